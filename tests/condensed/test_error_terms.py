"""Parts of the error estimate alone: what the orders neglect, waves along the cable, the modes of the richer model."""

from __future__ import annotations

import math

import numpy as np
import pytest
from references.numbers import Numbers
from scenes import ORDERS, full_modes, spatial
from scipy.integrate import solve_ivp

import cablepod as cp
from cablepod.condensed import _estimate as estimate
from cablepod.condensed import _estimate_neglected as neglected_terms
from cablepod.condensed._assembly import model_of
from cablepod.condensed._error_coefficients import EXTRA_MODES, enriched_modes
from cablepod.condensed._error_equation import ErrorEquation
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.parameters._from_scene import parameters

ALPHA = 0.7


@pytest.mark.parametrize("dims", [2, 3])
def test_the_accelerations_by_the_rotation_of_the_chord_are_those_of_the_motion(soft, dims):
    mapping = {**soft, "damping": {"mass_proportional": ALPHA}}
    mapping["motion"] = {"upper": {"y": {"kind": "harmonic", "amplitude": 1.0, "angular_frequency": 2.0}}}
    mapping["motion"]["lower"] = {"x": {"kind": "one_minus_cosine", "amplitude": 0.5, "angular_frequency": 3.0}}
    if dims == 3:
        mapping = spatial(mapping)
        mapping["motion"]["upper"]["z"] = {"kind": "harmonic", "amplitude": 0.8, "angular_frequency": 2.5}
    scene = cp.make_scene({**mapping, "chain": {"links": 60}})
    p = Numbers(scene)
    modes = cp.condensed.vibration_modes(scene, rank=3)
    model = model_of(parameters(scene), modes, rank=None, law="linear", order="inertial")
    equation = ErrorEquation.of(model.chain, model.modes, model.shapes, model.n_in_plane, leading=False)
    neglected = neglected_terms.Neglected(model, equation)
    r, rng = len(model.shapes), np.random.default_rng(3)
    amplitude, frequency = rng.normal(0.0, 3.0, r), rng.uniform(1.0, 5.0, r)

    def coordinates(times, derivative=0):
        turned = times[:, None] * frequency + 0.5 * np.pi * derivative
        return amplitude * frequency**derivative * np.sin(turned)

    def position(times):
        """Position less the line between the ends, and the axes of the frame."""
        ends = p.end_positions(times)
        frame, q = ChordFrame.of(ends[:, 1] - ends[:, 0], model.reference), coordinates(times)
        eta = neglected.chordwise(q, q, q)[0] @ neglected._sines
        deflection = [q[:, rows] @ model.shapes[rows] for rows in model.sets]
        return eta[:, :, None] * frame.along[:, None] + sum(
            w[:, :, None] * frame.normals[:, k, None] for k, w in enumerate(deflection)
        )

    times, h = np.linspace(0.3, 2.3, 41), 1e-3
    before, now, after = position(times - h), position(times), position(times + h)
    acceleration = (after - 2.0 * now + before) / h**2 + ALPHA * (after - before) / (2.0 * h)
    motion = tuple(coordinates(times, derivative) for derivative in range(3))
    eta, eta_rate, eta_acceleration = neglected.chordwise(*motion)
    forces, along = neglected.of_rotation(motion, eta, eta_rate, times)
    frame = ChordFrame.of(np.diff(p.end_positions(times), axis=1)[:, 0], model.reference)
    chain = model.chain
    onto = 2.0 / chain.total_length * chain.tributary_length * neglected._sines
    chordwise = np.einsum("tpc,tc->tp", acceleration, frame.along) @ onto.T
    expected = chordwise - eta_acceleration - ALPHA * eta_rate
    inner = np.abs(times - 1.3) < 0.9  # the frames are differentiated within the samples
    assert along[inner] == pytest.approx(expected[inner], abs=2e-3 * np.abs(expected).max())
    for k, target in enumerate(neglected._enriched):
        across = np.einsum("tpc,tc->tp", acceleration, frame.normals[:, k])
        rows = model.sets[k]
        across -= (motion[2][:, rows] + ALPHA * motion[1][:, rows]) @ model.shapes[rows]
        expected = -(across * model.mass) @ equation.shapes[target].T
        assert forces[inner][:, target] == pytest.approx(expected[inner], abs=2e-3 * np.abs(expected).max())


def test_the_estimate_of_the_richer_model_is_zero(soft, monkeypatch):
    # all modes and chordwise inertia: left are waves, the rotation of the chord, and the error of the step, which it lacks
    monkeypatch.setattr(estimate, "waves_of", lambda *_: 0.0)
    monkeypatch.setattr(
        estimate.Neglected, "of", lambda self, _, times: (np.zeros((times.size, len(self.equation.shapes))), 0.0)
    )
    scene = cp.make_scene({**soft, "cable": {**soft["cable"], "youngs_modulus": 2e8}})
    run = {
        order: cp.condensed.simulate(scene, full_modes(), order=order, step=1 / 4000, outputs=("error_estimate",))
        for order in ORDERS
    }
    assert run["inertial"].attrs["error_estimate"] < 1e-6
    assert run["leading"].attrs["error_estimate"] > run["exact"].attrs["error_estimate"] > 1e-3
    assert "position" not in run["exact"]


