"""Prepared models: steps of a host, end force, static and dynamic stiffness, runs, Datasets."""

from __future__ import annotations

import copy
import math
import re
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import xarray as xr
from host_scenes import GUY, SCENES, SPATIAL, joined, motion, prepared, sines, table
from references.catenary_mpmath import MP, from_length
from references.numbers import Numbers

import cablepod as cp

# --- the physics of a step ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENES)
def test_steps_converge_to_simulate_with_order_two(name):
    mapping = SCENES[name]
    modes = sines(4, len(mapping["ends"]["upper"]))
    fine = cp.condensed.simulate(cp.make_scene(mapping), modes, step=1 / 3200, outputs=())
    errors = []
    for step in (0.02, 0.01):
        guy, every = prepared(mapping), round(1.0 / step)
        amplitudes = [np.concatenate(guy.amplitude)]
        position, velocity, _ = table(mapping, step)
        for k in range(1, len(position)):
            guy.step(position[k], velocity[k], step)
            if k % every == 0:
                amplitudes.append(np.concatenate(guy.amplitude))
        errors.append(np.abs(np.array(amplitudes) - joined(fine)).max())
        assert guy.time == pytest.approx(8.0, abs=1e-9)
    same = cp.condensed.simulate(cp.make_scene(mapping), modes, step=0.01, outputs=())
    assert errors[1] < 1.05 * np.abs(joined(same) - joined(fine)).max()  # no worse than simulate with the same step
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.4)


def test_end_force_is_the_reaction_of_the_chain():
    # the chain's last link and half its load; 12 sines leave 1e-3 of the change of the force
    mapping = copy.deepcopy(GUY)
    mapping["motion"]["upper"]["x"] |= {"kind": "one_minus_cosine"}
    scene = cp.make_scene(mapping)
    chain = cp.chain.simulate(scene, links=80, tolerance=1e-4, outputs=("position", "tension"))
    last = np.diff(chain.position.values[:, -2:], axis=1)[:, 0]
    reaction = -chain.tension.values[:, -1:] * last / np.linalg.norm(last, axis=1)[:, None]
    p = Numbers(scene)
    half = 0.5 * float(chain.unstretched_length) / 80
    times = chain.time.values
    inertia = p.end_positions(times, 2)[:, 1] + p.damping * p.end_positions(times, 1)[:, 1]
    reaction += half * (p.weight - p.mass * inertia)
    run = cp.condensed.prepare(scene, sines(12, points=81), step=0.002).run()
    change = np.abs(reaction - reaction[0]).max()
    assert change > 1000.0
    assert np.abs(run.end_force - reaction).max() < 1.5e-3 * change


@pytest.mark.parametrize("name", SCENES)
def test_step_with_the_acceleration_gives_the_force_of_a_run(name):
    mapping = SCENES[name]
    differences = []
    for step in (0.02, 0.01):
        guy = prepared(mapping, step=step)
        truth = guy.run(times=step * np.arange(round(8.0 / step) + 1)).end_force
        position, velocity, acceleration = table(mapping, step)
        forces = [guy.step(position[k], velocity[k], step, acceleration[k]) for k in range(1, len(position))]
        differences.append(np.abs(np.array(forces)[20:] - truth[21:]).max())
    assert differences[1] < 1e-3  # of 8000 N
    assert differences[0] / differences[1] == pytest.approx(4.0, abs=1.0)


