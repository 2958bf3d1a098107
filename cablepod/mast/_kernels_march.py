"""Compiled run of a mast: one loop for all kinds of guys, whose terms fill the forces on the mast."""

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.mast._kernels_catenary import _static_forces
from cablepod.mast._kernels_chain import _advance_chains
from cablepod.mast._kernels_condensed import (
    _add_drag,
    _advance_guys,
    _damp,
    _fill_drag,
    _fill_own_rates,
    _guy_forces,
    _place_guys,
    _watch,
)
from cablepod.mast._kernels_layout import DIVERGED, DONE
from cablepod.mast._kernels_mast import (
    _advance_mast,
    _begin_step,
    _fill_mast_drag,
    _fill_tensions,
    _interpolate,
    _move,
    _record,
    _sample_weights,
    _save,
    _save_drag,
)


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION)
def march(pace, beam, state, loads, wind, guys, condensed, chains, static, guy_wind, record):
    """Run a mast from rest; return status, step and guy at which it was found.

    Parameters
    ----------
    pace, beam, state, loads, wind, guys, record
        See :mod:`cablepod.mast._kernels_layout`; `wind` is None in still air.
    condensed, chains, static
        Guys of one kind, the others None: CondensedTerms with their scheme and state; ChainTerms; StaticTerms.
    guy_wind
        Wind of the kind of guys; None in still air.
    """
    status, guy, left, ahead = DONE, 0, 0, 0.5 * pace.hold  # from the last rates to the middle of the steps of the drag
    for k in range(pace.steps + 1):
        fresh = k % pace.hold == 0
        _begin_step(k, ahead, beam, state, loads)
        if wind is not None:
            if fresh:
                left = _sample_weights((k + ahead - 0.5) * wind.samples_per_step, wind)
                _interpolate(wind.velocity, left, wind.weights, wind.air)
                _fill_mast_drag(state.rate, wind)
            for i in range(state.force.size):
                state.force[i] += wind.force[i]
        if condensed is not None:
            of_guys, scheme, moving = condensed
            _place_guys(of_guys, guys, state, beam, moving)
            _guy_forces(of_guys, moving, guys.force)
            if guy_wind is not None:
                if fresh:
                    _interpolate(guy_wind.velocity, left, wind.weights, guy_wind.air)
                    _fill_own_rates(ahead, of_guys, moving)
                    _fill_drag(of_guys, moving, guy_wind)
                _add_drag(moving, guy_wind, guys.force)
            status, guy = _watch(k, pace.step, of_guys, moving, guys)
            if status != DONE:
                return status, k, guy
            _damp(scheme.damping, of_guys, moving)
            _advance_guys(k, pace, of_guys, scheme, moving, guys)
        if chains is not None:
            status, guy = _advance_chains(k, pace, chains, guys, state, guy_wind)
            if status != DONE:
                return status, k, guy
        if static is not None:
            _static_forces(k, static, guys, state, guy_wind)
        _advance_mast(k, pace.step, beam, state, guys)
        if static is None:  # static guys have tensions of their own, without drag and inertia
            _fill_tensions(guys.force, guys.tension)
        if pace.first <= k <= pace.last:
            _record(k, state.upper, record.of_levels)
            _record(k, guys.tension, record.of_tensions)
        if k % pace.every == 0:
            _save(k // pace.every, state, guys, record)
            if wind is not None:
                _save_drag(k // pace.every, wind, record.drag)
        if not _move(pace.step, state):
            return DIVERGED, k, 0
    return DONE, pace.steps, 0
