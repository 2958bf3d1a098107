"""Orders of labels, instants and particles: found, or refused."""

from __future__ import annotations

import math
import weakref
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import LABELS
from cablepod.errors import scene_error

#: Rounding of a number of single precision, which arc lengths and instants may have.
ROUNDING = 1e-6
#: Indexes whose labels or instants are in order, by name of the variable and identity.  An index cannot be changed, and an entry
#: is removed as the index goes, before another object can have its identity.
IN_ORDER: dict[Any, dict[int, weakref.ref[Any]]] = {name: {} for name in (*LABELS, "time")}


def _note(name: str, index: Any) -> None:
    """Keep that an index is in order, as long as it exists."""
    known, number = IN_ORDER[name], id(index)
    known[number] = weakref.ref(index, lambda _: known.pop(number, None))


def label_orders(key: str, variables: Any, *, some: bool) -> dict[str, Any]:
    """Return the indices that bring labels into their order, by dimension; refuse labels that have none, and instants."""
    orders: dict[str, Any] = {}
    for name, known in IN_ORDER.items():
        if (variable := variables.get(name)) is None or not variable._dims:
            continue
        index = variable._data.array if isinstance(variable, xr.IndexVariable) else None
        if index is not None and id(index) in known:
            continue
        if name == "time":
            _check_times(key, variable)
        elif (order := _label_order(key, name, variable, some=some)) is not None:
            orders[name] = order
            continue
        if index is not None and not some:
            _note(name, index)
    return orders


def place_orders(key: str, variables: Any) -> dict[str, Any]:
    """Return the indices that bring particles and links into the order of their arc length; refuse those that have none."""
    orders: dict[str, Any] = {}
    for name, dim in (("arc_length", "particle"), ("link_arc_length", "link")):
        if (variable := variables.get(name)) is not None:
            order = _place_order(key, name, dim, variable, variables.get("unstretched_length"))
            if order is not None:
                orders[dim] = order
    return orders


def _label_order(key: str, dim: str, variable: xr.Variable, *, some: bool) -> np.ndarray | None:
    """Return the indices that bring the labels of a dimension into their order, None where they are in it."""
    labels = variable._data.array.tolist() if isinstance(variable, xr.IndexVariable) else variable.values.tolist()
    own = LABELS[dim]
    if own is None:  # modes
        if set(map(type, labels)) != {int} or len(set(labels)) < len(labels):
            raise scene_error(f"{key}: {dim}", labels, "different whole numbers")
        return None if labels == sorted(labels) else np.argsort(labels)
    if labels == own[: len(labels)] and len(labels) > 1:
        return None
    if dim == "feature" and set(labels) != set(own):
        return None  # of another version; whoever reads them looks at their names
    if some and dim == "coordinate" and len(labels) == 1 and labels[0] in own:
        return None
    if len(labels) < 2 or sorted(map(str, labels)) != sorted(own[: len(labels)]):
        raise scene_error(f"{key}: {dim}", labels, f"{' and '.join(own[: max(2, len(labels))])}, each once")
    return np.array([labels.index(label) for label in own[: len(labels)]])


def _check_times(key: str, variable: xr.Variable) -> None:
    """Refuse instants that are not finite or do not rise."""
    index = variable._data.array if isinstance(variable, xr.IndexVariable) else variable.to_index()
    if (
        index.dtype.kind not in "fiu"
        or not index.size
        or not (index.is_monotonic_increasing and index.is_unique)
        or not math.isfinite(index[0])
        or not math.isfinite(index[-1])
    ):
        raise scene_error(f"{key}: time", index.tolist(), "finite, rising instants [s], each once")


def _place_order(key: str, name: str, dim: str, variable: xr.Variable, length: xr.Variable | None) -> np.ndarray | None:
    """Return the indices that bring particles or links into the order of their arc length, None where they are in it."""
    arc = np.asarray(variable._data) if isinstance(variable._data, np.ndarray) else variable.values
    if dim not in variable._dims or arc.dtype.kind not in "fiu":
        raise scene_error(f"{key}: {name}", f"{variable._dims} of type {arc.dtype}", f"numbers over {dim} [m]")
    if arc.ndim > 1:
        return _common_order(
            np.moveaxis(arc, variable._dims.index(dim), -1).reshape(-1, arc.shape[variable._dims.index(dim)])
        )
    order, rises = None, (arc[1:] > arc[:-1]).all()
    if not rises:
        order = np.argsort(arc)
        arc = arc[order]
        rises = (arc[1:] > arc[:-1]).all()
    allowed = f"those of the {dim}s, rising from the lower end"
    if arc.size < 2 or not rises or not math.isfinite(arc[0]) or not math.isfinite(arc[-1]):
        raise scene_error(f"{key}: {name}", variable.values.tolist(), f"{allowed}, each once")
    if dim == "particle":
        last = float(arc[-1])
        end = float(length.values) if length is not None and not length._dims and length.dtype.kind in "fiu" else last
        if not (abs(arc[0]) <= ROUNDING * last and abs(last - end) <= ROUNDING * last):
            given = f"{arc[0]:g} ... {last:g} m of {end:g} m"
            raise scene_error(f"{key}: {name}", given, f"{allowed}, 0, to the unstretched length")
    return order


def _common_order(rows: np.ndarray) -> np.ndarray | None:
    """Return the indices that bring all rows into rising order, None where they are in it or have no common one."""
    if not len(rows) or not (rows[:, 1:] < rows[:, :-1]).any():
        return None
    order = np.argsort(rows[0])
    return order if not (np.diff(rows[:, order], axis=1) < 0).any() else None
