"""Datasets read by their labels: variables checked, and put into the order of the package."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr
from xarray import Dataset
from xarray.indexes import PandasMultiIndex

from cablepod._inputs._kinds import ALWAYS_READ, ANY, PLACES, Dims, Kind, rule_of
from cablepod._inputs._labels import ROUNDING, label_orders, place_orders
from cablepod._resources import defer_sigint, defer_sigint_during_dask
from cablepod.conventions import ATTRIBUTES, LABELS, ORDERED, is_in_memory
from cablepod.errors import SceneError, scene_error, shown
from cablepod.parameters._checks import LARGEST
from cablepod.parameters._tables import OF_CABLE, OF_MAST, misspelt, place_of_variable
from cablepod.provenance import is_history

#: Compared with ``==``: a type that was unpickled, or has metadata, is another object.
FLOAT = np.dtype(float)
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
        instants that do not rise, particles without their arc length, other units, values that are no finite numbers, and modes
        that are not zero at both ends.
    """
    if not isinstance(given, Dataset):
        name = type(given).__name__
        article = "an" if name[:1].lower() in "aeiou" else "a"
        raise SceneError(f"{key}: given {article} {name}; allowed: {kind.allowed}{_remedy(kind)}")
    if kind is not ANY and not given.sizes.get("member", 1):
        raise SceneError(f"{key}: given no members; allowed: at least one")
    if not kind.is_small:
        given = _loaded(given)
    layout = _layout(key, given, kind)
    if kind.is_scene:
        _check_names(key, given)
    variables = read_by(kind, given.variables)
    has_gaps = kind.is_scene and "member" in (*given.dims, *given.coords)
    in_order = [
        _is_in_order(key, name, variable, kind, layout, has_gaps=has_gaps) for name, variable in variables.items()
    ]
    if kind is ANY:
        return given
    orders = label_orders(key, variables, some=kind.some) | place_orders(key, variables)
    coords = given.coords
    if orders or not all(in_order) or not all(name in coords for name in ORDERED if name in variables):
        given = _tidied(key, given, kind, layout, orders)
    if kind.layouts:
        for name, variable in given.variables.items():
            if name == "mean" or str(name).startswith("mode_shape"):
                check_ends(f"{key}: {name}", variable)
    return given


def several(key: str, given: Any, kind: Kind) -> list[xr.Dataset]:
    """Return one Dataset, or those of a list or tuple, as a list, each through :func:`taken`."""
    if not isinstance(given, list | tuple):
        return [taken(key, given, kind)]
    return [taken(f"{key}[{number}]", dataset, kind) for number, dataset in enumerate(given)]


def check_ends(key: str, shapes: xr.Variable) -> None:
    """Refuse shapes over ``particle`` that are not zero at both ends but by rounding."""
    values = shapes.values
    at_ends = float(np.abs(values.take((0, -1), shapes.dims.index("particle"))).max(initial=0.0))
    if at_ends and not at_ends <= ROUNDING * (size := float(np.abs(values).max())):
        raise scene_error(key, f"up to {at_ends:g} at the ends, of {size:g}", "zero at both ends")


def floats(array: Any) -> np.ndarray:
    """Return numbers as floats of this machine in the memory order of C, which decides on the last bits of sums."""
    return np.require(array, float, ("C", "ALIGNED", "WRITEABLE"))


def _loaded(given: xr.Dataset) -> xr.Dataset:
    """Return a Dataset whose lazy variables without instants, such as the places of particles, are in memory."""
    variables, indexes = given.variables, given.xindexes
    lazy = [name for name, variable in variables.items() if not is_in_memory(variable)]
    small = [name for name in lazy if name not in indexes and "time" not in variables[name].dims]
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
    missing = [name for name, _ in kind.needs if name not in given.variables]
    if missing and kind.instead and kind.instead[0] in given.variables:
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


def read_by(kind: Kind, variables: Mapping[Any, xr.Variable]) -> dict[Any, xr.Variable]:
    """Return the variables that functions of a kind read."""
    names = variables if kind.reads is None else filter(variables.__contains__, kind.reads)
    return {name: variables[name] for name in names}


