"""Datasets like one that was in order before: recognised, so that they need no second check.

What decides on a Dataset is read anew in each call and compared with what was read when a Dataset of these names was accepted:
dimensions, types and units of all variables, types of attributes, and the bytes of labels, places and small arrays.  A Dataset
may be changed in place, so nothing hangs on its identity.  Only an index is known by its identity: it cannot be changed, but
through a writable view of its array.
"""

from __future__ import annotations

import math
from operator import attrgetter
from typing import Any

import numpy as np
import xarray as xr

from cablepod._inputs._kinds import PLACES, Kind
from cablepod._inputs._labels import label_orders, place_orders
from cablepod.conventions import IN_ORDER, LABELS, PLACES_IN_ORDER, keep_places
from cablepod.provenance import VERDICTS, is_history

#: Compared with ``==``: a type that was unpickled, or has metadata, is another object.
FLOAT = np.dtype(float)
#: Maximum number of records, bytes of an array of values that are compared (a product shows faster that more are finite), and
#: bytes that are compared of a Dataset.
MAX_RECORDS, MAX_BYTES, MAX_CONTENT = 64, 1 << 14, 1 << 16
#: Variables whose values decide on the order of others.
ORDERING = frozenset((*LABELS, *PLACES, "unstretched_length"))
#: Arrays whose bytes, one after the other, are looked up among places in order, and their dimensions; both are needed.
PLACED: dict[Any, Any] = {"arc_length": ("particle",), "unstretched_length": ()}
#: What is done with the array of a variable: its bytes are compared; the same, and its values are looked at if they changed; its
#: bytes are looked up; its values are looked at; its index is looked up; nothing.
COMPARED, NUMBERS, PLACE, FINITE, INDEX, NOTHING = range(6)
#: Attributes that all functions read.
ALWAYS_READ = ("stage", "id", "history_json")


class Missing:
    """In place of the value of an attribute that a Dataset lacks: None would be a value, which is refused."""


MISSING = Missing()
is_writable_c = attrgetter("flags.carray")


#: Name, dimensions, units and type of the array of a variable, type of its numbers (None for any), what is done with it, and
#: where its index is looked up; dimensions None of a variable that a Dataset lacks.
Expected = tuple[Any, Any, str | None, Any, Any, int, dict[int, Any]]


class Record:
    """What was read of a Dataset that was in order."""

    __slots__ = ("attributes", "content", "has_orders", "has_places_alone", "shapes", "variables")

    def __init__(self, given: xr.Dataset, kind: Kind, variables: list[Expected], content: bytes, shapes: Any) -> None:
        attrs, decide = given.attrs, {"stage": kind.stages, "layout": kind.layouts}
        #: name, type and, of those that decide, text of an attribute
        self.attributes = [
            (name, type(attrs.get(name, MISSING)), attrs.get(name) if decide.get(name) else None)
            for name in (attrs if kind.reads is None else ALWAYS_READ)
        ]
        self.variables = variables
        self.content, self.shapes = content, shapes  #: of the arrays that are compared; shapes say where one ends
        done = {what for *_, what, _ in variables}
        #: whether there is nothing else to look at than indexes and places
        self.has_places_alone = PLACE in done and not kind.is_small and done <= {PLACE, INDEX, NOTHING}
        #: whether some of these decide on the order of others
        self.has_orders = any(
            what == COMPARED and (name in LABELS or name in PLACES) for name, *_, what, _ in variables
        )


#: By kind or, where all variables are read, by names.
_records: dict[Any, Record] = {}


def is_like_one_in_order(key: str, given: xr.Dataset, kind: Kind) -> bool:
    """Tell whether a Dataset equals one in order in all that is checked; False also where that is not known.

    Raises
    ------
    SceneError
        For labels, instants and places that are not legal.
    """
    # each public call passes here, with cold caches: few calls, and private attributes, as properties take three times as long
    variables, attrs = given._variables, given._attrs or {}
    record = _records.get(_names(given, kind) if kind.reads is None else kind)
    if record is None:
        return False
    for name, own_type, text in record.attributes:
        value = attrs.get(name, MISSING)
        if type(value) is not own_type or (text is not None and value is not text and value != text):
            return False
    history = attrs.get("history_json")
    if history is not None and not (VERDICTS.get(history) or is_history(history)):
        return False
    found: tuple[list[Any], ...] = ([], [], [], [])
    is_known = True
    for name, dims, units, array_type, dtype, what, known in record.variables:
        variable: Any = variables.get(name)
        if variable is None:
            if dims is None:
                continue
            return False
        array: Any = variable._data
        own = variable._attrs.get("units") if variable._attrs else None
        if (
            (variable._dims is not dims and variable._dims != dims)
            or type(array) is not array_type
            or (own is not units and (type(own) is not str or own != units))
            or (dtype is not None and array.dtype is not dtype and array.dtype != dtype)
        ):
            return False
        if what == INDEX:
            if name not in given._indexes:
                return False
            is_known = is_known and id(array.array) in known
        elif what != NOTHING:
            found[what].append(array)
    return _are_in_order(key, variables, kind, record, found, is_known)


