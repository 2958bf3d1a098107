"""Fixture of all tests of figures."""

from __future__ import annotations

import copy

import matplotlib as mpl
import pytest

mpl.use("Agg")

from matplotlib import pyplot as plt


@pytest.fixture(autouse=True)
def _clean():
    """Every test closes its figures and must leave the global options as they were."""
    before = copy.deepcopy(dict(mpl.rcParams))
    yield
    plt.close("all")
    assert dict(mpl.rcParams) == before
