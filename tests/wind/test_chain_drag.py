"""Drag of explicit steps: loops of whole vectors against the plain loop over particles of implicit steps."""

from __future__ import annotations

import numpy as np
import pytest
from wind_scenes import GUY, WIND

import cablepod as cp
from cablepod.chain import _kernels_layout as layout
from cablepod.chain._kernels_drag import apply_drag, drag_forces
from cablepod.chain._kernels_explicit import new_states

DRAG, STEP = 0.012, 1e-3


def increments(links: int, dims: int, free: str, evaluations: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the increments of explicit steps after some evaluations (dims, n + 1), and those of the plain loop at each."""
    generator = np.random.default_rng(links)
    state = new_states(1, links)[0]
    particles, first, last = slice(links + 1), 0 if free == "lower" else 1, links + 1 if free == "upper" else links
    state[layout.PER_MASS, first:last] = generator.uniform(1e-3, 2e-3, last - first)
    ratio, bodies = generator.uniform(0.5, 2.0, links + 1), np.zeros(links + 1)  # parts of the cable, attachments
    state[layout.DRAG_PER_MASS, particles] = ratio * state[layout.PER_MASS, particles]
    bodies[[links // 3, links // 2]] = 0.2
    for c in range(dims):
        state[layout.BASE_X + c, first:last] = generator.normal(size=last - first)
    plain = []
    for evaluation in range(evaluations):
        x = np.arange(links + 1.0) + 0.1 * generator.normal(size=(dims, links + 1))
        v = generator.normal(size=(dims, links + 1))
        wind = 20.0 + generator.normal(size=(2, dims, links + 1))
        state[layout.X : layout.X + dims, particles], state[layout.VX : layout.VX + dims, particles] = x, v
        apply_drag(state, links, wind, 0.3, DRAG, bodies, STEP, layout.LOAD_X, evaluation, True if dims == 3 else None)
        force, damping = np.empty((dims, links + 1)), np.empty(links + 1)
        drag_forces(x - 0.5 * STEP * v, v, wind, 0.3, DRAG * ratio, first, last, force, damping)
        air = wind[0] + 0.3 * (wind[1] - wind[0]) - v  # a body has drag in every direction
        force += bodies * np.sqrt((air * air).sum(axis=0)) * air
        # a free end has half of the distance of its neighbours, which is the link, as every particle
        plain.append(state[layout.PER_MASS, particles] * force)
    base = state[layout.BASE_X : layout.BASE_X + dims, particles]
    return state[layout.LOAD_X : layout.LOAD_X + dims, particles] - base, plain


@pytest.mark.parametrize("free", ["", "lower", "upper"])
@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("links", [2, 8, 9, 10, 16, 17, 41])
def test_whole_vectors_cover_every_particle(links: int, dims: int, free: str) -> None:
    """Fewer particles than a vector, whole vectors, and a last one that overlaps; the weights of one evaluation add up to one."""
    filled, (plain,) = increments(links, dims, free, 1)
    # rounding of a few operations on increments of some tenths beside a base of some units
    np.testing.assert_allclose(filled, plain, rtol=0, atol=1e-14 * (1.0 + np.abs(plain).max()))
    assert (filled[:, -1] != 0.0).all() == (free == "upper")
    assert (filled[:, 0] != 0.0).all() == (free == "lower")


@pytest.mark.parametrize("evaluations", [2, 3, 4, 7])
def test_last_three_evaluations_are_extrapolated(evaluations: int) -> None:
    """Rows take turns: 23/12, -16/12 and 5/12 of the last three; those before the start are that of the start."""
    filled, plain = increments(10, 3, "", evaluations)
    now, before, old = (plain[max(evaluations - 1 - back, 0)] for back in range(3))
    expected = (23.0 * now - 16.0 * before + 5.0 * old) / 12.0
    np.testing.assert_allclose(filled, expected, rtol=0, atol=1e-14 * (1.0 + np.abs(now).max()))


@pytest.mark.parametrize("outputs", [("position",), ("position", "velocity")])
def test_instants_between_two_evaluations_change_no_bit(outputs: tuple[str, ...]) -> None:
    """A run is cut at its output instants; the drag is evaluated at the same steps whatever these are."""
    motion = {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": 0.05, "angular_frequency": 20.0}}}
    scene = cp.make_scene({**GUY, "wind": WIND, "motion": motion})
    runs = [
        cp.chain.simulate(scene, step=4e-4, times=times, outputs=outputs)
        for times in ([0.0, 0.0012, 0.0104, 0.0264, 0.0268, 0.1], [0.0, 0.1])
    ]
    assert np.array_equal(runs[0].position[-1], runs[1].position[-1])
    assert np.abs(runs[0].position[-1] - runs[0].position[0]).max() > 1e-3
