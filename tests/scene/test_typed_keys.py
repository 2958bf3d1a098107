"""The key that was typed is the one that is named, where another unit explains a warning or a refusal."""

from __future__ import annotations

import warnings

import pytest

import cablepod as cp

CABLE = {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "diameter": 0.016}


@pytest.mark.parametrize(("thickness", "right"), [(1.2, "0.0012"), (1.9, "0.0019")])
def test_ice_in_millimetres_is_named_by_its_own_key(thickness, right):
    ends = {"lower": [0.0, 0.0], "upper": [20.4, 57.7]}
    tree = {"cable": {**CABLE, "top_tension": 15000.0}, "ends": ends, "ice": {"thickness": thickness}}
    remedy = rf"; try: ice\.thickness = {right} \(given in mm\?\)"
    with pytest.warns(cp.UnusualSceneWarning, match=rf"^ice\.thickness: the scene has .*{remedy}; see"):
        cp.chain.simulate(cp.make_scene(tree), links=4, times=[0.0, 0.01], step=1e-3)
    assert str(cp.summary(cp.make_scene({**tree, "ice": {"thickness": 1e-3 * thickness}})).note.values) == ""


def test_an_inclination_in_radians_is_named_by_its_own_key():
    cable, chord = {**CABLE, "bottom_tension": 200.0}, {"lower": [0.0, 0.0], "chord": 61.2}
    remedy = r"; try: ends\.inclination = 70\.4738 \(given in rad\?\) or "
    with pytest.raises(cp.SceneError, match=rf"^cable\.bottom_tension: given 200\.0; allowed: at least .*{remedy}"):
        cp.make_scene({"cable": cable, "ends": {**chord, "inclination": 1.23}})
    cp.make_scene({"cable": cable, "ends": {**chord, "inclination": 70.4738}})
    downward = cp.make_scene({"cable": {**CABLE, "top_tension": 5000.0}, "ends": {**chord, "inclination": -1.2}})
    note = str(cp.summary(downward).note.values)
    assert note == "ends.inclination: an inclination of -1.2 degrees, an upper end 1.28 m below the lower one"


def test_a_chord_in_centimetres_is_named_by_its_own_key():
    cable = {**CABLE, "top_tension": 2000.0}
    with pytest.raises(cp.SceneError, match=r"; try: ends\.chord = 6 \(given in cm\?\)$"):
        cp.make_scene({"cable": cable, "ends": {"lower": [0.0, 0.0], "chord": 600.0, "inclination": 30.0}})


def test_temperatures_of_a_table_in_kelvins_are_named():
    cable = {**CABLE, "top_tension": 15000.0, "thermal_expansion": 1.15e-5}
    scene = cp.make_scene({"cable": cable, "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]}})
    message = r"^temperatures: given a temperature of 300 degC \(usual: up to 150 degC; kelvins\? 300 K are 26\.85 degC\); try:"
    with pytest.warns(cp.UnusualSceneWarning, match=message) as caught:
        cp.catenary.stringing(scene, [253.0, 300.0])
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cp.catenary.stringing(scene, [-20.0, 80.0])
