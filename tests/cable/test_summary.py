"""Numbers of a summary against formulas, other functions of the package, and each other."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
import xarray as xr
from references import irvine
from scenes import SOFT, spatial

import cablepod as cp
from cablepod import examples

GUY = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 7850.0, "top_tension": 15000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [60.0, 0.0]},
    "load": {"uniform": [3.0, -2.0]},
}


def test_every_number_has_units_and_a_long_name():
    for scene in (cp.make_scene(SOFT), cp.ensemble.design(cp.make_scene(SOFT), {"gravity": [9.0, 10.0]}, members=3)):
        numbers = cp.summary(scene)
        for name, variable in numbers.variables.items():
            assert variable.attrs["long_name"], name
            assert variable.attrs["units"], name
        assert numbers.attrs["stage"] == "summary"


def test_numbers_of_the_scene_as_given():
    scene = examples.scene("example4")
    numbers = cp.summary(scene)
    assert float(numbers.chord) == pytest.approx(math.hypot(20.4, 57.7), rel=1e-14)
    assert float(numbers.inclination) == pytest.approx(math.atan2(57.7, 20.4), rel=1e-14)
    assert float(numbers.weight_per_length) == pytest.approx(78500.0 * 1.25e-4, rel=1e-14)
    assert float(numbers.mass_per_length) == pytest.approx(78500.0 * 1.25e-4 / 9.81, rel=1e-14)
    assert float(numbers.axial_stiffness) == pytest.approx(1.6e11 * 1.25e-4, rel=1e-14)
    assert float(numbers.stress) == pytest.approx(7500.0 / 1.25e-4, rel=1e-12)
    assert float(numbers.strain) == pytest.approx(7500.0 / 2e7, rel=1e-12)
    assert float(numbers.load_over_weight) == pytest.approx(1.5, rel=1e-12)
    assert float(numbers.motion_over_chord) == pytest.approx(0.14 / math.hypot(20.4, 57.7), rel=1e-14)
    rest = cp.catenary.rest(scene)
    for name in ("unstretched_length", "stretched_length", "tension_lower", "tension_upper", "horizontal_force"):
        assert float(numbers[name]) == float(rest[name])


def test_the_sag_is_that_of_the_shape():
    for name in ("example2", "sagging", "slack_cable"):
        scene = examples.scene(name)
        position = cp.catenary.rest(scene, points=20001).position.values
        chord = position[-1] - position[0]
        across = np.array([-chord[1], chord[0]]) / np.hypot(*chord)
        # between 20001 points a parabola rises by (1/20000)^2 of its height, and more where the slack cable turns
        assert float(cp.summary(scene).sag) == pytest.approx(np.abs((position - position[0]) @ across).max(), rel=1e-8)


def test_sag_and_frequencies_of_a_taut_level_cable():
    # H = T to (q L / 2 T)^2 / 2; sag q L^2 / 8 H; Irvine's theory is of the first order in the sag ratio squared
    mapping = {**GUY, "load": {"uniform": [0.0, 0.0]}}
    numbers = cp.summary(cp.make_scene(mapping))
    weight, chord, tension = 7850.0 * 1.25e-4 * 9.81, 60.0, float(numbers.horizontal_force)
    assert float(numbers.sag) == pytest.approx(weight * chord**2 / (8.0 * tension), rel=2e-3)  # the strain, 0.08 %
    mu = float(numbers.mass_per_length)
    string = math.pi / chord * math.sqrt(tension / mu)
    expected = string * np.arange(1, 4)
    np.testing.assert_allclose(numbers.angular_frequency_out_of_plane, expected, rtol=1e-3)
    # even modes in the plane do not feel the sag
    assert float(numbers.angular_frequency_in_plane[1]) == pytest.approx(2.0 * string, rel=1e-3)
    squared = float(numbers.irvine_parameter)
    assert squared == pytest.approx((weight * chord / tension) ** 2 * 2e7 / tension, rel=3e-3)
    first = irvine.symmetric_roots(squared, 1)[0] * string / math.pi
    assert float(numbers.angular_frequency_in_plane[0]) == pytest.approx(first, rel=2e-3)
    axial = math.pi / float(numbers.unstretched_length) * math.sqrt(2e7 / mu)
    assert float(numbers.first_axial_frequency) == pytest.approx(axial, rel=1e-12)
    for name in ("in_plane", "out_of_plane"):
        np.testing.assert_array_equal(
            numbers[f"frequency_{name}"], numbers[f"angular_frequency_{name}"] / (2.0 * np.pi)
        )
    assert float(numbers.first_axial_frequency_hertz) == pytest.approx(axial / (2.0 * np.pi), rel=1e-12)


@pytest.mark.parametrize("point_loads", [[], [{"arc_length": 0.3, "force": [40.0, -200.0]}]])
def test_frequencies_are_those_of_the_cable_in_space(point_loads):
    # a wind load turns the plane of chord and load out of the vertical; all modes of the spatial scene, told apart by shape
    mapping = spatial({**copy.deepcopy(GUY), "point_load": point_loads})
    if not point_loads:
        mapping["load"]["uniform"][2] = 12.0
        mapping["ends"]["upper"] = [40.0, 30.0, 20.0]
    scene = cp.make_scene(mapping)
    numbers = cp.summary(scene)
    modes = cp.cable.frequencies(scene, count=6, law="linear")
    out = modes.out_of_plane_share.values > 0.5
    for name, chosen in (("out_of_plane", out), ("in_plane", ~out)):
        values = modes.angular_frequency.values[chosen][:2]
        assert values.size == 2
        np.testing.assert_allclose(numbers[f"angular_frequency_{name}"].values[:2], values, rtol=1e-7)


def test_members_have_the_numbers_of_their_scenes():
    scene = cp.make_scene({**SOFT, "cable": {**SOFT["cable"], "breaking_strength": 1e6}})
    scenes = cp.ensemble.design(scene, {"cable.top_tension": [200.0, 300.0], "ends.upper.x": [7.0, 8.5]}, members=3)
    numbers = cp.summary(scenes)
    assert numbers.stress.dims == ("member",)
    assert numbers.angular_frequency_in_plane.dims == ("member", "mode")
    assert {"cable_top_tension", "ends_upper_x"} <= set(numbers.coords)
    for member in range(3):
        single = cp.summary(scenes.isel(member=member, drop=True))
        xr.testing.assert_equal(numbers.isel(member=member).drop_vars(set(numbers.coords) - {"mode"}), single)


def test_utilisation_only_where_a_strength_is_given():
    assert "utilisation" not in cp.summary(cp.make_scene(GUY))
    steep = {**GUY, "ends": {"lower": [0.0, 0.0], "upper": [20.0, 50.0]}}
    cable = {**GUY["cable"], "breaking_strength": 60000.0}
    assert float(cp.summary(cp.make_scene({**steep, "cable": cable})).utilisation) == pytest.approx(0.25, rel=1e-12)


def test_notes_are_lines_of_a_text():
    cable = {**GUY["cable"], "density": 7.85, "breaking_strength": 60.0}
    lines = str(cp.summary(cp.make_scene({**GUY, "cable": cable})).note.values).split("\n")
    assert {"cable.breaking_strength", "cable.density"} <= {line.partition(":")[0] for line in lines}
    assert len(lines) == len(set(lines))
    assert str(cp.summary(cp.make_scene(GUY)).note.values) == ""


@pytest.mark.parametrize(
    "changes",
    [
        {"gravity": 0.0, "load": {"uniform": [0.0, 0.0]}},  # a string without load
        {"ends": {"lower": [0.0, 0.0], "upper": [0.0, 60.0]}, "load": {"uniform": [0.0, 0.0]}},  # vertical
        {"ends": {"lower": [0.0, 0.0, 0.0], "upper": [0.0, 60.0, 0.0]}, "load": {"uniform": [0.0, 0.0, 0.0]}},
        {"ends": {"lower": [0.0, 0.0], "upper": [60.0, 0.0], "free": "upper"}},
    ],
    ids=["weightless", "vertical", "vertical in space", "free end"],
)
def test_degenerate_scenes(changes):
    numbers = cp.summary(cp.make_scene({**GUY, **changes}))
    assert np.isfinite(numbers.sag)
    free = "free" in changes.get("ends", {})
    for name in ("in_plane", "out_of_plane"):
        values = numbers[f"angular_frequency_{name}"].values
        assert np.isnan(values).all() if free else (values > 0.0).all()
    if not free:  # a straight string: both sets are the same
        np.testing.assert_allclose(
            numbers.angular_frequency_in_plane, numbers.angular_frequency_out_of_plane, rtol=1e-6
        )


def test_what_is_no_scene_is_refused():
    with pytest.raises(cp.SceneError, match=r"^scene: given an int; allowed: what make_scene gives$"):
        cp.summary(5)


def test_a_summary_is_archived(tmp_path):
    numbers = cp.summary(cp.make_scene({**GUY, "cable": {**GUY["cable"], "density": 7.85}}))
    cp.archive.write(numbers, tmp_path / "summary.nc")
    xr.testing.assert_equal(cp.archive.read(tmp_path / "summary.nc"), numbers)
