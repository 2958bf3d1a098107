"""Fields of wind on a mast and its guys: the points that a scene fixes, and fields that are given there."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import xarray as xr

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._mast import MastParameters
from cablepod.scene._wind_field import (
    by_axes,
    checked_field,
    linear_between,
    positions_of,
)

#: Points of the air along each guy, and along the mast.
GUY_POINTS, MAST_POINTS = 9, 17
#: Largest distance of a point of a field from the mast or from the chord of a guy, over the length.
MAX_DISTANCE = 0.02


def mast_points(p: MastParameters) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points of the mast from below, then those of the chord of each guy from its anchor.

    Chords do not depend on tension or ice, so that masts which differ in these share their wind.

    Returns
    -------
    tuple
        Positions (points, 3) [m], number of the guy, 0 for the mast (points,), and relative distance from foot or anchor.

    Raises
    ------
    SceneError
        For anchors or a foot below the ground of the wind.
    """
    height, sigma = np.linspace(0.0, p.height, MAST_POINTS), np.linspace(0.0, 1.0, GUY_POINTS)
    mast = np.stack([0.0 * height, height, 0.0 * height], axis=1)
    chords = [guy.p.lower + sigma[:, None] * (guy.p.upper - guy.p.lower) for guy in p.guys]
    position = np.concatenate([mast, *chords])
    number = np.concatenate([np.zeros(MAST_POINTS, dtype=int), np.repeat(np.arange(1, len(chords) + 1), GUY_POINTS)])
    relative = np.concatenate([height / p.height, *([sigma] * len(chords))])
    if p.wind is not None:
        ground, lowest = float(p.wind["ground"]), float(position[:, 1].min())
        if lowest < ground - 1e-9 * p.height:
            raise scene_error(
                "wind.ground", ground, f"at most the lowest anchor and the foot of the mast, {lowest:g} m"
            )
    return position, number, relative


def at_mast_points(
    p: MastParameters, end_time: float, given: xr.Dataset, key: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return instants [s], velocities (instants, points, 3) and means (points, 3) [m/s] of a field at the points of a mast.

    Points of a field belong to the mast or to a guy by the coordinate ``guy`` with ``relative_arc_length``, else by
    ``position``; velocities are linear between them.

    Raises
    ------
    SceneError
        For a field without points on the mast or on a guy, and as :func:`checked_field`; the message begins with `key`.
    """
    position, number, relative = mast_points(p)
    given = by_axes(given) if isinstance(given, xr.Dataset) else given
    spatial: Any = SimpleNamespace(dims=3)  # what checked_field asks of a cable whose points are known
    velocity: Any = None
    mean, time = np.empty((len(position), 3)), np.empty(0)
    for line in range(len(p.guys) + 1):
        where = np.flatnonzero(number == line)
        ends = position[where[[0, -1]]]
        name = "the mast" if line == 0 else f"guy {line} ({p.guys[line - 1].key})"
        own = _of_line(given, line, ends, key, name)
        time, sigma, values, means = checked_field(spatial, end_time, own, key)
        if velocity is None:
            velocity = np.empty((time.size, len(position), 3))
        velocity[:, where] = linear_between(sigma, values, relative[where])
        mean[where] = linear_between(sigma, means, relative[where], axis=0)
    return time, velocity, mean


def _of_line(given: Any, line: int, ends: np.ndarray, key: str, name: str) -> Any:
    """Return the points of a field on the mast or on a guy, with ``relative_arc_length``; another object as it is."""
    if not isinstance(given, xr.Dataset) or "point" not in given.dims:
        return given
    if "guy" in given.variables and "relative_arc_length" in given.variables:
        if given["guy"].dims != ("point",) or given["guy"].dtype.kind not in "iu":
            raise SceneError(
                f"{key}: given guy of type {given['guy'].dtype}; allowed: whole numbers over point, 0 for the mast"
            )
        chosen = np.flatnonzero(given["guy"].values == line)
        own = given.isel(point=chosen)
    else:
        if "position" not in given.variables:
            raise SceneError(
                f"{key}: given a field without places; allowed: one with position (point, component) [m], or with guy and "
                "relative_arc_length (point)"
            )
        place = positions_of(given, key)
        if place.shape[1] != 3:
            raise SceneError(f"{key}: given positions of {place.shape[1]} numbers; allowed: three")
        reach, from_end = ends[1] - ends[0], place - ends[0]
        length = float(np.linalg.norm(reach))
        sigma = np.clip(from_end @ reach / length**2, 0.0, 1.0)
        distance = np.linalg.norm(from_end - sigma[:, None] * reach, axis=1)
        chosen = np.flatnonzero(distance <= MAX_DISTANCE * length)
        own = given.drop_vars("guy", errors="ignore").isel(point=chosen)
        own = own.assign_coords(relative_arc_length=("point", sigma[chosen]))
    if not chosen.size:
        raise SceneError(
            f"{key}: given a field without a point on {name}; allowed: points on the mast and on the chord of each guy; "
            "try: wind.field of the scene"
        )
    return own
