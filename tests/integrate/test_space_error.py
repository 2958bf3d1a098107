"""Error in space: the estimate of a companion run against the continuous cable, and the warning of too few links."""

from __future__ import annotations

import math
import re
import tomllib
import warnings

import numpy as np
import pytest

import cablepod as cp
from cablepod import examples
from cablepod.chain._explicit import ExplicitChainRun
from cablepod.chain._implicit import ImplicitChainRun
from cablepod.discretisation._interpolation import at_places
from cablepod.integrate._coarse import driven_of, remedy_of
from cablepod.parameters._from_scene import parameters


@pytest.fixture(scope="module", params=["example2", "example3", "example4"])
def shipped(request):
    """A scene of the paper with its converged continuous cable."""
    return examples.scene(request.param), cp.archive.read(examples.truth_path(request.param, "linear"))


@pytest.fixture
def made(monkeypatch):
    """Record runs of chains with their steps per second and trajectories: the companion comes last."""
    found = []
    for kind in (ExplicitChainRun, ImplicitChainRun):

        def noted(run, rate, call=kind.__call__):
            found.append((run, rate, call(run, rate)))
            return found[-1][2]

        monkeypatch.setattr(kind, "__call__", noted)
    return found


@pytest.mark.parametrize(
    "options",
    [*({"links": links, "tolerance": 1e-3} for links in (5, 10, 20, 40)), {"scheme": "trapezoidal", "step": 0.1}],
)
def test_the_estimate_of_a_chain_is_within_a_factor_of_three(shipped, options):
    scene, truth = shipped
    outputs = ("position", "error_estimate")
    run = cp.chain.simulate(scene, **{"links": 40, "times": truth.time.values, "outputs": outputs} | options)
    error = float(cp.compare.errors(run, truth).error_max)  # with that of a given step
    assert error / 3.0 < run.attrs["space_error_estimate"] < 3.0 * error


@pytest.mark.filterwarnings("ignore::cablepod.errors.CoarseWarning")  # of 24 links, which miss points of the wind
@pytest.mark.parametrize("seed", [1, 3])
def test_the_estimate_in_gusts_knows_what_falls_by_more_than_second_order(seed):
    tables = tomllib.loads((examples.data_folder() / "new.toml").read_text())
    del tables["motion"]
    tables["wind"] = {"speed": 25.0, "direction": [1.0, 0.0], "turbulence": {"spectrum": "kaimal", "seed": seed}}
    tables["time"] = {"duration": 8.0, "interval": 0.1}
    scene = cp.make_scene(tables)
    fine = cp.chain.simulate(scene, links=160, scheme="trapezoidal", step=0.005)
    for links in (24, 40):
        run = cp.chain.simulate(scene, links=links, tolerance=1e-3, outputs=("position", "error_estimate"))
        error = float(cp.compare.errors(run, fine).error_max)
        # errors are about 10 and 1 %, estimates of four seeds 0.78 to 2.1 times as large
        assert 0.7 * error < run.attrs["space_error_estimate"] < 2.5 * error


@pytest.mark.parametrize("options", [{"elements": 1}, {"elements": 2}, {"elements": 5, "order": 1}])
def test_the_estimate_of_elements_is_an_upper_one(shipped, options):
    scene, truth = shipped
    run = cp.cable.simulate(
        scene, law="linear", times=truth.time.values, points=truth.sizes["particle"], step=3e-4, **options,
        outputs=("position", "error_estimate"),
    )  # fmt: skip
    error = float(cp.compare.errors(run, truth).error_max)
    assert run.attrs["space_error_estimate"] > 0.9 * error  # by linear elements it is within some per cent


@pytest.mark.parametrize("option", [{}, {"step": 1e-3}, {"scheme": "trapezoidal", "step": 0.02}, {"law": "green"}])
def test_it_does_not_change_the_run_and_is_no_default(option):
    scene = examples.scene("example3")
    plain = cp.chain.simulate(scene, links=10, times=[0.0, 5.0, 10.0], **option)
    asked = cp.chain.simulate(
        scene, links=10, times=[0.0, 5.0, 10.0], outputs=("position", "tension", "error_estimate"), **option
    )
    assert "space_error_estimate" not in plain.attrs
    assert asked.attrs["space_error_estimate"] > 0.0
    np.testing.assert_array_equal(asked.position, plain.position)


@pytest.mark.parametrize(("option", "share"), [({"step": 0.02}, 0.5), ({"tolerance": 1e-3}, None)])
def test_steps_of_an_implicit_companion_are_longer_with_its_links(option, share, made):
    # most of the time of such a step does not depend on the number of links
    cp.chain.simulate(
        examples.scene("example3"), links=20, times=[0.0, 5.0, 10.0], scheme="trapezoidal",
        outputs=("position", "error_estimate"), **option,
    )  # fmt: skip
    (run, rate, _), (companion, lower, _) = made[-2:]
    assert run.chain.links == 20 > companion.chain.links
    assert lower == pytest.approx(rate * (share or companion.chain.links / 20))


