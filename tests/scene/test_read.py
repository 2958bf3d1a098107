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
    assert scene.attrs["title"] == "every table and kind"
    times, factors = np.loadtxt("record.csv", delimiter=",", skiprows=2).T
    assert {name: scene[name].values.tolist() for name in scene.data_vars} == {
        "gravity": 9.7,
        **{"cable_youngs_modulus": 2e7, "cable_area": 1e-3, "cable_density": 1000.0, "cable_top_tension": 200.0},
        **{"ends_lower": [0.0, 0.0], "ends_upper": [8.0, 6.0]},
        **{"motion_upper_x_kind": "one_minus_cosine", "motion_upper_x_amplitude": -0.05},
        **{
            "motion_upper_x_angular_frequency": 2.0,
            "motion_upper_y_kind": "harmonic",
            "motion_upper_y_amplitude": 0.02,
        },
        **{"motion_upper_y_angular_frequency": 3.0, "motion_upper_y_phase": 0.3, "motion_lower_x_kind": "ramp"},
        **{"motion_lower_x_amplitude": 0.1, "motion_lower_x_duration": 2.0, "motion_lower_y_kind": "polynomial"},
        "motion_lower_y_coefficients": [0.0, 0.01, 0.002],
        **{"load_uniform": [1.0, -2.0], "load_kind": "file", "load_path": "record.csv"},
        **{"load_time": times.tolist(), "load_value": factors.tolist()},
        **{"point_load_1_arc_length": 0.25, "point_load_1_force": [0.0, -5.0]},
        **{"point_load_2_arc_length": 0.5, "point_load_2_force": [3.0, 0.0], "point_load_2_kind": "harmonic"},
        **{"point_load_2_amplitude": 1.0, "point_load_2_angular_frequency": 2.5, "point_load_2_phase": 0.0},
        **{"time_duration": 4.0, "time_interval": 0.5, "chain_links": 3, "chain_link_lengths": [1.0, 2.0, 1.0]},
        **{"initial_top_tension": 260.0, "damping_mass_proportional": 0.1, "damping_link_viscosity": 1e-3},
    }
    numbers = cp.summary(scene)
    assert (float(numbers.axial_stiffness), float(numbers.mass_per_length)) == (2e4, 1.0)
    assert float(numbers.weight_per_length) == 9.7
    assert json.loads(scene.attrs["ensemble_json"]) == {
        "members": 48,
        "seed": 5,
        "sampling": "sobol",
        "ranges": {"cable.top_tension": [150.0, 300.0], "motion.upper.x.angular_frequency": [0.1, 1.0]},
    }


def test_the_end_positions_are_those_of_the_motions(soft):
    t = np.array([0.0, 0.7, 3.1])
    scene = cp.make_scene({**soft, "motion": everything()["motion"]})
    run = cp.chain.simulate(scene, times=t, step=1e-3, outputs=("position", "velocity"))
    s = np.clip(t / 2, 0, 1)
    lower = np.stack([0.1 * (10 * s**3 - 15 * s**4 + 6 * s**5), 0.01 * t**2 + 0.002 * t**3], axis=-1)
    upper = np.stack([8 - 0.05 * (1 - np.cos(2 * t)), 6 + 0.02 * (np.sin(3 * t + 0.3) - np.sin(0.3))], axis=-1)
    found = run.isel(particle=[0, -1])
    np.testing.assert_allclose(found.position, np.stack([lower, upper], axis=1), rtol=0, atol=1e-15)
    rates = np.stack([0.05 * (30 * s**2 - 60 * s**3 + 30 * s**4), 0.02 * t + 0.006 * t**2], axis=-1)
    rates = np.stack([rates, np.stack([-0.1 * np.sin(2 * t), 0.06 * np.cos(3 * t + 0.3)], axis=-1)], axis=1)
    np.testing.assert_allclose(found.velocity, rates, rtol=0, atol=1e-14)


def test_a_record_of_a_load_moves_as_the_polynomial_that_it_is(soft, scene_folder):
    # the record is 1.6 t^2, which a cubic spline has exactly
    loads = [everything()["load"], {"uniform": [1.0, -2.0], "kind": "polynomial", "coefficients": [0.0, 1.6]}]
    record, formula = (cp.chain.simulate(cp.make_scene({**soft, "load": load}), step=1e-3) for load in loads)
    np.testing.assert_allclose(
        record.position, formula.position, rtol=0, atol=1e-9
    )  # rounding, which the motion amplifies
    assert np.abs(formula.position - formula.position[0]).max() > 0.1


def test_every_number_has_units_and_every_variable_a_long_name(scene_folder):
    scene = cp.make_scene(everything())
    assert scene.sizes.keys() >= {"coordinate", "load_sample", "chain_link_lengths_item"}
    for name, variable in scene.variables.items():
        assert variable.attrs["long_name"], name
        assert variable.attrs["units"] == "1" if variable.dtype.kind == "U" else variable.attrs["units"], name
    assert scene["cable_youngs_modulus"].attrs["units"] == "Pa"
    assert scene["motion_upper_y_phase"].attrs["units"] == "rad"
    assert scene["load_value"].attrs["units"] == "1"


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
    "not TOML": ("cable: {area: 1}\n", r"not a TOML file: .*\(at line 1, column 6\); allowed: TOML, as cablepod new writes$"),
    "half": (EVERYTHING[: EVERYTHING.index("lower = [0.0") + 12], r"not a TOML file: .*\(at end of document\); allowed: TOML"),
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
    "date": (EVERYTHING.replace("9.7", "1979-05-27"), r"gravity: given datetime\.date\(1979, 5, 27\); allowed: a finite"),
    "text": (EVERYTHING.replace("9.7", '"9.7"'), r"gravity: given '9\.7'; allowed: a finite number of at least 0$"),
    "true": (EVERYTHING.replace("9.7", "true"), r"gravity: given True; allowed: a finite number of at least 0$"),
    "nan": (EVERYTHING.replace("9.7", "nan"), r"gravity: given nan; allowed: a finite number of at least 0$"),
    "table for list": (EVERYTHING.replace("[[point_load]]", "[point_load]", 1), r"not a TOML file: "),
}  # fmt: skip


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
