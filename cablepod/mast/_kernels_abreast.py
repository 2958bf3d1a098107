"""Compiled run of masts with condensed guys, several abreast in the same air: one loop for all of them.

The terms and steps are those of :mod:`cablepod.mast._kernels_condensed`, which runs one mast.  Arrays have rows of one number for
each mast, which are loaded as vectors.  Every mast is computed as if it were alone, so that its result does not depend on the
others; all of a step is done for one guy after the other, whose vectors stay in registers and the fastest cache.
"""

from __future__ import annotations

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.mast._kernels_condensed import DIVERGED, DONE, UNSTABLE
from cablepod.mast._kernels_guy import _advance_guy, _end_tension, _guy_drag, _guy_forces
from cablepod.mast._kernels_mast import TAPS as TAPS
from cablepod.mast._kernels_mast import _interpolate, _sample_weights
from cablepod.mast._kernels_vectors import all_lanes, all_less, load, root, size_of, store, where_less


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _add_loads(k, load_vectors, factors, force):
    """Add loads with their factors at step `k` to modal forces (modes, masts)."""
    modes = force.shape[0]
    count = load_vectors.shape[0] // modes
    for n in range(count):
        factor = load(factors, k * count + n)
        for i in range(modes):
            store(force, i, load(force, i) + load(load_vectors, n * modes + i) * factor)


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _move(a, rate, level_rows, level_rest, upper, upper_rate):
    """Fill displacements (2 levels, masts) [m] and their rates [m/s] of the levels of the guys."""
    modes = a.shape[0]
    for n in range(upper.shape[0]):
        x, y = load(level_rest, n), all_lanes(0.0)
        for i in range(modes):
            row = load(level_rows, n * modes + i)
            x = x + row * load(a, i)
            y = y + row * load(rate, i)
        store(upper, n, x)
        store(upper_rate, n, y)


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _add_node_drag(rate, wind, rows, drag, force):
    """Add the drag on the nodes, c |r| r for the velocity r of the air relative to the mast, to modal forces (modes, masts).

    Parameters
    ----------
    rate, wind
        Rates of the modes (modes, masts); velocity of the air at the nodes in x, then in z (2 nodes,) [m/s].
    rows
        Displacement of the nodes by the modes (nodes 2 modes, masts).
    drag
        Half the density of the air times drag area (nodes, masts) [kg/m].
    """
    nodes, modes = drag.shape[0], rate.shape[0]
    for n in range(0, nodes, 2):
        at = 2 * n * modes
        x, z = all_lanes(wind[n]), all_lanes(wind[nodes + n])
        x1, z1 = all_lanes(wind[n + 1]), all_lanes(wind[nodes + n + 1])
        for i in range(modes):
            u = load(rate, i)
            x = x - load(rows, at + i) * u
            z = z - load(rows, at + modes + i) * u
            x1 = x1 - load(rows, at + 2 * modes + i) * u
            z1 = z1 - load(rows, at + 3 * modes + i) * u
        size, size1 = load(drag, n) * root(x * x + z * z), load(drag, n + 1) * root(x1 * x1 + z1 * z1)
        x, z = size * x, size * z
        x1, z1 = size1 * x1, size1 * z1
        for i in range(modes):
            store(
                force, i, load(force, i) + load(rows, at + i) * x + load(rows, at + modes + i) * z
                + load(rows, at + 2 * modes + i) * x1 + load(rows, at + 3 * modes + i) * z1
            )  # fmt: skip


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _advance(first, step, a, v, before, force, stiffness, keep, gain, level_rows, level_force, change, acceleration):
    """Add stiffness and guys to the modal forces, advance the rates, fill accelerations of the levels (2 levels, masts).

    v[i] <- sum of keep[i, j] v[j] + gain[i, j] F[j]; in the first step, from rest, half of the impulse counts, of which the half
    before is the opposite.
    """
    modes, places = a.shape[0], level_force.shape[0]
    for i in range(0, modes, 2):
        x, y = load(force, i), load(force, i + 1)
        for j in range(modes):
            b = load(a, j)
            x = x - load(stiffness, i * modes + j) * b
            y = y - load(stiffness, (i + 1) * modes + j) * b
        for n in range(places):
            b = load(level_force, n)
            x = x + load(level_rows, n * modes + i) * b
            y = y + load(level_rows, n * modes + i + 1) * b
        store(force, i, x)
        store(force, i + 1, y)
    last, impulse = 1.0, 1.0
    if first:
        last, impulse = 0.0, 0.5
    for i in range(0, modes, 2):
        x, y, x1, y1 = all_lanes(0.0), all_lanes(0.0), all_lanes(0.0), all_lanes(0.0)
        for j in range(modes):
            b, c = load(v, j), load(force, j)
            x = x + load(keep, i * modes + j) * b
            x1 = x1 + load(gain, i * modes + j) * c
            y = y + load(keep, (i + 1) * modes + j) * b
            y1 = y1 + load(gain, (i + 1) * modes + j) * c
        store(change, i, last * x + impulse * x1)
        store(change, i + 1, last * y + impulse * y1)
    total = all_lanes(0.0)
    for i in range(modes):
        new, old = load(change, i), load(v, i)
        total = total + size_of(new)
        if first:
            old = -1.0 * new
        store(before, i, old)
        store(v, i, new)
        store(a, i, load(a, i) + step * new)
        store(change, i, new - old)
    inverse = 1.0 / step
    for n in range(places):
        x = all_lanes(0.0)
        for i in range(modes):
            x = x + load(level_rows, n * modes + i) * load(change, i)
        store(acceleration, n, inverse * x)
    return all_less(total, all_lanes(np.inf))


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _record(k, place, value, extremes):
    """Update extremes, the steps of them, sum and sum of squares (6 places, masts)."""
    step, at = all_lanes(1.0 * k), 6 * place
    least, largest = load(extremes, at), load(extremes, at + 1)
    store(extremes, at + 2, where_less(value, least, step, load(extremes, at + 2)))
    store(extremes, at + 3, where_less(largest, value, step, load(extremes, at + 3)))
    store(extremes, at, where_less(value, least, value, least))
    store(extremes, at + 1, where_less(largest, value, value, largest))
    store(extremes, at + 4, load(extremes, at + 4) + value)
    store(extremes, at + 5, load(extremes, at + 5) + value * value)


