"""The cable at rest as a Dataset: orientation, loads, members; the numbers themselves are in test_kernel."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import cablepod as cp


def guy(**cable):
    return {
        "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, **cable},
        "ends": {"lower": [0.0, 0.0], "upper": [20.40, 57.70]},
    }


# 50-digit reference, T1 -> L0
LENGTHS = {15000.0: 61.155551941825}


@pytest.mark.parametrize("tension", LENGTHS)
def test_unstretched_lengths_of_the_guy(tension):
    rest = cp.catenary.rest(cp.make_scene(guy(top_tension=tension)))
    assert float(rest.unstretched_length) == pytest.approx(LENGTHS[tension], abs=1e-12 * 61 + 5e-13)
    assert float(rest.tension_upper) == pytest.approx(tension, rel=1e-13)
    assert float(rest.tension[-1]) == pytest.approx(tension, rel=1e-12)
    np.testing.assert_allclose(rest.position[[0, -1]], [[0, 0], [20.40, 57.70]], atol=1e-12)


def test_every_way_to_give_the_length_gives_the_same_cable():
    rest = cp.catenary.rest(cp.make_scene(guy(top_tension=3750.0)))
    same = {
        "bottom_tension": float(rest.tension_lower),
        "horizontal_force": float(rest.horizontal_force),
        "unstretched_length": float(rest.unstretched_length),
    }
    for key, value in same.items():
        other = cp.catenary.rest(cp.make_scene(guy(**{key: value})))
        # K/T 2^-53 is 6e-13 here; ten of them for the length
        xr.testing.assert_allclose(other, rest, rtol=1e-11, atol=1e-11)


def test_the_shape_is_in_equilibrium_with_the_load_everywhere():
    mapping = {**guy(unstretched_length=75.0), "load": {"uniform": [14.7, 3.0]}}
    rest = cp.catenary.rest(cp.make_scene(mapping), points=20001)
    along = rest.position.differentiate("particle").values
    along /= np.linalg.norm(along, axis=1)[:, None]
    force = rest.tension.values[:, None] * along
    change = np.gradient(force, rest.arc_length.values, axis=0)[5:-5]
    np.testing.assert_allclose(change, np.tile([-14.7, 9.8125 - 3.0], (len(change), 1)), atol=2e-3)


def test_a_load_tilts_the_plane_of_a_spatial_cable():
    mapping = guy(top_tension=7500.0)
    mapping["ends"] = {"lower": [0.0, 0.0, 0.0], "upper": [20.40, 57.70, 0.0]}
    blown = cp.catenary.rest(cp.make_scene({**mapping, "load": {"uniform": [0.0, 0.0, 9.8125]}}))
    assert float(blown.position[20, 2]) > 0.1
    # seen along the total load, which is tilted by 45 degrees, it is the cable under sqrt(2) times the weight
    np.testing.assert_allclose(blown.position[[0, -1]].values[:, 2], 0.0, atol=1e-12)
    still = cp.catenary.rest(cp.make_scene(mapping))
    flat = cp.catenary.rest(cp.make_scene(guy(top_tension=7500.0)))
    np.testing.assert_array_equal(still.position[:, :2], flat.position)


def test_turning_the_scene_turns_the_cable():
    flat = cp.catenary.rest(cp.make_scene(guy(top_tension=1875.0)))
    mirrored = guy(top_tension=1875.0)
    mirrored["ends"]["upper"] = [-20.40, 57.70]
    np.testing.assert_array_equal(cp.catenary.rest(cp.make_scene(mirrored)).position[:, 0], -flat.position[:, 0])
    # seen from the other end: bottom and top change their roles
    turned = guy(bottom_tension=1875.0)
    turned["ends"] = {"lower": [20.40, 57.70], "upper": [0.0, 0.0]}
    other = cp.catenary.rest(cp.make_scene(turned))
    np.testing.assert_allclose(other.position.values[::-1], flat.position, atol=1e-10)
    assert float(other.unstretched_length) == pytest.approx(float(flat.unstretched_length), rel=1e-13)


def test_vertical_and_weightless_cables():
    hanging = guy(unstretched_length=60.0)
    hanging["ends"]["upper"] = [0.0, 60.5]
    rest = cp.catenary.rest(cp.make_scene(hanging))
    assert not rest.position[:, 0].any()
    # T(S) = T0 + q S and the stretch is the mean strain: 60.5 - 60 = (T0 + q L0 / 2) L0 / K
    lower = 0.5 / 60 * 2e7 - 9.8125 * 30
    np.testing.assert_allclose(rest.tension, lower + 9.8125 * rest.arc_length, rtol=1e-11)
    light = {**guy(density=8000.0, top_tension=100.0), "gravity": 0.0}
    del light["cable"]["specific_weight"]
    straight = cp.catenary.rest(cp.make_scene(light))
    np.testing.assert_allclose(straight.tension, 100.0, rtol=1e-14)
    s = np.linspace(0, 1, 41)[:, None]
    np.testing.assert_allclose(straight.position, s * [20.40, 57.70], atol=1e-13)


def test_a_tension_that_no_cable_has_names_the_least():
    with pytest.raises(cp.SceneError, match=r"cable\.top_tension: given 600\.0; allowed: at least 628\.29"):
        cp.make_scene(guy(top_tension=600.0))
    with pytest.raises(cp.SceneError, match=r"cable\.bottom_tension: given 60\.0; allowed: at least 62\.12"):
        cp.make_scene(guy(bottom_tension=60.0))


def test_members_are_solved_together():
    tensions = [1875.0, 3750.0, 7500.0]
    scenes = xr.concat([cp.make_scene(guy(top_tension=t)) for t in tensions], "member", combine_attrs="override")
    together = cp.catenary.rest(scenes)
    assert together.position.dims == ("member", "particle", "coordinate")
    np.testing.assert_array_equal(together.cable_top_tension, tensions)
    for i, tension in enumerate(tensions):
        alone = cp.catenary.rest(cp.make_scene(guy(top_tension=tension)))
        for name in alone.data_vars:
            np.testing.assert_array_equal(together[name][i], alone[name])


def test_point_loads_are_left_out_loudly():
    scene = cp.make_scene({**guy(top_tension=7500.0), "point_load": [{"arc_length": 0.5, "force": [0.0, -100.0]}]})
    with pytest.warns(UserWarning, match=r"leaves out the point loads.*chain\.rest"):
        cp.catenary.rest(scene)


def test_every_variable_has_units():
    rest = cp.catenary.rest(cp.make_scene(guy(top_tension=7500.0)), points=5)
    assert all({"units", "long_name"} <= set(v.attrs) for v in rest.variables.values())
    assert rest.sizes["particle"] == 5
    with pytest.raises(cp.SceneError, match="points: given 1; allowed: a whole number of at least 2"):
        cp.catenary.rest(cp.make_scene(guy(top_tension=7500.0)), points=1)


def test_scenes_and_arrays_have_one_refusal():
    with pytest.raises(cp.SceneError) as scene:
        cp.make_scene(guy(top_tension=600.0))
    with pytest.raises(cp.SceneError) as array:
        cp.catenary.solve(20.40, 57.70, 9.8125, 2e7, top_tension=600.0)
    assert str(scene.value).removeprefix("cable.top_tension") == str(array.value).removeprefix("top_tension[0]")


def test_arrays_are_solved_in_one_call():
    tensions = np.array([[1875.0, 3750.0], [7500.0, 15000.0]])
    many = cp.catenary.solve(20.40, 57.70, 78500.0 * 1.25e-4, 2e7, top_tension=tensions)
    for index, tension in np.ndenumerate(tensions):
        alone = cp.catenary.rest(cp.make_scene(guy(top_tension=tension)))
        for name in ("unstretched_length", "stretched_length", "horizontal_force", "tension_lower", "tension_upper"):
            assert many[name][index] == float(alone[name])
    with pytest.raises(cp.SceneError, match=r"top_tension\[1\]: given 600\.0; allowed: at least 628\.29"):
        cp.catenary.solve(20.40, 57.70, 9.8125, 2e7, top_tension=[700.0, 600.0])
    with pytest.raises(cp.SceneError, match=r"unstretched_length\[0\]: given 62\.0; allowed: at most the chord"):
        cp.catenary.solve(20.40, 57.70, 0.0, 2e7, unstretched_length=62.0)
    with pytest.raises(cp.SceneError, match=r"horizontal_force\[0\]: given 1\.0; allowed: a tension or a length"):
        cp.catenary.solve(0.0, 57.70, 9.8125, 2e7, horizontal_force=1.0)
    with pytest.raises(cp.SceneError, match="exactly one of top_tension"):
        cp.catenary.solve(20.40, 57.70, 0.0, 2e7)
    with pytest.raises(cp.SceneError, match="unknown key"):
        cp.catenary.solve(20.40, 57.70, 0.0, 2e7, top_tension=1.0, tension=2.0)
