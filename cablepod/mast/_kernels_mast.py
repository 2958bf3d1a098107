"""Compiled step of the mast: modal coordinates, drag and loads on it, displacement of the guys' upper ends.

The rates v of the modal coordinates a go from the middle of one step to that of the next, v <- A1 v + A2 F, with the mass that
makes the frequencies of the mast exact and the damping at the middle of both.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.mast._kernels_layout import LARGEST, LARGEST_STEP, LEAST, LEAST_STEP


@compiled(fastmath=REORDERED_FUSED, forceinline=True)
def _move_ends(a, v, level_rows, level_rest, upper, upper_rate):
    """Fill displacements (levels, 2) [m] and their rates [m/s] of the levels of the guys."""
    for k in range(level_rows.shape[0]):
        for d in range(2):
            x, rate = level_rest[k, d], 0.0
            for i in range(a.size):
                x += level_rows[k, d, i] * a[i]
                rate += level_rows[k, d, i] * v[i]
            upper[k, d], upper_rate[k, d] = x, rate


@compiled(fastmath=REORDERED_FUSED, forceinline=True)
def _add_mast_drag(v, wind, place, node_rows, node_drag, force):
    """Add the drag on the nodes, c |r| r for the velocity r of the air relative to the mast, to modal forces.

    `wind` is (samples, nodes, 2) [m/s], linear between samples; `node_drag` half the density of the air times drag area [kg/m].
    """
    place = min(max(place, 0.0), wind.shape[0] - 1.0)
    sample = min(int(place), wind.shape[0] - 2)
    share = place - sample
    for n in range(node_drag.size):
        if node_drag[n] == 0.0:
            continue
        x = wind[sample, n, 0] + share * (wind[sample + 1, n, 0] - wind[sample, n, 0])
        z = wind[sample, n, 1] + share * (wind[sample + 1, n, 1] - wind[sample, n, 1])
        for i in range(v.size):
            x -= node_rows[n, 0, i] * v[i]
            z -= node_rows[n, 1, i] * v[i]
        size = node_drag[n] * math.sqrt(x * x + z * z)
        x *= size
        z *= size
        for i in range(v.size):
            force[i] += node_rows[n, 0, i] * x + node_rows[n, 1, i] * z


@compiled(fastmath=REORDERED_FUSED, forceinline=True)
def _advance_mast(first, a, v, before, force, stiffness, keep, gain, level_rows, level_force, step, acceleration):
    """Add stiffness and guys to the modal forces, advance the rates, fill accelerations of the levels; not the coordinates."""
    for i in range(a.size):
        total = force[i]
        for j in range(a.size):
            total -= stiffness[i, j] * a[j]
        for k in range(level_rows.shape[0]):
            total += level_rows[k, 0, i] * level_force[k, 0] + level_rows[k, 1, i] * level_force[k, 1]
        force[i] = total
    for i in range(a.size):
        before[i] = v[i]
    for i in range(a.size):
        rate = 0.0
        if first:  # at rest: half of the first impulse, of which the half before is the opposite
            for j in range(a.size):
                rate += 0.5 * gain[i, j] * force[j]
        else:
            for j in range(a.size):
                rate += keep[i, j] * before[j] + gain[i, j] * force[j]
        v[i] = rate
    if first:
        for i in range(a.size):
            before[i] = -v[i]
    inverse = 1.0 / step
    for k in range(level_rows.shape[0]):
        for d in range(2):
            total = 0.0
            for i in range(a.size):
                total += level_rows[k, d, i] * (v[i] - before[i])
            acceleration[k, d] = total * inverse


@compiled(forceinline=True)
def _update_extremes(value, step, row):
    """Update least and largest value and their steps in a row (4,)."""
    if value < row[LEAST]:
        row[LEAST], row[LEAST_STEP] = value, step
    if value > row[LARGEST]:
        row[LARGEST], row[LARGEST_STEP] = value, step


@compiled(forceinline=True)
def _record(k, window, upper, tension, level_extremes, level_sums, tension_extremes, tension_sums):
    """Update extremes, sums and sums of squares over the steps of a window."""
    if k < window[0] or k > window[1]:
        return
    for n in range(upper.shape[0]):
        for d in range(2):
            _update_extremes(upper[n, d], k, level_extremes[n, d])
            level_sums[n, d, 0] += upper[n, d]
            level_sums[n, d, 1] += upper[n, d] * upper[n, d]
    for g in range(tension.size):
        _update_extremes(tension[g], k, tension_extremes[g])
        tension_sums[g, 0] += tension[g]
        tension_sums[g, 1] += tension[g] * tension[g]


@compiled(forceinline=True)
def _save(k, every, a, v, before, guy_force, tension, saved, saved_rates, saved_force, saved_tension):
    """Save the state at the steps of the output."""
    if k % every:
        return
    row = k // every
    for i in range(a.size):
        saved[row, i] = a[i]
        saved_rates[row, 0, i], saved_rates[row, 1, i] = before[i], v[i]
    for g in range(tension.size):
        saved_tension[row, g] = tension[g]
        for d in range(3):
            saved_force[row, g, d] = guy_force[g, d]


@compiled(forceinline=True)
def _is_finite(values):
    """Tell whether the sum of magnitudes is finite."""
    total = 0.0
    for i in range(values.size):
        total += abs(values[i])
    return total < np.inf
