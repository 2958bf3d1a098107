"""Compiled drag of the wind on the particles of a chain, with relative velocity."""

from __future__ import annotations

import math

from cablepod._jit import compiled


@compiled
def drag_forces(x, v, wind, place, drag, first, last, force, damping):
    """Compute the drag on particles: drag l |u_n| u_n, u_n the part normal to the cable of wind less velocity.

    The neighbours of a particle give direction and present length l of the cable at it (half of their distance).

    Parameters
    ----------
    x, v : float arrays (dims, n + 1)
        Positions [m] and velocities [m/s].
    wind : float array (samples, dims, n + 1)
        Velocity of the air at the particles [m/s], linear between the samples.
    place, drag : float
        Place between the samples; half the density of the air times drag coefficient and diameter [kg/m2].
    first, last : int
        The free particles, first ... last - 1.
    force, damping : float arrays (dims, n + 1), (n + 1,)
        Filled: drag [N], and its size over that of u_n [kg/s]; 0 at held particles.
    """
    dims, particles = x.shape
    place = min(max(place, 0.0), wind.shape[0] - 1.0)
    sample = min(int(place), wind.shape[0] - 2)
    share = place - sample
    force[:] = 0.0
    damping[:] = 0.0
    for p in range(first, last):
        below, above = max(p - 1, 0), min(p + 1, particles - 1)
        square, along, speed_squared = 0.0, 0.0, 0.0
        for c in range(dims):
            t = x[c, above] - x[c, below]
            u = wind[sample, c, p] + share * (wind[sample + 1, c, p] - wind[sample, c, p]) - v[c, p]
            square += t * t
            along += u * t
            force[c, p] = u
        along /= square
        for c in range(dims):
            force[c, p] -= along * (x[c, above] - x[c, below])
            speed_squared += force[c, p] * force[c, p]
        damping[p] = 0.5 * drag * math.sqrt(square * speed_squared)
        for c in range(dims):
            force[c, p] *= damping[p]
