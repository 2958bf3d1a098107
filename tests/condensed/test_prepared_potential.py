"""Prepared models and the potential of the cable: energy of host and guy, end force as its gradient."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from host_scenes import GUY, SCENES, prepared

from cablepod.condensed import _kernels_layout as layout
from cablepod.discretisation._chord_frame import ChordFrame


def test_energy_of_host_and_guy():
    # a mass on a rail along the chord, with a spring, kicked; without chordwise acceleration of the cable the coupled scheme is
    # symplectic: the energy swings with the square of the step and does not drift
    swings = []
    for step in (2e-3, 1e-3):
        energy, exchanged = _energies(step)
        swings.append(np.ptp(energy))
        assert np.ptp(exchanged) > 20.0
        assert abs(energy[-500:].mean() - energy[:500].mean()) < 1e-4 * np.ptp(exchanged)
    assert swings[1] < 1e-3 * np.ptp(exchanged)
    assert swings[0] / swings[1] == pytest.approx(4.0, abs=0.1)


def _energies(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Total energy, and that of the host, at the steps of a closed loop [J]."""
    guy = prepared({key: GUY[key] for key in ("cable", "ends")})
    model, rest, coefficients = guy._model, guy.end_position, guy.coefficients
    along, mass, spring = rest / np.linalg.norm(rest), 300.0, 2.0e5
    chain, moments, balance = model.chain, coefficients.by_coordinate[layout.MOMENTS], guy.force
    second_moment = chain.p.mass * coefficients.numbers[layout.SECOND_MOMENT]
    end_mass = along @ guy.mass @ along
    s, force, energies, host = 0.0, balance, [], []
    half = 0.5  # velocity at the start [m/s]
    half += 0.5 * step * ((force - balance) @ along) / (mass + end_mass)
    for _ in range(round(3.0 / step)):
        s += step * half
        # no inertia of the guy along itself: as for a host that gives no acceleration
        force = guy.step(rest + s * along, half * along, step, np.zeros(2))
        acceleration = ((force - balance) @ along - spring * s) / (mass + end_mass)
        velocity = half + 0.5 * step * acceleration
        state, r = guy.state, len(model.shapes)
        rates = (
            state[layout.RATES, :r] + 0.5 * step * state[layout.UNDAMPED, :r]
        )  # the normal velocity of the end is zero
        potential = _potential(model, state[layout.Q, :r], state[layout.BOUNDARY])
        kinetic = 0.5 * rates @ rates + 0.5 * end_mass * velocity**2
        host.append(0.5 * mass * velocity**2 + 0.5 * spring * s * s)
        energies.append(host[-1] + (balance @ along) * s + kinetic + potential)
        half += step * acceleration
    assert second_moment > 0.0
    assert np.abs(moments).max() > 0.0
    return np.array(energies), np.array(host)


def _potential(model: Any, q: np.ndarray, row: np.ndarray) -> float:
    """Potential of the cable: strain energy of N, uniform loads along and across the chord."""
    chain, k, length = model.chain, model.chain.p.stiffness, model.chain.length
    slopes, tau = [q[which] @ model.slopes[which] for which in model.sets], row[1] * model.chordwise_force_patterns[0]
    squared = model.slope_factor * sum(slope**2 for slope in slopes)  # with the terms of second order
    strain = row[0] / chain.total_length - 1.0 + 0.5 * (squared @ length) / chain.total_length
    force = k * strain - (tau @ length) / chain.total_length + tau
    zeta = np.concatenate([[0.0], np.cumsum(length * (1.0 + force / k - 0.5 * squared))])
    loads = 1 + layout.PATTERNS + np.arange(len(model.load_projection))
    across = row[loads] @ model.load_projection @ q
    return float(0.5 * force**2 @ length / k + row[1] * (chain.tributary_length @ zeta) - across)


def _potential_at(model: Any, q: np.ndarray, upper: np.ndarray) -> float:
    """Potential of the cable, loads included, with its upper end at rest at another place [J]."""
    p = model.chain.p
    ends, still = np.stack([p.lower, upper]), np.zeros((2 * p.dims, 1))
    row = model._project_loads(np.ascontiguousarray(ends.reshape(-1, 1)), still, np.zeros(1), 0, 0.0)
    return _potential(model, q, row[0])


@pytest.mark.parametrize("name", SCENES)
def test_end_force_is_the_gradient_of_the_potential(name):
    # out of equilibrium, along and across the chord.  What stays are the coordinates of the absolute motion, q + m n.u with the
    # moments m, in which the kinetic energy has no term of q'.n.u': the force is then all potential.  In space the normals turn
    # about the chord too; the deflections, as absolute motion, do not.
    mapping = {key: value for key, value in SCENES[name].items() if key not in ("motion", "damping")}
    # a soft, sagging cable: the strain by the weight along the chord is 1e-2, and all terms of the force matter
    mapping["cable"] = mapping["cable"] | {"top_tension": 2500.0, "youngs_modulus": 1.6e8}
    guy = prepared(mapping)
    model, dims, moments = guy._model, len(guy.end_position), guy.coefficients.by_coordinate[layout.MOMENTS]
    r, kicked, upper = len(model.shapes), guy.state, guy.end_position + [0.02, -0.03, 0.01][: len(guy.end_position)]
    shares = np.array([0.3, 0.2, -0.2, 0.1])[np.arange(r) % 4]
    kicked[layout.Q, :r] += shares * np.abs(kicked[layout.Q, :r]).max()
    guy.state = kicked
    guy.step(upper, np.zeros(dims), 1e-5, np.zeros(dims))
    q, lower = guy.state[layout.Q, :r], model.chain.p.lower
    frame = ChordFrame.of((upper - lower)[None], model.reference)
    deflection = np.stack([q[which] @ model.shapes[which] for which in model.sets])

    def moved(shift: np.ndarray) -> float:
        turned = ChordFrame.of((upper + shift - lower)[None], model.reference).normals[0]
        turn = np.linalg.qr(turned @ frame.normals[0].T)[0] if dims == 3 else np.eye(1)
        turn = turn * np.sign(np.diag(turn))
        there = model.coordinates((turn @ deflection)[:, None])[0]
        for k, which in enumerate(model.sets):
            there[which] -= moments[which] * (frame.normals[0, k] @ shift)
        return _potential_at(model, there, upper + shift)

    assert np.abs(model.coordinates(deflection[:, None])[0] - q).max() < 1e-12 * np.abs(q).max()
    h = 1e-5
    gradient = np.array([(moved(shift) - moved(-shift)) / (2 * h) for shift in h * np.eye(dims)])
    # differences: h^2 of the third derivative, and rounding of some 1e4 J over h
    assert np.abs(guy.force + gradient).max() < 2e-6 * np.linalg.norm(guy.force)
    assert np.linalg.norm(guy.force - prepared(mapping).force) > 0.01 * np.linalg.norm(guy.force)
