"""Error estimate of cables with springs, whose stiffness the samples of the residual need not resolve."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import cablepod as cp
from cablepod.condensed._kernels_error import _hold_by_springs

SPRING: dict[str, Any] = {"arc_length": 0.4, "direction": [0.0, 0.0, 1.0]}


def held(spring: float) -> Any:
    """Make a guy that a spring holds out of its plane, and moves there with its upper end."""
    motion = {
        axis: {"kind": "one_minus_cosine", "amplitude": amplitude, "angular_frequency": omega}
        for axis, amplitude, omega in (("z", 0.1, 4.0), ("y", 0.05, 5.0))
    }
    return cp.make_scene(
        {
            "cable": {"axial_stiffness": 3e6, "mass_per_length": 1.0, "top_tension": 8e3},
            "ends": {"lower": [0.0, 0.0, 0.0], "upper": [60.0, 20.0, 0.0]},
            "chain": {"links": 96},
            "time": {"duration": 2.0, "interval": 0.02},
            "motion": {"upper": motion},
            "attachment": [{**SPRING, "spring": spring}],
        }
    )


@pytest.mark.parametrize("spring", [1e4, 1e7, 1e9])
def test_the_estimate_does_not_depend_on_the_samples(spring: float) -> None:
    # central differences without the spring in their mass diverge for some intervals: estimates of 0.4 and 2
    scene = held(spring)
    modes = cp.condensed.vibration_modes(scene, rank=10)
    found = [
        cp.condensed.simulate(scene, modes, scheme="trapezoidal", step=step).attrs["error_estimate"]
        for step in (0.01, 0.00625, 0.005, 0.00125)
    ]
    assert found == pytest.approx([found[-1]] * 4, rel=0.05)  # sampled at 2 rad of the last mode
    assert found[-1] < 0.01


def test_a_spring_that_is_a_support_gives_the_cable_of_two_parts_its_estimate() -> None:
    scene = held(1e9)
    run = cp.condensed.simulate(scene, cp.condensed.vibration_modes(scene, rank=10))
    cable = cp.cable.simulate(scene, law="linear", points=run.arc_length.values / float(run.arc_length[-1]))
    error = np.sqrt((((run.position - cable.position.values) ** 2).sum("coordinate")).mean("particle")).max()
    motion = np.sqrt((((cable.position - cable.position[0]) ** 2).sum("coordinate")).mean(cable.position.dims[1])).max()
    assert float(error / motion) < 2.7 * run.attrs["error_estimate"] < 0.02  # the bound of the README
    assert run.attrs["time_error_estimate"] < 0.1 * run.attrs["error_estimate"]


def test_dyads_of_springs_are_inverted() -> None:
    rng = np.random.default_rng(3)
    springs, inverse_mass = rng.normal(size=(3, 7)), 1.0 / rng.uniform(1.0, 2.0, 7)
    mass = np.diag(1.0 / inverse_mass)
    vectors = rng.normal(size=(2, 7))
    expected = mass @ np.linalg.solve(mass + 0.7 * springs.T @ springs, vectors.T)
    own = vectors.copy()
    getattr(_hold_by_springs, "py_func", _hold_by_springs)(springs, 0.7, inverse_mass, np.zeros((3, 9)), own[0], own[1])
    np.testing.assert_allclose(own.T, expected, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("thing", [{"spring": 2000.0}, {"damper": 100.0}], ids=["spring", "damper"])
@pytest.mark.parametrize("direction", [[0.0, 1.0, 0.0], [-0.5, 0.5, 0.7]])
def test_the_estimate_sees_a_chord_that_turns_away_from_an_attachment(direction: list[float], thing: Any) -> None:
    # the model has the attachment in the chord frame of rest, in which the sag turns: without this 2 to 11 times the estimate
    scene = cp.make_scene(
        {
            "cable": {"axial_stiffness": 3e6, "mass_per_length": 1.0, "top_tension": 4e3},
            "ends": {"lower": [0.0, 0.0, 0.0], "upper": [20.0, 50.0, 0.0]},
            "chain": {"links": 40},
            "time": {"duration": 6.0, "interval": 0.05},
            "motion": {"upper": {"z": {"kind": "harmonic", "amplitude": 0.6, "angular_frequency": 2.0, "ramp": 3.0}}},
            "attachment": [{"arc_length": 0.4, "direction": list(direction / np.linalg.norm(direction)), **thing}],
        }
    )
    chain = cp.chain.simulate(scene, tolerance=1e-4, outputs=("position",))
    run = cp.condensed.simulate(scene, cp.condensed.vibration_modes(scene, rank=8, static_modes=True))
    ratio = float(cp.compare.errors(run, chain).error_max) / run.attrs["error_estimate"]
    assert 0.3 < ratio < 1.3  # dampers do not damp the error
    assert "damper" in thing or ratio > 0.8
