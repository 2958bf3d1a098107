"""Compiled forces, equilibrium and steps of the condensed model to leading order."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.condensed._kernels_closure import MAX_ITERATIONS, NEWTON_RTOL
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_layout import (
    LINK_FORCE,
    LINK_ROWS,
    MIN_FORCE,
    MIN_FORCE_STEP,
    SLOPE_IN_PLANE,
    SLOPE_OUT_OF_PLANE,
)
from cablepod.condensed._kernels_step import _monitor_frequency, _save_implicit, _update_rates

#: Maximum number of links whose tensions are computed one by one (vectorised loops only pay for more).
SCALAR_LINK_LIMIT = 6
#: Relative tolerance of the equilibrium: last Newton correction over the deflection.
EQUILIBRIUM_RTOL = 1e-9
#: Relative Newton correction below which only rounding is left.
ROUNDING_RTOL = 1e-14


# --- forces -----------------------------------------------------------------------------------------------------------


@compiled(inline="always")
def _straight_tension(boundary_data, row, mean_chordwise_forces, stiffness, length):
    """Return H of a cable without deflection [N]."""
    chord_tension = stiffness * (boundary_data[row, 0] / length - 1.0)
    for a in range(mean_chordwise_forces.size):
        chord_tension -= boundary_data[row, 1 + a] * mean_chordwise_forces[a]
    return chord_tension


@compiled(inline="always")
def _chord_tension(q, boundary_data, row, kappa, mean_chordwise_forces, stiffness, length):
    """Return H [N] by the closure to leading order."""
    stretching = 0.0
    for i in range(q.size):
        stretching += kappa[i] * q[i] * q[i]
    straight = _straight_tension(boundary_data, row, mean_chordwise_forces, stiffness, length)
    return straight + 0.5 * stiffness / length * stretching


@compiled(inline="always")
def _leading_acceleration(q, boundary_data, row, chord_tension, kappa, geometric_stiffness, load_projection, f):
    """Fill the undamped accelerations f (r,) for a given H, with the modes as test functions of H."""
    patterns = geometric_stiffness.shape[0]
    for i in range(q.size):
        f[i] = -chord_tension * kappa[i] * q[i]
    for a in range(patterns):
        g = boundary_data[row, 1 + a]
        for i in range(q.size):
            total = 0.0
            for j in range(q.size):
                total += geometric_stiffness[a, i, j] * q[j]
            f[i] -= g * total
    for a in range(load_projection.shape[0]):
        g = boundary_data[row, 1 + patterns + a]
        for i in range(q.size):
            f[i] += g * load_projection[a, i]


@compiled(inline="always")
def _add_test_stiffness(q, chord_tension, test_stiffness_defect, f):
    """Subtract the stiffness contribution H G q of non-Galerkin test functions from the accelerations f (r,)."""
    for i in range(q.size):
        total = 0.0
        for j in range(q.size):
            total += test_stiffness_defect[i, j] * q[j]
        f[i] -= chord_tension * total


@compiled(forceinline=True)
def _leading_tangent(q, boundary_data, row, chord_tension, kappa, geometric_stiffness, stiffness, length, tangent):
    """Fill the negative derivative of the accelerations by q (r, r), with the modes as test functions of H."""
    for i in range(q.size):
        for j in range(q.size):
            total = stiffness / length * kappa[i] * q[i] * kappa[j] * q[j]
            for a in range(geometric_stiffness.shape[0]):
                total += boundary_data[row, 1 + a] * geometric_stiffness[a, i, j]
            tangent[i, j] = total
        tangent[i, i] += chord_tension * kappa[i]


@compiled
def leading_force(
    q, boundary_data, row, stiffness, length, kappa, test_stiffness_defect, mean_chordwise_forces,
    geometric_stiffness, load_projection, f, tangent,
):  # fmt: skip
    """Fill undamped accelerations f (r,) and their tangent (r, r) for one state; return H [N]."""
    chord_tension = _chord_tension(q, boundary_data, row, kappa, mean_chordwise_forces, stiffness, length)
    _leading_acceleration(q, boundary_data, row, chord_tension, kappa, geometric_stiffness, load_projection, f)
    _leading_tangent(q, boundary_data, row, chord_tension, kappa, geometric_stiffness, stiffness, length, tangent)
    if test_stiffness_defect is not None:
        _add_test_stiffness(q, chord_tension, test_stiffness_defect, f)
        for i in range(q.size):
            total = 0.0
            for j in range(q.size):
                total += test_stiffness_defect[i, j] * q[j]
            for j in range(q.size):
                tangent[i, j] += (
                    chord_tension * test_stiffness_defect[i, j] + stiffness / length * total * kappa[j] * q[j]
                )
    return chord_tension


@compiled
def leading_rest(
    q, boundary_data, stiffness, length, kappa, test_stiffness_defect, mean_chordwise_forces, geometric_stiffness,
    load_projection,
):  # fmt: skip
    """Change q into the equilibrium near it by Newton's method; False where it fails, or converges to another one."""
    f, tangent, first = np.empty(q.size), np.empty((q.size, q.size)), q.copy()
    scale = np.abs(q).max()
    for _ in range(2 * MAX_ITERATIONS):
        leading_force(
            q, boundary_data, 0, stiffness, length, kappa, test_stiffness_defect, mean_chordwise_forces,
            geometric_stiffness, load_projection, f, tangent,
        )  # fmt: skip
        if not _solve(tangent, f):
            return False
        change, largest = 0.0, 0.0
        for i in range(q.size):
            q[i] += f[i]
            change, largest = max(change, abs(f[i])), max(largest, abs(q[i]))
            if not abs(q[i]) <= 10.0 * scale:
                return False
        if change <= ROUNDING_RTOL * scale:
            break
    # an equilibrium further away than the deflection is that of the cable turned over
    return change <= EQUILIBRIUM_RTOL * scale and np.abs(q - first).max() <= scale


