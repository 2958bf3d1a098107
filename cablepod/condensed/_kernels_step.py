"""Compiled parts that the explicit and implicit steps of all orders share."""

from __future__ import annotations

from cablepod._jit import compiled
from cablepod.condensed._kernels_layout import MAX_OMEGA_SQUARED, OMEGA_SQUARED_LIMIT, UNSTABLE_STEP


@compiled(inline="always")
def _monitor_frequency(
    step_number, q, boundary_data, row, chord_tension, kappa, geometric_stiffness_norms, stiffness, length, monitor
):
    """Keep the largest bound of the squared frequency, and the first step at which it reaches the limit."""
    sag, kappa_max, load_frequency_bound = 0.0, 0.0, 0.0
    for j in range(q.size):
        sag += (kappa[j] * q[j]) ** 2
        kappa_max = max(kappa_max, kappa[j])
    for a in range(geometric_stiffness_norms.size):
        load_frequency_bound += abs(boundary_data[row, 1 + a]) * geometric_stiffness_norms[a]
    omega_squared = abs(chord_tension) * kappa_max + load_frequency_bound + stiffness / length * sag
    if omega_squared > monitor[MAX_OMEGA_SQUARED]:
        monitor[MAX_OMEGA_SQUARED] = omega_squared
        if omega_squared >= monitor[OMEGA_SQUARED_LIMIT]:
            monitor[UNSTABLE_STEP] = min(monitor[UNSTABLE_STEP], step_number)


@compiled(inline="always")
def _save_implicit(q, v, acceleration, step, saved, half_step_rates):
    """Save the coordinates (r,) of a step, and the rates half a step before and after it (2, r)."""
    for j in range(q.size):
        saved[j] = q[j]
        half_step_rates[0, j] = v[j] - 0.5 * step * acceleration[j]
        half_step_rates[1, j] = v[j] + 0.5 * step * acceleration[j]


@compiled(inline="always")
def _update_rates(q_start, q, v, acceleration, previous_acceleration, step):
    """Update rates and accelerations by the trapezoidal rule, from coordinates before and after a step."""
    for j in range(q.size):
        new_rate = 2.0 / step * (q[j] - q_start[j]) - v[j]
        previous_acceleration[j] = acceleration[j]
        acceleration[j] = 2.0 / step * (new_rate - v[j]) - acceleration[j]
        v[j] = new_rate
