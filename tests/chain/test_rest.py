"""Equilibrium of the elastic chain: balance, the catenary as its limit, hand calculation."""

from __future__ import annotations

import numpy as np
import pytest
from convergence import orders
from scenes import scene_with, uniform_chain

import cablepod as cp


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_rest_is_in_equilibrium(scenes, number):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    rest = cp.chain.rest(scene)
    assert float(rest.residual) < 1e-9 * float(rest.tension.max())
    # and by the law of the links from the positions alone, whose rounding is worth 1e-7 N here
    length, stiffness, mass = uniform_chain(scene, rest)
    reach = rest.position.diff("particle").values
    stretched = np.linalg.norm(reach, axis=1)
    force = (stiffness * np.maximum(stretched - length, 0.0) / stretched)[:, None] * reach
    share = 0.5 * (length[1:] + length[:-1])
    left = force[1:] - force[:-1] - 9.81 * mass[1:-1, None] * [0.0, 1.0] + share[:, None] * scene.load_uniform.values
    assert np.abs(left).max() < 1e-9 * float(rest.tension.max())


@pytest.mark.parametrize(
    ("law", "stiffness"),
    [("linear", k) for k in (1e3, 1e5, 1e7, 1e10, 1e13)] + [("green", k) for k in (1e2, 1e3, 1e5, 1e7, 1e10)],
)
@pytest.mark.parametrize("length", [60.0, 61.15, 61.3, 80.0, 180.0])
def test_rest_is_balanced_by_the_law_from_soft_to_stiff_and_taut_to_slack(scenes, law, stiffness, length):
    scene = cp.read_scene(scenes / "example2.toml").drop_vars("cable_top_tension")
    scene = scene.assign(
        cable_unstretched_length=((), length), cable_youngs_modulus=((), stiffness / float(scene.cable_area))
    )
    rest = cp.chain.rest(scene, law=law)
    largest = float(rest.tension.max())
    assert float(rest.residual) < 1e-9 * largest
    reach = rest.position.diff("particle").values
    xi = np.linalg.norm(reach, axis=1) / (length / 40)
    tension = stiffness * (np.maximum(xi - 1.0, 0.0) if law == "linear" else 0.5 * xi * (xi**2 - 1.0))
    # rounding of positions of 60 m (and sagging further) in links of 1.5 m: 1e-14 relative to the link
    np.testing.assert_allclose(rest.tension, tension, rtol=1e-11, atol=1e-12 * stiffness)
    force = (tension / (xi * length / 40))[:, None] * reach
    left = force[1:] - force[:-1] - 9.81 * uniform_chain(scene, rest).mass[1:-1, None] * [0.0, 1.0]
    assert np.abs(left).max() < 1e-9 * largest + 1e-12 * stiffness
    assert rest.attrs["law"] == law
    assert rest.attrs["title"].endswith("chain at rest" if law == "linear" else "chain at rest, green law")


def test_rest_tends_to_the_catenary_as_the_square_of_the_link(soft):
    scene = scene_with(soft)
    errors = []
    for n in (10, 20, 40):
        exact = cp.catenary.rest(scene, points=n + 1)
        errors.append(float(np.abs(cp.chain.rest(scene, links=n).position - exact.position).max()))
    np.testing.assert_allclose(orders(errors), 2.0, atol=0.1)


def test_rest_of_two_links_against_hand_calculation():
    # one mass in the middle of a symmetric span: k (1 - l/R) * 2 * sag / R = weight
    scene = cp.make_scene(
        {
            "cable": {"youngs_modulus": 1e6, "area": 1e-3, "density": 2000.0, "unstretched_length": 4.2},
            "ends": {"lower": [0.0, 0.0], "upper": [4.0, 0.0]},
            "chain": {"links": 2},
        }
    )
    rest = cp.chain.rest(scene)
    sag = -float(rest.position[1, 1])
    reach = np.hypot(2.0, sag)
    pull = 1e3 / 2.1 * (reach - 2.1)
    assert 2 * pull * sag / reach == pytest.approx(2.0 * 2.1 * 9.81, rel=1e-12)
    assert float(rest.position[1, 0]) == pytest.approx(2.0, rel=1e-12)


def test_rest_carries_point_loads_and_unequal_links(soft):
    scene = scene_with(
        soft,
        chain={"link_lengths": [1.0, 5.0, 0.2, 2.0, 1.0]},
        point_load=[{"arc_length": 0.31, "force": [4.0, -50.0]}, {"arc_length": 1.0, "force": [1e3, 0.0]}],
    )
    rest = cp.chain.rest(scene)
    assert float(rest.residual) < 1e-9 * float(rest.tension.max())
    # the lever rule keeps the whole force: both ends together carry the loads that no end takes directly
    reach = rest.position.diff("particle").values
    pull = rest.tension.values[:, None] * reach / np.linalg.norm(reach, axis=1)[:, None]
    weight = 9.81 * float(rest.unstretched_length) * (1.0 - 0.5 * (1.0 + 1.0) / 9.2)
    np.testing.assert_allclose(pull[-1] - pull[0], [-4.0, 50.0 + weight], rtol=1e-9)


def test_a_chain_that_folds_at_rest_is_refused():
    scene = cp.make_scene(
        {
            "cable": {"youngs_modulus": 1e6, "area": 1e-3, "density": 2000.0, "unstretched_length": 6.0},
            "ends": {"lower": [0.0, 0.0], "upper": [0.0, 4.0]},
            "chain": {"links": 9},
        }
    )
    with pytest.raises(cp.SceneError, match=r"no rest found.*initial\.points"):
        cp.chain.rest(scene)
