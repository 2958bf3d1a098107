"""Tension of a guy in the wind, and of a mast's guys: statistics over the right part of the run, printed and written."""

from __future__ import annotations

import contextlib
import copy
import io
import json
import re

import numpy as np
import pytest
from mast_scenes import SMALL
from mast_scenes import WIND as MAST_WIND
from scene_files import toml_of
from wind_scenes import GUY, KAIMAL, WIND

import cablepod as cp
from cablepod import cli

ENDS = ["lower", "upper"]


def tables_of(wind, *, duration=6.0, **tables):
    cable = {**GUY["cable"], "breaking_strength": 1.8e5}
    time = {"duration": duration, "interval": 0.25}
    return {**GUY, "cable": cable, "chain": {"links": 8}, "time": time, "wind": wind} | tables


def guy(wind, **options):
    return cp.make_scene(tables_of(wind, **options))


@pytest.fixture(scope="module")
def stormy(tmp_path_factory):
    """The folder of the command on a guy in gusts, and the JSON that it prints."""
    folder = tmp_path_factory.mktemp("stormy")
    (folder / "guy.toml").write_text(toml_of(tables_of(KAIMAL)))
    command = ["run", str(folder / "guy.toml"), "--out", str(folder), "--ranks", "4", "--json"]
    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert cli.main(command) == 0
    return folder, json.loads(said.getvalue())


def test_statistics_are_those_of_a_run_with_more_instants(stormy):
    scene, (folder, said) = guy(KAIMAL), stormy
    ends, chain = (cp.archive.read(folder / f"{name}.nc") for name in ("tension", "chain"))
    assert said["answers"]["tension"]["upper"]["fatigue_range"] == float(ends.fatigue_range.sel(end="upper"))  # in N
    assert ends.end.values.tolist() == ENDS
    times = np.linspace(0.0, 6.0, 24001)
    fine = cp.chain.simulate(
        scene, times=times, step=chain.attrs["step"], scheme=chain.attrs["scheme"], outputs=("tension",)
    )
    series = fine.tension.isel(link=[0, -1])
    np.testing.assert_allclose(ends.end_tension_mean, np.trapezoid(series, times, axis=0) / 6.0, rtol=1e-6)
    # a trapezoidal rule over all steps beside a sum over instants
    np.testing.assert_allclose(ends.end_tension_std, series.std("time"), rtol=1e-3)
    np.testing.assert_allclose(ends.end_tension_maximum, series.max("time"), rtol=1e-6)
    np.testing.assert_allclose(ends.end_tension_minimum, series.min("time"), rtol=1e-6)
    interval = float(ends.time[1] - ends.time[0])
    assert np.abs(ends.end_tension_maximum_time - times[series.values.argmax(axis=0)]).max() <= interval
    # peaks between instants are cut: a twentieth of a period lowers one by 1.2 % of its amplitude at most
    np.testing.assert_allclose(
        ends.fatigue_range, cp.fatigue.equivalent(series, exponent=4.0, frequency=1.0), rtol=0.012
    )
    assert float(ends.utilisation) == float(chain.tension_maximum.max()) / 1.8e5
    assert float(ends.tension_maximum) == float(chain.tension_maximum.max())
    assert (ends.attrs["exponent"], ends.attrs["frequency"]) == (4.0, 1.0)
    assert (ends.attrs["window_start"], ends.attrs["window_end"]) == (0.0, 6.0)
    assert np.abs(ends.tension_maximum_time - ends.end_tension_maximum_time.sel(end="upper")) <= interval


def test_a_steady_wind_moves_nothing():
    study = cp.study.run(guy(WIND, duration=2.0), ranks=[4])
    ends, rest = study["tension"].to_dataset(), cp.chain.rest(guy(WIND, duration=2.0))
    np.testing.assert_allclose(ends.end_tension_mean, rest.tension.isel(link=[0, -1]), rtol=1e-6)
    assert (ends.end_tension_std < 1e-3 * ends.end_tension_mean).all()
    assert (ends.fatigue_range < 1e-3 * ends.end_tension_mean).all()


