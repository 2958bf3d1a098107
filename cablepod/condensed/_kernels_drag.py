"""Compiled forces of the condensed model that depend on velocities: damping by the tension, drag of the wind."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled

#: Velocity of the air along the chord and two normals, and slopes of both deflections: rows of the work array of the drag.
AIR_ROWS = 5


@compiled(inline="always")
def _add_tension_damping(u, boundary_data, row, chord_tension, kappa, geometric_stiffness, tension_damping, f):
    """Subtract tension_damping times geometric stiffness times rates u from the accelerations f (r,); 0 for a slack cable."""
    if chord_tension > 0.0:
        for i in range(u.size):
            total = chord_tension * kappa[i] * u[i]
            for a in range(geometric_stiffness.shape[0]):
                for j in range(u.size):
                    total += boundary_data[row, 1 + a] * geometric_stiffness[a, i, j] * u[j]
            f[i] -= tension_damping * total


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _interpolate_air(before, after, share, air):
    """Fill the air (n,) between two samples."""
    for k in range(before.size):
        air[k] = before[k] + share * (after[k] - before[k])


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _add_motion(first, last, q, u, slopes, shapes, slope, velocity):
    """Add the slopes of coordinates `first` ... `last` - 1 at the points, and subtract their rates from the velocity of the air.

    Four coordinates at a time: the loop over the points is vectorised, and takes as long for four of them as for one.
    """
    for i in range(first, last, 4):
        b, c, d = min(i + 1, last - 1), min(i + 2, last - 1), min(i + 3, last - 1)
        q0, u0 = q[i], u[i]
        q1, u1 = (q[b], u[b]) if i + 1 < last else (0.0, 0.0)
        q2, u2 = (q[c], u[c]) if i + 2 < last else (0.0, 0.0)
        q3, u3 = (q[d], u[d]) if i + 3 < last else (0.0, 0.0)
        for g in range(slope.size):
            slope[g] += (slopes[i, g] * q0 + slopes[b, g] * q1) + (slopes[c, g] * q2 + slopes[d, g] * q3)
            velocity[g] -= (shapes[i, g] * u0 + shapes[b, g] * u1) + (shapes[c, g] * u2 + shapes[d, g] * u3)


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _add_projection(first, last, tests, force, f):
    """Add the forces at the points times the test functions to the accelerations f `first` ... `last` - 1."""
    for i in range(first, last, 4):
        b, c, d = min(i + 1, last - 1), min(i + 2, last - 1), min(i + 3, last - 1)
        f0, f1, f2, f3 = 0.0, 0.0, 0.0, 0.0
        for g in range(force.size):
            f0 += tests[i, g] * force[g]
            f1 += tests[b, g] * force[g]
            f2 += tests[c, g] * force[g]
            f3 += tests[d, g] * force[g]
        f[i] += f0
        if i + 1 < last:
            f[b] += f1
        if i + 2 < last:
            f[c] += f2
        if i + 3 < last:
            f[d] += f3


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _planar_drag(stretch, exact, drag, along, normal, slope):
    """Replace the relative velocity along the normal by the drag: c |w| w zeta' / |t|^2, w the component of t x u."""
    for g in range(drag.size):
        square, chordwise = stretch * stretch, stretch
        if exact is None:
            square += slope[g] * slope[g]
        else:
            chordwise = math.sqrt(max(square - slope[g] * slope[g], 0.0))
        w = normal[g] * chordwise - along[g] * slope[g]
        normal[g] = drag[g] * abs(w) * w * chordwise / square


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION, forceinline=True)
def _spatial_drag(stretch, exact, drag, along, normal, binormal, slope, slope_out):
    """Replace the relative velocities along the normals by the drag: c |w| w x t / |t|^2, w = t x u."""
    for g in range(drag.size):
        square, chordwise = stretch * stretch, stretch
        slopes_squared = slope[g] * slope[g] + slope_out[g] * slope_out[g]
        if exact is None:
            square += slopes_squared
        else:
            chordwise = math.sqrt(max(square - slopes_squared, 0.0))
        along_w = slope[g] * binormal[g] - slope_out[g] * normal[g]
        normal_w = slope_out[g] * along[g] - chordwise * binormal[g]
        binormal_w = chordwise * normal[g] - slope[g] * along[g]
        factor = drag[g] * math.sqrt(along_w * along_w + normal_w * normal_w + binormal_w * binormal_w) / square
        normal[g] = factor * (binormal_w * chordwise - along_w * slope_out[g])
        binormal[g] = factor * (along_w * slope[g] - normal_w * chordwise)


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
        Quadrature weights [m] times c, half the density of the air times drag coefficient and diameter [kg/m2]; 0 at points that
        fill up a vector.
    shapes : float array (3, r, points)
        Shapes of the coordinates, their slopes, and the test functions.
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
    place = min(max(place, 0.0), wind.shape[0] - 1.0)
    sample = min(int(place), wind.shape[0] - 2)
    n = drag.size
    _interpolate_air(wind[sample], wind[sample + 1], place - sample, work)
    _add_drag(
        q, u, stretch, exact, work[:n], work[n : 2 * n], work[2 * n : 3 * n], work[3 * n : 4 * n], work[4 * n : 5 * n], drag,
        shapes, n_in_plane, None, None, f,
    )  # fmt: skip


@compiled(inline="always")
def _weights_of_drag(hold):
    """Return the weights of three evaluations of the drag, `hold` steps apart, in its mean over the next `hold` steps.

    The mean of the parabola through the evaluations now, before, and before that.  The first of the steps is that of the
    evaluation.
    """
    first, second = 0.5 * (hold - 1.0) / hold, (hold - 1.0) * (2.0 * hold - 1.0) / (6.0 * hold * hold)
    return 0.5 * (second + 3.0 * first + 2.0), -(second + 2.0 * first), 0.5 * (second + first)


@compiled(noalias=True, counted=False, forceinline=True)
def _extrapolate_drag(weights, at_start, now, before, old, held):
    """Fill `held` (r,) with the mean of the drag over the next steps, and shift the evaluations for the next one.

    The drag before the start is that of the start.
    """
    for i in range(now.size):
        if at_start:
            before[i], old[i] = now[i], now[i]
        held[i] = weights[0] * now[i] + weights[1] * before[i] + weights[2] * old[i]
        old[i] = before[i]
        before[i] = now[i]


@compiled
def drag_force(q, u, stretch, exact, wind, place, drag, shapes, n_in_plane, f):
    """Fill f (r,) with the accelerations by the drag in one state, see :func:`_add_drag_at`."""
    f[:] = 0.0
    _add_drag_at(q, u, stretch, exact, wind, place, drag, shapes, n_in_plane, np.empty(AIR_ROWS * drag.size), f)
