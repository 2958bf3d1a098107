"""Each stage records the content of its result and inputs; what was changed outside the package is a stage of its own."""

from __future__ import annotations

import functools

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from histories import functions_of
from results import make_modes, make_scene, make_trajectory

import cablepod as cp
from cablepod import provenance
from cablepod.integrate import _request as request
from cablepod.provenance import _content as content
from cablepod.provenance import _inputs as inputs


@pytest.fixture
def run(soft):
    """A small chain."""
    return cp.chain.simulate(cp.make_scene(soft), step=1e-3, times=np.arange(21) / 10)


def change_of(dataset):
    """The parameters of the stage that stands for a change."""
    (stage,) = (stage for stage in provenance.stages_of(dataset) if stage["function"] == provenance.CHANGED)
    return stage["parameters"]


def test_changed_values_have_another_id_and_a_stage_of_their_own(run):
    noise = 1e-6 * np.random.default_rng(0).standard_normal(run.position.shape)
    clean = cp.pod.decompose(run, rank=2)
    noisy = cp.pod.decompose(run.assign(position=run.position + noise), rank=2)
    assert clean.attrs["id"] != noisy.attrs["id"]
    assert functions_of(noisy) == ["make_scene", "chain.simulate", "changed outside the package", "pod.decompose"]
    change = change_of(noisy)
    assert change["differs"] == ["position"]
    assert change["sizes"]["time"] == 21
    assert (change["first_instant"], change["last_instant"]) == (0.0, 2.0)
    assert cp.pod.decompose(run, rank=2).attrs["id"] == clean.attrs["id"]
    assert provenance.CHANGED not in functions_of(clean)


def test_an_array_changed_in_place_is_noticed(run):
    before = cp.pod.decompose(run, rank=2)
    run["position"].values[3, 4, 1] = np.nextafter(run["position"].values[3, 4, 1], np.inf)  # of the same object
    assert cp.pod.decompose(run, rank=2).attrs["id"] != before.attrs["id"]


def test_two_slices_in_time_are_two_inputs(run):
    parts = [run.isel(time=slice(10)), run.isel(time=slice(10, None))]
    modes = [cp.pod.decompose(part, rank=2) for part in parts]
    assert modes[0].attrs["id"] != modes[1].attrs["id"]
    ends = [(change_of(part)["first_instant"], change_of(part)["last_instant"]) for part in modes]
    assert ends == [(0.0, 0.9), (1.0, 2.0)]
    assert change_of(modes[0])["sizes"]["time"] == 10


def test_several_inputs_are_told_apart(run):
    parts = [run.isel(time=slice(10)), run.isel(time=slice(10, None))]
    stream = cp.pod.Stream()
    for part in parts:
        stream.update(part)
    inputs = provenance.stages_of(stream.modes(rank=2))[-1]["inputs"]
    assert len(set(inputs)) == 2
    assert provenance.stages_of(cp.pod.decompose(parts, rank=2))[-1]["inputs"] == inputs


def test_a_file_changed_before_it_is_an_input_is_noticed(run, tmp_path):
    back = cp.archive.read(cp.archive.write(run, tmp_path / "run.nc"))
    same = cp.pod.decompose(back, rank=2)
    assert same.attrs["id"] == cp.pod.decompose(run, rank=2).attrs["id"]
    tension = back["tension"].copy(data=back["tension"].values + 1e-9)
    changed = cp.pod.decompose(back.assign(tension=tension), rank=2)
    assert changed.attrs["id"] != same.attrs["id"]
    assert change_of(changed)["differs"] == ["tension"]
    # also where it is written, as before it ever was
    for before in (run, back):
        written = cp.archive.read(cp.archive.write(before.assign(tension=tension), tmp_path / "it.nc", overwrite=True))
        assert functions_of(written)[-1] == provenance.CHANGED
        assert written.attrs["id"] == provenance.stages_of(changed)[-1]["inputs"][0]