# --- waves along the cable --------------------------------------------------------------------------------------------

LENGTH = 9.2


def bar(scene, omega, end_time):
    """Largest rms distance of the waves in a bar from what the model contains, by a method of high order [m]."""
    p, n = Numbers(scene), np.arange(1, neglected_terms.MODES + 1)
    frequency, along = math.pi / LENGTH * math.sqrt(p.stiffness / p.mass) * n, (p.upper - p.lower) / 10.0

    def on_modes(times, *derivatives):
        ends = sum(factor * (p.end_positions(times, order) @ along) for order, factor in derivatives)
        return 2.0 / (math.pi * n) * (ends[:, :1] - (-1.0) ** n * ends[:, 1:])

    def rates(time, state):
        b, b_rate = state.reshape(2, -1)
        force = -on_modes(np.array([time]), (2, 1.0), (1, p.damping))[0]
        return np.concatenate([b_rate, force - p.damping * b_rate - frequency**2 * b])

    start = np.concatenate([np.zeros(n.size), -on_modes(np.zeros(1), (1, 1.0))[0]])
    times = np.linspace(0.0, end_time, 1001)
    options = {"rtol": 1e-5, "atol": 1e-9, "max_step": 0.2 * math.pi / omega, "t_eval": times}
    found = solve_ivp(rates, (0.0, end_time), start, method="DOP853", **options)
    distance = found.y[: n.size] + on_modes(times, (2, 1.0), (1, p.damping)).T / frequency[:, None] ** 2
    return math.sqrt(0.5 * (distance**2).sum(axis=0).max())


@pytest.mark.parametrize(
    ("kind", "damping", "ratio"),
    [
        ("harmonic", 3.0, 0.03),
        ("harmonic", 0.0, 0.3),
        ("one_minus_cosine", 0.0, 0.08),
        ("one_minus_cosine", 3.0, 1.04),
        ("harmonic", 3.0, 3.1),
    ],
)
def test_waves_are_those_of_a_bar(soft, kind, damping, ratio):
    omega = ratio * math.pi / LENGTH * math.sqrt(2e7 / 1000.0)
    motion = {"upper": {"x": {"kind": kind, "amplitude": 0.01, "angular_frequency": omega}}}
    scene = cp.make_scene({**soft, "motion": motion, "damping": {"mass_proportional": damping}})
    # that of the start counts no damping
    assert neglected_terms.waves(parameters(scene), LENGTH, 0.3) == pytest.approx(bar(scene, omega, 0.3), rel=0.12)


def test_ends_that_stand_still_make_no_waves(soft):
    assert neglected_terms.waves(parameters(cp.make_scene({**soft, "motion": {}})), LENGTH, 1.0) == 0.0


# --- modes of the richer model ----------------------------------------------------------------------------------------

#: Particles at unequal distances.
SIGMA = np.append(0.0, np.cumsum(1.0 + 0.5 * np.sin(np.arange(24.0))))
SIGMA /= SIGMA[-1]
MASSES = np.zeros_like(SIGMA)
MASSES[1:-1] = 0.5 * (SIGMA[2:] - SIGMA[:-2])


def sines(*numbers):
    return np.sin(np.pi * np.outer(numbers, SIGMA))


def legendre(count):
    return np.polynomial.legendre.legvander(2.0 * SIGMA - 1.0, count - 1).T * SIGMA * (1.0 - SIGMA)


def left_of(shapes, basis):
    """Return the norms of what is left of shapes without their parts in an orthonormal basis, over theirs."""
    rest = shapes - (shapes * MASSES) @ basis.T @ basis
    return np.sqrt((rest**2 @ MASSES) / (shapes**2 @ MASSES))


@pytest.mark.parametrize(
    ("modes", "added"),
    [
        (sines(1), (2, 3, 4)),
        (sines(1, 2, 3, 4), (5, 6, 7)),
        (sines(1, 3, 5), (2, 4, 6)),
        (sines(2, 3), (1, 4, 5)),
        # in other combinations
        (np.array([[1.0, 1e-3, 0.0], [1.0, -1e-3, 0.0], [3.0, 1.0, 2.0]]) @ sines(1, 2, 3), (4, 5, 6)),
        (legendre(4), ()),
        (legendre(8), ()),
        # as many as inner particles at most
        (np.eye(SIGMA.size)[1:-2], ()),
        (np.eye(SIGMA.size)[1:-1], ()),
    ],
)
def test_the_richer_model_has_the_modes_and_the_sines_that_they_lack(modes, added):
    (basis,) = enriched_modes([modes], SIGMA)
    assert len(basis) == min(len(modes) + EXTRA_MODES, SIGMA.size - 2)
    # rounding, a thousandfold for modes that differ by a thousandth
    np.testing.assert_allclose((basis * MASSES) @ basis.T, np.eye(len(basis)), atol=1e-12)
    assert left_of(modes, basis).max() < 1e-11
    if added:  # sines on unequal links are not quite orthogonal: some per cent
        assert left_of(sines(*added), basis).max() < 0.1
