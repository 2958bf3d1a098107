"""Compiled parts that the implicit steps of all orders share."""

from __future__ import annotations

from cablepod._jit import compiled


@compiled(counted=False)
def _save_implicit(q, v, acceleration, step, record, saved):
    """Save the coordinates (r,) of a step, and the rates half a step before and after it, as output number `saved`."""
    r = q.size
    for j in range(r):
        record.coordinates[saved * r + j] = q[j]
        record.half_step_rates[2 * saved * r + j] = v[j] - 0.5 * step * acceleration[j]
        record.half_step_rates[(2 * saved + 1) * r + j] = v[j] + 0.5 * step * acceleration[j]


@compiled(counted=False)
def _add_modal_tangent(modal_damping, step, tangent):
    """Add the derivative of the damping by ratios by the coordinates after a step, 2 C / step, to the tangent (r, r)."""
    r = tangent.shape[0]
    for j in range(modal_damping.size // r):
        for k in range(r):
            tangent[j, k] += 2.0 / step * modal_damping[j * r + k]


@compiled(counted=False)
def _update_rates(q_start, q, v, acceleration, previous_acceleration, step):
    """Update rates and accelerations by the trapezoidal rule, from coordinates before and after a step."""
    for j in range(q.size):
        new_rate = 2.0 / step * (q[j] - q_start[j]) - v[j]
        previous_acceleration[j] = acceleration[j]
        acceleration[j] = 2.0 / step * (new_rate - v[j]) - acceleration[j]
        v[j] = new_rate
