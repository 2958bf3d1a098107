"""What engineers have: axial stiffness, mass per length, chord and inclination, sag; the same scenes in other words."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
import xarray as xr
from mast_scenes import SMALL

import cablepod as cp

AREA = 1.25e-4
FULL = {
    "cable": {"youngs_modulus": 1.6e11, "area": AREA, "density": 8000.0, "top_tension": 15000.0},
    "ends": {"lower": [2.0, 1.0], "upper": [22.0, 51.0]},
    "motion": {"upper": {"x": {"kind": "ramp", "amplitude": -0.02, "duration": 1.0}}},
    "time": {"duration": 1.0, "interval": 0.25},
    "chain": {"links": 8},
}
SHORT = {
    **FULL,
    "cable": {"axial_stiffness": 1.6e11 * AREA, "mass_per_length": 8000.0 * AREA, "top_tension": 15000.0},
    "ends": {"lower": [2.0, 1.0], "chord": math.hypot(20.0, 50.0), "inclination": math.degrees(math.atan2(50.0, 20.0))},
}


def changed(mapping, **tables):
    result = copy.deepcopy(mapping)
    for table, values in tables.items():
        result[table] = {name: value for name, value in {**result[table], **values}.items() if value is not None}
    return result


def test_the_short_form_is_the_same_cable():
    full, short = cp.make_scene(FULL), cp.make_scene(SHORT)
    one, other = cp.chain.simulate(full), cp.chain.simulate(short)
    np.testing.assert_allclose(other.position, one.position, rtol=0, atol=1e-9)  # rounding of the upper end
    np.testing.assert_allclose(other.tension, one.tension, rtol=1e-7)
    numbers, others = cp.summary(full), cp.summary(short)
    for name in ("axial_stiffness", "mass_per_length", "chord", "inclination", "tension_lower", "unstretched_length"):
        assert float(others[name]) == pytest.approx(float(numbers[name]), rel=1e-12), name


def test_without_an_area_there_is_no_stress():
    full, short = cp.summary(cp.make_scene(FULL)), cp.summary(cp.make_scene(SHORT))
    assert float(full["stress"]) == pytest.approx(15000.0 / AREA)
    assert not {"stress", "density"} & set(short.data_vars)
    assert float(short["strain"]) == pytest.approx(float(full["strain"]), rel=1e-12)
    with_area = cp.summary(cp.make_scene(changed(SHORT, cable={"area": AREA})))
    assert float(with_area["stress"]) == pytest.approx(15000.0 / AREA)


def test_the_scene_keeps_what_was_given(tmp_path):
    scene = cp.make_scene(SHORT)
    given = {"cable_axial_stiffness", "cable_mass_per_length", "ends_chord", "ends_inclination"}
    assert given <= set(scene.data_vars)
    assert not {"cable_youngs_modulus", "cable_area", "cable_density", "ends_upper"} & set(scene.data_vars)
    units = [scene[name].attrs["units"] for name in sorted(given)]
    assert units == ["N", "kg m-1", "m", "degree"]
    cp.archive.write(scene, tmp_path / "scene.nc")
    again = cp.archive.read(tmp_path / "scene.nc")
    xr.testing.assert_identical(again.drop_attrs(), scene.drop_attrs())
    assert again.attrs["id"] == scene.attrs["id"] != cp.make_scene(FULL).attrs["id"]
    assert cp.chain.rest(again).equals(cp.chain.rest(scene))


def test_key_paths_and_files_give_the_same_scene(tmp_path):
    paths = {f"{table}.{key}": value for table in ("cable", "ends") for key, value in SHORT[table].items()}
    rest = {name: SHORT[name] for name in ("motion", "time", "chain")}
    assert cp.make_scene({**paths, **rest}).attrs["id"] == cp.make_scene(SHORT).attrs["id"]
    text = "[cable]\naxial_stiffness = 2e7\nmass_per_length = 1.0\nsag = 0.2\n[ends]\nlower = [0, 0]\n"
    (tmp_path / "guy.toml").write_text(text + "chord = 50.0\ninclination = 60.0\n")
    scene = cp.read_scene(tmp_path / "guy.toml")
    end = cp.catenary.rest(scene)["position"][-1]
    np.testing.assert_allclose(end, [25.0, 50.0 * math.sin(math.radians(60.0))], rtol=1e-12)


@pytest.mark.parametrize(
    ("angle", "end"),
    [(0.0, [50.0, 0.0]), (90.0, [0.0, 50.0]), (-90.0, [0.0, -50.0]), (-30.0, [43.30127018922193, -25.0])],
)
def test_the_inclination_is_the_angle_above_the_horizontal(angle, end):
    cable = {"axial_stiffness": 2e7, "mass_per_length": 1.0, "unstretched_length": 49.9}
    scene = cp.make_scene({"cable": cable, "ends": {"lower": [0.0, 0.0], "chord": 50.0, "inclination": angle}})
    np.testing.assert_allclose(cp.catenary.rest(scene)["position"][-1], end, rtol=1e-15, atol=1e-11)


def test_members_vary_the_new_keys():
    scene = cp.make_scene(SHORT)
    ranges = {
        "cable.axial_stiffness": [1e7, 3e7],
        "cable.mass_per_length": [0.8, 1.2],
        "ends.chord": [50.0, 56.0],
        "ends.inclination": [50.0, 70.0],
        "cable.top_tension": [9e3, 2e4],
    }
    members = cp.ensemble.design(scene, ranges, members=5, seed=2)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    together = cp.condensed.simulate(members, modes, step=1e-3)
    for k in range(5):
        values = members.isel(member=k)
        cable = {name: float(values[f"cable_{name}"]) for name in SHORT["cable"]}
        ends = {"lower": [2.0, 1.0], **{name: float(values[f"ends_{name}"]) for name in ("chord", "inclination")}}
        single = cp.condensed.simulate(cp.make_scene({**SHORT, "cable": cable, "ends": ends}), modes, step=1e-3)
        np.testing.assert_allclose(together.position[k], single.position, rtol=0, atol=1e-9)


def test_assigned_keys_are_read_and_two_ways_refused():
    scene = cp.make_scene(SHORT)
    softer = scene.assign(cable_axial_stiffness=1e7)
    assert float(cp.summary(softer)["axial_stiffness"]) == 1e7
    with pytest.raises(
        cp.SceneError, match=r"^cable: given youngs_modulus = .* and axial_stiffness = .*; allowed: exactly one"
    ):
        cp.chain.rest(scene.assign(cable_youngs_modulus=1.6e11, cable_area=AREA))
    with pytest.raises(
        cp.SceneError, match=r"^ends: given upper = .* and chord = .*; allowed: upper, or chord with inclin"
    ):
        cp.chain.rest(scene.assign(ends_upper=("coordinate", [22.0, 51.0])))


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        (
            {"cable": {"youngs_modulus": 1.6e11}},
            r"^cable: given youngs_modulus = 160000000000.0 and axial_stiffness = 20000000.0; allowed: exactly one",
        ),
        (
            {"cable": {"density": 8000.0}},
            r"^cable: given density = 8000.0 and mass_per_length = 1.0; allowed: exactly one of specific_weight, density, mass",
        ),
        (
            {"cable": {"mass_per_length": None, "density": 8000.0}},
            r"^cable\.area: missing; allowed: area of the unstrained cross-section \[m2\], or cable\.mass_per_length in place of",
        ),
        ({"cable": {"axial_stiffness": None}}, r"^cable\.youngs_modulus: missing; allowed: Young's modulus \[Pa\], or "),
        ({"cable": {"axial_stiffness": 1e19}}, r"^cable\.axial_stiffness: given 1e\+19; allowed: an axial stiffness of 1e-6"),
        ({"cable": {"mass_per_length": 1e16}}, r"^cable\.mass_per_length: given 1e\+16; allowed: 1e-15 to 1e15 kg/m"),
        ({"cable": {"axial_stiffness": -1.0}}, r"^cable\.axial_stiffness: given -1.0; allowed: a finite number above 0$"),
        ({"cable": {"sag": 0.1}}, r"^cable: given top_tension = 15000.0 and sag = 0.1; allowed: exactly one of top_tension, "),
        ({"ends": {"upper": [22.0, 51.0]}}, r"^ends: given upper = \[22.0, 51.0\] and chord = .* and inclination = "),
        ({"ends": {"chord": None}}, r"^ends\.chord: missing; allowed: distance of the upper end from the lower one \[m\], or"),
        ({"ends": {"inclination": None}}, r"^ends\.inclination: missing; allowed: angle of the chord above the horizontal, .*"),
        ({"ends": {"inclination": 91.0}}, r"^ends\.inclination: given 91.0; allowed: a finite number of at least -90 and of at"),
        ({"ends": {"chord": 1e10}}, r"^ends\.chord: given 10000000000.0; allowed: a chord from 1e-06 m to 1e\+09 m"),
        ({"ends": {"lower": [0.0, 0.0, 0.0]}}, r"^ends\.chord: given .*; allowed: a planar scene, .*; try: ends\.upper$"),
    ],
)  # fmt: skip
def test_wrong_ways_are_refused_by_key(tables, message):
    with pytest.raises(cp.SceneError, match=message):
        cp.make_scene(changed(SHORT, **tables))


def test_a_number_in_another_unit_is_suggested():
    scene = cp.make_scene(changed(SHORT, cable={"axial_stiffness": 2e4}))  # kN
    assert "cable.axial_stiffness = 2e+07 (given in kN?)" in str(cp.summary(scene)["note"].values)
    assert str(cp.summary(cp.make_scene(SHORT))["note"].values) == ""


def test_guys_of_a_mast_take_them_too():
    full, short = copy.deepcopy(SMALL), copy.deepcopy(SMALL)
    short["cables"]["guy"] = {"axial_stiffness": 1.6e11 * 3.8e-5, "mass_per_length": 8000.0 * 3.8e-5, "diameter": 0.008}
    one, other = cp.mast.rest(cp.make_scene(full)), cp.mast.rest(cp.make_scene(short))
    np.testing.assert_allclose(other["guy_length"], one["guy_length"], rtol=1e-14)
    cable = {"axial_stiffness": 1.6e11 * 3.8e-5, "mass_per_length": 8000.0 * 3.8e-5, "sag": 0.1}
    guy = cp.make_scene({"cable": cable, "ends": {"lower": [20.0, 0.0], "upper": [0.0, 28.0]}})
    by_sag = copy.deepcopy(short)
    del by_sag["guy"][0]["top_tension"]
    by_sag["guy"][0]["sag"] = 0.1
    length = float(cp.catenary.rest(guy)["unstretched_length"])
    np.testing.assert_allclose(cp.mast.rest(cp.make_scene(by_sag))["guy_length"], length, rtol=1e-14)
    by_sag["guy"][0]["sag"] = 1e-9
    with pytest.raises(cp.SceneError, match=r"^guy\.1\.sag: given 1e-09; allowed: a strain of at most 10 at rest"):
        cp.make_scene(by_sag)
    del short["cables"]["guy"]["axial_stiffness"]
    with pytest.raises(
        cp.SceneError, match=r"^cables\.guy\.youngs_modulus: missing; allowed: .*, or cables\.guy\.axial_"
    ):
        cp.make_scene(short)
    members = cp.ensemble.design(cp.make_scene(full), {"guy.1.top_tension": [4e3, 6e3, 2]})
    assert np.isfinite(cp.mast.rest(members.isel(member=1))["guy_length"]).all()