def _are_in_order(
    key: str, variables: dict[Any, Any], kind: Kind, record: Record, found: tuple[list[Any], ...], is_known: bool
) -> bool:
    """Tell whether arrays, by what is done with them, are in order; False also where that is not known.

    `is_known` tells whether all indexes are known to be in order.
    """
    compared, numbers, places, finite = found
    try:
        place = b"".join(places)
        if record.has_places_alone and is_known and place in PLACES_IN_ORDER:
            return True
        number = b"".join(numbers) if numbers else b""
        content = number + b"".join(compared) if compared else number
    except TypeError:  # not in the memory order of C
        return False
    if kind.is_scene and not all(map(is_writable_c, (*compared, *numbers, *finite))):
        return False
    shapes = [array.shape for array in compared] if compared else []
    is_changed = content != record.content or shapes != record.shapes
    if is_changed and number:
        finite.append(np.frombuffer(number))
    if kind.is_small:
        finite += places
    for array in finite:
        if not math.isfinite(np.vdot(array, array)):
            return False
    may_differ = is_changed and record.has_orders
    if (not is_known or may_differ) and label_orders(key, read_by(kind, variables), some=kind.some):
        return False
    if may_differ or (place and place not in PLACES_IN_ORDER):
        if place_orders(key, read_by(kind, variables)):
            return False
        keep_places(place)
    record.content, record.shapes = content, shapes
    return True


def note_in_order(given: xr.Dataset, kind: Kind) -> None:
    """Keep what decides on a Dataset that is in order, unless that cannot be compared."""
    variables: list[Expected] = []
    read = read_by(kind, given._variables)
    placed = PLACED if all(name in read and _is_placed(read[name], dims) for name, dims in PLACED.items()) else ()
    for name, variable in read.items():
        units = variable.attrs.get("units")
        what = PLACE if name in placed else _what(name, variable, kind)
        if what is None or not (units is None or type(units) is str):
            return
        dtype = None if what == INDEX and name in LABELS else variable._data.dtype
        variables.append((name, variable._dims, units, type(variable._data), dtype, what, IN_ORDER.get(name, {})))
    variables.sort(key=lambda expected: expected[0] == "unstretched_length")  # after the arc lengths
    variables += (
        (name, None, None, None, None, NOTHING, {}) for name in kind.reads or () if name not in given._variables
    )
    numbers, compared = (
        [read[name]._data for name, *_, what, _ in variables if what == kept] for kept in (NUMBERS, COMPARED)
    )
    content = b"".join(numbers + compared)
    if len(content) > MAX_CONTENT:
        return
    if len(_records) >= MAX_RECORDS:
        _records.clear()
    _records[_names(given, kind) if kind.reads is None else kind] = Record(
        given, kind, variables, content, [array.shape for array in compared]
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
    if not decides and array.dtype == FLOAT:
        return NUMBERS if contiguous and array.nbytes <= MAX_BYTES else FINITE
    return COMPARED if contiguous and array.dtype.kind in "fiubU" else None


def _is_placed(variable: xr.Variable, dims: tuple[str, ...]) -> bool:
    """Tell whether a variable can be looked up among places in order."""
    array: Any = variable._data
    return type(array) is np.ndarray and array.dtype == FLOAT and array.flags.c_contiguous and variable._dims == dims


def read_by(kind: Kind, variables: dict[Any, Any]) -> dict[Any, Any]:
    """Return the variables that functions of a kind read."""
    return variables if kind.reads is None else {name: variables[name] for name in kind.reads if name in variables}


def _names(given: xr.Dataset, kind: Kind) -> tuple[Any, ...]:
    """Return the kind, all names and the sizes, on which it depends what is compared."""
    return (kind, *given._variables, *given.attrs, *given._dims.values())
