"""Compiled run of a mast with condensed guys: one loop for the mast and all guys.

A guy has the coordinates p = q + m n.u, with the deflections q in and out of its vertical plane and the displacement u of its
upper end.  The mass matrix of p and of the modal coordinates of the mast is constant and block diagonal, so that no step has an
iteration.  The energy of a guy, its chord c = |upper - lower| and its load g along it give the forces,

    H = K (c/L - 1) + K/(2 L) (1 - 2 e) sum of kappa q^2,    F_i = -((1 - 2 e) H + e N0) kappa_i q_i - g (B q)_i + h P_i,

and the force H e + (q.B q h/2 + P.q g) n/c + half of the weight on its upper end at fixed q.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.mast._kernels_mast import _add_mast_drag, _advance_mast, _is_finite, _move_ends, _record, _save

#: Columns of the numbers of a guy: K [N], L [m], weight [N/m], 1 - 2 e, e N0 [N], mass of the end along the chord [kg],
#: largest fitted kappa [1/(kg m)].
STIFFNESS, LENGTH, WEIGHT, SOFTENING, STIFFENING, END_MASS, LARGEST_KAPPA = range(7)
DONE, DIVERGED, UNSTABLE = range(3)


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _frame(x, z, lower, level, axes):
    """Fill the axes of a guy from the displacement of its upper end; return the length of the chord [m]."""
    along_x, along_y, along_z = lower[0] - x, lower[1] - level, lower[2] - z
    flat = along_x * along_x + along_z * along_z
    chord = math.sqrt(flat + along_y * along_y)
    inverse = 1.0 / chord
    axes[0, 0], axes[0, 1], axes[0, 2] = along_x * inverse, along_y * inverse, along_z * inverse
    if flat > 1e-24 * chord * chord:
        run = math.sqrt(flat)
        sine, cosine = run * inverse, -along_y * inverse
        axes[1, 0], axes[1, 1], axes[1, 2] = cosine * along_x / run, sine, cosine * along_z / run
    else:
        axes[1, 0], axes[1, 1], axes[1, 2] = 1.0, 0.0, 0.0
    axes[2, 0] = axes[1, 1] * axes[0, 2] - axes[1, 2] * axes[0, 1]
    axes[2, 1] = axes[1, 2] * axes[0, 0] - axes[1, 0] * axes[0, 2]
    axes[2, 2] = axes[1, 0] * axes[0, 1] - axes[1, 1] * axes[0, 0]
    return chord


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _guy_forces(numbers, kappa, loads, tilt, axes, chord, q, tilted, on_q, on_end):
    """Fill the forces on the coordinates (2 r,) and on the end (3,); return H [N] and the stiffness of the sag [1/s2]."""
    length, stiffness, weight = numbers[LENGTH], numbers[STIFFNESS], numbers[WEIGHT]
    r = q.size // 2
    total, squares = 0.0, 0.0
    for i in range(q.size):
        total += kappa[i] * q[i] * q[i]
        squares += kappa[i] * kappa[i] * q[i] * q[i]
    tension = stiffness * (chord / length - 1.0) + 0.5 * stiffness / length * numbers[SOFTENING] * total
    along_load, normal_load = -weight * axes[0, 1], -weight * axes[1, 1]
    factor = tension * numbers[SOFTENING] + numbers[STIFFENING]
    quadratic, linear = 0.0, 0.0
    for part in range(2):
        for i in range(r):
            sum_of_row = 0.0
            for j in range(r):
                sum_of_row += tilt[part, i, j] * q[part * r + j]
            tilted[part * r + i] = sum_of_row
    for i in range(q.size):
        on_q[i] = -factor * kappa[i] * q[i] - along_load * tilted[i] + normal_load * loads[i]
        quadratic += q[i] * tilted[i]
        linear += q[i] * loads[i]
    turning = (0.5 * quadratic * normal_load + linear * along_load) / chord
    for d in range(3):
        on_end[d] = tension * axes[0, d] + turning * axes[1, d]
    on_end[1] -= 0.5 * weight * length
    return tension, stiffness / length * squares


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _add_guy_drag(
    q, rates, normal_rates, along_rate, stretch, wind, place, g, drag, sigma, shapes, slopes, axes, on_q, on_end
):
    """Add the drag on a guy at points along it to the forces on its coordinates and on its upper end.

    `wind` is (samples, guys, 3, points) [m/s] along the axes of the guy at rest, `rates` those of the deflections, `normal_rates`
    and `along_rate` the velocity of the upper end along the axes.
    """
    place = min(max(place, 0.0), wind.shape[0] - 1.0)
    sample = min(int(place), wind.shape[0] - 2)
    share = place - sample
    r = q.size // 2
    for k in range(sigma.size):
        slope, slope_out, rate, rate_out = 0.0, 0.0, 0.0, 0.0
        for i in range(r):
            slope += slopes[0, k, i] * q[i]
            rate += shapes[0, k, i] * rates[i]
            slope_out += slopes[1, k, i] * q[r + i]
            rate_out += shapes[1, k, i] * rates[r + i]
        along = wind[sample, g, 0, k] + share * (wind[sample + 1, g, 0, k] - wind[sample, g, 0, k])
        normal = wind[sample, g, 1, k] + share * (wind[sample + 1, g, 1, k] - wind[sample, g, 1, k])
        binormal = wind[sample, g, 2, k] + share * (wind[sample + 1, g, 2, k] - wind[sample, g, 2, k])
        along -= sigma[k] * along_rate
        normal -= sigma[k] * normal_rates[0] + rate
        binormal -= sigma[k] * normal_rates[1] + rate_out
        # the tangent points from the anchor to the mast, the first axis the other way
        square = stretch * stretch + slope * slope + slope_out * slope_out
        product = (-along * stretch + normal * slope + binormal * slope_out) / square
        along += product * stretch
        normal -= product * slope
        binormal -= product * slope_out
        size = drag[k] * math.sqrt(square * (along * along + normal * normal + binormal * binormal))
        along *= size
        normal *= size
        binormal *= size
        for i in range(r):
            on_q[i] += shapes[0, k, i] * normal
            on_q[r + i] += shapes[1, k, i] * binormal
        for d in range(3):
            on_end[d] += sigma[k] * (along * axes[0, d] + normal * axes[1, d] + binormal * axes[2, d])


@compiled
def guy_state(
    numbers, kappa, loads, tilt, lower, level, x, z, q, wind, place, g, drag, sigma, shapes, slopes, on_q, on_end
):
    """Fill the forces of a guy at rest, with drag unless `wind` is None; return H [N]."""
    axes, tilted, still, none = np.empty((3, 3)), np.empty_like(q), np.zeros_like(q), np.zeros(2)
    chord = _frame(x, z, lower, level, axes)
    tension, _ = _guy_forces(numbers, kappa, loads, tilt, axes, chord, q, tilted, on_q, on_end)
    if wind is not None:
        _add_guy_drag(
            q,
            still,
            none,
            0.0,
            chord / numbers[LENGTH],
            wind,
            place,
            g,
            drag,
            sigma,
            shapes,
            slopes,
            axes,
            on_q,
            on_end,
        )
    return tension


@compiled(fastmath=FAST_DIVISION)
def condensed_run(
    step, every, steps, window, a, v, p, rates, constant, mast_stiffness, keep, gain, level_rows, level_rest, heights,
    guy_level, lower, rest_axes, numbers, kappa, moments, loads, tilt, guy_keep, guy_gain, end_mass, load_vectors, factors,
    samples_per_step, mast_wind, node_rows, node_drag, guy_wind, guy_drag, sigma, shapes, slopes, saved, saved_rates,
    saved_coordinates, saved_force, saved_tension, level_extremes, level_sums, tension_extremes, tension_sums, monitor,
):  # fmt: skip
    """Run a mast with condensed guys from rest; return the status and the step at which it was found.

    Parameters
    ----------
    step, every, steps, window
        Step [s], steps from one output to the next, number of steps, first and last step of extremes and sums (2,).
    a, v
        Modal coordinates of the mast and their rates (modes,); changed.
    p, rates
        Coordinates of the guys and their rates (guys, 2 r); changed.
    constant, mast_stiffness, keep, gain
        Constant modal forces (modes,), stiffness and the matrices A1 and A2 of the step (modes, modes).
    level_rows, level_rest, heights
        Displacement of the levels in x and z by the modes (levels, 2, modes), at rest (levels, 2) [m]; their heights [m].
    guy_level, lower, rest_axes
        Level of each guy (guys,), anchors (guys, 3) [m], axes of the guys at rest (guys, 3, 3).
    numbers, kappa, moments, loads, tilt
        Coefficients of the guys (guys, ...), see the head of this file.
    guy_keep, guy_gain
        Factors of rates and of forces in a step (guys,), (guys, 2 r).
    end_mass
        Mass of the upper ends (guys, 2, 2) in x and z without that of the coordinates [kg].
    load_vectors, factors
        Loads on the modes (loads, modes) and their factors (loads, steps + 1), or None.
    samples_per_step, mast_wind, node_rows, node_drag, guy_wind, guy_drag, sigma, shapes, slopes
        Wind: samples of the air in a step, at the nodes of the mast and along the guys; None without wind.
    saved, saved_rates, saved_coordinates, saved_force, saved_tension
        Filled at the outputs: modal coordinates, rates half a step before and after, coordinates of the guys and such rates
        (or without rows), force on the mast and tension of each guy.
    level_extremes, level_sums, tension_extremes, tension_sums
        Filled; see :mod:`cablepod.mast._kernels_mast`.
    monitor
        Least H of each guy [N] and its step (guys, 2).
    """
    count, size, levels = lower.shape[0], p.shape[1], heights.size
    r = size // 2
    force, before = np.empty(a.size), np.empty(a.size)
    mean_rate, guy_rates, guy_before = np.empty(a.size), np.empty(size), rates.copy()
    upper, upper_rate, level_force = np.empty((levels, 2)), np.empty((levels, 2)), np.empty((levels, 2))
    acceleration = np.empty((levels, 2))
    q, on_q, tilted, axes = np.empty(size), np.empty(size), np.empty(size), np.empty((3, 3))
    on_end, guy_force, tension, normal_rates = np.empty(3), np.empty((count, 3)), np.empty(count), np.empty(2)
    deflections = np.empty((count, size))
    for i in range(a.size):
        before[i] = v[i]
    for k in range(steps + 1):
        for i in range(a.size):
            force[i] = constant[i]
            mean_rate[i] = 1.5 * v[i] - 0.5 * before[i]
        if factors is not None:
            for n in range(factors.shape[0]):
                for i in range(a.size):
                    force[i] += load_vectors[n, i] * factors[n, k]
        _move_ends(a, mean_rate, level_rows, level_rest, upper, upper_rate)
        if mast_wind is not None:
            _add_mast_drag(mean_rate, mast_wind, k * samples_per_step, node_rows, node_drag, force)
        for n in range(levels):
            level_force[n, 0] = level_force[n, 1] = 0.0
        for g in range(count):
            n = guy_level[g]
            x, z = upper[n, 0] - level_rest[n, 0], upper[n, 1] - level_rest[n, 1]
            for part in range(2):
                moved = rest_axes[g, 1 + part, 0] * x + rest_axes[g, 1 + part, 2] * z
                for i in range(part * r, part * r + r):
                    q[i] = p[g, i] - moments[g, i] * moved
            chord = _frame(upper[n, 0], upper[n, 1], lower[g], heights[n], axes)
            h, sag = _guy_forces(numbers[g], kappa[g], loads[g], tilt[g], axes, chord, q, tilted, on_q, on_end)
            if h < monitor[g, 0]:
                monitor[g, 0], monitor[g, 1] = h, k
            if not (abs(h) * numbers[g, LARGEST_KAPPA] + sag) * step * step < 4.0:
                return (UNSTABLE if abs(h) < np.inf else DIVERGED), k, g
            if guy_wind is not None:
                along_rate = rest_axes[g, 0, 0] * upper_rate[n, 0] + rest_axes[g, 0, 2] * upper_rate[n, 1]
                for part in range(2):
                    normal_rates[part] = (
                        rest_axes[g, 1 + part, 0] * upper_rate[n, 0] + rest_axes[g, 1 + part, 2] * upper_rate[n, 1]
                    )
                    for i in range(part * r, part * r + r):
                        guy_rates[i] = 1.5 * rates[g, i] - 0.5 * guy_before[g, i] - moments[g, i] * normal_rates[part]
                _add_guy_drag(
                    q, guy_rates, normal_rates, along_rate, chord / numbers[g, LENGTH], guy_wind, k * samples_per_step, g,
                    guy_drag[g], sigma, shapes[g], slopes[g], rest_axes[g], on_q, on_end,
                )  # fmt: skip
            for part in range(2):
                shared = 0.0
                for i in range(part * r, part * r + r):
                    shared += moments[g, i] * on_q[i]
                for d in range(3):
                    on_end[d] -= shared * rest_axes[g, 1 + part, d]
            for i in range(size):
                old = rates[g, i]
                if k == 0:
                    rates[g, i] = 0.5 * guy_gain[g, i] * on_q[i]
                    old = -rates[g, i]
                else:
                    rates[g, i] = guy_keep[g] * old + guy_gain[g, i] * on_q[i]
                guy_before[g, i] = old
                deflections[g, i] = q[i]
            for d in range(3):
                guy_force[g, d] = on_end[d]
            level_force[n, 0] += on_end[0]
            level_force[n, 1] += on_end[2]
        _advance_mast(
            k == 0, a, v, before, force, mast_stiffness, keep, gain, level_rows, level_force, step, acceleration
        )
        for g in range(count):
            n = guy_level[g]
            x, z = acceleration[n, 0], acceleration[n, 1]
            guy_force[g, 0] -= end_mass[g, 0, 0] * x + end_mass[g, 0, 1] * z
            guy_force[g, 2] -= end_mass[g, 1, 0] * x + end_mass[g, 1, 1] * z
            square = 0.0
            for d in range(3):
                square += guy_force[g, d] * guy_force[g, d]
            tension[g] = math.sqrt(square)
        _record(k, window, upper, tension, level_extremes, level_sums, tension_extremes, tension_sums)
        _save(k, every, a, v, before, guy_force, tension, saved, saved_rates, saved_force, saved_tension)
        if saved_coordinates.shape[0] and k % every == 0:
            for g in range(count):
                for i in range(size):
                    saved_coordinates[k // every, 0, g, i] = deflections[g, i]
                    saved_coordinates[k // every, 1, g, i] = guy_before[g, i]
                    saved_coordinates[k // every, 2, g, i] = rates[g, i]
        if not _is_finite(v):
            return DIVERGED, k, 0
        for i in range(a.size):
            a[i] += step * v[i]
        for g in range(count):
            for i in range(size):
                p[g, i] += step * rates[g, i]
    return DONE, steps, 0
