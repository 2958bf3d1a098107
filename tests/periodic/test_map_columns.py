"""The map alone: two ways to compute it, threads, columns of different steps, interrupts and progress."""

from __future__ import annotations

import numpy as np
import pytest
from periodic_scenes import guy

import cablepod as cp
from cablepod.periodic._map_general import compute_general_map


@pytest.fixture(scope="module")
def damped():
    """The guy with two modes."""
    scene = guy(damping=0.05)
    return scene, cp.condensed.vibration_modes(scene, rank=2)


def test_without_tension_damping_both_maps_agree(damped, monkeypatch):
    scene, modes = damped
    grid = {"frequency": np.linspace(12.3, 12.7, 5), "amplitude": np.array([0.002, 0.004, 0.006])}
    compiled = cp.periodic.stability_map(scene, modes, **grid)
    monkeypatch.setattr("cablepod.periodic._stability_map.compute_map", compute_general_map)
    general = cp.periodic.stability_map(scene, modes, **grid)
    assert np.array_equal(compiled.kind.values, general.kind.values)
    assert compiled.sizes["edge"] == general.sizes["edge"] > 0
    assert general.edge_angular_frequency.values == pytest.approx(compiled.edge_angular_frequency.values, rel=1e-7)
    for name in ("growth_in_plane", "growth_out_of_plane"):
        # harmonics until the last two hold 1e-6 or 1e-5
        assert general[name].values == pytest.approx(compiled[name].values, abs=1e-5)


def test_a_map_depends_neither_on_threads_nor_on_its_extent(damped, monkeypatch):
    scene, modes = damped
    frequency, amplitude = np.linspace(12.0, 13.0, 9), np.array([0.002, 0.004])
    one = cp.periodic.stability_map(scene, modes, frequency=frequency, amplitude=amplitude)
    monkeypatch.setattr("cablepod.periodic._map.cores", lambda: 1)
    again = cp.periodic.stability_map(scene, modes, frequency=frequency, amplitude=amplitude)
    for name in one.data_vars:
        assert np.array_equal(one[name].values, again[name].values, equal_nan=one[name].dtype.kind == "f"), name


def one_by_one(function, items, workers, done=lambda count: None):
    """Map a function as threads do, but in order."""
    for count, item in enumerate(items, start=1):
        function(item)
        done(count)


def ctrl_c_after(share, told):
    """A callback that is Ctrl-C after some share of the work."""

    def stop(done):
        told.append(done)
        if done > share:
            raise KeyboardInterrupt

    return stop


def is_part_of(partial, whole):
    """Whether a partial map has the points of the whole one, and says of the others that they are missing."""
    left_out = partial.failure.values == "interrupted"
    assert 0 < left_out.sum() < left_out.size
    for name in ("growth_in_plane", "growth_out_of_plane", "response", "smallest_chordwise_force"):
        assert np.array_equal(partial[name].values[~left_out], whole[name].values[~left_out], equal_nan=True), name
        assert np.isnan(partial[name].values[left_out]).all(), name
    assert (partial.kind.values[left_out] == "").all()
    assert np.array_equal(partial.kind.values[~left_out], whole.kind.values[~left_out])
    edges = partial.edge_angular_frequency.values
    assert np.isin(edges[np.isfinite(edges)], whole.edge_angular_frequency.values).all()
    assert partial.attrs["incomplete"] == 1
    return left_out


@pytest.mark.parametrize("tension_damping", [0.0, 2e-4])
def test_what_was_computed_is_kept_after_an_interrupt(damped, tension_damping, monkeypatch, tmp_path):
    scene, modes = damped
    grid = {"frequency": np.linspace(12.3, 12.7, 12), "amplitude": np.array([0.002, 0.004, 0.006])}
    if tension_damping:
        scene = scene.assign(damping_tension_proportional=((), tension_damping, {"units": "s"}))
        grid["frequency"] = grid["frequency"][::3]
    whole = cp.periodic.stability_map(scene, modes, **grid)
    monkeypatch.setattr("cablepod.periodic._map.map_threads", one_by_one)
    monkeypatch.setattr("cablepod.periodic._map.COLUMNS", 1)
    told: list[float] = []
    with pytest.raises(cp.RunStopped, match="interrupted") as caught:
        cp.periodic.stability_map(scene, modes, **grid, progress=ctrl_c_after(0.2, told))
    left_out = is_part_of(caught.value.partial, whole)
    if not tension_damping:  # columns are whole
        assert np.array_equal(left_out.any(axis=0), left_out.all(axis=0))
    cp.archive.write(caught.value.partial, tmp_path / "map.nc")
    again = cp.archive.read(tmp_path / "map.nc")
    labels = [text.get_text() for text in cp.plots.stability_map(again).get_legend().get_texts()]
    assert "not computed" in labels
    with pytest.raises(cp.SceneError, match="result: given failure"):
        cp.plots.stability_map(again.assign(failure=again.failure.isel(amplitude=0)))


def test_progress_of_a_map_never_falls_and_members_share_it(damped, monkeypatch):
    monkeypatch.setattr("cablepod.periodic._map.map_threads", one_by_one)
    scene, modes = damped
    members = cp.ensemble.design(scene, {"cable.top_tension": [9e3, 15e3]}, members=2, sampling="grid")
    # several numbers of harmonics
    grid = {"frequency": np.geomspace(1.0, 40.0, 12), "amplitude": np.array([0.002, 0.02])}
    told: list[float] = []
    whole = cp.periodic.stability_map(members, modes, **grid, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert any(0.0 < share < 0.5 for share in told)
    with pytest.raises(cp.RunStopped, match="interrupted") as caught:
        cp.periodic.stability_map(members, modes, **grid, progress=ctrl_c_after(0.5, []))
    left_out = is_part_of(caught.value.partial, whole)
    assert not left_out[0].any()
    assert left_out[1].any()


def test_an_edge_between_columns_of_different_steps_is_located(damped, monkeypatch):
    scene, modes = damped
    grid = {"frequency": np.linspace(12.3, 12.7, 9), "amplitude": np.array([0.002, 0.004, 0.006])}
    whole = cp.periodic.stability_map(scene, modes, **grid)
    edges = whole.edge_angular_frequency.values
    assert edges.size

    scale = float(modes.angular_frequency[0])
    for last in np.unique(np.searchsorted(grid["frequency"], edges)) - 1:  # before each edge
        border = grid["frequency"][last] * 1.0001

        def different(period, highest, samples, border=border):
            return np.where(2.0 * np.pi / period * scale <= border, 8, 4)

        monkeypatch.setattr("cablepod.periodic._map.strides", different)
        again = cp.periodic.stability_map(scene, modes, **grid)
        assert again.edge_angular_frequency.values == pytest.approx(edges, rel=1e-8)
        assert np.array_equal(again.kind.values, whole.kind.values)
