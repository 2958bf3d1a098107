"""The Galerkin model: against the chain it is made from, its order, identities, and what it refuses."""

from __future__ import annotations

import copy
import itertools

import numpy as np
import pytest
import xarray as xr
from conftest import spatial

import cablepod as cp
from cablepod import galerkin_model
from cablepod.parameters import parameters

TERMS = {
    "plain": {},
    "varying load": {"load": {"uniform": [3.0, -2.0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 3.0}},
    "point load": {"point_load": [{"arc_length": 0.4, "force": [5.0, -20.0]}]},
    "mass damping": {"damping": {"mass_proportional": 0.8}},
    "both ends": {
        "motion": {
            "lower": {"y": {"kind": "harmonic", "amplitude": 0.03, "angular_frequency": 1.7, "phase": 0.4}},
            "upper": {"x": {"kind": "ramp", "amplitude": 0.1, "duration": 2.0}},
        }
    },
    "damped, starting with a velocity": {
        "damping": {"mass_proportional": 2.0},
        "motion": {"upper": {"y": {"kind": "harmonic", "amplitude": 0.03, "angular_frequency": 1.7}}},
    },
    "initial shape": {"initial": {"top_tension": 260.0}},
    "unequal links": {"chain": {"link_lengths": [1.0, 2.0, 1.0, 0.5, 2.0, 1.0, 1.0, 3.0]}},
}


@pytest.mark.parametrize("layout", ["separate", "vector"])
@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("name", TERMS)
def test_all_modes_and_the_linear_law_are_the_chain(soft, name, layout, dims):
    mapping = {**soft, **copy.deepcopy(TERMS[name])}
    scene = cp.make_scene(mapping if dims == 2 else spatial(mapping))
    # the lifting uses the analytic second derivative of the end motion, the chain the motion itself: in steps of h they differ
    # by h^2 / 12 times the fourth derivative, which is 1e-10 of the motion at this step
    times, step = np.linspace(0, 4, 33), 1 / 8000
    chain = cp.chain.simulate(scene, times=times, step=step)
    modes = cp.pod.decompose(chain, layout=layout)
    model = cp.galerkin.simulate(
        scene, modes, times=times, law="linear", step=step, outputs=("position", "velocity", "tension")
    )
    assert float(cp.compare.errors(model, chain).error_max) < 1e-9
    full = cp.chain.simulate(scene, times=times, step=step, outputs=("velocity", "tension"))
    np.testing.assert_allclose(model.velocity, full.velocity, atol=1e-8)
    np.testing.assert_allclose(model.tension, full.tension, rtol=1e-8)


@pytest.mark.parametrize("number", [2, 3])
def test_all_modes_and_the_linear_law_are_the_chain_in_the_examples(scenes, number):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    times = np.arange(0.0, 51.0)
    chain = cp.chain.simulate(scene, times=times, step=2.5e-4)
    model = cp.galerkin.simulate(scene, cp.pod.decompose(chain), times=times, law="linear", step=2.5e-4)
    assert float(cp.compare.errors(model, chain).error_max) < 1e-9


# What must come out: (example, law, modes) -> largest error over 125 s against the linear chain, every 0.1 s.
# "green" includes the difference of the laws, 0.03 to 0.07 %.
LIMITS = {
    2: {("green", 1): 2.2e-2, ("green", 2): 8e-4, ("linear", 3): 2e-5},
    3: {("green", 4): 1.2e-2, ("green", 8): 8e-4, ("linear", 8): 5e-4},
    4: {("green", 2): 1.8e-3},
}


@pytest.mark.slow
@pytest.mark.parametrize("number", LIMITS)
def test_errors_against_the_chain_it_was_trained_on(scenes, number):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    chain = cp.chain.simulate(scene, times=np.arange(1251) / 10, step=1.25e-4)
    modes = cp.pod.decompose(chain, rank=8)
    for (law, rank), limit in LIMITS[number].items():
        model = cp.galerkin.simulate(scene, modes, rank=rank, law=law, times=chain.time.values)
        assert float(cp.compare.errors(model, chain).error_max) <= limit, (law, rank)


def test_the_packed_form_has_the_gradient_of_the_energy(soft):
    # energy link by link, differentiated numerically, against the packed coefficients
    from cablepod.kernels import reduced as kernel

    scene = cp.make_scene({**soft, **TERMS["both ends"]})
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3))
    model = galerkin_model.model_of(parameters(scene), modes, rank=3, law="green")
    shape, rates = model.slopes
    weight = model.chain.p.stiffness * model.chain.length
    rng = np.random.default_rng(5)
    y = rng.normal(size=len(rates)) * 0.1

    def energy(y):
        square = np.sum((shape + np.tensordot(y, rates, axes=1)) ** 2, axis=1)
        return np.sum(weight * (square - 1) ** 2) / 8

    factor, offset, first, second = model.packed
    gradient = np.zeros(y.size)
    kernel._green_gradient(
        y, factor, offset, first, second, np.zeros(factor.shape[1]), np.zeros(factor.shape[1]), gradient
    )
    h = 1e-3  # the energy is quartic: the five-point formula is exact but for rounding
    unit = np.eye(y.size) * h
    numeric = [(8 * (energy(y + u) - energy(y - u)) - energy(y + 2 * u) + energy(y - 2 * u)) / (12 * h) for u in unit]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-7, atol=1e-7 * np.abs(numeric).max())
    own, hessian = model.gradient(y)
    np.testing.assert_allclose(own, gradient[: own.size], rtol=1e-10, atol=1e-10 * np.abs(own).max())
    steps = [(model.gradient(y + u)[0] - model.gradient(y - u)[0]) / (2 * h) for u in unit[: own.size]]
    np.testing.assert_allclose(hessian, steps, rtol=1e-3, atol=1e-4 * np.abs(hessian).max())


