"""Compiled implicit steps of the condensed model to leading order."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_closure import MAX_ITERATIONS, NEWTON_RTOL
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_layout import LINK_ROWS
from cablepod.condensed._kernels_leading import (
    _link_tensions,
    _monitor_step,
    _straight_tension,
)
from cablepod.condensed._kernels_step import _save_implicit, _update_rates


@compiled(inline="always")
def _collect_known_terms(
    q, v, acceleration, step, damping, inertia_factor, quarter_step_squared, boundary_data, row, geometric_stiffness,
    load_projection, known_terms, load_stiffness,
):  # fmt: skip
    """Fill the terms of the implicit equation of a step that do not change with q (r,), (r, r)."""
    r, patterns = q.size, geometric_stiffness.shape[0]
    for j in range(r):
        total = acceleration[j]
        for a in range(load_projection.shape[0]):
            total += boundary_data[row, 1 + patterns + a] * load_projection[a, j]
        known_terms[j] = (
            inertia_factor * q[j] + step * (1.0 + 0.25 * step * damping) * v[j] + quarter_step_squared * total
        )
        for k in range(r):
            total = 0.0
            for a in range(patterns):
                total += boundary_data[row, 1 + a] * geometric_stiffness[a, j, k]
            load_stiffness[j, k] = quarter_step_squared * total


@compiled(inline="always")
def _newton_system(
    q, straight, inertia_factor, quarter_step_squared, sag_stiffness, kappa, known_terms, load_stiffness, tangent, change
):  # fmt: skip
    """Fill residual (r,) and tangent (r, r) of the implicit equation of a step."""
    r, chord_tension = q.size, straight
    for j in range(r):
        chord_tension += sag_stiffness * kappa[j] * q[j] * q[j]
    for j in range(r):
        diagonal = inertia_factor + quarter_step_squared * chord_tension * kappa[j]
        residual = known_terms[j] - diagonal * q[j]
        sag = 2.0 * quarter_step_squared * sag_stiffness * kappa[j] * q[j]
        for k in range(r):
            residual -= load_stiffness[j, k] * q[k]
            tangent[j, k] = load_stiffness[j, k] + sag * kappa[k] * q[k]
        change[j] = residual
        tangent[j, j] += diagonal


@compiled(inline="always")
def _remaining_residual(q, change, cross, square, kappa):
    """Return the part of the cubic force that the tangent left out of the last Newton correction, per sag stiffness."""
    residual = 0.0
    for j in range(q.size):
        residual = max(residual, abs(kappa[j] * (cross * change[j] + 0.5 * square * q[j])))
    return residual


@compiled
def leading_implicit(
    q, v, acceleration, step, damping, boundary_data, stiffness, length, kappa, mean_chordwise_forces,
    geometric_stiffness, load_projection, geometric_stiffness_norms, chordwise_forces_at_candidates, slopes, n_in_plane,
    chordwise_force_patterns, begin, output_steps, saved, half_step_rates, low, high, monitor,
):  # fmt: skip
    """Advance by the trapezoidal rule (average acceleration) with Newton's method, to leading order.

    On call `q`, `v` and `acceleration` belong to the first row of the boundary data, on return to the last, which is the first
    of the next block.  Other parameters as in
    :func:`cablepod.condensed._kernels_leading.leading_verlet`.

    Returns
    -------
    int
        Number of steps done; fewer than asked for where Newton's method did not converge.
    """
    r = q.size
    work, matrices, vectors = np.empty((LINK_ROWS, low.size)), np.empty((2, r, r)), np.empty((4, r))
    tangent, load_stiffness = matrices
    change, q_start, known_terms, previous_acceleration = vectors
    previous_acceleration[:] = acceleration
    quarter_step_squared, next_output, last_row = 0.25 * step * step, 0, boundary_data.shape[0] - 1
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
            next_output += 1
        if i == last_row:
            break
        straight = _straight_tension(boundary_data, i + 1, mean_chordwise_forces, stiffness, length)
        _collect_known_terms(
            q, v, acceleration, step, damping, inertia_factor, quarter_step_squared, boundary_data, i + 1,
            geometric_stiffness, load_projection, known_terms, load_stiffness,
        )  # fmt: skip
        scale = 0.0
        for j in range(r):
            q_start[j] = q[j]
            q[j] += step * v[j] + quarter_step_squared * (3.0 * acceleration[j] - previous_acceleration[j])
            scale = max(scale, abs(q[j]))
        previous_change, converged = 0.0, False  # the first correction has no known reduction
        for _ in range(MAX_ITERATIONS):
            _newton_system(
                q, straight, inertia_factor, quarter_step_squared, sag_stiffness, kappa, known_terms, load_stiffness,
                tangent, change,
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
            residual = _remaining_residual(q, change, cross, square, kappa)
            reduction = min(largest / previous_change, 1.0)
            bound = min(2.0 * quarter_step_squared * sag_stiffness * residual, largest * reduction * reduction)
            if bound <= NEWTON_RTOL * scale:
                converged = True
                break
            previous_change = largest
        if not converged:
            for j in range(r):
                q[j] = q_start[j]
            return i
        _update_rates(q_start, q, v, acceleration, previous_acceleration, step)
    return last_row
