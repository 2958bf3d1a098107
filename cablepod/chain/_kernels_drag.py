"""Compiled drag of the wind on the particles of a chain, with relative velocity."""

from __future__ import annotations

import math

from cablepod._jit import compiled
from cablepod.chain._kernels_layout import (
    BASE_X,
    DRAG_X,
    LINE,
    PER_MASS,
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


@compiled(noalias=True, counted=False, literal=False, forceinline=True)
def _fill_drag(
    count, back, share, half_drag, per_mass,
    x_below, x_above, vx_below, vx_above, vx, x_before, x_after, drag_x,
    y_below, y_above, vy_below, vy_above, vy, y_before, y_after, drag_y,
    z_below, z_above, vz_below, vz_above, vz, z_before, z_after, drag_z,
):  # fmt: skip
    """Fill the velocity increments in a step by the drag on `count` particles: c |t| |u_n| u_n / 2 per mass times the step.

    t is the vector between the neighbours at the time of the velocities, half a step before, and u_n the part normal to t of the
    air's velocity less the particle's.

    Parameters
    ----------
    count : int
        Number of particles.
    back, share, half_drag : float
        Half a step [s]; place between the two samples of the wind; half of c [kg/m2].
    per_mass : float array (count,)
        Step over mass [s/kg].
    x_below, ..., drag_z : float arrays (count,)
        For each coordinate: positions of both neighbours, their velocities, the particles' velocities, two samples of the air's
        velocity; filled, the increments [m/s].  None for z in the plane.
    """
    for j in range(count):
        tx = x_above[j] - x_below[j] - back * (vx_above[j] - vx_below[j])
        ty = y_above[j] - y_below[j] - back * (vy_above[j] - vy_below[j])
        ux = x_before[j] + share * (x_after[j] - x_before[j]) - vx[j]
        uy = y_before[j] + share * (y_after[j] - y_before[j]) - vy[j]
        square, along = tx * tx + ty * ty, ux * tx + uy * ty
        if z_below is not None:
            tz = z_above[j] - z_below[j] - back * (vz_above[j] - vz_below[j])
            uz = z_before[j] + share * (z_after[j] - z_before[j]) - vz[j]
            square += tz * tz
            along += uz * tz
        along /= square
        ux -= along * tx
        uy -= along * ty
        speed_squared = ux * ux + uy * uy
        if z_below is not None:
            uz -= along * tz
            speed_squared += uz * uz
        factor = half_drag * per_mass[j] * math.sqrt(square * speed_squared)
        drag_x[j] = factor * ux
        drag_y[j] = factor * uy
        if z_below is not None:
            drag_z[j] = factor * uz


@compiled(counted=False, literal=False, forceinline=True)
def _drag_on(s, row, first, below, above, count, back, share, half_drag, before, after, spatial):
    """Fill the rows from `row` on with the drag on `count` particles from `first` on, neighbours from `below`, `above` on."""
    _fill_drag(
        count, back, share, half_drag, s[PER_MASS, first:],
        s[X, below:], s[X, above:], s[VX, below:], s[VX, above:], s[VX, first:], before[0, first:], after[0, first:],
        s[row, first:],
        s[Y, below:], s[Y, above:], s[VY, below:], s[VY, above:], s[VY, first:], before[1, first:], after[1, first:],
        s[row + 1, first:],
        None if spatial is None else s[Z, below:],
        None if spatial is None else s[Z, above:],
        None if spatial is None else s[VZ, below:],
        None if spatial is None else s[VZ, above:],
        None if spatial is None else s[VZ, first:],
        None if spatial is None else before[2, first:],
        None if spatial is None else after[2, first:],
        None if spatial is None else s[row + 2, first:],
    )  # fmt: skip


@compiled(noalias=True, counted=False, forceinline=True)
def _extrapolate_drag(count, now, before, old, base, increments):
    """Fill the velocity increments by loads and drag until the next evaluation: base + 23/12 now - 16/12 before + 5/12 old."""
    for j in range(count):
        increments[j] = base[j] + NOW * now[j] + BEFORE * before[j] + OLD * old[j]


@compiled(counted=False)
def _apply_drag(s, links, wind, place, drag, step, target, evaluation, spatial):
    """Compute the drag half a step before from the wind (samples, dims, n + 1) [m/s] at a place between its samples.

    The increments of this evaluation and the two before are extrapolated to their mean over the steps until the next one, in the
    rows from `target` on.  Evaluations are numbered from 0; each replaces that three before, and those before the start are that
    of the start.  Loops take whole vectors of LINE particles, as scalar roots and divisions of a remainder would take as long as
    the rest: the last vector computes some particles of the one before again.
    """
    place = min(max(place, 0.0), wind.shape[0] - 1.0)
    sample = min(int(place), wind.shape[0] - 2)
    share, back, half_drag = place - sample, 0.5 * step, 0.5 * drag
    before, after = wind[sample], wind[sample + 1]
    now = DRAG_X + 3 * (evaluation % 3)
    earlier, oldest = DRAG_X + 3 * (max(evaluation - 1, 0) % 3), DRAG_X + 3 * (max(evaluation - 2, 0) % 3)
    between, last = links - 1, links - LINE  # particles between the ends, and the first of the last vector of them
    whole = between // LINE * LINE  # a multiple of LINE, as the compiler sees
    _drag_on(s, now, 1, 0, 2, whole, back, share, half_drag, before, after, spatial)
    if whole == 0:
        _drag_on(s, now, 1, 0, 2, between, back, share, half_drag, before, after, spatial)
    elif whole < between:
        _drag_on(s, now, last, last - 1, last + 1, LINE, back, share, half_drag, before, after, spatial)
    for end, below in ((0, 0), (links, links - 1)):
        if s[PER_MASS, end] != 0.0:  # a free end, with the direction of its link
            _drag_on(s, now, end, below, below + 1, 1, back, share, half_drag, before, after, spatial)
    columns = (links + LINE) // LINE * LINE
    for c in range(2 if spatial is None else 3):
        _extrapolate_drag(columns, s[now + c], s[earlier + c], s[oldest + c], s[BASE_X + c], s[target + c])
