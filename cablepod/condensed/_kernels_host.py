"""Compiled steps of a condensed model whose upper end a host moves, and the force of the cable on that end.

The frame of the chord accelerates with the end.  In the rate of the absolute motion of a coordinate, q' + m n.u', with the
velocity u' of the end, the normal n and the moment m = integral of mu sigma phi of the shape, that inertia cancels:

    (q' + m n.u')' + alpha (q' + m n.u') = F(q, u)

The leapfrog scheme takes n.u' at the middle of a step from the positions of the end.  A host with the same scheme and the mass
of the end makes one symplectic scheme of both.

Tangential and normal force on the end are N(L0) = H + tau(L0) and V.  The balance of moments about the lower end gives V,

    c V = integral of N w' - h_0 integral of zeta + c (sum of m_i F_i - h_1 integral of sigma^2)

with the chord c, the loads h_0 + h_1 sigma along the normal, the moments m_i of the shapes and their accelerations F_i.  No slope
of a mode at the end is in it: few modes give slopes badly.
"""

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed import _kernels_layout as at
from cablepod.condensed._kernels_closure import _forces
from cablepod.condensed._kernels_drag import _add_drag
from cablepod.condensed._kernels_frame import _complete_axes
from cablepod.condensed._kernels_layout import Bounds, LeadingTerms, Sizes
from cablepod.condensed._kernels_recorder import _monitor_step
from cablepod.wind._kernels_drag import sample_at

#: The number of load patterns as a constant of the compiled code, see :class:`cablepod.condensed._kernels_layout.Sizes`.
TWO_PATTERNS = (0,) * at.PATTERNS


@compiled(forceinline=True, counted=False)
def _check(coefficients, accepted, end_position, end_velocity, end_acceleration, step):
    """Return the reason to refuse a step, DONE for none."""
    dims, numbers = coefficients.sizes[at.DIMS], coefficients.numbers
    squared, along_axis, total, reversal = 0.0, 0.0, 0.0, 0.0
    for d in range(dims):
        reach = end_position[d] - numbers[at.LOWER + d]
        squared += reach * reach
        reversal += reach * accepted[at.AXES, d]  # below zero for less than a right angle between the chords
        total += abs(end_velocity[d])
        along_axis += reach * numbers[at.FIRST_NORMAL + d]
    for d in range(end_acceleration.size):
        total += abs(end_acceleration[d])
    if not squared + total < np.inf:
        return at.INVALID_NUMBER
    if not 0.0 <= step < np.inf:
        return at.INVALID_STEP
    if not numbers[at.SHORTEST] * numbers[at.SHORTEST] <= squared <= numbers[at.LONGEST] * numbers[at.LONGEST]:
        return at.CHORD_OUT_OF_RANGE
    if reversal > 0.0:
        return at.CHORD_REVERSED
    if dims == 3 and along_axis * along_axis > numbers[at.ALONG_AXIS] * numbers[at.ALONG_AXIS] * squared:
        return at.CHORD_ALONG_AXIS
    if step * step * accepted[at.MONITOR, at.MAX_OMEGA_SQUARED] >= 4.0:
        return at.STEP_ABOVE_LIMIT
    return at.DONE


