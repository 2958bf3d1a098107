"""Compiled forces and steps of the condensed model with the exact chordwise stretch."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.condensed._kernels_closure import _chordwise_momentum, _close
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_drag import AIR_ROWS, _add_drag_at
from cablepod.condensed._kernels_layout import (
    CHORD_TENSION,
    CLOSURE_ROWS,
    COMPLIANCE,
    FORCE,
    LOAD_FORCE,
    MIN_FORCE,
    MIN_FORCE_STEP,
    PREDICTED_TENSION,
    SLOPE_SQUARED,
    WEIGHTED_STIFFNESS,
)
from cablepod.condensed._kernels_step import _monitor_frequency

# --- forces -----------------------------------------------------------------------------------------------------------


@compiled(inline="always")
def _fill_tangent(
    slopes, n_in_plane, weights, stiffness, green, stretch, work, slope, row_work, tangent, tension_change
):
    """Fill the tangent (r, r) of the forces; overwrite row WEIGHTED_STIFFNESS of `work` and row 1 of `row_work` (2, m).

    The diagonal of `tension_change` (r, r) is overwritten with the derivatives of H by the coordinates.
    """
    r, m = slopes.shape
    compliance = 0.0
    for j in range(m):
        compliance += weights[j] * work[COMPLIANCE, j]
        # at constant N the derivative of the stretch by w' is minus this times w'
        cube = 1.0 if green else math.sqrt(stretch[j] * stretch[j] + work[SLOPE_SQUARED, j]) ** 3
        row_work[1, j] = stiffness * work[COMPLIANCE, j] * stretch[j] / cube
    for i in range(r):
        k = 0 if i < n_in_plane else 1
        total = 0.0
        for j in range(m):
            total += weights[j] * row_work[1, j] * slope[k, j] * slopes[i, j]
        tension_change[i, i] = total / compliance
    for j in range(m):
        work[WEIGHTED_STIFFNESS, j] *= 1.0 + row_work[1, j] * work[SLOPE_SQUARED, j] / stretch[j]
    for i in range(r):
        for j in range(i + 1):
            total = 0.0
            if (i < n_in_plane) == (j < n_in_plane):
                for k in range(m):
                    total += work[WEIGHTED_STIFFNESS, k] * slopes[i, k] * slopes[j, k]
            tangent[i, j] = total + tension_change[i, i] * tension_change[j, j] * compliance
            tangent[j, i] = tangent[i, j]


@compiled(inline="always")
def _add_chordwise_inertia(
    v, slopes, n_in_plane, weights, inertia, stretch, slope, slope_rate, stretch_jacobian, f, mass
):
    """Subtract the inertial force of chordwise motion from f (r,), and fill the mass matrix (r, r)."""
    r, m = slopes.shape
    for j in range(m):
        slope_rate[0, j] = 0.0
        slope_rate[1, j] = 0.0
    for i in range(r):
        k = 0 if i < n_in_plane else 1
        for j in range(m):
            slope_rate[k, j] += slopes[i, j] * v[i]
            stretch_jacobian[i, j] = -slope[k, j] * slopes[i, j] / stretch[j]
    for j in range(m):
        stretch_rate = (slope[0, j] * slope_rate[0, j] + slope[1, j] * slope_rate[1, j]) / stretch[j]
        # from here on row 0: second rate of the stretch without accelerations
        slope_rate[0, j] = (
            -(slope_rate[0, j] * slope_rate[0, j] + slope_rate[1, j] * slope_rate[1, j] + stretch_rate * stretch_rate)
            / stretch[j]
        )
    for i in range(r):
        _chordwise_momentum(stretch_jacobian[i], weights, inertia, stretch_jacobian[r + i])
    for i in range(r):
        total = 0.0
        for j in range(m):
            total += stretch_jacobian[r + i, j] * slope_rate[0, j]
        f[i] -= total
        for k in range(i + 1):
            total = 0.0
            for j in range(m):
                total += stretch_jacobian[r + i, j] * stretch_jacobian[k, j]
            mass[i, k] = total
            mass[k, i] = total
        mass[i, i] += 1.0


@compiled(fastmath=REORDERED_FUSED, forceinline=True, counted=False)
def exact_force(
    q, v, boundary_data, row, slopes, n_in_plane, chordwise_force_patterns, weights, stiffness, green, load_projection,
    inertia, guess, stretch, work, slope, slope_rate, stretch_jacobian, f, tangent, mass,
):  # fmt: skip
    """Fill the undamped forces f (r,) with the exact chordwise stretch; return H [N], not finite where there is none.

    Parameters
    ----------
    q, v
        Coordinates and rates (r,); rates only count with chordwise inertia.
    boundary_data, row
        See :func:`cablepod.condensed._kernels_frame.frames`; index of the row.
    slopes, n_in_plane, chordwise_force_patterns, weights, stiffness, green, load_projection
        As in ``leading_verlet`` and ``_close``, at the links or quadrature points (m,).
    inertia
        Masses [kg] of the particles above the links and their relative arc lengths (2, m); at quadrature points the chordwise
        mass matrix (m, m) [kg m^2]; without entries: no chordwise inertia.
    guess
        First guess of H [N].
    stretch
        First guess of the chordwise stretch (m,); changed into the solution.
    work, slope, slope_rate, stretch_jacobian
        Work arrays: (CLOSURE_ROWS, m); slopes of the deflections (2, m); their rates (2, m); derivatives of the stretch by the
        coordinates, and their products with the chordwise mass matrix (2 r, m).
    f, tangent, mass
        Filled: forces (r,); negative derivative of the forces (r, r), or without entries, accurate enough for Newton's method;
        mass matrix (r, r) with chordwise inertia, otherwise a work array.
    """
    r, m = slopes.shape
    for j in range(m):
        slope[0, j] = 0.0
        slope[1, j] = 0.0
        work[LOAD_FORCE, j] = 0.0
    for i in range(r):
        k = 0 if i < n_in_plane else 1
        for j in range(m):
            slope[k, j] += slopes[i, j] * q[i]
    for a in range(chordwise_force_patterns.shape[0]):
        for j in range(m):
            work[LOAD_FORCE, j] += boundary_data[row, 1 + a] * chordwise_force_patterns[a, j]
    for j in range(m):
        work[SLOPE_SQUARED, j] = slope[0, j] * slope[0, j] + slope[1, j] * slope[1, j]
    chord_tension = _close(weights, boundary_data[row, 0], stiffness, green, guess, stretch, work)
    for j in range(m):
        work[WEIGHTED_STIFFNESS, j] = weights[j] * work[FORCE, j] / stretch[j]
    for i in range(r):
        k = 0 if i < n_in_plane else 1
        total = 0.0
        for j in range(m):
            total += work[WEIGHTED_STIFFNESS, j] * slopes[i, j] * slope[k, j]
        f[i] = -total
    patterns = chordwise_force_patterns.shape[0]
    for a in range(load_projection.shape[0]):
        g = boundary_data[row, 1 + patterns + a]
        for i in range(r):
            f[i] += g * load_projection[a, i]
    if tangent.size:
        _fill_tangent(slopes, n_in_plane, weights, stiffness, green, stretch, work, slope, slope_rate, tangent, mass)
    if inertia.size:
        _add_chordwise_inertia(
            v, slopes, n_in_plane, weights, inertia, stretch, slope, slope_rate, stretch_jacobian, f, mass
        )
    return chord_tension


# --- monitor and tensions ---------------------------------------------------------------------------------------------


@compiled(inline="always")
def _update_extremes(stretch, work, stiffness, green, low, high):
    """Update the extremes `low` and `high` (m,) by the tensions of the material law."""
    for j in range(low.size):
        xi = math.sqrt(stretch[j] * stretch[j] + work[SLOPE_SQUARED, j])
        tension = 0.5 * stiffness * xi * (xi * xi - 1.0) if green else stiffness * (xi - 1.0)
        low[j] = min(low[j], tension)
        high[j] = max(high[j], tension)


@compiled(inline="always")
def _monitor_step(
    step_number,
    q,
    boundary_data,
    row,
    chord_tension,
    force,
    kappa,
    geometric_stiffness_norms,
    stiffness,
    length,
    monitor,
):
    """Update the monitor: least chordwise force with its step, largest frequency, first step where that is too large."""
    for j in range(force.size):
        if force[j] < monitor[MIN_FORCE]:
            monitor[MIN_FORCE], monitor[MIN_FORCE_STEP] = force[j], step_number
    _monitor_frequency(
        step_number, q, boundary_data, row, chord_tension, kappa, geometric_stiffness_norms, stiffness, length, monitor
    )


# --- steps ------------------------------------------------------------------------------------------------------------


@compiled(inline="always")
def _subtract_tension_damping(rates, slopes, n_in_plane, tension_damping, work, slope_rate, f):
    """Subtract the damping by the tension, tension_damping N / zeta' times the rate of the slope, from the forces f (r,).

    Row WEIGHTED_STIFFNESS of `work` holds weights times N / zeta'; `slope_rate` (2, m) is overwritten.
    """
    r, m = slopes.shape
    for j in range(m):
        slope_rate[0, j] = 0.0
        slope_rate[1, j] = 0.0
    for i in range(r):
        k = 0 if i < n_in_plane else 1
        for j in range(m):
            slope_rate[k, j] += slopes[i, j] * rates[i]
    for i in range(r):
        k, total = 0 if i < n_in_plane else 1, 0.0
        for j in range(m):
            total += max(work[WEIGHTED_STIFFNESS, j], 0.0) * slopes[i, j] * slope_rate[k, j]
        f[i] -= tension_damping * total


@compiled
def exact_verlet(
    q, v, acceleration, step, damping_factor, impulse, tension_damping, wind, samples_per_second, drag, drag_shapes,
    boundary_data, stiffness, length, kappa, load_projection,
    geometric_stiffness_norms, slopes, n_in_plane, chordwise_force_patterns, weights, green, inertia, stretch, begin,
    output_steps, saved, half_step_rates, low, high, monitor,
):  # fmt: skip
    """Advance by velocity Verlet with the exact chordwise stretch, one step for each row of the boundary data.

    Chordwise inertia, damping by the tension and drag take the rates extrapolated from half a step before with `acceleration`,
    that of the last step (r,).  Row 0 of `stretch` (2, m) is the first guess for the next step, extrapolated from the last two,
    row 1 the stretch of the last step; the same holds for H in the monitor.  Other parameters as in ``leading_verlet`` and
    :func:`exact_force`.
    """
    r, m = slopes.shape
    f, rates, mass, no_array = np.empty(r), np.empty(r), np.empty((r, r)), np.empty((0, 0))
    work, slope, slope_rate = np.empty((CLOSURE_ROWS, m)), np.empty((2, m)), np.empty((2, m))
    stretch_jacobian, next_output, predicted, accepted = np.empty((2 * r, m)), 0, stretch[0], stretch[1]
    air = None if wind is None else np.empty(AIR_ROWS * drag.size)
    for i in range(boundary_data.shape[0]):
        for j in range(r):
            rates[j] = v[j] + 0.5 * step * acceleration[j]
        guess, chord_tension = monitor[PREDICTED_TENSION], np.nan
        for _ in range(2):
            chord_tension = exact_force(
                q, rates, boundary_data, i, slopes, n_in_plane, chordwise_force_patterns, weights, stiffness, green,
                load_projection, inertia, guess, predicted, work, slope, slope_rate, stretch_jacobian, f, no_array, mass,
            )  # fmt: skip
            if abs(chord_tension) < np.inf:
                break
            # extrapolated too far: once more from the last step
            guess = monitor[CHORD_TENSION]
            for j in range(m):
                predicted[j] = accepted[j]
        if tension_damping is not None:
            _subtract_tension_damping(rates, slopes, n_in_plane, tension_damping, work, slope_rate, f)
        if wind is not None:
            _add_drag_at(
                q, rates, 1.0 + chord_tension / stiffness, True, wind, (begin + i) * step * samples_per_second, drag,
                drag_shapes, n_in_plane, air, f,
            )  # fmt: skip
        if inertia.size:
            _solve(mass, f)
        _monitor_step(
            begin + i,
            q,
            boundary_data,
            i,
            chord_tension,
            work[FORCE],
            kappa,
            geometric_stiffness_norms,
            stiffness,
            length,
            monitor,
        )
        if low.size:
            _update_extremes(predicted, work, stiffness, green, low, high)
        is_output = next_output < output_steps.size and output_steps[next_output] == begin + i
        if is_output:
            for j in range(r):
                saved[next_output, j] = q[j]
                half_step_rates[next_output, 0, j] = v[j]
        for j in range(r):
            new_rate = damping_factor * v[j] + impulse * f[j]
            acceleration[j] = (new_rate - v[j]) / step
            v[j] = new_rate
        if is_output:
            for j in range(r):
                half_step_rates[next_output, 1, j] = v[j]
            next_output += 1
        for j in range(r):
            q[j] += step * v[j]
        # extrapolate linearly, but not at the start, which has one state only; mostly one Newton iteration suffices then
        extrapolation = 0.0 if begin + i == 0 else 1.0
        monitor[CHORD_TENSION], monitor[PREDICTED_TENSION] = (
            chord_tension,
            chord_tension + extrapolation * (chord_tension - monitor[CHORD_TENSION]),
        )
        for j in range(m):
            current = predicted[j]
            predicted[j] = current + extrapolation * (current - accepted[j])
            accepted[j] = current
