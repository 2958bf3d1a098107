"""Compiled run of a mast on static guys: the horizontal force of each as a table of the distance of its ends."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.mast._kernels_mast import (
    TAPS,
    _advance_mast,
    _air_work,
    _begin_step,
    _is_finite,
    _record,
    _sample_weights,
    _save,
)

DONE, DIVERGED = range(2)


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _spline(table, place):
    """Return the value of a cubic spline (intervals, 4), highest power first, at a place in intervals; linear outside."""
    left = min(max(int(place), 0), table.shape[0] - 1)
    t = place - left
    if t < 0.0:
        return table[left, 3] + t * table[left, 2]
    if t > 1.0:
        row = table[left]
        return row[0] + row[1] + row[2] + row[3] + (t - 1.0) * (3.0 * row[0] + 2.0 * row[1] + row[2])
    return ((table[left, 0] * t + table[left, 1]) * t + table[left, 2]) * t + table[left, 3]


@compiled(fastmath=FAST_DIVISION)
def catenary_run(
    step, every, steps, window, a, v, constant, mast_stiffness, pulls, keep, gain, level_rows, level_rest, guy_level, anchors,
    first, spacing, horizontal, vertical, end_mass, load_vectors, factors, samples_per_step, table, mast_wind, node_columns,
    node_rows, node_drag, reaction_per_step, reaction,
    saved, saved_rates, saved_force, saved_tension, saved_drag, level_extremes, level_sums, tension_extremes, tension_sums,
    monitor,
):  # fmt: skip
    """Run a mast on static guys from rest; return the status, the step and the guy at which it was found.

    Parameters
    ----------
    anchors, first, spacing
        Anchors in x and z (guys, 2) [m]; least horizontal distance of the table and interval of the tables (guys,) [m].
    horizontal, vertical
        Splines of the horizontal force over the distance [N/m], and of the vertical force on the mast [N] (guys, intervals, 4).
    end_mass
        Mass of the guys that moves with the mast (guys,) [kg].
    reaction_per_step, reaction
        Samples in a step; part of the drag on the guys that the mast carries, in x and z (samples, guys, 2) [N]; None without
        wind.
    monitor
        Least and largest place in the tables, in intervals (guys, 2).
    step, every, steps, window, a, v, constant, mast_stiffness, pulls, keep, gain, level_rows, level_rest, guy_level, \
load_vectors, factors, samples_per_step, table, mast_wind, node_columns, node_rows, node_drag, saved, saved_rates, saved_force, \
saved_tension, saved_drag, level_extremes, level_sums, tension_extremes, tension_sums
        As in :func:`cablepod.mast._kernels_condensed.condensed_run`.
    """
    count, levels = anchors.shape[0], level_rest.shape[0]
    force, before, mean_rate = np.empty(a.size), v.copy(), np.empty(a.size)
    upper, upper_rate, level_force = np.empty((levels, 2)), np.empty((levels, 2)), np.empty((levels, 3))
    acceleration, guy_force, tension = np.empty((levels, 2)), np.empty((count, 3)), np.empty(count)
    work, weights, left = _air_work(node_drag), np.empty(TAPS), 0
    for k in range(steps + 1):
        if mast_wind is not None:
            left = _sample_weights(k * samples_per_step, mast_wind.shape[0], table, weights)
        _begin_step(
            k, a, v, before, constant, load_vectors, factors, left, weights, mast_wind, node_columns, node_rows, node_drag, work,
            level_rows, level_rest, pulls, mean_rate, force, upper, upper_rate, level_force,
        )  # fmt: skip
        for g in range(count):
            m = guy_level[g]
            x, z = anchors[g, 0] - upper[m, 0], anchors[g, 1] - upper[m, 1]
            place = (math.sqrt(x * x + z * z) - first[g]) / spacing[g]
            monitor[g, 0], monitor[g, 1] = min(monitor[g, 0], place), max(monitor[g, 1], place)
            pull = _spline(horizontal[g], place)
            guy_force[g, 0], guy_force[g, 1], guy_force[g, 2] = pull * x, _spline(vertical[g], place), pull * z
            square = 0.0
            for d in range(3):
                square += guy_force[g, d] * guy_force[g, d]
            tension[g] = math.sqrt(square)
            if reaction is not None:
                at = min(max(k * reaction_per_step, 0.0), reaction.shape[0] - 1.0)
                sample = min(int(at), reaction.shape[0] - 2)
                for d in range(2):
                    low, high = reaction[sample, g, d], reaction[sample + 1, g, d]
                    guy_force[g, 2 * d] += low + (at - sample) * (high - low)
            level_force[m, 0] += guy_force[g, 0]
            level_force[m, 1] += guy_force[g, 2]
            level_force[m, 2] += guy_force[g, 1]
        _advance_mast(
            k == 0,
            step,
            a,
            v,
            before,
            force,
            mast_stiffness,
            pulls[2],
            pulls[4],
            keep,
            gain,
            level_rows,
            level_force,
            acceleration,
        )
        for g in range(count):
            guy_force[g, 0] -= end_mass[g] * acceleration[guy_level[g], 0]
            guy_force[g, 2] -= end_mass[g] * acceleration[guy_level[g], 1]
        _record(k, window, upper, tension, level_extremes, level_sums, tension_extremes, tension_sums)
        _save(
            k, every, a, v, before, guy_force, tension, work, saved, saved_rates, saved_force, saved_tension, saved_drag
        )  # fmt: skip
        if not _is_finite(v):
            return DIVERGED, k, 0
        for i in range(a.size):
            a[i] += step * v[i]
    return DONE, steps, 0
