"""Make a scene Dataset from nested tables, with all checks of user input.

The variables of a scene are the keys of the scene file with ``_`` for ``.``: ``cable.area`` is the variable ``cable_area`` [m2].
An absent key is an absent variable.  :func:`parameters` makes the numbers with which the models compute.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._resources import check_memory
from cablepod.conventions import COORDINATES, ENDS, label
from cablepod.errors import SceneError, named, scene_error, shown
from cablepod.parameters._checks import choice, point
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._key_paths import motion_path, point_load_path, replaced, variable_name
from cablepod.parameters._keys import (
    ENSEMBLE,
    INITIAL,
    LENGTH_KEYS,
    OTHER_TABLES,
    POINT_LOAD,
    TABLES,
    TOP,
    WEIGHT_KEYS,
    Key,
    check_table,
    exactly_one,
    join,
    time_function_keys,
)
from cablepod.parameters._parameters import Parameters, count_instants
from cablepod.scene._files import read_record
from cablepod.scene._limits import LONGEST, SHORTEST, check_limits
from cablepod.scene._ranges import check_ranges


def make_scene(mapping: Mapping[str, Any]) -> xr.Dataset:
    """Make a scene from nested Python values with the keys of the scene file.

    Parameters
    ----------
    mapping
        Tables as mappings, vectors as sequences, SI units.  Not modified.

    Returns
    -------
    xarray.Dataset
        A variable with units for each key, its name the key path with ``_`` for ``.``.

    Raises
    ------
    SceneError
        For unknown and missing keys, two ways to give the length, types, signs and magnitudes that are not allowed, a
        tension below the minimum, and output larger than the memory.  The message names the key, the given value and the
        allowed ones.

    Examples
    --------
    >>> import cablepod as cp
    >>> cable = {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "top_tension": 15000.0}
    >>> ends = {"lower": [0.0, 0.0], "upper": [20.4, 57.7]}
    >>> scene = cp.make_scene({"title": "A guy", "cable": cable, "ends": ends, "chain": {"links": 40}})
    >>> scene.ends_upper.values.tolist(), scene.ends_upper.units
    ([20.4, 57.7], 'm')
    >>> cp.make_scene({"cable": {**cable, "area": -1.0}, "ends": ends})
    Traceback (most recent call last):
    cablepod.errors.SceneError: cable.area: given -1.0; allowed: a finite number above 0
    """
    return _make(mapping, Path())


def check_numbers(p: Parameters) -> None:
    """Check the numbers of a scene together: records, motions, statics, strains, memory.

    Raises
    ------
    SceneError
        For a scene that cannot be simulated; the message names the key, the given value and the allowed ones.
    """
    p.check_reach(p.duration or 0.0)
    check_limits(p)
    instants = 1 if p.duration is None or p.interval is None else count_instants(p.duration, p.interval)
    check_memory(instants, p.links or 1, p.dims, key="chain.links and time.interval")


# --- checks ---------------------------------------------------------------------------------------------------------


def _make(mapping: Mapping[str, Any], folder: Path) -> xr.Dataset:
    """Make a scene; paths of records are relative to `folder`."""
    tree = _check(mapping, folder)
    scene = _to_dataset(tree)
    scene.attrs["title"] = tree.get("title", "untitled scene")
    scene.attrs["stage"] = "scene"
    if "ensemble" in tree:
        scene.attrs["ensemble_json"] = json.dumps(tree["ensemble"], sort_keys=True)
    provenance.stamp_values(provenance.record(scene, function="make_scene", parameters={"scene": tree}))
    check_numbers(parameters(scene))
    _check_bounds(mapping, tree.get("ensemble", {}).get("ranges", {}), folder)
    return scene


def _check(mapping: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Check all tables; return them with defaults filled in and records read."""
    if not isinstance(mapping, Mapping):
        raise scene_error("scene", mapping, "a mapping with the tables of a scene; read_scene reads a file")
    _check_names(mapping)
    tree = check_table("", {key: mapping[key] for key in mapping if key in TOP}, TOP)
    for name, keys in TABLES.items():
        if name == "load" and name in mapping:
            tree[name] = _check_with_factor(name, mapping[name], keys, folder)
        elif name in mapping:
            tree[name] = check_table(name, mapping[name], keys)
    dims = _check_ends(tree)
    _check_cable(tree)
    _check_chain(tree)
    _check_initial(tree, dims)
    _check_time(tree)
    if "load" in tree:
        _check_vector("load.uniform", tree["load"]["uniform"], dims)
    if "motion" in mapping:
        tree["motion"] = _check_motion(mapping["motion"], dims, tree["ends"].get("free"), folder)
    if "point_load" in mapping:
        tree["point_load"] = _check_point_loads(mapping["point_load"], dims, folder)
    if "ensemble" in mapping:
        tree["ensemble"] = _check_ensemble(mapping["ensemble"], tree)
    return tree


