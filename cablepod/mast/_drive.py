"""Loads and air of the mast as arrays for the kernels, the same for all kinds of guys."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cablepod.mast._air import at_nodes, time_weights
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastRequest
from cablepod.wind._mast_air import MastAir


class Drive(NamedTuple):
    """Arrays of the kernels; None for what a scene lacks."""

    constant: np.ndarray  #: modal forces that balance loads and drag on the mast at rest (modes,)
    load_vectors: Any  #: (loads, modes)
    factors: Any  #: (loads, steps + 1)
    samples_per_step: float
    table: Any  #: weights of the samples of the air, see :func:`cablepod.mast._air.time_weights`
    mast_wind: Any  #: at the nodes but the foot in x, then in z (samples, 2 nodes) [m/s]
    node_columns: Any  #: displacement of what the nodes carry by the modes (2, modes, nodes)
    node_rows: Any  #: the same (2, nodes, modes)
    node_drag: Any  #: (nodes,) [kg/m]

    @property
    def refined_samples_per_step(self) -> float:
        """Samples of :func:`cablepod.wind._air.refined` velocities in a step."""
        return self.samples_per_step * (0 if self.table is None else len(self.table))


def drive_of(mast: ModalMast, air: MastAir | None, request: MastRequest) -> Drive:
    """Make the arrays of a run."""
    factors = request.factors(mast.rest.p.loads)
    constant = np.zeros(len(mast.omega))
    if factors is not None:
        constant -= factors[:, 0] @ mast.load_vectors
    vectors = None if factors is None else mast.load_vectors
    if air is None:
        return Drive(constant, vectors, factors, 0.0, None, None, None, None, None)
    height, of_mast = mast.rest.beam.height, mast.rest.drag
    drag, by_modes = 0.5 * air.density * of_mast.areas, of_mast.rows @ mast.modes
    constant -= np.einsum("nd,nda->a", of_mast.at_rest, by_modes)
    wind = at_nodes(air, of_mast)  # the foot carries no drag
    drag = np.pad(drag[1:], (0, wind.shape[1] // 2 - drag.size + 1))
    samples = request.step * air.samples_per_second
    rows = np.zeros((2, wind.shape[1] // 2, len(mast.omega)))
    rows[:, : height.size - 1] = np.swapaxes(by_modes[1:], 0, 1)
    columns = np.ascontiguousarray(np.swapaxes(rows, 1, 2))
    return Drive(constant, vectors, factors, samples, time_weights(len(wind)), wind, columns, rows, drag)
