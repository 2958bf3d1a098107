"""Small vibrations and rest of a cable with segments and attachments, against closed forms of taut strings and statics."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from printed import printed
from references.damped_string import (
    LENGTH,
    MASS,
    SPEED,
    STIFFNESS,
    TAUT,
    UNSTRETCHED,
    damper,
    roots_with_damper,
    string,
)

import cablepod as cp

#: Forty elements have nodes enough for the first vibrations to be limited by rounding and, with a lumped mass, by its axial
#: stretch of order T / K; what is asked for is 1e-4.
RTOL = 1e-6
#: A guy of two parts with an insulator between them.
GUY: dict[str, Any] = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "top_tension": 15000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "segment": [{"to": 0.35}, {"from": 0.35, "youngs_modulus": 1.1e11, "area": 9e-5, "density": 7000.0}],
    "attachment": [{"distance_from_lower": 0.5, "mass": 60.0}],
}


@pytest.mark.parametrize(("place", "kappa"), [(0.02, 1.0), (0.05, 0.3), (0.1, 3.0)])
def test_shape_with_a_damper(place: float, kappa: float) -> None:
    eta = kappa / (math.pi * place)
    found = cp.cable.frequencies(string(attachment=[damper(place, eta)]), count=1, elements=40, law="linear")
    (exact,) = roots_with_damper(place, eta, 1)
    # a sine of the complex root below the damper
    shape = (found.mode_shape + 1j * found.mode_shape_imaginary).isel(coordinate=1).values[0]
    sine = np.sin(exact * found.arc_length.values / UNSTRETCHED)
    below = slice(1, 1 + int(np.searchsorted(found.arc_length.values, place * UNSTRETCHED, side="right") - 1))
    above = slice(below.stop, -1)
    other = np.sin(exact * (1.0 - found.arc_length.values / UNSTRETCHED))
    for part, values in ((below, sine), (above, other)):
        ratio = shape[part] / values[part]
        assert ratio == pytest.approx(np.full(ratio.size, ratio[0]) if ratio.size else ratio, rel=RTOL)


def test_dampers_of_both_ends_add_up_where_they_are_weak() -> None:
    # the ratios of weak dampers are c phi^2 / (2 omega), which add; the rest is of third order in eta a / l
    one, other = (
        cp.cable.frequencies(string(attachment=list(set_)), count=3, law="linear")
        for set_ in ([damper(0.1, 0.01)], [damper(0.7, 0.02)])
    )
    both = cp.cable.frequencies(string(attachment=[damper(0.1, 0.01), damper(0.7, 0.02)]), count=3, law="linear")
    assert both.damping_ratio.values == pytest.approx(one.damping_ratio.values + other.damping_ratio.values, rel=1e-3)


def test_damper_across_the_plane_damps_the_vibrations_there() -> None:
    found = cp.cable.frequencies(
        string(spatial=True, attachment=[damper(0.05, 3.0, [0.0, 0.0, 2.0])]), count=6, law="linear"
    )
    across = np.sqrt((np.abs(found.mode_shape + 1j * found.mode_shape_imaginary) ** 2).mean("particle"))
    is_across = across.sel(coordinate="z").values > 0.5
    exact = roots_with_damper(0.05, 3.0, 3)
    assert found.damping_ratio.values[is_across] == pytest.approx(exact.imag / np.abs(exact), rel=RTOL)
    assert found.damping_ratio.values[~is_across] == pytest.approx([0.0] * 3, abs=1e-12)
    assert found.angular_frequency.values[~is_across] == pytest.approx(
        math.pi * np.arange(1, 4) * SPEED / LENGTH, rel=RTOL
    )


def test_overdamped_motion_is_left_out() -> None:
    # at the middle the symmetric vibrations of beta l obey cot(beta l / 2) = -i eta / 2; above eta = 2 the first only decays
    found = cp.cable.frequencies(string(attachment=[damper(0.5, 3.0)]), count=2, law="linear")
    exact = 2.0 * math.pi + 1j * math.log((3.0 + 2.0) / (3.0 - 2.0))
    assert found.angular_frequency.values == pytest.approx(
        np.array([2.0 * math.pi, abs(exact)]) * SPEED / LENGTH, rel=RTOL
    )
    assert found.damping_ratio.values == pytest.approx([0.0, exact.imag / abs(exact)], rel=RTOL, abs=1e-12)


def test_members_without_a_damper_have_a_ratio_of_zero() -> None:
    scenes = cp.ensemble.design(
        string(attachment=[damper(0.05, 1.0)]), {"attachment.1.damper": [0.0, 100.0]}, members=2, sampling="list"
    )
    found = cp.cable.frequencies(scenes, count=2, elements=4, law="linear")
    assert found.damping_ratio.values[0].tolist() == [0.0, 0.0]
    assert (found.damping_ratio.values[1] > 1e-4).all()


@pytest.mark.parametrize("law", ["linear", "green"])
def test_equal_parts_are_one(law: str) -> None:
    # they differ in a diameter, on which nothing depends in still air
    parts = [{"to": 0.4, "diameter": 0.01}, {"diameter": 0.02}]
    one, two = (
        cp.cable.frequencies(cp.make_scene({**GUY, "attachment": [], "segment": parts_}), count=4, law=law)
        for parts_ in ([], parts)
    )
    assert two.angular_frequency.values == pytest.approx(one.angular_frequency.values, rel=1e-9)


def test_rest_by_the_linear_law_is_the_catenary_of_pieces() -> None:
    for length in ({"top_tension": 15000.0}, {"unstretched_length": 63.0}):
        cable = {name: value for name, value in GUY["cable"].items() if name != "top_tension"}
        scene = cp.make_scene({**GUY, "cable": {**cable, **length}})
        rest, exact = cp.cable.rest(scene, law="linear"), cp.catenary.rest(scene)
        assert np.abs(rest.position - exact.position).max() < 1e-9 * float(exact.unstretched_length)
        # tensions by strains have the rounding of positions over the distance of nodes, times EA
        assert float(rest.tension_upper) == pytest.approx(float(exact.tension_upper), rel=1e-7)
        assert float(rest.tension_lower) == pytest.approx(float(exact.tension_lower), rel=1e-7)


def test_forces_at_rest_by_law_21_balance_in_each_part() -> None:
    rest = cp.cable.rest(cp.make_scene(GUY), points="nodes", elements=8)
    assert float(rest.residual) < 1e-9 * 15000.0
    lower, upper = rest.position.values[[0, -1]]
    ends = rest.position.values
    below = (ends[1] - lower) / np.linalg.norm(ends[1] - lower) * float(rest.tension_lower)
    above = (upper - ends[-2]) / np.linalg.norm(upper - ends[-2]) * float(rest.tension_upper)
    length = float(rest.unstretched_length)
    weight = 9.81 * (length * (0.35 * 1.0 + 0.65 * 9e-5 * 7000.0) + 60.0)
    # directions of chords between nodes near the ends: of first order in their distance, 1e-3 of the weight
    assert above - below == pytest.approx([0.0, weight], abs=5e-3 * weight)


@pytest.mark.parametrize(
    ("tables", "what"),
    [
        ({"attachment": [{"arc_length": 0.1, "mass": 1.0}, {"arc_length": 0.7, "mass": 1.0}]}, "attachment"),
        ({"segment": [{"to": 0.2}, {"to": 0.6, "area": 2e-4}, {"area": 3e-4}]}, "end of a segment"),
    ],
)
def test_fewer_elements_than_parts_are_refused(tables: dict[str, Any], what: str) -> None:
    with pytest.raises(cp.SceneError, match=rf"elements: given 2; allowed: at least 3, so that every {what} is on"):
        cp.cable.frequencies(string(**tables), elements=2)


# --- summary ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spatial", [False, True])
def test_summary_has_numbers_of_all_parts(spatial: bool) -> None:
    attached = [*GUY["attachment"], {"distance_from_upper": 6.0, "damper": 400.0, "direction": "normal"}]
    ends = {end: [*place, 0.0] if spatial else place for end, place in GUY["ends"].items()}
    guy = {**GUY, "attachment": attached, "ends": ends}
    numbers = cp.summary(cp.make_scene(guy))
    planar = cp.make_scene({**guy, "ends": GUY["ends"]})
    found = cp.cable.frequencies(planar, count=3, law="linear")
    assert numbers.angular_frequency_in_plane.values == pytest.approx(found.angular_frequency.values, rel=1e-7)
    assert numbers.damping_ratio_in_plane.values == pytest.approx(found.damping_ratio.values, rel=1e-6)
    assert (numbers.damping_ratio_in_plane > 1e-3).all()
    assert numbers.damping_ratio_out_of_plane.values == pytest.approx([0.0] * 3, abs=1e-12)
    rest = cp.catenary.rest(planar, points=4001)
    along = rest.position.values[-1] / np.linalg.norm(rest.position.values[-1])
    off = np.abs(rest.position.values @ [-along[1], along[0]])
    assert float(numbers.sag) == pytest.approx(off.max(), rel=1e-5)  # the chord of points cuts its kink
    lower = rest.arc_length.values < 0.35 * float(rest.unstretched_length)
    tension = rest.tension.values
    largest = tension[lower].max(), tension[~lower].max()
    # the tension at the end of the lower segment is that of the next point to 4000th of its rise
    assert float(numbers.stress) == pytest.approx(max(largest[0] / 1.25e-4, largest[1] / 9e-5), rel=1e-6)
    assert float(numbers.strain) == pytest.approx(max(largest[0] / 2e7, largest[1] / (1.1e11 * 9e-5)), rel=1e-6)


def test_summary_has_the_first_axial_frequency_of_a_bar_with_a_mass() -> None:
    numbers = cp.summary(string(attachment=[{"arc_length": 0.5, "mass": MASS * LENGTH}]))
    speed = math.sqrt(STIFFNESS / (MASS * LENGTH / UNSTRETCHED))
    assert float(numbers.first_axial_frequency) == pytest.approx(0.5477054 * math.pi * speed / UNSTRETCHED, rel=1e-6)


def test_check_prints_damping_ratios(tmp_path: Path) -> None:
    lines = printed(tmp_path, {**TAUT, "attachment": [damper(0.5, 0.2)]}).splitlines()
    (line,) = (
        line for line in lines if line.startswith("  their damping ratios")
    )  # none across the damper, where all are 0
    assert line.endswith("% by dampers alone")
    first, second, _ = line.split("ratios")[1].split("%")[0].split()
    # cot(beta l / 2) = -i eta / 2
    root = math.pi + 1j * math.log((2.0 + 0.2) / (2.0 - 0.2))
    assert float(first) == pytest.approx(100.0 * root.imag / abs(root), rel=1e-4)
    assert float(second) == 0.0


def test_stringing_table_has_the_numbers_of_all_parts() -> None:
    strong = {"breaking_strength": 1e5}
    parts = [{**GUY["segment"][0], **strong}, {**GUY["segment"][1], "breaking_strength": 2e4}]
    attached = [*GUY["attachment"], damper(0.9, 1.0)]
    guy = {**GUY, "segment": parts, "attachment": attached, "cable": {**GUY["cable"], "thermal_expansion": 1.2e-5}}
    scene = cp.make_scene(guy)
    stringing = cp.catenary.stringing(scene, [20.0, -10.0])
    for temperature in (-10.0, 20.0):
        numbers = cp.summary(cp.make_scene({**guy, "temperature": temperature}))
        at = stringing.sel(temperature=temperature)
        for name in ("tension_upper", "tension_lower", "utilisation", "horizontal_force"):
            assert float(at[name]) == pytest.approx(float(numbers[name]), rel=1e-12)
        assert float(at.sag) == pytest.approx(float(numbers.sag_below_chord), rel=1e-12)
    assert float(numbers.utilisation) == pytest.approx(15000.0 / 2e4, rel=1e-12)  # 0.15 of the strong lower part
    assert stringing.angular_frequency.values[0] == pytest.approx(
        cp.cable.frequencies(scene, count=stringing.sizes["mode"], law="linear").angular_frequency.values, rel=1e-9
    )
