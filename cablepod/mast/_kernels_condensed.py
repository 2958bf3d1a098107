"""Compiled run of a mast with condensed guys: one loop for the mast and all guys, which lie abreast in lanes.

Terms of the guys are those of :mod:`cablepod.mast._kernels_guys`.  The mass matrix of their coordinates p and of the modal
coordinates of the mast is constant and block diagonal, so that no step has an iteration.
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
    Y,
    Z,
    _advance_guys,
    _axes,
    _deflections,
    _guy_drag,
    _guy_forces,
    _hand_over,
    _own_rates,
    _sizes_of,
)
from cablepod.mast._kernels_layout import LARGEST, LARGEST_STEP, LEAST, LEAST_STEP
from cablepod.mast._kernels_mast import (
    TAPS,
    _add_loads,
    _add_mast_drag,
    _advance_mast,
    _air_work,
    _interpolate,
    _is_finite,
    _lower_levels,
    _move_ends,
    _sample_weights,
    _save_drag,
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
    numbers, terms, kappa, loads, tilt, lower, heights, ends, q, wind, drag, sigma, shapes, slopes, rest_axes, on_q, on_end
):  # fmt: skip
    """Fill forces of guys whose deflections do not move, with drag unless `wind` is None.

    Arrays as in :func:`condensed_run`; `wind` is (points, 3, lanes) [m/s]; `q` and `on_q` (2, r, lanes), `on_end` (3, lanes).
    """
    axes, work, of_drag, others = _rows(q.shape[2], 0 if sigma is None else sigma.size)
    chord, stretch, tension, sag, end_along, end_normal, end_binormal, _, _ = others
    _axes(ends, lower, heights, numbers[LENGTH], axes, chord, stretch)
    _guy_forces(
        numbers, _sizes_of(q), terms, kappa[0], kappa[1], loads[0], tilt, q.reshape(q.size), q[0], q[1], axes, chord, work,
        tension, sag, on_q[0], on_q[1], on_end[0], on_end[1], on_end[2],
    )  # fmt: skip
    if wind is not None:
        still = np.zeros(q.shape)
        _guy_drag(
            q[0], q[1], still[0], still[1], wind, drag, sigma, shapes, slopes, numbers, rest_axes, end_along, end_normal,
            end_binormal, stretch, of_drag, on_q[0], on_q[1], on_end[0], on_end[1], on_end[2],
        )  # fmt: skip


@compiled(counted=False, fastmath=REORDERED_FUSED)
def _begin_mast(
    k, fresh, ahead, a, v, before, held, constant, load_vectors, factors, air, node_columns, node_rows, node_drag, x, z,
    level_rows, level_rest, pulls, guy_level, mean_rate, force, upper, upper_rate, ends,
):  # fmt: skip
    """Fill modal forces of loads and drag at step `k`, displacements and rates of the levels and of the guys' ends."""
    for i in range(a.size):
        force[i] = constant[i]
        mean_rate[i] = (1.0 + ahead) * v[i] - ahead * before[i]
    if factors is not None:
        _add_loads(k, load_vectors, factors, force)
    _move_ends(a, mean_rate, level_rows, level_rest, upper, upper_rate)
    _lower_levels(a, pulls[0], pulls[1], pulls[2], pulls[3])
    if air is not None:
        if fresh:
            for i in range(a.size):
                held[i] = 0.0
            _add_mast_drag(mean_rate, air, node_columns, node_rows, node_drag, x, z, held)
        for i in range(a.size):
            force[i] += held[i]
    for g in range(guy_level.size):
        n = guy_level[g]
        ends[X, g] = upper[n, 0] - level_rest[n, 0]
        ends[Y, g] = pulls[3][n]
        ends[Z, g] = upper[n, 1] - level_rest[n, 1]
        ends[AT_X, g], ends[AT_Z, g] = upper[n, 0], upper[n, 1]
        ends[RATE_X, g], ends[RATE_Z, g] = upper_rate[n, 0], upper_rate[n, 1]


