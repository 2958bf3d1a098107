"""Compiled steps to leading order of many members abreast by Numerov's method, as ``leading_numerov`` advances one.

Members lie in lanes, the last dimension of all arrays; see :mod:`cablepod.condensed._kernels_leading_lanes`.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_frame import planar_frames_of_lanes, spatial_frames_of_lanes
from cablepod.condensed._kernels_layout import LENGTH, MASS, SAG_STIFFNESS, STIFFNESS
from cablepod.condensed._kernels_leading_lanes import _close_lanes, _fill_amplitudes, _update_extremes
from cablepod.condensed._kernels_leading_numerov import START_CORRECTIONS
from cablepod.parameters._kernels_sines import (
    ROTATIONS,
    TURN_ROWS,
    ramp_ends,
    rotate,
    start_rotations,
    steps_of_ramps,
)


@compiled
def _boundary_data_of_step(
    i, patterns, steps_per_second, ramped, rows, motions, turns, waves, ends, accelerations, load, members, reference,
    chord, axes, normals, loads,
):  # fmt: skip
    """Fill chord lengths (lanes,) [m] and loads times the length (rows, lanes) [N] of a step; steps must follow each other."""
    if i > 0 and len(patterns) == 1:  # no end moves
        return
    if i % (4 * ROTATIONS) == 0:
        start_rotations(i, steps_per_second, motions, turns, waves)
    rotate(i, rows, turns, waves, ends, accelerations)
    if i < ramped:
        ramp_ends(i, steps_per_second, rows, motions, turns, waves, ends, accelerations)
    if reference is None:
        planar_frames_of_lanes(patterns, ends, accelerations, load, members[MASS], members[LENGTH], chord, loads)
    else:
        spatial_frames_of_lanes(
            patterns, ends, accelerations, load, members[MASS], members[LENGTH], reference, chord, axes, normals, loads
        )


@compiled(noalias=True, forceinline=True)
def _chord_tensions(modes, patterns, q, kappa, members, chord, loads, mean_chordwise_forces, chord_tension):
    """Fill H (lanes,) [N] by the closure."""
    for m in range(chord.size):
        force = members[STIFFNESS, m] * (chord[m] / members[LENGTH, m] - 1.0)
        stretching = 0.0
        for i in range(len(modes)):
            stretching += kappa[i, m] * q[i, m] * q[i, m]
        for a in range(len(patterns)):
            force -= loads[a, m] * mean_chordwise_forces[a]
        chord_tension[m] = force + members[SAG_STIFFNESS, m] * stretching


@compiled(noalias=True, forceinline=True, literal=False)
def _forces_of_set(
    modes, first, patterns, first_load, q, kappa, excess, chord_tension, loads, geometric_stiffness, load_projection, f
):
    """Fill the undamped accelerations plus the excess times q of one set of coordinates from `first` on (r, lanes)."""
    for i in range(first, first + len(modes)):
        for m in range(chord_tension.size):
            stiffness_force, load = 0.0, 0.0
            for a in range(len(patterns)):
                total = 0.0
                for j in range(len(modes)):
                    total += geometric_stiffness[a, i, first + j, m] * q[first + j, m]
                stiffness_force += loads[a, m] * total
                load += loads[first_load + a, m] * load_projection[first_load - len(patterns) + a, i, m]
            f[i, m] = load - (chord_tension[m] * kappa[i, m] - excess[m]) * q[i, m] - stiffness_force


@compiled
def _forces(
    in_plane, out_of_plane, patterns, q, kappa, excess, chord_tension, loads, geometric_stiffness, load_projection, f
):
    """Fill the undamped accelerations plus the excess times q of all coordinates (r, lanes)."""
    _forces_of_set(
        in_plane, 0, patterns, len(patterns), q, kappa, excess, chord_tension, loads, geometric_stiffness,
        load_projection, f,
    )  # fmt: skip
    _forces_of_set(
        out_of_plane, len(in_plane), patterns, 2 * len(patterns), q, kappa, excess, chord_tension, loads,
        geometric_stiffness, load_projection, f,
    )  # fmt: skip


@compiled(noalias=True, forceinline=True)
def _predict(step, decay, q, v, f, new_q):
    """Fill the coordinates one step later to second order (r, lanes)."""
    for j in range(q.shape[0]):
        for m in range(q.shape[1]):
            new_q[j, m] = decay[m] * (q[j, m] + step * (v[j, m] + step * f[j, m]))


@compiled(noalias=True, forceinline=True)
def _add_impulse(step, growth, decay, f, f_before, new_f, v):
    """Add the fourth-order impulse of a step to the differences `v` (r, lanes)."""
    for j in range(v.shape[0]):
        for m in range(v.shape[1]):
            v[j, m] += step / 12.0 * (growth[m] * new_f[j, m] + 10.0 * f[j, m] + decay[m] * f_before[j, m])


@compiled(noalias=True, forceinline=True)
def _move_damped(step, decay, q, v, f, f_before, f_before_that):
    """Move the coordinates by their differences, damp both by half a step's damping, and keep the forces (r, lanes)."""
    for j in range(q.shape[0]):
        for m in range(q.shape[1]):
            q[j, m] = decay[m] * (q[j, m] + step * v[j, m])
            v[j, m] *= decay[m]
            f_before_that[j, m] = f_before[j, m]
            f_before[j, m] = f[j, m]


