"""Compiled drag of the wind on the particles of a chain, with relative velocity."""

from __future__ import annotations

import math

from cablepod._jit import compiled
from cablepod.chain._kernels_layout import (
    BASE_X,
    BASE_Y,
    BASE_Z,
    DRAG_X,
    DRAG_Y,
    DRAG_Z,
    OLD_DRAG_X,
    OLD_DRAG_Y,
    OLD_DRAG_Z,
    PER_MASS,
    TX,
    TY,
    TZ,
    UX,
    UY,
    UZ,
    VX,
    VY,
    VZ,
    X,
    Y,
    Z,
)

#: Weights of Adams and Bashforth for the last three evaluations of the drag.
NOW, BEFORE, OLD = 23.0 / 12.0, -16.0 / 12.0, 5.0 / 12.0


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


# --- explicit steps -----------------------------------------------------------------------------------------------------


@compiled(inline="always")
def _tangents(s, links, back, spatial):
    """Compute the vectors from the neighbour below to that above each particle, half a step before."""
    for j in range(links - 1):
        s[TX, j + 1] = s[X, j + 2] - s[X, j] - back * (s[VX, j + 2] - s[VX, j])
        s[TY, j + 1] = s[Y, j + 2] - s[Y, j] - back * (s[VY, j + 2] - s[VY, j])
        if spatial is not None:
            s[TZ, j + 1] = s[Z, j + 2] - s[Z, j] - back * (s[VZ, j + 2] - s[VZ, j])
    for end, below in ((0, 0), (links, links - 1)):
        s[TX, end] = s[X, below + 1] - s[X, below] - back * (s[VX, below + 1] - s[VX, below])
        s[TY, end] = s[Y, below + 1] - s[Y, below] - back * (s[VY, below + 1] - s[VY, below])
        if spatial is not None:
            s[TZ, end] = s[Z, below + 1] - s[Z, below] - back * (s[VZ, below + 1] - s[VZ, below])


@compiled(inline="always")
def _extrapolate_drag(s, links, drag, target, spatial):
    """Fill three rows from `target` on with the velocity increments by loads and drag until the next evaluation.

    The drag c |t| |u_n| u_n / 2 per mass follows from the relative velocity U of the air, and is kept with that before.
    """
    for j in range(links + 1):
        tx, ty, ux, uy = s[TX, j], s[TY, j], s[UX, j], s[UY, j]
        square, along = tx * tx + ty * ty, ux * tx + uy * ty
        if spatial is not None:
            tz, uz = s[TZ, j], s[UZ, j]
            square += tz * tz
            along += uz * tz
        along /= square
        ux -= along * tx
        uy -= along * ty
        speed_squared = ux * ux + uy * uy
        if spatial is not None:
            uz -= along * tz
            speed_squared += uz * uz
        factor = 0.5 * drag * s[PER_MASS, j] * math.sqrt(square * speed_squared)
        now, before = factor * ux, s[DRAG_X, j]
        s[target, j] = s[BASE_X, j] + NOW * now + BEFORE * before + OLD * s[OLD_DRAG_X, j]
        s[OLD_DRAG_X, j], s[DRAG_X, j] = before, now
        now, before = factor * uy, s[DRAG_Y, j]
        s[target + 1, j] = s[BASE_Y, j] + NOW * now + BEFORE * before + OLD * s[OLD_DRAG_Y, j]
        s[OLD_DRAG_Y, j], s[DRAG_Y, j] = before, now
        if spatial is not None:
            now, before = factor * uz, s[DRAG_Z, j]
            s[target + 2, j] = s[BASE_Z, j] + NOW * now + BEFORE * before + OLD * s[OLD_DRAG_Z, j]
            s[OLD_DRAG_Z, j], s[DRAG_Z, j] = before, now


@compiled(inline="always")
def _relative_velocity(s, u, v, links, before, after, share):
    """Fill a row of relative velocities of the air from two samples of the wind (n + 1,) and the row of velocities."""
    for j in range(links + 1):
        s[u, j] = before[j] + share * (after[j] - before[j]) - s[v, j]


@compiled(inline="always")
def _apply_drag(s, links, wind, place, drag, step, target, is_first, spatial):
    """Compute the drag half a step before from the wind (samples, dims, n + 1) [m/s] at a place between its samples.

    The increments of three evaluations are extrapolated to their mean over the steps until the next one.
    """
    place = min(max(place, 0.0), wind.shape[0] - 1.0)
    sample = min(int(place), wind.shape[0] - 2)
    share = place - sample
    _relative_velocity(s, UX, VX, links, wind[sample, 0], wind[sample + 1, 0], share)
    _relative_velocity(s, UY, VY, links, wind[sample, 1], wind[sample + 1, 1], share)
    if spatial is not None:
        _relative_velocity(s, UZ, VZ, links, wind[sample, 2], wind[sample + 1, 2], share)
    _tangents(s, links, 0.5 * step, spatial)
    for _ in range(
        3 if is_first else 1
    ):  # the drag before the start is that of the start: all three evaluations are this one
        _extrapolate_drag(s, links, drag, target, spatial)
