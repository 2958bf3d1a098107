"""Compiled run of masts with condensed guys: one loop for the mast and all guys, which lie abreast in lanes.

Terms of the guys are those of :mod:`cablepod.mast._kernels_guys`.  The mass matrix of their coordinates p and of the modal
coordinates of the mast is constant and block diagonal, so that no step has an iteration.

Several masts of the same guys, in the same air, run abreast: their guys fill the lanes, mast by mast, and the air is
interpolated once for all.  Every mast is computed as if it were alone, so that its result does not depend on the others.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, REORDERED_FUSED, compiled
from cablepod.mast._kernels_guys import (
    AT_X,
    AT_Z,
    LARGEST_KAPPA,
    LENGTH,
    RATE_X,
    RATE_Z,
    X,
    Z,
    _advance_guys,
    _axes,
    _deflections,
    _guy_drag,
    _guy_forces,
    _hand_over,
    _own_rates,
)
from cablepod.mast._kernels_layout import LARGEST, LARGEST_STEP, LEAST, LEAST_STEP
from cablepod.mast._kernels_mast import (
    TAPS,
    _add_loads,
    _add_mast_drag,
    _advance_mast,
    _interpolate,
    _is_finite,
    _move_ends,
    _sample_weights,
)

DONE, DIVERGED, UNSTABLE = range(3)


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


@compiled(forceinline=True)
def _air_work(node_drag):
    """Return work arrays of the air at the nodes, twice that of the drag in each direction; None in still air."""
    if node_drag is None:
        return None, None, None
    nodes = node_drag.shape[1]
    return np.empty(2 * nodes), np.empty(nodes), np.empty(nodes)


@compiled(noalias=True, forceinline=True)
def _spread(values, members, guys, lanes):
    """Copy the air along the guys of one mast (rows, guys) to those of all masts (rows, lanes)."""
    for k in range(values.shape[0]):
        for m in range(members):
            for g in range(guys):
                lanes[k, m * guys + g] = values[k, g]


@compiled(counted=False, fastmath=REORDERED_FUSED)
def _begin_masts(
    k, a, v, before, constant, load_vectors, factors, air, node_columns, node_rows, node_drag, x, z, level_rows, level_rest,
    guy_level, mean_rate, force, upper, upper_rate, ends,
):  # fmt: skip
    """Fill modal forces of loads and drag at step `k`, displacements and rates of the levels and of the guys' ends."""
    count = guy_level.size
    for m in range(a.shape[0]):
        for i in range(a.shape[1]):
            force[m, i] = constant[m, i]
            mean_rate[i] = 1.5 * v[m, i] - 0.5 * before[m, i]
        if factors is not None:
            _add_loads(k, load_vectors[m], factors[m], force[m])
        _move_ends(a[m], mean_rate, level_rows[m], level_rest[m], upper[m], upper_rate[m])
        if air is not None:
            _add_mast_drag(mean_rate, air, node_columns[m], node_rows[m], node_drag[m], x, z, force[m])
        for g in range(count):
            n, lane = guy_level[g], m * count + g
            ends[X, lane] = upper[m, n, 0] - level_rest[m, n, 0]
            ends[Z, lane] = upper[m, n, 1] - level_rest[m, n, 1]
            ends[AT_X, lane], ends[AT_Z, lane] = upper[m, n, 0], upper[m, n, 1]
            ends[RATE_X, lane], ends[RATE_Z, lane] = upper_rate[m, n, 0], upper_rate[m, n, 1]


@compiled(counted=False, fastmath=FAST_DIVISION)
def _advance_masts(
    first, step, a, v, before, force, stiffness, keep, gain, level_rows, guy_level, on_end, level_force, acceleration, at_guys
):  # fmt: skip
    """Advance the rates of the masts by the forces of their guys; fill accelerations in x and z of the guys' ends."""
    count = guy_level.size
    for m in range(a.shape[0]):
        for n in range(level_force.shape[0]):
            level_force[n, 0] = level_force[n, 1] = 0.0
        for g in range(count):
            n, lane = guy_level[g], m * count + g
            level_force[n, 0] += on_end[0, lane]
            level_force[n, 1] += on_end[2, lane]
        _advance_mast(
            first, step, a[m], v[m], before[m], force[m], stiffness[m], keep[m], gain[m], level_rows[m], level_force,
            acceleration,
        )  # fmt: skip
        for g in range(count):
            n, lane = guy_level[g], m * count + g
            at_guys[0, lane], at_guys[1, lane] = acceleration[n, 0], acceleration[n, 1]


@compiled(noalias=True, forceinline=True, fastmath=FAST_DIVISION)
def _take_inertia(end_mass, acceleration, on_x, on_y, on_z, tension):
    """Take the inertia of the upper ends from the forces on them (lanes,) [N]; fill the tensions."""
    for g in range(tension.size):
        x, z = acceleration[0, g], acceleration[1, g]
        u = on_x[g] - (end_mass[0, g] * x + end_mass[1, g] * z)
        v = on_y[g] - (end_mass[2, g] * x + end_mass[3, g] * z)
        w = on_z[g] - (end_mass[4, g] * x + end_mass[5, g] * z)
        on_x[g] = u
        on_y[g] = v
        on_z[g] = w
        tension[g] = math.sqrt(u * u + v * v + w * w)