def _check_names(mapping: Mapping[str, Any]) -> None:
    allowed = [*TOP, *TABLES, *OTHER_TABLES]
    for name in mapping:
        if name not in allowed:
            raise SceneError(f"{named(name)}: unknown key or table; allowed: {', '.join(allowed)}")
    for name in ("cable", "ends"):
        if name not in mapping:
            raise SceneError(f"{name}: missing; allowed: a table with the keys {', '.join(TABLES[name])}")


def _check_vector(key: str, value: list[float], dims: int) -> None:
    if len(value) != dims:
        raise scene_error(key, value, f"{dims} numbers, as many as ends.lower has")


def _check_ends(tree: dict[str, Any]) -> int:
    lower, upper = tree["ends"]["lower"], tree["ends"]["upper"]
    if len(lower) != len(upper):
        raise scene_error("ends.upper", upper, f"{len(lower)} numbers, as many as ends.lower has")
    if lower == upper:
        raise scene_error(
            "ends.upper", upper, "a point other than ends.lower, because ends that coincide span no cable"
        )
    chord = math.dist(lower, upper)
    if not SHORTEST <= chord <= LONGEST:
        raise scene_error("ends.upper", upper, f"a chord from {SHORTEST:g} m to {LONGEST:g} m (it is {chord:g} m)")
    return len(lower)


def _check_cable(tree: dict[str, Any]) -> None:
    cable = tree["cable"]
    exactly_one("cable", cable, LENGTH_KEYS)
    kind = exactly_one("cable", cable, WEIGHT_KEYS)
    if kind == "specific_weight" and tree["gravity"] == 0.0:
        raise scene_error(
            "cable.specific_weight", cable[kind], "cable.density instead, as without gravity it gives no mass"
        )
    modulus = cable["youngs_modulus"]
    stiffness = modulus * cable["area"]
    if not 1e-6 <= stiffness <= 1e18:
        raise scene_error(
            "cable.youngs_modulus", modulus, f"an axial stiffness of 1e-6 to 1e18 N (it is {stiffness:g} N)"
        )
    mass = cable[kind] * cable["area"] / (tree["gravity"] if kind == "specific_weight" else 1.0)
    if not 1e-15 <= mass <= 1e15 or not mass * tree["gravity"] <= 1e15:
        raise scene_error(
            f"cable.{kind}", cable[kind], f"1e-15 to 1e15 kg/m and at most 1e15 N/m (it is {mass:g} kg/m)"
        )


def _check_chain(tree: dict[str, Any]) -> None:
    if "chain" not in tree:
        return
    chain = tree["chain"]
    if "links" not in chain and "link_lengths" not in chain:
        raise SceneError("chain.links: missing; allowed: a whole number of at least 2, or chain.link_lengths")
    lengths = chain.get("link_lengths")
    if lengths is not None:
        if chain.setdefault("links", len(lengths)) != len(lengths):
            raise scene_error("chain.link_lengths", lengths, f"{chain['links']} numbers, as many as chain.links says")
        if max(lengths) / min(lengths) > 1e6:
            raise scene_error("chain.link_lengths", lengths, "lengths that differ by a factor of at most 1e6")


