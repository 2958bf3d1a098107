"""Choice of the step of every model: the first one, tolerances of motion and tension, limits, what a stopped search leaves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from models_of import options_of

import cablepod as cp


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning", "ignore::cablepod.NotConvergedWarning")
@pytest.mark.parametrize("model", ["chain", "cable", "galerkin", "condensed"])
def test_every_run_has_eight_steps_in_the_shortest_time_scale(soft, model):
    # any two runs meet this tolerance; without regard to the motion implicit steps are a twentieth of the run and longer
    options = options_of(model, soft)
    soft["motion"]["upper"]["x"] |= {"angular_frequency": 40.0, "amplitude": 1e-4}
    run = getattr(cp, model).simulate(cp.make_scene(soft), scheme="trapezoidal", tolerance=1e3, **options)
    first = 2.0 * run.attrs["step"]
    assert 0.5 * 2.0 * math.pi / 40.0 / 8.0 < first <= 2.0 * math.pi / 40.0 / 8.0


def test_a_stopped_run_keeps_the_output_times_alone(soft, any_load):
    # it was also compared at other instants
    soft["motion"] = {"upper": {"x": {"kind": "polynomial", "coefficients": [0.0] * 29 + [1e3]}}}
    with pytest.raises(cp.RunStopped, match="left the finite numbers") as stopped:
        cp.chain.simulate(cp.make_scene(soft), scheme="trapezoidal", tolerance=1e-3, times=[0.0, 0.5, 4.0])
    assert stopped.value.partial.time.values.tolist() == [0.0, 0.5]


@pytest.mark.filterwarnings("ignore::cablepod.NotConvergedWarning", "ignore::cablepod.UnusualSceneWarning")
@pytest.mark.parametrize("model", ["chain", "cable"])
def test_every_run_has_twenty_steps_in_a_ramp_of_the_wind(soft, model):
    # which begins in tenths of it; the ends do not move
    soft["cable"] |= {"drag_coefficient": 1.2, "diameter": 0.036}
    scene = cp.make_scene({**soft, "motion": {}, "wind": {"speed": 2.0, "direction": [1.0, 0.0], "ramp": 1.0}})
    run = getattr(cp, model).simulate(scene, scheme="trapezoidal", tolerance=1e3, **options_of(model, soft))
    assert 0.025 < 2.0 * run.attrs["step"] <= 0.05


@pytest.mark.filterwarnings("ignore:.*the model expects an error:cablepod.OutOfRangeWarning")
@pytest.mark.parametrize(
    ("model", "options"),
    [
        ("chain", {"scheme": "velocity_verlet", "tolerance": 1e-3}),
        ("chain", {"scheme": "trapezoidal", "tolerance": 1e-3}),
        ("condensed", {}),
        ("condensed", {"tolerance": 1e-3}),
        ("condensed", {"tolerance": 1e-4, "scheme": "trapezoidal"}),
    ],
)
def test_one_instant_is_as_good_as_many(soft, model, options):
    # at one instant two runs may agree by luck
    scene, simulate = cp.make_scene(soft), getattr(cp, model).simulate
    options = options | options_of(model, soft, rank=3) | {"outputs": ("position",)}
    one = simulate(scene, times=[4.0], **options)
    many = simulate(scene, times=np.linspace(0.0, 4.0, 65), **options)
    assert one.attrs["step"] == many.attrs["step"]
    allowed = 0.4 if model == "chain" else 0.25
    assert one.attrs["time_error_estimate"] == pytest.approx(many.attrs["time_error_estimate"], rel=allowed)
    assert one.time.values.tolist() == [4.0]
    # of the condensed model the matrix products of one instant and of many sum in another order
    rounding = 0.0 if model == "chain" else 1e-14
    np.testing.assert_allclose(one.position[-1], many.position[-1], rtol=rounding, atol=0.1 * rounding)


def test_a_chain_keeps_the_tolerance_in_its_tensions(soft):
    scene = cp.make_scene(soft)
    exact = cp.chain.simulate(scene, step=1e-5)
    run = cp.chain.simulate(scene)
    span = float((exact.tension.max("time") - exact.tension.min("time")).max())
    error = float(np.sqrt(((run.tension - exact.tension) ** 2).mean("link")).max()) / span
    assert error < 1e-4
    assert error < 2.0 * run.attrs["tension_time_error_estimate"]
    # by its motion alone the run would be coarser
    assert cp.chain.simulate(scene, outputs=("position",)).attrs["step"] > run.attrs["step"]


def test_a_month_of_a_stiff_cable_needs_a_given_step(soft):
    # 2e13 links times steps
    soft["cable"] |= {"youngs_modulus": 1e15, "top_tension": 200.0}
    soft["time"] = {"duration": 2.6e6, "interval": 1e5}
    scene = cp.make_scene(soft)
    with pytest.raises(
        cp.SceneError, match=r"time\.duration: given 2\.6e\+06 s, which with 8 links needs .*; allowed: 1e\+12 steps"
    ):
        cp.chain.simulate(scene, scheme="velocity_verlet")
    run = cp.chain.simulate(scene, scheme="velocity_verlet", times=[0.0, 1e-4])  # as the message says
    assert np.isfinite(run.position).all()


def test_steps_are_counted_in_doubles(soft):
    for simulate in (cp.chain.simulate, cp.cable.simulate):
        with pytest.raises(cp.SceneError, match=r"step: given 1e-20; allowed: at least 4e-13 s, for 4 s of time"):
            simulate(cp.make_scene(soft), step=1e-20)


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")  # nothing is like this damping
@pytest.mark.parametrize("model", ["chain", "cable", "galerkin", "condensed"])
def test_damping_that_overflows_is_refused(soft, model):
    options = options_of(model, soft)
    scene = cp.make_scene({**soft, "damping": {"mass_proportional": 1e6}})
    simulate = getattr(cp, model).simulate
    with pytest.raises(
        cp.SceneError, match=r"damping\.mass_proportional: given 1e\+06; allowed: at most 6e\+05 1/s .* 0\.001 s;"
    ):
        simulate(scene, **options, step=1e-3, scheme="velocity_verlet")
    if model in ("chain", "galerkin"):  # as the message says
        assert np.isfinite(simulate(scene, **options, step=1e-3, scheme="trapezoidal").position).all()


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")  # such steps give anything
@pytest.mark.parametrize("model", ["chain", "cable", "galerkin", "condensed"])
def test_a_given_step_that_does_not_resolve_the_motion_is_warned_of(soft, model):
    scene = cp.make_scene(soft)  # moves with 2 rad/s, period 3.14 s
    options = options_of(model, soft)
    simulate = getattr(cp, model).simulate
    simulate(scene, **options, scheme="trapezoidal", step=0.7, times=[0.0, 2.1])
    with pytest.warns(
        cp.NotConvergedWarning,
        match=r"step: given 1 s does not resolve motions and loads, with 3\.1 steps .* 3\.142 s;",
    ):
        simulate(scene, **options, scheme="trapezoidal", step=1.0, times=[0.0, 2.0])
