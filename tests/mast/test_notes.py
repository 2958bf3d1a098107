"""Notes on masts: numbers in another unit, missing keys, and the warning of the models."""

from __future__ import annotations

import copy
import inspect
import json
import warnings

import numpy as np
import pytest
from printed import printed
from scene_files import put

import cablepod as cp
from cablepod import examples

#: A mast as an engineer gives it; nothing is unusual about it.
MAST = {
    "mast": {"height": 60.0, "bending_stiffness": 2.4e7, "mass": 55.0, "drag_area": 0.45},
    "cables": {
        "lower": {"axial_stiffness": 1.6e7, "mass_per_length": 0.85, "diameter": 0.013, "breaking_strength": 1.1e5},
        "upper": {"axial_stiffness": 2.1e7, "mass_per_length": 1.1, "diameter": 0.017, "breaking_strength": 1.5e5},
    },
    "guy": [
        {"cable": cable, "level": level, "radius": 35.0, "count": 3, "direction": [-1.0, 0.0, 0.0], "top_tension": tension}
        for cable, level, tension in (("lower", 29.0, 11000.0), ("upper", 56.0, 15000.0))
    ],
    "wind": {"speed": 26.0, "direction": [1.0, 0.0, 0.0]},
    "time": {"duration": 1.0, "interval": 0.1},
}  # fmt: skip


def changed(path, value):
    """The mapping of the mast with one key changed, or without it."""
    return put(copy.deepcopy(MAST), path, value)


