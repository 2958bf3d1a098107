"""Checks of the tables of a scene against their keys: names, values, defaults."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cablepod.errors import SceneError, did_you_mean, scene_error
from cablepod.parameters._keys import ENSEMBLE, LISTED, TABLES, TOP, Key, describe, join


def check_table(prefix: str, table: Any, keys: Mapping[str, Key]) -> dict[str, Any]:
    """Check a table of a scene against its keys; return the values, defaults filled in.

    Raises
    ------
    SceneError
        As :func:`check_names` and :func:`filled`.
    """
    return filled(prefix, check_names(prefix, table, keys), keys)


def check_names(prefix: str, table: Any, keys: Mapping[str, Key]) -> dict[str, Any]:
    """Check names and values of a table of a scene against its keys; return the values.

    Raises
    ------
    SceneError
        If it is no table, for unknown keys, and for values that are not allowed.
    """
    if not isinstance(table, Mapping):
        raise scene_error(prefix, table, "a table with the keys " + ", ".join(keys))
    checked: dict[str, Any] = {}
    for name, value in table.items():
        if name not in keys:
            below = f"{prefix}."
            allowed = [*keys, *(table.removeprefix(below) for table in TABLES if table.startswith(below))]
            raise unknown_key(prefix, name, allowed)
        checked[name] = keys[name].check(join(prefix, name), value)
    return checked


def filled(prefix: str, table: Mapping[str, Any], keys: Mapping[str, Key]) -> dict[str, Any]:
    """Return a table with the defaults of keys that it lacks; refuse one that lacks required keys.

    Raises
    ------
    SceneError
        The message names the missing key.
    """
    result = dict(table)
    for name, key in keys.items():
        if name not in result:
            if key.required:
                raise SceneError(f"{join(prefix, name)}: missing; allowed: {describe(key)}")
            if key.default is not None:
                result[name] = key.default
    return result


def unknown_key(
    prefix: str, name: Any, allowed: Sequence[str], remedy: str | None = None, kind: str = "key"
) -> SceneError:
    """Return the refusal of a name of a table, with its remedy or that of :func:`meant`."""
    remedy = meant(prefix, name, allowed) if remedy is None else remedy
    return SceneError(f"{join(prefix, name)}: unknown {kind}; allowed: {', '.join(allowed)}{remedy}")


def meant(prefix: str, name: Any, keys: Iterable[str]) -> str:
    """Return the remedy of an unknown key: a similar key of its table, or the same key of another table; else empty."""
    similar = did_you_mean(name, keys, f"{prefix}." if prefix else "")
    tables = {"": TOP, **TABLES, **{f"{table}.1": keys for table, keys in LISTED.items()}, "ensemble": ENSEMBLE}
    elsewhere = [join(table, name) for table, of_table in tables.items() if name in of_table and table != prefix]
    return similar or (f"; try: {' or '.join(elsewhere)}" if elsewhere else "")
