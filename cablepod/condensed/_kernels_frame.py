"""Compiled boundary data of the chord frame, chord length and projected loads, also of members side by side."""

import math

from cablepod._jit import compiled
from cablepod.parameters._kernels_sines import ROTATIONS, ramp_ends, rotate, start_rotations, steps_of_ramps


@compiled(forceinline=True, counted=False)
def _spatial_axes(x, y, z, a, b, c):
    """Return the length [m] of a vector (x, y, z), its direction and normals, the first closest to the unit vector (a, b, c)."""
    distance = math.sqrt(x * x + y * y + z * z)
    inverse = 1.0 / distance
    x, y, z = x * inverse, y * inverse, z * inverse
    cosine = a * x + b * y + c * z
    inverse = 1.0 / math.sqrt(1.0 - cosine * cosine)
    a, b, c = (a - cosine * x) * inverse, (b - cosine * y) * inverse, (c - cosine * z) * inverse
    return distance, x, y, z, a, b, c, b * z - c * y, c * x - a * z, a * y - b * x


@compiled(inline="always")
def _complete_axes(axes, dims, reference):
    """Change the vector in the first row of `axes` (dims, dims) into a direction, fill its normals; return its length [m].

    In space the first normal is the one closest to the unit vector `reference`.
    """
    x, y = axes[0, 0], axes[0, 1]
    if dims == 2:
        chord = math.sqrt(x * x + y * y)
        axes[0, 0], axes[0, 1] = x / chord, y / chord
        axes[1, 0], axes[1, 1] = axes[0, 1], -axes[0, 0]
        return chord
    (
        chord, axes[0, 0], axes[0, 1], axes[0, 2], axes[1, 0], axes[1, 1], axes[1, 2], axes[2, 0], axes[2, 1], axes[2, 2]
    ) = _spatial_axes(x, y, axes[0, 2], reference[0], reference[1], reference[2])  # fmt: skip
    return chord


@compiled(noalias=True, forceinline=True)
def planar_frames_of_lanes(lanes, patterns, ends, end_accelerations, load, mass, row):
    """Fill chord lengths and projected loads in the plane, side by side: of members at a step, or of a cable at many instants.

    Parameters
    ----------
    lanes, patterns
        Sequences with an entry for each lane and load pattern: two patterns where ends move, one where none does.
    ends, end_accelerations
        Coordinates of the ends, all of the lower one first (4, lanes) [m]; their accelerations, plus mass damping times their
        velocities (4, lanes) [m/s^2].
    load, mass
        Uniform load with weight (2, lanes) [N/m], mass per unstretched length (lanes,) [kg/m].
    row
        Boundary data of the step (columns, lanes), flat; filled.  Columns: chord length [m], then the load patterns along the
        chord from the upper end to the lower one, then those along each normal: uniform load, inertia that grows with the
        relative arc length [N/m].
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
            row[2 * width + m] = growing_x * x + growing_y * y
            row[(2 + count) * width + m] = growing_x * y - growing_y * x
        row[m] = distance
        row[width + m] = load_x * x + load_y * y
        row[(1 + count) * width + m] = load_x * y - load_y * x


@compiled(noalias=True, forceinline=True)
def spatial_frames_of_lanes(lanes, patterns, ends, end_accelerations, load, mass, reference, axes, row):
    """Fill the boundary data of one step of spatial members, as :func:`planar_frames_of_lanes` of planar ones.

    `reference` are unit vectors, to which the first normals are closest (3, lanes), `axes` a work array (9, lanes): the
    direction from the upper end to the lower one, both normals.
    """
    width, count = len(lanes), len(patterns)
    for m in range(width):
        (
            row[m], axes[0, m], axes[1, m], axes[2, m], axes[3, m], axes[4, m], axes[5, m], axes[6, m], axes[7, m], axes[8, m]
        ) = _spatial_axes(
            ends[0, m] - ends[3, m], ends[1, m] - ends[4, m], ends[2, m] - ends[5, m],
            reference[0, m], reference[1, m], reference[2, m],
        )  # fmt: skip
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
                row[(2 + k * count) * width + m] = growing_x * x + growing_y * y + growing_z * z
            row[(1 + k * count) * width + m] = load_x * x + load_y * y + load_z * z


@compiled(counted=False)
def boundary_data_of_lanes(
    lanes,
    patterns,
    begin,
    steps,
    steps_per_second,
    moved,
    motions,
    work,
    ends,
    accelerations,
    load,
    mass,
    reference,
    rows,
):
    """Fill the boundary data of the steps `begin` ... `begin + steps`, both included.

    Parameters
    ----------
    lanes, patterns, load, mass, reference
        As in :func:`cablepod.condensed._kernels_frame.spatial_frames_of_lanes`; `reference` is None in the plane.
    begin, steps, steps_per_second
        `begin` is a multiple of four times ROTATIONS.
    moved, motions
        Coordinate of the ends that each motion moves (motions,), and the motions (motions, MOTION_ROWS, lanes), see
        :mod:`cablepod.parameters._kernels_sines`.
    work
        Work arrays: turns (motions, TURN_ROWS, lanes), waves (motions, 2, 4, lanes), axes (9, lanes).
    ends, accelerations
        Coordinates of the ends at rest [m], and zeros (2 dims, lanes); changed.
    rows
        Filled: (steps + 1, columns lanes), columns as in :func:`cablepod.condensed._frame.chord_and_loads`.
    """
    turns, waves, axes = work
    ramped = steps_of_ramps(motions, steps_per_second)
    for i in range(begin, begin + steps + 1):
        if i % (4 * ROTATIONS) == 0:
            start_rotations(i, steps_per_second, motions, turns, waves)
        rotate(i, moved, turns, waves, ends, accelerations)
        if i < ramped:
            ramp_ends(i, steps_per_second, moved, motions, turns, waves, ends, accelerations)
        if reference is None:
            planar_frames_of_lanes(lanes, patterns, ends, accelerations, load, mass, rows[i - begin])
        else:
            spatial_frames_of_lanes(lanes, patterns, ends, accelerations, load, mass, reference, axes, rows[i - begin])
