"""Runs of masts with condensed guys, alone or abreast: their arrays for the kernel, guys last, in lanes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.mast._air import along_guys, to_gauss
from cablepod.mast._drive import Drive, drive_of
from cablepod.mast._kernels_layout import LANES, MODES_TOGETHER
from cablepod.mast._request import MastRequest, MastTrajectory, empty_trajectory
from cablepod.wind._air import drag_of

if TYPE_CHECKING:
    from cablepod.mast._condensed_run import CondensedGuys

#: Lanes that masts abreast fill at most: more do not fit the cache of a core.
MAX_LANES = 64


def members_abreast(guys: int) -> int:
    """Return the number of masts with so many guys that run abreast."""
    return max(1, MAX_LANES // max(guys, 1))


def run_abreast(models: Sequence[CondensedGuys], request: MastRequest) -> list[MastTrajectory]:
    """Run masts with the same number of guys, levels, modes and loads, in the same air, from rest.

    The result of a mast does not depend on the others.

    Raises
    ------
    SceneError
        For a step above the stability limit.
    """
    from cablepod.mast import _kernels_condensed as kernel  # numba is imported only to compute
    from cablepod.mast._kernels_guys import LARGEST_KAPPA

    first, step, members = models[0], request.step, len(models)
    lanes = first.lanes if members == 1 else Lanes(models)
    schemes = [model.checked_scheme(step) for model in models]
    drives = [drive_of(model.mast, model.air, request) for model in models]
    constants = [_balance(model, drive) for model, drive in zip(models, drives, strict=True)]
    fitted = np.concatenate([factors for _, factors in schemes])
    numbers = lanes.numbers.copy()
    numbers[LARGEST_KAPPA, : lanes.count] = (lanes.of_guys(lambda guys: guys.kappa) * fitted).max(axis=1, initial=0.0)
    alpha = first.mast.rest.p.mass_damping
    drive, modes, levels = drives[0], len(first.mast.omega), len(first.mast.heights)
    results = [empty_trajectory(request, modes, levels, first.guys.count) for _ in models]
    saved = {
        name: np.zeros((members, *getattr(results[0], name).shape)) for name in ("modal", "rates", "force", "tension")
    }
    keeps = request.energy or request.keeps_guys
    coordinates = np.zeros((request.outputs_count if keeps else 0, 3, *lanes.kappa.shape))
    level_extremes, level_sums = _empty_extremes(members * levels * 2)
    tension_extremes, tension_sums = _empty_extremes(lanes.size)
    monitor = np.zeros((2, lanes.size))
    monitor[0] = np.inf
    status, stopped = np.zeros(members, dtype=np.int64), np.zeros((members, 2), dtype=np.int64)
    # momentum coordinates are the deflections at the displacement of rest
    p = lanes.coordinates(np.concatenate([model.rest[0] for model in models]))

    def stacked(part: Callable[[Any], Any], of: Sequence[Any]) -> Any:
        return None if part(of[0]) is None else np.stack([part(one) for one in of])

    kernel.condensed_run(
        step, request.every, request.steps, np.array(request.window_steps), np.zeros((members, modes)),
        np.zeros((members, modes)), p, np.zeros_like(p), np.stack(constants),
        stacked(lambda model: model.mast.stiffness, models), stacked(lambda scheme: scheme[0].keep, schemes),
        stacked(lambda scheme: scheme[0].gain, schemes), stacked(lambda model: model.mast.level_rows, models),
        stacked(lambda model: model.mast.level_rest, models), lanes.heights, first.mast.level_of_guy, lanes.lower, lanes.axes,
        numbers, lanes.kappa, lanes.moments, lanes.loads, lanes.tilt, (1.0 - 0.5 * alpha * step) / (1.0 + 0.5 * alpha * step),
        lanes.coordinates(step * fitted / (1.0 + 0.5 * alpha * step)), lanes.end_mass,
        stacked(lambda one: one.load_vectors, drives), stacked(lambda one: one.factors, drives), drive.samples_per_step,
        drive.table, drive.mast_wind, stacked(lambda one: one.node_columns, drives), stacked(lambda one: one.node_rows, drives),
        stacked(lambda one: one.node_drag, drives),
        None if first.air is None else along_guys(first.air, first.drag_points), *lanes.drag, saved["modal"], saved["rates"],
        coordinates, saved["force"], saved["tension"], level_extremes, level_sums, tension_extremes, tension_sums, monitor,
        status, stopped,
    )  # fmt: skip
    back = lanes.back(coordinates)
    for m, result in enumerate(results):
        own = slice(m * first.guys.count, (m + 1) * first.guys.count)
        for name, values in saved.items():
            setattr(result, name, values[m])
        of_levels = slice(m * levels * 2, (m + 1) * levels * 2)
        result.level_extremes = level_extremes[:, of_levels].T.reshape(levels, 2, 4)
        result.level_sums = level_sums[:, of_levels].T.reshape(levels, 2, 2)
        result.tension_extremes, result.tension_sums = tension_extremes[:, own].T, tension_sums[:, own].T
        result.finish(int(status[m]), int(stopped[m, 0]), int(stopped[m, 1]), monitor[:, own].T)
        models[m].finished(result, back[:, :, own], *schemes[m], drives[m], constants[m])
    return results


def _balance(model: CondensedGuys, drive: Drive) -> np.ndarray:
    """Return the modal forces that balance loads, drag and guys at rest (modes,)."""
    return drive.constant - np.einsum("gi,gia->a", model.rest[1][:, [0, 2]], model.mast.guy_rows)


def _empty_extremes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return extremes and their steps (4, count), and sums and sums of squares (2, count) before a run."""
    extremes = np.zeros((4, count))
    extremes[0], extremes[1] = np.inf, -np.inf
    return extremes, np.zeros((2, count))