# --- monitor and tensions ---------------------------------------------------------------------------------------------


@compiled(inline="always")
def _monitor_step(
    step_number, q, boundary_data, row, chord_tension, kappa, geometric_stiffness_norms,
    chordwise_forces_at_candidates, stiffness, length, monitor,
):  # fmt: skip
    """Update the monitor: least chordwise force with its step, largest frequency, first step where that is too large."""
    least = np.inf
    for k in range(chordwise_forces_at_candidates.shape[1]):
        tau = 0.0
        for a in range(chordwise_forces_at_candidates.shape[0]):
            tau += boundary_data[row, 1 + a] * chordwise_forces_at_candidates[a, k]
        least = min(least, tau)
    if chord_tension + least < monitor[MIN_FORCE]:
        monitor[MIN_FORCE], monitor[MIN_FORCE_STEP] = chord_tension + least, step_number
    _monitor_frequency(
        step_number, q, boundary_data, row, chord_tension, kappa, geometric_stiffness_norms, stiffness, length, monitor
    )


@compiled(inline="always")
def _link_tension(j, q, boundary_data, row, chord_tension, slopes, n_in_plane, chordwise_force_patterns):
    """Return the tension of one link to leading order [N]."""
    x, y, force = 0.0, 0.0, chord_tension
    for i in range(n_in_plane):
        x += slopes[i, j] * q[i]
    for i in range(n_in_plane, q.size):
        y += slopes[i, j] * q[i]
    for a in range(chordwise_force_patterns.shape[0]):
        force += boundary_data[row, 1 + a] * chordwise_force_patterns[a, j]
    return force * math.sqrt(1.0 + x * x + y * y)


@compiled(fastmath=REORDERED_FUSED)
def _link_tensions(
    q, boundary_data, row, chord_tension, slopes, n_in_plane, chordwise_force_patterns, work, low, high,
):  # fmt: skip
    """Update the extremes `low` and `high` (n,) by the tensions of all links to leading order."""
    links = low.size
    for j in range(links):
        work[SLOPE_IN_PLANE, j] = 0.0
        work[SLOPE_OUT_OF_PLANE, j] = 0.0
        work[LINK_FORCE, j] = chord_tension
    for i in range(q.size):
        k = SLOPE_IN_PLANE if i < n_in_plane else SLOPE_OUT_OF_PLANE
        for j in range(links):
            work[k, j] += slopes[i, j] * q[i]
    for a in range(chordwise_force_patterns.shape[0]):
        for j in range(links):
            work[LINK_FORCE, j] += boundary_data[row, 1 + a] * chordwise_force_patterns[a, j]
    for j in range(links):
        tension = work[LINK_FORCE, j] * math.sqrt(
            1.0
            + work[SLOPE_IN_PLANE, j] * work[SLOPE_IN_PLANE, j]
            + work[SLOPE_OUT_OF_PLANE, j] * work[SLOPE_OUT_OF_PLANE, j]
        )
        low[j] = min(low[j], tension)
        high[j] = max(high[j], tension)


