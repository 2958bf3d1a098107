"""How the folder of an ensemble opens: lazily, with its parameters and its provenance, and what is wrong with a file."""

from __future__ import annotations

import json
import shutil
import zlib

import numpy as np
import pytest
import xarray as xr
from compliance import check_compliance
from scenes import ENSEMBLE_STEP

import cablepod as cp
from cablepod import cli


def manifest_of(folder):
    return json.loads((folder / "manifest.json").read_text())


def manifest_text(manifest):
    """A manifest as the text of its file, with the CRC-32 of the rest."""
    content = {name: value for name, value in manifest.items() if name != "crc32"}
    crc = zlib.crc32(json.dumps(content, sort_keys=True).encode())
    return json.dumps({**content, "crc32": f"{crc:08x}"}, sort_keys=True)


def test_it_opens_lazily_with_parameters_to_choose_by(finished):
    whole = cp.archive.open_ensemble(finished)
    assert whole["position"].dims == ("member", "time", "particle", "coordinate")
    assert whole["position"].chunks[0] == (4, 4, 2)
    assert {"cable_top_tension", "ends_upper_x", "member", "arc_length", "time"} <= set(whole.coords)
    assert whole["arc_length"].dims == ("member", "particle")
    taut = whole.where(whole["cable_top_tension"] > 250.0, drop=True)
    assert taut.sizes["member"] == int((whole["cable_top_tension"] > 250.0).sum()) > 0
    by_tension = whole.swap_dims(member="cable_top_tension").sortby("cable_top_tension")
    wanted = float(whole["cable_top_tension"][7])
    np.testing.assert_array_equal(by_tension["position"].sel(cable_top_tension=wanted), whole["position"][7])
    np.testing.assert_array_equal(whole["position"].sel(member=9, time=2.0), whole["position"].values[9, 4])


def test_its_provenance_has_each_stage_once(finished):
    whole = cp.archive.open_ensemble(finished)
    manifest = manifest_of(finished)
    stages = json.loads(whole.attrs["history_json"])
    assert [stage["function"] for stage in stages] == ["make_scene", "ensemble.design", "ensemble.run"]
    assert whole.attrs["id"] == stages[-1]["id"] == manifest["id"]
    assert len(whole.attrs["history"].split("\n")) == 3
    assert stages[-1]["parameters"]["options"]["step"] == ENSEMBLE_STEP
    # and a batch by itself
    batch = cp.archive.read(finished / "batch_0001.nc")
    own = json.loads(batch.attrs["history_json"])[-1]
    assert own["parameters"]["number"] == 1
    assert own["parameters"]["ensemble"] == manifest["id"]
    assert own["wall_time_s"] > 0
    assert batch.attrs["history"].split("\n")[:2] == whole.attrs["history"].split("\n")[:2]


def test_what_was_opened_can_be_written_again(finished, tmp_path):
    whole = cp.archive.open_ensemble(finished)
    back = cp.archive.read(cp.archive.write(whole, tmp_path / "one.nc"))
    xr.testing.assert_equal(back, whole.compute())
    assert back.attrs["id"] == whole.attrs["id"]


def test_coordinates_that_all_batches_share_stay_shared(scenes_of, tmp_path):
    scenes = scenes_of(4, ranges={"motion.upper.x.amplitude": [-0.05, 0.01]})
    run = cp.ensemble.run(scenes, tmp_path / "it", batch=2, step=ENSEMBLE_STEP)
    assert run["arc_length"].dims == ("particle",)
    # one member alone shares everything with itself
    single = cp.ensemble.run(scenes_of(3), tmp_path / "other", batch=1, step=ENSEMBLE_STEP)
    assert single["arc_length"].dims == ("member", "particle")
    np.testing.assert_array_equal(
        single["arc_length"], cp.chain.simulate(scenes_of(3), step=ENSEMBLE_STEP)["arc_length"]
    )


