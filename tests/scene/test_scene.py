"""The scene file: every key, equal from file and values, and every mistake answered by one clear error."""

from __future__ import annotations

import copy
import fractions
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scenes import DATA

import cablepod as cp
from cablepod import schema
from cablepod.parameters import parameters, parameters_of_members

EVERYTHING = """
title = "every table and kind"
gravity = 9.7
[cable]
youngs_modulus = 2.0e7
area = 1.0e-3
density = 1000.0
top_tension = 200.0
[ends]
lower = [0.0, 0.0]
upper = [8.0, 6.0]
[motion.upper.x]
kind = "one_minus_cosine"
amplitude = -0.05
angular_frequency = 2.0
[motion.upper.y]
kind = "harmonic"
amplitude = 0.02
angular_frequency = 3.0
phase = 0.3
[motion.lower.x]
kind = "ramp"
amplitude = 0.1
duration = 2.0
[motion.lower.y]
kind = "polynomial"
coefficients = [0.0, 0.01, 0.002]
[load]
uniform = [1.0, -2.0]
kind = "file"
path = "record.csv"
[[point_load]]
arc_length = 0.25
force = [0.0, -5.0]
[[point_load]]
arc_length = 0.5
force = [3.0, 0.0]
kind = "harmonic"
amplitude = 1.0
angular_frequency = 2.5
[time]
duration = 4.0
interval = 0.5
[chain]
links = 3
link_lengths = [1.0, 2.0, 1.0]
[initial]
top_tension = 260.0
[damping]
mass_proportional = 0.1
link_viscosity = 1e-3
[ensemble]
members = 48
seed = 5
sampling = "sobol"
[ensemble.ranges]
"cable.top_tension" = [150.0, 300.0]
"motion.upper.x.angular_frequency" = [0.1, 1.0]
"""
RECORD = "# by hand\ntime,value\n" + "".join(f"{0.25 * i},{0.1 * i * i}\n" for i in range(17))


