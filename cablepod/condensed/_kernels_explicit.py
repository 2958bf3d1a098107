"""Compiled explicit steps of the condensed model to leading order: Numerov's method with a prediction, velocity Verlet.

The schemes know no physics: terms are in :mod:`cablepod.condensed._kernels_closure`, what is kept of a run in
:mod:`cablepod.condensed._kernels_recorder`.  Members lie in lanes, as there.
"""

from cablepod._jit import FUSED, compiled
from cablepod.condensed._kernels_closure import _forces
from cablepod.condensed._kernels_rates import _add_held_drag, _add_rate_forces, _apply_dampers
from cablepod.condensed._kernels_recorder import _monitor_step, _update_extremes


@compiled(fastmath=FUSED, noalias=True, forceinline=True, counted=False)
def _add_excess(sizes, damped, q, f):
    """Add c^2 q / 4 to accelerations f (r, lanes): with it exp(c t / 2) q moves without damping."""
    for k in range(len(sizes.modes) * len(sizes.lanes)):
        f[k] += 0.25 * damped.damping[k] * damped.damping[k] * q[k]


@compiled(fastmath=FUSED, noalias=True, counted=False)
def _start_numerov(sizes, terms, damped, rows, state):
    """Change the rates at the start into (u(h) - u) / h for u = exp(c t / 2) q, and fill the force one step before the start.

    The first step is that of the parabola through the forces at the first three instants, which two corrections find: the first
    leaves an error of fifth order.  The force before the start is that of the parabola.
    """
    n = len(sizes.modes) * len(sizes.lanes)
    last, h = len(rows) - 1, damped.step
    q, v, before, earlier, f, rate, new_q, tension = state
    for k in range(n):
        v[k] += 0.5 * damped.damping[k] * q[k]
        rate[k] = v[k] + 0.5 * h * f[k]
    for trial in range(4):  # one step ahead, two steps ahead, and both again
        ahead = 1 + trial % 2
        for k in range(n):
            new_q[k] = damped.decay[k] * (q[k] + h * rate[k])
            if ahead == 2:
                new_q[k] = damped.decay[k] * damped.decay[k] * (q[k] + h * (2.0 * rate[k] + h * before[k]))
        _forces(sizes, terms, rows[ahead if ahead < last else last], new_q, tension, earlier)
        _add_excess(sizes, damped, new_q, earlier)
        for k in range(n):
            earlier[k] *= damped.impulse[k]
            if ahead == 1:
                before[k] = earlier[k]
            else:
                earlier[k] *= damped.impulse[k]
                rate[k] = v[k] + h / 24.0 * (7.0 * f[k] + 6.0 * before[k] - earlier[k])
    for k in range(n):
        v[k] = rate[k]
        before[k] = damped.impulse[k] * (3.0 * f[k] - 3.0 * before[k] + earlier[k])


