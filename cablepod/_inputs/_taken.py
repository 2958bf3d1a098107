"""Datasets read by their labels: variables checked, and put into the order of the package."""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr
from xarray import Dataset

from cablepod._inputs._kinds import ANY, DIMS, PLACES, SEPARATE, TABLES_OF_MODES, Dims, Kind
from cablepod._inputs._labels import label_orders, place_orders
from cablepod._inputs._seen import ALWAYS_READ, FLOAT, is_like_one_in_order, note_in_order, read_by
from cablepod._resources import defer_sigint, defer_sigint_during_dask
from cablepod.conventions import ATTRIBUTES, IN_ORDER, LABELS, UNITS, VARIABLES
from cablepod.errors import SceneError, scene_error, shown
from cablepod.parameters._checks import LARGEST, point, points
from cablepod.parameters._key_paths import key_of_variable
from cablepod.provenance import is_history

#: Types of a number; a tuple is tested ten times as fast as a union.
REAL = (float, int, np.integer, np.floating)
#: Attributes that are numbers, and those that are texts.
NUMBERS = frozenset(ATTRIBUTES) | {"accepted_time_error"}
TEXTS = ("id",)
#: Names of units in full, as pint writes them.
UNITS_IN_FULL = {
    "meter": "m", "metre": "m", "second": "s", "newton": "N", "pascal": "Pa", "radian": "rad", "kilogram": "kg", "joule": "J",
}  # fmt: skip


def taken(key: str, given: Any, kind: Kind) -> xr.Dataset:
    """Return a Dataset that a public function is given, in the order of the package.

    Parameters
    ----------
    key
        Name of the argument.
    given
        The argument.
    kind
        What it may be.

    Returns
    -------
    xarray.Dataset
        The Dataset itself where nothing is to be done, otherwise a copy.

    Raises
    ------
    SceneError
        For something else than a Dataset, for missing variables and dimensions, labels that are repeated or not the package's,
        instants that do not rise, particles without their arc length, other units, and values that are no finite numbers.
    """
    if not isinstance(given, Dataset):
        name = type(given).__name__
        article = "an" if name[:1].lower() in "aeiou" else "a"
        raise SceneError(f"{key}: given {article} {name}; allowed: {kind.allowed}{_remedy(kind)}")
    if kind is not ANY and is_like_one_in_order(key, given, kind):
        return given
    if not kind.is_small:
        given = _loaded(given)
    variables: dict[Any, Any] = read_by(kind, given._variables)
    layout = _layout(key, given, kind)
    tidy = kind is ANY or given._coord_names.issuperset(filter(IN_ORDER.__contains__, variables))
    for name, variable in variables.items():
        data, attrs = variable._data, variable._attrs
        units = attrs.get("units") if attrs else None
        if units is not None and type(units) is not str:
            units = shown(units)
        verdict = _verdict(kind, layout, name, variable._dims, units, data.dtype)
        if verdict is None:
            continue
        if verdict.__class__ is tuple:
            raise SceneError(f"{key}: {name}: given {verdict[0]}; allowed: {verdict[1]}")
        if verdict is not True or type(data) is not np.ndarray or (kind.is_scene and not data.flags.carray):
            tidy = False
        elif data.dtype == FLOAT and not math.isfinite(np.vdot(data, data)):
            _check_finite(key, name, variable, kind)
    if kind is ANY:
        return given if tidy else _tidied(key, given, kind, layout, {})
    orders = label_orders(key, variables, some=kind.some) | place_orders(key, variables)
    if not tidy or orders:
        return _tidied(key, given, kind, layout, orders)
    note_in_order(given, kind)
    return given


def several(key: str, given: Any, kind: Kind) -> list[xr.Dataset]:
    """Return one Dataset, or those of a list or tuple, as a list, each through :func:`taken`."""
    if not isinstance(given, list | tuple):
        return [taken(key, given, kind)]
    return [taken(f"{key}[{number}]", dataset, kind) for number, dataset in enumerate(given)]


def floats(array: Any) -> np.ndarray:
    """Return numbers as floats of this machine in the memory order of C, which decides on the last bits of sums."""
    if type(array) is np.ndarray and array.dtype == FLOAT and array.flags.carray:  # ten times as fast as numpy's test
        return array
    return np.require(array, float, ("C", "ALIGNED", "WRITEABLE"))


def _loaded(given: xr.Dataset) -> xr.Dataset:
    """Return a Dataset whose lazy variables without instants, such as the places of particles, are in memory."""
    variables: dict[Any, xr.Variable] = given._variables
    lazy = {name for name, variable in variables.items() if not variable._in_memory}
    small = [name for name in lazy - set(given._indexes) if "time" not in variables[name].dims]
    if not small:
        return given
    with defer_sigint(), defer_sigint_during_dask(given):  # dask and the files of xarray hold locks meanwhile
        loaded = given[small].compute()
    coords, others = [name for name in small if name in given.coords], [name for name in small if name in given]
    given = given.assign_coords({name: loaded[name].variable for name in coords})
    return given.assign({name: loaded[name].variable for name in others if name not in coords})


