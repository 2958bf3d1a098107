"""Stability over frequency and amplitude: Mathieu's tongues, orbits at single points, the answer in all threads."""

from __future__ import annotations

import numpy as np
import pytest
from periodic_scenes import guy, loaded, mathieu
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

import cablepod as cp
from cablepod.periodic._map_general import compute_general_map

STIFFER = 1e3


@pytest.mark.filterwarnings("ignore:damping is zero")
@pytest.mark.parametrize("tongue", [1, 2])
def test_tongues_have_the_edges_of_mathieu(tongue):
    scene = mathieu(0.1, stiffer=STIFFER)
    modes = cp.condensed.vibration_modes(scene, rank=1)
    omega = float(modes.angular_frequency[0])
    epsilon = np.array([0.05, 0.2, 0.4])
    amplitude = epsilon / 0.1 * float(scene.motion_upper_x_amplitude)
    centre = 2.0 * omega / tongue
    frequency = centre * np.linspace(0.85, 1.1, 60 if tongue == 1 else 400)
    found = cp.periodic.stability_map(scene, modes, frequency=frequency, amplitude=amplitude, out_of_plane=False)
    for k, eps in enumerate(epsilon):
        edges = found.edge_angular_frequency.values[np.isclose(found.edge_amplitude.values, amplitude[k])]
        exact = sorted(
            brentq(lambda x, f=f, e=eps: f(tongue, 0.5 * e * (2.0 * omega / x) ** 2) - (2.0 * omega / x) ** 2,
                   0.8 * centre, 1.2 * centre, xtol=1e-13)
            for f in (mathieu_a, mathieu_b)
        )  # fmt: skip
        if exact[1] - exact[0] < 2.0 * (frequency[1] - frequency[0]):
            continue  # between two frequencies of the map
        # inertia along the string is 1e-6 of epsilon
        assert edges == pytest.approx(exact, rel=1e-6)
    kinds = {1: "period_doubling", 2: "fold"}
    assert set(found.edge_kind.values) == {kinds[tongue]}


def test_a_map_has_the_growth_of_single_orbits():
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    frequency, amplitude = np.array([5.0, 6.25, 12.3, 12.47]), np.array([0.001, 0.004, 0.006])
    found = cp.periodic.stability_map(scene, modes, frequency=frequency, amplitude=amplitude)
    for i, omega in enumerate(frequency):
        for j, a in enumerate(amplitude):
            orbit = cp.periodic.orbit(guy(damping=0.05, angular_frequency=omega, amplitude=a), modes, outputs=())
            point = found.isel(amplitude=j, angular_frequency=i)
            largest = max(float(point.growth_in_plane), float(point.growth_out_of_plane))
            # the map takes harmonics until the last two hold 1e-5
            assert largest == pytest.approx(float(orbit.growth), abs=1e-5)
            assert (point.kind == "stable") == bool(orbit.stable)
            assert float(point.response) == pytest.approx(float(orbit.deflection_maximum), rel=1e-3)


def test_a_map_with_damping_by_the_tension_has_the_growth_of_single_orbits():
    frequency, amplitude = np.array([12.3, 12.44, 12.8]), np.array([0.002, 0.004, 0.006])
    scene = guy(damping=0.03).assign(damping_tension_proportional=((), 2e-4, {"units": "s"}))
    modes = cp.condensed.vibration_modes(scene, rank=2)
    progress: list[float] = []
    found = cp.periodic.stability_map(
        scene, modes, frequency=frequency, amplitude=amplitude, progress=progress.append
    )  # fmt: skip
    for i, omega in enumerate(frequency):
        for j, a in enumerate(amplitude):
            here = scene.assign(
                motion_upper_x_angular_frequency=scene.motion_upper_x_angular_frequency * 0.0 + omega,
                motion_upper_x_amplitude=scene.motion_upper_x_amplitude * 0.0 + a,
            )
            orbit = cp.periodic.orbit(here, modes, outputs=())
            point = found.isel(amplitude=j, angular_frequency=i)
            largest = max(float(point.growth_in_plane), float(point.growth_out_of_plane))
            # harmonics are taken until the last two hold 1e-6, in both
            assert largest == pytest.approx(float(orbit.growth), abs=1e-6)
            assert float(point.response) == pytest.approx(float(orbit.deflection_maximum), rel=1e-3)
    assert {"stable", "period_doubling"} <= set(found.kind.values.ravel())
    assert progress == sorted(progress)
    # at an edge a multiplier is on the circle
    for omega, a in zip(found.edge_angular_frequency.values[:2], found.edge_amplitude.values[:2], strict=True):
        edge = cp.periodic.stability_map(
            scene, modes, frequency=[omega], amplitude=np.append(amplitude[amplitude < a], a)
        )
        at = edge.isel(amplitude=-1, angular_frequency=0)
        assert min(abs(float(at.growth_in_plane)), abs(float(at.growth_out_of_plane))) < 1e-7