@compiled(literal=False)
def _save_states(
    output, first, count, at_start, step, damping, decay, q, v, f, f_before, f_before_that, members, chord, loads, saved,
    half_step_rates, boundary_data,
):  # fmt: skip
    """Save coordinates, rates half a step before and after, and boundary data of `count` members at one instant."""
    for m in range(count):
        excess = 0.25 * damping[m] * damping[m]
        for j in range(q.shape[0]):
            rate = v[j, m]
            if not at_start:
                earlier = 6.0 * f_before[j, m] - decay[m] * f_before_that[j, m]
                rate += step / 24.0 * (7.0 * f[j, m] + decay[m] * earlier) - 0.5 * damping[m] * q[j, m]
            change = 0.5 * step * (f[j, m] - excess * q[j, m] - damping[m] * rate)
            saved[first + m, output, j] = q[j, m]
            half_step_rates[first + m, output, 0, j] = rate - change
            half_step_rates[first + m, output, 1, j] = rate + change
        if boundary_data.shape[1]:
            boundary_data[first + m, output, 0] = chord[m]
            for row in range(loads.shape[0]):
                boundary_data[first + m, output, 1 + row] = loads[row, m] / members[LENGTH, m]


@compiled
def _advance_lanes(
    first, count, in_plane, out_of_plane, patterns, steps, steps_per_second, output_steps, rows, motions, ends, load,
    reference, q, v, damping, kappa, members, mean_chordwise_forces, geometric_stiffness, load_projection,
    geometric_stiffness_norms, chordwise_forces_at_candidates, slopes, force_patterns, bases, watched, low, high, least_force,
    least_force_step, largest_omega_squared, saved, half_step_rates, boundary_data,
):  # fmt: skip
    """Advance one group of lanes; see :func:`leading_numerov_lanes`."""
    (r, lanes), next_output, step = q.shape, 0, 1.0 / steps_per_second
    turns, waves = np.empty((rows.size, TURN_ROWS, lanes)), np.empty((rows.size, 2, 4, lanes))
    accelerations, chord, chord_tension = np.zeros_like(ends), np.empty(lanes), np.empty(lanes)
    loads = np.empty((len(patterns) * load.shape[0], lanes))
    axes, normals = np.empty((3, lanes)), np.empty((6, lanes))
    modes = in_plane + out_of_plane
    amplitude, f, new_q, new_f = np.empty((r, lanes)), np.empty((r, lanes)), np.empty((r, lanes)), np.empty((r, lanes))
    f_before, f_before_that = np.zeros((r, lanes)), np.zeros((r, lanes))
    growth, decay, excess = np.empty(lanes), np.empty(lanes), np.empty(lanes)
    ramped = steps_of_ramps(motions, steps_per_second)
    early_chords, early_loads = np.empty((3, lanes)), np.empty((3, *loads.shape))
    for m in range(lanes):
        growth[m] = math.exp(0.5 * damping[m] * step)
        decay[m] = 1.0 / growth[m]
        excess[m] = 0.25 * damping[m] * damping[m]
    for i in range(3):  # the first step needs the loads of three instants
        _boundary_data_of_step(
            i, patterns, steps_per_second, ramped, rows, motions, turns, waves, ends, accelerations, load, members,
            reference, chord, axes, normals, loads,
        )  # fmt: skip
        early_chords[i], early_loads[i] = chord, loads
    for i in range(steps + 1):
        if i < 3:
            chord[:], loads[:] = early_chords[i], early_loads[i]
        else:
            _boundary_data_of_step(
                i, patterns, steps_per_second, ramped, rows, motions, turns, waves, ends, accelerations, load, members,
                reference, chord, axes, normals, loads,
            )  # fmt: skip
        if i > 1:
            _predict(step, decay, q, v, f, new_q)
            _chord_tensions(modes, patterns, new_q, kappa, members, chord, loads, mean_chordwise_forces, chord_tension)
            _forces(
                in_plane, out_of_plane, patterns, new_q, kappa, excess, chord_tension, loads, geometric_stiffness,
                load_projection, new_f,
            )  # fmt: skip
            _add_impulse(step, growth, decay, f, f_before, new_f, v)
        if i > 0:
            _move_damped(step, decay, q, v, f, f_before, f_before_that)
        _close_lanes(
            i, modes, patterns, q, kappa, members, chord, loads, mean_chordwise_forces, geometric_stiffness_norms,
            chordwise_forces_at_candidates, chord_tension, least_force, least_force_step, largest_omega_squared,
        )  # fmt: skip
        if low.shape[0] and watched[0] <= i <= watched[1]:
            _fill_amplitudes(in_plane, 0, q, bases, amplitude)
            _fill_amplitudes(out_of_plane, len(in_plane), q, bases, amplitude)
            _update_extremes(
                in_plane, out_of_plane, patterns, amplitude, members, chord_tension, loads, slopes, force_patterns, low,
                high,
            )  # fmt: skip
        _forces(
            in_plane, out_of_plane, patterns, q, kappa, excess, chord_tension, loads, geometric_stiffness,
            load_projection, f,
        )  # fmt: skip
        if next_output < output_steps.size and output_steps[next_output] == i:
            _save_states(
                next_output, first, count, i == 0, step, damping, decay, q, v, f, f_before, f_before_that, members,
                chord, loads, saved, half_step_rates, boundary_data,
            )  # fmt: skip
            next_output += 1
        if i == 0:  # v becomes (u(h) - u) / h, and f_before the force extrapolated to one step before
            for j in range(r):
                for m in range(lanes):
                    v[j, m] += 0.5 * damping[m] * q[j, m]
                    f_before[j, m] = v[j, m] + 0.5 * step * f[j, m]
            for _ in range(START_CORRECTIONS):
                for j in range(r):
                    for m in range(lanes):
                        new_q[j, m] = decay[m] * (q[j, m] + step * f_before[j, m])
                _chord_tensions(
                    modes, patterns, new_q, kappa, members, early_chords[1], early_loads[1], mean_chordwise_forces,
                    chord_tension,
                )  # fmt: skip
                _forces(
                    in_plane, out_of_plane, patterns, new_q, kappa, excess, chord_tension, early_loads[1],
                    geometric_stiffness, load_projection, new_f,
                )  # fmt: skip
                for j in range(r):
                    for m in range(lanes):
                        new_f[j, m] *= growth[m]
                        new_q[j, m] = (
                            decay[m] * decay[m] * (q[j, m] + step * (2.0 * f_before[j, m] + step * new_f[j, m]))
                        )
                _chord_tensions(
                    modes, patterns, new_q, kappa, members, early_chords[2], early_loads[2], mean_chordwise_forces,
                    chord_tension,
                )  # fmt: skip
                _forces(
                    in_plane, out_of_plane, patterns, new_q, kappa, excess, chord_tension, early_loads[2],
                    geometric_stiffness, load_projection, f_before_that,
                )  # fmt: skip
                for j in range(r):
                    for m in range(lanes):
                        f_before_that[j, m] *= growth[m] * growth[m]
                        f_before[j, m] = v[j, m] + step / 24.0 * (
                            7.0 * f[j, m] + 6.0 * new_f[j, m] - f_before_that[j, m]
                        )
            for j in range(r):
                for m in range(lanes):
                    v[j, m] = f_before[j, m]
                    f_before[j, m] = growth[m] * (3.0 * f[j, m] - 3.0 * new_f[j, m] + f_before_that[j, m])