# --- variables ------------------------------------------------------------------------------------------------------------


def _layout(key: str, given: xr.Dataset, kind: Kind) -> str | None:
    """Return the layout of modes; refuse other stages and layouts, and a Dataset that lacks variables."""
    stage = given.attrs.get("stage")
    missing = [name for name, _ in kind.needs if name not in given._variables]
    if missing and kind.instead and kind.instead[0] in given._variables:
        raise SceneError(kind.instead[1])
    if missing:
        of_stage = "" if stage is None else f" of stage {shown(stage)}"
        remedy = _remedy(kind) if stage is None else ""  # all Datasets of the package have one
        raise SceneError(
            f"{key}: given a Dataset{of_stage} without {' and '.join(missing)}; allowed: {kind.allowed}{remedy}"
        )
    history = given.attrs.get("history_json", "[]")
    if kind is not ANY and not (isinstance(history, str) and is_history(history)):
        raise scene_error(
            f"{key}: history_json", history, "the stages of the Dataset as the package writes them, or none"
        )
    if kind is not ANY:
        _check_attributes(key, given.attrs, kind)
    if kind.stages and stage is not None and not (isinstance(stage, str) and stage in kind.stages):
        raise SceneError(f"{key}: given a Dataset of stage {shown(stage)}; allowed: {kind.allowed}")
    if not kind.layouts:
        return None
    layout = given.attrs.get("layout")
    if not isinstance(layout, str) or layout not in kind.layouts:
        remedy = _remedy(kind) if layout is None else ""
        raise SceneError(f"{key}: given layout {shown(layout)}; allowed: {kind.allowed}{remedy}")
    return layout


def _remedy(kind: Kind) -> str:
    """Return the last part of the message that refuses something else, for data of another program."""
    return f"; try: {kind.own}" if kind.own else ""


def _check_attributes(key: str, attrs: dict[Any, Any], kind: Kind) -> None:
    """Refuse attributes of other types than the package writes: all, or those that functions of a kind read."""
    for name, value in attrs.items():
        if kind.reads is not None and name not in ALWAYS_READ:
            continue
        if name in NUMBERS and not isinstance(value, REAL):
            raise scene_error(f"{key}: {name}", value, "a number as the package writes it, or none")
        if name in TEXTS and not isinstance(value, str):
            raise scene_error(f"{key}: {name}", value, "a text as the package writes it, or none")


@lru_cache(4096)
def _verdict(kind: Kind, layout: str | None, name: str, dims: Dims, units: str | None, dtype: np.dtype) -> Any:
    """Tell of a variable whether it is as in the package; None if it does not matter, (given, allowed) if it is not legal."""
    found = _known(kind, layout, name)
    if found is None:
        return None
    own_units, own_dims, is_number = found
    if units is not None and own_units is not None and units != own_units and powers(units) != powers(own_units):
        return f"units {units!r}", f"{own_units}, the units of the package"
    is_checked = kind is not ANY and (is_number or (not kind.is_scene and name not in LABELS))
    legal = "fiu" if own_units is not None else "fiub"  # truth values have no units
    if is_checked and (dtype.kind not in legal or (dtype.kind == "f" and dtype.itemsize < 4)):
        return f"values of type {dtype}", "finite numbers of at least single precision"
    if own_dims is None or not _matters(kind, name):
        return None
    must, may = _dims_allowed(kind, layout, name, own_dims)
    if not set(must) <= set(dims) or (may is not None and not set(dims) <= set(may)):
        return f"the dimensions {dims}", f"{must or own_dims}, {kind.allowed}"
    if name in PLACES:
        return None if dtype == FLOAT else False
    if name in LABELS or not kind.is_small:
        return None
    order = (*(dim for dim in dims if dim not in own_dims), *(dim for dim in own_dims if dim in dims))
    return order == dims and (not is_number or dtype == FLOAT)


@lru_cache(4096)
def _known(kind: Kind, layout: str | None, name: str) -> tuple[str | None, Dims | None, bool] | None:
    """Return units, dimensions and whether it holds numbers of a variable of the package or of this kind; None for others."""
    if kind.is_scene:
        key = key_of_variable(name) if isinstance(name, str) else None
        if key is None:
            return None
        vector: dict[Any, Dims] = {point: ("coordinate",), points: (f"{name}_point", "coordinate")}
        return key.units, vector.get(key.check, ()), key.units is not None and not key.is_whole
    units = VARIABLES.get(name, ATTRIBUTES.get(name, (UNITS.get(name),)))[0]
    dims = SEPARATE.get(name) if layout == "separate" else None
    dims = DIMS.get(name, dict(kind.needs).get(name)) if dims is None else dims
    return None if units is None and dims is None else (units, dims, dims is not None and name not in LABELS)


