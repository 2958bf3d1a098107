"""Fields of wind: those given to a model, and the record of a scene, a netCDF file."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod._inputs import check_units
from cablepod.catenary._rest import _rest_of_member
from cablepod.errors import SceneError, named, scene_error
from cablepod.parameters._parameters import InWind, Parameters
from cablepod.parameters._time_functions import MAX_GAP
from cablepod.scene._files import read_bytes

#: Key of the record.
RECORD = "wind.turbulence.record"
#: Maximum size of a record [bytes].
LARGEST_FIELD = 2**30
#: Largest distance of a point of a field from the cable at rest, over the chord.
MAX_DISTANCE = 0.1
#: Number of points at which the height of the cable above the ground is checked.
GROUND_POINTS = 401
WHAT = "record, a netCDF file with wind (time, point, component)"
#: Units of the variables of a field.
UNITS_OF_FIELD = {"time": "s", "wind": "m s-1", "mean_wind": "m s-1", "position": "m", "relative_arc_length": "1"}


def read_wind_record(path: Path, expected: str | None) -> dict[str, str]:
    """Read the record of the wind; return its absolute path and the SHA-256 of its content.

    Raises
    ------
    SceneError
        For a file that is no field of wind, and one whose content is not as `expected`.
    """
    path = path.absolute()
    digest = hashlib.sha256(_content(path)).hexdigest()
    if expected is not None and expected != digest:
        raise scene_error("wind.turbulence.record_sha256", expected, f"that of {named(str(path))}, {digest}")
    _field(str(path), digest)
    return {"record": str(path), "record_sha256": digest}


def field_of_record(p: InWind) -> xr.Dataset:
    """Return the field of the record of a scene by path and content hash.

    Raises
    ------
    SceneError
        If the file has gone, or is not as it was when the scene was made.
    """
    assert p.turbulence is not None
    return _field(str(p.turbulence["record"]), str(p.turbulence["record_sha256"]))


def check_above_ground(p: Parameters, position: np.ndarray | None = None) -> None:
    """Refuse a scene with wind whose cable at rest in still air, at positions (points, dims) [m], lies below the ground."""
    if p.wind is None:
        return
    if position is None:
        position = _rest_of_member(p, GROUND_POINTS)[0]
    ground, lowest = float(p.wind["ground"]), float(position[:, 1].min())
    if lowest < ground - 1e-9 * float(np.abs(position).max()):
        raise scene_error("wind.ground", ground, f"at most the lowest point of the cable at rest, {lowest:g} m")


def key_of_record(p: InWind) -> str:
    """Return key and name of the record, for messages."""
    assert p.turbulence is not None
    return f"{RECORD}: {named(str(p.turbulence['record']))}"


def checked_field(
    p: Parameters, end_time: float, given: xr.Dataset, key: str = "wind"
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Check a field; return its instants [s], and of the points near the cable the relative arc lengths, velocities, mean.

    Velocities (samples, points, dims) and their mean (points, dims) are in m/s.

    Raises
    ------
    SceneError
        For a field without points near the cable, one that does not cover the run until `end_time` [s], instants that do not
        rise, components other than the axes of the scene, and values that are not finite; the message begins with `key`.
    """
    _check_variables(key, given, ("wind", "time", "point", "component"), "a field, such as that of wind.field")
    _check_numbers(key, given, "time", ("time",))
    _check_numbers(key, given, "wind", ("time", "point", "component"))
    for name, units in UNITS_OF_FIELD.items():
        if name in given.variables:
            check_units(f"{key}: {name}", given[name], units)
    if given.variables["component"].dims != ("component",):
        raise SceneError(f"{key}: given component over {given['component'].dims}; allowed: the axes over component")
    given = by_axes(given)
    axes, own = "xyz"[: p.dims], given.variables["component"].values
    if list(own) != list(axes):
        raise SceneError(f"{key}: given the components {', '.join(map(str, own))}; allowed: {', '.join(axes)}")
    time = np.asarray(given.variables["time"].values, dtype=float)
    velocity = given.variables["wind"].transpose("time", "point", "component").values.astype(float, copy=False)
    if time.size < 2 or not velocity.shape[1] or not (np.diff(time) > 0.0).all() or not np.isfinite(time).all():
        raise SceneError(
            f"{key}: given instants that do not rise, or none ({time.size} instants, {velocity.shape[1]} points); "
            "allowed: at least two rising instants [s] and a point"
        )
    if not np.isfinite(velocity).all():
        raise SceneError(f"{key}: given values that are not finite; allowed: finite velocities [m/s]")
    spacing = np.diff(time)
    if spacing.max() > MAX_GAP * np.median(spacing):
        raise SceneError(
            f"{key}: given a gap of {spacing.max():g} s after {time[spacing.argmax()]:g} s; allowed: at most ten times the "
            f"median spacing, {np.median(spacing):g} s"
        )
    if time[0] > 0.0 or time[-1] < end_time * (1.0 - 1e-12):
        raise SceneError(
            f"{key}: the field is too short, from {time[0]:g} s to {time[-1]:g} s; allowed: one that covers the run, from 0 s to "
            f"{end_time:g} s"
        )
    sigma, order = _places_of(p, given, key)
    if not np.array_equal(order, np.arange(velocity.shape[1])):
        velocity = velocity[:, order]
    if "mean_wind" not in given.variables:
        mean = velocity.mean(axis=0)
    else:
        _check_numbers(key, given, "mean_wind", ("point", "component"))
        mean = given.variables["mean_wind"].transpose("point", "component").values.astype(float)[order]
        if not np.isfinite(mean).all():
            raise SceneError(f"{key}: given a mean_wind that is not finite; allowed: finite velocities [m/s]")
    return time, sigma, velocity, mean


