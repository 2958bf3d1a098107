"""Similarity numbers of a scene: dimensionless parameters of the dynamics of a taut cable.

Trajectories of the chain and of the continuous cable carry these numbers as a variable, so that ``xarray.concat`` keeps those of
all runs.  Modes carry the range of their training scenes, and reduced runs their distance from it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cablepod.catenary._sag import irvine_parameter
from cablepod.catenary._statics import solve_statics
from cablepod.conventions import FEATURES
from cablepod.parameters._parameters import Parameters

#: Number of instants at which motions and loads are sampled.
INSTANTS = 201


def features(p: Parameters, length: Any, end_time: float, tension: Any = None) -> np.ndarray:
    """Compute FEATURES of a scene with an unstretched length [m] until `end_time` [s].

    `tension` is the mean of both end tensions at rest in still air [N], computed if None.  Stacked members give (members,
    features) for arrays of lengths and tensions.
    """
    if tension is None:
        statics = solve_statics(p, "unstretched_length", length)
        tension = 0.5 * float(statics[4] + statics[5])
    # a weightless slack cable has no tension: a small one puts it far from all taut scenes
    tension = np.where(tension > 0.0, tension, 1e-12 * p.stiffness)
    times = np.linspace(0.0, end_time, INSTANTS)
    chord = _reach(p.initial_ends)
    chord_length = np.sqrt(_dot(chord, chord))
    along = chord / chord_length[..., None]
    load = p.load_at(0.0)
    tangential = _dot(load, along)
    normal = load - tangential[..., None] * along
    chord_change: Any = 0.0
    acceleration: Any = 0.0
    if p.motions:
        reach = _reach(p.end_positions(times))
        change = np.sqrt(np.einsum("...td,...td->...t", reach, reach)) - chord_length[..., None]
        chord_change = np.abs(change).max(axis=-1)
        second = p.end_positions(times, 2)
        second = second.reshape(*second.shape[:-3], -1, p.dims)
        second -= (second @ along[..., None]) * along[..., None, :]
        acceleration = np.sqrt(np.einsum("...td,...td->...t", second, second).max(axis=-1))
    other_loads = 0.0
    for load_at_point in p.point_loads:
        other_loads += float(np.linalg.norm(load_at_point.force)) * _largest(load_at_point.factor, times)
    if p.load is not None and p.load_factor is not None:
        factor = p.load_factor(times)
        other_loads += float(np.linalg.norm(p.load)) * length * float(np.abs(factor - factor[0]).max())
    return np.stack(
        [
            irvine_parameter(np.sqrt(_dot(normal, normal)), length, tension, p.stiffness),
            abs(tangential) * length / tension,
            chord_change * p.stiffness / (tension * length),
            p.mass * length * acceleration / tension,
            2.0 * length / p.shortest_time_scale * np.sqrt(p.mass / tension),
            other_loads / tension,
        ],
        axis=-1,
    )


def _reach(ends: np.ndarray) -> np.ndarray:
    """Return the vectors between ends (..., end, dims)."""
    return ends[..., 1, :] - ends[..., 0, :]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the inner products of vectors (..., dims)."""
    return (a[..., None, :] @ b[..., :, None])[..., 0, 0]


def _largest(factor: Callable[[np.ndarray], np.ndarray] | None, times: np.ndarray) -> float:
    """Return the largest absolute value of a load factor; None is the constant 1."""
    return 1.0 if factor is None else float(np.abs(factor(times)).max())


def describe(
    p: Parameters, length: float, end_time: float, tension: float | None = None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the variable ``scene_feature (feature)`` of a trajectory and its coordinate, see :func:`features`.

    Both belong in the constructor of the Dataset: adding them later costs as much as a short run.
    """
    return {"scene_feature": ("feature", features(p, length, end_time, tension))}, {"feature": np.array(FEATURES)}