# --- steps ------------------------------------------------------------------------------------------------------------


@compiled
def leading_verlet(
    q, v, step, damping_factor, impulse, boundary_data, stiffness, length, kappa, test_stiffness_defect,
    mean_chordwise_forces, geometric_stiffness, load_projection, geometric_stiffness_norms,
    chordwise_forces_at_candidates, slopes, n_in_plane, chordwise_force_patterns, begin, output_steps, saved,
    half_step_rates, low, high, monitor, tension_series,
):  # fmt: skip
    """Advance by velocity Verlet to leading order, one step for each row of the boundary data.

    Parameters
    ----------
    q, v
        Coordinates, and their rates half a step before (r,); changed.
    step, damping_factor, impulse
        Step [s]; factor of the rates by damping over a step; rate gained in a step for unit acceleration [s].
    boundary_data
        See :func:`cablepod.condensed._kernels_frame.frames`; one row for each step.
    stiffness, length
        K [N] and L0 [m].
    kappa, mean_chordwise_forces, geometric_stiffness, load_projection
        Coefficients: squared slope norms (r,), then (patterns,), (patterns, r, r), (normals times patterns, r).
    test_stiffness_defect
        Stiffness of non-Galerkin test functions for H = 1, minus diag(kappa) (r, r); None for the modes as test functions.
    geometric_stiffness_norms, chordwise_forces_at_candidates
        Norms of `geometric_stiffness` (patterns,); chordwise force patterns where the sum may be least (patterns, candidates).
    slopes, n_in_plane, chordwise_force_patterns
        For link tensions: slopes of the modes (r, n), number of in-plane coordinates, patterns (patterns, n).
    begin, output_steps, saved, half_step_rates
        Number of the first step; steps to save (outputs,); filled: q there (outputs, r), rates half a step before and after
        (outputs, 2, r).
    low, high
        Extremes of the link tensions over all steps (n,) [N], or without entries; changed.
    monitor
        Extremes of the run, see :mod:`cablepod.condensed._kernels_layout`; changed.
    tension_series
        Filled: link tensions at the steps to save (outputs, n) [N], or without columns.
    """
    f, work = np.empty(q.size), np.empty((LINK_ROWS, low.size))
    next_output = 0
    for i in range(boundary_data.shape[0]):
        chord_tension = _chord_tension(q, boundary_data, i, kappa, mean_chordwise_forces, stiffness, length)
        _leading_acceleration(q, boundary_data, i, chord_tension, kappa, geometric_stiffness, load_projection, f)
        if test_stiffness_defect is not None:
            _add_test_stiffness(q, chord_tension, test_stiffness_defect, f)
        _monitor_step(
            begin + i, q, boundary_data, i, chord_tension, kappa, geometric_stiffness_norms,
            chordwise_forces_at_candidates, stiffness, length, monitor,
        )  # fmt: skip
        if low.size < SCALAR_LINK_LIMIT:
            for j in range(low.size):
                tension = _link_tension(
                    j, q, boundary_data, i, chord_tension, slopes, n_in_plane, chordwise_force_patterns
                )
                if tension < low[j]:
                    low[j] = tension
                if tension > high[j]:
                    high[j] = tension
        else:
            _link_tensions(
                q, boundary_data, i, chord_tension, slopes, n_in_plane, chordwise_force_patterns, work, low, high
            )
        is_output = next_output < output_steps.size and output_steps[next_output] == begin + i
        if is_output:
            for j in range(q.size):
                saved[next_output, j] = q[j]
                half_step_rates[next_output, 0, j] = v[j]
            for j in range(tension_series.shape[1]):
                tension_series[next_output, j] = _link_tension(
                    j, q, boundary_data, i, chord_tension, slopes, n_in_plane, chordwise_force_patterns
                )
        for j in range(q.size):
            v[j] = damping_factor * v[j] + impulse * f[j]
        if is_output:
            for j in range(q.size):
                half_step_rates[next_output, 1, j] = v[j]
            next_output += 1
        for j in range(q.size):
            q[j] += step * v[j]


