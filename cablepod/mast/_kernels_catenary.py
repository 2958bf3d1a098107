"""Compiled term of static guys: their forces as a table of the distance of their ends."""

import math

from cablepod._jit import FAST_DIVISION, compiled
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