def _matters(kind: Kind, name: str) -> bool:
    """Tell whether functions that take this kind use a variable: all of scenes and modes, otherwise those that they need."""
    if kind.is_scene or kind.layouts or name == "scene_feature":
        return kind is not ANY
    return name.removesuffix("_out_of_plane") in dict(kind.needs)


def _dims_allowed(kind: Kind, layout: str | None, name: str, own: Dims) -> tuple[Dims, Dims | None]:
    """Return the dimensions that a variable must have, and those that it may have (None for any)."""
    needed = own if name == "scene_feature" else dict(kind.needs).get(name, ())
    if kind.is_scene:
        return own, (*own, "member", *((f"{name}_item", name.rpartition("_")[0] + "_sample") if not own else ()))
    if not kind.layouts:
        return needed, None if kind.further is None else (*own, *kind.further)
    if name.startswith("mode_shape") and layout != "separate":
        own = own if layout == "vector" else ("mode", "particle")
    elif name.startswith((*TABLES_OF_MODES, "truncation_error")) and layout != "separate":
        own = tuple(dim for dim in own if dim != "coordinate")
    return own, own


@lru_cache(256)
def powers(units: str) -> dict[str, int] | None:
    """Return the powers of the units in a text such as "m s-1", "m/s" or "meter / second"; None for any other text."""
    powers: dict[str, int] = {}
    for place, part in enumerate(units.replace("**", "").replace("^", "").replace("*", " ").split("/")):
        for token in part.split():
            found = re.fullmatch(r"([A-Za-z]+|1)(-?\d+)?", token)
            if not found:
                return None
            name = UNITS_IN_FULL.get(found[1], found[1])
            if name not in ("1", "dimensionless"):
                powers[name] = powers.get(name, 0) + int(found[2] or 1) * (-1 if place else 1)
    return {name: power for name, power in powers.items() if power} if units.strip() else None


def _check_finite(key: str, name: str, variable: xr.Variable, kind: Kind) -> None:
    """Refuse values that are no finite numbers; in scenes rows of nan stand for a variable that a member lacks.

    Records of members end with nan where those of others are longer.
    """
    data = variable.values
    missing = np.isnan(data)
    if kind.is_scene and missing.any():
        rows = missing.reshape(-1, 1 if variable.dims[-1:] in ((), ("member",)) else data.shape[-1])
        missing = rows.any(axis=1) & ~rows.all(axis=1)
        if "member" in variable.dims and str(variable.dims[-1]).endswith("_sample"):
            missing = np.diff(rows.astype(int), axis=1) < 0
    largest = np.abs(data[np.isfinite(data)]).max(initial=0.0)
    if missing.any() or np.isinf(data).any() or largest > LARGEST:
        raise scene_error(f"{key}: {name}", "values that are not finite", f"finite numbers of at most {LARGEST:g}")


# --- a Dataset in order -----------------------------------------------------------------------------------------------------


def _tidied(key: str, given: xr.Dataset, kind: Kind, layout: str | None, orders: dict[str, Any]) -> xr.Dataset:
    """Return a copy with labels, particles, dimensions and arrays as in the package."""
    result = given.isel(orders) if orders else given.copy()
    of_dims = [name for name in result._dims if name in result._variables]
    result = result.set_coords(of_dims)  # xarray merges no labels that are plain variables
    variables: dict[Any, xr.Variable] = {}
    for name, variable in read_by(kind, result._variables).items():
        own = LABELS.get(name)
        if name in LABELS and variable.dims == (name,):
            if own is not None and variable.dtype.kind == "O":
                variables[name] = xr.Variable(variable.dims, np.array(variable.values, str), variable.attrs)
            continue
        if name in PLACES:
            variables[name] = xr.Variable(variable.dims, floats(variable.values), variable.attrs)
            continue
        known = _known(kind, layout, str(name)) if kind.is_small and _matters(kind, str(name)) else None
        if known is None or known[1] is None:
            continue
        order = (
            *(dim for dim in variable.dims if dim not in known[1]),
            *(dim for dim in known[1] if dim in variable.dims),
        )
        values = variable.transpose(*order).values
        if known[2]:
            values = floats(values)
            if not math.isfinite(np.vdot(values, values)):
                _check_finite(key, str(name), xr.Variable(order, values), kind)
        variables[name] = xr.Variable(order, values, variable.attrs)
    coords = {name: variable for name, variable in variables.items() if name in result.coords}
    return result.assign({name: variable for name, variable in variables.items() if name not in coords}).assign_coords(
        coords
    )
