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
    options = {"order": "leading", "scheme": SCHEMES[0], "times": TIMES, "outputs": ("position",)}
    with monkeypatch.context() as patch:  # no member falls back to a single run
        patch.setattr(condensed_batch, "solve", None)
        coarse, fine = (cp.condensed.simulate(scenes, modes, step=h, **options).position for h in (1 / 4000, 1 / 8000))
    # Richardson extrapolation of a second-order scheme, as for a single run: the error is of fourth order, below 1e-12 of the
    # fastest motion; DOP853 has a tolerance of 1e-11 a step, over about 1e3 steps
    found = ((4.0 * fine - coarse) / 3.0).transpose("member", "time", "particle", "coordinate").values[:, :, 1:-1]
    for i in range(scenes.sizes["member"]):
        reference = Reference(scenes.isel(member=i), LENGTHS, order="leading").positions(TIMES)
        np.testing.assert_allclose(found[i], reference, rtol=0, atol=1e-8, err_msg=f"member {i}")
