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
from cablepod.condensed._kernels_closure import _forces
from cablepod.condensed._kernels_drag import _add_drag
from cablepod.condensed._kernels_frame import _complete_axes
from cablepod.condensed._kernels_layout import (
    AIR_MOMENTS,
    AIR_RATES,
    AIR_VELOCITY,
    ALONG_AXIS,
    AT_CANDIDATES,
    AT_END,
    AXES,
    BETWEEN,
    BOUNDARY,
    CHORD_ALONG_AXIS,
    CHORD_OUT_OF_RANGE,
    CHORD_REVERSED,
    CHORD_TENSION,
    CLOCK,
    COUNT,
    DAMPING,
    DIMS,
    DIVERGED,
    DIVERGED_ABOVE,
    DONE,
    END,
    END_FORCE,
    END_MASS,
    FACTOR,
    FIRST_NORMAL,
    FIRST_TRIBUTARY,
    IMPULSE,
    IN_PLANE,
    INVALID_NUMBER,
    INVALID_STEP,
    INVERSE_LENGTH,
    KAPPA,
    LEAST_FORCE,
    LENGTH,
    LONGEST,
    LOWER,
    MASS,
    MAX_OMEGA_SQUARED,
    MEAN_VELOCITY,
    MEANS,
    MIN_FORCE,
    MIN_FORCE_STEP,
    MOMENTS,
    MONITOR,
    NO_EQUILIBRIUM,
    NORMS,
    OMEGA_SQUARED_LIMIT,
    PATTERNS,
    RANK,
    RATES,
    REACH_LOADS,
    REACH_MOMENT,
    SAG_STIFFNESS,
    SECOND_MOMENT,
    SHORTEST,
    SLOPE_MOMENTS,
    STEADY_LOAD,
    STEP,
    STEP_ABOVE_LIMIT,
    STIFFENED,
    STIFFNESS,
    TIME,
    UNDAMPED,
    UNSTABLE_STEP,
    VELOCITY,
    VELOCITY_SLOPE,
    Bounds,
    LeadingTerms,
    Q,
    Sizes,
)
from cablepod.condensed._kernels_recorder import _monitor_step
from cablepod.wind._kernels_drag import sample_at

#: The number of load patterns as a constant of the compiled code, see :class:`cablepod.condensed._kernels_layout.Sizes`.
TWO_PATTERNS = (0,) * PATTERNS


@compiled(forceinline=True, counted=False)
def _check(coefficients, accepted, end_position, end_velocity, end_acceleration, step):
    """Return the reason to refuse a step, DONE for none."""
    dims, numbers = coefficients.sizes[DIMS], coefficients.numbers
    squared, along_axis, total, reversal = 0.0, 0.0, 0.0, 0.0
    for d in range(dims):
        reach = end_position[d] - numbers[LOWER + d]
        squared += reach * reach
        reversal += reach * accepted[AXES, d]  # below zero for less than a right angle between the chords
        total += abs(end_velocity[d])
        along_axis += reach * numbers[FIRST_NORMAL + d]
    for d in range(end_acceleration.size):
        total += abs(end_acceleration[d])
    if not squared + total < np.inf:
        return INVALID_NUMBER
    if not 0.0 <= step < np.inf:
        return INVALID_STEP
    if not numbers[SHORTEST] * numbers[SHORTEST] <= squared <= numbers[LONGEST] * numbers[LONGEST]:
        return CHORD_OUT_OF_RANGE
    if reversal > 0.0:
        return CHORD_REVERSED
    if dims == 3 and along_axis * along_axis > numbers[ALONG_AXIS] * numbers[ALONG_AXIS] * squared:
        return CHORD_ALONG_AXIS
    if step * step * accepted[MONITOR, MAX_OMEGA_SQUARED] >= 4.0:
        return STEP_ABOVE_LIMIT
    return DONE