def test_left_out_variables_and_units_are_changes(run):
    without = cp.pod.decompose(run.drop_vars("tension"), rank=2)
    assert change_of(without) | {"sizes": 0} == {
        "differs": [], "lacks": ["tension"], "sizes": 0, "first_instant": 0.0, "last_instant": 2.0,
    }  # fmt: skip
    filtered = run.copy()
    filtered["tension"].attrs["filter"] = "low-pass"
    assert change_of(cp.pod.decompose(filtered, rank=2))["differs"] == ["tension"]
    noted = cp.pod.decompose(run.assign_attrs(step=2e-3), rank=2)
    assert change_of(noted)["attributes"] == "differ"
    assert change_of(noted)["differs"] == []
    titled = run.assign_attrs(title="mine", comment="for the report")
    titled["position"].attrs["long_name"] = "Ort"
    assert provenance.CHANGED not in functions_of(cp.pod.decompose(titled, rank=2))


def test_a_dataset_without_a_history_is_told_by_its_content(run):
    bare = [run.drop_attrs(), run.assign(position=1.001 * run.position).drop_attrs()]
    for dataset in bare:
        assert "id" not in dataset.attrs
    modes = [cp.pod.decompose(dataset, rank=2) for dataset in bare]
    assert modes[0].attrs["id"] != modes[1].attrs["id"]
    assert functions_of(modes[0]) == ["made outside the package", "pod.decompose"]


def test_chunked_inputs_are_not_computed_and_the_history_says_so(run, tmp_path):
    dask = pytest.importorskip("dask")
    path = cp.archive.write(run, tmp_path / "run.nc")
    lazy = cp.archive.read(path, chunks={"time": 7})
    computed = []
    with dask.callbacks.Callback(pretask=lambda *_: computed.append(1)):
        found = provenance.input_of(lazy)
        part = provenance.input_of(lazy.isel(time=slice(5, 10)))
    assert computed == []
    assert found.id == run.attrs["id"]
    assert found.hash == f"{provenance.input_of(run).hash} as it was written, chunks are not computed"
    assert part.id not in (found.id, provenance.input_of(lazy.isel(time=slice(5))).id)
    stage = provenance.checked_stages(part.history)[-1]["parameters"]
    assert "time" in stage["differs"]
    assert stage["not_computed"] == sorted(name for name, item in lazy.variables.items() if item.chunks is not None)
    times = cp.pod.at_times(lazy, times=[0.5, 1.0])
    assert provenance.stages_of(times)[-1]["input_hashes"] == [found.hash]
    # what is written of lazy data is compared with what was recorded
    again = cp.archive.read(cp.archive.write(lazy, tmp_path / "same.nc"))
    assert again.attrs["id"] == run.attrs["id"]
    shifted = cp.archive.read(cp.archive.write(lazy.assign(position=lazy.position + 1.0), tmp_path / "shifted.nc"))
    assert change_of(shifted)["differs"] == ["position"]
    lazy.close()


def test_inputs_are_recorded_with_their_hashes(run):
    modes = cp.pod.decompose(run, rank=2)
    stage, made = provenance.stages_of(modes)[-1], provenance.stages_of(run)[-1]
    assert stage["input_hashes"] == [made["content"]["hash"]]
    assert made["content"] == provenance.content_of(run)


def test_nothing_that_was_chosen_decides_on_an_id(soft, monkeypatch):
    """A chosen tolerance differed in its 12th digit on another machine, and gave another id."""
    scene = cp.make_scene({**soft, "time": {"duration": 0.5, "interval": 0.25}})
    run = cp.chain.simulate(scene, times=np.arange(11) / 20)
    modes = cp.pod.decompose(run, rank=2, layout="normal")
    calls = [
        lambda: cp.condensed.simulate(scene, modes), lambda: cp.chain.simulate(scene), lambda: cp.cable.simulate(scene),
        lambda: cp.galerkin.simulate(scene, cp.pod.decompose(run, rank=2)),
    ]  # fmt: skip
    before = [call().attrs["id"] for call in calls]
    record = request.provenance.record
    seen = []

    def perturbed(factor, result, *, parameters, chosen=(), **others):
        numbers = {key: value for key, value in parameters.items() if key in chosen and isinstance(value, float)}
        seen.extend(numbers)
        return record(
            result,
            parameters=parameters | {key: value * factor for key, value in numbers.items()},
            chosen=chosen,
            **others,
        )

    for factor in (1.0 + 1e-12, 1.0 - 1e-12, 1.5):
        monkeypatch.setattr(request.provenance, "record", functools.partial(perturbed, factor))
        assert [call().attrs["id"] for call in calls] == before
    assert {"tolerance", "step"} <= set(seen)


