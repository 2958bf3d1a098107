"""Compiled implicit steps of elastic chains: generalized alpha, with the trapezoidal rule as a case of it, and energy-momentum.

Every step solves for the displacements by Newton's method, with O(n) operations.  A link couples its two particles only, so that
the tangent is block tridiagonal with blocks of 2 x 2 or 3 x 3.  All lanes iterate together; one that has converged is no longer
corrected, so that each member takes the iterations of its run alone.
"""

import math

from cablepod._jit import compiled
from cablepod.chain._kernels_links import conserving_links, elastic_links
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

# --- generalized alpha ------------------------------------------------------------------------------------------------


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


# --- energy-momentum --------------------------------------------------------------------------------------------------


@compiled(noalias=True, counted=False)
def _predict_conserving(chain, step, state, newton):
    """Predict the displacements of a step, and sum up the forces that do not depend on them."""
    x, v, last_displacement = state.x, state.v, state.a
    for q in range(x.size):
        # last displacement plus twice the difference of step * velocity from it
        displacement = 2.0 * step * v[q] - last_displacement[q]
        newton.d[q] = displacement
        newton.trial[q] = x[q] + displacement
        newton.fixed[q] = chain.loads[q] + 2.0 * chain.mass[q] * v[q] / step


@compiled(noalias=True, counted=False)
def _mean_motion(step, x, newton):
    """Fill positions and velocities in the middle of a step."""
    for q in range(x.size):
        newton.middle[q] = 0.5 * (x[q] + newton.trial[q])
        newton.rates[q] = (newton.trial[q] - x[q]) / step


@compiled(noalias=True, counted=False)
def _accept_conserving(step, state, newton):
    """Go on to the end of a step."""
    x, v, last_displacement = state.x, state.v, state.a
    for q in range(x.size):
        v[q] = 2.0 * newton.d[q] / step - v[q]
        last_displacement[q] = newton.d[q]
        x[q] = newton.trial[q]


# --- steps ------------------------------------------------------------------------------------------------------------


@compiled(counted=False)
def implicit(sizes, chain, terms, tables, steps, numbers, state, lanes, record, newton, conserving):
    """Advance chains by up to `steps` steps of generalized alpha, or of the energy-momentum method.

    Generalized alpha: Chung and Hulbert 1993; alphas 0 give the trapezoidal rule.  Energy-momentum: Simo and Tarnow 1992.  Its
    forces of the links over a step are difference quotients of their energies.  With ends and loads at rest, the total energy is
    then conserved at any step, up to the residual of Newton's method.  Time-dependent loads are means of both ends of the step.
    Forces by rates are those of the mean position and velocity, in the wind at the middle of the step.  The residual has a
    systematic sign and accumulates in the energy: iterations continue until a correction is below rounding, or not decreasing.

    Parameters
    ----------
    sizes, chain, terms, tables, state, lanes, record, newton
        See :mod:`cablepod.chain._kernels_arguments`.
    steps : int
        Number of steps.
    numbers : tuple of 5 floats
        Step [s], and parameters alpha_m, alpha_f, beta, gamma of generalized alpha.
    conserving : True or None
        Whether to take energy-momentum steps.

    Returns
    -------
    int
        Number of steps done: fewer if lanes failed in the last one, and remain at its beginning, or left their bound.
    """
    step, _, _, beta, gamma = numbers
    saved, with_rates = 0, _has_rates(chain, terms)
    for i in range(steps):
        saved = _note(sizes, chain, record, saved, record.start + i, state)
        if conserving is not None:
            _predict_conserving(chain, step, state, newton)
            _add_loads(sizes, chain.patterns, tables.factors, i, 0.5, newton.fixed)
            _add_loads(sizes, chain.patterns, tables.factors, i + 1, 0.5, newton.fixed)
        else:
            _predict(chain, numbers, state, newton)
            _add_loads(sizes, chain.patterns, tables.factors, i + 1, 1.0, newton.fixed)
        _set_ends(sizes, tables, i + 1, newton.trial)
        _begin_step(lanes, math.inf if conserving is not None else 0.0, newton)
        place = 0.0
        if tables.places.size:
            place = tables.places[i] if conserving is not None else tables.places[i + 1]
        for _ in range(MAX_ITERATIONS):
            if conserving is not None:
                conserving_links(sizes, chain, state.x, newton.trial, newton.reach, newton.t, newton.g)
                if with_rates:
                    _mean_motion(step, state.x, newton)
                on_particles = _forces_and_tangent(sizes, chain, terms, place, newton.middle, 0.5, 1.0 / step, newton)
            else:
                if with_rates:
                    _rates(numbers, state, newton)
                    _set_end_rates(sizes, chain, tables.end_rates, i + 1, newton.rates)
                elastic_links(sizes, chain, newton.trial, newton.reach, newton.t, newton.g)
                rate = gamma / (beta * step)
                on_particles = _forces_and_tangent(sizes, chain, terms, place, newton.trial, 1.0, rate, newton)
            _correct(sizes, chain, on_particles, state.x, newton)
            _set_ends(sizes, tables, i + 1, newton.trial)
            if _count_active(lanes, newton) == 0:
                break
        failed = _any_failed(lanes, newton)
        if failed:
            _keep(state, newton.before)
        if conserving is not None:
            _accept_conserving(step, state, newton)
        else:
            _accept(chain, numbers, state, newton)
        if failed:
            _restore(lanes.failed, newton.before, state)
        if not _all_inside(lanes, state.x) or failed:
            return i + 1
    return steps
