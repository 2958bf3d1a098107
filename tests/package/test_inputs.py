"""Datasets that functions are given: in order, put in order, or refused by the name of what is wrong."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr
from public_calls import datasets

import cablepod as cp
from cablepod import provenance
from cablepod._inputs import (
    AMPLITUDES,
    FIELD_MODES,
    MOTION,
    NORMAL_MODES,
    SCENE,
    SNAPSHOTS,
    TRAJECTORY,
    WITH_PLACES,
    taken,
)
from cablepod.provenance import Abridged

KINDS = {
    "scene": SCENE, "members": SCENE, "chain": TRAJECTORY, "condensed": SNAPSHOTS, "modes": FIELD_MODES,
    "vector modes": FIELD_MODES, "normal modes": NORMAL_MODES, "amplitudes": AMPLITUDES,
}  # fmt: skip
# whichever test comes first makes the Datasets
pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")


def in_order(stage: str, spatial: bool = False) -> xr.Dataset:
    """A Dataset of one's own, which is in order."""
    dataset = datasets(spatial)[stage].copy(deep=True)
    assert taken("it", dataset, KINDS[stage]) is dataset
    return dataset


@pytest.mark.parametrize("spatial", [False, True], ids=["plane", "space"])
@pytest.mark.parametrize("stage", KINDS)
def test_a_dataset_in_order_is_returned_as_it_is(stage, spatial):
    dataset = in_order(stage, spatial)
    assert dataset.identical(datasets(spatial)[stage])


def test_a_part_in_order_is_not_copied_and_one_put_in_order_shares_no_memory():
    part = datasets()["modes"].isel(mode=slice(0, 2))
    assert taken("it", part, FIELD_MODES) is part
    assert not np.shares_memory(taken("it", part.isel(coordinate=[1, 0]), FIELD_MODES).mode_shape, part.mode_shape)


def put(name: str, value: Any) -> Callable[[xr.Dataset], None]:
    """Put a number in the place of the last of an array, in place."""

    def change(dataset: xr.Dataset) -> None:
        dataset[name].values.reshape(-1)[-1] = value

    return change


def exchange(first: str, second: str) -> Callable[[xr.Dataset], None]:
    """Exchange two variables."""

    def change(dataset: xr.Dataset) -> None:
        one, other = dataset[first].variable, dataset[second].variable
        dataset[first], dataset[second] = other, one

    return change


def set_attrs(name: str, **attrs: Any) -> Callable[[xr.Dataset], None]:
    """Change attributes of a variable."""
    return lambda dataset: dataset[name].attrs.update(attrs)


def array_of(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[xr.Dataset], None]:
    """Put another array into a variable."""

    def put_array(dataset: xr.Dataset) -> None:
        dataset.variables[name].data = change(dataset.variables[name].values)

    return put_array


def coords(**labels: Any) -> Callable[[xr.Dataset], None]:
    """Give other labels."""

    def change(dataset: xr.Dataset) -> None:
        for name, value in labels.items():
            new = value(dataset[name].values) if callable(value) else value
            dataset.coords[name] = (name, new, dataset[name].attrs)

    return change


def first_of(name: str, dim: str) -> Callable[[xr.Dataset], None]:
    """Take the first of a dimension of a variable, which loses it."""
    return lambda dataset: dataset.update({name: dataset[name].variable.isel({dim: 0}).copy(deep=True)})


def renamed_attribute(old: str, new: str) -> Callable[[xr.Dataset], None]:
    """Rename an attribute, in its place among the others."""

    def change(dataset: xr.Dataset) -> None:
        dataset.attrs = {new if name == old else name: value for name, value in dataset.attrs.items()}

    return change