@compiled(inline="always")
def _collect_known_terms(
    q, v, acceleration, step, damping, beta, inertia_factor, new_part, boundary_data, row, geometric_stiffness,
    load_projection, known_terms, load_stiffness,
):  # fmt: skip
    """Fill the terms of the implicit equation of a step that do not change with q (r,), (r, r); `new_part` is beta step^2."""
    r, patterns = q.size, geometric_stiffness.shape[0]
    old_part = (0.5 - beta + 0.5 * step * damping * (0.5 - 2.0 * beta)) / beta
    for j in range(r):
        total = old_part * acceleration[j]
        for a in range(load_projection.shape[0]):
            total += boundary_data[row, 1 + patterns + a] * load_projection[a, j]
        known_terms[j] = inertia_factor * q[j] + step * (1.0 + (0.5 - beta) * step * damping) * v[j] + new_part * total
        for k in range(r):
            total = 0.0
            for a in range(patterns):
                total += boundary_data[row, 1 + a] * geometric_stiffness[a, j, k]
            load_stiffness[j, k] = new_part * total


@compiled(inline="always")
def _newton_system(
    q, straight, inertia_factor, new_part, sag_stiffness, kappa, test_stiffness_defect, known_terms,
    load_stiffness, tangent, change,
):  # fmt: skip
    """Fill residual (r,) and tangent (r, r) of the implicit equation of a step."""
    r, chord_tension = q.size, straight
    for j in range(r):
        chord_tension += sag_stiffness * kappa[j] * q[j] * q[j]
    for j in range(r):
        diagonal = inertia_factor + new_part * chord_tension * kappa[j]
        residual = known_terms[j] - diagonal * q[j]
        sag = 2.0 * new_part * sag_stiffness * kappa[j] * q[j]
        if test_stiffness_defect is not None:
            for k in range(r):
                residual -= new_part * chord_tension * test_stiffness_defect[j, k] * q[k]
                sag += 2.0 * new_part * sag_stiffness * test_stiffness_defect[j, k] * q[k]
        for k in range(r):
            residual -= load_stiffness[j, k] * q[k]
            tangent[j, k] = load_stiffness[j, k] + sag * kappa[k] * q[k]
            if test_stiffness_defect is not None:
                tangent[j, k] += new_part * chord_tension * test_stiffness_defect[j, k]
        change[j] = residual
        tangent[j, j] += diagonal


@compiled(inline="always")
def _remaining_residual(q, change, cross, square, kappa, test_stiffness_defect):
    """Return the part of the cubic force that the tangent left out of the last Newton correction, per sag stiffness."""
    residual = 0.0
    for j in range(q.size):
        total = kappa[j] * (cross * change[j] + 0.5 * square * q[j])
        if test_stiffness_defect is not None:
            for k in range(q.size):
                total += test_stiffness_defect[j, k] * (cross * change[k] + 0.5 * square * q[k])
        residual = max(residual, abs(total))
    return residual