def test_acceleration_adds_the_inertia_of_the_mass():
    # at once, before the cable moves: the difference is mass times acceleration up to the tension's effect on the sagging cable
    position, velocity, _ = (rows[0] for rows in motion(SPATIAL, [0.0]))
    guy, acceleration = prepared(SPATIAL), np.array([3.0, -2.0, 1.0])
    with_it = guy.trial(position, velocity * 0.0, 1e-3, acceleration)
    without = guy.trial(position, velocity * 0.0, 1e-3, np.zeros(3))
    expected = guy.mass @ acceleration
    assert np.linalg.norm(without - with_it - expected) < 0.03 * np.linalg.norm(expected)
    numbers = Numbers(cp.make_scene(SPATIAL))
    third = numbers.mass * numbers.length / 3.0
    values = np.linalg.eigvalsh(guy.mass)
    assert values[-1] == pytest.approx(third, rel=1e-3)
    assert 0.0 < values[0] < 0.2 * third  # four sines hold the most of it


# --- stiffness ----------------------------------------------------------------------------------------------------------


CATENARIES = {
    "taut": ([20.4, 57.7], 15000.0),
    "sagging": ([50.0, 35.0], 1500.0),
    "level": ([60.0, 0.0], 4000.0),
    "steep, downward": ([3.0, -40.0], 2000.0),
}


@pytest.mark.parametrize("name", CATENARIES)
def test_static_stiffness_is_the_tangent_of_the_catenary(name):
    # central differences of catenaries with 50 digits; the issue asks for 1e-5, rounding leaves 1e-9
    upper, tension = CATENARIES[name]
    mapping = {"cable": GUY["cable"] | {"top_tension": tension}, "ends": {"lower": [0.0, 0.0], "upper": upper}}
    guy, p = prepared(mapping), Numbers(cp.make_scene(mapping))
    h, tangent = 1e-12, np.empty((2, 2))
    for k in range(2):
        forces = []
        for sign in (1, -1):
            a, b = (value + sign * h * (axis == k) for axis, value in enumerate(map(MP.mpf, upper)))
            cable = from_length(a, b, -p.weight[1], p.stiffness, p.length)
            forces.append((cable.force, cable.vertical(cable.length)))
        tangent[:, k] = [float((forces[0][i] - forces[1][i]) / (2 * h)) for i in range(2)]
    assert np.abs(guy.stiffness - tangent).max() < 1e-9 * np.abs(tangent).max()
    assert (
        np.abs(np.linalg.inv(guy.stiffness) - np.linalg.inv(tangent)).max()
        < 1e-9 * np.abs(np.linalg.inv(tangent)).max()
    )


def test_static_stiffness_in_space_follows_the_load():
    # differences of catenaries in the plane of chord and total load, which the end leaves
    guy = prepared(SPATIAL)
    length, h = Numbers(cp.make_scene(SPATIAL)).length, 1e-4
    tangent = np.empty((3, 3))
    for k in range(3):
        forces = []
        for sign in (1.0, -1.0):
            mapping = copy.deepcopy(SPATIAL) | {"motion": {}}
            mapping["cable"] = {key: value for key, value in GUY["cable"].items() if key != "top_tension"}
            mapping["cable"]["unstretched_length"] = length
            mapping["ends"]["upper"][k] += sign * h
            rest = cp.catenary.rest(cp.make_scene(mapping), points=2001)
            last = np.diff(rest.position.values[-3:], axis=0)
            direction = 1.5 * last[1] / np.linalg.norm(last[1]) - 0.5 * last[0] / np.linalg.norm(last[0])
            forces.append(rest.tension.values[-1] * direction / np.linalg.norm(direction))
        tangent[:, k] = (forces[0] - forces[1]) / (2 * h)
    assert np.abs(guy.stiffness - tangent).max() < 1e-5 * np.abs(tangent).max()
    compliance = np.linalg.inv(tangent)  # across the chord
    assert np.abs(np.linalg.inv(guy.stiffness) - compliance).max() < 1e-5 * np.abs(compliance).max()
    assert guy.stiffness == pytest.approx(guy.stiffness.T, rel=1e-12)


