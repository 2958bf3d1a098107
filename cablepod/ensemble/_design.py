"""Scenes of an ensemble: one scene, and what differs between its members."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.conventions import COORDINATES, VARIABLES
from cablepod.errors import SceneError, scene_error, shown
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._key_paths import variable_name, variable_of
from cablepod.parameters._keys import ENSEMBLE, join
from cablepod.scene._make import check_numbers
from cablepod.scene._ranges import check_values, points_of_grid


def design(
    scene: xr.Dataset,
    ranges: Mapping[str, Any] | None = None,
    *,
    members: int | None = None,
    sampling: str | None = None,
    seed: int | None = None,
) -> xr.Dataset:
    """Make the scenes of an ensemble.

    Parameters
    ----------
    scene
        One scene; all that `ranges` does not name is the same in all members.
    ranges
        From key paths of numbers, in any order, to [low, high], or to values where `sampling` says so.  Components of vectors are
        named by their axis (``"ends.upper.x"``), point loads by their number (``"point_load.1.force.y"``).  Left out, the table
        ``[ensemble]`` of the scene file gives this and all options that are left out too.
    members
        Number of members.
    sampling
        "latin_hypercube" (the default): each range is cut into as many equal parts as there are members, and each part has one;
        "sobol": points of the scrambled Sobol sequence, the first of a power of two; "grid": every combination, of equally many
        equally spaced values of each [low, high], ends included, or of more than two given values; "list": each range gives as
        many values as there are members.
    seed
        Of the sampling; 0 by default.

    Returns
    -------
    xarray.Dataset
        The scene with the dimension coordinate ``member``, from 0; what varies lies along it under its key path with ``_`` for
        ``.``.  A varied component of a vector makes the vector vary, and is a coordinate beside it.

    Raises
    ------
    SceneError
        For unknown key paths, reversed ranges, values at whose bounds there is no scene, a grid of another number of members, no
        members; the message names the key, what was given and what is allowed.
    """
    if not isinstance(scene, xr.Dataset) or "ends_lower" not in scene or "member" in scene.dims:
        raise SceneError("scene: given no Dataset of one scene; allowed: what make_scene or read_scene gives")
    options: dict[str, Any] = {"members": members, "sampling": sampling, "seed": seed}
    prefix = "ranges"
    if ranges is None:
        if "ensemble_json" not in scene.attrs:
            raise SceneError("ranges: given none, and the scene has no table [ensemble]; allowed: one of them")
        table = json.loads(scene.attrs["ensemble_json"])
        ranges, prefix = table["ranges"], "ensemble.ranges"
        options |= {name: table[name] for name, value in options.items() if value is None}
    options = {
        name: key.default if options[name] is None else key.check(name, options[name]) for name, key in ENSEMBLE.items()
    }
    if options["members"] is None:
        raise SceneError("members: missing; allowed: a whole number of at least 1")
    checked = _checked(scene, ranges, prefix, options)
    points = _points(checked, **options)
    scenes = _joined(scene, dict(zip(checked, points.T, strict=True)))
    scenes.attrs = {
        name: value for name, value in scene.attrs.items() if name not in ("values_sha256", "ensemble_json")
    }
    scenes.attrs |= {"title": f"{scene.attrs.get('title', 'scene')}: {options['members']} members"}
    record = {**options, "ranges": checked}
    return provenance.stamp_values(
        provenance.record(scenes, function="ensemble.design", parameters=record, inputs=[scene])
    )


def _checked(scene: xr.Dataset, given: Any, prefix: str, options: Mapping[str, Any]) -> dict[str, list[float]]:
    """Check the ranges, each value by its key and, at the bounds, the scene that it makes."""
    if not isinstance(given, Mapping) or not given:
        raise scene_error(prefix, given, "a mapping from key paths to [low, high]")
    checked: dict[str, list[float]] = {}
    for path, item in given.items():
        key, found = join(prefix, path), variable_of(scene, path)
        if found is None:
            raise SceneError(f"{key}: unknown key path; allowed: the path of a number that this scene has")
        values = check_values(key, item, members=options["members"], sampling=options["sampling"])
        is_whole = scene[found[0]].dtype.kind == "i"
        listed = options["sampling"] == "list" or (options["sampling"] == "grid" and len(values) > 2)
        if is_whole and not (listed and all(value.is_integer() for value in values)):
            raise scene_error(key, item, 'a list of whole numbers, by sampling "list" or "grid"')
        for value in sorted({min(values), max(values)}):
            try:
                if found[1] is None:
                    found[2].check(path, int(value) if is_whole and value.is_integer() else value)
                one = _joined(scene, {path: np.array([value])}).isel(member=0, drop=True)
                check_numbers(parameters(one))
            except SceneError as error:
                raise SceneError(f"{key}: given {shown(values)}, at {value:g} no scene: {error}") from None
        checked[path] = values
    if options["sampling"] == "grid":
        points_of_grid(checked, options["members"], key="members")
    return dict(sorted(checked.items()))  # in whatever order they are given


def _points(checked: Mapping[str, list[float]], *, members: int, sampling: str, seed: int) -> np.ndarray:
    """Return the values of all members (members, ranges)."""
    if sampling == "list":
        return np.array(list(checked.values())).T
    if sampling == "grid":
        count = points_of_grid(checked, members)
        axes = [values if len(values) > 2 else np.linspace(values[0], values[1], count) for values in checked.values()]
        return np.array(list(itertools.product(*axes)))
    from scipy.stats import qmc  # takes half a second to import

    made = (qmc.Sobol if sampling == "sobol" else qmc.LatinHypercube)(len(checked), seed=np.random.default_rng(seed))
    # of Sobol's these are the points of random(members) too, without its warning: a part of a balanced set is not balanced
    unit = made.random_base2((members - 1).bit_length())[:members] if sampling == "sobol" else made.random(members)
    low, high = np.array(list(checked.values())).T
    return low + (high - low) * unit


def _joined(scene: xr.Dataset, varied: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Return scenes with the values of each key path along ``member``."""
    count = len(next(iter(varied.values())))
    units, long_name = VARIABLES["member"]
    made: dict[str, Any] = {}
    coords: dict[str, Any] = {"member": ("member", np.arange(count), {"units": units, "long_name": long_name})}
    for path, values in varied.items():
        found = variable_of(scene, path)
        assert found is not None  # checked before
        name, place, _ = found
        attrs = scene[name].attrs
        if place is None:
            made[name] = ("member", values.astype(scene[name].dtype), attrs)
            continue
        if name not in made:
            made[name] = (("member", "coordinate"), np.repeat(scene[name].values[None], count, axis=0), attrs)
        made[name][1][:, place] = values
        axis = {**attrs, "long_name": f"{attrs.get('long_name', name)}, {COORDINATES[place]}"}
        coords[variable_name(path)] = ("member", values, axis)
    return scene.assign(made).assign_coords(coords)
