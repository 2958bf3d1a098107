"""Values of a scene Dataset, which may have been changed by hand: as nested tables, checked as those of a scene file are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from cablepod.errors import SceneError
from cablepod.parameters._key_paths import listed_path, variable_name
from cablepod.parameters._keys import Key, describe, time_function_keys
from cablepod.parameters._tables import key_at, place_of_variable


def tables_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of scene variables by name as nested tables; those of a list by their number, a text."""
    tables: dict[str, Any] = {}
    for name, value in values.items():
        place = place_of_variable(name)
        if place is None or place.axis or not place.of:
            continue
        table = tables
        for part in place.table:
            table = table.setdefault(part, {})
        table[place.name] = value
    return tables


def listed(tables: Mapping[str, Any], name: str, above: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield key path and values of each table of a list; `above` is the beginning of the path of the list.

    Raises
    ------
    SceneError
        For a table whose number is not the next one, as in a Dataset that lost the table before it.
    """
    given = tables.get(name, {})
    for number in range(1, len(given) + 1):
        path = listed_path(f"{above}{name}", number)
        if str(number) not in given:
            beyond = listed_path(f"{above}{name}", min(int(other) for other in given if int(other) > number))
            raise SceneError(f"{beyond}: given without {path}; allowed: tables numbered from 1, without a gap")
        yield path, given[str(number)]


def of_keys(table: Mapping[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    """Return the values of a table that are those of `keys`, in their order."""
    return {name: table[name] for name in keys if name in table}


def whole(path: str, table: Mapping[str, Any], keys: Mapping[str, Key]) -> dict[str, Any]:
    """Return the values of the keys of a table; refuse one that has some and lacks others that make_scene gives.

    Raises
    ------
    SceneError
        The message names the first key that is missing.
    """
    found = of_keys(table, keys)
    for name, key in keys.items():
        if found and name not in found and (key.required or key.default is not None):
            raise SceneError(f"{path}.{name}: missing; allowed: {describe(key)}")
    return found


def check_values(fixed: Mapping[str, Any], varied: Mapping[str, np.ndarray]) -> None:
    """Refuse numbers, words and lists of numbers that a scene cannot have.

    Vectors need only be finite, which :func:`cablepod._inputs.taken` checks; records are checked where they are read.

    Parameters
    ----------
    fixed
        Values of all members by the name of the variable.
    varied
        Values with a row for each member, nan for members that lack the variable.

    Raises
    ------
    SceneError
        The message names the key.
    """
    for name, value in fixed.items():
        if not isinstance(value, np.ndarray):
            _check(name, _kind(fixed, name), value)
        elif value.ndim == 1:
            _check_lists(name, _kind(fixed, name), value[None])
    for name, values in varied.items():
        kind = _kind(fixed, name)
        for value in _extremes(values) if values.ndim == 1 else ():
            _check(name, kind, value)
        if values.ndim == 2:
            _check_lists(name, kind, values)


def _extremes(values: np.ndarray) -> Iterable[Any]:
    """Return the least and the largest number, which decide on all between, or all words."""
    if values.dtype.kind in "iu":
        return values.min(), values.max()
    if values.dtype.kind == "f":
        known = values[~np.isnan(values)]
        return (known.min(), known.max()) if known.size else ()
    return {value for value in values.tolist() if isinstance(value, str)}


def _kind(fixed: Mapping[str, Any], name: str) -> str | None:
    """Return the kind of the time function that a variable belongs to; None for others, and where it varies."""
    place = place_of_variable(name)
    kind = fixed.get(variable_name(".".join((*place.table, "kind")))) if place is not None and place.table else None
    return str(kind) if isinstance(kind, str) else None


@lru_cache(4096, typed=True)
def _check(name: str, kind: str | None, value: Any) -> None:
    """Check a value; kept, as most values of a scene are those of another one."""
    path, key = _path_and_key(name, kind)
    if key is not None and key.is_whole and isinstance(value, float) and value.is_integer():
        value = int(value)  # xarray.concat makes floats of members that lack the variable
    if key is not None and (key.is_number or key.is_choice or key.is_truth):
        key.check(path, value)


def _check_lists(name: str, kind: str | None, rows: np.ndarray) -> None:
    """Check lists of numbers, a row for each; those of nan are of members that lack the variable."""
    path, key = _path_and_key(name, kind)
    if key is not None and key.is_list:
        for row in rows[~np.isnan(rows).all(axis=1)].tolist():
            key.check(path, row)


@lru_cache(4096)
def _path_and_key(name: str, kind: str | None) -> tuple[str, Key | None]:
    """Return key path and key of a variable, of a time function that of its `kind`; no key for other names and components."""
    place = place_of_variable(name)
    if place is None or place.axis:
        return name, None
    known = kind if kind in time_function_keys("1") else None  # another kind is refused where it is read
    return place.path, key_at(place.path, known)
