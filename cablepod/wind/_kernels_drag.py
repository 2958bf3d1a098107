"""Compiled laws of the drag; :mod:`cablepod.wind._drag` has them for arrays, ``condensed/_kernels_drag.py`` in components."""

import math

from cablepod._jit import FAST_DIVISION, compiled


@compiled(counted=False, fastmath=FAST_DIVISION, forceinline=True)
def straight_drag(tx, ty, tz, ux, uy, uz):
    """Return |t| |u_n| and u_n, the part normal to the cable of the relative velocity u of the air: a drag c |t| |u_n| u_n.

    The cable is straight along t, whose size is its present length; in the plane tz and uz are 0.
    """
    square = tx * tx + ty * ty + tz * tz
    along = (ux * tx + uy * ty + uz * tz) / square
    ux -= along * tx
    uy -= along * ty
    uz -= along * tz
    return math.sqrt(square * (ux * ux + uy * uy + uz * uz)), ux, uy, uz


@compiled(counted=False, fastmath=FAST_DIVISION, forceinline=True)
def body_drag(b, ux, uy, uz):
    """Return the drag b |u| u of a body in the relative velocity u of the air."""
    size = b * math.sqrt(ux * ux + uy * uy + uz * uz)
    return size * ux, size * uy, size * uz


@compiled(inline="always")
def relative_velocity(before, after, share, v, j):
    """Return the velocity of the air between two samples, less that of node j, of v (dims, N); z is 0 in the plane."""
    uz = 0.0
    if v.shape[0] == 3:
        uz = before[2, j] + share * (after[2, j] - before[2, j]) - v[2, j]
    return (
        before[0, j] + share * (after[0, j] - before[0, j]) - v[0, j],
        before[1, j] + share * (after[1, j] - before[1, j]) - v[1, j],
        uz,
    )  # fmt: skip


@compiled(inline="always")
def sample_at(place, samples):
    """Return the sample before a place among a number of samples, and the share of the next one; the ends are held beyond."""
    place = min(max(place, 0.0), samples - 1.0)
    sample = min(int(place), samples - 2)
    return sample, place - sample
