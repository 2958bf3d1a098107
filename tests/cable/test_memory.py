"""Memory of a run: what would not fit is refused before it."""

import tracemalloc

import numpy as np
import pytest

from cablepod import SceneError, _resources, cable, make_scene

IMPLICIT, EXPLICIT = {"scheme": "trapezoidal", "step": 1 / 1024}, {"scheme": "velocity_verlet", "step": 2.0**-14}


@pytest.mark.parametrize("between", [False, True])
@pytest.mark.parametrize(
    "options",
    [
        {"elements": 8, **EXPLICIT},
        {"elements": 8, **IMPLICIT},
        {"elements": 24, **IMPLICIT},
        {"elements": 8, "outputs": ("position", "tension", "error_estimate"), **IMPLICIT},
        {"elements": 6, "order": 13, "points": "nodes", **IMPLICIT},
    ],
)
def test_a_run_whose_peak_is_above_half_of_the_memory_is_refused(options, between, soft, monkeypatch):
    """The peak is of the run itself or of its result, at output times on the steps or between them."""
    times = (np.arange(1500.0) * (2.3 if between else 1.0)) * options["step"]
    scene = make_scene(soft)
    cable.simulate(scene, times=times[:5], **options)  # compiles and fills caches
    tracemalloc.start()
    try:
        cable.simulate(scene, times=times, **options)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    monkeypatch.setattr(_resources, "memory", lambda: 1.95 * peak)
    with pytest.raises(SceneError, match=r"times.*allowed: half of this machine's memory"):
        cable.simulate(scene, times=times, **options)
    monkeypatch.setattr(_resources, "memory", lambda: 4.0 * peak)
    cable.simulate(scene, times=times, **options)
