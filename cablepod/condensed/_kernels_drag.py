"""Compiled drag of the wind on the condensed model, with relative velocity.

It is the law of :func:`cablepod.wind._kernels_drag.straight_drag` in components of t x u.
"""

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.condensed._kernels_layout import AIR_ROWS
from cablepod.wind._kernels_drag import body_drag, sample_at


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _add_motion(first, last, q, u, slopes, shapes, slope, velocity):
    """Add slopes of coordinates `first` ... `last` - 1 at the points, subtract their rates from the velocity of the air."""
    for i in range(first, last):
        for g in range(slope.size):
            slope[g] += slopes[i, g] * q[i]
            velocity[g] -= shapes[i, g] * u[i]


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _add_projection(first, last, shapes, force, f):
    """Add the forces at the points times the shapes to the accelerations f `first` ... `last` - 1."""
    for i in range(first, last):
        total = 0.0
        for g in range(force.size):
            total += shapes[i, g] * force[g]
        f[i] += total


@compiled(counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _across(chordwise, slope, along, normal):
    """Return a component of t x u, of the tangent t and the velocity u of the air relative to the cable."""
    return chordwise * normal - slope * along


@compiled(counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _spatial_law(drag, chordwise, square, along, normal, binormal, slope, slope_out):
    """Return the drag along the chord and both normals at a point: c |w| w x t / |t|^2, w = t x u; `square` is |t|^2."""
    along_w = _across(slope, slope_out, normal, binormal)
    normal_w = _across(slope_out, chordwise, binormal, along)
    binormal_w = _across(chordwise, slope, along, normal)
    factor = drag * math.sqrt(along_w * along_w + normal_w * normal_w + binormal_w * binormal_w) / square
    return (
        factor * (normal_w * slope_out - binormal_w * slope),
        factor * (binormal_w * chordwise - along_w * slope_out),
        factor * (along_w * slope - normal_w * chordwise),
    )


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _planar_drag(stretch, exact, drag, along, normal, slope):
    """Replace the relative velocity along the normal by the drag c |w| w zeta' / |t|^2, with w = t x u at a point."""
    for g in range(drag.size):
        square, chordwise = stretch * stretch, stretch
        if exact is None:
            square += slope[g] * slope[g]
        else:
            chordwise = math.sqrt(max(square - slope[g] * slope[g], 0.0))
        w = _across(chordwise, slope[g], along[g], normal[g])
        normal[g] = drag[g] * abs(w) * w * chordwise / square


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _spatial_drag(stretch, exact, drag, along, normal, binormal, slope, slope_out):
    """Replace the relative velocities along the normals by the drag."""
    for g in range(drag.size):
        square, chordwise = stretch * stretch, stretch
        slopes_squared = slope[g] * slope[g] + slope_out[g] * slope_out[g]
        if exact is None:
            square += slopes_squared
        else:
            chordwise = math.sqrt(max(square - slopes_squared, 0.0))
        _, normal[g], binormal[g] = _spatial_law(
            drag[g], chordwise, square, along[g], normal[g], binormal[g], slope[g], slope_out[g]
        )


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _add_drag(
    q, u, stretch, exact, along, normal, binormal, slope, slope_out, drag, shapes, n_in_plane, sigma, moments, f
):
    """Add the drag to the accelerations f (r,): c |t| |u_n| u_n at points along the cable.

    At a point, t = (zeta', w') in the chord frame, and u_n is the part normal to t of wind less velocity.

    Parameters
    ----------
    q, u : float arrays (r,)
        Coordinates and their rates.
    stretch : float
        Mean chordwise stretch zeta'; with `exact` that of the cable, from which zeta' at each point follows.
    exact : True or None
        Whether the model has the exact chordwise stretch.
    along, normal, binormal : float arrays (points,)
        Velocity of the air less that of the line between the ends, along the chord and its normals [m/s]; overwritten by the
        drag.  Without out-of-plane coordinates `binormal` has no use.
    slope, slope_out : float arrays (points,)
        Overwritten by the slopes of the deflections.
    drag : float array (points,)
        Quadrature weights [m] times c, half the density of the air times drag coefficient and diameter [kg/m2].
    shapes : float array (3, r, points)
        Shapes of the coordinates, their slopes, and the shapes that the drag acts on.
    n_in_plane : int
        Number of in-plane coordinates.
    sigma, moments : float arrays (points,), (2,), or None
        Relative arc lengths of the points; filled: moments of the drag about the lower end, over the length, by normal [N].
    """
    slope[:] = 0.0
    _add_motion(0, n_in_plane, q, u, shapes[1], shapes[0], slope, normal)
    if q.size > n_in_plane:
        slope_out[:] = 0.0
        _add_motion(n_in_plane, q.size, q, u, shapes[1], shapes[0], slope_out, binormal)
        _spatial_drag(stretch, exact, drag, along, normal, binormal, slope, slope_out)
        _add_projection(n_in_plane, q.size, shapes[2], binormal, f)
    else:
        _planar_drag(stretch, exact, drag, along, normal, slope)
    _add_projection(0, n_in_plane, shapes[2], normal, f)
    if moments is not None:
        moments[0], moments[1] = 0.0, 0.0
        for g in range(drag.size):
            moments[0] += sigma[g] * normal[g]
            if q.size > n_in_plane:
                moments[1] += sigma[g] * binormal[g]


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _add_drag_at(q, u, stretch, exact, wind, place, drag, shapes, n_in_plane, work, f):
    """Add the drag of the wind at a place between its samples to the accelerations f (r,), see :func:`_add_drag`.

    `wind` (samples, (1 + normals) points) is the velocity of the air at the points along the chord, then along each normal,
    linear between samples; `work` (AIR_ROWS points,) is overwritten.
    """
    sample, share = sample_at(place, wind.shape[0])
    n = drag.size
    before, after = wind[sample], wind[sample + 1]
    for k in range(before.size):
        work[k] = before[k] + share * (after[k] - before[k])
    _add_drag(
        q, u, stretch, exact, work[:n], work[n : 2 * n], work[2 * n : 3 * n], work[3 * n : 4 * n], work[4 * n : 5 * n], drag,
        shapes, n_in_plane, None, None, f,
    )  # fmt: skip


@compiled(noalias=True, counted=False, forceinline=True)
def _extrapolate_drag(hold, at_start, now, before, old, held):
    """Fill `held` (r,) with the mean of the drag over the next `hold` steps, and shift the evaluations for the next one.

    The mean is that of the parabola through the evaluations `now`, `before` and before that, `hold` steps apart; the first of the
    steps is that of the evaluation.  The drag before the start is that of the start.
    """
    first, second = 0.5 * (hold - 1.0) / hold, (hold - 1.0) * (2.0 * hold - 1.0) / (6.0 * hold * hold)
    weights = 0.5 * (second + 3.0 * first + 2.0), -(second + 2.0 * first), 0.5 * (second + first)
    for i in range(now.size):
        if at_start:
            before[i], old[i] = now[i], now[i]
        held[i] = weights[0] * now[i] + weights[1] * before[i] + weights[2] * old[i]
        old[i] = before[i]
        before[i] = now[i]


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _add_body_drag(bodies, u, wind, place, points, shapes, n_in_plane, f):
    """Add the drag of bodies across the chord to the accelerations f (r,): b |u| u, u the velocity of the air relative to them.

    Along the chord they move with the line between the ends.

    Parameters
    ----------
    bodies
        See :class:`cablepod.condensed._kernels_layout.Bodies`; None without any.
    points
        Number of points of the air.
    u, wind, place, shapes, n_in_plane
        As in :func:`_add_drag_at`, with the shapes alone (r, points).
    """
    if bodies is None:
        return
    sample, share = sample_at(place, wind.shape[0])
    before, after, r = wind[sample], wind[sample + 1], u.size
    for b in range(bodies.points.size):
        g = bodies.points[b]
        along = before[g] + share * (after[g] - before[g])
        k = points + g
        normal, binormal = before[k] + share * (after[k] - before[k]), 0.0
        for i in range(n_in_plane):
            normal -= shapes[i, g] * u[i]
        if before.size > 2 * points:
            k = 2 * points + g
            binormal = before[k] + share * (after[k] - before[k])
            for i in range(n_in_plane, r):
                binormal -= shapes[i, g] * u[i]
        _, on_normal, on_binormal = body_drag(bodies.drag[b], along, normal, binormal)
        for i in range(n_in_plane):
            f[i] += on_normal * shapes[i, g]
        for i in range(n_in_plane, r):
            f[i] += on_binormal * shapes[i, g]


@compiled
def drag_force(q, u, stretch, exact, wind, drag, shapes, n_in_plane, bodies, f):
    """Fill f (r,) with the accelerations by the drag at the start, see :func:`_add_drag_at` and :func:`_add_body_drag`."""
    f[:] = 0.0
    _add_drag_at(q, u, stretch, exact, wind, 0.0, drag, shapes, n_in_plane, np.empty(AIR_ROWS * drag.size), f)
    _add_body_drag(bodies, u, wind, 0.0, drag.size, shapes[0], n_in_plane, f)
