"""Keys of wind and ice: refusals by key, ice after tensioning."""

from __future__ import annotations

import numpy as np
import pytest
from wind_scenes import GUY, KAIMAL, WIND

import cablepod as cp

SWAY = {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 2.0}}}


def wrong(**changes):
    tables = {**GUY, "wind": dict(KAIMAL)}
    for path, value in changes.items():
        target = tables
        *parents, name = path.split("__")
        for parent in parents:
            target[parent] = dict(target.get(parent, {}))
            target = target[parent]
        if value is None:
            target.pop(name)
        else:
            target[name] = value
    return tables


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"wind__speed": -1.0}, "wind.speed"),
        ({"wind__speed": float("nan")}, "wind.speed"),
        ({"wind__speed": float("inf")}, "wind.speed"),
        ({"wind__speed": None}, "wind.speed"),
        ({"wind__direction": None}, "wind.direction"),
        ({"wind__direction": [0.0, 1.0, 0.0]}, "wind.direction"),
        ({"wind__direction": [1.0, 0.1, 0.0]}, "wind.direction"),
        ({"wind__direction": [0.0, 0.0, 0.0]}, "wind.direction"),
        ({"wind__direction": [1.0, 0.0]}, "wind.direction"),
        ({"wind__profile": "linear"}, "wind.profile"),
        ({"wind__profile": "power"}, "wind.exponent"),
        ({"wind__exponent": 0.2}, "wind.exponent"),
        ({"wind__roughness_length": 0.0}, "wind.roughness_length"),
        ({"wind__roughness_length": 12.0, "wind__reference_height": 50.0}, "wind.roughness_length"),
        ({"wind__reference_height": 0.01}, "wind.reference_height"),
        ({"wind__air_density": 0.0}, "wind.air_density"),
        ({"wind__ramp": -1.0}, "wind.ramp"),
        ({"wind__gusts": 1.0}, "wind.gusts"),
        ({"wind__turbulence": "strong"}, "wind.turbulence"),
        ({"wind__turbulence__spectrum": "bogus"}, "wind.turbulence.spectrum"),
        ({"wind__turbulence__spectrum": None}, "wind.turbulence.spectrum"),
        ({"wind__turbulence__spectrum": "von_karman"}, "wind.turbulence.intensity"),
        ({"wind__turbulence__intensity": 0.2}, "wind.turbulence.intensity"),
        ({"wind__turbulence__decay": [10.0]}, "wind.turbulence.decay"),
        ({"wind__turbulence__seed": 1.5}, "wind.turbulence.seed"),
        ({"wind__turbulence__interval": 0.2}, "wind.turbulence.interval"),
        ({"wind__turbulence__interval": 0.0}, "wind.turbulence.interval"),
        ({"wind__turbulence__sed": 1}, "wind.turbulence.sed"),
        ({"wind": 3.0}, "wind"),
        ({"cable__diameter": None}, "cable.diameter"),
        ({"cable__diameter": 0.0}, "cable.diameter"),
        ({"cable__drag_coefficient": -1.0}, "cable.drag_coefficient"),
        ({"ice__thickness": -0.01}, "ice.thickness"),
        ({"ice__thickness": 0.01, "ice__density": 0.0}, "ice.density"),
        ({"ice__thickness": 0.01, "wind": None, "cable__diameter": None}, "cable.diameter"),
    ],
)
def test_wrong_keys_are_refused(changes, key):
    with pytest.raises(cp.SceneError, match=rf"^{key}[^;]*: .*allowed: "):
        cp.make_scene(wrong(**changes))


def test_wind_across_a_planar_scene_is_refused():
    planar = {
        **GUY,
        "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
        "wind": {"speed": 10.0, "direction": [0.0, 0.0, 1.0]},
    }
    with pytest.raises(cp.SceneError, match=r"^wind\.direction: given .*spatial scene"):
        cp.make_scene(planar)


