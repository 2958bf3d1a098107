"""Drag of explicit steps: loops of whole vectors against the plain loop over particles of implicit steps."""

from __future__ import annotations

import numpy as np
import pytest

from cablepod.chain import _kernels_layout as layout
from cablepod.chain._kernels_drag import _apply_drag, drag_forces
from cablepod.chain._kernels_explicit import new_states

DRAG, STEP = 0.012, 1e-3


def increments(links: int, dims: int, is_free: bool, evaluations: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the increments of explicit steps after some evaluations (dims, n + 1), and those of the plain loop at each."""
    generator = np.random.default_rng(links)
    state = new_states(1, links)[0]
    particles, last = slice(links + 1), links + 1 if is_free else links
    state[layout.PER_MASS, 1:last] = generator.uniform(1e-3, 2e-3, last - 1)
    for c in range(dims):
        state[layout.BASE_X + c, 1:last] = generator.normal(size=last - 1)
    plain = []
    for evaluation in range(evaluations):
        x = np.arange(links + 1.0) + 0.1 * generator.normal(size=(dims, links + 1))
        v = generator.normal(size=(dims, links + 1))
        wind = 20.0 + generator.normal(size=(2, dims, links + 1))
        state[layout.X : layout.X + dims, particles], state[layout.VX : layout.VX + dims, particles] = x, v
        _apply_drag(state, links, wind, 0.3, DRAG, STEP, layout.LOAD_X, evaluation, True if dims == 3 else None)
        force, damping = np.empty((dims, links + 1)), np.empty(links + 1)
        drag_forces(x - 0.5 * STEP * v, v, wind, 0.3, DRAG, 1, last, force, damping)
        # a free end has half of the distance of its neighbours, which is the link, as every particle
        plain.append(state[layout.PER_MASS, particles] * force)
    base = state[layout.BASE_X : layout.BASE_X + dims, particles]
    return state[layout.LOAD_X : layout.LOAD_X + dims, particles] - base, plain


@pytest.mark.parametrize("is_free", [False, True])
@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("links", [2, 8, 9, 10, 16, 17, 41])
def test_whole_vectors_cover_every_particle(links: int, dims: int, is_free: bool) -> None:
    """Fewer particles than a vector, whole vectors, and a last one that overlaps; the weights of one evaluation add up to one."""
    filled, (plain,) = increments(links, dims, is_free, 1)
    # rounding of a few operations on increments of some tenths beside a base of some units
    np.testing.assert_allclose(filled, plain, rtol=0, atol=1e-14 * (1.0 + np.abs(plain).max()))
    assert (filled[:, -1] != 0.0).all() == is_free


@pytest.mark.parametrize("evaluations", [2, 3, 4, 7])
def test_last_three_evaluations_are_extrapolated(evaluations: int) -> None:
    """Rows take turns: 23/12, -16/12 and 5/12 of the last three; those before the start are that of the start."""
    filled, plain = increments(10, 3, False, evaluations)
    now, before, old = (plain[max(evaluations - 1 - back, 0)] for back in range(3))
    expected = (23.0 * now - 16.0 * before + 5.0 * old) / 12.0
    np.testing.assert_allclose(filled, expected, rtol=0, atol=1e-14 * (1.0 + np.abs(now).max()))
