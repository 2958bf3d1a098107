"""Scenes from values: each way to give the cable, defaults, space, instants, and the shipped scenes."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
from scene_files import put, refused

import cablepod as cp


def test_defaults(soft):
    for name in ("title", "motion", "time", "chain"):
        del soft[name]
    soft["motion"] = {"upper": {"x": {"kind": "harmonic", "amplitude": 1.0, "angular_frequency": 2.0}}}
    soft["ensemble"] = {"members": 2, "ranges": {"gravity": [9.0, 10.0]}}
    scene = cp.make_scene(soft)
    given = {"cable_youngs_modulus", "cable_area", "cable_density", "cable_top_tension", "ends_lower", "ends_upper"}
    motion = {f"motion_upper_x_{key}" for key in ("kind", "amplitude", "angular_frequency", "phase")}
    assert set(scene.variables) == {"coordinate", "gravity"} | given | motion
    assert scene["gravity"] == 9.81
    assert scene["motion_upper_x_phase"] == 0.0
    assert scene.attrs["title"]
    chosen = json.loads(scene.attrs["ensemble_json"])
    assert (chosen["seed"], chosen["sampling"]) == (0, "latin_hypercube")
    with pytest.raises(cp.SceneError, match=r"time: missing; allowed: a table with duration and interval \[s\], or"):
        cp.chain.simulate(scene, links=4)


LENGTHS = {"top_tension": 200.0, "bottom_tension": 141.0, "horizontal_force": 130.0, "unstretched_length": 10.0}


@pytest.mark.parametrize("key", LENGTHS)
def test_each_way_to_give_the_length(soft, key):
    del soft["cable"]["top_tension"]
    soft["cable"][key] = LENGTHS[key]
    rest = cp.catenary.rest(cp.make_scene(soft))
    found = {"top_tension": "tension_upper", "bottom_tension": "tension_lower"}.get(key, key)
    assert float(rest[found]) == pytest.approx(LENGTHS[key], rel=1e-12)


def test_a_tension_is_that_under_weight_and_load(soft):
    soft["load"] = {"uniform": [4.0, -3.0]}
    rest = cp.catenary.rest(cp.make_scene(soft))
    assert float(rest["tension_upper"]) == pytest.approx(200.0, rel=1e-12)
    del soft["load"]
    assert float(cp.catenary.rest(cp.make_scene(soft))["unstretched_length"]) != float(rest["unstretched_length"])


@pytest.mark.parametrize(
    "changes",
    [
        {"ends.free": "upper", "motion.upper": None, "initial.points": [[0, 0], [5, 0], [9.5, 1]]},
        {"ends.free": "lower", "initial.points": [[1, 1], [8, 6]]},
        {"initial.points": np.array([[0.0, 0.0], [4.0, -2.0], [8.0, 6.0]])},
        {"initial.unstretched_length": 10.02},
        {"chain.links": None, "chain.link_lengths": [1.0, 5.0, 2.0]},
        {"motion": {}},
        {"motion.upper": {}},
        {"point_load": []},
        {"gravity": 0, "load.uniform": [0.0, 0.0]},
        {"time.interval": 4.0},
        {"time.interval": 3.0},
    ],
    ids=str,
)
def test_what_is_allowed(soft, changes):
    for path, value in changes.items():
        put(soft, path, value)
    assert int(cp.make_scene(soft).chain_links) == (3 if "chain.links" in changes else 8)


def test_a_weightless_slack_cable_may_start_from_points(soft):
    soft["gravity"] = 0.0
    soft["cable"] = {"youngs_modulus": 2e7, "area": 1e-3, "density": 1000.0, "unstretched_length": 11.0}
    soft["initial"] = {"points": [[0, 0], [6, -1], [8, 6]]}
    assert float(cp.make_scene(soft).cable_unstretched_length) == 11.0


def test_a_line_of_no_length(soft):
    soft["ends"]["free"] = "lower"
    soft["initial"] = {"points": [[8, 6], [8, 6]]}
    refused(soft, r"^initial\.points: given \[\[8\.0, 6\.0\], \[8\.0, 6\.0\]\]; allowed: a line of some length$")


def test_a_spatial_scene(soft):
    soft["ends"] = {"lower": [0.0, 0.0, 0.0], "upper": [3.0, 6.0, 4.0]}
    soft["motion"] = {"upper": {"z": {"kind": "ramp", "amplitude": 0.5, "duration": 1.0}}}
    soft["load"] = {"uniform": [0.0, 0.0, 2.0]}
    scene = cp.make_scene(soft)
    assert list(scene["coordinate"].values) == ["x", "y", "z"]
    ends = cp.chain.simulate(scene, times=[2.0], step=1e-3).position.values[0, [0, -1]]
    np.testing.assert_allclose(ends, [[0, 0, 0], [3, 6, 4.5]], rtol=1e-15)


@pytest.mark.parametrize(
    ("duration", "interval", "count"), [(124.0, 1.0, 125), (0.3, 0.1, 4), (1.0, 0.4, 3), (1, 1, 2)]
)
def test_the_instants(soft, duration, interval, count):
    soft["time"] = {"duration": duration, "interval": interval}
    times = cp.chain.simulate(cp.make_scene(soft), step=4e-3).time
    assert times.size == count
    np.testing.assert_allclose(times, interval * np.arange(count))


SHIPPED = {1: 61.236754645982, 2: 61.155551941825, 3: 61.198027145477, 4: 61.229563673343}


@pytest.mark.parametrize("number", SHIPPED)
def test_the_shipped_scenes(scenes, number):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    assert float(cp.catenary.rest(scene)["unstretched_length"]) == pytest.approx(SHIPPED[number], abs=2e-12 * 60)
    numbers = cp.summary(scene)
    assert float(numbers.axial_stiffness) == pytest.approx(2e7, rel=1e-15)
    assert float(numbers.mass_per_length) == pytest.approx(78500 * 1.25e-4 / 9.81, rel=1e-15)
    assert (int(scene.chain_links), float(scene.time_duration), float(scene.time_interval)) == (40, 124.0, 1.0)
    assert [name for name in scene if str(name).endswith("_kind")] == ["motion_upper_x_kind"]


def test_density_and_specific_weight_are_two_names_of_one_cable(soft):
    weight = copy.deepcopy(soft)
    del weight["cable"]["density"]
    weight["cable"]["specific_weight"] = 1000.0 * 9.81
    a, b = (cp.summary(cp.make_scene(scene)) for scene in (soft, weight))
    for name in ("mass_per_length", "weight_per_length"):
        assert float(a[name]) == pytest.approx(float(b[name]), rel=1e-15)
