"""Batched chains: each member equals the run of its scene alone, explicit ones bit for bit."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest
import xarray as xr
from member_scenes import varied_in
from scenes import spatial
from suite import slow

import cablepod as cp
from cablepod import _resources as sigint
from cablepod import errors
from cablepod.batch import _members as members
from cablepod.chain import _batch as chain_many
from cablepod.chain import _explicit as chain_explicit
from cablepod.chain import _kernels_explicit
from cablepod.chain import _lanes as lanes
from cablepod.chain._explicit import ExplicitChainRun, ExplicitStepper
from cablepod.chain._implicit import ImplicitChainRun, ImplicitStepper
from cablepod.chain._scheme import ChainRequest, prepare
from cablepod.integrate._chain_run import ChainRun

STEP = 2e-3
ALL = ("position", "velocity", "tension", "tension_extremes")
HARMONIC = {"kind": "harmonic", "amplitude": 0.05, "angular_frequency": 1.7, "phase": 0.3}
RAMP = {"kind": "ramp", "amplitude": 0.1, "duration": 1.0}
ONE = {"motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 2.0}}}}
BOTH = {"motion": {"lower": {"y": HARMONIC}, "upper": {"x": RAMP, "y": {**HARMONIC, "amplitude": 0.02}}}}
LOADED = {
    "load": {"uniform": [3.0, -2.0], **HARMONIC, "amplitude": 0.5},
    "point_load": [
        {"arc_length": 0.3, "force": [5.0, -10.0]},
        {"arc_length": 0.6, "force": [0.0, -5.0], **HARMONIC, "amplitude": 1.0},
    ],
}
RATIO = ONE | {"damping": {"ratio": 0.03}}
FREE = {"ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0], "free": "upper"}, "motion": {}}
TENSIONS = {"cable_top_tension": [200.0, 300.0, 230.0]}
#: Tables of the scene, varied parameters, options.
CASES = {
    "tension": (ONE, TENSIONS, {"step": STEP}),
    "all outputs": (ONE, TENSIONS, {"step": STEP, "outputs": ALL}),
    "a motion": (
        BOTH, {"motion_lower_y_amplitude": [0.1, 0.0, -0.1], "motion_upper_x_duration": [1.0, 0.5, 2.0]}, {"step": STEP}
    ),
    "starts with a jump": (
        {"motion": {"upper": {"x": HARMONIC}}}, {"motion_upper_x_amplitude": [0.0, 0.05, 0.02]}, {"step": STEP}
    ),
    "ends": (BOTH, {"ends_upper": [[8.0, 6.0], [7.0, 5.0], [9.0, 3.0]]}, {"step": STEP, "outputs": ALL}),
    "loads and damping": (
        BOTH | LOADED | {"damping": {"mass_proportional": 0.4}},
        {
            "point_load_2_force": [[0.0, -5.0], [4.0, 0.0], [0.0, 0.0], [0.0, -5.0]],
            "point_load_2_amplitude": [1.0, 0.5, 1.0, 2.0],
            "damping_mass_proportional": [0.4, 0.0, 2.0, 1.0],
        },
        {"step": STEP, "outputs": ALL},
    ),
    "viscous": (
        ONE | {"damping": {"link_viscosity": 1e-4}},
        {"damping_link_viscosity": [1e-4, 0.0, 2e-4], "motion_upper_x_amplitude": [-0.05, 0.01, 0.02]},
        {"step": STEP, "outputs": ALL},
    ),
    "damped by the tension": (
        ONE | {"damping": {"tension_proportional": 1e-2}},
        {"damping_tension_proportional": [1e-2, 5e-3, 2e-2]},
        {"step": STEP, "outputs": ALL},
    ),
    "free end": (FREE, {"cable_area": [1e-3, 2e-3, 5e-4]}, {"step": STEP}),
    "green": (BOTH, TENSIONS, {"step": STEP, "law": "green", "outputs": ALL}),
    "between steps": (ONE, TENSIONS, {"step": STEP, "times": [0.0, 0.333, 1.7, 3.3], "outputs": ALL}),
    "other links": (ONE, TENSIONS, {"step": STEP, "links": 5}),
}  # fmt: skip
#: Of these members are quick that advance explicitly.
QUICK = ("tension", "all outputs", "damped by the tension", "between steps", "other links")
#: Case, scheme, dimensions, for members in lanes.  Each scheme has each law, and each term that changes its equations.
IN_LANES = [
    ("all outputs", "trapezoidal", 2),
    slow("green", "trapezoidal", 2),
    slow("free end", "trapezoidal", 2),
    slow("loads and damping", "trapezoidal", 3),
    slow("viscous", "generalized_alpha", 2),
    ("damped by the tension", "trapezoidal", 2),
    slow("damped by the tension", "energy_momentum", 3),
    slow("between steps", "generalized_alpha", 2),
    slow("green", "generalized_alpha", 3),
    slow("loads and damping", "energy_momentum", 2),
    slow("viscous", "energy_momentum", 2),
    slow("green", "energy_momentum", 2),
    slow("a motion", "energy_momentum", 3),
]
#: Cases that choose their steps, or are not advanced together, but still make no Dataset of each member.
ALONE = {
    "default": (ONE, TENSIONS, {}),
    "tolerance": (ONE, TENSIONS, {"tolerance": 1e-3, "scheme": "velocity_verlet", "outputs": ALL}),
    "implicit": (ONE, TENSIONS, {"scheme": "trapezoidal", "tolerance": 1e-3, "outputs": ALL[:2]}),  # too few members
    "ratio": (RATIO, {"damping_ratio": [0.03, 0.05, 0.1]}, {"step": 5e-3}),
    "ratio, energy_momentum": (
        RATIO, {"damping_ratio": [0.03, 0.0, 0.1]}, {"step": 5e-3, "scheme": "energy_momentum"}
    ),
}  # fmt: skip


def scenes_of(soft, tables, varied, dims=2):
    """Members of a soft scene with these tables, planar or spatial."""
    mapping = {**soft, **tables}
    if dims == 3:
        mapping = spatial(mapping)
        mapping["ends"]["upper"][2] = 1.0
    return varied_in(cp.make_scene(mapping), varied)


def run_batched(scenes, options):
    """Run four copies of the members, so that a chunk has all of them; return the last copy."""
    count = scenes.sizes["member"]
    with members.thread_limit(1):
        run = cp.chain.simulate(scenes.isel(member=np.tile(np.arange(count), 4)), **options)
    return run.isel(member=slice(3 * count, None))


def run_together(monkeypatch, scenes, options):
    """Run members as :func:`run_batched` does, of which none may be left to a single run."""
    with monkeypatch.context() as patch:
        patch.setattr(lanes, "MIN_MEMBERS", 4)  # the copies of one member, where it alone has a term or such steps
        patch.setattr(ImplicitChainRun, "__call__", None)
        patch.setattr(ExplicitChainRun, "__call__", None)
        return run_batched(scenes, options)


def assert_same_bits(run, scenes, options):
    """Compare each member with the run of its scene alone: all variables and attributes."""
    for i in range(scenes.sizes["member"]):
        alone = cp.chain.simulate(scenes.isel(member=i), **options)
        assert set(alone.variables) <= set(run.variables)
        assert set(alone.coords) <= set(run.coords)
        for name, variable in alone.variables.items():
            own = run.variables[name]
            assert own.attrs == variable.attrs
            row = own.values[i] if own.dims[:1] == ("member",) else own.values
            np.testing.assert_array_equal(row, variable.values, err_msg=str(name))
        for name, value in alone.attrs.items():
            if name in ("id", "history_json"):
                continue
            own = run.attrs[name] if name in run.attrs else run[name].values[i]
            assert own == value, name


@pytest.mark.parametrize(
    ("case", "dims"),
    [(case, 2) if case in QUICK else slow(case, 2) for case in CASES]
    + [slow("a motion", 3), slow("loads and damping", 3)],
)
def test_batched_members_equal_single_runs(soft, monkeypatch, case, dims):
    tables, varied, options = CASES[case]
    scenes = scenes_of(soft, tables, varied, dims)
    run = run_together(monkeypatch, scenes, options)
    assert run.sizes["coordinate"] == dims
    assert_same_bits(run, scenes, options)


def assert_equal_members(run, scenes, options, tolerance=1e-12):
    """Compare members in lanes with runs of their scenes alone: variables over their size, and numbers of iterations."""
    for i in range(scenes.sizes["member"]):
        alone = cp.chain.simulate(scenes.isel(member=i, drop=True), **options)
        step, end = alone.attrs["step"], float(alone.time[-1])
        rounded = 2.0 / step * np.finfo(float).eps * end / step
        for name in ("position", "velocity", "tension", "tension_minimum", "tension_maximum"):
            if name in alone:
                size = float(abs(alone[name]).max())
                # a velocity is 2 / step times a difference of positions, which each step may round by a digit
                rounding = rounded * float(abs(alone.position).max()) if name == "velocity" else 0.0
                atol = tolerance * size + rounding
                np.testing.assert_allclose(run[name][i], alone[name], rtol=0.0, atol=atol, err_msg=name)
        for name in ("newton_iterations", "steps_cut", "energy_excess"):
            own = run[name].values[i] if name in run else run.attrs[name]
            assert own == pytest.approx(alone.attrs[name], rel=1e-9), name


@pytest.mark.parametrize(("case", "scheme", "dims"), IN_LANES)
def test_members_in_lanes_equal_single_runs(soft, monkeypatch, case, scheme, dims):
    tables, varied, options = CASES[case]
    options = options | {"scheme": scheme, "step": 5e-3}
    scenes = scenes_of(soft, tables, varied, dims)
    assert_equal_members(run_together(monkeypatch, scenes, options), scenes, options)


@pytest.mark.slow
def test_steps_that_do_not_converge_are_cut_in_their_lanes_alone(soft, monkeypatch):
    # links of the third member slacken and snap taut
    motion = {"upper": {"y": {**HARMONIC, "angular_frequency": 15.0}}}
    scenes = scenes_of(soft, {"motion": motion}, {"motion_upper_y_amplitude": [0.001, 0.002, 3.0]})
    options = {"scheme": "energy_momentum", "step": 0.05, "outputs": ALL, "times": np.arange(0.0, 1.01, 0.25)}
    run = run_together(monkeypatch, scenes, options)
    assert run.steps_cut.values.tolist() == [0, 0, 1]
    assert_equal_members(run.isel(member=slice(2)), scenes.isel(member=slice(2)), options)
    # snapping links amplify differences of rounding
    assert_equal_members(run.isel(member=[2]), scenes.isel(member=[2]), options, 1e-9)


@pytest.mark.parametrize("scheme", ["trapezoidal", slow("energy_momentum")])
def test_a_lane_that_fails_is_stepped_alone_from_where_it_was(soft, monkeypatch, scheme):
    scenes = scenes_of(soft, ONE, {"cable_top_tension": np.linspace(200.0, 300.0, 9)})
    options = {"scheme": scheme, "step": 5e-3, "outputs": ALL}
    whole = cp.chain.simulate(scenes, **options)
    call, cut = lanes.ImplicitLanes._call, []

    def fail(self, start, time, tables):
        """Take one step, and set the third lane back as if it had failed in it."""
        before = self._states.copy()
        if start != 100:
            return call(self, start, time[: 101 - start] if start < 100 else time, tables)
        done = call(self, start, time[:2], tables)
        self._states[..., 2] = before[..., 2]
        self._failed[2] = True
        cut.append(start)
        return done

    monkeypatch.setattr(lanes.ImplicitLanes, "_call", fail)
    with members.thread_limit(1):
        run = cp.chain.simulate(scenes, **options)
    assert cut == [100]
    assert sorted(run.steps_cut.values) == [0] * 8 + [1]
    changed = abs(run.position - whole.position).max(["time", "particle", "coordinate"]).values
    assert (changed > 0.0).tolist() == (run.steps_cut.values == 1).tolist()
    assert changed.max() < 1e-4  # the error of one step against that of two halves, of second order


def diverging_in_the_fourth(soft, top_tension):
    """Make members of these tensions at rest; the end of the fourth leaves the finite numbers, after the time of the scene."""
    motion = {"upper": {"x": {"kind": "polynomial", "coefficients": [0.0] * 29 + [1e-3]}}}
    tables = {"motion": motion, "time": {"duration": 0.5, "interval": 0.5}}
    scenes = scenes_of(soft, tables, {"cable_top_tension": top_tension})
    coefficients = np.zeros((len(top_tension), 30))
    coefficients[3, -1] = 1e3
    dims = ("member", *scenes["motion_upper_x_coefficients"].dims)
    return scenes.assign(motion_upper_x_coefficients=(dims, coefficients))


@pytest.mark.slow
def test_members_of_lanes_that_fail_report_the_reason_of_single_runs(soft):
    scenes = diverging_in_the_fourth(soft, [230.0, 1.0, 250.0, 230.0, 300.0, 220.0])
    options = {"scheme": "trapezoidal", "step": 0.1, "times": np.arange(0.0, 41.0)}
    with pytest.warns(errors.MemberFailedWarning, match="8 of 24 members failed"):
        run = run_batched(scenes, options)
    for i, kind in {1: cp.SceneError, 3: cp.RunStopped}.items():
        with pytest.raises(kind) as stopped:
            cp.chain.simulate(scenes.isel(member=i), **options)
        assert run.failure.values[i] == str(stopped.value)
        assert np.isnan(run.position[i]).all()
    good = [0, 2, 4, 5]
    assert not run.failure.values[good].any(where=run.failure.values[good] != "")
    assert_equal_members(run.isel(member=good), scenes.isel(member=good), options)


@pytest.mark.parametrize(
    "scheme", ["trapezoidal", slow("generalized_alpha"), slow("energy_momentum"), "velocity_verlet"]
)
def test_members_whose_steps_are_chosen_advance_together(soft, monkeypatch, scheme):
    scenes = scenes_of(soft, ONE, TENSIONS)
    options = {"scheme": scheme, "tolerance": 1e-2, "outputs": ALL}
    run = run_together(monkeypatch, scenes, options)
    for i in range(scenes.sizes["member"]):
        alone = cp.chain.simulate(scenes.isel(member=i, drop=True), **options)
        own = {
            name: run[name].values[i] if name in run else run.attrs[name] for name in ("step", "time_error_estimate")
        }
        assert own == pytest.approx({name: alone.attrs[name] for name in own}, rel=1e-6)
    if scheme == "velocity_verlet":
        assert_same_bits(run, scenes, options)
    else:
        assert_equal_members(run, scenes, options)


@pytest.mark.slow
def test_members_whose_first_step_breaks_down_go_on_alone(soft, monkeypatch):
    scenes = scenes_of(soft, ONE, {"cable_top_tension": np.linspace(230.0, 231.0, 9)})
    options = {"scheme": "trapezoidal", "tolerance": 1e-3, "outputs": ALL[:2]}
    advance, alone, call = lanes.ImplicitLanes.advance, [], ImplicitChainRun.__call__

    def fail(self, start, steps):
        finite = advance(self, start, steps)
        finite[: len(finite) - lanes.MIN_MEMBERS] = False  # the first of nine; the other eight stay together
        return finite

    monkeypatch.setattr(lanes, "MIN_MEMBERS", 8)
    monkeypatch.setattr(lanes.ImplicitLanes, "advance", fail)
    monkeypatch.setattr(ImplicitChainRun, "__call__", lambda self, rate: alone.append(rate) or call(self, rate))
    with members.thread_limit(1):
        run = cp.chain.simulate(scenes, **options)
    monkeypatch.setattr(lanes.ImplicitLanes, "advance", advance)
    assert len(set(alone)) == len(alone) < 6  # each rate of the one member once
    assert_equal_members(run, scenes, options)


@pytest.mark.slow
def test_blocks_of_lanes_change_no_bit_and_few_members_run_alone(soft, monkeypatch):
    scenes = scenes_of(soft, BOTH | LOADED, {"cable_top_tension": np.linspace(200.0, 300.0, 9)})
    options = {"scheme": "trapezoidal", "step": 1e-3, "outputs": ALL}
    alone, lengths = [], []
    single, advance = ImplicitStepper.advance, lanes.ImplicitLanes.advance
    monkeypatch.setattr(ImplicitStepper, "advance", lambda self, i, n: alone.append(n) or single(self, i, n))
    monkeypatch.setattr(lanes.ImplicitLanes, "advance", lambda self, i, n: lengths.append(n) or advance(self, i, n))
    with members.thread_limit(1):
        run = cp.chain.simulate(scenes, **options)
        assert (lengths, alone) == ([4000], [])
        monkeypatch.setattr(chain_many, "BLOCK_WORK", 0.0)
        again = cp.chain.simulate(scenes, **options)
        assert (lengths[1:], alone) == ([1024, 1024, 1024, 928], [])
        cp.chain.simulate(scenes.isel(member=slice(lanes.MIN_MEMBERS - 1)), **options)
        assert alone == [4000] * (lanes.MIN_MEMBERS - 1)
    xr.testing.assert_identical(run, again)


def test_groups_of_lanes_have_similar_speeds(soft):
    amplitude = np.tile([0.0, 0.1], 12)
    batch = chain_many.plan(
        scenes_of(soft, ONE, {"motion_upper_x_amplitude": amplitude}), scheme="trapezoidal", step=0.02
    )
    prepared = [
        prepare(batch.run_member.__self__.members[i], ChainRequest.of(scheme="trapezoidal"), "") for i in range(24)
    ]
    steppers = [one.run.begin(50.0) for one in prepared]
    groups = lanes.groups_of_lanes(steppers)
    assert [len(group) for group in groups] == [12, 12]
    assert [set(amplitude[group]) for group in groups] == [{0.0}, {0.1}]


@pytest.mark.parametrize("case", ALONE)
def test_members_outside_a_batch_equal_single_runs(soft, monkeypatch, case):
    tables, varied, options = ALONE[case]
    scenes = scenes_of(soft, tables, varied)
    made = []
    with monkeypatch.context() as patch:
        plain = ChainRun.dataset
        patch.setattr(ChainRun, "dataset", lambda *args: made.append(0) or plain(*args))
        with members.thread_limit(1):
            run = cp.chain.simulate(scenes, **options)
    assert len(made) == 1
    assert_same_bits(run, scenes, options)


@pytest.mark.parametrize("case", ["all outputs", "starts with a jump", "default"])
def test_the_result_equals_that_of_single_runs(soft, case):
    tables, varied, options = (CASES | ALONE)[case]
    scenes = scenes_of(soft, tables, varied)
    truth = members.over_members(cp.chain.simulate.__wrapped__)(scenes, **options)
    run = cp.chain.simulate(scenes, **options)
    xr.testing.assert_identical(run, truth)  # attributes too, with the id and the history
    assert list(run.variables) == list(truth.variables)  # files hold them in this order
    assert list(run.attrs) == list(truth.attrs)


def test_members_with_other_instants_are_refused(soft):
    varied = {"time_duration": [4.0, 2.0], "time_interval": [0.5, 0.25]}
    with pytest.raises(
        cp.SceneError, match=r"^time\.interval: given 0\.25 to 0\.5 s in 8 members; allowed: one value for all"
    ):
        run_batched(scenes_of(soft, ONE, varied), {"step": STEP})


def test_inactive_members_are_not_advanced(soft):
    batch = chain_many.plan(scenes_of(soft, ONE, TENSIONS), step=STEP)
    ready = [prepare(batch.run_member.__self__.members[i], ChainRequest.of(), "") for i in range(3)]
    stepper = ExplicitStepper([one.run.begin(1.0 / STEP) for one in ready])
    assert stepper.states.ctypes.data % 64 == 0
    assert stepper.states.strides[0] % 64 == stepper.states.strides[1] % 64 == 0
    stepper.is_finite[1] = False
    before = stepper.states.copy()
    assert stepper.advance(0, 10).all()
    moved = (stepper.states != before).any(axis=(1, 2))
    assert moved.tolist() == [True, False, True]
    stepper.states[2] = np.inf
    assert stepper.advance(10, 10).tolist() == [True, True, False]


def test_members_are_grouped_by_shape(soft, monkeypatch):
    ramp, sine = (scenes_of(soft, {"motion": {"upper": {"x": motion}}}, {}) for motion in (RAMP, HARMONIC))
    still = cp.make_scene({name: table for name, table in soft.items() if name != "motion"})
    scenes = xr.concat([ramp, sine, still, ramp, sine], "member", data_vars="all", combine_attrs="override")
    scenes = scenes.assign_coords(member=range(5))  # so that each of them says that what is nan is absent
    sizes = []
    with monkeypatch.context() as patch:
        patch.setattr(
            chain_explicit, "ExplicitStepper", lambda begun: sizes.append(len(begun)) or ExplicitStepper(begun)
        )
        run = run_together(patch, scenes, {"step": STEP})
    # whether a motion is a sine does not matter, whether there is one does
    assert sorted(sizes) == [1] * 4 + [4] * 4
    assert_same_bits(run, scenes, {"step": STEP})


@pytest.mark.parametrize(
    ("name", "value", "longest", "left"),
    # what a member keeps is 3888 bytes here, three are in a chunk
    [
        ("MAX_BLOCK_STEPS", 1024, 1024, 0),
        ("BLOCK_WORK", 0.0, 1024, 0),
        ("MAX_KEPT_BYTES", 3 * 3888, 8001, 0),
        ("MAX_KEPT_BYTES", 3 * 3888 - 1, 8001, 4),
        ("MAX_KEPT_BYTES", 0, 8001, 12),
    ],
)
def test_block_and_chunk_sizes_change_no_bit(soft, monkeypatch, name, value, longest, left):
    scenes = scenes_of(soft, BOTH | LOADED, {"cable_top_tension": np.linspace(200.0, 300.0, 12)})
    with members.thread_limit(1):
        run = cp.chain.simulate(scenes, step=5e-4, outputs=ALL)  # 8000 steps
        lengths, alone = [], []
        monkeypatch.setattr(chain_many, name, value)
        advance, single = ExplicitStepper.advance, ExplicitChainRun.__call__
        monkeypatch.setattr(ExplicitStepper, "advance", lambda self, i, n: lengths.append(n) or advance(self, i, n))
        monkeypatch.setattr(ExplicitChainRun, "__call__", lambda self, rate: alone.append(rate) or single(self, rate))
        compiled = set(_kernels_explicit.verlet.signatures)
        again = cp.chain.simulate(scenes, step=5e-4, outputs=ALL)
    xr.testing.assert_identical(run, again)
    assert set(_kernels_explicit.verlet.signatures) == compiled  # what a block saves is not compiled anew
    assert max(lengths) == longest
    assert len(alone) == left


def test_failing_members_report_the_reason_of_single_runs(soft):
    # no such cable; a limit below the step; a motion that leaves the finite numbers
    scenes = diverging_in_the_fourth(soft, [230.0, 1.0, 5e5, 230.0, 300.0])
    options = {"step": STEP, "outputs": ALL, "times": np.arange(0.0, 41.0)}
    with pytest.warns(errors.MemberFailedWarning, match="12 of 20 members failed"):
        run = run_batched(scenes, options)
    for i, (kind, why) in {
        1: (cp.SceneError, r"cable.top_tension: given 1.0"),
        2: (cp.SceneError, r"step: given 0.002 s; allowed: below"),
        3: (cp.RunStopped, r"the chain left the finite numbers at \d"),
    }.items():
        with pytest.raises(kind, match=why) as stopped:
            cp.chain.simulate(scenes.isel(member=i), **options)
        assert run.failure.values[i] == str(stopped.value)
        assert np.isnan(run.position[i]).all()
    assert list(run.failure.values[[0, 4]]) == ["", ""]
    good = scenes.isel(member=[0, 4])
    assert_same_bits(run.isel(member=[0, 4]), good, options)


def test_invalid_options_fail_as_in_single_runs(soft):
    scenes = scenes_of(soft, ONE, TENSIONS)
    with pytest.raises(cp.SceneError, match="step and tolerance") as refused:
        cp.chain.simulate(scenes, step=STEP, tolerance=1e-3)
    assert isinstance(refused.value.__cause__, errors.AllFailedError)


# --- stopping ---------------------------------------------------------------------------------------------------------------


def test_batches_stop_between_blocks(soft, monkeypatch):
    scenes = scenes_of(soft, ONE, {"cable_top_tension": np.linspace(200.0, 300.0, 9)})
    monkeypatch.setattr(chain_many, "MAX_BLOCK_STEPS", 1024)
    done = []
    advance = ExplicitStepper.advance
    monkeypatch.setattr(ExplicitStepper, "advance", lambda self, i, n: done.append(i) or advance(self, i, n))
    with members.thread_limit(1), members.stop_when(lambda: len(done) == 3), pytest.raises(errors.StoppedError):
        cp.chain.simulate(scenes, step=5e-4)
    assert done == [0, 1024, 2048]  # of eight blocks


def test_ctrl_c_ends_the_blocks_of_other_threads(soft, ctrl_c, monkeypatch):
    scenes = scenes_of(soft, ONE, {"cable_top_tension": np.linspace(200.0, 300.0, 16)})
    monkeypatch.setattr(chain_many, "MAX_BLOCK_STEPS", 1024)
    begun, halted, done = threading.Event(), threading.Event(), []

    def advance(self, start, steps):
        done.append(start)
        begun.set()
        halted.wait(10.0)  # until the main thread has been told
        return self.is_finite

    def press():
        begun.wait(10.0)
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(2.0 * sigint.LOOK_EVERY)
        halted.set()

    monkeypatch.setattr(ExplicitStepper, "advance", advance)
    threading.Thread(target=press).start()
    with members.thread_limit(2), pytest.raises(KeyboardInterrupt):
        cp.chain.simulate(scenes, step=5e-4)
    assert done in ([0], [0, 0])  # the blocks that were under way


def test_the_first_error_is_reported_not_the_cancellation():
    running = threading.Event()

    def ahead(first, last, check):
        if first:
            running.wait(10.0)
            raise TypeError("a fault of the program")
        running.set()
        for _ in range(10_000):
            check()
            time.sleep(1e-3)

    with members.thread_limit(2), pytest.raises(TypeError, match="a fault of the program"):
        members.run_members(lambda i: ({}, {}), 2, None, prepare_chunk=ahead)
