"""Calls that repeat scenes, modes and layouts of earlier ones: what is kept between them never reaches another result."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import xarray as xr
from scenes import full_modes

import cablepod as cp
from cablepod.conventions import COORDINATES, label, labelled_dataset

TIMES = np.arange(11) / 10.0


@pytest.fixture(scope="module")
def modes():
    return full_modes()


def run(scene, modes, **options):
    return cp.condensed.simulate(scene, modes, rank=2, step=1e-3, times=TIMES, outputs=("position",), **options)


def test_a_scene_changed_in_place_is_read_again(soft, modes):
    scene = cp.make_scene(soft)
    first = run(scene, modes)
    scene["cable_top_tension"][...] = 1.1 * float(scene["cable_top_tension"])
    second = run(scene, modes)
    other = copy.deepcopy(soft)
    other["cable"]["top_tension"] *= 1.1
    np.testing.assert_array_equal(second["position"], run(cp.make_scene(other), modes)["position"])
    assert second.attrs["id"] != first.attrs["id"]
    assert not np.array_equal(second["position"], first["position"])


def test_modes_changed_in_place_are_read_again(soft, modes):
    scene, changed = cp.make_scene(soft), modes.copy(deep=True)
    first = run(scene, changed)
    changed["mode_shape"][{"mode": 0}] = changed["mode_shape"][{"mode": 2}]  # the third mode, which the first two lack
    second = run(scene, changed)
    assert np.abs(second["position"] - first["position"]).max() > 1e-6
    changed["mode_shape"][...] = modes["mode_shape"]
    np.testing.assert_array_equal(run(scene, changed)["position"], first["position"])


def test_a_result_changed_in_place_does_not_reach_the_next(soft, modes):
    scene = cp.make_scene(soft)
    first = run(scene, modes)
    expected = first.copy(deep=True)
    for name in ("position", "end_position", "amplitude", "arc_length"):
        first[name][...] = -1.0
        first[name].attrs["units"] = "furlong"
    first.attrs["title"] = "changed"
    for name in ("time", "coordinate", "mode", "end"):  # these indexes are kept
        first[name].attrs |= {"units": "changed", "mine": True}
        with pytest.raises(ValueError, match="read-only"):
            first[name].values[0] = first[name].values[1]
    xr.testing.assert_identical(run(scene, modes), expected)


def test_a_dataset_from_a_template_is_one_made_anew():
    rng = np.random.default_rng(4)
    for count in (3, 5, 3):
        indexes = {"time": rng.random(count).cumsum(), "coordinate": np.array(COORDINATES[:2])}
        variables = {
            "position": (("time", "particle", "coordinate"), rng.random((count, 4, 2))),
            "unstretched_length": ((), 2.5),
        }
        coordinates = {"arc_length": (("particle",), rng.random(4).cumsum())}
        made = labelled_dataset(variables, indexes, coordinates)
        xr.testing.assert_identical(made, label(xr.Dataset(variables, coords={**indexes, **coordinates})))
        assert made.sel(time=indexes["time"][1], coordinate="y").sizes == {"particle": 4}
