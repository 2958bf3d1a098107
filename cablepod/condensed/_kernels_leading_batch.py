"""Compiled explicit steps of leading order for many members."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_frame import frames
from cablepod.condensed._kernels_leading import leading_force, leading_rest, leading_verlet


@compiled
def leading_starts(
    ends, rates, second, load, reference, step, damping, mass, stiffness, length, squares, means, bends, pushes, norms,
    plane, bow, q, v, limit,
):  # fmt: skip
    """Find where many scenes start from: at rest but for the motion of their ends; velocities half a step before.

    Parameters
    ----------
    ends, rates, second
        Ends at the start, their rates, their second rates with those times damping (members, 2 dims, 1); the latter two
        without columns where no end moves.
    load, reference, mass, stiffness, length
        As in :func:`frames` and :func:`leading_verlet`, of each scene: (members, dims, 1), then (members,).
    step, damping
        [s], (members,) [1/s].
    squares, means, bends, pushes, norms, plane
        As in :func:`leading_verlet`, (members, ...) but for `plane`.
    bow
        Coordinates that a load of one across the chord would about give (members, r).
    q, v
        Filled (members, r).
    limit
        Filled: the largest stable step at the start [s]; nan where there is no equilibrium near.
    """
    members, r = q.shape
    patterns, dims = means.shape[1], load.shape[1]
    f, tangent, row = np.empty(r), np.empty((r, r)), np.empty((1, 1 + patterns * dims))
    still, nothing, points = np.zeros(second.shape[1:]), np.zeros((dims, 1)), np.empty((0, dims, 1))
    for m in range(members):
        about = stiffness[m], length[m], squares[m], None, means[m], bends[m], pushes[m]
        frames(ends[m], still, load[m], points, reference[m], mass[m], row)
        for i in range(r):
            q[m, i] = row[0, 1 + patterns * (1 if i < plane else 2)] * bow[m, i]
        if not leading_rest(q[m], row, *about):
            limit[m] = np.nan
            continue
        v[m] = 0.0
        if rates.shape[2]:
            # the particles are at rest, the frame is not: its rates show in the coordinates as its second rates do
            frames(ends[m], rates[m], nothing, points, reference[m], mass[m], row)
            for a in range(pushes.shape[1]):
                for i in range(r):
                    v[m, i] += row[0, 1 + patterns + a] * pushes[m, a, i]
        frames(ends[m], second[m], load[m], points, reference[m], mass[m], row)
        h = leading_force(q[m], row, 0, *about, f, tangent)
        sag, stray = 0.0, 0.0
        for i in range(r):
            sag += (squares[m, i] * q[m, i]) ** 2
        for a in range(patterns):
            stray += abs(row[0, 1 + a]) * norms[m, a]
        limit[m] = 2.0 / math.sqrt(abs(h) * squares[m].max() + stray + stiffness[m] / length[m] * sag)
        grow = math.expm1(0.5 * damping[m] * step)
        back = grow / damping[m] if damping[m] else 0.5 * step
        for i in range(r):
            v[m, i] = v[m, i] * (1.0 + grow) - back * f[i]


@compiled
def leading_members(
    q, v, step, decay, kick, ends, second, load, reference, mass, stiffness, length, squares, means, bends, pushes, norms,
    knots, slopes, plane, taus, begin, steps, marks, first, last, saved, low, high, watch, series, bound, good,
):  # fmt: skip
    """Run one block of steps of many scenes by :func:`leading_verlet`, each of its own numbers (members, ...).

    Parameters
    ----------
    ends, second, load, reference, mass
        As in :func:`frames`; there may be more than `steps` columns.
    steps
        Number of steps.
    first, last
        Which of `marks`, and rows of `saved` (members, marks, r) and `series` (members, marks, links), are in the block.
    bound, good
        Of the coordinates, where they are sound (members,); whether a scene goes on (members,), changed.

    Other parameters are those of :func:`leading_verlet`; of these `step`, `plane`, `begin` and `marks` are the same for all.
    """
    rows = np.empty((steps, 1 + means.shape[1] * load.shape[1]))
    points, halves = np.empty((0, load.shape[1], 1)), np.empty((last - first, 2, q.shape[1]))
    for m in range(good.size):
        if not good[m]:
            continue
        frames(ends[m], second[m], load[m], points, reference[m], mass[m], rows)
        leading_verlet(
            q[m], v[m], step, decay[m], kick[m], rows, stiffness[m], length[m], squares[m], None, means[m], bends[m],
            pushes[m], norms[m], knots[m], slopes[m], plane, taus[m], begin, marks[first:last], saved[m, first:last], halves,
            low[m], high[m], watch[m], series[m, first:last],
        )  # fmt: skip
        for i in range(q.shape[1]):
            good[m] = good[m] and abs(q[m, i]) < bound[m]
