"""What orders "exact" and "inertial" neglect: accelerations against finite differences, estimates against the chain."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import spatial

import cablepod as cp
from cablepod.condensed import _estimate_neglected as neglected_terms
from cablepod.condensed._assembly import model_of
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
    p = parameters(scene)
    model = model_of(p, cp.condensed.vibration_modes(scene, rank=3), rank=None, law="linear", order="inertial")
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


@pytest.mark.parametrize("order", ["exact", "inertial"])
def test_the_estimate_contains_the_rotation_of_the_chord(soft, order):
    # an end that moves slowly across the chord: without rotation and waves the estimate of "inertial" is 200 times too small
    cable = {**soft["cable"], "top_tension": 300.0}
    motion = {"upper": {"y": {"kind": "harmonic", "amplitude": 0.4, "angular_frequency": 4.0, "ramp": 1.5}}}
    time, ends = {"duration": 2.0, "interval": 0.01}, {"lower": [0.0, 0.0], "upper": [9.0, 0.0]}
    scene = cp.make_scene(
        {**soft, "cable": cable, "ends": ends, "motion": motion, "chain": {"links": 12}, "time": time}
    )
    chain = cp.chain.simulate(scene, step=2e-4, outputs=("position",))
    run = cp.condensed.simulate(scene, cp.pod.decompose(chain, layout="normal", rank=8), order=order)
    error = float(cp.compare.errors(run, chain).error_max)
    assert error == pytest.approx(run.attrs["error_estimate"], rel=0.1)
