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
from cablepod.errors import SceneError
from cablepod.parameters._key_paths import variable_of
from cablepod.parameters._keys import ENSEMBLE
from cablepod.scene._checked_ranges import checked_ranges
from cablepod.scene._hertz import ranges_in_radians
from cablepod.scene._mast import scene_kind
from cablepod.scene._ranges import are_choices, points_of_grid, with_counts_expanded
from cablepod.scene._varied import vary


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
    given = {"members": members, "sampling": sampling, "seed": seed}
    options: dict[str, Any] = {
        name: None if value is None else ENSEMBLE[name].check(name, value) for name, value in given.items()
    }
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
    whole, checked = checked_ranges(scene, ranges, prefix, options, members_key="members")
    checked = dict(sorted(checked.items()))  # the result does not depend on the order of the ranges
    scenes = vary(whole, _sample(checked, **options), checked)
    scenes.attrs = {name: value for name, value in scene.attrs.items() if name != "ensemble_json"}
    scenes.attrs |= {"title": f"{scene.attrs.get('title', 'scene')}: {options['members']} members"}
    record = {**options, "ranges": checked}
    return provenance.record(scenes, function="ensemble.design", parameters=record, inputs=[scene])


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
