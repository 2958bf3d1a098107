"""Loads and air of the mast as arrays for the kernels, the same for all kinds of guys."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cablepod.mast._air import at_nodes, time_weights
from cablepod.mast._kernels_layout import TAPS, Loads, MastWind
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastRequest
from cablepod.wind._mast_air import MastAir


class Drive(NamedTuple):
    """Loads and air of a run."""

    constant: np.ndarray  #: modal forces that balance loads and drag on the mast at rest (modes,)
    loads: Loads
    wind: MastWind | None  #: None in still air

    @property
    def refined_samples_per_step(self) -> float:
        """Samples of :func:`cablepod.wind._air.refined` velocities in a step."""
        return 0.0 if self.wind is None else self.wind.samples_per_step * len(self.wind.table)


def drive_of(mast: ModalMast, air: MastAir | None, request: MastRequest) -> Drive:
    """Make the arrays of a run."""
    factors, modes = request.factors(mast.rest.p.loads), len(mast.omega)
    loads = Loads(mast.load_vectors if len(factors) else np.empty((0, modes)), factors)
    constant = -factors[:, 0] @ loads.vectors
    if air is None:
        return Drive(constant, loads, None)
    height, of_mast = mast.rest.beam.height, mast.rest.drag
    drag, by_modes = 0.5 * air.density * of_mast.areas, of_mast.rows @ mast.modes
    constant -= np.einsum("nd,nda->a", of_mast.at_rest, by_modes)
    velocity = at_nodes(air, of_mast)  # the foot carries no drag
    nodes = velocity.shape[1] // 2
    rows = np.zeros((2, nodes, modes))
    rows[:, : height.size - 1] = np.swapaxes(by_modes[1:], 0, 1)
    wind = MastWind(
        request.step * air.samples_per_second, time_weights(len(velocity)), velocity,
        np.ascontiguousarray(np.swapaxes(rows, 1, 2)), rows, np.pad(drag[1:], (0, nodes - drag.size + 1)), np.zeros(TAPS),
        np.zeros(2 * nodes), np.zeros(nodes), np.zeros(nodes), np.zeros(modes),
    )  # fmt: skip
    return Drive(constant, loads, wind)
