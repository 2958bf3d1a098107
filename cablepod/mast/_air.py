"""Loads and air on a mast and its guys as arrays for the kernels; those of the air are kept as long as it is."""

from __future__ import annotations

import threading
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cablepod.condensed._air_places import AirPlaces, projection_matrix
from cablepod.mast._drag import MastDrag
from cablepod.mast._kernels_layout import NODES_TOGETHER, TAPS, Loads, MastWind
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastRequest
from cablepod.scene._mast_field import GUY_POINTS, MAST_POINTS
from cablepod.wind._air import SAMPLES_TOGETHER, weights_of_samples
from cablepod.wind._mast_air import KEPT_FIELDS, MastAir

_LOCK = threading.RLock()


@lru_cache(2 * KEPT_FIELDS)
def _at_nodes(air: MastAir, weights: bytes, mean: bytes) -> np.ndarray:
    of_points, of_nodes = np.frombuffer(weights).reshape(-1, MAST_POINTS), np.frombuffer(mean).reshape(-1, 2)
    count = len(of_nodes)
    result = np.zeros((len(air.velocity), 2, -(-count // NODES_TOGETHER) * NODES_TOGETHER))
    result[:, :, :count] = np.tensordot(air.of_mast(air.velocity), of_points, (1, 1))
    result[:, :, :count] += air.growth[:, None, None] * (of_nodes - of_points @ air.of_mast(air.mean)).T
    return result.reshape(len(result), -1)


def at_nodes(air: MastAir, drag: MastDrag) -> np.ndarray:
    """Return the velocity at the nodes of the mast but the foot, in x, then in z, padded (samples, 2 nodes) [m/s].

    It is the mean velocity of the drag with the gusts on what each node carries.
    """
    weights = drag.gusts @ air.weights_at(drag.heights)
    with _LOCK:
        return _at_nodes(air, weights[1:].tobytes(), drag.velocity[1:].tobytes())


def _of_places(air: MastAir, velocity: np.ndarray, count: int, lanes: int) -> np.ndarray:
    """Return velocities (samples, points, 3) at Gauss points of the guys (samples, count, 3, lanes)."""
    matrix, result = to_gauss(count)[2], np.zeros((len(velocity), count, 3, lanes))
    for first in range(0, len(velocity), SAMPLES_TOGETHER):
        own = air.of_guys(velocity[first : first + SAMPLES_TOGETHER])
        placed = matrix @ own.transpose(2, 0, 3, 1).reshape(GUY_POINTS, -1)
        result[first : first + SAMPLES_TOGETHER, ..., : air.guys] = np.swapaxes(
            placed.reshape(count, len(own), 3, air.guys), 0, 1
        )
    return result


@lru_cache(2 * KEPT_FIELDS)
def _along_guys(air: MastAir, count: int, lanes: int) -> np.ndarray:
    return _of_places(air, air.velocity, count, lanes).reshape(len(air.velocity), -1)


def along_guys(air: MastAir, count: int, lanes: int) -> np.ndarray:
    """Return the velocity at Gauss points of the guys (samples, count 3 lanes) [m/s]."""
    with _LOCK:
        return _along_guys(air, count, lanes)


def steady_along_guys(air: MastAir, count: int, lanes: int) -> np.ndarray:
    """Return the velocity from which runs start at Gauss points of the guys (count, 3, lanes) [m/s]."""
    return _of_places(air, air.start[None], count, lanes)[0]


@lru_cache
def to_gauss(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places and weights of Gauss points, and the matrix from the points of a guy's air to them."""
    places = AirPlaces(((0.0, 1.0, count),), ())
    matrix = projection_matrix(places, np.linspace(0.0, 1.0, GUY_POINTS).tobytes())
    return places.sigma, places.weights(1.0), matrix[:count]


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
        request.step * air.samples_per_second, weights_of_samples(len(velocity)), velocity,
        np.ascontiguousarray(np.swapaxes(rows, 1, 2)), rows, np.pad(drag[1:], (0, nodes - drag.size + 1)), np.zeros(TAPS),
        np.zeros(2 * nodes), np.zeros(nodes), np.zeros(nodes), np.zeros(modes),
    )  # fmt: skip
    return Drive(constant, loads, wind)