def test_the_cost_does_not_depend_on_the_particles(soft):
    # the packed factor has at most as many rows as columns, however many links the modes have
    scene = cp.make_scene(soft)
    sizes = []
    for links in (40, 120):
        modes = cp.pod.decompose(cp.chain.simulate(scene, links=links, step=1e-4), rank=2)
        sizes.append(galerkin_model.model_of(parameters(scene), modes, rank=2, law="green").packed[0].shape)
    assert sizes[0] == sizes[1]


@pytest.mark.parametrize("law", ["green", "linear"])
@pytest.mark.parametrize("name", [name for name in TERMS if name != "unequal links"])
def test_second_order_in_the_step(soft, law, name):
    scene = cp.make_scene({**soft, **TERMS[name]})
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3))
    runs = [
        cp.galerkin.simulate(scene, modes, rank=2, law=law, times=[1.0, 2.0, 4.0], step=h).position.values
        for h in (1 / 1600, 1 / 3200, 1 / 6400, 1 / 12800)
    ]
    distance = [np.abs(a - b).max() for a, b in itertools.pairwise(runs)]
    np.testing.assert_allclose(np.log2(np.divide(distance[:-1], distance[1:])), 2.0, atol=0.1)


@pytest.mark.parametrize("law", ["green", "linear"])
def test_equilibrium_stays_at_rest(soft, law):
    modes = cp.pod.decompose(cp.chain.simulate(cp.make_scene(soft), step=1e-3))
    still = cp.make_scene({**soft, "motion": {}})
    run = cp.galerkin.simulate(still, modes, rank=3, law=law)
    assert float(np.abs(run.position - run.position[0]).max()) < 1e-11


def test_saving_more_often_changes_no_bit_and_no_input_changes(soft):
    scene = cp.make_scene(soft)
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3))
    before = scene.copy(deep=True), modes.copy(deep=True)
    every = cp.galerkin.simulate(scene, modes, rank=2, times=np.arange(4001) / 1000, step=1e-3)
    few = cp.galerkin.simulate(scene, modes, rank=2, times=[0.5, 4.0], step=1e-3)
    np.testing.assert_array_equal(few.position, every.position[[500, 4000]])
    xr.testing.assert_identical(scene, before[0])
    xr.testing.assert_identical(modes, before[1])


