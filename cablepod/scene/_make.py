"""Make a scene Dataset from nested tables, with all checks of user input.

The variables of a scene are the keys of the scene file with ``_`` for ``.``: ``cable.area`` is the variable ``cable_area`` [m2].
An absent key is an absent variable.  ``parameters`` makes the numbers with which the models compute.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from cablepod import provenance
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._key_paths import nested
from cablepod.scene._check import check_mapping
from cablepod.scene._checked_ranges import checked_ranges
from cablepod.scene._dataset import dataset_of
from cablepod.scene._hertz import OMEGA, in_radians
from cablepod.scene._mast import check_mast, is_mast
from cablepod.scene._numbers import check_scene


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


def _make(mapping: Mapping[str, Any], folder: Path) -> xr.Dataset:
    """Make a scene; paths of records are relative to `folder`."""
    if not isinstance(mapping, Mapping):
        raise scene_error("scene", mapping, "a mapping with the tables of a scene; read_scene reads a file")
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
    tree = check_mast(mapping, folder) if is_mast(mapping) else check_mapping(mapping, folder)
    scene = dataset_of(tree)
    check_scene(scene)
    if "ensemble" in tree:
        table, prefix = tree["ensemble"], "ensemble"
        tree["ensemble"] = table | {
            "ranges": checked_ranges(
                scene, table["ranges"], f"{prefix}.ranges", table, members_key=f"{prefix}.members", folder=folder
            )[1]
        }
        scene.attrs["ensemble_json"] = provenance.Abridged(json.dumps(tree["ensemble"], sort_keys=True))
    scene.attrs["title"] = tree.get("title", "untitled scene")
    scene.attrs["stage"] = "scene"
    identity = {"scene": _without_places(tree)}
    return provenance.record(scene, function="make_scene", parameters={"scene": tree}, identity=identity)


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
