"""Order "exact" where the chord hardly closes: runs end with finite numbers, or stop and say when."""

from __future__ import annotations

import re

import numpy as np
import pytest
import xarray as xr

import cablepod as cp
from cablepod.condensed import _fields as fields

#: A cable whose upper end moves a little.
GUY = {
    "cable": {"youngs_modulus": 1e9, "area": 1.25e-4, "specific_weight": 78500.0, "unstretched_length": 60.0},
    "ends": {"lower": [0.0, 0.0], "upper": [42.3225, 42.5301]},
    "motion": {"upper": {"y": {"kind": "harmonic", "amplitude": 0.1, "angular_frequency": 1.0}}},
    "time": {"duration": 20.0, "interval": 0.1},
    "chain": {"links": 20},
}
OPTIONS = {"order": "exact", "scheme": "trapezoidal", "step": 0.05}


@pytest.fixture(scope="module")
def modes():
    return cp.condensed.vibration_modes(cp.make_scene(GUY), rank=2, static_modes=True)


@pytest.fixture
def opened(monkeypatch):
    """Open all chords of 59.82 m and more: the closure finds no force there."""
    close = fields.close_chord_of

    def open_chords(model, q, boundary_data):
        stretch, force, squared, deflection = close(model, q, boundary_data)
        where = boundary_data[:, 0] > LONGEST
        force[where] = stretch[where] = np.nan
        return stretch, force, squared, deflection

    monkeypatch.setattr(fields, "close_chord_of", open_chords)
    time = np.arange(201) * 0.1
    chord = np.hypot(42.3225, 42.5301 + 0.1 * np.sin(time))
    return float(time[chord > LONGEST][0])


LONGEST = 60.04


def check(stopped, time):
    """Check that a run stopped at a time [s] and kept what was before."""
    assert f"no equilibrium along the chord at {time:g} s" in str(stopped.value)
    partial = stopped.value.partial
    assert partial.attrs["incomplete"] == f"stopped at {time:g} s of 20 s"
    assert float(partial.time[-1]) == pytest.approx(time - 0.1, abs=1e-9)
    assert np.isfinite(partial.position).all()


def test_a_run_stops_at_the_first_instant_whose_chord_does_not_close(modes, opened):
    for outputs in (("position",), ("tension",), ()):  # whatever is asked for
        with pytest.raises(cp.RunStopped) as stopped:
            cp.condensed.simulate(cp.make_scene(GUY), modes, outputs=outputs, **OPTIONS)
        check(stopped, opened)


def test_means_stop_at_the_step_whose_chord_does_not_close(modes, opened):
    with pytest.raises(cp.RunStopped, match="no equilibrium along the chord at") as stopped:
        cp.condensed.simulate(cp.make_scene(GUY), modes, times=[0.0, 6.0], outputs=("tension_mean",), **OPTIONS)
    # at the ends of the run the chord is short
    assert opened - 0.1 < float(re.search(r"at ([0-9.]+) s", str(stopped.value))[1]) <= opened


def test_a_member_whose_chord_does_not_close_says_so_and_stops_no_other(modes, opened):
    still = cp.make_scene(GUY | {"motion": {"upper": {"y": GUY["motion"]["upper"]["y"] | {"amplitude": 1e-3}}}})
    with pytest.warns(cp.errors.MemberFailedWarning):
        result = cp.condensed.simulate(xr.concat([cp.make_scene(GUY), still], "member"), modes, **OPTIONS)
    assert f"no equilibrium along the chord at {opened:g} s" in str(result.failure[0].item())
    assert np.isfinite(result.position[1]).all()


@pytest.mark.filterwarnings("ignore::cablepod.errors.OutOfRangeWarning")
@pytest.mark.parametrize("step", [0.1, 0.25])
@pytest.mark.parametrize("rank", [1, 2])
def test_nothing_is_left_that_is_not_finite_where_links_buckle(rank, step):
    """The upper end comes nearer by 0.7 chords; single instants were not finite, in whole and in stopped runs."""
    motion = {"kind": "one_minus_cosine", "amplitude": -30.0, "angular_frequency": 1.0}
    scene = cp.make_scene(GUY | {"motion": {"upper": {"y": motion}}})
    modes = cp.condensed.vibration_modes(scene, rank=rank, static_modes=True)
    outputs = ("position", "tension", "tension_mean")
    try:
        run = cp.condensed.simulate(scene, modes, outputs=outputs, **(OPTIONS | {"step": step}))
    except cp.RunStopped as stopped:
        run = stopped.partial
    assert all(np.isfinite(variable).all() for variable in run.data_vars.values())
