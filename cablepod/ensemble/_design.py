"""Design of experiments: scenes of an ensemble with parameters varied over ranges."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import taken
from cablepod.conventions import COORDINATES, VARIABLES
from cablepod.errors import SceneError, did_you_mean, scene_error, shown
from cablepod.parameters._key_paths import dotted, flat, variable_name, variable_of
from cablepod.parameters._keys import ENSEMBLE, join
from cablepod.scene._hertz import ranges_in_radians
from cablepod.scene._make import check_scene_numbers
from cablepod.scene._mast import scene_kind
from cablepod.scene._ranges import axis_hint, check_values, points_of_grid, with_counts_expanded


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
        Key path of a number -> [low, high]; the order has no effect.  If all ranges are [low, high, count], without `sampling`,
        the members are all combinations of `count` equally spaced values of each, ends included.  For sampling "grid" and
        "list": values.  A path has points, ``_`` (``"cable_top_tension"``) or is nested (``{"cable": {"top_tension": [low,
        high]}}``).  Components of vectors are named by their axis (``"ends.upper.x"``), point loads by their number
        (``"point_load.1.force.y"``).  By default the table ``[ensemble]`` of the scene file gives the ranges and all options
        that are None.
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
        For unknown key paths, reversed ranges, bounds that give no valid scene, ranges with a count beside others without, a
        missing number of members, or one that does not fit the grid.
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
    checked = _check_ranges(scene, ranges, prefix, options)
    points = _sample(checked, **options)
    scenes = _vary(scene, dict(zip(checked, np.ascontiguousarray(points.T), strict=True)))
    scenes.attrs = {
        name: value for name, value in scene.attrs.items() if name not in ("values_sha256", "ensemble_json")
    }
    scenes.attrs |= {"title": f"{scene.attrs.get('title', 'scene')}: {options['members']} members"}
    record = {**options, "ranges": checked}
    return provenance.stamp_values(
        provenance.record(scenes, function="ensemble.design", parameters=record, inputs=[scene])
    )


def _check_ranges(scene: xr.Dataset, ranges: Any, prefix: str, options: Mapping[str, Any]) -> dict[str, list[float]]:
    """Check all values and the scenes at the bounds; return the ranges sorted by key path."""
    ranges = flat(ranges)
    if not isinstance(ranges, Mapping) or not ranges:
        raise scene_error(prefix, ranges, "a mapping from key paths to [low, high]")
    checked: dict[str, list[float]] = {}
    for path, range_values in ranges.items():
        key, target = join(prefix, path), variable_of(scene, path)
        if target is None:
            is_vector = variable_of(scene, f"{path}.x") is not None
            similar = axis_hint(is_vector, path) or did_you_mean(path, [dotted(str(name)) for name in scene.data_vars])
            raise SceneError(f"{key}: unknown key path; allowed: the path of a number of this scene{similar}")
        name, index, vocabulary_key = target
        values = check_values(key, range_values, members=options["members"], sampling=options["sampling"])
        is_whole = scene[name].dtype.kind == "i"
        listed = options["sampling"] == "list" or (options["sampling"] == "grid" and len(values) > 2)
        if is_whole and not (listed and all(value.is_integer() for value in values)):
            raise scene_error(key, range_values, 'a list of whole numbers, by sampling "list" or "grid"')
        for value in sorted({min(values), max(values)}):
            try:
                if index is None:
                    vocabulary_key.check(path, int(value) if is_whole and value.is_integer() else value)
                varied = _vary(scene, {path: np.array([value])}).isel(member=0, drop=True)
                check_scene_numbers(varied)
            except SceneError as error:
                raise SceneError(f"{key}: given {shown(values)}, at {value:g} no scene: {error}") from None
        checked[path] = values
    if options["sampling"] == "grid":
        points_of_grid(checked, options["members"], key="members")
    return dict(sorted(checked.items()))  # the result does not depend on the order of the ranges


def _sample(checked: Mapping[str, list[float]], *, members: int, sampling: str, seed: int) -> np.ndarray:
    """Return the values of all members (member, range)."""
    if sampling == "list":
        return np.array(list(checked.values())).T
    if sampling == "grid":
        count = points_of_grid(checked, members)
        axes = [values if len(values) > 2 else np.linspace(values[0], values[1], count) for values in checked.values()]
        return np.array(list(itertools.product(*axes)))
    from scipy.stats import qmc  # takes half a second to import

    sampler = (qmc.Sobol if sampling == "sobol" else qmc.LatinHypercube)(len(checked), seed=np.random.default_rng(seed))
    # Sobol: the same points as random(members), without its warning on numbers that are no power of two
    power = (members - 1).bit_length()
    unit = sampler.random_base2(power)[:members] if sampling == "sobol" else sampler.random(members)
    low, high = np.array(list(checked.values())).T
    return low + (high - low) * unit


def _vary(scene: xr.Dataset, varied: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Return the scene with the values of each key path along ``member``."""
    count = len(next(iter(varied.values())))
    units, long_name = VARIABLES["member"]
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {"member": ("member", np.arange(count), {"units": units, "long_name": long_name})}
    for path, values in varied.items():
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
    return scene.assign(variables).assign_coords(coords)
