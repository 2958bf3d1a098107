"""Compiled step of the mast: modal coordinates, drag and loads on it, forces of its guys, extremes and outputs.

The rates v of the modal coordinates a go from the middle of one step to that of the next, v <- A1 v + A2 F, with the mass that
makes the frequencies of the mast exact and the damping at the middle of both.  The number of modes is even.
"""

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.mast._kernels_layout import TAPS
from cablepod.wind._kernels_drag import body_drag, sample_at


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _begin_step(k, ahead, beam, state, loads):
    """Fill modal forces of loads at step `k`, rates `ahead` steps after the last, displacements of the levels and their rates.

    With slopes a mast of given length becomes shorter: its levels have the vertical displacement y = a.G u0 + a.G a / 2 from
    rest, with which the pull of the guys is conservative.
    """
    a, v, before, rate, force, gradient = state.a, state.v, state.before, state.rate, state.force, state.gradient
    modes = a.size
    for i in range(modes):
        force[i] = beam.constant[i]
        rate[i] = (1.0 + ahead) * v[i] - ahead * before[i]
    for n in range(loads.factors.shape[0]):
        for i in range(modes):
            force[i] += loads.vectors[n, i] * loads.factors[n, k]
    for n in range(state.lowered.size):
        for d in range(2):
            x, speed = beam.level_rest[n, d], 0.0
            for i in range(modes):
                x += beam.level_rows[n, d, i] * a[i]
                speed += beam.level_rows[n, d, i] * rate[i]
            state.upper[2 * n + d] = x
            state.upper_rate[n, d] = speed
        for i in range(modes):
            gradient[n, i] = beam.geometric_rest[n, i]
        for j in range(0, modes, 2):
            for i in range(modes):
                gradient[n, i] += beam.geometric[n, j, i] * a[j] + beam.geometric[n, j + 1, i] * a[j + 1]
        y = 0.0
        for i in range(modes):
            y += 0.5 * a[i] * (beam.geometric_rest[n, i] + gradient[n, i])
        state.lowered[n] = y


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _sample_weights(place, wind):
    """Fill the weights of the samples of the air at a place in samples; return the number of the third of them.

    Between the equal parts of an interval, at which the weights are given, the air is linear.
    """
    table, weights = wind.table, wind.weights
    left, beyond = sample_at(place, wind.velocity.shape[0])
    parts = table.shape[0]
    fine = beyond * parts
    part = min(int(fine), parts - 1)
    share = fine - part
    for i in range(TAPS):
        weights[i] = (1.0 - share) * table[part, i]
        if part + 1 < parts:
            weights[i] += share * table[part + 1, i]
    if part + 1 == parts:
        weights[3] += share
    return left


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
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


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _fill_mast_drag(rate, wind):
    """Fill the drag on the nodes, c |u| u for the velocity u of the air relative to the mast, and the modal forces by it."""
    columns, rows, x, z, force = wind.columns, wind.rows, wind.x, wind.z, wind.force
    nodes, modes = wind.drag.size, rate.size  # multiples of 4 and of 2
    for n in range(nodes):
        x[n] = wind.air[n]
        z[n] = wind.air[nodes + n]
    for i in range(0, modes, 2):
        for n in range(nodes):
            x[n] -= columns[0, i, n] * rate[i] + columns[0, i + 1, n] * rate[i + 1]
            z[n] -= columns[1, i, n] * rate[i] + columns[1, i + 1, n] * rate[i + 1]
    for n in range(nodes):
        x[n], z[n], _ = body_drag(wind.drag[n], x[n], z[n], 0.0)
    for i in range(modes):
        force[i] = 0.0
    for n in range(0, nodes, 4):
        for i in range(modes):
            force[i] += (
                rows[0, n, i] * x[n] + rows[1, n, i] * z[n] + rows[0, n + 1, i] * x[n + 1] + rows[1, n + 1, i] * z[n + 1]
                + rows[0, n + 2, i] * x[n + 2] + rows[1, n + 2, i] * z[n + 2]
                + rows[0, n + 3, i] * x[n + 3] + rows[1, n + 3, i] * z[n + 3]
            )  # fmt: skip


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _advance_mast(k, step, beam, state, guys):
    """Add stiffness and guys to the modal forces, advance the rates, take the inertia of the guys' ends from their forces.

    A broken guy has no force.  The axial force of the mast follows the pull of the guys.  In the first step, from rest, half of
    the impulse counts, of which the half before is the opposite.
    """
    a, v, before, force, level_force = state.a, state.v, state.before, state.force, state.level_force
    modes, levels = a.size, state.lowered.size
    for n in range(levels):
        level_force[n, 0] = level_force[n, 1] = level_force[n, 2] = 0.0
    for g in range(guys.level.size):
        for d in range(3):
            if k >= guys.breaks[g]:
                guys.force[d, g] = 0.0
            level_force[guys.level[g], d] += guys.force[d, g]
    for j in range(0, modes, 2):
        for i in range(modes):
            force[i] -= beam.stiffness[j, i] * a[j] + beam.stiffness[j + 1, i] * a[j + 1]
    for n in range(levels):
        if k == 0:
            state.pull[n] = level_force[n, 1]
        pull = state.pull[n] - level_force[n, 1]
        for i in range(modes):
            force[i] += (
                beam.level_rows[n, 0, i] * level_force[n, 0]
                + beam.level_rows[n, 1, i] * level_force[n, 2]
                - pull * state.gradient[n, i]
            )
    last = 1.0 if k > 0 else 0.0
    impulse = 1.0 if k > 0 else 0.5
    for i in range(modes):
        before[i] = v[i]
    for j in range(0, modes, 2):
        kept = 1.0 if j > 0 else 0.0
        b, c = last * before[j], last * before[j + 1]
        e, f = impulse * force[j], impulse * force[j + 1]
        for i in range(modes):
            v[i] = (
                kept * v[i]
                + beam.keep[j, i] * b
                + beam.keep[j + 1, i] * c
                + beam.gain[j, i] * e
                + beam.gain[j + 1, i] * f
            )
    if k == 0:
        for i in range(modes):
            before[i] = -v[i]
    for n in range(levels):
        for d in range(2):
            change = 0.0
            for i in range(modes):
                change += beam.level_rows[n, d, i] * (v[i] - before[i])
            state.acceleration[n, d] = change / step
    for g in range(guys.level.size):
        if k < guys.breaks[g]:
            x, z = state.acceleration[guys.level[g], 0], state.acceleration[guys.level[g], 1]
            for d in range(3):
                guys.force[d, g] -= guys.end_mass[2 * d, g] * x + guys.end_mass[2 * d + 1, g] * z


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _fill_tensions(force, tension):
    """Fill the magnitudes of the forces on the mast (lanes,) [N]."""
    for g in range(tension.size):
        x, y, z = force[0, g], force[1, g], force[2, g]
        tension[g] = math.sqrt(x * x + y * y + z * z)


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _record(k, values, extremes):
    """Update extremes, the steps of them, sums and sums of squares of values."""
    least, largest = extremes.least, extremes.largest
    for g in range(values.size):
        x = values[g]
        less, more = x < least[g], x > largest[g]
        least[g] = x if less else least[g]
        extremes.least_step[g] = k if less else extremes.least_step[g]
        largest[g] = x if more else largest[g]
        extremes.largest_step[g] = k if more else extremes.largest_step[g]
        extremes.total[g] += x
        extremes.squares[g] += x * x


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _save(row, state, guys, record):
    """Save the state at an output."""
    for i in range(state.a.size):
        record.modal[row, i] = state.a[i]
        record.rates[row, 0, i] = state.before[i]
        record.rates[row, 1, i] = state.v[i]
    for g in range(record.tension.shape[1]):
        record.tension[row, g] = guys.tension[g]
        for d in range(3):
            record.force[row, g, d] = guys.force[d, g]


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _save_drag(row, wind, drag):
    """Save the drag on the nodes in x and z, where there is room."""
    if row < drag.shape[0]:
        for n in range(wind.x.size):
            drag[row, 0, n] = wind.x[n]
            drag[row, 1, n] = wind.z[n]


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _move(step, state):
    """Advance the coordinates by a step, unless the rates are not finite; tell whether they are."""
    total = 0.0
    for i in range(state.a.size):
        total += abs(state.v[i])
        state.a[i] += step * state.v[i]
    return total < np.inf
