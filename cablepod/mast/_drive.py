"""Loads and air of the mast as arrays for the kernels, the same for all kinds of guys."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cablepod.mast._air import MastAir
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastRequest
from cablepod.wind._air import refined


class Drive(NamedTuple):
    """Arrays of the kernels; None for what a scene lacks."""

    constant: np.ndarray  #: modal forces that balance loads and drag on the mast at rest (modes,)
    load_vectors: Any  #: (loads, modes)
    factors: Any  #: (loads, steps + 1)
    samples_per_step: float
    mast_wind: Any  #: (samples, nodes, 2) [m/s]
    node_rows: Any  #: (nodes, 2, modes)
    node_drag: Any  #: (nodes,) [kg/m]


def drive_of(mast: ModalMast, air: MastAir | None, request: MastRequest) -> Drive:
    """Make the arrays of a run."""
    factors = request.factors(mast.rest.p.loads)
    constant = np.zeros(len(mast.omega))
    if factors is not None:
        constant -= factors[:, 0] @ mast.load_vectors
    vectors = None if factors is None else mast.load_vectors
    if air is None:
        return Drive(constant, vectors, factors, 0.0, None, None, None)
    assert mast.rest.p.wind is not None
    height = mast.rest.beam.height
    drag = 0.5 * float(mast.rest.p.wind["air_density"]) * mast.rest.beam.drag_areas
    start = air.at_nodes(height, air.start)
    constant -= np.einsum("nd,nda->a", drag[:, None] * np.linalg.norm(start, axis=1)[:, None] * start, mast.node_rows)
    samples = request.step * air.samples_per_second
    return Drive(constant, vectors, factors, samples, refined(air.at_nodes(height, air.velocity)), mast.node_rows, drag)
