"""Compiled implicit steps of the condensed model by the trapezoidal rule: to leading order, and with the exact stretch."""

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_closure import _fill_tangent, _forces
from cablepod.condensed._kernels_exact import _close_chord, _record_exact, exact_force
from cablepod.condensed._kernels_exact_closure import MAX_ITERATIONS, NEWTON_RTOL
from cablepod.condensed._kernels_layout import CHORD_TENSION
from cablepod.condensed._kernels_rates import _subtract_modal_damping
from cablepod.condensed._kernels_recorder import _monitor_frequency, _monitor_step, _update_extremes
from cablepod.discretisation._kernels_dense import _solve


@compiled(counted=False)
def _save_implicit(q, v, acceleration, step, record, saved):
    """Save the coordinates (r,) of a step, and the rates half a step before and after it, as output number `saved`."""
    for j in range(q.size):
        record.coordinates[0, saved, j] = q[j]
        record.half_step_rates[0, saved, 0, j] = v[j] - 0.5 * step * acceleration[j]
        record.half_step_rates[0, saved, 1, j] = v[j] + 0.5 * step * acceleration[j]


@compiled(counted=False)
def _add_modal_tangent(modal_damping, step, tangent):
    """Add the derivative of the damping by ratios by the coordinates after a step, 2 C / step, to the tangent (r, r)."""
    r = tangent.shape[0]
    for j in range(modal_damping.size // r):
        for k in range(r):
            tangent[j, k] += 2.0 / step * modal_damping[j * r + k]


@compiled(counted=False)
def _predict(q, v, acceleration, previous_acceleration, step, q_start):
    """Keep the coordinates (r,) before a step, predict those after it; return the largest one.

    The acceleration is extrapolated from the last two steps.
    """
    scale = 0.0
    for j in range(q.size):
        q_start[j] = q[j]
        q[j] += step * v[j] + 0.25 * step * step * (3.0 * acceleration[j] - previous_acceleration[j])
        scale = max(scale, abs(q[j]))
    return scale


@compiled(counted=False)
def _fill_rates(q_start, q, v, step, rates):
    """Fill the rates (r,) after a step, for coordinates before and after it and the rates v before it."""
    for j in range(q.size):
        rates[j] = 2.0 / step * (q[j] - q_start[j]) - v[j]


@compiled(counted=False)
def _fill_newton_system(inertia, mass, q_start, state, rates, step, damping, f, tangent, change):
    """Change forces f (r,) and their tangent (r, r) into residual `change` and tangent of the implicit equation of a step.

    The mass matrix (r, r) is the identity without `inertia`.  The rates after the step (r,) are overwritten.
    """
    q, v, acceleration, quarter, factor = state[0], state[1], state[2], 0.25 * step * step, 1.0 + 0.5 * step * damping
    r, known = q.size, rates
    for j in range(r):
        known[j] = q_start[j] + step * v[j] + quarter * (acceleration[j] - damping * rates[j]) - q[j]
        change[j] = quarter * f[j]
        for k in range(r):
            tangent[j, k] *= quarter
    if inertia is None:
        for j in range(r):
            change[j] += known[j]
            tangent[j, j] += factor
        return
    for j in range(r):
        for k in range(r):
            change[j] += mass[j, k] * known[k]
            tangent[j, k] += factor * mass[j, k]


@compiled(counted=False)
def _correct(change, q):
    """Add a correction to the coordinates (r,); return the largest part of it."""
    largest = 0.0
    for j in range(q.size):
        q[j] += change[j]
        largest = max(largest, abs(change[j]))
    return largest


@compiled(counted=False)
def _update_rates(q_start, q, v, acceleration, previous_acceleration, step):
    """Update rates and accelerations by the trapezoidal rule, from coordinates before and after a step."""
    for j in range(q.size):
        new_rate = 2.0 / step * (q[j] - q_start[j]) - v[j]
        previous_acceleration[j] = acceleration[j]
        acceleration[j] = 2.0 / step * (new_rate - v[j]) - acceleration[j]
        v[j] = new_rate


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
    r, saved = q.size, record.first
    tangent, vectors, tension = np.empty((r, r)), np.empty((5, r)), np.empty(1)
    f, change, q_start, rates, previous_acceleration = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    for j in range(r):
        previous_acceleration[j] = acceleration[j]
    _forces(sizes, terms, rows[0], q, tension, f)
    for i in range(steps + 1):
        _monitor_step(sizes, terms, bounds, rows[i], q, tension, begin + i, monitor)
        if links is not None and links.low.size:
            _update_extremes(sizes, links, rows[i], q, tension)
        if saved < record.steps.size and record.steps[saved] == begin + i:
            _save_implicit(q, v, acceleration, step, record, saved)
            saved += 1
        if i == steps:
            break
        scale = _predict(q, v, acceleration, previous_acceleration, step, q_start)
        previous_change, converged = 0.0, False  # the first correction has no known reduction
        for _ in range(MAX_ITERATIONS):
            _forces(sizes, terms, rows[i + 1], q, tension, f)
            _fill_tangent(terms, rows[i + 1], q, tension[0], tangent)
            _fill_rates(q_start, q, v, step, rates)
            _subtract_modal_damping(modal_damping, rates, f)
            _add_modal_tangent(modal_damping, step, tangent)
            _fill_newton_system(None, None, q_start, state, rates, step, damping, f, tangent, change)
            if not _solve(tangent, change):
                break
            cross, square, residual = 0.0, 0.0, 0.0
            for j in range(r):
                cross += terms.kappa[j] * q[j] * change[j]
                square += terms.kappa[j] * change[j] * change[j]
            largest = _correct(change, q)
            # two bounds of the next correction: the cubic force that the tangent left out (sharp for a soft cable), and quadratic
            # convergence, by the square of the last reduction (sharp for a stiff one)
            for j in range(r):
                residual = max(residual, abs(terms.kappa[j] * (cross * change[j] + 0.5 * square * q[j])))
            reduction = min(largest / previous_change, 1.0)
            bound = min(0.5 * step * step * terms.sag_stiffness[0] * residual, largest * reduction * reduction)
            if bound <= NEWTON_RTOL * scale:
                converged = True
                break
            previous_change = largest
        if not converged:
            for j in range(r):
                q[j] = q_start[j]
            return i
        _forces(sizes, terms, rows[i + 1], q, tension, f)
        _update_rates(q_start, q, v, acceleration, previous_acceleration, step)
    return steps


@compiled(counted=False)
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
    work,
    begin,
    record,
    low,
    high,
    monitor,
):
    """Advance by the trapezoidal rule with the exact chordwise stretch; return the number of steps done.

    The closure starts from the stretch and H of the last step.  `modal_damping` is that of
    :class:`cablepod.condensed._kernels_layout.RateTerms`.  Other arguments and the returned value as in
    :func:`cablepod.condensed._kernels_exact.exact_verlet` and
    :func:`cablepod.condensed._kernels_implicit.trapezoidal`.
    """
    q, v, acceleration, saved, steps = state[0], state[1], state[2], record.first, boundary_data.shape[0] - 1
    r, tangent, vectors, tension = q.size, work.tangent, work.vectors, work.tension
    f, change, q_start, rates, previous_acceleration = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    for j in range(r):
        previous_acceleration[j] = acceleration[j]
    for i in range(steps + 1):
        if saved < record.steps.size and record.steps[saved] == begin + i:
            _save_implicit(q, v, acceleration, step, record, saved)
            saved += 1
        # evaluate H once more: in a stiff cable a small last correction still changes it much
        row, guess = boundary_data[i], monitor[CHORD_TENSION]
        tension[0] = _close_chord(exact, row, q, guess, work)
        monitor[CHORD_TENSION] = tension[0]
        _record_exact(exact, work.stretch[0], work.closure, begin + i, low, high, monitor)
        _monitor_frequency(sizes, terms, bounds, row, q, tension, begin + i, monitor)
        if i == steps:
            break
        scale = _predict(q, v, acceleration, previous_acceleration, step, q_start)
        row, previous_change, converged = boundary_data[i + 1], 0.0, False
        for _ in range(MAX_ITERATIONS):
            _fill_rates(q_start, q, v, step, rates)
            guess = monitor[CHORD_TENSION]
            monitor[CHORD_TENSION] = exact_force(exact, row, q, rates, guess, work, f)
            _subtract_modal_damping(modal_damping, rates, f)
            _add_modal_tangent(modal_damping, step, tangent)
            _fill_newton_system(exact.inertia, work.mass, q_start, state, rates, step, damping, f, tangent, change)
            if not _solve(tangent, change):
                break
            largest = _correct(change, q)
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