@compiled(noalias=True, forceinline=True)
def _record_rows(k, values, least, largest, least_step, largest_step, total, squares):
    """Update extremes, the steps of them, sums and sums of squares of values."""
    for g in range(values.size):
        x = values[g]
        less, more = x < least[g], x > largest[g]
        least[g] = x if less else least[g]
        least_step[g] = k if less else least_step[g]
        largest[g] = x if more else largest[g]
        largest_step[g] = k if more else largest_step[g]
        total[g] += x
        squares[g] += x * x


@compiled(noalias=True, forceinline=True)
def _watch(k, largest, chordwise, sag, kappa, least, least_step):
    """Update least H and its steps (lanes,); tell whether the squared frequency of a guy is not below its limit [1/s2]."""
    beyond = 0.0
    for g in range(chordwise.size):
        force = chordwise[g]
        less = force < least[g]
        least[g] = force if less else least[g]
        least_step[g] = k if less else least_step[g]
        beyond += 0.0 if abs(force) * kappa[g] + sag[g] < largest else 1.0
    return beyond > 0.0


@compiled(forceinline=True)
def _stop_guys(k, largest, chordwise, sag, kappa, guys, status, stopped):
    """Note masts of which a guy has left the stable range or the finite numbers."""
    for lane in range(status.size * guys):
        m = lane // guys
        if status[m] == DONE and not abs(chordwise[lane]) * kappa[lane] + sag[lane] < largest:
            status[m] = UNSTABLE if abs(chordwise[lane]) < np.inf else DIVERGED
            stopped[m, 0], stopped[m, 1] = k, lane - m * guys


@compiled(noalias=True, forceinline=True)
def _save_masts(row, a, v, before, on_end, tension, saved, saved_rates, saved_force, saved_tension):
    """Save the states of the masts at an output."""
    guys = saved_tension.shape[2]
    for m in range(a.shape[0]):
        for i in range(a.shape[1]):
            saved[m, row, i] = a[m, i]
            saved_rates[m, row, 0, i], saved_rates[m, row, 1, i] = before[m, i], v[m, i]
        for g in range(guys):
            saved_tension[m, row, g] = tension[m * guys + g]
            for d in range(3):
                saved_force[m, row, g, d] = on_end[d, m * guys + g]


