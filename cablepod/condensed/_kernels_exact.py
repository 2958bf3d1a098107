"""Compiled forces of the condensed model with the exact chordwise stretch, and its steps by velocity Verlet."""

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.condensed._kernels_exact_closure import _chordwise_momentum, _close
from cablepod.condensed._kernels_layout import (
    CHORD_TENSION,
    COMPLIANCE,
    FORCE,
    LOAD_FORCE,
    MIN_FORCE,
    MIN_FORCE_STEP,
    PREDICTED_TENSION,
    SLOPE_SQUARED,
    WEIGHTED_STIFFNESS,
)
from cablepod.condensed._kernels_rates import _add_held_drag, _subtract_modal_damping
from cablepod.condensed._kernels_recorder import _monitor_frequency
from cablepod.discretisation._kernels_dense import _solve
from cablepod.discretisation._kernels_laws import damping_by_tension, green_secant, linear_secant

# --- forces -----------------------------------------------------------------------------------------------------------


@compiled(fastmath=REORDERED_FUSED, counted=False)
def _sum_slopes(terms, q, slope):
    """Fill the slopes of both deflections (2, m), or their rates, for coordinates or rates q (r,)."""
    r, m = terms.slopes.shape
    for j in range(m):
        slope[0, j] = slope[1, j] = 0.0
    for i in range(r):
        k = 0 if i < terms.in_plane else 1
        for j in range(m):
            slope[k, j] += terms.slopes[i, j] * q[i]


@compiled(fastmath=REORDERED_FUSED, counted=False)
def _subtract_projection(terms, stiffness, slope, f):
    """Subtract from f (r,) the integrals of the slopes (2, m) times a weighted stiffness (m,)."""
    r, m = terms.slopes.shape
    for i in range(r):
        k, total = 0 if i < terms.in_plane else 1, 0.0
        for j in range(m):
            total += stiffness[j] * terms.slopes[i, j] * slope[k, j]
        f[i] -= total


@compiled(fastmath=REORDERED_FUSED, counted=False)
def _fill_exact_tangent(terms, work):
    """Fill the tangent of the forces; overwrite the slope rates, and the mass: its diagonal has the derivatives of H.

    At constant N the force N / zeta' w' along a normal changes with the slopes along both, as zeta' does.
    """
    (r, m), closure, slope, (weights, by_slope) = terms.slopes.shape, work.closure, work.slope, work.slope_rate
    stretch, tangent, tension_change, compliance = work.stretch[0], work.tangent, work.mass, 0.0
    for j in range(m):
        compliance += terms.weights[j] * closure[COMPLIANCE, j]
        # at constant N the derivative of the stretch by w' is minus this times w'
        cube = math.sqrt(stretch[j] * stretch[j] + closure[SLOPE_SQUARED, j]) ** 3 if terms.green is None else 1.0
        by_slope[j] = terms.stiffness * closure[COMPLIANCE, j] * stretch[j] / cube
    for i in range(r):
        k, total = 0 if i < terms.in_plane else 1, 0.0
        for j in range(m):
            total += terms.weights[j] * by_slope[j] * slope[k, j] * terms.slopes[i, j]
        tension_change[i, i] = total / compliance
    for a, b in ((0, 0), (1, 0), (1, 1)):  # normals
        for k in range(m):
            stiffness = closure[WEIGHTED_STIFFNESS, k]
            weights[k] = stiffness * by_slope[k] * slope[a, k] * slope[b, k] / stretch[k] + (
                stiffness if a == b else 0.0
            )
        for i in range(terms.in_plane if a else 0, r if a else terms.in_plane):
            for j in range(terms.in_plane if b else 0, i + 1 if a == b else terms.in_plane):
                total = 0.0
                for k in range(m):
                    total += weights[k] * terms.slopes[i, k] * terms.slopes[j, k]
                tangent[i, j] = total + tension_change[i, i] * tension_change[j, j] * compliance
                tangent[j, i] = tangent[i, j]


