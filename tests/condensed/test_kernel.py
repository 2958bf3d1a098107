"""The closure: its solutions close the chord and satisfy the material law, from distant first guesses too."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import everything, full_modes, spatial

import cablepod as cp
from cablepod.condensed import _kernels_exact_closure as kernel
from cablepod.condensed import _stepper


@pytest.mark.parametrize("green", [False, True])
def test_solutions_close_the_chord_and_satisfy_the_law(green):
    """Shapes, loads and chords jump from one instant to the next, some into compression; each reported root is a root."""
    generator = np.random.default_rng(3)
    solved = 0
    for _ in range(200):
        links, shapes = 20, 30
        stiffness, strain = 10.0 ** generator.uniform(3, 8), 10.0 ** generator.uniform(-6, -0.5)
        length = np.full(links, 10.0 ** generator.uniform(0, 2) / links)
        squared = (10.0 ** generator.uniform(-3, 0) * generator.standard_normal((shapes, links))) ** 2
        tau = 0.2 * stiffness * strain * generator.standard_normal((shapes, links))
        chord = (
            length.sum()
            * (1.0 + strain - 0.5 * squared.mean(axis=1))
            * (1.0 + 0.02 * generator.standard_normal(shapes))
        )
        force, z = np.full(shapes, stiffness * strain), np.ones((shapes, links))
        kernel.close_all(squared, tau, length, chord, stiffness, green, force, z)
        good = np.isfinite(force)
        solved += int(good.sum())
        force, z, squared = force[good], z[good], squared[good]
        np.testing.assert_allclose(z @ length, chord[good], rtol=1e-12)
        xi = np.sqrt(z**2 + squared)
        law = stiffness * (0.5 * z * (xi**2 - 1.0) if green else (1.0 - 1.0 / xi) * z)
        # the closure bounds the error of H, a mean over all links, by 1e-10 of H and rounding; one link may err by more, and a
        # false root errs by all of H
        off = np.abs(force[:, None] + tau[good] - law).max(axis=1)
        assert (off <= 1e-8 * np.abs(force) + 1e-13 * stiffness).all()
    assert solved > 5500  # of 6000; under strong compression there is no solution


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")  # modes of another cable; the ends come near
@pytest.mark.constant_sizes
@pytest.mark.parametrize("case", ["everything", "one of each deflection", "downhill", "unstable"])
def test_steps_of_a_constant_number_of_coordinates_are_those_of_any_number(soft, monkeypatch, case):
    """Loads that vary, damping, several blocks of loads, extremes; the order of the sums differs, and nothing else."""
    mapping, rank, rate = everything(soft), 2, 500
    if case == "one of each deflection":
        mapping, rank = spatial({**soft, "damping": {"mass_proportional": 0.8}}), 1
    elif case == "downhill":  # where the chordwise force is least in the last link
        mapping = {**soft, "ends": {"lower": [0.0, 6.0], "upper": [8.0, 0.0]}}
    elif case == "unstable":  # the tension grows with the distance of the ends
        mapping, rate = {**soft, "motion": {"upper": {"x": {"kind": "ramp", "amplitude": 0.3, "duration": 1.0}}}}, 4
    scene, modes = cp.make_scene(mapping), full_modes(dims=3 if rank == 1 else 2)
    options = {"scheme": "numerov", "step": 1.0 / rate, "times": np.linspace(0.0, 2.0, 41)}
    outputs = ("velocity", "tension_extremes")

    def run():
        try:
            return cp.condensed.simulate(scene, modes, rank=rank, outputs=outputs, **options)
        except cp.RunStopped as stopped:
            return str(stopped)

    one = run()
    monkeypatch.setattr(_stepper, "MAX_CONSTANT_SIZE", 0)
    other = run()
    if case == "unstable":
        assert one == other
        assert "its stability limit is below the step" in one
        return
    # rounding, which the sums of a thousand steps add up to 1e-12 of the motion
    for name in ("amplitude", "velocity", "tension_minimum", "tension_maximum"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-9, atol=1e-10 * float(np.abs(other[name]).max()))
    for name in ("smallest_chordwise_force", "time_of_smallest_force"):
        assert one.attrs[name] == pytest.approx(other.attrs[name], rel=1e-9)
