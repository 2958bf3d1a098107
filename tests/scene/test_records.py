"""Records of time series: what is read, and every mistake answered by one clear error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scene_files import LOAD, ROWS, csv, put, refused, write

import cablepod as cp

RECORDS = {
    "missing": (None, r"cannot be read: No such file or directory; allowed: a record, a CSV file"),
    "empty": ("", r"is empty; allowed: a CSV file with a header"),
    "comments only": ("# nothing\n\n", r"is empty; allowed: a CSV file with a header"),
    "header only": ("time,value\n", r"is too short: 0 rows; allowed: .* at least 4 rows of numbers$"),
    "three rows": (csv([(0, 0), (2, 0), (4, 0)]), r"is too short: 3 rows; allowed: .* at least 4 rows of numbers$"),
    "ends early": (csv(ROWS[:-1]), r"the record is too short, from 0 s to 3\.5 s; .*covers the run, from 0 s to 4 s$"),
    "begins late": (csv(ROWS[1:]), r"the record is too short, from 0\.5 s to 4 s; .*covers the run, from 0 s to 4 s$"),
    "unsorted": (csv([*ROWS[:3], ROWS[4], ROWS[3], *ROWS[5:]]), r"is unsorted: time 1\.5 s follows 2 s; allowed: rising"),
    "twice": (csv([*ROWS[:3], *ROWS[2:]]), r"is unsorted: time 1 s follows 1 s; allowed: rising times$"),
    "nearly twice": (csv([*ROWS, (4 + 1e-12, 1)]), r"is unsorted: time 4 s follows 4 s; allowed: rising times$"),
    "blank cell": (csv([*ROWS[:3], (1.5, ""), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5,'; allowed: two finite numbers$"),
    "nan": (csv([*ROWS[:3], (1.5, "nan"), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5,nan'; allowed: two finite numbers$"),
    "infinity": (csv([*ROWS[:3], (1.5, "1e999"), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5,1e999'; allowed: two finite"),
    "huge": (csv([*ROWS[:3], (1.5, "1e300"), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5,1e300'; allowed: two finite"),
    "text": (csv([*ROWS[:3], (1.5, "x"), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5,x'; allowed: two finite numbers$"),
    "short row": (csv([*ROWS[:3], (1.5,), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5'; allowed: two finite numbers$"),
    "long row": (csv([*ROWS[:3], (1.5, 1, 2), *ROWS[4:]]), r"has a gap: row 4 holds '1\.5,1,2'; allowed: two finite"),
    "hole": (
        csv([(0.01 * i, 0) for i in range(401) if not 100 < i < 150]),
        r"has a gap of 0\.5 s after 1 s; allowed: at most ten times the median spacing, 0\.01 s$",
    ),
    "binary": (b"time,value\n\xff\xfe\x00\x01", r"binary or not UTF-8; allowed: a record, a CSV file .* in text form$"),
    "nul": (b"\x00\x01\x02" * 99, r"has the columns '.x00.*; allowed: a CSV file with a header"),
    "three columns": (csv(ROWS, "time,x,y"), r"has the columns 'time, x, y'; allowed: a CSV file with a header"),
    "millimetres": (csv(ROWS, "time,x [mm]"), r"has values in 'mm'; allowed: [m1], or a column without units$"),
    "in round brackets": (csv(ROWS, "time,x (mm)"), r"has values in 'mm'; allowed: [m1], or a column without units$"),
    "milliseconds": (csv(ROWS, "time [ms],x"), r"has times in 'ms'; allowed: s, or a column without units$"),
    "one column": (csv([(0,)] * 5, "time"), r"has the columns 'time'; allowed: a CSV file with a header"),
    "no time": (csv(ROWS, "t,value"), r"has the columns 't, value'; allowed: a CSV file with a header"),
    "two times": (csv(ROWS, "time,time"), r"has the columns 'time, time'; allowed: a CSV file with a header"),
    "no header": (csv(ROWS, "0,0"), r"has the columns '0, 0'; allowed: a CSV file with a header"),
}  # fmt: skip


@pytest.mark.parametrize("name", RECORDS)
@pytest.mark.parametrize("key", ["motion.upper.x", "load", "point_load.1"])
def test_a_bad_record_is_named(soft, scene_folder, name, key):
    content, match = RECORDS[name]
    write(scene_folder / "bad.csv", content)
    factor = {"kind": "file", "path": "bad.csv"}
    changed = {
        "motion.upper.x": ("motion", {"upper": {"x": factor}}),
        "load": ("load", {"uniform": [1.0, 0.0], **factor}),
        "point_load.1": ("point_load", [{**LOAD, **factor}]),
    }
    refused(put(soft, *changed[key]), rf"^{key}\.path: .*{match}")


def test_a_folder_for_a_record(soft, scene_folder):
    (scene_folder / "records").mkdir()
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": "records"}
    refused(soft, r"^motion\.upper\.x\.path: records: is a folder; allowed: a record, a CSV file")


@pytest.mark.parametrize("path", ["", 5, None, ["a"]])
def test_a_path_that_is_none(soft, path):
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": path}
    refused(soft, r"^motion\.upper\.x\.path: given .*; allowed: a text that is not empty$")


@pytest.mark.parametrize("path", ["a\0b", "x" * 5000, "\ud800", "a\nb"], ids=["nul", "long", "surrogate", "newline"])
def test_a_path_that_cannot_be(soft, path):
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": path}
    refused(soft, r"^motion\.upper\.x\.path: .*: cannot be read: .*; allowed: a record")


def test_a_device_is_no_record(soft):
    if not Path("/dev/zero").exists():
        pytest.skip("no /dev/zero here")
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": "/dev/zero"}
    refused(soft, r"^motion\.upper\.x\.path: /dev/zero: is a pipe or a device; allowed: a record")


def test_a_motion_is_counted_from_its_record_at_the_start(soft, scene_folder):
    # alone, the record would bring the ends together at the start
    write(scene_folder / "far.csv", csv([(i, -8.0 + 0.01 * i**3) for i in range(6)]))
    soft["ends"]["upper"] = [8.0, 0.0]
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": "far.csv"}
    scene = cp.make_scene(soft)
    run = cp.chain.simulate(scene, times=[0.0, 2.0], step=1e-3)
    np.testing.assert_allclose(run.position[:, -1, 0], [8.0, 8.08], rtol=1e-14)
    assert run.attrs["motion_upper_x_offset"] == -8.0


def test_a_load_factor_keeps_its_record_at_the_start(soft, scene_folder):
    # the mean of a wind record is in the rest shape; a ramp takes the gusts only
    write(scene_folder / "wind.csv", csv([(i, 2.0 + 0.01 * i**3) for i in range(6)]))
    soft["load"] = {"uniform": [3.0, 0.0], "kind": "file", "path": "wind.csv"}
    steady = {**soft, "load": {"uniform": [6.0, 0.0]}}
    rest = cp.chain.rest(cp.make_scene(steady)).position
    for ramp in ({}, {"ramp": 3.0}):
        soft["load"] |= ramp
        scene = cp.make_scene(soft)
        np.testing.assert_array_equal(cp.chain.rest(scene).position, rest)


def test_an_error_names_the_point_load_as_the_file_numbers_it(soft, scene_folder):
    factor = {"kind": "file", "path": "record.csv"}
    soft["point_load"] = [{**LOAD, "force": [0.0, 0.0]}, {**LOAD, **factor}]
    soft["time"]["duration"] = 5.0
    refused(soft, r"^point_load\.2\.path: the record is too short, from 0 s to 4 s; allowed: one that covers the run")


def test_a_record_may_end_a_rounding_before_the_run(soft, scene_folder):
    write(scene_folder / "good.csv", csv([(0.1 * i if i < 3 else 0.3, 0.1 * i) for i in range(4)]))
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": "good.csv"}
    soft["time"] = {"duration": 3 * 0.1, "interval": 0.1}
    assert soft["time"]["duration"] > 0.3
    assert cp.chain.simulate(cp.make_scene(soft), step=1e-3).sizes["time"] == 4


@pytest.mark.parametrize("order", ["time,value", "value,time", " time , anything ", "time (s),x [m]"])
def test_good_records(soft, scene_folder, order):
    rows = [(v, t) if order.startswith("value") else (t, v) for t, v in ROWS]
    write(scene_folder / "good.csv", "\ufeff# comment\n" + csv(rows, order).replace("\n", "\r\n") + "\n\n")
    soft["motion"]["upper"]["x"] = {"kind": "file", "path": "good.csv"}
    scene = cp.make_scene(soft)
    times, values = np.array(ROWS).T
    position = cp.chain.simulate(scene, times=times, step=1e-3).position
    np.testing.assert_allclose(position[:, -1, 0], 8.0 + values, rtol=0, atol=2e-15)
    with pytest.raises(
        cp.SceneError, match=r"motion\.upper\.x\.path: the record is too short, from 0 s to 4 s; .* 4\.5 s"
    ):
        cp.chain.simulate(scene, times=[4.5], step=1e-3)
