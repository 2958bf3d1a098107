"""The Galerkin model: against the chain it is made from, its order, identities, and what it refuses."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
from convergence import distances, orders
from scenes import TERMS as SHARED
from scenes import energies, spatial
from suite import slow

import cablepod as cp

SCHEMES = ("velocity_verlet", "filtered_verlet", "trapezoidal")
TERMS = {
    **SHARED,
    "damped, starting with a velocity": {
        "damping": {"mass_proportional": 2.0},
        "motion": {"upper": {"y": {"kind": "harmonic", "amplitude": 0.03, "angular_frequency": 1.7}}},
    },
    "initial shape": {"initial": {"top_tension": 260.0}},
    "unequal links": {"chain": {"link_lengths": [1.0, 2.0, 1.0, 0.5, 2.0, 1.0, 1.0, 3.0]}},
}


# identities and orders hold for models that cannot be trusted too; that they say so is tested at the end
pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")


@pytest.mark.parametrize(("layout", "weights"), [("separate", None), ("vector", "mass")])
@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("name", TERMS)
def test_all_modes_and_the_linear_law_are_the_chain(soft, name, layout, weights, dims):
    mapping = {**soft, **copy.deepcopy(TERMS[name])}
    scene = cp.make_scene(mapping if dims == 2 else spatial(mapping))
    # two instants lie between steps; the steps are long, as the particles themselves are stepped, and not what the lifting leaves
    times, step = np.append(np.linspace(0, 3, 25), [3.0004, 3.7777]), 1 / 1000
    chain = cp.chain.simulate(scene, times=times, step=step, outputs=("position", "velocity", "tension"))
    modes = cp.pod.decompose(chain, layout=layout, weights=weights)
    model = cp.galerkin.simulate(
        scene, modes, times=times, law="linear", step=step, outputs=("position", "velocity", "tension")
    )
    # rounding in 4000 steps: 2e-13 at most in the positions, 20 times that in what they are multiplied with K / T for
    assert float(cp.compare.errors(model, chain).error_max) < 1e-11
    np.testing.assert_allclose(model.velocity, chain.velocity, atol=1e-11)
    np.testing.assert_allclose(model.tension, chain.tension, rtol=1e-10)


@pytest.mark.parametrize(("layout", "weights"), [("separate", "length"), ("vector", None)])
@pytest.mark.parametrize(
    ("law", "name", "others"),
    [
        *(("linear", name, {}) for name in ("plain", "point load", "initial shape", "unequal links")),
        # ends at rest, as in the tests of the implicit chain: another choice of terms, compiled for seconds
        slow("linear", "mass damping", {"motion": {}, "initial": {"top_tension": 260.0}}),
        slow("green", "both ends", {}),
    ],
)
def test_all_modes_are_the_chain_implicitly_too(soft, law, name, others, layout, weights):
    scene = cp.make_scene({**soft, **copy.deepcopy(TERMS[name]), **others})
    # from steps of 2 to 10 times the explicit limit; two instants lie between them
    times, step = np.append(np.linspace(0, 3, 25), [3.004, 3.7777]), 0.02
    chain = cp.chain.simulate(scene, times=times, step=step, law=law, scheme="trapezoidal")
    model = cp.galerkin.simulate(
        scene,
        cp.pod.decompose(chain, layout=layout, weights=weights),
        times=times,
        step=step,
        law=law,
        scheme="trapezoidal",
    )
    # what Newton's method may leave turns links by 1e-6
    assert float(cp.compare.errors(model, chain).error_max) < 1e-7


@pytest.mark.parametrize("number", [2, 3])
def test_all_modes_and_the_linear_law_are_the_chain_in_the_examples(scenes, number):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    times = np.arange(0.0, 51.0)
    chain = cp.chain.simulate(scene, times=times, step=2.5e-4)
    model = cp.galerkin.simulate(scene, cp.pod.decompose(chain), times=times, law="linear", step=2.5e-4)
    # rounding in 200 000 steps of a chain whose K is 1300 and 5300 times its tension: 8e-12 and 6e-11
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


@pytest.mark.parametrize("law", ["green", "linear"])
@pytest.mark.parametrize("name", [name for name in TERMS if name != "unequal links"])
def test_second_order_in_the_step(soft, law, name):
    scene = cp.make_scene({**soft, **TERMS[name]})
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3))
    options = {"rank": 2, "law": law, "times": [1.0, 2.0, 4.0]}
    # filtered steps have their order where they resolve all vibrations, which an initial shape excites
    rates = {scheme: (3200 if scheme == "filtered_verlet" else 1600) * 2 ** np.arange(4) for scheme in SCHEMES}
    found = {
        scheme: [cp.galerkin.simulate(scene, modes, **options, scheme=scheme, step=1 / rate) for rate in of_scheme]
        for scheme, of_scheme in rates.items()
    }
    other = [run.position for run in found["filtered_verlet"][1:3]]  # steps of 1/6400 and 1/12800 s
    for scheme, runs in found.items():
        distance = distances([run.position for run in runs])
        # links slacken with an initial shape: the kinks in steps leave errors of order 1 to 1.5, which small errors show
        kinks = (law, name, scheme) == ("linear", "initial shape", "filtered_verlet")
        np.testing.assert_allclose(orders(distance), 2.0, atol=0.7 if kinks else 0.1, err_msg=scheme)
        # the errors left are a third of the last distance, of either scheme
        apart = float(np.abs(runs[-1].position - other[1]).max())
        assert apart < distance[-1] + float(np.abs(other[0] - other[1]).max()), scheme
        defect = [run.attrs["energy_defect"] for run in runs]
        if (law, name) != ("linear", "initial shape"):  # links slacken there, and kinks fall where they like
            # a work or a dissipation that is left out, or counted twice, would be left as the steps become short
            np.testing.assert_allclose(orders(defect), 2.0, atol=0.1, err_msg=scheme)


@pytest.mark.parametrize("law", ["linear", "green"])
def test_the_energy_defect_is_that_of_the_particles(soft, law):
    # a chain let go from another shape between ends at rest: all that can be seen from outside
    scene = cp.make_scene({**soft, "motion": {}, "initial": {"top_tension": 260.0}})
    started = cp.chain.simulate(scene, step=1e-3, times=np.linspace(0, 4, 41))
    run = cp.galerkin.simulate(
        scene,
        cp.pod.decompose(started),
        times=np.arange(81) / 20,
        law=law,
        scheme="trapezoidal",
        step=0.05,
        outputs=("position", "velocity"),
    )
    kinetic, strain, weight = energies(scene, run, law)
    work = weight[0] - weight
    exchanged = max(kinetic.max(), np.abs(strain - strain[0]).max(), np.abs(work).max())
    defect = np.abs(kinetic + strain - strain[0] - work).max() / exchanged
    # digits are lost in the difference of strain energies
    assert run.attrs["energy_defect"] == pytest.approx(defect, rel=1e-6, abs=1e-11)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_equilibrium_by_the_linear_law_stays_at_rest(soft, scheme):
    modes = cp.pod.decompose(cp.chain.simulate(cp.make_scene(soft), step=1e-3))
    still = cp.make_scene({**soft, "motion": {}})
    run = cp.galerkin.simulate(still, modes, rank=3, law="linear", scheme=scheme)
    assert float(np.abs(run.position - run.position[0]).max()) < 1e-11


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
    picked = cp.galerkin.simulate(scene, modes.isel(mode=[0, 2]), step=1e-3)
    np.testing.assert_allclose(cp.pod.reconstruct(picked, modes).position, picked.position, atol=1e-13)
    bare = cp.galerkin.simulate(scene, modes, step=1e-3, outputs=())
    assert "position" not in bare
    np.testing.assert_array_equal(bare.amplitude, run.amplitude)


def test_the_default_step_is_stable_and_accurate_without_help(soft):
    scene = cp.make_scene({**soft, "cable": {**soft["cable"], "youngs_modulus": 2e9}})  # a hundred times stiffer
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-4))
    exact = cp.galerkin.simulate(scene, modes, rank=4, step=1e-5)
    close = cp.galerkin.simulate(scene, modes, rank=4, tolerance=1e-6)
    assert float(cp.compare.errors(close, exact).error_max) < 1e-6
    run = cp.galerkin.simulate(scene, modes, rank=4)
    assert float(cp.compare.errors(run, exact).error_max) < 0.1 * run.attrs["error_estimate"]


@pytest.mark.parametrize("number", [2, 3, 4])
def test_the_default_time_error_is_small_beside_that_of_the_modes(scenes, number):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    chain = cp.chain.simulate(scene, links=40, tolerance=1e-5)
    modes = cp.pod.decompose(chain)
    run = cp.galerkin.simulate(scene, modes, rank=2)
    exact = cp.galerkin.simulate(scene, modes, rank=2, scheme="velocity_verlet", step=run.attrs["step_limit"] / 8)
    time_error = float(cp.compare.errors(run, exact).error_max)
    assert time_error < 0.2 * float(cp.compare.errors(exact, chain).error_max)
    # its own estimates say so
    assert time_error < 1.5 * run.attrs["time_error_estimate"]
    assert run.attrs["time_error_estimate"] <= 0.1 * run.attrs["error_estimate"]
    assert run.attrs["step"] > run.attrs["step_limit"]
    steps = json.loads(run.attrs["history_json"])[-1]["parameters"]
    assert steps["scheme"] == run.attrs["scheme"]
    assert run.attrs["time_error_estimate"] <= steps["tolerance"] <= 0.1 * run.attrs["error_estimate"]


def test_the_error_estimate_changes_no_bit_of_a_run(soft):
    scene = cp.make_scene(soft)
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3))
    for scheme in SCHEMES:
        options = {"rank": 2, "scheme": scheme, "step": 1e-3}
        with_estimate = cp.galerkin.simulate(scene, modes, **options)
        without = cp.galerkin.simulate(scene, modes, outputs=("position",), **options)
        np.testing.assert_array_equal(with_estimate.position, without.position)
        assert with_estimate.attrs["energy_defect"] == without.attrs["energy_defect"]
        assert "error_estimate" not in without.attrs


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_tolerance_is_met(soft, scheme):
    scene = cp.make_scene(soft)
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3))
    exact = cp.galerkin.simulate(scene, modes, rank=3, step=1e-5)
    for tolerance in (1e-2, 1e-4, 1e-6):
        run = cp.galerkin.simulate(scene, modes, rank=3, scheme=scheme, tolerance=tolerance)
        assert float(cp.compare.errors(run, exact).error_max) < tolerance
        assert run.attrs["time_error_estimate"] <= tolerance
        assert run.attrs["choice_of_scheme"] == "given"


@pytest.mark.parametrize("options", [{}, {"tolerance": 1e-3}, {"tolerance": 1e-3, "scheme": "trapezoidal"}], ids=str)
def test_runs_are_compared_between_the_output_times_too(soft, options):
    # at one instant two runs may agree by luck
    scene, options = cp.make_scene(soft), {"rank": 3, "outputs": ("position", "error_estimate"), **options}
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3))
    one = cp.galerkin.simulate(scene, modes, times=[4.0], **options)
    many = cp.galerkin.simulate(scene, modes, times=np.linspace(0.0, 4.0, 65), **options)
    assert one.attrs["step"] == many.attrs["step"]
    assert one.attrs["time_error_estimate"] == pytest.approx(many.attrs["time_error_estimate"], rel=0.1)
    assert one.time.values.tolist() == [4.0]
    np.testing.assert_array_equal(one.position[-1], many.position[-1])


def test_the_pick_follows_the_tolerance(scenes):
    scene = cp.read_scene(scenes / "example2.toml")
    modes = cp.pod.decompose(cp.chain.simulate(scene, times=np.arange(31.0)), rank=4)
    loose = cp.galerkin.simulate(scene, modes, times=np.arange(31.0), tolerance=1e-3)
    assert loose.attrs["scheme"] == "trapezoidal"
    assert loose.attrs["step"] > 10 * loose.attrs["step_limit"]
    tight = cp.galerkin.simulate(scene, modes, times=np.arange(31.0), tolerance=1e-6)
    assert tight.attrs["scheme"] == "velocity_verlet"
    assert float(cp.compare.errors(loose, tight).error_max) < 1e-3


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
        (scene, {"scheme": "energy_momentum"}, r"scheme: given 'energy_momentum'; allowed: .*\"trapezoidal\""),
        (scene, {"scheme": "trapezoidal", "step": 5.0}, r"step: given 5\.0"),
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
    dependent, lifted = modes.copy(deep=True), modes.assign(mean=modes["mean"] + 0.1)
    dependent["mode_shape"][:, 1] = 2.0 * modes.mode_shape[:, 0].values
    with pytest.raises(cp.SceneError, match=r"^modes: given some that are sums of others; allowed: independent ones"):
        cp.galerkin.simulate(scene, dependent)
    with pytest.raises(
        cp.SceneError, match=r"^modes: mean: given 'up to 0\.1.* at the ends.*'; allowed: zero at both ends"
    ):
        cp.galerkin.simulate(scene, lifted)
    with pytest.raises(cp.SceneError, match=r"modes: given a Dataset.* without mode_shape.*pod\.decompose"):
        cp.galerkin.simulate(scene, scene)


def test_it_warns_where_the_laws_are_of_different_materials(soft):
    scene = cp.make_scene({**soft, "cable": {**soft["cable"], "youngs_modulus": 2e6}})  # stretched by a tenth
    chain = cp.chain.simulate(scene, tolerance=1e-4)
    modes = cp.pod.decompose(chain)
    with pytest.warns(cp.OutOfRangeWarning, match=r"law \(21\) has .* % more tension than the linear law"):
        green = cp.galerkin.simulate(scene, modes, rank=4)
    linear = cp.galerkin.simulate(scene, modes, rank=4, law="linear")  # without a warning
    assert green.attrs["largest_stretch"] == pytest.approx(float(linear.attrs["largest_stretch"]), rel=0.05)
    errors = [float(cp.compare.errors(run, chain).error_max) for run in (green, linear)]
    # what the warning is for: the motion is that of another material, which the estimate contains
    assert errors[0] == pytest.approx(green.attrs["error_estimate"], rel=0.3)
    assert errors[0] > 3 * errors[1]
    assert errors[1] < 2 * linear.attrs["error_estimate"] + 1e-4
