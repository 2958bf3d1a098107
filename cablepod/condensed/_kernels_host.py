"""Compiled steps of a condensed model whose upper end a host moves, and the force of the cable on that end.

The frame of the chord accelerates with the end.  In the rate of the absolute motion of a coordinate, q' + m n.u', with the
velocity u' of the end, the normal n and the moment m = integral of mu sigma phi of the shape, that inertia cancels:

    (q' + m n.u')' + alpha (q' + m n.u') = F(q, u)

The leapfrog scheme takes n.u' at the middle of a step from the positions of the end.  A host with the same scheme and the mass
of the end makes one symplectic scheme of both.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_drag import _add_drag
from cablepod.condensed._kernels_end_force import _end_force, _leading_end_force
from cablepod.condensed._kernels_exact import _monitor_step as _monitor_exact
from cablepod.condensed._kernels_exact import exact_force
from cablepod.condensed._kernels_frame import _complete_axes
from cablepod.condensed._kernels_host_layout import (
    AIR_MOMENTS,
    AIR_RATES,
    AIR_VELOCITY,
    ALONG_AXIS,
    ARMS,
    AT_CANDIDATES,
    AT_END,
    AXES,
    BETWEEN,
    BOUNDARY,
    CHORD_ALONG_AXIS,
    CHORD_OUT_OF_RANGE,
    CHORD_REVERSED,
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
    EXACT_ROWS,
    FACTOR,
    FORCES,
    IMPULSE,
    IN_PLANE,
    INVALID_NUMBER,
    INVALID_STEP,
    KAPPA,
    LAST_STRETCH,
    LEADING_ROWS,
    LENGTH,
    LONGEST,
    LOWER,
    MASS,
    MEAN_VELOCITY,
    MEANS,
    MOMENTS,
    MONITOR,
    NO_EQUILIBRIUM,
    NORMS,
    PATTERNS,
    PREDICTED_STRETCH,
    PROJECTION,
    RANK,
    RATES,
    REFERENCE,
    SHORTEST,
    SLOPE,
    SLOPES,
    STEADY_LOAD,
    STEP,
    STEP_ABOVE_LIMIT,
    STIFFENED,
    STIFFNESS,
    TIME,
    UNDAMPED,
    VELOCITY,
    VELOCITY_SLOPE,
    WEIGHTS,
    WORK,
    Q,
)
from cablepod.condensed._kernels_layout import (
    CHORD_TENSION,
    FORCE,
    MAX_OMEGA_SQUARED,
    MIN_FORCE,
    MIN_FORCE_STEP,
    OMEGA_SQUARED_LIMIT,
    PREDICTED_TENSION,
    UNSTABLE_STEP,
)
from cablepod.condensed._kernels_leading import _chord_tension, _leading_acceleration
from cablepod.condensed._kernels_leading import _monitor_step as _monitor_leading


@compiled(inline="always")
def _check(coefficients, accepted, end_position, end_velocity, end_acceleration, step):
    """Return the reason to refuse a step, DONE for none."""
    dims, numbers = coefficients.sizes[DIMS], coefficients.numbers
    squared, along_axis, total, reversal = 0.0, 0.0, 0.0, 0.0
    for d in range(dims):
        reach = end_position[d] - numbers[LOWER + d]
        squared += reach * reach
        reversal += reach * accepted[AXES, d]  # below zero for less than a right angle between the chords
        total += abs(end_velocity[d])
        if dims == 3 and d == coefficients.sizes[REFERENCE]:
            along_axis = reach * reach
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
    if along_axis > numbers[ALONG_AXIS] * numbers[ALONG_AXIS] * squared:
        return CHORD_ALONG_AXIS
    if step * step * accepted[MONITOR, MAX_OMEGA_SQUARED] >= 4.0:
        return STEP_ABOVE_LIMIT
    return DONE


@compiled(inline="always")
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
    chord = _complete_axes(axes, dims, coefficients.sizes[REFERENCE])
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
    trial[MONITOR, MIN_FORCE], trial[MONITOR, MIN_FORCE_STEP] = (
        accepted[MONITOR, MIN_FORCE],
        accepted[MONITOR, MIN_FORCE_STEP],
    )
    trial[MONITOR, MAX_OMEGA_SQUARED], trial[MONITOR, UNSTABLE_STEP] = 0.0, np.inf
    trial[MONITOR, OMEGA_SQUARED_LIMIT] = 4.0 * inverse * inverse if step > 0.0 else np.inf
    return along


@compiled(inline="always")
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
def _add_air(air, coefficients, accepted, trial, first_row, end_velocity, step, q, stretch, exact, f):
    """Add the drag to the accelerations f (r,), and fill its moments in row `first_row` + AIR_MOMENTS; nothing in still air.

    The rates at the end of a step are extrapolated from the middles of this step and the last one.
    """
    if air is None:
        return
    dims, r = coefficients.sizes[DIMS], coefficients.sizes[RANK]
    rates, between, points = trial[first_row + AIR_RATES], trial[CLOCK, BETWEEN], air.drag.size
    weight = 0.5 * step / between if between > 0.0 else 0.0
    for i in range(r):
        rates[i] = trial[RATES, i] + weight * (trial[RATES, i] - accepted[RATES, i])
    samples = air.velocity.shape[0]
    place = min(max(trial[CLOCK, TIME] * air.samples_per_second, 0.0), samples - 1.0)
    sample = min(int(place), samples - 2)
    share, first = place - sample, first_row + AIR_VELOCITY
    for g in range(points):
        for k in range(dims):
            total = 0.0
            for d in range(dims):
                before, after = air.velocity[sample, d, g], air.velocity[sample + 1, d, g]
                relative = before + share * (after - before) - air.sigma[g] * end_velocity[d]
                total += relative * trial[AXES + k, d]
            trial[first + k, g] = -total if k == 0 else total  # axis 0 points to the lower end
    _add_drag(
        q, rates, stretch, exact, trial[first, :points], trial[first + 1, :points], trial[first + dims - 1, :points],
        trial[first + dims, :points], trial[first + 2 * dims - 1, :points], air.drag, air.shapes, coefficients.sizes[IN_PLANE],
        air.sigma, trial[first_row + AIR_MOMENTS], f,
    )  # fmt: skip


@compiled(forceinline=True, counted=False)
def _add_moments(air, coefficients, trial, first_row):
    """Add the reaction to the moments of the drag to the force on the end; nothing in still air."""
    if air is None:
        return
    dims = coefficients.sizes[DIMS]
    for k in range(dims - 1):
        for d in range(dims):
            trial[END_FORCE, d] += trial[first_row + AIR_MOMENTS, k] * trial[AXES + 1 + k, d]


@compiled(forceinline=True, counted=False)
def leading_trial(coefficients, accepted, trial, end_position, end_velocity, end_acceleration, step):
    """Fill the state after a step of the upper end, to leading order.

    Parameters
    ----------
    coefficients
        See :class:`cablepod.condensed._kernels_host_layout.HostCoefficients`.
    accepted
        State before the step (rows, columns); not changed.
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
        DONE, or the reason why `trial` is not to be accepted, one of the constants of this file.
    """
    status = _check(coefficients, accepted, end_position, end_velocity, end_acceleration, step)
    if status != DONE:
        return status
    along = _advance(coefficients, accepted, trial, end_position, end_velocity, end_acceleration, step)
    r, boundary_data, monitor = coefficients.sizes[RANK], trial[BOUNDARY : BOUNDARY + 1], trial[MONITOR]
    q, f = trial[Q, :r], trial[UNDAMPED]
    kappa, by_pattern = coefficients.by_coordinate[KAPPA], coefficients.by_pattern
    stiffness, length = coefficients.numbers[STIFFNESS], coefficients.numbers[LENGTH]
    chord_tension = _chord_tension(q, boundary_data, 0, kappa, by_pattern[MEANS], stiffness, length)
    _leading_acceleration(
        q, boundary_data, 0, chord_tension, kappa, coefficients.geometric_stiffness,
        coefficients.by_coordinate[PROJECTION:], f,
    )  # fmt: skip
    _add_air(
        coefficients.air, coefficients, accepted, trial, LEADING_ROWS, end_velocity, step, q, boundary_data[0, 0] / length, None,
        f,
    )  # fmt: skip
    _monitor_leading(
        trial[CLOCK, COUNT], q, boundary_data, 0, chord_tension, kappa, by_pattern[NORMS], by_pattern[AT_CANDIDATES:].T,
        stiffness, length, monitor,
    )  # fmt: skip
    monitor[CHORD_TENSION] = chord_tension
    monitor[PREDICTED_TENSION] = chord_tension
    _leading_end_force(coefficients, q, f, boundary_data, 0, chord_tension, trial[AXES:], trial[END_FORCE])
    _add_moments(coefficients.air, coefficients, trial, LEADING_ROWS)
    return _finish(coefficients, trial, chord_tension, end_velocity, end_acceleration, along)


@compiled(forceinline=True, counted=False)
def exact_trial(coefficients, accepted, trial, end_position, end_velocity, end_acceleration, step):
    """Fill the state after a step of the upper end, with the exact chordwise stretch; as :func:`leading_trial`."""
    status = _check(coefficients, accepted, end_position, end_velocity, end_acceleration, step)
    if status != DONE:
        return status
    along = _advance(coefficients, accepted, trial, end_position, end_velocity, end_acceleration, step)
    r, boundary_data, monitor = coefficients.sizes[RANK], trial[BOUNDARY : BOUNDARY + 1], trial[MONITOR]
    q, rates, f = trial[Q, :r], trial[RATES, :r], trial[UNDAMPED]
    by_coordinate, by_pattern, by_point = coefficients.by_coordinate, coefficients.by_pattern, coefficients.by_point
    stiffness, length = coefficients.numbers[STIFFNESS], coefficients.numbers[LENGTH]
    m, n_in_plane = by_point.shape[1], coefficients.sizes[IN_PLANE]
    stretch, last = trial[PREDICTED_STRETCH, :m], trial[LAST_STRETCH, :m]
    for j in range(m):
        stretch[j] = accepted[PREDICTED_STRETCH, j]
    work, slope, no_array = trial[WORK:SLOPE], trial[SLOPE:], trial[:0]
    guess, chord_tension = accepted[MONITOR, PREDICTED_TENSION], np.nan
    for _ in range(2):
        chord_tension = exact_force(
            q, rates, boundary_data, 0, by_point[SLOPES:], n_in_plane, by_point[FORCES:SLOPES], by_point[WEIGHTS], stiffness,
            False, by_coordinate[PROJECTION:], no_array, guess, stretch, work, slope, no_array, no_array, f, no_array,
            no_array,
        )  # fmt: skip
        if abs(chord_tension) < np.inf:
            break
        # extrapolated too far: once more from the last step
        guess = accepted[MONITOR, CHORD_TENSION]
        for j in range(m):
            stretch[j] = accepted[LAST_STRETCH, j]
    _add_air(
        coefficients.air, coefficients, accepted, trial, EXACT_ROWS, end_velocity, step, q, 1.0 + chord_tension / stiffness, True,
        f,
    )  # fmt: skip
    _monitor_exact(
        trial[CLOCK, COUNT], q, boundary_data, 0, chord_tension, work[FORCE, :m], by_coordinate[KAPPA], by_pattern[NORMS],
        stiffness, length, monitor,
    )  # fmt: skip
    along_force, first, second, reach = chord_tension, 0.0, 0.0, 0.0
    for a in range(PATTERNS):
        along_force += boundary_data[0, 1 + a] * by_pattern[AT_END, a]
    for j in range(m):
        weight = by_point[WEIGHTS, j]
        first += weight * work[FORCE, j] * slope[0, j]
        second += weight * work[FORCE, j] * slope[1, j]
        reach += weight * by_point[ARMS, j] * stretch[j]
    _end_force(coefficients, f, boundary_data, 0, along_force, first, second, reach, trial[AXES:], trial[END_FORCE])
    _add_moments(coefficients.air, coefficients, trial, EXACT_ROWS)
    # first guess for the next step: linear extrapolation, but not from the start, which has one state only
    extrapolation = 1.0 if accepted[CLOCK, STEP] > 0.0 else 0.0
    monitor[CHORD_TENSION] = chord_tension
    monitor[PREDICTED_TENSION] = chord_tension + extrapolation * (chord_tension - accepted[MONITOR, CHORD_TENSION])
    for j in range(m):
        last[j] = stretch[j]
        stretch[j] += extrapolation * (stretch[j] - accepted[LAST_STRETCH, j])
    return _finish(coefficients, trial, chord_tension, end_velocity, end_acceleration, along)