@compiled(forceinline=True, counted=False)
def _advance(coefficients, accepted, trial, end_position, end_velocity, end_acceleration, step):
    """Fill coordinates, rates, frame and boundary data at the end of a step; return the chordwise acceleration."""
    numbers, moments = coefficients.numbers, coefficients.by_coordinate[MOMENTS]
    r, dims, n_in_plane = coefficients.sizes[RANK], coefficients.sizes[DIMS], coefficients.sizes[IN_PLANE]
    damping, before = numbers[DAMPING], accepted[CLOCK, STEP]
    axes, inverse = trial[AXES:], (1.0 / step if step > 0.0 else 0.0)
    # rates go from the middle of the last step to that of this one
    between = 0.5 * (before + step)
    factor, impulse = accepted[CLOCK, FACTOR], accepted[CLOCK, IMPULSE]
    if between != accepted[CLOCK, BETWEEN]:
        factor, impulse = 1.0, between
        if damping > 0.0:
            factor, impulse = math.exp(-damping * between), -math.expm1(-damping * between) / damping
    trial[CLOCK, TIME], trial[CLOCK, STEP] = accepted[CLOCK, TIME] + step, step
    trial[CLOCK, COUNT], trial[CLOCK, BETWEEN] = accepted[CLOCK, COUNT] + 1.0, between
    trial[CLOCK, FACTOR], trial[CLOCK, IMPULSE] = factor, impulse
    for d in range(dims):
        trial[MEAN_VELOCITY, d] = (end_position[d] - accepted[END, d]) * inverse
        trial[END, d] = end_position[d]
    for k in range(dims - 1):
        gained = 0.0
        for d in range(dims):
            gained += accepted[AXES + 1 + k, d] * (trial[MEAN_VELOCITY, d] - factor * accepted[MEAN_VELOCITY, d])
        for i in range(0 if k == 0 else n_in_plane, n_in_plane if k == 0 else r):
            rate = factor * accepted[RATES, i] + impulse * accepted[UNDAMPED, i] - moments[i] * gained
            trial[RATES, i] = rate
            trial[Q, i] = accepted[Q, i] + step * rate
    for d in range(dims):
        axes[0, d] = numbers[LOWER + d] - end_position[d]
    chord = _complete_axes(axes, dims, numbers[FIRST_NORMAL:])
    along, damped = 0.0, 0.0
    for d in range(dims):
        # the velocity at the start is not given: no acceleration in the first step, then differences of two and three velocities
        slope, acceleration = 0.0, 0.0
        if before > 0.0:
            slope = (end_velocity[d] - accepted[VELOCITY, d]) * inverse
            acceleration = slope
        if accepted[CLOCK, COUNT] > 1.0:
            acceleration += (slope - accepted[VELOCITY_SLOPE, d]) * step / (step + before)
        if end_acceleration.size:
            acceleration = end_acceleration[d]
        trial[VELOCITY_SLOPE, d], trial[VELOCITY, d] = slope, end_velocity[d]
        along += acceleration * axes[0, d]
        damped += damping * end_velocity[d] * axes[0, d]
    # the inertia of the frame along the normals is in the rates
    trial[BOUNDARY, 0] = chord
    for k in range(dims):
        uniform = 0.0
        for d in range(dims):
            uniform += numbers[STEADY_LOAD + d] * axes[k, d]
        trial[BOUNDARY, 1 + PATTERNS * k] = uniform
        trial[BOUNDARY, 2 + PATTERNS * k] = -numbers[MASS] * (along + damped) if k == 0 else 0.0
    trial[MONITOR, MIN_FORCE] = accepted[MONITOR, MIN_FORCE]
    trial[MONITOR, MIN_FORCE_STEP] = accepted[MONITOR, MIN_FORCE_STEP]
    trial[MONITOR, MAX_OMEGA_SQUARED], trial[MONITOR, UNSTABLE_STEP] = 0.0, np.inf
    trial[MONITOR, OMEGA_SQUARED_LIMIT] = 4.0 * inverse * inverse if step > 0.0 else np.inf
    return along


