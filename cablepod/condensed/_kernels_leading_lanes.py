"""Compiled explicit steps to leading order of many members abreast.

Members lie in lanes, the last dimension of all arrays, and each loop over them is vectorised.  Each member has coordinates of
its own, and matrices of them; slopes and positions come from the amplitudes of the modes, a = B q, because the modes as given
are shared.  Shared are also the load patterns of a cable of unit length, whose loads are multiplied by the length.  No kernel
here reorders or fuses operations, so that the result of a member does not depend on its lane.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_frame import planar_frames_of_lanes, spatial_frames_of_lanes
from cablepod.condensed._kernels_layout import (
    DAMPING_FACTOR,
    IMPULSE,
    INVERSE_LENGTH,
    KAPPA_MAX,
    LENGTH,
    MASS,
    SAG,
    SAG_STIFFNESS,
    STIFFNESS,
    UNIFORM,
)
from cablepod.parameters._kernels_sines import (
    ROTATIONS,
    TURN_ROWS,
    ramp_ends,
    rotate,
    start_rotations,
    steps_of_ramps,
)


@compiled(noalias=True, forceinline=True)
def _close_lanes(
    step_number, modes, patterns, q, kappa, members, chord, loads, mean_chordwise_forces, geometric_stiffness_norms,
    chordwise_forces_at_candidates, chord_tension, least_force, least_force_step, largest_omega_squared,
):  # fmt: skip
    """Fill H (lanes,) [N] by the closure, and update the extremes of the run (lanes,)."""
    for m in range(chord.size):
        force = members[STIFFNESS, m] * (chord[m] / members[LENGTH, m] - 1.0)
        stretching, sag, load_frequency_bound = 0.0, 0.0, 0.0
        for i in range(len(modes)):
            stretching += kappa[i, m] * q[i, m] * q[i, m]
            sag += (kappa[i, m] * q[i, m]) * (kappa[i, m] * q[i, m])
        for a in range(len(patterns)):
            force -= loads[a, m] * mean_chordwise_forces[a]
            load_frequency_bound += abs(loads[a, m]) * geometric_stiffness_norms[a, m]
        force += members[SAG_STIFFNESS, m] * stretching
        chord_tension[m] = force
        omega_squared = (
            abs(force) * members[KAPPA_MAX, m] + load_frequency_bound + 2.0 * members[SAG_STIFFNESS, m] * sag
        )
        largest = largest_omega_squared[m]
        largest_omega_squared[m] = omega_squared if omega_squared > largest else largest
        lower, upper = force, force  # N of the lowest and of the highest link
        for a in range(len(patterns)):
            lower += loads[a, m] * chordwise_forces_at_candidates[a, 0]
            upper += loads[a, m] * chordwise_forces_at_candidates[a, 1]
        least = lower if lower < upper else upper
        is_least = least < least_force[m]
        least_force[m] = least if is_least else least_force[m]
        least_force_step[m] = step_number if is_least else least_force_step[m]


@compiled(noalias=True, forceinline=True, literal=False)
def _fill_amplitudes(modes, first, q, bases, amplitude):
    """Fill the amplitudes of the modes of one set (modes from `first` on, lanes) [m]."""
    for k in range(first, first + len(modes)):
        for m in range(q.shape[1]):
            total = 0.0
            for i in range(len(modes)):
                total += bases[k, i, m] * q[first + i, m]
            amplitude[k, m] = total


@compiled(inline="always")
def _signed_square(
    in_plane, out_of_plane, patterns, j, m, amplitude, members, chord_tension, loads, slopes, force_patterns
):
    """Return the square of the tension of a link to leading order, with its sign [N^2]: |N| N (1 + w'^2)."""
    x, y, force = 0.0, 0.0, chord_tension[m]
    for i in range(len(in_plane)):
        x += slopes[j, i] * amplitude[i, m]
    for i in range(len(out_of_plane)):
        y += slopes[j, len(in_plane) + i] * amplitude[len(in_plane) + i, m]
    for a in range(len(patterns)):
        force += force_patterns[j, a] * loads[a, m]
    return force * abs(force) * (1.0 + members[INVERSE_LENGTH, m] * members[INVERSE_LENGTH, m] * (x * x + y * y))


@compiled(noalias=True, forceinline=True)
def _update_extremes(
    in_plane, out_of_plane, patterns, amplitude, members, chord_tension, loads, slopes, force_patterns, low, high
):
    """Update the extremes of the signed squares of the link tensions (links, lanes) [N^2], which need no root."""
    for j in range(low.shape[0]):
        for m in range(low.shape[1]):
            square = _signed_square(
                in_plane, out_of_plane, patterns, j, m, amplitude, members, chord_tension, loads, slopes,
                force_patterns,
            )  # fmt: skip
            low[j, m] = square if square < low[j, m] else low[j, m]
            high[j, m] = square if square > high[j, m] else high[j, m]


@compiled(literal=False)
def _save_lanes(
    output, first, count, in_plane, out_of_plane, patterns, amplitude, members, chord_tension, loads, slopes,
    force_patterns, amplitudes, amplitudes_out_of_plane, tension_series,
):  # fmt: skip
    """Save amplitudes and tensions of `count` members from `first` on at one instant."""
    for m in range(count):
        for k in range(len(in_plane)):
            amplitudes[first + m, output, k] = amplitude[k, m]
        for k in range(len(out_of_plane)):
            amplitudes_out_of_plane[first + m, output, k] = amplitude[len(in_plane) + k, m]
    for j in range(tension_series.shape[2]):
        for m in range(count):
            square = _signed_square(
                in_plane, out_of_plane, patterns, j, m, amplitude, members, chord_tension, loads, slopes,
                force_patterns,
            )  # fmt: skip
            tension_series[first + m, output, j] = math.copysign(math.sqrt(abs(square)), square)


@compiled(literal=False)
def _save_positions(
    output, first, count, in_plane, out_of_plane, patterns, amplitude, members, chord, chord_tension, loads, ends, axes,
    normals, shapes, link_shares, rest_profile, all_slopes, all_force_patterns, positions,
):  # fmt: skip
    """Save the positions of the particles of `count` members from `first` on at one instant."""
    dims, particles = positions.shape[3], positions.shape[2]
    along, normal, binormal = np.zeros(3), np.zeros(3), np.zeros(3)
    for m in range(count):
        if len(out_of_plane) == 0 and dims == 2:
            for d in range(2):
                along[d] = (ends[2 + d, m] - ends[d, m]) / chord[m]
            normal[0], normal[1] = -along[1], along[0]
        else:
            for d in range(3):
                along[d], normal[d], binormal[d] = -axes[d, m], normals[d, m], normals[3 + d, m]
        distance = 0.0
        for p in range(particles):
            w, z = 0.0, 0.0
            for i in range(len(in_plane)):
                w += shapes[p, i] * amplitude[i, m]
            for i in range(len(out_of_plane)):
                z += shapes[p, len(in_plane) + i] * amplitude[len(in_plane) + i, m]
            for d in range(dims):
                positions[first + m, output, p, d] = ends[d, m] + distance * along[d] + w * normal[d] + z * binormal[d]
            if p < particles - 1:
                x, y, force = 0.0, 0.0, chord_tension[m]
                for i in range(len(in_plane)):
                    x += all_slopes[p, i] * amplitude[i, m]
                for i in range(len(out_of_plane)):
                    y += all_slopes[p, len(in_plane) + i] * amplitude[len(in_plane) + i, m]
                for a in range(len(patterns)):
                    force += all_force_patterns[p, a] * loads[a, m]
                factor = members[UNIFORM, m] + members[SAG, m] * rest_profile[p]
                slope_squared = factor * members[INVERSE_LENGTH, m] * members[INVERSE_LENGTH, m] * (x * x + y * y)
                stretch = 1.0 + force / members[STIFFNESS, m] - 0.5 * slope_squared
                distance += stretch * link_shares[p] * members[LENGTH, m]


@compiled(noalias=True, forceinline=True, literal=False)
def _accelerate_set(
    modes, first, patterns, first_load, q, v, kappa, members, chord_tension, loads, geometric_stiffness, load_projection
):
    """Update the rates of one set of coordinates from `first` on by a step, its loads along the normal from `first_load` on."""
    for i in range(first, first + len(modes)):
        for m in range(chord_tension.size):
            stiffness_force, load = 0.0, 0.0
            for a in range(len(patterns)):
                total = 0.0
                for j in range(len(modes)):
                    total += geometric_stiffness[a, i, first + j, m] * q[first + j, m]
                stiffness_force += loads[a, m] * total
                load += loads[first_load + a, m] * load_projection[first_load - len(patterns) + a, i, m]
            f = load - chord_tension[m] * kappa[i, m] * q[i, m] - stiffness_force
            v[i, m] = members[DAMPING_FACTOR, m] * v[i, m] + members[IMPULSE, m] * f


@compiled(noalias=True, forceinline=True)
def _move(step, q, v):
    """Move the coordinates by their rates."""
    for i in range(q.shape[0]):
        for m in range(q.shape[1]):
            q[i, m] += step * v[i, m]


@compiled
def _advance_lanes(
    first, count, in_plane, out_of_plane, patterns, steps, steps_per_second, output_steps, rows, motions, ends, load,
    reference, q, v, kappa, members, mean_chordwise_forces, geometric_stiffness, load_projection,
    geometric_stiffness_norms, chordwise_forces_at_candidates, slopes, force_patterns, bases, shapes, link_shares, rest_profile,
    all_slopes, all_force_patterns, watched, low, high, least_force, least_force_step, largest_omega_squared, amplitudes,
    amplitudes_out_of_plane, tension_series, positions,
):  # fmt: skip
    """Advance one group of lanes; see :func:`leading_lanes`."""
    lanes, next_output, step = q.shape[1], 0, 1.0 / steps_per_second
    turns, waves = np.empty((rows.size, TURN_ROWS, lanes)), np.empty((rows.size, 2, 4, lanes))
    accelerations, chord, chord_tension = np.zeros_like(ends), np.empty(lanes), np.empty(lanes)
    loads = np.empty((len(patterns) * load.shape[0], lanes))
    axes, normals = np.empty((3, lanes)), np.empty((6, lanes))
    modes = in_plane + out_of_plane
    amplitude, ramped = np.empty((len(modes), lanes)), steps_of_ramps(motions, steps_per_second)
    for i in range(steps):
        if i % (4 * ROTATIONS) == 0:
            start_rotations(i, steps_per_second, motions, turns, waves)
        if i == 0 or len(patterns) > 1:
            rotate(i, rows, turns, waves, ends, accelerations)
            if i < ramped:
                ramp_ends(i, steps_per_second, rows, motions, turns, waves, ends, accelerations)
            if reference is None:
                planar_frames_of_lanes(
                    patterns, ends, accelerations, load, members[MASS], members[LENGTH], chord, loads
                )
            else:
                spatial_frames_of_lanes(
                    patterns, ends, accelerations, load, members[MASS], members[LENGTH], reference, chord, axes,
                    normals, loads,
                )  # fmt: skip
        _close_lanes(
            i, modes, patterns, q, kappa, members, chord, loads, mean_chordwise_forces, geometric_stiffness_norms,
            chordwise_forces_at_candidates, chord_tension, least_force, least_force_step, largest_omega_squared,
        )  # fmt: skip
        is_output = next_output < output_steps.size and output_steps[next_output] == i
        is_watched = low.shape[0] > 0 and watched[0] <= i <= watched[1]
        if is_output or is_watched:
            _fill_amplitudes(in_plane, 0, q, bases, amplitude)
            _fill_amplitudes(out_of_plane, len(in_plane), q, bases, amplitude)
        if is_watched:
            _update_extremes(
                in_plane, out_of_plane, patterns, amplitude, members, chord_tension, loads, slopes, force_patterns, low,
                high,
            )  # fmt: skip
        if is_output:
            _save_lanes(
                next_output, first, count, in_plane, out_of_plane, patterns, amplitude, members, chord_tension, loads,
                slopes, force_patterns, amplitudes, amplitudes_out_of_plane, tension_series,
            )  # fmt: skip
            if positions.shape[2]:
                _save_positions(
                    next_output, first, count, in_plane, out_of_plane, patterns, amplitude, members, chord,
                    chord_tension, loads, ends, axes, normals, shapes, link_shares, rest_profile, all_slopes, all_force_patterns,
                    positions,
                )  # fmt: skip
            next_output += 1
        _accelerate_set(
            in_plane, 0, patterns, len(patterns), q, v, kappa, members, chord_tension, loads, geometric_stiffness,
            load_projection,
        )  # fmt: skip
        _accelerate_set(
            out_of_plane, len(in_plane), patterns, 2 * len(patterns), q, v, kappa, members, chord_tension, loads,
            geometric_stiffness, load_projection,
        )  # fmt: skip
        _move(step, q, v)


@compiled
def leading_lanes(
    count, in_plane, out_of_plane, patterns, steps, steps_per_second, output_steps, rows, motions, ends, load,
    reference, q, v, kappa, members, mean_chordwise_forces, geometric_stiffness, load_projection,
    geometric_stiffness_norms, chordwise_forces_at_candidates, slopes, force_patterns, bases, shapes, link_shares, rest_profile,
    all_slopes, all_force_patterns, watched, low, high, least_force, least_force_step, largest_omega_squared, amplitudes,
    amplitudes_out_of_plane, tension_series, positions,
):  # fmt: skip
    """Advance many members by velocity Verlet to leading order, as ``leading_verlet`` advances one.

    Tuples of zeros give the numbers of modes and patterns, which are constants of the compiled code.  Arrays of members have a
    leading dimension of groups, and lanes last; the last lanes of the last group may repeat a member.

    Parameters
    ----------
    count
        Number of members.
    in_plane, out_of_plane, patterns
        Tuples with an entry for each mode of both sets, and for each load pattern: two where ends move, one where none does.
    steps, steps_per_second
        Number of steps; steps per second [1/s].
    output_steps
        Steps to save (outputs,).
    rows, motions
        Coordinate of the ends that each motion moves (motions,), and its parameters (groups, motions, MOTION_ROWS, lanes), see
        :mod:`cablepod.parameters._kernels_sines`.
    ends
        Coordinates of the ends at rest (groups, 2 dims, lanes) [m]; changed.
    load, reference
        Uniform load with weight (groups, dims, lanes) [N/m]; in space, unit vector along the axis that defines the normals
        (groups, 3, lanes), else None.
    q, v
        Coordinates, and their rates half a step before (groups, r, lanes); changed.
    kappa
        Squared slope norms (groups, r, lanes).
    members
        Numbers of the members (groups, MEMBER_ROWS, lanes), rows as in ``_kernels_layout``.
    mean_chordwise_forces, geometric_stiffness, load_projection, geometric_stiffness_norms, chordwise_forces_at_candidates
        Coefficients as in ``leading_verlet`` for loads times the length.  The first, and the last for the first link and the last
        one, are those of a cable of unit length; the others (groups, ..., lanes) are those of the members.
    slopes, force_patterns
        For link tensions, of a cable of unit length: slopes of the modes as given (links, r), chordwise force patterns
        (links, patterns).
    bases
        Matrices from coordinates to amplitudes of the modes, B (groups, r, modes of a set, lanes).
    shapes, link_shares, rest_profile, all_slopes, all_force_patterns
        For positions: modes as given (particles, r), share of each link in the length (n,), profile of the squared slopes at
        rest (n,), and `slopes` and `force_patterns` of all links.
    watched
        First and last step that the extremes count (2,).
    low, high
        Extremes of the signed squares of the link tensions (groups, links, lanes) [N^2], or without links; changed.
    least_force, least_force_step, largest_omega_squared
        Least chordwise force [N], the number of its step, and largest bound of the squared frequency [1/s^2] (groups, lanes);
        changed.
    amplitudes, amplitudes_out_of_plane, tension_series, positions
        Filled: amplitudes of the modes (members, outputs, modes) [m], of planar members only the first; tensions
        (members, outputs, links) [N]; positions (members, outputs, particles, dims) [m], or without particles.
    """
    lanes = q.shape[2]
    for g in range(q.shape[0]):
        reference_of_group = None if reference is None else reference[g]
        _advance_lanes(
            g * lanes, min(lanes, count - g * lanes), in_plane, out_of_plane, patterns, steps, steps_per_second,
            output_steps, rows, motions[g], ends[g], load[g], reference_of_group, q[g], v[g], kappa[g], members[g],
            mean_chordwise_forces, geometric_stiffness[g], load_projection[g], geometric_stiffness_norms[g],
            chordwise_forces_at_candidates, slopes, force_patterns, bases[g], shapes, link_shares, rest_profile, all_slopes,
            all_force_patterns, watched, low[g], high[g], least_force[g], least_force_step[g], largest_omega_squared[g],
            amplitudes, amplitudes_out_of_plane, tension_series, positions,
        )  # fmt: skip
