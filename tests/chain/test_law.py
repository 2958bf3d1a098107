"""Chain with law (21): Galerkin model of all modes, hand calculation, order, energy, stability limit."""

from __future__ import annotations

import copy
import itertools
import json
import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scenes import TERMS as SHARED
from scenes import spatial
from scipy.integrate import solve_ivp
from suite import slow, with_slow

import cablepod as cp

TERMS = {**SHARED, "unequal links": {"chain": {"link_lengths": [1.0, 2.0, 1.0, 0.5, 2.0, 1.0, 1.0, 3.0]}}}
#: Terms for which loops of their own are compiled; quick in the test of the order, but for the damping.
COMPILED = ("uniform load", "mass damping")

# a rubber band of 4 m, straight and without weight, pulled to xi = 2
RUBBER = {
    "title": "rubber",
    "gravity": 0.0,
    "cable": {"youngs_modulus": 1e6, "area": 1e-3, "density": 1000.0, "unstretched_length": 4.0},
    "ends": {"lower": [0.0, 0.0], "upper": [4.4, 0.0]},
    "motion": {"upper": {"x": {"kind": "ramp", "amplitude": 3.6, "duration": 2.0}}},
    "time": {"duration": 2.5, "interval": 0.25},
    "chain": {"links": 8},
}

# two links of 2.1 m on a line of 4 m: compressed to xi = 2 / 2.1, pulled down by nothing but a mass in the middle
COMPRESSED = {
    "gravity": 0.0,
    "cable": {"youngs_modulus": 1e6, "area": 1e-3, "density": 2000.0, "unstretched_length": 4.2},
    "ends": {"lower": [0.0, 0.0], "upper": [4.0, 0.0]},
    "initial": {"points": [[0.0, 0.0], [2.05, 0.0], [4.0, 0.0]]},
    "chain": {"links": 2},
}


def green(mapping, **options):
    return cp.chain.simulate(cp.make_scene(mapping), law="green", **options)


def stretch(run):
    length = np.diff(run.arc_length)
    return np.linalg.norm(run.position.diff("particle").values, axis=-1) / length


def law(xi, stiffness):
    return 0.5 * stiffness * xi * (xi**2 - 1)


# --- against what is known --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("name", with_slow(TERMS, *COMPILED))
def test_the_galerkin_model_of_all_modes_is_the_chain(soft, name, dims):
    # two codes with nothing in common but masses and loads: forces link by link here, packed energy there
    mapping = {**soft, **copy.deepcopy(TERMS[name])}
    if dims == 3:
        mapping = spatial(mapping)
        sideways = {"z": {"kind": "one_minus_cosine", "amplitude": 0.03, "angular_frequency": 1.5}}
        mapping["motion"] = {**mapping["motion"], "upper": {**mapping["motion"]["upper"], **sideways}}
    scene = cp.make_scene(mapping)
    # as by the linear law: the lifting and the motion of the ends differ by h^2 / 12 times the fourth derivative of the motion
    times, step = np.linspace(0, 4, 33), 1 / 8000
    outputs = ("position", "velocity", "tension")
    chain = cp.chain.simulate(scene, times=times, step=step, law="green", outputs=outputs)
    model = cp.galerkin.simulate(
        scene, cp.pod.decompose(chain), times=times, law="green", step=step, outputs=(*outputs, "tension_extremes")
    )
    assert float(cp.compare.errors(model, chain).error_max) < 1e-9
    np.testing.assert_allclose(model.velocity, chain.velocity, atol=1e-8)
    np.testing.assert_allclose(model.tension, chain.tension, rtol=1e-8)
    # and each from the start that it finds for itself
    np.testing.assert_allclose(model.position[0], chain.position[0], rtol=0, atol=1e-12)
    # the laws differ by much more than that
    linear = cp.chain.simulate(scene, times=times, step=step)
    assert float(cp.compare.errors(linear, chain).error_max) > 1e-4