def test_slow_steps_feel_the_static_stiffness():
    # a slow ramp, strongly damped; 8 sines on 161 points leave 0.05 % of the compliance of the sag
    guy = prepared(
        {key: GUY[key] for key in ("cable", "ends")} | {"damping": {"mass_proportional": 8.0}}, 8, points=161
    )
    rest, before, small = guy.end_position, guy.force, np.array([2e-5, 1e-5])
    step, steps = 4e-3, 20000
    for k in range(1, steps + 1):
        s = k / steps
        guy.step(rest + small * s * s * (3 - 2 * s), small * 6 * s * (1 - s) / (steps * step), step)
    for _ in range(2000):
        force = guy.step(rest + small, np.zeros(2), step)
    expected = -guy.stiffness @ small
    assert np.linalg.norm(force - before - expected) < 2e-3 * np.linalg.norm(expected)


def test_dynamic_stiffness_is_that_of_davenport_and_steels():
    # k = (EA/c) / (1 + lambda^2/(2x)^2 (tan x / x - 1)), x = (c/2) sqrt((w^2 - i alpha w) mu/T); small harmonic motion along
    # the chord, damping 1 % of critical in the first mode.  Example 2's guy: strain 7e-4, sag 1/300.  At resonance a relative
    # error d of the frequency is one of d / 0.01 of the stiffness: 41 particles (d = 2.6e-4) would not do.
    omega = math.pi * math.sqrt(15000.0 / 1.0006) / 61.2
    damping = 0.02 * omega
    cable = GUY["cable"] | {"top_tension": 15000.0}
    mapping = {"cable": cable, "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]}}
    guy = prepared(mapping | {"damping": {"mass_proportional": damping}}, points=121)
    drive, resonance, scene = _driver(guy), [], cp.make_scene(mapping)
    for hertz in (0.1, 0.4, 0.7, 0.9, 0.97, 0.99, 1.0, 1.01, 1.03, 1.1, 1.3, 1.8):
        given, expected = drive(2.0 * math.pi * hertz), _davenport_steels(scene, 2.0 * math.pi * hertz, damping)
        assert abs(given - expected) < 0.01 * abs(expected), hertz
        resonance.append(abs(expected) / abs(_davenport_steels(scene, 1e-3, damping)))
    assert max(resonance) > 1.3 * min(resonance)  # the resonance is among them


def _davenport_steels(scene: xr.Dataset, omega: float, damping: float) -> complex:
    p, rest = Numbers(scene), cp.catenary.rest(scene)
    chord = float(np.linalg.norm(p.upper - p.lower))
    stretch = chord / p.length
    tension = 0.5 * float(rest.tension_lower + rest.tension_upper)
    transverse = -p.weight[1] / stretch * (p.upper - p.lower)[0] / chord
    irvine = (transverse * chord / tension) ** 2 * p.stiffness / tension
    x = 0.5 * chord * np.sqrt((omega**2 - 1j * damping * omega) * p.mass / stretch / tension)
    return complex(p.stiffness / chord / (1.0 + irvine / (2.0 * x) ** 2 * (np.tan(x) / x - 1.0)))


@cache
def compiled_host(kernel: Any, row: int) -> Any:
    """A compiled host in the plane: forces at the steps after the first; whether all were done."""

    @numba.njit
    def host(coefficients, accepted, trial, position, velocity, step, forces):
        unknown = np.empty(0)
        for k in range(1, len(position)):
            if kernel(coefficients, accepted, trial, position[k], velocity[k], unknown, step) != 0:
                return False
            accepted, trial = trial, accepted
            forces[k] = accepted[row, :2]
        return True

    return host


def _driver(guy: Any) -> Any:
    """Return the complex stiffness by a harmonic motion of the end along the chord."""
    host = compiled_host(guy.kernel, guy.FORCE_ROW)

    def stiffness(omega: float) -> complex:
        period = 2.0 * math.pi / omega
        per_period = max(round(period * 400.0), 400)
        step, settle = period / per_period, math.ceil(130.0 / period)  # e^-8 of the start is left
        phase = omega * step * np.arange((settle + 1) * per_period + 1)[:, None]
        forces, amplitude, rest = np.empty((len(phase), 2)), 1e-6, guy.end_position
        along = rest / np.linalg.norm(rest)
        position, velocity = rest + amplitude * np.sin(phase) * along, amplitude * omega * np.cos(phase) * along
        assert host(guy.coefficients, guy.state, guy.state, position, velocity, step, forces)
        force, last = ((forces - guy.force) @ along)[-per_period:], phase[-per_period:, 0]
        return -2.0 / per_period * complex(force @ np.sin(last), force @ np.cos(last)) / amplitude

    return stiffness


# --- trials, states, Datasets -------------------------------------------------------------------------------------------


def test_trial_twice_is_trial_once():
    position, velocity, _ = table(SPATIAL, 0.01)
    once, twice = prepared(SPATIAL), prepared(SPATIAL)
    for k in range(1, 40):
        before = twice.state
        twice.trial(position[k] + 0.01, velocity[k] - 0.3, 0.01)
        twice.trial(position[k], velocity[k], 0.02)
        first = twice.trial(position[k], velocity[k], 0.01)
        np.testing.assert_array_equal(twice.state, before)
        second = twice.trial(position[k], velocity[k], 0.01)
        np.testing.assert_array_equal(first, second)
        twice.accept()
        np.testing.assert_array_equal(once.step(position[k], velocity[k], 0.01), second)
        np.testing.assert_array_equal(once.force, twice.force)
    np.testing.assert_array_equal(once.state, twice.state)
    assert np.abs(once.force - prepared(SPATIAL).force).max() > 1.0


@pytest.mark.parametrize("name", SCENES)
def test_resume_goes_on_bit_by_bit(name, tmp_path):
    position, velocity, _ = table(SCENES[name], 0.01)
    guy = prepared(SCENES[name])
    for k in range(1, 30):
        guy.step(position[k], velocity[k], 0.01)
    dataset = guy.dataset()
    assert dataset.attrs["stage"] == "prepared model"
    assert "id" in dataset.attrs
    assert all("units" in variable.attrs for variable in dataset.variables.values())
    cp.archive.write(dataset, tmp_path / "guy.nc")
    again = cp.condensed.resume(cp.archive.read(tmp_path / "guy.nc"))
    assert again.time == guy.time
    for k in range(30, 60):
        np.testing.assert_array_equal(
            guy.step(position[k], velocity[k], 0.01), again.step(position[k], velocity[k], 0.01)
        )
    np.testing.assert_array_equal(guy.state, again.state)
    np.testing.assert_array_equal(guy.run().end_force, again.run().end_force)
    assert guy.dataset().attrs["id"] != dataset.attrs["id"]
    assert guy.dataset().attrs["id"] == again.dataset().attrs["id"]


def test_a_compiled_host_gives_the_bits_of_one_in_python():
    position, velocity, _ = table(GUY, 0.01)
    guy = prepared(GUY)
    forces, accepted, trial = np.empty((201, 2)), guy.state, guy.state
    host = compiled_host(guy.kernel, guy.FORCE_ROW)
    assert host(guy.coefficients, accepted, trial, position[:201], velocity[:201], 0.01, forces)
    given = [guy.step(position[k], velocity[k], 0.01) for k in range(1, 201)]
    np.testing.assert_array_equal(forces[1:], given)
    other = prepared(GUY)
    other.state = accepted  # 200 steps: the arrays have changed places an even number of times
    np.testing.assert_array_equal(other.force, guy.force)


# --- runs ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENES)
def test_run_is_simulate(name):
    mapping, dims = SCENES[name], len(SCENES[name]["ends"]["upper"])
    outputs, times = ("position", "tension"), np.array([0.0, 0.3333, 1.27, 7.77])  # also between the steps
    for options in ({}, {"times": times}, {"links": [1, 7, 40]}):
        truth = cp.condensed.simulate(cp.make_scene(mapping), sines(4, dims), step=0.01, outputs=outputs, **options)
        run = prepared(mapping, step=0.01).run(outputs=(*outputs, "end_force"), **options)
        scale = float(np.ptp(truth.position.values, axis=0).max())
        np.testing.assert_allclose(run.time, truth.time)
        assert np.abs(run.position - truth.position.values).max() < 1e-9 * scale
        assert np.abs(run.tension - truth.tension.values).max() < 1e-9 * truth.tension.values.max()
        assert np.abs(run.amplitude - truth.amplitude.values).max() < 1e-9 * scale
        assert run.end_force.shape == (truth.time.size, dims)
        assert run.smallest_chordwise_force == pytest.approx(truth.attrs["smallest_chordwise_force"], rel=1e-9)


def test_a_run_does_not_go_beyond_the_records_of_its_motions(tmp_path):
    (tmp_path / "sway.csv").write_text(
        "time,value\n" + "".join(f"{k / 10},{1e-3 * math.sin(k / 10)}\n" for k in range(81))
    )
    mapping = {**GUY, "motion": {"upper": {"x": {"kind": "file", "path": str(tmp_path / "sway.csv")}}}}
    guy = prepared(mapping, step=0.01)
    assert guy.run(times=[8.0]).end_force.shape == (1, 2)
    with pytest.raises(cp.SceneError, match=r"8"):
        guy.run(times=[9.0])


def test_runs_leave_the_state_of_the_steps():
    guy = prepared(GUY)
    position, velocity, _ = (rows[0] for rows in motion(GUY, [0.01]))
    guy.step(position, velocity, 0.01)
    before = guy.state
    run = guy.run()
    np.testing.assert_array_equal(guy.state, before)
    guy.step(position, velocity, 0.01)
    for again in (guy.run(), prepared(GUY).run()):  # whatever was called before
        np.testing.assert_array_equal(again.end_force, run.end_force)
        np.testing.assert_array_equal(again.amplitude, run.amplitude)


def test_position_and_tension_of_a_state():
    guy = prepared(GUY)
    rest = cp.condensed.simulate(cp.make_scene(GUY), sines(4), step=0.01, outputs=("position", "tension"))
    assert np.abs(guy.position - rest.position.values[0]).max() < 1e-6
    assert guy.tension == pytest.approx(rest.tension.values[0], rel=1e-5)  # the scene's end accelerates at the start


# --- page ---------------------------------------------------------------------------------------------------------------


def test_the_host_of_the_page_runs():
    text = (Path(cp.__file__).parent / "condensed" / "HOST.md").read_text()
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(block, names)  # the page's own lines
    times, displacement = names["times"], names["displacement"]
    assert len(times) == len(displacement)
    # the mass swings with the spring, and the guy's static stiffness and mass within 2 %
    turns = np.flatnonzero(np.diff(np.sign(displacement - displacement.mean())) > 0)
    period = float(np.diff(times[turns]).mean())
    assert period == pytest.approx(names["expected_period"], rel=0.02)


def test_a_steady_wind_does_not_end_with_its_ramp():
    tables = {
        "cable": {"axial_stiffness": 2e7, "mass_per_length": 1.0, "top_tension": 15e3, "diameter": 0.016},
        "ends": {"lower": [0.0, 0.0], "upper": [20.0, 50.0]},
        "wind": {"speed": 25.0, "direction": [1.0, 0.0], "ramp": 0.2},
        "chain": {"links": 20},
        "damping": {"mass_proportional": 0.5},
    }
    scene = cp.make_scene(tables)
    guy = cp.condensed.prepare(scene, cp.condensed.vibration_modes(scene, rank=2, static_modes=True))
    for _ in range(400):
        guy.step(guy.end_position, [0.0, 0.0], 1e-3)
    assert guy.time == pytest.approx(0.4)
