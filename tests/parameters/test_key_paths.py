"""Key paths of a scene: variables, numbers in nested tables and in Datasets, both forms."""

from __future__ import annotations

import copy
import json

import pytest
from scenes import SOFT

import cablepod as cp
from cablepod.parameters._key_paths import (  # what messages and ranges are made of; no public function gives them alone
    dotted,
    flat,
    listed_path,
    motion_path,
    number_at,
    variable_name,
    variable_of,
)
from cablepod.parameters._keys import ENSEMBLE, POINT_LOAD, TABLES, time_function_keys
from cablepod.parameters._scene_values import tables_of

TREE = {
    "gravity": 9.81,
    "title": "A guy",
    "cable": {"youngs_modulus": 2e11, "area": 1e-4, "density": 8000, "top_tension": 15000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "motion": {"upper": {"x": {"kind": "ramp", "amplitude": 0.1, "duration": 2.0}}},
    "point_load": [{"arc_length": 0.3, "force": [0.0, -200.0]}, {"arc_length": 0.5, "force": [1.0, 2.0]}],
}
NUMBERS = {
    "gravity": 9.81, "cable.density": 8000, "ends.upper.y": 57.7, "motion.upper.x.amplitude": 0.1,
    "point_load.1.arc_length": 0.3, "point_load.2.force.x": 1.0,
}  # fmt: skip
NO_NUMBERS = (
    None, 3, "", ".", "title", "cable", "cable.", "cable.mass", "ends.upper", "ends.upper.z", "ends.upper.1", "ends.x",
    "motion.upper.x.kind", "point_load.0.arc_length", "point_load.3.arc_length", "point_load.x.arc_length",
    "point_load.arc_length", "gravity.x",
)  # fmt: skip


@pytest.mark.parametrize("path", NUMBERS)
def test_numbers_of_nested_tables_are_found(path):
    assert number_at(TREE, path) == NUMBERS[path]


@pytest.mark.parametrize("path", NO_NUMBERS)
def test_other_paths_lead_to_no_number(path):
    assert number_at(TREE, path) is None


def test_paths_of_tables_and_their_variables():
    assert variable_name("cable.top_tension") == "cable_top_tension"
    assert variable_name(f"{motion_path('upper', 'x')}.amplitude") == "motion_upper_x_amplitude"
    assert variable_name(f"{listed_path('point_load', 2)}.force") == "point_load_2_force"


@pytest.mark.parametrize(
    ("path", "name", "component", "units"),
    [
        ("gravity", "gravity", None, "m s-2"),
        ("cable.density", "cable_density", None, "kg m-3"),
        ("ends.upper.y", "ends_upper", 1, "m"),
        ("motion.upper.x.amplitude", "motion_upper_x_amplitude", None, "m"),
        ("point_load.1.arc_length", "point_load_1_arc_length", None, "1"),
        ("point_load.2.force.x", "point_load_2_force", 0, "N"),
    ],
)
def test_numbers_of_a_dataset_are_those_of_its_tables(path, name, component, units):
    scene = cp.make_scene(TREE)
    found = variable_of(scene, path)
    assert found is not None
    assert (found[0], found[1], found[2].units) == (name, component, units)
    assert (scene[name].values if component is None else scene[name].values[component]) == NUMBERS[path]


@pytest.mark.parametrize("path", [*NO_NUMBERS, "cable_mass", "ends.upper.w", "damping.link_viscosity"])
def test_other_paths_lead_to_no_variable(path):
    assert variable_of(cp.make_scene(TREE), path) is None


def test_tables_of_a_dataset():
    scene = cp.make_scene(TREE)
    tables = tables_of({str(name): variable.values.tolist() for name, variable in scene.variables.items()})
    loads = {str(number): load for number, load in enumerate(TREE["point_load"], start=1)}
    assert tables == {name: TREE[name] for name in ("gravity", "cable", "ends", "motion")} | {"point_load": loads}


# --- two forms of one path ---------------------------------------------------------------------------------------------


def all_paths():
    """Key paths of the whole schema: every table and key, motions of both ends, two point loads, components."""
    for table, keys in {**TABLES, "ensemble": ENSEMBLE}.items():
        yield from (f"{table}.{key}" for key in keys)
    for kind in time_function_keys("m").values():
        yield from (f"{table}.{key}" for table in ("motion.lower.x", "motion.upper.z", "load") for key in kind)
        yield from (f"point_load.12.{key}" for key in kind)
    yield from (f"point_load.{number}.{key}" for number in (1, 12) for key in (*POINT_LOAD, "kind", "force.y"))
    yield from ("ends.upper.x", "ends.lower.z", "load.uniform.y", "gravity", "title")


@pytest.mark.parametrize("path", sorted(set(all_paths())))
def test_a_variable_has_its_key_path(path):
    assert dotted(variable_name(path)) == path
    assert dotted(path) == path


@pytest.mark.parametrize(
    "path", [None, 3, [], "", "_", "cable_", "cable_aera", "point_load_x_force", "motion_top_x_kind"]
)
def test_what_is_no_path_stays(path):
    assert dotted(path) == path


FORMS = {
    "points": {
        "cable.youngs_modulus": 2e11, "cable.area": 1e-4, "cable.density": 8000, "cable.top_tension": 15000.0,
        "ends.lower": [0.0, 0.0], "ends.upper": [0.0, 57.7], "ends.upper.x": 20.4, "gravity": 9.81, "title": "A guy",
        "motion.upper.x": {"kind": "ramp", "amplitude": 0.1, "duration": 2.0},
        "point_load.2.arc_length": 0.5, "point_load.2.force": [1.0, 2.0],
        "point_load.1.arc_length": 0.3, "point_load.1.force": [0.0, 0.0], "point_load.1.force.y": -200.0,
    },
    "mixed": {
        "cable": {"youngs_modulus": 2e11, "area": 1e-4, "density": 8000}, "cable.top_tension": 15000.0, "gravity": 9.81,
        "ends": TREE["ends"], "title": "A guy", "motion": {"upper.x": TREE["motion"]["upper"]["x"]},
        "point_load": [{"arc_length": 0.3, "force": [0.0, 3.0]}, TREE["point_load"][1]], "point_load.1.force.y": -200.0,
    },
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_a_scene_is_the_same_in_both_forms(form):
    before = copy.deepcopy(FORMS[form])
    scene = cp.make_scene(FORMS[form])
    assert FORMS[form] == before
    expected = cp.make_scene(TREE)
    assert scene.identical(expected)
    assert scene.attrs["id"] == expected.attrs["id"]


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"cable.area": 2e-4}, r"^cable\.area: given in two forms, 0\.0001 and 0\.0002; allowed: one$"),
        ({"cable_area": 2e-4}, r"^cable_area: unknown key or table; allowed: .* key paths with points; try: cable\.area$"),
        ({"motion_upper_x_phase": 0.1}, r"^motion_upper_x_phase: unknown key or table; .*; try: motion\.upper\.x\.phase$"),
        ({"ends_upper_x": 7.0}, r"^ends_upper_x: unknown key or table; .*; try: ends\.upper\.x$"),
        ({"cable.area.x": 2e-4}, r"^cable\.area\.x: given beside 0\.0001; allowed: a table"),
        ({"cable.aera": 2e-4}, r"^cable\.aera: unknown key; .*; try: cable\.area$"),
        ({"cable_aera": 2e-4}, r"^cable_aera: unknown key or table"),
        ({"ends.upper.z": 2.0}, r"^ends\.upper\.z: unknown key path"),
        ({"point_load.4.force": [0.0, 1.0]}, r"^point_load\.4\.force: unknown key path"),
    ],
)  # fmt: skip
def test_forms_that_contradict_each_other_are_refused(given, match):
    with pytest.raises(cp.SceneError, match=match):
        cp.make_scene({**TREE, **given})