def _check_initial(tree: dict[str, Any], dims: int) -> None:
    if "initial" not in tree:
        return
    initial = tree["initial"]
    if exactly_one("initial", initial, tuple(INITIAL)) != "points":
        return
    line = initial["points"]
    for index, place in enumerate(line):
        _check_vector(f"initial.points[{index}]", place, dims)
    chord = math.dist(tree["ends"]["lower"], tree["ends"]["upper"])
    for end, place in zip(ENDS, (line[0], line[-1]), strict=True):
        held = tree["ends"][end]
        if end != tree["ends"].get("free") and math.dist(place, held) > 1e-9 * chord:
            raise scene_error(
                "initial.points", place, f"a line that begins and ends at the held ends (ends.{end} is {held})"
            )
    if not sum(math.dist(a, b) for a, b in pairwise(line)) > 1e-9 * chord:
        raise scene_error("initial.points", line, "a line of some length")


def _check_time(tree: dict[str, Any]) -> None:
    if "time" not in tree:
        return
    duration, interval = tree["time"]["duration"], tree["time"]["interval"]
    if interval > duration:
        raise scene_error("time.interval", interval, f"at most time.duration, {duration:g} s")
    if duration / interval > 1e12:
        raise scene_error("time.interval", interval, f"an interval that {duration:g} s holds at most 1e12 times")


def _check_with_factor(prefix: str, table: Any, keys: Mapping[str, Key], folder: Path) -> dict[str, Any]:
    """Check the table of a load, with the keys of its time factor if it has one."""
    if not isinstance(table, Mapping):
        raise scene_error(prefix, table, "a table with the keys " + ", ".join(keys))
    load = {name: value for name, value in table.items() if name in keys}
    factor = {name: value for name, value in table.items() if name not in keys}
    factor_keys = {"kind", *(name for kind in time_function_keys("1").values() for name in kind)}
    for name in factor:
        if name not in factor_keys:
            allowed = ", ".join([*keys, "kind (of a time factor)"])
            raise SceneError(f"{join(prefix, name)}: unknown key; allowed: {allowed}")
    checked = check_table(prefix, load, keys)
    return checked | _check_time_function(prefix, factor, "1", folder) if factor else checked


def _check_time_function(prefix: str, table: Any, units: str, folder: Path) -> dict[str, Any]:
    kinds = time_function_keys(units)
    if not isinstance(table, Mapping):
        raise scene_error(prefix, table, "a table with the key kind")
    if "kind" not in table:
        raise SceneError(f"{prefix}.kind: missing; allowed: one of {', '.join(kinds)}")
    kind = choice(*kinds)(f"{prefix}.kind", table["kind"])
    values = {name: value for name, value in table.items() if name != "kind"}
    checked = check_table(prefix, values, kinds[kind])
    if kind == "file":
        checked.update(read_record(f"{prefix}.path", folder / checked["path"]))
    return {"kind": kind, **checked}


def _check_motion(table: Any, dims: int, free: str | None, folder: Path) -> dict[str, Any]:
    if not isinstance(table, Mapping):
        raise scene_error("motion", table, "tables motion.lower.x, motion.upper.y and so on")
    axes = COORDINATES[:dims]
    checked: dict[str, Any] = {}
    for end, motions in table.items():
        if end not in ENDS:
            raise SceneError(f"motion.{named(end)}: unknown key; allowed: {', '.join(ENDS)}")
        if not isinstance(motions, Mapping):
            raise scene_error(f"motion.{end}", motions, f"tables motion.{end}.x and so on")
        if end == free and motions:
            raise scene_error(f"motion.{end}", dict(motions), f"no motion of the end that ends.free names ({free})")
        checked[end] = {}
        for axis, function in motions.items():
            if axis not in axes:
                raise SceneError(f"motion.{end}.{named(axis)}: unknown axis; allowed: {', '.join(axes)}")
            checked[end][axis] = _check_time_function(motion_path(end, axis), function, "m", folder)
    return checked


def _check_point_loads(loads: Any, dims: int, folder: Path) -> list[dict[str, Any]]:
    if not isinstance(loads, list | tuple):
        raise scene_error("point_load", loads, "an array of tables, [[point_load]]")
    checked = []
    for index, table in enumerate(loads, start=1):
        prefix = point_load_path(index)
        load = _check_with_factor(prefix, table, POINT_LOAD, folder)
        _check_vector(f"{prefix}.force", load["force"], dims)
        checked.append(load)
    return checked


