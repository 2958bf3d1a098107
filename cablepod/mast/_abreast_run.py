"""Runs of masts with condensed guys abreast: their arrays for the kernel, masts last."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.mast._air import along_guys, to_gauss
from cablepod.mast._condensed_lanes import balance
from cablepod.mast._drive import drive_of
from cablepod.mast._kernels_layout import ABREAST
from cablepod.mast._request import MastRequest, MastTrajectory, empty_trajectory
from cablepod.wind._air import drag_of

if TYPE_CHECKING:
    from cablepod.mast._condensed_run import CondensedGuys

#: Bytes of a line of the cache: no vector lies across two.
LINE = 64


def empty(*shape: int) -> np.ndarray:
    """Return an array (shape, masts) of zeros whose rows do not lie across lines of the cache."""
    count = int(np.prod(shape)) * ABREAST
    buffer = np.zeros(count + LINE // 8)
    skip = (-buffer.ctypes.data % LINE) // 8
    return buffer[skip : skip + count].reshape(-1, ABREAST)


def rows_of(values: Sequence[np.ndarray]) -> np.ndarray:
    """Return arrays of each mast as rows (count, masts)."""
    result = empty(values[0].size)
    for m, one in enumerate(values):
        result[:, m] = one.ravel()
    result[:, len(values):] = result[:, len(values) - 1, None]
    return result


def run_abreast(models: Sequence[CondensedGuys], request: MastRequest) -> list[MastTrajectory]:
    from cablepod.mast import _kernels_abreast as kernel  # numba is imported only to compute
    from cablepod.mast import _kernels_guy as rows
    from cablepod.mast._kernels_mast import TAPS

    members, first, step = len(models), models[0], request.step
    schemes = [model.checked_scheme(step) for model in models]
    drives = [drive_of(model.mast, model.air, request) for model in models]
    constants = [balance(model, drive) for model, drive in zip(models, drives, strict=True)]
    alpha = first.mast.rest.p.mass_damping
    drive, modes, levels, count = drives[0], len(first.mast.omega), len(first.mast.heights), first.guys.count
    r, outputs = first.rank, request.outputs_count
    even = r + r % 2
    points = first.drag_points
    saved, saved_tension = np.empty((members, outputs, modes)), np.empty((members, outputs, count))
    saved_force = np.empty((members, outputs, 3 * count))
    level_extremes, tension_extremes, monitor = empty(2 * levels, 6), empty(count, 6), empty(count, 2)
    level_extremes[0::6] = tension_extremes[0::6] = monitor[0::2] = np.inf
    level_extremes[1::6] = tension_extremes[1::6] = -np.inf
    status, stopped = np.zeros(members, dtype=np.int64), np.zeros((members, 2), dtype=np.int64)

    def of(values: Callable[[Any], Any], given: Sequence[Any] = models) -> Any:
        return None if values(given[0]) is None else rows_of([values(one) for one in given])

    def coordinates(values: np.ndarray) -> np.ndarray:
        result = np.zeros((len(values), 2, even))
        result[:, :, :r] = values.reshape(-1, 2, r)
        return result

    shapes = first.shapes
    places, weights, _ = to_gauss(points)
    shared = np.zeros((3 + even + 2 * points, 2, even))
    for part, shape in enumerate(shapes):
        shared[0, part, :r], shared[1, part, :r], shared[2, part, :r] = shape.slopes, shape.moments, shape.means * (part == 0)
        shared[3 : 3 + r, part, :r] = shape.tilt
        shared[3 + even : 3 + even + points, part, :r] = shape.basis(places, 0).T
        shared[3 + even + points :, part, :r] = shape.basis(places, 1).T

    def numbers(model: Any) -> np.ndarray:
        guys, fitted = model.guys, model.checked_scheme(step)[1]
        result = np.zeros((count, rows.GUY_ROWS))
        values = {
            rows.STIFFNESS: guys.stiffness, rows.SPRING: guys.stiffness / guys.length, rows.INVERSE_LENGTH: 1.0 / guys.length,
            rows.WEIGHT: guys.weight, rows.HALF_WEIGHT: 0.5 * guys.weight * guys.length, rows.SOFTENING: 1.0 - 2.0 * guys.strain,
            rows.STIFFENING: guys.strain * guys.rest_force, rows.SCALE: guys.scale, rows.INVERSE_SCALE: 1.0 / guys.scale,
            rows.KAPPA: guys.scale**2 / guys.length, rows.LOAD: guys.length * guys.scale,
            rows.FITTED_KAPPA: (guys.kappa * fitted).max(axis=1, initial=0.0),
        }  # fmt: skip
        if model.air is not None:
            values[rows.DRAG] = np.array([drag_of(g.p, model.air.density) for g in model.mast.rest.p.guys]) * guys.length
        for row, column in values.items():
            result[:, row] = column
        result[:, rows.AXES : rows.AXES + 9] = model.axes.reshape(-1, 9)
        result[:, rows.LOWER : rows.LOWER + 3] = guys.lower
        result[:, rows.LOWER + 1] -= guys.upper[:, 1]
        result[:, rows.END_MASS :] = model.reaction_mass.reshape(-1, 6)
        return result

    def gains(model: Any) -> np.ndarray:
        return coordinates(step * model.checked_scheme(step)[1] / (1.0 + 0.5 * alpha * step))

    work = (
        empty(modes), empty(modes), empty(modes), empty(2 * levels), empty(2 * levels), empty(2 * levels), empty(2 * levels),
        empty(2 * even), empty(2 * even), empty(2 * even), empty(3 * count), empty(count), empty(count + 1), empty(2 * points),
        np.empty(TAPS), np.empty(3 * points * count), np.empty(0 if drive.node_drag is None else 2 * drive.node_drag.size), empty(modes),
        empty(count, 2 * even), empty(3 * count),
    )  # fmt: skip
    in_wind = first.air is not None
    kernel.masts_run(
        step, request.every, request.steps, first.steps_of_drag(step), np.array(request.window_steps), even, of(lambda model: coordinates(model.rest[0])),
        empty(count, 2 * even), empty(count, 2 * even), of(gains), (1.0 - 0.5 * alpha * step) / (1.0 + 0.5 * alpha * step),
        of(numbers), shared.reshape(-1, 2 * even), places if in_wind else None, first.mast.level_of_guy, empty(modes),
        empty(modes), empty(modes), rows_of(constants), of(lambda model: model.mast.stiffness),
        of(lambda scheme: scheme[0].keep.T, schemes), of(lambda scheme: scheme[0].gain.T, schemes),
        of(lambda model: model.mast.level_rows), of(lambda model: model.mast.level_rest),
        of(lambda drive: drive.load_vectors, drives),
        of(lambda drive: None if drive.factors is None else drive.factors.T, drives),
        drive.samples_per_step, drive.table, drive.mast_wind,
        of(lambda drive: None if drive.node_rows is None else np.swapaxes(drive.node_rows, 0, 1), drives),
        of(lambda drive: drive.node_drag, drives),
        along_guys(first.air, points, count) if in_wind else None, weights if in_wind else None, work,
        saved, saved_force, saved_tension, level_extremes, tension_extremes, monitor, status, stopped,
    )  # fmt: skip
    results = []
    for m, model in enumerate(models):
        result = empty_trajectory(request, modes, levels, count)
        result.modal, result.force, result.tension = saved[m], saved_force[m].reshape(-1, count, 3), saved_tension[m]
        extremes = level_extremes[:, m].reshape(levels, 2, 6)
        result.level_extremes, result.level_sums = extremes[..., :4], extremes[..., 4:]
        extremes = tension_extremes[:, m].reshape(count, 6)
        result.tension_extremes, result.tension_sums = extremes[..., :4], extremes[..., 4:]
        result.finish(int(status[m]), int(stopped[m, 0]), int(stopped[m, 1]), monitor[:, m].reshape(count, 2))
        results.append(result)
    return results