def test_one_compressed_mass_swings_as_its_equation_says():
    # along the line: m x'' = T(right) - T(left)
    run = green(
        COMPRESSED, times=np.linspace(0, 0.5, 11), step=1e-5, outputs=("position", "tension", "tension_extremes")
    )
    mass, stiffness, length = 2.0 * 2.1, 1e3, 2.1

    def rates(_, state):
        left, right = law(state[0] / length, stiffness), law((4.0 - state[0]) / length, stiffness)
        return [state[1], (right - left) / mass]

    exact = solve_ivp(rates, (0, 0.5), [2.05, 0.0], "DOP853", run.time.values, rtol=1e-12, atol=1e-13)
    # the step is worth (omega h)^2 / 24 t omega ~ 1e-8 of 0.05 m
    np.testing.assert_allclose(run.position[:, 1, 0], exact.y[0], rtol=0, atol=2e-9)
    assert np.ptp(exact.y[0]) > 0.09
    np.testing.assert_allclose(run.tension, law(stretch(run), stiffness), rtol=1e-12)
    assert float(run.tension.max()) < 0.0
    assert run.attrs["smallest_stretch"] == stretch(run).min()
    # the limit of the step is that of links that are not compressed
    assert run.attrs["step_limit"] == pytest.approx(2 / np.sqrt(2 * stiffness / length / mass), rel=1e-12)
    # the left link swings between 1.95 and 2.05 m
    least, most = law(np.array([1.95, 2.05]) / length, stiffness)
    np.testing.assert_allclose(run.tension_minimum, [least] * 2, rtol=1e-6)
    np.testing.assert_allclose(run.tension_maximum, [most] * 2, rtol=1e-6)


@pytest.mark.parametrize("dims", [2, slow(3)])
def test_extremes_are_taken_over_all_steps_with_their_sign(soft, dims):
    # a chain thrown up from rest by a jump of the load goes slack: some links push
    load = {"uniform": [0.0, 25.0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 4.0}
    mapping = {**soft, "load": load}
    if dims == 3:
        mapping = spatial(mapping)
        mapping["load"]["uniform"][2] = 15.0
    run = green(
        mapping, times=np.arange(0, 2001) / 1000, step=1e-3, outputs=("position", "tension", "tension_extremes")
    )
    # the run keeps T |T|: its root is T but for a rounding or two
    np.testing.assert_allclose(run.tension_maximum, run.tension.max("time"), rtol=1e-15)
    np.testing.assert_allclose(run.tension_minimum, run.tension.min("time"), rtol=1e-15)
    assert float(run.tension_minimum.min()) < -1.0 < 1.0 < float(run.tension_maximum.max())
    np.testing.assert_array_equal(run.tension > 0, stretch(run) > 1)
    assert run.attrs["smallest_stretch"] == stretch(run).min() < 1.0 < stretch(run)[0].min()


# --- rest -------------------------------------------------------------------------------------------------------------


def test_a_taut_chain_has_three_halves_of_the_strain_more_tension_than_by_the_linear_law():
    for strain in (1e-2, 1e-3, 1e-4):
        line = {**RUBBER, "ends": {"lower": [0.0, 0.0], "upper": [4.0 * (1 + strain), 0.0]}, "motion": {}}
        scene = cp.make_scene(line)
        both = [float(cp.chain.rest(scene, law=name).tension_upper) for name in ("green", "linear")]
        # exactly 1.5 e + 0.5 e^2; the strain itself has the rounding of the gap, 1e-15 of 4 m over 1e-4
        assert both[0] / both[1] - 1 == pytest.approx(1.5 * strain + 0.5 * strain**2, abs=2e-11)


def test_where_the_sag_decides_the_rests_differ_by_the_square_of_the_strain(soft):
    # the laws stretch the cable by e and e - 1.5 e^2, and the tension follows its stretched length
    difference = []
    for modulus in (2e8, 2e9):
        scene = cp.make_scene({**soft, "cable": {**soft["cable"], "youngs_modulus": modulus}})
        a, b = (cp.chain.rest(scene, law=name) for name in ("green", "linear"))
        assert float(a.unstretched_length) == float(b.unstretched_length)
        difference.append(float(a.tension_upper / b.tension_upper - 1))
    assert 0.0 < difference[0] < 1.5 * 200.0 / 2e5
    assert difference[0] / difference[1] == pytest.approx(100.0, rel=0.1)


def test_a_start_that_the_scene_says_is_at_rest_by_the_law(soft):
    mapping = {**soft, "motion": {}, "initial": {"unstretched_length": 10.2}}
    run = green(mapping, times=[0.0], step=1e-4)
    other = {**soft, "cable": {**soft["cable"], "unstretched_length": 10.2}}
    del other["cable"]["top_tension"]
    np.testing.assert_allclose(
        run.position[0], cp.chain.rest(cp.make_scene(other), law="green").position, rtol=0, atol=1e-12
    )


# --- identities -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["linear", "green"])
def test_runs_in_two_threads_are_those_of_one_after_the_other(soft, name):
    scenes = [cp.make_scene({**soft, "cable": {**soft["cable"], "top_tension": t}}) for t in (200.0, 240.0)]
    modes = cp.pod.decompose(cp.chain.simulate(scenes[0], step=1e-3))

    def both(scene):
        chain = cp.chain.simulate(scene, step=1e-5, law=name, outputs=("position", "tension_extremes"))
        model = cp.galerkin.simulate(scene, modes, step=1e-5, law=name)
        return [chain.position.values, chain.tension_maximum.values, model.position.values]

    alone = [both(scene) for scene in scenes]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(both, scenes))
    for a, b in zip(itertools.chain(*alone), itertools.chain(*together), strict=True):
        np.testing.assert_array_equal(a, b)


