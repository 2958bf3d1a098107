"""How far a scene lies outside those that modes were trained on, in numbers without dimension that decide how a taut cable moves.

Trajectories of the chain and of the continuous cable carry the numbers of their scene, as a variable, so that runs joined by
``xarray.concat`` keep those of all; modes carry the least and largest of their snapshots; a reduced run says how far it is.
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

#: What is compared, all at rest or as the largest over time; T is the mean tension of the ends at rest, L the unstretched length:
#: "irvine_parameter": (q_n L / T)^2 K / T, q_n the load per length normal to the chord: how much the sag softens the cable;
#: "pull_along": q_t L / T, what the load along the chord adds to the tension;
#: "end_motion": change of the distance of the ends over T L / K, the elastic stretch;
#: "end_acceleration": mu L a / T, a the second rate of the ends' distance vector normal to the chord, or of either end;
#: "frequency": 2 pi over the shortest time in which ends or loads change, over pi / L sqrt(T / mu), the first transverse one;
#: "other_loads": point loads, and what the uniform load changes by, over T.
FEATURES = ("irvine_parameter", "pull_along", "end_motion", "end_acceleration", "frequency", "other_loads")
#: Instants at which motions and loads are looked at.
INSTANTS = 201


# to make the index of a coordinate takes as long as a thousand steps
@lru_cache
def feature_index() -> xr.IndexVariable:
    return xr.IndexVariable("feature", list(FEATURES))


def features(p: Parameters, length: float, until: float, tension: float | None = None) -> np.ndarray:
    """Compute FEATURES of a scene with a given unstretched length [m], from 0 to some time [s].

    `tension` is the mean of those at the ends at rest [N], where it is known.
    """
    if tension is None:
        columns = solve_statics(p, "unstretched_length", length)
        tension = 0.5 * float(columns[4] + columns[5])
    # a weightless slack cable has none: any small one makes it lie far outside
    tension = tension if tension > 0.0 else 1e-12 * p.stiffness
    times = np.linspace(0.0, until, INSTANTS)
    ends = p.end_positions(times[:1])
    chord = ends[0, 1] - ends[0, 0]
    size = float(np.linalg.norm(chord))
    along = chord / size
    load = p.load_at(0.0)
    pull = float(load @ along)
    across = float(np.linalg.norm(load - pull * along))
    moved = pushed = 0.0
    if p.motions:
        ends = p.end_positions(times)
        reach = ends[:, 1] - ends[:, 0]
        moved = float(np.abs(np.sqrt(np.einsum("td,td->t", reach, reach)) - size).max())
        second = p.end_positions(times, 2).reshape(-1, p.dims)
        second -= np.outer(second @ along, along)
        pushed = math.sqrt(float(np.einsum("td,td->t", second, second).max()))
    slowest, other = p.shortest_time_scale, 0.0
    for item in p.point_loads:
        other += float(np.linalg.norm(item.force)) * _largest(item.factor, times)
    if p.load is not None and p.load_factor is not None:
        factor = p.load_factor(times)
        other += float(np.linalg.norm(p.load)) * length * float(np.abs(factor - factor[0]).max())
    size_of = (p.stiffness, p.mass, length, tension)
    return _without_dimension(*size_of, across, pull, moved, pushed, slowest, other)


def _without_dimension(
    stiffness: Any, mass: Any, length: Any, tension: Any,
    across: Any, pull: Any, moved: Any, pushed: Any, slowest: Any, other: Any,
) -> np.ndarray:  # fmt: skip
    """FEATURES (..., features) of scenes from their numbers or arrays of them."""
    return np.stack(
        [
            (across * length / tension) ** 2 * stiffness / tension,
            abs(pull) * length / tension,
            moved * stiffness / (tension * length),
            mass * length * pushed / tension,
            2.0 * length / slowest * np.sqrt(mass / tension),
            other / tension,
        ],
        axis=-1,
    )


def features_of_columns(columns: MemberParameters, length: np.ndarray, until: float, tension: np.ndarray) -> np.ndarray:
    """Compute FEATURES of many scenes at once (members, features), as :func:`features` does of one."""
    tension = np.where(tension > 0.0, tension, 1e-12 * columns.stiffness)
    chord, load = columns.chord, columns.load
    size = np.sqrt((chord * chord).sum(axis=1))
    along = chord / size[:, None]
    pull = (load * along).sum(axis=1)
    across = np.sqrt(((load - pull[:, None] * along) ** 2).sum(axis=1))
    moved = pushed = np.zeros(size.size)
    if columns.motions:
        times = np.linspace(0.0, until, INSTANTS)
        ends = columns.end_positions(times)
        reach = ends[:, :, 1] - ends[:, :, 0]
        moved = np.abs(np.sqrt(np.einsum("mtd,mtd->mt", reach, reach)) - size[:, None]).max(axis=1)
        second = columns.end_positions(times, 2).reshape(size.size, -1, chord.shape[1])
        second -= np.einsum("mtd,md->mt", second, along)[:, :, None] * along[:, None]
        pushed = np.sqrt(np.einsum("mtd,mtd->mt", second, second).max(axis=1))
    size_of = (columns.stiffness, columns.mass, length, tension)
    return _without_dimension(*size_of, across, pull, moved, pushed, columns.shortest_time_scale, np.zeros(size.size))


def _largest(factor: Callable[[np.ndarray], np.ndarray] | None, times: np.ndarray) -> float:
    return 1.0 if factor is None else float(np.abs(factor(times)).max())


def describe(
    p: Parameters, length: float, until: float, tension: float | None = None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the variable ``scene_feature (feature)`` of a trajectory and its coordinate; see :func:`features`."""
    # given to the Dataset as it is made: to add them later takes as long as a short run
    return {"scene_feature": ("feature", features(p, length, until, tension))}, {"feature": feature_index()}
