"""Results with the same labels and instants share their indexes, which are known to be in order."""

from __future__ import annotations

import importlib
import json
import tomllib
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from public_calls import datasets

import cablepod as cp
from cablepod import examples, provenance
from cablepod._inputs import MOTION, NORMAL_MODES, SCENE, _seen, taken
from cablepod.conventions import (
    IN_ORDER,
    LABELS,
    PLACES_IN_ORDER,
    _orders,
    is_in_order,
    keep_places,
    label,
    labelled_dataset,
    shared_coordinates,
)
from cablepod.conventions._orders import MAX_PLACES, MAX_PLACES_BYTES

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
        assert all(id(index) in IN_ORDER[name] for name, index in result.indexes.items())
        for other in (one for one in (scene, *results) if one is not result):
            assert result["coordinate"].attrs is not other["coordinate"].attrs


def test_a_new_result_needs_no_check_of_labels_places_and_history(monkeypatch):
    tree = tomllib.loads(examples.scene_path("example2").read_text())
    lengths = set()
    for tension in (14.3e3, 14.6e3):
        scene = cp.make_scene(tree | {"cable": tree["cable"] | {"top_tension": tension}})
        run = cp.chain.simulate(scene, links=10, times=np.linspace(0.0, 1e-3 * tension, 19), outputs="position")
        modes = cp.pod.decompose(run, rank=2, layout="normal")
        with monkeypatch.context() as patch:
            if lengths:  # the first may be the first of its kind
                patch.setattr(_seen, "label_orders", None)
                patch.setattr(_seen, "place_orders", None)
                patch.setattr(json, "loads", None)
            for result, kind in ((scene, SCENE), (run, MOTION), (modes, NORMAL_MODES)):
                assert taken("it", result, kind) is result
        lengths.add(float(run.unstretched_length))
    assert len(lengths) == 2


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


def test_an_index_out_of_order_is_not_noted():
    coordinates = shared_coordinates({"time": np.array([0.0, 2.0, 1.0]), "mode": np.array([1, 1])})
    assert not any(id(index) in IN_ORDER[name] for name, index in coordinates.indexes.items())


def content_of(arc: Any) -> bytes:
    """Arc lengths and the last of them as the unstretched length."""
    return np.ascontiguousarray(arc).tobytes() + np.ascontiguousarray(arc)[-1:].tobytes()


@pytest.mark.parametrize("make", [shared_coordinates, "template"])
@pytest.mark.parametrize(
    ("arc", "expected"),
    [
        (np.array([0.0, 1.0, 7.125]), True),
        (np.array([0.0, 1.0, 1.0]), False),
        (np.array([0.0, 2.0, 1.0]), False),
        (np.array([1.0, 2.0, 3.0]), False),
        (np.array([-1.0, 2.0, 3.0]), False),
        (np.array([0.0, np.nan, 3.0]), False),
        (np.array([np.nan, 1.0, 3.0]), False),
        (np.array([0.0, 1.0, np.inf]), False),
        (np.array([0.0]), False),
        (np.array([0.0, 1.0, 3.0], ">f8"), False),
        (np.array([0.0, 1.0, 3.0], "f4"), False),
        (np.array([0, 1, 3]), False),
        (np.array([[0.0, 1.0], [2.0, 3.0]]), False),
        (np.arange(float(MAX_PLACES_BYTES)), False),
    ],
)
def test_places_of_results_are_kept_if_they_are_in_order(monkeypatch, make, arc, expected):
    for name in ("_orders", "_datasets"):
        module = importlib.import_module(f"cablepod.conventions.{name}")
        monkeypatch.setattr(module, "PLACES_IN_ORDER", {}, raising=name == "_orders")
    if make == "template":
        labelled_dataset({}, {}, {"arc_length": (("member", "particle")[-arc.ndim :], arc)})
    else:
        make({"arc_length": (("member", "particle")[-arc.ndim :], arc)})
    assert list(_orders.PLACES_IN_ORDER) == ([content_of(arc)] if expected else [])


def test_places_kept_are_few():
    for number in range(2 * MAX_PLACES):
        keep_places(content_of([0.0, 1.0 + number]))
    assert 0 < len(PLACES_IN_ORDER) <= MAX_PLACES
    keep_places(bytes(MAX_PLACES_BYTES + 8))
    keep_places(b"")
    assert bytes(MAX_PLACES_BYTES + 8) not in PLACES_IN_ORDER
    assert b"" not in PLACES_IN_ORDER


def test_verdicts_on_histories_are_few():
    text = datasets()["chain"].attrs["history_json"]
    assert provenance.is_history(text)
    for number in range(2 * provenance.MAX_VERDICTS):
        assert not provenance.is_history(str(number))
    assert len(provenance.VERDICTS) <= provenance.MAX_VERDICTS
    assert provenance.is_history(text)
    for bad in ("", "{}", "[1]", "[{}]", '[{"id": 1, "function": "f"}]', '[{"id": "a"}]', "[" * 100_000):
        assert not provenance.is_history(bad)