def test_lengths_that_follow_from_a_tension_decide_on_no_id(soft, monkeypatch):
    """Only the tension is given, so the length is found by Newton's method, and its last digits are not the same everywhere."""
    scene = cp.make_scene(soft)
    several = scene.assign(cable_top_tension=("member", [200.0, 230.0], scene.cable_top_tension.attrs))
    stages = [
        provenance.stages_of(result)[-1]
        for result in (cp.cable.rest(scene), cp.cable.simulate(scene, times=[0.1]), cp.catenary.rest(several))
    ]
    for stage in stages:
        assert not {"arc_length", "unstretched_lengths"} & set(stage["parameters"])


# --- content ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [make_scene, make_trajectory, make_modes])
def test_the_content_is_that_of_the_file(make, tmp_path):
    made = make().assign(
        flags=("kind", np.array([True, False])), texts=("kind", ["a", "längeres"]), whole=("kind", np.array([1, 2], np.int16)),
        single=("kind", np.array([0.1, np.nan], np.float32)), odd=("kind", np.array([-np.nan, 1.0], ">f8")),
    )  # fmt: skip
    made["odd"].values.view(np.uint64)[0] |= 1  # bits of nan that no file keeps
    made.attrs |= {"one": 3, "few": [1.5, 2.0], "word": "x", "words": ["x", "y"], "number": np.float32(0.1)}
    back = cp.archive.read(cp.archive.write(made, tmp_path / "it.nc"))
    assert provenance.content_of(back) == provenance.content_of(made)
    assert provenance.input_of(back).hash == provenance.input_of(made).hash


def test_all_models_record_what_they_return(soft, tmp_path):
    """No stage sets a variable or an attribute after its record."""
    scene = cp.make_scene(soft | {"damping": {"mass_proportional": 0.1}})
    run = cp.chain.simulate(scene, times=np.arange(21) / 10, outputs=("position", "tension", "tension_extremes"))
    separate = cp.pod.decompose(run, rank=2, layout="separate")
    normal = cp.pod.decompose(
        run, rank=4, layout="normal"
    )  # lanes are compiled for a number of modes: that of other tests
    several = cp.ensemble.design(scene, {"cable.top_tension": [200.0, 230.0]}, members=2)
    amplitudes = cp.pod.project(run, separate)
    results = [
        scene, several, run, normal, separate, amplitudes, cp.pod.reconstruct(amplitudes, separate), cp.summary(scene),
        cp.catenary.rest(scene), cp.catenary.rest(several), cp.chain.rest(scene), cp.chain.rest(several), cp.cable.rest(scene),
        cp.rigid.rest(scene), cp.cable.frequencies(scene), cp.rigid.simulate(scene, times=[0.1]),
        cp.cable.simulate(scene, times=[0.1]), cp.galerkin.simulate(scene, separate), cp.condensed.simulate(scene, normal),
        cp.condensed.simulate(several, normal), cp.galerkin.simulate(several, separate), cp.chain.simulate(several),
        cp.condensed.vibration_modes(scene, rank=2), cp.compare.errors(run, run),
        cp.condensed.prepare(scene, normal).dataset(), cp.fatigue.ranges(run.tension.isel(link=0)),
    ]  # fmt: skip
    for result in results:
        found = provenance.input_of(result)
        assert found.id == result.attrs["id"], functions_of(result)
        assert provenance.stages_of(result)[-1]["content"]["hash"] == found.hash
        back = cp.archive.read(cp.archive.write(result, tmp_path / "it.nc", overwrite=True))
        assert provenance.input_of(back)[::2] == found[::2], functions_of(result)


