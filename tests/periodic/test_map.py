"""Stability over frequency and amplitude: Mathieu's tongues, orbits at single points, the answer in all threads."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from periodic_scenes import GUY, guy, loaded, mathieu
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

import cablepod as cp

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


@pytest.mark.parametrize(
    ("tension_damping", "frequency", "amplitude", "allowed"),
    [
        (0.0, [5.0, 6.25, 12.3, 12.47], [0.001, 0.004, 0.006], 1e-5),  # harmonics until the last two hold 1e-5
        (2e-4, [12.3, 12.44, 12.8], [0.002, 0.004, 0.006], 1e-6),
    ],
)
def test_a_map_has_the_growth_of_single_orbits(tension_damping, frequency, amplitude, allowed):
    scene = guy(damping=0.05 if not tension_damping else 0.03)
    if tension_damping:
        scene = scene.assign(damping_tension_proportional=((), tension_damping, {"units": "s"}))
    modes, progress = cp.condensed.vibration_modes(scene, rank=2), []
    grid = {"frequency": np.array(frequency), "amplitude": np.array(amplitude)}
    found = cp.periodic.stability_map(scene, modes, **grid, progress=progress.append)
    for i, omega in enumerate(frequency):
        for j, a in enumerate(amplitude):
            here = scene.assign(motion_upper_x_angular_frequency=omega, motion_upper_x_amplitude=a)
            orbit = cp.periodic.orbit(here, modes, outputs=())
            point = found.isel(amplitude=j, angular_frequency=i)
            largest = max(float(point.growth_in_plane), float(point.growth_out_of_plane))
            assert largest == pytest.approx(float(orbit.growth), abs=allowed)
            assert (point.kind == "stable") == bool(orbit.stable)
            assert float(point.response) == pytest.approx(float(orbit.deflection_maximum), rel=1e-3)
    assert {"stable", "period_doubling"} <= set(found.kind.values.ravel())
    assert progress == sorted(progress)
    # at an edge a multiplier is on the circle
    for omega, a in zip(found.edge_angular_frequency.values[:2], found.edge_amplitude.values[:2], strict=True):
        below = [value for value in amplitude if value < a]
        edge = cp.periodic.stability_map(scene, modes, frequency=[omega], amplitude=[*below, a])
        at = edge.isel(amplitude=-1, angular_frequency=0)
        # of a compiled map to the 1e-5 of its harmonics
        assert min(abs(float(at.growth_in_plane)), abs(float(at.growth_out_of_plane))) < (
            1e-7 if tension_damping else 1e-5
        )


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


def test_loads_alone_are_scaled_by_their_factor(tmp_path):
    scene = loaded(0.4, 7.0, 0.05)
    modes = cp.condensed.vibration_modes(scene, rank=1)
    found = cp.periodic.stability_map(scene, modes, frequency=[5.0, 6.0], amplitude=[0.5, 1.0])
    orbit = cp.periodic.orbit(loaded(0.4, 6.0, 0.05), modes, outputs=())
    assert float(found.response[1, 1]) == pytest.approx(float(orbit.deflection_maximum), rel=1e-3)
    assert found.amplitude.attrs["units"] == found.edge_amplitude.attrs["units"] == "1"
    cp.archive.write(found, tmp_path / "map.nc")
    assert cp.plots.stability_map(found).get_ylabel().endswith("factor of a load [1]")


def test_a_map_that_no_memory_holds_is_refused():
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=1)
    grid = {"frequency": np.linspace(5.0, 6.0, 10**5), "amplitude": np.linspace(1e-3, 1e-2, 10**5)}
    with pytest.raises(cp.SceneError, match="frequency and amplitude: given"):
        cp.periodic.stability_map(scene, modes, **grid)


def test_the_response_in_space_is_that_of_both_deflections():
    tables = {
        "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "top_tension": 12000.0},
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": [30.0, 25.0, 8.0]},
        "chain": {"links": 30},
        "damping": {"mass_proportional": 0.6},
        "motion": {"upper": {axis: {"kind": "harmonic", "amplitude": 2e-3, "angular_frequency": 5.0} for axis in "xz"}},
    }
    scene = cp.make_scene(tables)
    modes = cp.condensed.vibration_modes(scene, rank=3, static_modes=True)
    found = cp.periodic.stability_map(scene, modes, frequency=[5.0], amplitude=[1e-3, 2e-3])
    orbit = cp.periodic.orbit(scene, modes, outputs=())
    assert float(found.response[1, 0]) == pytest.approx(float(orbit.deflection_maximum), rel=1e-3)


def test_there_is_no_edge_where_the_response_jumps():
    """At 16.33 rad/s whirling begins on the high response, at 17.26 rad/s there is the low one: no edge at these themselves."""
    mapping = copy.deepcopy(GUY) | {"damping": {"mass_proportional": 0.2, "tension_proportional": 1.75e-4}}
    mapping["cable"]["top_tension"], mapping["ends"]["upper"] = 16050.0, [24.74, 0.0]
    mapping["motion"] = {"lower": {"y": {"kind": "harmonic", "amplitude": 0.0084, "angular_frequency": 6.0}}}
    sine = {"kind": "harmonic", "amplitude": 1.0, "angular_frequency": 6.0, "phase": 1.0}
    mapping["load"] = {"uniform": [0.0, 1.667]} | sine
    scene = cp.make_scene(mapping)
    modes, grid = cp.condensed.vibration_modes(scene, rank=2), [16.33, 17.26]
    found = cp.periodic.stability_map(scene, modes, frequency=grid, amplitude=[0.002, 0.004, 0.006, 0.0084])
    assert found.sizes["edge"] == 1
    assert grid[0] < found.edge_angular_frequency.item() < grid[1]


@pytest.mark.parametrize(("damping", "omega"), [({"mass_proportional": 0.1}, 11.5), ({"ratio": 0.005}, 11.5)])
def test_a_response_grows_up_to_the_first_amplitude(damping, omega):
    scene = cp.make_scene({**GUY, "damping": damping}).assign(motion_upper_x_angular_frequency=omega)
    modes = cp.condensed.vibration_modes(scene, rank=3)
    grid = {"frequency": [omega - 0.5, omega], "amplitude": [0.1, 0.11]}  # from rest Newton's method fails
    found = cp.periodic.stability_map(scene, modes, **grid)
    assert (found.failure == "").all()
    for k, amplitude in enumerate(grid["amplitude"]):
        orbit = cp.periodic.orbit(scene.assign(motion_upper_x_amplitude=amplitude), modes, outputs=())
        point = found.isel(amplitude=k, angular_frequency=1)
        # the harmonics that maps leave out have 1e-5 of the motion, their largest deflections are at fewer phases
        assert float(point.response) == pytest.approx(float(orbit.deflection_maximum), rel=1e-3)
        growth = max(float(point.growth_in_plane), float(point.growth_out_of_plane))
        assert growth == pytest.approx(float(orbit.growth), abs=1e-3)
