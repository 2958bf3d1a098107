"""The elastic chain: against analytic results, its order, identities, and what it refuses."""

from __future__ import annotations

import copy
import itertools

import numpy as np
import pytest
import xarray as xr
from scenes import TERMS as SHARED
from scenes import spatial

import cablepod as cp
from cablepod import cable_runs, chain_runs, chain_start, links
from cablepod.implicit import ImplicitRun
from cablepod.parameters import parameters
from cablepod.verlet import VerletRun

TERMS = {
    **SHARED,
    "link viscosity": {"damping": {"link_viscosity": 0.002}},
    "initial shape": {"initial": {"top_tension": 260.0}},
}


def of(soft, **changes):
    return cp.make_scene({**soft, **changes})


def positions(scene, **options):
    return cp.chain.simulate(scene, **options).position.values


# --- rest -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_rest_is_in_equilibrium(scenes, number):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    rest = cp.chain.rest(scene)
    assert float(rest.residual) < 1e-9 * float(rest.tension.max())
    # and by the law of the chain from the positions alone, whose rounding is worth 1e-7 N here
    chain = links.chain_of(parameters(scene))
    force = chain.pull(rest.position.values)[1]
    left = force[1:] - force[:-1] + chain.loads(0.0)[1:-1]
    assert np.abs(left).max() < 1e-9 * float(rest.tension.max())


@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e7, 1e10, 1e13])
@pytest.mark.parametrize("length", [60.0, 61.15, 61.3, 80.0, 180.0])
def test_rest_from_soft_to_stiff_and_taut_to_slack(scenes, stiffness, length):
    scene = cp.read_scene(scenes / "example2.toml").drop_vars("cable_top_tension")
    scene = scene.assign(
        cable_unstretched_length=((), length), cable_youngs_modulus=((), stiffness / float(scene.cable_area))
    )
    rest = cp.chain.rest(scene)
    assert float(rest.residual) < 1e-9 * float(rest.tension.max())
    stretched = np.linalg.norm(rest.position.diff("particle"), axis=1)
    law = (stretched / (length / 40) - 1) * stiffness
    # rounding of positions of 60 m (and sagging further) in links of 1.5 m: 1e-14 relative to the link
    np.testing.assert_allclose(rest.tension, law, rtol=1e-11, atol=1e-12 * stiffness)


