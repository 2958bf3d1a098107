"""Damping of the vibrations about rest by given ratios in chain and cable: decay, order, members, refusals."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from references.free_decay import amplitude_of, deflection_of, guy_from_mode, ratio_of, string_from_mode
from suite import slow

import cablepod as cp

RATIO = 0.03
SCHEMES = ["trapezoidal", "generalized_alpha", "energy_momentum"]
MODELS = [cp.chain.simulate, partial(cp.cable.simulate, elements=6)]


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("mode", [1, 3, slow(6)])
def test_each_mode_of_a_taut_string_has_the_ratio(mode, scheme):
    scene, shape = string_from_mode(mode, {"ratio": RATIO})
    assert ratio_of(cp.chain.simulate(scene, scheme=scheme, step=1e-3), shape) == pytest.approx(RATIO, rel=5e-3)


@pytest.mark.parametrize("simulate", MODELS)
@pytest.mark.parametrize("mode", [1, 2, 3])
def test_each_mode_of_a_sagging_guy_has_its_ratio(mode, simulate):
    ratios = [0.02, 0.05, 0.01]
    scene, shape = guy_from_mode(mode, {"ratios": ratios})
    run = simulate(scene, step=2.5e-3)
    assert run.attrs["scheme"] == "trapezoidal"
    assert ratio_of(run, shape) == pytest.approx(ratios[mode - 1], rel=0.02)


@pytest.mark.parametrize("simulate", MODELS)
def test_the_last_ratio_is_that_of_all_others(simulate):
    scene, shape = string_from_mode(3, {"ratios": [0.2, 0.02]})
    assert ratio_of(simulate(scene, step=1e-3), shape) == pytest.approx(0.02, rel=0.01)
    scene, shape = string_from_mode(3, {"ratios": [0.2, 0.0]})
    assert ratio_of(simulate(scene, step=1e-3), shape) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("simulate", MODELS)
@pytest.mark.parametrize("ratio", [0.3, slow(1.0)])
def test_large_ratios_converge(ratio, simulate):
    scene, shape = string_from_mode(1, {"ratios": [RATIO, ratio]})
    run = simulate(scene, step=4e-3, scheme="trapezoidal")
    assert ratio_of(run, shape) == pytest.approx(RATIO, rel=0.02)
    assert run.attrs["steps_cut"] == 0


@pytest.mark.parametrize("simulate", MODELS)
def test_a_taut_cable_without_weight_that_moves_as_a_rigid_body_is_not_damped(simulate):
    options = {"step": 0.02, "scheme": "trapezoidal"}
    scene, _ = string_from_mode(1, {"ratio": 0.5}, amplitude=0.0, lift=5.0, duration=20.0)
    relative = deflection_of(simulate(scene, **options))
    scene, _ = string_from_mode(1, {"mass_proportional": 2 * 0.5 * 8.9}, amplitude=0.0, lift=5.0, duration=20.0)
    absolute = deflection_of(simulate(scene, **options))
    scene, _ = string_from_mode(1, {}, amplitude=0.0, lift=5.0, duration=20.0)
    undamped = deflection_of(simulate(scene, **options))
    assert absolute > 0.05
    assert relative <= 1.01 * undamped < 0.05 * absolute


@pytest.mark.parametrize("simulate", MODELS)
def test_second_order_remains(simulate):
    scene, shape = string_from_mode(2, {"ratio": 0.1})
    # of the mode: waves along the string, which these steps do not resolve, have errors of their own
    runs = [amplitude_of(simulate(scene, step=step, scheme="trapezoidal"), shape) for step in (4e-3, 2e-3, 1e-3)]
    coarse, fine = (np.abs(a - b).max() for a, b in pairwise(runs))
    assert math.log2(coarse / fine) == pytest.approx(2.0, abs=0.2)


@pytest.mark.slow
def test_spatial_chains_have_the_ratio():
    scene, shape = string_from_mode(2, {"ratio": RATIO}, spatial=True)
    for simulate in MODELS:
        assert ratio_of(simulate(scene, step=1e-3), shape) == pytest.approx(RATIO, rel=5e-3)


def test_ratios_are_part_of_the_identity_and_history_of_a_run():
    one, other = (string_from_mode(1, {"ratios": [0.02, last]}, links=6)[0] for last in (0.01, 0.03))
    assert one.attrs["id"] != other.attrs["id"]
    runs = [cp.chain.simulate(scene, step=1e-2) for scene in (one, other)]
    assert runs[0].attrs["id"] != runs[1].attrs["id"]
    assert '"ratios": [0.02, 0.01]' in str(runs[0].attrs["history_json"])


@pytest.mark.parametrize(("key", "value"), [("ratio", 0.02), ("ratios", [0.02, 0.01])])
def test_explicit_schemes_free_ends_and_other_models_refuse_it(key, value):
    scene = {
        "cable": {"youngs_modulus": 2e9, "area": 1e-4, "density": 8000.0, "unstretched_length": 40.0},
        "ends": {"lower": [0.0, 0.0], "upper": [39.0, 0.0]},
        "chain": {"links": 10},
        "damping": {key: value},
        "time": {"duration": 0.1, "interval": 0.05},
    }
    damped = cp.make_scene(scene)
    for simulate in MODELS:
        with pytest.raises(
            cp.SceneError, match=rf'^damping\.{key}: given .*; allowed: none with scheme "velocity_verlet"'
        ):
            simulate(damped, scheme="velocity_verlet")
    run = cp.chain.simulate(damped, step=1e-3)
    for call in (
        lambda: cp.rigid.simulate(damped),
        lambda: cp.galerkin.simulate(damped, cp.pod.decompose(run, rank=2)),
    ):
        with pytest.raises(cp.SceneError, match=rf"^damping\.{key}: given .*; allowed: none; try: c"):
            call()
    scene["ends"]["free"] = "upper"
    for simulate in MODELS:
        with pytest.raises(cp.SceneError, match=rf"^damping\.{key}: given .*; allowed: none with ends\.free"):
            simulate(cp.make_scene(scene))


@pytest.mark.parametrize("key", ["links", "chain.links"])
def test_links_whose_matrices_no_memory_holds_are_refused(key):
    scene, _ = string_from_mode(1, {"ratio": RATIO})
    scene = scene.drop_vars([name for name in scene.data_vars if str(name).startswith("initial_")])
    if key == "chain.links":
        scene = scene.assign(chain_links=scene["chain_links"].copy(data=10**6))
    allowed = r"given 1000000; allowed: at most [1-9][0-9]* with damping\.ratio, .*; try: damping\.mass_proportional"
    with pytest.raises(cp.SceneError, match=f"^{key}: {allowed}"):
        cp.chain.simulate(scene, links=10**6 if key == "links" else None, times=[0.0, 0.1])
