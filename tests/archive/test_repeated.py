"""Scripts that make files again compare values with the record: rounding is said, more is refused."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from histories import run_script
from suite import slow

import cablepod as cp
from cablepod import cli, examples, lineage, provenance


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The files of the first command of the README, with fewer ranks."""
    folder = tmp_path_factory.mktemp("run") / "out"
    scene = examples.scene_path("example2")
    assert cli.main(["run", str(scene), "--ranks", "1", "--out", str(folder)]) == 0
    return {path.stem: path for path in sorted(folder.glob("*.nc"))}


def script_of(path):
    return lineage.script(cp.archive.read(path, chunks={}))


def again(text):
    """What a script makes, and what it says."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        made = run_script(text)
    texts = [str(item.message) for item in said if issubclass(item.category, lineage.RepeatedWarning)]
    return made, texts


def perturb(monkeypatch, factor, functions=("chain.simulate",)):
    """Let a model compute another number in the last shape."""
    record = provenance.record

    def perturbed(result, *, function, **others):
        if function in functions:
            result["position"].values[-1, 3, 0] *= factor
        return record(result, function=function, **others)

    monkeypatch.setattr(provenance, "record", perturbed)


#: Files of a study that a quick test makes again; the other scripts are run by quick tests of what they say of rounding.
QUICK = ["scene", "summary", "catenary", "chain_rest", "chain", "condensed_r1"]


@pytest.mark.parametrize("name", [*QUICK, *map(slow, ("chain_half", "modes", "normal_modes", "galerkin_r1"))])
def test_the_files_of_a_study_are_made_again_with_the_same_numbers(name, files):
    made, said = again(script_of(files[name]))
    assert said == []
    before = cp.archive.read(files[name])
    assert made.attrs["id"] == before.attrs["id"]
    assert made.equals(before)


def test_all_files_of_a_study_are_looked_at(files):
    assert set(files) == {*QUICK, "chain_half", "modes", "normal_modes", "galerkin_r1", "comparison", "chains"}


@pytest.mark.parametrize("name", ["comparison", "chains"])
def test_tables_of_run_times_say_that_they_cannot_be_made_again(name, files):
    with pytest.raises(
        SystemExit, match=rf"study\.{name}, [0-9a-f]{{20}}: cannot be made again, it is a table of a study"
    ):
        again(script_of(files[name]))


@pytest.mark.parametrize("name", ["chain", "modes", "normal_modes", "galerkin_r1", "condensed_r1"])
def test_rounding_is_said_and_the_script_goes_on(name, files, monkeypatch):
    perturb(monkeypatch, 1.0 + 1e-12)
    made, said = again(script_of(files[name]))
    assert made.attrs["id"] == cp.archive.read(files[name]).attrs["id"]
    assert re.match(r"chain\.simulate, [0-9a-f]{20}: differs from the record within rounding, in position, ", said[0])


@pytest.mark.parametrize("name", ["chain", "modes", "galerkin_r1"])
def test_more_than_rounding_is_refused(name, files, monkeypatch):
    perturb(monkeypatch, 1.0 + 1e-6)
    with pytest.raises(
        cp.SceneError, match=r"chain\.simulate: given a result made again, of which position differs by "
    ):
        again(script_of(files[name]))


def test_what_was_changed_outside_is_named(soft, tmp_path):
    run = cp.chain.simulate(cp.make_scene(soft), step=1e-3, times=np.arange(21) / 10)
    changed = run.isel(time=slice(5)).assign(position=run.position.isel(time=slice(5)) + 1e-3)
    text = script_of(cp.archive.write(cp.pod.decompose(changed, rank=1), tmp_path / "modes.nc"))
    with pytest.raises(SystemExit) as stopped:
        again(text)
    assert "values were changed outside the package: position, tension, time; " in str(stopped.value)
    assert str(stopped.value).endswith("from 0 s to 0.4 s")
    bare = cp.pod.decompose(run.drop_attrs(), rank=1)
    with pytest.raises(SystemExit, match=r"made outside the package: .*time 21, from 0 s to 2 s"):
        again(lineage.script(bare))


def test_variables_left_out_are_left_out_again(soft):
    run = cp.chain.simulate(cp.make_scene(soft), step=1e-3, times=np.arange(21) / 10)
    modes = cp.pod.decompose(run.drop_vars("tension"), rank=1)
    made, said = again(lineage.script(modes))
    assert said == []
    assert made.identical(modes)


def test_another_id_with_the_same_values_is_said(soft):
    scene = cp.make_scene(soft)
    with pytest.warns(lineage.RepeatedWarning, match="has the id [0-9a-f]{20} in place of an id, with the same values"):
        lineage.check(scene, "an id", values=provenance.content_of(scene)["variables"])


def test_noise_is_compared_with_what_it_is_the_noise_of(soft):
    """A residual is as large as the rounding of tensions, so all of it may differ."""
    rest = cp.chain.rest(cp.make_scene(soft))
    values = provenance.content_of(rest)["variables"]
    other = rest.assign(residual=rest.residual.copy(data=3.0 * float(rest.residual) + 1e-12))
    with pytest.warns(lineage.RepeatedWarning, match="within rounding, in residual"):
        lineage.check(other, rest.attrs["id"], values=values)
    with pytest.raises(cp.SceneError, match="residual differs"):
        lineage.check(other.assign(residual=rest.residual.copy(data=1e-3)), rest.attrs["id"], values=values)
