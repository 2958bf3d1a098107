"""Compiled run of a mast: one loop for all kinds of guys, whose terms fill the forces on the mast."""

import math

from cablepod._jit import FAST_DIVISION, compiled
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
from cablepod.wind._kernels_drag import sample_at


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _spline(table, g, place):
    """Return the value of the cubic spline of a guy (guys, intervals, 4) at a place in intervals; linear outside."""
    left = min(max(int(place), 0), table.shape[1] - 1)
    t = place - left
    a, b, c, d = table[g, left, 0], table[g, left, 1], table[g, left, 2], table[g, left, 3]
    if t < 0.0:
        return d + t * c
    if t > 1.0:
        return a + b + c + d + (t - 1.0) * (3.0 * a + 2.0 * b + c)
    return ((a * t + b) * t + c) * t + d


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _static_forces(k, static, guys, mast, wind):
    """Fill tensions, and the forces on the mast with its part of the drag at step `k`."""
    for g in range(guys.level.size):
        n = guys.level[g]
        x, z = static.anchors[g, 0] - mast.upper[2 * n], static.anchors[g, 1] - mast.upper[2 * n + 1]
        place = (math.sqrt(x * x + z * z) - static.first[g]) / static.spacing[g]
        static.places[0, g] = min(static.places[0, g], place)
        static.places[1, g] = max(static.places[1, g], place)
        pull, vertical = _spline(static.horizontal, g, place), _spline(static.vertical, g, place)
        guys.force[0, g] = pull * x
        guys.force[1, g] = vertical
        guys.force[2, g] = pull * z
        guys.tension[g] = math.sqrt(pull * pull * (x * x + z * z) + vertical * vertical)
        if wind is not None:
            sample, share = sample_at(k * wind.samples_per_step, wind.reaction.shape[0])
            for d in range(2):
                low, high = wind.reaction[sample, g, d], wind.reaction[sample + 1, g, d]
                guys.force[2 * d, g] += low + share * (high - low)


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
