"""Design of experiments: scenes of an ensemble with parameters varied over ranges."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import taken
from cablepod.conventions import COORDINATES, VARIABLES
from cablepod.errors import SceneError, scene_error, shown
from cablepod.parameters._checks import text
from cablepod.parameters._key_paths import dotted, flat, kind_in, variable_name, variable_of
from cablepod.parameters._keys import ENSEMBLE, join
from cablepod.scene._completed import completed, may_have, variables_at
from cablepod.scene._hertz import ranges_in_radians
from cablepod.scene._make import check_scene
from cablepod.scene._mast import scene_kind
from cablepod.scene._ranges import (
    ALLOWED_PATHS,
    KEYS_OF_WORDS,
    are_choices,
    axis_hint,
    bounds_of,
    check_choices,
    check_values,
    key_of_range,
    points_of_grid,
    shown_value,
    similar_path,
    with_counts_expanded,
)


def design(
    scene: xr.Dataset,
    ranges: Mapping[str, Any] | None = None,
    *,
    members: int | None = None,
    sampling: str | None = None,
    seed: int | None = None,
) -> xr.Dataset:
    """Create the scenes of an ensemble from one scene and parameter ranges.

    Parameters
    ----------
    scene
        One scene; parameters outside `ranges` are the same in all members.
    ranges
        Key path of a number -> [low, high], of a word, list of numbers or record -> its values; the order has no effect.  Keys
        that the scene lacks are made, with the defaults of their tables.  If all ranges are [low, high, count], without
        `sampling`, the members are all combinations of `count` equally spaced values of each, ends included.  For sampling "grid"
        and "list": values.  A path has points or is nested (``{"cable": {"top_tension": [low, high]}}``).  Components of vectors
        are named by their axis (``"ends.upper.x"``), point loads by their number (``"point_load.1.force.y"``).  By default the
        table ``[ensemble]`` of the scene file gives the ranges and all options that are None.
    members
        Number of members; not needed for ranges with a count, and then equal to the product of the counts.
    sampling
        "latin_hypercube" (the default): one member in each of as many equal parts of a range as there are members; "sobol": the
        first points of a scrambled Sobol sequence; "grid": all combinations of equally spaced
        values of each [low, high], ends included, or of lists of more than two values; "list": each range lists the values of all
        members.
    seed
        Seed of the random sampling; 0 by default.

    Returns
    -------
    xarray.Dataset
        The scene with the dimension coordinate ``member``, from 0.  Varied parameters have this dimension; their names are the
        key paths with ``_`` for ``.``.  If a component of a vector is varied, the whole vector has the dimension, and the
        component is an additional coordinate.

    Raises
    ------
    SceneError
        For unknown key paths, reversed ranges, bounds, words and lists that give no valid scene, tables that lack required keys,
        ranges with a count beside others without, a missing number of members, or one that does not fit the grid.
    """
    scene = taken("scene", scene, scene_kind(scene))
    if "member" in scene.dims:
        raise SceneError("scene: given no Dataset of one scene; allowed: a result of make_scene or read_scene")
    options: dict[str, Any] = {"members": members, "sampling": sampling, "seed": seed}
    prefix = "ranges"
    if ranges is None:
        if "ensemble_json" not in scene.attrs:
            raise SceneError("ranges: given none, and the scene has no table [ensemble]; allowed: one of them")
        table = json.loads(scene.attrs["ensemble_json"])
        ranges, prefix = table["ranges"], "ensemble.ranges"
        options |= {name: table[name] for name, value in options.items() if value is None}
    else:
        if isinstance(ranges, Mapping):
            ranges = ranges_in_radians(ranges, sampling, lambda path: variable_of(scene, path) is not None)
        ranges, options = with_counts_expanded(ranges, options)
    options = {
        name: key.default if options[name] is None else key.check(name, options[name]) for name, key in ENSEMBLE.items()
    }
    if options["members"] is None:
        counts = "ranges [low, high, count] without sampling, which give it"
        raise SceneError(f"members: missing; allowed: a whole number of at least 1, or {counts}")
    whole, checked = _check_ranges(scene, ranges, prefix, options)
    scenes = _vary(whole, _sample(checked, **options), checked)
    scenes.attrs = {name: value for name, value in scene.attrs.items() if name != "ensemble_json"}
    scenes.attrs |= {"title": f"{scene.attrs.get('title', 'scene')}: {options['members']} members"}
    record = {**options, "ranges": checked}
    return provenance.record(scenes, function="ensemble.design", parameters=record, inputs=[scene])


def _check_ranges(
    scene: xr.Dataset, ranges: Any, prefix: str, options: Mapping[str, Any]
) -> tuple[xr.Dataset, dict[str, list[Any]]]:
    """Check all values and the scenes at the bounds; return the completed scene, and the ranges sorted by key path."""
    ranges = flat(ranges)
    if not isinstance(ranges, Mapping) or not ranges:
        raise scene_error(prefix, ranges, "a mapping from key paths to [low, high]")
    checked: dict[str, list[Any]] = {}
    for path, values in ranges.items():
        checked[path] = _checked_values(scene, join(prefix, path), path, values, options)
    scene = _completed(scene, checked, prefix)
    for path in checked:
        _check_bounds(scene, join(prefix, path), path, checked, ranges, options)
    if options["sampling"] == "grid":
        points_of_grid(checked, options["members"], key="members")
    return scene, dict(sorted(checked.items()))  # the result does not depend on the order of the ranges


def _checked_values(scene: xr.Dataset, key: str, path: Any, values: Any, options: Mapping[str, Any]) -> list[Any]:
    """Check the values of a range by themselves."""
    sampling = {"members": options["members"], "sampling": options["sampling"]}
    if variable_of(scene, path) is not None:
        return check_values(key, values, **sampling)
    of = key_of_range(path, values, partial(kind_in, scene), partial(_has_table, scene))
    if of is None:
        is_vector = variable_of(scene, f"{path}.x") is not None
        similar = axis_hint(is_vector, path) or similar_path(path, (dotted(str(name)) for name in scene.data_vars))
        raise SceneError(f"{key}: unknown key path; allowed: {ALLOWED_PATHS}{similar}")
    if not may_have(scene, path):
        raise scene_error(
            key, values, f"no such key in a scene of {'a mast' if 'mast_height' in scene else 'one cable'}"
        )
    if of.is_number:
        return check_values(key, values, **sampling)
    chosen = check_choices(key, values, of, **sampling)
    if of.check is text:
        return [str(Path(value).absolute()) for value in chosen]
    for value in chosen:
        variables_at(scene, path, [value])  # refuses vectors of another number of components
    return chosen


def _has_table(scene: xr.Dataset, path: str) -> bool:
    """Tell whether a scene has a table."""
    return any(str(name).startswith(f"{variable_name(path)}_") for name in scene.data_vars)


def _completed(scene: xr.Dataset, checked: Mapping[str, list[Any]], prefix: str) -> xr.Dataset:
    """Return the scene with the keys that ranges give and it lacks, at their first values."""
    lacking = {
        path: values[0]
        for path, values in checked.items()
        if variable_of(scene, path) is None and variable_name(path) not in scene
    }
    try:
        return completed(scene, lacking)
    except SceneError as error:
        raise SceneError(f"{prefix}: given {', '.join(lacking)}, which make no scene: {error}") from None


def _check_bounds(
    scene: xr.Dataset, key: str, path: str, checked: Mapping[str, list[Any]], ranges: Mapping[str, Any],
    options: Mapping[str, Any],
) -> None:  # fmt: skip
    """Check the scenes at the bounds of a range, or with each of its texts and lists; of a list of members, these members."""
    values, target = checked[path], variable_of(scene, path)
    is_whole = target is not None and scene[target[0]].dtype.kind == "i"
    listed = options["sampling"] == "list" or (options["sampling"] == "grid" and len(values) > 2)
    if is_whole and not (listed and all(value.is_integer() for value in values)):
        raise scene_error(key, ranges[path], 'a list of whole numbers, by sampling "list" or "grid"')
    for value in bounds_of(values):
        try:
            if target is not None and target[1] is None:
                target[2].check(path, int(value) if is_whole and value.is_integer() else value)
            row = {path: value}
            if options["sampling"] == "list":
                row = {other: given[values.index(value)] for other, given in checked.items()}
            columns = {
                name: [entry] if are_choices(checked[name]) else np.array([entry]) for name, entry in row.items()
            }
            varied = _vary(scene, columns, ranges).isel(member=0, drop=True)
            check_scene(varied)
        except SceneError as error:
            raise SceneError(f"{key}: given {shown(values)}, at {shown_value(value)} no scene: {error}") from None


def _sample(checked: Mapping[str, list[Any]], *, members: int, sampling: str, seed: int) -> dict[str, Any]:
    """Return the values of all members by key path: arrays of numbers, lists of texts and lists."""
    ranges = {  # of texts and lists their numbers from 0
        path: list(range(len(values))) if are_choices(values) else values for path, values in checked.items()
    }
    points = _points(checked, ranges, members=members, sampling=sampling, seed=seed)
    columns = dict(zip(ranges, np.ascontiguousarray(points.T), strict=True))
    return {
        path: [checked[path][int(k)] for k in column] if are_choices(checked[path]) else column
        for path, column in columns.items()
    }


def _points(
    checked: Mapping[str, list[Any]], ranges: Mapping[str, list[Any]], *, members: int, sampling: str, seed: int
) -> np.ndarray:
    """Return the values of all members (member, range), numbers in place of texts and lists."""
    if sampling == "list":
        return np.array(list(ranges.values())).T
    if sampling == "grid":
        count = points_of_grid(checked, members)
        axes = [
            values if len(values) > 2 or are_choices(checked[path]) else np.linspace(values[0], values[1], count)
            for path, values in ranges.items()
        ]
        return np.array(list(itertools.product(*axes)))
    from scipy.stats import qmc  # takes half a second to import

    sampler = (qmc.Sobol if sampling == "sobol" else qmc.LatinHypercube)(len(ranges), seed=np.random.default_rng(seed))
    # Sobol: the same points as random(members), without its warning on numbers that are no power of two
    power = (members - 1).bit_length()
    unit = sampler.random_base2(power)[:members] if sampling == "sobol" else sampler.random(members)
    low, high = np.array([(values[0], values[1]) for values in ranges.values()]).T
    points = low + (high - low) * unit
    for k, (path, values) in enumerate(ranges.items()):
        if are_choices(checked[path]):  # equal parts of 0 to 1
            points[:, k] = np.floor(unit[:, k] * len(values))
    return points


def _vary(scene: xr.Dataset, varied: Mapping[str, Any], ranges: Iterable[str]) -> xr.Dataset:
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
        assert target is not None  # _check_ranges refuses unknown key paths
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