@compiled(fastmath=REORDERED_FUSED, counted=False)
def _add_chordwise_inertia(inertia, terms, v, work, f):
    """Subtract the inertial force of chordwise motion from f (r,), and fill the mass matrix; nothing without `inertia`."""
    if inertia is None:
        return
    (r, m), slope, slope_rate, jacobian = terms.slopes.shape, work.slope, work.slope_rate, work.stretch_jacobian
    stretch, mass = work.stretch[0], work.mass
    _sum_slopes(terms, v, slope_rate)
    for i in range(r):
        k = 0 if i < terms.in_plane else 1
        for j in range(m):
            jacobian[i, j, 0] = -slope[k, j] * terms.slopes[i, j] / stretch[j]
        _chordwise_momentum(1, jacobian[i], terms.weights, inertia, jacobian[r + i])
    for j in range(m):
        stretch_rate = (slope[0, j] * slope_rate[0, j] + slope[1, j] * slope_rate[1, j]) / stretch[j]
        # from here on row 0: second rate of the stretch without accelerations
        slope_rate[0, j] = (
            -(slope_rate[0, j] * slope_rate[0, j] + slope_rate[1, j] * slope_rate[1, j] + stretch_rate * stretch_rate)
            / stretch[j]
        )
    for i in range(r):
        total = 0.0
        for j in range(m):
            total += jacobian[r + i, j, 0] * slope_rate[0, j]
        f[i] -= total
        for k in range(i + 1):
            total = 0.0
            for j in range(m):
                total += jacobian[r + i, j, 0] * jacobian[k, j, 0]
            mass[i, k] = total
            mass[k, i] = total
        mass[i, i] += 1.0


@compiled(fastmath=REORDERED_FUSED, counted=False)
def _close_chord(terms, row, q, guess, work):
    """Solve the closure for coordinates q (r,); return H [N], not finite where there is none.  Arguments as in `exact_force`."""
    m, closure = terms.weights.size, work.closure
    _sum_slopes(terms, q, work.slope)
    for j in range(m):
        closure[LOAD_FORCE, j] = 0.0
        closure[SLOPE_SQUARED, j] = work.slope[0, j] * work.slope[0, j] + work.slope[1, j] * work.slope[1, j]
    for a in range(terms.force_patterns.shape[0]):
        for j in range(m):
            closure[LOAD_FORCE, j] += row[1 + a] * terms.force_patterns[a, j]
    return _close(terms.weights, row[0], terms.stiffness, terms.green, guess, work.stretch[0], closure)


@compiled(counted=False)
def _accelerate(inertia, mass, f):
    """Change forces f (r,) into accelerations by the mass matrix (r, r); nothing without `inertia`."""
    if inertia is None:
        return
    _solve(mass, f)


@compiled(fastmath=REORDERED_FUSED, counted=False)
def exact_force(terms, row, q, v, guess, work, f):
    """Fill the undamped forces f (r,) with the exact chordwise stretch; return H [N], not finite where there is none.

    Stretch, tangent and mass matrix are left in the work arrays.

    Parameters
    ----------
    terms, work
        See :mod:`cablepod.condensed._kernels_layout`.
    row
        Boundary data of one instant, see :func:`cablepod.condensed._frame.chord_and_loads`.
    q, v
        Coordinates and rates (r,); rates only count with chordwise inertia.
    guess
        First guess of H [N].
    f
        Filled: forces (r,).
    """
    chord_tension, closure, stretch = _close_chord(terms, row, q, guess, work), work.closure, work.stretch[0]
    for j in range(stretch.size):
        closure[WEIGHTED_STIFFNESS, j] = terms.weights[j] * closure[FORCE, j] / stretch[j]
    patterns = terms.force_patterns.shape[0]
    for i in range(f.size):
        f[i] = 0.0
        for a in range(terms.load_projection.shape[0]):
            f[i] += row[1 + patterns + a] * terms.load_projection[a, i]
    _subtract_projection(terms, closure[WEIGHTED_STIFFNESS], work.slope, f)
    if work.tangent.size:
        _fill_exact_tangent(terms, work)
    _add_chordwise_inertia(terms.inertia, terms, v, work, f)
    return chord_tension


@compiled(fastmath=REORDERED_FUSED, counted=False)
def _subtract_tension_damping(terms, tension_damping, rates, work, f):
    """Subtract the damping by the tension, tension_damping N / zeta' times the rate of the slope, from f (r,); 0 where slack.

    Row WEIGHTED_STIFFNESS of the closure holds weights times N / zeta'; it is overwritten, as the rates of the slopes are.
    """
    stiffness = work.closure[WEIGHTED_STIFFNESS]
    for j in range(stiffness.size):
        stiffness[j] = damping_by_tension(stiffness[j], stiffness[j], tension_damping)
    _sum_slopes(terms, rates, work.slope_rate)
    _subtract_projection(terms, stiffness, work.slope_rate, f)


# --- monitor and tensions ---------------------------------------------------------------------------------------------


