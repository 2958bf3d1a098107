"""Damping of the vibrations about rest by given ratios in the condensed model: decay, refusals, members, estimate."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from references.free_decay import deflection_of, guy_from_mode, ratio_of, string_from_mode
from suite import slow

import cablepod as cp

RATIO = 0.03


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
@pytest.mark.parametrize("order", ["leading", slow("exact"), slow("inertial")])
@pytest.mark.parametrize("mode", [1, 2, 4])
def test_each_mode_of_a_taut_string_has_the_ratio(mode, scheme, order):
    scene, shape = string_from_mode(mode, {"ratio": RATIO})
    modes = cp.condensed.vibration_modes(scene, rank=4)
    run = cp.condensed.simulate(scene, modes, order=order, scheme=scheme, step=2e-3)
    assert ratio_of(run, shape) == pytest.approx(RATIO, rel=5e-3)


@pytest.mark.parametrize(("mode", "order"), [(1, "exact"), (2, "leading"), (2, "inertial"), (3, "exact")])
def test_each_mode_of_a_sagging_guy_has_its_ratio(mode, order):
    ratios = [0.02, 0.05, 0.01]
    scene, shape = guy_from_mode(mode, {"ratios": ratios})
    modes = cp.condensed.vibration_modes(scene, rank=8, static_modes=True)  # which hold the shape at rest
    run = cp.condensed.simulate(scene, modes, order=order, tolerance=1e-4)
    assert ratio_of(run, shape) == pytest.approx(ratios[mode - 1], rel=0.02)


@pytest.mark.parametrize("mode", [2, 4])
def test_the_last_ratio_is_that_of_all_others(mode):
    scene, shape = string_from_mode(mode, {"ratios": [0.1, 0.02]})
    run = cp.condensed.simulate(scene, cp.condensed.vibration_modes(scene, rank=4), step=2e-3)
    assert ratio_of(run, shape) == pytest.approx(0.02, rel=5e-3)


def test_a_taut_cable_without_weight_that_moves_as_a_rigid_body_is_not_damped():
    largest = {}
    for name, damping in (("relative", {"ratio": 0.5}), ("absolute", {"mass_proportional": 8.9}), ("undamped", {})):
        scene, _ = string_from_mode(1, damping, amplitude=0.0, lift=5.0, duration=20.0)
        run = cp.condensed.simulate(scene, cp.condensed.vibration_modes(scene, rank=4), step=4e-3)
        largest[name] = deflection_of(run)
    assert largest["absolute"] > 0.05
    assert largest["relative"] <= 1.01 * largest["undamped"] < 0.05 * largest["absolute"]


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
def test_second_order_remains(scheme):
    scene, _ = guy_from_mode(2, {"ratio": 0.1}, amplitude=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=4, static_modes=True)
    runs = [
        cp.condensed.simulate(scene, modes, step=step, scheme=scheme).amplitude.values for step in (8e-3, 4e-3, 2e-3)
    ]
    coarse, fine = (np.abs(a - b).max() for a, b in pairwise(runs))
    assert math.log2(coarse / fine) == pytest.approx(2.0, abs=0.15)


def test_members_have_the_bits_of_single_runs():
    scene, _ = guy_from_mode(2, {"ratio": 0.1}, amplitude=0.05)
    members = cp.ensemble.design(scene, {"damping.ratio": [0.0, 0.1]}, members=5, seed=1)
    modes = cp.condensed.vibration_modes(scene, rank=4, static_modes=True)
    together = cp.condensed.simulate(members, modes, step=4e-3, outputs=("position",))
    alone = cp.condensed.simulate(members.isel(member=3, drop=True), modes, step=4e-3, outputs=("position",))
    assert np.array_equal(together.position.isel(member=3), alone.position)
    assert float(together.position.std("member").max()) > 1e-3


def test_numerov_and_hosts_refuse_it():
    scene, _ = string_from_mode(1, {"ratio": 0.01}, links=10, amplitude=0.0)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    with pytest.raises(
        cp.SceneError, match=r"^scheme: given 'numerov'; allowed: .velocity_verlet. or .trapezoidal. with damping.ratio"
    ):
        cp.condensed.simulate(scene, modes, scheme="numerov")
    plain = cp.make_scene(
        {
            "cable": {"youngs_modulus": 2e7, "area": 1.0, "density": 1.0, "top_tension": 2e4},
            "ends": {"lower": [0.0, 0.0], "upper": [50.0, 0.0]},
            "damping": {"ratios": [0.01, 0.02]},
            "chain": {"links": 10},
        }
    )
    with pytest.raises(cp.SceneError, match=r"^damping\.ratios: given \[0\.01, 0\.02\]; allowed: none"):
        cp.condensed.prepare(plain, modes)
