"""Results with the same labels and instants share their indexes, and labels have an order."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import cablepod as cp
from cablepod import examples
from cablepod.conventions import LABELS, is_in_order, label, shared_coordinates

# whichever test comes first makes the Datasets
pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")


def test_results_of_all_models_share_labels_and_instants():
    scene, times = examples.scene("example2"), np.linspace(0.0, 9.0, 19)
    chain = cp.chain.simulate(scene, links=10, times=times)
    modes = cp.pod.decompose(chain, rank=2, layout="normal")
    separate = cp.pod.decompose(chain, rank=2)
    results = [
        chain,
        cp.condensed.simulate(scene, modes, times=times),
        cp.galerkin.simulate(scene, separate, times=times),
        cp.cable.simulate(scene, elements=2, times=times),
        cp.pod.project(chain, separate),
        cp.pod.reconstruct(cp.pod.project(chain, separate), separate),
    ]
    for result in results:
        assert result.indexes["time"] is chain.indexes["time"], result.attrs["title"]
    for result in (scene, modes, separate, *results):
        assert result.indexes["coordinate"] is chain.indexes["coordinate"]
        assert result["coordinate"].dtype == "<U1"
        for other in (one for one in (scene, *results) if one is not result):
            assert result["coordinate"].attrs is not other["coordinate"].attrs


@pytest.mark.parametrize(
    "labels",
    [
        {"time": np.linspace(0.0, 1.0, 5), "coordinate": ["x", "y"]},
        {"time": np.arange(4), "mode": np.arange(1, 3), "arc_length": ("particle", [0.0, 1.0])},
        {"time": np.linspace(0.0, 1.0, 20_000), "coordinate": ("time", np.arange(20_000.0))},
        {"coordinate": np.array(["x", "y"], object), "end": ["lower", "upper"]},
    ],
    ids=["lists", "numbers", "long", "objects"],
)
def test_coordinates_are_those_of_xarray(labels):
    found = [label(xr.Dataset(coords=shared_coordinates(labels))) for _ in range(2)]
    expected = label(xr.Dataset(coords=labels))
    for one in found:
        xr.testing.assert_identical(one, expected)
        assert {name: v.dtype for name, v in one.variables.items()} == {
            name: v.dtype for name, v in expected.variables.items()
        }
        assert {name: index.dtype for name, index in one.indexes.items()} == {
            name: index.dtype for name, index in expected.indexes.items()
        }
    for name in labels:
        found[0][name].attrs["units"] = "changed"
    xr.testing.assert_identical(found[1], expected)


@pytest.mark.parametrize(
    ("name", "labels", "expected"),
    [
        ("time", [0.0, 1.0, 2.0], True),
        ("time", [3], True),
        ("time", [], False),
        ("time", [0.0, 1.0, 1.0], False),
        ("time", [0.0, 2.0, 1.0], False),
        ("time", [0.0, np.nan, 1.0], False),
        ("time", [np.nan], False),
        ("time", [-np.inf, 1.0], False),
        ("time", [0.0, np.inf], False),
        ("time", ["a", "b"], False),
        ("time", [[0.0, 1.0], [2.0, 3.0]], False),
        ("mode", [1, 2, 5], True),
        ("mode", [2, 1], False),
        ("mode", [1, 1], False),
        ("mode", [1.0, 2.0], False),
        ("mode", [False, True], False),
        ("coordinate", ["x", "y"], True),
        ("coordinate", ["x", "y", "z"], True),
        ("coordinate", ["y", "x"], False),
        ("coordinate", ["x"], False),
        ("coordinate", [0, 1], False),
        ("feature", LABELS["feature"], True),
        ("feature", LABELS["feature"][::-1], False),
    ],
)
def test_labels_in_order(name, labels, expected):
    assert is_in_order(name, np.array(labels)) is expected
    if np.ndim(labels) == 1:
        assert is_in_order(name, pd.Index(labels)) is expected