def test_statistics_begin_where_the_last_ramp_ends():
    scene = guy(
        {**KAIMAL, "ramp": 2.0},
        motion={"upper": {"x": {"kind": "harmonic", "amplitude": 0.01, "angular_frequency": 2.0, "ramp": 3.0}}},
    )
    ends = cp.study.run(scene, ranks=[4])["tension"].to_dataset()
    assert (ends.attrs["window_start"], ends.attrs["window_end"]) == (3.0, 6.0)
    later = ends.end_tension.sel(time=slice(3.0, 6.0))
    np.testing.assert_allclose(ends.end_tension_mean, later.mean("time"), rtol=1e-3)
    np.testing.assert_allclose(ends.fatigue_range, cp.fatigue.equivalent(later), rtol=1e-12)
    assert (ends.end_tension_minimum > 1.001 * ends.end_tension.isel(time=0)).all()  # in still air
    assert float(ends.tension_minimum) < float(ends.end_tension_minimum.min())  # of the whole run


def test_the_command_prints_and_writes_them(stormy, tmp_path, capsys):
    scene = str(stormy[0] / "guy.toml")
    assert cli.main(["run", scene, "--out", str(tmp_path), "--ranks", "4"]) == 0
    said = capsys.readouterr().out
    ends = cp.archive.read(tmp_path / "tension.nc")
    assert ends.attrs["id"] == cp.archive.read(stormy[0] / "tension.nc").attrs["id"]
    for end in ENDS:
        row = re.search(rf"^ +{end} end +(.*)$", said, re.MULTILINE)
        own = ends.sel(end=end)
        forces = [
            own[name] for name in ("end_tension_mean", "end_tension_std", "end_tension_minimum", "end_tension_maximum")
        ]
        wanted = [
            *(1e-3 * float(force) for force in forces),
            float(own.end_tension_maximum_time),
            1e-3 * float(own.fatigue_range),
        ]
        np.testing.assert_allclose(
            [float(number) for number in row[1].split()], wanted, atol=0.0051
        )  # two or three decimals
    assert "statistics over the whole run; fatigue: equivalent range of rainflow cycles, exponent 4, at 1 Hz" in said
    used = re.search(r"utilisation ([\d.]+) %: the largest over the breaking strength of 180 kN", said)
    assert float(used[1]) == pytest.approx(100.0 * float(ends.utilisation), rel=5e-3)
    largest = re.search(r"largest ([\d.]+) kN at ([\d.]+) s, ([\d.]+) m along the cable", said)
    peak = [1e-3 * ends.tension_maximum, ends.tension_maximum_time, ends.tension_maximum_arc_length]
    np.testing.assert_allclose([float(number) for number in largest.groups()], peak, rtol=5e-3)
    assert said.splitlines()[-1].startswith(f"{tmp_path}: tension.png, tension_map.png, deflection.png")


def test_a_mast_leaves_its_ramp_out_too(tmp_path, capsys):
    mapping = copy.deepcopy(SMALL)
    mapping["wind"] = MAST_WIND | {"ramp": 1.0}
    mapping["time"]["duration"] = 4.0
    del mapping["mast"]["load"]
    scene = cp.make_scene(mapping)
    (tmp_path / "mast.toml").write_text(toml_of(mapping))
    assert cli.main(["run", str(tmp_path / "mast.toml"), "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    guys = cp.archive.read(tmp_path / "guys.nc")
    assert (guys.attrs["window_start"], guys.attrs["window_end"]) == (1.0, 4.0)
    run = cp.mast.simulate(scene, window=(1.0, 4.0))
    for name in ("guy_tension_mean", "guy_tension_maximum"):
        np.testing.assert_array_equal(guys[name], run[name])
    np.testing.assert_array_equal(guys.fatigue_range, cp.fatigue.equivalent(run.guy_tension.sel(time=slice(1.0, 4.0))))
    assert "statistics from 1 s, where the last ramp ends, to 4 s" in said
    assert "towards: angle from +x towards +z of the anchor" in said
    rows = [line for line in said.splitlines() if re.match(r" +\d+ +[\d.]+ +[\d.]+ deg", line)]
    for row, anchor in zip(rows, guys.anchor.values, strict=True):
        angle, x, y, z = re.search(r"([\d.]+) deg +\((.*), (.*), (.*)\)", row).groups()
        np.testing.assert_allclose([float(x), float(y), float(z)], anchor, atol=0.006)
        turned = np.deg2rad(float(angle))
        np.testing.assert_allclose(
            [np.cos(turned), np.sin(turned)], anchor[[0, 2]] / np.hypot(*anchor[[0, 2]]), atol=2e-3
        )
