"""Check the ranges of an ensemble against the Dataset of its scene: key paths, values, and the scenes at the bounds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES
from cablepod.errors import SceneError, did_you_mean, scene_error, shown
from cablepod.parameters._checks import point, text
from cablepod.parameters._key_paths import dotted, flat, key_in, variable_name, variable_of
from cablepod.parameters._keys import LISTED, TABLES, Key, join
from cablepod.scene._numbers import check_scene
from cablepod.scene._ranges import (
    HERE,
    are_choices,
    bounds_of,
    check_choices,
    check_values,
    points_of_grid,
    shown_value,
)
from cablepod.scene._varied import completed, may_have, variables_at, vary

#: Key paths that ranges may have, for messages.
ALLOWED_PATHS = "the path of a number or of a word of a scene, or of a list of numbers with lists of them"
#: Texts that may vary beside words: files of records.
RECORDS = ("path", "record")
#: Tables that a range makes with the keys of other ranges and defaults; those with a number or a kind must be there.
LISTED_TABLES = ("motion", *LISTED, "guy", "cables", "mast")


def checked_ranges(
    scene: xr.Dataset, ranges: Any, prefix: str, options: Mapping[str, Any], *, members_key: str, folder: Path = HERE
) -> tuple[xr.Dataset, dict[str, list[Any]]]:
    """Check the ranges of an ensemble and the scenes at their bounds.

    Parameters
    ----------
    scene
        One scene.
    ranges
        Key path -> values, in any form.
    prefix, members_key
        Key paths of the ranges and of the number of members, for messages.
    options
        Checked options of the ensemble.
    folder
        Folder of the paths of records.

    Returns
    -------
    tuple
        The scene with the keys that the ranges give and it lacks, and the checked values by key path.

    Raises
    ------
    SceneError
        For an empty table, unknown key paths, values that are not allowed, bounds without a scene, and a grid of another number
        of members.
    """
    ranges = flat(ranges)
    if not isinstance(ranges, Mapping) or not ranges:
        raise scene_error(prefix, ranges, "a mapping from key paths to [low, high]")
    checked = {
        path: _checked_values(scene, join(prefix, path), path, values, options, folder)
        for path, values in ranges.items()
    }
    if options["sampling"] == "grid":
        points_of_grid(checked, options["members"], key=members_key)
    lacking = {
        path: values[0]
        for path, values in checked.items()
        if variable_of(scene, path) is None and variable_name(path) not in scene
    }
    try:
        scene = completed(scene, lacking)
    except SceneError as error:
        raise SceneError(f"{prefix}: given {', '.join(lacking)}, which make no scene: {error}") from None
    for path in checked:
        _check_bounds(scene, prefix, path, checked, ranges, options)
    return scene, checked


def _checked_values(
    scene: xr.Dataset, key: str, path: Any, values: Any, options: Mapping[str, Any], folder: Path
) -> list[Any]:
    """Check the values of a range by themselves."""
    sampling = {"members": options["members"], "sampling": options["sampling"]}
    if variable_of(scene, path) is not None:
        return check_values(key, values, **sampling)
    of = _key_of_range(scene, path, values)
    if of is None:
        is_vector = variable_of(scene, f"{path}.x") is not None
        similar = f"; try: {path}.x or {path}.y" if is_vector else _similar_path(scene, path)
        raise SceneError(f"{key}: unknown key path; allowed: {ALLOWED_PATHS}{similar}")
    if not may_have(scene, path):
        raise scene_error(
            key, values, f"no such key in a scene of {'a mast' if 'mast_height' in scene else 'one cable'}"
        )
    if of.is_number:
        return check_values(key, values, **sampling)
    chosen = check_choices(key, values, of, **sampling)
    if of.check is text:
        return [str((folder / value).absolute()) for value in chosen]
    for value in chosen:
        with _at(key, values, value):
            variables_at(scene, path, [value])  # refuses vectors of another number of components
    return chosen


def _key_of_range(scene: xr.Dataset, path: Any, values: Any) -> Key | None:
    """Return the key that a range may vary beside the numbers of a scene; None for all other paths.

    These are numbers that the scene lacks, words, lists of numbers, and files of records.
    """
    if not isinstance(path, str):
        return None
    above, _, name = path.rpartition(".")
    has_table = any(str(variable).startswith(f"{variable_name(above)}_") for variable in scene.data_vars)
    if above.partition(".")[0] in LISTED_TABLES and not has_table:
        return None
    of = key_in(scene, path)
    if of is None or of.is_truth or (of.check is text and name not in RECORDS):
        return None
    return None if of.check is point and not are_choices(values) else of


def _similar_path(scene: xr.Dataset, path: Any) -> str:
    """Return the remedy for an unknown key path: that of a variable, one like it of the scene or of its tables; else empty."""
    if (meant := dotted(path)) != path:
        return f"; try: {meant}"
    of_tables = (f"{table}.{key}" for table, keys in TABLES.items() for key in keys)
    return did_you_mean(path, list(dict.fromkeys([*_paths_in(scene), *of_tables])))


def _paths_in(scene: xr.Dataset) -> Iterator[str]:
    """Yield the key paths of the numbers of a scene."""
    for name, variable in scene.data_vars.items():
        axes = COORDINATES[: variable.size] if variable.dims == ("coordinate",) else ()
        yield from (f"{dotted(str(name))}.{axis}" for axis in axes)
        if not axes and variable.dtype.kind in "if":
            yield dotted(str(name))


def _check_bounds(
    scene: xr.Dataset, prefix: str, path: str, checked: Mapping[str, list[Any]], ranges: Mapping[str, Any],
    options: Mapping[str, Any],
) -> None:  # fmt: skip
    """Check the scenes at the bounds of a range, or with each of its texts and lists; of a list of members, these members."""
    key, values, target = join(prefix, path), checked[path], variable_of(scene, path)
    is_whole = target is not None and scene[target[0]].dtype.kind == "i"
    listed = options["sampling"] == "list" or (options["sampling"] == "grid" and len(values) > 2)
    if is_whole and not (listed and all(value.is_integer() for value in values)):
        raise scene_error(key, ranges[path], 'a list of whole numbers, by sampling "list" or "grid"')
    for value in bounds_of(values):
        row = {path: value}
        if options["sampling"] == "list":
            row |= {other: given[values.index(value)] for other, given in checked.items()}
        with _at_row(prefix, checked, row):
            if target is not None and target[1] is None:
                target[2].check(path, int(value) if is_whole and value.is_integer() else value)
            columns = {
                name: [entry] if are_choices(checked[name]) else np.array([entry]) for name, entry in row.items()
            }
            varied = vary(scene, columns, ranges).isel(member=0, drop=True)
            check_scene(varied)


@contextmanager
def _at_row(prefix: str, checked: Mapping[str, list[Any]], row: Mapping[str, Any]) -> Iterator[None]:
    """Say in the error of a scene which range makes it, by the key that the error names; all values of a member otherwise."""
    try:
        yield
    except SceneError as error:
        key = str(error).partition(":")[0].partition("[")[0]
        named = [path for path in row if f"{path}.".startswith(f"{key}.")]
        if not named and len(row) > 1:
            together = ", ".join(f"{path} {shown_value(value)}" for path, value in row.items())
            raise SceneError(f"{prefix}: given a member with {together}, which make no scene: {error}") from None
        path = (named or [*row])[0]
        with _at(join(prefix, path), checked[path], row[path]):
            raise


@contextmanager
def _at(key: str, values: list[Any], value: Any) -> Iterator[None]:
    """Say in the error of a scene with which value of a range it is made."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{key}: given {shown(values)}, at {shown_value(value)} no scene: {error}") from None
