"""Which members run in compiled blocks and lanes, what falls back to single runs, and what they share."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from member_scenes import BOTH, CASES, ONE, assert_close, scenes_of, single_runs
from scenes import full_modes
from suite import slow, with_slow

import cablepod as cp
from cablepod.batch import _members as members
from cablepod.catenary._statics import load_plane, load_planes, member_statics, solve_statics
from cablepod.condensed import _batch as condensed_batch
from cablepod.condensed._lanes import MemberCoefficients
from cablepod.discretisation import _similarity as similarity
from cablepod.parameters._from_scene import Members

pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")
STEP = 2e-3
GIVEN = {"step": STEP, "times": np.array([0.0, 0.04, 0.08]), "outputs": ("tension",)}
FITTED = {"times": np.arange(0.0, 2.0, 0.0371), "outputs": ("tension", "error_estimate")}
MANY = {"cable_top_tension": np.linspace(200.0, 300.0, 41), "motion_lower_y_phase": np.linspace(0.0, 6.0, 41)}


@pytest.fixture
def alone(monkeypatch):
    """Record the tensions or lengths of members that run alone."""
    solve, keys = condensed_batch.solve, []

    def recorded(model, request):
        keys.append(float(model.chain.p.length_value))
        return solve(model, request)

    monkeypatch.setattr(condensed_batch, "solve", recorded)
    return keys


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("case", with_slow(CASES, "still"))
def test_members_run_in_blocks_and_lanes(soft, alone, case, dims):
    scenes, modes = scenes_of(soft, *CASES[case], dims), full_modes(dims=dims)
    cp.condensed.simulate(scenes, modes, **GIVEN)
    assert not alone
    cp.condensed.simulate(scenes, modes, **FITTED)
    assert len(alone) < 4 if case != "tension" else not alone  # some need a third run


@pytest.mark.parametrize(
    ("case", "options", "most"),
    [
        ("tension", {"scheme": "numerov"}, 0),
        ("tension", {"times": [2.0]}, 0),
        ("ramp", {"outputs": ("tension_extremes",), "window": (0.7, 1.3)}, 2),
        ("ramp", {"outputs": ("tension_extremes",), "window": (0.7, 1.3), "step": STEP, "times": [0.0, 2.0]}, 0),
    ],
)
def test_members_with_these_options_run_in_lanes(soft, alone, case, options, most):
    cp.condensed.simulate(scenes_of(soft, *CASES[case]), full_modes(), **FITTED | {"outputs": ("tension",)} | options)
    assert len(alone) <= most  # of four


def test_unsupported_requests_fall_back_to_single_runs(soft, alone):
    tensions = {"cable_top_tension": [200.0, 300.0]}
    scenes = scenes_of(soft, ONE, tensions)
    load = {"uniform": [3.0, -2.0], "kind": "harmonic", "amplitude": 0.3, "angular_frequency": 3.0}
    point = [{"arc_length": 0.4, "force": [5.0, -20.0]}]
    ramp = {"upper": {"x": {"kind": "ramp", "amplitude": 0.01, "duration": 1.0}}}
    no_motion = [scenes_of(soft, motion, {}) for motion in (ONE, {})]
    loaded = [
        cp.make_scene({**soft, "motion": ONE, key: value}) for key, value in (("load", load), ("point_load", point))
    ]

    def count(scenes, **changes):
        alone.clear()
        cp.condensed.simulate(scenes, full_modes(), **GIVEN | changes)
        return len(alone)

    assert count(scenes) == 0
    for changes in (
        {"order": "exact"},
        {"scheme": "trapezoidal"},
        {"times": np.array([0.0, 0.0031])},
        {"times": np.array([0.5, 1.0, 1.5]) * STEP},  # as many saved steps as instants, but interpolated
        {"outputs": ("velocity",)},
        {"outputs": ("position", "error_estimate")},
    ):
        assert count(scenes, **changes) == 2, changes
    for other in (
        scenes_of(soft, ramp, tensions),
        *(scene.assign(cable_top_tension=("member", [200.0, 300.0])) for scene in loaded),
        scenes.assign(
            motion_upper_x_kind=("member", ["harmonic", "one_minus_cosine"]),
            motion_upper_x_phase=("member", [0.0, np.nan]),
        ),
        scenes.assign(time_duration=("member", [1.0, 2.0])),  # which decides on the reference state
        xr.concat(no_motion, "member", data_vars="all", combine_attrs="override"),
    ):
        assert count(other) == 2


def test_members_without_an_equilibrium_fall_back_to_single_runs(soft, alone, monkeypatch):
    scenes, modes = scenes_of(soft, *CASES["tension"]), full_modes()
    truth, start = single_runs(scenes, modes, **GIVEN), MemberCoefficients.starts
    alone.clear()

    def without_equilibrium(coefficients, step):
        q, v, limit, chord_tension = start(coefficients, step)
        return q, v, np.where(coefficients.parameters.length_value == 300.0, np.nan, limit), chord_tension

    monkeypatch.setattr(MemberCoefficients, "starts", without_equilibrium)
    assert_close(cp.condensed.simulate(scenes, modes, **GIVEN), truth)
    assert alone == [300.0]


def test_members_that_need_a_third_run_run_alone(soft, alone, monkeypatch):
    scenes, modes = scenes_of(soft, ONE, {"cable_top_tension": [200.0, 300.0, 230.0]}), full_modes()
    cp.condensed.simulate(scenes, modes, **FITTED)
    assert not alone
    fit = condensed_batch.fit

    def refused(lanes, coefficients, *arguments):
        done, errors = fit(lanes, coefficients, *arguments)
        done.completed[coefficients.parameters.length_value == 300.0] = False
        return done, errors

    monkeypatch.setattr(condensed_batch, "fit", refused)
    run = cp.condensed.simulate(scenes, modes, **FITTED)
    assert alone == [300.0]
    assert_close(run, single_runs(scenes, modes, **FITTED))


def test_bits_do_not_depend_on_threads(soft):
    scenes, modes, runs = scenes_of(soft, BOTH, MANY), full_modes(), []
    for count in (1, 2, 5):
        seen = []
        with members.thread_limit(count):
            runs.append(cp.condensed.simulate(scenes, modes, **GIVEN | {"times": None}, progress=seen.append))
        assert seen == sorted(seen)
        assert seen[-1] == 1.0
        assert len(seen) > 1
    for run in runs[1:]:
        xr.testing.assert_identical(runs[0], run)


@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("case", CASES)
def test_stacked_parameters_equal_those_of_each_scene(soft, case, dims):
    scenes = scenes_of(soft, *CASES[case], dims)
    before = scenes.copy(deep=True)
    members = Members(scenes)
    assert members.can_be_stacked
    stacked = members.stacked(0, len(members))
    xr.testing.assert_identical(scenes, before)
    statics, solved = member_statics(stacked)
    assert solved.all()
    lengths, tension = statics[:, 0], 0.5 * (statics[:, 4] + statics[:, 5])
    features = similarity.features(stacked, lengths, 2.0, tension)
    planes, times = load_planes(stacked), np.linspace(0.0, 2.0, 5)
    for i, p in enumerate(members):
        for one, many in zip(load_plane(p), planes, strict=True):
            np.testing.assert_array_equal(one, many[i])
        np.testing.assert_array_equal(solve_statics(p, p.length_key, p.length_value), statics[i])
        np.testing.assert_array_equal(stacked.load_at(0.0)[i], p.load_at(0.0))
        assert (stacked.stiffness[i], stacked.mass[i], stacked.damping[i]) == (p.stiffness, p.mass, p.damping)
        assert np.broadcast_to(stacked.shortest_time_scale, lengths.shape)[i] == p.shortest_time_scale
        for derivative in (0, 1, 2):
            np.testing.assert_array_equal(
                stacked.end_positions(times, derivative)[i], p.end_positions(times, derivative)
            )
        np.testing.assert_array_equal(features[i], similarity.features(p, lengths[i], 2.0, tension[i]))
