"""Compiled forces of the condensed model that depend on velocities: damping by the tension, drag of the wind."""

from __future__ import annotations

import math

from cablepod._jit import FAST_DIVISION, compiled


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


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _add_drag(q, u, stretch, exact, wind, place, drag, shapes, slopes, tests, n_in_plane, sigma, moments, f):
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
    wind : float array (samples, 1 + normals, points)
        Velocity of the air less that of the line between the ends, along the chord and its normals [m/s]; linear between samples.
    place : float
        Place between the samples.
    drag : float array (points,)
        Quadrature weights [m] times c, half the density of the air times drag coefficient and diameter [kg/m2].
    shapes, slopes, tests : float arrays (points, r)
        Shapes of the coordinates, their slopes, and the test functions.
    n_in_plane : int
        Number of in-plane coordinates.
    sigma, moments : float arrays (points,), (2,), or None
        Relative arc lengths of the points; filled: moments of the drag about the lower end, over the length, by normal [N].
    """
    if moments is not None:
        moments[0], moments[1] = 0.0, 0.0
    place = min(max(place, 0.0), wind.shape[0] - 1.0)
    sample = min(int(place), wind.shape[0] - 2)
    share = place - sample
    for g in range(drag.size):
        slope, rate = 0.0, 0.0
        for i in range(n_in_plane):
            slope += slopes[g, i] * q[i]
            rate += shapes[g, i] * u[i]
        along = wind[sample, 0, g] + share * (wind[sample + 1, 0, g] - wind[sample, 0, g])
        normal = wind[sample, 1, g] + share * (wind[sample + 1, 1, g] - wind[sample, 1, g]) - rate
        slope_out, binormal = 0.0, 0.0
        if q.size > n_in_plane:
            rate = 0.0
            for i in range(n_in_plane, q.size):
                slope_out += slopes[g, i] * q[i]
                rate += shapes[g, i] * u[i]
            binormal = wind[sample, 2, g] + share * (wind[sample + 1, 2, g] - wind[sample, 2, g]) - rate
        square, chordwise = stretch * stretch, stretch
        if exact is None:
            square += slope * slope + slope_out * slope_out
        else:
            chordwise = math.sqrt(max(square - slope * slope - slope_out * slope_out, 0.0))
        product = (along * chordwise + normal * slope + binormal * slope_out) / square
        along -= product * chordwise
        normal -= product * slope
        binormal -= product * slope_out
        factor = drag[g] * math.sqrt(square * (along * along + normal * normal + binormal * binormal))
        if moments is not None:
            moments[0] += sigma[g] * factor * normal
            moments[1] += sigma[g] * factor * binormal
        for i in range(n_in_plane):
            f[i] += tests[g, i] * factor * normal
        for i in range(n_in_plane, q.size):
            f[i] += tests[g, i] * factor * binormal


@compiled(inline="always")
def _extrapolate_drag(hold, held):
    """Extrapolate the drag (r,) to its mean over the next `hold` steps, of which the first is that of the evaluation.

    The parabola through the last three evaluations, `hold` steps apart: those in the rows 1 (now), 2 and 3 of `held` (4, r).
    Row 0 is filled, and the rows are shifted for the next evaluation.
    """
    first, second = 0.5 * (hold - 1.0) / hold, (hold - 1.0) * (2.0 * hold - 1.0) / (6.0 * hold * hold)
    for i in range(held.shape[1]):
        now, before, old = held[1, i], held[2, i], held[3, i]
        held[0, i] = (
            0.5 * (second + 3.0 * first + 2.0) * now - (second + 2.0 * first) * before + 0.5 * (second + first) * old
        )
        held[3, i], held[2, i] = before, now


@compiled
def drag_force(q, u, stretch, exact, wind, place, drag, shapes, slopes, tests, n_in_plane, f):
    """Fill f (r,) with the accelerations by the drag in one state, see :func:`_add_drag`."""
    f[:] = 0.0
    _add_drag(q, u, stretch, exact, wind, place, drag, shapes, slopes, tests, n_in_plane, None, None, f)
