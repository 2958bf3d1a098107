"""Key paths of a scene: variables of the Dataset that they name, numbers in nested tables, their replacement.

A key path joins tables and key by points: ``cable.top_tension``, ``motion.upper.x.amplitude``.  An axis names a component of a
vector (``ends.upper.x``), a number from 1 a table of a list (``point_load.1.force.y``).  The variable of the scene Dataset has
the path with ``_`` for ``.``; the components of a vector share the variable of the vector.

Wherever a key path is taken, its two forms are the same: nested tables, and the path with points.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES
from cablepod.errors import SceneError, named, shown
from cablepod.parameters._keys import Key
from cablepod.parameters._tables import LISTS, is_like, key_at, place_of_variable

#: Maximum number of parts of a key path: ``motion.upper.x.amplitude`` has four, ``ensemble.ranges`` holds such paths.
MAX_PARTS = 6


@lru_cache(maxsize=1024)
def variable_name(path: str) -> str:
    """Return the name of the variable of a key path in the scene Dataset."""
    return path.replace(".", "_")


def dotted(path: Any) -> Any:
    """Return the key path of a variable of the scene Dataset (``cable_top_tension``); anything else as it is."""
    place = place_of_variable(path) if isinstance(path, str) and "." not in path else None
    return path if place is None else place.path


def key_of_variable(name: str) -> Key | None:
    """Return the key of a variable of a scene Dataset, of a component the number; None for other variables."""
    place = place_of_variable(name)
    return place.key if place is not None and place.of else None


def nested(tree: Mapping[Any, Any]) -> Mapping[Any, Any]:
    """Return the tables of a scene as nested mappings, given in any form of key paths.

    Raises
    ------
    SceneError
        If two forms of one key are given, and for the name of a variable in place of the path.
    """
    for key in tree:
        if (path := dotted(key)) != key:
            raise SceneError(f"{key}: unknown key or table; allowed: tables, and key paths with points; try: {path}")
    if all(isinstance(key, str) and "." not in key for key in tree) and not any(
        isinstance(table, Mapping) and any(isinstance(key, str) and "." in key for key in table)
        for table in tree.values()
    ):
        return tree
    paths = sorted(_paths(tree, ()), key=lambda item: _order(item[0]))
    result: dict[Any, Any] = {}
    for parts, value in paths:
        _place(result, parts, value)
    return result


def _order(parts: tuple[Any, ...]) -> tuple[bool, int, int]:
    """Return the order in which values are placed: vectors before their components, tables before keys, loads by number."""
    depth = next((count for count in range(1, len(parts)) if _is_list(parts[:count])), 0)
    number = parts[depth] if 0 < depth < len(parts) else ""
    is_number = isinstance(number, str) and number.isdecimal() and len(number) < 10
    return parts[-1] in COORDINATES, len(parts), int(number) if is_number else 0


def _is_list(path: tuple[Any, ...]) -> bool:
    """Tell whether the table at a path is a list."""
    return any(is_like(path, own) for own in LISTS)


def _paths(tree: Mapping[Any, Any], above: tuple[Any, ...]) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Yield the parts of the key path of each value of nested tables; tables that are empty or hold no names are values."""
    for key, value in tree.items():
        is_whole = above[:2] == ("ensemble", "ranges")  # keys there are key paths themselves
        parts = (*above, *(key.split(".") if isinstance(key, str) and not is_whole else (key,)))
        if isinstance(value, Mapping) and value and len(parts) < MAX_PARTS:
            yield from _paths(value, parts)
        else:
            yield parts, value