CHANGES: list[tuple[str, Callable[[xr.Dataset], Any], str]] = [
    ("chain", coords(time=lambda t: t[::-1]), "it: time: given .* rising instants"),
    ("chain", coords(time=lambda t: np.r_[t[:-1], np.nan]), "it: time: given .* rising instants"),
    ("chain", coords(time=lambda t: np.r_[t[:1], t[:-1]]), "it: time: given .* each once"),
    ("chain", coords(time=lambda t: np.arange(t.size).astype("M8[s]")), "it: time: given values of type date"),
    ("chain", coords(coordinate=["x", "x"]), r"it: coordinate: given \['x', 'x'\]"),
    ("chain", coords(coordinate=[0, 1]), r"it: coordinate: given \[0, 1\]"),
    ("chain", set_attrs("position", units="km"), "it: position: given units 'km'"),
    ("chain", set_attrs("velocity", units="m"), "it: velocity: given units 'm'"),
    ("chain", set_attrs("arc_length", units=np.array(["m"])), "it: arc_length: given units"),
    ("chain", set_attrs("tension", units=3), "it: tension: given units"),
    ("chain", exchange("position", "velocity"), "it: position: given units 'm s-1'"),
    ("chain", exchange("position", "tension"), "it: position: given units 'N'"),
    ("chain", first_of("position", "time"), "it: position: given the dimensions"),
    ("chain", renamed_attribute("title", "rank"), "it: rank: given"),
    ("chain", array_of("position", lambda a: a + 1j), "it: position: given values of type complex"),
    ("chain", array_of("position", lambda a: a.astype(str)), "it: position: given values of type <U"),
    ("chain", array_of("position", lambda a: a.astype("f2")), "it: position: given values of type float16"),
    ("chain", put("arc_length", np.nan), "it: arc_length: given"),
    ("chain", put("arc_length", 0.0), "it: arc_length: given"),
    ("chain", array_of("arc_length", lambda s: s + 1.25), r"it: arc_length: given '1.25 ... .* allowed: those of"),
    ("chain", array_of("arc_length", lambda s: s / 1000.0), r"it: arc_length: given .*0 ... 0.01"),
    ("chain", put("unstretched_length", 7.0), "it: arc_length: given .* of 7 m"),
    ("chain", lambda run: run.__delitem__("arc_length"), "it: given a Dataset of stage 'trajectory' without arc_length"),
    ("chain", lambda run: run.attrs.update(stage="comparison"), "it: given a Dataset of stage 'comparison'"),
    ("chain", lambda run: run.attrs.update(stage=["trajectory"]), "it: given a Dataset of stage"),
    ("chain", lambda run: run.attrs.update(stage=np.array(["trajectory"])), "it: given a Dataset of stage"),
    ("chain", lambda run: run.attrs.update(history_json="?"), r"it: history_json: given '\?'"),
    ("chain", lambda run: run.attrs.update(history_json=Abridged("[{}]")), r"it: history_json: given '\[{}\]'"),
    ("chain", lambda run: run.attrs.update(history_json=None), "it: history_json: given None"),
    ("chain", lambda run: run.attrs.update(step=np.array(run.attrs["step"])), "it: step: given array"),
    ("chain", lambda run: run.attrs.update(id=3), "it: id: given 3"),
    ("chain", lambda run: run.attrs.update(rank="two"), "it: rank: given 'two'"),
    ("modes", put("mode_shape", np.nan), "it: mode_shape: given 'values that are not finite'"),
    ("modes", put("mean", np.inf), "it: mean: given 'values that are not finite'"),
    ("modes", put("singular_value", -1e300), "it: singular_value: given 'values that are not finite'"),
    ("modes", first_of("mean", "coordinate"), "it: mean: given the dimensions"),
    ("modes", coords(mode=[1, 1, 2]), r"it: mode: given \[1, 1, 2\]"),
    ("modes", coords(mode=[1.0, 2.0, np.nan]), "it: mode: given"),
    ("modes", coords(bound=["least", "most"]), "it: bound: given"),
    ("modes", exchange("mode_shape", "mean"), "it: mode_shape: given"),
    ("modes", lambda modes: modes.attrs.update(layout="normal"), "it: given layout 'normal'"),
    ("modes", lambda modes: modes.attrs.update(layout=np.array(["separate"])), "it: given layout"),
    ("modes", lambda modes: modes.attrs.__delitem__("layout"), "it: given layout None"),
    ("amplitudes", put("amplitude", np.nan), "it: amplitude: given 'values that are not finite'"),
    ("amplitudes", coords(end=["left", "right"]), "it: end: given"),
    ("scene", put("ends_upper", np.inf), "it: ends_upper: given 'values that are not finite'"),
    ("scene", put("cable_area", np.inf), "it: cable_area: given 'values that are not finite'"),
    ("scene", set_attrs("gravity", units="km s-2"), "it: gravity: given units"),
    ("scene", lambda scene: scene.attrs.update(stage="modes"), "it: given a Dataset of stage 'modes'"),
    ("scene", lambda scene: scene.__delitem__("gravity"), "it: given a Dataset of stage 'scene' without gravity"),
    ("members", put("ends_upper", np.inf), "it: ends_upper: given 'values that are not finite'"),
]  # fmt: skip


@pytest.mark.parametrize(("stage", "change", "message"), CHANGES)
def test_a_change_in_place_is_refused_also_after_an_accepted_call(stage, change, message):
    dataset = in_order(stage)
    change(dataset)
    for _ in range(2):
        with pytest.raises(cp.SceneError, match=message):
            taken("it", dataset, KINDS[stage])


