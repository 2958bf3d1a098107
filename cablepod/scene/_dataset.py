"""Dataset of a scene whose tables are checked: a variable for each key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES, label, shared_coordinates
from cablepod.errors import SceneError
from cablepod.parameters._checks import direction, point, points
from cablepod.parameters._key_paths import variable_name
from cablepod.parameters._keys import Key, time_function_keys
from cablepod.parameters._tables import table_of

#: Tables that have to give something, beside those of lists.
NOT_EMPTY = ("initial", "cables")
#: Name -> dimensions, values, attributes.
Variables = dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]


def dataset_of(tree: Mapping[str, Any]) -> xr.Dataset:
    """Make the Dataset of a checked scene.

    Raises
    ------
    SceneError
        For vectors with another number of components than the scene has, and for empty tables.
    """
    axes = COORDINATES[: len(tree["ends"]["lower"]) if "ends" in tree else None]
    variables: Variables = {}
    for parts, values in tables_in(tree):
        table = table_of(parts)
        if table is None or not table.of:  # holds other tables only, or is that of an ensemble
            continue
        path = ".".join(parts)
        if not values and (parts[-1].isdecimal() or parts[0] in NOT_EMPTY):
            raise SceneError(f"{path}: given an empty table; allowed: one with some of {', '.join(table.keys)}")
        for name, key in table.keys.items():
            if name in values and name != "title":
                key_path = f"{path}.{name}" if path else name
                variables[variable_name(key_path)] = variable(key_path, values[name], key, axes)
        if table.factor is not None and "kind" in values:
            variables |= _time_function(path, values, table.factor, _meaning(parts), axes)
    scene = xr.Dataset(variables, coords=shared_coordinates({"coordinate": list(axes)}))
    label(scene[["coordinate"]])
    return scene


def tables_in(tree: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the parts of the path and the values of each table of nested ones."""
    yield above, tree
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from tables_in(value, (*above, name))
        elif isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            tables = ((number, entry) for number, entry in enumerate(value, start=1) if isinstance(entry, Mapping))
            for number, entry in tables:
                yield from tables_in(entry, (*above, name, str(number)))


def _meaning(parts: tuple[str, ...]) -> str:
    """Return what the time function of a table is, for long names."""
    if parts[0] == "motion":
        return f"displacement of the {parts[1]} end along {parts[2]}"
    names = {"load": "the uniform load", "point_load": f"point load {parts[-1]}", "mast": f"mast load {parts[-1]}"}
    return f"factor of {names[parts[0]]}"


def _time_function(path: str, table: Mapping[str, Any], units: str, meaning: str, axes: tuple[str, ...]) -> Variables:
    """Make the variables of a time function."""
    kind = {"units": "1", "long_name": f"kind of {meaning}"}
    variables: Variables = {variable_name(f"{path}.kind"): ((), np.asarray(table["kind"]), kind)}
    for name, key in time_function_keys(units)[table["kind"]].items():
        if name in table:
            own = Key(key.check, key.units, f"{key.long_name}, {meaning}")
            variables[variable_name(f"{path}.{name}")] = variable(f"{path}.{name}", table[name], own, axes)
    if table["kind"] == "file":
        samples = variable_name(f"{path}.sample")
        for name, unit in (("time", "s"), ("value", units)):
            attrs = {"units": unit, "long_name": f"{name} of the record, {meaning}"}
            variables[variable_name(f"{path}.{name}")] = ((samples,), np.array(table[name]), attrs)
    return variables


def variable(
    path: str, value: Any, key: Key, axes: tuple[str, ...]
) -> tuple[tuple[str, ...], np.ndarray, dict[str, str]]:
    """Make dimensions, values and attributes of the variable of a key, of a scene with the coordinates `axes`.

    Raises
    ------
    SceneError
        For a vector with another number of components.
    """
    attrs = {"units": "1" if key.units is None or isinstance(value, str) else key.units, "long_name": key.long_name}
    name = variable_name(path)
    if key.check is points:
        for index, vector in enumerate(value):
            _check_vector(f"{path}[{index}]", vector, axes)
        return (f"{name}_point", "coordinate"), np.array(value, dtype=float), attrs
    array = np.asarray(value)
    if array.ndim == 0:
        return (), array, attrs
    if key.check in (point, direction):
        _check_vector(path, value, axes)
        return ("coordinate",), array.astype(float), attrs
    return (f"{name}_item",), array.astype(float), attrs


def _check_vector(path: str, value: Any, axes: tuple[str, ...]) -> None:
    """Refuse a vector with another number of components than the scene has."""
    if len(value) != len(axes):
        spatial = "; try: a spatial scene, with three numbers in ends.lower" if len(value) > len(axes) else ""
        raise SceneError(
            f"{path}: given {len(value)} numbers; allowed: {len(axes)} numbers, for {', '.join(axes)}{spatial}"
        )
