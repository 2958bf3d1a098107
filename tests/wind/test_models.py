"""Chain and condensed model in wind: aerodynamic damping, statics, gusts, given fields."""

from __future__ import annotations

import math
import re
import warnings

import numpy as np
import pytest
import xarray as xr
from mast_scenes import small, windy
from scipy.integrate import solve_bvp
from scipy.interpolate import BarycentricInterpolator
from scipy.optimize import curve_fit
from scipy.signal import firwin, resample_poly
from suite import slow
from wind_scenes import GUY, WIND

import cablepod as cp

LENGTH, TENSION, MASS, STIFFNESS, DIAMETER = 50.0, 20000.0, 1.0, 2.0e7, 0.02
AIR, DRAG = 1.25, 1.2

#: A string of 5 m, 25 m above ground, and a wind across it.
LEVEL = {"lower": [0.0, 25.0, 0.0], "upper": [5.0, 25.0, 0.0]}
ACROSS = {"speed": 20.0, "direction": [0.0, 0.0, 1.0]}


def string(speed=20.0, *, links=40, stiffness=STIFFNESS, duration=2.0, turbulence=None, points=None):
    """Make a taut string without weight along x in a uniform wind along z."""
    wind = {"speed": speed, "direction": [0.0, 0.0, 1.0], "profile": "uniform", "ground": -50.0}
    cable = {"youngs_modulus": stiffness, "area": 1.0, "density": MASS, "top_tension": TENSION, "diameter": DIAMETER}
    tables = {
        "gravity": 0.0,
        "cable": cable,
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": [LENGTH, 0.0, 0.0]},
        "chain": {"links": links},
        "wind": {**wind, "turbulence": turbulence} if turbulence else wind,
        "time": {"duration": duration, "interval": 0.01},
    }
    return cp.make_scene(tables | ({} if points is None else {"initial": {"points": points.tolist()}}))


def plucked(mode, axis):
    """Return the string at its rest in the wind, and plucked from there in a mode along an axis."""
    rest = cp.chain.rest(string()).position.values
    moved = rest.copy()
    moved[:, axis] += 1e-4 / mode * np.sin(mode * np.pi * np.linspace(0.0, 1.0, len(rest)))
    return string(points=rest), string(points=moved)


def decay(still, run, mode, axis):
    """Fit the rate of decay [1/s] to the amplitude of a mode."""
    shape = np.sin(mode * np.pi * np.linspace(0.0, 1.0, run.sizes["particle"]))
    amplitude = (run.position - still.position).values[:, :, axis] @ shape

    def damped(t, rate, omega, c, s):
        return np.exp(-rate * t) * (c * np.cos(omega * t) + s * np.sin(omega * t))

    guess = mode * math.pi / LENGTH * math.sqrt(TENSION / MASS)
    return curve_fit(damped, run.time.values, amplitude / amplitude[0], p0=(0.2, guess, 1.0, 0.0))[0][0]


@pytest.mark.parametrize("mode", [1, 3])
@pytest.mark.parametrize(("axis", "share"), [(2, 1.0), (1, 0.5)])
@pytest.mark.parametrize("model", ["velocity_verlet", slow("trapezoidal"), slow("generalized_alpha"), "condensed"])
def test_decay_of_a_taut_string_in_wind(model, axis, share, mode):
    scenes = plucked(mode, axis)
    if model == "condensed":
        modes = cp.condensed.vibration_modes(scenes[0], rank=6)
        runs = [cp.condensed.simulate(scene, modes, step=1e-3, outputs=("position",)) for scene in scenes]
    else:
        step = 1.5e-4 if model == "velocity_verlet" else 1e-3
        runs = [cp.chain.simulate(scene, scheme=model, step=step) for scene in scenes]
    expected = share * AIR * DRAG * DIAMETER * 20.0 / (2.0 * MASS)
    assert decay(*runs, mode, axis) == pytest.approx(expected, rel=0.01)


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")  # modes that hold no motion
def test_inertia_does_not_move_the_rest_of_a_sagging_cable(soft):
    """The sag is so deep, a third of the chord, that accelerations for forces lead Newton's method away."""
    soft["cable"] |= {"unstretched_length": 13.0, "diameter": 0.036}
    del soft["cable"]["top_tension"]
    wind = {"speed": 5.0, "direction": [1.0, 0.0], "profile": "uniform", "ground": -20.0}
    scene = cp.make_scene({**soft, "motion": {}, "wind": wind})
    modes = cp.condensed.vibration_modes(scene, rank=2, static_modes=True)
    rest = [
        cp.condensed.simulate(scene, modes, order=order, times=[0.0], outputs=("position",)).position
        for order in ("exact", "inertial")
    ]
    np.testing.assert_allclose(rest[1], rest[0], rtol=0, atol=1e-9)