def _place(tree: dict[Any, Any], parts: tuple[Any, ...], value: Any) -> None:
    """Put a value at its place in nested tables; missing tables are made, also those of point loads."""
    table: Any = tree
    for depth, part in enumerate(parts):
        last = depth == len(parts) - 1
        if isinstance(table, list):
            index = _index(table, part) if table and not isinstance(table[0], Mapping) else _new_index(table, part)
            if index is None or index >= len(table):
                raise SceneError(f"{'.'.join(map(named, parts))}: unknown key path; allowed: a key of a table")
            if last:
                table[index] = value
            else:
                table[index] = table = _mutable(table[index])
            continue
        if last:
            if part in table:
                path = ".".join(map(named, parts))
                raise SceneError(f"{path}: given in two forms, {shown(table[part])} and {shown(value)}; allowed: one")
            table[part] = value
        else:
            empty: Any = [] if _is_list(parts[: depth + 1]) else {}
            table[part] = table = _mutable(table.get(part, empty))
        if not isinstance(table, dict | list):
            path = ".".join(map(named, parts))
            raise SceneError(f"{path}: given beside {shown(table)}; allowed: a table, or the keys of one")


def _mutable(value: Any) -> Any:
    """Return a copy of a table or list that can be changed; any other value as it is."""
    if isinstance(value, Mapping):
        return dict(value)
    return list(value) if isinstance(value, list | tuple | np.ndarray) else value


def _new_index(loads: list[Any], part: Any) -> int | None:
    """Return the index of a point load, which may be the next one."""
    index = int(part) - 1 if isinstance(part, str) and part.isdecimal() and len(part) < 10 else -1
    if index == len(loads):
        loads.append({})
    return index if 0 <= index < len(loads) else None


def flat(ranges: Any, depth: int = MAX_PARTS) -> Any:
    """Return ranges by key paths with points, given in any form; anything else as it is.

    Raises
    ------
    SceneError
        If two forms of one key are given.
    """
    if not isinstance(ranges, Mapping):
        return ranges
    result: dict[Any, Any] = {}
    for path, values in ranges.items():
        below = flat(values, depth - 1) if isinstance(values, Mapping) and values and depth > 1 else {}
        found = {f"{path}.{part}": range_values for part, range_values in below.items()} or {path: values}
        for key, range_values in found.items():
            if key in result:
                raise SceneError(f"ensemble.ranges.{named(key)}: given in two forms; allowed: one")
            result[key] = range_values
    return result


def motion_path(end: str, axis: str) -> str:
    """Return the key path of the motion of an end along an axis."""
    return f"motion.{end}.{axis}"


def listed_path(table: str, number: int) -> str:
    """Return the key path of a table of a list, counted from 1."""
    return f"{table}.{number}"


def variable_of(scene: xr.Dataset, path: Any) -> tuple[str, int | None, Key] | None:
    """Find the number of a scene Dataset at a key path.

    Returns
    -------
    tuple or None
        Name of the variable, index of the component of a vector (None for a scalar), and key; None for an unknown path.
    """
    parts = path.split(".") if isinstance(path, str) else []
    axis = COORDINATES.index(parts[-1]) if parts and parts[-1] in COORDINATES else None
    for component, of_key in ((None, ".".join(parts)), (axis, ".".join(parts[:-1]))):
        name, key = variable_name(of_key), key_in(scene, of_key)
        if key is None or key.units is None or name not in scene or scene[name].dtype.kind not in "if":
            continue
        is_vector = scene[name].dims == ("coordinate",)
        if component is None and not scene[name].dims:
            return name, None, key
        if component is not None and is_vector and component < scene[name].size:
            return name, component, key
    return None


def key_in(scene: xr.Dataset, path: str) -> Key | None:
    """Return the key at a path of a scene Dataset, of a time function that of its kind; None for other paths."""
    return key_at(path, kind_in(scene, path.rpartition(".")[0]))


def kind_in(scene: xr.Dataset, path: str) -> str | None:
    """Return the kind of the time function at a key path of a scene Dataset; None without one, and where it varies."""
    name = variable_name(f"{path}.kind")
    return str(scene[name].values) if name in scene and not scene[name].dims else None


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


def _index(values: list[Any] | tuple[Any, ...], part: str) -> int | None:
    """Return the index of a vector component or of a point load."""
    if len(values) and isinstance(values[0], Mapping):
        return int(part) - 1 if part.isdecimal() and int(part) > 0 else None
    return COORDINATES.index(part) if part in COORDINATES else None
