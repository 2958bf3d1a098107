"""Orders of labels, instants and particles: found, or refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import LABELS, ORDERED, is_in_order, is_rising
from cablepod.errors import scene_error

RISING = "rising from the lower end"
#: Rounding of a number of single precision, which arc lengths and instants may have.
ROUNDING = 1e-6


def label_orders(key: str, variables: Any, *, some: bool) -> dict[str, Any]:
    """Return the indices that bring labels into their order, by dimension; refuse labels that have none, and instants."""
    orders: dict[str, Any] = {}
    for name in ORDERED:
        if (variable := variables.get(name)) is None or not variable.dims:
            continue
        if variable.dims != (name,):
            raise scene_error(f"{key}: {name}", f"the dimensions {variable.dims}", f"labels over the dimension {name}")
        labels = variable.values
        if is_in_order(name, labels):
            continue
        if name == "time":
            raise scene_error(f"{key}: time", labels.tolist(), "finite, rising instants [s], each once")
        if (order := _label_order(key, name, labels.tolist(), some=some)) is not None:
            orders[name] = order
    return orders


def place_orders(key: str, variables: Any) -> dict[str, Any]:
    """Return the indices that bring particles and links into the order of their arc length; refuse those that have none."""
    orders: dict[str, Any] = {}
    for name, dim in (("arc_length", "particle"), ("link_arc_length", "link")):
        # of a link that was picked, the place is one number
        if (variable := variables.get(name)) is not None and (dim == "particle" or variable.dims):
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
    arc = variable.values
    if dim not in variable.dims or arc.dtype.kind not in "fiu":
        raise scene_error(f"{key}: {name}", f"{variable.dims} of type {arc.dtype}", f"numbers over {dim} [m]")
    place = variable.dims.index(dim)
    if arc.shape[place] < (least := 2 if dim == "particle" else 1):
        raise scene_error(f"{key}: {name}", f"those of {arc.shape[place]} {dim}s", f"at least {least}")
    rows = arc[None] if arc.ndim == 1 else np.moveaxis(arc, place, -1).reshape(-1, arc.shape[place])
    order = _common_order(rows)
    rows = rows if order is None else rows[:, order]
    if arc.ndim == 1 and not (is_rising(rows[0]) and np.isfinite(rows).all()):
        raise scene_error(f"{key}: {name}", arc.tolist(), f"those of the {dim}s, {RISING}, each once")
    if dim == "particle":
        _check_ends(f"{key}: {name}", rows, length)
    return order


def _check_ends(key: str, rows: np.ndarray, length: xr.Variable | None) -> None:
    """Refuse places of particles (members, particle) that are not from 0 to the unstretched length; nan is no particle."""
    lasts = rows[:, -1].tolist()
    is_own = length is not None and length.dtype.kind in "fiu" and length.size == len(rows)
    ends = length.values.ravel().tolist() if length is not None and is_own else lasts
    for first, last, end in zip(rows[:, 0].tolist(), lasts, ends, strict=True):  # arrays would take longer for one
        if abs(first) > ROUNDING * last or abs(last - end) > ROUNDING * last:
            given = f"{first:g} ... {last:g} m of {end:g} m"
            raise scene_error(key, given, f"those of the particles, {RISING}, 0, to the unstretched length")


def _common_order(rows: np.ndarray) -> np.ndarray | None:
    """Return the indices that bring all rows into rising order, None where they are in it or have no common one."""
    if not len(rows) or not (rows[:, 1:] < rows[:, :-1]).any():
        return None
    order = np.argsort(rows[0])
    return order if not (np.diff(rows[:, order], axis=1) < 0).any() else None
