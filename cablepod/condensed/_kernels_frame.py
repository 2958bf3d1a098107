"""Compiled boundary data of the chord frame: chord length and projected loads."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled


@compiled(inline="always")
def _complete_axes(axes, dims, reference):
    """Change the vector in the first row of `axes` (dims, dims) into a direction, fill its normals; return its length [m]."""
    chord = 0.0
    for d in range(dims):
        chord += axes[0, d] * axes[0, d]
    chord = math.sqrt(chord)
    inverse = 1.0 / chord
    for d in range(dims):
        axes[0, d] *= inverse
    if dims == 2:
        axes[1, 0], axes[1, 1] = axes[0, 1], -axes[0, 0]
        return chord
    cosine = axes[0, reference]
    inverse = 1.0 / math.sqrt(1.0 - cosine * cosine)
    for d in range(3):
        axes[1, d] = ((1.0 if d == reference else 0.0) - cosine * axes[0, d]) * inverse
    for d in range(3):
        j, k = (d + 1) % 3, (d + 2) % 3
        axes[2, d] = axes[1, j] * axes[0, k] - axes[1, k] * axes[0, j]
    return chord


@compiled(inline="always")
def _planar_frames(ends, end_accelerations, load, point_loads, mass, boundary_data):
    """Fill the boundary data of planar scenes as :func:`frames` does, bit for bit, four times as fast (numbers in registers)."""
    moving = end_accelerations.shape[1] > 0
    first_point = 3 if moving else 2
    patterns = first_point - 1 + point_loads.shape[0]
    for i in range(boundary_data.shape[0]):
        x, y = ends[0, i] - ends[2, i], ends[1, i] - ends[3, i]  # from the upper end to the lower one
        chord = math.sqrt(x * x + y * y)
        inverse = 1.0 / chord
        x *= inverse
        y *= inverse
        k = i if load.shape[1] > 1 else 0
        effective_x, effective_y = load[0, k], load[1, k]
        if moving:
            effective_x -= mass * end_accelerations[0, i]
            effective_y -= mass * end_accelerations[1, i]
            growing_x, growing_y = (
                mass * (end_accelerations[0, i] - end_accelerations[2, i]),
                mass * (end_accelerations[1, i] - end_accelerations[3, i]),
            )
            boundary_data[i, 2] = growing_x * x + growing_y * y
            boundary_data[i, 2 + patterns] = growing_x * y - growing_y * x
        boundary_data[i, 0] = chord
        boundary_data[i, 1] = effective_x * x + effective_y * y
        boundary_data[i, 1 + patterns] = effective_x * y - effective_y * x
        k = i if point_loads.shape[2] > 1 else 0
        for j in range(point_loads.shape[0]):
            boundary_data[i, first_point + j] = point_loads[j, 0, k] * x + point_loads[j, 1, k] * y
            boundary_data[i, first_point + patterns + j] = point_loads[j, 0, k] * y - point_loads[j, 1, k] * x


@compiled
def frames(ends, end_accelerations, load, point_loads, reference, mass, boundary_data):
    """Compute chord length and projected loads for each step.

    Parameters
    ----------
    ends
        Positions of the ends, all coordinates of the lower one first (2 dims, steps) [m].
    end_accelerations
        Their accelerations, plus mass damping times their velocities (2 dims, steps) [m/s^2]; no columns where no end moves.
    load, point_loads
        Uniform load with weight (dims, steps or 1) [N/m]; point loads (loads, dims, steps or 1) [N].
    reference
        Axis that defines the normals in spatial scenes: the first normal is the one closest to it.
    mass
        Mass per unstretched length [kg/m].
    boundary_data
        Filled: (steps, 1 + patterns dims): chord length [m], then the load patterns along the chord from the upper end to the
        lower one, then those along each normal.  Patterns: uniform load, inertia that grows with sigma (moving ends only)
        [N/m], point loads [N].
    """
    dims, n_points = load.shape[0], point_loads.shape[0]
    if dims == 2:
        _planar_frames(ends, end_accelerations, load, point_loads, mass, boundary_data)
        return
    moving = end_accelerations.shape[1] > 0
    first_point = 3 if moving else 2
    patterns = first_point - 1 + n_points
    work = np.zeros((5, 3))
    axes, effective_load, growing_load = (
        work[:3],
        work[3],
        work[4],
    )  # direction from the upper end to the lower one, both normals
    for i in range(boundary_data.shape[0]):
        for d in range(dims):
            axes[0, d] = ends[d, i] - ends[dims + d, i]
        boundary_data[i, 0] = _complete_axes(axes, dims, reference)
        k = i if load.shape[1] > 1 else 0
        for d in range(dims):
            effective_load[d] = load[d, k]
            if moving:
                effective_load[d] -= mass * end_accelerations[d, i]
                growing_load[d] = mass * (end_accelerations[d, i] - end_accelerations[dims + d, i])
        column = 1
        for axis in range(dims):
            along, growing = 0.0, 0.0
            for d in range(dims):
                along += effective_load[d] * axes[axis, d]
                growing += growing_load[d] * axes[axis, d]
            boundary_data[i, column] = along
            if moving:
                boundary_data[i, column + 1] = growing
            column += patterns
        k = i if point_loads.shape[2] > 1 else 0
        for j in range(n_points):
            for axis in range(dims):
                along = 0.0
                for d in range(dims):
                    along += point_loads[j, d, k] * axes[axis, d]
                boundary_data[i, first_point + axis * patterns + j] = along


# --- lanes: members side by side, in the last dimension of all arrays ---------------------------------------------------


@compiled(noalias=True, forceinline=True)
def planar_frames_of_lanes(lanes, patterns, ends, end_accelerations, load, mass, rows, at):
    """Fill the boundary data of one step of planar members, as :func:`frames` does for many steps of one.

    Parameters
    ----------
    lanes, patterns
        Tuples with an entry for each lane and load pattern: two patterns where ends move, one where none does.
    ends, end_accelerations, load, mass
        As in :func:`frames`, for one step: (4, lanes), (4, lanes), (2, lanes), (lanes,).
    rows, at
        Boundary data (steps, columns, lanes), flat, and the index of the step there; filled.
    """
    width, count = len(lanes), len(patterns)
    for m in range(width):
        x, y = ends[0, m] - ends[2, m], ends[1, m] - ends[3, m]
        distance = math.sqrt(x * x + y * y)
        inverse = 1.0 / distance
        x *= inverse
        y *= inverse
        load_x, load_y = load[0, m], load[1, m]
        if count > 1:
            load_x -= mass[m] * end_accelerations[0, m]
            load_y -= mass[m] * end_accelerations[1, m]
            growing_x = mass[m] * (end_accelerations[0, m] - end_accelerations[2, m])
            growing_y = mass[m] * (end_accelerations[1, m] - end_accelerations[3, m])
            rows[at + 2 * width + m] = growing_x * x + growing_y * y
            rows[at + (2 + count) * width + m] = growing_x * y - growing_y * x
        rows[at + m] = distance
        rows[at + width + m] = load_x * x + load_y * y
        rows[at + (1 + count) * width + m] = load_x * y - load_y * x


@compiled(noalias=True, forceinline=True)
def spatial_frames_of_lanes(lanes, patterns, ends, end_accelerations, load, mass, reference, axes, rows, at):
    """Fill the boundary data of one step of spatial members, as :func:`planar_frames_of_lanes` of planar ones.

    `reference` is the unit vector along the axis that defines the normals (3, lanes), `axes` a work array (9, lanes): the
    direction from the upper end to the lower one, both normals.
    """
    width, count = len(lanes), len(patterns)
    for m in range(width):
        x, y, z = ends[0, m] - ends[3, m], ends[1, m] - ends[4, m], ends[2, m] - ends[5, m]
        distance = math.sqrt(x * x + y * y + z * z)
        inverse = 1.0 / distance
        rows[at + m], axes[0, m], axes[1, m], axes[2, m] = distance, x * inverse, y * inverse, z * inverse
    for m in range(width):
        x, y, z = axes[0, m], axes[1, m], axes[2, m]
        a, b, c = reference[0, m], reference[1, m], reference[2, m]
        cosine = a * x + b * y + c * z
        inverse = 1.0 / math.sqrt(1.0 - cosine * cosine)
        a, b, c = (a - cosine * x) * inverse, (b - cosine * y) * inverse, (c - cosine * z) * inverse
        axes[3, m], axes[4, m], axes[5, m] = a, b, c
        axes[6, m], axes[7, m], axes[8, m] = b * z - c * y, c * x - a * z, a * y - b * x
    for k in range(3):
        for m in range(width):
            x, y, z = axes[3 * k, m], axes[3 * k + 1, m], axes[3 * k + 2, m]
            load_x, load_y, load_z = load[0, m], load[1, m], load[2, m]
            if count > 1:
                load_x -= mass[m] * end_accelerations[0, m]
                load_y -= mass[m] * end_accelerations[1, m]
                load_z -= mass[m] * end_accelerations[2, m]
                growing_x = mass[m] * (end_accelerations[0, m] - end_accelerations[3, m])
                growing_y = mass[m] * (end_accelerations[1, m] - end_accelerations[4, m])
                growing_z = mass[m] * (end_accelerations[2, m] - end_accelerations[5, m])
                rows[at + (2 + k * count) * width + m] = growing_x * x + growing_y * y + growing_z * z
            rows[at + (1 + k * count) * width + m] = load_x * x + load_y * y + load_z * z