def _check_ensemble(table: Any, tree: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(table, Mapping):
        raise scene_error("ensemble", table, "a table with the keys " + ", ".join([*ENSEMBLE, "ranges"]))
    checked = check_table("ensemble", {key: value for key, value in table.items() if key != "ranges"}, ENSEMBLE)
    count, sampling = checked["members"], checked["sampling"]
    checked["ranges"] = check_ranges(table.get("ranges"), tree, members=count, sampling=sampling)
    return checked


def _check_bounds(mapping: Mapping[str, Any], ranges: Mapping[str, list[float]], folder: Path) -> None:
    """Refuse a range of an ensemble if the scene at one of its bounds is refused."""
    single = {name: table for name, table in mapping.items() if name != "ensemble"}
    for path, values in ranges.items():
        for bound in sorted({min(values), max(values)}):
            try:
                _make(replaced(single, path, bound), folder)
            except SceneError as error:
                text = f"ensemble.ranges.{path}: given {shown(values)}, at {bound:g} no scene: {error}"
                raise SceneError(text) from None


# --- Dataset --------------------------------------------------------------------------------------------------------


Variables = dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]


def _to_dataset(tree: dict[str, Any]) -> xr.Dataset:
    """Make the variables of a checked scene."""
    variables = {"gravity": _variable("gravity", tree["gravity"], TOP["gravity"])}
    for table, keys in TABLES.items():
        values = tree.get(table, {})
        variables |= _table_variables(table, values, {name: keys[name] for name in values if name in keys})
    variables |= _time_function_variables("load", tree.get("load", {}), "1", "factor of the uniform load")
    for end, axes in tree.get("motion", {}).items():
        for axis, function in axes.items():
            long_name = f"displacement of the {end} end along {axis}"
            variables |= _time_function_variables(motion_path(end, axis), function, "m", long_name)
    for number, load in enumerate(tree.get("point_load", []), start=1):
        path = point_load_path(number)
        variables |= _table_variables(path, load, POINT_LOAD)
        variables |= _time_function_variables(path, load, "1", f"factor of point load {number}")
    dims = len(tree["ends"]["lower"])
    scene = xr.Dataset(variables, coords={"coordinate": list(COORDINATES[:dims])})
    label(scene[["coordinate"]])
    return scene


def _table_variables(path: str, table: Mapping[str, Any], keys: Mapping[str, Key]) -> Variables:
    """Make the variables of the keys of a table, in the order of `keys`."""
    names = {key: variable_name(f"{path}.{key}") for key in keys}
    return {name: _variable(name, table[key], keys[key]) for key, name in names.items()}


def _time_function_variables(path: str, table: Mapping[str, Any], units: str, long_name: str) -> Variables:
    """Make the variables of a time function; none for a table without `kind`."""
    if "kind" not in table:
        return {}
    kind = {"long_name": f"kind of {long_name}"}
    variables: Variables = {variable_name(f"{path}.kind"): ((), np.asarray(table["kind"]), kind)}
    keys = time_function_keys(units)[table["kind"]]
    keys = {name: Key(key.check, key.units, f"{key.long_name}, {long_name}") for name, key in keys.items()}
    variables |= _table_variables(path, table, keys)
    if table["kind"] == "file":
        samples = variable_name(f"{path}.sample")
        for name, unit in (("time", "s"), ("value", units)):
            attrs = {"units": unit, "long_name": f"{name} of the record, {long_name}"}
            variables[variable_name(f"{path}.{name}")] = ((samples,), np.array(table[name]), attrs)
    return variables


def _variable(name: str, value: Any, key: Key) -> tuple[tuple[str, ...], np.ndarray, dict[str, str]]:
    """Make dimensions, values and attributes of the variable of a key."""
    attrs = {"long_name": key.long_name} | ({"units": key.units} if key.units else {})
    array = np.asarray(value)
    if array.ndim == 0:
        return (), array, attrs
    dims = ("coordinate",) if key.check is point else (f"{name}_item",)
    return (dims if array.ndim == 1 else (f"{name}_point", "coordinate")), array.astype(float), attrs
