"""Key paths of a scene: variables of the Dataset that they name, numbers in nested tables, their replacement.

A key path joins tables and key by points: ``cable.top_tension``, ``motion.upper.x.amplitude``.  An axis names a component of a
vector (``ends.upper.x``), a number from 1 a point load (``point_load.1.force.y``).  The variable of the scene Dataset has the
path with ``_`` for ``.``; the components of a vector share the variable of the vector.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

import xarray as xr

from cablepod.conventions import COORDINATES
from cablepod.parameters._keys import POINT_LOAD, TABLES, TOP, Key, time_function_keys


@lru_cache(maxsize=1024)
def variable_name(path: str) -> str:
    """Return the name of the variable of a key path in the scene Dataset."""
    return path.replace(".", "_")


def motion_path(end: str, axis: str) -> str:
    """Return the key path of the motion of an end along an axis."""
    return f"motion.{end}.{axis}"


def point_load_path(number: int) -> str:
    """Return the key path of a point load, counted from 1."""
    return f"point_load.{number}"


def table_at(values: Mapping[str, Any], path: str, keys: Iterable[str]) -> dict[str, Any]:
    """Return the present `keys` of the table at a key path, from values of variables by name."""
    return {key: values[name] for key, name in _variables_of_keys(path, tuple(keys)) if name in values}


@lru_cache(maxsize=1024)
def _variables_of_keys(path: str, keys: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    return tuple((key, variable_name(f"{path}.{key}")) for key in keys)


def variable_of(scene: xr.Dataset, path: Any) -> tuple[str, int | None, Key] | None:
    """Find the number of a scene Dataset at a key path.

    Returns
    -------
    tuple or None
        Name of the variable, index of the component of a vector (None for a scalar), and key; None for an unknown path.
    """
    parts = path.split(".") if isinstance(path, str) else []
    axis = COORDINATES.index(parts[-1]) if parts and parts[-1] in COORDINATES else None
    for component, of_key in ((None, parts), (axis, parts[:-1])):
        name, key = variable_name(".".join(of_key)), _key_of(scene, of_key)
        if key is None or key.units is None or name not in scene or scene[name].dtype.kind not in "if":
            continue
        is_vector = scene[name].dims == ("coordinate",)
        if component is None and not scene[name].dims:
            return name, None, key
        if component is not None and is_vector and component < scene[name].size:
            return name, component, key
    return None


def _key_of(scene: xr.Dataset, parts: list[str]) -> Key | None:
    """Return the key at a path; keys of time functions depend on their kind."""
    *tables, name = parts or [""]
    if not tables:
        return TOP.get(name)
    keys: dict[str, Key] = {}
    if len(tables) == 1:
        keys |= TABLES.get(tables[0], {})
    elif len(tables) == 2 and tables[0] == "point_load":
        keys |= POINT_LOAD
    kind = variable_name(".".join([*tables, "kind"]))
    if tables[0] in ("motion", "load", "point_load") and kind in scene and not scene[kind].dims:
        keys |= time_function_keys("m" if tables[0] == "motion" else "1")[str(scene[kind].values)]
    return keys.get(name)


def number_at(tree: Any, path: Any) -> float | None:
    """Return the number at a key path of nested tables; None for any other path."""
    value = tree
    for part in path.split(".") if isinstance(path, str) else ("",):
        if isinstance(value, Mapping):
            value = value.get(part)
        else:
            index = _index(value, part) if isinstance(value, list | tuple) else None
            value = value[index] if index is not None and index < len(value) else None
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def replaced(tree: Any, path: str, value: float) -> Any:
    """Replace the number at a key path in a copy of nested tables; missing tables are made."""
    return _replaced(tree, path.split("."), value)


def _replaced(tree: Any, parts: list[str], value: float) -> Any:
    if not parts:
        return value
    first, *rest = parts
    if tree is None or isinstance(tree, Mapping):
        return {**(tree or {}), first: _replaced((tree or {}).get(first), rest, value)}
    items = list(tree)
    index = _index(items, first)
    assert index is not None  # number_at found it
    items[index] = _replaced(items[index], rest, value)
    return items


def _index(values: list[Any] | tuple[Any, ...], part: str) -> int | None:
    """Return the index of a vector component or of a point load."""
    if len(values) and isinstance(values[0], Mapping):
        return int(part) - 1 if part.isdecimal() and int(part) > 0 else None
    return COORDINATES.index(part) if part in COORDINATES else None
