"""Compiled steps of generalized alpha, with the trapezoidal rule as a case of it, for elastic chains; O(n) per step.

Every step solves for the displacements by Newton's method.  A link couples its two particles only, so that the tangent is block
tridiagonal with blocks of 2 x 2 or 3 x 3.  All lanes iterate together; one that has converged is no longer corrected, so that
each member takes the iterations of its run alone.
"""

from __future__ import annotations

from cablepod._jit import compiled
from cablepod.chain._kernels_links import elastic_links
from cablepod.chain._kernels_newton import (
    MAX_ITERATIONS,
    _add_loads,
    _all_inside,
    _any_failed,
    _begin_step,
    _correct,
    _count_active,
    _forces_and_tangent,
    _has_rates,
    _keep,
    _note,
    _restore,
    _set_end_rates,
    _set_ends,
)


@compiled(noalias=True, counted=False)
def _predict(chain, numbers, state, newton):
    """Predict the displacements of a step, and sum up the forces that do not depend on them."""
    step, alpha_m, alpha_f, beta, gamma = numbers
    per_v, per_a, inertia = 1.0 / (beta * step), 0.5 / beta - 1.0, (1.0 - alpha_m) / (1.0 - alpha_f)
    old_g, old_a = alpha_f / (1.0 - alpha_f), alpha_m / (1.0 - alpha_f)
    x, v, a, g, last_a, first_a = state
    for q in range(x.size):
        # prediction a1 = a + a(-1) - a(-2): exact for resolved linear motion and for oscillation from step to step
        displacement = step * (v[q] + step * ((0.5 - beta) * a[q] + beta * (a[q] + last_a[q] - first_a[q])))
        newton.d[q] = displacement
        newton.trial[q] = x[q] + displacement
        # terms of the balance that do not depend on the unknowns of the step
        balance = old_g * g[q] + chain.mass[q] * (inertia * (per_v * v[q] + per_a * a[q]) - old_a * a[q])
        newton.fixed[q] = chain.loads[q] + balance
    for q in range(chain.damped_mass.size):
        after = (1.0 - gamma) * a[q] - gamma * (per_v * v[q] + per_a * a[q])
        newton.fixed[q] -= chain.damped_mass[q] * (v[q] + step * after)


@compiled(noalias=True, counted=False)
def _rates(numbers, state, newton):
    """Fill the velocities at the end of a step."""
    step, _, _, beta, gamma = numbers
    per_d, per_a, v, a = 1.0 / (beta * step * step), 0.5 / beta - 1.0, state.v, state.a
    for q in range(v.size):
        new = per_d * (newton.d[q] - step * v[q]) - per_a * a[q]
        newton.rates[q] = v[q] + step * ((1.0 - gamma) * a[q] + gamma * new)


@compiled(noalias=True, counted=False)
def _accept(chain, numbers, state, newton):
    """Go on to the end of a step."""
    step, alpha_m, alpha_f, beta, gamma = numbers
    per_d, per_a, inertia = 1.0 / (beta * step * step), 0.5 / beta - 1.0, (1.0 - alpha_m) / (1.0 - alpha_f)
    old_g, old_a = alpha_f / (1.0 - alpha_f), alpha_m / (1.0 - alpha_f)
    x, v, a, g, last_a, first_a = state
    for q in range(x.size):
        before = a[q]
        new = per_d * (newton.d[q] - step * v[q]) - per_a * before
        v[q] = v[q] + step * ((1.0 - gamma) * before + gamma * new)
        g[q] = chain.mass[q] * (inertia * new + old_a * before) - old_g * g[q]
        first_a[q] = last_a[q]
        last_a[q] = before
        a[q] = new
        x[q] = newton.trial[q]


@compiled(counted=False)
def generalized_alpha(sizes, chain, terms, tables, steps, numbers, state, lanes, record, newton):
    """Advance chains by up to `steps` steps of generalized alpha (Chung and Hulbert 1993); alphas 0 give the trapezoidal rule.

    Parameters
    ----------
    sizes, chain, terms, tables, state, lanes, record, newton
        See :mod:`cablepod.chain._kernels_arguments`.
    steps : int
        Number of steps.
    numbers : tuple of 5 floats
        Step [s], and parameters alpha_m, alpha_f, beta, gamma of the method.

    Returns
    -------
    int
        Number of steps done: fewer if lanes failed in the last one, and remain at its beginning, or left their bound.
    """
    step, _, _, beta, gamma = numbers
    rate, saved, with_rates = gamma / (beta * step), 0, _has_rates(chain, terms)
    for i in range(steps):
        saved = _note(sizes, chain, record, saved, record.start + i, state)
        _predict(chain, numbers, state, newton)
        _add_loads(sizes, chain.patterns, tables.factors, i + 1, 1.0, newton.fixed)
        _set_ends(sizes, tables, i + 1, newton.trial)
        _begin_step(lanes, 0.0, newton)
        place = tables.places[i + 1] if tables.places.size else 0.0
        for _ in range(MAX_ITERATIONS):
            if with_rates:
                _rates(numbers, state, newton)
                _set_end_rates(sizes, chain, tables.end_rates, i + 1, newton.rates)
            elastic_links(sizes, chain, newton.trial, newton.reach, newton.t, newton.g)
            on_particles = _forces_and_tangent(sizes, chain, terms, place, newton.trial, 1.0, rate, newton)
            _correct(sizes, chain, on_particles, state.x, newton)
            _set_ends(sizes, tables, i + 1, newton.trial)
            if _count_active(lanes, newton) == 0:
                break
        failed = _any_failed(lanes, newton)
        if failed:
            _keep(state, newton.before)
        _accept(chain, numbers, state, newton)
        if failed:
            _restore(lanes.failed, newton.before, state)
        if not _all_inside(lanes, state.x) or failed:
            return i + 1
    return steps
