"""The search for the chordwise stretch: what it finds closes the chord and obeys the law, however far it had to go."""

from __future__ import annotations

import numpy as np
import pytest

from cablepod.condensed import _kernels_closure as kernel


@pytest.mark.parametrize("green", [False, True])
def test_a_closed_chord_is_closed_and_obeys_the_law(green):
    """Shapes, loads and chords that jump from one to the next, some pushed together: a root found is a root."""
    generator = np.random.default_rng(3)
    found = 0
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
        found += int(good.sum())
        force, z, squared = force[good], z[good], squared[good]
        np.testing.assert_allclose(z @ length, chord[good], rtol=1e-12)
        xi = np.sqrt(z**2 + squared)
        law = stiffness * (0.5 * z * (xi**2 - 1.0) if green else (1.0 - 1.0 / xi) * z)
        # the search bounds its error by 1e-10 of H, a sum over all links, of which one may be off by more; and rounding of a
        # strain near nothing.  A false root is off by all of H
        off = np.abs(force[:, None] + tau[good] - law).max(axis=1)
        assert (off <= 1e-8 * np.abs(force) + 1e-13 * stiffness).all()
    assert found > 5500  # of 6000; a cable pushed too hard has no such shape
