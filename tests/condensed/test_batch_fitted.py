"""Members whose steps fit their models run in lanes and equal runs of their scenes alone."""

from __future__ import annotations

import numpy as np
import pytest
from member_scenes import BOTH, CASES, ONE, assert_close, scenes_of, single_runs
from scenes import full_modes
from suite import slow, with_slow

import cablepod as cp
from cablepod import errors
from cablepod.condensed import _batch as condensed_batch
from cablepod.condensed import _batch_fitted as fitted

# the modes of these scenes are sines, which the estimate of some members does not accept
pytestmark = pytest.mark.filterwarnings("ignore::cablepod.errors.OutOfRangeWarning")
#: Between the steps of all runs.
TIMES = np.arange(0.0, 2.0, 0.0371)
OUTPUTS = ("position", "tension", "tension_extremes", "error_estimate")


@pytest.fixture
def alone(monkeypatch):
    """Record the tensions or lengths of members that run alone."""
    solve, keys = condensed_batch.solve, []

    def recorded(model, request):
        keys.append(float(model.chain.p.length_value))
        return solve(model, request)

    monkeypatch.setattr(condensed_batch, "solve", recorded)
    return keys


def assert_equal_to_runs_alone(run, scenes, modes, **options):
    """Compare with runs of the scenes alone: differences are rounding, some 1e-14 of motion and tension."""
    for i in range(scenes.sizes["member"]):
        truth, member = cp.condensed.simulate(scenes.isel(member=i), modes, **options), run.isel(member=i)
        for name, values in truth.data_vars.items():
            size = np.abs(values.values).max()
            moved = np.abs(values.values - values.values[:1]).max() if "time" in values.dims else 0.0
            # a still cable moves by the tolerance of its start, some 1e-8
            scale = moved if moved > 1e-7 * size and not name.startswith("tension") else size
            assert np.abs(member[name].values - values.values).max() <= 1e-12 * scale, (name, i)
        for name, value in truth.attrs.items():
            given = run.attrs[name] if name in run.attrs else member.get(name)
            if name in ("step", "number_of_steps", "scheme"):
                assert given == value, (name, i)
            elif isinstance(value, float):
                # the residual of the estimate is a difference of forces that nearly cancel
                tolerance = 1e-7 if name.endswith("error_estimate") else 1e-10
                assert float(given) == pytest.approx(value, rel=tolerance, abs=1e-13), (name, i)


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("case", with_slow(CASES, "still"))
def test_members_in_lanes_equal_runs_of_their_scenes_alone(soft, alone, case, dims):
    scenes, modes = scenes_of(soft, *CASES[case], dims), full_modes(dims=dims)
    options = {"rank": 3, "outputs": OUTPUTS, "links": [1, 5], "times": TIMES}
    run = cp.condensed.simulate(scenes, modes, **options)
    in_lanes = scenes.sizes["member"] - len(alone)
    assert in_lanes > 0
    assert_equal_to_runs_alone(run, scenes, modes, **options)


def test_members_with_one_output_instant_are_compared_at_others_too(soft, alone):
    scenes, modes = scenes_of(soft, *CASES["tension"]), full_modes()
    options = {"rank": 3, "outputs": OUTPUTS, "times": [2.0]}
    run = cp.condensed.simulate(scenes, modes, **options)
    assert not alone
    assert run.position.sizes["time"] == 1
    assert_equal_to_runs_alone(run, scenes, modes, **options)
    many = cp.condensed.simulate(scenes, modes, **{**options, "times": np.linspace(0.0, 2.0, 65)})
    np.testing.assert_allclose(run.time_error_estimate, many.time_error_estimate, rtol=0.1)


def test_extremes_within_a_window_and_with_a_ramp_equal_those_of_runs_alone(soft, alone):
    scenes, modes = scenes_of(soft, *CASES["ramp"]), full_modes()
    options = {"rank": 3, "outputs": ("tension_extremes",), "times": TIMES, "window": (0.7, 1.3)}
    run = cp.condensed.simulate(scenes, modes, **options)
    assert len(alone) <= 2  # of four
    assert_equal_to_runs_alone(run, scenes, modes, **options)
    whole = cp.condensed.simulate(scenes, modes, **{**options, "window": None})
    assert (run.tension_maximum < whole.tension_maximum).any()
    assert run.attrs["window_start"] == 0.7


@pytest.mark.parametrize("options", [{}, {"step": 2e-3}])
@pytest.mark.parametrize("window", [(0.7, 9.0), (0.5, 0.5001)])
def test_windows_that_no_member_can_have_are_refused(soft, options, window):
    scenes, modes = scenes_of(soft, *CASES["tension"]), full_modes()
    with pytest.raises(errors.SceneError, match="window: given"):
        cp.condensed.simulate(
            scenes, modes, rank=3, outputs=("tension_extremes",), times=[2.0], window=window, **options
        )


