"""Chord lengths and projected loads of instants or members: the boundary data of the condensed model."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.parameters._parameters import Parameters

#: Number of scenes whose longest chords are kept.
KEPT_CHORDS = 64


def chord_and_loads(
    ends: np.ndarray,
    accelerations: np.ndarray,
    load: np.ndarray,
    mass: float | np.ndarray,
    reference: np.ndarray,
    point_loads: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """Return boundary data (instants, 1 + patterns dims).

    Parameters
    ----------
    ends
        Positions of the ends, all coordinates of the lower one first (2 dims, instants) [m].
    accelerations
        Their accelerations, plus mass damping times their velocities (2 dims, instants) [m/s^2]; no columns where no end moves.
    load, mass
        Uniform load with weight (dims, instants or 1) [N/m], mass per unstretched length, a number or (instants,) [kg/m].
    reference
        Unit vector in spatial scenes: the first normal is the one closest to it; (dims,) or (instants, dims).
    point_loads
        Forces, (dims, instants or 1) each [N].

    Returns
    -------
    numpy.ndarray
        Chord length [m], then the load patterns along the chord from the upper end to the lower one, then those along each
        normal: uniform load, inertia that grows with sigma (moving ends only) [N/m], point loads [N].
    """
    patterns, dims = 2 if accelerations.shape[1] else 1, load.shape[0]
    rows = _projected(ends, accelerations, load, mass, reference)
    if not point_loads:
        return np.ascontiguousarray(rows.T)
    still = np.empty((2 * dims, 0))
    points = np.stack([_projected(ends, still, force, mass, reference)[1:] for force in point_loads], axis=1)
    uniform = rows[1:].reshape(dims, patterns, -1)
    loads = np.concatenate([uniform, points], axis=1).reshape(-1, ends.shape[1])
    return np.ascontiguousarray(np.concatenate([rows[:1], loads]).T)


def add_damping_of_turning(
    rows: np.ndarray, ends: np.ndarray, velocities: np.ndarray, reference: np.ndarray, damping: float
) -> None:
    """Add to boundary data the damping by the tension of the line between the ends, a load along the normals of a turning chord.

    Parameters
    ----------
    rows
        Result of :func:`chord_and_loads`, which is changed.
    ends, velocities
        Positions [m] and velocities [m/s] of the ends, as there (2 dims, instants).
    reference
        As there, (dims,).
    damping
        Damping by the tension [s].
    """
    dims = len(ends) // 2
    frame = ChordFrame.of((ends[dims:] - ends[:dims]).T, reference)
    turning = np.einsum("ct,tkc->tk", velocities[dims:] - velocities[:dims], frame.normals) / frame.chord[:, None]
    loads = rows[:, 1:].reshape(len(rows), dims, -1)  # a view
    loads[:, 1:] += damping * turning[:, :, None] * loads[:, :1]


def _projected(
    ends: np.ndarray, accelerations: np.ndarray, load: np.ndarray, mass: float | np.ndarray, reference: np.ndarray
) -> np.ndarray:
    """Return chord lengths and one load projected, or two where ends move (columns, instants)."""
    from cablepod.condensed import _kernels_frame as kernel  # numba is imported only to compute

    dims, instants = load.shape[0], ends.shape[1]
    patterns = np.empty(2 if accelerations.shape[1] else 1)
    rows, masses = np.empty((1 + dims * patterns.size, instants)), np.empty(instants)
    masses[:] = mass
    loads = np.empty((dims, instants))  # no broadcast view, for which the kernel would be compiled again
    loads[:] = load
    if not accelerations.shape[1]:
        accelerations = ends  # not read
    if dims == 2:
        kernel.planar_frames_of_lanes(masses, patterns, ends, accelerations, loads, masses, rows.reshape(-1))
        return rows
    axes = np.empty((3, instants))
    axes[:] = reference[:, None] if reference.ndim == 1 else reference.T
    work = np.empty((9, instants))
    kernel.spatial_frames_of_lanes(masses, patterns, ends, accelerations, loads, masses, axes, work, rows.reshape(-1))
    return rows


def end_tables(p: Parameters, begin: int, steps: int, steps_per_second: float) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends [m] and their accelerations with damping [m/s^2] from step `begin` on (2 dims, steps + 1)."""
    count = steps + 1
    ends, accelerations = np.empty((2 * p.dims, count)), np.zeros((2 * p.dims, count if p.motions else 0))
    ends[: p.dims], ends[p.dims :] = p.lower[:, None], p.upper[:, None]
    derivatives = (0, 2, 1) if p.mass_damping else (0, 2)
    for (end, axis), function in p.motions.items():
        row = ENDS.index(end) * p.dims + COORDINATES.index(axis)
        tables = function.all_at_steps(begin, steps, steps_per_second, derivatives, ends[row, 0])
        ends[row] = tables[0]
        accelerations[row] = tables[1] + p.mass_damping * tables[2] if p.mass_damping else tables[1]
    return ends, accelerations


def end_velocities(p: Parameters, begin: int, steps: int, steps_per_second: float) -> np.ndarray:
    """Return the velocities of both ends from step `begin` on (2 dims, steps + 1) [m/s]; no columns where no end moves."""
    velocities = np.zeros((2 * p.dims, steps + 1 if p.motions else 0))
    for (end, axis), function in p.motions.items():
        row = ENDS.index(end) * p.dims + COORDINATES.index(axis)
        velocities[row] = function.at_steps(begin, steps, steps_per_second, 1)
    return velocities


@lru_cache(KEPT_CHORDS)
def longest_chord(p: Parameters, end_time: float, intervals: int) -> float:
    """Return the longest distance of the ends at equal intervals up to `end_time` [s], in m; kept for the same scenes."""
    ends = p.end_positions(np.linspace(0.0, end_time, intervals + 1))
    return float(np.sqrt(np.sum((ends[:, 1] - ends[:, 0]) ** 2, axis=1)).max())