RANGES = (
    {"cable.top_tension": [200.0, 300.0], "ends.upper.x": [7.0, 8.5]},
    {"cable": {"top_tension": [200.0, 300.0]}, "ends": {"upper": {"x": [7.0, 8.5]}}},
    {"cable": {"top_tension": [200.0, 300.0]}, "ends.upper": {"x": [7.0, 8.5]}},
)


@pytest.mark.parametrize("ranges", RANGES)
def test_ranges_are_the_same_in_both_forms(ranges):
    assert flat(ranges) == RANGES[0]
    expected = cp.ensemble.design(cp.make_scene(SOFT), RANGES[0], members=5)
    assert cp.ensemble.design(cp.make_scene(SOFT), ranges, members=5).identical(expected)
    table = cp.make_scene({**SOFT, "ensemble": {"members": 5, "ranges": ranges}})
    assert json.loads(table.attrs["ensemble_json"])["ranges"] == RANGES[0]
    assert cp.ensemble.design(table).equals(expected)


def test_a_range_in_two_forms_is_refused():
    ranges = {**RANGES[0], "cable": {"top_tension": [1.0, 2.0]}}
    with pytest.raises(
        cp.SceneError, match=r"^ensemble\.ranges\.cable\.top_tension: given in two forms; allowed: one$"
    ):
        cp.ensemble.design(cp.make_scene(SOFT), ranges, members=5)


@pytest.mark.parametrize(
    ("name", "path"), [("cable_top_tension", r"cable\.top_tension"), ("ends_upper_x", r"ends\.upper\.x")]
)
def test_a_range_by_the_name_of_a_variable_is_refused(name, path):
    said = rf"ranges\.{name}: unknown key path; allowed: .*; try: {path}$"
    with pytest.raises(cp.SceneError, match=f"^{said}"):
        cp.ensemble.design(cp.make_scene(SOFT), {name: [7.0, 8.0]}, members=5)
    with pytest.raises(cp.SceneError, match=rf"^ensemble\.{said}"):
        cp.make_scene({**SOFT, "ensemble": {"members": 5, "ranges": {name: [7.0, 8.0]}}})