@pytest.mark.parametrize("links", [5, 10, 20, 40])
@pytest.mark.parametrize("part", [0.1, 0.5, 0.65, 0.8, 0.99])
def test_a_companion_of_a_given_explicit_step_makes_at_most_half_as_many(part, links, made):
    scene = examples.scene("example3")
    limit = cp.chain.simulate(scene, links=links, times=[0.0, 0.1], step=1e-5).attrs["step_limit"]
    made.clear()
    cp.chain.simulate(scene, links=links, times=[0.0, 2.0], step=part * limit, outputs=("error_estimate",))
    (run, rate, _), (companion, lower, _) = made
    assert companion.chain.links < run.chain.links
    assert lower <= 0.5 * rate
    assert 1.0 / lower <= companion.step_limit * max(0.9, part) * (1.0 + 1e-9)


@pytest.mark.parametrize("name", ["example2", "example3", "example4"])
@pytest.mark.parametrize(
    ("simulate", "option"),
    [(cp.chain.simulate, {"links": links}) for links in (10, 40)] + [(cp.cable.simulate, {"elements": 4})],
)
def test_an_implicit_companion_makes_half_the_iterations(name, simulate, option, made):
    # of a run with one iteration a step; with its tolerance the steps of the companion, twice as long, take two in example 3
    simulate(
        examples.scene(name), law="linear", times=np.linspace(0.0, 60.0, 601), scheme="trapezoidal", step=0.02,
        outputs=("error_estimate",), **option,
    )  # fmt: skip
    run, companion = (state.diagnostics["newton_iterations"] for _, _, state in made)
    assert companion <= 0.52 * run


@pytest.mark.parametrize("simulate", [cp.chain.simulate, cp.cable.simulate])
@pytest.mark.parametrize("step", [0.02, 0.1])
@pytest.mark.parametrize("damping", [{}, {"damping": {"ratios": [0.02] * 4}}])
def test_the_tolerance_of_newton_does_not_show_in_the_estimate(simulate, step, damping, monkeypatch):
    # two digits of the distance are wanted; with damping ratios the iterations converge linearly
    scene = cp.make_scene({**tomllib.loads(examples.scene_path("example3").read_text()), **damping})
    option = {"links": 40} if simulate is cp.chain.simulate else {"elements": 4}

    def estimate(factor):
        monkeypatch.setattr("cablepod.chain._implicit.COMPANION_NEWTON", factor)
        run = simulate(
            scene, law="linear", times=np.linspace(0.0, 60.0, 601), scheme="trapezoidal", step=step,
            outputs=("error_estimate",), **option,
        )  # fmt: skip
        return run.attrs["space_error_estimate"]

    assert estimate(30.0) == pytest.approx(estimate(1.0), rel=1e-3)


def test_each_member_has_the_estimate_of_its_scene():
    scenes = cp.ensemble.design(examples.scene("example3"), {"cable.top_tension": [3e3, 6e3]}, members=3)
    options = {"links": 10, "times": [0.0, 5.0, 10.0], "outputs": ("position", "error_estimate")}
    for more in ({}, {"scheme": "trapezoidal", "step": 0.05}):
        together = cp.chain.simulate(scenes, **options, **more)["space_error_estimate"]
        alone = [
            cp.chain.simulate(scenes.isel(member=i), **options, **more).attrs["space_error_estimate"] for i in range(3)
        ]
        # in lanes sums over links are added up in another order
        np.testing.assert_allclose(together, alone, rtol=1e-6)
        assert together.attrs["units"] == "1"


def test_unequal_links_keep_their_gradation(soft):
    graded = {**soft, "chain": {"links": 12, "link_lengths": list(np.linspace(1.0, 2.0, 12))}}
    equal = {**soft, "chain": {"links": 12}}
    found = [
        cp.chain.simulate(cp.make_scene(item), outputs=("error_estimate",)).attrs["space_error_estimate"]
        for item in (graded, equal)
    ]
    assert 0.3 < found[0] / found[1] < 3.0  # the longest link is 1.33 times as long, its error 1.8 times as large


def test_the_number_of_links_that_is_advised_would_do():
    """The estimate of a chain with the advised number of links is what is asked for; about, as it falls with their square."""
    scene = examples.scene("example3")
    run = cp.chain.simulate(scene, links=5, outputs=("error_estimate",))
    error = run.attrs["space_error_estimate"]
    assert error > 0.04  # four times what a warning is about
    advised = int(re.search(r"try about (\d+) links", remedy_of(5, error))[1])
    finer = cp.chain.simulate(scene, links=advised, outputs=("error_estimate",))
    assert 0.005 < finer.attrs["space_error_estimate"] < 0.0125
    assert "at least" in remedy_of(10, 0.2)


