"""The closure: its solutions close the chord and satisfy the material law, from distant first guesses too."""

from __future__ import annotations

import numpy as np
import pytest

from cablepod.condensed import _kernels_closure as kernel


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
