"""Scenes with several members, and what is no scene."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scene_files import everything

import cablepod as cp


def concatenated(*scenes):
    return xr.concat(scenes, "member", data_vars="all", coords="minimal", compat="equals", join="outer")


def assert_members_are(many, each):
    """Hold that each member has the rest and the motion of the scene that it was made of."""
    for i, scene in enumerate(each):
        of_member = many.assign_coords(member=range(len(each))).isel(member=i)
        np.testing.assert_array_equal(cp.chain.rest(of_member).tension, cp.chain.rest(scene).tension)
        run, expected = (cp.chain.simulate(item, step=1e-3) for item in (of_member, scene))
        np.testing.assert_array_equal(run.time, expected.time)
        np.testing.assert_array_equal(run.position, expected.position)


@pytest.mark.parametrize("dims", [("member", "coordinate"), ("coordinate", "member")])
def test_members_are_the_scenes_they_were_made_of(soft, dims):
    each = []
    for tension in (150.0, 200.0, 300.0):
        soft["cable"]["top_tension"] = tension
        soft["ends"]["upper"] = [8.0, 6.0 + tension / 1e3]
        each.append(cp.make_scene(soft))
    many = concatenated(*each).transpose(*dims, ...)
    assert_members_are(many, each)
    rest = cp.catenary.rest(many)
    for i, scene in enumerate(each):
        np.testing.assert_array_equal(rest.position[i], cp.catenary.rest(scene).position)
    modes = cp.condensed.vibration_modes(each[0], rank=1)
    with pytest.raises(cp.SceneError, match=r"scene: given several members; allowed: one, scene\.isel\(member=0\)"):
        cp.condensed.prepare(many, modes)


def test_members_may_differ_in_what_they_have(soft, scene_folder):
    other = everything()
    other["cable"] = {"youngs_modulus": 2e7, "area": 1e-3, "specific_weight": 9810.0, "unstretched_length": 10.1}
    del other["ensemble"]
    each = [cp.make_scene(soft), cp.make_scene(other)]
    assert_members_are(concatenated(*each), each)


@pytest.mark.parametrize("lacking", ["gravity", "ends_lower"])
def test_a_dataset_that_is_no_scene(soft, lacking):
    scene = cp.make_scene(soft).drop_vars(lacking)
    with pytest.raises(
        cp.SceneError, match=f"scene: given a Dataset of .* without {lacking}; allowed: what make_scene gives"
    ):
        cp.chain.rest(scene)
    with pytest.raises(cp.SceneError, match=r"scene: given a dict; allowed: what make_scene gives"):
        cp.chain.rest({"gravity": 9.81})


@pytest.mark.parametrize(
    ("lacking", "message"),
    [
        (
            "cable_area",
            r"cable\.area: missing; allowed: area .*, or cable\.axial_stiffness in place of youngs_modulus and",
        ),
        ("cable_youngs_modulus", r"cable\.youngs_modulus: missing; allowed: Young's modulus \[Pa\], or cable\.axial_"),
        ("ends_upper", r"ends\.upper: missing; allowed: position of the upper end at rest \[m\], or ends\.chord \[m\]"),
    ],
)
def test_a_scene_that_lost_a_key(soft, lacking, message):
    with pytest.raises(cp.SceneError, match=message):
        cp.chain.rest(cp.make_scene(soft).drop_vars(lacking))


def test_a_scene_that_lost_its_length_or_weight(soft):
    with pytest.raises(cp.SceneError, match=r"cable: given none; allowed: exactly one of top_tension, bottom_tension"):
        cp.chain.rest(cp.make_scene(soft).drop_vars("cable_top_tension"))
    with pytest.raises(cp.SceneError, match=r"cable: given none; allowed: exactly one of specific_weight, density"):
        cp.chain.rest(cp.make_scene(soft).drop_vars("cable_density"))
