"""Run of a mast with condensed guys alone: arrays of the kernel, guys last, in lanes."""

from __future__ import annotations

import weakref
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.condensed._kernels_layout import LeadingTerms
from cablepod.mast._air import along_guys, to_gauss
from cablepod.mast._drive import Drive, drive_of
from cablepod.mast._kernels_layout import LANES, MODES_TOGETHER
from cablepod.mast._request import MastRequest, MastTrajectory, empty_trajectory
from cablepod.wind._air import drag_of

if TYPE_CHECKING:
    from cablepod.mast._condensed_run import CondensedGuys, CondensedRun


def run_alone(run: CondensedRun, request: MastRequest) -> MastTrajectory:
    """Run a mast from rest.

    Raises
    ------
    SceneError
        For a step above the stability limit.
    """
    from cablepod.mast import _kernels_condensed as kernel  # numba is imported only to compute
    from cablepod.mast._kernels_guys import LARGEST_KAPPA

    model, air = run.model, run.air
    mast, step, lanes, count = model.mast, request.step, model.lanes, model.guys.count
    matrices, fitted = run.checked_scheme(step)
    drive = drive_of(mast, air, request)
    constant = balance(model, drive)
    numbers = lanes.numbers.copy()
    numbers[LARGEST_KAPPA, :count] = (model.guys.kappa * fitted).max(axis=1, initial=0.0)
    alpha, modes, levels = mast.rest.p.mass_damping, len(mast.omega), len(mast.heights)
    result = empty_trajectory(request, mast, drive.node_drag)
    keeps = request.energy or request.keeps_guys
    coordinates = np.zeros((request.outputs_count if keeps else 0, 3, *lanes.kappa.shape))
    level_extremes, level_sums = _empty_extremes(levels * 2)
    tension_extremes, tension_sums = _empty_extremes(lanes.size)
    monitor = np.zeros((2, lanes.size))
    monitor[0] = np.inf
    breaks = np.array([np.inf if guy.breaks is None else guy.breaks / step for guy in mast.rest.p.guys])
    p = lanes.coordinates(model.rest[0])  # momentum coordinates are the deflections at the displacement of rest
    status, at, guy = kernel.condensed_run(
        step, request.every, request.steps, run.steps_of_drag(step), np.array(request.window_steps), np.zeros(modes),
        np.zeros(modes), p, np.zeros_like(p), constant, mast.stiffness, mast.pulls(), matrices.keep, matrices.gain,
        mast.level_rows, mast.level_rest, lanes.heights, mast.level_of_guy, breaks, lanes.lower, lanes.axes, numbers, lanes.terms,
        lanes.kappa, lanes.moments, lanes.loads, lanes.tilt, (1.0 - 0.5 * alpha * step) / (1.0 + 0.5 * alpha * step),
        lanes.coordinates(step * fitted / (1.0 + 0.5 * alpha * step)), lanes.damping(step, fitted), lanes.end_mass,
         drive.load_vectors, drive.factors,
        drive.samples_per_step, drive.table, drive.mast_wind, drive.node_columns, drive.node_rows, drive.node_drag,
        None if air is None else along_guys(air, model.drag_points, lanes.size), *lanes.drag, result.modal,
        result.rates, coordinates, result.force, result.tension, result.drag, level_extremes, level_sums, tension_extremes,
        tension_sums, monitor,
    )  # fmt: skip
    result.level_extremes = level_extremes.T.reshape(levels, 2, 4)
    result.level_sums = level_sums.T.reshape(levels, 2, 2)
    result.tension_extremes, result.tension_sums = tension_extremes[:, :count].T, tension_sums[:, :count].T
    result.finish(status, at, guy, monitor[:, :count].T)
    return model.finished(result, lanes.back(coordinates), matrices, fitted, drive, constant)


def balance(model: CondensedGuys, drive: Drive) -> np.ndarray:
    """Return the modal forces that balance loads, drag and guys at rest (modes,)."""
    return drive.constant - np.einsum("gi,gia->a", model.rest[1][:, [0, 2]], model.mast.guy_rows)


