"""Values of a scene Dataset that somebody changed are checked as those of a scene file are."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from mast_scenes import SMALL, WIND

import cablepod as cp
from cablepod import examples
from cablepod.parameters import _scene_values
from cablepod.parameters._from_scene import Members

CHANGES = [
    ("gravity", -9.81, r"gravity: given -9.81; allowed: a finite number of at least 0"),
    ("gravity", np.nan, r"gravity: missing; allowed: a number, as make_scene gives it"),
    ("cable_area", -1e-4, r"cable.area: given -0.0001; allowed: a finite number above 0"),
    ("cable_area", np.nan, r"cable.area: missing; allowed: area of the unstrained cross-section"),
    ("cable_area", 0.0, r"cable.area: given 0.0; allowed: a finite number above 0"),
    ("cable_area", 1e-40, r"cable.area: given 1e-40; allowed: a finite number above 0, of a size from 1e-30"),
    ("cable_youngs_modulus", np.inf, "scene: cable_youngs_modulus: given 'values that are not finite'"),
    ("cable_top_tension", -1.0, r"cable.top_tension: given -1.0; allowed: a finite number above 0"),
    ("cable_specific_weight", np.nan, "cable: given none; allowed: exactly one of specific_weight, density"),
    ("time_interval", 0.0, r"time.interval: given 0.0; allowed: a finite number above 0"),
    ("motion_upper_x_angular_frequency", -1.0, r"motion.upper.x.angular_frequency: given -1.0; allowed:"),
    ("motion_upper_x_amplitude", np.nan, r"motion.upper.x.amplitude: missing; allowed: a number"),
    ("motion_upper_x_kind", "circle", r"motion.upper.x.kind: given 'circle'; allowed: one of"),
]


def altered(scene: xr.Dataset, name: str, value: float | str) -> xr.Dataset:
    """The scene with another value, as a user writes it."""
    return scene.assign({name: ((), value, scene[name].attrs)})


@pytest.mark.parametrize(("name", "value", "message"), CHANGES)
def test_a_value_that_no_scene_has_is_refused(name, value, message):
    scene = examples.scene("example2")
    for function in (cp.catenary.rest, cp.chain.simulate, cp.cable.simulate, cp.cable.summary):
        for _ in range(2):  # what is refused is not kept
            with pytest.raises(cp.SceneError, match=message):
                function(altered(scene, name, value))
    cp.catenary.rest(scene)


def test_a_value_that_a_scene_may_have_is_taken():
    scene = examples.scene("example2")
    heavier = altered(scene, "gravity", 2.0 * float(scene.gravity))
    given = cp.make_scene(examples_tree() | {"gravity": 2.0 * float(scene.gravity)})
    np.testing.assert_array_equal(cp.catenary.rest(heavier)["position"], cp.catenary.rest(given)["position"])


def examples_tree() -> dict[str, object]:
    """Example 2 as nested tables."""
    import tomllib

    return tomllib.loads(examples.scene_path("example2").read_text())


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("mast_height", -30.0, "mast.height: given -30.0; allowed: a finite number above 0"),
        ("mast_damping_ratio", -0.1, "mast.damping_ratio: given -0.1"),
        ("mast_base", "floating", "mast.base: given 'floating'"),
        ("wind_speed", -5.0, "wind.speed: given -5.0"),
        ("guy_1_level", np.nan, "guy.1.level: missing; allowed: a number"),
        ("mast_load_1_level", np.nan, "mast.load.1.level: missing; allowed: a number"),
    ],
)
def test_a_value_that_no_mast_has_is_refused(name, value, message):
    scene = cp.make_scene({**SMALL, "wind": WIND})
    assert name in scene
    with pytest.raises(cp.SceneError, match=message):
        cp.mast.rest(altered(scene, name, value))


def test_a_member_that_no_scene_is_is_refused():
    members = cp.ensemble.design(examples.scene("example2"), {"cable.area": [1e-4, 2e-4]}, members=5, seed=1)
    areas = members["cable_area"].values.copy()
    for bad in (-1.0, 0.0):
        other = members.assign(cable_area=("member", np.r_[areas[:2], bad, areas[3:]], members["cable_area"].attrs))
        with pytest.raises(cp.SceneError, match=f"cable.area: given {bad}; allowed: a finite number above 0"):
            cp.catenary.rest(other)


def test_whole_numbers_may_be_floats_where_a_member_lacks_them():
    tree = {key: value for key, value in examples_tree().items() if key != "chain"}
    scenes = [cp.make_scene({**tree, "chain": {"links": 8}}), cp.make_scene(tree)]
    both = xr.concat(scenes, "member", data_vars="all", coords="minimal", join="outer")
    assert both["chain_links"].dtype == float
    assert [p.links for p in Members(both)] == [8, None]
    with pytest.raises(cp.SceneError, match=r"chain\.links: given 8\.5; allowed: a whole number"):
        Members(both.assign(chain_links=both["chain_links"] + 0.5))


def test_most_values_are_checked_once(monkeypatch):
    scene = examples.scene("example2")
    Members(scene)
    monkeypatch.setattr(_scene_values, "key_at", None)
    Members(scene.copy(deep=True))