@compiled(forceinline=True, counted=False)
def _advance(coefficients, accepted, trial, end_position, end_velocity, end_acceleration, step):
    """Fill coordinates, rates, frame and boundary data at the end of a step; return the chordwise acceleration."""
    numbers, moments = coefficients.numbers, coefficients.by_coordinate[at.MOMENTS]
    r, dims, n_in_plane = coefficients.sizes[at.RANK], coefficients.sizes[at.DIMS], coefficients.sizes[at.IN_PLANE]
    damping, before = numbers[at.DAMPING], accepted[at.CLOCK, at.STEP]
    axes, inverse = trial[at.AXES :], (1.0 / step if step > 0.0 else 0.0)
    # rates go from the middle of the last step to that of this one
    between = 0.5 * (before + step)
    factor, impulse = accepted[at.CLOCK, at.FACTOR], accepted[at.CLOCK, at.IMPULSE]
    if between != accepted[at.CLOCK, at.BETWEEN]:
        factor, impulse = 1.0, between
        if damping > 0.0:
            factor, impulse = math.exp(-damping * between), -math.expm1(-damping * between) / damping
    trial[at.CLOCK, at.TIME], trial[at.CLOCK, at.STEP] = accepted[at.CLOCK, at.TIME] + step, step
    trial[at.CLOCK, at.COUNT], trial[at.CLOCK, at.BETWEEN] = accepted[at.CLOCK, at.COUNT] + 1.0, between
    trial[at.CLOCK, at.FACTOR], trial[at.CLOCK, at.IMPULSE] = factor, impulse
    for d in range(dims):
        trial[at.MEAN_VELOCITY, d] = (end_position[d] - accepted[at.END, d]) * inverse
        trial[at.END, d] = end_position[d]
    for k in range(dims - 1):
        gained = 0.0
        for d in range(dims):
            change = trial[at.MEAN_VELOCITY, d] - factor * accepted[at.MEAN_VELOCITY, d]
            gained += accepted[at.AXES + 1 + k, d] * change
        for i in range(0 if k == 0 else n_in_plane, n_in_plane if k == 0 else r):
            rate = factor * accepted[at.RATES, i] + impulse * accepted[at.UNDAMPED, i] - moments[i] * gained
            trial[at.RATES, i] = rate
            trial[at.Q, i] = accepted[at.Q, i] + step * rate
    for d in range(dims):
        axes[0, d] = numbers[at.LOWER + d] - end_position[d]
    chord = _complete_axes(axes, dims, numbers[at.FIRST_NORMAL :])
    along, damped = 0.0, 0.0
    for d in range(dims):
        # the velocity at the start is not given: no acceleration in the first step, then differences of two and three velocities
        slope, acceleration = 0.0, 0.0
        if before > 0.0:
            slope = (end_velocity[d] - accepted[at.VELOCITY, d]) * inverse
            acceleration = slope
        if accepted[at.CLOCK, at.COUNT] > 1.0:
            acceleration += (slope - accepted[at.VELOCITY_SLOPE, d]) * step / (step + before)
        if end_acceleration.size:
            acceleration = end_acceleration[d]
        trial[at.VELOCITY_SLOPE, d], trial[at.VELOCITY, d] = slope, end_velocity[d]
        along += acceleration * axes[0, d]
        damped += damping * end_velocity[d] * axes[0, d]
    # the inertia of the frame along the normals is in the rates
    trial[at.BOUNDARY, 0] = chord
    for k in range(dims):
        uniform = 0.0
        for d in range(dims):
            uniform += numbers[at.STEADY_LOAD + d] * axes[k, d]
        trial[at.BOUNDARY, 1 + at.PATTERNS * k] = uniform
        trial[at.BOUNDARY, 2 + at.PATTERNS * k] = -numbers[at.MASS] * (along + damped) if k == 0 else 0.0
    trial[at.MONITOR, at.MIN_FORCE] = accepted[at.MONITOR, at.MIN_FORCE]
    trial[at.MONITOR, at.MIN_FORCE_STEP] = accepted[at.MONITOR, at.MIN_FORCE_STEP]
    trial[at.MONITOR, at.MAX_OMEGA_SQUARED], trial[at.MONITOR, at.UNSTABLE_STEP] = 0.0, np.inf
    trial[at.MONITOR, at.OMEGA_SQUARED_LIMIT] = 4.0 * inverse * inverse if step > 0.0 else np.inf
    return along


@compiled(forceinline=True, counted=False)
def _terms(coefficients):
    """Return the coefficients of the forces by name."""
    numbers = coefficients.numbers
    kappa, means = coefficients.by_coordinate[at.KAPPA], coefficients.by_pattern[at.MEANS]
    return LeadingTerms(
        numbers[at.STIFFNESS : at.STIFFNESS + 1], numbers[at.INVERSE_LENGTH : at.INVERSE_LENGTH + 1],
        numbers[at.SAG_STIFFNESS : at.SAG_STIFFNESS + 1], kappa, means, coefficients.geometric_stiffness,
        coefficients.load_projection,
    )  # fmt: skip