@compiled(forceinline=True, counted=False)
def _terms(coefficients):
    """Return the coefficients of the forces by name."""
    numbers, kappa, means = coefficients.numbers, coefficients.by_coordinate[KAPPA], coefficients.by_pattern[MEANS]
    return LeadingTerms(
        numbers[STIFFNESS : STIFFNESS + 1], numbers[INVERSE_LENGTH : INVERSE_LENGTH + 1],
        numbers[SAG_STIFFNESS : SAG_STIFFNESS + 1], kappa, means, coefficients.geometric_stiffness,
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
    sizes, numbers, moments = coefficients.sizes, coefficients.numbers, coefficients.by_coordinate[MOMENTS]
    r, dims, n_in_plane = sizes[RANK], sizes[DIMS], sizes[IN_PLANE]
    kappa, by_pattern = coefficients.by_coordinate[KAPPA], coefficients.by_pattern
    beyond, compliance = numbers[LENGTH] - numbers[FIRST_TRIBUTARY], 1.0 / numbers[STIFFNESS]
    # N(L0), integrals of N w' along both normals, integral of zeta
    along, first, second = chord_tension, 0.0, 0.0
    reach = numbers[REACH_MOMENT] * (1.0 + chord_tension * compliance)
    for a in range(PATTERNS):
        g = row[1 + a]
        along += g * by_pattern[AT_END, a]
        reach += g * by_pattern[REACH_LOADS, a] * compliance
        for i in range(n_in_plane):
            first += g * coefficients.by_coordinate[SLOPE_MOMENTS + a, i] * q[i]
        for i in range(n_in_plane, r):
            second += g * coefficients.by_coordinate[SLOPE_MOMENTS + a, i] * q[i]
    for i in range(r):
        total = beyond * kappa[i] * q[i]
        for j in range(r):
            total -= coefficients.geometric_stiffness[np.uintp(i * r + j)] * q[np.uintp(j)]
        reach -= 0.5 * total * q[i]
    inverse = 1.0 / row[0]
    for d in range(dims):
        force[d] = along * axes[0, d]
    for k in range(dims - 1):
        uniform, growing = row[1 + PATTERNS * (1 + k)], row[2 + PATTERNS * (1 + k)]
        transverse = ((first if k == 0 else second) - uniform * reach) * inverse - growing * numbers[SECOND_MOMENT]
        for i in range(0 if k == 0 else n_in_plane, n_in_plane if k == 0 else r):
            transverse += moments[i] * f[i]
        for d in range(dims):
            force[d] -= transverse * axes[1 + k, d]


@compiled(forceinline=True, counted=False)
def _finish(coefficients, trial, chord_tension, end_velocity, end_acceleration, along):
    """Complete the force on the end: without the inertia of the end mass unless the acceleration is given; return the status."""
    numbers, dims = coefficients.numbers, coefficients.sizes[DIMS]
    force, axes = trial[END_FORCE], trial[AXES:]
    damping, given = numbers[DAMPING], end_acceleration.size > 0
    if not given:
        for d in range(dims):
            force[d] += numbers[END_MASS] * along * axes[0, d]
    if given or damping > 0.0:
        for k in range(1, dims):
            normal = 0.0
            for d in range(dims):
                normal += axes[k, d] * damping * end_velocity[d]
                if given:
                    normal += axes[k, d] * end_acceleration[d]
            for d in range(dims):
                force[d] -= numbers[END_MASS + k] * normal * axes[k, d]
    total, others = 0.0, 0.0
    for i in range(coefficients.sizes[RANK]):
        total += abs(trial[Q, i])
        others += abs(trial[RATES, i]) + abs(trial[UNDAMPED, i])
    for d in range(dims):
        others += abs(force[d]) + abs(trial[VELOCITY_SLOPE, d]) + abs(trial[MEAN_VELOCITY, d])
    if not total <= numbers[DIVERGED_ABOVE]:
        return DIVERGED
    if not abs(chord_tension) < np.inf:
        return NO_EQUILIBRIUM
    if not others < np.inf:
        return DIVERGED
    if trial[MONITOR, UNSTABLE_STEP] < np.inf:
        return STIFFENED
    return DONE


@compiled(forceinline=True, counted=False)
def _add_air(air, coefficients, accepted, trial, end_velocity, step, q, f):
    """Add the drag to the accelerations f (r,), and fill its moments in row AIR_MOMENTS; nothing in still air.

    The rates at the end of a step are extrapolated from the middles of this step and the last one.
    """
    if air is None:
        return
    dims, r = coefficients.sizes[DIMS], coefficients.sizes[RANK]
    rates, between, points = trial[AIR_RATES], trial[CLOCK, BETWEEN], air.drag.size
    weight = 0.5 * step / between if between > 0.0 else 0.0
    for i in range(r):
        rates[i] = trial[RATES, i] + weight * (trial[RATES, i] - accepted[RATES, i])
    sample, share = sample_at(trial[CLOCK, TIME] * air.samples_per_second, air.velocity.shape[0])
    first = AIR_VELOCITY
    for g in range(points):
        for k in range(dims):
            total = 0.0
            for d in range(dims):
                before, after = air.velocity[sample, d, g], air.velocity[sample + 1, d, g]
                relative = before + share * (after - before) - air.sigma[g] * end_velocity[d]
                total += relative * trial[AXES + k, d]
            trial[first + k, g] = -total if k == 0 else total  # axis 0 points to the lower end
    _add_drag(
        q, rates, trial[BOUNDARY, 0] * coefficients.numbers[INVERSE_LENGTH], None, trial[first, :points],
        trial[first + 1, :points], trial[first + dims - 1, :points], trial[first + dims, :points],
        trial[first + 2 * dims - 1, :points], air.drag, air.shapes, coefficients.sizes[IN_PLANE], air.sigma,
        trial[AIR_MOMENTS], f,
    )  # fmt: skip


@compiled(forceinline=True, counted=False)
def _add_moments(air, coefficients, trial):
    """Add the reaction to the moments of the drag to the force on the end; nothing in still air."""
    if air is None:
        return
    dims = coefficients.sizes[DIMS]
    for k in range(dims - 1):
        for d in range(dims):
            trial[END_FORCE, d] += trial[AIR_MOMENTS, k] * trial[AXES + 1 + k, d]


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
    if status != DONE:
        return status
    along = _advance(coefficients, accepted, trial, end_position, end_velocity, end_acceleration, step)
    r, row, monitor, by_pattern = coefficients.sizes[RANK], trial[BOUNDARY], trial[MONITOR], coefficients.by_pattern
    q, f, tension = trial[Q, :r], trial[UNDAMPED, :r], trial[MONITOR, CHORD_TENSION : CHORD_TENSION + 1]
    terms = _terms(coefficients)
    bounds = Bounds(by_pattern[NORMS], by_pattern[AT_CANDIDATES:], trial[MONITOR, LEAST_FORCE : LEAST_FORCE + 1])
    sizes = Sizes((0,), q, TWO_PATTERNS, row[: PATTERNS * (coefficients.sizes[DIMS] - 1)])
    _forces(sizes, terms, row, q, tension, f)
    _add_air(coefficients.air, coefficients, accepted, trial, end_velocity, step, q, f)
    _monitor_step(sizes, terms, bounds, row, q, tension, trial[CLOCK, COUNT], monitor)
    _end_force(coefficients, row, q, f, tension[0], trial[AXES:], trial[END_FORCE])
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
    dims, terms = coefficients.sizes[DIMS], _terms(coefficients)
    for i in range(q.shape[0]):
        row = boundary_data[i]
        for d in range(dims):
            axes[0, d] = ends[i, 0, d] - ends[i, 1, d]
        _complete_axes(axes, dims, coefficients.numbers[FIRST_NORMAL:])
        _forces(Sizes((0,), f, TWO_PATTERNS, row[1 + PATTERNS :]), terms, row, q[i], tension, f)
        _end_force(coefficients, row, q[i], f, tension[0], axes, force[i])
