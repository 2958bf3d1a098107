"""Compiled terms of condensed guys, which lie abreast in lanes: deflections, forces, drag, steps.

A guy has the coordinates p = q + m n.u, with the deflections q in and out of its vertical plane and the displacement u of its
upper end.  The mass matrix of p and of the modal coordinates of the mast is constant and block diagonal, so that no step has an
iteration.  The energy of a guy, its chord c = |upper - lower| and its load g along it give the forces, closure and drag being
those of the condensed model,

    H = K (c/L - 1) + K/(2 L) (1 - 2 e) sum of kappa q^2,    F_i = -((1 - 2 e) H + e N0) kappa_i q_i - g (B q)_i + h P_i,

and the force H e + (q.B q h/2 + P.q g) n/c + half of the weight on its upper end at fixed q.

Guys are the last dimension of their arrays, padded to whole groups of lanes.  Loops over them write to arrays of which they read
no other row, so that they become a few instructions; modes are padded to multiples of four, which are taken together.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.condensed._kernels_drag import _spatial_law
from cablepod.condensed._kernels_layout import Sizes
from cablepod.condensed._kernels_terms import _chord_tensions

#: Rows of the numbers of the guys: K [N], L [m], weight [N/m], 1 - 2 e, e N0 [N], largest fitted kappa [1/(kg m)], scale of the
#: shapes [kg^-1/2] and of their slopes [kg^-1/2 1/m].
STIFFNESS, LENGTH, WEIGHT, SOFTENING, STIFFENING, LARGEST_KAPPA, SCALE, SLOPE_SCALE = range(8)
#: Rows of the ends of the guys: displacement in x, y, z from rest [m], position in x and z [m], rates in x and z [m/s].
X, Y, Z, AT_X, AT_Z, RATE_X, RATE_Z = range(7)


@compiled(forceinline=True)
def _sizes_of(q):
    """Return the numbers of lanes and of coordinates of the closure; its loads along the chord have no mean."""
    none = np.empty(0)
    return Sizes(q[0, 0], np.empty(2 * q.shape[1]), none, none)


@compiled(noalias=True, forceinline=True, fastmath=FAST_DIVISION)
def _deflections(p, p_out, moments, moments_out, rest_axes, ends, moved, moved_out, q, q_out):
    """Fill the deflections q = p - m n.u in and out of the plane (r, lanes) [kg^1/2 m]."""
    lanes = moved.size
    for g in range(lanes):
        moved[g] = rest_axes[3, g] * ends[X, g] + rest_axes[4, g] * ends[Y, g] + rest_axes[5, g] * ends[Z, g]
        moved_out[g] = rest_axes[6, g] * ends[X, g] + rest_axes[7, g] * ends[Y, g] + rest_axes[8, g] * ends[Z, g]
    for i in range(q.shape[0]):
        for g in range(lanes):
            q[i, g] = p[i, g] - moments[i, g] * moved[g]
            q_out[i, g] = p_out[i, g] - moments_out[i, g] * moved_out[g]


@compiled(noalias=True, forceinline=True, fastmath=FAST_DIVISION)
def _own_rates(
    ahead, rates, rates_out, before, before_out, moments, moments_out, rest_axes, ends, along, normal, binormal, own, own_out
):  # fmt: skip
    """Fill velocities of the ends along the axes (lanes,), rates of the deflections (r, lanes) `ahead` steps after the last."""
    lanes = along.size
    for g in range(lanes):
        along[g] = rest_axes[0, g] * ends[RATE_X, g] + rest_axes[2, g] * ends[RATE_Z, g]
        normal[g] = rest_axes[3, g] * ends[RATE_X, g] + rest_axes[5, g] * ends[RATE_Z, g]
        binormal[g] = rest_axes[6, g] * ends[RATE_X, g] + rest_axes[8, g] * ends[RATE_Z, g]
    for i in range(own.shape[0]):
        for g in range(lanes):
            own[i, g] = (1.0 + ahead) * rates[i, g] - ahead * before[i, g] - moments[i, g] * normal[g]
            own_out[i, g] = (1.0 + ahead) * rates_out[i, g] - ahead * before_out[i, g] - moments_out[i, g] * binormal[g]


@compiled(noalias=True, forceinline=True, fastmath=FAST_DIVISION)
def _advance_guys(
    at_rest, step, keep, gain, gain_out, moments, moments_out, on_q, on_out, shared, shared_out, rates, rates_out, before,
    before_out, p, p_out,
):  # fmt: skip
    """Advance rates and coordinates by a step, the first by half an impulse; fill sums of moments times forces (lanes,)."""
    lanes, last, impulse = shared.size, keep, 1.0
    if at_rest:
        last, impulse = 0.0, 0.5
    for i in range(p.shape[0]):
        kept = 1.0 if i > 0 else 0.0
        for g in range(lanes):
            shared[g] = kept * shared[g] + moments[i, g] * on_q[i, g]
            shared_out[g] = kept * shared_out[g] + moments_out[i, g] * on_out[i, g]
        for g in range(lanes):
            new = last * rates[i, g] + impulse * gain[i, g] * on_q[i, g]
            before[i, g] = -new if at_rest else rates[i, g]
            rates[i, g] = new
            p[i, g] += step * new
        for g in range(lanes):
            new = last * rates_out[i, g] + impulse * gain_out[i, g] * on_out[i, g]
            before_out[i, g] = -new if at_rest else rates_out[i, g]
            rates_out[i, g] = new
            p_out[i, g] += step * new


@compiled(noalias=True, forceinline=True, fastmath=FAST_DIVISION)
def _hand_over(rest_axes, shared, shared_out, end_x, end_y, end_z):
    """Take the forces on the moments of the deflections from those on the ends (lanes,) [N]."""
    for g in range(shared.size):
        end_x[g] -= shared[g] * rest_axes[3, g] + shared_out[g] * rest_axes[6, g]
        end_y[g] -= shared[g] * rest_axes[4, g] + shared_out[g] * rest_axes[7, g]
        end_z[g] -= shared[g] * rest_axes[5, g] + shared_out[g] * rest_axes[8, g]


@compiled(noalias=True, forceinline=True, fastmath=FAST_DIVISION)
def _axes(ends, lower, heights, lengths, axes, chord, stretch):
    """Fill the axes along the chords and normal to them, chord lengths [m] and their ratio to the unstretched ones (lanes,)."""
    ax, ay, az, flat, nx, nz = axes
    for g in range(chord.size):
        x, y, z = lower[0, g] - ends[AT_X, g], lower[1, g] - heights[g] - ends[Y, g], lower[2, g] - ends[AT_Z, g]
        size = math.sqrt(x * x + y * y + z * z)
        inverse = 1.0 / size
        chord[g] = size
        stretch[g] = size / lengths[g]
        x *= inverse
        y *= inverse
        z *= inverse
        square = x * x + z * z
        beside = square > 1e-24
        level = math.sqrt(square) if beside else 1.0  # the vertical component of the normal; 0 along the mast
        turn = -y / level
        ax[g] = x
        ay[g] = y
        az[g] = z
        flat[g] = level if beside else 0.0
        nx[g] = turn * x if beside else 1.0
        nz[g] = turn * z if beside else 0.0


@compiled(noalias=True, forceinline=True, fastmath=FAST_DIVISION)
def _guy_forces(
    numbers, sizes, terms, kappa, kappa_out, loads, tilt, both, q, q_out, axes, chord, work, tension, sag, on_q, on_out, end_x,
    end_y, end_z,
):  # fmt: skip
    """Fill the forces on the coordinates (r, lanes) and on the ends (lanes,) [N], H [N] and the stiffness of the sag [1/s2].

    `sizes` and `terms` are those of the closure, see :mod:`cablepod.condensed._kernels_layout`, for the coordinates `both` in and
    out of the plane (2 r lanes,); `tilt` is that of shapes of unit mass (2, r, r); `loads` are those of the shapes in the plane.
    """
    ax, ay, az, flat, nx, nz = axes
    straight, along, normal, tilted, tilted_out, quadratic, linear = work
    r, lanes = q.shape
    _chord_tensions(sizes, terms, chord, 0, both, tension)
    for g in range(lanes):
        a, b = kappa[0, g] * q[0, g], kappa[1, g] * q[1, g]
        c, d = kappa_out[0, g] * q_out[0, g], kappa_out[1, g] * q_out[1, g]
        sag[g] = a * a + b * b + c * c + d * d
    for i in range(2, r, 2):
        for g in range(lanes):
            a, b = kappa[i, g] * q[i, g], kappa[i + 1, g] * q[i + 1, g]
            c, d = kappa_out[i, g] * q_out[i, g], kappa_out[i + 1, g] * q_out[i + 1, g]
            sag[g] += a * a + b * b + c * c + d * d
    for g in range(lanes):
        force = tension[g]
        sag[g] *= numbers[STIFFNESS, g] / numbers[LENGTH, g]
        straight[g] = -(force * numbers[SOFTENING, g] + numbers[STIFFENING, g])
        along[g] = numbers[WEIGHT, g] * ay[g]  # minus the load along the chord
        normal[g] = -numbers[WEIGHT, g] * flat[g]  # the load across it
        quadratic[g] = 0.0
        linear[g] = 0.0
    for i in range(r):
        for g in range(lanes):
            tilted[g] = (
                tilt[0, i, 0] * q[0, g] + tilt[0, i, 1] * q[1, g] + tilt[0, i, 2] * q[2, g] + tilt[0, i, 3] * q[3, g]
            )
            tilted_out[g] = (
                tilt[1, i, 0] * q_out[0, g] + tilt[1, i, 1] * q_out[1, g]
                + tilt[1, i, 2] * q_out[2, g] + tilt[1, i, 3] * q_out[3, g]
            )  # fmt: skip
        for j in range(4, r, 4):
            for g in range(lanes):
                tilted[g] += (
                    tilt[0, i, j] * q[j, g] + tilt[0, i, j + 1] * q[j + 1, g]
                    + tilt[0, i, j + 2] * q[j + 2, g] + tilt[0, i, j + 3] * q[j + 3, g]
                )  # fmt: skip
                tilted_out[g] += (
                    tilt[1, i, j] * q_out[j, g] + tilt[1, i, j + 1] * q_out[j + 1, g]
                    + tilt[1, i, j + 2] * q_out[j + 2, g] + tilt[1, i, j + 3] * q_out[j + 3, g]
                )  # fmt: skip
        for g in range(lanes):
            square = numbers[SCALE, g] * numbers[SCALE, g]
            a, b = square * tilted[g], square * tilted_out[g]
            on_q[i, g] = straight[g] * kappa[i, g] * q[i, g] + along[g] * a + normal[g] * loads[i, g]
            on_out[i, g] = straight[g] * kappa_out[i, g] * q_out[i, g] + along[g] * b
            quadratic[g] += q[i, g] * a + q_out[i, g] * b
            linear[g] += q[i, g] * loads[i, g]
    for g in range(lanes):
        turning = (0.5 * quadratic[g] * normal[g] - linear[g] * along[g]) / chord[g]
        end_x[g] = tension[g] * ax[g] + turning * nx[g]
        end_y[g] = tension[g] * ay[g] + turning * flat[g] - 0.5 * numbers[WEIGHT, g] * numbers[LENGTH, g]
        end_z[g] = tension[g] * az[g] + turning * nz[g]


@compiled(noalias=True, forceinline=True, fastmath=FAST_DIVISION)
def _guy_drag(
    q, q_out, rates, rates_out, wind, drag, sigma, shapes, slopes, numbers, axes, end_along, end_normal, end_binormal, stretch,
    work, on_q, on_out, end_x, end_y, end_z,
):  # fmt: skip
    """Add the drag on guys at points along them to the forces on their coordinates and on their upper ends.

    Parameters
    ----------
    q, q_out, rates, rates_out
        Deflections and their rates relative to the chord (r, lanes).
    wind
        Velocity of the air in x, y, z (points, 3, lanes) [m/s].
    drag
        Half the density of the air times drag coefficient, diameter and length of a point (points, lanes) [kg/m].
    sigma, shapes, slopes
        Places of the points, shapes of unit length and mass and their slopes (2, points, r).
    numbers
        Numbers of the guys, see the head of this file.
    axes, end_along, end_normal, end_binormal
        Axes at rest (9, lanes), velocity of the upper ends along them (lanes,) [m/s].
    stretch
        Chord over unstretched length (lanes,).
    work
        Work arrays of (lanes,), the last three of (points, lanes).
    on_q, on_out, end_x, end_y, end_z
        Forces on coordinates (r, lanes) and on ends (lanes,) [N]; added to.
    """
    slope, slope_out, rate, rate_out, sum_along, sum_normal, sum_binormal, along, normal, binormal = work
    r, lanes = q.shape
    for k in range(sigma.size):
        for g in range(lanes):
            slope[g] = (
                slopes[0, k, 0] * q[0, g] + slopes[0, k, 1] * q[1, g]
                + slopes[0, k, 2] * q[2, g] + slopes[0, k, 3] * q[3, g]
            )  # fmt: skip
            rate[g] = (
                shapes[0, k, 0] * rates[0, g] + shapes[0, k, 1] * rates[1, g]
                + shapes[0, k, 2] * rates[2, g] + shapes[0, k, 3] * rates[3, g]
            )  # fmt: skip
        for g in range(lanes):
            slope_out[g] = (
                slopes[1, k, 0] * q_out[0, g] + slopes[1, k, 1] * q_out[1, g]
                + slopes[1, k, 2] * q_out[2, g] + slopes[1, k, 3] * q_out[3, g]
            )  # fmt: skip
            rate_out[g] = (
                shapes[1, k, 0] * rates_out[0, g] + shapes[1, k, 1] * rates_out[1, g]
                + shapes[1, k, 2] * rates_out[2, g] + shapes[1, k, 3] * rates_out[3, g]
            )  # fmt: skip
        for i in range(4, r, 4):
            for g in range(lanes):
                slope[g] += (
                    slopes[0, k, i] * q[i, g] + slopes[0, k, i + 1] * q[i + 1, g]
                    + slopes[0, k, i + 2] * q[i + 2, g] + slopes[0, k, i + 3] * q[i + 3, g]
                )  # fmt: skip
                rate[g] += (
                    shapes[0, k, i] * rates[i, g] + shapes[0, k, i + 1] * rates[i + 1, g]
                    + shapes[0, k, i + 2] * rates[i + 2, g] + shapes[0, k, i + 3] * rates[i + 3, g]
                )  # fmt: skip
            for g in range(lanes):
                slope_out[g] += (
                    slopes[1, k, i] * q_out[i, g] + slopes[1, k, i + 1] * q_out[i + 1, g]
                    + slopes[1, k, i + 2] * q_out[i + 2, g] + slopes[1, k, i + 3] * q_out[i + 3, g]
                )  # fmt: skip
                rate_out[g] += (
                    shapes[1, k, i] * rates_out[i, g] + shapes[1, k, i + 1] * rates_out[i + 1, g]
                    + shapes[1, k, i + 2] * rates_out[i + 2, g] + shapes[1, k, i + 3] * rates_out[i + 3, g]
                )  # fmt: skip
        for g in range(lanes):
            scale = numbers[SCALE, g]
            a, b = slope[g] * numbers[SLOPE_SCALE, g], slope_out[g] * numbers[SLOPE_SCALE, g]
            u = (
                axes[0, g] * wind[k, 0, g] + axes[1, g] * wind[k, 1, g] + axes[2, g] * wind[k, 2, g]
                - sigma[k] * end_along[g]
            )  # fmt: skip
            v = (
                axes[3, g] * wind[k, 0, g] + axes[4, g] * wind[k, 1, g] + axes[5, g] * wind[k, 2, g]
                - sigma[k] * end_normal[g] - scale * rate[g]
            )  # fmt: skip
            w = (
                axes[6, g] * wind[k, 0, g] + axes[7, g] * wind[k, 1, g] + axes[8, g] * wind[k, 2, g]
                - sigma[k] * end_binormal[g] - scale * rate_out[g]
            )  # fmt: skip
            # the tangent points from the anchor to the mast, the first axis the other way
            square = stretch[g] * stretch[g] + a * a + b * b
            u, v, w = _spatial_law(drag[k, g], -stretch[g], square, u, v, w, a, b)
            along[k, g] = u
            normal[k, g] = scale * v
            binormal[k, g] = scale * w
    for i in range(r):
        for k in range(0, sigma.size, 2):
            for g in range(lanes):
                on_q[i, g] += shapes[0, k, i] * normal[k, g] + shapes[0, k + 1, i] * normal[k + 1, g]
                on_out[i, g] += shapes[1, k, i] * binormal[k, g] + shapes[1, k + 1, i] * binormal[k + 1, g]
    for k in range(0, sigma.size, 2):
        kept = 1.0 if k > 0 else 0.0
        for g in range(lanes):
            sum_along[g] = kept * sum_along[g] + sigma[k] * along[k, g] + sigma[k + 1] * along[k + 1, g]
            sum_normal[g] = kept * sum_normal[g] + sigma[k] * normal[k, g] + sigma[k + 1] * normal[k + 1, g]
            sum_binormal[g] = kept * sum_binormal[g] + sigma[k] * binormal[k, g] + sigma[k + 1] * binormal[k + 1, g]
    for g in range(lanes):
        u, v, w = sum_along[g], sum_normal[g] / numbers[SCALE, g], sum_binormal[g] / numbers[SCALE, g]
        end_x[g] += u * axes[0, g] + v * axes[3, g] + w * axes[6, g]
        end_y[g] += u * axes[1, g] + v * axes[4, g] + w * axes[7, g]
        end_z[g] += u * axes[2, g] + v * axes[5, g] + w * axes[8, g]
