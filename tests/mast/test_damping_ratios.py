"""Damping of the guys of masts by given ratios: decay of each vibration, members, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mast_scenes import small
from scipy.optimize import curve_fit

import cablepod as cp
from cablepod.mast._condensed_guy import sines
from cablepod.mast._condensed_run import CondensedGuys, CondensedRun
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastRequest
from cablepod.mast._statics import rest_of
from cablepod.parameters._mast import mast_parameters

RATIOS = [0.01, 0.04, 0.02]


def damped(damping, **mast):
    def change(mapping):
        mapping["damping"] = damping
        mapping["mast"] |= mast
        del mapping["mast"]["load"]

    return small(change)


@pytest.mark.parametrize("number", [0, 1, 3, 5])
def test_each_vibration_of_a_guy_has_its_ratio(number):
    # a mast that is too heavy to move: the guys vibrate between fixed ends, from a start that no scene can give
    p = mast_parameters(damped({"ratios": RATIOS}, bending_stiffness=4e12, mass=2e7, base="clamped"))
    model = CondensedGuys(ModalMast(rest_of(p)), (sines(3), sines(3)), None)
    q, on_mast = model.rest
    squared, vectors = np.linalg.eigh(model.guys.stiffness_of(q, model.guys.upper)[1])
    omega = np.sqrt(squared[number])
    request = MastRequest(0.1 / omega * np.arange(600), 1, None, keeps_guys=True)
    start = q.copy()
    start[1] += 1e-4 / np.linalg.norm(vectors[:, number]) * vectors[:, number]
    rest = CondensedRun(model, None).run(replace(request, times=request.times[:2])).guy_position[0, 1]
    vars(model)["rest"] = start, on_mast
    moved = CondensedRun(model, None).run(request).guy_position[:, 1] - rest
    motion = (moved * moved[0]).sum(axis=(1, 2)) / (moved[0] ** 2).sum()

    def decaying(t, rate, frequency, c, s, mean):
        return np.exp(-rate * t) * (c * np.cos(frequency * t) + s * np.sin(frequency * t)) + mean

    rate, frequency = curve_fit(decaying, request.times, motion, p0=(0.02 * omega, omega, 1.0, 0.0, 0.0))[0][:2]
    assert np.hypot(rate, frequency) == pytest.approx(omega, rel=2e-3)
    assert rate / omega == pytest.approx(RATIOS[min(number, 2)], rel=0.02)


def test_ratios_damp_a_whole_mast_and_members(tmp_path):
    def change(mapping):
        mapping["mast"]["damping_ratio"] = 0.0
        mapping["damping"] = {"ratio": 0.0}

    scene = small(change)
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
