"""Compiled implicit steps of the condensed model to leading order, by the trapezoidal rule."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_closure import MAX_ITERATIONS, NEWTON_RTOL
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_rates import _subtract_modal_damping
from cablepod.condensed._kernels_recorder import _monitor_step, _update_extremes
from cablepod.condensed._kernels_step import _add_modal_tangent, _save_implicit, _update_rates
from cablepod.condensed._kernels_terms import _fill_tangent, _forces


@compiled
def trapezoidal(sizes, terms, bounds, links, step, damping, modal_damping, rows, steps, state, begin, record, monitor):
    """Advance by the trapezoidal rule (average acceleration) with Newton's method, to leading order, one lane.

    On call `state` holds coordinates, rates and damped accelerations (3, r) of the first row of the boundary data, on return of
    the last, which is the first of the next block.  `modal_damping` is that of
    :class:`cablepod.condensed._kernels_layout.RateTerms`.  Other arguments as in
    :func:`cablepod.condensed._kernels_explicit.numerov`.

    Returns
    -------
    int
        Number of steps done; fewer than asked for where Newton's method did not converge.
    """
    q, v, acceleration = state[0], state[1], state[2]
    r, columns, saved = q.size, 1 + len(sizes.patterns) + len(sizes.normal_loads), 0
    tangent, vectors, tension = np.empty((r, r)), np.empty((6, r)), np.empty(1)
    f, change, q_start, known_terms, previous_acceleration = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    rates = vectors[5]
    for j in range(r):
        previous_acceleration[j] = acceleration[j]
    quarter, inertia_factor = 0.25 * step * step, 1.0 + 0.5 * step * damping
    _forces(sizes, terms, rows, 0, q, tension, f)
    for i in range(steps + 1):
        _monitor_step(sizes, terms, bounds, rows, i * columns, q, tension, begin + i, monitor)
        if links is not None and links.low.size:
            _update_extremes(sizes, links, rows, i * columns, q, tension)
        if saved < record.steps.size and record.steps[saved] == begin + i:
            _save_implicit(q, v, acceleration, step, record, saved)
            saved += 1
        if i == steps:
            break
        scale = 0.0
        for j in range(r):
            q_start[j] = q[j]
            known_terms[j] = (
                inertia_factor * q[j] + step * (1.0 + 0.25 * step * damping) * v[j] + quarter * acceleration[j]
            )
            q[j] += step * v[j] + quarter * (3.0 * acceleration[j] - previous_acceleration[j])
            scale = max(scale, abs(q[j]))
        previous_change, converged = 0.0, False  # the first correction has no known reduction
        for _ in range(MAX_ITERATIONS):
            _forces(sizes, terms, rows, (i + 1) * columns, q, tension, f)
            _fill_tangent(terms, rows, (i + 1) * columns, q, tension[0], tangent)
            for j in range(r):
                rates[j] = 2.0 / step * (q[j] - q_start[j]) - v[j]
            _subtract_modal_damping(modal_damping, rates, f)
            _add_modal_tangent(modal_damping, step, tangent)
            for j in range(r):
                change[j] = known_terms[j] - inertia_factor * q[j] + quarter * f[j]
                for k in range(r):
                    tangent[j, k] *= quarter
                tangent[j, j] += inertia_factor
            if not _solve(tangent, change):
                break
            cross, square, largest, residual = 0.0, 0.0, 0.0, 0.0
            for j in range(r):
                cross += terms.kappa[j] * q[j] * change[j]
                square += terms.kappa[j] * change[j] * change[j]
                q[j] += change[j]
                largest = max(largest, abs(change[j]))
            # two bounds of the next correction: the cubic force that the tangent left out (sharp for a soft cable), and quadratic
            # convergence, by the square of the last reduction (sharp for a stiff one)
            for j in range(r):
                residual = max(residual, abs(terms.kappa[j] * (cross * change[j] + 0.5 * square * q[j])))
            reduction = min(largest / previous_change, 1.0)
            bound = min(2.0 * quarter * terms.sag_stiffness[0] * residual, largest * reduction * reduction)
            if bound <= NEWTON_RTOL * scale:
                converged = True
                break
            previous_change = largest
        if not converged:
            for j in range(r):
                q[j] = q_start[j]
            return i
        _forces(sizes, terms, rows, (i + 1) * columns, q, tension, f)
        _update_rates(q_start, q, v, acceleration, previous_acceleration, step)
    return steps
