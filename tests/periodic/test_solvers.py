"""Solvers of periodic responses alone: two of them, derivatives, Magnus' scheme, work, events, interrupts."""

from __future__ import annotations

import numpy as np
import pytest
from periodic_scenes import guy, loaded, tension_damped
from scipy.linalg import expm

import cablepod as cp
from cablepod.periodic import _fields as fields
from cablepod.periodic._continuation import zero_between
from cablepod.periodic._events import Signs, can_be_told_apart
from cablepod.periodic._general import GeneralSolver, exponentials, magnus
from cablepod.periodic._members import model_of
from cablepod.periodic._orbit import find
from cablepod.periodic._solve import Solver


def solved(scene, order="leading", solver=GeneralSolver, harmonics=12):
    modes = cp.condensed.vibration_modes(scene, rank=3)
    model, omega = model_of(scene, modes, rank=None, order=order, out_of_plane=True)
    solver = solver(model)
    return solver, find(solver, omega / model.scales[0], 1, harmonics, None)


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


@pytest.mark.parametrize("order", ["leading", "exact"])
def test_the_product_of_all_multipliers_with_damping_by_the_tension(order):
    solver, state = solved(tension_damped(2e-3), order)
    full = state.full(solver.model)
    damping = solver._forces(full, 4096).damping
    along = np.trace(damping, axis1=1, axis2=2)
    assert np.ptp(along) > 1e-3 * along.mean()  # it varies over the period
    exponent = (along.mean() + full.size * solver.model.damping) * 2.0 * np.pi / state.omega
    assert np.prod(solver.stability(state).multipliers).real == pytest.approx(np.exp(-exponent), rel=1e-9)


@pytest.mark.parametrize(("omega", "amplitude"), [(6.1, 0.003), (12.6, 0.002)])
def test_the_work_of_ends_and_loads_is_dissipated(omega, amplitude):
    scene = guy(angular_frequency=omega, amplitude=amplitude)
    solver, state = solved(scene, solver=Solver, harmonics=24)
    model, count = solver.model, 4096
    z, a, condensed = state.omega, model.damping, model.condensed
    rows = np.tensordot((1.0, z, z * z), model.rows(count, 1), 1)
    chord, loads, normals = np.split(rows, [1, 1 + len(condensed.load_patterns)], axis=1)
    # stiffness and load without deflection, in SI units over the square of the frequency
    tension = model.condensed.chain.p.stiffness * (chord[:, 0] / condensed.chain.total_length - 1.0)
    tension = tension - loads @ condensed.mean_chordwise_forces
    stiffness = tension[:, None, None] * np.diag(model.kappa_si) + np.tensordot(loads, model.geometric_stiffness, 1)
    stiffness, load = stiffness / model.scales[0] ** 2, normals @ model.load_projection / model.scales[0] ** 2
    q = fields.coordinates(model, state, count) / model.scales[1]
    load = load / model.scales[1]

    def rate(values):
        spectrum = np.fft.rfft(values, axis=0)
        number = np.arange(len(spectrum)).reshape(-1, *[1] * (values.ndim - 1))
        return np.fft.irfft(1j * number * spectrum, count, axis=0)

    velocity = z * rate(q)
    work = 0.5 * np.einsum("ti,tij,tj->t", q, rate(stiffness), q) - (rate(load) * q).sum(axis=1)
    dissipated = a / z * (velocity**2).sum(axis=1)
    assert work.mean() == pytest.approx(dissipated.mean(), rel=1e-6)


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


def test_a_zero_between_two_points_is_no_jump():
    def between(low, high, share):
        return low + share * (high - low)

    def beside(low, high, share):
        """No point at the zero, where the Jacobian is singular."""
        x = between(low, high, share)
        return None if abs(x**3 - 10.0) < 1e-6 else x

    share, point = zero_between((1.0, 3.0), between, lambda x: x**3 - 10.0, 1e-14)
    assert point == pytest.approx(10.0 ** (1.0 / 3.0), rel=1e-13)
    assert share == pytest.approx(0.5 * (point - 1.0), rel=1e-13)
    found = zero_between((1.0, 3.0), beside, lambda x: x**3 - 10.0, 1e-14)
    assert found is not None
    assert abs(found[1] ** 3 - 10.0) < 1e-3 * 17.0  # of the larger end
    # two pairs that meet on a circle within that of one, and leave it, as the square root
    assert zero_between((0.0, 1.0), between, lambda x: 0.1 * max(x - 0.3, 0.0) ** 0.5 - 0.004, 1e-12) is not None
    assert zero_between((1.0, 3.0), between, lambda x: x, 1e-14) is None
    assert zero_between((1.0, 3.0), between, lambda x: 1.0 / (x - 1.7), 1e-14) is None
    assert zero_between((1.0, 3.0), lambda *_: None, lambda x: x - 1.7, 1e-14) is None
    assert zero_between((1.0, 3.0), between, lambda x: x - 1.7 if x in (1.0, 3.0) else np.nan, 1e-14) is None


def test_a_complex_pair_that_becomes_real_outside_of_the_circle_is_no_crossing():
    def outside(above, below, pairs):
        return Signs(np.ones(1), np.ones(1), np.array([pairs]), np.array([[above, below]]))

    pair = outside(0, 0, 1)
    assert can_be_told_apart(pair, outside(2, 0, 0))
    assert can_be_told_apart(outside(0, 2, 0), pair)
    assert can_be_told_apart(pair, outside(1, 0, 1))
    assert not can_be_told_apart(pair, outside(2, 0, 1))  # two real ones crossed
    assert not can_be_told_apart(pair, outside(0, 0, 1)._replace(real_outside=np.array([[0, 2]])))


def test_an_interrupt_while_errors_are_estimated_keeps_the_branches(monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    scene = loaded(0.6, 7.0, 0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    monkeypatch.setattr("cablepod.periodic._estimate.bifurcation_errors", stop)
    with pytest.raises(cp.RunStopped, match="interrupted") as caught:
        cp.periodic.frequency_response(scene, modes, frequency=(6.5, 11.0), points=20, outputs=("error_estimate",))
    assert caught.value.partial.sizes["point"] == 20
    assert "bifurcation_error_estimate" not in caught.value.partial


def test_an_interrupt_before_the_first_point_is_one(monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    scene = loaded(0.6, 7.0, 0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    monkeypatch.setattr("cablepod.periodic._frequency_response.grown_from_rest", stop)
    with pytest.raises(KeyboardInterrupt):
        cp.periodic.frequency_response(scene, modes, frequency=(6.5, 11.0))