def _empty_extremes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return extremes and their steps (4, count), and sums and sums of squares (2, count) before a run."""
    extremes = np.zeros((4, count))
    extremes[0], extremes[1] = np.inf, -np.inf
    return extremes, np.zeros((2, count))


class Lanes:
    """Arrays of the guys of a mast for the kernel: guys last, padded to whole groups of lanes, modes too."""

    def __init__(self, model: CondensedGuys) -> None:
        from cablepod.mast import _kernels_guys as kernel

        guys, self.rank = model.guys, model.rank
        self.model = weakref.proxy(
            model
        )  # which keeps these lanes: in a circle both would keep the air of many members
        self.count = guys.count
        self.size = -(-max(self.count, 1) // LANES) * LANES
        self.modes = -(-self.rank // MODES_TOGETHER) * MODES_TOGETHER
        self.numbers = np.ones((8, self.size))
        self.numbers[[kernel.WEIGHT, kernel.STIFFENING, kernel.LARGEST_KAPPA]] = 0.0
        rows = {
            kernel.STIFFNESS: guys.stiffness, kernel.LENGTH: guys.length, kernel.WEIGHT: guys.weight,
            kernel.SOFTENING: 1.0 - 2.0 * guys.strain, kernel.STIFFENING: guys.strain * guys.rest_force,
            kernel.SCALE: guys.scale, kernel.SLOPE_SCALE: guys.scale / guys.length,
        }  # fmt: skip
        for row, values in rows.items():
            self.numbers[row, : self.count] = values
        self.kappa, self.moments, self.loads = (
            self.coordinates(values) for values in (guys.kappa, guys.moments, guys.loads)
        )
        spring = 0.5 * self.numbers[kernel.STIFFNESS] / self.numbers[kernel.LENGTH]
        none = np.empty(0)
        self.terms = LeadingTerms(
            self.numbers[kernel.STIFFNESS], 1.0 / self.numbers[kernel.LENGTH], spring * self.numbers[kernel.SOFTENING],
            self.kappa.ravel(), none, none, none,
        )  # fmt: skip
        r, tilt = self.rank, guys.tilt
        self.tilt = np.zeros((2, self.modes, self.modes))
        self.tilt[0, :r, :r], self.tilt[1, :r, :r] = tilt[:r, :r], tilt[r:, r:]
        self.lower = np.zeros((3, self.size))
        self.lower[0] = 1.0  # lanes without a guy have a chord
        self.lower[:, : self.count] = guys.lower.T
        self.heights = self.of(guys.upper[:, 1])
        self.axes = self.of(model.axes.reshape(-1, 9))

    @cached_property
    def end_mass(self) -> np.ndarray:
        """Mass of the upper ends, rows of force in x, y, z by acceleration in x and z (6, lanes) [kg]."""
        return self.of(self.model.reaction_mass.reshape(-1, 6))

    def damping(self, step: float, fitted: np.ndarray) -> np.ndarray:
        """Return the matrices D and A of the damping by ratios (2, 2, modes, modes, lanes); without entries for none.

        D is the damping matrix for the fitted masses, A = (1 + step / 2 D F)^-1, for fitted factors F (guys, 2 r).
        """
        matrices, r = self.model.damping, self.rank
        if not matrices.size:
            return np.empty((2, 2, 0, 0, 0))
        root, one = np.sqrt(fitted), np.eye(2 * r)
        fitting = matrices / root[:, :, None] / root[:, None]
        solved = np.linalg.inv(one + 0.5 * step * fitting * fitted[:, None])
        result = np.zeros((2, 2, self.modes, self.modes, self.size))
        for k, both in enumerate((fitting, solved)):
            for part in range(2):  # the planes are independent about rest
                which = slice(part * r, (part + 1) * r)
                result[k, part, :r, :r, : self.count] = np.moveaxis(both[:, which, which], 0, -1)
        return result

    @cached_property
    def drag(self) -> tuple[Any, Any, Any, Any]:
        """Drag at the points of the guys (points, lanes) [kg/m], places, shapes and slopes (2, points, r); None in still air."""
        model = self.model
        if model.air is None:
            return None, None, None, None
        places, weights, _ = to_gauss(model.drag_points)
        drag = np.array([drag_of(guy.p, model.air.density) for guy in model.mast.rest.p.guys]) * model.guys.length
        shapes, slopes = np.zeros((2, 2, places.size, self.modes))
        for part, shape in enumerate(model.shapes):
            shapes[part, :, : self.rank] = shape.basis(places, 0).T
            slopes[part, :, : self.rank] = shape.basis(places, 1).T
        return self.of(drag[:, None] * weights), places, shapes, slopes

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