@compiled(counted=False, fastmath=FAST_DIVISION)
def _advance(
    first, step, a, v, before, force, stiffness, pulls, keep, gain, level_rows, guy_level, on_end, level_force, acceleration,
    at_guys
):  # fmt: skip
    """Advance the rates of the mast by the forces of its guys; fill accelerations in x and z of the guys' ends."""
    for n in range(level_force.shape[0]):
        level_force[n, 0] = level_force[n, 1] = level_force[n, 2] = 0.0
    for g in range(guy_level.size):
        n = guy_level[g]
        level_force[n, 0] += on_end[0, g]
        level_force[n, 1] += on_end[2, g]
        level_force[n, 2] += on_end[1, g]
    _advance_mast(
        first, step, a, v, before, force, stiffness, pulls[2], pulls[4], keep, gain, level_rows, level_force, acceleration
    )  # fmt: skip
    for g in range(guy_level.size):
        n = guy_level[g]
        at_guys[0, g], at_guys[1, g] = acceleration[n, 0], acceleration[n, 1]


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
def _release(k, breaks, rates, on_q, on_end, chordwise, sag, least):
    """Take guys that are broken at step `k` out: they rest, carry no force, and are not watched."""
    for g in range(breaks.size):
        if k >= breaks[g]:
            for j in range(on_q.shape[0]):
                for i in range(on_q.shape[1]):
                    on_q[j, i, g] = rates[j, i, g] = 0.0
            on_end[0, g] = on_end[1, g] = on_end[2, g] = 0.0
            chordwise[g], sag[g] = least[g], 0.0


@compiled(forceinline=True)
def _stopped_by(largest, chordwise, sag, kappa, guys):
    """Return the status and the guy that has left the stable range or the finite numbers."""
    for g in range(guys):
        if not abs(chordwise[g]) * kappa[g] + sag[g] < largest:
            return UNSTABLE if abs(chordwise[g]) < np.inf else DIVERGED, g
    return DONE, 0


@compiled(noalias=True, forceinline=True)
def _save(row, a, v, before, on_end, tension, saved, saved_rates, saved_force, saved_tension):
    """Save the state at an output."""
    for i in range(a.size):
        saved[row, i] = a[i]
        saved_rates[row, 0, i], saved_rates[row, 1, i] = before[i], v[i]
    for g in range(saved_tension.shape[1]):
        saved_tension[row, g] = tension[g]
        for d in range(3):
            saved_force[row, g, d] = on_end[d, g]


@compiled(noalias=True, counted=False, forceinline=True)
def _clear(held_q, held_end):
    """Clear the drag that is held."""
    for j in range(held_q.shape[0]):
        for i in range(held_q.shape[1]):
            for g in range(held_q.shape[2]):
                held_q[j, i, g] = 0.0
    for d in range(3):
        for g in range(held_end.shape[1]):
            held_end[d, g] = 0.0


@compiled(noalias=True, counted=False, forceinline=True)
def _add(held_q, held_end, on_q, on_end):
    """Add the drag that is held to the forces on the guys."""
    for j in range(on_q.shape[0]):
        for i in range(on_q.shape[1]):
            for g in range(on_q.shape[2]):
                on_q[j, i, g] += held_q[j, i, g]
    for d in range(3):
        for g in range(on_end.shape[1]):
            on_end[d, g] += held_end[d, g]


@compiled(counted=False, fastmath=FAST_DIVISION)
def _damp(guy_damping, own, on_q, undamped):
    """Change the forces f on the coordinates (2, r, lanes) into A (f - D u), with rates u of deflections half a step before.

    With A = (1 + step / 2 D F)^-1 and the fitted factors F the damping is that of the mean rates of the step.
    """
    for part in range(2):
        for i in range(on_q.shape[1]):
            for g in range(on_q.shape[2]):
                undamped[part, i, g] = on_q[part, i, g]
            for j in range(on_q.shape[1]):
                for g in range(on_q.shape[2]):
                    undamped[part, i, g] -= guy_damping[0, part, i, j, g] * own[part, j, g]
        for i in range(on_q.shape[1]):
            for g in range(on_q.shape[2]):
                on_q[part, i, g] = 0.0
            for j in range(on_q.shape[1]):
                for g in range(on_q.shape[2]):
                    on_q[part, i, g] += guy_damping[1, part, i, j, g] * undamped[part, j, g]


