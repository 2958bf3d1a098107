"""Extremes and means of tensions, of runs and windows: those of all steps, for every model and scheme; refusals."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scenes import SOFT

import cablepod as cp

STEP = {"galerkin": 0.005, "condensed": 0.005, "chain": 0.0025, "cable": 0.0005, "rigid": 0.0025}
CASES = {
    "chain velocity_verlet": ("chain", {}),
    "chain trapezoidal": ("chain", {"scheme": "trapezoidal"}),
    "chain generalized_alpha": ("chain", {"scheme": "generalized_alpha"}),
    "chain energy_momentum": ("chain", {"scheme": "energy_momentum"}),
    "cable velocity_verlet": ("cable", {"elements": 2, "points": "nodes", "law": "linear"}),
    "cable trapezoidal": ("cable", {"elements": 2, "points": "nodes", "law": "linear", "scheme": "trapezoidal"}),
    "rigid rattle": ("rigid", {}),
    "rigid index1": ("rigid", {"formulation": "index1"}),
    "galerkin velocity_verlet": ("galerkin", {"scheme": "velocity_verlet"}),
    "galerkin trapezoidal": ("galerkin", {"scheme": "trapezoidal"}),
    "condensed leading": ("condensed", {}),
    "condensed numerov": ("condensed", {"scheme": "numerov"}),
    "condensed trapezoidal": ("condensed", {"scheme": "trapezoidal"}),
    "condensed exact": ("condensed", {"order": "exact"}),
    "condensed inertial": ("condensed", {"order": "inertial", "scheme": "trapezoidal"}),
    "condensed links": ("condensed", {"links": [1, 8]}),
}


@pytest.fixture(scope="module")
def soft():
    """Scene whose tension peaks after, before and within windows; modes of both layouts."""
    tables = {**SOFT, "cable": {**SOFT["cable"], "top_tension": 120.0}, "chain": {"links": 8}}
    scene = cp.make_scene(tables)
    run = cp.chain.simulate(scene, tolerance=1e-3)
    return scene, {
        "galerkin": cp.pod.decompose(run, rank=2),
        "condensed": cp.pod.decompose(run, layout="normal", rank=2),
    }


def simulate(soft, model, **options):
    """Run a model with its modes and step."""
    scene, modes = soft
    scenes = options.pop("scenes", scene)
    options = {"step": STEP[model], **options}
    return getattr(cp, model).simulate(scenes, *([modes[model]] if model in modes else []), **options)


@pytest.mark.parametrize("case", CASES)
def test_extremes_and_peaks_are_those_of_the_steps_within(soft, case):
    model, options = CASES[case]
    # the tension at all steps, as output at each of them; runs cut at the window differ by the tolerance of Newton's method
    steps = np.arange(round(4.0 / STEP[model]) + 1) * STEP[model]
    every = simulate(soft, model, outputs=("tension",), times=steps, **options)
    middles = np.asarray(every.link_arc_length)  # of the links that the run kept
    for window in (None, (0.0, 1.0), (1.0, 2.3), (2.0, 4.0)):
        first, last = window or (0.0, 4.0)
        within = (steps >= first - 1e-9) & (steps <= last + 1e-9)
        times, tension = steps[within], every.tension.values[within]
        run = simulate(soft, model, outputs=("tension_extremes", "tension_peaks"), window=window, **options)
        assert run.attrs.get("window_start", 0.0) == first
        assert run.attrs.get("window_end", 4.0) == last
        for name, sign in (("minimum", -1.0), ("maximum", 1.0)):
            extreme = sign * (sign * tension).max(axis=0)
            np.testing.assert_allclose(run[f"tension_{name}"], extreme, rtol=0, atol=1e-6 * tension.max())
            # the same instant, unless another is as large to the rounding of the output
            place = np.abs(middles - float(run[f"tension_{name}_arc_length"]))
            time = np.abs(times - float(run[f"tension_{name}_time"]))
            assert max(place.min(), time.min()) < 1e-9
            peak = tension[time.argmin(), place.argmin()]
            assert peak == pytest.approx(sign * (sign * extreme).max(), rel=1e-7)
            assert run[f"tension_{name}_time"].units == "s"
        # the search for peaks leaves no trace
        plain = simulate(soft, model, outputs=("tension_extremes",), window=window, **options)
        np.testing.assert_allclose(run.tension_maximum, plain.tension_maximum, rtol=1e-9)
        assert run.attrs.get("newton_iterations", 0) >= plain.attrs.get("newton_iterations", 0)


@pytest.mark.parametrize("model", ["chain", "condensed"])
def test_a_window_of_the_whole_run_changes_nothing(soft, model):
    whole = simulate(soft, model, outputs=("position", "tension_extremes"))
    run = simulate(soft, model, outputs=("position", "tension_extremes"), window=(0.0, 4.0))
    for name in ("position", "tension_minimum", "tension_maximum"):
        np.testing.assert_array_equal(run[name], whole[name])
    assert "window_start" not in whole.attrs


@pytest.mark.parametrize("model", ["chain", "condensed", "galerkin"])
def test_members_have_their_windows(soft, model, tmp_path):
    scenes = cp.ensemble.design(soft[0], {"cable.top_tension": [110.0, 130.0]}, members=3)
    options = {"outputs": ("position", "tension_extremes", "tension_peaks"), "window": (1.0, 2.3)}
    runs = simulate(soft, model, scenes=scenes, **options)
    for i in range(3):
        single = simulate(soft, model, scenes=scenes.isel(member=i), **options)
        np.testing.assert_allclose(runs.tension_maximum[i], single.tension_maximum, rtol=1e-9)
        assert float(runs.tension_maximum_time[i]) == float(single.tension_maximum_time)
    modes = {"modes": soft[1][model]} if model in soft[1] else {}
    cp.ensemble.run(scenes, tmp_path / "study", model=model, step=STEP[model], **modes, **options)
    kept = cp.archive.open_ensemble(tmp_path / "study")
    np.testing.assert_allclose(kept.tension_maximum, runs.tension_maximum, rtol=1e-9)
    for name in ("tension_maximum_time", "tension_maximum_arc_length", "tension_minimum_time"):
        np.testing.assert_allclose(kept[name], runs[name], rtol=1e-9)


@pytest.mark.parametrize("model", STEP)
@pytest.mark.parametrize(
    ("window", "allowed"),
    [
        ((1.0, 5.0), "a part of the run, from 0 s to 4 s"),
        ((2.0, 1.0), "two finite instants (start, end) of the run with start < end [s]"),
        ((1.0, 1.0), "two finite instants"),
        ((-1.0, 1.0), "two finite instants"),
        ((0.0, np.nan), "two finite instants"),
        ((0.0, np.inf), "two finite instants"),
        ((0.0, 1.0, 2.0), "two finite instants"),
        (3.0, "two finite instants"),
        ("ab", "two finite instants"),
        ((1.0, 1.0001), "one that is longer than two steps of the run, each of"),
    ],
)
def test_other_windows_are_refused(soft, model, window, allowed):
    with pytest.raises(cp.SceneError, match=r"^window: given .*; allowed: " + re.escape(allowed)):
        simulate(soft, model, outputs=("tension_extremes",), window=window)


@pytest.mark.parametrize("model", STEP)
def test_windows_and_peaks_need_extremes(soft, model):
    with pytest.raises(cp.SceneError, match=r"^outputs: given .*; allowed: .tension_extremes. beside .tension_peaks."):
        simulate(soft, model, outputs=("position", "tension_peaks"))
    with pytest.raises(cp.SceneError, match=r"^window: given .*none without the output .tension_extremes."):
        simulate(soft, model, outputs=("position",), window=(0.0, 1.0))


MEANS = ("tension_mean", "tension_rms")
#: Long taut cable almost without weight, stretched along its chord: T = T0 + K A / L0 (1 - cos wt).  The wave along the cable
#: changes the part with cos wt by the factor theta cot theta = 1 - theta^2 / 3 at most, theta = w L sqrt(mu / K).
AMPLITUDE, OMEGA, CHORD, STIFFNESS, TENSION = 0.05, 2.0, 100.0, 1e7, 1e5
WAVE = (OMEGA * CHORD) ** 2 * 0.8 / STIFFNESS / 3.0


@pytest.fixture(scope="module")
def taut():
    scene = cp.make_scene(
        {
            "gravity": 0.01,
            "cable": {"youngs_modulus": 1e11, "area": 1e-4, "density": 8000.0, "horizontal_force": TENSION},
            "ends": {"lower": [0.0, 0.0], "upper": [CHORD, 0.0]},
            "motion": {
                "upper": {"x": {"kind": "one_minus_cosine", "amplitude": AMPLITUDE, "angular_frequency": OMEGA}}
            },
            "time": {"duration": 10.0, "interval": 2.5},
            "chain": {"links": 12},
        }
    )
    run = cp.chain.simulate(scene, times=np.linspace(0.0, 10.0, 101), tolerance=1e-4)
    return scene, {"galerkin": cp.pod.decompose(run, rank=2), "condensed": cp.condensed.vibration_modes(scene, rank=2)}


def exact(begin, end, length):
    """Mean and root mean square of c - k cos wt."""
    k = STIFFNESS / length * AMPLITUDE
    c = TENSION + k

    def first(t):
        return c * t - k * math.sin(OMEGA * t) / OMEGA

    def second(t):
        return (
            c * first(t) - c * k * math.sin(OMEGA * t) / OMEGA + k * k * (t / 2 + math.sin(2 * OMEGA * t) / 4 / OMEGA)
        )

    width = end - begin
    return (first(end) - first(begin)) / width, math.sqrt((second(end) - second(begin)) / width)


@pytest.mark.filterwarnings("ignore::cablepod.errors.UnusualSceneWarning", "ignore::cablepod.errors.OutOfRangeWarning")
@pytest.mark.parametrize(
    ("model", "options"),
    [
        ("chain", {}),
        ("chain", {"scheme": "energy_momentum", "step": 0.004}),
        ("cable", {"law": "linear", "elements": 3, "tolerance": 1e-4}),
        ("galerkin", {"law": "linear"}),
        ("condensed", {}),
        ("condensed", {"order": "exact"}),
    ],
)
@pytest.mark.parametrize("window", [None, (1.2345, 4.321)])
def test_a_taut_cable_has_the_means_of_a_sinusoidal_tension(taut, model, options, window):
    run = simulate(taut, model, outputs=MEANS, window=window, **{"step": None, **options})
    mean, rms = exact(*(window or (0.0, 10.0)), float(run.unstretched_length))
    deviation = math.sqrt(rms**2 - mean**2)
    # trapezoidal rule: (w h)^2 / 12 of the change
    share = (OMEGA * run.attrs["step"]) ** 2 / 12 + WAVE
    np.testing.assert_allclose(run.tension_mean, mean, atol=1.1 * share * deviation, rtol=0)
    np.testing.assert_allclose(np.sqrt(run.tension_rms**2 - run.tension_mean**2), deviation, rtol=1.1 * share)
    assert run.tension_mean.dims == run.tension_rms.dims == ("link",)
    assert run.tension_rms.attrs["units"] == "N"


def mean_of_series(times, values, begin, end):
    """Mean of the linear interpolant of a series (times, links) over part of it."""
    inside = times[(times > begin) & (times < end)]
    at = np.concatenate([[begin], inside, [end]])
    return np.stack([np.trapezoid(np.interp(at, times, column), at) for column in values.T]) / (end - begin)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("times", [(0.0, 1.7, 4.0), (0.1234, 3.33333)])
def test_means_are_those_of_the_series_at_all_steps(soft, case, times):
    model, options = CASES[case]
    steps = np.arange(math.ceil(times[-1] / STEP[model] - 1e-9) + 1) * STEP[model]
    tension = simulate(soft, model, outputs=("tension",), times=steps, **options).tension.values
    alone = simulate(soft, model, outputs=("position",), times=times, **options)
    for window in (None, (1.0006, 2.3007)):
        run = simulate(soft, model, outputs=("position", *MEANS), window=window, times=times, **options)
        begin, end = window or (0.0, times[-1])
        np.testing.assert_allclose(run.tension_mean, mean_of_series(steps, tension, begin, end), rtol=1e-9)
        rms = np.sqrt(mean_of_series(steps, tension**2, begin, end))
        np.testing.assert_allclose(run.tension_rms, rms, rtol=1e-9)
        # the steps that are saved for them do not change what is output at the asked instants
        np.testing.assert_allclose(run.position, alone.position, rtol=0, atol=1e-12 * 10.0)


@pytest.mark.parametrize("model", STEP)
def test_a_run_of_no_length_has_the_tension_at_its_instant(soft, model):
    run = simulate(soft, model, outputs=("tension", *MEANS), times=[0.0])
    for name in MEANS:
        np.testing.assert_allclose(run[name], run.tension[0], rtol=1e-12)


@pytest.mark.parametrize(
    ("model", "options"),
    [
        ("chain", {}),
        ("chain", {"scheme": "trapezoidal"}),
        ("cable", {"elements": 2}),
        ("rigid", {}),
        ("galerkin", {}),
        ("condensed", {}),
    ],
)
@pytest.mark.parametrize("window", [None, (1.0006, 2.3007)])
def test_members_have_the_means_of_their_single_runs(soft, model, options, window):
    ranges = {"motion.upper.x.amplitude": [-0.05, -0.02]}
    scenes = cp.ensemble.design(soft[0], ranges, members=3)
    runs = simulate(soft, model, scenes=scenes, outputs=MEANS, window=window, **options)
    assert runs.tension_mean.dims == ("member", "link")
    for i in range(3):
        single = simulate(soft, model, scenes=scenes.isel(member=i), outputs=MEANS, window=window, **options)
        for name in MEANS:
            np.testing.assert_allclose(runs[name][i], single[name], rtol=1e-10)


def test_an_ensemble_keeps_means(soft, tmp_path):
    scenes = cp.ensemble.design(soft[0], {"cable.top_tension": [110.0, 130.0]}, members=3)
    cp.ensemble.run(scenes, tmp_path / "study", model="chain", step=0.0025, outputs=MEANS)
    kept = cp.archive.open_ensemble(tmp_path / "study")
    runs = cp.chain.simulate(scenes, step=0.0025, outputs=MEANS)
    for name in MEANS:
        np.testing.assert_allclose(kept[name], runs[name], rtol=1e-12)


def test_a_selection_of_links_has_their_means(soft):
    whole, part = (simulate(soft, "condensed", outputs=MEANS, **options) for options in ({}, {"links": [1, 8]}))
    for name in MEANS:
        np.testing.assert_allclose(part[name], whole[name][[0, 7]], rtol=1e-12)


def test_only_what_is_asked_for_is_there(soft):
    for model in STEP:
        run = simulate(soft, model, outputs=("tension_rms",), times=[0.0, 0.5])
        assert "tension_rms" in run
        assert not {"tension_mean", "tension_maximum", "tension"} & set(run.variables)


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
def test_what_a_stopped_run_keeps_has_no_means(scheme):
    scene = cp.make_scene(
        {
            **SOFT,
            "motion": {"upper": {"x": {"kind": "polynomial", "coefficients": [0.0] * 29 + [1e-3]}}},
            "time": {"duration": 1.0, "interval": 1.0},
        }
    )
    times = np.arange(0, 4000.0)
    with pytest.raises(cp.RunStopped) as stopped:
        cp.chain.simulate(scene, times=times, step=1e-3, scheme=scheme, outputs=("position", *MEANS))
    partial = stopped.value.partial
    assert not {*MEANS} & set(partial.variables)
    again = cp.chain.simulate(scene, times=partial.time.values, step=1e-3, scheme=scheme)
    np.testing.assert_allclose(partial.position, again.position, rtol=1e-12)


@pytest.mark.parametrize("model", STEP)
@pytest.mark.parametrize(
    ("varied", "said"),
    [
        (
            {"time_interval": [0.5, 1.0], "time_duration": [4.0, 8.0]},
            r"^time\.interval: given 0\.5 to 1 s in 2 members",
        ),
        ({"time_duration": [4.0, 8.0]}, r"^time\.duration: given 4 to 8 s in 2 members"),
    ],
)
def test_members_with_other_instants_are_refused(soft, model, varied, said):
    # one coordinate time labels all members, though their arrays may have one shape
    scenes = soft[0].assign({name: ("member", values) for name, values in varied.items()})
    with pytest.raises(cp.SceneError, match=said + "; allowed: one value for all members, or the option times"):
        simulate(soft, model, scenes=scenes)
    run = simulate(soft, model, scenes=scenes, times=[0.0, 0.5], outputs=("position",))
    assert run.time.values.tolist() == [0.0, 0.5]
    same = soft[0].assign(time_duration=("member", [4.0, 4.2]))  # 0.5 s apart up to 4 s in both
    assert simulate(soft, model, scenes=same, outputs=("position",)).sizes["time"] == 9