@compiled
def leading_numerov_lanes(
    count, in_plane, out_of_plane, patterns, steps, steps_per_second, output_steps, rows, motions, ends, load,
    reference, q, v, damping, kappa, members, mean_chordwise_forces, geometric_stiffness, load_projection,
    geometric_stiffness_norms, chordwise_forces_at_candidates, slopes, force_patterns, bases, watched, low, high, least_force,
    least_force_step, largest_omega_squared, saved, half_step_rates, boundary_data,
):  # fmt: skip
    """Advance many members by Numerov's method with an explicit prediction of the new force, to leading order.

    The formulas are those of :func:`cablepod.condensed._kernels_leading_numerov.leading_numerov`, the arrays those of
    :func:`cablepod.condensed._kernels_leading_lanes.leading_lanes` except for the following.

    Parameters
    ----------
    steps
        Number of steps, at least 2.
    q, v
        Coordinates and rates at the start (groups, r, lanes); changed.
    damping
        Mass-proportional damping (groups, lanes) [1/s].
    watched
        First and last step that the extremes count (2,).
    low, high
        Extremes of the signed squares of the link tensions (groups, links, lanes) [N^2], or without links; changed.
    saved, half_step_rates
        Filled: coordinates (members, outputs, r), and rates half a step before and after (members, outputs, 2, r).
    boundary_data
        Filled: boundary data at the outputs (members, outputs, 1 + patterns dims), columns as in
        :func:`cablepod.condensed._kernels_frame.frames`; or without outputs.
    """
    lanes = q.shape[2]
    for g in range(q.shape[0]):
        reference_of_group = None if reference is None else reference[g]
        _advance_lanes(
            g * lanes, min(lanes, count - g * lanes), in_plane, out_of_plane, patterns, steps, steps_per_second,
            output_steps, rows, motions[g], ends[g], load[g], reference_of_group, q[g], v[g], damping[g], kappa[g],
            members[g], mean_chordwise_forces, geometric_stiffness[g], load_projection[g], geometric_stiffness_norms[g],
            chordwise_forces_at_candidates, slopes, force_patterns, bases[g], watched, low[g], high[g], least_force[g],
            least_force_step[g], largest_omega_squared[g], saved, half_step_rates, boundary_data,
        )  # fmt: skip
