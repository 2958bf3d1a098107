"""Values of a scene Dataset, which may have been changed by hand, checked as those of a scene file are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from cablepod.errors import SceneError
from cablepod.parameters._key_paths import dotted, key_at, listed_path, variable_name
from cablepod.parameters._keys import Key, time_function_keys


def check_values(fixed: Mapping[str, Any], varied: Mapping[str, np.ndarray]) -> None:
    """Refuse numbers and words that a scene cannot have.

    Vectors and records need only be finite, which :func:`cablepod._inputs.taken` checks.

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
    for name, values in varied.items():
        if values.ndim == 1:
            kind = _kind(fixed, name)
            for value in _extremes(values):
                _check(name, kind, value)


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
    table = dotted(name).rpartition(".")[0]
    kind = fixed.get(variable_name(f"{table}.kind")) if table else None
    return str(kind) if isinstance(kind, str) else None


@lru_cache(4096, typed=True)
def _check(name: str, kind: str | None, value: Any) -> None:
    """Check a value; kept, as most values of a scene are those of another one."""
    key = _key(dotted(name), kind)
    if key is not None and key.is_whole and isinstance(value, float) and value.is_integer():
        value = int(value)  # xarray.concat makes floats of members that lack the variable
    if key is not None and (key.is_number or key.is_choice or key.is_truth):
        key.check(dotted(name), value)


def _key(path: str, kind: str | None) -> Key | None:
    known = kind if kind in time_function_keys("1") else None  # another kind is refused where it is read
    return key_at(path.split("."), lambda _: known)


def refuse_gap(values: Mapping[str, Any], table: str, keys: Iterable[str], count: int) -> None:
    """Refuse a table of a list whose number is above `count`, where the numbers of the list end.

    Raises
    ------
    SceneError
        The message names the table.
    """
    beginning, known = variable_name(f"{table}."), tuple(keys)
    for name in values:
        if not name.startswith(beginning):
            continue
        number, _, key = name.removeprefix(beginning).partition("_")
        if key in known and number.isdecimal() and int(number) > count:
            path, missing = listed_path(table, int(number)), listed_path(table, count + 1)
            raise SceneError(f"{path}: given without {missing}; allowed: tables numbered from 1, without a gap")