def test_the_weighted_sum_tells_differences_of_single_values_from_rounding():
    rng = np.random.default_rng(2)
    for size in (2, 4095, 4096, 4097, 3 * 4096 + 5, 1_000_000):
        values = rng.uniform(1.0, 2.0, size)
        rounded = values * (1.0 + 2.0**-52 * rng.integers(-4, 5, size))
        off = values.copy()
        off[size // 2] += 1e-8
        sums = [content.weighted_sum(item) for item in (values, rounded, off)]
        # 4 in the last place, at random, and the rounding of the sum: below 1e-12 of the values up to a million of them
        assert abs(sums[1] - sums[0]) < 2e-12 * max(1.0, np.sqrt(size) / 100)
        assert 0.4e-8 < abs(sums[2] - sums[0]) < 1.6e-8
        parts = np.split(values, sorted({size // 3, size // 2}))
        starts = np.cumsum([0, *(part.size for part in parts[:-1])])
        total = sum(content.weighted_sum(part, int(start)) for part, start in zip(parts, starts, strict=True))
        assert total == pytest.approx(sums[0], abs=1e-11 * size)  # rounding of sums of numbers up to 2


def test_the_weights_are_the_same_everywhere():
    np.testing.assert_array_equal(content.weights(1024), content.weights(4096)[:1024])
    # SplitMix64 from 0 begins with 0xE220A8397B1DCDAF (odd: positive) and 0x6E789E6AA1B965F4 (even: negative)
    expected = [0.5 + (0xE220A8397B1DCDAF >> 11) / 2**53, -0.5 - (0x6E789E6AA1B965F4 >> 11) / 2**53]
    np.testing.assert_array_equal(content.weights(1024)[:2], expected)


@pytest.mark.parametrize(
    "value",
    [
        [], {"hash": "a", "attributes": "b"}, {"hash": 1, "attributes": "b", "variables": {}},
        *(
            {"hash": "a", "attributes": "b", "variables": {"x": entry}}
            for entry in (1, ["h"], ["h", [1.5]], ["h", [-1]], ["h", [2], 1.0], ["h", [2], 1.0, float("nan")], [1, [2]])
        ),
    ],
)  # fmt: skip
def test_a_content_of_another_form_is_no_history(value, run):
    stages = provenance.stages_of(run)
    stages[-1]["content"] = value
    with pytest.raises(ValueError, match="stage 2 has another content than a stage can have"):
        provenance.checked_stages(provenance._stages.SORTED.encode(stages))


def test_parts_of_a_result_are_not_recorded(soft):
    with provenance.unrecorded():
        assert "id" not in cp.chain.rest(cp.make_scene(soft)).attrs
    assert "id" in cp.chain.rest(cp.make_scene(soft)).attrs


def test_a_study_keeps_its_ids_in_a_tree(soft):
    tree = cp.study.run(cp.make_scene(soft), ranks=(1,))
    for name, node in tree.children.items():
        dataset = node.to_dataset()
        assert provenance.input_of(dataset).id == dataset.attrs["id"], name
    assert functions_of(tree["comparison"].to_dataset())[-1] == "study.comparison"


def test_made_variables_leave_other_datasets_alone(run):
    copy = run.copy(deep=True)
    provenance.input_of(run.assign(position=run.position + 1.0))
    xr.testing.assert_identical(run, copy)


OF_OTHER_TYPES = {
    "extended precision": lambda count: np.arange(count, dtype=np.longdouble) / 3,
    "extended complex": lambda count: np.arange(count, dtype=np.clongdouble) / 3,
    "half precision": lambda count: np.arange(count, dtype=np.float16),
    "integers of pandas": lambda count: pd.array([None, *range(1, count)], dtype="Int64"),
    "categories of pandas": lambda count: pd.Categorical(["a", "b"] * count)[:count],
    "texts of numpy": lambda count: np.array(["a", "b"] * count, np.dtypes.StringDType())[:count],
}


@pytest.mark.parametrize("name", OF_OTHER_TYPES)
def test_content_of_any_type_is_known(run, name):
    values = OF_OTHER_TYPES[name](run.sizes["time"])
    changed = values.copy()
    changed[1] = values[2]
    first, same, other = (run.assign(mine=("time", array)) for array in (values, values.copy(), changed))
    ids = [cp.pod.decompose(dataset, rank=2).attrs["id"] for dataset in (first, same, other)]
    assert ids[0] == ids[1] != ids[2]


def test_bytes_of_extended_precision_that_hold_no_digits_do_not_count():
    values = np.arange(5, dtype=np.longdouble) / 3
    others = values.copy()
    others.view(np.uint8).reshape(5, -1)[:, -1] ^= 255  # the last of 16 bytes, of which 10 are used
    if not np.array_equal(values, others):
        pytest.skip("all bytes hold digits here")
    ends = [content.VariableContent(xr.Variable("time", array)).update(array).hash for array in (values, others)]
    assert ends[0] == ends[1]
    others[2] *= 1 + np.finfo(np.longdouble).eps
    assert content.VariableContent(xr.Variable("time", others)).update(others).hash != ends[0]


@pytest.mark.parametrize("name", [7, ("mine", 1)])
def test_variables_without_a_text_for_a_name_are_inputs(run, soft, name, tmp_path):
    cp.archive.write(run, tmp_path / "run.nc")
    with cp.archive.read(tmp_path / "run.nc", chunks={"time": 7}) as lazy:
        assert change_of(cp.pod.decompose(lazy.assign({name: 1.0}), rank=2))["differs"] == [str(name)]
    scene = cp.make_scene(soft).assign({name: ("mine", [1.0, 2.0], {1: "number", "two": np.array([1, 2])})})
    change = change_of(cp.chain.simulate(scene, step=1e-3, times=[0.0, 0.1]))
    assert change["values"] == {str(name): [["mine"], [1.0, 2.0], {"1": "number", "two": [1, 2]}]}


@pytest.mark.parametrize("name", [7, ("mine", 1)])
def test_variables_without_a_text_for_a_name_are_compared_by_shape_where_their_hash_is_unknown(run, name):
    dataset = run.assign({name: ("time", np.zeros(run.sizes["time"]))}).chunk()
    recorded = provenance.stages_of(cp.pod.decompose(dataset, rank=2))[-2]["content"]
    recorded["variables"][str(name)] = [content.UNKNOWN, [run.sizes["time"]]]
    found = inputs._found(dataset, recorded, None)
    assert inputs._differing(dataset, recorded, found) == []
    assert inputs._differing(dataset.isel(time=slice(3)), recorded, found) != []


@pytest.mark.parametrize(
    "labels",
    [["y", "x", "é"], [3, 1, 2], [0.5, np.nan, 1e300], np.array([0.1, 0.2], "f4"), np.array(["a", None], object)],
)
def test_labels_have_the_content_of_their_values(labels):
    dataset = xr.Dataset(coords={"place": ("place", labels, {"units": "m"})})
    variable = dataset.variables["place"]
    entry = provenance.content_of(dataset)["variables"]["place"]
    assert entry == content.VariableContent(variable).update(variable.values).entry()


def test_attributes_that_are_equal_numbers_of_other_types_differ():
    hashes = {content.content_of_variable(xr.Variable((), 1.0, {"n": n})).hash for n in (1, 1.0, True)}
    assert len(hashes) == 3


@pytest.mark.parametrize(
    ("values", "largest"),
    [([-3.0, 2.0], 3.0), ([-0.0], 0.0), ([], 0.0), ([np.nan, -2.0, np.inf, 1.0], 2.0), ([np.nan], 0.0)],
)
def test_the_largest_value_is_that_of_the_finite_ones(values, largest):
    entry = content.content_of_variable(xr.Variable("x", np.array(values, float))).entry()
    assert entry[2] == largest
    assert np.signbit(entry[2]) == np.False_