def _check_names(key: str, scene: xr.Dataset) -> None:
    """Refuse variables of a scene that are named as keys, and are none; coordinates may have any name."""
    of = OF_MAST if "mast_height" in scene.variables else OF_CABLE
    for name in scene.data_vars:
        if isinstance(name, str) and (remedy := misspelt(name, of)):
            allowed = f"the keys of a scene of {of}, with _ for each point"
            raise SceneError(f"{key}: {name}: unknown variable of a scene; allowed: {allowed}; try: {remedy}")
    index = scene.xindexes.get("member") if "member" in scene.dims else None
    names = index.index.names if isinstance(index, PandasMultiIndex) else ()
    levels = [str(name) for name in names if place_of_variable(str(name)) is not None]
    if levels:
        raise SceneError(
            f"{key}: member: given an index of the parameters {', '.join(levels)}; allowed: parameters as variables; "
            'try: reset_index("member")'
        )


def _is_in_order(key: str, name: Any, variable: xr.Variable, kind: Kind, layout: str | None, *, has_gaps: bool) -> bool:
    """Tell whether a variable is as in the package, or need not be; refuse one that is not legal."""
    rule = rule_of(kind, layout, name)
    if rule is None:
        return True
    dims, dtype, units = variable.dims, variable.dtype, variable.attrs.get("units")
    if units is not None and type(units) is not str:
        units = shown(units)
    if not (
        units is None or rule.units is None or units == rule.units or powers(units) == powers(rule.units)
        or _is_another(name, dims, units)
    ):  # fmt: skip
        raise SceneError(f"{key}: {name}: given units {units!r}; allowed: {rule.units}, the units of the package")
    if rule.types and (dtype.kind not in rule.types or (dtype.kind == "f" and dtype.itemsize < 4)):
        allowed = "finite numbers of at least single precision"
        raise SceneError(f"{key}: {name}: given values of type {dtype}; allowed: {allowed}")
    if rule.dims is None:
        return True
    if not rule.must.issubset(dims) or (rule.may is not None and not rule.may.issuperset(dims)):
        raise SceneError(f"{key}: {name}: given the dimensions {dims}; allowed: {rule.allowed_dims}, {kind.allowed}")
    if name in PLACES:
        return dtype == FLOAT
    if name in LABELS or not kind.is_small:
        return True
    if dims != ordered(dims, rule.dims) or (rule.is_number and dtype != FLOAT) or not is_in_memory(variable):
        return False
    values = variable.data
    if type(values) is not np.ndarray or (kind.is_scene and not values.flags.carray):
        return False
    if dtype == FLOAT and not math.isfinite(np.vdot(values, values)):
        _check_finite(key, name, variable, kind, has_gaps=has_gaps)
    return True


def _is_another(name: Any, dims: tuple[Any, ...], units: str) -> bool:
    """Tell whether a result uses a name for something else: maps for factors of loads, peaks for means of any quantity."""
    is_factor = name == "edge_amplitude" or (name == "amplitude" and dims == ("amplitude",))
    return (is_factor and powers(units) == {}) or (name == "mean" and "particle" not in dims)


def ordered(dims: tuple[Any, ...], own: Dims) -> tuple[Any, ...]:
    """Return dimensions in the order of the package, others first."""
    return dims if dims == own else (*(dim for dim in dims if dim not in own), *(dim for dim in own if dim in dims))


def check_units(key: str, given: Any, units: str) -> None:
    """Refuse an array with labels in other units; one without units, and what has none, is taken as it is."""
    if not isinstance(given, xr.DataArray) or "units" not in given.attrs:
        return
    own = str(given.attrs["units"]).partition(" since ")[0].replace("seconds", "s")
    if powers(own) != powers(units):
        raise SceneError(f"{key}: given units {own!r}; allowed: {units}")


