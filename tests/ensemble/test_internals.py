"""What no small ensemble shows: batches too long for a chunk, doubtful members, warnings of several batches."""

from __future__ import annotations

import csv

import numpy as np
import pytest
import xarray as xr

import cablepod as cp
from cablepod.archive import _open_ensemble as open_module
from cablepod.archive._manifest import peak_of
from cablepod.cli import _map
from cablepod.ensemble._collect_warnings import emit_of_all_members


def test_long_batches_are_cut_along_time(finished, monkeypatch):
    monkeypatch.setattr(open_module, "CHUNK", 4 * 9 * 2 * 8 * 2)
    whole = cp.archive.open_ensemble(finished)
    assert whole["position"].chunks[1] == (2, 2, 2, 2, 1)
    monkeypatch.undo()
    np.testing.assert_array_equal(whole["position"], cp.archive.open_ensemble(finished)["position"])


def test_the_table_of_the_map_tells_what_is_doubtful(tmp_path):
    tension = np.array([[5.0, 7.0], [9.0, 4.0], [np.nan, np.nan]])
    results = xr.Dataset(
        {
            "tension_maximum": (("member", "link"), tension),
            "tension_minimum": (("member", "link"), tension - 4.0),
            "time_error_estimate": ("member", [2e-4, 1e-5, np.nan]),
            "error_estimate": ("member", [0.7, 0.1, np.nan]),
            "failure": ("member", ["", "", "diverged"]),
        },
        coords={"member": [0, 1, 2], "size": ("member", [1.0, 2.0, 3.0], {"units": "m"})},
        attrs={"accepted_time_error": 1e-4},
    )
    _map._write_table(tmp_path / "map.csv", results, ["size"])
    lines = (tmp_path / "map.csv").read_text().splitlines()
    head = "member,size [m],largest tension [N],smallest tension [N],error_estimate [1],time_error_estimate [1],note"
    assert lines[0] == head
    assert lines[1:] == [
        "0,1,7,1,0.7,0.0002,not converged; model error above half the motion",
        "1,2,9,0,0.1,1e-05,slack at times",
        "2,3,nan,nan,nan,nan,failed: diverged",
    ]


def test_the_table_of_the_map_has_frequencies_in_hertz_and_the_error_of_the_peak(tmp_path):
    # of 1000 N, 1 N of which are motion: 30 % of these are little of the peak; of the second they are a part of it
    results = xr.Dataset(
        {
            "tension_maximum": (("member", "link"), [[990.0, 1000.0], [99.0, 100.0]]),
            "tension_minimum": (("member", "link"), [[989.0, 999.0], [20.0, 20.0]]),
            "time_error_estimate": ("member", [0.1, 0.1]),
            "tension_time_error_estimate": ("member", [0.3, 0.3]),
            "failure": ("member", ["", ""]),
        },
        coords={"member": [0, 1], "x_angular_frequency": ("member", [3.0, 6.0], {"units": "rad s-1"})},
        attrs={"accepted_time_error": 1e-4},
    )
    _map._write_table(tmp_path / "map.csv", results, ["x_angular_frequency"])
    with (tmp_path / "map.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["x_frequency [Hz]"]) for row in rows] == pytest.approx([3.0 / (2 * np.pi), 6.0 / (2 * np.pi)])
    of_peak = [float(row["time error of the largest tension [1]"]) for row in rows]
    assert of_peak == pytest.approx([0.3 * 1.0 / 1000.0, 0.3 * 80.0 / 100.0])
    manifest = {"done": {"0": {"largest_tension": {"member": 1, "value": 9e3, "at": {"x": 3.0}}, "not_converged": {}}}}
    (line,) = peak_of({**manifest, "varied": {"x": [1.0, 6.0, "rad s-1"]}})
    assert line == "largest tension  9 kN, in member 1 (x 3 rad s-1 (0.4775 Hz))"
    assert [row["note"] for row in rows] == ["not converged, but the largest tension is", "not converged"]


def test_warnings_of_batches_of_the_condensed_model_become_one_of_all_members():
    force = np.array([5.0, -1.0, 2.0, -8.0, -2.0, 4.0])
    names = {"smallest_chordwise_force": force, "time_of_smallest_force": 0.1 * np.arange(6), "step": np.full(6, 1e-3)}
    results = xr.Dataset({name: ("member", values) for name, values in names.items()}, attrs={"scheme": "numerov"})
    of_batches = [
        (cp.OutOfRangeWarning, "1 of 3 members, of these number 1 the worst: the chordwise force falls"),
        (cp.OutOfRangeWarning, "2 of 3 members, of these number 0 the worst: the chordwise force falls"),
        (cp.OutOfRangeWarning, "another"),
    ]
    with pytest.warns(cp.OutOfRangeWarning, match=r"^3 of 6 members, of these number 3 the worst: .* -8 N") as caught:
        assert emit_of_all_members(of_batches, lambda: results) == of_batches[2:]
    assert len(caught) == 1
