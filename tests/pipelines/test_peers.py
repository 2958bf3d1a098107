"""The comparison with other packages, in what needs none of them: system, error, fronts, and what is said of missing ones."""

from __future__ import annotations

import importlib.metadata
import sys

import numpy as np
import pytest
import xarray as xr
from benchmarks.peers import run as peers
from benchmarks.peers import solvers as peer_solvers
from benchmarks.peers import system as peer_system
from benchmarks.peers import things
from scenes import SOFT

import cablepod as cp


@pytest.fixture(scope="module")
def system():
    return peer_system.system_of(cp.make_scene(SOFT))


@pytest.fixture(scope="module")
def state(system):
    """A state far from rest, with some links slack and some taut."""
    return np.random.default_rng(1).normal(scale=0.03, size=4 * system.particles)


@pytest.mark.slow
def test_right_side_is_the_chains_forces(system, state):
    time, out = 0.7, np.empty(state.size)
    peer_system.rates_of(system)(time, state, out)
    position = system.positions(state[None], [time])[0]
    tension, force = system.chain.tensions_and_forces(position)
    assert 0 < np.count_nonzero(tension) < tension.size  # else nothing is seen of slack links
    parts = out.reshape(-1, 4)
    acceleration = (np.diff(force, axis=0) + system.chain.loads(time)[1:-1]) / system.mass[:, None]
    # rounding of the positions, ten metres, in links of 1.6e4 N/m on masses of about a kilogram: 1e-15 * 10 * 1e4 m/s2
    np.testing.assert_allclose(parts[:, :2], acceleration, rtol=1e-12, atol=1e-9)
    np.testing.assert_array_equal(parts[:, 2:], state.reshape(-1, 4)[:, :2])
    ends = system.chain.p.end_positions(np.array([time]))[0]
    np.testing.assert_allclose(position[[0, -1]], ends, rtol=1e-15)


@pytest.mark.slow
def test_jacobian_is_the_slope_of_the_right_side(system, state):
    rates, jacobian, size, time, h = (
        peer_system.rates_of(system), peer_system.jacobian_of(system), state.size, 0.7, 1e-6,
    )  # fmt: skip
    slopes, both = np.empty((size, size)), np.empty((2, size))
    for column in range(size):
        for sign, out in zip((1.0, -1.0), both, strict=True):
            moved = state.copy()
            moved[column] += sign * h
            rates(time, moved, out)
        slopes[:, column] = (both[0] - both[1]) / (2.0 * h)
    full = np.full((size, size), np.nan)
    jacobian(time, state, full, False)
    # central differences: rounding of the right side, 1e-9 m/s2, over 2e-6 m; entries are up to 3e4
    np.testing.assert_allclose(full, slopes, rtol=1e-6, atol=2e-3)
    packed = np.full((peer_system.ABOVE + 1 + peer_system.BELOW, size), np.nan)
    jacobian(time, state, packed, True)
    unpacked = np.zeros((size, size))
    for row, column in zip(*np.nonzero(full), strict=True):
        unpacked[row, column] = packed[row - column + peer_system.ABOVE, column]
    np.testing.assert_array_equal(unpacked, full)
    assert np.count_nonzero(packed) == np.count_nonzero(full)


@pytest.mark.slow
def test_check_agrees_with_the_chain(system):
    times = np.array([0.0, 0.5, 1.0])
    ours = cp.chain.simulate(cp.make_scene(SOFT), times=times, scheme="velocity_verlet", step=1e-5)["position"].values
    other = peer_system.check_of(system, times, 1e-3)
    scale = peer_system.largest_displacement(ours)
    # second order: (omega h)^2 / 24 = (300 * 1e-5)^2 / 24 = 4e-7 of the part that vibrates, which is a small one
    assert peer_system.error_of(other, ours, scale).max() < 1e-7
    assert scale > 0.01


def test_error_is_the_largest_distance():
    truth = np.zeros((2, 3, 2))
    truth[1, 2] = [3.0, 4.0]
    other = truth.copy()
    other[1, 1] = [0.3, -0.4]
    other[1, 2, 0] += 0.2
    assert peer_system.largest_displacement(truth) == 5.0
    np.testing.assert_allclose(peer_system.error_of(other, truth, 5.0), [0.0, 0.1], rtol=1e-14)


@pytest.mark.parametrize(
    "change",
    [
        {"motion": {}},
        {"motion": {"upper": {"x": {"kind": "ramp", "amplitude": 0.1, "duration": 1.0}}}},
        {"damping": {"mass_proportional": 0.1}},
        {"load": {"uniform": [1.0, 0.0]}},
        {"point_load": [{"arc_length": 0.5, "force": [1.0, 0.0]}]},
    ],
    ids=lambda change: next(iter(change)),
)
def test_scene_that_not_all_can_do_is_refused(change):
    with pytest.raises(ValueError, match="allowed"):
        peer_system.system_of(cp.make_scene({**SOFT, **change}))


def test_front_keeps_what_nothing_beats():
    error, seconds = np.array([1e-2, 1e-4, 1e-3, 1e-6, np.nan]), np.array([1.0, 10.0, 20.0, 100.0, 0.1])
    best = peers.front(error, seconds)
    np.testing.assert_array_equal(best, [[1e-6, 1e-4, 1e-2], [100.0, 10.0, 1.0]])
    assert peers.time_at(1e-5, *best) == pytest.approx(10.0**1.5, rel=1e-12)  # halfway in logarithms
    assert peers.time_at(1.0, *best) == pytest.approx(1.0, rel=1e-12)
    assert np.isnan(peers.time_at(1e-7, *best))


