"""Compiled steps of the condensed model to leading order by Numerov's method, made explicit by a predictor."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_layout import LINK_ROWS
from cablepod.condensed._kernels_leading import _link_tensions, _monitor_step, _straight_tension

#: Number of corrections of the first step (the first leaves an error of fifth order).
START_CORRECTIONS = 2


@compiled(inline="always")
def _collect_loads(
    boundary_data, row, mean_chordwise_forces, geometric_stiffness, load_projection, stiffness, length, excess, load,
    load_stiffness,
):  # fmt: skip
    """Fill accelerations (r,) and stiffness (r, r) by the loads of an instant, less `excess`; return H without deflection [N]."""
    patterns = geometric_stiffness.shape[0]
    for j in range(load.size):
        total = 0.0
        for a in range(load_projection.shape[0]):
            total += boundary_data[row, 1 + patterns + a] * load_projection[a, j]
        load[j] = total
        for k in range(load.size):
            total = 0.0
            for a in range(patterns):
                total += boundary_data[row, 1 + a] * geometric_stiffness[a, j, k]
            load_stiffness[j, k] = total
        load_stiffness[j, j] -= excess
    return _straight_tension(boundary_data, row, mean_chordwise_forces, stiffness, length)


@compiled(inline="always")
def _undamped_force(q, straight, sag_stiffness, load, load_stiffness, kappa, f):
    """Fill f (r,) with the accelerations without damping plus the excess times q; return H [N]."""
    stretching = 0.0
    for j in range(q.size):
        stretching += kappa[j] * q[j] * q[j]
    chord_tension = straight + sag_stiffness * stretching
    for j in range(q.size):
        total = load[j] - chord_tension * kappa[j] * q[j]
        for k in range(q.size):
            total -= load_stiffness[j, k] * q[k]
        f[j] = total
    return chord_tension


@compiled
def start_numerov(
    q, v, f, f_before, second, step, damping, boundary_data, stiffness, length, kappa, mean_chordwise_forces,
    geometric_stiffness, load_projection,
):  # fmt: skip
    """Change v from the rates at the start to (u(h) - u) / h, and fill f_before with the force one step before, extrapolated.

    `f` are the forces at the start, `second` is work (r,); the others as in :func:`leading_numerov`.
    """
    r, last_row = q.size, boundary_data.shape[0] - 1
    vectors, load_stiffness = np.empty((3, r)), np.empty((r, r))
    new_q, new_f, load = vectors
    sag_stiffness = 0.5 * stiffness / length
    growth, excess, half_damping = math.exp(0.5 * damping * step), 0.25 * damping * damping, 0.5 * damping
    decay = 1.0 / growth
    for j in range(r):
        v[j] += half_damping * q[j]
        f_before[j] = v[j] + 0.5 * step * f[j]
    for _ in range(START_CORRECTIONS):
        for j in range(r):
            new_q[j] = decay * (q[j] + step * f_before[j])
        straight = _collect_loads(
            boundary_data, 1, mean_chordwise_forces, geometric_stiffness, load_projection, stiffness, length, excess,
            load, load_stiffness,
        )  # fmt: skip
        _undamped_force(new_q, straight, sag_stiffness, load, load_stiffness, kappa, new_f)
        for j in range(r):
            new_f[j] *= growth
            new_q[j] = decay * decay * (q[j] + step * (2.0 * f_before[j] + step * new_f[j]))
        straight = _collect_loads(
            boundary_data, min(2, last_row), mean_chordwise_forces, geometric_stiffness, load_projection, stiffness,
            length, excess, load, load_stiffness,
        )  # fmt: skip
        _undamped_force(new_q, straight, sag_stiffness, load, load_stiffness, kappa, second)
        for j in range(r):
            second[j] *= growth * growth
            f_before[j] = v[j] + step / 24.0 * (7.0 * f[j] + 6.0 * new_f[j] - second[j])
    for j in range(r):
        v[j] = f_before[j]
        f_before[j] = growth * (3.0 * f[j] - 3.0 * new_f[j] + second[j])


@compiled
def leading_numerov(
    q, v, f_before, f_before_that, step, damping, boundary_data, stiffness, length, kappa, mean_chordwise_forces,
    geometric_stiffness, load_projection, geometric_stiffness_norms, chordwise_forces_at_candidates, slopes, n_in_plane,
    chordwise_force_patterns, begin, output_steps, saved, half_step_rates, low, high, monitor,
):  # fmt: skip
    """Advance by Numerov's method with an explicit prediction of the new force, to leading order.

    Without the damping c, u = exp(c t / 2) q obeys u'' = g with the force g of q plus c^2 q / 4.  With the prediction
    u(t + h) = 2 u - u(t - h) + h^2 g,

        u(t + h) - 2 u + u(t - h) = h^2 / 12 (g(t + h) + 10 g + g(t - h))

    is of fourth order, stable below sqrt(12) over the highest angular frequency, and errs by (omega h)^4 / 720 of the phase.
    Rates follow from u' = (u - u(t - h)) / h + h / 24 (7 g + 6 g(t - h) - g(t - 2 h)).  The first step is that of the parabola
    through g at the first three instants.

    Parameters
    ----------
    q
        Coordinates (r,); changed.
    v
        At the start their rates; later, and on return, (u - u(t - h)) / h for u = q now (r,).
    f_before, f_before_that
        Forces plus c^2 q / 4 one step and two steps before (r,); changed.
    step, damping
        h [s] and c [1/s].
    boundary_data, stiffness, ..., monitor
        As in :func:`cablepod.condensed._kernels_leading.leading_verlet`; the last row is the first of the next block.

    Notes
    -----
    M. M. Chawla, Numerov made explicit has better stability, BIT 24, 117 (1984).
    """
    r, last_row, next_output = q.size, boundary_data.shape[0] - 1, 0
    work, vectors, load_stiffness = np.empty((LINK_ROWS, low.size)), np.empty((4, r)), np.empty((r, r))
    f, new_q, new_f, load = vectors
    sag_stiffness = 0.5 * stiffness / length
    growth, excess, half_damping = math.exp(0.5 * damping * step), 0.25 * damping * damping, 0.5 * damping
    decay = 1.0 / growth
    straight = _collect_loads(
        boundary_data, 0, mean_chordwise_forces, geometric_stiffness, load_projection, stiffness, length, excess, load,
        load_stiffness,
    )  # fmt: skip
    for i in range(boundary_data.shape[0]):
        chord_tension = _undamped_force(q, straight, sag_stiffness, load, load_stiffness, kappa, f)
        _monitor_step(
            begin + i, q, boundary_data, i, chord_tension, kappa, geometric_stiffness_norms,
            chordwise_forces_at_candidates, stiffness, length, monitor,
        )  # fmt: skip
        if low.size:
            _link_tensions(
                q, boundary_data, i, chord_tension, slopes, n_in_plane, chordwise_force_patterns, work, low, high
            )
        at_start = begin + i == 0
        if next_output < output_steps.size and output_steps[next_output] == begin + i:
            for j in range(r):
                rate = v[j]
                if not at_start:
                    rate += step / 24.0 * (7.0 * f[j] + decay * (6.0 * f_before[j] - decay * f_before_that[j]))
                    rate -= half_damping * q[j]
                change = 0.5 * step * (f[j] - excess * q[j] - damping * rate)
                saved[next_output, j] = q[j]
                half_step_rates[next_output, 0, j] = rate - change
                half_step_rates[next_output, 1, j] = rate + change
            next_output += 1
        if i == last_row:
            break
        if at_start:
            start_numerov(
                q, v, f, f_before, f_before_that, step, damping, boundary_data, stiffness, length, kappa,
                mean_chordwise_forces, geometric_stiffness, load_projection,
            )  # fmt: skip
        straight = _collect_loads(
            boundary_data, i + 1, mean_chordwise_forces, geometric_stiffness, load_projection, stiffness, length, excess,
            load, load_stiffness,
        )  # fmt: skip
        if not at_start:
            for j in range(r):
                new_q[j] = decay * (q[j] + step * (v[j] + step * f[j]))
            _undamped_force(new_q, straight, sag_stiffness, load, load_stiffness, kappa, new_f)
            for j in range(r):
                v[j] += step / 12.0 * (growth * new_f[j] + 10.0 * f[j] + decay * f_before[j])
        for j in range(r):
            q[j] = decay * (q[j] + step * v[j])
            v[j] *= decay
            f_before_that[j], f_before[j] = f_before[j], f[j]
