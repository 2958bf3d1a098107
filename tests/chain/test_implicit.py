"""Implicit schemes of the chain: order, energy, links that slacken within a step, known solutions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from convergence import orders
from scenes import energies, pulled, scene_with
from suite import slow, slow_but

import cablepod as cp

SCHEMES = ("trapezoidal", "generalized_alpha", "energy_momentum")


def largest(run, truth):
    return float(np.abs(run.position - truth.position).max())


# --- accuracy -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", slow_but(SCHEMES, "energy_momentum"))
def test_second_order_with_moving_ends_and_law_21(soft, scheme):
    scene = scene_with(
        soft,
        motion={"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.2, "angular_frequency": 6.0}},
                "lower": {"y": {"kind": "one_minus_cosine", "amplitude": 0.1, "angular_frequency": 4.0}}},
        cable={**soft["cable"], "youngs_modulus": 4e5},
        time={"duration": 1.0, "interval": 0.25},
    )  # fmt: skip
    fine = cp.chain.simulate(scene, scheme="velocity_verlet", step=1e-5, law="green")
    runs = [cp.chain.simulate(scene, scheme=scheme, step=h, law="green") for h in (1e-3, 5e-4)]
    error = [largest(run, fine) for run in runs]
    assert orders(error) == pytest.approx([2.0], abs=0.1)


def test_example_2_with_steps_300_times_the_explicit_limit(scenes):
    scene = cp.read_scene(scenes / "example2.toml")
    truth = cp.chain.simulate(scene, scheme="velocity_verlet", step=1.25e-4)
    moved = float(np.sqrt(((truth.position - truth.position[0]) ** 2).sum("coordinate")).max())

    def at_45(step, **options):
        run = cp.chain.simulate(scene, scheme="trapezoidal", step=step, **options)
        gap = (run.position - truth.position).sel(time=45.0)
        return float(np.sqrt((gap**2).sum("coordinate")).max()) / moved

    assert at_45(0.1) < 2e-5
    assert at_45(0.01) < 2e-6


@pytest.mark.parametrize("damping", [{}, slow({"damping": {"mass_proportional": 0.5, "link_viscosity": 0.01}})])
@pytest.mark.parametrize("free", ["upper", "lower"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_released_end(soft, scheme, free, damping):
    ends = {**soft["ends"], "free": free}
    soft_cable = {**soft["cable"], "youngs_modulus": 4e5}
    time = {"duration": 0.6, "interval": 0.2}
    scene = scene_with(soft, motion={}, ends=ends, cable=soft_cable, time=time, **damping)
    fine = cp.chain.simulate(scene, scheme="velocity_verlet", step=1e-5)
    error = [largest(cp.chain.simulate(scene, scheme=scheme, step=h), fine) for h in (1e-3, 5e-4)]
    moved = float(np.abs(fine.position - fine.position[0]).max())
    assert moved > 0.5
    # links slacken as the end flies off, where forces have a kink: less than second order in these runs
    assert error[1] < 2e-3 * moved
    assert error[0] > 1.5 * error[1]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_outputs_between_steps(soft, scheme):
    scene = scene_with(soft)
    outputs = ("position", "velocity", "tension", "tension_extremes")
    run = cp.chain.simulate(scene, scheme=scheme, step=1e-3, times=[0.1, 0.5003], outputs=outputs)
    fine = cp.chain.simulate(scene, scheme="velocity_verlet", step=1e-5, times=[0.1, 0.5003], outputs=outputs)
    for name in outputs[:3]:
        scale = float(np.abs(fine[name]).max())
        np.testing.assert_allclose(run[name], fine[name], atol=2e-3 * scale)
    for name in ("tension_minimum", "tension_maximum"):
        np.testing.assert_allclose(run[name], fine[name], atol=5e-3 * float(fine.tension_maximum.max()))


# --- energy -------------------------------------------------------------------------------------------------------


def energy(scene, run, law="linear"):
    """Kinetic, strain and potential energy over time [J]."""
    return sum(energies(scene, run, law))


def test_the_energy_momentum_method_keeps_the_energy_of_a_violent_motion(soft):
    # links slacken and snap taut; steps far beyond the explicit limit
    scene = scene_with(
        soft,
        motion={},
        initial={"points": [[0.0, 0.0], [2.0, 6.5], [8.0, 6.0]]},
        time={"duration": 20.0, "interval": 0.5},
    )
    run = cp.chain.simulate(
        scene, scheme="energy_momentum", step=2e-3, outputs=("position", "velocity", "tension_extremes")
    )
    found = energy(scene, run)
    assert float(run.tension_minimum.min()) == 0.0
    np.testing.assert_allclose(found, found[0], rtol=1e-8)
    rough = energy(scene, cp.chain.simulate(scene, scheme="trapezoidal", step=2e-3, outputs=("position", "velocity")))
    assert np.ptp(rough) > 1e3 * np.ptp(found)


@pytest.mark.parametrize("law", ["linear", slow("green")])
def test_the_energy_does_not_drift(soft, law):
    scene = pulled(soft).assign(time_duration=1000.0, time_interval=10.0)
    run = cp.chain.simulate(scene, scheme="energy_momentum", step=0.05, law=law, outputs=("position", "velocity"))
    found, kinetic = energy(scene, run, law), energies(scene, run, law)[0].max()
    assert kinetic > 0.1
    # 20 000 steps, each right to 1e-13 of a link
    assert np.abs(found - found[0]).max() < 1e-9 * kinetic


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.9, 1.0])
def test_generalized_alpha_damps_unresolved_frequencies(soft, radius):
    # one mass between two stiff links, moved along them by far less than their stretch: a linear oscillator of 2.8e4 rad/s
    taut = {**soft["cable"], "youngs_modulus": 2e12, "density": 1.0, "top_tension": 2e6}
    start = [[0.0, 0.0], [4.0 * (1.0 + 1e-5), 3.0 * (1.0 + 1e-5)], [8.0, 6.0]]
    scene = scene_with(soft, motion={}, cable=taut, chain={"links": 2}, initial={"points": start})
    run = cp.chain.simulate(
        scene,
        scheme="generalized_alpha",
        spectral_radius=radius,
        step=0.5,
        times=np.arange(1, 21) * 0.5,
        outputs=("velocity",),
    )
    speed = np.sqrt((run.velocity.isel(particle=1) ** 2).sum("coordinate")).values
    # the roots are double: (A + B n) radius^n; at zero all is gone after two steps
    if radius == 0.0:
        assert speed[2:].max() < 1e-3 * speed[0]
    else:
        assert (speed[19] / speed[9]) ** 0.1 == pytest.approx(radius, abs=0.08)


# --- choices and refusals -----------------------------------------------------------------------------------------


def test_the_choice_of_scheme_follows_the_tolerance(scenes):
    scene = cp.read_scene(scenes / "example2.toml")
    loose = cp.chain.simulate(scene, tolerance=1e-3)
    assert loose.attrs["scheme"] == "trapezoidal"
    assert loose.attrs["step"] > 0.02  # sixty times the explicit limit
    assert loose.attrs["choice_of_scheme"].startswith("implicit: two runs with steps of ")
    tight = cp.chain.simulate(scene, tolerance=1e-6)
    assert tight.attrs["scheme"] == "velocity_verlet"
    assert tight.attrs["choice_of_scheme"].startswith("explicit: implicit runs with steps down to 0.00")
    assert float(cp.compare.errors(loose, tight).error_max) < 1e-3
    unasked = cp.chain.simulate(scene, times=[1.0])
    assert unasked.attrs["choice_of_scheme"].startswith("explicit: its runs were expected to take ")


@pytest.mark.parametrize("period", [slow(0.025), 0.00025])
@pytest.mark.parametrize("tolerance", [1e-1, 1e-3])
def test_steps_do_not_alias_a_fast_load(period, tolerance):
    # a load that every round step meets in the same phase: two runs with such steps agree, and both miss it
    factor = {"kind": "harmonic", "amplitude": 1.0, "angular_frequency": 2 * math.pi / period, "phase": 1.0}
    scene = cp.make_scene(
        {
            "cable": {"youngs_modulus": 2e10, "area": 1e-3, "density": 1000.0, "unstretched_length": 61.0},
            "ends": {"lower": [0.0, 0.0], "upper": [60.0, 0.0]},
            "load": {"uniform": [0.0, 200.0], **factor},
            "time": {"duration": 2.0, "interval": 0.5},
            "chain": {"links": 8},
        }
    )
    run = cp.chain.simulate(scene, tolerance=tolerance)
    truth = cp.chain.simulate(scene, scheme="velocity_verlet", step=period / 37.0 if period < 1e-3 else 1.3e-5)
    assert float(cp.compare.errors(run, truth).error_max) < tolerance


def test_a_step_that_does_not_converge_is_substepped(soft):
    # a tangle that is let go: links slacken and snap taut within a step
    tangle = np.random.default_rng(1).normal(size=(9, 2)) * 2 + np.linspace(0, 1, 9)[:, None] * [8, 6]
    tangle[0], tangle[-1] = 0.0, [8, 6]
    scene = scene_with(soft, motion={}, initial={"points": tangle.tolist()}, time={"duration": 4.0, "interval": 0.5})
    run = cp.chain.simulate(scene, scheme="energy_momentum", step=0.1, outputs=("position", "velocity"))
    assert run.attrs["steps_cut"] > 0
    found = energy(scene, run)
    np.testing.assert_allclose(found, found[0], rtol=1e-6)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_newton_converges_far_from_the_origin(soft, scheme):
    # where rounding of the coordinates is larger than the correction that would end the iteration near the origin
    away = np.array([3e5, -2e5])
    ends = {name: (np.array(place) + away).tolist() for name, place in soft["ends"].items()}
    near, there = (
        cp.chain.simulate(scene, scheme=scheme, step=0.05, times=np.arange(5) / 4)
        for scene in (pulled(soft), pulled(soft, ends=ends))
    )
    assert there.attrs["steps_cut"] == 0
    # rounding of 3e5 m is 6e-11 m; in 20 steps stiff links of 1e6 N/m make forces of it
    assert float(np.abs(there.position - away - near.position).max()) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES)
def test_newton_converges_where_the_chain_is_towed_far_away(soft, scheme):
    tow = {end: {"x": {"kind": "polynomial", "coefficients": [0.0, 5.0]}} for end in ("lower", "upper")}
    run = cp.chain.simulate(
        scene_with(soft, motion=tow, time={"duration": 400.0, "interval": 10.0}),
        scheme=scheme,
        step=0.05,
        times=[0.0, 400.0],
    )
    assert run.attrs["steps_cut"] == 0
    assert float(run.position[-1, 0, 0]) == pytest.approx(8e5)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_divergent_finite_runs_are_stopped(soft, any_load, scheme):
    blown = scene_with(
        soft, motion={}, ends={**soft["ends"], "free": "upper"}, load={"uniform": [1e6, 0.0]},
        time={"duration": 100.0, "interval": 10.0},
        cable={"youngs_modulus": 1e3, "area": 1e-3, "density": 1000.0, "unstretched_length": 10.0},
        initial={"points": [[0.0, 0.0], [8.0, 6.0]]},
    )  # fmt: skip
    with pytest.raises(cp.RunStopped, match="left the finite numbers"):
        cp.chain.simulate(blown, scheme=scheme, step=0.01)