def test_time_at_an_error_is_that_of_the_fastest_method():
    table = xr.Dataset(
        {"error": ("case", [1e-2, 1e-4, 1e-2, 1e-4]), "stepping": ("case", [1.0, 100.0, 2.0, 4.0])},
        coords={"package": ("case", ["a"] * 4), "method": ("case", ["x", "x", "y", "y"])},
    )
    # the front of both together, from 1.0 to 4.0, would say 2.0 at the middle, which no method reaches
    assert peers.package_time(table, "a", 1e-3) == pytest.approx(8.0**0.5, rel=1e-12)
    assert peers.package_time(table, "a", 1e-2) == pytest.approx(1.0, rel=1e-12)
    assert np.isnan(peers.package_time(table, "b", 1e-3))


def test_our_time_is_that_of_the_kernel(monkeypatch):
    monkeypatch.setattr(peers, "TIMES", np.array([0.0, 1.0]))
    position, seconds = peers.ours(cp.make_scene(SOFT), "trapezoidal", 0.1)
    assert position.shape == (2, 9, 2)
    assert seconds > 0.0


def test_missing_packages_are_said(monkeypatch):
    def nothing(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", nothing)
    for module in ("sksundae", "exudyn", "moordyn"):
        monkeypatch.setitem(sys.modules, module, None)  # an import of it fails
    found = peer_solvers.versions()
    assert found == dict.fromkeys(("scikit-sundae", "SciPy", "Exudyn", "MoorDyn"))
    assert {case.package for case in peer_solvers.cases()} == set(found)
    lines = peers.table_lines(table_of_one(missing=", ".join(found)))
    for name in found:
        assert any(line.startswith(f"{name}: not installed") for line in lines), name


def test_failure_of_a_package_is_said():
    def fails(system, times):
        raise RuntimeError("it broke\nfor a reason")

    into = peers.Measured()
    peers.once(peers.Case("Exudyn", "any", "1 s", fails), None, None, 1.0, into)
    assert into.failure == "RuntimeError: it broke"
    assert not into.stepping
    assert any("it broke" in line for line in peers.table_lines(table_of_one(failure=into.failure)))


def table_of_one(missing="", failure=""):
    """A table with our case and one of another package."""
    dims = ("example", "case")
    numbers = {
        "error": [1e-5, 1e-5], "error_worst": [1e-5, 2e-5], "stepping": [0.01, 0.1], "whole": [0.02, 0.2], "repeats": [5, 5],
    }  # fmt: skip
    return xr.Dataset(
        {
            **{name: (dims, [values]) for name, values in numbers.items()},
            "failure": (dims, np.array([["", failure]])),
            "check_distance": ("example", [1e-12]),
            "displacement_scale": ("example", [0.3]),
        },
        coords={
            "example": ["example2"],
            "package": ("case", ["cablepod", "Exudyn"]),
            "method": ("case", ["trapezoidal", "trapezoidal"]),
            "setting": ("case", ["0.1 s", "0.1 s"]),
        },
        attrs={"versions": "none", "machine": "any", "missing": missing},
    )  # fmt: skip


# --- things on the cable ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", things.SCENES)
def test_links_with_things_are_those_of_the_chain(kind):
    chain = cp.chain.rest(things.scene(kind, 20))
    own = things.hanging(kind, chain.position.values)
    if kind != "damper":  # of equal masses a result has none
        np.testing.assert_allclose(own.mass[1:-1], chain.particle_mass.values[1:-1], rtol=1e-13)
    np.testing.assert_allclose(own.tension(chain.position.values[None]), chain.tension.values[-1:], rtol=1e-9)
    # rest: the links of each particle carry its weight
    reach = np.diff(own.start, axis=0)
    size = np.linalg.norm(reach, axis=1)
    pull = (own.stiffness * (size * own.links / things.LENGTH - 1.0) / size)[:, None] * reach
    weight = things.GRAVITY * own.mass[1:-1, None] * [0.0, 1.0]
    np.testing.assert_allclose(np.diff(pull, axis=0), weight, atol=1e-8 * np.abs(pull).max())


def test_end_of_the_things_moves_as_in_the_scene():
    times = np.linspace(0.0, things.END, 41)
    run = cp.chain.simulate(things.scene("two segments", 5), times=times, step=1e-3)
    np.testing.assert_allclose(run.position.values[:, -1, 0], things.SPAN + things.upper(times), rtol=1e-14)


def test_links_that_do_not_end_at_the_place_are_refused():
    with pytest.raises(ValueError, match="links: given 7; allowed: a multiple of 5"):
        things.hanging("clump weight", np.zeros((8, 2)))


@pytest.mark.slow
@pytest.mark.parametrize(("module", "name"), [("moordyn", "MoorDyn"), ("openseespy.opensees", "OpenSees")])
@pytest.mark.parametrize("kind", things.SCENES)
def test_things_move_as_in_other_packages(kind, module, name):
    pytest.importorskip(module)
    if (name, kind) == ("MoorDyn", "damper"):
        pytest.skip("MoorDyn has no damper to the ground")
    chain, cable = things.runs(kind, 20)
    given = things.hanging(kind, chain.position.values[0])
    with peer_solvers.quiet():
        position = things.PROGRAMS[name](given)
    found = things.differences(chain, position, given.tension(position))
    # the end of MoorDyn moves by steps of 1 ms, Newmark's step is 2.5 ms: (1.5 * 2.5e-3)^2 / 12 of the slow motion, more of waves
    assert found[0] < 1e-4
    assert found[1] < 2e-3
    assert things.differences(cable, position, given.tension(position))[0] > 100.0 * found[0]
