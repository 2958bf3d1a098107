"""The error estimate on modes of any origin: what the richer model adds, and estimates beside errors."""

from __future__ import annotations

import numpy as np
import pytest
from prediction import own_modes
from prediction.scenes import Case

import cablepod as cp
from cablepod.condensed._error_coefficients import EXTRA_MODES, enriched_modes

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
    ],
)
def test_the_richer_model_has_the_modes_and_the_sines_that_they_lack(modes, added):
    (basis,) = enriched_modes([modes], SIGMA)
    assert len(basis) == len(modes) + EXTRA_MODES
    # rounding, a thousandfold for modes that differ by a thousandth
    np.testing.assert_allclose((basis * MASSES) @ basis.T, np.eye(len(basis)), atol=1e-12)
    assert left_of(modes, basis).max() < 1e-11
    if added:  # sines on unequal links are not quite orthogonal: some per cent
        assert left_of(sines(*added), basis).max() < 0.1


def test_the_richer_model_has_as_many_modes_as_inner_particles_at_most():
    inner = SIGMA.size - 2
    for count in (inner - 1, inner):
        (basis,) = enriched_modes([np.eye(SIGMA.size)[1 : 1 + count]], SIGMA)
        assert len(basis) == inner
        np.testing.assert_allclose((basis * MASSES) @ basis.T, np.eye(inner), atol=1e-12)


@pytest.mark.parametrize("tension", [4000.0, 15000.0])
def test_the_estimate_with_sines_is_right_within_a_factor_of_five(tension):
    """It was more than five times too small, by sines added to themselves."""
    case = Case(
        {"tension": tension, "frequency": 1.0, "size": 0.05, "load": 0.0, "inclination": 40.0, "chord": 60.0}, 20.0
    )
    error, estimate = own_modes.error_and_estimate(case, own_modes.bases(case, 0)["sines"], 3, "leading")
    assert 0.2 < estimate / error < 5.0


def shaken(amplitude):
    """A guy whose load oscillates: alike on all of it, so that no even number of half waves is excited."""
    return cp.make_scene(
        {
            "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 15000.0},
            "ends": {"lower": [0.0, 0.0], "upper": [50.0, 35.0]},
            "load": {"uniform": [5.0, 0.0], "kind": "harmonic", "amplitude": amplitude, "angular_frequency": 6.0},
            "damping": {"mass_proportional": 0.1},
            "chain": {"links": 20},
            "time": {"duration": 10.0, "interval": 0.1},
        }
    )


@pytest.mark.parametrize("model", ["leading", "exact", "members", "galerkin"])
def test_a_model_that_stands_still_misses_the_motion_of_its_cable(model):
    """The estimate was the error over the chord, some thousandths, as if the cable stood still too."""

    def run(amplitude):
        sigma = np.linspace(0.0, 1.0, 21)
        shapes, scene = np.sin(np.pi * np.outer([2, 4], sigma)), shaken(amplitude)
        if model == "galerkin":
            modes = cp.modes(np.stack([shapes, shapes]), layout="separate", arc_length=sigma)
            return cp.galerkin.simulate(scene, modes)
        modes = cp.modes(shapes, arc_length=sigma)
        if model != "members":
            return cp.condensed.simulate(scene, modes, order=model)
        scenes = cp.ensemble.design(scene, {"cable.top_tension": [15000.0, 15001.0]}, members=2)
        return cp.condensed.simulate(scenes, modes).isel(member=0)

    def estimate_of(result):
        return float(result.get("error_estimate", result.attrs.get("error_estimate")))

    with pytest.warns(cp.OutOfRangeWarning, match="do not represent this scene"):
        reduced = run(1.0)
    assert float(abs(reduced.amplitude - reduced.amplitude.isel(time=0)).max()) < 1e-9
    truth = cp.chain.simulate(shaken(1.0))
    error = float(cp.compare.errors(reduced.drop_vars("member", errors="ignore"), truth)["error_max"])
    assert estimate_of(reduced) == pytest.approx(error, rel=0.25)
    assert estimate_of(run(0.0)) < 0.01  # of the chord, where nothing moves


@pytest.mark.slow
def test_the_estimate_is_right_on_bases_of_any_origin():
    result = own_modes.report(scenes=6, duration=30.0, ranks=(1, 3, 8))
    ratio = own_modes.ratios(result)
    assert ratio.size == 6 * 6 * 2 * 3
    assert own_modes.within(ratio) >= 0.95
    assert "| sines | 36 |" in own_modes.table(result)
