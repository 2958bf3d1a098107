"""Compiled energy-momentum steps of elastic chains (Simo and Tarnow)."""

from __future__ import annotations

import math

from cablepod._jit import compiled
from cablepod.chain._kernels_links import conserving_links
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
    _set_ends,
)


@compiled(noalias=True, counted=False)
def _predict(chain, step, state, newton):
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
def _accept(step, state, newton):
    """Go on to the end of a step."""
    x, v, last_displacement = state.x, state.v, state.a
    for q in range(x.size):
        v[q] = 2.0 * newton.d[q] / step - v[q]
        last_displacement[q] = newton.d[q]
        x[q] = newton.trial[q]


@compiled(counted=False)
def energy_momentum(sizes, chain, terms, tables, steps, numbers, state, lanes, record, newton):
    """Advance chains by up to `steps` steps of the energy-momentum method (Simo and Tarnow 1992).

    The forces of the links over a step are difference quotients of their energies.  With ends and loads at rest, the total energy
    is then conserved at any step, up to the residual of Newton's method.  Time-dependent loads are means of both ends of the
    step.  Forces by rates are those of the mean position and velocity, in the wind at the middle of the step.  The residual has a
    systematic sign and accumulates in the energy: iterations continue until a correction is below rounding, or not decreasing.
    Parameters and result as in ``generalized_alpha``; of `numbers` the step is taken only.
    """
    step, saved, with_rates = numbers[0], 0, _has_rates(chain, terms)
    for i in range(steps):
        saved = _note(sizes, chain, record, saved, record.start + i, state)
        _predict(chain, step, state, newton)
        _add_loads(sizes, chain.patterns, tables.factors, i, 0.5, newton.fixed)
        _add_loads(sizes, chain.patterns, tables.factors, i + 1, 0.5, newton.fixed)
        _set_ends(sizes, tables, i + 1, newton.trial)
        _begin_step(lanes, math.inf, newton)
        place = tables.places[i] if tables.places.size else 0.0
        for _ in range(MAX_ITERATIONS):
            conserving_links(sizes, chain, state.x, newton.trial, newton.reach, newton.t, newton.g)
            if with_rates:
                _mean_motion(step, state.x, newton)
            on_particles = _forces_and_tangent(sizes, chain, terms, place, newton.middle, 0.5, 1.0 / step, newton)
            _correct(sizes, chain, on_particles, state.x, newton)
            _set_ends(sizes, tables, i + 1, newton.trial)
            if _count_active(lanes, newton) == 0:
                break
        failed = _any_failed(lanes, newton)
        if failed:
            _keep(state, newton.before)
        _accept(step, state, newton)
        if failed:
            _restore(lanes.failed, newton.before, state)
        if not _all_inside(lanes, state.x) or failed:
            return i + 1
    return steps