@compiled(forceinline=True, counted=False)
def _end_force(coefficients, row, q, f, chord_tension, axes, force):
    """Fill the force of the cable on the upper end (dims,) [N].

    Parameters
    ----------
    coefficients, row
        See :class:`cablepod.condensed._kernels_layout.HostCoefficients`; boundary data of the instant.
    q, f
        Coordinates and undamped accelerations (r,).
    chord_tension
        H [N].
    axes, force
        Direction from the upper end to the lower one and normals (dims, dims); filled (dims,).
    """
    sizes, numbers, moments = coefficients.sizes, coefficients.numbers, coefficients.by_coordinate[at.MOMENTS]
    r, dims, n_in_plane = sizes[at.RANK], sizes[at.DIMS], sizes[at.IN_PLANE]
    kappa, by_pattern = coefficients.by_coordinate[at.KAPPA], coefficients.by_pattern
    beyond, compliance = numbers[at.LENGTH] - numbers[at.FIRST_TRIBUTARY], 1.0 / numbers[at.STIFFNESS]
    # N(L0), integrals of N w' along both normals, integral of zeta
    along, first, second = chord_tension, 0.0, 0.0
    reach = numbers[at.REACH_MOMENT] * (1.0 + chord_tension * compliance)
    for a in range(at.PATTERNS):
        g = row[1 + a]
        along += g * by_pattern[at.AT_END, a]
        reach += g * by_pattern[at.REACH_LOADS, a] * compliance
        for i in range(n_in_plane):
            first += g * coefficients.by_coordinate[at.SLOPE_MOMENTS + a, i] * q[i]
        for i in range(n_in_plane, r):
            second += g * coefficients.by_coordinate[at.SLOPE_MOMENTS + a, i] * q[i]
    for i in range(r):
        total = beyond * kappa[i] * q[i]
        for j in range(r):
            total -= coefficients.geometric_stiffness[np.uintp(i * r + j)] * q[np.uintp(j)]
        reach -= 0.5 * total * q[i]
    inverse = 1.0 / row[0]
    for d in range(dims):
        force[d] = along * axes[0, d]
    for k in range(dims - 1):
        uniform, growing = row[1 + at.PATTERNS * (1 + k)], row[2 + at.PATTERNS * (1 + k)]
        transverse = ((first if k == 0 else second) - uniform * reach) * inverse - growing * numbers[at.SECOND_MOMENT]
        for i in range(0 if k == 0 else n_in_plane, n_in_plane if k == 0 else r):
            transverse += moments[i] * f[i]
        for d in range(dims):
            force[d] -= transverse * axes[1 + k, d]


@compiled(forceinline=True, counted=False)
def _finish(coefficients, trial, chord_tension, end_velocity, end_acceleration, along):
    """Complete the force on the end: without the inertia of the end mass unless the acceleration is given; return the status."""
    numbers, dims = coefficients.numbers, coefficients.sizes[at.DIMS]
    force, axes = trial[at.END_FORCE], trial[at.AXES :]
    damping, given = numbers[at.DAMPING], end_acceleration.size > 0
    if not given:
        for d in range(dims):
            force[d] += numbers[at.END_MASS] * along * axes[0, d]
    if given or damping > 0.0:
        for k in range(1, dims):
            normal = 0.0
            for d in range(dims):
                normal += axes[k, d] * damping * end_velocity[d]
                if given:
                    normal += axes[k, d] * end_acceleration[d]
            for d in range(dims):
                force[d] -= numbers[at.END_MASS + k] * normal * axes[k, d]
    total, others = 0.0, 0.0
    for i in range(coefficients.sizes[at.RANK]):
        total += abs(trial[at.Q, i])
        others += abs(trial[at.RATES, i]) + abs(trial[at.UNDAMPED, i])
    for d in range(dims):
        others += abs(force[d]) + abs(trial[at.VELOCITY_SLOPE, d]) + abs(trial[at.MEAN_VELOCITY, d])
    if not total <= numbers[at.DIVERGED_ABOVE]:
        return at.DIVERGED
    if not abs(chord_tension) < np.inf:
        return at.NO_EQUILIBRIUM
    if not others < np.inf:
        return at.DIVERGED
    if trial[at.MONITOR, at.UNSTABLE_STEP] < np.inf:
        return at.STIFFENED
    return at.DONE


@compiled(forceinline=True, counted=False)
def _add_air(air, coefficients, accepted, trial, end_velocity, step, q, f):
    """Add the drag to the accelerations f (r,), and fill its moments in row AIR_MOMENTS; nothing in still air.

    The rates at the end of a step are extrapolated from the middles of this step and the last one.
    """
    if air is None:
        return
    dims, r = coefficients.sizes[at.DIMS], coefficients.sizes[at.RANK]
    rates, between, points = trial[at.AIR_RATES], trial[at.CLOCK, at.BETWEEN], air.drag.size
    weight = 0.5 * step / between if between > 0.0 else 0.0
    for i in range(r):
        rates[i] = trial[at.RATES, i] + weight * (trial[at.RATES, i] - accepted[at.RATES, i])
    sample, share = sample_at(trial[at.CLOCK, at.TIME] * air.samples_per_second, air.velocity.shape[0])
    first = at.AIR_VELOCITY
    for g in range(points):
        for k in range(dims):
            total = 0.0
            for d in range(dims):
                before, after = air.velocity[sample, d, g], air.velocity[sample + 1, d, g]
                relative = before + share * (after - before) - air.sigma[g] * end_velocity[d]
                total += relative * trial[at.AXES + k, d]
            trial[first + k, g] = -total if k == 0 else total  # axis 0 points to the lower end
    _add_drag(
        q, rates, trial[at.BOUNDARY, 0] * coefficients.numbers[at.INVERSE_LENGTH], None, trial[first, :points],
        trial[first + 1, :points], trial[first + dims - 1, :points], trial[first + dims, :points],
        trial[first + 2 * dims - 1, :points], air.drag, air.shapes, coefficients.sizes[at.IN_PLANE], air.sigma,
        trial[at.AIR_MOMENTS], f,
    )  # fmt: skip