def test_a_public_call_refuses_what_was_changed_after_the_first():
    run, modes = (datasets()[stage].copy(deep=True) for stage in ("chain", "modes"))
    expected = cp.pod.project(run, modes)
    assert cp.pod.project(run, modes).identical(expected)
    run["position"].attrs["units"] = "km"
    with pytest.raises(
        cp.SceneError, match=r"^snapshots: position: given units 'km'; allowed: m, the units of the package$"
    ):
        cp.pod.project(run, modes)
    run["position"].attrs["units"] = "m"
    modes["mode_shape"].values[0, 0, 1] = np.nan
    with pytest.raises(cp.SceneError, match="modes: mode_shape: given 'values that are not finite'"):
        cp.pod.project(run, modes)


@pytest.mark.parametrize(
    ("stage", "change"),
    [
        ("chain", coords(coordinate=["y", "x"])),
        ("chain", array_of("arc_length", lambda s: s[::-1].copy())),
        ("chain", array_of("arc_length", lambda s: s.astype("f4"))),
        ("chain", coords(time=lambda t: t.astype("f4"))),
        ("modes", coords(mode=[3, 2, 1])),
        ("modes", array_of("mode_shape", lambda a: a.astype(">f8"))),
        ("scene", array_of("ends_upper", lambda a: np.repeat(a, 2)[::2])),
        ("scene", lambda scene: scene["ends_upper"].values.setflags(write=False)),
    ],
)
def test_a_change_in_place_that_is_legal_is_put_in_order(stage, change):
    dataset = in_order(stage)
    change(dataset)
    found = taken("it", dataset, KINDS[stage])
    assert found is not dataset
    assert found.identical(taken("it", dataset.copy(deep=True), KINDS[stage]))
    assert taken("it", found, KINDS[stage]) is found


def test_arrays_in_another_memory_order_are_looked_at():
    modes = in_order("modes")
    modes.variables["singular_value"].data = np.asfortranarray(modes["singular_value"].values)
    assert taken("it", modes, FIELD_MODES) is modes
    modes["singular_value"].values[0, 0] = np.nan
    with pytest.raises(cp.SceneError, match="it: singular_value: given 'values that are not finite'"):
        taken("it", modes, FIELD_MODES)


def test_a_kind_is_not_taken_for_another_one():
    for stage, kind in (("chain", AMPLITUDES), ("chain", SCENE), ("modes", NORMAL_MODES), ("amplitudes", TRAJECTORY)):
        dataset = in_order(stage)
        with pytest.raises(cp.SceneError, match="it: given"):
            taken("it", dataset, kind)


#: Variables of a trajectory that comparing and projecting it does not read.
UNREAD = {
    "units": set_attrs("tension", units="kN"),
    "type": array_of("velocity", lambda a: a + 1j),
    "labels": coords(feature=list("abcdef")),
    "dimensions": first_of("velocity", "time"),
    "attribute": lambda run: run.attrs.update(rank="two"),
    "missing": lambda run: run.__delitem__("tension"),
}


@pytest.mark.parametrize("change", UNREAD.values(), ids=UNREAD)
def test_what_a_comparison_does_not_read_is_not_looked_at(change):
    run, model = (datasets()[stage].copy(deep=True) for stage in ("chain", "condensed"))
    expected = [cp.compare.errors(model, run).error, cp.pod.project(run, datasets()["modes"]).amplitude]
    change(run)
    found = [cp.compare.errors(model, run).error, cp.pod.project(run, datasets()["modes"]).amplitude]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    assert taken("it", run, MOTION) is run


def test_what_a_comparison_does_not_read_is_not_put_in_order():
    run = datasets()["chain"]
    expected = cp.compare.errors(run, run).error
    other = run.isel(coordinate=[1, 0]).assign_coords(link_arc_length=("link", ["a"] * run.sizes["link"]))
    np.testing.assert_array_equal(cp.compare.errors(other, run).error, expected)
    with pytest.raises(cp.SceneError, match="snapshots: link_arc_length: given"):
        cp.pod.decompose(other)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (change, message)
        for stage, change, message in CHANGES
        if stage == "chain" and not any(name in message for name in ("velocity", "tension", "rank", "step"))
    ],
)
def test_what_a_comparison_reads_is_looked_at(change, message):
    run = datasets()["chain"].copy(deep=True)
    assert taken("it", run, MOTION) is run
    change(run)
    with pytest.raises(cp.SceneError, match=message.replace("it: ", "run: ", 1)):
        cp.compare.errors(run, datasets()["chain"])


@pytest.mark.parametrize("name", ["history_json", "id"])
def test_an_attribute_without_a_value_is_none_that_lacks(name):
    run = datasets()["chain"].copy(deep=True)
    for attribute in ("history_json", "id"):
        run.attrs.pop(attribute, None)
    assert taken("it", run, MOTION) is run
    with pytest.raises(cp.SceneError, match=f"it: {name}: given None"):
        taken("it", run.assign_attrs({name: None}), MOTION)


