"""Compiled boundary data of members side by side, whose ends move by sines."""

from __future__ import annotations

from cablepod._jit import compiled
from cablepod.condensed._kernels_frame import planar_frames_of_lanes, spatial_frames_of_lanes
from cablepod.parameters._kernels_sines import ROTATIONS, ramp_ends, rotate, start_rotations, steps_of_ramps


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
        Filled: (steps + 1, columns, lanes), flat, columns as in :func:`cablepod.condensed._frame.chord_and_loads`.
    """
    turns, waves, axes = work
    ramped, columns = steps_of_ramps(motions, steps_per_second), rows.size // (steps + 1)
    for i in range(begin, begin + steps + 1):
        if i % (4 * ROTATIONS) == 0:
            start_rotations(i, steps_per_second, motions, turns, waves)
        rotate(i, moved, turns, waves, ends, accelerations)
        if i < ramped:
            ramp_ends(i, steps_per_second, moved, motions, turns, waves, ends, accelerations)
        at = (i - begin) * columns
        if reference is None:
            planar_frames_of_lanes(lanes, patterns, ends, accelerations, load, mass, rows, at)
        else:
            spatial_frames_of_lanes(lanes, patterns, ends, accelerations, load, mass, reference, axes, rows, at)
