"""Compiled run of a mast with condensed guys: one loop for the mast and all guys, which lie abreast in lanes.

Terms of the guys are those of :mod:`cablepod.mast._kernels_guys`.  The mass matrix of their coordinates p and of the modal
coordinates of the mast is constant and block diagonal, so that no step has an iteration.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
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
        Coefficients of the guys (..., lanes), see :mod:`cablepod.mast._kernels_guys`, and tilt of shapes of unit mass (2, r, r).
    guy_keep, guy_gain
        Factor of rates in a step, factors of forces (2, r, lanes).
    end_mass
        Mass of the upper ends without that of the coordinates: force in x, y, z by acceleration in x, z (guys, 3, 2) [kg].
    load_vectors, factors
        Loads on the modes (loads, modes) and their factors (loads, steps + 1), or None.
    samples_per_step, table, mast_wind, node_columns, node_rows, node_drag, guy_wind, guy_drag, sigma, shapes, slopes
        Wind: samples in a step and weights between them, at the nodes of the mast (samples, 2 nodes) and along the guys (samples,
        3 points lanes) [m/s], see ``_kernels_mast`` and ``_kernels_guys``; None without wind.
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
