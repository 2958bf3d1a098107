"""Make a scene Dataset from nested tables, with all checks of user input.

The variables of a scene are the keys of the scene file with ``_`` for ``.``: ``cable.area`` is the variable ``cable_area`` [m2].
An absent key is an absent variable.  ``parameters`` makes the numbers with which the models compute.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._resources import check_memory
from cablepod.conventions import COORDINATES, label, shared_coordinates
from cablepod.errors import SceneError, shown
from cablepod.parameters._checks import direction, point
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._key_paths import (
    key_at,
    listed_path,
    motion_path,
    nested,
    number_at,
    replaced,
    value_at,
    variable_name,
)
from cablepod.parameters._keys import LISTED, TABLES, TOP, Key, time_function_keys
from cablepod.parameters._mast import mast_parameters
from cablepod.parameters._mast_keys import GUY, GUY_CABLE, GUY_LISTED, MAST, MAST_LOAD, MAST_SECTION, SHARED_TABLES
from cablepod.parameters._parameters import Parameters, count_instants
from cablepod.scene._check import check_mapping
from cablepod.scene._hertz import OMEGA, in_radians
from cablepod.scene._limits import check_limits
from cablepod.scene._mast import check_mast, check_mast_numbers, is_mast
from cablepod.scene._mast_field import check_mast_record
from cablepod.scene._notes import hint
from cablepod.scene._ranges import are_choices, bounds_of, shown_value, without_unused


def make_scene(mapping: Mapping[str, Any]) -> xr.Dataset:
    """Make a scene from nested Python values with the keys of the scene file.

    Parameters
    ----------
    mapping
        Tables as mappings, vectors as sequences, SI units.  Not modified.  A key may also be given by its path with points:
        ``{"cable.area": 1.25e-4}``.

        Motions and load factors, by `kind`: "one_minus_cosine", amplitude (1 - cos(angular_frequency t)); "harmonic", amplitude
        (sin(angular_frequency t + phase) - sin(phase)); "ramp", amplitude s^3 (10 - 15 s + 6 s^2) with s = t / duration, then
        amplitude; "polynomial", c1 t + c2 t^2 + ... with coefficients [c1, c2, ...]; "file", a spline through a record, minus
        its value at t = 0 for a motion.  The first two take `frequency` [Hz] in place of `angular_frequency` [rad/s].  All but
        "ramp" may have `ramp` [s], which multiplies the change since t = 0 by the same step of that duration.

    Returns
    -------
    xarray.Dataset
        A variable with units for each key, its name the key path with ``_`` for ``.``.

    Raises
    ------
    SceneError
        For unknown and missing keys, two ways to give the length, types, signs and magnitudes that are not allowed, a
        tension below the minimum, and output larger than the memory.  The message names the key, the given value and the
        allowed ones, and the key that was likely given in another unit.

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
    if p.wind is not None:
        from cablepod.scene._wind_field import check_above_ground, check_wind_record  # needed by wind only

        check_above_ground(p)
        check_wind_record(p)
    instants = 1 if p.duration is None or p.interval is None else count_instants(p.duration, p.interval)
    check_memory(instants, p.links or 1, p.dims, key="chain.links and time.interval")


def check_scene_numbers(scene: xr.Dataset) -> None:
    """Check the numbers of a scene Dataset together, of a cable or of a mast.

    Raises
    ------
    SceneError
        As :func:`check_numbers`.
    """
    if "mast_height" in scene:
        check_mast_numbers(mast_parameters(scene))
        check_mast_record(mast_parameters(scene))
    else:
        check_numbers(parameters(scene))


def _make(mapping: Mapping[str, Any], folder: Path) -> xr.Dataset:
    """Make a scene; paths of records are relative to `folder`."""
    if not isinstance(mapping, Mapping):
        return _of_tables(mapping, folder)
    tables = nested(mapping)
    given = in_radians(tables)
    try:
        return _of_tables(given, folder)
    except SceneError as error:
        if given is not tables and OMEGA in str(error):
            error.args = (f"{error} ({OMEGA} is 2 pi times the frequency given)",)
        raise


def _of_tables(mapping: Mapping[str, Any], folder: Path) -> xr.Dataset:
    """Make a scene from nested tables with angular frequencies."""
    is_of_mast = is_mast(mapping)
    tree = check_mast(mapping, folder) if is_of_mast else check_mapping(mapping, folder)
    scene = _mast_to_dataset(tree) if is_of_mast else _to_dataset(tree)
    scene.attrs["title"] = tree.get("title", "untitled scene")
    scene.attrs["stage"] = "scene"
    if "ensemble" in tree:
        scene.attrs["ensemble_json"] = provenance.Abridged(json.dumps(tree["ensemble"], sort_keys=True))
    identity = {"scene": _without_places(tree)}
    provenance.record(scene, function="make_scene", parameters={"scene": tree}, identity=identity)
    if is_of_mast:
        check_scene_numbers(scene)
        if "ensemble" in tree:
            _check_bounds(mapping, tree, folder)
        return scene
    p = parameters(scene)
    try:
        check_numbers(p)
    except SceneError as error:
        error.args = (f"{error}{hint(p)}",)
        raise
    if "ensemble" in tree:
        _check_bounds(mapping, tree, folder)
    return scene


def _without_places(tree: dict[str, Any]) -> dict[str, Any]:
    """Return a checked scene without the places of files whose content identifies it: records of wind, tables of strands."""
    tables = {"cable": tree["cable"]} if "cable" in tree else tree["cables"]
    if any("strand_table" in cable for cable in tables.values()):
        of = {
            name: {key: value for key, value in cable.items() if key != "strand_table"}
            for name, cable in tables.items()
        }
        tree = {**tree, **(of if "cable" in tree else {"cables": of})}
    turbulence = tree.get("wind", {}).get("turbulence", {})
    if "record" not in turbulence:
        return tree
    kept = {name: value for name, value in turbulence.items() if name != "record"}
    return {**tree, "wind": {**tree["wind"], "turbulence": kept}}


