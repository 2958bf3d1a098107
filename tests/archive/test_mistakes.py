"""Paths, attributes and files that the archive refuses, each with a clear error."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from results import make_modes, make_scene, make_trajectory

from cablepod import SceneError
from cablepod.archive import ArchiveError, describe, read, write


def test_an_existing_file_is_kept_unless_asked_otherwise(tmp_path, monkeypatch):
    path = write(make_scene(), tmp_path / "it.nc")
    with pytest.raises(ArchiveError, match=r"it\.nc: exists already; give another path, or overwrite=True"):
        write(make_modes(), path)
    assert "gravity" in read(path)
    write(make_modes(), path, overwrite=True)
    assert "mode_shape" in read(path)

    fresh = tmp_path / "fresh.nc"
    fsync = os.fsync

    def meanwhile(handle):
        fsync(handle)
        fresh.write_text("of somebody else")

    monkeypatch.setattr(os, "fsync", meanwhile)
    with pytest.raises(ArchiveError, match=rf"^{fresh}: exists already"):
        write(make_scene(), fresh)
    assert fresh.read_text() == "of somebody else"
    assert sorted(item.name for item in tmp_path.iterdir()) == ["fresh.nc", "it.nc"]


def test_a_folder_that_cannot_take_the_file_is_named(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(ArchiveError, match=r"missing/it\.nc: .*missing does not exist; make that folder first"):
        write(make_scene(), tmp_path / "missing" / "it.nc")
    with pytest.raises(ArchiveError, match=r"file/it\.nc: .*file is not a folder"):
        write(make_scene(), tmp_path / "file" / "it.nc")
    with pytest.raises(ArchiveError, match=r"file/deeper does not exist"):
        write(make_scene(), tmp_path / "file" / "deeper" / "it.nc")
    with pytest.raises(ArchiveError, match=f"{tmp_path}: is a folder; give the path of a file in it"):
        write(make_scene(), tmp_path, overwrite=True)
    monkeypatch.setattr(os, "access", lambda *args: False)  # root may write anywhere
    with pytest.raises(ArchiveError, match=f"no permission to write in the folder {tmp_path}"):
        write(make_scene(), tmp_path / "it.nc")
    assert [item.name for item in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder in which not even root can write")
def test_a_folder_where_nobody_can_write_is_named():
    with pytest.raises(ArchiveError, match=r"^/proc/it\.nc: "):
        write(make_scene(), "/proc/it.nc")


@pytest.mark.parametrize("value", [None, True, np.bool_(False), {"a": 1}, [1, None], [], ["a", 1], 1j, b"b", [[1, 2]]])
def test_attributes_that_netcdf_cannot_hold_are_named(value, tmp_path):
    with pytest.raises(ArchiveError, match="dataset: attribute 'tolerance' is "):
        write(make_scene().assign_attrs(tolerance=value), tmp_path / "it.nc")
    scene = make_scene()
    scene["gravity"].attrs["seed"] = value
    with pytest.raises(ArchiveError, match=r"variable 'gravity': attribute 'seed' is .*leave it out, or make it a var"):
        write(scene, tmp_path / "it.nc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["id", "stage", "title", "summary", "history", "history_json", "wall_time_s"])
def test_an_array_in_place_of_a_text_or_number_of_the_package_is_named(name, tmp_path):
    for values in ([1.0, 2.0], ["a", "b"]):
        with pytest.raises(ArchiveError, match=f"^dataset: attribute '{name}' is array.*leave it out$"):
            write(make_scene().assign_attrs({name: np.array(values)}), tmp_path / "it.nc")
    assert list(tmp_path.iterdir()) == []


def test_names_that_would_be_decoded_and_types_that_change_are_refused(tmp_path):
    scene = make_scene()
    scene["gravity"].attrs["scale_factor"] = 2.0
    with pytest.raises(ArchiveError, match="variable 'gravity': no attribute of a file can be named 'scale_factor'"):
        write(scene, tmp_path / "it.nc")
    of_pandas = pd.array([1, None], dtype="Int64"), pd.Categorical(["a", "b"])
    for wrong in (1j, np.datetime64("2020-01-01", "ns"), np.array(["a", None], dtype=object), *of_pandas):
        with pytest.raises(ArchiveError, match=r"variable 'wrong': \S+ cannot be written; make it numbers or strings"):
            write(make_scene().assign(wrong=("n", wrong if np.ndim(wrong) else [wrong])), tmp_path / "it.nc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("chunks", [None, {}])
def test_files_that_are_none_of_ours_are_refused(chunks, tmp_path):
    if chunks is not None:
        pytest.importorskip("dask")
    with pytest.raises(ArchiveError, match=r"missing\.nc: does not exist; check the path"):
        read(tmp_path / "missing.nc", chunks=chunks)
    with pytest.raises(ArchiveError, match="is a folder or a device"):
        read(tmp_path, chunks=chunks)
    (path := tmp_path / "it.nc").write_bytes(b"")
    with pytest.raises(ArchiveError, match=r"it\.nc: is empty; make it again"):
        read(path, chunks=chunks)
    path.write_text("time,value\n0,1\n" * 100)
    with pytest.raises(ArchiveError, match=r"it\.nc: is not a netCDF-4 file"):
        read(path, chunks=chunks)
    for form in ("NETCDF4", "NETCDF3_64BIT"):
        xr.Dataset({"a": 1.0}).to_netcdf(path, engine="netcdf4", format=form)
        with pytest.raises(ArchiveError, match=r"it\.nc: was not written by cablepod \(no attribute cablepod_schema\)"):
            read(path, chunks=chunks)


@pytest.mark.parametrize("chunks", [2**70, "small", [1], {"time": "a"}])
def test_chunks_that_do_not_fit_are_no_damage(chunks, tmp_path):
    pytest.importorskip("dask")
    path = write(make_trajectory(), tmp_path / "it.nc")
    with pytest.raises(SceneError, match=r"^chunks: given .*; allowed: None, a whole number"):
        read(path, chunks=chunks)


def test_a_newer_file_is_refused_and_tells_both_versions(tmp_path):
    path = tmp_path / "it.nc"
    make_scene().drop_attrs().assign_attrs(cablepod_schema=4).to_netcdf(path, engine="netcdf4")
    with pytest.raises(ArchiveError, match=r"schema version 4, this cablepod \(.*\) knows versions up to 3; install a"):
        read(path)


def test_a_truncated_file_is_refused_wherever_it_was_cut(tmp_path, capfd):
    whole = write(make_trajectory(times=400), tmp_path / "whole.nc").read_bytes()
    path = tmp_path / "cut.nc"
    sizes = [1, 7, 8, 100, 511, 2048, *np.linspace(4096, len(whole) - 1, 25).astype(int), len(whole) - 2]
    for size in sizes:
        path.write_bytes(whole[:size])
        with pytest.raises(ArchiveError, match=r"cut\.nc: (is truncated or damaged|is not a netCDF-4 file) .*; "):
            read(path)
        with pytest.raises(ArchiveError, match=r"cut\.nc: "):
            describe(path)
    path.write_bytes(whole)
    xr.testing.assert_identical(read(path), read(tmp_path / "whole.nc"))
    assert capfd.readouterr().err == ""


def test_damage_within_the_data_is_refused(tmp_path, capfd):
    whole = write(make_trajectory(times=400), tmp_path / "whole.nc").read_bytes()
    stream = whole.index(b"\x78\x5e")  # where zlib data of level 4 begin
    path = tmp_path / "damaged.nc"
    path.write_bytes(whole[: stream + 100] + bytes(2000) + whole[stream + 2100 :])
    for task in (read, describe):
        with pytest.raises(ArchiveError, match=r"damaged\.nc: changed since it was written: position; .*verify=False"):
            task(path)
    with pytest.raises(ArchiveError, match=r"damaged\.nc: is truncated or damaged .*make it again"):
        read(path, verify=False)
    assert capfd.readouterr().err == ""