def test_results_name_the_law(soft):
    scene = cp.make_scene(soft)
    runs = {name: cp.chain.simulate(scene, step=1e-3, law=name) for name in ("linear", "green")}
    default = cp.chain.simulate(scene, step=1e-3)
    assert default.attrs == runs["linear"].attrs
    np.testing.assert_array_equal(default.position, runs["linear"].position)
    assert runs["linear"].attrs["id"] != runs["green"].attrs["id"]
    assert "smallest_stretch" not in default.attrs
    assert default.attrs["title"] == "soft: elastic chain of 8 links"
    assert runs["green"].attrs["title"] == "soft: elastic chain of 8 links, green law"
    for name, run in runs.items():
        assert run.attrs["law"] == name
        assert json.loads(run.attrs["history_json"])[-1]["parameters"]["law"] == name
        rest = cp.chain.rest(scene, law=name)
        assert json.loads(rest.attrs["history_json"])[-1]["parameters"] == {"links": 8, "law": name}


# --- limit of the step ------------------------------------------------------------------------------------------------


def test_the_stability_limit_is_where_it_is_predicted():
    # a straight chain pulled to xi = 2 is (3 xi^2 - 1) / 2 = 5.5 times as stiff as unstretched
    jitter = 1e-7 * np.where(np.arange(9) % 2, 1.0, -1.0)
    jitter[[0, -1]] = 0
    line = np.stack([np.linspace(0, 8, 9) + jitter, np.zeros(9)], axis=1)
    still = {**RUBBER, "motion": {}, "ends": {"lower": [0.0, 0.0], "upper": [8.0, 0.0]}}
    still["initial"] = {"points": line.tolist()}
    limit = green(still, times=[0.0], step=1e-4).attrs["step_limit"]
    # the top axial frequency of 8 links of 0.5 m, 0.5 kg, 2e3 N/m
    assert limit == pytest.approx(2 / (2 * np.sqrt(5.5 * 2e3 / 0.5) * np.cos(np.pi / 16)), rel=1e-6)

    def largest(step):
        run = green(still, times=[1000 * step], step=step)
        return float(np.abs(run.position - line).max())

    assert largest(0.999 * limit) < 1e-5
    with pytest.raises(cp.SceneError, match=rf"step: given .* s; allowed: below .* {limit:.6g} s"):
        largest(1.001 * limit)


def pulled(amplitude):
    return {**RUBBER, "motion": {"upper": {"x": {"kind": "ramp", "amplitude": amplitude, "duration": 2.0}}}}


