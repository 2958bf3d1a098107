"""The cable of a given sag, against catenaries of fifty digits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from references import catenary_mpmath as reference

import cablepod as cp

#: Span, rise [m], load [N/m], stiffness [N], unstretched over chord: taut to slack, level and steep, stiff and soft.
CABLES = [
    (100.0, 0.0, 9.81, 2e7, 0.9995),
    (100.0, 0.0, 9.81, 2e7, 1.0),
    (100.0, 0.0, 9.81, 2e7, 3.0),
    (20.4, 57.7, 9.8125, 2e7, 0.999),
    (20.4, -57.7, 9.8125, 2e7, 1.02),
    (20.4, 57.7, 9.8125, 2e7, 1.2),
    (400.0, 150.0, 25.0, 8e7, 0.998),
    (1.0, 50.0, 4.0, 1e6, 1.001),
    (8.0, 6.0, 9.81, 2e3, 0.8),
    (8.0, 6.0, 0.01, 1e9, 0.99999),
]


def scene_of(a, b, q, k, sag, **tables):
    cable = {"axial_stiffness": k, "mass_per_length": q / 10.0, "sag": sag}
    return cp.make_scene({"gravity": 10.0, "cable": cable, "ends": {"lower": [0.0, 0.0], "upper": [a, b]}, **tables})


@pytest.mark.parametrize("case", CABLES, ids=str)
def test_a_sag_gives_the_cable_of_fifty_digits(case):
    a, b, q, k, ratio = case
    cable = reference.from_length(a, b, q, k, ratio * math.hypot(a, b))
    sag = reference.sag(cable)
    scene = scene_of(a, b, q, k, float(sag))
    rest = cp.catenary.rest(scene)
    # a rounding of the sag, and one of the length times K/T, the condition of the forces on the length
    for name, value in zip(
        ("unstretched_length", "horizontal_force", "tension_lower", "tension_upper"),
        (cable.length, cable.force, cable.tension(0), cable.tension(cable.length)),
        strict=True,
    ):
        assert float(abs(float(rest[name]) / value - 1)) < 1e-12, name
    assert float(cp.summary(scene)["sag_below_chord"]) == pytest.approx(
        float(sag), rel=1e-11
    )  # rounded forces of taut cables


@pytest.mark.parametrize("sag", [1e-6, 1e-3, 1.0, 30.0, 1e4, 1e8])
def test_the_sag_of_the_result_is_the_given_one(sag):
    rest = cp.catenary.rest(scene_of(30.0, 40.0, 9.81, 1e12, sag))
    # of its force, which has the condition of the sag, where a length has K/T times that
    cable = reference.from_quantity(30.0, 40.0, 9.81, 1e12, 2, float(rest["horizontal_force"]))
    assert float(reference.sag(cable)) == pytest.approx(sag, rel=1e-12)


def test_a_summary_tells_both_sags():
    numbers = cp.summary(scene_of(30.0, 40.0, 9.81, 2e7, 0.7))
    assert float(numbers["sag"]) == pytest.approx(0.6 * 0.7, rel=1e-12)  # cosine of the chord's inclination


def test_members_of_given_sags_are_those_of_single_scenes():
    scene = scene_of(30.0, 40.0, 9.81, 2e7, 0.5, time={"duration": 0.2, "interval": 0.1}, chain={"links": 12})
    members = cp.ensemble.design(scene, {"cable.sag": [0.2, 2.0, 4], "cable.axial_stiffness": [1e7, 3e7, 2]})
    modes = cp.condensed.vibration_modes(scene, rank=2)
    many = cp.condensed.simulate(members, modes, step=1e-3)
    for k in range(members.sizes["member"]):
        one = cp.condensed.simulate(members.isel(member=k), modes, step=1e-3)
        np.testing.assert_allclose(many.position[k], one.position, rtol=0, atol=1e-9)  # batch and single: rounding
    rest = cp.catenary.rest(members)
    below = cp.summary(members)["sag_below_chord"]
    np.testing.assert_allclose(below, members["cable_sag"], rtol=1e-12)
    assert float(rest["unstretched_length"].min()) < float(rest["unstretched_length"].max())


def test_the_sag_is_that_without_ice():
    bare = scene_of(30.0, 40.0, 9.81, 2e7, 0.5)
    cable = {"axial_stiffness": 2e7, "mass_per_length": 0.981, "sag": 0.5, "diameter": 0.02}
    ends = {"lower": [0.0, 0.0], "upper": [30.0, 40.0]}
    iced = cp.make_scene({"gravity": 10.0, "cable": cable, "ends": ends, "ice": {"thickness": 0.01}})
    lengths = [float(cp.catenary.rest(scene)["unstretched_length"]) for scene in (bare, iced)]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-15)
    assert float(cp.summary(iced)["sag_below_chord"]) > 0.55


@pytest.mark.parametrize(
    ("a", "q", "sag", "message"),
    [
        (0.0, 9.81, 0.5, r"^cable\.sag: given 0\.5; allowed: a tension or a length, as the chord lies along the load"),
        (
            30.0,
            0.0,
            0.5,
            r"^cable\.sag: given 0\.5; allowed: a tension or a length, as a cable without load has no sag$",
        ),
        (30.0, 9.81, -0.5, r"^cable\.sag: given -0\.5; allowed: a finite number above 0$"),
        # by hand: at T = 10 K the weight of c / 11 hangs by 9.81 c / 11 c / (8 T)
        (30.0, 9.81, 1e-9, r"^cable\.sag: given 1e-09; allowed: at least 0\.000139\d+ m, .* strained by 10"),
    ],
)
def test_a_sag_that_no_length_gives_is_refused(a, q, sag, message):
    cable = {"axial_stiffness": 2e5, "mass_per_length": 0.981, "sag": sag}
    ends = {"lower": [0.0, 0.0], "upper": [a, 40.0]}
    with pytest.raises(cp.SceneError, match=message):
        cp.make_scene({"gravity": q / 0.981, "cable": cable, "ends": ends})


def test_the_least_sag_is_that_of_the_tightest_cable():
    cable = {"axial_stiffness": 2e5, "mass_per_length": 0.981, "sag": 1e-9}
    ends = {"lower": [0.0, 0.0], "upper": [30.0, 40.0]}
    with pytest.raises(cp.SceneError) as refused:
        cp.make_scene({"cable": cable, "ends": ends})
    least = float(str(refused.value).split("at least ")[1].split(" m")[0])
    cp.make_scene({"cable": {**cable, "sag": 1.001 * least}, "ends": ends})
    strain = float(cp.summary(cp.make_scene({"cable": {**cable, "sag": 1.001 * least}, "ends": ends}))["strain"])
    assert strain == pytest.approx(10.0, rel=2e-3)
