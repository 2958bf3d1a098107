"""Orders of labels, instants and particles: found, or refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import IN_ORDER, LABELS, is_in_order, is_rising, note_in_order
from cablepod.errors import scene_error

RISING = "rising from the lower end"
#: Rounding of a number of single precision, which arc lengths and instants may have.
ROUNDING = 1e-6


def label_orders(key: str, variables: Any, *, some: bool) -> dict[str, Any]:
    """Return the indices that bring labels into their order, by dimension; refuse labels that have none, and instants."""
    orders: dict[str, Any] = {}
    for name, known in IN_ORDER.items():
        if (variable := variables.get(name)) is None or not variable._dims:
            continue
        if variable._dims != (name,):
            raise scene_error(f"{key}: {name}", f"the dimensions {variable._dims}", f"labels over the dimension {name}")
        index = variable._data.array if isinstance(variable, xr.IndexVariable) else None
        if index is not None and id(index) in known:
            continue
        # an index of texts has the same methods, and takes ten times as long to become an array
        labels = variable.values if index is None else np.asarray(index.values) if index.dtype.kind in "fiu" else index
        if is_in_order(name, labels):
            if index is not None:
                note_in_order(name, index)
        elif name == "time":
            raise scene_error(f"{key}: time", labels.tolist(), "finite, rising instants [s], each once")
        elif (order := _label_order(key, name, labels.tolist(), some=some)) is not None:
            orders[name] = order
    return orders


def place_orders(key: str, variables: Any) -> dict[str, Any]:
    """Return the indices that bring particles and links into the order of their arc length; refuse those that have none."""
    orders: dict[str, Any] = {}
    for name, dim in (("arc_length", "particle"), ("link_arc_length", "link")):
        # of a link that was picked, the place is one number
        if (variable := variables.get(name)) is not None and (dim == "particle" or variable._dims):
            order = _place_order(key, name, dim, variable, variables.get("unstretched_length"))
            if order is not None:
                orders[dim] = order
    return orders


def _label_order(key: str, dim: str, labels: list[Any], *, some: bool) -> np.ndarray | None:
    """Return the indices that bring the labels of a dimension into their order, None where they have none and need none."""
    own = LABELS[dim]
    if own is None:  # modes
        if set(map(type, labels)) != {int} or len(set(labels)) < len(labels):
            raise scene_error(f"{key}: {dim}", labels, "different whole numbers")
        return None if labels == sorted(labels) else np.argsort(labels)
    if dim == "feature" and sorted(map(str, labels)) != sorted(own):
        return None  # of another version; whoever reads them looks at their names
    if some and dim == "coordinate" and len(labels) == 1 and labels[0] in own:
        return None
    if len(labels) < 2 or sorted(map(str, labels)) != sorted(own[: len(labels)]):
        raise scene_error(f"{key}: {dim}", labels, f"{' and '.join(own[: max(2, len(labels))])}, each once")
    return np.array([labels.index(label) for label in own[: len(labels)]])


def _place_order(key: str, name: str, dim: str, variable: xr.Variable, length: xr.Variable | None) -> np.ndarray | None:
    """Return the indices that bring particles or links into the order of their arc length, None where they are in it."""
    arc: np.ndarray = variable._data if type(variable._data) is np.ndarray else variable.values
    if dim not in variable._dims or arc.dtype.kind not in "fiu":
        raise scene_error(f"{key}: {name}", f"{variable._dims} of type {arc.dtype}", f"numbers over {dim} [m]")
    if arc.ndim > 1:
        return _common_order(
            np.moveaxis(arc, variable._dims.index(dim), -1).reshape(-1, arc.shape[variable._dims.index(dim)])
        )
    order, rises = None, is_rising(arc)
    if not rises:
        order = np.argsort(arc)
        arc = arc[order]
        rises = is_rising(arc)
    first, last = (float(arc[0]), float(arc[-1])) if arc.size else (math.nan, math.nan)
    if arc.size < (2 if dim == "particle" else 1) or not rises or not math.isfinite(first) or not math.isfinite(last):
        raise scene_error(f"{key}: {name}", variable.values.tolist(), f"those of the {dim}s, {RISING}, each once")
    if dim == "particle":
        end: Any = last
        if length is not None and not length._dims and length.dtype.kind in "fiu":
            end = float(length._data if type(length._data) is np.ndarray else length.values)
        if not (abs(first) <= ROUNDING * last and abs(last - end) <= ROUNDING * last):
            given = f"{first:g} ... {last:g} m of {end:g} m"
            raise scene_error(f"{key}: {name}", given, f"those of the {dim}s, {RISING}, 0, to the unstretched length")
    return order


def _common_order(rows: np.ndarray) -> np.ndarray | None:
    """Return the indices that bring all rows into rising order, None where they are in it or have no common one."""
    if not len(rows) or not (rows[:, 1:] < rows[:, :-1]).any():
        return None
    order = np.argsort(rows[0])
    return order if not (np.diff(rows[:, order], axis=1) < 0).any() else None
