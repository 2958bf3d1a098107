"""Streams of snapshots: merged, pickled, and left as they were by a fault."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import xarray as xr
from spectra import STEEP, sines, trajectory, turning

import cablepod as cp


def test_streams_of_deflections_keep_the_first_chord_s_axis():
    steep = turning(steep=True)[0].isel(time=slice(0, 1500))
    other = turning()[0]
    stream = cp.pod.Stream(layout="normal").update(steep)
    with pytest.raises(cp.SceneError, match="other: its first chord is so steep"):
        cp.pod.Stream(layout="normal").update(other).merge(stream)
    # later pieces, whose own first chord is far from the vertical, do not begin anew
    late = steep.isel(time=slice(1400, None))
    chord = late.position.values[0, -1] - late.position.values[0, 0]
    assert abs(chord[1]) < 0.99 * np.linalg.norm(chord)
    pieces = cp.pod.Stream(layout="normal").update(steep.isel(time=slice(0, 1400))).update(late).modes(rank=6)
    np.testing.assert_allclose(pieces.singular_value, stream.modes(rank=6).singular_value, rtol=1e-9)
    # nor do amplitudes of a part of the run, whether it is cut before or after the projection
    modes, whole = (
        stream.modes(rank=6),
        cp.pod.reconstruct(cp.pod.project(steep, stream.modes(rank=6)), stream.modes(rank=6)),
    )
    cut = cp.pod.project(steep, modes).isel(time=slice(1400, None)), cp.pod.project(late, modes)
    for amplitudes in cut:
        back = cp.pod.reconstruct(amplitudes, modes)
        np.testing.assert_allclose(back.position, whole.position[1400:], atol=1e-9 * np.linalg.norm(chord))
    with pytest.raises(cp.SceneError, match=r"coordinate: given \['x'\]"):
        cp.pod.decompose(other.isel(coordinate=[0]).chunk(), layout="normal")
    ends = other.where((other.time < 0.5) | (other.arc_length < 10.0))
    with pytest.raises(cp.SceneError, match="not finite"):
        cp.pod.decompose(ends.assign_coords(arc_length=other.arc_length).chunk(), layout="normal")


def test_streams_merge_and_travel():
    snapshots, left = trajectory(samples=9000, kind="waves")
    streams = [cp.pod.Stream(layout="vector") for _ in range(3)]
    for i, stream in enumerate(streams):
        stream.update(snapshots.isel(time=slice(3000 * i, 3000 * (i + 1))))
    sent = [pickle.loads(pickle.dumps(stream)) for stream in streams]
    before = sent[1].modes(rank=5)
    merged = cp.pod.Stream(layout="vector").merge(sent[2]).merge(sent[0]).merge(sent[1])
    modes = merged.modes(rank=20)
    np.testing.assert_allclose(modes.singular_value, STEEP, rtol=3e-10)  # 9000 rows average less than a long run
    assert sines(modes, left).max() < 1e-8
    assert modes.attrs["number_of_snapshots"] == 9000
    xr.testing.assert_identical(sent[1].modes(rank=5), before)
    assert len(pickle.dumps(merged)) < 100_000


def test_a_fault_leaves_a_stream_as_it_was():
    snapshots, _ = trajectory(samples=3000)
    stream = cp.pod.Stream().update(snapshots)
    before = stream.modes(rank=4)
    broken = snapshots.where((snapshots.time != 200.0) | (snapshots.particle != 5))
    for bad, match in (
        (broken, "not finite"),
        (broken.chunk({"time": 300}), "not finite"),
        (snapshots.isel(particle=slice(0, 9)), "given 9 particles"),
        (snapshots.isel(coordinate=[0]), r"coordinate: given \['x'\]"),
        (snapshots.drop_vars("position"), "without position"),
    ):
        with pytest.raises(cp.SceneError, match=match):
            stream.update(bad)
        xr.testing.assert_identical(stream.modes(rank=4), before)
    with pytest.raises(cp.SceneError, match="other: given"):
        stream.merge(cp.pod.Stream(center=False))
    with pytest.raises(cp.SceneError, match="given none"):
        cp.pod.Stream().modes()
    with pytest.raises(cp.SceneError, match="layout: given 'joint'"):
        cp.pod.Stream(layout="joint")
    with pytest.raises(cp.SceneError, match="one instant"):
        cp.pod.Stream().update(snapshots.isel(time=[0])).modes()
    with pytest.raises(cp.SceneError, match="rank: given 21; allowed: at most 20"):
        stream.modes(rank=21)