def test_where_no_companion_runs_it_is_nan(soft):
    # a companion of a single link has no inner particle
    taut, short = examples.scene("example2"), {"scheme": "velocity_verlet", "times": [0.0, 0.5]}
    for scene, links, options in ((cp.make_scene(soft), 2, {}), (taut, 2, short), (taut, 3, short)):
        run = cp.chain.simulate(scene, links=links, outputs=("error_estimate",), **options)
        assert math.isnan(run.attrs["space_error_estimate"])
    one = cp.cable.simulate(cp.make_scene(soft), elements=1, order=3, outputs=("error_estimate",), law="linear")
    assert math.isnan(one.attrs["space_error_estimate"])


def coarse(call):
    """Texts of the warnings of too few links that a call gives."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    return [str(item.message) for item in caught if item.category is cp.CoarseWarning]


def test_five_links_of_example_3_warn_and_the_estimate_replaces_the_warning():
    scene = examples.scene("example3")
    found = coarse(lambda: cp.chain.simulate(scene, links=5, step=1e-3))
    assert len(found) == 1
    assert found[0].startswith("links: given 5")
    assert "links=15" in found[0]
    assert coarse(lambda: cp.chain.simulate(scene, links=15, step=5e-4)) == []
    assert coarse(lambda: cp.chain.simulate(scene, links=5, step=1e-3, outputs=("error_estimate",))) == []
    assert coarse(lambda: cp.chain.simulate(scene, links=5, times=[0.0])) == []  # nothing moves


def test_the_links_of_the_shipped_scenes_do_not_warn():
    scenes = {name: examples.scene(name) for name in examples.scenes()}
    links = {name: int(scene["chain_links"]) for name, scene in scenes.items() if "mast_height" not in scene}
    cables = [name for name, count in links.items() if count >= 8]  # a pendulum of two links is no cable
    assert len(cables) > 15
    needed = {name: driven_of(parameters(scenes[name]), float(scenes[name]["time_duration"])).links for name in cables}
    assert [name for name in cables if needed[name] > links[name]] == []


def test_the_member_that_needs_most_links_is_named_once():
    scenes = cp.ensemble.design(examples.scene("example3"), {"motion.upper.x.angular_frequency": [0.05, 0.8, 3]})
    found = coarse(lambda: cp.chain.simulate(scenes, links=12, times=[0.0, 60.0], step=1e-3))
    assert len(found) == 1
    assert found[0].startswith("member 2, the worst of 3: links: given 12")
    found = coarse(lambda: cp.cable.simulate(scenes, elements=1, order=3, times=[0.0, 60.0], step=1e-3))
    assert len(found) == 1
    assert found[0].startswith("elements: given 1 of order 3")


def test_a_free_end_and_a_high_frequency_need_links_for_each_half_wave():
    hanging = {
        "cable": {"youngs_modulus": 1e9, "area": 1e-4, "density": 1000.0, "unstretched_length": 10.0},
        "ends": {"lower": [0.0, -10.001], "upper": [0.0, 0.0], "free": "lower"},
        "motion": {"upper": {"x": {"kind": "harmonic", "amplitude": 0.01, "angular_frequency": 10.0}}},
        "time": {"duration": 0.5, "interval": 0.5},
        "chain": {"links": 40},
    }
    # a wave takes 2 sqrt(L / g) = 2.02 s, in which 10 rad/s make 6.4 half waves
    found = coarse(lambda: cp.chain.simulate(cp.make_scene(hanging), step=1e-4))
    assert len(found) == 1
    assert "6.22 for each half wave" in found[0]
    slow = {"upper": {"x": {"kind": "harmonic", "amplitude": 0.01, "angular_frequency": 5.0}}}
    assert coarse(lambda: cp.chain.simulate(cp.make_scene({**hanging, "motion": slow}), step=1e-4)) == []


def test_a_sagging_line_whose_end_hardly_moves_needs_more_links():
    # 8 s^2 / 3 c over n^2 against the millimetre by which its end moves
    flat = {
        "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 3000.0},
        "ends": {"lower": [0.0, 0.0], "upper": [100.0, 0.0]},
        "motion": {"upper": {"x": {"kind": "ramp", "amplitude": -0.001, "duration": 20.0}}},
        "time": {"duration": 25.0, "interval": 5.0},
        "chain": {"links": 40},
    }
    found = coarse(lambda: cp.chain.simulate(cp.make_scene(flat), step=3e-4))
    assert len(found) == 1
    assert "sag" in found[0]
    flat["motion"]["upper"]["x"]["amplitude"] = -0.1
    assert coarse(lambda: cp.chain.simulate(cp.make_scene(flat), step=3e-4)) == []


def test_splines_of_many_and_of_few_instants_agree():
    rng = np.random.default_rng(4)
    known, wanted = np.linspace(0.0, 1.0, 11), np.sort(rng.random(7))
    position = rng.random((40, 11, 2))
    each = np.concatenate([at_places(wanted, known, position[i : i + 1]) for i in range(40)])
    np.testing.assert_allclose(at_places(wanted, known, position), each, atol=1e-13)  # rounding