@compiled(forceinline=True, counted=False)
def _add_moments(air, coefficients, trial):
    """Add the reaction to the moments of the drag to the force on the end; nothing in still air."""
    if air is None:
        return
    dims = coefficients.sizes[at.DIMS]
    for k in range(dims - 1):
        for d in range(dims):
            trial[at.END_FORCE, d] += trial[at.AIR_MOMENTS, k] * trial[at.AXES + 1 + k, d]


@compiled(forceinline=True, counted=False)
def leading_trial(coefficients, accepted, trial, end_position, end_velocity, end_acceleration, step):
    """Fill the state after a step of the upper end.

    Parameters
    ----------
    coefficients, accepted
        See :class:`cablepod.condensed._kernels_layout.HostCoefficients`; state before the step (rows, columns).
    trial
        State after the step; filled, a function of the arguments alone.  Row END_FORCE holds the force on the end [N], row Q
        the coordinates, entry ``[CLOCK, TIME]`` the time [s].
    end_position, end_velocity
        Of the upper end at the end of the step (dims,) [m, m/s].
    end_acceleration
        The same (dims,) [m/s^2]; without entries the force lacks the inertia of the end mass, and the chordwise acceleration in
        the cable follows from the last velocities.
    step
        [s]

    Returns
    -------
    int
        DONE, or the reason why `trial` is not to be accepted, one of :mod:`cablepod.condensed._kernels_layout`.
    """
    status = _check(coefficients, accepted, end_position, end_velocity, end_acceleration, step)
    if status != at.DONE:
        return status
    along = _advance(coefficients, accepted, trial, end_position, end_velocity, end_acceleration, step)
    r, by_pattern = coefficients.sizes[at.RANK], coefficients.by_pattern
    row, monitor = trial[at.BOUNDARY], trial[at.MONITOR]
    q, f, tension = trial[at.Q, :r], trial[at.UNDAMPED, :r], trial[at.MONITOR, at.CHORD_TENSION : at.CHORD_TENSION + 1]
    terms = _terms(coefficients)
    least = trial[at.MONITOR, at.LEAST_FORCE : at.LEAST_FORCE + 1]
    bounds = Bounds(by_pattern[at.NORMS], by_pattern[at.AT_CANDIDATES :], least)
    sizes = Sizes((0,), q, TWO_PATTERNS, row[: at.PATTERNS * (coefficients.sizes[at.DIMS] - 1)])
    _forces(sizes, terms, row, q, tension, f)
    _add_air(coefficients.air, coefficients, accepted, trial, end_velocity, step, q, f)
    _monitor_step(sizes, terms, bounds, row, q, tension, trial[at.CLOCK, at.COUNT], monitor)
    _end_force(coefficients, row, q, f, tension[0], trial[at.AXES :], trial[at.END_FORCE])
    _add_moments(coefficients.air, coefficients, trial)
    return _finish(coefficients, trial, tension[0], end_velocity, end_acceleration, along)


@compiled(counted=False)
def end_forces(coefficients, q, boundary_data, ends, f, axes, tension, force):
    """Fill the forces of the cable on the upper end (times, dims) [N] of a run in still air, inertia included.

    Parameters
    ----------
    coefficients
        See :class:`cablepod.condensed._kernels_layout.HostCoefficients`; the lower end is that of `ends`.
    q, boundary_data
        Coordinates (times, r); rows of :func:`cablepod.condensed._frame.chord_and_loads` at the same instants.
    ends
        Positions of the ends (times, 2, dims) [m].
    f, axes, tension
        Work arrays (r,), (dims, dims), (1,).
    force
        Filled.
    """
    dims, terms = coefficients.sizes[at.DIMS], _terms(coefficients)
    for i in range(q.shape[0]):
        row = boundary_data[i]
        for d in range(dims):
            axes[0, d] = ends[i, 0, d] - ends[i, 1, d]
        _complete_axes(axes, dims, coefficients.numbers[at.FIRST_NORMAL :])
        _forces(Sizes((0,), f, TWO_PATTERNS, row[1 + at.PATTERNS :]), terms, row, q[i], tension, f)
        _end_force(coefficients, row, q[i], f, tension[0], axes, force[i])
