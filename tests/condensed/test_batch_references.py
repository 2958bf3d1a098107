"""Members of a batch solve the equations of their links: an independent ODE solution of each."""

from __future__ import annotations

import numpy as np
import pytest
from member_scenes import CASES, scenes_of
from references.condensed_ode import Reference
from scenes import LENGTHS, full_modes
from suite import slow, with_slow

import cablepod as cp
from cablepod.condensed import _batch as condensed_batch
from cablepod.condensed._runs import SCHEMES

TIMES = np.array([0.4, 0.8])


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("case", with_slow(CASES, "material"))
def test_members_solve_the_equations_of_their_links(soft, monkeypatch, case, dims):
    scenes, modes = scenes_of(soft, *CASES[case], dims), full_modes(dims=dims)
    options = {"order": "leading", "scheme": SCHEMES[0], "times": TIMES, "outputs": ("position", "tension")}
    with monkeypatch.context() as patch:  # no member falls back to a single run
        patch.setattr(condensed_batch, "solve", None)
        coarse, fine = (cp.condensed.simulate(scenes, modes, step=h, **options) for h in (1 / 4000, 1 / 8000))

    # Richardson extrapolation of a second-order scheme, as for a single run: the error is of fourth order, below 1e-12 of the
    # fastest motion; DOP853 has a tolerance of 1e-11 a step, over about 1e3 steps
    def extrapolated(name, dim):
        values = (4.0 * fine[name] - coarse[name]) / 3.0
        return values.transpose("member", "time", dim, ...).values

    position, tension = extrapolated("position", "particle")[:, :, 1:-1], extrapolated("tension", "link")
    for i in range(scenes.sizes["member"]):
        positions, tensions = Reference(scenes.isel(member=i), LENGTHS, order="leading").motion(TIMES)
        np.testing.assert_allclose(position[i], positions, rtol=0, atol=1e-8, err_msg=f"member {i}")
        np.testing.assert_allclose(tension[i], tensions, rtol=0, atol=1e-7, err_msg=f"member {i}")


@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("case", with_slow(CASES, "tension"))
@pytest.mark.parametrize("scheme", ["numerov", slow(None)])
def test_members_with_steps_of_their_own_solve_them_as_well(soft, scheme, case, dims):
    scenes, modes = scenes_of(soft, *CASES[case], dims), full_modes(dims=dims)
    times, tolerance = np.linspace(0.0, 0.8, 41), 1e-6
    options = {"times": times, "tolerance": tolerance, "outputs": ("position", "tension", "tension_extremes")}
    run = cp.condensed.simulate(scenes, modes, scheme=scheme, **options)
    for i in range(scenes.sizes["member"]):
        reference, member = Reference(scenes.isel(member=i), LENGTHS, order="leading"), run.isel(member=i)
        positions, tensions = reference.motion(times)
        moved, error = (
            np.sqrt(((change**2).sum(axis=2)).mean(axis=1)).max()
            for change in (positions - positions[0], member.position.values[:, 1:-1] - positions)
        )
        assert error <= 2.0 * tolerance * moved + 1e-9, (
            f"member {i}"
        )  # a still cable moves by the tolerance of its start
        np.testing.assert_allclose(member.tension, tensions, rtol=1e-5, err_msg=f"member {i}")
        of_steps = reference.motion(np.arange(int(member.number_of_steps) + 1) * float(member.step))[1]
        for name, extreme in (("minimum", of_steps.min(axis=0)), ("maximum", of_steps.max(axis=0))):
            np.testing.assert_allclose(member[f"tension_{name}"], extreme, rtol=1e-5, err_msg=f"member {i}")
