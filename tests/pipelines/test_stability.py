"""The stability report in small: its judging, and what it says of a few cases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from stability import cases, figure, run, verdict

import cablepod as cp
from cablepod.discretisation._chain import chain_of
from cablepod.parameters._from_scene import parameters


@pytest.fixture(scope="module")
def pipeline():
    """The modules of the study and its cases by name."""
    return {"report": run, "judge": verdict, "figure": figure, "cases": {case.name: case for case in cases.cases()}}


SMALL = (
    "K = 1e10 N", "rubber, K = 2e4 N", "2 links", "links 1 : 1000 in turn", "let go at zero tension", "let fall from a wide arc",
    "vertical, slack: it folds", "plucked, none", "tight fold falls", "ends drawn too far apart",
)  # fmt: skip


def shortened(case, duration, interval):
    return replace(case, tables={**case.tables, "time": {"duration": duration, "interval": interval}})


@pytest.fixture(scope="module")
def small(pipeline):
    """The report on ten cases, those that take longest cut short."""
    cases = [pipeline["cases"][name] for name in SMALL]
    cases[0] = shortened(cases[0], 0.5, 0.1)
    patch = pytest.MonkeyPatch()
    # enough for the truth of the cases that have one; the chaotic one is refined in vain
    patch.setattr(pipeline["judge"], "BUDGET", 4e7)
    patch.setattr(pipeline["judge"], "CHECK_BUDGET", 2e6)
    try:
        yield pipeline["report"].report(cases)
    finally:
        patch.undo()


def outcomes(pipeline, result, case):
    return [pipeline["judge"].CLASSES[int(value)] for value in result["outcome"].sel(case=case).values]


@pytest.mark.slow
@pytest.mark.xdist_group("stability")
def test_no_cell_is_broken_and_every_number_is_there(pipeline, small):
    classes = pipeline["judge"].CLASSES
    assert not (small["outcome"] == classes.index("broken")).any()
    ran = small["outcome"].isin([classes.index("accurate"), classes.index("inaccurate")])
    assert np.isfinite(small["error"].values[ran.values]).all()
    assert np.isnan(small["error"].values[~ran.values]).all()
    told = ~ran & (small["outcome"] != classes.index("accurate"))
    assert (small["message"].where(told, "said") != "").all()
    assert (small["kept"].values[ran.values] == 1.0).all()


@pytest.mark.slow
@pytest.mark.xdist_group("stability")
def test_classes_of_the_small_cases(pipeline, small):
    # soft, stiff, uneven and coarse chains are smooth motions, which two hundred steps in a period resolve to a hundredth
    for case in ("K = 1e10 N", "rubber, K = 2e4 N", "2 links", "links 1 : 1000 in turn", "plucked, none"):
        assert outcomes(pipeline, small, case)[:4] == ["accurate"] * 4, case
    # the links snap taut, where 0.9 of the limit of taut links is too long: that is noticed, though all numbers are finite
    assert outcomes(pipeline, small, "let go at zero tension")[0] == "stopped"
    assert outcomes(pipeline, small, "let go at zero tension")[3] == "accurate"
    # a chain that hangs down on itself has no rest to start from
    assert outcomes(pipeline, small, "vertical, slack: it folds") == ["refused"] * 6
    # in the free fall every scheme but the one that keeps the energy gains it in snaps, until it is stopped
    assert outcomes(pipeline, small, "let fall from a wide arc")[:3] == ["stopped"] * 3
    assert outcomes(pipeline, small, "let fall from a wide arc")[3] in ("accurate", "inaccurate")
    # rigid links: taut elastic cables are stretched starts; elastic links are not run on scenes of rigid ones
    for case in ("rubber, K = 2e4 N", "2 links", "plucked, none"):
        assert outcomes(pipeline, small, case)[4:] == ["refused"] * 2, case
    assert outcomes(pipeline, small, "tight fold falls") == ["another model"] * 4 + ["accurate"] * 2
    assert outcomes(pipeline, small, "ends drawn too far apart")[4:] == ["refused"] * 2
    message = str(small["message"].sel(case="ends drawn too far apart", scheme="rattle").values)
    assert "too far apart from 0.36" in message
    assert list(small["case"].values[small["chaotic"].values == 1]) == ["let fall from a wide arc"]


@pytest.mark.slow
@pytest.mark.xdist_group("stability")
def test_truths_are_confirmed_by_the_other_scheme(small):
    # both are of second order, so two ways of resolving the same motion agree far below what counts as accurate
    single = small["statistical"].values == 0
    there = single & np.isfinite(small["truth_check"].values)
    assert there.sum() == 7
    assert small["truth_error"].values[there].max() < 1e-5
    assert small["truth_check"].values[there].max() < 2e-4  # the check has longer steps


@pytest.mark.slow
@pytest.mark.xdist_group("stability")
def test_energy_is_kept_as_each_scheme_promises(small):
    drift = small["energy_drift"].sel(case="plucked, none")
    # 1440 steps, each exact but for the end of Newton's method, 1e-13 of a link, and rounding of like size
    assert drift.sel(scheme="energy_momentum") < 1e-11
    assert drift.sel(scheme="velocity_verlet") > 1e-9  # bounded, but not kept: the measure tells the difference
    # also where links slacken and snap taut, in long steps
    assert small["energy_drift"].sel(case="let fall from a wide arc", scheme="energy_momentum") < 1e-10


@pytest.mark.slow
@pytest.mark.xdist_group("stability")
def test_tolerances_are_met(pipeline, small):
    states = pipeline["judge"].STATES
    rough = ("let go at zero tension", "let fall from a wide arc", SMALL[6], SMALL[9])
    smooth = [name for name in SMALL if name not in rough]
    for case in smooth:
        for wanted in small["wanted_error"].values:
            one = small.sel(case=case, wanted_error=wanted)
            assert states[int(one["tolerance_state"])] == "met", (case, wanted)
            assert float(one["tolerance_error"]) <= wanted


@pytest.mark.slow
@pytest.mark.xdist_group("stability")
def test_the_limit_of_taut_links_is_found_and_that_of_snapping_ones_is_lower(small):
    ratio = small["limit_found"] / small["limit_predicted"]
    # the prediction is that of the straight chain, the highest of any shape: sag raises the limit a little, with two links most
    for case in ("rubber, K = 2e4 N", "2 links"):
        assert 1.0 <= float(ratio.sel(limit_case=case)) < 1.02
    assert float(ratio.sel(limit_case="let fall from a wide arc")) < 0.9


@pytest.mark.slow
@pytest.mark.xdist_group("stability")
def test_the_matrix_is_drawn(pipeline, small):
    from matplotlib import pyplot as plt

    figure = pipeline["figure"].matrix(small)
    texts = [item.get_text() for item in figure.axes[0].texts]
    assert sum(text.startswith("S ") for text in texts) == (small["outcome"] == 3).sum()
    assert "let fall from a wide arc *" in [item.get_text() for item in figure.axes[0].get_yticklabels()]
    plt.close(figure)


# --- the judge can tell ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plucked(pipeline):
    """A short case, its truth, and a sound run."""
    judge, case = pipeline["judge"], shortened(pipeline["cases"]["plucked, none"], 1.0, 0.25)
    scene = case.scene()
    run = judge.simulate(scene, scheme="velocity_verlet", step=1e-4, outputs=judge.OUTPUTS)
    return case, scene, judge.truth_of(case, scene), run


def doctored(run, name, change):
    result = run.copy(deep=True)
    result[name][:] = change(result[name].values)
    return result


def test_a_sound_run_is_accurate(pipeline, plucked):
    case, scene, truth, run = plucked
    verdict = pipeline["judge"].judge(case, scene, truth, lambda: run)
    assert verdict.outcome == "accurate"
    assert verdict.error < 1e-4


@pytest.mark.parametrize(
    ("name", "change", "outcome"),
    [
        ("position", lambda x: np.where(x == x.max(), np.nan, x), "broken"),
        ("tension_maximum", lambda x: np.inf * x, "broken"),
        ("position", lambda x: x[0] + 20.0 * (x - x[0]), "broken"),  # finite garbage: the links hold what nothing explains
        ("velocity", lambda v: 1e3 * v, "broken"),
        ("position", lambda x: x[0] + 1.03 * (x - x[0]), "inaccurate"),  # three hundredths of the motion
    ],
    ids=["nan", "infinite", "garbage", "fast", "wrong"],
)  # fmt: skip
def test_doctored_runs_are_noticed(pipeline, plucked, name, change, outcome):
    case, scene, truth, run = plucked
    assert pipeline["judge"].judge(case, scene, truth, lambda: doctored(run, name, change)).outcome == outcome


def test_what_is_left_of_a_stopped_run_is_looked_at(pipeline, plucked):
    case, scene, truth, run = plucked
    judge = pipeline["judge"]

    def stopped(partial, message="at 0.5 s"):
        def raising():
            raise cp.RunStopped(message, partial)

        return judge.judge(case, scene, truth, raising)

    kept = run.isel(time=slice(3))
    marked = kept.assign_attrs(incomplete="stopped at 0.5 s")
    assert stopped(marked).outcome == "stopped"
    assert stopped(marked).kept == pytest.approx(0.5)
    assert stopped(None).outcome == "broken"
    assert stopped(kept).outcome == "broken"  # not marked as incomplete
    assert stopped(marked, "").outcome == "broken"
    assert stopped(doctored(marked, "position", lambda x: np.nan * x)).outcome == "broken"


def test_a_refusal_needs_a_message_and_a_hang_is_broken(pipeline, plucked, monkeypatch):
    case, scene, truth, _ = plucked
    judge = pipeline["judge"]

    def refusing(message):
        def raising():
            raise cp.SceneError(message)

        return judge.judge(case, scene, truth, raising).outcome

    assert refusing("links: given 1") == "refused"
    assert refusing("") == "broken"
    monkeypatch.setattr(judge, "PATIENCE", 0.0)
    verdict = judge.judge(case, scene, truth, lambda: judge.simulate(scene, scheme="velocity_verlet", step=1e-4))
    assert verdict.outcome == "broken"
    assert "still running" in verdict.message


def test_statistics_accept_one_more_of_the_same_and_reject_another(pipeline, plucked):
    judge = pipeline["judge"]
    _, scene, truth, run = plucked
    chain = chain_of(parameters(scene))
    mean = judge.statistics(chain, run)
    spread = 0.05 * mean * np.array([[-1.5], [-0.5], [-0.2], [0.3], [0.8], [1.1]])
    chaotic = replace(truth, samples=mean + spread)
    assert judge._accuracy(chain, run, chaotic)[1]
    assert not judge._accuracy(chain, run, replace(chaotic, samples=2.0 * mean + spread))[1]


def test_the_work_of_moving_ends_balances_the_energy(pipeline):
    # the difference quotient of the scheme: each step changes the energy by just this work
    case = pipeline["cases"]["end moves, 1e5 s"]
    assert pipeline["report"].balance(case, "energy_momentum", 0.05, 100.0) < 1e-11
    # the mean of both ends' forces leaves what the order of the scheme leaves
    assert 1e-9 < pipeline["report"].balance(case, "velocity_verlet", 0.00125, 10.0) < 1e-4


@pytest.mark.slow
def test_the_energy_is_kept_over_many_hours(pipeline):
    # a fifth of the 1e5 s of the report; rounding of 4e5 steps adds up like a random walk
    case = shortened(pipeline["cases"]["plucked, 1e5 s"], 2e4, 100.0)
    scene = case.scene()
    chain, judge = chain_of(parameters(scene)), pipeline["judge"]
    for scheme, step, most in (("energy_momentum", 0.05, 1e-11), ("velocity_verlet", 0.002, 1e-5)):
        run = judge.simulate(scene, scheme=scheme, step=step, outputs=judge.OUTPUTS)
        assert judge.drift(chain, run["position"].values, run["velocity"].values) < most


def verdicts():
    nan = np.nan
    return xr.Dataset(
        {
            "outcome": (("case", "scheme"), [[0, 1], [2, 3]]),
            "error": (("case", "scheme"), [[1e-3, 0.2], [nan, nan]]),
            "energy_drift": (("case", "scheme"), [[1e-9, nan], [nan, nan]]),
            "kept": (("case", "scheme"), [[1.0, 1.0], [0.0, 0.42]]),
            "group": ("case", ["stiff", "slack"]),
            "chaotic": ("case", [0, 1]),
            "tolerance_state": (("case", "wanted_error"), [[0], [1]]),
            "tolerance_error": (("case", "wanted_error"), [[1e-5], [nan]]),
            "tolerance_scheme": (("case", "wanted_error"), [[1], [-1]]),
        },
        coords={
            "case": ["a guy", "a whip"],
            "scheme": ["velocity_verlet", "trapezoidal"],
            "wanted_error": [1e-4],
        },
        attrs={"classes": "accurate, inaccurate, refused, stopped", "states": "met, missed with a warning"},
    )


def test_the_stability_matrix_has_letters_numbers_and_names():
    ax = figure.stability(verdicts(), Figure().subplots())
    said = [item.get_text() for item in ax.texts]
    assert said == ["stiff", "slack", "A  1e-3  ΔE 1e-9", "I  2e-1", "A  1e-5  T", "R", "S  at 42 %", "W"]
    assert [item.get_text() for item in ax.get_yticklabels()] == ["a guy", "a whip *"]
    assert len(ax.patches) == 6
    assert "A  accurate" in [item.get_text() for item in ax.get_legend().get_texts()]


def test_another_dataset_is_no_stability_matrix():
    ax = Figure().subplots()
    with pytest.raises(cp.SceneError, match="result: given a Dataset without outcome; allowed: what pipelines/stab"):
        figure.stability(verdicts().drop_vars("outcome"), ax)
    assert not ax.texts
