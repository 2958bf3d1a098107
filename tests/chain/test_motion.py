"""Motion of the elastic chain: analytic results, order, identities."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from convergence import distances, orders
from scenes import TERMS as SHARED
from scenes import along, energies, scene_with
from suite import slow

import cablepod as cp

TERMS = {
    **SHARED,
    "link viscosity": {"damping": {"link_viscosity": 0.002}},
    "unequal links": {"chain": {"link_lengths": [1.0, 2.0, 1.0, 0.5, 2.0, 1.0, 1.0, 3.0]}},
    "initial shape": {"initial": {"top_tension": 260.0}},
}


def positions(scene, **options):
    return cp.chain.simulate(scene, **options).position.values


def test_positions_that_two_independent_schemes_agree_on(scenes):
    # mass 20 of 39 in Example 2, known to 3e-12 m; the default step keeps 1e-6 of a motion of 0.1 m
    run = cp.chain.simulate(cp.read_scene(scenes / "example2.toml"), times=[5.0, 45.0, 125.0])
    known = [[10.300121695, 28.812870094], [10.389263084, 28.768181787], [10.297997392, 28.815093996]]
    np.testing.assert_allclose(run.position[:, 20], known, rtol=0, atol=2e-8)
    assert run.attrs["time_error_estimate"] < 1e-6


def test_small_vibrations_of_a_taut_chain_have_the_frequencies_of_the_discrete_string():
    # weightless, tension T, n links: omega_j = 2 sqrt(T / (l m)) sin(j pi / 2 n), here with the stretched link l (1 + T/K)
    n, tension, stiffness, span = 12, 500.0, 1e6, 6.0
    length = span / (1 + tension / stiffness)
    line = np.stack([np.linspace(0, span, n + 1), 1e-7 * np.sin(np.pi * np.linspace(0, 1, n + 1))], axis=1)
    scene = along(line, length, 1e9)
    mass, link = length / n, span / n
    omega = 2 * np.sqrt(tension / (link * mass)) * np.sin(np.pi / (2 * n))
    times = np.linspace(0.0, 2 * np.pi / omega, 9)
    run = cp.chain.simulate(scene, times=times, step=1e-5)
    # amplitude 1e-7 of 6 m: nonlinear terms are of relative order 1e-10, the step of (omega h)^2/24 ~ 1e-9
    np.testing.assert_allclose(run.position[:, n // 2, 1], 1e-7 * np.cos(omega * times), rtol=0, atol=1e-14)


def test_slack_links_do_not_push():
    # a mass between two slack links falls freely until they tighten
    scene = cp.make_scene(
        {
            "cable": {"youngs_modulus": 1e6, "area": 1e-3, "density": 2000.0, "unstretched_length": 6.0},
            "ends": {"lower": [0.0, 0.0], "upper": [4.0, 0.0]},
            "initial": {"points": [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]]},
            "chain": {"links": 2},
        }
    )
    times = np.linspace(0.0, 0.6, 7)  # taut from a fall of sqrt(9 - 4) m, at 0.675 s, on
    run = cp.chain.simulate(scene, times=times, step=1e-3, outputs=("position", "tension", "velocity"))
    # Verlet is exact for constant acceleration
    np.testing.assert_allclose(run.position[:, 1, 1], -0.5 * 9.81 * times**2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.velocity[:, 1, 1], -9.81 * times, rtol=0, atol=1e-12)
    assert not run.tension.any()


def test_a_released_end_carries_half_a_link(soft):
    scene = scene_with(soft, ends={**soft["ends"], "free": "upper"}, motion={})
    run = cp.chain.simulate(scene, times=[0.0, 1e-3, 2e-3], step=1e-4, outputs=("velocity",))
    rest = cp.chain.rest(scene)
    reach = (rest.position[-1] - rest.position[-2]).values
    pull = -float(rest.tension[-1]) * reach / np.linalg.norm(reach)
    mass = 1.0 * float(rest.unstretched_length) / 8 / 2
    # to first order in t: the pull itself changes by (omega t)^2 / 2 with omega ~ 2e2 rad/s, 2 % at 1 ms
    np.testing.assert_allclose(run.velocity[1, -1], 1e-3 * (pull / mass + [0, -9.81]), rtol=0.05)


def test_a_line_is_scaled_between_held_ends_and_cut_at_a_free_one(soft):
    cable = {**soft["cable"], "unstretched_length": 8.0}
    del cable["top_tension"]
    ends = {"lower": [0.0, 0.0], "upper": [8.0, 0.0]}
    line = {"points": [[0.0, 0.0], [4.0, 3.0], [8.0, 0.0]]}  # 10 m

    def laid(**changes):
        return positions(scene_with(soft, cable=cable, initial=line, motion={}, **changes), times=[0.0], step=1e-3)[0]

    held = laid(ends=ends)
    np.testing.assert_allclose(held[[2, 4, 8]], [[2.0, 1.5], [4.0, 3.0], [8.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(laid(ends={**ends, "free": "upper"})[[4, 8]], [[3.2, 2.4], [6.4, 1.2]], atol=1e-12)
    np.testing.assert_allclose(laid(ends={**ends, "free": "lower"})[[0, 8]], [[1.6, 1.2], [8.0, 0.0]], atol=1e-12)
    cable["unstretched_length"] = 10.1
    with pytest.raises(cp.SceneError, match=r"initial\.points: given a line of 10 m; allowed: at least .*10\.1 m"):
        laid(ends={**ends, "free": "upper"})


@pytest.mark.parametrize(
    ("law", "name"),
    [("linear", name) for name in TERMS]
    + [
        slow("green", name) if name == "mass damping" else ("green", name) for name in TERMS if name != "link viscosity"
    ],
)
def test_second_order_in_the_step_with_every_term(soft, law, name):
    scene = scene_with(soft, **TERMS[name])
    # by law (21) the outputs of the comparison with the cable, so that both need the same compiled loops
    outputs = ("position",) if law == "linear" else ("position", "tension_extremes")
    options = {"times": [1.0, 2.0, 4.0], "law": law, "outputs": outputs}
    runs = [positions(scene, step=h, **options) for h in (1 / 1600, 1 / 3200, 1 / 6400, 1 / 12800)]
    np.testing.assert_allclose(orders(distances(runs)), 2.0, atol=0.1)


def test_second_order_in_the_number_of_links(soft):
    scene = scene_with(soft)
    runs = [positions(scene, links=n, times=[0.5, 1.0], step=1 / 8000)[:, :: n // 8] for n in (16, 32, 64, 128)]
    distance = [np.sqrt(np.mean((a - b) ** 2)) for a, b in itertools.pairwise(runs)]
    np.testing.assert_allclose(orders(distance), 2.0, atol=0.1)


def test_saving_more_often_changes_no_bit(soft):
    scene = scene_with(soft, damping={"mass_proportional": 0.3, "link_viscosity": 0.001})
    every = positions(scene, times=np.arange(0, 4001) / 1000, step=1e-3)
    few = cp.chain.simulate(scene, times=[0.5, 2.0, 4.0], step=1e-3, outputs=("position", "velocity", "tension"))
    np.testing.assert_array_equal(few.position, every[[500, 2000, 4000]])
    # nor does the default step depend on the instants
    steps = {cp.chain.simulate(scene, times=t).attrs["step"] for t in ([4.0], [0.25, 4.0], [0.1, 1 / 3, 4.0])}
    assert len(steps) == 1


def test_between_steps_the_output_has_the_order_of_the_scheme(soft):
    scene = scene_with(soft)
    times = np.sort(np.random.default_rng(1).uniform(0, 4, 40))
    exact = cp.chain.simulate(scene, times=times, step=1 / 128000, outputs=("position", "velocity"))
    errors = []
    for rate in (2000, 4000, 8000):
        run = cp.chain.simulate(scene, times=times, step=1 / rate, outputs=("position", "velocity"))
        errors.append([float(np.abs(run[name] - exact[name]).max()) for name in ("position", "velocity")])
    np.testing.assert_allclose(orders(errors), 2.0, atol=0.15)


@pytest.mark.parametrize("law", ["linear", "green"])
def test_energy_is_kept(soft, law):
    scene = scene_with(soft, motion={}, initial={"top_tension": 300.0})
    spread = {}
    for rate in (500, 1000):
        # until 4 s and until 40 s: a symplectic scheme has an error that oscillates and does not drift
        times, outputs = np.arange(0, 40001, 40) / 1000, ("position", "velocity")
        run = cp.chain.simulate(scene, times=times, step=1 / rate, law=law, outputs=outputs)
        kinetic, strain, weight = energies(scene, run, law)
        energy = kinetic + strain + weight
        spread[rate] = [np.ptp(part) / kinetic.max() for part in (energy[:101], energy)]
    assert spread[1000][1] < 0.02
    assert spread[1000][1] < 1.5 * spread[1000][0]
    assert spread[500][0] / spread[1000][0] == pytest.approx(4.0, rel=0.15)


def test_viscous_links_damp_only_the_axial_motion(soft):
    # one longitudinal mode of a straight weightless chain decays as exp(-nu omega^2 t / 2)
    n, span = 8, 4.0
    length = span / 1.01
    s = np.linspace(0, 1, n + 1)
    line = np.stack([span * (s + 1e-6 * np.sin(np.pi * s)), 0 * s], axis=1)
    nu = 0.004
    scene = along(line, length, damping={"link_viscosity": nu})
    link = length / n
    omega = 2 * np.sqrt(1e3 / link / link) * np.sin(np.pi / (2 * n))
    ratio = nu * omega / 2
    damped = omega * np.sqrt(1 - ratio**2)
    times = np.linspace(0, 0.5, 11)
    run = cp.chain.simulate(scene, times=times, step=1e-5)
    decay = np.exp(-ratio * omega * times)
    exact = decay * (np.cos(damped * times) + ratio * omega / damped * np.sin(damped * times))
    moved = (run.position[:, n // 2, 0].values - span / 2) / (1e-6 * span)
    # the strain of 1e-6 against a prestrain of 1e-2 makes no link slack; the step is second order, (omega h)^2 ~ 4e-7
    np.testing.assert_allclose(moved, exact, atol=2e-5)
