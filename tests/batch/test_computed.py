"""Variables that are computed on reading give the same elements as arrays."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from cablepod.batch import _computed as computed

SHAPE = (7, 5, 2)
VALUES = np.arange(70.0).reshape(SHAPE)


class Rows:
    """Rows of known values; counts those that are asked for."""

    def __init__(self):
        self.asked = 0

    def __call__(self, first, last):
        self.asked += last - first
        return VALUES[first:last].copy()


def variable():
    rows = Rows()
    return xr.Variable(*computed.computed_variable(("member", "time", "end"), SHAPE, rows)), rows


@pytest.mark.parametrize("block", [1, 3, 100])
@pytest.mark.parametrize(
    "key",
    [
        {},
        {"member": 2},
        {"member": -1, "time": 3},
        {"member": slice(1, 6)},
        {"member": slice(1, 6, 2), "time": slice(None, None, -1)},
        {"member": slice(None, None, -1)},
        {"member": slice(4, 4), "end": 1},
        {"member": [5, 0, 2], "time": [1, 1]},
        {"member": np.arange(7) > 3},
        {"member": xr.Variable("point", [6, 1]), "time": xr.Variable("point", [0, 4])},
    ],
    ids=str,
)
def test_elements_equal_those_of_an_array(monkeypatch, block, key):
    monkeypatch.setattr(computed, "BLOCK", block)
    truth = xr.Variable(("member", "time", "end"), VALUES)
    xr.testing.assert_identical(variable()[0].isel(key).load(), truth.isel(key))


def test_rows_are_computed_once_and_only_those_that_are_read():
    values, rows = variable()
    assert values.shape == SHAPE
    assert values.nbytes == VALUES.nbytes
    assert rows.asked == 0
    values.isel(member=slice(None, None, 3)).load()
    assert rows.asked == 3
    values.load()
    values.load()
    assert rows.asked == 3 + 7
