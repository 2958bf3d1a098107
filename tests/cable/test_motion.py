"""The continuous cable in motion: its order, what it must equal, compression, and what it refuses or stops."""

from __future__ import annotations

import copy
import itertools

import numpy as np
import pytest
from convergence import orders
from references.elements import Elements
from scenes import scene_with, spatial
from suite import slow

import cablepod as cp
from cablepod import examples as shipped

#: Ends that begin to move so smoothly (as t^6) that no wave has a corner: order can be seen.
SMOOTH = {
    "upper": {"x": {"kind": "polynomial", "coefficients": [0, 0, 0, 0, 0, 0.4, -0.15]}},
    "lower": {"y": {"kind": "polynomial", "coefficients": [0, 0, 0, 0, 0, 0.1]}},
}
TERMS = {
    "plain": {},
    "mass damping": {"damping": {"mass_proportional": 0.7}},
    "loads": {
        "load": {"uniform": [3.0, 1.0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 3.0, "phase": 0.5},
        "point_load": [
            {"arc_length": 0.25, "force": [5.0, -20.0]},
            {"arc_length": 0.75, "force": [0.0, 5.0], "kind": "ramp", "amplitude": 1.0, "duration": 1.0},
        ],
    },
    "viscosity": {"damping": {"link_viscosity": 2e-3}},
}
#: Every term by one law, as each combination is compiled on its own; so all that run them ask for all outputs.
LAW_AND_TERM = [
    ("green", "plain"),
    ("linear", "plain"),
    ("green", "mass damping"),
    ("green", "loads"),
    slow("linear", "viscosity"),
]
ALL = ("position", "velocity", "tension", "tension_extremes")


@pytest.fixture
def smooth(soft):
    return {**soft, "motion": copy.deepcopy(SMOOTH), "time": {"duration": 1.5, "interval": 0.25}}


def distance(run, truth):
    """Largest rms distance over the largest rms displacement."""
    gap, moved = (np.sqrt(((a - b) ** 2).sum(-1).mean(-1)).max() for a, b in (
        (run.position.values, truth.position.values), (truth.position.values, truth.position.values[:1])))  # fmt: skip
    return gap / moved


# --- order ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", [slow("green"), "linear"])
@pytest.mark.parametrize(("order", "numbers"), [(1, (16, 32)), (2, (16, 32)), (3, (12, 24)), (4, (8, 16))])
def test_order_in_space(law, order, numbers, smooth):
    scene = scene_with(smooth)
    errors = []
    for count in numbers:
        run = cp.cable.simulate(scene, elements=count, order=order, step=1e-4, law=law, points="nodes")
        sigma = run.arc_length.values / float(run.unstretched_length)
        # the same step in both, so that the error in time cancels
        errors.append(distance(run, cp.cable.simulate(scene, elements=16, step=1e-4, law=law, points=sigma)))
    # order + 2 at the nodes from order 2 on, see the rest
    assert orders(errors) == pytest.approx([2 if order == 1 else order + 2], abs=0.15)


@pytest.mark.parametrize(("law", "term"), LAW_AND_TERM)
@pytest.mark.parametrize(("scheme", "step"), [("velocity_verlet", 4e-4), slow("trapezoidal", 1e-2)])
def test_second_order_in_time(law, term, scheme, step, smooth):
    scene = scene_with(smooth, **TERMS[term])
    options = {"elements": 4, "order": 4, "law": law, "outputs": ALL}
    truth = cp.cable.simulate(scene, **options, step=2.5e-5)
    errors = [distance(cp.cable.simulate(scene, **options, scheme=scheme, step=h), truth) for h in (step, step / 2.0)]
    assert orders(errors) == pytest.approx([2.0], abs=0.1)


@pytest.mark.parametrize("law", ["green", "linear"])
def test_the_chain_converges_to_it_with_the_square_of_the_links(law, smooth):
    scene = scene_with(smooth)
    truth = cp.cable.simulate(scene, law=law, points=11)
    errors = []
    for links in (20, 40):
        run = cp.chain.simulate(scene, law=law, links=links)
        errors.append(distance(run.isel(particle=slice(None, None, links // 10)), truth))
    assert orders(errors) == pytest.approx([2.0], abs=0.1)


@pytest.mark.parametrize("law", ["green", "linear"])
def test_chosen_elements_and_step_keep_their_word(law, soft):
    scene = scene_with(soft)
    run = cp.cable.simulate(scene, law=law, tolerance=1e-6, outputs=("position",))
    fine = cp.cable.simulate(scene, law=law, elements=48, step=2e-5)  # a third of the step, an error of a tenth
    assert run.attrs["time_error_estimate"] <= 1e-6
    assert run.attrs["space_error_estimate"] <= 1e-6
    assert distance(run, fine) <= 2e-6  # both together
    rough = cp.cable.simulate(scene, law=law, tolerance=1e-3, outputs=("position",))
    assert rough.attrs["elements"] < run.attrs["elements"]
    assert 1e-6 < distance(rough, fine) <= 2e-3


@pytest.mark.slow
def test_a_tolerance_picks_the_implicit_scheme_where_it_is_faster(soft):
    soft["cable"]["youngs_modulus"] = 2e11
    soft["time"]["duration"] = 20.0
    run = cp.cable.simulate(scene_with(soft), tolerance=1e-3, outputs=("position",))
    assert run.attrs["scheme"] == "trapezoidal"
    assert run.attrs["choice_of_scheme"].startswith("implicit: two runs with steps of")


# --- what it must equal -----------------------------------------------------------------------------------------------

CASES = {
    **TERMS,
    "free end": {
        "ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0], "free": "lower"},
        "motion": {"upper": SMOOTH["upper"]},
    },
    "points": {"initial": {"points": [[0.0, 0.0], [3.0, 4.5], [8.0, 6.0]]}},
    "length": {"initial": {"top_tension": 260.0}},
}


@pytest.mark.parametrize(
    ("law", "case"),
    [
        *(slow(*one) if one == ("green", "mass damping") else one for one in LAW_AND_TERM),  # another loop of the chain
        ("green", "points"),
        ("linear", "points"),
        ("green", "length"),
        ("linear", "free end"),
    ],
)
@pytest.mark.parametrize(("scheme", "step"), [("velocity_verlet", 2e-4), slow("trapezoidal", 5e-3)])
def test_elements_of_order_1_are_the_chain(law, case, scheme, step, smooth):
    scene = scene_with(smooth, **copy.deepcopy(CASES[case]))
    times = [0.0, 0.1, 0.333, 0.5]  # one of them between two steps
    options = {"times": times, "law": law, "scheme": scheme, "step": step, "outputs": ALL}
    chain = cp.chain.simulate(scene, links=8, **options)
    cable = cp.cable.simulate(scene, elements=8, order=1, **options)
    # rounding, and the corrections that end Newton's method, grow over 2500 steps; a folded or slack cable lets them grow more
    allowed = 1e-9 if case not in ("points", "free end") else 1e-7
    assert np.abs(chain.position - cable.position).max() < allowed
    assert np.abs(chain.velocity - cable.velocity).max() < 100.0 * allowed
    for name in ("tension", "tension_minimum", "tension_maximum"):
        assert np.abs(chain[name].values - cable[name].values).max() < 2e4 * 10.0 * allowed, name  # K times a strain


def test_the_shape_of_another_length(soft):
    del soft["motion"]
    soft["initial"] = {"top_tension": 260.0}
    start = cp.cable.simulate(
        scene_with(soft), law="linear", elements=8, step=1e-4, times=[0.0], points=9
    ).position.values[0]
    other = cp.catenary.rest(scene_with(soft, cable={**soft["cable"], "top_tension": 260.0}), points=9).position.values
    assert np.abs(start - other).max() < 1e-10


@pytest.mark.parametrize(("law", "term"), LAW_AND_TERM)
@pytest.mark.parametrize(("scheme", "step"), [("velocity_verlet", 2e-4), slow("trapezoidal", 1e-2)])
def test_planar_is_spatial_bit_for_bit(law, term, scheme, step, smooth):
    mapping = {**smooth, **TERMS[term]}
    options = {
        "elements": 4,
        "order": 4,
        "law": law,
        "scheme": scheme,
        "step": step,
        "times": [0.0, 0.2, 0.5001],
        "outputs": ALL,
    }
    flat, deep = (cp.cable.simulate(scene_with(m), **options) for m in (mapping, spatial(mapping)))
    for name in flat.data_vars:
        values = deep[name].values
        if "coordinate" in deep[name].dims:
            assert not values[..., 2].any()
            values = values[..., :2]
        assert np.array_equal(flat[name].values, values), name


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
def test_what_rests_by_law_21_stays_at_rest(scheme, soft):
    del soft["motion"]
    soft["point_load"] = TERMS["loads"]["point_load"][:1]
    run = cp.cable.simulate(scene_with(soft), elements=4, scheme=scheme, step=2e-4)
    assert np.abs(run.position - run.position[0]).max() < 1e-11  # rounding of forces, 1e-16 K/h, over 20000 steps


@pytest.mark.parametrize("law", ["green", "linear"])
def test_verlet_keeps_the_energy(law, soft):
    del soft["motion"]
    soft["initial"] = {"top_tension": 260.0}
    scene = scene_with(soft)
    drift = []
    for step in (2e-4, 1e-4):
        run = cp.cable.simulate(scene, elements=4, law=law, step=step, points="nodes", outputs=("position", "velocity"))
        elements = Elements(run.arc_length.values)
        xi = elements.stretch(run.position.values)
        density = 2e4 * ((xi**2 - 1.0) ** 2 / 8.0 if law == "green" else 0.5 * (xi - 1.0) ** 2)
        strain = (density * elements.weight).sum(axis=(1, 2))
        kinetic = 0.5 * ((run.velocity.values**2).sum(-1) * elements.share).sum(-1)
        energy = strain + kinetic + 9.81 * (run.position.values[..., 1] * elements.share).sum(-1)
        drift.append(np.abs(energy - energy[0]).max() / kinetic.max())
    # symplectic: the energy swings by an amount of second order and goes nowhere
    assert drift[0] < 1e-3
    assert orders(drift) == pytest.approx([2.0], abs=0.3)


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
def test_instants_between_steps_lie_on_the_curve_and_change_no_bit(scheme, smooth):
    step = 2e-4 if scheme == "velocity_verlet" else 1e-2
    options = {"elements": 4, "scheme": scheme, "step": step, "outputs": ("position", "velocity")}
    few, between = (
        cp.cable.simulate(scene_with(smooth), times=times, **options) for times in ([1.0], [0.9, 0.9 + 0.3 * step, 1.0])
    )
    assert np.array_equal(between.position.values[2], few.position.values[0])
    expected = between.position.values[0] + 0.3 * step * between.velocity.values[0]
    # the next term of Taylor's series with accelerations of some 10 m/s2
    assert np.abs(between.position.values[1] - expected).max() < 20.0 * step**2


def test_results_at_nodes_and_elsewhere_are_one_curve(smooth):
    options = {"elements": 3, "order": 5, "step": 2e-4, "outputs": ("position", "tension")}
    nodes = cp.cable.simulate(scene_with(smooth), points="nodes", **options)
    some = cp.cable.simulate(scene_with(smooth), points=13, **options)
    # borders of elements are particles of both
    assert np.abs(nodes.position.values[:, ::5] - some.position.values[:, ::4]).max() < 1e-13
    assert some.link_arc_length.values == pytest.approx(
        (some.arc_length.values[1:] + some.arc_length.values[:-1]) / 2.0
    )
    assert dict(nodes.position.sizes) == {"time": 7, "particle": 16, "coordinate": 2}
    assert nodes.sizes["link"] == 15
    assert nodes.attrs["element_order"] == 5


# --- compression ------------------------------------------------------------------------------------------------------


def test_where_and_when_it_is_compressed(soft):
    # pushed along its chord, so that no transverse wave comes with it
    push = {
        axis: {"kind": "ramp", "amplitude": -0.1 * part, "duration": 0.05} for axis, part in (("x", 0.8), ("y", 0.6))
    }
    scene = scene_with(soft, motion={"upper": push}, time={"duration": 0.1, "interval": 0.01})
    run = cp.cable.simulate(scene, elements=16, step=2e-5)
    # a wave along the cable takes off v/c of the strain, which is T/K at rest
    time = np.linspace(0.0, 0.025, 5001)
    speed = 2.0 * 30.0 * (time / 0.05) ** 2 * (1.0 - time / 0.05) ** 2
    when = time[np.argmax(speed / np.sqrt(2.0e4) > 200.0 / 2.0e4)]
    assert run.attrs["first_slack_time"] == pytest.approx(
        when, rel=0.05
    )  # the cable sags, and tension falls towards the ground
    assert run.attrs["first_slack_arc_length"] > 0.95 * float(run.unstretched_length)  # where it is pushed
    assert run.attrs["smallest_stretch"] < 1.0
    assert run.attrs["first_slack_time"] < run.attrs["smallest_stretch_time"] <= 0.1
    implicit = cp.cable.simulate(scene, elements=16, scheme="trapezoidal", step=1e-4)
    assert implicit.attrs["first_slack_time"] == pytest.approx(run.attrs["first_slack_time"], abs=2e-4)
    before = cp.cable.simulate(scene, elements=16, step=2e-5, times=[0.0, 0.5 * when])
    assert before.attrs["smallest_stretch"] > 1.0
    assert "first_slack_time" not in before.attrs


def test_tension_only_converges_and_law_21_does_not(soft):
    """In compression law (21) is ill-posed: the shorter a wave, the faster it buckles.  Tension only: first order or so."""
    push = {"upper": {"x": {"kind": "ramp", "amplitude": -0.1, "duration": 0.05}}}
    scene = scene_with(soft, motion=push, time={"duration": 0.2, "interval": 0.01})  # faster than the strain can follow
    gaps = {}
    for law in ("green", "linear"):
        runs = [cp.cable.simulate(scene, law=law, elements=n, step=2e-5, points=65) for n in (4, 8, 16, 32)]
        gaps[law] = [distance(a, b) for a, b in itertools.pairwise(runs)]
    assert gaps["linear"][2] < 0.6 * gaps["linear"][0] < 0.1
    assert min(gaps["green"]) > 0.05  # and so it stays with more elements
    assert gaps["green"][2] > 2.0 * gaps["linear"][2]


# --- what it refuses, what stops --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "tables", "match"),
    [
        ({"law": "rubber"}, {}, r"law: given .rubber."),
        ({"scheme": "rk4"}, {}, r'scheme: given .rk4.; allowed: one of "velocity_verlet", "trapezoidal"'),
        ({"step": 0.1, "tolerance": 0.1}, {}, r"step and tolerance: given \(0.1, 0.1\)"),
        (
            {"elements": 8, "step": 0.01},
            {},
            r"step: given 0.01 s; allowed: below the stability limit, 0.000\d+ s, .*trapez",
        ),
        ({"outputs": "energy"}, {}, r"outputs: given .energy."),
        ({}, {"damping": {"link_viscosity": 0.001}}, r"law and damping.link_viscosity: given .'green', 0.001."),
        ({"elements": 10**9}, {}, r"elements.*allowed: half of this machine's memory"),
        ({"elements": 1}, {"point_load": TERMS["loads"]["point_load"]}, r"elements: given 1; allowed: at least 3"),
    ],
)
def test_options_that_cannot_be(soft, options, tables, match):
    with pytest.raises(cp.SceneError, match=match):
        cp.cable.simulate(scene_with(soft, **tables), **options)


def test_the_limit_of_the_step_is_sharp(soft):
    scene = scene_with(soft)
    limit = cp.cable.simulate(scene, elements=4, step=1e-5, times=[0.0]).attrs["step_limit"]
    sound = cp.cable.simulate(scene, elements=4, step=0.97 * limit)
    assert sound.attrs["energy_excess"] < 1.0
    omega = sound.attrs["highest_angular_frequency"]
    assert limit == pytest.approx(2.0 / omega, rel=1e-12)
    # the bound is that of the straight cable, moved along itself: what the tangent of the cable at rest has, but for its sag
    found = cp.cable.frequencies(scene, elements=4, law="green", count=2 * (4 * 7 - 1))  # two of each inner node
    assert omega == pytest.approx(float(found.angular_frequency[-1]), rel=1e-2)


def test_a_stopped_run_keeps_what_it_had(soft, any_load):
    soft["load"] = {"uniform": [0.0, -1e9], "kind": "polynomial", "coefficients": [0.0, 0.0, 1.0]}
    with pytest.raises(cp.RunStopped, match=r"try") as caught:
        cp.cable.simulate(scene_with(soft), elements=4, step=2e-4)
    partial = caught.value.partial
    assert partial is not None
    assert "incomplete" in partial.attrs
    assert np.isfinite(partial.position).all()


def test_a_divergent_implicit_run_stops_at_the_step_that_leaves_the_bound(soft):
    scene = scene_with(
        soft,
        motion={"upper": {"x": {"kind": "polynomial", "coefficients": [0.0] * 29 + [1e-3]}}},
        time={"duration": 1.0, "interval": 1.0},
    )
    with pytest.raises(cp.RunStopped, match=r"left the finite numbers at 2\.19 s") as stopped:
        cp.cable.simulate(scene, elements=4, scheme="trapezoidal", step=0.01, times=np.arange(100.0))
    np.testing.assert_array_equal(stopped.value.partial.time, [0.0, 1.0, 2.0])
    assert np.abs(stopped.value.partial.position).max() < 1e6 * (10.0 + 8.0)


def test_long_steps_are_solved_without_cuts():
    """Steps of 0.2 s leave axial vibrations in the accelerations: predicted with these, Newton's method fails in 127 steps."""
    options = {"scheme": "trapezoidal", "elements": 8, "law": "linear", "outputs": ("position",)}
    scene = shipped.scene("example3")
    run = cp.cable.simulate(scene, step=0.2, **options)
    assert run.attrs["steps_cut"] == 0
    truth = cp.cable.simulate(scene, step=0.02, **options)
    assert distance(run, truth) < 0.02  # steps of 0.05, 0.1 and 0.2 s all leave out the same 0.011 to 0.012


# --- the truth on file ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["green", "linear"])
@pytest.mark.parametrize("name", ["example2", "example3", "example4", "sagging", "stiff_spatial"])
def test_truth_on_file(name, law):
    truth = cp.archive.read(shipped.truth_path(name, law))
    assert truth.convergence_error.values[-2] <= 1e-6  # two resolutions agree
    assert np.isnan(truth.convergence_error.values[-1])
    assert truth.attrs["law"] == law
    assert truth.attrs["smallest_stretch"] > 1.0
    short = truth.isel(time=slice(0, 4))
    run = cp.cable.simulate(
        shipped.scene(name), law=law, times=short.time.values, elements=12, scheme="trapezoidal", step=2e-3
    )
    scale = np.sqrt(((truth.position - truth.position[0]) ** 2).sum("coordinate").mean("particle")).max()
    gap = np.sqrt(((run.position - short.position) ** 2).sum("coordinate").mean("particle")).max() / scale
    assert gap < 3e-5  # what steps of 2 ms leave of waves from the ends' start


def test_no_truth_of_that_name():
    with pytest.raises(cp.SceneError, match=r"truth: given .example9, green.; allowed: .*example2, green"):
        shipped.truth_path("example9", "green")
