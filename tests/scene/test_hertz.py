"""Frequencies in Hz: the same scene as by angular frequencies, and one clear error for each mistake."""

from __future__ import annotations

import copy
import math
import tomllib

import pytest
import xarray as xr
from scenes import SOFT

import cablepod as cp

TURN = 2.0 * math.pi
SINE = {"kind": "one_minus_cosine", "amplitude": -0.05, "frequency": 0.3}
FORCE = {"arc_length": 0.5, "force": [0.0, -20.0], "kind": "harmonic", "amplitude": 1.0, "frequency": 0.5}
WIND = {"uniform": [2.0, 0.0], "kind": "harmonic", "amplitude": 0.5, "frequency": 0.2, "phase": 0.1}


def in_radians(table):
    """The same table by its angular frequency."""
    return {
        **{key: value for key, value in table.items() if key != "frequency"},
        "angular_frequency": TURN * table["frequency"],
    }


def test_a_scene_by_frequencies_is_that_by_angular_frequencies():
    hertz = {**SOFT, "motion": {"upper": {"x": SINE}}, "load": WIND, "point_load": [FORCE]}
    before = copy.deepcopy(hertz)
    radians = {
        **SOFT, "motion": {"upper": {"x": in_radians(SINE)}}, "load": in_radians(WIND), "point_load": [in_radians(FORCE)]
    }  # fmt: skip
    made, same = cp.make_scene(hertz), cp.make_scene(radians)
    xr.testing.assert_identical(made, same)
    assert made.attrs["id"] == same.attrs["id"]
    assert hertz == before
    assert float(made.motion_upper_x_angular_frequency) == TURN * 0.3
    assert float(made.load_angular_frequency) == TURN * 0.2


def test_a_frequency_may_be_given_by_its_path():
    form = {"motion.upper.x.frequency": 0.3, "load.frequency": 0.2, "point_load.1.frequency": 0.5}
    without = [{key: value for key, value in table.items() if key != "frequency"} for table in (SINE, WIND, FORCE)]
    tables = {**SOFT, "motion": {"upper": {"x": without[0]}}, "load": without[1], "point_load": [without[2]]}
    scene = cp.make_scene({**tables, **form})
    assert float(scene.motion_upper_x_angular_frequency) == TURN * 0.3
    assert float(scene.load_angular_frequency) == TURN * 0.2
    assert float(scene.point_load_1_angular_frequency) == TURN * 0.5


def test_the_load_of_a_mast_has_a_frequency_too(scenes):
    mast = tomllib.loads((scenes / "mast30.toml").read_text())
    gust = {"level": 10.0, "force": [10.0, 0.0, 0.0], "kind": "harmonic", "amplitude": 1.0, "frequency": 0.5}
    mast["mast"]["load"] = [gust]
    assert float(cp.make_scene(mast).mast_load_1_angular_frequency) == TURN * 0.5


@pytest.mark.parametrize(
    ("ensemble", "values"),
    [
        ({"ranges": {"motion.upper.x.frequency": [0.1, 0.4, 4]}}, [0.1, 0.2, 0.3, 0.4]),
        ({"ranges": {"motion": {"upper": {"x": {"frequency": [0.1, 0.4, 4]}}}}}, [0.1, 0.2, 0.3, 0.4]),
        ({"members": 3, "sampling": "list", "ranges": {"motion.upper.x.frequency": [0.1, 0.3, 0.2]}}, [0.1, 0.3, 0.2]),
        ({"members": 3, "sampling": "grid", "ranges": {"motion.upper.x.frequency": [0.1, 0.4]}}, [0.1, 0.25, 0.4]),
    ],
)
def test_ranges_of_an_ensemble_may_be_in_hertz(ensemble, values):
    motion = {"upper": {"x": SINE}}
    scenes = cp.ensemble.design(cp.make_scene({**SOFT, "motion": motion, "ensemble": ensemble}))
    assert scenes.motion_upper_x_angular_frequency.values == pytest.approx([TURN * value for value in values])
    options = {name: ensemble[name] for name in ("members", "sampling") if name in ensemble}
    same = cp.ensemble.design(cp.make_scene({**SOFT, "motion": motion}), ensemble["ranges"], **options)
    assert (
        same.motion_upper_x_angular_frequency.values.tolist() == scenes.motion_upper_x_angular_frequency.values.tolist()
    )


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"frequency": -1.0}, r"^motion\.upper\.x\.frequency: given -1\.0; allowed: a finite number of at least 0$"),
        ({"frequency": "0.3"}, r"^motion\.upper\.x\.frequency: given '0\.3'; allowed: a finite number"),
        ({"frequency": [0.3]}, r"^motion\.upper\.x\.frequency: given \[0\.3\]; allowed"),
        ({"angular_frequency": 1.0}, r"^motion\.upper\.x: given frequency = 0\.3 and angular_frequency = 1\.0; allowed: exactly"),
        ({"kind": "ramp"}, r"^motion\.upper\.x\.frequency: unknown key; allowed: amplitude, duration"),
        ({"frequency": 1e30}, r"^motion\.upper\.x\.angular_frequency: given .* \(angular_frequency is 2 pi times"),
    ],
)  # fmt: skip
def test_a_wrong_frequency_is_refused_by_its_key(changes, text):
    with pytest.raises(cp.SceneError, match=text):
        cp.make_scene({**SOFT, "motion": {"upper": {"x": {**SINE, **changes}}}})


@pytest.mark.parametrize(
    ("ranges", "text"),
    [
        ({"motion.upper.x.frequency": [0.4, "a"]}, r"ensemble\.ranges\.motion\.upper\.x\.frequency\[1\]: given 'a'"),
        ({"motion.upper.x.frequency": 0.4}, r"ensemble\.ranges\.motion\.upper\.x\.frequency: given 0\.4; allowed: a list"),
        ({"motion.upper.x.frequency": [0.4, 0.1]}, r"with low < high \(angular_frequency is 2 pi times the frequency"),
        ({"motion.lower.x.frequency": [0.1, 0.4]}, r"ensemble\.ranges\.motion\.lower\.x\.frequency: unknown key path"),
        (
            {"motion.upper.x.frequency": [0.1, 0.4], "motion.upper.x.angular_frequency": [1.0, 2.0]},
            r"ensemble\.ranges\.motion\.upper\.x\.frequency: given beside motion\.upper\.x\.angular_frequency; allowed: one",
        ),
    ],
)  # fmt: skip
def test_wrong_ranges_in_hertz_are_refused_by_their_key(ranges, text):
    with pytest.raises(cp.SceneError, match=text):
        cp.make_scene({**SOFT, "motion": {"upper": {"x": SINE}}, "ensemble": {"members": 3, "ranges": ranges}})


def test_an_error_of_a_scene_without_frequencies_speaks_of_none():
    motion = {"upper": {"x": {**SINE, "angular_frequency": -1.0}}}
    motion["upper"]["x"].pop("frequency", None)
    with pytest.raises(cp.SceneError, match=r"^motion\.upper\.x\.angular_frequency: given -1\.0; .* of at least 0$"):
        cp.make_scene({**SOFT, "motion": motion})
