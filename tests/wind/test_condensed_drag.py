"""The compiled drag of the condensed model against the same sums in numpy."""

from __future__ import annotations

import numpy as np
import pytest
from wind_scenes import GUY, WIND

import cablepod as cp
from cablepod.condensed._air import CondensedAir
from cablepod.condensed._air_motion import DragOfMotion
from cablepod.condensed._assembly import model_of
from cablepod.condensed._kernels_layout import POINTS_IN_VECTOR
from cablepod.parameters._from_scene import parameters
from cablepod.wind._air import air_of


@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("rank", [1, 3, 4, 6, 9])
def test_the_kernel_sums_all_points_and_coordinates(dims, rank):
    direction = [1.0, 0.0] if dims == 2 else [0.6, 0.0, 0.8]
    ends = {name: end[:dims] for name, end in GUY["ends"].items()}
    scene = cp.make_scene({**GUY, "ends": ends, "wind": {**WIND, "direction": direction}})
    modes = cp.condensed.vibration_modes(scene, rank=rank)
    model = model_of(parameters(scene), modes, rank=None, order="leading", law="linear")
    air = CondensedAir(model, air_of(model.chain.p, 0.0), 0.0)
    points = rank + 2
    assert air.rule[0].size == points
    assert air.shapes_of_kernel.shape == (2, len(model.shapes), -(-points // POINTS_IN_VECTOR) * POINTS_IN_VECTOR)
    rng = np.random.default_rng(rank)
    q, rates = 0.3 * rng.normal(size=(2, len(model.shapes))) * [[1.0], [10.0]]
    stretch = model.initial_boundary_data[0] / model.chain.total_length
    motion = DragOfMotion.of(air, np.zeros(1), q[None], rates[None], np.array([stretch]))
    expected = motion.on(air.shapes[0], model.n_in_plane)[0]
    assert np.abs(expected).min() > 1e-9
    assert air.acceleration(q, rates) == pytest.approx(expected, rel=1e-9, abs=1e-12 * np.abs(expected).max())