@compiled(fastmath=FUSED, noalias=True, counted=False)
def numerov(sizes, terms, bounds, links, damped, rows, steps, state, begin, record, monitor):
    """Advance by Numerov's method with an explicit prediction of the new force, to leading order.

    Without the damping c, u = exp(c t / 2) q obeys u'' = g with the force g of q plus c^2 q / 4.  With the prediction
    u(t + h) = 2 u - u(t - h) + h^2 g,

        u(t + h) - 2 u + u(t - h) = h^2 / 12 (g(t + h) + 10 g + g(t - h))

    is of fourth order, stable below sqrt(12) over the highest angular frequency, and errs by (omega h)^4 / 720 of the phase.
    Rates follow from u' = (u - u(t - h)) / h + h / 24 (7 g + 6 g(t - h) - g(t - 2 h)).

    Parameters
    ----------
    sizes, terms, bounds, links
        See :mod:`cablepod.condensed._kernels_closure` and :mod:`cablepod.condensed._kernels_recorder`.
    damped, state, record
        See above.  At the start `state.v` holds the rates; later, and on return, (u - u(t - h)) / h for u = q now.
    rows, steps
        Boundary data (steps + 1 or more, columns lanes); row number `steps` is the first of the next block.  The first
        step takes three rows where there are as many.
    begin
        Number of the first step.
    monitor
        Extremes of the run (MONITOR_ROWS, lanes), flat; changed.

    Notes
    -----
    M. M. Chawla, Numerov made explicit has better stability, BIT 24, 117 (1984).
    """
    lanes, size = len(sizes.lanes), len(sizes.modes)
    n, h, saved = size * lanes, damped.step, record.first
    q, v, before, earlier, f, predicted, new_f, tension = state
    next_output = record.steps[saved] if saved < record.steps.size else -1
    for i in range(steps + 1):
        number = begin + i
        if i > 0 and number == 1:
            _start_numerov(sizes, terms, damped, rows, state)
        elif i > 0:
            for k in range(n):
                predicted[k] = damped.decay[k] * (q[k] + h * (v[k] + h * f[k]))
            _forces(sizes, terms, rows[i], predicted, tension, new_f)
            _add_excess(sizes, damped, predicted, new_f)
            for k in range(n):
                v[k] += h / 12.0 * (damped.impulse[k] * new_f[k] + 10.0 * f[k] + damped.decay[k] * before[k])
        if i > 0:
            for k in range(n):
                q[k] = damped.decay[k] * (q[k] + h * v[k])
                v[k] *= damped.decay[k]
                earlier[k] = before[k]
                before[k] = f[k]
        _forces(sizes, terms, rows[i], q, tension, f)
        _add_excess(sizes, damped, q, f)
        _monitor_step(sizes, terms, bounds, rows[i], q, tension, number, monitor)
        if links is not None and links.low.size:
            _update_extremes(sizes, links, rows[i], q, tension)
        if number == next_output:
            for j in range(size):
                for m in range(lanes):
                    k = j * lanes + m
                    damping, decay, rate = damped.damping[k], damped.decay[k], v[k]
                    if number > 0:
                        past = decay * (6.0 * before[k] - decay * earlier[k])
                        rate += h / 24.0 * (7.0 * f[k] + past) - 0.5 * damping * q[k]
                    change = 0.5 * h * (f[k] - 0.25 * damping * damping * q[k] - damping * rate)
                    record.coordinates[m, saved, j] = q[k]
                    if record.half_step_rates.size:
                        record.half_step_rates[m, saved, 0, j] = rate - change
                        record.half_step_rates[m, saved, 1, j] = rate + change
            saved += 1
            next_output = record.steps[saved] if saved < record.steps.size else -1


@compiled(fastmath=FUSED, noalias=True, counted=False)
def verlet(sizes, terms, bounds, links, damped, rate_terms, air, rows, steps, state, begin, record, monitor):
    """Advance by velocity Verlet to leading order, one step for each row of the boundary data.

    Parameters
    ----------
    rate_terms, air
        Forces by rates, see :class:`cablepod.condensed._kernels_layout.RateTerms`, and wind, see
        :class:`cablepod.condensed._kernels_layout.RunAir`; None where the rates count in the damping by mass only.  Both are of
        one lane.  The rates at a step are extrapolated from the middles of the last two steps.
    state
        `v` holds the rates half a step before, `before` those one and a half steps before.
    sizes, terms, bounds, links, damped, rows, steps, begin, record, monitor
        As in :func:`numerov`, without a row after the last step.
    """
    lanes, size = len(sizes.lanes), len(sizes.modes)
    n, saved = size * lanes, record.first
    q, v, before, _, f, u, work, tension = state
    next_output = record.steps[saved] if saved < record.steps.size else -1
    for i in range(steps):
        number = begin + i
        _forces(sizes, terms, rows[i], q, tension, f)
        if rate_terms is not None:
            for k in range(n):
                u[k] = 1.5 * v[k] - 0.5 * before[k]
                before[k] = v[k]
            _add_rate_forces(sizes, terms, rate_terms, rows[i], tension, u, work, f)
            _add_held_drag(air, q, u, rows[i, 0] * terms.inverse_length[0], None, number, damped.step, f)
        _monitor_step(sizes, terms, bounds, rows[i], q, tension, number, monitor)
        if links is not None and links.low.size:
            _update_extremes(sizes, links, rows[i], q, tension)
        if number == next_output:
            for j in range(size):
                for m in range(lanes):
                    record.coordinates[m, saved, j] = q[j * lanes + m]
                    if record.half_step_rates.size:
                        record.half_step_rates[m, saved, 0, j] = v[j * lanes + m]
        for k in range(n):
            v[k] = damped.decay[k] * v[k] + damped.impulse[k] * f[k]
        if rate_terms is not None and rate_terms.dampers.size:
            for k in range(n):
                u[k] = before[k]
            _apply_dampers(rate_terms.dampers, v, u, work)
        if number == next_output:
            if record.half_step_rates.size:
                for j in range(size):
                    for m in range(lanes):
                        record.half_step_rates[m, saved, 1, j] = v[j * lanes + m]
            saved += 1
            next_output = record.steps[saved] if saved < record.steps.size else -1
        for k in range(n):
            q[k] += damped.step * v[k]