def everything() -> dict[str, Any]:
    return {
        "title": "every table and kind",
        "gravity": 9.7,
        "cable": {"youngs_modulus": 2e7, "area": 1e-3, "density": 1000, "top_tension": np.float64(200.0)},
        "ends": {"lower": (0, 0), "upper": np.array([8.0, 6.0])},
        "motion": {
            "upper": {
                "x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 2},
                "y": {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 3.0, "phase": 0.3},
            },
            "lower": {
                "x": {"kind": "ramp", "amplitude": 0.1, "duration": 2.0},
                "y": {"kind": "polynomial", "coefficients": np.array([0.0, 0.01, 0.002])},
            },
        },
        "load": {"uniform": [1.0, -2.0], "kind": "file", "path": "record.csv"},
        "point_load": (
            {"arc_length": fractions.Fraction(1, 4), "force": [0.0, -5.0]},
            {"arc_length": 0.5, "force": [3, 0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 2.5},
        ),
        "time": {"duration": 4.0, "interval": 0.5},
        "chain": {"links": np.int64(3), "link_lengths": [1.0, 2.0, 1.0]},
        "initial": {"top_tension": np.array(260.0)},
        "damping": {"mass_proportional": 0.1, "link_viscosity": 1e-3},
        "ensemble": {
            "members": 48,
            "seed": 5,
            "sampling": "sobol",
            "ranges": {"cable.top_tension": [150.0, 300.0], "motion.upper.x.angular_frequency": (0.1, 1)},
        },
    }


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with EVERYTHING and its record, and the current one: so that both ways find the record."""
    (tmp_path / "scene.toml").write_text(EVERYTHING)
    (tmp_path / "record.csv").write_text(RECORD)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(mapping: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """Set the value at a key path, making tables on the way; None deletes it."""
    *tables, last = path.split(".")
    table = mapping
    for name in tables:
        table = table.setdefault(name, {})
    if value is None:
        del table[last]
    else:
        table[last] = value
    return mapping


# --- what is read ---------------------------------------------------------------------------------------------------


def test_file_and_values_give_the_same_scene(folder):
    read, made = cp.read_scene("scene.toml"), cp.make_scene(everything())
    xr.testing.assert_identical(read, made)
    assert read.attrs["id"] == made.attrs["id"]
    assert {name: read[name].dtype for name in read.variables} == {name: made[name].dtype for name in made.variables}


def test_a_record_is_looked_for_beside_the_scene_file(folder, monkeypatch, tmp_path_factory):
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    assert cp.read_scene(folder / "scene.toml")["load_value"].size == 17
    with pytest.raises(cp.SceneError, match=r"load\.path: record\.csv: cannot be read: No such file"):
        cp.make_scene(everything())


def test_everything_given_is_in_the_scene(folder):
    scene = cp.make_scene(everything())
    p = parameters(scene)
    assert scene.attrs["title"] == "every table and kind"
    assert p.stiffness == 2e4
    assert p.mass == 1.0
    np.testing.assert_array_equal(p.weight, [0.0, -9.7])
    np.testing.assert_array_equal(p.lower, [0, 0])
    np.testing.assert_array_equal(p.upper, [8, 6])
    assert (p.length_key, p.length_value) == ("top_tension", 200.0)
    assert {key: item.kind for key, item in p.motions.items()} == {
        ("upper", "x"): "one_minus_cosine",
        ("upper", "y"): "harmonic",
        ("lower", "x"): "ramp",
        ("lower", "y"): "polynomial",
    }
    np.testing.assert_array_equal(p.load, [1.0, -2.0])
    assert p.load_factor(1.0) == pytest.approx(0.1 * 16)
    assert [(item.key, item.fraction) for item in p.point_loads] == [("point_load.1", 0.25), ("point_load.2", 0.5)]
    np.testing.assert_array_equal(p.point_loads[0].force, [0.0, -5.0])
    assert p.point_loads[0].factor is None
    assert p.point_loads[1].factor(1.0) == pytest.approx(np.sin(2.5))
    np.testing.assert_array_equal(p.times(), np.arange(9) * 0.5)
    assert p.links == 3
    np.testing.assert_array_equal(p.link_lengths, [1, 2, 1])
    assert p.initial == {"top_tension": 260.0}
    assert (p.mass_damping, p.link_viscosity) == (0.1, 1e-3)
    assert json.loads(scene.attrs["ensemble_json"]) == {
        "members": 48,
        "seed": 5,
        "sampling": "sobol",
        "ranges": {"cable.top_tension": [150.0, 300.0], "motion.upper.x.angular_frequency": [0.1, 1.0]},
    }


def test_the_end_positions_are_those_of_the_motions(folder):
    p = parameters(cp.make_scene(everything()))
    t = np.array([0.0, 0.7, 3.1])
    s = np.clip(t / 2, 0, 1)
    lower = np.stack([0.1 * (10 * s**3 - 15 * s**4 + 6 * s**5), 0.01 * t**2 + 0.002 * t**3], axis=-1)
    upper = np.stack(
        [8 - 0.05 * (1 - np.cos(2 * t)), 6 + 0.02 * (np.sin(3 * t + 0.3) - np.sin(0.3))],
        axis=-1,
    )
    np.testing.assert_allclose(p.end_positions(t), np.stack([lower, upper], axis=1), rtol=0, atol=1e-15)
    rate = (p.end_positions(t + 1e-5) - p.end_positions(t - 1e-5)) / 2e-5
    np.testing.assert_allclose(p.end_positions(t, 1), rate, rtol=0, atol=1e-9)


def test_every_number_has_units_and_every_variable_a_long_name(folder):
    scene = cp.make_scene(everything())
    assert scene.sizes.keys() >= {"coordinate", "load_sample", "chain_link_lengths_item"}
    for name, variable in scene.variables.items():
        assert variable.attrs["long_name"], name
        if variable.dtype.kind != "U":
            assert variable.dtype.kind in "fi"
            assert variable.attrs["units"], name
    assert scene["cable_youngs_modulus"].attrs["units"] == "Pa"
    assert scene["motion_upper_y_phase"].attrs["units"] == "rad"
    assert scene["load_value"].attrs["units"] == "1"


def test_every_key_of_the_schema_has_a_long_name_and_units_unless_a_text():
    tables = [schema.TOP, *schema.TABLES.values(), schema.POINT_LOAD, schema.ENSEMBLE]
    tables += [keys for units in ("m", "1") for keys in schema.time_function_keys(units).values()]
    texts = {"title", "free", "sampling", "path"}
    for keys in tables:
        for name, key in keys.items():
            assert key.long_name
            assert (key.units is None) == (name in texts), name


def test_defaults(soft):
    for name in ("title", "motion", "time", "chain"):
        del soft[name]
    soft["motion"] = {"upper": {"x": {"kind": "harmonic", "amplitude": 1.0, "angular_frequency": 2.0}}}
    soft["ensemble"] = {"members": 2, "ranges": {"gravity": [9.0, 10.0]}}
    scene = cp.make_scene(soft)
    p = parameters(scene)
    assert scene["gravity"] == 9.81
    assert scene["motion_upper_x_phase"] == 0.0
    assert scene.attrs["title"]
    chosen = json.loads(scene.attrs["ensemble_json"])
    assert (chosen["seed"], chosen["sampling"]) == (0, "latin_hypercube")
    absent = (p.free, p.load, p.load_factor, p.duration, p.links, p.link_lengths, p.mass_damping, p.link_viscosity)
    assert all(item is None for item in absent)
    assert p.point_loads == ()
    assert p.initial == {}
    with pytest.raises(cp.SceneError, match=r"time: missing; allowed: a table with duration and interval \[s\], or"):
        p.times()


LENGTHS = {"top_tension": 200.0, "bottom_tension": 141.0, "horizontal_force": 130.0, "unstretched_length": 10.0}


ABSURD = {
    "a modulus in GPa": (
        {"cable.youngs_modulus": 20.0},
        r"cable\.youngs_modulus: .* 0\.02 N, .* by 1e\+04; allowed: .* Pa",
    ),
    "a short cable": (
        {"cable.top_tension": None, "cable.unstretched_length": 0.9},
        r"cable\.youngs_modulus: .* with unstretched_length = 0\.9 is strained by 10\.1; allowed: a strain of at most 10",
    ),
    "a long start": (
        {"initial.unstretched_length": 120.0},
        r"initial\.unstretched_length: given 120\.0; allowed: a start .* at most 11 times its length \(it is 12",
    ),
    "a wide start": (
        {"initial.points": [[0.0, 0.0], [0.0, 60.0], [8.0, 6.0]]},
        r"initial\.points: given .*; allowed: a start that stretches .* \(it is 11\.",
    ),
    "ends that part": (
        {"motion.upper.y": {"kind": "polynomial", "coefficients": [30.0]}},
        r"motion: given one that takes the ends 126\.\d+ m apart at 4 s; allowed: at most 11\d",
    ),
    "a heavy load": (
        {"point_load": [{"arc_length": 0.25, "force": [0.0, -5e7]}]},
        r"point_load\.1\.force: given loads of 5e\+07 N in all .*; allowed: .* of 20000 N, by at most 10 .* is 1\.25e\+03 or",
    ),
    "loads that part the cable": (
        {"point_load": [{"arc_length": 0.25, "force": [-5e5, 0.0]}, {"arc_length": 0.75, "force": [6e5, 0.0]}]},
        r"point_load\.2\.force: given loads of 6e\+05 N in all .* is 15 or more",
    ),
    "a load that grows": (
        {"load": {"uniform": [0.0, -10.0], "kind": "polynomial", "coefficients": [0.0, 0.0, 0.0, 20.0]}},
        r"load\.uniform: given loads of 5\.1\d+e\+05 N in all at their largest; .* is 12\.\d+ or more",
    ),
    "a load that comes and goes": (
        {
            "load": {
                "uniform": [0.0, -1e5],
                "kind": "one_minus_cosine",
                "amplitude": 1.0,
                "angular_frequency": 50.0 * math.pi,
            }
        },
        r"load\.uniform: given loads of 2\.0\d+e\+06 N in all at their largest",
    ),
    "a free end that is pulled": (
        {
            "motion": {},
            "ends.free": "upper",
            "initial": {"points": [[0.0, 0.0], [8.0, 0.0]]},
            "point_load": [{"arc_length": 1.0, "force": [2.1e5, 0.0]}],
        },
        r"point_load\.1\.force: given loads of 2\.1e\+05 N .* is 10\.5 or more",
    ),
}


@pytest.mark.parametrize("name", ABSURD)
def test_absurd_strains_are_refused(soft, name):
    changes, match = ABSURD[name]
    for path, value in changes.items():
        put(soft, path, value)
    with pytest.raises(cp.SceneError, match=match):
        cp.make_scene(soft)


def test_strains_as_of_rubber_are_not_refused(soft):
    # a load on a held end strains nothing, and half of one between the ends goes to each
    loads = [{"arc_length": 1.0, "force": [1e9, 0.0]}, {"arc_length": 0.5, "force": [0.0, -3.9e5]}]
    assert cp.make_scene(put(copy.deepcopy(soft), "point_load", loads)).attrs
    # 200 N on 25 N: a strain of 8
    assert cp.chain.rest(cp.make_scene(put(soft, "cable.youngs_modulus", 2.5e4))).stretched_length > 0.0
    # a free end goes where it likes
    put(soft, "initial.points", [[0.0, 0.0], [0.0, 500.0]])
    cp.make_scene(put(put(soft, "motion", {}), "ends.free", "upper"))


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
    p = parameters(cp.make_scene(soft))
    assert p.links == 3 if "chain.links" in changes else p.links == 8


def test_a_load_of_nothing_is_absent(soft):
    soft["load"] = {"uniform": [0.0, 0.0]}
    soft["point_load"] = [{"arc_length": 0.5, "force": [0.0, 0.0]}]
    p = parameters(cp.make_scene(soft))
    assert p.load is None
    assert p.point_loads == ()


def test_a_weightless_slack_cable_may_start_from_points(soft):
    soft["gravity"] = 0.0
    soft["cable"] = {"youngs_modulus": 2e7, "area": 1e-3, "density": 1000.0, "unstretched_length": 11.0}
    soft["initial"] = {"points": [[0, 0], [6, -1], [8, 6]]}
    assert parameters(cp.make_scene(soft)).length_value == 11.0


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
    np.testing.assert_allclose(parameters(scene).end_positions(np.array([2.0]))[0], [[0, 0, 0], [3, 6, 4.5]])


@pytest.mark.parametrize(
    ("duration", "interval", "count"), [(124.0, 1.0, 125), (0.3, 0.1, 4), (1.0, 0.4, 3), (1, 1, 2)]
)
def test_the_instants(soft, duration, interval, count):
    soft["time"] = {"duration": duration, "interval": interval}
    times = parameters(cp.make_scene(soft)).times()
    assert times.size == count
    np.testing.assert_allclose(times, interval * np.arange(count))


SHIPPED = {1: 61.236754645982, 2: 61.155551941825, 3: 61.198027145477, 4: 61.229563673343}


@pytest.mark.parametrize("number", SHIPPED)
def test_the_shipped_scenes(scenes, number):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    assert float(cp.catenary.rest(scene)["unstretched_length"]) == pytest.approx(SHIPPED[number], abs=2e-12 * 60)
    p = parameters(scene)
    assert p.stiffness == pytest.approx(2e7, rel=1e-15)
    assert p.mass == pytest.approx(78500 * 1.25e-4 / 9.81, rel=1e-15)
    assert p.links == 40
    np.testing.assert_array_equal(p.times(), np.arange(125.0))
    assert p.motions["upper", "x"](0.0) == 0.0
    assert len(p.motions) == 1


def test_density_and_specific_weight_are_two_names_of_one_cable(soft):
    weight = copy.deepcopy(soft)
    del weight["cable"]["density"]
    weight["cable"]["specific_weight"] = 1000.0 * 9.81
    a, b = parameters(cp.make_scene(soft)), parameters(cp.make_scene(weight))
    assert a.mass == pytest.approx(b.mass, rel=1e-15)
    np.testing.assert_allclose(a.weight, b.weight, rtol=1e-15)


def test_what_is_given_is_not_modified(folder):
    given = everything()
    del given["chain"]["links"], given["motion"]["upper"]["y"]["phase"], given["ensemble"]["seed"]
    before = copy.deepcopy(given)
    cp.make_scene(given)
    assert repr(given) == repr(before)


# --- ids ------------------------------------------------------------------------------------------------------------


def test_equal_values_have_equal_ids_in_any_order_and_type(soft):
    turned = {key: soft[key] for key in reversed(soft)}
    turned["ends"] = {"upper": np.array([8, 6]), "lower": (0, 0)}
    assert cp.make_scene(turned).attrs["id"] == cp.make_scene(soft).attrs["id"]


CHANGES = {
    "title": "other",
    "gravity": 9.80665,
    "cable.area": 1.0000000000000002e-3,
    "cable.density": 1001.0,
    "ends.upper": [8.0, 6.1],
    "motion.upper.x.amplitude": -0.051,
    "motion.upper.x.kind": "harmonic",
    "motion.lower.y": {"kind": "ramp", "amplitude": 0.0, "duration": 1.0},
    "load.uniform": [0.0, 0.0],
    "point_load": [{"arc_length": 0.5, "force": [0.0, 1.0]}],
    "time.interval": 0.25,
    "chain.links": 9,
    "initial.top_tension": 200.0,
    "damping.mass_proportional": 0.0,
    "ensemble": {"members": 2, "ranges": {"gravity": [9, 10]}},
}


@pytest.mark.parametrize("path", CHANGES)
def test_changed_values_have_other_ids(soft, path):
    before = cp.make_scene(soft).attrs["id"]
    assert cp.make_scene(put(soft, path, CHANGES[path])).attrs["id"] != before


def test_a_changed_record_gives_another_id(folder):
    before = cp.read_scene("scene.toml")
    (folder / "record.csv").write_text(RECORD.replace("4.0,25.6", "4.0,25.600000001"))
    after = cp.read_scene("scene.toml")
    assert before.attrs["id"] != after.attrs["id"]


# --- members --------------------------------------------------------------------------------------------------------


def concatenated(*scenes):
    return xr.concat(scenes, "member", data_vars="all", coords="minimal", compat="equals", join="outer")


def equal(a, b):
    for name in a.__dataclass_fields__:
        x, y = getattr(a, name), getattr(b, name)
        if name in ("motions", "initial"):
            assert x.keys() == y.keys()
        elif name == "point_loads":
            assert [item.key for item in x] == [item.key for item in y]
        elif name != "load_factor":
            np.testing.assert_array_equal(x, y, err_msg=name)


@pytest.mark.parametrize("dims", [("member", "coordinate"), ("coordinate", "member")])
def test_members_are_the_scenes_they_were_made_of(soft, dims):
    each = []
    for tension in (150.0, 200.0, 300.0):
        soft["cable"]["top_tension"] = tension
        soft["ends"]["upper"] = [8.0, 6.0 + tension / 1e3]
        each.append(cp.make_scene(soft))
    many = concatenated(*each).transpose(*dims, ...)
    for member, scene in zip(parameters_of_members(many), each, strict=True):
        equal(member, parameters(scene))
    with pytest.raises(cp.SceneError, match=r"scene: given several members; allowed: one, scene\.isel\(member=0\)"):
        parameters(many)
    equal(parameters(many.isel(member=1)), parameters(each[1]))


def test_members_may_differ_in_what_they_have(soft, folder):
    other = everything()
    other["cable"] = {"youngs_modulus": 2e7, "area": 1e-3, "specific_weight": 9810.0, "unstretched_length": 10.1}
    del other["ensemble"]
    each = [cp.make_scene(soft), cp.make_scene(other)]
    for member, scene in zip(parameters_of_members(concatenated(*each)), each, strict=True):
        equal(member, parameters(scene))


def test_a_scene_without_members_is_a_list_of_one(soft):
    scene = cp.make_scene(soft)
    (only,) = parameters_of_members(scene)
    equal(only, parameters(scene))


@pytest.mark.parametrize("lacking", ["gravity", "cable_area", "ends_upper"])
def test_a_dataset_that_is_no_scene(soft, lacking):
    with pytest.raises(cp.SceneError, match=r"scene: given no Dataset with gravity, .*allowed: what make_scene gives"):
        parameters(cp.make_scene(soft).drop_vars(lacking))
    with pytest.raises(cp.SceneError, match=r"allowed: what make_scene gives"):
        parameters({"gravity": 9.81})


def test_a_scene_that_lost_its_length_or_weight(soft):
    with pytest.raises(cp.SceneError, match=r"cable: given none; allowed: exactly one of top_tension, bottom_tension"):
        parameters(cp.make_scene(soft).drop_vars("cable_top_tension"))
    with pytest.raises(cp.SceneError, match=r"cable: given none; allowed: exactly one of specific_weight, density"):
        parameters(cp.make_scene(soft).drop_vars("cable_density"))


# --- mistakes in values ---------------------------------------------------------------------------------------------

BIG = 10**400
BEYOND = 10**5000  # more digits than Python writes
LOAD = {"arc_length": 0.5, "force": [0.0, 1.0]}
RAMP = {"kind": "ramp", "amplitude": 1.0, "duration": 1.0}


def nested(depth: int) -> Any:
    value: Any = 1.0
    for _ in range(depth):
        value = [value]
    return value


MISTAKES = [
    # unknown and missing keys and tables
    ("cables", {}, r"^cables: unknown key or table; allowed: title, gravity, cable, ends, .*ensemble$"),
    ("cable.aera", 1.0, r"^cable\.aera: unknown key; allowed: youngs_modulus, area, specific_weight, .*"),
    ("ends.left", [0, 0], r"^ends\.left: unknown key; allowed: lower, upper, free$"),
    ("time.step", 1.0, r"^time\.step: unknown key; allowed: duration, interval$"),
    ("chain.elements", 5, r"^chain\.elements: unknown key; allowed: links, link_lengths$"),
    ("damping.viscous", 5.0, r"^damping\.viscous: unknown key; allowed: mass_proportional, link_viscosity$"),
    ("motion.top", {}, r"^motion\.top: unknown key; allowed: lower, upper$"),
    ("motion.upper.z", RAMP, r"^motion\.upper\.z: unknown axis; allowed: x, y$"),
    ("motion.upper.x.phase", 1.0, r"^motion\.upper\.x\.phase: unknown key; allowed: amplitude, angular_frequency$"),
    ("load", {"uniform": [0, 0], "up": 1}, r"^load\.up: unknown key; allowed: uniform, kind \(of a time factor\)$"),
    ("load", {"uniform": [0, 0], "phase": 1}, r"^load\.kind: missing; allowed: one of one_minus_cosine, .*file$"),
    ("cable", None, r"^cable: missing; allowed: a table with the keys youngs_modulus, "),
    ("ends", None, r"^ends: missing; allowed: a table with the keys lower, upper, free$"),
    ("cable.area", None, r"^cable\.area: missing; allowed: area of the unstrained cross-section \[m2\]$"),
    ("cable.youngs_modulus", None, r"^cable\.youngs_modulus: missing; allowed: Young's modulus \[Pa\]$"),
    ("ends.upper", None, r"^ends\.upper: missing; allowed: position of the upper end at rest \[m\]$"),
    ("time.interval", None, r"^time\.interval: missing; allowed: time between snapshots \[s\]$"),
    ("chain.links", None, r"^chain\.links: missing; allowed: a whole number of at least 2, or chain\.link_lengths$"),
    ("motion.upper.x.kind", None, r"^motion\.upper\.x\.kind: missing; allowed: one of one_minus_cosine, "),
    ("motion.upper.x.amplitude", None, r"^motion\.upper\.x\.amplitude: missing; allowed: amplitude \[m\]$"),
    ("load", {}, r"^load\.uniform: missing; allowed: load per unstretched length, beside the weight \[N m-1\]$"),
    # ways to give length and weight
    (
        "cable.unstretched_length",
        9.0,
        r"^cable: given top_tension = 200\.0 and unstretched_length = 9\.0; allowed: exactly one of top_tension, "
        r"bottom_tension, horizontal_force, unstretched_length$",
    ),
    ("cable.top_tension", None, r"^cable: given none; allowed: exactly one of top_tension, "),
    ("cable.specific_weight", 9.0, r"^cable: given specific_weight = 9\.0 and density = 1000\.0; allowed: exactly one"),
    ("cable.density", None, r"^cable: given none; allowed: exactly one of specific_weight, density$"),
    # signs and sizes
    ("cable.youngs_modulus", -2e7, r"^cable\.youngs_modulus: given -20000000\.0; allowed: a finite number above 0$"),
    ("cable.youngs_modulus", 0, r"^cable\.youngs_modulus: given 0; allowed: a finite number above 0$"),
    (
        "cable.youngs_modulus",
        1e25,
        r"^cable\.youngs_modulus: given 1e\+25; allowed: an axial stiffness of 1e-6 to 1e18",
    ),
    ("cable.youngs_modulus", 1e-5, r"^cable\.youngs_modulus: given 1e-05; allowed: an axial stiffness of 1e-6 to 1e18"),
    ("cable.area", 0.0, r"^cable\.area: given 0\.0; allowed: a finite number above 0$"),
    ("cable.area", -1.0, r"^cable\.area: given -1\.0; allowed: a finite number above 0$"),
    ("cable.area", 1e-300, r"^cable\.area: given 1e-300; allowed: .* of a size from 1e-30 to 1e\+30$"),
    ("cable.density", 1e20, r"^cable\.density: given 1e\+20; allowed: 1e-15 to 1e15 kg/m and at most 1e15 N/m \(it is"),
    ("cable.density", 1e-20, r"^cable\.density: given 1e-20; allowed: 1e-15 to 1e15 kg/m"),
    ("gravity", 1e16, r"^cable\.density: given 1000\.0; allowed: .* at most 1e15 N/m \(it is 1 kg/m\)$"),
    ("gravity", -9.81, r"^gravity: given -9\.81; allowed: a finite number of at least 0$"),
    ("chain.links", 1, r"^chain\.links: given 1; allowed: a whole number of at least 2$"),
    ("chain.links", 0, r"^chain\.links: given 0; allowed: a whole number of at least 2$"),
    ("chain.links", -3, r"^chain\.links: given -3; allowed: a whole number of at least 2$"),
    ("chain.links", 8.0, r"^chain\.links: given 8\.0; allowed: a whole number of at least 2$"),
    ("chain.links", BIG, r"^chain\.links: given 1000\d+\.\.\.; allowed: .* at most 4611686018427387904$"),
    ("chain.link_lengths", [1.0, 0.0], r"^chain\.link_lengths\[1\]: given 0\.0; allowed: a finite number above 0$"),
    ("chain.link_lengths", [1.0, 2.0], r"^chain\.link_lengths: given \[1\.0, 2\.0\]; allowed: 8 numbers, as many as"),
    ("chain", {"link_lengths": [1.0, 2e6]}, r"^chain\.link_lengths: .*differ by a factor of at most 1e6$"),
    (
        "chain.link_lengths",
        [1.0],
        r"^chain\.link_lengths: given \[1\.0\]; allowed: a list of at least 2 finite numbers$",
    ),
    ("damping.link_viscosity", -1.0, r"^damping\.link_viscosity: given -1\.0; allowed: a finite number of at least 0$"),
    ("motion.upper.x.angular_frequency", -1, r"^motion\.upper\.x\.angular_frequency: given -1; allowed: .* least 0$"),
    ("motion.upper.x", {**RAMP, "duration": 0}, r"^motion\.upper\.x\.duration: given 0; allowed: .* above 0$"),
    ("time.interval", 0, r"^time\.interval: given 0; allowed: a finite number above 0$"),
    ("time.interval", 0.0, r"^time\.interval: given 0\.0; allowed: a finite number above 0$"),
    ("time.interval", 5.0, r"^time\.interval: given 5\.0; allowed: at most time\.duration, 4 s$"),
    ("time.duration", -4.0, r"^time\.duration: given -4\.0; allowed: a finite number above 0$"),
    # no numbers
    ("cable.area", float("nan"), r"^cable\.area: given nan; allowed: a finite number above 0$"),
    ("cable.area", float("inf"), r"^cable\.area: given inf; allowed: a finite number above 0$"),
    ("cable.area", "1e-3", r"^cable\.area: given '1e-3'; allowed: a finite number above 0$"),
    ("cable.area", True, r"^cable\.area: given True; allowed: a finite number above 0$"),
    ("cable.area", np.bool_(True), r"^cable\.area: given True; allowed: a finite number above 0$"),
    ("cable.area", [1e-3], r"^cable\.area: given \[0\.001\]; allowed: a finite number above 0$"),
    ("cable.area", 1j, r"^cable\.area: given 1j; allowed: a finite number above 0$"),
    ("cable.area", {}, r"^cable\.area: given \{\}; allowed: a finite number above 0$"),
    ("cable.area", BIG, r"^cable\.area: given 1000\d+\.\.\.; allowed: a finite number above 0$"),
    ("cable.area", fractions.Fraction(BIG, 3), r"^cable\.area: given Fraction.*; allowed: a finite number above 0$"),
    (
        "cable.area",
        BEYOND,
        r"^cable\.area: given something of type int that cannot be shown; allowed: a finite number above 0$",
    ),
    (
        "chain.links",
        BEYOND,
        r"^chain\.links: given something of type int that cannot be shown; allowed: a whole number of at least 2 and",
    ),
    (
        "chain.links",
        -BEYOND,
        r"^chain\.links: given something of type int that cannot be shown; allowed: a whole number of at least 2$",
    ),
    ("chain.links", True, r"^chain\.links: given True; allowed: a whole number of at least 2$"),
    ("chain.links", "8", r"^chain\.links: given '8'; allowed: a whole number of at least 2$"),
    ("gravity", -BIG, r"^gravity: given -1000\d+\.\.\.; allowed: a finite number of at least 0$"),
    (
        "gravity",
        1e31,
        r"^gravity: given 1e\+31; allowed: a finite number of at least 0, of a size from 1e-30 to 1e\+30$",
    ),
    ("ends.upper", [1.0, float("nan")], r"^ends\.upper\[1\]: given nan; allowed: a finite number$"),
    ("ends.upper", ["8", "6"], r"^ends\.upper\[0\]: given '8'; allowed: a finite number$"),
    ("ends.upper", [True, 6.0], r"^ends\.upper\[0\]: given True; allowed: a finite number$"),
    ("ends.upper", "86", r"^ends\.upper: given '86'; allowed: a list of two or three finite numbers$"),
    ("ends.upper", 8.0, r"^ends\.upper: given 8\.0; allowed: a list of two or three finite numbers$"),
    ("ends.upper", [8.0], r"^ends\.upper: given \[8\.0\]; allowed: a list of two or three finite numbers$"),
    ("ends.upper", np.array(8.0), r"^ends\.upper: given array\(8\.\); allowed: a list of two or three finite numbers$"),
    ("ends.upper", np.eye(2), r"^ends\.upper\[0\]: given array\(\[1\., 0\.\]\); allowed: a finite number$"),
    (
        "ends.upper",
        nested(100_000),
        r"^ends\.upper: given something of type list that cannot be shown; allowed: a list of two or",
    ),
    ("title", 5, r"^title: given 5; allowed: a text that is not empty$"),
    ("title", " ", r"^title: given ' '; allowed: a text that is not empty$"),
    # ends
    ("ends.upper", [0.0, 0.0], r"^ends\.upper: given \[0\.0, 0\.0\]; allowed: a point other than ends\.lower"),
    ("ends.upper", [1e-9, 0.0], r"^ends\.upper: .*allowed: a chord from 1e-06 m to 1e\+09 m \(it is 1e-09 m\)$"),
    ("ends.upper", [1e29, -1e29], r"^ends\.upper: .*allowed: a chord from 1e-06 m to 1e\+09 m"),
    (
        "ends.upper",
        [8, 6, 1],
        r"^ends\.upper: given \[8\.0, 6\.0, 1\.0\]; allowed: 2 numbers, as many as ends\.lower has$",
    ),
    ("ends.free", "top", r'^ends\.free: given \'top\'; allowed: one of "lower", "upper"$'),
    ("ends.free", ["upper"], r'^ends\.free: given \[\'upper\'\]; allowed: one of "lower", "upper"$'),
    (
        "ends.free",
        "upper",
        r"^motion\.upper: given \{.*\}; allowed: no motion of the end that ends\.free names \(upper\)$",
    ),
    # tensions that no cable has
    (
        "cable.top_tension",
        10.0,
        r"^cable\.top_tension: given 10\.0; allowed: at least \d+\.\d+ N, the least that a cable",
    ),
    (
        "initial.top_tension",
        10.0,
        r"^initial\.top_tension: given 10\.0; allowed: at least \d+\.\d+ N, the least that a",
    ),
    # the wrong kind of table
    ("cable", [1, 2], r"^cable: given \[1, 2\]; allowed: a table with the keys youngs_modulus, "),
    ("ends", "here", r"^ends: given 'here'; allowed: a table with the keys lower, upper, free$"),
    ("motion", 5, r"^motion: given 5; allowed: tables motion\.lower\.x, motion\.upper\.y and so on$"),
    ("motion.upper", 5, r"^motion\.upper: given 5; allowed: tables motion\.upper\.x and so on$"),
    ("motion.upper.x", 5, r"^motion\.upper\.x: given 5; allowed: a table with the key kind$"),
    ("motion.upper.x.kind", "sine", r'^motion\.upper\.x\.kind: given \'sine\'; allowed: one of "one_minus_cosine", '),
    ("motion.upper.x.kind", 5, r'^motion\.upper\.x\.kind: given 5; allowed: one of "one_minus_cosine", '),
    ("load", 5, r"^load: given 5; allowed: a table with the keys uniform$"),
    ("time", [], r"^time: given \[\]; allowed: a table with the keys duration, interval$"),
    ("chain", 40, r"^chain: given 40; allowed: a table with the keys links, link_lengths$"),
    ("point_load", LOAD, r"^point_load: given \{.*\}; allowed: an array of tables, \[\[point_load\]\]$"),
    ("point_load", [5], r"^point_load\.1: given 5; allowed: a table with the keys arc_length, force$"),
    # loads
    (
        "load",
        {"uniform": [1, 2, 3]},
        r"^load\.uniform: given \[1\.0, 2\.0, 3\.0\]; allowed: 2 numbers, as many as ends",
    ),
    ("load", {"uniform": 9.81}, r"^load\.uniform: given 9\.81; allowed: a list of two or three finite numbers$"),
    ("load", {"uniform": [0, 0], "kind": "x"}, r'^load\.kind: given \'x\'; allowed: one of "one_minus_cosine"'),
    ("point_load", [LOAD, {**LOAD, "force": [1, 2, 3]}], r"^point_load\.2\.force: given .*; allowed: 2 numbers"),
    (
        "point_load",
        [{**LOAD, "arc_length": 1.5}],
        r"^point_load\.1\.arc_length: given 1\.5; .* least 0 and of at most 1$",
    ),
    (
        "point_load",
        [{**LOAD, "arc_length": -0.1}],
        r"^point_load\.1\.arc_length: given -0\.1; allowed: a finite number",
    ),
    (
        "point_load",
        [{"force": [0, 1]}],
        r"^point_load\.1\.arc_length: missing; allowed: place of the load as a fraction",
    ),
    ("point_load", [{**LOAD, "at": 1}], r"^point_load\.1\.at: unknown key; allowed: arc_length, force, kind"),
    ("point_load", [{**LOAD, "kind": "ramp"}], r"^point_load\.1\.amplitude: missing; allowed: amplitude \[1\]$"),
    # the start
    ("initial", {}, r"^initial: given none; allowed: exactly one of top_tension, unstretched_length, points$"),
    (
        "initial",
        {"top_tension": 1, "unstretched_length": 1},
        r"^initial: given top_tension = 1\.0 and unstretched_length",
    ),
    ("initial.points", [[0, 0]], r"^initial\.points: given \[\[0, 0\]\]; allowed: a list of at least two points$"),
    ("initial.points", [[0, 0], [8]], r"^initial\.points\[1\]: given \[8\]; allowed: a list of two or three finite"),
    ("initial.points", [[0, 0], 8], r"^initial\.points\[1\]: given 8; allowed: a list of two or three finite"),
    ("initial.points", [[0, 0, 0], [8, 6, 0]], r"^initial\.points\[0\]: .*allowed: 2 numbers, as many as ends\.lower"),
    (
        "initial.points",
        [[0, 0], [8, 6.1]],
        r"^initial\.points: given \[8\.0, 6\.1\]; allowed: a line that begins and ends",
    ),
    (
        "initial",
        {"points": [[0, 0], [8, 6], [8, 6.1]]},
        r"^initial\.points: given \[8\.0, 6\.1\]; allowed: a line that",
    ),
    ("initial.points", np.array(1.0), r"^initial\.points: given array\(1\.\); allowed: a list of at least two points$"),
    (
        "initial.points",
        [[0, 0], [1e30, -1e30], [8, 6.1]],
        r"^initial\.points: given \[8\.0, 6\.1\]; allowed: a line that",
    ),
    # ensembles
    ("ensemble", 5, r"^ensemble: given 5; allowed: a table with the keys members, seed, sampling, ranges$"),
    ("ensemble", {"ranges": {"gravity": [1, 2]}}, r"^ensemble\.members: missing; allowed: number of members \[1\]$"),
    ("ensemble", {"members": 3}, r"^ensemble\.ranges: given None; allowed: a table from key paths to \[low, high\]$"),
    ("ensemble", {"members": 3, "ranges": {}}, r"^ensemble\.ranges: given \{\}; allowed: a table from key paths"),
    ("ensemble", {"members": 3, "ranges": []}, r"^ensemble\.ranges: given \[\]; allowed: a table from key paths"),
    ("ensemble.member", 5, r"^ensemble\.member: unknown key; allowed: members, seed, sampling$"),
    ("ensemble", {"members": 0}, r"^ensemble\.members: given 0; allowed: a whole number of at least 1$"),
    ("ensemble", {"members": True}, r"^ensemble\.members: given True; allowed: a whole number of at least 1$"),
    (
        "ensemble",
        {"members": np.bool_(True)},
        r"^ensemble\.members: given True; allowed: a whole number of at least 1$",
    ),
    ("ensemble", {"members": 10**9}, r"^ensemble\.members: given 1000000000; allowed: .* at most 10000000$"),
    ("ensemble", {"members": 3, "seed": -1}, r"^ensemble\.seed: given -1; allowed: a whole number of at least 0$"),
    ("ensemble", {"members": 3, "sampling": "random"}, r'^ensemble\.sampling: given \'random\'; .*"sobol", "grid"$'),
]
RANGES = [
    ({"cable.tension": [1, 2]}, r"^ensemble\.ranges\.cable\.tension: unknown key path; allowed: the path of a number"),
    ({"cable": [1, 2]}, r"^ensemble\.ranges\.cable: unknown key path"),
    ({"ends.upper": [1, 2]}, r"^ensemble\.ranges\.ends\.upper: unknown key path"),
    ({"title": [1, 2]}, r"^ensemble\.ranges\.title: unknown key path"),
    ({5: [1, 2]}, r"^ensemble\.ranges\.5: unknown key path"),
    ({"ensemble.members": [1, 2]}, r"^ensemble\.ranges\.ensemble\.members: unknown key path"),
    ({"gravity": [2, 1]}, r"^ensemble\.ranges\.gravity: given \[2, 1\]; allowed: \[low, high\] with low < high$"),
    ({"gravity": [1, 1]}, r"^ensemble\.ranges\.gravity: given \[1, 1\]; allowed: \[low, high\] with low < high$"),
    ({"gravity": [1, 2, 3]}, r"^ensemble\.ranges\.gravity: given \[1, 2, 3\]; allowed: \[low, high\] with low < high$"),
    ({"gravity": 1.0}, r"^ensemble\.ranges\.gravity: given 1\.0; allowed: a list of at least 2 finite numbers$"),
    ({"gravity": ["1", 2]}, r"^ensemble\.ranges\.gravity\[0\]: given '1'; allowed: a finite number$"),
    (
        {"gravity": [-1, 2]},
        r"^ensemble\.ranges\.gravity: given \[-1\.0, 2\.0\], at -1 no scene: gravity: given -1\.0; ",
    ),
    (
        {"cable.top_tension": [10, 300]},
        r"^ensemble\.ranges\.cable\.top_tension: given \[10\.0, 300\.0\], at 10 no scene: cable\.top_tension: given 10\.0; "
        r"allowed: at least ",
    ),
    ({"time.interval": [1, 5]}, r"at 5 no scene: time\.interval: given 5\.0; allowed: at most time\.duration, 4 s$"),
    ({"chain.links": [5, 9]}, r"at 5 no scene: chain\.links: given 5\.0; allowed: a whole number"),
]


def refused(mapping: Any, match: str) -> None:
    """Hold that a scene is refused, in one line, soon, and without a word besides."""
    begin = time.perf_counter()
    with pytest.raises(cp.SceneError, match=match) as caught:
        cp.make_scene(mapping)
    assert time.perf_counter() - begin < 2.0  # at once; the bound only tells a loop or an allocation
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 600
    assert "allowed: " in text


@pytest.mark.parametrize(
    ("path", "value", "match"), MISTAKES, ids=[f"{index}-{path}" for index, (path, _, _) in enumerate(MISTAKES)]
)
def test_a_mistake_is_named(soft, path, value, match):
    refused(put(soft, path, value), match)


@pytest.mark.parametrize(("ranges", "match"), RANGES, ids=[str(next(iter(item[0].items()))) for item in RANGES])
def test_a_mistake_in_a_range_is_named(soft, ranges, match):
    soft["ensemble"] = {"members": 3, "ranges": ranges}
    refused(soft, match)


@pytest.mark.parametrize("mapping", [None, 5, [], "cable", [("cable", 1)]])
def test_what_is_no_mapping(mapping):
    refused(mapping, r"^scene: given .*; allowed: a mapping with the tables of a scene; read_scene reads a file$")


@pytest.mark.parametrize(
    "name",
    [5, None, ("a",), BEYOND, "", "a\nb", "x" * 5000, "\ud800"],
    ids=lambda name: repr(name)[:9] if name != BEYOND else "beyond",
)
def test_strange_names_of_keys(soft, name):
    for table in (soft, soft["cable"], soft["motion"], soft["motion"]["upper"], soft["motion"]["upper"]["x"]):
        table[name] = 1.0
        refused(soft, r"(unknown key|unknown axis)[a-z ]*; allowed: ")
        del table[name]
    soft["load"] = {"uniform": [0, 0], name: 1}
    refused(soft, r"^load\..*: unknown key; allowed: ")


class Mute:
    """Something that cannot even be shown."""

    def __repr__(self):
        raise RuntimeError("no")


def test_a_value_that_cannot_be_shown(soft):
    refused(
        put(soft, "cable.area", Mute()),
        r"^cable\.area: given something of type Mute that cannot be shown; allowed: a finite number",
    )


def test_the_least_tension_is_named(scenes):
    text = (scenes / "example1.toml").read_text()
    assert "top_tension = 1875.0 " in text
    import tomllib

    mapping = tomllib.loads(text.replace("top_tension = 1875.0 ", "top_tension = 600.0 "))
    refused(
        mapping, r"^cable\.top_tension: given 600\.0; allowed: at least 628\.29\d* N, the least that a cable between"
    )
    mapping["cable"]["top_tension"] = 628.3
    cp.make_scene(mapping)


def test_cables_without_a_rest(soft):
    weightless = {**soft, "gravity": 0.0}
    weightless["cable"] = {**soft["cable"], "unstretched_length": 10.5}
    del weightless["cable"]["top_tension"]
    refused(weightless, r"^cable\.unstretched_length: given 10\.5; allowed: at most the chord, 10 m, as a slack cable")
    upright = {**soft, "ends": {"lower": [0, 0], "upper": [0, 6]}, "motion": {}}
    upright["cable"] = {**soft["cable"], "horizontal_force": 10.0}
    del upright["cable"]["top_tension"]
    refused(
        upright, r"^cable\.horizontal_force: given 10\.0; allowed: another way to give the length, as a cable along"
    )
    no_mass = {**soft, "gravity": 0.0, "cable": {**soft["cable"], "specific_weight": 9810.0}}
    del no_mass["cable"]["density"]
    refused(no_mass, r"^cable\.specific_weight: given 9810\.0; allowed: cable\.density instead, as without gravity")


@pytest.mark.parametrize(
    "changes",
    [
        {"chain.links": 10**12},
        {"chain.links": 2**62},
        {"chain.links": 10**12, "time": None},
        {"time.interval": 1e-9, "time.duration": 1e3},
        {"time.interval": 1e-8, "time.duration": 1e4, "chain": None},
        {"chain.links": 10**6, "time.interval": 1e-6},
    ],
    ids=str,
)
def test_what_memory_would_not_hold(soft, changes):
    for path, value in changes.items():
        put(soft, path, value)
    refused(
        soft, r"^chain\.links and time\.interval: given \d+ links and \d+ instants, .* GB of output; allowed: half of"
    )


def test_instants_beyond_counting(soft):
    soft["time"] = {"duration": 1e20, "interval": 1e-20}
    refused(soft, r"^time\.interval: given 1e-20; allowed: an interval that 1e\+20 s holds at most 1e12 times$")


def test_motions_beyond_all_numbers(soft):
    soft["motion"]["upper"]["x"] = {"kind": "polynomial", "coefficients": [1e30] * 1000}
    refused(
        soft,
        r"^motion\.upper\.x: given a polynomial that leaves the finite numbers by 4 s; allowed: one that is finite",
    )


# --- mistakes in records --------------------------------------------------------------------------------------------

ROWS = [(0.5 * i, 0.1 * i) for i in range(9)]


def csv(rows, header="time,value"):
    return "\n".join([header, *(",".join(str(item) for item in row) for row in rows)]) + "\n"


RECORDS = {
    "missing": (None, r"cannot be read: No such file or directory; allowed: a record, a CSV file"),
    "empty": ("", r"is empty; allowed: a CSV file with a header"),
    "comments only": ("# nothing\n\n", r"is empty; allowed: a CSV file with a header"),
    "header only": ("time,value\n", r"is too short: 0 rows; allowed: .* at least 4 rows of numbers$"),
    "three rows": (csv([(0, 0), (2, 0), (4, 0)]), r"is too short: 3 rows; allowed: .* at least 4 rows of numbers$"),
    "ends early": (csv(ROWS[:-1]), r"the record is too short, from 0 s to 3\.5 s; .*covers the run, from 0 s to 4 s$"),
    "begins late": (csv(ROWS[1:]), r"the record is too short, from 0\.5 s to 4 s; .*covers the run, from 0 s to 4 s$"),
    "unsorted": (
        csv([*ROWS[:3], ROWS[4], ROWS[3], *ROWS[5:]]),
        r"is unsorted: time 1\.5 s follows 2 s; allowed: rising",
    ),
    "twice": (csv([*ROWS[:3], *ROWS[2:]]), r"is unsorted: time 1 s follows 1 s; allowed: rising times$"),
    "nearly twice": (csv([*ROWS, (4 + 1e-12, 1)]), r"is unsorted: time 4 s follows 4 s; allowed: rising times$"),
    "blank cell": (
        csv([*ROWS[:3], (1.5, ""), *ROWS[4:]]),
        r"has a gap: row 4 holds '1\.5,'; allowed: two finite numbers$",
    ),
    "nan": (
        csv([*ROWS[:3], (1.5, "nan"), *ROWS[4:]]),
        r"has a gap: row 4 holds '1\.5,nan'; allowed: two finite numbers$",
    ),
    "infinity": (
        csv([*ROWS[:3], (1.5, "1e999"), *ROWS[4:]]),
        r"has a gap: row 4 holds '1\.5,1e999'; allowed: two finite",
    ),
    "huge": (csv([*ROWS[:3], (1.5, "1e300"), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5,1e300'; allowed: two finite"),
    "text": (csv([*ROWS[:3], (1.5, "x"), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5,x'; allowed: two finite numbers$"),
    "short row": (csv([*ROWS[:3], (1.5,), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5'; allowed: two finite numbers$"),
    "long row": (csv([*ROWS[:3], (1.5, 1, 2), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5,1,2'; allowed: two finite"),
    "hole": (
        csv([(0.01 * i, 0) for i in range(401) if not 100 < i < 150]),
        r"has a gap of 0\.5 s after 1 s; allowed: at most ten times the median spacing, 0\.01 s$",
    ),
    "binary": (b"time,value\n\xff\xfe\x00\x01", r"binary or not UTF-8; allowed: a record, a CSV file .* in text form$"),
    "nul": (b"\x00\x01\x02" * 99, r"has the columns '.x00.*; allowed: a CSV file with a header"),
    "three columns": (csv(ROWS, "time,x,y"), r"has the columns 'time, x, y'; allowed: a CSV file with a header"),
    "one column": (csv([(0,)] * 5, "time"), r"has the columns 'time'; allowed: a CSV file with a header"),
    "no time": (csv(ROWS, "t,value"), r"has the columns 't, value'; allowed: a CSV file with a header"),
    "two times": (csv(ROWS, "time,time"), r"has the columns 'time, time'; allowed: a CSV file with a header"),
    "no header": (csv(ROWS, "0,0"), r"has the columns '0, 0'; allowed: a CSV file with a header"),
}


def write(path: Path, content: str | bytes | None) -> None:
    if content is not None:
        path.write_bytes(content.encode() if isinstance(content, str) else content)


@pytest.mark.parametrize("name", RECORDS)
@pytest.mark.parametrize("key", ["motion.upper.x", "load", "point_load.1"])
def test_a_bad_record_is_named(soft, folder, name, key):
    content, match = RECORDS[name]
    write(folder / "bad.csv", content)
    factor = {"kind": "file", "path": "bad.csv"}
    changed = {
        "motion.upper.x": ("motion", {"upper": {"x": factor}}),
        "load": ("load", {"uniform": [1.0, 0.0], **factor}),
        "point_load.1": ("point_load", [{**LOAD, **factor}]),
    }
    refused(put(soft, *changed[key]), rf"^{key}\.path: .*{match}")


def test_a_folder_for_a_record(soft, folder):
    (folder / "records").mkdir()
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": "records"}
    refused(soft, r"^motion\.upper\.x\.path: records: is a folder; allowed: a record, a CSV file")


@pytest.mark.parametrize("path", ["", 5, None, ["a"]])
def test_a_path_that_is_none(soft, path):
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": path}
    refused(soft, r"^motion\.upper\.x\.path: given .*; allowed: a text that is not empty$")


@pytest.mark.parametrize("path", ["a\0b", "x" * 5000, "\ud800", "a\nb"], ids=["nul", "long", "surrogate", "newline"])
def test_a_path_that_cannot_be(soft, path):
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": path}
    refused(soft, r"^motion\.upper\.x\.path: .*: cannot be read: .*; allowed: a record")


def test_an_endless_record_is_not_read_to_its_end(soft):
    if not Path("/dev/zero").exists():
        pytest.skip("no /dev/zero here")
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": "/dev/zero"}
    refused(soft, r"^motion\.upper\.x\.path: /dev/zero: larger than 64 MiB; allowed: a record")


def test_a_record_that_brings_the_ends_together(soft, folder):
    (folder / "bad.csv").write_text(csv([(i, -8.0) for i in range(6)]))
    soft["ends"]["upper"] = [8.0, 0.0]
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": "bad.csv"}
    refused(soft, r"^motion: given one that begins with the ends 0 m apart; allowed: 1e-06 m to 1e\+09 m$")


def test_an_error_names_the_point_load_as_the_file_numbers_it(soft, folder):
    factor = {"kind": "file", "path": "record.csv"}
    soft["point_load"] = [{**LOAD, "force": [0.0, 0.0]}, {**LOAD, **factor}]
    soft["time"]["duration"] = 5.0
    refused(soft, r"^point_load\.2\.path: the record is too short, from 0 s to 4 s; allowed: one that covers the run")


def test_a_record_may_end_a_rounding_before_the_run(soft, folder):
    write(folder / "good.csv", csv([(0.1 * i if i < 3 else 0.3, 0.1 * i) for i in range(4)]))
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": "good.csv"}
    soft["time"] = {"duration": 3 * 0.1, "interval": 0.1}
    assert soft["time"]["duration"] > 0.3
    assert parameters(cp.make_scene(soft)).times().size == 4


@pytest.mark.parametrize("order", ["time,value", "value,time", " time , anything "])
def test_good_records(soft, folder, order):
    rows = [(v, t) if order.startswith("value") else (t, v) for t, v in ROWS]
    write(folder / "good.csv", "\ufeff# comment\n" + csv(rows, order).replace("\n", "\r\n") + "\n\n")
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": "good.csv"}
    p = parameters(cp.make_scene(soft))
    times, values = np.array(ROWS).T
    np.testing.assert_allclose(p.motions["upper", "x"](times), values, rtol=0, atol=1e-15)
    p.check_reach(4.0)
    with pytest.raises(
        cp.SceneError, match=r"motion\.upper\.x\.path: the record is too short, from 0 s to 4 s; .* 4\.5 s"
    ):
        p.check_reach(4.5)


# --- mistakes in scene files ----------------------------------------------------------------------------------------

FILES = {
    "empty": ("", r"the scene file is empty; allowed: TOML with at least \[cable\] and \[ends\]$"),
    "blank": (" \n\n", r"the scene file is empty; allowed: TOML"),
    "comments only": ("# nothing\n", r"cable: missing; allowed: a table with the keys"),
    "binary": (b"\x93NUMPY\xff\x00", r"binary or not UTF-8; allowed: a scene file in text form$"),
    "netCDF": (b"\x89HDF\r\n\x1a\n" + bytes(range(256)), r"binary or not UTF-8; allowed: a scene file in text form$"),
    "nul": (b"\x00" * 999, r"not a TOML file: "),
    "not TOML": (
        "cable: {area: 1}\n",
        r"not a TOML file: .*\(at line 1, column 6\); allowed: TOML, as cablepod new writes$",
    ),
    "half": (
        EVERYTHING[: EVERYTHING.index("lower = [0.0") + 12],
        r"not a TOML file: .*\(at end of document\); allowed: TOML",
    ),
    "key twice": (
        EVERYTHING.replace("area", "area = 1\narea", 1),
        r"not a TOML file: .*\(at line 7, column \d+\); allowed: TOML",
    ),
    "deep lists": (
        "a = " + "[" * 100_000,
        r"not a scene: its tables or values are nested too deeply; allowed: keys of at most four parts$",
    ),
    "deep keys": (
        "a." * 20_000 + "a = 1\n",
        r"not a scene: its tables or values are nested too deeply; allowed: keys of at most four parts$",
    ),
    "deep quoted keys": (
        '"a" . ' * 20_000 + "a = 1\n",
        r"not a scene: its tables or values are nested too deeply; allowed: keys of at most four parts$",
    ),
    "deep table": (
        "[" + "a." * 20_000 + "a]\n",
        r"not a scene: its tables or values are nested too deeply; allowed: keys of at most four parts$",
    ),
    "endless number": (f"gravity = {'9' * 5000}\n", r"not a TOML file: .*"),
    "date": (
        EVERYTHING.replace("9.7", "1979-05-27"),
        r"gravity: given datetime\.date\(1979, 5, 27\); allowed: a finite",
    ),
    "text": (EVERYTHING.replace("9.7", '"9.7"'), r"gravity: given '9\.7'; allowed: a finite number of at least 0$"),
    "true": (EVERYTHING.replace("9.7", "true"), r"gravity: given True; allowed: a finite number of at least 0$"),
    "nan": (EVERYTHING.replace("9.7", "nan"), r"gravity: given nan; allowed: a finite number of at least 0$"),
    "table for list": (EVERYTHING.replace("[[point_load]]", "[point_load]", 1), r"not a TOML file: "),
}


@pytest.mark.parametrize("name", FILES)
def test_a_bad_scene_file_is_named(folder, name):
    content, match = FILES[name]
    write(folder / "bad.toml", content)
    begin = time.perf_counter()
    with pytest.raises(cp.SceneError, match=rf"^bad\.toml: {match}") as caught:
        cp.read_scene("bad.toml")
    assert time.perf_counter() - begin < 2.0
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", ["", "a", "gravity = 1.0", "a." * 20_000 + "a = 1", EVERYTHING])
def test_a_name_that_breaks_the_line_is_shown_in_one(folder, content):
    write(folder / "b\nd.toml", content.replace("record.csv", "b\\nd.csv"))
    write(folder / "b\nd.csv", csv(ROWS[:2]))
    with pytest.raises(cp.SceneError, match=r"^'b\\nd\.toml': ") as caught:
        cp.read_scene("b\nd.toml")
    assert "\n" not in str(caught.value)


def test_no_scene_file(folder):
    with pytest.raises(cp.SceneError, match=r"^none\.toml: cannot be read: No such file .*; allowed: a scene file$"):
        cp.read_scene("none.toml")
    with pytest.raises(cp.SceneError, match=r": is a folder; allowed: a scene file$"):
        cp.read_scene(folder)
    with pytest.raises(cp.SceneError, match=r"cannot be read: .*; allowed: a scene file$"):
        cp.read_scene("scene.toml/x")


def test_a_mark_at_the_beginning_and_line_ends_of_other_systems(folder):
    write(folder / "other.toml", "\ufeff" + EVERYTHING.replace("\n", "\r\n"))
    xr.testing.assert_identical(cp.read_scene("other.toml"), cp.read_scene("scene.toml"))


# --- the paper's numbers --------------------------------------------------------------------------------------------


def table(name: str) -> dict[str, np.ndarray]:
    lines = [line for line in (DATA / name).read_text().splitlines() if not line.startswith("#")]
    header, *rows = [line.split(",") for line in lines]
    assert len(set(header)) == len(header)
    assert all(len(row) == len(header) for row in rows)
    return {key: np.array([row[i] for row in rows]) for i, key in enumerate(header)}


def numbers(name: str) -> dict[str, np.ndarray]:
    return {key: np.array([float(item or "nan") for item in column]) for key, column in table(name).items()}


def guy(scenes, **cable):
    """Example 1 with another cable: its rest."""
    import tomllib

    mapping = tomllib.loads((scenes / "example1.toml").read_text())
    mapping["cable"] |= cable
    return cp.catenary.rest(cp.make_scene(mapping), points=2001)


def test_every_table_names_its_source_and_is_told_of(scenes):
    told = (DATA / "README.md").read_text()
    paths = sorted(DATA.glob("*.csv"))
    assert [path.stem for path in paths] == ["energy_shares", "examples", "starts", "table1", "table2"]
    for path in paths:
        assert path.read_text().startswith("# ")
        assert "Escalante" in path.read_text().splitlines()[0]
        assert path.name in told


def test_table_1_is_the_guy_but_for_its_soft_rows(scenes):
    printed = numbers("table1.csv")
    np.testing.assert_array_equal(printed["top_tension_N"], printed["stress_kgf_per_cm2"] * 1.25 * 10)
    for i, tension in enumerate(printed["top_tension_N"]):
        rest = guy(scenes, top_tension=tension)
        assert float(rest["stretched_length"]) == pytest.approx(printed["stretched_length_m"][i], abs=1.5e-4)
        elongation = printed["stretched_length_m"][i] - printed["unstretched_length_m"][i]
        assert elongation == pytest.approx(printed["elongation_m"][i], abs=5.1e-4)
        # eq. (16): the inextensible shape (a cable as stiff as allowed), shortened by its tension over K
        stiff = guy(scenes, top_tension=tension, youngs_modulus=1e17)
        assert np.floor(float(stiff["tension_lower"])) == printed["bottom_tension_N"][i]  # the print cuts digits off
        shortening = float(np.trapezoid(stiff["tension"], stiff["arc_length"])) / (2e7 if i == 0 else 2e5)
        unstretched = float(stiff["unstretched_length"]) - shortening
        assert unstretched == pytest.approx(printed["unstretched_length_m"][i], abs=1.5e-4)


def test_table_2_belongs_to_its_sums():
    printed, text = numbers("table2.csv"), table("energy_shares.csv")
    assert list(text["quantity"]) == ["sum_of_singular_values", "cumulative_share"]
    assert list(text["horizontal"]) == ["7.1486", "85.66"]
    assert list(text["vertical"]) == ["2.516", "85.70"]
    np.testing.assert_array_equal(printed["mode"], np.arange(1, 6))
    for axis, total in (("x", 7.1486), ("y", 2.5136)):  # for y the text prints 2.516, see README.md
        shares = 100 * np.cumsum(printed[f"singular_value_{axis}_m"]) / total
        np.testing.assert_allclose(shares, printed[f"cumulative_share_{axis}_percent"], rtol=0, atol=0.011)


def test_the_printed_data_are_those_of_the_scenes(scenes):
    printed, first = numbers("examples.csv"), numbers("table1.csv")
    for i, number in enumerate(printed["example"].astype(int)):
        p = parameters(cp.read_scene(scenes / f"example{number}.toml"))
        motion = p.motions["upper", "x"]
        assert (p.length_key, p.length_value) == ("top_tension", printed["top_tension_N"][i])
        assert (motion.kind, motion.values["amplitude"]) == ("one_minus_cosine", -0.07)
        assert motion.values["angular_frequency"] == printed["angular_frequency_rad_per_s"][i]
        load = np.zeros(2) if p.load is None else p.load
        np.testing.assert_allclose(load, [-printed["load_ratio"][i] * p.weight[1], 0.0], rtol=1e-14)
        # the printed lengths are those of Table 1, but Examples 3 and 4 have each other's
        row = list(first["unstretched_length_m"]).index(printed["printed_unstretched_length_m"][i])
        assert first["top_tension_N"][row] == {2: 15000, 3: 7500, 4: 3750}[number]
    assert printed["masses"][0] + 1 == p.links
    assert printed["instants"][0] == p.times().size


def test_what_the_readme_computes(scenes):
    import tomllib

    softer = guy(scenes, top_tension=1.59e6)
    assert float(softer["unstretched_length"]) == pytest.approx(56.6972, abs=0.02)
    mapping = tomllib.loads((scenes / "example4.toml").read_text())
    mapping["load"]["uniform"][0] *= -1
    rest = cp.catenary.rest(cp.make_scene(mapping))
    assert float(rest["unstretched_length"]) == pytest.approx(61.200083, abs=5e-7)