@pytest.mark.slow
@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize(
    "outputs", [("position", "error_estimate"), slow(()), slow(("tension",)), slow(("tension_extremes",))]
)
def test_lanes_give_the_variables_and_attributes_of_single_runs(soft, monkeypatch, outputs, dims):
    scenes, modes = scenes_of(soft, *CASES["damping"], dims), full_modes(dims=dims)
    truth = single_runs(monkeypatch, scenes, modes, rank=2, outputs=outputs)
    run = cp.condensed.simulate(scenes, modes, rank=2, outputs=outputs)
    for result in (run, truth):  # a difference of forces, see above
        assert ("error_estimate" in result) == ("error_estimate" in outputs)
        for name in ("error_estimate", "time_error_estimate"):
            if name in result:
                result[name] = result[name].round(9)
    assert_close(run, truth)


def test_members_that_need_a_third_run_run_alone(soft, alone, monkeypatch):
    scenes, modes = scenes_of(soft, ONE, {"cable_top_tension": [200.0, 300.0, 230.0]}), full_modes()
    cp.condensed.simulate(scenes, modes, rank=3)
    assert not alone
    original = fitted.FittedBatch._run_group

    def refused(self, lanes, part, *arguments):
        done = original(self, lanes, part, *arguments)
        done.completed[self.parameters.length_value[part] == 300.0] = False
        return done

    monkeypatch.setattr(fitted.FittedBatch, "_run_group", refused)
    run = cp.condensed.simulate(scenes, modes, rank=3)
    assert alone == [300.0]
    assert_equal_to_runs_alone(run, scenes, modes, rank=3)


def test_the_bits_of_a_member_do_not_depend_on_its_lane(soft, monkeypatch):
    varied = {"cable_top_tension": np.linspace(200.0, 300.0, 41), "motion_lower_y_phase": np.linspace(0.0, 6.0, 41)}
    scenes, modes = scenes_of(soft, BOTH, varied), full_modes()
    options = {"rank": 3, "outputs": OUTPUTS, "times": TIMES}
    run = cp.condensed.simulate(scenes, modes, **options)
    other = np.array([0, *range(40, 2, -1)])  # the first member gives the shared coefficients
    for most in (1, fitted.MAX_SAVED):
        monkeypatch.setattr(fitted, "MAX_SAVED", most)  # at least all lanes
        part = cp.condensed.simulate(scenes.isel(member=other), modes, **options)
        for name in ("amplitude", "position", "tension", "tension_minimum", "tension_maximum", "error_estimate"):
            np.testing.assert_array_equal(part[name], run[name].isel(member=other), err_msg=f"{name} {most}")


def test_failing_members_report_the_reason_of_single_runs(soft, monkeypatch):
    varied = {
        "cable_top_tension": [230.0, 1.0, 230.0],  # member 1: no such cable
        "motion_upper_x_amplitude": [-0.05, -0.05, -0.02],
    }
    scenes, modes = scenes_of(soft, ONE, varied), full_modes()
    with pytest.warns(errors.MemberFailedWarning, match="1 of 3 members"):
        run = cp.condensed.simulate(scenes, modes, rank=3, outputs=())
    assert "cable.top_tension: given 1.0" in run.failure.values[1]
    assert np.isnan(run.amplitude[1]).all()
    assert_equal_to_runs_alone(run.isel(member=[0, 2]), scenes.isel(member=[0, 2]), modes, rank=3, outputs=())


@pytest.mark.slow
def test_chords_that_turn_into_their_first_normal_have_no_positions(soft):
    # the end of the first member circles about the lower one, by a right angle and more
    size = {"motion_upper_x_amplitude": [-7.0, -0.05, 0.02], "motion_upper_y_amplitude": [7.0, 0.05, 0.02]}
    varied = {"ends_upper": [[7.0, 0.0], [7.0, 3.0], [6.0, 4.0]], **size}
    motion = {"upper": {"x": ONE["upper"]["x"], "y": {**ONE["upper"]["x"], "kind": "harmonic"}}}
    scenes, modes = scenes_of(soft, motion, varied, 3), full_modes(dims=3)
    with pytest.warns(errors.MemberFailedWarning, match="1 of 3 members"):
        run = cp.condensed.simulate(scenes, modes, rank=3, times=[0.6, 1.2, 1.8], outputs=("position",))
    assert "turns into the direction" in run.failure.values[0]
    assert np.isnan(run.position[0]).all()


def test_a_given_scheme_of_fourth_order_runs_in_lanes(soft, alone):
    scenes, modes = scenes_of(soft, *CASES["tension"]), full_modes()
    run = cp.condensed.simulate(scenes, modes, rank=3, scheme="numerov")
    assert not alone
    assert_equal_to_runs_alone(run, scenes, modes, rank=3, scheme="numerov")