def test_a_chain_that_outgrows_a_given_step_stops():
    # it starts with xi = 1.1
    limit = 2 / (2 * np.sqrt((1.5 * 1.1**2 - 0.5) * 2e3 / 0.5) * np.cos(np.pi / 16))
    assert green(RUBBER, step=1e-3).attrs["step_limit"] == pytest.approx(limit, rel=1e-12)
    np.testing.assert_allclose(stretch(green(RUBBER, step=1e-3))[0], 1.1, rtol=1e-12)
    # a small pull is noticed afterwards, a large one breaks the run, and the reason shows in what was saved before
    for amplitude, part, incomplete in ((1e-3, 0.99999, False), (3.6, 0.99, True)):
        match = r"stiffened: at [\d.]+ s its stability limit is (.*) s, below the step (.*) s \(velocity Verlet, law green\)"
        with pytest.raises(cp.RunStopped, match=match) as stopped:
            green(pulled(amplitude), step=part * limit)
        said = [float(word) for word in re.search(match, str(stopped.value)).groups()]
        assert 0.95 * limit < said[0] < said[1] == pytest.approx(part * limit, rel=1e-5)
        assert np.isfinite(stopped.value.partial.position).all()
        assert ("incomplete" in stopped.value.partial.attrs) is incomplete
    # by the linear law the limit is the same at any stretch
    linear = cp.chain.simulate(cp.make_scene(RUBBER), step=1e-3).attrs["step_limit"]
    assert linear == pytest.approx(1 / (np.sqrt(2e3 / 0.5) * np.cos(np.pi / 16)), rel=1e-12)


@pytest.mark.parametrize("amplitude", [0.5, 3.6, 39.0])
def test_the_chosen_step_allows_for_later_stiffening(amplitude):
    scene = cp.make_scene(pulled(amplitude))
    run = cp.chain.simulate(scene, law="green", tolerance=1e-6, scheme="velocity_verlet", outputs=("position",))
    exact = cp.chain.simulate(scene, law="green", step=run.attrs["step"] / 8)
    assert float(cp.compare.errors(run, exact).error_max) < 1e-6
    assert float(stretch(run)[-1].mean()) == pytest.approx(1.1 + amplitude / 4, rel=1e-9)


def test_links_that_are_stiffest_at_different_times_do_not_stop_a_run():
    # a wave runs along the chain: all links at their stiffest are no state of it
    shaken = {"kind": "harmonic", "amplitude": 0.05, "angular_frequency": 10.0}
    mapping = {**RUBBER, "motion": {"upper": {"x": shaken}}}
    limit = green(mapping, times=[0.0], step=1e-3).attrs["step_limit"]
    run = green(mapping, times=np.arange(250) / 100, step=0.975 * limit)
    tangents = 2e3 * (1.5 * stretch(run) ** 2 - 0.5)  # of eight links with half a kilogram between them [N/m]

    def limit_of(k):
        matrix = np.diag(k[1:] + k[:-1]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
        return 2.0 / np.sqrt(np.linalg.eigvalsh(matrix / 0.5)[-1])

    assert limit_of(tangents.max(axis=0)) < 0.975 * limit < min(map(limit_of, tangents))


# --- what is refused --------------------------------------------------------------------------------------------------


def test_invalid_options_are_refused(soft):
    scene = cp.make_scene(soft)
    for function in (cp.chain.simulate, cp.chain.rest):
        with pytest.raises(cp.SceneError, match='law: given \'hooke\'; allowed: one of "linear", "green"'):
            function(scene, law="hooke")
    # before anything else is looked at
    with pytest.raises(cp.SceneError, match="law: given 'hooke'"):
        cp.chain.simulate(scene, law="hooke", scheme="euler")
    viscous = cp.make_scene({**soft, "damping": {"link_viscosity": 0.002}})
    with pytest.raises(
        cp.SceneError, match=r"law and damping\.link_viscosity: given \('green', 0\.002\); allowed: .*linear"
    ):
        cp.chain.simulate(viscous, law="green")
    cp.chain.rest(viscous, law="green")  # at rest nothing is viscous
