"""Damping of the guys of masts by given ratios: a whole mast, members, refusals; each vibration is in test_internals."""

from __future__ import annotations

import numpy as np
import pytest
from mast_scenes import small
from scene_files import put

import cablepod as cp


def damped(damping):
    return small(lambda mapping: mapping.update(damping=damping))


def test_ratios_damp_a_whole_mast_and_members(tmp_path):
    scene = small(lambda mapping: (put(mapping, "mast.damping_ratio", 0.0), put(mapping, "damping", {"ratio": 0.0})))
    members = cp.ensemble.design(scene, {"damping.ratio": [0.0, 0.3, 3]})
    options = {"rank": 2, "outputs": ("guy_tension",)}
    together = cp.ensemble.run(members, tmp_path / "masts", model="mast", **options)
    late = together.guy_tension.isel(time=slice(60, None)).std("time").max("guy").values
    assert late[0] > 1.05 * late[1]
    assert late[1] > 1.01 * late[2]
    alone = cp.mast.simulate(members.isel(member=1, drop=True), **options)
    assert np.array_equal(together.guy_tension.isel(member=1), alone.guy_tension)


@pytest.mark.parametrize("guys", ["chain", "catenary"])
def test_other_guys_refuse_it(guys):
    with pytest.raises(cp.SceneError, match=rf'^damping\.ratio: given 0\.02; allowed: none with guys "{guys}"'):
        cp.mast.simulate(damped({"ratio": 0.02}), guys=guys)
    with pytest.raises(
        cp.SceneError, match=r"^damping\.ratio: given 0\.02; allowed: none beside damping\.mass_proportional"
    ):
        damped({"ratio": 0.02, "mass_proportional": 0.1})
