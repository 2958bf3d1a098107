"""Compiled step of the mast: modal coordinates, drag and loads on it, displacement of the guys' upper ends.

The rates v of the modal coordinates a go from the middle of one step to that of the next, v <- A1 v + A2 F, with the mass that
makes the frequencies of the mast exact and the damping at the middle of both.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.mast._kernels_layout import LARGEST, LARGEST_STEP, LEAST, LEAST_STEP

#: Samples of the air through which it is interpolated in time.
TAPS = 6


@compiled(noalias=True, forceinline=True, fastmath=REORDERED_FUSED)
def _move_ends(a, v, level_rows, level_rest, upper, upper_rate):
    """Fill displacements (levels, 2) [m] and their rates [m/s] of the levels of the guys."""
    for k in range(level_rows.shape[0]):
        for d in range(2):
            x, rate = level_rest[k, d], 0.0
            for i in range(a.size):
                x += level_rows[k, d, i] * a[i]
                rate += level_rows[k, d, i] * v[i]
            upper[k, d] = x
            upper_rate[k, d] = rate


@compiled(noalias=True, forceinline=True, fastmath=REORDERED_FUSED)
def _lower_levels(a, geometric, geometric_rest, gradient, vertical):
    """Fill the vertical displacement of each level from rest, y = a.G u0 + a.G a / 2, as slopes shorten a mast of given length.

    `geometric` is the geometric stiffness G of a unit pull at each level (levels, modes, modes), `geometric_rest` the same times
    the displacement at rest (levels, modes); filled are the derivative of y by a (levels, modes) and y (levels,) [m].  With y the
    pull of the guys is conservative.
    """
    for k in range(vertical.size):
        for i in range(a.size):
            gradient[k, i] = geometric_rest[k, i]
        for j in range(0, a.size, 2):
            for i in range(a.size):
                gradient[k, i] += geometric[k, j, i] * a[j] + geometric[k, j + 1, i] * a[j + 1]
        y = 0.0
        for i in range(a.size):
            y += 0.5 * a[i] * (geometric_rest[k, i] + gradient[k, i])
        vertical[k] = y


@compiled(noalias=True, forceinline=True, fastmath=REORDERED_FUSED)
def _sample_weights(place, count, table, weights):
    """Fill the weights of the samples of the air at a place in samples; return the number of the third of them.

    `table` holds the weights at equal parts of an interval (parts, TAPS), between which the air is linear.
    """
    place = min(max(place, 0.0), count - 1.0)
    left = min(int(place), count - 2)
    parts = table.shape[0]
    fine = (place - left) * parts
    part = min(int(fine), parts - 1)
    share = fine - part
    for i in range(TAPS):
        weights[i] = (1.0 - share) * table[part, i]
    if part + 1 < parts:
        for i in range(TAPS):
            weights[i] += share * table[part + 1, i]
    else:
        weights[3] += share
    return left


@compiled(noalias=True, forceinline=True, fastmath=REORDERED_FUSED)
def _interpolate(samples, left, weights, values):
    """Fill values at an instant from samples (count, values); the first and the last sample are held beyond."""
    last = samples.shape[0] - 1
    a, b, c = max(left - 2, 0), max(left - 1, 0), left
    d, e, f = left + 1, min(left + 2, last), min(left + 3, last)
    for i in range(values.size):
        values[i] = (
            weights[0] * samples[a, i] + weights[1] * samples[b, i] + weights[2] * samples[c, i]
            + weights[3] * samples[d, i] + weights[4] * samples[e, i] + weights[5] * samples[f, i]
        )  # fmt: skip


@compiled(noalias=True, forceinline=True, fastmath=REORDERED_FUSED)
def _add_mast_drag(v, wind, columns, rows, drag, x, z, force):
    """Add the drag on the nodes, c |r| r for the velocity r of the air relative to the mast, to modal forces.

    Parameters
    ----------
    v, wind
        Rates of the modes; velocity of the air at the nodes in x, then in z (2 nodes,) [m/s].
    columns, rows
        Displacement of the nodes by the modes (2, modes, nodes) and (2, nodes, modes).
    drag
        Half the density of the air times drag area (nodes,) [kg/m].
    x, z
        Work arrays (nodes,).
    """
    nodes, modes = drag.size, v.size  # multiples of 4 and of 2
    for n in range(nodes):
        x[n] = wind[n]
        z[n] = wind[nodes + n]
    for i in range(0, modes, 2):
        for n in range(nodes):
            x[n] -= columns[0, i, n] * v[i] + columns[0, i + 1, n] * v[i + 1]
            z[n] -= columns[1, i, n] * v[i] + columns[1, i + 1, n] * v[i + 1]
    for n in range(nodes):
        a, b = x[n], z[n]
        size = drag[n] * math.sqrt(a * a + b * b)
        x[n] = size * a
        z[n] = size * b
    for n in range(0, nodes, 4):
        for i in range(modes):
            force[i] += (
                rows[0, n, i] * x[n] + rows[1, n, i] * z[n] + rows[0, n + 1, i] * x[n + 1] + rows[1, n + 1, i] * z[n + 1]
                + rows[0, n + 2, i] * x[n + 2] + rows[1, n + 2, i] * z[n + 2]
                + rows[0, n + 3, i] * x[n + 3] + rows[1, n + 3, i] * z[n + 3]
            )  # fmt: skip


@compiled(noalias=True, forceinline=True, fastmath=REORDERED_FUSED)
def _add_loads(k, load_vectors, factors, force):
    """Add loads with their factors at step `k` to modal forces."""
    for n in range(factors.shape[0]):
        for i in range(force.size):
            force[i] += load_vectors[n, i] * factors[n, k]


@compiled(fastmath=REORDERED_FUSED, forceinline=True)
def _begin_step(
    k, a, v, before, constant, load_vectors, factors, left, weights, mast_wind, node_columns, node_rows, node_drag, work,
    level_rows, level_rest, pulls, mean_rate, force, upper, upper_rate, level_force,
):  # fmt: skip
    """Fill modal forces of loads and drag at step `k`, displacements and rates of the levels; clear the forces of the guys."""
    for i in range(a.size):
        force[i] = constant[i]
        mean_rate[i] = 1.5 * v[i] - 0.5 * before[i]
    if factors is not None:
        _add_loads(k, load_vectors, factors, force)
    _move_ends(a, mean_rate, level_rows, level_rest, upper, upper_rate)
    _lower_levels(a, pulls[0], pulls[1], pulls[2], pulls[3])
    if mast_wind is not None:
        air, x, z = work
        _interpolate(mast_wind, left, weights, air)
        _add_mast_drag(mean_rate, air, node_columns, node_rows, node_drag, x, z, force)
    for n in range(level_force.shape[0]):
        level_force[n, 0] = level_force[n, 1] = level_force[n, 2] = 0.0


@compiled(forceinline=True)
def _air_work(node_drag):
    """Return work arrays of the air at the nodes; None in still air."""
    if node_drag is None:
        return None
    return np.empty(2 * node_drag.size), np.empty(node_drag.size), np.empty(node_drag.size)


@compiled(noalias=True, forceinline=True, fastmath=REORDERED_FUSED)
def _advance_mast(
    first, step, a, v, before, force, stiffness, gradient, at_rest, keep, gain, level_rows, level_force, acceleration
):  # fmt: skip
    """Add stiffness and guys to the modal forces, advance the rates, fill accelerations of the levels.

    The axial force follows the guys: `stiffness` holds that of rest, `gradient` is that of :func:`_lower_levels`, `at_rest` the
    vertical forces of the guys at rest (levels,), filled in the first step.  `level_force` (levels, 3) is in x, z and upwards.

    `keep` and `gain` are transposed, v[i] <- sum of keep[j, i] v[j] + gain[j, i] F[j]; in the first step, from rest, half of the
    impulse counts, of which the half before is the opposite.  The number of modes is even.
    """
    modes = a.size
    for j in range(0, modes, 2):
        for i in range(modes):
            force[i] -= stiffness[j, i] * a[j] + stiffness[j + 1, i] * a[j + 1]
    for k in range(level_rows.shape[0]):
        if first:
            at_rest[k] = level_force[k, 2]
        pull = at_rest[k] - level_force[k, 2]
        for i in range(modes):
            force[i] += (
                level_rows[k, 0, i] * level_force[k, 0]
                + level_rows[k, 1, i] * level_force[k, 1]
                - pull * gradient[k, i]
            )
    for i in range(modes):
        before[i] = v[i]
    last, impulse = 1.0, 1.0
    if first:
        last, impulse = 0.0, 0.5
    for j in range(0, modes, 2):
        kept = 1.0 if j > 0 else 0.0
        b, c, e, f = last * before[j], last * before[j + 1], impulse * force[j], impulse * force[j + 1]
        for i in range(modes):
            v[i] = kept * v[i] + keep[j, i] * b + keep[j + 1, i] * c + gain[j, i] * e + gain[j + 1, i] * f
    if first:
        for i in range(modes):
            before[i] = -v[i]
    inverse = 1.0 / step
    for k in range(level_rows.shape[0]):
        x, z = 0.0, 0.0
        for i in range(modes):
            change = v[i] - before[i]
            x += level_rows[k, 0, i] * change
            z += level_rows[k, 1, i] * change
        acceleration[k, 0], acceleration[k, 1] = x * inverse, z * inverse


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
def _save(k, every, a, v, before, guy_force, tension, work, saved, saved_rates, saved_force, saved_tension, saved_drag):
    """Save the state at the steps of the output."""
    if k % every:
        return
    row = k // every
    if work is not None:
        _save_drag(row, work, saved_drag)
    for i in range(a.size):
        saved[row, i] = a[i]
        saved_rates[row, 0, i], saved_rates[row, 1, i] = before[i], v[i]
    for g in range(tension.size):
        saved_tension[row, g] = tension[g]
        for d in range(3):
            saved_force[row, g, d] = guy_force[g, d]


@compiled(forceinline=True)
def _save_drag(row, work, saved_drag):
    """Save the drag on the nodes in x and z, where there is room (outputs, 2, nodes) [N]."""
    _, x, z = work
    if row < saved_drag.shape[0]:
        for n in range(x.size):
            saved_drag[row, 0, n], saved_drag[row, 1, n] = x[n], z[n]


@compiled(forceinline=True)
def _is_finite(values):
    """Tell whether the sum of magnitudes is finite."""
    total = 0.0
    for i in range(values.size):
        total += abs(values[i])
    return total < np.inf
