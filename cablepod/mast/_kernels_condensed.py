"""Compiled run of a mast with condensed guys: one loop for the mast and all guys, which lie abreast in lanes.

A guy has the coordinates p = q + m n.u, with the deflections q in and out of its vertical plane and the displacement u of its
upper end.  The mass matrix of p and of the modal coordinates of the mast is constant and block diagonal, so that no step has an
iteration.  The energy of a guy, its chord c = |upper - lower| and its load g along it give the forces,

    H = K (c/L - 1) + K/(2 L) (1 - 2 e) sum of kappa q^2,    F_i = -((1 - 2 e) H + e N0) kappa_i q_i - g (B q)_i + h P_i,

and the force H e + (q.B q h/2 + P.q g) n/c + half of the weight on its upper end at fixed q.

Guys are the last dimension of their arrays, padded to whole groups of lanes.  Loops over them write to arrays of which they read
no other row, so that they become a few instructions; modes are padded to multiples of four, which are taken together.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.mast._kernels_mast import (
    TAPS,
    _advance_mast,
    _air_work,
    _begin_step,
    _interpolate,
    _is_finite,
    _record,
    _sample_weights,
    _save,
)

#: Rows of the numbers of the guys: K [N], L [m], weight [N/m], 1 - 2 e, e N0 [N], largest fitted kappa [1/(kg m)], scale of the
#: shapes [kg^-1/2] and of their slopes [kg^-1/2 1/m].
STIFFNESS, LENGTH, WEIGHT, SOFTENING, STIFFENING, LARGEST_KAPPA, SCALE, SLOPE_SCALE = range(8)
#: Rows of the ends of the guys: displacement in x and z from rest [m], position in x and z [m], rates in x and z [m/s].
X, Z, AT_X, AT_Z, RATE_X, RATE_Z = range(6)
DONE, DIVERGED, UNSTABLE = range(3)


@compiled(noalias=True, forceinline=True, fastmath=FAST_DIVISION)
def _deflections(p, p_out, moments, moments_out, rest_axes, ends, moved, moved_out, q, q_out):
    """Fill the deflections q = p - m n.u in and out of the plane (r, lanes) [kg^1/2 m]."""
    lanes = moved.size
    for g in range(lanes):
        moved[g] = rest_axes[3, g] * ends[X, g] + rest_axes[5, g] * ends[Z, g]
        moved_out[g] = rest_axes[6, g] * ends[X, g] + rest_axes[8, g] * ends[Z, g]
    for i in range(q.shape[0]):
        for g in range(lanes):
            q[i, g] = p[i, g] - moments[i, g] * moved[g]
            q_out[i, g] = p_out[i, g] - moments_out[i, g] * moved_out[g]


@compiled(noalias=True, forceinline=True, fastmath=FAST_DIVISION)
def _own_rates(
    rates, rates_out, before, before_out, moments, moments_out, rest_axes, ends, along, normal, binormal, own, own_out
):  # fmt: skip
    """Fill velocities of the ends along the axes (lanes,) and rates of the deflections (r, lanes), predicted to the step."""
    lanes = along.size
    for g in range(lanes):
        along[g] = rest_axes[0, g] * ends[RATE_X, g] + rest_axes[2, g] * ends[RATE_Z, g]
        normal[g] = rest_axes[3, g] * ends[RATE_X, g] + rest_axes[5, g] * ends[RATE_Z, g]
        binormal[g] = rest_axes[6, g] * ends[RATE_X, g] + rest_axes[8, g] * ends[RATE_Z, g]
    for i in range(own.shape[0]):
        for g in range(lanes):
            own[i, g] = 1.5 * rates[i, g] - 0.5 * before[i, g] - moments[i, g] * normal[g]
            own_out[i, g] = 1.5 * rates_out[i, g] - 0.5 * before_out[i, g] - moments_out[i, g] * binormal[g]


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
        x, y, z = lower[0, g] - ends[AT_X, g], lower[1, g] - heights[g], lower[2, g] - ends[AT_Z, g]
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
    numbers, kappa, kappa_out, loads, tilt, q, q_out, axes, chord, stretch, work, tension, sag, on_q, on_out, end_x, end_y, end_z
):  # fmt: skip
    """Fill the forces on the coordinates (r, lanes) and on the ends (lanes,) [N], H [N] and the stiffness of the sag [1/s2].

    `tilt` is that of shapes of unit mass (2, r, r); `loads` are those of the shapes in the plane.
    """
    ax, ay, az, flat, nx, nz = axes
    straight, along, normal, tilted, tilted_out, quadratic, linear = work
    r, lanes = q.shape
    for g in range(lanes):
        a, b = kappa[0, g] * q[0, g], kappa[1, g] * q[1, g]
        c, d = kappa_out[0, g] * q_out[0, g], kappa_out[1, g] * q_out[1, g]
        tension[g] = a * q[0, g] + b * q[1, g] + c * q_out[0, g] + d * q_out[1, g]
        sag[g] = a * a + b * b + c * c + d * d
    for i in range(2, r, 2):
        for g in range(lanes):
            a, b = kappa[i, g] * q[i, g], kappa[i + 1, g] * q[i + 1, g]
            c, d = kappa_out[i, g] * q_out[i, g], kappa_out[i + 1, g] * q_out[i + 1, g]
            tension[g] += a * q[i, g] + b * q[i + 1, g] + c * q_out[i, g] + d * q_out[i + 1, g]
            sag[g] += a * a + b * b + c * c + d * d
    for g in range(lanes):
        spring = numbers[STIFFNESS, g] / numbers[LENGTH, g]
        force = numbers[STIFFNESS, g] * (stretch[g] - 1.0) + 0.5 * spring * numbers[SOFTENING, g] * tension[g]
        tension[g] = force
        sag[g] *= spring
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
            product = (v * a + w * b - u * stretch[g]) / square
            u += product * stretch[g]
            v -= product * a
            w -= product * b
            size = drag[k, g] * math.sqrt(square * (u * u + v * v + w * w))
            along[k, g] = size * u
            normal[k, g] = scale * size * v
            binormal[k, g] = scale * size * w
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


@compiled(forceinline=True)
def _rows(lanes, points):
    """Return work arrays of a step (lanes,): axes, terms of the forces, terms of the drag, and others."""
    axes = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    terms = (
        np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    )  # fmt: skip
    of_drag = (
        np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes),
        np.zeros((points, lanes)), np.zeros((points, lanes)), np.zeros((points, lanes)),
    )  # fmt: skip
    others = (
        np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes),
        np.zeros(lanes), np.zeros(lanes),
    )  # fmt: skip
    return axes, terms, of_drag, others


@compiled
def guy_forces(
    numbers, kappa, loads, tilt, lower, heights, ends, q, wind, drag, sigma, shapes, slopes, rest_axes, on_q, on_end
):  # fmt: skip
    """Fill forces of guys whose deflections do not move, with drag unless `wind` is None.

    Arrays as in :func:`condensed_run`; `wind` is (points, 3, lanes) [m/s]; `q` and `on_q` (2, r, lanes), `on_end` (3, lanes).
    """
    axes, terms, of_drag, others = _rows(q.shape[2], 0 if sigma is None else sigma.size)
    chord, stretch, tension, sag, end_along, end_normal, end_binormal, _, _ = others
    _axes(ends, lower, heights, numbers[LENGTH], axes, chord, stretch)
    _guy_forces(
        numbers, kappa[0], kappa[1], loads[0], tilt, q[0], q[1], axes, chord, stretch, terms, tension, sag, on_q[0], on_q[1],
        on_end[0], on_end[1], on_end[2],
    )  # fmt: skip
    if wind is not None:
        still = np.zeros(q.shape)
        _guy_drag(
            q[0], q[1], still[0], still[1], wind, drag, sigma, shapes, slopes, numbers, rest_axes, end_along, end_normal,
            end_binormal, stretch, of_drag, on_q[0], on_q[1], on_end[0], on_end[1], on_end[2],
        )  # fmt: skip


@compiled(fastmath=FAST_DIVISION)
def condensed_run(
    step, every, steps, window, a, v, p, rates, constant, mast_stiffness, keep, gain, level_rows, level_rest, heights,
    guy_level, lower, rest_axes, numbers, kappa, moments, loads, tilt, guy_keep, guy_gain, end_mass, load_vectors, factors,
    samples_per_step, table, mast_wind, node_columns, node_rows, node_drag, guy_wind, guy_drag, sigma, shapes, slopes,
    saved, saved_rates, saved_coordinates, saved_force, saved_tension, level_extremes, level_sums, tension_extremes,
    tension_sums, monitor,
):  # fmt: skip
    """Run a mast with condensed guys from rest; return the status and the step at which it was found.

    Parameters
    ----------
    step, every, steps, window
        Step [s], steps from one output to the next, number of steps, first and last step of extremes and sums (2,).
    a, v
        Modal coordinates of the mast and their rates (modes,); changed.
    p, rates
        Coordinates of the guys and their rates (2, r, lanes), in and out of their planes; changed.
    constant, mast_stiffness, keep, gain
        Constant modal forces (modes,), stiffness and the transposed matrices A1 and A2 of the step (modes, modes).
    level_rows, level_rest, heights
        Displacement of the levels in x and z by the modes (levels, 2, modes), at rest (levels, 2) [m]; heights of the guys
        (lanes,) [m].
    guy_level, lower, rest_axes
        Level of each guy (guys,), anchors (3, lanes) [m], axes of the guys at rest (9, lanes).
    numbers, kappa, moments, loads, tilt
        Coefficients of the guys (..., lanes), see the head of this file, and tilt of shapes of unit mass (2, r, r).
    guy_keep, guy_gain
        Factor of rates in a step, factors of forces (2, r, lanes).
    end_mass
        Mass of the upper ends without that of the coordinates: force in x, y, z by acceleration in x, z (guys, 3, 2) [kg].
    load_vectors, factors
        Loads on the modes (loads, modes) and their factors (loads, steps + 1), or None.
    samples_per_step, table, mast_wind, node_columns, node_rows, node_drag, guy_wind, guy_drag, sigma, shapes, slopes
        Wind: samples in a step and weights between them, at the nodes of the mast (samples, 2 nodes) and along the guys (samples,
        3 points lanes) [m/s], see :func:`_mast_drag` and :func:`_guy_drag`; None without wind.
    saved, saved_rates, saved_coordinates, saved_force, saved_tension
        Filled at the outputs: modal coordinates, rates half a step before and after, coordinates of the guys and such rates
        (or without rows), force on the mast and tension of each guy.
    level_extremes, level_sums, tension_extremes, tension_sums
        Filled; see :mod:`cablepod.mast._kernels_mast`.
    monitor
        Least H of each guy [N] and its step (lanes, 2).
    """
    count, r, lanes, levels = guy_level.size, p.shape[1], p.shape[2], level_rest.shape[0]
    force, before, mean_rate = np.empty(a.size), v.copy(), np.empty(a.size)
    upper, upper_rate, level_force = np.empty((levels, 2)), np.empty((levels, 2)), np.empty((levels, 2))
    acceleration, guy_force, tension = np.empty((levels, 2)), np.empty((count, 3)), np.empty(count)
    rates_before, ends, on_end = rates.copy(), np.zeros((6, lanes)), np.empty((3, lanes))
    q, on_q, own = np.empty((2, r, lanes)), np.empty((2, r, lanes)), np.zeros((2, r, lanes))
    points = 0 if sigma is None else sigma.size
    axes, terms, of_drag, others = _rows(lanes, points)
    chord, stretch, chordwise, sag, end_along, end_normal, end_binormal, moved, moved_out = others
    guy_air, weights = np.empty(points * 3 * lanes), np.empty(TAPS)
    guy_air_at = guy_air.reshape((points, 3, lanes))
    mast_work, left = _air_work(node_drag), 0
    for k in range(steps + 1):
        if mast_wind is not None:
            left = _sample_weights(k * samples_per_step, mast_wind.shape[0], table, weights)
            _interpolate(guy_wind, left, weights, guy_air)
        _begin_step(
            k, a, v, before, constant, load_vectors, factors, left, weights, mast_wind, node_columns, node_rows, node_drag,
            mast_work, level_rows, level_rest, mean_rate, force, upper, upper_rate, level_force,
        )  # fmt: skip
        for g in range(count):
            n = guy_level[g]
            ends[X, g], ends[Z, g] = upper[n, 0] - level_rest[n, 0], upper[n, 1] - level_rest[n, 1]
            ends[AT_X, g], ends[AT_Z, g] = upper[n, 0], upper[n, 1]
            ends[RATE_X, g], ends[RATE_Z, g] = upper_rate[n, 0], upper_rate[n, 1]
        _deflections(p[0], p[1], moments[0], moments[1], rest_axes, ends, moved, moved_out, q[0], q[1])
        _axes(ends, lower, heights, numbers[LENGTH], axes, chord, stretch)
        _guy_forces(
            numbers, kappa[0], kappa[1], loads[0], tilt, q[0], q[1], axes, chord, stretch, terms, chordwise, sag, on_q[0],
            on_q[1], on_end[0], on_end[1], on_end[2],
        )  # fmt: skip
        for g in range(count):
            if chordwise[g] < monitor[g, 0]:
                monitor[g, 0], monitor[g, 1] = chordwise[g], k
            if not (abs(chordwise[g]) * numbers[LARGEST_KAPPA, g] + sag[g]) * step * step < 4.0:
                return (UNSTABLE if abs(chordwise[g]) < np.inf else DIVERGED), k, g
        if guy_wind is not None:
            _own_rates(
                rates[0], rates[1], rates_before[0], rates_before[1], moments[0], moments[1], rest_axes, ends, end_along,
                end_normal, end_binormal, own[0], own[1],
            )  # fmt: skip
            _guy_drag(
                q[0], q[1], own[0], own[1], guy_air_at, guy_drag, sigma, shapes, slopes, numbers, rest_axes, end_along,
                end_normal, end_binormal, stretch, of_drag, on_q[0], on_q[1], on_end[0], on_end[1], on_end[2],
            )  # fmt: skip
        _advance_guys(
            k == 0, step, guy_keep, guy_gain[0], guy_gain[1], moments[0], moments[1], on_q[0], on_q[1], moved, moved_out,
            rates[0], rates[1], rates_before[0], rates_before[1], p[0], p[1],
        )  # fmt: skip
        _hand_over(rest_axes, moved, moved_out, on_end[0], on_end[1], on_end[2])
        for g in range(count):
            n = guy_level[g]
            for d in range(3):
                guy_force[g, d] = on_end[d, g]
            level_force[n, 0] += on_end[0, g]
            level_force[n, 1] += on_end[2, g]
        _advance_mast(
            k == 0, step, a, v, before, force, mast_stiffness, keep, gain, level_rows, level_force, acceleration
        )
        for g in range(count):
            n = guy_level[g]
            x, z = acceleration[n, 0], acceleration[n, 1]
            square = 0.0
            for d in range(3):
                guy_force[g, d] -= end_mass[g, d, 0] * x + end_mass[g, d, 1] * z
                square += guy_force[g, d] * guy_force[g, d]
            tension[g] = math.sqrt(square)
        _record(k, window, upper, tension, level_extremes, level_sums, tension_extremes, tension_sums)
        _save(k, every, a, v, before, guy_force, tension, saved, saved_rates, saved_force, saved_tension)
        if saved_coordinates.shape[0] and k % every == 0:
            for part in range(2):
                for i in range(r):
                    for g in range(count):
                        saved_coordinates[k // every, 0, part, i, g] = q[part, i, g]
                        saved_coordinates[k // every, 1, part, i, g] = rates_before[part, i, g]
                        saved_coordinates[k // every, 2, part, i, g] = rates[part, i, g]
        if not _is_finite(v):
            return DIVERGED, k, 0
        for i in range(a.size):
            a[i] += step * v[i]
    return DONE, steps, 0
