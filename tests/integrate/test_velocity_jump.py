"""Starts with a jump of the end speed: the wave against the chain's, one warning of every model, none with a ramp."""

from __future__ import annotations

import copy
import math
import re
import warnings

import numpy as np
import pytest

import cablepod as cp

GUY = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 15000.0},
    "ends": {"lower": [0.0, 0.0, 0.0], "upper": [20.4, 57.7, 0.0]},
    "time": {"duration": 0.02, "interval": 0.0005},
    "chain": {"links": 300},
}
SINE = {"kind": "harmonic", "amplitude": 0.05, "angular_frequency": 2.0}


def wave_of(message):
    """Return the tension of the axial wave [N] of a warning, and its part of the tension at rest."""
    wave, percent = re.search(r"an? axial wave of (\S+) N \((\S+) % of the tension at rest\)", str(message)).groups()
    return float(wave), float(percent) / 100.0


@pytest.mark.parametrize(("axis", "speed", "rtol"), [("x", 1.0, 0.01), ("y", 0.5, 0.01), ("z", 5.0, 0.03)])
def test_the_wave_has_the_tension_of_the_chain(axis, speed, rtol):
    # a speed across the cable is of second order: the kink's angle of 0.04 rad leaves a relative error of some per cent
    scene = cp.make_scene({**GUY, "motion": {"upper": {axis: {"kind": "polynomial", "coefficients": [speed]}}}})
    with pytest.warns(cp.VelocityJumpWarning) as caught:
        run = cp.chain.simulate(scene, outputs=("tension",), tolerance=1e-3)
    behind = run.tension[10:38, -10].mean() - run.tension[0, -10]  # between the wave's passage and its return
    assert wave_of(caught[0].message)[0] == pytest.approx(abs(float(behind)), rel=rtol)


@pytest.fixture(scope="module")
def taut():
    """Scene with a sine, and modes of both layouts."""
    mapping = {
        "cable": {"youngs_modulus": 2.0e7, "area": 1.0e-3, "density": 1000.0, "top_tension": 2000.0},
        "ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0]},
        "motion": {"upper": {"x": {**SINE, "ramp": 3.0}}},
        "time": {"duration": 2.0, "interval": 0.1},
        "chain": {"links": 8},
    }
    run = cp.chain.simulate(cp.make_scene(mapping), tolerance=1e-3)
    layouts = {"galerkin": "separate", "condensed": "normal"}
    return mapping, {model: cp.pod.decompose(run, layout=layout, rank=2) for model, layout in layouts.items()}


STEPS = {"chain": 1e-4, "cable": 1e-4, "rigid": 1e-3, "galerkin": 1e-4, "condensed": 2e-3}


def jumps(model, scene, modes=()):
    """Run one model; return its warnings of jumps."""
    options = {"elements": 2} if model == "cable" else {"modes": modes[model]} if model in modes else {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        getattr(cp, model).simulate(scene, step=STEPS[model], **options)
    return [warning for warning in caught if warning.category is cp.VelocityJumpWarning]


@pytest.mark.parametrize("model", STEPS)
def test_every_model_warns_once(taut, model):
    mapping, modes = taut
    tables = copy.deepcopy(mapping)
    if model == "rigid":  # inextensible: the upper end stays within the chain's length
        tables["cable"]["top_tension"] = 100.0
        tables["motion"]["upper"]["x"] |= {"amplitude": -0.05}
    assert jumps(model, cp.make_scene(tables), modes) == []
    del tables["motion"]["upper"]["x"]["ramp"]
    scene = cp.make_scene(tables)
    (warning,) = jumps(model, scene, modes)
    text = str(warning.message)
    assert text.startswith("motion.upper.x: starts from rest at 0.1 m/s, a jump")
    # v sqrt(K mu) of the speed along the cable, whose direction at the end is that of the force there, and of w^2 / 2c of the
    # speed w across it, with c = sqrt(T / mu); here K = 2e4 N and mu = 1 kg/m
    rest = cp.catenary.rest(scene)
    cosine = float(rest.horizontal_force / rest.tension_upper)
    along = 0.1 * cosine + 0.01 * (1.0 - cosine**2) / (2.0 * math.sqrt(float(rest.tension_upper)))
    wave, part = wave_of(text)
    assert wave == pytest.approx(along * math.sqrt(2.0e4), rel=6e-3)  # of three digits
    assert part == pytest.approx(wave / float(0.5 * (rest.tension_lower + rest.tension_upper)), rel=6e-2)  # of two
    assert "try: motion.upper.x.ramp = 3.1 s" in text  # a period
    assert warning.filename == __file__


@pytest.mark.parametrize("model", ["chain", "galerkin", "condensed"])
def test_members_warn_once(taut, model):
    mapping, modes = taut
    tables = copy.deepcopy(mapping)
    tables["motion"]["upper"]["x"]["ramp"] = 0.0
    ranges = {"motion.upper.x.amplitude": [0.01, 0.05]}
    scenes = cp.ensemble.design(cp.make_scene(tables), ranges, members=3)
    (warning,) = jumps(model, scenes, modes)
    fastest = int(scenes.motion_upper_x_amplitude.values.argmax())
    assert str(warning.message).startswith(f"member {fastest}, whose ends start fastest of 3: motion.upper.x: starts")
    assert warning.filename == __file__
    (warning,) = jumps(model, scenes.assign_coords(member=[64, 65, 66]), modes)  # as in a batch of an ensemble
    assert str(warning.message).startswith(f"member {64 + fastest}, whose ends start fastest of 3: ")
    ramps = cp.ensemble.design(cp.make_scene(tables), {"motion.upper.x.ramp": [2.0, 3.0]}, members=3)
    assert jumps(model, ramps, modes) == []


@pytest.mark.parametrize(
    "motion",
    [
        {"kind": "one_minus_cosine", "amplitude": 0.1, "angular_frequency": 2.0},
        {"kind": "polynomial", "coefficients": [1e-7, 0.01]},  # 4e-5 N of 2000
        {**SINE, "phase": np.pi / 2},
    ],
)
def test_smooth_and_tiny_starts_do_not_warn(taut, motion):
    mapping, modes = taut
    scene = cp.make_scene({**mapping, "motion": {"upper": {"x": motion}}})
    assert jumps("condensed", scene, modes) == []
