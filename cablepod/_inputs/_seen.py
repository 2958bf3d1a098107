"""Datasets like one that was in order before: recognised, so that they need no second check.

What decides on a Dataset is read anew in each call and compared with what was read when a Dataset of these names was accepted:
dimensions, types and units of all variables, types of attributes, and the bytes of labels, places and small arrays.  A Dataset
may be changed in place, so nothing hangs on its identity.  Only an index is known by its identity: it cannot be changed, but
through a writable view of its array.
"""

from __future__ import annotations

import math
from itertools import repeat
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod._inputs._kinds import PLACES, Kind
from cablepod._inputs._labels import label_orders, place_orders
from cablepod.conventions import IN_ORDER, LABELS
from cablepod.provenance import is_history

FLOAT = np.dtype(float)
#: Maximum number of records, bytes of an array of values that are compared (a product shows faster that more are finite), and
#: bytes that are compared of a Dataset.
MAX_RECORDS, MAX_BYTES, MAX_CONTENT = 64, 1 << 14, 1 << 16
#: Variables whose values decide on the order of others.
ORDERING = frozenset((*LABELS, *PLACES, "unstretched_length"))
#: What is done with the array of a variable: nothing, its bytes are compared, its values are looked at, its index is looked up.
NOTHING, COMPARED, FINITE, INDEX = range(4)
#: Attributes that all functions read.
ALWAYS_READ = ("stage", "layout", "id", "history_json", "values_sha256")


class Missing:
    """In place of the value of an attribute that a Dataset lacks: None would be a value, which is refused."""


MISSING = Missing()
is_writable_c = attrgetter("flags.carray")


#: Name, dimensions, units and type of the array of a variable, type of its numbers (None for any), what is done with it, and
#: where its index is looked up.
Expected = tuple[Any, tuple[Any, ...], str | None, Any, Any, int, dict[int, Any]]


class Record(NamedTuple):
    """What was read of a Dataset that was in order."""

    types: list[type]  #: of attributes
    stage: Any
    layout: Any
    variables: list[Expected]
    content: bytes  #: of the arrays that are compared
    has_labels: bool  #: whether there are labels among these


_records: dict[tuple[Any, ...], Record] = {}


def is_like_one_in_order(key: str, given: xr.Dataset, kind: Kind) -> bool:
    """Tell whether a Dataset equals one in order in all that is checked; False also where that is not known.

    Raises
    ------
    SceneError
        For labels, instants and places that are not legal.
    """
    # each public call passes here, with cold caches: private attributes, as the properties take three times as long
    variables, attrs = given._variables, given._attrs or {}
    names = _names(given, kind)
    record = _records.get(names)
    if record is None or not _has_attributes(attrs, record, kind):
        return False
    found = _arrays(variables, record)
    if found is None:
        return False
    compared, finite, is_known = found
    if kind.is_scene and not all(map(is_writable_c, compared + finite)):
        return False
    try:
        content = b"".join(compared)
    except TypeError:  # not in the memory order of C
        return False
    is_changed = content != record.content
    # of snapshots only places and labels are compared, which are looked at below
    for array in finite + compared if is_changed and kind.is_small else finite:
        if array.dtype is FLOAT and not math.isfinite(np.vdot(array, array)):
            return False
    if (not is_known or (is_changed and record.has_labels)) and label_orders(
        key, read_by(kind, variables), some=kind.some
    ):
        return False
    if is_changed:
        if place_orders(key, read_by(kind, variables)):
            return False
        _records[names] = record._replace(content=content)
    return True


def _arrays(variables: dict[Any, Any], record: Record) -> tuple[list[Any], list[Any], bool] | None:
    """Return the arrays that are compared, those whose values are looked at, and whether all indexes are known to be in order.

    None for other dimensions, types or units.
    """
    compared: list[Any] = []
    finite: list[Any] = []
    is_known = True
    for name, dims, units, array_type, numbers, what, known in record.variables:
        variable: Any = variables.get(name)
        if variable is None:
            return None
        array: Any = variable._data
        attrs = variable._attrs
        own = attrs.get("units") if attrs else None
        if (
            (variable._dims is not dims and variable._dims != dims)
            or type(array) is not array_type
            or (own is not units and (type(own) is not str or own != units))
            or (numbers is not None and array.dtype is not numbers and array.dtype != numbers)
        ):
            return None
        if what == INDEX:
            is_known = is_known and id(array.array) in known
        elif what == COMPARED:
            compared.append(array)
        elif what == FINITE:
            finite.append(array)
    return compared, finite, is_known


def note_in_order(given: xr.Dataset, kind: Kind) -> None:
    """Keep what decides on a Dataset that is in order, unless that cannot be compared."""
    attrs = given.attrs
    variables: list[Expected] = []
    compared: list[Any] = []
    for name, variable in read_by(kind, given._variables).items():
        units = variable.attrs.get("units")
        array: Any = variable._data
        what = _what(name, variable, kind)
        if what is None or not (units is None or type(units) is str):
            return
        numbers = None if what == INDEX and name in LABELS else array.dtype
        variables.append((name, variable._dims, units, type(array), numbers, what, IN_ORDER.get(name, {})))
        if what == COMPARED:
            compared.append(array)
    if sum(array.nbytes for array in compared) > MAX_CONTENT:
        return
    if len(_records) >= MAX_RECORDS:
        _records.clear()
    has_labels = any(what == COMPARED and name in IN_ORDER for name, *_, what, _ in variables)
    types = _types(attrs, kind)
    content = b"".join(compared)
    _records[_names(given, kind)] = Record(
        types, attrs.get("stage"), attrs.get("layout"), variables, content, has_labels
    )


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


def read_by(kind: Kind, variables: dict[Any, Any]) -> dict[Any, Any]:
    """Return the variables that functions of a kind read."""
    return variables if kind.reads is None else {name: variables[name] for name in kind.reads if name in variables}


def _names(given: xr.Dataset, kind: Kind) -> tuple[Any, ...]:
    """Return the kind, dimensions with their sizes, and names of the variables that are read and, where all are, attributes."""
    sizes = given._dims
    if kind.reads is not None:
        return (kind, *sizes, *sizes.values(), *filter(given._variables.__contains__, kind.reads))
    return (kind, *given._variables, *given.attrs, *sizes, *sizes.values())


def _types(attrs: dict[Any, Any], kind: Kind) -> list[type]:
    """Return the types of the attributes that functions of a kind read."""
    return [*map(type, attrs.values() if kind.reads is None else map(attrs.get, ALWAYS_READ, repeat(MISSING)))]


def _has_attributes(attrs: dict[Any, Any], record: Record, kind: Kind) -> bool:
    """Tell whether attributes of the names of a record have its types, stage and layout, and a history."""
    # types first, so that what compares in its own way, such as an array, is not compared with a text
    if _types(attrs, kind) != record.types:
        return False
    if (kind.stages and attrs.get("stage") != record.stage) or (kind.layouts and attrs.get("layout") != record.layout):
        return False
    history = attrs.get("history_json")
    return history is None or is_history(history)