def numbers_in(key: str, given: Any, units: str, allowed: str) -> np.ndarray:
    """Return finite numbers as floats (n,); refuse others, and those that are labelled with other units."""
    check_units(key, given, units)
    try:
        array = np.atleast_1d(np.asarray(given))
        # complex numbers, dates, differences of times, truth values and texts, which numpy would convert
        numbers = np.full(1, np.nan) if array.dtype.kind in "bcmMSU" else array.astype(float)
    except (OverflowError, TypeError, ValueError):
        raise scene_error(key, given, allowed) from None
    if numbers.ndim != 1 or not numbers.size or not np.isfinite(numbers).all():
        raise scene_error(key, given, allowed)
    return numbers


def check_times(times: Any) -> np.ndarray:
    """Return output times as floats [s]; refuse them unless they are finite, rising and not negative."""
    allowed = "finite, rising instants from 0 on [s]"
    result = numbers_in("times", times, "s", allowed)
    if result[0] < 0.0 or (np.diff(result) <= 0.0).any():
        raise scene_error("times", times, allowed)
    return result


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


def _check_finite(key: str, name: str, variable: xr.Variable, kind: Kind, *, has_gaps: bool) -> None:
    """Refuse values that are no finite numbers.

    In scenes of members, and in one of these, rows of nan stand for a variable that a member lacks (`has_gaps`).  Records of
    members end with nan where those of others are longer.
    """
    data = variable.values
    missing = np.isnan(data)
    if has_gaps and missing.any():
        rows = missing.reshape(-1, 1 if variable.dims[-1:] in ((), ("member",)) else data.shape[-1])
        missing = rows.any(axis=1) & ~rows.all(axis=1)
        if variable.dims and str(variable.dims[-1]).endswith("_sample"):
            missing = np.diff(rows.astype(int), axis=1) < 0
    largest = np.abs(data[np.isfinite(data)]).max(initial=0.0)
    if missing.any() and not data.ndim and kind.is_scene:
        allowed = f"a finite number of at most {LARGEST:g}, or no such variable; try: {key}.drop_vars({name!r})"
        raise scene_error(f"{key}: {name}", math.nan, allowed)
    if missing.any() or np.isinf(data).any() or largest > LARGEST:
        raise scene_error(f"{key}: {name}", "values that are not finite", f"finite numbers of at most {LARGEST:g}")


# --- a Dataset in order -----------------------------------------------------------------------------------------------------


def _tidied(key: str, given: xr.Dataset, kind: Kind, layout: str | None, orders: dict[str, Any]) -> xr.Dataset:
    """Return a copy with labels, particles, dimensions and arrays as in the package."""
    result = given.isel(orders) if orders else given.copy()
    of_dims = [name for name in result.sizes if name in result.variables]
    result = result.set_coords(of_dims)  # xarray merges no labels that are plain variables
    variables: dict[Any, xr.Variable] = {}
    for name, variable in read_by(kind, result.variables).items():
        own = LABELS.get(name)
        if name in LABELS and variable.dims == (name,):
            if own is not None and variable.dtype.kind == "O":
                variables[name] = xr.Variable(variable.dims, np.array(variable.values, str), variable.attrs)
            continue
        if name in PLACES:
            variables[name] = xr.Variable(variable.dims, floats(variable.values), variable.attrs)
            continue
        rule = rule_of(kind, layout, name) if kind.is_small else None
        if rule is None or rule.dims is None:
            continue
        order = ordered(variable.dims, rule.dims)
        values = variable.transpose(*order).values
        if rule.is_number:
            values = floats(values)
            if not math.isfinite(np.vdot(values, values)):
                has_gaps = kind.is_scene and "member" in (*given.dims, *given.coords)
                _check_finite(key, str(name), xr.Variable(order, values), kind, has_gaps=has_gaps)
        variables[name] = xr.Variable(order, values, variable.attrs)
    coords = {name: variable for name, variable in variables.items() if name in result.coords}
    return result.assign({name: variable for name, variable in variables.items() if name not in coords}).assign_coords(
        coords
    )
