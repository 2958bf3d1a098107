"""Run of the compiled loop, the same for all kinds of guys."""

from __future__ import annotations

from typing import Any

import numpy as np

from cablepod.mast._air import Drive
from cablepod.mast._kernels_layout import Beam, BeamState, Extremes, GuyEnds, MastRecord, Pace
from cablepod.mast._model import ModalMast, StepMatrices
from cablepod.mast._request import MastRequest, MastTrajectory


def constant_forces(mast: ModalMast, drive: Drive, at_rest: np.ndarray) -> np.ndarray:
    """Return the modal forces that balance loads, drag and guys, with forces (guys, 3) on the mast, at rest (modes,)."""
    return drive.constant - np.einsum("gi,gia->a", at_rest[:, [0, 2]], mast.guy_rows)


def march(
    mast: ModalMast,
    request: MastRequest,
    matrices: StepMatrices,
    drive: Drive,
    end_mass: np.ndarray,
    at_rest: np.ndarray,
    *,
    hold: int = 1,
    condensed: Any = None,
    chains: Any = None,
    static: Any = None,
    guy_wind: Any = None,
) -> MastTrajectory:
    """Run a mast with guys of one kind from rest.

    Parameters
    ----------
    mast, request, matrices, drive
        The mast, what is asked, its step, its loads and air.
    end_mass, at_rest
        Mass of the guys at the mast, see :class:`GuyEnds`, or (guys,) where it follows the mast in x and z [kg]; their forces on
        the mast at rest (guys, 3) [N], which a constant force balances.
    hold
        Steps over which drag is held.
    condensed, chains, static, guy_wind
        As of :func:`cablepod.mast._kernels_march.march`.
    """
    from cablepod.mast import _kernels_march as kernel  # numba is imported only to compute

    levels, modes, count = len(mast.heights), len(mast.omega), len(mast.rest.p.guys)
    wind, outputs = drive.wind, request.outputs_count
    ends = GuyEnds.of(mast.level_of_guy, request.steps_of_breaks(mast.rest.p), end_mass)
    nodes = wind.drag.size if request.keeps_drag and wind is not None else 0
    record = MastRecord(
        np.zeros((outputs, modes)), np.zeros((outputs, 2, modes)), np.zeros((outputs, count, 3)), np.zeros((outputs, count)),
        np.zeros((outputs if nodes else 0, 2, nodes)), Extremes.of(2 * levels), Extremes.of(ends.tension.size),
    )  # fmt: skip
    beam = Beam(
        constant_forces(mast, drive, at_rest), mast.stiffness, matrices.keep, matrices.gain, mast.level_rows, mast.level_rest,
        mast.pull_stiffness, mast.pull_at_rest,
    )  # fmt: skip
    status, at, guy = kernel.march(
        Pace(request.step, request.every, request.steps, hold, *request.window_steps), beam, BeamState.of(levels, modes),
        drive.loads, wind, ends, condensed, chains, static, guy_wind, record,
    )  # fmt: skip
    of_levels = Extremes(*(values.reshape(levels, 2) for values in record.of_levels))
    of_tensions = Extremes(*(values[:count] for values in record.of_tensions))
    return MastTrajectory(
        request, record.modal, record.rates, record.force, record.tension, record.drag, of_levels, of_tensions,
        ends.least[:count], ends.least_step[:count], status, at, guy,
    )  # fmt: skip
