"""Compiled implicit steps of the condensed model with the exact chordwise stretch."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_closure import MAX_ITERATIONS, NEWTON_RTOL
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_exact import _exact_work, _record_exact, exact_force
from cablepod.condensed._kernels_layout import CHORD_TENSION, ExactTerms
from cablepod.condensed._kernels_rates import _subtract_modal_damping
from cablepod.condensed._kernels_recorder import _monitor_frequency
from cablepod.condensed._kernels_step import _add_modal_tangent, _save_implicit, _update_rates


@compiled(counted=False)
def _newton_system(q_start, state, rates, step, damping, has_inertia, f, tangent, mass, change):
    """Change forces (r,) and tangent (r, r) into residual `change` and tangent of the implicit equation of a step."""
    q, v, acceleration, quarter = state[0], state[1], state[2], 0.25 * step * step
    r = q.size
    for j in range(r):
        if not has_inertia:
            for k in range(r):
                mass[j, k] = 1.0 if j == k else 0.0
        change[j] = quarter * f[j]
        for k in range(r):
            known = q_start[k] + step * v[k] + quarter * (acceleration[k] - damping * rates[k]) - q[k]
            change[j] += mass[j, k] * known
            tangent[j, k] = quarter * tangent[j, k] + (1.0 + 0.5 * step * damping) * mass[j, k]


@compiled
def exact_trapezoidal(
    exact,
    sizes,
    terms,
    bounds,
    step,
    damping,
    modal_damping,
    boundary_data,
    state,
    stretch,
    begin,
    record,
    low,
    high,
    monitor,
):
    """Advance by the trapezoidal rule with the exact chordwise stretch; return the number of steps done.

    The closure starts from the last stretch, ``stretch[0]``, and the last H.  `modal_damping` is that of
    :class:`cablepod.condensed._kernels_layout.RateTerms`.  Other arguments and the returned value as in
    :func:`cablepod.condensed._kernels_exact.exact_verlet` and
    :func:`cablepod.condensed._kernels_implicit.trapezoidal`.
    """
    (r, _), q, v, acceleration = exact.slopes.shape, state[0], state[1], state[2]
    f, tangent, mass, work = np.empty(r), np.empty((r, r)), np.empty((r, r)), _exact_work(exact)
    change, q_start, rates, previous_acceleration = np.empty(r), np.empty(r), np.empty(r), np.empty(r)
    no_array, tension, saved, accepted = np.empty((0, 0)), np.empty(1), 0, stretch[0]
    steps = boundary_data.shape[0] - 1
    without_inertia = ExactTerms(
        exact.stiffness, exact.green, exact.slopes, exact.in_plane, exact.force_patterns, exact.weights, exact.load_projection,
        no_array,
    )  # fmt: skip
    for j in range(r):
        previous_acceleration[j] = acceleration[j]
    for i in range(steps + 1):
        if saved < record.steps.size and record.steps[saved] == begin + i:
            _save_implicit(q, v, acceleration, step, record, saved)
            saved += 1
        # evaluate H once more: in a stiff cable a small last correction still changes it much
        row, guess = boundary_data[i], monitor[CHORD_TENSION]
        tension[0] = exact_force(without_inertia, row, q, v, guess, accepted, work, f, no_array, mass)
        monitor[CHORD_TENSION] = tension[0]
        _record_exact(exact, accepted, work.closure, begin + i, low, high, monitor)
        _monitor_frequency(sizes, terms, bounds, row, 0, q, tension, begin + i, monitor)
        if i == steps:
            break
        scale = 0.0
        for j in range(r):
            q_start[j] = q[j]
            q[j] += step * v[j] + 0.25 * step * step * (3.0 * acceleration[j] - previous_acceleration[j])
            scale = max(scale, abs(q[j]))
        previous_change, converged, row = (
            0.0,
            False,
            boundary_data[i + 1],
        )  # the first correction has no known reduction
        for _ in range(MAX_ITERATIONS):
            for j in range(r):
                rates[j] = 2.0 / step * (q[j] - q_start[j]) - v[j]
            guess = monitor[CHORD_TENSION]
            monitor[CHORD_TENSION] = exact_force(exact, row, q, rates, guess, accepted, work, f, tangent, mass)
            _subtract_modal_damping(modal_damping, rates, f)
            _add_modal_tangent(modal_damping, step, tangent)
            _newton_system(q_start, state, rates, step, damping, exact.inertia.size > 0, f, tangent, mass, change)
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
    return steps
