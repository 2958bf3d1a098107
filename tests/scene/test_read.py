"""Scene files: equal from file and values, units and names, ids, and every mistake of a file answered by one clear error."""

from __future__ import annotations

import copy
import json
import time

import numpy as np
import pytest
import xarray as xr
from scene_files import EVERYTHING, RECORD, ROWS, csv, everything, put, write

import cablepod as cp
from cablepod.parameters import _keys as scene_keys
from cablepod.parameters._from_scene import parameters


def test_file_and_values_give_the_same_scene(scene_folder):
    read, made = cp.read_scene("scene.toml"), cp.make_scene(everything())
    xr.testing.assert_identical(read, made)
    assert read.attrs["id"] == made.attrs["id"]
    assert {name: read[name].dtype for name in read.variables} == {name: made[name].dtype for name in made.variables}


def test_a_record_is_looked_for_beside_the_scene_file(scene_folder, monkeypatch, tmp_path_factory):
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    assert cp.read_scene(scene_folder / "scene.toml")["load_value"].size == 17
    with pytest.raises(cp.SceneError, match=r"load\.path: record\.csv: cannot be read: No such file"):
        cp.make_scene(everything())


def test_everything_given_is_in_the_scene(scene_folder):
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


def test_the_end_positions_are_those_of_the_motions(scene_folder):
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


def test_every_number_has_units_and_every_variable_a_long_name(scene_folder):
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


def test_every_key_of_the_schema_has_a_long_name_and_units_unless_a_text_or_truth():
    tables = [scene_keys.TOP, *scene_keys.TABLES.values(), scene_keys.POINT_LOAD, scene_keys.ENSEMBLE]
    tables += [keys for units in ("m", "1") for keys in scene_keys.time_function_keys(units).values()]
    texts = {
        "title",
        "free",
        "sampling",
        "path",
        "strand",
        "strand_table",
        "profile",
        "spectrum",
        "record",
        "record_sha256",
        "exact_mean",
    }
    for keys in tables:
        for name, key in keys.items():
            assert key.long_name
            assert (key.units is None) == (name in texts), name


def test_what_is_given_is_not_modified(scene_folder):
    given = everything()
    del given["chain"]["links"], given["motion"]["upper"]["y"]["phase"], given["ensemble"]["seed"]
    before = copy.deepcopy(given)
    cp.make_scene(given)
    assert repr(given) == repr(before)


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


def test_a_changed_record_gives_another_id(scene_folder):
    before = cp.read_scene("scene.toml")
    (scene_folder / "record.csv").write_text(RECORD.replace("4.0,25.6", "4.0,25.600000001"))
    after = cp.read_scene("scene.toml")
    assert before.attrs["id"] != after.attrs["id"]


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
def test_a_bad_scene_file_is_named(scene_folder, name):
    content, match = FILES[name]
    write(scene_folder / "bad.toml", content)
    begin = time.process_time()
    with pytest.raises(cp.SceneError, match=rf"^bad\.toml: {match}") as caught:
        cp.read_scene("bad.toml")
    assert time.process_time() - begin < 2.0
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", ["", "a", "gravity = 1.0", "a." * 20_000 + "a = 1", EVERYTHING])
def test_a_name_that_breaks_the_line_is_shown_in_one(scene_folder, content):
    write(scene_folder / "b\nd.toml", content.replace("record.csv", "b\\nd.csv"))
    write(scene_folder / "b\nd.csv", csv(ROWS[:2]))
    with pytest.raises(cp.SceneError, match=r"^'b\\nd\.toml': ") as caught:
        cp.read_scene("b\nd.toml")
    assert "\n" not in str(caught.value)


def test_no_scene_file(scene_folder):
    with pytest.raises(cp.SceneError, match=r"^none\.toml: cannot be read: No such file .*; allowed: a scene file$"):
        cp.read_scene("none.toml")
    with pytest.raises(cp.SceneError, match=r": is a folder; allowed: a scene file$"):
        cp.read_scene(scene_folder)
    with pytest.raises(cp.SceneError, match=r"cannot be read: .*; allowed: a scene file$"):
        cp.read_scene("scene.toml/x")


def test_a_mark_at_the_beginning_and_line_ends_of_other_systems(scene_folder):
    write(scene_folder / "other.toml", "\ufeff" + EVERYTHING.replace("\n", "\r\n"))
    xr.testing.assert_identical(cp.read_scene("other.toml"), cp.read_scene("scene.toml"))
