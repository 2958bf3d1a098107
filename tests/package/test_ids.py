"""Ids follow from what was asked: not from numbers that rounding can change, and from each part of an ensemble."""

from __future__ import annotations

import numpy as np
import pytest
from histories import functions_of

import cablepod as cp
from cablepod import lineage, provenance
from cablepod.condensed import _prepared, _prepared_model
from cablepod.pod import _own

CLOSE = 1.0 + 1e-12


def scaled(function, factor=CLOSE):
    """A function whose result differs as from machine to machine."""
    return lambda *arguments: factor * function(*arguments)


# --- numbers that a function computes ---------------------------------------------------------------------------------------


def test_the_step_and_the_first_state_of_a_prepared_model_decide_on_no_id(soft, monkeypatch, tmp_path):
    scene = cp.make_scene(soft)
    modes = cp.condensed.vibration_modes(scene, rank=2)

    def made(step=None):
        return cp.condensed.prepare(scene, modes, step=step)

    before = made().dataset()
    given = [made(step).dataset().attrs["id"] for step in (1e-2, 1e-2 * CLOSE)]
    moved = made()
    moved.step(moved.end_position + 1e-3, np.zeros(moved.end_position.size), 1e-3)
    monkeypatch.setattr(_prepared, "preferred_steps_per_second", scaled(_prepared.preferred_steps_per_second))
    monkeypatch.setattr(_prepared_model, "initial_state", scaled(_prepared_model.initial_state))
    after = made().dataset()
    assert after.attrs["step"] != before.attrs["step"]
    assert not after.state.equals(before.state)
    assert after.attrs["id"] == before.attrs["id"]
    assert len({before.attrs["id"], *given, moved.dataset().attrs["id"]}) == 4
    # the same of one that was stored, here and on another machine
    back = cp.archive.read(cp.archive.write(before, tmp_path / "model.nc"))
    resumed = cp.condensed.resume(back).dataset()
    assert resumed.attrs["id"] == before.attrs["id"]
    assert resumed.identical(before)


def test_places_that_follow_from_a_tension_decide_on_no_id(soft, monkeypatch):
    scene = cp.make_scene(soft)
    position = cp.chain.simulate(scene, step=1e-3, times=np.arange(21) / 10).position.values
    sigma = np.linspace(0.0, 1.0, 11)
    calls = [
        lambda **options: cp.snapshots(position, times=np.arange(21) / 10, scene=scene, **options),
        lambda **options: cp.modes([np.sin(np.pi * sigma)], scene=scene, **options),
    ]
    before = [call() for call in calls]
    given = [
        call(arc_length=result.arc_length.values * factor).attrs["id"]
        for call, result in zip(calls, before, strict=True)
        for factor in (1.0, CLOSE)
    ]
    monkeypatch.setattr(_own, "_arc_length", scaled(_own._arc_length))
    after = [call() for call in calls]
    assert [result.attrs["id"] for result in after] == [result.attrs["id"] for result in before]
    assert not after[0].arc_length.equals(before[0].arc_length)
    assert len(set(given)) == 4


# --- parts of ensembles -------------------------------------------------------------------------------------------------------


@pytest.fixture
def runs(soft, tmp_path):
    """An ensemble on disk."""
    scenes = cp.ensemble.design(cp.make_scene(soft), {"cable.top_tension": [200.0, 260.0]}, members=4)
    return cp.ensemble.run(scenes, tmp_path / "it", batch=2, step=1e-3, times=np.arange(21) / 10)


def test_parts_of_an_ensemble_are_inputs_of_their_own(runs):
    for dataset in (runs, runs.compute()):
        whole = provenance.input_of(dataset)
        assert whole.id == runs.attrs["id"]
        assert provenance.CHANGED not in whole.history
        one = dataset.isel(member=0)
        parts = [one, dataset.isel(member=1), one.isel(time=slice(10)), one.isel(time=slice(10, 20))]
        modes = [cp.pod.decompose(part, rank=2) for part in parts]
        assert len({item.attrs["id"] for item in modes}) == 4
        for item in modes:
            assert functions_of(item)[-2:] == [provenance.CHANGED, "pod.decompose"]
        change = provenance.stages_of(modes[3])[-2]["parameters"]
        assert (change["first_instant"], change["last_instant"]) == (1.0, 1.9)
        assert change["sizes"]["time"] == 10
    noisy = dataset.assign(position=dataset.position + 1e-3)
    assert provenance.input_of(noisy).key != provenance.input_of(dataset).key


def test_the_script_of_a_part_of_an_ensemble_says_that_it_cannot_repeat_it(runs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = lineage.script(cp.pod.decompose(runs.isel(member=1), rank=2))
    with pytest.raises(SystemExit, match=r"changed outside the package: .*arc_length.*from 0 s to 2 s"):
        exec(compile(text, "lineage", "exec"), {})


def test_an_ensemble_in_one_file_keeps_its_id(runs, tmp_path):
    for number, dataset in enumerate((runs, runs.compute())):
        back = cp.archive.read(cp.archive.write(dataset, tmp_path / f"{number}.nc"))
        assert back.attrs["id"] == runs.attrs["id"]
        assert provenance.input_of(back).id == runs.attrs["id"]
    part = cp.archive.read(cp.archive.write(runs.isel(member=[1, 2]), tmp_path / "part.nc"))
    assert part.attrs["id"] != runs.attrs["id"]
    assert functions_of(part)[-1] == provenance.CHANGED


# --- values that are computed from chunks ---------------------------------------------------------------------------------------


def test_values_computed_from_chunks_are_a_change(soft, tmp_path):
    """They have no hash on record, and are not computed for one."""
    dask = pytest.importorskip("dask")
    run = cp.chain.simulate(cp.make_scene(soft), step=1e-3, times=np.arange(21) / 10)
    modes = cp.pod.decompose(run, rank=2)
    lazy = cp.archive.read(cp.archive.write(run, tmp_path / "run.nc"), chunks={"time": 7})
    same = (lazy, lazy.chunk({"time": 5}), lazy.isel(time=slice(None)), run.chunk({"time": 5}))
    noisy = lazy.assign(position=lazy.position + 1e-3)
    computed = []
    with dask.callbacks.Callback(pretask=lambda *_: computed.append(1)):
        assert {provenance.input_of(dataset).id for dataset in same} == {run.attrs["id"]}
        changed = [provenance.input_of(dataset) for dataset in (noisy, lazy.assign(position=1.001 * lazy.position))]
    assert computed == []
    assert len({found.id for found in changed} | {run.attrs["id"]}) == 3
    for measure in (lambda it: cp.compare.errors(it, run), lambda it: cp.pod.project(it, modes)):
        before, after = measure(lazy), measure(noisy)
        assert before.attrs["id"] == measure(run).attrs["id"] != after.attrs["id"]
        (stage,) = (stage for stage in provenance.stages_of(after) if stage["function"] == provenance.CHANGED)
        assert stage["parameters"]["differs"] == ["position"]
        assert "position" in stage["parameters"]["not_computed"]
    lazy.close()