def linear_between(given: np.ndarray, values: np.ndarray, places: np.ndarray, axis: int = 1) -> np.ndarray:
    """Interpolate values (samples, points, dims), given at rising places or instants along an axis, to others, held beyond."""
    if given.size == 1:
        return np.repeat(values, places.size, axis=axis)
    right = np.clip(np.searchsorted(given, places), 1, given.size - 1)
    share = np.clip((places - given[right - 1]) / (given[right] - given[right - 1]), 0.0, 1.0)
    share = share.reshape(-1, *[1] * (values.ndim - 1 - axis))
    return (1.0 - share) * values.take(right - 1, axis) + share * values.take(right, axis)


def by_axes(field: xr.Dataset) -> xr.Dataset:
    """Return a field whose components are in the order of the axes; as it is where they have no such labels."""
    component = field.variables.get("component")
    if component is None or component.dims != ("component",):
        return field
    names = [str(name) for name in component.values]
    return field if names == sorted(names) else field.isel(component=np.argsort(names))


def positions_of(given: xr.Dataset, key: str) -> np.ndarray:
    """Return the positions of the points of a field (points, dims) [m]; refuse what are no finite numbers."""
    _check_numbers(key, given, "position", ("point", "component"))
    place = given.variables["position"].transpose("point", "component").values.astype(float)
    if not np.isfinite(place).all():
        raise SceneError(f"{key}: given a position that is not finite; allowed: finite positions [m]")
    return place


def _check_variables(key: str, given: Any, names: tuple[str, ...], allowed: str) -> None:
    """Refuse a field that is no Dataset, or lacks variables."""
    if not isinstance(given, xr.Dataset):
        raise SceneError(f"{key}: given a {type(given).__name__}; allowed: {allowed}")
    missing = [name for name in names if name not in given.variables and not (name == "point" and name in given.dims)]
    if missing:
        raise SceneError(f"{key}: given a Dataset without {' and '.join(missing)}; allowed: {allowed}")


def _check_numbers(key: str, given: xr.Dataset, name: str, dims: tuple[str, ...]) -> None:
    """Refuse a variable of a field that holds no numbers, or has other dimensions."""
    array = given.variables[name]
    if set(array.dims) != set(dims) or array.dtype.kind not in "iuf":
        raise SceneError(f"{key}: given {name} over {array.dims} of type {array.dtype}; allowed: numbers over {dims}")


def _places_of(p: Parameters, given: xr.Dataset, key: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the relative arc lengths of the points of a field near the cable, rising, and their numbers from 0."""
    if "relative_arc_length" in given.variables:
        _check_numbers(key, given, "relative_arc_length", ("point",))
        sigma = np.asarray(given.variables["relative_arc_length"].values, dtype=float)
        if not ((sigma >= 0.0) & (sigma <= 1.0)).all():
            raise SceneError(
                f"{key}: given relative_arc_length outside of the cable; allowed: a number from 0 to 1 a point"
            )
        if "guy" in given.variables and np.unique(given.variables["guy"].values).size > 1:
            raise SceneError(f"{key}: given the field of a mast; allowed: one of a cable, or the points of one guy")
        near, distance = np.ones(sigma.size, dtype=bool), np.zeros(sigma.size)
    else:
        _check_variables(
            key, given, ("position",), "a field with relative_arc_length (point) or position (point, component)"
        )
        place = positions_of(given, key)
        of_rest, rest = np.linspace(0.0, 1.0, 401), _rest_of_member(p, 401)[0]
        distances = np.sqrt(((place[:, None] - rest[None]) ** 2).sum(axis=-1))
        sigma, distance = of_rest[distances.argmin(axis=1)], distances.min(axis=1)
        chord = float(np.linalg.norm(rest[-1] - rest[0]))
        near = distance <= MAX_DISTANCE * chord
        if not near.any():
            raise SceneError(
                f"{key}: given a field with no point near the cable (the nearest is {distance.min():.3g} m away); "
                f"allowed: points within {MAX_DISTANCE * chord:.3g} m"
            )
    order = np.flatnonzero(near)[np.lexsort((distance[near], sigma[near]))]  # of points at one place the nearest
    order = order[np.concatenate([[True], np.diff(sigma[order]) > 0.0])]
    return sigma[order], order


# --- file -----------------------------------------------------------------------------------------------------------------


def _content(path: Path) -> bytes:
    """Read a record; the error names the key."""
    content = read_bytes(path, WHAT, LARGEST_FIELD, key=RECORD)
    if not content:
        raise SceneError(f"{RECORD}: {named(str(path))} is empty; allowed: a {WHAT}")
    return content


@lru_cache(4)
def _field(path: str, sha256: str) -> xr.Dataset:
    """Read the field of a file: what is hashed is what is read."""
    content = _content(Path(path))
    if hashlib.sha256(content).hexdigest() != sha256:
        raise SceneError(
            f"{RECORD}: {named(path)} has changed since the scene was made; allowed: the file with the SHA-256 {sha256}; "
            "try: make the scene again"
        )
    from netCDF4 import Dataset
    from xarray.backends import NetCDF4DataStore

    try:
        with Dataset("record", memory=content) as file:
            store: Any = NetCDF4DataStore(file)
            field = xr.open_dataset(store, decode_times=False, decode_timedelta=False).load()
    except Exception as error:  # of the library, by the kind of damage
        raise SceneError(
            f"{RECORD}: {named(path)} is no netCDF file, or damaged ({error}); allowed: a {WHAT}"
        ) from None
    return field
