"""Members, in compiled blocks with a given step or in lanes with steps that fit, equal runs of their scenes alone."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from member_scenes import BOTH, CASES, ONE, assert_close, scenes_of, single_runs
from references.condensed_ode import Reference
from references.numbers import Numbers
from scenes import LENGTHS, full_modes
from suite import slow, slow_but, with_slow

import cablepod as cp

# the modes of these scenes are sines, which the estimate of some members does not accept
pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")
STEP = 2e-3
OUTPUTS = ("position", "tension", "tension_extremes")
#: Options of a call on all modes, as the reference has them: lanes are compiled for their number.  Given steps make two blocks,
#: the second not full; the other instants lie between the steps of all runs.
STEPS = {
    "given": {"step": STEP, "times": np.arange(0.0, 2.01, 0.04), "outputs": OUTPUTS},
    "fitted": {"times": np.arange(0.0, 2.0, 0.0371), "outputs": (*OUTPUTS, "error_estimate")},
}


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


def varied_loads(soft):
    """Make members whose loads vary with time, which no lane takes."""
    load = {"uniform": [3.0, -2.0], "kind": "harmonic", "amplitude": 0.3, "angular_frequency": 3.0}
    point = [{"arc_length": 0.4, "force": [5.0, -20.0]}]
    scene = cp.make_scene({**soft, "motion": ONE, "load": load, "point_load": point})
    return scene.assign(cable_top_tension=("member", [200.0, 300.0], scene["cable_top_tension"].attrs))


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("case", with_slow([*CASES, "loads"], "still"))
@pytest.mark.parametrize("steps", STEPS)
def test_members_equal_runs_of_their_scenes_alone(soft, steps, case, dims):
    scenes = varied_loads(soft) if case == "loads" else scenes_of(soft, *CASES[case], dims)
    options = STEPS[steps] | {"links": [1, 5]}
    modes = full_modes(dims=scenes.sizes["coordinate"])
    assert_equal_to_runs_alone(cp.condensed.simulate(scenes, modes, **options), scenes, modes, **options)


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize(
    ("steps", "outputs"),
    [
        *(("given", outputs) for outputs in ((), ("tension_extremes",), ("position", "tension"))),
        *(
            slow("fitted", outputs)
            for outputs in ((), ("tension_extremes",), ("tension",), ("position", "error_estimate"))
        ),
    ],
)
def test_variables_and_attributes_are_those_of_single_runs(soft, steps, outputs, dims):
    case = "both ends" if steps == "given" else "damping"
    scenes, modes = scenes_of(soft, *CASES[case], dims), full_modes(dims=dims)
    options = {"step": STEP if steps == "given" else None, "outputs": outputs}
    run, truth = cp.condensed.simulate(scenes, modes, **options), single_runs(scenes, modes, **options)
    assert_close(run, truth)
    assert ("tension_maximum" in run) == ("tension_extremes" in outputs)
    assert ("position" in run) == ("position" in outputs)
    assert ("error_estimate" in run) == ("error_estimate" in outputs)


# --- independent ODE solution of each member --------------------------------------------------------------------------


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("case", slow_but(CASES, "chord", "damping", "load", "ramp"))
def test_members_solve_the_equations_of_their_links(soft, case, dims):
    scenes, modes, times = scenes_of(soft, *CASES[case], dims), full_modes(dims=dims), np.array([0.4, 0.8])
    options = {"scheme": "velocity_verlet", "times": times, "outputs": ("position", "tension")}
    coarse, fine = (cp.condensed.simulate(scenes, modes, step=h, **options) for h in (1 / 4000, 1 / 8000))

    # Richardson extrapolation of a second-order scheme, as for a single run: the error is of fourth order, below 1e-12 of the
    # fastest motion; DOP853 has a tolerance of 1e-11 a step, over about 1e3 steps
    def extrapolated(name, dim):
        values = (4.0 * fine[name] - coarse[name]) / 3.0
        return values.transpose("member", "time", dim, ...).values

    position, tension = extrapolated("position", "particle")[:, :, 1:-1], extrapolated("tension", "link")
    for i in range(scenes.sizes["member"]):
        positions, tensions = Reference(scenes.isel(member=i), LENGTHS, order="leading").motion(times)
        np.testing.assert_allclose(position[i], positions, rtol=0, atol=1e-8, err_msg=f"member {i}")
        np.testing.assert_allclose(tension[i], tensions, rtol=0, atol=1e-7, err_msg=f"member {i}")


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("case", slow_but(CASES, "amplitude", "load"))
@pytest.mark.parametrize("scheme", ["numerov", slow(None)])
def test_members_with_steps_of_their_own_solve_them_as_well(soft, scheme, case, dims):
    scenes, modes = scenes_of(soft, *CASES[case], dims), full_modes(dims=dims)
    times, tolerance = np.linspace(0.0, 0.8, 41), 1e-6
    options = {"times": times, "tolerance": tolerance, "outputs": OUTPUTS}
    run = cp.condensed.simulate(scenes, modes, scheme=scheme, **options)
    for i in range(scenes.sizes["member"]):
        reference, member = Reference(scenes.isel(member=i), LENGTHS, order="leading"), run.isel(member=i)
        positions, tensions = reference.motion(times)
        moved, error = (
            np.sqrt(((change**2).sum(axis=2)).mean(axis=1)).max()
            for change in (positions - positions[0], member.position.values[:, 1:-1] - positions)
        )
        # a still cable moves by the tolerance of its start
        assert error <= 2.0 * tolerance * moved + 1e-9, f"member {i}"
        np.testing.assert_allclose(member.tension, tensions, rtol=1e-5, err_msg=f"member {i}")
        of_steps = reference.motion(np.arange(int(member.number_of_steps) + 1) * float(member.step))[1]
        for name, extreme in (("minimum", of_steps.min(axis=0)), ("maximum", of_steps.max(axis=0))):
            np.testing.assert_allclose(member[f"tension_{name}"], extreme, rtol=1e-5, err_msg=f"member {i}")


# --- options ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("steps", STEPS)
def test_extremes_within_a_window_and_with_a_ramp_equal_those_of_runs_alone(soft, steps):
    scenes, modes = scenes_of(soft, *CASES["ramp"]), full_modes()
    options = STEPS[steps] | {"outputs": ("tension_extremes",), "window": (0.7, 1.3)}
    run = cp.condensed.simulate(scenes, modes, **options)
    assert_equal_to_runs_alone(run, scenes, modes, **options)
    whole = cp.condensed.simulate(scenes, modes, **{**options, "window": None})
    assert (run.tension_maximum < whole.tension_maximum).any()
    assert run.attrs["window_start"] == 0.7


@pytest.mark.parametrize("options", [{}, {"step": STEP}])
@pytest.mark.parametrize("window", [(0.7, 9.0), (0.5, 0.5001)])
def test_windows_that_no_member_can_have_are_refused(soft, options, window):
    scenes, modes = scenes_of(soft, *CASES["tension"]), full_modes()
    options = options | {"outputs": ("tension_extremes",), "times": [2.0], "window": window}
    with pytest.raises(cp.SceneError, match="window: given"):
        cp.condensed.simulate(scenes, modes, **options)


def test_members_with_one_output_instant_are_compared_at_others_too(soft):
    scenes, modes = scenes_of(soft, *CASES["tension"]), full_modes()
    options = STEPS["fitted"] | {"times": [2.0]}
    run = cp.condensed.simulate(scenes, modes, **options)
    assert run.position.sizes["time"] == 1
    assert_equal_to_runs_alone(run, scenes, modes, **options)
    many = cp.condensed.simulate(scenes, modes, **{**options, "times": np.linspace(0.0, 2.0, 65)})
    np.testing.assert_allclose(run.time_error_estimate, many.time_error_estimate, rtol=0.1)


def test_a_given_scheme_of_fourth_order_equals_runs_alone(soft):
    scenes, modes, options = scenes_of(soft, *CASES["tension"]), full_modes(), {"scheme": "numerov"}
    assert_equal_to_runs_alone(cp.condensed.simulate(scenes, modes, **options), scenes, modes, **options)


@pytest.mark.parametrize("steps", STEPS)
def test_the_bits_of_a_member_do_not_depend_on_its_lane(soft, steps):
    varied = {"cable_top_tension": np.linspace(200.0, 300.0, 41), "motion_lower_y_phase": np.linspace(0.0, 6.0, 41)}
    scenes, modes = scenes_of(soft, BOTH, varied), full_modes()
    run = cp.condensed.simulate(scenes, modes, **STEPS[steps])
    other = np.array([0, *range(40, 2, -1)])  # the first member gives the shared coefficients
    part = cp.condensed.simulate(scenes.isel(member=other), modes, **STEPS[steps])
    for name in (*part.data_vars, "error_estimate") if steps == "fitted" else part.data_vars:
        if name != "end_position":
            np.testing.assert_array_equal(part[name], run[name].isel(member=other), err_msg=name)


@pytest.mark.slow
def test_spatial_members_with_loads_across_equal_runs_alone(soft):
    scenes = scenes_of(soft, *CASES["tension"], 3)
    loads = np.column_stack([np.full(4, 3.0), np.full(4, -2.0), [-5.0, 8.0, 4.0, 0.0]])
    scenes, modes = scenes.assign(load_uniform=(("member", "coordinate"), loads)), full_modes(dims=3)
    options = STEPS["given"] | {"links": [1, 3]}
    assert_equal_to_runs_alone(cp.condensed.simulate(scenes, modes, **options), scenes, modes, **options)


# --- failures ---------------------------------------------------------------------------------------------------------

#: Of five members one has no such cable, one a step above the limit, and one stiffens during the run, just too stiff, so that
#: the coordinates stay finite; of three one has no such cable.
FAILING = {
    "given": (
        {"cable_top_tension": [230.0, 1.0, 5e5, 230.0, 300.0], "motion_upper_x_amplitude": [-0.05, -0.05, -0.05, 5.25, -0.02]},
        {1: "cable.top_tension: given 1.0", 2: "step: given", 3: "stiffened"},
    ),
    "fitted": (
        {"cable_top_tension": [230.0, 1.0, 230.0], "motion_upper_x_amplitude": [-0.05, -0.05, -0.02]},
        {1: "cable.top_tension: given 1.0"},
    ),
}  # fmt: skip


def assert_some_fail(scenes, modes, failing, **options):
    """Check that some members fail for the reason of their single run, and that the others equal theirs."""
    count = scenes.sizes["member"]
    with pytest.warns(cp.errors.MemberFailedWarning, match=f"{len(failing)} of {count} members"):
        run = cp.condensed.simulate(scenes, modes, **options)
    for i, why in failing.items():
        assert why in run.failure.values[i]
        assert all(np.isnan(run[name][i]).all() for name in ("amplitude", *options["outputs"]) if name in run)
        if "turns" not in why:  # of which a single run has the instant in its own words
            with pytest.raises((cp.SceneError, cp.RunStopped)) as alone:
                cp.condensed.simulate(scenes.isel(member=i, drop=True), modes, **options)
            assert str(alone.value) == run.failure.values[i]
    others = [i for i in range(count) if i not in failing]
    assert list(run.failure.values[others]) == [""] * len(others)
    assert_equal_to_runs_alone(run.isel(member=others), scenes.isel(member=others), modes, **options)


@pytest.mark.parametrize("steps", STEPS)
def test_failing_members_report_the_reason_of_single_runs(soft, steps):
    varied, failing = FAILING[steps]
    scenes, modes = scenes_of(soft, ONE, varied), full_modes()
    options = STEPS[steps] | {"outputs": ("tension", "tension_extremes"), "links": [1]}
    if steps == "given":
        options["step"] = 0.02
    assert_some_fail(scenes, modes, failing, **options)
    if steps == "given":
        with pytest.raises(cp.SceneError, match=r"step: given 0\.02 s"):
            cp.condensed.simulate(scenes.isel(member=[2, 2]), modes, **options)


@pytest.mark.slow
@pytest.mark.parametrize("steps", STEPS)
def test_chords_that_turn_into_their_first_normal_have_no_positions(soft, steps):
    # the end of the first member circles about the lower one, by a right angle and more
    size = {"motion_upper_x_amplitude": [-7.0, -0.05, 0.02], "motion_upper_y_amplitude": [7.0, 0.05, 0.02]}
    varied = {"ends_upper": [[7.0, 0.0], [7.0, 3.0], [6.0, 4.0]], **size}
    motion = {"upper": {"x": ONE["upper"]["x"], "y": {**ONE["upper"]["x"], "kind": "harmonic"}}}
    scenes, modes = scenes_of(soft, motion, varied, 3), full_modes(dims=3)
    options = STEPS[steps] | {"outputs": ("position",)}
    assert_some_fail(scenes, modes, {0: "turns into the direction"}, **options)


def test_end_positions_take_memory_only_when_read(soft):
    # twice as many numbers as the amplitudes of two modes: most of the memory of a batch without shapes
    scenes, modes, options = scenes_of(soft, *CASES["both ends"]), full_modes(), STEPS["given"]
    run = cp.condensed.simulate(scenes, modes, **options)
    assert not run.variables["end_position"]._in_memory
    again = pickle.loads(pickle.dumps(run))  # as from another process
    truth = np.stack([Numbers(scenes.isel(member=i)).end_positions(options["times"]) for i in range(4)])
    moved = np.ptp(truth, axis=1).max()
    for ends in (again.end_position, run.copy(deep=True).end_position, run.end_position):
        np.testing.assert_allclose(ends.isel(time=3, end=1), truth[:, 3, 1], rtol=0, atol=1e-15 * moved + 1e-14)
        np.testing.assert_allclose(ends, truth, rtol=0, atol=1e-14)
    assert run.variables["end_position"]._in_memory
    run.end_position[0] = 0.0  # as any other variable
    assert not run.end_position[0].any()
    np.testing.assert_array_equal(run.end_position[1:], again.end_position[1:])
