"""Free vibrations: the elliptic closed form, whirling, hardening and softening."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from periodic_scenes import STIFFNESS, STRING, TENSION, mathieu
from scipy.optimize import brentq
from scipy.special import ellipk

import cablepod as cp

#: Linear law and step 8 of the condensed model: the stretch of a straight cable divides the squared slopes.
STRETCH = 1.0 + TENSION / STIFFNESS


def string_factor(modes, mode):
    """The model's own epsilon over the square of the largest deflection: its squared slope norm, from its frequency."""
    length = float(modes.unstretched_length)
    mass = 8000.0 * 1.25e-4
    squared = float(modes.angular_frequency[mode - 1]) ** 2
    shape = modes.mode_shape.values[mode - 1]
    weights = np.full(shape.size, length / (shape.size - 1))
    norm = mass * (weights * shape**2).sum() / np.abs(shape).max() ** 2
    return STIFFNESS / (2.0 * length) * squared * norm / TENSION**2


@pytest.mark.parametrize("mode", [1, 2])
def test_a_string_has_the_frequencies_of_the_elliptic_integral(mode):
    scene = mathieu(0.1)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    result = cp.periodic.backbone(scene, modes, mode=mode, amplitude=2.0)
    omega, a = result.angular_frequency.values, result.amplitude.values
    epsilon = string_factor(modes, mode) * a**2
    m = 0.5 * epsilon / (1.0 + epsilon)
    exact = float(modes.angular_frequency[mode - 1]) * np.pi * np.sqrt(1.0 + epsilon) / (2.0 * ellipk(m))
    assert epsilon.max() > 2.0
    assert omega == pytest.approx(exact, rel=1e-6)
    assert result.attrs["ended"] == "amplitude"
    assert a[-1] == pytest.approx(2.0, rel=1e-9)
    hardening = 0.75 * float(modes.angular_frequency[mode - 1]) ** 2 * string_factor(modes, mode)
    assert result.attrs["hardening"] == pytest.approx(hardening, rel=1e-5)


def test_a_whirling_string_moves_on_circles():
    scene = mathieu(0.1)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    result = cp.periodic.backbone(scene, modes, amplitude=2.0, motion="whirling")
    epsilon = string_factor(modes, 1) * result.amplitude.values**2
    assert result.angular_frequency.values == pytest.approx(
        float(modes.angular_frequency[0]) * np.sqrt(1.0 + epsilon), rel=1e-9
    )


def parabolic(parameter):
    """A level cable of small sag with a given lambda squared."""
    span, tension, weight = 100.0, 1.0e5, 10.0
    stiffness = parameter * tension / (weight * span / tension) ** 2
    mapping = copy.deepcopy(STRING)
    mapping["gravity"] = 9.81
    mapping["cable"] = {
        "youngs_modulus": stiffness / 1e-4, "area": 1e-4, "specific_weight": weight / 1e-4, "horizontal_force": tension,
    }  # fmt: skip
    mapping["ends"]["upper"] = [span, 0.0]
    return cp.make_scene(mapping)


@pytest.mark.slow
def test_hardening_turns_to_softening_at_the_known_sag():
    def hardening(parameter):
        scene = parabolic(parameter)
        modes = cp.condensed.vibration_modes(scene, rank=7, static_modes=True, links=80)
        return cp.periodic.backbone(scene, modes, amplitude=1e-3).attrs["hardening"]

    assert hardening(2.0) > 0.0 > hardening(5.0)
    assert brentq(hardening, 2.5, 4.0, xtol=1e-3) == pytest.approx(3.068, abs=0.01)