def test_modes_transfer_by_sigma_to_another_cable(soft):
    scene = cp.make_scene(soft)
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3), rank=4)
    other = cp.make_scene({**soft, "cable": {**soft["cable"], "top_tension": 230.0}})
    run = cp.galerkin.simulate(other, modes)
    truth = cp.chain.simulate(other)
    assert float(run.unstretched_length) == pytest.approx(float(truth.unstretched_length), rel=1e-14)
    assert float(cp.compare.errors(run, truth).error_max) < 0.1


def test_amplitudes_reconstruct_the_positions(soft):
    scene = cp.make_scene(soft)
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3), rank=3)
    run = cp.galerkin.simulate(scene, modes, step=1e-3)
    np.testing.assert_allclose(cp.pod.reconstruct(run, modes).position, run.position, atol=1e-13)
    bare = cp.galerkin.simulate(scene, modes, step=1e-3, outputs=())
    assert "position" not in bare
    np.testing.assert_array_equal(bare.amplitude, run.amplitude)


def test_extremes_are_taken_over_all_steps(soft):
    scene = cp.make_scene(soft)
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3), rank=2)
    run = cp.galerkin.simulate(
        scene, modes, times=np.arange(4001) / 1000, step=1e-3, outputs=("tension", "tension_extremes")
    )
    np.testing.assert_allclose(run.tension_maximum, run.tension.max("time"), rtol=1e-12)
    np.testing.assert_allclose(run.tension_minimum, run.tension.min("time"), rtol=1e-12)


def test_the_default_step_is_stable_and_accurate_without_help(soft):
    scene = cp.make_scene({**soft, "cable": {**soft["cable"], "youngs_modulus": 2e9}})  # a hundred times stiffer
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-4))
    run = cp.galerkin.simulate(scene, modes, rank=4)
    exact = cp.galerkin.simulate(scene, modes, rank=4, step=run.attrs["step"] / 16)
    assert float(cp.compare.errors(run, exact).error_max) < 1e-6


def test_a_step_above_the_limit_is_refused_and_one_that_is_outgrown_stops(soft):
    scene = cp.make_scene(soft)
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3), rank=2)
    limit = cp.galerkin.simulate(scene, modes, step=1e-3).attrs["step_limit"]
    with pytest.raises(cp.SceneError, match=rf"step: given .*; allowed: below .*{limit:.6g} s"):
        cp.galerkin.simulate(scene, modes, step=1.001 * limit)
    # a pull makes the cable stiffer: a little, and the step is found too long afterwards; more, and the run breaks down
    for amplitude, part, match in (
        (0.002, 0.99999, "stiffened: at .* below the step"),
        (0.5, 0.995, "left the finite numbers at"),
    ):
        motion = {"upper": {"x": {"kind": "ramp", "amplitude": amplitude, "duration": 4.0}}}
        pulled = cp.make_scene({**soft, "motion": motion})
        with pytest.raises(cp.RunStopped, match=match) as stopped:
            cp.galerkin.simulate(pulled, modes, step=part * limit)
        assert np.isfinite(stopped.value.partial.position).all()
        assert np.isfinite(cp.galerkin.simulate(pulled, modes, tolerance=1e-3).position).all()


def test_scenes_and_options_that_cannot_be(soft):
    scene = cp.make_scene(soft)
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3), rank=2)
    cases = [
        (scene, {"law": "hooke"}, 'law: given \'hooke\'; allowed: one of "linear", "green"'),
        (scene, {"rank": 3}, "rank: given 3; allowed: at most 2"),
        (scene, {"scheme": "rk4"}, "scheme: given 'rk4'"),
        (
            cp.make_scene({**soft, "motion": {}, "ends": {**soft["ends"], "free": "upper"}}),
            {},
            r"ends\.free: given 'upper'",
        ),
        (cp.make_scene({**soft, "damping": {"link_viscosity": 1.0}}), {}, r"damping\.link_viscosity: given 1\.0"),
        (cp.make_scene(spatial(soft)), {}, "modes: given 2 coordinates; allowed: the 3 coordinates of the scene"),
    ]
    for some, options, match in cases:
        with pytest.raises(cp.SceneError, match=match):
            cp.galerkin.simulate(some, modes, **options)
    with pytest.raises(cp.SceneError, match=r"modes: given a Dataset without mode_shape.*pod\.decompose"):
        cp.galerkin.simulate(scene, scene)
