"""Memory of a run: what would not fit is refused before it."""

import tracemalloc

import numpy as np
import pytest
from mast_scenes import small, windy
from scenes import SOFT
from wind_scenes import GUY, KAIMAL

import cablepod as cp
from cablepod import SceneError, _resources
from cablepod.examples import scene

IMPLICIT, EXPLICIT = {"scheme": "trapezoidal", "step": 1 / 1024}, {"scheme": "velocity_verlet", "step": 2.0**-14}
CABLES = {
    "explicit": {"elements": 8, **EXPLICIT},
    "implicit": {"elements": 8, **IMPLICIT},
    "many elements": {"elements": 24, **IMPLICIT},
    "estimate": {"elements": 8, "outputs": ("position", "tension", "error_estimate"), **IMPLICIT},
    "nodes": {"elements": 6, "order": 13, "points": "nodes", **IMPLICIT},
}


def refused_above_half_of_the_memory(run, times, monkeypatch, fits):
    """A run is refused where half of the memory is just below its peak, and runs where memory is `fits` times the peak."""
    run(times[:5])  # compiles and fills caches
    tracemalloc.start()
    try:
        run(times)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    monkeypatch.setattr(_resources, "memory", lambda: 1.95 * peak)
    with pytest.raises(SceneError, match=r"(times|links).*: given .*allowed: half of this machine's memory"):
        run(times)
    monkeypatch.setattr(_resources, "memory", lambda: fits * peak)
    run(times)


@pytest.mark.parametrize("between", [False, True])
@pytest.mark.parametrize("case", CABLES)
def test_of_the_cable(case, between, monkeypatch):
    """The peak is of the run itself or of its result, at output times on the steps or between them."""
    soft, options = cp.make_scene(SOFT), CABLES[case]
    times = (np.arange(1500.0) * (2.3 if between else 1.0)) * options["step"]
    refused_above_half_of_the_memory(
        lambda some: cp.cable.simulate(soft, times=some, **options), times, monkeypatch, 4.0
    )


# in the first five instants hardly anything moves, and the modes err by as much
@pytest.mark.filterwarnings("ignore::cablepod.errors.OutOfRangeWarning")
@pytest.mark.parametrize("model", ["explicit chain", "implicit chain", "condensed", "galerkin", "rigid"])
def test_of_other_models(model, monkeypatch):
    soft = cp.make_scene({**SOFT, "chain": {"links": 40}})
    modes, of_fields = (
        cp.condensed.vibration_modes(soft, rank=4, static_modes=True),
        cp.pod.decompose(cp.chain.simulate(soft), rank=2),
    )
    pendulum = scene("pendulum")
    runs = {
        "explicit chain": lambda some: cp.chain.simulate(soft, times=some, **EXPLICIT),
        "implicit chain": lambda some: cp.chain.simulate(soft, times=some, **IMPLICIT),
        "condensed": lambda some: cp.condensed.simulate(soft, modes, times=some, step=1 / 1024),
        "galerkin": lambda some: cp.galerkin.simulate(soft, of_fields, times=some, step=1 / 1024),
        "rigid": lambda some: cp.rigid.simulate(pendulum, links=20, times=some, step=1 / 1024),
    }
    times = np.arange(1500.0) / (2.0**14 if model == "explicit chain" else 1024)
    refused_above_half_of_the_memory(runs[model], times, monkeypatch, 8.0)


@pytest.mark.parametrize("end", [1e9, 2**70])
@pytest.mark.parametrize("call", ["condensed", "mast", "field"])
def test_of_gusts(call, end):
    """The gusts of a run that is far too long are not made, even where it has two output times."""
    guy = cp.make_scene({**GUY, "wind": KAIMAL})
    calls = {
        "condensed": lambda times: cp.condensed.simulate(guy, cp.condensed.vibration_modes(guy, rank=1), times=times),
        "mast": lambda times: cp.mast.simulate(small(windy), times=times),
        "field": lambda times: cp.wind.field(guy, times=times),
    }
    with pytest.raises(
        SceneError, match=r"^times: given instants until .* GB of wind; allowed: half of this machine's"
    ):
        calls[call]([0.0, end])