@compiled(counted=False, forceinline=True)
def _save(row, values, saved):
    """Save values (count, masts) of an output in an array (masts, outputs, count)."""
    for m in range(saved.shape[0]):
        for i in range(saved.shape[2]):
            saved[m, row, i] = values[i, m]


@compiled(counted=False, forceinline=True)
def _stop(k, row, guy, values, limit, reason, status, stopped):
    """Note masts of which the magnitude of a row has left its limit, or the finite numbers."""
    for m in range(status.size):
        size = abs(values[row, m])
        if status[m] == DONE and not size < limit:
            status[m] = reason if size < np.inf else DIVERGED
            stopped[m, 0], stopped[m, 1] = k, guy


@compiled(counted=False, forceinline=True)
def _all_stopped(status):
    """Tell whether all masts have stopped."""
    running = 0
    for m in range(status.size):
        running += status[m] == DONE
    return running == 0


@compiled(counted=False, fastmath=FAST_DIVISION)
def masts_run(
    step, every, steps, hold, window, r, p, rates, before_rates, guy_gain, guy_keep, numbers, shared, guy_level, a, v, before,
    constant, stiffness, keep, gain, level_rows, level_rest, load_vectors, factors, samples_per_step, table, mast_wind,
    node_rows, node_drag, guy_wind, sigma, guy_weights, air, guy_air, weights, work, saved, saved_force, saved_tension,
    level_extremes, tension_extremes, monitor, status, stopped,
):  # fmt: skip
    """Run masts with condensed guys from rest, all with the same steps and in the same air.

    Parameters
    ----------
    step, every, steps, hold, window
        Step [s], steps from one output to the next, number of steps, number of those over which drag is held, first and last
        step of extremes and sums (2,).
    r
        Number of modes of each deflection, even.
    p, rates, before_rates
        Coordinates of the guys, in and out of their planes, their rates and those a step before (guys 2 r, masts); changed.
    guy_gain, guy_keep
        Factors of forces in a step (guys 2 r, masts), factor of rates.
    numbers, shared
        Numbers of the guys (guys GUY_ROWS, masts) and of the shapes (rows, 2 r), see :mod:`cablepod.mast._kernels_guy`.
    guy_level
        Level of each guy of a mast (guys,).
    a, v, before
        Modal coordinates of the masts, their rates and those a step before (modes, masts); changed.
    constant, stiffness, keep, gain
        Constant modal forces (modes, masts), stiffness and the matrices A1 and A2 of the step (modes modes, masts).
    level_rows, level_rest
        Displacement of the levels in x and z by the modes (2 levels modes, masts), at rest (2 levels, masts) [m].
    load_vectors, factors
        Loads on the modes (loads modes, masts) and their factors (steps + 1 times loads, masts), or None.
    samples_per_step, table, mast_wind, node_rows, node_drag, guy_wind, sigma, guy_weights
        Wind: samples in a step and weights between them, at the nodes of the mast (samples, 2 nodes), displacement of the nodes
        by the modes (nodes 2 modes, masts), their drag (nodes, masts) [kg/m], wind along the guys of a mast
        (samples, 3 points guys) [m/s], places and weights of its points; arrays of the wind are None without it.
    air, guy_air, weights, work
        Work arrays: air at the nodes and along the guys, weights of samples, and rows of vectors.
    saved, saved_force, saved_tension
        Filled at the outputs (masts, outputs, ...): modal coordinates, forces on the mast (3 guys), tensions of the guys [N].
    level_extremes, tension_extremes
        Filled: least and largest value, their steps, sum and sum of squares (6 levels 2, masts) and (6 guys, masts).
    monitor
        Least H of the guys [N] and its step (2 guys, masts).
    status, stopped
        Filled: status of each mast (masts,), step and guy at which it was found (masts, 2).
    """
    (
        force, mean_rate, change, held, upper, upper_rate, level_force, acceleration, q, on_q, own, drag, held_q, held_end,
        on_end, tension, squared, stretch,
    ) = work  # fmt: skip
    modes, places, guys = a.shape[0], level_rest.shape[0], guy_level.size
    largest = 4.0 / (step * step)
    ahead = 0.5 * hold  # from the last rates to the middle of the steps over which drag is held
    for k in range(steps + 1):
        fresh, output, counts = k % hold == 0, k % every == 0, window[0] <= k <= window[1]
        if fresh:
            for i in range(modes):
                store(mean_rate, i, (1.0 + ahead) * load(v, i) - ahead * load(before, i))
                store(held, i, all_lanes(0.0))
        _move(a, mean_rate, level_rows, level_rest, upper, upper_rate)
        if mast_wind is not None and fresh:
            left = _sample_weights((k + ahead - 0.5) * samples_per_step, mast_wind.shape[0], table, weights)
            _interpolate(mast_wind, left, weights, air)
            _interpolate(guy_wind, left, weights, guy_air)
            _add_node_drag(mean_rate, air, node_rows, node_drag, held)
        for i in range(modes):
            store(force, i, load(constant, i) + load(held, i))
        if factors is not None:
            _add_loads(k, load_vectors, factors, force)
        for n in range(places):
            store(level_force, n, all_lanes(0.0))
        stable = True
        for g in range(guys):
            n = 2 * guy_level[g]
            _guy_forces(
                k, g, n, r, p, numbers, shared, upper, level_rest, q, on_q, on_end, squared, stretch, monitor
            )  # fmt: skip
            stable = stable and all_less(load(squared, g), all_lanes(largest))
            if guy_wind is not None and fresh:
                _guy_drag(
                    g, n, r, ahead, rates, before_rates, numbers, shared, sigma, guy_weights, guy_air, stretch, upper_rate, q,
                    own, drag, held_q, held_end,
                )  # fmt: skip
            _advance_guy(
                k == 0, step, g, n, r, p, rates, before_rates, guy_gain, guy_keep, numbers, shared, on_q, held_q, on_end,
                held_end, level_force,
            )  # fmt: skip
        if output:
            _save(k // every, a, saved)
        finite = _advance(
            k == 0, step, a, v, before, force, stiffness, keep, gain, level_rows, level_force, change, acceleration
        )
        for g in range(guys):
            store(tension, g, _end_tension(g, 2 * guy_level[g], numbers, acceleration, on_end))
        if counts:
            for n in range(places):
                _record(k, n, load(upper, n), level_extremes)
            for g in range(guys):
                _record(k, g, load(tension, g), tension_extremes)
        if output:
            _save(k // every, tension, saved_tension)
            _save(k // every, on_end, saved_force)
        if not (stable and finite):
            for g in range(guys):
                _stop(k, g, g, squared, largest, UNSTABLE, status, stopped)
            for i in range(modes):
                _stop(k, i, 0, v, np.inf, DIVERGED, status, stopped)
            if _all_stopped(status):
                return
