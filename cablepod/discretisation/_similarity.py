"""Similarity numbers of a scene: dimensionless parameters of the dynamics of a taut cable.

Trajectories of the chain and of the continuous cable carry these numbers as a variable, so that ``xarray.concat`` keeps those of
all runs.  Modes carry the range of their training scenes, and reduced runs their distance from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr

from cablepod.catenary._statics import solve_statics
from cablepod.parameters._members import MemberParameters
from cablepod.parameters._parameters import Parameters

#: Similarity numbers, at rest or maxima over time; T is the mean tension of the ends at rest, L the unstretched length:
#: "irvine_parameter": (q_n L / T)^2 K / T, q_n the load per length normal to the chord: softening of the cable by its sag;
#: "pull_along": q_t L / T, tension increase along the cable by the load along the chord;
#: "end_motion": change of the distance of the ends over the elastic stretch T L / K;
#: "end_acceleration": mu L a / T, a the largest acceleration of either end normal to the chord;
#: "frequency": 2 pi over the shortest time scale of ends and loads, over the first transverse frequency pi / L sqrt(T / mu);
#: "other_loads": point loads and change of the uniform load, over T.
FEATURES = ("irvine_parameter", "pull_along", "end_motion", "end_acceleration", "frequency", "other_loads")
#: Number of instants at which motions and loads are sampled.
INSTANTS = 201


@lru_cache
def feature_index() -> xr.IndexVariable:
    """Return the coordinate of FEATURES (cached: it costs as much as a thousand steps)."""
    return xr.IndexVariable("feature", list(FEATURES))


def features(p: Parameters, length: float, end_time: float, tension: float | None = None) -> np.ndarray:
    """Compute FEATURES of a scene with an unstretched length [m] until `end_time` [s].

    `tension` is the mean of both end tensions at rest [N], computed if None.
    """
    if tension is None:
        statics = solve_statics(p, "unstretched_length", length)
        tension = 0.5 * float(statics[4] + statics[5])
    # a weightless slack cable has no tension: a small one puts it far from all taut scenes
    tension = tension if tension > 0.0 else 1e-12 * p.stiffness
    times = np.linspace(0.0, end_time, INSTANTS)
    ends = p.end_positions(times[:1])
    chord = ends[0, 1] - ends[0, 0]
    chord_length = float(np.linalg.norm(chord))
    along = chord / chord_length
    load = p.load_at(0.0)
    tangential = float(load @ along)
    normal = float(np.linalg.norm(load - tangential * along))
    chord_change = acceleration = 0.0
    if p.motions:
        ends = p.end_positions(times)
        reach = ends[:, 1] - ends[:, 0]
        chord_change = float(np.abs(np.sqrt(np.einsum("td,td->t", reach, reach)) - chord_length).max())
        second = p.end_positions(times, 2).reshape(-1, p.dims)
        second -= np.outer(second @ along, along)
        acceleration = math.sqrt(float(np.einsum("td,td->t", second, second).max()))
    other_loads = 0.0
    for load_at_point in p.point_loads:
        other_loads += float(np.linalg.norm(load_at_point.force)) * _largest(load_at_point.factor, times)
    if p.load is not None and p.load_factor is not None:
        factor = p.load_factor(times)
        other_loads += float(np.linalg.norm(p.load)) * length * float(np.abs(factor - factor[0]).max())
    units = (p.stiffness, p.mass, length, tension)
    return _without_dimension(
        *units, normal, tangential, chord_change, acceleration, p.shortest_time_scale, other_loads
    )


def _without_dimension(
    stiffness: Any, mass: Any, length: Any, tension: Any,
    normal: Any, tangential: Any, chord_change: Any, acceleration: Any, time_scale: Any, other_loads: Any,
) -> np.ndarray:  # fmt: skip
    """Return FEATURES (..., features) from quantities with dimension: numbers, or arrays over members."""
    return np.stack(
        [
            (normal * length / tension) ** 2 * stiffness / tension,
            abs(tangential) * length / tension,
            chord_change * stiffness / (tension * length),
            mass * length * acceleration / tension,
            2.0 * length / time_scale * np.sqrt(mass / tension),
            other_loads / tension,
        ],
        axis=-1,
    )


def features_of_columns(
    columns: MemberParameters, length: np.ndarray, end_time: float, tension: np.ndarray
) -> np.ndarray:
    """Compute FEATURES of many members at once (members, features), see :func:`features`."""
    tension = np.where(tension > 0.0, tension, 1e-12 * columns.stiffness)
    chord, load = columns.chord, columns.load
    chord_length = np.sqrt((chord * chord).sum(axis=1))
    along = chord / chord_length[:, None]
    tangential = (load * along).sum(axis=1)
    normal = np.sqrt(((load - tangential[:, None] * along) ** 2).sum(axis=1))
    members = chord_length.size
    chord_change = acceleration = np.zeros(members)
    if columns.motions:
        times = np.linspace(0.0, end_time, INSTANTS)
        ends = columns.end_positions(times)
        reach = ends[:, :, 1] - ends[:, :, 0]
        distance = np.sqrt(np.einsum("mtd,mtd->mt", reach, reach))
        chord_change = np.abs(distance - chord_length[:, None]).max(axis=1)
        second = columns.end_positions(times, 2).reshape(members, -1, chord.shape[1])
        second -= np.einsum("mtd,md->mt", second, along)[:, :, None] * along[:, None]
        acceleration = np.sqrt(np.einsum("mtd,mtd->mt", second, second).max(axis=1))
    units = (columns.stiffness, columns.mass, length, tension)
    scale = columns.shortest_time_scale
    return _without_dimension(*units, normal, tangential, chord_change, acceleration, scale, np.zeros(members))


def _largest(factor: Callable[[np.ndarray], np.ndarray] | None, times: np.ndarray) -> float:
    """Return the largest absolute value of a load factor; None is the constant 1."""
    return 1.0 if factor is None else float(np.abs(factor(times)).max())


def describe(
    p: Parameters, length: float, end_time: float, tension: float | None = None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the variable ``scene_feature (feature)`` of a trajectory and its coordinate, see :func:`features`.

    Both belong in the constructor of the Dataset: adding them later costs as much as a short run.
    """
    return {"scene_feature": ("feature", features(p, length, end_time, tension))}, {"feature": feature_index()}