@compiled(fastmath=FAST_DIVISION)
def condensed_run(
    step, every, steps, hold, window, a, v, p, rates, constant, mast_stiffness, pulls, keep, gain, level_rows, level_rest,
    heights, guy_level, breaks, lower, rest_axes, numbers, terms, kappa, moments, loads, tilt, guy_keep, guy_gain, guy_damping,
    end_mass, load_vectors, factors, samples_per_step, table, mast_wind, node_columns, node_rows, node_drag, guy_wind, guy_drag,
    sigma, shapes, slopes, saved, saved_rates, saved_coordinates, saved_force, saved_tension, saved_drag, level_extremes,
    level_sums, tension_extremes, tension_sums, monitor,
):  # fmt: skip
    """Run a mast with condensed guys from rest; return status, step and guy at which it was found.

    Parameters
    ----------
    step, every, steps, hold, window
        Step [s], steps from one output to the next, number of steps, number of those over which drag is held, first and last
        step of extremes and sums (2,).
    a, v
        Modal coordinates of the mast and their rates (modes,); changed.
    p, rates
        Coordinates of the guys and their rates (2, r, lanes), in and out of their planes; changed.
    constant, mast_stiffness, keep, gain
        Constant modal forces (modes,), stiffness and the transposed matrices A1 and A2 of the step (modes, modes).
    pulls
        See :func:`cablepod.mast._kernels_mast._advance_mast`.
    level_rows, level_rest, heights
        Displacement of the levels in x and z by the modes (levels, 2, modes), at rest (levels, 2) [m]; heights of the guys
        (lanes,) [m].
    guy_level, breaks, lower, rest_axes
        Level of each guy and the step from which on it carries no force (guys,), anchors (3, lanes) [m], axes of the guys at rest
        (9, lanes).
    numbers, terms, kappa, moments, loads, tilt
        Coefficients of the guys (..., lanes), see :mod:`cablepod.mast._kernels_guys`, those of the closure, see
        :class:`cablepod.condensed._kernels_layout.LeadingTerms`, and tilt of shapes of unit mass (2, r, r).
    guy_keep, guy_gain
        Factor of rates in a step, factors of forces (2, r, lanes).
    guy_damping
        Matrices D and A of the damping by ratios (2, 2, r, r, lanes), see :func:`_damp`; without entries: none.
    end_mass
        Mass of the upper ends without that of the coordinates, rows of force in x, y, z by acceleration in x and z (6, lanes)
        [kg].
    load_vectors, factors
        Loads on the modes (loads, modes) and their factors (loads, steps + 1), or None.
    samples_per_step, table, mast_wind, node_columns, node_rows, node_drag, guy_wind, guy_drag, sigma, shapes, slopes
        Wind: samples in a step and weights between them, at the nodes of the mast (samples, 2 nodes) and along the guys
        (samples, 3 points lanes) [m/s], see ``_kernels_mast`` and ``_kernels_guys``; None without wind.
    saved, saved_rates, saved_coordinates, saved_force, saved_tension, saved_drag
        Filled at the outputs: modal coordinates, rates half a step before and after, coordinates of the guys and such rates
        (or without rows), force on the mast and tension of each guy, drag on the nodes (or without rows).
    level_extremes, level_sums, tension_extremes, tension_sums
        Filled: extremes and their steps (4, 2 levels) and (4, lanes), sums and sums of squares (2, ...).
    monitor
        Least H of the guys [N] and its steps (2, lanes).
    """
    count, r, lanes, levels = guy_level.size, p.shape[1], p.shape[2], level_rest.shape[0]
    force, before, held, mean_rate = np.empty(a.shape), v.copy(), np.zeros(a.shape), np.empty(a.shape)
    upper, upper_rate, level_force = np.empty((levels, 2)), np.empty((levels, 2)), np.empty((levels, 3))
    acceleration, at_guys, tension = np.empty((levels, 2)), np.zeros((2, lanes)), np.empty(lanes)
    rates_before, ends, on_end = rates.copy(), np.zeros((7, lanes)), np.empty((3, lanes))
    q, on_q, own = np.empty((2, r, lanes)), np.empty((2, r, lanes)), np.zeros((2, r, lanes))
    undamped = np.empty(q.shape)
    held_q, held_end = np.zeros(q.shape), np.zeros(on_end.shape)
    points = 0 if sigma is None else sigma.size
    axes, of_forces, of_drag, others = _rows(lanes, points)
    sizes, both = _sizes_of(q), q.reshape(q.size)
    chord, stretch, chordwise, sag, end_along, end_normal, end_binormal, moved, moved_out = others
    weights, guy_air = np.empty(TAPS), np.zeros(3 * points * lanes)
    guy_air_at = guy_air.reshape((points, 3, lanes))
    flat_upper, largest = upper.reshape(levels * 2), 4.0 / (step * step)
    work = _air_work(node_drag)
    air, x, z = (None, None, None) if work is None else work
    ahead = 0.5 * hold  # from the last rates to the middle of the steps over which drag is held
    for k in range(steps + 1):
        fresh = k % hold == 0
        if mast_wind is not None and fresh:
            middle = (k + ahead - 0.5) * samples_per_step
            left = _sample_weights(middle, mast_wind.shape[0], table, weights)
            _interpolate(mast_wind, left, weights, air)
            _interpolate(guy_wind, left, weights, guy_air)
        _begin_mast(
            k, fresh, ahead, a, v, before, held, constant, load_vectors, factors, air, node_columns, node_rows, node_drag, x, z,
            level_rows, level_rest, pulls, guy_level, mean_rate, force, upper, upper_rate, ends,
        )  # fmt: skip
        _deflections(p[0], p[1], moments[0], moments[1], rest_axes, ends, moved, moved_out, q[0], q[1])
        _axes(ends, lower, heights, numbers[LENGTH], axes, chord, stretch)
        _guy_forces(
            numbers, sizes, terms, kappa[0], kappa[1], loads[0], tilt, both, q[0], q[1], axes, chord, of_forces, chordwise, sag,
            on_q[0], on_q[1], on_end[0], on_end[1], on_end[2],
        )  # fmt: skip
        _release(k, breaks, rates, on_q, on_end, chordwise, sag, monitor[0])
        if _watch(k, largest, chordwise, sag, numbers[LARGEST_KAPPA], monitor[0], monitor[1]):
            status, guy = _stopped_by(largest, chordwise, sag, numbers[LARGEST_KAPPA], count)
            if status != DONE:
                return status, k, guy
        if guy_wind is not None and fresh:
            _clear(held_q, held_end)
            _own_rates(
                ahead, rates[0], rates[1], rates_before[0], rates_before[1], moments[0], moments[1], rest_axes, ends, end_along,
                end_normal, end_binormal, own[0], own[1],
            )  # fmt: skip
            _guy_drag(
                q[0], q[1], own[0], own[1], guy_air_at, guy_drag, sigma, shapes, slopes, numbers, rest_axes, end_along,
                end_normal, end_binormal, stretch, of_drag, held_q[0], held_q[1], held_end[0], held_end[1], held_end[2],
            )  # fmt: skip
        if guy_wind is not None:
            _add(held_q, held_end, on_q, on_end)
            _release(k, breaks, rates, on_q, on_end, chordwise, sag, monitor[0])
        if guy_damping.size:
            _own_rates(
                0.0, rates[0], rates[1], rates_before[0], rates_before[1], moments[0], moments[1], rest_axes, ends, end_along,
                end_normal, end_binormal, own[0], own[1],
            )  # fmt: skip
            _damp(guy_damping, own, on_q, undamped)
            _release(k, breaks, rates, on_q, on_end, chordwise, sag, monitor[0])
        _advance_guys(
            k == 0, step, guy_keep, guy_gain[0], guy_gain[1], moments[0], moments[1], on_q[0], on_q[1], moved, moved_out,
            rates[0], rates[1], rates_before[0], rates_before[1], p[0], p[1],
        )  # fmt: skip
        _hand_over(rest_axes, moved, moved_out, on_end[0], on_end[1], on_end[2])
        _advance(
            k == 0, step, a, v, before, force, mast_stiffness, pulls, keep, gain, level_rows, guy_level, on_end, level_force,
            acceleration, at_guys,
        )  # fmt: skip
        _take_inertia(end_mass, at_guys, on_end[0], on_end[1], on_end[2], tension)
        for g in range(count):
            if k >= breaks[g]:
                on_end[0, g] = on_end[1, g] = on_end[2, g] = tension[g] = 0.0
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
            _save(k // every, a, v, before, on_end, tension, saved, saved_rates, saved_force, saved_tension)
            if mast_wind is not None:
                _save_drag(k // every, work, saved_drag)
            if saved_coordinates.shape[0]:
                saved_coordinates[k // every, 0] = q
                saved_coordinates[k // every, 1] = rates_before
                saved_coordinates[k // every, 2] = rates
        if not _is_finite(v):
            return DIVERGED, k, 0
        for i in range(a.size):
            a[i] += step * v[i]
    return DONE, steps, 0
