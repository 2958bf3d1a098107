"""Extremes within a window: those of the tensions at the steps in it, for every model and scheme; refusals."""

from __future__ import annotations

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
    return getattr(cp, model).simulate(scenes, *([modes[model]] if model in modes else []), step=STEP[model], **options)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("window", [(0.0, 1.0), (1.0, 2.3), (2.0, 4.0), (0.0, 4.0)])
def test_extremes_are_those_of_the_steps_within(soft, case, window):
    model, options = CASES[case]
    run = simulate(soft, model, outputs=("tension_extremes",), window=window, **options)
    # the tension at all steps, as output at each of them; runs cut at the window differ by the tolerance of Newton's method
    steps = np.arange(round(4.0 / STEP[model]) + 1) * STEP[model]
    tension = simulate(soft, model, outputs=("tension",), times=steps, **options).tension
    within = tension.values[(steps >= window[0] - 1e-9) & (steps <= window[1] + 1e-9)]
    scale = tension.values.max()
    np.testing.assert_allclose(run.tension_maximum, within.max(axis=0), rtol=0, atol=1e-6 * scale)
    np.testing.assert_allclose(run.tension_minimum, within.min(axis=0), rtol=0, atol=1e-6 * scale)
    assert (run.attrs["window_start"], run.attrs["window_end"]) == window


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
def test_peaks_need_extremes(soft, model):
    with pytest.raises(cp.SceneError, match=r"^outputs: given .*; allowed: .tension_extremes. beside .tension_peaks."):
        simulate(soft, model, outputs=("position", "tension_peaks"))


@pytest.mark.parametrize("model", STEP)
def test_a_window_needs_extremes(soft, model):
    with pytest.raises(cp.SceneError, match=r"^window: given .*none without the output .tension_extremes."):
        simulate(soft, model, outputs=("position",), window=(0.0, 1.0))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("window", [None, (1.0, 2.3)])
def test_peaks_have_their_time_and_place(soft, case, window):
    model, options = CASES[case]
    outputs = ("tension_extremes", "tension_peaks")
    run = simulate(soft, model, outputs=outputs, window=window, **options)
    steps = np.arange(round(4.0 / STEP[model]) + 1) * STEP[model]
    first, last = window or (0.0, 4.0)
    times = steps[(steps >= first - 1e-9) & (steps <= last + 1e-9)]
    tension = simulate(soft, model, outputs=("tension",), times=times, **options).tension.values
    middles = run.get("link_arc_length", 0.5 * (run.arc_length.values[1:] + run.arc_length.values[:-1]))
    middles = np.asarray(middles)[[0, 7]] if "links" in options else np.asarray(middles)
    for name, sign in (("minimum", -1.0), ("maximum", 1.0)):
        instant, link = np.unravel_index(int((sign * tension).argmax()), tension.shape)
        time, place = float(run[f"tension_{name}_time"]), float(run[f"tension_{name}_arc_length"])
        # the same instant, unless another is as large to the rounding of the output
        at = tension[np.abs(times - time).argmin(), np.abs(middles - place).argmin()]
        assert at == pytest.approx(tension[instant, link], rel=1e-7)
        assert np.abs(times - time).min() < 1e-9
        assert np.abs(middles - place).min() < 1e-9
        assert run[f"tension_{name}_time"].units == "s"
    # the search leaves no trace
    plain = simulate(soft, model, outputs=("tension_extremes",), window=window, **options)
    np.testing.assert_allclose(run.tension_maximum, plain.tension_maximum, rtol=1e-9)
    assert run.attrs.get("newton_iterations", 0) >= plain.attrs.get("newton_iterations", 0)
