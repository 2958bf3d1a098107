"""Loops of drag against plain sums over particles or points, the coherence of factors, and what scenes of equal wind share."""

from __future__ import annotations

import numpy as np
import pytest
from wind_scenes import GUY, KAIMAL, WIND

import cablepod as cp
from cablepod.chain import _kernels_layout as layout
from cablepod.chain._kernels_drag import apply_drag, drag_forces
from cablepod.chain._kernels_explicit import new_states
from cablepod.condensed._air import CondensedAir
from cablepod.condensed._air_motion import DragOfMotion
from cablepod.condensed._assembly import model_of
from cablepod.parameters._from_scene import parameters
from cablepod.wind import _air, _turbulence

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


@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("rank", [1, 3, 4, 6, 9])
def test_the_kernel_sums_all_points_and_coordinates(dims, rank):
    direction = [1.0, 0.0] if dims == 2 else [0.6, 0.0, 0.8]
    ends = {name: end[:dims] for name, end in GUY["ends"].items()}
    scene = cp.make_scene({**GUY, "ends": ends, "wind": {**WIND, "direction": direction}})
    modes = cp.condensed.vibration_modes(scene, rank=rank)
    model = model_of(parameters(scene), modes, rank=None, order="leading", law="linear")
    air = CondensedAir(model, _air.air_of(model.chain.p, 0.0), 0.0)
    points = rank + 2
    assert air.rule[0].size == points
    assert air.shapes.shape == (3, len(model.shapes), points)
    rng = np.random.default_rng(rank)
    q, rates = 0.3 * rng.normal(size=(2, len(model.shapes))) * [[1.0], [10.0]]
    stretch = model.initial_boundary_data[0] / model.chain.total_length
    motion = DragOfMotion.of(air, np.zeros(1), q[None], rates[None], np.array([stretch]))
    expected = motion.on(air.shapes[2], model.n_in_plane)[0]
    assert np.abs(expected).min() > 1e-9
    assert air.acceleration(q, rates) == pytest.approx(expected, rel=1e-9, abs=1e-12 * np.abs(expected).max())


def test_interpolated_factors_keep_the_coherence():
    heights = np.linspace(2.0, 120.0, 20)
    decay = 10.0 * np.abs(heights[:, None] - heights) / 25.0
    n = np.arange(1, 3300) / 660.0
    basis = np.eye(20, dtype=complex)
    # the image of unit vectors at each frequency is the factor itself
    columns = np.stack(
        [_turbulence._coupled([np.repeat(basis[:, [k]], n.size, axis=1)], n, decay)[0] for k in range(20)], axis=2
    )
    found = np.einsum("pnk,qnk->npq", columns.real, columns.real)
    assert np.abs(found - np.exp(-n[:, None, None] * decay)).max() < 3e-3


def test_scenes_of_equal_wind_share_the_turbulence_and_others_do_not():
    def scene(wind=KAIMAL, **tables):
        return cp.make_scene({**GUY, "wind": wind, **tables})

    def velocity(given):
        return _air.air_of(parameters(given), 2.0).velocity

    _air._kept_turbulence.cache_clear()
    short = {"time": {"duration": 2.0, "interval": 0.5}}
    first = velocity(scene(**short))
    damped = velocity(scene(damping={"mass_proportional": 0.1}, **short))
    assert _air._kept_turbulence.cache_info().hits == 1
    np.testing.assert_array_equal(damped, first)
    for other in (
        scene({**KAIMAL, "speed": 24.0}, **short),
        scene({**KAIMAL, "turbulence": {"spectrum": "kaimal", "seed": 8}}, **short),
        scene(cable={**GUY["cable"], "top_tension": 14000.0}, **short),
    ):
        assert np.abs(velocity(other) - first).max() > 1e-6
        direct = cp.wind.field(other).wind.values  # with nothing kept but phases
        assert np.abs(velocity(other) - direct).max() < 1e-12
    assert _air._kept_turbulence.cache_info().misses == 4  # that of the first and of each other scene