def test_blow_back_of_a_level_cable():
    tables = {
        "cable": {
            "youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "horizontal_force": 30000.0, "diameter": 0.016,
        },
        "ends": {"lower": [0.0, 20.0, 0.0], "upper": [60.0, 20.0, 0.0]},
        "chain": {"links": 80},
        "wind": {"speed": 30.0, "direction": [0.0, 0.0, 1.0], "profile": "uniform"},
        "time": {"duration": 1.0, "interval": 0.1},
    }  # fmt: skip
    scene = cp.make_scene(tables)
    rest = cp.chain.rest(scene)
    strain = float(rest.tension.mean()) / 2.0e7
    drag, weight = 0.5 * AIR * DRAG * 0.016 * 30.0**2, 8000.0 * 1.25e-4 * 9.81
    expected = math.degrees(math.atan(drag * (1.0 + strain) / weight))
    modes = cp.condensed.vibration_modes(scene, rank=4, static_modes=True)
    condensed = cp.condensed.simulate(scene, modes, step=5e-3, times=[0.0]).position.values[0]
    for position in (rest.position.values, condensed):
        _, y, z = position[40]
        assert 20.0 - y < 60.0 / 200.0
        assert math.degrees(math.atan2(z, 20.0 - y)) == pytest.approx(expected, abs=0.01)
    assert float(rest.residual) < 1e-6


@pytest.mark.parametrize("model", ["chain", "cable", "condensed"])
@pytest.mark.parametrize(("direction", "profile"), [((0.0, 0.0, 1.0), "uniform"), ((-0.6, 0.0, 0.8), "power")])
def test_sag_of_an_iced_string_across_the_wind(model, direction, profile):
    """A taut string sags by q l^2 / 8 T: q by the normal part of the wind, with density, coefficient, ice and height."""
    tables = {
        "gravity": 0.0,
        "cable": {
            "axial_stiffness": 4e5,
            "mass_per_length": MASS,
            "top_tension": TENSION,
            "diameter": DIAMETER,
            "drag_coefficient": 0.9,
        },
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": [LENGTH, 0.0, 0.0]},
        "ice": {"thickness": 0.01},
        "wind": {"speed": 12.0, "direction": list(direction), "profile": profile, "ground": -20.0, "air_density": 1.1},
        "chain": {"links": 100},
        "time": {"duration": 1.0, "interval": 0.1},
    }
    if profile == "power":
        tables["wind"]["exponent"] = 0.2
    scene = cp.make_scene(tables)
    if model == "condensed":
        modes = cp.condensed.vibration_modes(scene, rank=4, static_modes=True)
        position = cp.condensed.simulate(scene, modes, step=0.005, times=[0.0]).position[0].values
    else:
        position = (cp.chain.rest(scene) if model == "chain" else cp.cable.rest(scene, law="linear")).position.values
    normal = direction[2] * 12.0 * (2.0**0.2 if profile == "power" else 1.0)
    sag = 0.5 * 1.1 * 0.9 * (0.02 + 2.0 * 0.01) * normal**2 * LENGTH**2 / (8.0 * TENSION)
    rise = 4e5 / TENSION * 8.0 / 3.0 * (sag / LENGTH) ** 2  # of the tension by the sag, 4e-5
    assert position[len(position) // 2, 2] == pytest.approx(np.sign(normal) * sag / (1.0 + rise), rel=1e-5)


def exact_guy(scene, direction, speed):
    """Solve the boundary value problem of an elastic cable in a uniform wind; returns positions as a function of arc length."""
    rest = cp.catenary.rest(scene, points=201)
    length = float(rest.unstretched_length)
    wind, weight = speed * np.array(direction)[:, None], np.array([0.0, -8000.0 * 1.25e-4 * 9.81, 0.0])[:, None]

    def slope(_, state):
        tension = np.sqrt((state[3:] ** 2).sum(axis=0))
        tangent = state[3:] / tension
        stretch = 1.0 + tension / 2.0e7
        normal = wind - (wind * tangent).sum(axis=0) * tangent
        load = 0.5 * AIR * DRAG * 0.016 * stretch * np.sqrt((normal**2).sum(axis=0)) * normal + weight
        return np.vstack([tangent * stretch, -load])

    def ends(first, last):
        return np.concatenate([first[:3] - GUY["ends"]["lower"], last[:3] - GUY["ends"]["upper"]])

    place = np.linspace(0.0, length, 401)
    start = np.array([np.interp(place, rest.arc_length, rest.position[:, c]) for c in range(3)])
    tangent = np.gradient(start, place, axis=1)
    tangent *= np.interp(place, rest.arc_length, rest.tension) / np.sqrt((tangent**2).sum(axis=0))
    found = solve_bvp(slope, ends, place, np.vstack([start, tangent]), tol=1e-9, max_nodes=20000)
    assert found.success
    return found.sol


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, 0.8)])
def test_static_guys_in_wind(direction):
    scene = cp.make_scene(
        {**GUY, "wind": {"speed": 30.0, "direction": list(direction), "profile": "uniform"}, "chain": {"links": 80}}
    )
    rest = cp.chain.rest(scene)
    exact = exact_guy(scene, direction, 30.0)(rest.arc_length.values)
    change = np.abs(exact[:3].T - cp.catenary.rest(scene, points=81).position.values).max()
    assert change > 0.2
    assert np.abs(rest.position.values - exact[:3].T).max() < 2e-4 * change
    modes = cp.condensed.vibration_modes(scene, rank=4, static_modes=True)
    condensed = cp.condensed.simulate(scene, modes, step=5e-3, times=[0.0])
    assert np.abs(condensed.position.values[0] - exact[:3].T).max() < 2e-3 * change
    # and a run stays there
    run = cp.chain.simulate(scene, step=1.2e-4, times=[0.0, 0.5])
    assert np.abs(run.position[1] - run.position[0]).max() < 1e-7