@compiled(fastmath=FAST_DIVISION)
def condensed_run(
    step, every, steps, window, a, v, p, rates, constant, mast_stiffness, keep, gain, level_rows, level_rest, heights,
    guy_level, lower, rest_axes, numbers, kappa, moments, loads, tilt, guy_keep, guy_gain, end_mass, load_vectors, factors,
    samples_per_step, table, mast_wind, node_columns, node_rows, node_drag, guy_wind, guy_drag, sigma, shapes, slopes,
    saved, saved_rates, saved_coordinates, saved_force, saved_tension, level_extremes, level_sums, tension_extremes,
    tension_sums, monitor, status, stopped,
):  # fmt: skip
    """Run masts with condensed guys from rest, all with the same steps and in the same air.

    Parameters
    ----------
    step, every, steps, window
        Step [s], steps from one output to the next, number of steps, first and last step of extremes and sums (2,).
    a, v
        Modal coordinates of the masts and their rates (masts, modes); changed.
    p, rates
        Coordinates of the guys and their rates (2, r, lanes), in and out of their planes; changed.
    constant, mast_stiffness, keep, gain
        Constant modal forces (masts, modes), stiffness and the transposed matrices A1 and A2 of the step (masts, modes, modes).
    level_rows, level_rest, heights
        Displacement of the levels in x and z by the modes (masts, levels, 2, modes), at rest (masts, levels, 2) [m]; heights of
        the guys (lanes,) [m].
    guy_level, lower, rest_axes
        Level of each guy of a mast (guys,), anchors (3, lanes) [m], axes of the guys at rest (9, lanes).
    numbers, kappa, moments, loads, tilt
        Coefficients of the guys (..., lanes), see :mod:`cablepod.mast._kernels_guys`, and tilt of shapes of unit mass (2, r, r).
    guy_keep, guy_gain
        Factor of rates in a step, factors of forces (2, r, lanes).
    end_mass
        Mass of the upper ends without that of the coordinates, rows of force in x, y, z by acceleration in x and z (6, lanes)
        [kg].
    load_vectors, factors
        Loads on the modes (masts, loads, modes) and their factors (masts, loads, steps + 1), or None.
    samples_per_step, table, mast_wind, node_columns, node_rows, node_drag, guy_wind, guy_drag, sigma, shapes, slopes
        Wind: samples in a step and weights between them, at the nodes of the mast (samples, 2 nodes) and along the guys of a mast
        (samples, 3 points guys) [m/s], see ``_kernels_mast`` and ``_kernels_guys``; None without wind.
    saved, saved_rates, saved_coordinates, saved_force, saved_tension
        Filled at the outputs: modal coordinates, rates half a step before and after, coordinates of the guys and such rates
        (or without rows), force on the mast and tension of each guy.
    level_extremes, level_sums, tension_extremes, tension_sums
        Filled: extremes and their steps (4, masts levels 2) and (4, lanes), sums and sums of squares (2, ...).
    monitor
        Least H of the guys [N] and its steps (2, lanes).
    status, stopped
        Filled: status of each mast (masts,), step and guy at which it was found (masts, 2).  A mast alone stops there.
    """
    count, r, lanes, members, levels = guy_level.size, p.shape[1], p.shape[2], a.shape[0], level_rest.shape[1]
    force, before, mean_rate = np.empty(a.shape), v.copy(), np.empty(a.shape[1])
    upper, upper_rate, level_force = (
        np.empty((members, levels, 2)),
        np.empty((members, levels, 2)),
        np.empty((levels, 2)),
    )
    acceleration, at_guys, tension = np.empty((levels, 2)), np.zeros((2, lanes)), np.empty(lanes)
    rates_before, ends, on_end = rates.copy(), np.zeros((6, lanes)), np.empty((3, lanes))
    q, on_q, own = np.empty((2, r, lanes)), np.empty((2, r, lanes)), np.zeros((2, r, lanes))
    points = 0 if sigma is None else sigma.size
    axes, terms, of_drag, others = _rows(lanes, points)
    chord, stretch, chordwise, sag, end_along, end_normal, end_binormal, moved, moved_out = others
    values, weights, guy_air = np.empty((3 * points, count)), np.empty(TAPS), np.zeros((3 * points, lanes))
    flat_values, guy_air_at = values.reshape(3 * points * count), guy_air.reshape((points, 3, lanes))
    flat_upper, flat_v, largest = upper.reshape(members * levels * 2), v.reshape(v.size), 4.0 / (step * step)
    air, x, z = _air_work(node_drag)
    for k in range(steps + 1):
        if mast_wind is not None:
            left = _sample_weights(k * samples_per_step, mast_wind.shape[0], table, weights)
            _interpolate(mast_wind, left, weights, air)
            _interpolate(guy_wind, left, weights, flat_values)
            _spread(values, members, count, guy_air)
        _begin_masts(
            k, a, v, before, constant, load_vectors, factors, air, node_columns, node_rows, node_drag, x, z, level_rows,
            level_rest, guy_level, mean_rate, force, upper, upper_rate, ends,
        )  # fmt: skip
        _deflections(p[0], p[1], moments[0], moments[1], rest_axes, ends, moved, moved_out, q[0], q[1])
        _axes(ends, lower, heights, numbers[LENGTH], axes, chord, stretch)
        _guy_forces(
            numbers, kappa[0], kappa[1], loads[0], tilt, q[0], q[1], axes, chord, stretch, terms, chordwise, sag, on_q[0],
            on_q[1], on_end[0], on_end[1], on_end[2],
        )  # fmt: skip
        if _watch(k, largest, chordwise, sag, numbers[LARGEST_KAPPA], monitor[0], monitor[1]):
            _stop_guys(k, largest, chordwise, sag, numbers[LARGEST_KAPPA], count, status, stopped)
            if members == 1:
                return
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
        _advance_masts(
            k == 0, step, a, v, before, force, mast_stiffness, keep, gain, level_rows, guy_level, on_end, level_force,
            acceleration, at_guys,
        )  # fmt: skip
        _take_inertia(end_mass, at_guys, on_end[0], on_end[1], on_end[2], tension)
        if window[0] <= k <= window[1]:
            _record_rows(
                k, flat_upper, level_extremes[LEAST], level_extremes[LARGEST], level_extremes[LEAST_STEP],
                level_extremes[LARGEST_STEP], level_sums[0], level_sums[1],
            )  # fmt: skip
            _record_rows(
                k, tension, tension_extremes[LEAST], tension_extremes[LARGEST], tension_extremes[LEAST_STEP],
                tension_extremes[LARGEST_STEP], tension_sums[0], tension_sums[1],
            )  # fmt: skip
        if k % every == 0:
            _save_masts(k // every, a, v, before, on_end, tension, saved, saved_rates, saved_force, saved_tension)
            if saved_coordinates.shape[0]:
                saved_coordinates[k // every, 0] = q
                saved_coordinates[k // every, 1] = rates_before
                saved_coordinates[k // every, 2] = rates
        if not _is_finite(flat_v):
            for m in range(members):
                if status[m] == DONE and not _is_finite(v[m]):
                    status[m], stopped[m, 0], stopped[m, 1] = DIVERGED, k, 0
            if members == 1:
                return
        for m in range(members):
            for i in range(a.shape[1]):
                a[m, i] += step * v[m, i]
