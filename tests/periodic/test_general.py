"""Order "exact" and damping by the tension: the compiled solver, time integration, identities."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from periodic_scenes import GUY, guy, loaded, multipliers
from scipy.linalg import expm
from suite import slow

import cablepod as cp
from cablepod.periodic._general import GeneralSolver, exponentials, magnus
from cablepod.periodic._members import model_of
from cablepod.periodic._orbit import find
from cablepod.periodic._solve import Solver


def tension_damped(beta, omega=12.6, amplitude=0.003, alpha=0.03):
    mapping = copy.deepcopy(GUY)
    mapping["damping"] = {"tension_proportional": beta, "mass_proportional": alpha}
    mapping["motion"]["upper"]["x"] |= {"angular_frequency": omega, "amplitude": amplitude}
    return cp.make_scene(mapping)


def solved(scene, order="leading", solver=GeneralSolver, rank=3):
    modes = cp.condensed.vibration_modes(scene, rank=rank)
    model, omega = model_of(scene, modes, rank=None, order=order, out_of_plane=True)
    solver = solver(model)
    return solver, find(solver, omega / model.scales[0], 1, 12, None)


def test_both_solvers_have_the_same_orbit_and_multipliers():
    scene = guy(angular_frequency=12.6)
    compiled, general = solved(scene, solver=Solver), solved(scene)
    assert np.abs(compiled[1].z - general[1].z).max() < 1e-12
    mu, other = (np.sort_complex(solver.stability(state).multipliers) for solver, state in (compiled, general))
    assert np.abs(mu - other).max() < 1e-12
    forces = [solver.stability(state).smallest_force for solver, state in (compiled, general)]
    assert forces[1] == pytest.approx(forces[0], rel=1e-12)


@pytest.mark.parametrize("kind", ["exact", "tension", "exact, tension"])
def test_derivatives_are_those_of_differences(kind):
    scene = tension_damped(1e-3) if "tension" in kind else guy(angular_frequency=12.6)
    solver, state = solved(scene, "leading" if kind == "tension" else "exact")
    state = state.full(solver.model)
    z = state.z + 1e-3 * np.random.default_rng(0).normal(size=state.z.size)
    z[-1] = state.z[-1]

    def at(z):
        return solver._balance(state.changed(z[:-1].reshape(-1, state.size), z[-1]))

    _, rate, jacobian = at(z)
    for k in (0, 4, z.size - 2, z.size - 1):
        change = np.zeros_like(z)
        change[k] = 1e-6
        difference = (at(z + change)[0] - at(z - change)[0]) / 2e-6
        column = rate if k == z.size - 1 else jacobian[:, k]
        # central differences: 1e-12 of the curvature, and rounding 1e-10; the closure is solved to 1e-10 of the tension
        assert np.abs(difference - column).max() < 2e-7 * max(1.0, np.abs(column).max())


@pytest.mark.filterwarnings("ignore::cablepod.NotConvergedWarning")
@pytest.mark.parametrize("kind", ["exact", "tension", slow("exact, tension")])
def test_the_model_settles_on_the_orbit(kind):
    omega, order = 6.2, "leading" if kind == "tension" else "exact"
    scene = guy(angular_frequency=omega, damping=0.5, amplitude=0.02)
    if "tension" in kind:
        scene = tension_damped(5e-3, omega, 0.02, 0.5)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    orbit = cp.periodic.orbit(scene, modes, order=order, outputs=("tension",))
    assert orbit.stable
    assert orbit.attrs["order"] == order
    scene = scene.assign(time_duration=2.0 * np.pi / omega)  # the constants of a period
    first = round(np.ceil(2.0 * np.log(1e6) / 0.5 / (2.0 * np.pi / omega)))
    times = 2.0 * np.pi / omega * (first + np.arange(32) / 32)
    runs = [
        cp.condensed.simulate(
            scene, modes, order=order, times=times, step=2.0 * np.pi / omega / steps, outputs=("tension",),
            scheme="velocity_verlet",
        )
        for steps in (128, 256)
    ]  # fmt: skip
    for name in ("amplitude", "tension"):
        coarse, fine = (run[name].values for run in runs)
        settled, found = fine + (fine - coarse) / 3.0, orbit[name].values[:-1:4]  # order two
        assert np.abs(found - settled).max() < 1e-4 * np.ptp(settled, axis=0).max()


@pytest.mark.parametrize("order", ["leading", "exact"])
def test_the_product_of_all_multipliers_with_damping_by_the_tension(order):
    solver, state = solved(tension_damped(2e-3), order)
    full = state.full(solver.model)
    damping = solver._forces(full, 4096).damping
    along = np.trace(damping, axis1=1, axis2=2)
    assert np.ptp(along) > 1e-3 * along.mean()  # it varies over the period
    exponent = (along.mean() + full.size * solver.model.damping) * 2.0 * np.pi / state.omega
    assert np.prod(solver.stability(state).multipliers).real == pytest.approx(np.exp(-exponent), rel=1e-9)


def test_small_vibrations_have_the_damping_ratio_of_the_tension():
    beta = 2e-3
    mapping = copy.deepcopy(GUY)
    mapping["gravity"] = 0.0
    mapping["cable"]["density"] = mapping["cable"].pop("specific_weight") / 9.81
    mapping["damping"] = {"tension_proportional": beta}
    mapping["motion"]["upper"]["x"] |= {"amplitude": 1e-9, "angular_frequency": 5.0}
    scene = cp.make_scene(mapping)
    modes = cp.condensed.vibration_modes(scene, rank=3)
    mu = multipliers(cp.periodic.orbit(scene, modes, outputs=()))
    decay = np.sort(-np.log(np.abs(mu)) / (2.0 * np.pi / 5.0))
    omega = modes.angular_frequency.values
    # a taut string: zeta = beta omega / 2, in the plane and out of it; the tension varies by 1e-7
    assert decay == pytest.approx(np.repeat(0.5 * beta * omega**2, 4), rel=1e-6)


@pytest.mark.parametrize("order", ["leading", "exact"])
@pytest.mark.parametrize("planar", [False, True])
def test_small_vibrations_have_the_damping_ratios(order, planar):
    ratios = [0.01, 0.05, 0.02]
    mapping = copy.deepcopy(GUY)
    mapping["damping"] = {"ratios": ratios}
    mapping["motion"]["upper"]["x"] |= {"amplitude": 1e-9, "angular_frequency": 5.0}
    if not planar:
        mapping["ends"] = {name: [*place[:2], 0.0] for name, place in mapping["ends"].items()}
    scene = cp.make_scene(mapping)
    modes = cp.condensed.vibration_modes(scene, rank=3)
    mu = multipliers(cp.periodic.orbit(scene, modes, order=order, outputs=(), out_of_plane=not planar))
    decay = np.sort(-np.log(np.abs(mu)) / (2.0 * np.pi / 5.0))[::2]
    model, _ = model_of(scene, modes, rank=None, order=order, out_of_plane=not planar)
    omega = np.sqrt(np.linalg.eigvalsh(model.tangent_at_rest))
    expected = np.array([0.01, 0.05, 0.02, 0.02, 0.02, 0.02])[: omega.size] * omega
    assert decay == pytest.approx(np.sort(expected), rel=1e-6 if order == "leading" else 0.02)


def test_an_orbit_with_damping_ratios_is_the_motion_in_the_end():
    mapping = copy.deepcopy(GUY)
    mapping["damping"] = {"ratio": 0.05}
    mapping["motion"]["upper"]["x"] |= {"amplitude": 0.003, "angular_frequency": 12.6}
    mapping["time"] = {"duration": 20.0, "interval": 0.5}
    scene = cp.make_scene(mapping)
    modes = cp.condensed.vibration_modes(scene, rank=3)
    orbit = cp.periodic.orbit(scene, modes, outputs=("position",))
    period = 2.0 * np.pi / 12.6
    times = 39 * period + orbit.time.values
    run = cp.condensed.simulate(scene, modes, times=times, step=5e-4)
    moved = run.position.values - orbit.position.values
    motion = np.ptp(orbit.position.values, axis=0).max()
    assert np.abs(moved).max() < 2e-3 * motion


def test_the_scheme_of_magnus_is_of_fourth_order():
    rng = np.random.default_rng(2)
    a, b, c, d = rng.normal(size=(4, 3, 3))

    def matrix(phases):
        angle = 2.0 * np.pi / phases * np.arange(phases)[:, None, None]
        return magnus(
            8.0 * np.eye(3) + a * np.cos(angle) + b,
            0.2 * np.eye(3) + 0.1 * (c * np.sin(angle) + d),
            4.0 * np.pi / phases,
            3.0,
        )

    best = matrix(4096)
    errors = [np.abs(matrix(phases) - best).max() for phases in (64, 128, 256)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.4)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.2)
    some = 5.0 * rng.normal(size=(4, 6, 6))
    for given, found in zip(some, exponentials(some), strict=True):
        assert np.abs(found - expm(given)).max() < 1e-12 * np.abs(expm(given)).max()


def test_branches_of_order_exact_are_near_those_of_order_leading():
    scene = loaded(0.6, 7.0, 0.05)
    modes = cp.condensed.vibration_modes(scene, rank=1)
    found = [
        cp.periodic.frequency_response(
            scene, modes, frequency=(6.5, 11.0), order=order, follow=(), out_of_plane=False, outputs=()
        )
        for order in ("leading", "exact")
    ]
    leading, exact = (part.bifurcation_angular_frequency.values for part in found)
    assert leading.size == exact.size > 0
    # a string without sag: terms of second order in slopes of some per cent
    assert exact == pytest.approx(leading, rel=2e-3)
    assert not np.allclose(exact, leading, rtol=1e-9)
