"""Compiled implicit steps of the condensed model with the exact chordwise stretch."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_closure import MAX_ITERATIONS, NEWTON_RTOL
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_exact import _monitor_step, _update_extremes, exact_force
from cablepod.condensed._kernels_layout import CHORD_TENSION, CLOSURE_ROWS, FORCE
from cablepod.condensed._kernels_step import _save_implicit, _update_rates


@compiled(inline="always")
def _newton_system(
    q, q_start, v, rates, acceleration, step, damping, quarter_step_squared, has_inertia, f, tangent, mass, change
):
    """Change forces (r,) and tangent (r, r) into residual `change` and tangent of the implicit equation of a step."""
    r = q.size
    for j in range(r):
        if not has_inertia:
            for k in range(r):
                mass[j, k] = 1.0 if j == k else 0.0
        change[j] = quarter_step_squared * f[j]
    for j in range(r):
        for k in range(r):
            known = q_start[k] + step * v[k] + quarter_step_squared * (acceleration[k] - damping * rates[k]) - q[k]
            change[j] += mass[j, k] * known
            tangent[j, k] = quarter_step_squared * tangent[j, k] + (1.0 + 0.5 * step * damping) * mass[j, k]


@compiled
def exact_implicit(
    q, v, acceleration, step, damping, boundary_data, stiffness, length, kappa, load_projection,
    geometric_stiffness_norms, slopes, n_in_plane, chordwise_force_patterns, weights, green, inertia, stretch, begin,
    output_steps, saved, half_step_rates, low, high, monitor,
):  # fmt: skip
    """Advance by the trapezoidal rule with the exact chordwise stretch; returns the number of steps done.

    The closure starts from the last stretch, ``stretch[0]``, and the last H.  Other parameters and the returned value as in
    :func:`cablepod.condensed._kernels_leading_implicit.leading_implicit` and
    :func:`cablepod.condensed._kernels_exact.exact_verlet`.
    """
    r, m = slopes.shape
    f, tangent, mass = np.empty(r), np.empty((r, r)), np.empty((r, r))
    work, slope, slope_rate = np.empty((CLOSURE_ROWS, m)), np.empty((2, m)), np.empty((2, m))
    stretch_jacobian, no_array = np.empty((2 * r, m)), np.empty((0, 0))
    change, q_start, rates, previous_acceleration = np.empty(r), np.empty(r), np.empty(r), acceleration.copy()
    quarter_step_squared, next_output, last_row = 0.25 * step * step, 0, boundary_data.shape[0] - 1
    accepted = stretch[0]
    for i in range(boundary_data.shape[0]):
        if next_output < output_steps.size and output_steps[next_output] == begin + i:
            _save_implicit(q, v, acceleration, step, saved[next_output], half_step_rates[next_output])
            next_output += 1
        # evaluate H once more: in a stiff cable a small last correction still changes it much
        monitor[CHORD_TENSION] = exact_force(
            q, v, boundary_data, i, slopes, n_in_plane, chordwise_force_patterns, weights, stiffness, green,
            load_projection, no_array, monitor[CHORD_TENSION], accepted, work, slope, slope_rate,
            stretch_jacobian, f, no_array, mass,
        )  # fmt: skip
        _monitor_step(
            begin + i, q, boundary_data, i, monitor[CHORD_TENSION], work[FORCE], kappa, geometric_stiffness_norms, stiffness,
            length, monitor,
        )  # fmt: skip
        if low.size:
            _update_extremes(accepted, work, stiffness, green, low, high)
        if i == last_row:
            break
        scale = 0.0
        for j in range(r):
            q_start[j] = q[j]
            q[j] += step * v[j] + quarter_step_squared * (3.0 * acceleration[j] - previous_acceleration[j])
            scale = max(scale, abs(q[j]))
        previous_change, converged = 0.0, False  # the first correction has no known reduction
        for _ in range(MAX_ITERATIONS):
            for j in range(r):
                rates[j] = 2.0 / step * (q[j] - q_start[j]) - v[j]
            monitor[CHORD_TENSION] = exact_force(
                q, rates, boundary_data, i + 1, slopes, n_in_plane, chordwise_force_patterns, weights, stiffness, green,
                load_projection, inertia, monitor[CHORD_TENSION], accepted, work, slope, slope_rate,
                stretch_jacobian, f, tangent, mass,
            )  # fmt: skip
            _newton_system(
                q, q_start, v, rates, acceleration, step, damping, quarter_step_squared, inertia.size > 0, f, tangent,
                mass, change,
            )  # fmt: skip
            if not _solve(tangent, change):
                break
            largest = 0.0
            for j in range(r):
                q[j] += change[j]
                largest = max(largest, abs(change[j]))
            # the tangent is approximate: the error shrinks at least by the last reduction
            if largest * min(largest / previous_change, 1.0) <= NEWTON_RTOL * scale or largest == 0.0:
                converged = True
                break
            previous_change = largest
        if not converged:
            for j in range(r):
                q[j] = q_start[j]
            return i
        _update_rates(q_start, q, v, acceleration, previous_acceleration, step)
    return last_row
