"""Public function: velocity of the air at points, over time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import check_times, check_units
from cablepod.batch._members import no_plan, over_members_by
from cablepod.conventions import COORDINATES
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import integer, point
from cablepod.parameters._from_scene import SceneContent
from cablepod.parameters._mast import MastParameters, mast_parameters
from cablepod.parameters._parameters import gust_interval, has_record
from cablepod.scene._mast import scene_kind
from cablepod.scene._mast_field import mast_points
from cablepod.scene._wind_field import linear_between
from cablepod.wind._air import (
    air_of,
    instants_until,
    mean_velocity,
    rest_points,
    turbulence_at,
)
from cablepod.wind._mast_air import mast_air


@over_members_by(no_plan, kind=scene_kind)
def field(scene: xr.Dataset, *, times: Any = None, seed: int | None = None, points: Any = None) -> xr.Dataset:
    """Compute the velocity of the air: mean wind and turbulence at points, over time.

    Parameters
    ----------
    scene
        A scene with the table ``[wind]``, of a cable or of a mast, with or without ``member``.
    times
        Instants [s], rising from 0 on; by default those of the turbulence until the duration of the scene, every 0.1 s or
        ``wind.turbulence.interval``; between these it is linear.
    seed
        Seed of the turbulence, instead of the scene's.
    points
        Positions (points, coordinates) [m], of which a DataArray may label the coordinates "x", "y", "z"; by default 41 points
        along the cable at rest in still air, at equal intervals of the unstretched arc length, and a few more where the profile
        of the mean wind bends; of a mast 17 points, and 9 of the chord of each guy.

    Returns
    -------
    xarray.Dataset
        ``wind (time, point, component)`` [m/s], the velocity of the air along each axis, ``mean_wind (point, component)`` [m/s],
        ``position (point, component)`` [m] and, on the cable, ``relative_arc_length (point)``, on a mast also ``guy (point)``, 0
        for the mast.  What models take as ``wind=``.

    Raises
    ------
    SceneError
        For a scene without wind, a cable below the ground, points below it, and seed or points with a record.

    Notes
    -----
    A sum of harmonics with the amplitudes of the spectrum and random phases, coupled by Davenport's coherence; both components
    are independent of each other.  The turbulence is carried along with the mean speed at the reference height (Taylor's
    hypothesis).  It depends on seed, spectrum, points and duration, on nothing else.  ``wind.ramp`` belongs to runs: models let a
    field rise as they do the wind of the scene.

    M. Shinozuka and G. Deodatis, Simulation of stochastic processes by spectral representation, Appl. Mech. Rev. 44, 191 (1991).

    Examples
    --------
    >>> import cablepod as cp
    >>> scene = cp.make_scene(
    ...     {
    ...         "cable": {"strand": "EHS 1/2 in", "top_tension": 15000.0, "diameter": 0.0127},
    ...         "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    ...         "wind": {"speed": 25.0, "direction": [1.0, 0.0], "turbulence": {"spectrum": "kaimal", "seed": 7}},
    ...         "time": {"duration": 60.0, "interval": 1.0},
    ...     }
    ... )
    >>> wind = cp.wind.field(scene)
    >>> wind.wind.dims, wind.sizes["point"], round(float(wind.wind.isel(point=-1).std()), 1) > 1.0
    (('time', 'point', 'component'), 47, True)
    """
    is_mast = "mast_height" in scene
    p: Any = mast_parameters(scene) if is_mast else SceneContent.of(scene).parameters()
    if p.wind is None:
        raise SceneError("wind: missing; allowed: a scene with the table wind, which gives speed and direction")
    if seed is not None:
        integer(least=0)("seed", seed)
        p = _with_seed(p, int(seed))
    if times is None:
        if p.duration is None:
            raise SceneError("times: missing; allowed: instants [s], or a scene with time.duration")
        time = gust_interval(p) * np.arange(instants_until(p, p.duration))
    else:
        time = check_times(times)
    dims = 3 if is_mast else p.dims
    position, number, sigma = _points_of(p, points, dims)
    if has_record(p) or (is_mast and points is None):
        if has_record(p):
            _refuse_beside_record(seed, points)
        mean, velocity = _of_runs(p, time)
    else:
        mean = mean_velocity(p, position[:, 1])
        velocity = np.repeat(mean[None], time.size, axis=0)
        if p.turbulence is not None:
            velocity += _turbulence(p, position, time)
    result = _labelled(dims, time, position, mean, velocity, sigma, number)
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: wind", stage="wind", seed=_seed(p), spectrum=_spectrum(p)
    )
    options = {"times": None if times is None else time, "seed": seed, "points": None if points is None else position}
    return provenance.record(
        result,
        function="wind.field",
        parameters=options,
        inputs=[scene],
        chosen=provenance.defaulted_options(**options),
    )


def _turbulence(p: Any, position: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the turbulence (instants, points, dims) [m/s]."""
    values = turbulence_at(p, position, max(float(time[-1]), p.duration or 0.0))
    instants = gust_interval(p) * np.arange(len(values))
    if np.array_equal(time, instants[: time.size]):
        return values[: time.size]
    return linear_between(instants, values, time, axis=0)


