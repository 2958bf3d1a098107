"""Runs of masts with condensed guys abreast: their arrays for the kernel, masts last."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.mast._air import along_guys, to_gauss
from cablepod.mast._condensed_lanes import balance
from cablepod.mast._drive import Drive, drive_of
from cablepod.mast._kernels_layout import ABREAST
from cablepod.mast._request import MastRequest, MastTrajectory, empty_trajectory
from cablepod.wind._air import drag_of

if TYPE_CHECKING:
    from cablepod.mast._condensed_run import CondensedGuys

#: Bytes of a line of the cache: no vector lies across two.
LINE = 64


def run_abreast(models: Sequence[CondensedGuys], request: MastRequest) -> list[MastTrajectory]:
    """Run masts with the same number of guys, levels, modes and loads, in the same air, from rest.

    The result of a mast does not depend on the others.

    Raises
    ------
    SceneError
        For a step above the stability limit.
    """
    from cablepod.mast import _kernels_abreast as kernel  # numba is imported only to compute

    first, members, step = models[0], len(models), request.step
    modes, levels, guys = len(first.mast.omega), len(first.mast.heights), first.guys.count
    places, outputs, points = 2 * levels, request.outputs_count, first.drag_points
    schemes = [model.checked_scheme(step) for model in models]
    drives = [drive_of(model.mast, model.air, request) for model in models]
    constants = [balance(model, drive) for model, drive in zip(models, drives, strict=True)]
    drive, damping = drives[0], 0.5 * first.mast.rest.p.mass_damping * step
    rank, shared = _shapes(first)
    coordinates = 2 * rank * guys
    saved, saved_force, saved_tension = (np.empty((members, outputs, count)) for count in (modes, 3 * guys, guys))
    level_extremes, tension_extremes, monitor = _empty(6 * places), _empty(6 * guys), _empty(2 * guys)
    level_extremes[0::6] = tension_extremes[0::6] = monitor[0::2] = np.inf
    level_extremes[1::6] = tension_extremes[1::6] = -np.inf
    status, stopped = np.zeros(members, dtype=np.int64), np.zeros((members, 2), dtype=np.int64)
    rest = _rows([_padded(model.rest[0], first.rank, rank) for model in models])
    gain = _rows([_padded(step * factors / (1.0 + damping), first.rank, rank) for _, factors in schemes])
    numbers = _rows([_numbers(model, factors) for model, (_, factors) in zip(models, schemes, strict=True)])
    work = (
        *(_empty(modes) for _ in range(4)), *(_empty(places) for _ in range(4)), *(_empty(2 * rank) for _ in range(3)),
        _empty(2 * points), _empty(coordinates), *(_empty(3 * guys) for _ in range(2)), *(_empty(guys) for _ in range(3)),
    )  # fmt: skip
    kernel.masts_run(
        step, request.every, request.steps, first.steps_of_drag(step), np.array(request.window_steps), rank, rest,
        _empty(coordinates), _empty(coordinates), gain, (1.0 - damping) / (1.0 + damping), numbers, shared,
        first.mast.level_of_guy, _empty(modes), _empty(modes), _empty(modes), _rows(constants),
        _rows([model.mast.stiffness for model in models]), _rows([matrices.keep.T for matrices, _ in schemes]),
        _rows([matrices.gain.T for matrices, _ in schemes]), _rows([model.mast.level_rows for model in models]),
        _rows([model.mast.level_rest for model in models]), _rows_of(drives, lambda own: own.load_vectors),
        _rows_of(drives, lambda own: None if own.factors is None else own.factors.T), drive.samples_per_step, drive.table,
        drive.mast_wind, _rows_of(drives, lambda own: None if own.node_rows is None else np.swapaxes(own.node_rows, 0, 1)),
        _rows_of(drives, lambda own: own.node_drag), None if first.air is None else along_guys(first.air, points, guys),
        *to_gauss(points)[:2], np.empty(0 if drive.node_drag is None else 2 * drive.node_drag.size),
        np.empty(3 * points * guys), np.empty(kernel.TAPS), work, saved, saved_force, saved_tension, level_extremes,
        tension_extremes, monitor, status, stopped,
    )  # fmt: skip
    results = []
    for m in range(members):
        result = empty_trajectory(request, modes, levels, guys)
        result.modal, result.tension = saved[m], saved_tension[m]
        result.force = saved_force[m].reshape(outputs, guys, 3)
        of_levels, of_guys = level_extremes[:, m].reshape(levels, 2, 6), tension_extremes[:, m].reshape(guys, 6)
        result.level_extremes, result.level_sums = of_levels[..., :4], of_levels[..., 4:]
        result.tension_extremes, result.tension_sums = of_guys[:, :4], of_guys[:, 4:]
        result.finish(int(status[m]), int(stopped[m, 0]), int(stopped[m, 1]), monitor[:, m].reshape(guys, 2))
        results.append(result)
    return results


def _empty(count: int) -> np.ndarray:
    """Return zeros (count, masts), of which no row lies across lines of the cache."""
    buffer = np.zeros(count * ABREAST + LINE // 8)
    skip = (-buffer.ctypes.data % LINE) // 8
    return buffer[skip : skip + count * ABREAST].reshape(count, ABREAST)


def _rows(values: Sequence[np.ndarray]) -> np.ndarray:
    """Return arrays of the masts as rows (count, masts); the last one stands for those that are missing."""
    result = _empty(values[0].size)
    for m in range(ABREAST):
        result[:, m] = values[min(m, len(values) - 1)].ravel()
    return result


def _rows_of(drives: Sequence[Drive], part: Callable[[Drive], Any]) -> Any:
    """Return rows of a part of what drives the masts; None without it."""
    return None if part(drives[0]) is None else _rows([part(drive) for drive in drives])


def _padded(values: np.ndarray, rank: int, even: int) -> np.ndarray:
    """Return values of the coordinates (guys, 2 rank) as (guys, 2, even)."""
    result = np.zeros((len(values), 2, even))
    result[:, :, :rank] = values.reshape(-1, 2, rank)
    return result


def _shapes(model: CondensedGuys) -> tuple[int, np.ndarray]:
    """Return the padded number of modes of a deflection, and the numbers of the shapes for the kernel (rows, 2 modes)."""
    from cablepod.mast import _kernels_guy as rows

    r, even, points = model.rank, model.rank + model.rank % 2, model.drag_points
    places = to_gauss(points)[0]
    shared = np.zeros((rows.TILT + even + 2 * points, 2, even))
    for part, shape in enumerate(model.shapes):
        shared[rows.SLOPE_NORMS, part, :r], shared[rows.MOMENTS, part, :r] = shape.slopes, shape.moments
        shared[rows.TILT : rows.TILT + r, part, :r] = shape.tilt
        at = rows.TILT + even
        shared[at : at + points, part, :r], shared[at + points :, part, :r] = (
            shape.basis(places, 0).T,
            shape.basis(places, 1).T,
        )
    shared[rows.MEANS, 0, :r] = model.shapes[0].means  # the weight acts in the plane
    return even, shared.reshape(len(shared), 2 * even)


def _numbers(model: CondensedGuys, fitted: np.ndarray) -> np.ndarray:
    """Return the numbers of the guys for the kernel (guys, rows), for fitted factors (guys, 2 r)."""
    from cablepod.mast import _kernels_guy as rows

    guys = model.guys
    density = 0.0 if model.air is None else model.air.density
    per_length = [drag_of(guy.p, density) if density else 0.0 for guy in model.mast.rest.p.guys]
    columns = {
        rows.STIFFNESS: guys.stiffness, rows.SPRING: guys.stiffness / guys.length, rows.INVERSE_LENGTH: 1.0 / guys.length,
        rows.WEIGHT: guys.weight, rows.HALF_WEIGHT: 0.5 * guys.weight * guys.length, rows.SOFTENING: 1.0 - 2.0 * guys.strain,
        rows.STIFFENING: guys.strain * guys.rest_force, rows.SCALE: guys.scale, rows.INVERSE_SCALE: 1.0 / guys.scale,
        rows.KAPPA: guys.scale**2 / guys.length, rows.LOAD: guys.length * guys.scale,
        rows.FITTED_KAPPA: (guys.kappa * fitted).max(axis=1, initial=0.0), rows.DRAG: np.array(per_length) * guys.length,
    }  # fmt: skip
    result = np.zeros((guys.count, rows.GUY_ROWS))
    for row, values in columns.items():
        result[:, row] = values
    result[:, rows.AXES : rows.AXES + 9] = model.axes.reshape(-1, 9)
    result[:, rows.LOWER : rows.LOWER + 3] = guys.lower
    result[:, rows.LOWER + 1] -= guys.upper[:, 1]  # which does not change
    result[:, rows.END_MASS :] = model.reaction_mass.reshape(-1, 6)
    return result
