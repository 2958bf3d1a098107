"""A scene Dataset with more keys than it has, and with keys that vary along ``member``, for ensembles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES, VARIABLES
from cablepod.parameters._check_tables import filled
from cablepod.parameters._key_paths import key_in, variable_name, variable_of
from cablepod.parameters._particles import number_of_links
from cablepod.parameters._tables import OF_CABLE, OF_MAST, table_of
from cablepod.scene._dataset import Variables, variable
from cablepod.scene._files import read_record

#: Keys that go with one word of another key; members of an ensemble with another word lack them.
KEYS_OF_WORDS = {
    "wind.exponent": ("wind.profile", "power"),
    "wind.turbulence.intensity": ("wind.turbulence.spectrum", "von_karman"),
    "wind.turbulence.length_scale": ("wind.turbulence.spectrum", "von_karman"),
}


def completed(scene: xr.Dataset, lacking: Mapping[str, Any]) -> xr.Dataset:
    """Return a scene with the keys at some paths that it lacks, and with the defaults of the tables of these.

    Parameters
    ----------
    scene
        One scene.
    lacking
        Key path that the scene lacks -> value.

    Raises
    ------
    SceneError
        For tables that lack required keys.
    """
    for path, value in lacking.items():
        scene = scene.assign(variables_at(scene, path, [value], of_members=False))
    for above in dict.fromkeys(path.rpartition(".")[0] for path in lacking):
        table = table_of(tuple(above.split("."))) if above else None
        if table is None or variable_name(f"{above}.record") in scene:  # with a record there are no defaults
            continue
        names = {name: variable_name(f"{above}.{name}") for name in table.keys}
        given = {name: scene[of_key].values for name, of_key in names.items() if of_key in scene}
        whole = filled(above, given, table.keys)
        if above == "chain":
            whole.setdefault("links", number_of_links(given))
        for name in whole.keys() - given.keys():
            scene = scene.assign(variables_at(scene, f"{above}.{name}", [whole[name]], of_members=False))
    return scene


def may_have(scene: xr.Dataset, path: str) -> bool:
    """Tell whether a scene of its kind, of one cable or of a mast, may have the key at a path."""
    table = table_of(tuple(path.split(".")[:-1]))
    return table is not None and (OF_MAST if "mast_height" in scene else OF_CABLE) in table.of


def variables_at(scene: xr.Dataset, path: str, values: list[Any], *, of_members: bool = True) -> Variables:
    """Make the variables of a key from its values of all members, or from the only one without ``member``.

    A record of a motion or load has instants and values, nan after the last of shorter ones.
    """
    name, key = variable_name(path), key_in(scene, path)
    assert key is not None  # the ranges were checked
    made = [variable(path, value, key, COORDINATES[: scene.sizes["coordinate"]]) for value in values]
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
        from cablepod.scene._wind_field import read_wind_record  # needed by records only

        record: list[Any] = [read_wind_record(Path(value), None)["record_sha256"] for value in values]
        result |= variables_at(scene, f"{path}_sha256", record, of_members=of_members)
    if path.endswith(".path"):
        result |= _samples(scene, path, values, of_members=of_members)
    return result


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


def vary(scene: xr.Dataset, varied: Mapping[str, Any], ranges: Iterable[str]) -> xr.Dataset:
    """Return the scene with the values of each key path along ``member``.

    Keys that go with one word only are nan in members with another one, where the key path of the word is among `ranges`.
    """
    count = len(next(iter(varied.values())))
    units, long_name = VARIABLES["member"]
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {"member": ("member", np.arange(count), {"units": units, "long_name": long_name})}
    for path, values in varied.items():
        if isinstance(values, list):
            made = variables_at(scene, path, values)
            variables |= made
            dims, vectors, vector_attrs = made[variable_name(path)]
            if dims == ("member", "coordinate"):
                for number, axis in enumerate(COORDINATES[: vectors.shape[1]]):
                    component_attrs = {**vector_attrs, "long_name": f"{vector_attrs['long_name']}, {axis}"}
                    coords[variable_name(f"{path}.{axis}")] = ("member", vectors[:, number], component_attrs)
            continue
        target = variable_of(scene, path)
        assert target is not None  # the ranges were checked
        name, index, _ = target
        attrs = scene[name].attrs
        if index is None:
            variables[name] = ("member", values.astype(scene[name].dtype), attrs)
            continue
        if name not in variables:
            variables[name] = (("member", "coordinate"), np.repeat(scene[name].values[None], count, axis=0), attrs)
        variables[name][1][:, index] = values
        component_attrs = {**attrs, "long_name": f"{attrs.get('long_name', name)}, {COORDINATES[index]}"}
        coords[variable_name(path)] = ("member", values, component_attrs)
    scenes = scene.drop_vars([name for name in variables if name in scene]).assign(variables).assign_coords(coords)
    for path, (chooser, word) in KEYS_OF_WORDS.items():
        name = variable_name(path)
        if chooser in ranges and name in scenes:
            used = np.broadcast_to(scenes[variable_name(chooser)].values == word, count)
            values = np.where(used, scenes[name].values, np.nan)
            scenes[name] = ("member", values, scenes[name].attrs)
    return scenes