def test_a_string_in_coherent_turbulence_meets_the_spectral_integral():
    stiffness, speed, duration = 4.0e5, 20.0, 3600.0
    turbulence = {"spectrum": "von_karman", "intensity": 0.02, "length_scale": 100.0, "decay": [1e-6, 1e-6], "seed": 3}
    scene = string(speed, stiffness=stiffness, duration=duration, turbulence=turbulence, links=60)
    modes = cp.condensed.vibration_modes(scene, rank=6)
    run = cp.condensed.simulate(scene, modes, step=0.01, times=np.arange(30.0, duration, 0.1), outputs=("position",))
    found = float(run.position[:, 30, 2].std())
    stretch = 1.0 + TENSION / stiffness
    damping = AIR * DRAG * DIAMETER * speed * stretch / MASS  # force over velocity and mass, per unstretched length
    n = np.arange(1, 18000) / duration
    f = n * 100.0 / speed
    spectrum = (0.02 * speed) ** 2 * 4.0 * f / (1.0 + 70.8 * f**2) ** (5 / 6) / n
    omega, response = 2.0 * np.pi * n, 0.0
    for mode in range(1, 14, 2):
        own = mode * math.pi / LENGTH * math.sqrt(TENSION * stretch / MASS)
        shape = 4.0 / (mode * math.pi) * (-1) ** (mode // 2)
        response = response + shape * damping / (own**2 - omega**2 + 1j * omega * damping)
    expected = math.sqrt((np.abs(response) ** 2 * spectrum / duration).sum())
    assert found == pytest.approx(expected, rel=0.02)


@pytest.mark.slow
def test_denser_points_take_away_the_gusts_that_are_too_long():
    """Spectral integrals over gusts between points and over those of the whole guy give how much too far its shapes swing."""
    wind = {"speed": 25.0, "direction": [0.0, 0.0, 1.0], "profile": "uniform", "turbulence": {"spectrum": "kaimal"}}
    cable = {**GUY["cable"], "top_tension": 22000.0}
    scene = cp.make_scene({**GUY, "cable": cable, "wind": wind, "time": {"duration": 600.0, "interval": 0.05}})
    modes = cp.condensed.vibration_modes(scene, rank=6)
    swing = {}
    for count in (9, 161):
        points = cp.catenary.rest(scene, points=count).position
        fields = (cp.wind.field(scene, seed=seed, points=points) for seed in range(14))
        runs = [cp.condensed.simulate(scene, modes, step=0.0125, wind=field, outputs=()) for field in fields]
        swing[count] = np.mean([run.amplitude_out_of_plane[400:].std("time")[:3] for run in runs], axis=0)
    n, length, omega = np.arange(1, 3000) / 600.0, 61.2, math.pi / 61.2 * math.sqrt(22000.0)
    place, fine = np.linspace(0.0, 1.0, 9), np.linspace(0.0, 1.0, 161)
    between = np.array([np.interp(fine, place, row) for row in np.eye(9)])
    decay = length * math.hypot(10.0 * 57.7 / length, 16.0 * 20.4 / length) / 25.0
    spectrum = (1.0 + 50.0 * n * 30.0 / 25.0) ** (-5 / 3)
    expected = []
    for mode in (1, 2, 3):
        shape, squares = np.sin(mode * math.pi * fine), []
        for at, weights in ((place, between @ shape), (fine, shape)):
            apart = decay * np.abs(at[:, None] - at)
            loads = spectrum * [weights @ np.exp(-frequency * apart) @ weights for frequency in n]
            waves = 2.0 * math.pi * n
            response = ((mode * omega) ** 2 - waves**2) ** 2 + (AIR * DRAG * 0.016 * 25.0 * waves) ** 2
            squares.append((loads / response).sum())
        expected.append(math.sqrt(squares[0] / squares[1]))
    assert expected == pytest.approx([1.04, 1.30, 1.35], abs=0.01)
    np.testing.assert_allclose(swing[9] / swing[161], expected, rtol=0.05)  # three standard deviations of 14 seeds


def gain(product):
    """Gain of a wave over its frequency times the interval: polynomials through six samples to a quarter, then straight lines."""
    nodes, places = np.arange(-2.0, 4.0), np.arange(4) / 4.0
    weights = BarycentricInterpolator(nodes, np.eye(6))(places)
    turns = np.exp(-2j * np.pi * product * (places[:, None] - nodes))
    return np.sinc(product / 4.0) ** 2 * abs((weights * turns).sum()) / 4.0


@pytest.mark.parametrize(("frequency", "expected"), [(2.0, 0.98), (2.5, 0.96), (3.0, 0.91), (3.5, 0.83), (4.0, 0.72)])
def test_gusts_between_samples_lose_amplitude(frequency, expected):
    """A taut string of 29 Hz follows a wave of the wind, so that its amplitude is that of the wave between the samples."""
    cable = {**GUY["cable"], "top_tension": 60000.0}
    time = {"duration": 10.0, "interval": 0.02}
    scene = cp.make_scene(
        {**GUY, "cable": cable, "ends": LEVEL, "wind": {**ACROSS, "profile": "uniform"}, "time": time}
    )
    modes, swings = cp.condensed.vibration_modes(scene, rank=2), []
    for interval in (0.1, 0.0125):
        field = cp.wind.field(scene, times=interval * np.arange(round(10.0 / interval) + 1))
        field["wind"] = field.wind * (1.0 + 0.02 * np.cos(2.0 * np.pi * frequency * field.time))
        run = cp.condensed.simulate(scene, modes, step=2.5e-3, wind=field, outputs=())
        swings.append(
            abs((run.amplitude_out_of_plane[100:500, 0] * np.exp(-2j * np.pi * frequency * run.time[100:500])).sum())
        )
    assert gain(0.1 * frequency) == pytest.approx(expected, abs=0.005)
    assert float(swings[0] / swings[1]) == pytest.approx(gain(0.1 * frequency), abs=0.003)  # and 0.0125 s loses 1e-3


@pytest.mark.parametrize(("height", "expected"), [(10.0, 0.010), (30.0, 0.005)])
def test_gusts_between_samples_lose_variance(height, expected):
    """Of all variance of Kaimal's spectrum at 25 m/s, which is 6 of the reduced one."""
    n = np.linspace(1e-3, 5.0, 500)
    spectrum = 200.0 * height / 25.0 / (1.0 + 50.0 * n * height / 25.0) ** (5 / 3)
    lost = 1.0 - np.array([gain(0.1 * frequency) for frequency in n]) ** 2
    assert np.trapezoid(lost * spectrum, n) / 6.0 == pytest.approx(expected, abs=0.0006)


#: Guys [m, N], and a mast: change of the fatigue range and of the standard deviation of the tension [%], with samples every 0.1 s
#: and every 0.05 s.
BETWEEN = {
    (61.2, 22000.0): ((-0.1, 0.0), (0.0, 0.0)),
    (30.0, 20000.0): ((-1.7, -0.6), (-0.1, -0.1)),
    (20.0, 15000.0): ((-6.0, -2.3), (-0.4, -0.2)),
    (17.0, 20000.0): ((-18.5, -7.6), (-1.2, -0.5)),
    None: ((-11.2, -3.3), (-1.6, -0.4)),
}


@pytest.mark.slow
@pytest.mark.parametrize(("guy", "expected"), BETWEEN.items(), ids=str)
def test_finer_samples_keep_the_gusts_that_resonate(guy, expected):
    """Samples every 0.025 s, and of the same gusts without what is shorter than two intervals, one in two and one in four."""
    wind = {"speed": 25.0, "direction": [0.6, 0.0, 0.8], "turbulence": {"spectrum": "kaimal", "interval": 0.025}}
    time, changes = {"duration": 300.0, "interval": 0.02}, []
    if guy is None:
        scene = small(
            lambda tables: (
                windy(tables),
                tables.update(wind=wind, time=time),
                tables["mast"].update(modes=8, elements=16),
                tables["guy"].append({**tables["guy"][0], "level": 15.0}),
            )
        )
    else:
        ends = {"lower": [0.0, 0.0, 0.0], "upper": [guy[0] / 3.0, guy[0] * math.sqrt(8.0) / 3.0, 0.0]}
        scene = cp.make_scene(
            {**GUY, "cable": {**GUY["cable"], "top_tension": guy[1]}, "ends": ends, "wind": wind, "time": time}
        )
        modes = cp.condensed.vibration_modes(scene, rank=4)
    for seed in range(3):
        field, ranges = cp.wind.field(scene, seed=seed), []
        for every in (1, 4, 2):
            own = field.isel(time=slice(None, None, every)).copy()
            if every > 1:
                gusts = resample_poly(
                    field.wind - field.mean_wind, 1, every, window=firwin(1601, 1.0 / every), padtype="line"
                )
                own["wind"] = own.wind.dims, gusts + field.mean_wind.values
            if guy is None:
                tension = cp.mast.simulate(scene, step=0.005, rank=4, wind=own, outputs=("guy_tension",)).guy_tension
            else:
                tension = cp.condensed.simulate(
                    scene, modes, step=0.005, wind=own, outputs=("tension",), links=[20]
                ).tension
            tension = tension[500:]
            ranges.append([float(cp.fatigue.equivalent(tension).mean()), float(tension.std("time").mean())])
        changes.append(np.array(ranges[1:]) / ranges[0] - 1.0)
    np.testing.assert_allclose(
        100.0 * np.mean(changes, axis=0), expected, rtol=0.0, atol=0.06
    )  # as rounded, seeds are given


def gusty(**tables):
    return cp.make_scene(
        {
            **GUY,
            "ends": {"lower": [0.0, 0.0, 0.0], "upper": [60.0, 80.0, 0.0]},
            "damping": {"mass_proportional": 0.02},
            "chain": {"links": 40},
            "wind": {"speed": 25.0, "direction": [0.6, 0.0, 0.8], "turbulence": {"spectrum": "kaimal", "seed": 7}},
            "time": {"duration": 120.0, "interval": 0.05},
            **tables,
        }
    )


@pytest.mark.slow
def test_a_gusty_guy_by_the_condensed_model_and_by_its_chain():
    scene = gusty()
    chain = cp.chain.simulate(scene, step=4e-4, outputs=("tension",)).tension.isel(link=-1)
    modes = cp.condensed.vibration_modes(scene, rank=4)
    reduced = cp.condensed.simulate(scene, modes, step=0.02, outputs=("tension",), links=[40]).tension.isel(link=0)
    chain, reduced = (series.sel(time=slice(20.0, None)) for series in (chain, reduced))
    assert float(chain.std()) > 500.0
    for measure in (lambda t: t.std(), lambda t: t.max(), cp.fatigue.equivalent):
        assert float(measure(reduced)) == pytest.approx(float(measure(chain)), rel=0.01)


@pytest.mark.slow
def test_explicit_and_implicit_chains_agree_in_gusts():
    scene = gusty(time={"duration": 5.0, "interval": 0.05}, chain={"links": 20})
    explicit = cp.chain.simulate(scene, step=2e-4).position
    implicit = cp.chain.simulate(scene, scheme="trapezoidal", step=5e-4).position
    moved = float(np.abs(explicit - explicit[0]).max())
    assert moved > 0.05
    assert float(np.abs(explicit - implicit).max()) < 2e-3 * moved


def test_a_given_field_stands_for_that_of_the_scene():
    scene = gusty(time={"duration": 2.0, "interval": 0.1}, chain={"links": 10}, damping={})
    field = cp.wind.field(scene)
    own, given = cp.chain.simulate(scene, step=1e-3), cp.chain.simulate(scene, step=1e-3, wind=field)
    assert np.abs(own.position - given.position).max() < 1e-12
    assert field.attrs["id"] in given.attrs["history_json"]
    other = cp.chain.simulate(scene, step=1e-3, wind=cp.wind.field(scene, seed=8))
    assert np.abs(own.position - other.position).max() > 1e-4
    placed = field.drop_vars("relative_arc_length")  # a record with positions alone
    assert np.abs(cp.chain.simulate(scene, step=1e-3, wind=placed).position - own.position).max() < 1e-3
    modes = cp.condensed.vibration_modes(scene, rank=4)
    runs = [
        cp.condensed.simulate(scene, modes, step=0.01, wind=wind, outputs=("position",)).position
        for wind in (None, field)
    ]
    assert np.abs(runs[0] - runs[1]).max() < 1e-12


def test_components_of_a_field_are_found_by_their_label():
    scene = gusty(time={"duration": 1.0, "interval": 0.1}, chain={"links": 10})
    field = cp.wind.field(scene)
    turned = field.isel(component=[2, 0, 1])
    first, second = (cp.chain.simulate(scene, step=1e-3, wind=wind).position for wind in (field, turned))
    assert np.array_equal(first, second)
    storm = small(windy)
    field = cp.wind.field(storm).drop_vars(["guy", "relative_arc_length"])  # found by its positions
    first, second = (
        cp.mast.simulate(storm, wind=wind).displacement for wind in (field, field.isel(component=[1, 2, 0]))
    )
    assert np.array_equal(first, second)


def test_other_schemes_refuse_wind():
    scene = cp.make_scene({**GUY, "wind": WIND})
    modes = cp.condensed.vibration_modes(scene, rank=4)
    for scheme in ("numerov", "trapezoidal"):
        with pytest.raises(cp.SceneError, match=r"^scheme: given"):
            cp.condensed.simulate(scene, modes, scheme=scheme)


@pytest.mark.slow
def test_members_in_wind_have_the_bits_of_single_runs():
    scene = gusty(time={"duration": 1.0, "interval": 0.1}, chain={"links": 10})
    members = cp.ensemble.design(scene, {"wind.speed": [10.0, 30.0]}, members=3, seed=2)
    modes = cp.condensed.vibration_modes(scene, rank=4)
    for call in (
        lambda scenes: cp.chain.simulate(scenes, step=1e-3, outputs=("position", "tension_extremes")),
        lambda scenes: cp.condensed.simulate(scenes, modes, step=0.01, outputs=("position", "tension_extremes")),
    ):
        together, alone = call(members), call(members.isel(member=2, drop=True))
        for name in ("position", "tension_maximum"):
            assert np.array_equal(together[name].isel(member=2), alone[name])
        assert float(np.ptp(together.tension_maximum.values[:, -1])) > 10.0


def test_a_ramp_starts_in_still_air():
    scene = cp.make_scene({**GUY, "wind": {**WIND, "ramp": 1.0}, "time": {"duration": 2.0, "interval": 0.5}})
    run = cp.chain.simulate(scene, step=5e-4)
    still = cp.chain.rest(cp.make_scene(GUY))
    assert np.array_equal(run.position[0], still.position)
    assert float(np.abs(run.position[-1] - still.position).max()) > 0.05


@pytest.mark.slow
def test_planar_and_spatial_scenes_agree():
    planar = {**GUY, "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]}, "time": {"duration": 1.0, "interval": 0.1}}
    wind = {"speed": 25.0, "turbulence": {"spectrum": "kaimal"}}
    flat = cp.chain.simulate(cp.make_scene({**planar, "wind": {**wind, "direction": [1.0, 0.0]}}), step=5e-4).position
    space = {**GUY, "time": planar["time"], "wind": {**wind, "direction": [1.0, 0.0, 0.0]}}
    spatial = cp.wind.field(cp.make_scene(space))
    only_along = spatial.assign(wind=spatial.wind * xr.DataArray([1.0, 1.0, 0.0], dims="component"))
    run = cp.chain.simulate(cp.make_scene(space), step=5e-4, wind=only_along)
    assert np.abs(run.position.values[..., :2] - flat.values).max() < 1e-9


@pytest.mark.parametrize("outputs", [("position",), ("position", "velocity")])
def test_instants_between_two_evaluations_change_no_bit(outputs: tuple[str, ...]) -> None:
    """A run is cut at its output instants; the drag is evaluated at the same steps whatever these are."""
    motion = {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": 0.05, "angular_frequency": 20.0}}}
    scene = cp.make_scene({**GUY, "wind": WIND, "motion": motion})
    runs = [
        cp.chain.simulate(scene, step=4e-4, times=times, outputs=outputs)
        for times in ([0.0, 0.0012, 0.0104, 0.0264, 0.0268, 0.1], [0.0, 0.1])
    ]
    assert np.array_equal(runs[0].position[-1], runs[1].position[-1])
    assert np.abs(runs[0].position[-1] - runs[0].position[0]).max() > 1e-3


def test_few_links_in_gusts_are_told_of():
    scene = gusty(time={"duration": 20.0, "interval": 0.05}, chain={"links": 20})
    options = {"tolerance": 1e-2, "outputs": ("position",)}
    with pytest.warns(cp.CoarseWarning, match=r"links: given 20, .*errs by \d+ %\); try links=\d+") as caught:
        coarse = cp.chain.simulate(scene, **options)
    said = str(caught[0].message)
    told, least = (float(re.search(text, said).group(1)) for text in (r"errs by (\d+) %", r"try links=(\d+)"))
    fine, enough = (cp.chain.simulate(scene, links=int(factor * least), **options) for factor in (3, 1))  # no warning
    error = float(cp.compare.errors(coarse, fine).error_max)
    assert 0.5 * error < told / 100.0 < error  # the motion errs by more than the load
    assert float(cp.compare.errors(enough, fine).error_max) < 0.1 * error
    with pytest.warns(cp.CoarseWarning, match=r"errs by \d+ %"):  # the ramp of the mean wind does not hide the gusts
        cp.chain.simulate(scene.assign(wind_ramp=5.0), **options)
    steady = scene.drop_vars([name for name in scene.data_vars if str(name).startswith("wind_turbulence")])
    with warnings.catch_warnings():
        warnings.simplefilter("error", cp.CoarseWarning)
        for given in (steady, steady.assign(wind_ramp=5.0)):
            cp.chain.simulate(given, **options)


def test_the_exact_order_has_no_lower_end():
    """Drag with the stretch at the lower end moved a soft, heavy guy by 0.7 mm, and its mirror image by as much the other way."""
    cable = {"axial_stiffness": 1.5e6, "mass_per_length": 2.5, "unstretched_length": 92.2, "diameter": 0.03}
    ends = [[0.0, 0.0, 0.0], [20.0, 90.0, 0.0]]
    tables = {
        "cable": cable,
        "chain": {"links": 24},
        "wind": {"speed": 20.0, "direction": [0.6, 0.0, 0.8], "profile": "uniform", "ground": -1.0},
        "time": {"duration": 0.5, "interval": 0.5},
    }
    positions = []
    for lower, upper in (ends, ends[::-1]):
        scene = cp.make_scene({**tables, "ends": {"lower": lower, "upper": upper}})
        modes = cp.condensed.vibration_modes(scene, rank=4, static_modes=True)
        positions.append(cp.condensed.simulate(scene, modes, order="exact", step=0.005).position.values)
    np.testing.assert_allclose(positions[1][:, ::-1], positions[0], atol=1e-9)  # 1.4e-3 without the mean