def test_a_cable_below_the_ground_is_refused():
    with pytest.raises(cp.SceneError, match=r"^wind\.ground: given 5\.0; allowed: "):
        cp.make_scene({**GUY, "wind": {**WIND, "ground": 5.0}})
    slack = {
        **GUY,
        "cable": {**GUY["cable"], "top_tension": 600.0},
        "ends": {"lower": [0.0, 1.0], "upper": [60.0, 2.0]},
    }
    with pytest.raises(
        cp.SceneError, match=r"^wind\.ground: given 0\.0; allowed: at most the lowest point of the cable"
    ):
        cp.make_scene({**slack, "wind": {**WIND, "direction": [1.0, 0.0]}})  # the sag reaches the ground
    scene = cp.make_scene({**GUY, "wind": WIND})
    for call in (cp.wind.field, cp.chain.simulate):  # a scene that was changed by hand
        with pytest.raises(cp.SceneError, match=r"^wind\.ground: given 5\.0; allowed: "):
            call(scene.assign(wind_ground=((), 5.0, {"units": "m"})))


def test_key_paths_of_wind_and_ice():
    nested = cp.make_scene({**GUY, "wind": KAIMAL, "ice": {"thickness": 0.01}})
    flat = cp.make_scene(
        {
            **GUY,
            "wind.speed": 25.0,
            "wind.direction": [1.0, 0.0, 0.0],
            "wind.turbulence.spectrum": "kaimal",
            "wind.turbulence.seed": 7,
            "ice.thickness": 0.01,
        }
    )
    assert set(nested) == set(flat)
    assert nested.wind_turbulence_seed.units == "1"
    assert np.array_equal(cp.wind.field(nested).wind, cp.wind.field(flat).wind)


def test_ice_grows_after_tensioning():
    thickness, density, diameter = 0.015, 700.0, 0.016
    bare, iced = cp.make_scene(GUY), cp.make_scene({**GUY, "ice": {"thickness": thickness, "density": density}})
    added = density * np.pi * thickness * (diameter + thickness)  # kg/m
    same = cp.catenary.rest(bare)
    cable = {name: value for name, value in GUY["cable"].items() if name != "top_tension"}
    cable |= {"density": 8000.0 + added / 1.25e-4, "unstretched_length": float(same.unstretched_length)}
    with_weight = cp.make_scene({**GUY, "cable": cable})
    found, expected = cp.catenary.rest(iced), cp.catenary.rest(with_weight)
    assert float(found.unstretched_length) == pytest.approx(float(same.unstretched_length), rel=1e-14)
    assert found.tension.values == pytest.approx(expected.tension.values, rel=1e-9)
    assert float(found.tension[-1]) > 1.04 * 15000.0
    run, other = (cp.chain.simulate(scene, step=5e-4, times=[0.0, 0.1]) for scene in (iced, with_weight))
    assert run.position.values == pytest.approx(other.position.values, abs=1e-9)
    # the wind blows at a cable as thick as this one with its ice
    ice, thick = {"thickness": thickness, "density": density}, {**cable, "diameter": diameter + 2 * thickness}
    blown, other = (
        cp.chain.rest(cp.make_scene({**GUY, **tables, "wind": WIND})) for tables in ({"ice": ice}, {"cable": thick})
    )
    np.testing.assert_allclose(blown.position, other.position, rtol=0, atol=1e-9)
    assert float(np.abs(blown.position - run.position[0]).max()) > 0.1
    no_ice = cp.make_scene({**GUY, "ice": {"thickness": 0.0}})
    assert np.array_equal(cp.catenary.rest(no_ice).tension, same.tension)


@pytest.mark.slow
def test_a_study_leaves_out_the_model_that_refuses_wind():
    wind = {"speed": 20.0, "direction": [1.0, 0.0, 0.0]}
    scene = cp.make_scene(
        {**GUY, "wind": wind, "chain": {"links": 10}, "time": {"duration": 2.0, "interval": 0.1}, "motion": SWAY}
    )
    study = cp.study.run(scene, ranks=[4])
    assert "condensed_r4" in study.children
    assert "galerkin_r4" not in study.children


def test_the_catenary_is_in_still_air_and_says_so():
    still, windy = (cp.catenary.rest(cp.make_scene({**GUY, **wind})) for wind in ({}, {"wind": WIND}))
    assert np.array_equal(still.position, windy.position)
    assert windy.attrs["air"] == still.attrs["air"] == "still air"  # in the words of the other results at rest
    assert windy.attrs["title"].endswith("continuous cable at rest in still air")
