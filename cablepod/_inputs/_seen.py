"""Datasets like one that was in order before: recognised, so that they need no second check.

What decides on a Dataset is read anew in each call and compared with what was read when a Dataset of these names was accepted:
dimensions, types and units of all variables, types of attributes, and the bytes of labels, places and small arrays.  A Dataset
may be changed in place, so nothing hangs on its identity.  Only an index is known by its identity: it cannot be changed, but
through a writable view of its array.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod._inputs._kinds import PLACES, Kind
from cablepod._inputs._labels import IN_ORDER, label_orders, place_orders
from cablepod.conventions import LABELS

FLOAT = np.dtype(float)
#: Maximum number of records, bytes of an array of values that are compared (a product shows faster that more are finite), and
#: bytes that are compared of a Dataset.
MAX_RECORDS, MAX_BYTES, MAX_CONTENT = 64, 1 << 14, 1 << 16
#: Variables whose values decide on the order of others.
ORDERING = frozenset((*LABELS, *PLACES, "unstretched_length"))
#: What is done with the array of a variable: nothing, its bytes are compared, its values are looked at, its index is looked up.
NOTHING, COMPARED, FINITE, INDEX = range(4)
is_writable_c = attrgetter("flags.carray")


#: Dimensions, type of the array and of its numbers, units of a variable, and what is done with it.
Expected = tuple[tuple[Any, ...], type, Any, str | None, int]


class Record(NamedTuple):
    """What was read of a Dataset that was in order."""

    types: list[type]  #: of attributes
    stage: Any
    layout: Any
    variables: list[Expected]
    content: bytes  #: of the arrays that are compared
    indexes: list[dict[int, Any]]  #: where the index of each variable that has one is looked up


_records: dict[tuple[Any, ...], Record] = {}


def is_like_one_in_order(key: str, given: xr.Dataset, kind: Kind) -> bool:
    """Tell whether a Dataset equals one in order in all that is checked; False also where that is not known.

    Raises
    ------
    SceneError
        For labels, instants and places that are not legal.
    """
    record = _records.get(_names(given, kind))
    if record is None or not _has_attributes(given.attrs, record, kind):
        return False
    found = _arrays(given, record)
    if found is None:
        return False
    _, compared, finite, indexes = found
    if kind.is_scene and not all(map(is_writable_c, compared + finite)):
        return False
    try:
        content = b"".join(compared)
    except TypeError:  # not in the memory order of C
        return False
    is_changed = content != record.content
    for array in finite + compared if is_changed else finite:
        if array.dtype is FLOAT and not math.isfinite(np.vdot(array, array)):
            return False
    if is_changed:
        if label_orders(key, given._variables, some=kind.some) or place_orders(key, given._variables):
            return False
        _records[_names(given, kind)] = record._replace(content=content)
        return True
    for known, index in zip(record.indexes, indexes, strict=True):
        if id(index.array) not in known:
            return not label_orders(key, given._variables, some=kind.some)
    return True


def _arrays(given: xr.Dataset, record: Record) -> tuple[list[Any], ...] | None:
    """Return the arrays of all variables by what is done with them; None for other dimensions, types or units."""
    found: tuple[list[Any], ...] = ([], [], [], [])
    for variable, (dims, array_type, numbers, units, what) in zip(
        given._variables.values(), record.variables, strict=True
    ):
        # not public, but a third of the time of the properties, which wrap what they return
        array, attrs = variable._data, variable._attrs
        own = attrs.get("units") if attrs else None
        if (
            variable._dims != dims
            or array.__class__ is not array_type
            or (array.dtype is not numbers and array.dtype != numbers)
            or (own is not units and (own.__class__ is not str or own != units))
        ):
            return None
        found[what].append(array)
    return found


def note_in_order(given: xr.Dataset, kind: Kind) -> None:
    """Keep what decides on a Dataset that is in order, unless that cannot be compared."""
    attrs, variables, indexes = given.attrs, [], []
    compared: list[Any] = []
    for name, variable in given._variables.items():
        units = variable.attrs.get("units")
        array: Any = variable._data
        what = _what(name, variable, kind)
        if what is None or not (units is None or type(units) is str):
            return
        variables.append((variable._dims, type(array), array.dtype, units, what))
        if what == COMPARED:
            compared.append(array)
        elif what == INDEX:
            indexes.append(IN_ORDER[name])
    if sum(array.nbytes for array in compared) > MAX_CONTENT:
        return
    if len(_records) >= MAX_RECORDS:
        _records.clear()
    types = [*map(type, attrs.values())]
    content = b"".join(compared)
    _records[_names(given, kind)] = Record(types, attrs.get("stage"), attrs.get("layout"), variables, content, indexes)


def _what(name: Any, variable: xr.Variable, kind: Kind) -> int | None:
    """Tell what is done with the array of a variable to recognise it; None if that cannot be."""
    array, decides = variable._data, name in ORDERING
    if decides and isinstance(variable, xr.IndexVariable) and name in IN_ORDER:
        return INDEX
    if type(array) is not np.ndarray:
        return None if decides else NOTHING
    if not (decides or kind.is_small):
        return NOTHING
    contiguous = array.flags.c_contiguous
    if not decides and array.dtype is FLOAT and (array.nbytes > MAX_BYTES or not contiguous):
        return FINITE
    return COMPARED if contiguous and array.dtype.kind in "fiubU" else None


def _names(given: xr.Dataset, kind: Kind) -> tuple[Any, ...]:
    """Return the kind, and the names of variables, attributes and dimensions with their sizes."""
    sizes = given._dims
    return (kind, *given._variables, *given.attrs, *sizes, *sizes.values())


def _has_attributes(attrs: dict[Any, Any], record: Record, kind: Kind) -> bool:
    """Tell whether attributes of the names of a record have its types, stage and layout, and a history."""
    # types first, so that what compares in its own way, such as an array, is not compared with a text
    if [*map(type, attrs.values())] != record.types:
        return False
    if kind.stages and attrs.get("stage") != record.stage:
        return False
    if kind.layouts and attrs.get("layout") != record.layout:
        return False
    history = attrs.get("history_json")
    return history is None or is_history(history)


@lru_cache(256)
def is_history(text: str) -> bool:
    """Tell whether a text is a list of stages."""
    try:
        stages = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(stages, list) and all(
        isinstance(stage, dict) and isinstance(stage.get("id"), str) and isinstance(stage.get("function"), str)
        for stage in stages
    )
