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


def after(share):
    """A callback that is Ctrl-C after some share of the work, and the shares it was told."""
    told: list[float] = []

    def stop(done):
        told.append(done)
        if done > share:
            raise KeyboardInterrupt

    return stop, told


def leaving():
    """A sagging cable, of which whirling leaves the planar branch at 0.065 m, with its modes."""
    scene = parabolic(45.0)
    return scene, cp.condensed.vibration_modes(scene, rank=3, links=20, static_modes=True), 0.075


def string():
    """A string, of which whirling begins at rest."""
    scene = mathieu(0.1)
    return scene, cp.condensed.vibration_modes(scene, rank=2), 2.0


@pytest.mark.parametrize(
    ("case", "motion", "share"), [(string, "planar", 0.25), (string, "whirling", 0.25), (leaving, "whirling", 0.95)]
)
def test_what_was_traced_is_kept_after_an_interrupt(case, motion, share, tmp_path):
    scene, modes, amplitude = case()
    told: list[float] = []
    whole = cp.periodic.backbone(scene, modes, amplitude=amplitude, motion=motion, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    stop, _ = after(share)
    with pytest.raises(cp.RunStopped, match="interrupted") as caught:
        cp.periodic.backbone(scene, modes, amplitude=amplitude, motion=motion, progress=stop)
    partial = caught.value.partial
    count = partial.sizes["point"]
    assert 1 < count < whole.sizes["point"] - 1
    for name in ("angular_frequency", "amplitude", "amplitude_of_mode", "smallest_chordwise_force"):
        assert np.array_equal(partial[name].values, whole[name].values[:count], equal_nan=True), name
    assert (partial.attrs["ended"], partial.attrs["incomplete"]) == ("interrupted", 1)
    assert partial.attrs["hardening"] == whole.attrs["hardening"]
    cp.archive.write(partial, tmp_path / "backbone.nc")


def test_an_interrupt_on_the_way_to_whirling_keeps_nothing():
    scene, modes, amplitude = leaving()
    stop, _ = after(0.1)
    with pytest.raises(KeyboardInterrupt):
        cp.periodic.backbone(scene, modes, amplitude=amplitude, motion="whirling", progress=stop)