class Lanes:
    """Arrays of the guys of masts for the kernel: guys last, padded to whole groups of lanes, modes too."""

    def __init__(self, models: Sequence[CondensedGuys]) -> None:
        from cablepod.mast import _kernels_guys as kernel

        self.models, self.rank = models, models[0].rank
        self.count = sum(model.guys.count for model in models)
        self.size = -(-max(self.count, 1) // LANES) * LANES
        self.modes = -(-self.rank // MODES_TOGETHER) * MODES_TOGETHER
        self.numbers = np.ones((8, self.size))
        self.numbers[[kernel.WEIGHT, kernel.STIFFENING, kernel.LARGEST_KAPPA]] = 0.0
        rows: dict[int, Callable[[Any], np.ndarray]] = {
            kernel.STIFFNESS: lambda guys: guys.stiffness, kernel.LENGTH: lambda guys: guys.length,
            kernel.WEIGHT: lambda guys: guys.weight, kernel.SOFTENING: lambda guys: 1.0 - 2.0 * guys.strain,
            kernel.STIFFENING: lambda guys: guys.strain * guys.rest_force, kernel.SCALE: lambda guys: guys.scale,
            kernel.SLOPE_SCALE: lambda guys: guys.scale / guys.length,
        }  # fmt: skip
        for row, values in rows.items():
            self.numbers[row, : self.count] = self.of_guys(values)
        self.kappa, self.moments, self.loads = (
            self.coordinates(self.of_guys(values))
            for values in (lambda guys: guys.kappa, lambda guys: guys.moments, lambda guys: guys.loads)
        )
        r, tilt = self.rank, models[0].guys.tilt
        self.tilt = np.zeros((2, self.modes, self.modes))
        self.tilt[0, :r, :r], self.tilt[1, :r, :r] = tilt[:r, :r], tilt[r:, r:]
        self.lower = np.zeros((3, self.size))
        self.lower[0] = 1.0  # lanes without a guy have a chord
        self.lower[:, : self.count] = self.of_guys(lambda guys: guys.lower).T
        self.heights = self.of(self.of_guys(lambda guys: guys.upper[:, 1]))
        self.axes = self.of(np.concatenate([model.axes.reshape(-1, 9) for model in models]))

    @cached_property
    def end_mass(self) -> np.ndarray:
        """Mass of the upper ends, rows of force in x, y, z by acceleration in x and z (6, lanes) [kg]."""
        return self.of(np.concatenate([model.reaction_mass.reshape(-1, 6) for model in self.models]))

    @cached_property
    def drag(self) -> tuple[Any, Any, Any, Any]:
        """Drag at the points of the guys (points, lanes) [kg/m], places, shapes and slopes (2, points, r); None in still air."""
        first = self.models[0]
        if first.air is None:
            return None, None, None, None
        places, weights, _ = to_gauss(first.drag_points)
        density = first.air.density  # masts abreast are in the same air
        per_length = [drag_of(guy.p, density) for model in self.models for guy in model.mast.rest.p.guys]
        drag = np.array(per_length) * self.of_guys(lambda guys: guys.length)
        shapes, slopes = np.zeros((2, 2, places.size, self.modes))
        for part, shape in enumerate(first.shapes):
            shapes[part, :, : self.rank] = shape.basis(places, 0).T
            slopes[part, :, : self.rank] = shape.basis(places, 1).T
        return self.of(drag[:, None] * weights), places, shapes, slopes

    def of_guys(self, values: Callable[[Any], np.ndarray]) -> np.ndarray:
        """Return values of the guys of all masts, one after the other (guys, ...)."""
        return np.concatenate([values(model.guys) for model in self.models])

    def of(self, values: np.ndarray) -> np.ndarray:
        """Return values (guys, ...) as (..., lanes)."""
        result = np.zeros((*values.shape[1:], self.size))
        result[..., : self.count] = np.moveaxis(values, 0, -1)
        return result

    def coordinates(self, values: np.ndarray) -> np.ndarray:
        """Return values of the coordinates (guys, 2 r) as (2, modes, lanes)."""
        result = np.zeros((2, self.modes, self.size))
        result[:, : self.rank, : self.count] = np.moveaxis(values.reshape(-1, 2, self.rank), 0, -1)
        return result

    def back(self, values: np.ndarray) -> np.ndarray:
        """Return values (..., 2, modes, lanes) of the kernel by guys (..., guys, 2 r)."""
        own = np.moveaxis(values[..., : self.rank, : self.count], -1, -3)
        return own.reshape(*own.shape[:-2], 2 * self.rank)