def test_faults_of_files_are_named(copied):
    netCDF4 = pytest.importorskip("netCDF4")
    (copied / "batch_0000.nc").unlink()
    content = (copied / "batch_0001.nc").read_bytes()
    (copied / "batch_0001.nc").write_bytes(content[: len(content) // 2])
    with netCDF4.Dataset(copied / "batch_0002.nc", "a") as file:
        file.setncattr("cablepod_schema", np.int64(99))
    with pytest.raises(cp.ArchiveError) as caught:
        cp.archive.open_ensemble(copied)
    text = str(caught.value)
    assert "batch_0000.nc: is missing; run the ensemble again" in text
    assert "batch_0001.nc: is truncated or damaged" in text
    assert "batch_0002.nc: has schema version 99" in text


def test_faults_of_manifests_are_named(copied, tmp_path):
    with pytest.raises(cp.ArchiveError, match=r"has no manifest\.json, so it is no ensemble"):
        cp.archive.open_ensemble(tmp_path)
    with pytest.raises(cp.ArchiveError, match="is no folder"):
        cp.archive.open_ensemble(tmp_path / "nowhere")
    manifest = manifest_of(copied)
    (copied / "manifest.json").write_text(manifest_text(manifest | {"schema": 99}))
    with pytest.raises(cp.ArchiveError, match=r"manifest\.json: has schema version 99"):
        cp.archive.open_ensemble(copied)
    (copied / "manifest.json").write_text(manifest_text(manifest)[:-40])
    with pytest.raises(cp.ArchiveError, match=r"manifest\.json: is damaged"):
        cp.archive.open_ensemble(copied)
    # a batch of another ensemble
    (copied / "manifest.json").write_text(manifest_text(manifest))
    shutil.copy(copied / "batch_0001.nc", copied / "batch_0000.nc")
    with pytest.raises(cp.ArchiveError, match=r"batch_0000\.nc: is not batch 0 of the ensemble"):
        cp.archive.open_ensemble(copied)


def test_an_unfinished_ensemble_opens_only_on_demand(finished, copied, described):
    manifest = manifest_of(copied)
    (copied / "batch_0001.nc").unlink()
    del manifest["done"]["1"], manifest["done"]["2"]  # the third was written, but the run was killed before it noted it
    (copied / "manifest.json").write_text(manifest_text(manifest))
    with pytest.raises(
        cp.ArchiveError, match=r"4 of 10 members are not done yet; run the ensemble again.*incomplete=True"
    ):
        cp.archive.open_ensemble(copied)
    part, whole = cp.archive.open_ensemble(copied, incomplete=True), cp.archive.open_ensemble(finished)
    assert part["member"].values.tolist() == [0, 1, 2, 3, 8, 9]
    xr.testing.assert_equal(part.compute(), whole.isel(member=[0, 1, 2, 3, 8, 9]).compute())
    assert "done      6; the same command or call goes on" in described(copied)


def test_ten_thousand_members_open_by_the_manifest_and_heads_alone(finished, tmp_path, monkeypatch):
    # the clock is in pipelines/benchmarks; here: that no batch but one of each kind is opened by xarray
    opened, open_dataset = [], xr.open_dataset
    monkeypatch.setattr(
        xr, "open_dataset", lambda path, **options: opened.append(path.name) or open_dataset(path, **options)
    )
    cp.archive.open_ensemble(finished)
    assert [name for name in opened if name != "scenes.nc"] == ["batch_0000.nc"]


def test_its_lineage_makes_it_again(finished, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for path, number in ((finished, None), (finished / "batch_0001.nc", 1)):
        assert cli.main(["info", str(path), "--lineage"]) == 0
        exec(capsys.readouterr().out, made := {})
        first = cp.archive.open_ensemble(finished)
        again = cp.archive.read("runs_again.nc")
        np.testing.assert_array_equal(again["position"], first["position"][slice(4, 8) if number else slice(None)])
        assert made["runs"].attrs["id"] == (first if number is None else cp.archive.read(path)).attrs["id"]
        (tmp_path / "runs_again.nc").unlink()


def test_the_real_checker_finds_only_what_is_allowed(finished, scenes_of, slackened, tmp_path):
    with pytest.warns(cp.MemberFailedWarning):
        cp.ensemble.run(slackened(scenes_of(3), slice(None)), tmp_path / "failed", step=ENSEMBLE_STEP)
    cp.archive.write(cp.archive.open_ensemble(finished), tmp_path / "whole.nc")
    files = {
        "batch": finished / "batch_0000.nc",
        "whole": tmp_path / "whole.nc",
        "scenes": finished / "scenes.nc",
        "failed": tmp_path / "failed" / "batch_0000.nc",
    }
    check_compliance(files, tmp_path, have_time=("batch", "whole"))
