"""Compiled steps to leading order by Numerov's method for two coordinates, which the processor keeps in registers."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FUSED, REORDERED_FUSED, compiled
from cablepod.condensed._kernels_layout import (
    LINK_ROWS,
    MAX_OMEGA_SQUARED,
    MIN_FORCE,
    MIN_FORCE_STEP,
    OMEGA_SQUARED_LIMIT,
    UNSTABLE_STEP,
)
from cablepod.condensed._kernels_leading import _link_tensions
from cablepod.condensed._kernels_leading_numerov import start_numerov

#: Number of steps whose loads are collected side by side.
BLOCK = 64
# Loads of a step (ROWS, BLOCK).
STRAIGHT = 0  #: H without deflection [N]
LOAD = 1  #: accelerations, two rows
LOAD_STIFFNESS = 3  #: stiffness, less a quarter of the squared damping on the diagonal, four rows
LEAST, BOUND = 7, 8  #: least chordwise force without H [N], bound of the squared frequency by the loads [1/s^2]
CANDIDATE = 9  #: work: chordwise force without H on a link [N]
ROWS = 10


@compiled(noalias=True, fastmath=REORDERED_FUSED)
def _combine(columns, first, weights, constant, total):
    """Fill `total` (rows,) with a constant plus the weighted sum of some columns (columns, rows)."""
    for i in range(total.size):
        total[i] = constant
    for a in range(weights.size):
        column, weight = columns[first + a], weights[a]
        for i in range(total.size):
            total[i] += weight * column[i]


@compiled(noalias=True, fastmath=REORDERED_FUSED)
def _combine_sizes(columns, first, weights, total):
    """Fill `total` (rows,) with the weighted sum of the sizes of some columns (columns, rows)."""
    for i in range(total.size):
        total[i] = 0.0
    for a in range(weights.size):
        column, weight = columns[first + a], weights[a]
        for i in range(total.size):
            total[i] += weight * abs(column[i])


@compiled(noalias=True, fastmath=REORDERED_FUSED)
def _straighten(chord, stiffness, length, straight):
    """Add K (c / L0 - 1) for chords c (rows,) to `straight`."""
    for i in range(chord.size):
        straight[i] += stiffness * (chord[i] / length - 1.0)


@compiled
def _collect_loads_of_rows(
    boundary_data, begin, count, stiffness, length, excess, mean_chordwise_forces, geometric_stiffness, load_projection,
    geometric_stiffness_norms, chordwise_forces_at_candidates, columns, loads,
):  # fmt: skip
    """Fill the loads (ROWS, count) of the steps from row `begin` of the boundary data on; `columns` is work."""
    patterns = mean_chordwise_forces.size
    for k in range(boundary_data.shape[1]):
        for i in range(count):
            columns[k, i] = boundary_data[begin + i, k]
    _combine(columns, 1, -mean_chordwise_forces, 0.0, loads[STRAIGHT, :count])
    _straighten(columns[0, :count], stiffness, length, loads[STRAIGHT, :count])
    for j in range(2):
        _combine(columns, 1 + patterns, load_projection[:, j], 0.0, loads[LOAD + j, :count])
        for k in range(2):
            constant = -excess if j == k else 0.0
            _combine(columns, 1, geometric_stiffness[:, j, k], constant, loads[LOAD_STIFFNESS + 2 * j + k, :count])
    _combine_sizes(columns, 1, geometric_stiffness_norms, loads[BOUND, :count])
    loads[LEAST, :count] = np.inf
    for k in range(chordwise_forces_at_candidates.shape[1]):
        _combine(columns, 1, chordwise_forces_at_candidates[:, k], 0.0, loads[CANDIDATE, :count])
        for i in range(count):
            loads[LEAST, i] = min(loads[LEAST, i], loads[CANDIDATE, i])


@compiled(inline="always")
def _force_of_two(x, y, loads, i, sag_stiffness, kappa_x, kappa_y):
    """Return H [N] and the accelerations of two coordinates without damping, plus a quarter of the squared damping times them."""
    slope_x, slope_y = kappa_x * x, kappa_y * y
    tension = loads[STRAIGHT, i] + sag_stiffness * (slope_x * x + slope_y * y)
    of_loads_x = loads[LOAD, i] - loads[LOAD_STIFFNESS, i] * x - loads[LOAD_STIFFNESS + 1, i] * y
    of_loads_y = loads[LOAD + 1, i] - loads[LOAD_STIFFNESS + 2, i] * x - loads[LOAD_STIFFNESS + 3, i] * y
    return tension, of_loads_x - tension * slope_x, of_loads_y - tension * slope_y


@compiled(fastmath=FUSED)
def numerov_of_two(
    q, v, f_before, f_before_that, step, damping, boundary_data, stiffness, length, kappa, mean_chordwise_forces,
    geometric_stiffness, load_projection, geometric_stiffness_norms, chordwise_forces_at_candidates, slopes, n_in_plane,
    chordwise_force_patterns, begin, output_steps, saved, half_step_rates, low, high, monitor,
):  # fmt: skip
    """Do :func:`cablepod.condensed._kernels_leading_numerov.leading_numerov` for two coordinates.

    The loads, which do not depend on the motion, are collected for BLOCK steps at a time.
    """
    work, loads = np.empty((LINK_ROWS, low.size)), np.empty((ROWS, BLOCK))
    columns, f = np.empty((boundary_data.shape[1], BLOCK)), np.empty(2)
    sag_stiffness, kappa_x, kappa_y = 0.5 * stiffness / length, kappa[0], kappa[1]
    kappa_max, of_sag = max(kappa_x, kappa_y), stiffness / length
    growth, excess, half_damping = math.exp(0.5 * damping * step), 0.25 * damping * damping, 0.5 * damping
    decay, half_step = 1.0 / growth, 0.5 * step
    # weights of the forces in the prediction, and of the new, the present and the last one in the impulse of a step
    ahead, of_new, of_now, of_last = step * step, step / 12.0 * growth, step / 12.0 * 10.0, step / 12.0 * decay
    x, y, v_x, v_y = q[0], q[1], v[0], v[1]
    last_x, last_y, before_x, before_y = f_before[0], f_before[1], f_before_that[0], f_before_that[1]
    f_x, f_y = 0.0, 0.0
    least, least_step = monitor[MIN_FORCE], monitor[MIN_FORCE_STEP]
    highest, limit, unstable = monitor[MAX_OMEGA_SQUARED], monitor[OMEGA_SQUARED_LIMIT], monitor[UNSTABLE_STEP]
    next_output, next_step = 0, output_steps[0] if output_steps.size else -1
    for row in range(boundary_data.shape[0]):
        i = row % BLOCK
        if i == 0:
            _collect_loads_of_rows(
                boundary_data, row, min(BLOCK, boundary_data.shape[0] - row), stiffness, length, excess,
                mean_chordwise_forces, geometric_stiffness, load_projection, geometric_stiffness_norms,
                chordwise_forces_at_candidates, columns, loads,
            )  # fmt: skip
        number = begin + row
        if row > 0:
            if number == 1:
                f[0], f[1] = f_x, f_y
                start_numerov(
                    q, v, f, f_before, f_before_that, step, damping, boundary_data, stiffness, length, kappa,
                    mean_chordwise_forces, geometric_stiffness, load_projection,
                )  # fmt: skip
                v_x, v_y, last_x, last_y = v[0], v[1], f_before[0], f_before[1]
                x, y = decay * (x + step * v_x), decay * (y + step * v_y)
            else:
                # the sums without the new force are ready before it
                known_x, known_y = v_x + of_now * f_x + of_last * last_x, v_y + of_now * f_y + of_last * last_y
                base_x, base_y = decay * (x + step * known_x), decay * (y + step * known_y)
                new_x, new_y = decay * (x + step * v_x), decay * (y + step * v_y)
                _, g_x, g_y = _force_of_two(
                    new_x + decay * ahead * f_x, new_y + decay * ahead * f_y, loads, i, sag_stiffness, kappa_x, kappa_y
                )
                v_x, v_y = known_x + of_new * g_x, known_y + of_new * g_y
                x, y = base_x + decay * step * of_new * g_x, base_y + decay * step * of_new * g_y
            v_x, v_y = v_x * decay, v_y * decay
            before_x, before_y, last_x, last_y = last_x, last_y, f_x, f_y
        tension, f_x, f_y = _force_of_two(x, y, loads, i, sag_stiffness, kappa_x, kappa_y)
        force = tension + loads[LEAST, i]
        if force < least:
            least, least_step = force, number
        omega_squared = (
            abs(tension) * kappa_max
            + loads[BOUND, i]
            + of_sag * ((kappa_x * x) * (kappa_x * x) + (kappa_y * y) * (kappa_y * y))
        )
        if omega_squared > highest:
            highest = omega_squared
            if omega_squared >= limit:
                unstable = min(unstable, number)
        if low.size:
            q[0], q[1] = x, y
            _link_tensions(
                q, boundary_data, row, tension, slopes, n_in_plane, chordwise_force_patterns, work, low, high
            )
        if number == next_step:
            rate_x, rate_y = v_x, v_y
            if number > 0:
                rate_x += step / 24.0 * (7.0 * f_x + decay * (6.0 * last_x - decay * before_x)) - half_damping * x
                rate_y += step / 24.0 * (7.0 * f_y + decay * (6.0 * last_y - decay * before_y)) - half_damping * y
            change_x = half_step * (f_x - excess * x - damping * rate_x)
            change_y = half_step * (f_y - excess * y - damping * rate_y)
            saved[next_output, 0], saved[next_output, 1] = x, y
            rates = half_step_rates[next_output]
            rates[0, 0], rates[0, 1] = rate_x - change_x, rate_y - change_y
            rates[1, 0], rates[1, 1] = rate_x + change_x, rate_y + change_y
            next_output += 1
            next_step = output_steps[next_output] if next_output < output_steps.size else -1
    q[0], q[1], v[0], v[1] = x, y, v_x, v_y
    f_before[0], f_before[1], f_before_that[0], f_before_that[1] = last_x, last_y, before_x, before_y
    monitor[MIN_FORCE], monitor[MIN_FORCE_STEP] = least, least_step
    monitor[MAX_OMEGA_SQUARED], monitor[UNSTABLE_STEP] = highest, unstable