def _of_runs(p: Any, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean velocity (points, dims) and velocity (instants, points, dims) that runs have without a ramp [m/s]."""
    p = replace(p, wind={**p.wind, "ramp": 0.0})
    air: Any = (mast_air if isinstance(p, MastParameters) else air_of)(p, float(time[-1]))
    if isinstance(p, MastParameters):
        mean, velocity = air.mean, air.velocity
    else:
        sigma = rest_points(p)[0]
        mean, velocity = air.steady.at(sigma)[0], air.at(sigma)
    return mean, linear_between(np.arange(len(velocity)) / air.samples_per_second, velocity, time, axis=0)


def _points_of(p: Any, points: Any, dims: int) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Return positions (points, dims) [m], numbers of the guys on a mast, and relative arc lengths; None where there are none."""
    is_mast = isinstance(p, MastParameters)
    if points is None:
        if is_mast:
            return mast_points(p)
        sigma, position = rest_points(p)
        return position, None, sigma
    check_units("points", points, "m")
    if isinstance(points, xr.DataArray):
        points = _by_labels(points)
    given = np.asarray(points).tolist() if isinstance(points, np.ndarray | xr.DataArray) else points
    if not isinstance(given, list | tuple) or not given:
        raise scene_error("points", points, "a list of positions [m]")
    places = [point(f"points[{number}]", place) for number, place in enumerate(given)]
    if {len(place) for place in places} != {dims}:
        raise scene_error(
            "points", places[0], f"{dims} numbers each" + ("" if is_mast else ", as many as ends.lower has")
        )
    position, ground = np.array(places), float(p.wind["ground"])
    if position[:, 1].min() < ground:
        raise scene_error("points", float(position[:, 1].min()), f"points above wind.ground, {ground:g} m")
    return position, None, None


def _refuse_beside_record(seed: int | None, points: Any) -> None:
    for key, value in (("seed", seed), ("points", points)):
        if value is not None:
            raise scene_error(key, value, "none with wind.turbulence.record, which is a field along the cable")


def _by_labels(points: xr.DataArray) -> xr.DataArray:
    """Return positions whose last dimension is that of the axes, in their order; as they are without such labels."""
    for name, label in points.coords.items():
        if label.dims == (name,) and sorted(map(str, label.values)) == list(COORDINATES[: label.size]):
            return points.sortby(str(name)).transpose(..., name)
    return points


def _with_seed(p: Any, seed: int) -> Any:
    return p if p.turbulence is None or has_record(p) else replace(p, turbulence={**p.turbulence, "seed": seed})


def _seed(p: Any) -> int:
    return -1 if p.turbulence is None or has_record(p) else int(p.turbulence["seed"])


def _spectrum(p: Any) -> str:
    return "none" if p.turbulence is None else "record" if has_record(p) else str(p.turbulence["spectrum"])


def _labelled(
    dims: int, time: np.ndarray, position: np.ndarray, mean: np.ndarray, velocity: np.ndarray, sigma: np.ndarray | None,
    number: np.ndarray | None,
) -> xr.Dataset:  # fmt: skip
    """Return the Dataset of a field with units and long names."""
    numbers = np.arange(1, len(position) + 1)
    coords: dict[str, Any] = {
        "time": ("time", time, {"units": "s", "long_name": "time since the start of the run"}),
        "point": ("point", numbers, {"units": "1", "long_name": "number of the point"}),
        "component": ("component", list(COORDINATES[:dims]), {"units": "1", "long_name": "axis of the velocity"}),
    }
    if sigma is not None:
        along = "unstretched arc length from the lower end over that of the cable"
        label = {"units": "1", "long_name": along if number is None else "distance from foot or anchor over the length"}
        coords["relative_arc_length"] = ("point", sigma, label)
    if number is not None:
        coords["guy"] = ("point", number, {"units": "1", "long_name": "number of the guy of the point, 0 for the mast"})
    return xr.Dataset(
        {
            "wind": (("time", "point", "component"), velocity, {"units": "m s-1", "long_name": "velocity of the air"}),
            "mean_wind": (("point", "component"), mean, {"units": "m s-1", "long_name": "mean velocity of the air"}),
            "position": (("point", "component"), position, {"units": "m", "long_name": "position of the point"}),
        },
        coords=coords,
    )
