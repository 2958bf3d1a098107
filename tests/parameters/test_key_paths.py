"""Key paths of a scene: variables, numbers in nested tables and in Datasets, replacement."""

from __future__ import annotations

import copy

import pytest

import cablepod as cp
from cablepod.parameters._key_paths import (
    motion_path,
    number_at,
    point_load_path,
    replaced,
    table_at,
    variable_name,
    variable_of,
)
from cablepod.parameters._keys import CABLE, POINT_LOAD

TREE = {
    "gravity": 9.81,
    "title": "A guy",
    "cable": {"youngs_modulus": 2e11, "area": 1e-4, "density": 8000, "top_tension": 15000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "motion": {"upper": {"x": {"kind": "ramp", "amplitude": 0.1, "duration": 2.0}}},
    "point_load": [{"arc_length": 0.3, "force": [0.0, -200.0]}, {"arc_length": 0.5, "force": [1.0, 2.0]}],
}
NUMBERS = {
    "gravity": 9.81,
    "cable.density": 8000,
    "ends.upper.y": 57.7,
    "motion.upper.x.amplitude": 0.1,
    "point_load.1.arc_length": 0.3,
    "point_load.2.force.x": 1.0,
}
NO_NUMBERS = (
    None, 3, "", ".", "title", "cable", "cable.", "cable.mass", "ends.upper", "ends.upper.z", "ends.upper.1", "ends.x",
    "motion.upper.x.kind", "point_load.0.arc_length", "point_load.3.arc_length", "point_load.x.arc_length",
    "point_load.arc_length", "gravity.x",
)  # fmt: skip


@pytest.mark.parametrize("path", NUMBERS)
def test_numbers_of_nested_tables_are_found_and_replaced(path):
    before = copy.deepcopy(TREE)
    assert number_at(TREE, path) == NUMBERS[path]
    changed = replaced(TREE, path, 0.25)
    assert before == TREE
    assert {name: number_at(changed, name) for name in NUMBERS} == NUMBERS | {path: 0.25}


@pytest.mark.parametrize("path", NO_NUMBERS)
def test_other_paths_lead_to_no_number(path):
    assert number_at(TREE, path) is None


def test_missing_tables_are_made():
    assert replaced({}, "damping.mass_proportional", 0.1) == {"damping": {"mass_proportional": 0.1}}
    assert replaced({"time": None}, "time.interval", 0.1) == {"time": {"interval": 0.1}}


def test_paths_of_tables_and_their_variables():
    assert variable_name("cable.top_tension") == "cable_top_tension"
    assert variable_name(f"{motion_path('upper', 'x')}.amplitude") == "motion_upper_x_amplitude"
    assert variable_name(f"{point_load_path(2)}.force") == "point_load_2_force"


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


@pytest.mark.parametrize("path", [*NO_NUMBERS, "cable_area", "ends.upper.w", "damping.link_viscosity"])
def test_other_paths_lead_to_no_variable(path):
    assert variable_of(cp.make_scene(TREE), path) is None


def test_tables_of_a_dataset():
    scene = cp.make_scene(TREE)
    values = {str(name): variable.values for name, variable in scene.variables.items()}
    assert table_at(values, "cable", CABLE) == TREE["cable"]
    assert table_at(values, "point_load.1", POINT_LOAD).keys() == POINT_LOAD.keys()
    assert table_at(values, "point_load.3", POINT_LOAD) == {}