def test_rest_tends_to_the_catenary_as_the_square_of_the_link(soft):
    scene = of(soft)
    errors = []
    for n in (10, 20, 40):
        exact = cp.catenary.rest(scene, points=n + 1)
        errors.append(float(np.abs(cp.chain.rest(scene, links=n).position - exact.position).max()))
    order = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(order, 2.0, atol=0.1)


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
    scene = of(
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


# --- motion against what is known -------------------------------------------------------------------------------------


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
    scene = cp.make_scene(
        {
            "gravity": 0.0,
            "cable": {"youngs_modulus": 1e9, "area": 1e-3, "density": 1000.0, "unstretched_length": length},
            "ends": {"lower": [0.0, 0.0], "upper": [span, 0.0]},
            "initial": {"points": line.tolist()},
            "chain": {"links": n},
        }
    )
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
    scene = of(soft, ends={**soft["ends"], "free": "upper"}, motion={})
    run = cp.chain.simulate(scene, times=[0.0, 1e-3, 2e-3], step=1e-4, outputs=("velocity",))
    rest = cp.chain.rest(scene)
    reach = (rest.position[-1] - rest.position[-2]).values
    pull = -float(rest.tension[-1]) * reach / np.linalg.norm(reach)
    mass = 1.0 * float(rest.unstretched_length) / 8 / 2
    # to first order in t: the pull itself changes by (omega t)^2 / 2 with omega ~ 2e2 rad/s, 2 % at 1 ms
    np.testing.assert_allclose(run.velocity[1, -1], 1e-3 * (pull / mass + [0, -9.81]), rtol=0.05)


def test_a_line_is_shared_out_between_held_ends_and_laid_out_to_a_free_one(soft):
    cable = {**soft["cable"], "unstretched_length": 8.0}
    del cable["top_tension"]
    ends = {"lower": [0.0, 0.0], "upper": [8.0, 0.0]}
    line = {"points": [[0.0, 0.0], [4.0, 3.0], [8.0, 0.0]]}  # 10 m

    def laid(**changes):
        return positions(of(soft, cable=cable, initial=line, motion={}, **changes), times=[0.0], step=1e-3)[0]

    held = laid(ends=ends)
    np.testing.assert_allclose(held[[2, 4, 8]], [[2.0, 1.5], [4.0, 3.0], [8.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(laid(ends={**ends, "free": "upper"})[[4, 8]], [[3.2, 2.4], [6.4, 1.2]], atol=1e-12)
    np.testing.assert_allclose(laid(ends={**ends, "free": "lower"})[[0, 8]], [[1.6, 1.2], [8.0, 0.0]], atol=1e-12)
    cable["unstretched_length"] = 10.1
    with pytest.raises(cp.SceneError, match=r"initial\.points: given a line of 10 m; allowed: at least .*10\.1 m"):
        laid(ends={**ends, "free": "upper"})


def test_a_free_lower_end_is_a_free_upper_end_seen_from_the_other_side(soft):
    lengths = [1.0, 2.0, 3.0, 1.5]
    upper = of(soft, ends={**soft["ends"], "free": "upper"}, motion={}, chain={"link_lengths": lengths})
    ends = {"lower": soft["ends"]["upper"], "upper": soft["ends"]["lower"], "free": "lower"}
    cable = {**soft["cable"], "bottom_tension": soft["cable"]["top_tension"]}
    del cable["top_tension"]
    lower = of(soft, ends=ends, cable=cable, motion={}, chain={"link_lengths": lengths[::-1]})
    a, b = (positions(scene, times=[0.2, 0.4], step=1e-3) for scene in (upper, lower))
    # rounding of the rest, 1e-15 of 10 m, over 400 steps of a motion that is not chaotic yet
    np.testing.assert_allclose(b[:, ::-1], a, atol=1e-11)


# --- order and identities ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TERMS)
def test_second_order_in_the_step_with_every_term(soft, name):
    scene = of(soft, **TERMS[name])
    times = [1.0, 2.0, 4.0]
    runs = [positions(scene, times=times, step=h) for h in (1 / 1600, 1 / 3200, 1 / 6400, 1 / 12800)]
    distance = [np.abs(a - b).max() for a, b in itertools.pairwise(runs)]
    np.testing.assert_allclose(np.log2(np.divide(distance[:-1], distance[1:])), 2.0, atol=0.1)


def test_second_order_in_the_number_of_links(soft):
    scene = of(soft)
    runs = [positions(scene, links=n, times=[0.5, 1.0], step=1 / 8000)[:, :: n // 8] for n in (16, 32, 64, 128)]
    distance = [np.sqrt(np.mean((a - b) ** 2)) for a, b in itertools.pairwise(runs)]
    np.testing.assert_allclose(np.log2(np.divide(distance[:-1], distance[1:])), 2.0, atol=0.1)


@pytest.mark.parametrize("name", TERMS)
def test_planar_and_spatial_agree_bit_for_bit(soft, name):
    mapping = {**soft, **copy.deepcopy(TERMS[name])}
    outputs = ("position", "velocity", "tension", "tension_extremes")
    flat = cp.chain.simulate(cp.make_scene(mapping), outputs=outputs)
    deep = cp.chain.simulate(cp.make_scene(spatial(mapping)), outputs=outputs)
    np.testing.assert_array_equal(deep.position[..., :2], flat.position)
    np.testing.assert_array_equal(deep.velocity[..., :2], flat.velocity)
    for name in ("tension", "tension_minimum", "tension_maximum"):
        np.testing.assert_array_equal(deep[name], flat[name])
    assert not deep.position[..., 2].any()


def test_a_turned_scene_moves_likewise(soft):
    # spatial scenes have no preferred horizontal axis: turn about y by 40 degrees
    c, s = np.cos(np.radians(40)), np.sin(np.radians(40))
    mapping = spatial(soft)
    turned = copy.deepcopy(mapping)
    turned["ends"]["upper"] = [8.0 * c, 6.0, -8.0 * s]
    motion = soft["motion"]["upper"]["x"]
    turned["motion"]["upper"] = {
        "x": {**motion, "amplitude": motion["amplitude"] * c},
        "z": {**motion, "amplitude": -motion["amplitude"] * s},
    }
    a = positions(cp.make_scene(mapping), step=1e-3)
    b = positions(cp.make_scene(turned), step=1e-3)
    expected = np.stack([a[..., 0] * c, a[..., 1], -a[..., 0] * s], axis=-1)
    # rounding of the turned ends, 1e-15, and of their motion, grown over 4000 steps
    np.testing.assert_allclose(b, expected, rtol=0, atol=1e-11)


def test_saving_more_often_changes_no_bit(soft):
    scene = of(soft, damping={"mass_proportional": 0.3, "link_viscosity": 0.001})
    every = positions(scene, times=np.arange(0, 4001) / 1000, step=1e-3)
    few = cp.chain.simulate(scene, times=[0.5, 2.0, 4.0], step=1e-3, outputs=("position", "velocity", "tension"))
    np.testing.assert_array_equal(few.position, every[[500, 2000, 4000]])
    # nor does the default step depend on the instants
    steps = {cp.chain.simulate(scene, times=t).attrs["step"] for t in ([4.0], [0.25, 4.0], [0.1, 1 / 3, 4.0])}
    assert len(steps) == 1


def test_between_steps_the_output_has_the_order_of_the_scheme(soft):
    scene = of(soft)
    times = np.sort(np.random.default_rng(1).uniform(0, 4, 40))
    exact = cp.chain.simulate(scene, times=times, step=1 / 128000, outputs=("position", "velocity"))
    errors = []
    for rate in (2000, 4000, 8000):
        run = cp.chain.simulate(scene, times=times, step=1 / rate, outputs=("position", "velocity"))
        errors.append([float(np.abs(run[name] - exact[name]).max()) for name in ("position", "velocity")])
    order = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(order, 2.0, atol=0.15)


def test_equilibrium_stays_at_rest(soft):
    scene = of(soft, motion={}, point_load=[{"arc_length": 0.4, "force": [0.0, -20.0]}])
    run = cp.chain.simulate(scene)
    # rounding of the rest, 1e-15 of 10 m times k/k, set swinging
    assert float(np.abs(run.position - run.position[0]).max()) < 1e-12


def test_energy_is_kept_and_time_can_be_turned_back(soft):
    scene = of(soft, motion={}, initial={"top_tension": 300.0})
    energies = {}
    for rate in (500, 1000):
        run = cp.chain.simulate(
            scene, times=np.arange(0, 4001, 40) / 1000, step=1 / rate, outputs=("position", "velocity")
        )
        p = parameters(scene)
        chain = links.chain_of(p)
        mass = p.mass * chain.share
        stretch = np.linalg.norm(np.diff(run.position, axis=1), axis=2) - chain.length
        energy = (
            0.5 * np.sum(mass[:, None] * run.velocity.values**2, axis=(1, 2))
            + 0.5 * np.sum(chain.k * np.maximum(stretch, 0) ** 2, axis=1)
            + 9.81 * np.sum(mass * run.position[..., 1].values, axis=1)
        )
        energies[rate] = np.ptp(energy) / np.sum(0.5 * mass[:, None] * run.velocity.values**2, axis=(1, 2)).max()
    # a symplectic scheme: an error that oscillates, of second order, and does not drift
    assert energies[1000] < 0.02
    assert energies[500] / energies[1000] == pytest.approx(4.0, rel=0.15)


def test_viscous_links_take_out_the_axial_motion_and_only_that(soft):
    # one longitudinal mode of a straight weightless chain decays as exp(-nu omega^2 t / 2)
    n, span = 8, 4.0
    length = span / 1.01
    s = np.linspace(0, 1, n + 1)
    line = np.stack([span * (s + 1e-6 * np.sin(np.pi * s)), 0 * s], axis=1)
    nu = 0.004
    scene = cp.make_scene(
        {
            "gravity": 0.0,
            "cable": {"youngs_modulus": 1e6, "area": 1e-3, "density": 1000.0, "unstretched_length": length},
            "ends": {"lower": [0.0, 0.0], "upper": [span, 0.0]},
            "initial": {"points": line.tolist()},
            "chain": {"links": n},
            "damping": {"link_viscosity": nu},
        }
    )
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


def test_extremes_are_taken_over_all_steps(soft):
    scene = of(soft)
    run = cp.chain.simulate(scene, times=np.arange(0, 4001) / 1000, step=1e-3, outputs=("tension", "tension_extremes"))
    np.testing.assert_allclose(run.tension_maximum, run.tension.max("time"), rtol=1e-11)
    np.testing.assert_allclose(run.tension_minimum, run.tension.min("time"), rtol=1e-11)
    few = cp.chain.simulate(scene, times=[4.0], step=1e-3, outputs=("tension_extremes",))
    np.testing.assert_array_equal(few.tension_maximum, run.tension_maximum)
    assert "position" not in few


def test_members_run_as_if_alone(soft):
    maps = [soft, {**soft, "cable": {**soft["cable"], "top_tension": 240.0}}]
    scenes = [cp.make_scene(m) for m in maps]
    both = xr.concat(scenes, "member", combine_attrs="override")
    before = both.copy(deep=True)
    run = cp.chain.simulate(both, step=1e-3)
    xr.testing.assert_identical(both, before)
    assert run.position.dims == ("member", "time", "particle", "coordinate")
    assert run.cable_top_tension.dims == ("member",)
    for i, scene in enumerate(scenes):
        np.testing.assert_array_equal(run.position[i], cp.chain.simulate(scene, step=1e-3).position)


def test_no_call_changes_its_input(soft):
    scene = of(soft)
    before = scene.copy(deep=True)
    cp.chain.rest(scene)
    cp.chain.simulate(scene)
    xr.testing.assert_identical(scene, before)


# --- step -------------------------------------------------------------------------------------------------------------


def test_the_stability_limit_is_where_it_is_predicted(soft):
    # a straight, weightless chain: its highest axial frequency is the bound itself
    s = np.linspace(0, 1, 9)
    jitter = 1e-7 * np.where(np.arange(9) % 2, 1.0, -1.0)
    jitter[[0, -1]] = 0
    line = np.stack([4.0 * s + jitter, 0 * s], axis=1)
    scene = cp.make_scene(
        {
            "gravity": 0.0,
            "cable": {"youngs_modulus": 1e6, "area": 1e-3, "density": 1000.0, "unstretched_length": 3.9},
            "ends": {"lower": [0.0, 0.0], "upper": [4.0, 0.0]},
            "initial": {"points": line.tolist()},
            "chain": {"links": 8},
        }
    )
    chain = links.chain_of(parameters(scene))
    limit = chain.step_limit()
    link = 3.9 / 8
    assert limit == pytest.approx(2 / (2 * np.sqrt(1e3 / link**2) * np.cos(np.pi / 16)), rel=1e-12)

    def largest(step):
        run = VerletRun(chain, np.array([1000 * step]), chain_start.start(chain), ("position",), None, "")
        return np.abs(run(1 / step).position - line).max()

    assert largest(0.999 * limit) < 1e-5
    with pytest.raises(cp.RunStopped, match="broke down"):
        largest(1.01 * limit)


@pytest.mark.parametrize("viscosity", [1e-3, 1e-2, 0.1])
def test_the_stability_limit_with_viscous_links(soft, viscosity):
    scene = of(soft, motion={}, damping={"link_viscosity": viscosity})
    chain = links.chain_of(parameters(scene))
    limit = chain.step_limit()
    assert limit < 2 / chain.highest_frequency()
    start = chain_start.start(chain)
    start[1:-1:2] += 1e-9

    def largest(step):
        run = VerletRun(chain, np.array([3000 * step]), start, ("position",), None, "")
        return np.abs(run(1 / step).position - start).max()

    assert largest(0.99 * limit) < 1e-8
    # beyond, the fastest axial mode grows until links go slack
    assert largest(1.05 * limit) > 1e-6


def test_a_step_above_the_limit_is_refused_with_both_numbers(soft):
    scene = of(soft)
    limit = cp.chain.simulate(scene, step=1e-3).attrs["step_limit"]
    with pytest.raises(cp.SceneError, match=rf"step: given {1.01 * limit:.6g} s; allowed: below .* {limit:.6g} s"):
        cp.chain.simulate(scene, step=1.01 * limit)


def test_a_run_that_leaves_the_finite_numbers_stops_and_keeps_what_it_had(soft):
    scene = of(
        soft,
        motion={"upper": {"x": {"kind": "polynomial", "coefficients": [0.0] * 29 + [1e-3]}}},
        time={"duration": 1.0, "interval": 1.0},  # later it takes the end far away, which a scene may not say
    )
    times = np.arange(0, 4000.0)
    with pytest.raises(
        cp.RunStopped, match=r"left the finite numbers at .* s \(velocity Verlet, step 0.001 s.*try"
    ) as stopped:
        cp.chain.simulate(scene, times=times, step=1e-3)
    partial = stopped.value.partial
    assert 1 < partial.sizes["time"] < times.size
    assert np.isfinite(partial.position).all()
    assert "stopped at" in partial.attrs["incomplete"]
    np.testing.assert_array_equal(partial.position, positions(scene, times=partial.time.values, step=1e-3))


def test_a_tolerance_is_met(soft):
    scene = of(soft)
    exact = cp.chain.simulate(scene, step=1 / 64000)
    for tolerance in (1e-4, 1e-6):
        run = cp.chain.simulate(scene, tolerance=tolerance)
        error = float(cp.compare.errors(run, exact).error_max)
        # the estimate is a bound after two runs, and right within a factor of two after more
        assert error < 2 * run.attrs["time_error_estimate"]
        assert run.attrs["time_error_estimate"] <= tolerance
        assert error < tolerance


def test_the_tolerance_is_met_where_the_motion_begins_with_a_jump(soft):
    # an end that starts with a velocity sends a shock along the chain, for which the scheme is not of second order
    scene = of(
        soft,
        motion={"upper": {"x": {"kind": "harmonic", "amplitude": 0.03, "angular_frequency": 5.0}}},
        time={"duration": 4.0, "interval": 0.5},
    )
    run = cp.chain.simulate(scene)
    exact = cp.chain.simulate(scene, step=run.attrs["step"] / 16)
    assert float(cp.compare.errors(run, exact).error_max) < 1e-6


def test_finite_garbage_is_stopped(scenes):
    # links slacken and snap taut: the step is below the limit of taut links, 3.4e-4 s, yet every snap adds energy
    scene = cp.read_scene(scenes / "example3_swapped_rows.toml")
    said = r"the run broke down: at 99 s the links hold .* J, .* explain \(velocity_verlet, step 0\.00025 s, limit 0\.0"
    with pytest.raises(cp.RunStopped, match=said) as stopped:
        cp.chain.simulate(scene, step=2.5e-4)
    assert str(stopped.value).endswith("try a step half as long, or scheme energy_momentum")
    assert stopped.value.partial.sizes["time"] == 99
    assert stopped.value.partial.attrs["incomplete"] == "stopped at 99 s of 124 s"
    sound = cp.chain.simulate(scene, step=2e-4)
    assert sound.attrs["energy_excess"] < 0.01


def test_a_run_that_breaks_down_is_told_only_of_other_schemes(soft):
    about = (links.chain_of(parameters(cp.make_scene(soft))), np.zeros(1), np.zeros((9, 2)), ("position",), None, "")
    assert ImplicitRun(*about, method="trapezoidal").cure.endswith("or scheme energy_momentum")
    assert ImplicitRun(*about, method="energy_momentum").cure == "a step half as long"
    assert "energy_momentum" not in cable_runs.MeshVerlet(*about).cure


def test_an_unexplained_energy_is_warned_of(soft, monkeypatch):
    # with the limit set to what any motion holds
    monkeypatch.setattr(chain_runs, "SUSPECT", 1e-9)
    with pytest.warns(cp.NotConvergedWarning, match="times the energy that rest, loads and ends explain"):
        cp.chain.simulate(cp.make_scene(soft), step=1e-3)


@pytest.mark.parametrize("law", ["linear", "green"])
def test_the_energy_of_links(soft, law):
    p = parameters(cp.make_scene(soft))
    run = VerletRun(links.chain_of(p, law=law), np.array([1.0]), np.zeros((9, 2)), ("position",), None, "")
    stretched = np.linspace(0.0, 1.0, 9)[:, None] * [8.0, 6.0] * 1.1
    xi = 1.1 * 10.0 / run.chain.total_length
    expected = (
        p.stiffness * run.chain.total_length * (0.5 * (xi - 1.0) ** 2 if law == "linear" else (xi**2 - 1.0) ** 2 / 8.0)
    )
    assert run._strain_energy(stretched[None])[0] == pytest.approx(expected, rel=1e-9)


def test_a_chaotic_scene_is_said_to_be_one(scenes):
    scene = cp.read_scene(scenes / "example2.toml")
    wild = scene.assign(
        motion_upper_x_amplitude=scene.motion_upper_x_amplitude * 2,
        motion_upper_x_angular_frequency=scene.gravity * 0 + 2.0,
    )
    with pytest.warns(cp.NotConvergedWarning, match="two steps disagree: an error of"):
        cp.chain.simulate(wild, links=10, times=[45.0])


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"links": 1}, "links: given 1; allowed: a whole number of at least 2"),
        ({"links": True}, "links: given True"),
        ({"links": 10**12}, "links: .* GB of output; allowed: half of this machine's memory"),
        ({"scheme": "euler"}, 'scheme: given \'euler\'; allowed: one of "velocity_verlet", "trapez'),
        ({"step": -1.0}, "step: given -1.0; allowed: a finite number above 0"),
        ({"step": "fast"}, "step: given 'fast'"),
        ({"step": 1e-3, "tolerance": 1e-3}, "step and tolerance"),
        ({"tolerance": 0.0}, "tolerance: given 0.0"),
        ({"times": []}, r"times: given \[\]; allowed: finite, rising"),
        ({"times": [1.0, 1.0]}, "times: given"),
        ({"times": [-1.0]}, "times: given"),
        ({"times": [np.nan]}, "times: given"),
        ({"times": "now"}, "times: given 'now'"),
        ({"outputs": ("positions",)}, "outputs: given 'positions'; allowed: some of position"),
    ],
)
def test_options_that_cannot_be(soft, options, match):
    with pytest.raises(cp.SceneError, match=match):
        cp.chain.simulate(of(soft), **options)


# --- ends that start with a jolt ------------------------------------------------------------------------------------


def test_the_energy_of_a_jolt_is_that_of_the_axial_wave():
    # a straight cable without weight: until the wave arrives, the chain has its energy and the work against the first tension
    speed, stiffness, mass, length = 0.5, 2e4, 1.0, 10.0
    scene = cp.make_scene(
        {
            "gravity": 0.0,
            "cable": {"youngs_modulus": stiffness / 1e-3, "area": 1e-3, "density": 1000.0, "unstretched_length": length / 1.01},
            "ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0]},
            "motion": {"upper": {axis: {"kind": "polynomial", "coefficients": [speed * part]}
                                 for axis, part in (("x", 0.8), ("y", 0.6))}},
            "chain": {"links": 800},
        }
    )  # fmt: skip
    arrival = length / 1.01 / np.sqrt(stiffness / mass)
    run = cp.chain.simulate(
        scene, times=[0.0, 0.9 * arrival], step=0.25 * arrival / 800, outputs=("position", "velocity", "tension")
    )
    chain = links.chain_of(parameters(scene))
    kinetic = 0.5 * (mass * chain.share[1:-1, None] * run.velocity.values[1, 1:-1] ** 2).sum()
    strain = (run.tension**2 * chain.length / (2 * stiffness)).sum("link")
    work = run.tension[0, -1] * speed * 0.9 * arrival
    found = float(kinetic + strain[1] - strain[0] - work)
    # 0.9 of the way; the front of a chain is not sharp: a few links of 800
    assert found == pytest.approx(0.9 * run.attrs["start_jolt_energy"], rel=0.01)
    assert run.attrs["start_jolt_speed"] == pytest.approx(speed, rel=1e-12)
    behind = float((run.tension[1, 400:700] - run.tension[0, 400:700]).mean())
    assert behind == pytest.approx(run.attrs["start_jolt_tension"], rel=0.01)


def test_ends_that_start_smoothly_give_no_jolt(soft):
    run = cp.chain.simulate(cp.make_scene(soft), times=[0.0], scheme="trapezoidal", step=0.1)
    assert not [name for name in run.attrs if name.startswith("start_jolt")]