@compiled(fastmath=REORDERED_FUSED, counted=False)
def _record_exact(terms, stretch, closure, number, low, high, monitor):
    """Update the least chordwise force with its step, and the extremes (m,) by the tensions of the material law."""
    for j in range(stretch.size):
        if closure[FORCE, j] < monitor[MIN_FORCE]:
            monitor[MIN_FORCE], monitor[MIN_FORCE_STEP] = closure[FORCE, j], number
    for j in range(low.size):
        xi = math.sqrt(stretch[j] * stretch[j] + closure[SLOPE_SQUARED, j])
        linear = terms.green is None
        secant = linear_secant(1.0 / xi, terms.stiffness) if linear else green_secant(xi * xi, terms.stiffness)
        tension = secant * xi
        low[j] = min(low[j], tension)
        high[j] = max(high[j], tension)


# --- steps ------------------------------------------------------------------------------------------------------------


@compiled(fastmath=REORDERED_FUSED, counted=False)
def mean_stretch(weights, stretch, slope_squared):
    """Return the mean stretch of the cable from chordwise stretch and squared slopes at points with weights (m,)."""
    total, length = 0.0, 0.0
    for j in range(weights.size):
        total += weights[j] * math.sqrt(stretch[j] * stretch[j] + slope_squared[j])
        length += weights[j]
    return total / length


@compiled(counted=False)
def exact_verlet(
    exact, sizes, terms, bounds, damped, rate_terms, air, boundary_data, state, work, begin, record, low, high, monitor
):
    """Advance by velocity Verlet with the exact chordwise stretch, one step for each row of the boundary data.

    Chordwise inertia, damping by the tension and drag take the rates extrapolated from half a step before with the acceleration
    of the last step.

    Parameters
    ----------
    exact
        See :class:`cablepod.condensed._kernels_layout.ExactTerms`.
    sizes, terms, bounds
        To leading order, for the bound of the frequencies.
    damped, rate_terms, air, begin, record, monitor
        As in :func:`cablepod.condensed._kernels_explicit.verlet`.
    boundary_data
        See :func:`cablepod.condensed._frame.chord_and_loads`; one row for each step.
    state
        Coordinates, rates half a step before, and accelerations of the last step (3, r); changed.
    work
        See :class:`cablepod.condensed._kernels_layout.ExactWork`, without a tangent; guesses of stretch and H are extrapolated
        from the last two steps.  Changed.
    low, high
        Extremes of the link tensions over all steps (n,) [N], or without entries; changed.
    """
    q, v, acceleration, (r, m), step = state[0], state[1], state[2], exact.slopes.shape, damped.step
    predicted, accepted, tension = work.stretch[0], work.stretch[1], work.tension
    f, rates, saved = work.vectors[0], work.vectors[1], record.first
    for i in range(boundary_data.shape[0]):
        number, row = begin + i, boundary_data[i]
        for j in range(r):
            rates[j] = v[j] + 0.5 * step * acceleration[j]
        guess = monitor[PREDICTED_TENSION]
        for trial in range(2):
            if trial:  # extrapolated too far: once more from the last step
                guess = monitor[CHORD_TENSION]
                for j in range(m):
                    predicted[j] = accepted[j]
            tension[0] = exact_force(exact, row, q, rates, guess, work, f)
            if abs(tension[0]) < np.inf:
                break
        _record_exact(exact, predicted, work.closure, number, low, high, monitor)
        if rate_terms is not None:
            if rate_terms.tension_damping > 0.0:
                _subtract_tension_damping(exact, rate_terms.tension_damping, rates, work, f)
            _subtract_modal_damping(rate_terms.modal_damping, rates, f)
            if air is not None:
                stretch = mean_stretch(exact.weights, predicted, work.closure[SLOPE_SQUARED])
                _add_held_drag(air, q, rates, stretch, True, number, step, f)
        _accelerate(exact.inertia, work.mass, f)
        _monitor_frequency(sizes, terms, bounds, row, q, tension, number, monitor)
        is_output = saved < record.steps.size and record.steps[saved] == number
        for j in range(r):
            new_rate = damped.decay[0] * v[j] + damped.impulse[0] * f[j]
            if is_output:
                record.coordinates[0, saved, j] = q[j]
                record.half_step_rates[0, saved, 0, j] = v[j]
                record.half_step_rates[0, saved, 1, j] = new_rate
            acceleration[j] = (new_rate - v[j]) / step
            v[j] = new_rate
            q[j] += step * v[j]
        saved += 1 if is_output else 0
        # extrapolate linearly, but not at the start, which has one state only; mostly one Newton iteration suffices then
        extrapolation = 0.0 if number == 0 else 1.0
        monitor[PREDICTED_TENSION] = tension[0] + extrapolation * (tension[0] - monitor[CHORD_TENSION])
        monitor[CHORD_TENSION] = tension[0]
        for j in range(m):
            current = predicted[j]
            predicted[j] = current + extrapolation * (current - accepted[j])
            accepted[j] = current