def _check_bounds(mapping: Mapping[str, Any], tree: Mapping[str, Any], folder: Path) -> None:
    """Refuse a range of an ensemble if the scene at one of its bounds is refused; `tree` is the checked scene."""
    single: Any = {name: table for name, table in mapping.items() if name != "ensemble"}
    has_values, ranges = tree["ensemble"]["sampling"] in ("grid", "list"), tree["ensemble"]["ranges"]

    def is_whole(path: str) -> bool:
        key = key_at(path.split("."), lambda above: value_at(tree, f"{above}.kind"))
        is_int = isinstance(number_at(tree, path), int) or (key is not None and key.is_whole)
        return has_values and is_int and all(map(float.is_integer, ranges[path]))

    for path, values in ranges.items():
        if value_at(tree, path) is None:
            single = replaced(single, path, int(values[0]) if not are_choices(values) and is_whole(path) else values[0])
    for path, values in ranges.items():
        for bound in bounds_of(values):
            value = int(bound) if not are_choices(values) and is_whole(path) else bound
            try:
                _make(without_unused(replaced(single, path, value), ranges), folder)
            except SceneError as error:
                raise SceneError(
                    f"ensemble.ranges.{path}: given {shown(values)}, at {shown_value(bound)} no scene: {error}"
                ) from None


# --- Dataset --------------------------------------------------------------------------------------------------------


Variables = dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]


def _to_dataset(tree: dict[str, Any]) -> xr.Dataset:
    """Make the variables of a checked scene."""
    variables = _top_variables(tree)
    for table, keys in TABLES.items():
        values = tree.get("wind", {}).get("turbulence", {}) if table == "wind.turbulence" else tree.get(table, {})
        variables |= _table_variables(table, values, {name: keys[name] for name in values if name in keys})
    variables |= _time_function_variables("load", tree.get("load", {}), "1", "factor of the uniform load")
    for end, axes in tree.get("motion", {}).items():
        for axis, function in axes.items():
            long_name = f"displacement of the {end} end along {axis}"
            variables |= _time_function_variables(motion_path(end, axis), function, "m", long_name)
    for name, keys in LISTED.items():
        for number, table in enumerate(tree.get(name, []), start=1):
            path = listed_path(name, number)
            variables |= _table_variables(path, table, {key: keys[key] for key in keys if key in table})
            variables |= _time_function_variables(path, table, "1", f"factor of point load {number}")
    dims = len(tree["ends"]["lower"])
    scene = xr.Dataset(variables, coords=shared_coordinates({"coordinate": list(COORDINATES[:dims])}))
    label(scene[["coordinate"]])
    return scene


def _mast_to_dataset(tree: dict[str, Any]) -> xr.Dataset:
    """Make the variables of a checked scene with a mast."""
    variables = _top_variables(tree)

    def add(path: str, values: Mapping[str, Any], keys: Mapping[str, Key]) -> None:
        variables.update(_table_variables(path, values, {name: keys[name] for name in keys if name in values}))

    add("mast", tree["mast"], MAST)
    for number, section in enumerate(tree["mast"].get("section", []), start=1):
        add(f"mast.section.{number}", section, MAST_SECTION)
    for number, load in enumerate(tree["mast"].get("load", []), start=1):
        add(f"mast.load.{number}", load, MAST_LOAD)
        variables.update(_time_function_variables(f"mast.load.{number}", load, "1", f"factor of mast load {number}"))
    for name, cable in tree["cables"].items():
        add(f"cables.{name}", cable, GUY_CABLE)
        for of_list, keys in GUY_LISTED.items():
            for number, part in enumerate(cable.get(of_list, []), start=1):
                add(listed_path(f"cables.{name}.{of_list}", number), part, keys)
    for number, guy in enumerate(tree["guy"], start=1):
        add(f"guy.{number}", guy, GUY)
    for table in SHARED_TABLES:
        values = tree.get("wind", {}).get("turbulence", {}) if table == "wind.turbulence" else tree.get(table, {})
        add(table, values, TABLES[table])
    scene = xr.Dataset(variables, coords=shared_coordinates({"coordinate": list(COORDINATES)}))
    label(scene[["coordinate"]])
    return scene


def _top_variables(tree: Mapping[str, Any]) -> Variables:
    """Make the variables of the numbers that stand in no table."""
    return {name: _variable(name, tree[name], key) for name, key in TOP.items() if name in tree and key.is_number}


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
    keys = {
        name: Key(key.check, key.units, f"{key.long_name}, {long_name}") for name, key in keys.items() if name in table
    }
    variables |= _table_variables(path, table, keys)
    if table["kind"] == "file":
        samples = variable_name(f"{path}.sample")
        for name, unit in (("time", "s"), ("value", units)):
            attrs = {"units": unit, "long_name": f"{name} of the record, {long_name}"}
            variables[variable_name(f"{path}.{name}")] = ((samples,), np.array(table[name]), attrs)
    return variables


def _variable(name: str, value: Any, key: Key) -> tuple[tuple[str, ...], np.ndarray, dict[str, str]]:
    """Make dimensions, values and attributes of the variable of a key."""
    attrs = {"long_name": key.long_name} | ({"units": key.units} if key.units and not isinstance(value, str) else {})
    array = np.asarray(value)
    if array.ndim == 0:
        return (), array, attrs
    dims = ("coordinate",) if key.check in (point, direction) else (f"{name}_item",)
    return (dims if array.ndim == 1 else (f"{name}_point", "coordinate")), array.astype(float), attrs
