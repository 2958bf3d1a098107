"""Compiled plane of chord c and total load p of cables: against = -p/|p|, rise b = c . against, span a = |c - b against|."""

from __future__ import annotations

import math

from cablepod._jit import FUSED, compiled


@compiled
def _norm(vector):
    """Return the length by hypot: right to the last digit or two, and the same bits for planar and spatial scenes."""
    total = 0.0
    for k in range(vector.size):
        total = math.hypot(total, vector[k])
    return total


@compiled(fastmath=FUSED)
def _dot(a, b):
    """Return the inner product, rounded as BLAS does."""
    total = 0.0
    for k in range(a.size):
        total += a[k] * b[k]
    return total


@compiled
def load_planes(chords, loads, planes, across, against):
    """Resolve the chord of each cable across and against its total load.

    Parameters
    ----------
    chords, loads : float arrays (cables, dims)
        Upper end from the lower one [m]; total load per unstretched length [N/m].
    planes : float array (4, cables)
        Filled with span (>= 0), rise, chord [m] and load [N/m].
    across, against : float arrays (cables, dims)
        Filled with unit vectors: across the load, zero where the chord lies along it; against it, up without load.
    """
    for i in range(len(chords)):
        q = _norm(loads[i])
        for k in range(chords.shape[1]):
            against[i, k] = -loads[i, k] / q if q > 0.0 else 1.0 * (k == 1)
            across[i, k] = chords[i, k]
        b = _dot(chords[i], against[i])
        for repeat in range(2):  # the first difference may have cancelled
            along = _dot(across[i], against[i]) if repeat else b
            for k in range(chords.shape[1]):
                across[i, k] -= along * against[i, k]
        a, c = _norm(across[i]), _norm(chords[i])
        along_load = a <= 1e-15 * c
        for k in range(chords.shape[1]):
            across[i, k] = 0.0 if along_load else across[i, k] / a
        if along_load:
            a, b = 0.0, math.copysign(c, b)
        planes[0, i], planes[1, i], planes[2, i], planes[3, i] = a, b, c, q