def test_without_tension_damping_both_maps_agree(monkeypatch):
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2)
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


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("cable.top_tension", [9e3, 15e3]),
        ("ends.upper.x", [20.4, 30.0]),
        ("damping.mass_proportional", [0.03, 3e3]),  # nothing is left of a disturbance by the second one
    ],
)
def test_members_have_the_maps_of_single_scenes(key, values, tmp_path):
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    members = cp.ensemble.design(scene, {key: values}, members=2, sampling="grid")
    grid = {"frequency": np.linspace(12.2, 12.8, 5), "amplitude": np.array([0.002, 0.005])}
    found = cp.periodic.stability_map(members, modes, **grid)
    for k in range(2):
        here = found.isel(member=k)
        if values[k] == 3e3:
            with pytest.raises(cp.RunStopped) as stopped:
                cp.periodic.stability_map(members.isel(member=k), modes, **grid)
            assert (here.failure == str(stopped.value)).all()
            assert here.growth_in_plane.isnull().all()
            assert (here.kind == "").all()
            continue
        alone = cp.periodic.stability_map(members.isel(member=k), modes, **grid)
        count = alone.sizes["edge"]
        for name, value in alone.data_vars.items():
            part = here[name].isel(edge=slice(count)) if "edge" in value.dims else here[name]
            assert np.array_equal(part.values, value.values, equal_nan=value.dtype.kind == "f"), name
        assert here.edge_angular_frequency.isel(edge=slice(count, None)).isnull().all()
    assert np.array_equal(found[key.replace(".", "_")].values, values)
    cp.archive.write(found, tmp_path / "map.nc")


def test_a_map_depends_neither_on_threads_nor_on_its_extent(monkeypatch):
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    frequency, amplitude = np.linspace(12.0, 13.0, 9), np.array([0.002, 0.004])
    one = cp.periodic.stability_map(scene, modes, frequency=frequency, amplitude=amplitude)
    monkeypatch.setattr("cablepod.periodic._map.cores", lambda: 1)
    again = cp.periodic.stability_map(scene, modes, frequency=frequency, amplitude=amplitude)
    for name in one.data_vars:
        assert np.array_equal(one[name].values, again[name].values, equal_nan=one[name].dtype.kind == "f"), name


def test_loads_alone_are_scaled_by_their_factor():
    scene = loaded(0.4, 7.0, 0.05)
    modes = cp.condensed.vibration_modes(scene, rank=1)
    found = cp.periodic.stability_map(scene, modes, frequency=[5.0, 6.0], amplitude=[0.5, 1.0])
    orbit = cp.periodic.orbit(loaded(0.4, 6.0, 0.05), modes, outputs=())
    assert float(found.response[1, 1]) == pytest.approx(float(orbit.deflection_maximum), rel=1e-3)
    assert found.amplitude.attrs["units"] == "1"


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
def test_what_was_computed_is_kept_after_an_interrupt(tension_damping, monkeypatch, tmp_path):
    scene = guy(damping=0.05)
    grid = {"frequency": np.linspace(12.3, 12.7, 12), "amplitude": np.array([0.002, 0.004, 0.006])}
    if tension_damping:
        scene = scene.assign(damping_tension_proportional=((), tension_damping, {"units": "s"}))
        grid["frequency"] = grid["frequency"][::3]
    modes = cp.condensed.vibration_modes(scene, rank=2)
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


def test_progress_of_a_map_never_falls_and_members_share_it(monkeypatch):
    monkeypatch.setattr("cablepod.periodic._map.map_threads", one_by_one)
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    members = cp.ensemble.design(scene, {"cable.top_tension": [9e3, 15e3]}, members=2, sampling="grid")
    grid = {
        "frequency": np.geomspace(1.0, 40.0, 12),
        "amplitude": np.array([0.002, 0.02]),
    }  # several numbers of harmonics
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


def test_an_edge_between_columns_of_different_steps_is_located(monkeypatch):
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    grid = {"frequency": np.linspace(12.3, 12.7, 9), "amplitude": np.array([0.002, 0.004, 0.006])}
    whole = cp.periodic.stability_map(scene, modes, **grid)
    edges = whole.edge_angular_frequency.values
    assert edges.size

    scale = float(modes.angular_frequency[0])
    for last in np.unique(np.searchsorted(grid["frequency"], edges)) - 1:  # before each edge
        border = grid["frequency"][last] * 1.0001

        def different(omega, highest, samples, most, border=border):
            return np.where(omega * scale <= border, 8, 4)

        monkeypatch.setattr("cablepod.periodic._map._strides", different)
        again = cp.periodic.stability_map(scene, modes, **grid)
        assert again.edge_angular_frequency.values == pytest.approx(edges, rel=1e-8)
        assert np.array_equal(again.kind.values, whole.kind.values)


def test_a_map_that_no_memory_holds_is_refused():
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=1)
    grid = {"frequency": np.linspace(5.0, 6.0, 10**5), "amplitude": np.linspace(1e-3, 1e-2, 10**5)}
    with pytest.raises(cp.SceneError, match="frequency and amplitude: given"):
        cp.periodic.stability_map(scene, modes, **grid)