@compiled
def leading_implicit(
    q, v, acceleration, previous_acceleration, step, damping, beta, boundary_data, stiffness, length, kappa,
    test_stiffness_defect, mean_chordwise_forces, geometric_stiffness, load_projection, geometric_stiffness_norms,
    chordwise_forces_at_candidates, slopes, n_in_plane, chordwise_force_patterns, begin, output_steps, saved,
    half_step_rates, low, high, monitor,
):  # fmt: skip
    """Advance by Newmark's method with gamma = 1/2 and a given beta, with Newton's method, to leading order.

    q(t + h) = q + h v + h^2 ((1/2 - beta) a + beta a(t + h)), v(t + h) = v + h/2 (a + a(t + h)).  With beta = 1/4 it is the
    trapezoidal rule (average acceleration).  With beta = 1/12 (Fox and Goodwin) coordinates are of fourth order without damping,
    where v exceeds the rate by h^2 a_t / 12, and steps are stable below sqrt(6) over the highest angular frequency.

    On call `q`, `v`, `acceleration` and, one step before, `previous_acceleration` belong to the first row of the boundary data,
    on return to the last, which is the first of the next block.  Other parameters as in :func:`leading_verlet`.

    Returns
    -------
    int
        Number of steps done; fewer than asked for where Newton's method did not converge.
    """
    r = q.size
    work, matrices, vectors = np.empty((LINK_ROWS, low.size)), np.empty((2, r, r)), np.empty((3, r))
    tangent, load_stiffness = matrices
    change, q_start, known_terms = vectors
    new_part, next_output, last_row = beta * step * step, 0, boundary_data.shape[0] - 1
    is_trapezoidal, extrapolation = beta == 0.25, (0.5 - beta) / beta + 2.0
    if begin == 0 and not is_trapezoidal:
        # the excess of v over the rates, from the change of the acceleration over the first step
        for j in range(r):
            q_start[j] = q[j] + step * (v[j] + 0.5 * step * acceleration[j])
        row = min(1, last_row)
        chord_tension = _chord_tension(q_start, boundary_data, row, kappa, mean_chordwise_forces, stiffness, length)
        _leading_acceleration(
            q_start, boundary_data, row, chord_tension, kappa, geometric_stiffness, load_projection, change
        )
        if test_stiffness_defect is not None:
            _add_test_stiffness(q_start, chord_tension, test_stiffness_defect, change)
        for j in range(r):
            change[j] -= damping * (v[j] + step * acceleration[j]) + acceleration[j]
            previous_acceleration[j] = acceleration[j] - change[j]
            v[j] += step / 12.0 * change[j]
    sag_stiffness, inertia_factor = 0.5 * stiffness / length, 1.0 + 0.5 * step * damping
    straight = _straight_tension(boundary_data, 0, mean_chordwise_forces, stiffness, length)
    for i in range(boundary_data.shape[0]):
        chord_tension = straight
        for j in range(r):
            chord_tension += sag_stiffness * kappa[j] * q[j] * q[j]
        _monitor_step(
            begin + i, q, boundary_data, i, chord_tension, kappa, geometric_stiffness_norms,
            chordwise_forces_at_candidates, stiffness, length, monitor,
        )  # fmt: skip
        if low.size:
            _link_tensions(
                q, boundary_data, i, chord_tension, slopes, n_in_plane, chordwise_force_patterns, work, low, high
            )
        if next_output < output_steps.size and output_steps[next_output] == begin + i:
            _save_implicit(q, v, acceleration, step, saved[next_output], half_step_rates[next_output])
            if not is_trapezoidal:
                for j in range(r):
                    excess = step / 12.0 * (acceleration[j] - previous_acceleration[j])
                    half_step_rates[next_output, 0, j] -= excess
                    half_step_rates[next_output, 1, j] -= excess
            next_output += 1
        if i == last_row:
            break
        straight = _straight_tension(boundary_data, i + 1, mean_chordwise_forces, stiffness, length)
        _collect_known_terms(
            q, v, acceleration, step, damping, beta, inertia_factor, new_part, boundary_data, i + 1,
            geometric_stiffness, load_projection, known_terms, load_stiffness,
        )  # fmt: skip
        scale = 0.0
        for j in range(r):
            q_start[j] = q[j]
            q[j] += step * v[j] + new_part * (extrapolation * acceleration[j] - previous_acceleration[j])
            scale = max(scale, abs(q[j]))
        previous_change, converged = 0.0, False  # the first correction has no known reduction
        for _ in range(MAX_ITERATIONS):
            _newton_system(
                q, straight, inertia_factor, new_part, sag_stiffness, kappa, test_stiffness_defect,
                known_terms, load_stiffness, tangent, change,
            )  # fmt: skip
            if not _solve(tangent, change):
                break
            cross, square, largest = 0.0, 0.0, 0.0
            for j in range(r):
                cross += kappa[j] * q[j] * change[j]
                square += kappa[j] * change[j] * change[j]
                q[j] += change[j]
                largest = max(largest, abs(change[j]))
            # two bounds of the next correction: the remaining cubic force (sharp for a soft cable), and quadratic convergence,
            # by the square of the last reduction (sharp for a stiff one)
            residual = _remaining_residual(q, change, cross, square, kappa, test_stiffness_defect)
            reduction = min(largest / previous_change, 1.0)
            bound = min(2.0 * new_part * sag_stiffness * residual, largest * reduction * reduction)
            if bound <= NEWTON_RTOL * scale:
                converged = True
                break
            previous_change = largest
        if not converged:
            for j in range(r):
                q[j] = q_start[j]
            return i
        if is_trapezoidal:
            _update_rates(q_start, q, v, acceleration, previous_acceleration, step)
        else:
            for j in range(r):
                previous_acceleration[j] = acceleration[j]
                moved = q[j] - q_start[j] - step * v[j]
                acceleration[j] = (moved - (0.5 * step * step - new_part) * acceleration[j]) / new_part
                v[j] += 0.5 * step * (previous_acceleration[j] + acceleration[j])
    return last_row
