"""Studies of a mast: its continuous guys, MoorDyn's lines beside its guys."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from mast import moordyn_lines, opensees, run


def test_extrapolation_leaves_nothing_of_an_error_of_second_order():
    exact = {name: np.arange(1.0, 4.0) for name in run.COMPARED}

    def chains(links):
        return xr.Dataset({name: ("guy", values + 7.0 / links**2) for name, values in exact.items()} | {"energy": 1.0})

    guys = run.extrapolated(chains(160), chains(80))
    assert sorted(guys.data_vars) == sorted(run.COMPARED)
    for name, values in exact.items():
        np.testing.assert_allclose(guys[name], values, rtol=1e-14)


@pytest.mark.slow
def test_chains_as_guys_agree_with_moordyn(tmp_path):
    pytest.importorskip("moordyn")
    rows = moordyn_lines.compare(opensees.still_mast(tmp_path), 20)
    errors = {row[2]: [float(text.split()[0]) for text in row[4:]] for row in rows}
    assert max(errors["chain, 20 links"]) < 2.0  # percent
    assert errors["condensed, r = 4"][0] < 1.5  # guys of the top level
