"""Complete a scene Dataset by keys that it lacks, for ensembles in which these vary."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES
from cablepod.errors import SceneError
from cablepod.parameters._key_paths import key_at, kind_in, variable_name
from cablepod.parameters._keys import STIFFNESS_KEYS, TABLES, TURBULENCE, WIND, Key, check_damping, check_table
from cablepod.parameters._mast_keys import SHARED_TABLES
from cablepod.scene._check import check_cable, check_chain, check_time
from cablepod.scene._files import read_record
from cablepod.scene._make import Variables, _variable
from cablepod.scene._mast import DAMPING_OF_CABLES, LISTS_OF_LINKS, MAST_TABLES
from cablepod.scene._ranges import KEYS_OF_WORDS
from cablepod.scene._wind import check_wind


def completed(scene: xr.Dataset, lacking: Mapping[str, Any], varied: Iterable[str]) -> xr.Dataset:
    """Return a scene with the keys at some paths that it lacks, and with the defaults of tables that it lacks.

    Parameters
    ----------
    scene
        One scene.
    lacking
        Key path that the scene lacks -> value.
    varied
        All key paths that vary.

    Raises
    ------
    SceneError
        For tables that lack required keys, and for values that are not allowed together.
    """
    for path, value in lacking.items():
        scene = scene.assign(variables_at(scene, path, [value], of_members=False))
    for table in dict.fromkeys(path.rpartition(".")[0] for path in lacking):
        for path, value in checked_table(scene, table, varied).items():
            if variable_name(path) not in scene:
                scene = scene.assign(variables_at(scene, path, [value], of_members=False))
    return scene


def may_have(scene: xr.Dataset, path: str) -> bool:
    """Tell whether a scene of its kind, of one cable or of a mast, may have the key at a path."""
    table, _, name = path.rpartition(".")
    if "mast_height" not in scene:
        return table.partition(".")[0] not in MAST_TABLES
    is_shared = table in ("", *SHARED_TABLES) and name not in (*DAMPING_OF_CABLES, *LISTS_OF_LINKS)
    return is_shared or table.partition(".")[0] in MAST_TABLES


def key_in(scene: xr.Dataset, path: str) -> Key:
    """Return the key at a path of a scene that has it."""
    key = key_at(path.split("."), lambda above: kind_in(scene, above))
    assert key is not None  # the ranges were checked
    return key


def variables_at(scene: xr.Dataset, path: str, values: list[Any], *, of_members: bool = True) -> Variables:
    """Make the variables of a key from its values of all members, or from the only one without ``member``.

    A record of a motion or load has instants and values, nan after the last of shorter ones.
    """
    name, key = variable_name(path), key_in(scene, path)
    made = [_variable(name, value, key) for value in values]
    dims, _, attrs = made[0]
    array = np.stack([array for _, array, _ in made])
    if array.dtype.kind == "U":
        array = np.array(values, dtype=str)
    elif dims == () and key.is_whole and np.all(array == np.round(array)):
        array = array.astype(np.int64)
    result: Variables = {name: (dims, array[0], attrs)}
    if of_members:
        result = {name: (("member", *dims), array, attrs)}
    if path.endswith(".record"):
        record: list[Any] = [checked_record(value)["record_sha256"] for value in values]
        result |= variables_at(scene, f"{path}_sha256", record, of_members=of_members)
    if path.endswith(".path"):
        result |= _samples(scene, path, values, of_members=of_members)
    return result


def checked_record(path: str) -> Mapping[str, str]:
    """Return path and content hash of a record of wind."""
    from cablepod.scene._wind_field import read_wind_record  # needed by records only

    return read_wind_record(Path(path), None)


def _samples(scene: xr.Dataset, path: str, values: list[Any], *, of_members: bool) -> Variables:
    """Make the variables of the instants and values of records, nan after the last of shorter ones."""
    above = path.rpartition(".")[0]
    records = [read_record(path, Path(value)) for value in values]
    count = max(len(record["time"]) for record in records)
    result: Variables = {}
    for column in ("time", "value"):
        rows = np.full((len(records), count), np.nan)
        for row, record in zip(rows, records, strict=True):
            row[: len(record[column])] = record[column]
        name = variable_name(f"{above}.{column}")
        dims = (variable_name(f"{above}.sample"),)
        attrs: dict[str, str] = dict(scene[name].attrs)
        result[name] = (("member", *dims), rows, attrs) if of_members else (dims, rows[0], attrs)
    return result


def checked_table(scene: xr.Dataset, table: str, varied: Iterable[str]) -> dict[str, Any]:
    """Check the table of a scene; return the values by key path, defaults filled in.

    Keys that go with one word only are left aside where this word is among the key paths `varied`.

    Raises
    ------
    SceneError
        For missing keys, and for values that are not allowed.
    """
    if table in ("wind", "wind.turbulence"):
        return _checked_wind(scene, varied)
    if not table:  # numbers by themselves, checked with the parameters
        return {}
    kind = kind_in(scene, table)
    keys = {
        name.removeprefix(f"{variable_name(table)}_"): None
        for name in map(str, scene.data_vars)
        if name.startswith(f"{variable_name(table)}_")
    }
    found = {name: key_at([*table.split("."), name], lambda _: kind) for name in keys}
    known: dict[str, Key] = {name: key for name, key in found.items() if key is not None}
    known = {**TABLES.get(table, {}), **known}
    values = {name: value_in(scene, f"{table}.{name}") for name in known if has_value(scene, f"{table}.{name}")}
    checked = check_table(table, values, known)
    tree = {table: checked, "gravity": value_in(scene, "gravity")}
    if table == "chain":
        check_chain(tree)
    if table in ("cable", "chain") and "mast_height" not in scene:
        check_cable({name: _table_in(scene, name) for name in ("cable", "chain", "ends", "initial")} | tree)
    if table == "time":
        check_time(tree)
    if table == "damping":
        check_damping(checked)
    if table == "ice":
        for cable in _cables_of(scene):
            if variable_name(f"{cable}.diameter") not in scene:
                raise SceneError(f"{cable}.diameter: missing; allowed: a diameter [m], on which the ice grows")
    return {f"{table}.{name}": value for name, value in checked.items()}


def _table_in(scene: xr.Dataset, table: str) -> dict[str, Any]:
    """Return the values that a scene has of the keys of a table."""
    return {name: value_in(scene, f"{table}.{name}") for name in TABLES[table] if has_value(scene, f"{table}.{name}")}


def _cables_of(scene: xr.Dataset) -> list[str]:
    """Return the key paths of the cables of a scene."""
    if "mast_height" not in scene:
        return ["cable"]
    ways = "|".join(STIFFNESS_KEYS)
    names = [re.fullmatch(rf"cables_(\w+)_({ways})", str(name)) for name in scene.data_vars]
    return [f"cables.{found[1]}" for found in names if found]


def _checked_wind(scene: xr.Dataset, varied: Iterable[str]) -> dict[str, Any]:
    """Check the tables [wind] and [wind.turbulence] of a scene."""
    tables: dict[str, dict[str, Any]] = {"wind": {}, "wind.turbulence": {}}
    for table, keys in (("wind", WIND), ("wind.turbulence", TURBULENCE)):
        for name in keys:
            if name != "record_sha256" and has_value(scene, path := f"{table}.{name}"):
                tables[table][name] = value_in(scene, path)
    for path, (chooser, word) in KEYS_OF_WORDS.items():
        table, _, name = path.rpartition(".")
        of_table = tables[table]
        if chooser in varied and of_table.get(chooser.rpartition(".")[2]) != word and name in of_table:
            key_in(scene, path).check(path, of_table.pop(name))
    has_diameter = "mast_height" in scene or "cable_diameter" in scene  # guys are checked with their parameters
    cable = {"diameter": 1.0} if has_diameter else {}
    given = tables["wind"] | ({"turbulence": tables["wind.turbulence"]} if tables["wind.turbulence"] else {})
    checked = check_wind(given, cable, scene.sizes["coordinate"], Path())
    gusts = checked.pop("turbulence", {})
    return {f"wind.{name}": value for name, value in checked.items()} | {
        f"wind.turbulence.{name}": value for name, value in gusts.items()
    }


def has_value(scene: xr.Dataset, path: str) -> bool:
    """Tell whether a scene has a key, which in a scene of an ensemble may be nan."""
    name = variable_name(path)
    return name in scene and not (scene[name].dtype.kind == "f" and bool(np.isnan(scene[name].values).all()))


def value_in(scene: xr.Dataset, path: str) -> Any:
    """Return the value of a scene Dataset at a key path, as Python holds it."""
    return scene[variable_name(path)].values.tolist()


def check_vector(scene: xr.Dataset, path: str, value: Any) -> None:
    """Refuse a vector with another number of components than the scene has."""
    count = scene.sizes["coordinate"]
    if scene[variable_name(path)].dims == ("coordinate",) and len(value) != count:
        axes = ", ".join(COORDINATES[:count])
        raise SceneError(f"{path}: given {len(value)} numbers; allowed: {count} numbers, for {axes}")
