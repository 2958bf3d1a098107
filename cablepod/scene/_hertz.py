"""Frequencies in Hz: the key ``frequency`` of a sine, in place of ``angular_frequency``."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from cablepod.errors import SceneError, shown
from cablepod.parameters._checks import number, numbers_list
from cablepod.parameters._key_paths import flat, number_at
from cablepod.parameters._keys import FREQUENCY, join
from cablepod.parameters._tables import table_of
from cablepod.parameters._time_functions import SINES
from cablepod.scene._dataset import tables_in

OMEGA = "angular_frequency"
#: Angle of a cycle.
RADIANS = 2.0 * math.pi


def in_radians(tree: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the tables of a scene with ``angular_frequency`` [rad/s] for each ``frequency`` [Hz]; the same object without any.

    Parameters
    ----------
    tree
        Nested tables, as of :func:`cablepod.parameters._key_paths.nested`; not modified.  What is no table is left as it is, for
        the checks behind.

    Raises
    ------
    SceneError
        For a frequency that is no number of at least 0, and for both keys in one table.
    """
    for parts, table in list(_tables_of_sines(tree)):
        tree = _replaced(tree, parts, _with_omega(".".join(parts), table))
    ensemble = tree.get("ensemble")
    if isinstance(ensemble, Mapping) and isinstance(ensemble.get("ranges"), Mapping):

        def is_number(path: str) -> bool:
            return number_at(tree, path) is not None

        sampling, table = ensemble.get("sampling"), ensemble["ranges"]
        ranges = ranges_in_radians(table, sampling, is_number, prefix="ensemble.ranges")
        if ranges is not table:
            tree = _replaced(tree, ("ensemble", "ranges"), ranges)
    return tree


def _tables_of_sines(tree: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Yield path and values of each motion and factor of a load that has a frequency in Hz."""
    for parts, values in tables_in(tree):
        table = table_of(parts)
        kind = values.get("kind") if table is not None and table.factor is not None and FREQUENCY in values else None
        if isinstance(kind, str) and kind in SINES:
            yield parts, values


def _replaced(tree: Any, parts: tuple[str, ...], value: Any) -> Any:
    """Return nested tables with another value at the parts of its path; all else is shared."""
    if not parts:
        return value
    is_list = isinstance(tree, list | tuple)
    copy: Any = list(tree) if is_list else dict(tree)
    key: Any = int(parts[0]) - 1 if is_list else parts[0]
    copy[key] = _replaced(tree[key], parts[1:], value)
    return copy


def ranges_in_radians(
    ranges: Mapping[str, Any], sampling: Any, is_number: Callable[[str], bool], *, prefix: str = "ranges"
) -> Mapping[str, Any]:
    """Return ranges with the path of ``angular_frequency`` for that of each ``frequency``, and values in rad/s.

    Parameters
    ----------
    ranges
        Key path -> values, in any form; a third number is a count where `sampling` gives none.
    sampling
        Kind of sampling; None if it is not given.
    is_number
        Tells whether a key path is that of a number of the scene.
    prefix
        Key path of the ranges, for messages.
    """
    given = flat(ranges)
    if not any(isinstance(path, str) and path.endswith(f".{FREQUENCY}") for path in given):
        return ranges
    result: dict[str, Any] = {}
    for path, values in given.items():
        of_omega = f"{path.removesuffix(FREQUENCY)}{OMEGA}" if isinstance(path, str) else path
        if not isinstance(path, str) or not path.endswith(f".{FREQUENCY}") or not is_number(of_omega):
            result[path] = values
            continue
        if of_omega in given:
            raise SceneError(f"{join(prefix, path)}: given beside {of_omega}; allowed: one of them")
        numbers = numbers_list()(join(prefix, path), values)
        count = len(numbers) == 3 and sampling not in ("grid", "list")
        result[of_omega] = [RADIANS * value for value in numbers[: 2 if count else None]] + numbers[2:] * count
    return result


def _with_omega(path: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table of a sine with its angular frequency."""
    if OMEGA in table:
        given = f"{FREQUENCY} = {shown(table[FREQUENCY])} and {OMEGA} = {shown(table[OMEGA])}"
        raise SceneError(f"{path}: given {given}; allowed: exactly one of {FREQUENCY}, {OMEGA}")
    omega = RADIANS * number(least=0.0)(f"{path}.{FREQUENCY}", table[FREQUENCY])
    return {OMEGA if key == FREQUENCY else key: omega if key == FREQUENCY else value for key, value in table.items()}
