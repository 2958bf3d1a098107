"""Searches of a step: what they want next, economical ones, the first step, what a stopped one leaves."""

from __future__ import annotations

import math

import numpy as np
import pytest

import cablepod as cp
from cablepod.integrate._comparison import ComparableRuns  # runs of known error; their estimates have closed forms
from cablepod.integrate._step_control import Refinement, complete, fit_step


def runs_of_order_two(size):
    """Runs of a motion of 1 m whose error is `size` (100 / steps per second)^2 [m]; a trajectory is (rate, error)."""
    return ComparableRuns(
        lambda rate: (rate, size * (100.0 / rate) ** 2), lambda run: np.full((1, 1, 1), run[1]), lambda run: 1.0, 100.0
    )


def test_a_search_takes_the_runs_that_it_wants_from_anywhere():
    # as of batches, which compute the runs of many searches together
    alone, search, wanted = complete(Refinement(runs_of_order_two(1e-3), 1e-6)), None, []
    search = Refinement(runs_of_order_two(1e-3), 1e-6)
    while search.wanted is not None:
        assert search.found is None
        wanted.append(search.wanted)
        search.take((search.wanted, 1e-3 * (100.0 / search.wanted) ** 2))
    assert search.found == alone
    assert wanted[:2] == [100.0, 200.0]
    assert wanted[-1] == alone.steps_per_second


def test_only_a_first_run_may_stop():
    search = Refinement(runs_of_order_two(1e-3), 1e-6)
    for rate in (100.0, 200.0):
        assert search.wanted == rate
        assert search.go_on_after_stop()
    assert search.wanted == 400.0
    search.take((400.0, 1e-3))
    assert not search.go_on_after_stop()


@pytest.mark.parametrize("size", [1e-3, 1e-2])
def test_an_economical_search_has_a_margin_of_a_half(size):
    # the distance of the first two runs is three times the error of the second one, if the order is two
    told = []
    (rate, error), same, estimate = fit_step(runs_of_order_two(size), lambda run: told.append(run) or 1e-2)
    assert told == [(200.0, size / 4.0)]  # the second run tells the tolerance
    assert rate == same == 200.0
    assert estimate == pytest.approx(1.5 * error, rel=1e-12)


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning", "ignore::cablepod.NotConvergedWarning")
@pytest.mark.parametrize("model", ["chain", "cable", "galerkin", "condensed"])
def test_every_run_has_eight_steps_in_the_shortest_time_scale(soft, model):
    # any two runs meet this tolerance; without regard to the motion implicit steps are a twentieth of the run and longer
    options = {"elements": 2} if model == "cable" else {}
    if model in ("galerkin", "condensed"):
        layout = "normal" if model == "condensed" else "separate"
        options["modes"] = cp.pod.decompose(cp.chain.simulate(cp.make_scene(soft), step=1e-3), layout=layout, rank=2)
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
    options = {"elements": 2} if model == "cable" else {}
    run = getattr(cp, model).simulate(scene, scheme="trapezoidal", tolerance=1e3, **options)
    assert 0.025 < 2.0 * run.attrs["step"] <= 0.05
