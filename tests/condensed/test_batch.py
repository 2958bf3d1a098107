"""Compiled blocks of members equal single runs; unsupported and failing members fall back to single runs."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import xarray as xr
from member_scenes import BOTH, CASES, ONE, assert_close, scenes_of, single_runs
from scenes import full_modes
from suite import slow, with_slow

import cablepod as cp
from cablepod import errors
from cablepod.batch import _members as members
from cablepod.catenary._statics import load_plane, load_planes, member_statics, solve_statics
from cablepod.condensed import _batch as condensed_batch
from cablepod.condensed import _runs as condensed_runs
from cablepod.condensed._assembly import model_of
from cablepod.discretisation import _similarity as similarity
from cablepod.parameters._from_scene import Members

STEP = 2e-3
TIMES = np.arange(0.0, 2.01, 0.04)  # two blocks of steps, the second not full
OPTIONS = {"rank": 3, "order": "leading", "step": STEP, "times": TIMES, "outputs": ("tension", "tension_extremes")}


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("case", with_slow(CASES, "still"))
def test_compiled_blocks_equal_single_runs(soft, monkeypatch, case, dims):
    scenes, modes = scenes_of(soft, *CASES[case], dims), full_modes(dims=dims)
    truth = single_runs(monkeypatch, scenes, modes, links=[1, 5], **OPTIONS)
    with monkeypatch.context() as patch:  # no member falls back to a single run
        patch.setattr(condensed_batch, "solve", None)
        run = cp.condensed.simulate(scenes, modes, links=[1, 5], **OPTIONS)
    assert_close(run, truth)


def test_extremes_within_a_window_equal_those_of_single_runs(soft, monkeypatch):
    scenes, modes = scenes_of(soft, *CASES["ramp"]), full_modes()
    options = {**OPTIONS, "window": (0.7, 1.3)}
    truth = single_runs(monkeypatch, scenes, modes, **options)
    with monkeypatch.context() as patch:
        patch.setattr(condensed_batch, "solve", None)
        run = cp.condensed.simulate(scenes, modes, **options)
    assert_close(run, truth)
    whole = cp.condensed.simulate(scenes, modes, **OPTIONS)
    assert (run.tension_maximum < whole.tension_maximum).any()


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("outputs", [(), ("tension_extremes",), ("position", "tension")])
def test_all_links_positions_and_no_outputs(soft, monkeypatch, outputs, dims):
    scenes, modes = scenes_of(soft, *CASES["both ends"], dims), full_modes(dims=dims)
    options = {**OPTIONS, "outputs": outputs, "times": None}
    truth = single_runs(monkeypatch, scenes, modes, **options)
    with monkeypatch.context() as patch:
        patch.setattr(condensed_batch, "solve", None)
        run = cp.condensed.simulate(scenes, modes, **options)
    assert_close(run, truth)
    assert ("tension_maximum" in run) == ("tension_extremes" in outputs)
    assert ("position" in run) == ("position" in outputs)


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("case", with_slow(CASES, "still"))
def test_members_equal_runs_of_their_scenes_alone_to_rounding(soft, case, dims):
    # own coefficients, own start, another kernel: differences are rounding, some 1e-14 of motion and tension
    scenes, modes = scenes_of(soft, *CASES[case], dims), full_modes(dims=dims)
    options = {**OPTIONS, "outputs": ("position", "tension", "tension_extremes"), "links": [1, 5]}
    run = cp.condensed.simulate(scenes, modes, **options)
    for i in range(4):
        alone = cp.condensed.simulate(scenes.isel(member=i), modes, **options)
        for name in ("amplitude", "position", "end_position", "tension", "tension_minimum", "tension_maximum"):
            values, truth = run[name].isel(member=i).values, alone[name].values
            size = np.abs(truth).max()
            moved = np.abs(truth - truth[:1]).max() if "time" in alone[name].dims else 0.0
            scale = (
                moved if moved > 1e-9 * size and not name.startswith("tension") else size
            )  # a still cable has no motion
            assert np.abs(values - truth).max() <= 1e-12 * scale, (name, i)


@pytest.mark.slow
def test_chords_that_turn_into_their_first_normal_have_no_positions(soft, monkeypatch):
    # the end of the first member circles about the lower one, by a right angle and more
    size = {"motion_upper_x_amplitude": [-7.0, -0.05, 0.02], "motion_upper_y_amplitude": [7.0, 0.05, 0.02]}
    varied = {"ends_upper": [[7.0, 0.0], [7.0, 3.0], [6.0, 4.0]], **size}
    motion = {"upper": {"x": ONE["upper"]["x"], "y": {**ONE["upper"]["x"], "kind": "harmonic"}}}
    scenes, modes = scenes_of(soft, motion, varied, 3), full_modes(dims=3)
    options = {**OPTIONS, "outputs": ("position",)}
    with pytest.warns(errors.MemberFailedWarning, match="1 of 3 members"):
        truth = single_runs(monkeypatch, scenes, modes, **options)
    with pytest.warns(errors.MemberFailedWarning, match="1 of 3 members"):
        run = cp.condensed.simulate(scenes, modes, **options)
    assert_close(run, truth)
    assert "turns into the direction" in run.failure.values[0]


def test_the_bits_of_a_member_do_not_depend_on_its_lane(soft):
    varied = {"cable_top_tension": np.linspace(200.0, 300.0, 41), "motion_lower_y_phase": np.linspace(0.0, 6.0, 41)}
    scenes, modes = scenes_of(soft, BOTH, varied), full_modes()
    options = {**OPTIONS, "outputs": ("position", "tension", "tension_extremes")}
    run = cp.condensed.simulate(scenes, modes, **options)
    other = np.array([0, *range(40, 2, -1)])  # the first member gives the shared coefficients
    part = cp.condensed.simulate(scenes.isel(member=other), modes, **options)
    for name in ("amplitude", "position", "tension", "tension_minimum", "tension_maximum"):
        np.testing.assert_array_equal(part[name], run[name].isel(member=other), err_msg=name)


def test_failing_members_report_the_reason_of_single_runs(soft, monkeypatch):
    # member 1: no such cable; member 2: step above the limit; member 3: stiffens during the run
    varied = {
        "cable_top_tension": [230.0, 1.0, 5e5, 230.0, 300.0],
        "motion_upper_x_amplitude": [-0.05, -0.05, -0.05, 5.25, -0.02],  # just too stiff: the coordinates stay finite
    }
    scenes, modes = scenes_of(soft, ONE, varied), full_modes()
    options = {**OPTIONS, "step": 0.02, "links": [1]}
    with pytest.warns(errors.MemberFailedWarning, match="3 of 5 members"):
        truth = single_runs(monkeypatch, scenes, modes, **options)
    with pytest.warns(errors.MemberFailedWarning, match="3 of 5 members"):
        run = cp.condensed.simulate(scenes, modes, **options)
    assert_close(run, truth)
    for i, why in ((1, "cable.top_tension: given 1.0"), (2, "step: given"), (3, "stiffened")):
        assert why in run.failure.values[i]
        assert np.isnan(run.tension[i]).all()
    assert list(run.failure.values[[0, 4]]) == ["", ""]
    with pytest.raises(cp.SceneError, match=r"step: given 0\.02 s"):
        cp.condensed.simulate(scenes.isel(member=[2, 2]), modes, **options)


def test_members_without_an_equilibrium_fall_back_to_single_runs(soft, monkeypatch):
    scenes, modes = scenes_of(soft, *CASES["tension"]), full_modes()
    truth = single_runs(monkeypatch, scenes, modes, links=[1, 5], **OPTIONS)
    start, solve, alone = condensed_batch.CondensedBatch.starts, condensed_runs.solve, []

    def without_equilibrium(batch, step):
        q, v, limit, chord_tension = start(batch, step)
        return q, v, np.where(batch.parameters.length_value == 300.0, np.nan, limit), chord_tension

    def recorded(model, request):
        alone.append(model.chain.p.length_value)
        return solve(model, request)

    monkeypatch.setattr(condensed_batch.CondensedBatch, "starts", without_equilibrium)
    monkeypatch.setattr(condensed_batch, "solve", recorded)
    assert_close(cp.condensed.simulate(scenes, modes, links=[1, 5], **OPTIONS), truth)
    assert alone == [300.0]


def test_any_number_of_threads_gives_the_same_bits_and_progress(soft):
    varied = {"cable_top_tension": np.linspace(200.0, 300.0, 41), "motion_lower_y_phase": np.linspace(0.0, 6.0, 41)}
    scenes, modes = scenes_of(soft, BOTH, varied), full_modes()
    runs = []
    for count in (1, 2, 5):
        seen = []
        with members.thread_limit(count):
            runs.append(cp.condensed.simulate(scenes, modes, links=[5], progress=seen.append, **OPTIONS))
        assert seen == sorted(seen)
        assert seen[-1] == 1.0
        assert len(seen) > 1
    for run in runs[1:]:
        xr.testing.assert_identical(runs[0], run)


def supported(scenes, **changes):
    """Return whether the compiled blocks support scenes and options."""
    given = {**OPTIONS, "links": np.array([0]), "scheme": None, **changes}
    modes, all_members = full_modes(), Members(scenes)
    model = model_of(all_members[0], modes, rank=3, order=given["order"], law="linear")
    names = ("times", "scheme", "step", "outputs", "links")
    request = condensed_runs.CondensedRequest(**{name: given[name] for name in names})
    return condensed_batch.plan(modes, model, all_members, request) is not None


def test_unsupported_requests_fall_back_to_single_runs(soft, monkeypatch):
    tensions = {"cable_top_tension": [200.0, 300.0]}
    scenes = scenes_of(soft, ONE, tensions)
    assert supported(scenes)
    for changes in (
        {"order": "exact"},
        {"scheme": "trapezoidal"},
        {"times": np.array([0.0, 0.0031])},
        {"times": np.array([0.5, 1.0, 1.5]) * STEP},  # as many saved steps as instants, but interpolated
        {"outputs": ("velocity",)},
        {"outputs": ("position", "error_estimate")},
    ):
        assert not supported(scenes, **changes), changes
    ramp = {"upper": {"x": {"kind": "ramp", "amplitude": 0.01, "duration": 1.0}}}
    load = {"uniform": [3.0, -2.0], "kind": "harmonic", "amplitude": 0.3, "angular_frequency": 3.0}
    point = [{"arc_length": 0.4, "force": [5.0, -20.0]}]
    kinds = scenes.assign(motion_upper_x_kind=("member", ["harmonic", "one_minus_cosine"]), motion_upper_x_phase=0.0)
    durations = scenes.assign(time_duration=("member", [1.0, 2.0]))
    gaps = xr.concat(
        [scenes_of(soft, ONE, {}), scenes_of(soft, {}, {})], "member", data_vars="all", combine_attrs="override"
    )
    assert not supported(scenes_of(soft, ramp, tensions))
    for key, values in (("load", load), ("point_load", point)):
        other = cp.make_scene({**soft, "motion": ONE, key: values})
        assert not supported(other.assign(cable_top_tension=("member", [200.0, 300.0])))
    assert not supported(kinds)
    assert not supported(durations)  # which decides on the reference state
    assert not supported(gaps)
    varying = cp.make_scene({**soft, "motion": ONE, "load": load, "point_load": point})
    varying = varying.assign(cable_top_tension=("member", [200.0, 300.0], varying["cable_top_tension"].attrs))
    run = cp.condensed.simulate(varying, full_modes(), links=[1], **OPTIONS)
    for i in (0, 1):
        alone = cp.condensed.simulate(varying.isel(member=i), full_modes(), links=[1], **OPTIONS)
        np.testing.assert_allclose(run.tension[i], alone.tension, rtol=1e-9)


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


def test_end_positions_take_memory_only_when_read(soft):
    # twice as many numbers as the amplitudes of two modes: most of the memory of a batch without shapes
    scenes, modes = scenes_of(soft, *CASES["both ends"]), full_modes()
    run = cp.condensed.simulate(scenes, modes, links=[1], **OPTIONS)
    assert not run.variables["end_position"]._in_memory
    again = pickle.loads(pickle.dumps(run))  # as from another process
    truth = np.stack([p.end_positions(TIMES) for p in Members(scenes)])
    moved = np.ptp(truth, axis=1).max()
    for ends in (again.end_position, run.copy(deep=True).end_position, run.end_position):
        np.testing.assert_allclose(ends.isel(time=3, end=1), truth[:, 3, 1], rtol=0, atol=1e-15 * moved + 1e-14)
        np.testing.assert_allclose(ends, truth, rtol=0, atol=1e-14)
    assert run.variables["end_position"]._in_memory
    run.end_position[0] = 0.0  # as any other variable
    assert not run.end_position[0].any()
    np.testing.assert_array_equal(run.end_position[1:], again.end_position[1:])