def warned(function, *arguments, **options):
    """Call a function; return its warnings of unusual scenes."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        function(*arguments, **options)
    return [item for item in caught if issubclass(item.category, cp.UnusualSceneWarning)]


@pytest.mark.parametrize("scene", [cp.make_scene(MAST), *map(examples.scene, ("mast30", "mast120"))])
def test_a_usual_mast_has_no_notes(scene):
    assert str(cp.summary(scene).note.values) == ""
    assert warned(cp.mast.rest, scene) == []


@pytest.mark.parametrize(
    ("path", "value", "key", "said"),
    [
        ("cables.upper.breaking_strength", 150.0, "cables.upper.breaking_strength", "= 150000 (given in kN?)"),
        ("cables.upper.mass_per_length", 10.8, "cables.upper.mass_per_length", "= 1.10092 (given in N/m?)"),
        (
            "cables.upper.breaking_strength",
            1.8e4,
            "cables.upper.breaking_strength",
            "in the mean wind over the breaking",
        ),
        ("mast.mass", 0.055, "mast.mass", "mast.mass times 1000 (given in t/m?)"),
        ("mast.bending_stiffness", 2.4e10, "mast.bending_stiffness", "mast.bending_stiffness times 0.001"),
        ("mast.damping_ratio", 0.5, "mast.damping_ratio", "given in %?"),
        ("mast.drag_area", None, "mast.drag_area", "missing, or 0"),
        ("guy.1.count", None, "guy.1.count", "one guy at the level of 29 m (usual: at least 3"),
        ("guy.1.count", 2, "guy.1.count", "2 guys at the level of 29 m"),
        ("damping", {"ratio": 0.5}, "damping.ratio", "given in %?"),
        ("wind.ramp", 2.0, "wind.ramp", "longer than the run of 1 s"),
        ("wind.air_density", 0.3, "wind.air_density", "usual: 0.5 to 2 kg/m3"),
        ("ice", {"thickness": 0.001, "density": 9000.0}, "ice.density", "9e+03 kg/m3"),
    ],
)
def test_what_is_unusual_is_noted_and_warned_of(path, value, key, said):
    mapping = changed(path, value)
    if path == "ice":
        mapping["mast"]["diameter"] = 0.3
    if path == "damping":
        del mapping["wind"]  # with it these runs would be compiled once more
    scene = cp.make_scene(mapping)
    note = str(cp.mast.summary(scene).note.values)
    assert f"{key}: " in note, note
    assert said in note, note
    assert len(set(note.split("\n"))) == len(note.split("\n"))  # tables that guys share are noted once
    assert warned(cp.mast.summary, scene) == []  # which has the notes
    for function in (cp.mast.rest, cp.mast.frequencies, cp.mast.simulate):
        (only,) = warned(function, scene)
        assert str(only.message).startswith(f"{key}: "), only.message
        assert only.filename == __file__


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("guy.2.top_tension", 15.0, "; try: guy.2.top_tension = 15000 (given in kN?)"),
        ("guy.2.radius", 35000.0, "; try: guy.2.radius times 0.001 (given in mm?)"),
        ("mast.height", 60000.0, "; try: mast.height times 0.001 (given in mm?)"),
        ("mast.bending_stiffness", 2.4e4, "; try: mast.bending_stiffness times 1000 (given in kN m2?)"),
        ("wind.speed", 93.6, "given in km/h? 93.6 km/h are 26 m/s)"),
    ],
)
def test_a_refusal_that_a_unit_explains_tells_it(path, value, said):
    mapping = changed(path, value)
    if path == "wind.speed":
        mapping["mast"]["drag_area"] = 4.0
    with pytest.raises(cp.SceneError) as caught:
        cp.mast.rest(cp.make_scene(mapping))
    assert str(caught.value).endswith(said), caught.value


def test_ice_hides_no_unit_and_guys_without_a_count_are_told():
    mapping = put(changed("mast.mass", 0.055), "ice", {"thickness": 0.02})
    mapping["mast"] |= {"diameter": 0.06, "member_length": 8.0}  # 32 kg/m of ice
    assert "mast.mass times 1000 (given in t/m?)" in str(cp.summary(cp.make_scene(mapping)).note.values)
    mapping = changed("mast.bending_stiffness", 6e6)
    for guy in mapping["guy"]:
        del guy["count"]
    with pytest.raises(
        cp.SceneError, match=r"buckles .*; guy.1.count: the scene has one guy .* a missing count is 1\)$"
    ):
        cp.mast.rest(cp.make_scene(mapping))


def test_the_largest_tension_of_the_guys_of_a_table_is_noted():
    scene = cp.make_scene(changed("cables.upper.breaking_strength", 1.8e4))
    rest = cp.mast.rest(scene)
    largest = float(np.maximum(rest.guy_tension, rest.guy_tension_anchor)[3:].max())
    assert f"strength of {largest / 1.8e4:.3g} " in str(cp.mast.summary(scene).note.values)


def test_members_and_the_main_job_warn_once():
    mapping = changed("mast.mass", 0.055)
    scene = cp.make_scene(mapping)
    scenes = cp.ensemble.design(scene, {"guy.1.top_tension": [11000.0, 12000.0]}, members=3)
    for function, given in ((cp.mast.rest, scenes), (cp.mast.simulate, scenes)):
        (only,) = warned(function, given)
        assert str(only.message).startswith("mast.mass: ")
        assert only.filename == __file__
    line = inspect.currentframe().f_lineno + 1
    (only,) = warned(lambda: cp.study.run(scene))
    assert (only.filename, only.lineno) == (__file__, line)


def test_columns_stay_apart_where_the_strength_is_in_kilonewtons(tmp_path):
    tables = changed("cables.upper.breaking_strength", 150.0)
    rows = [line for line in printed(tmp_path, tables, "run").splitlines() if " deg " in line]
    assert len(rows) == 6
    for row, guy in zip(rows, json.loads(printed(tmp_path, tables, "run", "--json"))["guys"], strict=True):
        used = ">999" if guy["level"] == 56.0 else f"{100.0 * guy['utilisation']:.1f}"
        assert row.split()[-3:] == [f"{1e-3 * guy['fatigue_range']:.3f}", used, "%"]


def test_a_design_warns_once():
    mapping = changed("mast.drag_area", None)
    mapping["wind"]["turbulence"] = {"spectrum": "kaimal", "seed": 1}
    options = {"directions": [0.0, 1.0], "speeds": [20.0], "storms": 1}
    (only,) = warned(cp.study.design, cp.make_scene(mapping), **options)
    assert str(only.message).startswith("mast.drag_area: ")
    assert only.filename == __file__