@pytest.mark.parametrize("name", ["coordinate", "unstretched_length"])
def test_a_motion_may_lack_labels_and_length(name):
    run = datasets()["chain"].drop_vars(name)
    assert taken("it", run, MOTION) is run


def test_a_coordinate_left_of_a_selection_is_in_order_only_where_it_may_be():
    run = datasets()["chain"].isel(coordinate=[0])
    assert taken("it", run, WITH_PLACES) is run
    with pytest.raises(cp.SceneError, match=r"it: coordinate: given \['x'\]"):
        taken("it", run, TRAJECTORY)


def test_instants_without_an_index_are_looked_at():
    run = in_order("chain").drop_indexes("time")
    assert taken("it", run, TRAJECTORY) is run
    run.variables["time"].data = run["time"].values[::-1].copy()
    with pytest.raises(cp.SceneError, match=r"it: time: given .* rising instants"):
        taken("it", run, TRAJECTORY)


def test_an_unstretched_length_that_is_no_float_is_looked_at():
    run = datasets()["chain"].copy(deep=True)
    arc = np.linspace(0.0, 8.0, run.sizes["particle"])
    run = run.assign_coords(arc_length=("particle", arc, {"units": "m"})).assign(
        unstretched_length=((), np.int64(8), {"units": "m"})
    )
    assert taken("it", run, MOTION) is run
    run["unstretched_length"].values[...] = 9
    with pytest.raises(cp.SceneError, match="it: arc_length: given"):
        taken("it", run, MOTION)


def test_a_length_without_places_is_not_looked_at():
    """Amplitudes have no particles: an unstretched length of their own decides on nothing."""
    amplitudes = in_order("amplitudes").assign(unstretched_length=((), 7.0, {"units": "m"}))
    assert taken("it", amplitudes, AMPLITUDES) is amplitudes


def test_lazy_snapshots_stay_lazy_and_their_places_are_loaded():
    run = datasets()["chain"].copy(deep=True)
    names = ("position", "velocity", "tension")
    lazy = run.assign({name: run[name].chunk(time=2) for name in names})
    assert taken("it", lazy, TRAJECTORY) is lazy
    found = taken("it", lazy.chunk(), TRAJECTORY)
    assert all(found[name].chunks is not None for name in names)
    assert found["arc_length"].chunks is None
    with pytest.raises(cp.SceneError, match="it: arc_length: given"):
        taken("it", lazy.chunk().assign_coords(arc_length=2.0 * lazy["arc_length"].chunk()), TRAJECTORY)


def test_trajectories_of_a_decomposition_are_checked_once(monkeypatch):
    count = []

    def counted(key: str, given: Any, kind: Any) -> Any:
        count.append(key)
        return taken(key, given, kind)

    for module in ("cablepod._inputs._taken", "cablepod.pod._stream"):
        monkeypatch.setattr(f"{module}.taken", counted)
    run = datasets()["chain"]
    cp.pod.decompose([run, run])
    assert count == ["snapshots[0]", "snapshots[1]"]


@pytest.mark.parametrize("dtype", [pickle.loads(pickle.dumps(np.dtype(float))), np.dtype(float, metadata={"a": 1})])
def test_types_that_equal_those_of_numpy_are_taken_for_them(dtype):
    assert dtype is not np.dtype(float)
    other = datasets()["modes"].copy(deep=True)
    for name, variable in other.variables.items():
        if variable.dtype == dtype and name not in other.indexes:
            variable.data = variable.values.view(dtype)
    assert other["mode_shape"].dtype is dtype
    assert taken("it", other, FIELD_MODES) is other
    other["mode_shape"].values[0, 0, 1] = np.nan
    with pytest.raises(cp.SceneError, match="it: mode_shape: given 'values that are not finite'"):
        taken("it", other, FIELD_MODES)


def test_lengths_of_modes_are_looked_at():
    modes = in_order("modes")
    for factor in (1e200, np.nan):
        other = modes.copy(deep=True)
        for name in ("arc_length", "unstretched_length"):
            other[name].values[...] *= factor
        with pytest.raises(cp.SceneError, match=r"it: \w+_length: given"):
            taken("it", other, FIELD_MODES)


@pytest.mark.parametrize(
    "text", ["", "{}", "[1]", "[{}]", '[{"id": 1, "function": "f"}]', '[{"id": "a"}]', "[" * 100_000], ids=range(7)
)
def test_a_text_that_is_no_history_is_refused(text):
    history = datasets()["chain"].attrs["history_json"]
    assert provenance.is_history(history)
    for _ in range(2):
        assert not provenance.is_history(text)
    run = datasets()["chain"].assign_attrs(history_json=text)
    with pytest.raises(cp.SceneError, match="it: history_json: given"):
        taken("it", run, TRAJECTORY)
