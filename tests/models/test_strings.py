"""Vibrations of a taut string of two parts, or with a mass, a spring or a damper: cable and condensed model by its roots."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from references import damped_string as taut
from references.damped_string import LENGTH, MASS, SPEED, damper, string

import cablepod as cp

ETAS = {place: kappa / (math.pi * place) for place, kappa in ((0.02, 1.0), (0.04, 0.3), (0.1, 3.0))}  #: of dampers
#: Tables, so many roots beta l, and the errors of frequencies and damping ratios with 100 links.
STRINGS: dict[str, tuple[dict[str, Any], Callable[[int], np.ndarray], float]] = {
    **{
        f"mass of {ratio} at {place}": (
            {"attachment": [{"arc_length": place, "mass": ratio * MASS * LENGTH}]},
            partial(taut.roots_with_mass, place, ratio), 4e-4,
        )
        for place, ratio in ((0.5, 1.0), (0.3, 0.2), (0.05, 5.0))
    },
    # three links in ten lie in the first part, with a border at a particle
    "two parts": ({"segment": [{"to": 0.3}, {"density": 4.0 * taut.DENSITY}]}, partial(taut.roots_of_two_parts, 0.3, 4.0), 1e-3),
    "spring": (
        {"attachment": [{"arc_length": 0.2, "spring": 500.0, "direction": "normal"}]},
        partial(taut.roots_with_spring, 0.2, 500.0 * LENGTH / taut.TENSION), 4e-4,
    ),
    **{
        f"damper at {place}": ({"attachment": [damper(place, eta)]}, partial(taut.roots_with_damper, place, eta), 3e-3)
        for place, eta in ETAS.items()
    },
}  # fmt: skip


def numbers_of(found: Any, roots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return errors of the frequencies, and of the damping ratios where the roots have some, over the exact ones."""
    exact = np.abs(roots) * SPEED / LENGTH
    frequencies = found.angular_frequency.values[: roots.size] / exact - 1.0
    if not np.iscomplexobj(roots):
        return frequencies, np.zeros(0)
    return frequencies, found.damping_ratio.values[: roots.size] / (roots.imag / np.abs(roots)) - 1.0


def test_printed_roots() -> None:
    assert taut.roots_with_mass(0.5, 1.0, 3) / math.pi == pytest.approx([0.5477054, 2.0, 2.1808164], abs=1e-7)
    (root,) = taut.roots_with_damper(0.02, ETAS[0.02], 1)
    assert root.imag / abs(root) == pytest.approx(0.01021147, abs=5e-9)


@pytest.mark.parametrize("case", STRINGS)
def test_cable(case: str) -> None:
    """Elements end where segments do and at attachments, so that few are as good with the lowest vibrations."""
    tables, roots_of, _ = STRINGS[case]
    roots = roots_of(4 if "damper" in case else 5)
    for elements in (40, 8) if case == "two parts" else (40,):
        found = cp.cable.frequencies(string(**tables), count=roots.size, elements=elements, law="linear")
        for errors in numbers_of(found, roots):
            np.testing.assert_allclose(errors, 0.0, atol=1e-6)  # rounding, and an axial stretch of order T / K
    assert ("damping_ratio" in found) == np.iscomplexobj(roots)


@pytest.mark.parametrize("case", STRINGS)
def test_condensed_model_with_the_second_order_of_its_links(case: str) -> None:
    tables, roots_of, least = STRINGS[case]
    coarse, fine = (
        numbers_of(cp.condensed.vibration_modes(string(links, **tables), rank=3), roots_of(3)) for links in (50, 100)
    )
    for one, other in zip(coarse, fine, strict=True):
        # but for the next order, and zeros where a mass rests
        np.testing.assert_allclose(other, one / 4.0, rtol=0.0, atol=0.05 * least)
        np.testing.assert_allclose(other, 0.0, atol=least)


def test_a_damper_at_the_node_of_the_second_mode_does_not_damp_it() -> None:
    # odd modes: tan(b l / 2) = 2 i / eta, so that Im(b l) = 2 artanh(eta / 2) for all of them
    scene, decay = string(attachment=[damper(0.5, 0.3)]), 2.0 * math.atanh(0.15)
    exact = decay / np.hypot(decay, math.pi * np.array([1.0, 3.0]))
    cable = cp.cable.frequencies(scene, count=4, law="linear")
    assert cable.angular_frequency.values[[1, 3]] == pytest.approx(
        np.array([2.0, 4.0]) * math.pi * SPEED / LENGTH, rel=1e-6
    )
    assert cable.damping_ratio.values[3] < 1e-12
    for found, rounding in ((cable, 1e-6), (cp.condensed.vibration_modes(scene, rank=3), 2e-3)):
        assert found.damping_ratio.values[1] < 1e-12
        assert found.damping_ratio.values[[0, 2]] == pytest.approx(exact, rel=rounding)
