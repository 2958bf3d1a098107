"""Output times, dense output, step control and its searches, on artificial runs of known error."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from models_of import ALL, options_of, scene_of

import cablepod as cp
from cablepod.cable import _runs as cable_runs
from cablepod.integrate import _comparison as comparison
from cablepod.integrate import _output_times as output_times
from cablepod.integrate import _refinement as refinement
from cablepod.integrate import _scheme as schemes
from cablepod.integrate import _step_control as step_control
from cablepod.rigid import _runs as rigid_runs


@pytest.mark.parametrize("rate", [0.3, 1.0, 1.01, 7.9, 3250.0, 4001.0, 1e6 + 1])
def test_preferred_rates_are_round_and_never_lower(rate):
    chosen = output_times.preferred_steps_per_second(rate)
    assert rate * (1 - 1e-12) <= chosen <= 1.28 * rate
    assert chosen / 10.0 ** np.floor(np.log10(chosen)) == pytest.approx(
        min(output_times._PREFERRED_MANTISSAS, key=lambda p: abs(p - chosen / 10.0 ** np.floor(np.log10(chosen))))
    )


def test_instants_on_steps_need_no_interpolation():
    instants = output_times.OutputTimes.of(np.arange(1251) / 10, 4000.0)
    assert not instants.needs_interpolation
    np.testing.assert_array_equal(instants.steps, 400 * np.arange(1251))


def test_dense_output_is_exact_for_quintics():
    rate = 3.0
    instants = output_times.OutputTimes.of(np.array([0.0, 0.1, 0.7, 1.0, 1.9]), rate)
    p = np.polynomial.Polynomial([1.0, -2.0, 0.5, 3.0, -1.0, 0.2])
    t = instants.steps / rate
    values = instants.at_times(*(f(t)[:, None, None] for f in (p, p.deriv(), p.deriv(2))))
    np.testing.assert_allclose(values[:, 0, 0], p(instants.times), rtol=1e-13)


class ArtificialRuns:
    """Runs whose error is `size` (rate / first rate)^-order, of a motion of size 1."""

    def __init__(self, size, order, rate=100.0):
        self.size, self.order, self.first, self.calls = size, order, rate, []

    def __call__(self, rate):
        self.calls.append(rate)
        return rate, self.size * (rate / self.first) ** -self.order

    def runs(self, end_time=0.0, links=0, **options):
        def position(run):
            return np.reshape(run[1], (1, 1, -1))

        return comparison.ComparableRuns(self, position, lambda run: 1.0, self.first, end_time, links, **options)

    def refine(self, tolerance, **options):
        return step_control.refine_step(self.runs(**options), tolerance)


def runs_without_error(run):
    """Runs that all have the same positions."""
    return comparison.ComparableRuns(run, lambda run: np.zeros((1, 1, 1)), lambda run: 1.0, 100.0)


@pytest.mark.parametrize(
    ("order", "size"),
    [(1.0, 3e-5), *((p, size) for p in (1.0, 1.5, 2.0) for size in (1e-9, 1e-6, 2e-6, 4e-6, 1e-5)), (2.0, 1e-3)],
)
def test_the_step_meets_the_tolerance_whatever_the_order(order, size):
    artificial = ArtificialRuns(size, order)
    (_, error), rate, estimate = artificial.refine(1e-6)
    assert error <= 1e-6
    # never an estimate below the error, but for rounding of the observed order
    assert estimate >= 0.99 * error
    assert rate == artificial.calls[-1]


@pytest.mark.parametrize("size", [9e-7, 1e-6, 1e-5, 1e-4])
def test_first_order_at_most_is_assumed_for_forces_with_kinks(size):
    # second order may be accidental: the error by a kink depends on its place in the step
    artificial = ArtificialRuns(size, 2.0)
    _, rate, estimate = artificial.refine(1e-6, has_kinks=lambda run: True)
    last, before = artificial.calls[-1], artificial.calls[-2]
    distance = size * ((before / 100.0) ** -2 - (last / 100.0) ** -2)
    assert estimate == pytest.approx(distance / (last / before - 1.0), rel=1e-6)
    assert estimate <= 0.5e-6
    assert rate > ArtificialRuns(size, 2.0).refine(1e-6)[1] or size < 1e-6


class UnresolvedRuns(ArtificialRuns):
    """Runs with an error of second order, and one of a vibration that stays until steps resolve its frequency."""

    frequency_rate, amplitude = 4e3, 2e-3

    def __call__(self, rate):
        _, slow = super().__call__(rate)
        vibration = self.amplitude * min(1.0, (self.frequency_rate / rate) ** 2)
        phase = np.log2(rate / self.first)  # which the step decides: the difference of two runs is about the error
        return rate, np.array([slow, vibration * np.cos(phase), vibration * np.sin(phase)])


@pytest.mark.parametrize("resolved", [0.0, UnresolvedRuns.frequency_rate])
def test_first_order_at_most_is_assumed_until_all_frequencies_are_resolved(resolved):
    # as of the trapezoidal rule, whose long steps resolve the motion but not the waves of a jump
    runs = UnresolvedRuns(0.2, 2.0)
    (_, error), rate, estimate = runs.refine(1e-3, resolved=resolved)
    if resolved:
        assert np.linalg.norm(error) <= estimate <= 0.5e-3
    else:
        assert np.linalg.norm(error) > 1.9e-3  # what the assumption cures
    assert (rate > runs.frequency_rate) == (resolved > 0.0)


def test_slow_convergence_ends_soon():
    artificial = ArtificialRuns(1e-2, 0.2)
    with pytest.warns(cp.NotConvergedWarning, match="more than the tolerance 1e-06; the motion is chaotic"):
        artificial.refine(1e-6)
    assert len(artificial.calls) == 4


def test_runs_do_not_grow_without_bound():
    artificial, long = ArtificialRuns(1.0, 1.0), {"end_time": 1e5, "links": 40}
    with pytest.warns(cp.NotConvergedWarning, match="too abrupt for this scheme"):
        artificial.refine(1e-6, **long)
    # the last is rounded up to a preferred rate
    assert max(artificial.calls) <= 1.3 * refinement.MAX_GROWTH * artificial.first
    barely = ArtificialRuns(0.9e-6 * refinement.MAX_GROWTH, 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (_, error), _, _ = barely.refine(1e-6, **long)
    assert error <= 1e-6
    quick = ArtificialRuns(2e-6 * refinement.MAX_GROWTH, 1.0)  # runs that take no time may have more steps
    (_, error), _, _ = quick.refine(1e-6, end_time=1.0, links=5)
    assert error <= 1e-6


@pytest.mark.parametrize(("first", "runs"), [(0.9, 2), (0.3, 3), (1.1, 0)])
def test_runs_that_choose_their_step_have_bounded_work(first, runs):
    # no convergence; the first run has `first` times the most steps times links
    artificial = ArtificialRuns(1.0, 0.9)

    def refine():
        return artificial.refine(1e-6, end_time=first * step_control.MAX_WORK / (artificial.first * 40), links=40)

    if runs == 0:
        with pytest.raises(
            cp.SceneError, match=r"time\.duration: given .* 40 links needs 2\.75e\+10 steps .*; allowed: .* step=0\.01,"
        ):
            refine()
    else:
        with pytest.warns(cp.NotConvergedWarning, match="an error of"):
            refine()
        # a second run there always is, as it tells the error of the first; a last one is rounded up to a preferred rate
        assert max(artificial.calls) <= max(2.0, 1.3 / first) * artificial.first
    assert len(artificial.calls) == runs


def test_trials_of_long_implicit_steps_have_bounded_work():
    artificial = ArtificialRuns(1.0, 0.1)
    runs = artificial.runs(end_time=schemes.MAX_TRIAL_WORK / (1000.0 * 40), links=40)
    assert step_control.complete(schemes.Halving(runs, 1e-6, 1e9)) is None
    assert artificial.calls == [100.0, 200.0, 400.0, 800.0]


@pytest.mark.parametrize("model", ALL)
def test_a_run_with_too_many_steps_is_refused_before_it_begins(soft, model, monkeypatch):
    # a bound that this small scene exceeds, instead of a scene that takes hours where the bound is not held
    scene, options, simulate = scene_of(model, soft), options_of(model, soft), getattr(cp, model).simulate
    monkeypatch.setattr(step_control, "MAX_WORK", 100)
    monkeypatch.setattr(schemes, "MAX_TRIAL_WORK", 1)
    monkeypatch.setattr(cable_runs, "advance_in_blocks", None)  # nothing is run
    monkeypatch.setattr(rigid_runs.RigidRun, "__call__", None)
    with pytest.raises(
        cp.SceneError,
        match=r"time\.duration: given 4 s, which with \d+ links needs .* steps of .*; allowed: 100 .* step=",
    ):
        simulate(scene, **options)
    monkeypatch.undo()
    assert simulate(scene, **options, step=1e-3).attrs["number_of_steps"] == 4000


def test_two_days_of_a_guy_are_begun():
    # 100 links, 2e7 N and 1 kg/m, a metre each, in steps of 0.2 ms
    step_control.check_work(5000.0, 2 * 86400.0, 100)


# --- searches -----------------------------------------------------------------------------------------------------------


def test_a_search_takes_the_runs_that_it_wants_from_anywhere():
    # as of batches, which compute the runs of many searches together
    alone, search, wanted = (
        step_control.complete(step_control.Refinement(ArtificialRuns(1e-3, 2.0).runs(), 1e-6)),
        None,
        [],
    )
    search = step_control.Refinement(ArtificialRuns(1e-3, 2.0).runs(), 1e-6)
    while search.wanted is not None:
        assert search.found is None
        wanted.append(search.wanted)
        search.take((search.wanted, 1e-3 * (100.0 / search.wanted) ** 2))
    assert search.found == alone
    assert wanted[:2] == [100.0, 200.0]
    assert wanted[-1] == alone.steps_per_second


def test_only_a_first_run_may_stop():
    search = step_control.Refinement(ArtificialRuns(1e-3, 2.0).runs(), 1e-6)
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
    (rate, error), same, estimate = step_control.fit_step(
        ArtificialRuns(size, 2.0).runs(), lambda run: told.append(run) or 1e-2
    )
    assert told == [(200.0, size / 4.0)]  # the second run tells the tolerance
    assert rate == same == 200.0
    assert estimate == pytest.approx(1.5 * error, rel=1e-12)


def halved(size, order, tolerance, max_steps_per_second):
    artificial = ArtificialRuns(size, order)
    return step_control.complete(schemes.Halving(artificial.runs(), tolerance, max_steps_per_second)), artificial.calls


def test_halving_stops_where_two_runs_agree_by_a_margin():
    # errors 4e-3, 1e-3, 2.5e-4, 6.2e-5: the distances are three quarters of the former
    accepted, calls = halved(4e-3, 2.0, 1e-3, 1e9)
    assert calls == [100.0, 200.0, 400.0, 800.0]
    (rate, error), same, estimate = accepted
    assert rate == same == 800.0
    assert estimate == pytest.approx(0.75 * 2.5e-4)
    assert error < estimate <= 1e-3 / schemes.HALVING_MARGIN


def test_halving_goes_no_further_than_it_may():
    accepted, calls = halved(4e-3, 2.0, 1e-6, 500.0)
    assert accepted is None
    assert calls == [100.0, 200.0, 400.0]
    assert halved(4e-3, 2.0, 1e-3, 50.0) == (None, [])


def test_halving_passes_over_steps_that_break_down():
    calls = []

    def run(rate):
        calls.append(rate)
        if rate < 300:
            raise cp.RunStopped("too long")
        return 0.0

    accepted = step_control.complete(schemes.Halving(runs_without_error(run), 1e-3, 1e9))
    assert calls == [100.0, 200.0, 400.0, 800.0]
    assert accepted[1] == 800.0


def test_runs_that_do_not_converge_end_soon():
    calls = []

    def run(rate):
        calls.append(rate)
        return 1e-2 * (-1.0) ** len(calls)

    runs = comparison.ComparableRuns(run, lambda run: np.full((1, 1, 1), run), lambda run: 1.0, 100.0)
    with pytest.warns(cp.NotConvergedWarning, match="an error of .* is left at step"):
        step_control.refine_step(runs, 1e-6)
    assert len(calls) == 4


def test_a_first_step_that_breaks_down_is_halved():
    calls = []

    def run(rate):
        calls.append(rate)
        if rate < 300:
            raise cp.RunStopped("too long")
        return rate, 0.0

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _, rate, _ = step_control.refine_step(runs_without_error(run), 1e-6)
    assert calls == [100.0, 200.0, 400.0, 800.0]
    assert rate == 800.0


# --- tensions ---------------------------------------------------------------------------------------------------------


def tension_runs(size, order, **options):
    """Runs whose motion has converged, and whose tension, with a range of 1 N, has an error of `size` h^p, h = 1 at the start."""

    def run(rate):
        return rate

    def tension(rate):
        return np.array([[0.0], [1.0 + size * (100.0 / rate) ** order]])

    noted = {}
    runs = comparison.ComparableRuns(
        run, lambda rate: np.zeros((1, 1, 1)), lambda rate: 1.0, 100.0, 1.0, 10, tension=tension,
        note_tension=noted.__setitem__, **options,
    )  # fmt: skip
    return runs, noted


@pytest.mark.parametrize("size", [1e-5, 1e-3, 1e-2])
def test_tensions_are_refined_as_the_motion_is(size):
    runs, noted = tension_runs(size, 2.0)
    fine, _, estimate = step_control.refine_step(runs, 1e-4)
    assert estimate == 0.0
    error = size * (100.0 / fine) ** 2
    assert error <= 1e-4
    assert noted[fine] <= 1e-4
    assert noted[fine] == pytest.approx(error, rel=2.1 if size < 1e-4 else 0.05)


def test_tensions_that_do_not_converge_are_said_to_be_the_only_ones(monkeypatch):
    monkeypatch.setattr(refinement, "MAX_TENSION_WORK", 1.0)
    runs, noted = tension_runs(0.3, 1.0)
    with pytest.warns(
        cp.NotConvergedWarning, match=r"tension not converged .* of 0 of the motion, .* 0\.0001; .* ramp"
    ):
        fine, rate, _ = step_control.refine_step(runs, 1e-4)
    assert rate <= refinement.MAX_TENSION_GROWTH * 100.0
    assert noted[fine] > 1e-4


def test_an_error_below_the_tolerance_is_accepted_where_no_finer_run_is_possible(monkeypatch):
    monkeypatch.setattr(refinement, "MAX_TENSION_WORK", 1.0)
    rules = refinement.Rules(tension_runs(1.0, 2.0)[0], 100.0, 1e-4, economical=False)
    rate, distance = rules.max_tension_rate, 3.0 * 0.7e-4  # of second order, with an error of 0.7 times the tolerance
    before = refinement.Compared(rate / 2.0, 2.0, 0.0, 4.0 * distance, has_kinks=False)
    history = [refinement.Verdict(before, 2.0, 0.0, 4.0 * distance / 3.0, 0.5e-4)]
    verdict = refinement.judge(rules, before._replace(steps_per_second=rate, tension=distance), history)
    assert verdict.tension_error == pytest.approx(0.7e-4)
    assert verdict.wanted is None
    assert verdict.is_accepted


def test_rounding_errors_of_the_tension_do_not_count():
    runs, _ = tension_runs(0.3, 0.0)
    same = comparison.tension_distance(np.array([[0.0], [1.0]]), np.array([[1e-3], [1.0]]), 1e-3)
    assert same == 0.0
    assert step_control.refine_step(runs, 1e-4)[1] == 200.0


# --- instants of comparison -------------------------------------------------------------------------------------------


def test_instants_of_comparison_lie_in_the_gaps():
    def own(times, steps_per_second=125.0):
        return output_times.judged_instants(np.array(times), steps_per_second)

    assert own(np.linspace(0.0, 4.0, 65)) is None
    assert own([0.0]) is None
    assert own([4.0]).size == 63
    assert own([4.0], 5.0).size == 63  # more than the steps of the first run, whose distances alias
    late = own([2.0, 4.0, *np.linspace(4.1, 8.0, 40)])
    assert late.max() < 4.0
    assert np.abs(late - 2.0).min() > 0.05
