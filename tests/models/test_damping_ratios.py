"""Damping of the vibrations about rest by given ratios in chain, cable and condensed model: decay, order, members, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from convergence import distances, orders
from references.free_decay import amplitude_of, deflection_of, guy_from_mode, ratio_of, string_from_mode
from suite import slow

import cablepod as cp

RATIO = 0.03
FULL = ("chain", "cable")
IMPLICIT = ("trapezoidal", "generalized_alpha", "energy_momentum")
SCHEMES = ("velocity_verlet", "trapezoidal")  # of the condensed model


def simulate(model: str, scene: Any, **options: Any) -> Any:
    """Run a model; the condensed one on eight vibration modes, which also hold the shape at rest."""
    if model == "chain":
        return cp.chain.simulate(scene, **options)
    if model == "cable":
        return cp.cable.simulate(scene, elements=6, **options)
    modes = cp.condensed.vibration_modes(scene, rank=8, static_modes=True)
    return cp.condensed.simulate(scene, modes, **options)


@pytest.mark.parametrize(
    ("model", "options"),
    [
        *(("chain", {"scheme": scheme}) for scheme in IMPLICIT),
        *(("condensed", {"scheme": scheme}) for scheme in SCHEMES),
        *(slow("condensed", {"scheme": scheme, "order": order}) for scheme in SCHEMES for order in ("exact", "inertial")),
    ],
    ids=str,
)  # fmt: skip
@pytest.mark.parametrize("mode", [1, 2, 3, slow(6)])
def test_each_mode_of_a_taut_string_has_the_ratio(mode, model, options):
    scene, shape = string_from_mode(mode, {"ratio": RATIO})
    assert ratio_of(simulate(model, scene, step=1e-3, **options), shape) == pytest.approx(RATIO, rel=5e-3)


@pytest.mark.parametrize(
    ("model", "mode", "options"),
    [
        *((model, mode, {"step": 2.5e-3}) for model in FULL for mode in (1, 2, 3)),
        ("condensed", 1, {"order": "exact", "tolerance": 1e-4}),
        ("condensed", 2, {"order": "leading", "tolerance": 1e-4}),
        slow("condensed", 2, {"order": "inertial", "tolerance": 1e-4}),
        ("condensed", 3, {"order": "exact", "tolerance": 1e-4}),
    ],
    ids=str,
)
def test_each_mode_of_a_sagging_guy_has_its_ratio(model, mode, options):
    ratios = [0.02, 0.05, 0.01]
    scene, shape = guy_from_mode(mode, {"ratios": ratios})
    run = simulate(model, scene, **options)
    assert model == "condensed" or run.attrs["scheme"] == "trapezoidal"
    assert ratio_of(run, shape) == pytest.approx(ratios[mode - 1], rel=0.02)


@pytest.mark.parametrize("model", [*FULL, "condensed"])
def test_the_last_ratio_is_that_of_all_others(model):
    for mode in (2, 4):
        scene, shape = string_from_mode(mode, {"ratios": [0.2, 0.02]})
        assert ratio_of(simulate(model, scene, step=1e-3), shape) == pytest.approx(0.02, rel=5e-3)


@pytest.mark.parametrize("model", FULL)
def test_a_last_ratio_of_nothing_damps_nothing(model):
    scene, shape = string_from_mode(3, {"ratios": [0.2, 0.0]})
    assert ratio_of(simulate(model, scene, step=1e-3), shape) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("model", FULL)
@pytest.mark.parametrize("ratio", [0.3, slow(1.0)])
def test_large_ratios_converge(ratio, model):
    scene, shape = string_from_mode(1, {"ratios": [RATIO, ratio]})
    run = simulate(model, scene, step=4e-3, scheme="trapezoidal")
    assert ratio_of(run, shape) == pytest.approx(RATIO, rel=0.02)
    assert run.attrs["steps_cut"] == 0


@pytest.mark.parametrize(
    ("model", "options"),
    [*((model, {"step": 0.02, "scheme": "trapezoidal"}) for model in FULL), ("condensed", {"step": 4e-3})],
)
def test_a_taut_cable_without_weight_that_moves_as_a_rigid_body_is_not_damped(model, options):
    largest = {}
    for name, damping in (("relative", {"ratio": 0.5}), ("absolute", {"mass_proportional": 8.9}), ("undamped", {})):
        scene, _ = string_from_mode(1, damping, amplitude=0.0, lift=5.0, duration=20.0)
        largest[name] = deflection_of(simulate(model, scene, **options))
    assert largest["absolute"] > 0.05
    assert largest["relative"] <= 1.01 * largest["undamped"] < 0.05 * largest["absolute"]


@pytest.mark.parametrize(
    ("model", "scheme"), [*((model, "trapezoidal") for model in FULL), *(("condensed", scheme) for scheme in SCHEMES)]
)
def test_second_order_remains(model, scheme):
    scene, shape = string_from_mode(2, {"ratio": 0.1})
    # of the mode: waves along the string, which these steps do not resolve, have errors of their own
    runs = [amplitude_of(simulate(model, scene, step=step, scheme=scheme), shape) for step in (4e-3, 2e-3, 1e-3)]
    assert orders(distances(runs)) == pytest.approx([2.0], abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("model", FULL)
def test_spatial_chains_have_the_ratio(model):
    scene, shape = string_from_mode(2, {"ratio": RATIO}, turned=np.pi / 2)
    assert ratio_of(simulate(model, scene, step=1e-3), shape) == pytest.approx(RATIO, rel=5e-3)


@pytest.mark.parametrize("turned", [0.0, 0.6])
@pytest.mark.parametrize("model", [slow("chain"), "cable", "condensed"])
def test_vibrations_of_equal_frequency_have_the_mean_of_their_ratios(model, turned):
    # no plane of a string in space differs from another; a matrix that does not either has the mean, by its trace
    for mode, expected in ((1, 0.04), (2, 0.01)):
        scene, shape = string_from_mode(mode, {"ratios": [0.02, 0.06, 0.01]}, turned=turned, links=20)
        options = {} if model == "condensed" else {"scheme": "trapezoidal"}
        assert ratio_of(simulate(model, scene, step=2e-3, **options), shape) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("order", ["exact", slow("inertial")])
def test_a_swinging_cable_in_space_has_the_ratio(order):
    # a sag of 14 % of the chord: slopes in the plane stiffen no motion out of it
    tables = {
        "cable": {"axial_stiffness": 1e6, "mass_per_length": 1.0, "unstretched_length": 42.0},
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": [40.0, 0.0, 0.0]},
        "chain": {"links": 20},
        "time": {"duration": 6.0, "interval": 0.03},
        "damping": {"ratio": RATIO},
    }
    shape = np.zeros((21, 3))
    shape[1:-1, 2] = np.sin(np.pi * np.linspace(0.0, 1.0, 21)[1:-1])
    points = cp.chain.rest(cp.make_scene(tables)).position.values + 1e-3 * shape
    scene = cp.make_scene({**tables, "initial": {"points": points.tolist()}})
    assert ratio_of(simulate("condensed", scene, order=order, step=2e-3), shape) == pytest.approx(RATIO, rel=5e-3)


def test_members_of_the_condensed_model_have_the_bits_of_single_runs():
    scene, _ = guy_from_mode(2, {"ratio": 0.1}, amplitude=0.05)
    members = cp.ensemble.design(scene, {"damping.ratio": [0.0, 0.1]}, members=5, seed=1)
    modes = cp.condensed.vibration_modes(scene, rank=4, static_modes=True)
    together = cp.condensed.simulate(members, modes, step=4e-3, outputs=("position",))
    alone = cp.condensed.simulate(members.isel(member=3, drop=True), modes, step=4e-3, outputs=("position",))
    assert np.array_equal(together.position.isel(member=3), alone.position)
    assert float(together.position.std("member").max()) > 1e-3


def test_ratios_are_part_of_the_identity_and_history_of_a_run():
    one, other = (string_from_mode(1, {"ratios": [0.02, last]}, links=6)[0] for last in (0.01, 0.03))
    assert one.attrs["id"] != other.attrs["id"]
    runs = [cp.chain.simulate(scene, step=1e-2) for scene in (one, other)]
    assert runs[0].attrs["id"] != runs[1].attrs["id"]
    assert '"ratios": [0.02, 0.01]' in str(runs[0].attrs["history_json"])


# --- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("key", "value"), [("ratio", 0.02), ("ratios", [0.02, 0.01])])
def test_other_schemes_and_free_ends_refuse_it(key, value):
    tables = {
        "cable": {"youngs_modulus": 2e9, "area": 1e-4, "density": 8000.0, "unstretched_length": 40.0},
        "ends": {"lower": [0.0, 0.0], "upper": [39.0, 0.0]},
        "chain": {"links": 10},
        "damping": {key: value},
        "time": {"duration": 0.1, "interval": 0.05},
    }
    damped, free = (cp.make_scene({**tables, "ends": {**tables["ends"], **end}}) for end in ({}, {"free": "upper"}))
    given = rf"^damping\.{key}: given .*; allowed: none"
    for model in FULL:
        with pytest.raises(cp.SceneError, match=rf'{given} with scheme "velocity_verlet"'):
            simulate(model, damped, scheme="velocity_verlet")
        with pytest.raises(cp.SceneError, match=rf"{given} with ends\.free"):
            simulate(model, free)
    with pytest.raises(
        cp.SceneError,
        match=r"^scheme: given 'numerov'; allowed: .velocity_verlet. or .trapezoidal. with damping.ratio",
    ):
        simulate("condensed", damped, scheme="numerov")


@pytest.mark.parametrize("key", ["links", "chain.links"])
def test_links_whose_matrices_no_memory_holds_are_refused(key):
    scene, _ = string_from_mode(1, {"ratio": RATIO})
    scene = scene.drop_vars([name for name in scene.data_vars if str(name).startswith("initial_")])
    if key == "chain.links":
        scene = scene.assign(chain_links=scene["chain_links"].copy(data=10**6))
    allowed = r"given 1000000; allowed: at most [1-9][0-9]* with damping\.ratio, .*; try: damping\.mass_proportional"
    with pytest.raises(cp.SceneError, match=f"^{key}: {allowed}"):
        cp.chain.simulate(scene, links=10**6 if key == "links" else None, times=[0.0, 0.1])
