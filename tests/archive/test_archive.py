"""The archive: identical round trips, whole files or none, clear refusals, and the judgement of the real checker."""

import errno
import json
import os
import re
import signal
import subprocess
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from children import python, run_python
from compliance import check_compliance
from results import KINDS, make_ensemble, make_modes, make_scene, make_trajectory

from cablepod import archive, provenance
from cablepod.archive import ArchiveError, describe, read, write

ROOT = Path(archive.__file__).parents[1]


def dtypes(dataset):
    return {name: item.dtype for name, item in dataset.variables.items()}


def is_open(path):
    """Tell whether this process holds `path` open; where that cannot be known, say no."""
    handles = Path("/proc/self/fd")
    names = [os.readlink(item) for item in handles.iterdir() if item.is_symlink()] if handles.is_dir() else []
    return str(path) in names


def visible(folder):
    return [item.name for item in folder.iterdir() if not item.name.startswith(".")]


# round trip


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_read_is_what_was_written(kind, tmp_path):
    dataset = KINDS[kind]()
    before = dataset.copy(deep=True)
    path = write(dataset, tmp_path / "it.nc")
    assert path == tmp_path / "it.nc"
    xr.testing.assert_identical(dataset, before)
    back = read(path)
    assert dtypes(back) == dtypes(dataset)
    assert {name: item.attrs for name, item in back.variables.items()} == {
        name: item.attrs for name, item in dataset.variables.items()
    }
    assert all(back.attrs[name] == value for name, value in dataset.attrs.items() if name != "history_json")
    xr.testing.assert_identical(
        back.assign_attrs(history_json=""), dataset.assign_attrs({**back.attrs, "history_json": ""})
    )
    assert all(not item.encoding for item in back.variables.values())
    assert not is_open(path)
    assert [item.name for item in tmp_path.iterdir()] == ["it.nc"]


def test_an_eager_read_closes_the_file(tmp_path, monkeypatch):
    path = write(make_trajectory(), tmp_path / "it.nc")
    opened = []
    monkeypatch.setattr(archive, "_open", lambda *args, _open=archive._open: opened.append(_open(*args)) or opened[-1])
    for task in (read, describe):
        task(path)
        assert not is_open(path)
    assert len(opened) == 2  # and still referred to, so that nothing else closed it


@pytest.mark.parametrize("kind", KINDS)
def test_a_second_write_changes_nothing(kind, tmp_path, monkeypatch):
    first = read(write(KINDS[kind](), tmp_path / "p.nc"))
    stop_clock(monkeypatch, "2099-01-01T00:00:00Z")
    second = read(write(first, tmp_path / "q.nc"))
    xr.testing.assert_identical(first, second)
    assert dtypes(first) == dtypes(second)


def test_inherited_encodings_and_attributes_of_the_input_stay_out_of_the_file(tmp_path):
    dataset = make_trajectory()
    dataset["position"].encoding = {"dtype": "f4", "scale_factor": 0.1, "_FillValue": -1.0}
    dataset.encoding = {"unlimited_dims": {"time"}}
    before = dataset["position"].encoding.copy()
    back = read(write(dataset, tmp_path / "it.nc"))
    xr.testing.assert_equal(back, dataset)
    assert back["position"].dtype == np.float64
    assert dataset["position"].encoding == before
    netCDF4 = pytest.importorskip("netCDF4")
    with netCDF4.Dataset(tmp_path / "it.nc") as file:
        assert not file.dimensions["time"].isunlimited()


def test_strings_of_any_kind_and_empty_arrays_come_back(tmp_path):
    dataset = xr.Dataset(
        {
            "none": ("nothing", np.zeros(0)),
            "words": ("word", np.array(["Å", "", "catenary "], dtype=object)),
            "pairs": (("word", "side"), [["a", "bb"], ["", "é"], ["x", "y"]]),
        }
    )
    back = read(write(dataset, tmp_path / "it.nc"))
    assert back["words"].dtype.kind == "U"
    assert back["words"].values.tolist() == ["Å", "", "catenary "]
    xr.testing.assert_identical(back.drop_attrs(), dataset)


def test_time_stays_in_elapsed_seconds(tmp_path):
    dataset = make_trajectory()
    # xarray knows this spelling as a unit of time spans, and "s" only in some versions
    dataset["duration"] = xr.DataArray(124.0, attrs={"units": "seconds", "long_name": "length of the run"})
    dataset["instant"] = xr.DataArray(0.0, attrs={"units": "s since 2030-01-01", "long_name": "clock at the start"})
    back = read(write(dataset, tmp_path / "it.nc"))
    assert back["time"].dtype == np.float64
    assert back["instant"].dtype == np.float64
    assert back["duration"].dtype == np.float64
    assert back["time"].attrs["units"] == "s"


def test_a_lazy_read_gives_the_same_values_in_chunks(tmp_path):
    dataset = make_ensemble()
    dask = pytest.importorskip("dask.array")
    path = write(dataset, tmp_path / "it.nc")
    with read(path, chunks={"time": 5}) as lazy:
        assert isinstance(lazy["position"].data, dask.Array)
        assert lazy["position"].chunks[1] == (5, 5, 5, 5)
        assert lazy["motion_upper_x_kind"].dtype == dataset["motion_upper_x_kind"].dtype
        xr.testing.assert_identical(lazy.compute(), read(path))
        # its way back to a file, which needs no more memory than a chunk
        again = write(lazy, tmp_path / "again.nc")
    assert not is_open(path)
    xr.testing.assert_identical(read(again), read(path))


def test_a_lazy_read_without_dask_says_so(tmp_path, monkeypatch):
    path = write(make_scene(), tmp_path / "it.nc")
    monkeypatch.setattr(archive, "find_spec", lambda name: None)
    with pytest.raises(ArchiveError, match="needs dask; install it, or read without chunks"):
        read(path, chunks={})


def test_import_is_light():
    # a stand-in for the package keeps what its other modules import out of the count
    code = (
        "import sys, types; package = types.ModuleType('cablepod'); "
        f"package.__path__ = [{str(ROOT / 'cablepod')!r}]; sys.modules['cablepod'] = package; "
        "import cablepod.archive; print(sorted({'netCDF4', 'dask', 'matplotlib', 'numba'} & set(sys.modules)))"
    )
    done = run_python("-c", code, timeout=60)
    assert done.stdout.strip() == "[]", done.stderr


# layout


def test_large_float_arrays_are_compressed_in_complete_rows_of_particles():
    big = make_trajectory(times=3000, particles=41)
    encoding = archive.encoding_of(big)
    position = encoding["position"]
    assert (position["zlib"], position["complevel"], position["shuffle"]) == (True, 4, True)
    times, *rest = position["chunksizes"]
    assert rest == [41, 2]
    assert times == 2**20 // (41 * 2 * 8)  # about 1 MB, counted in whole rows
    assert "zlib" not in encoding["tension_maximum"]
    assert encoding["coordinate"] == {"dtype": "S1", "char_dim_name": "coordinate_characters"}


def test_chunks_are_cut_along_member_only_when_all_times_fit():
    shape = (64, 100, 41, 2)  # 65.6 kB a member
    ensemble = xr.Dataset({"position": (("member", "time", "particle", "coordinate"), np.zeros(shape))})
    assert archive.encoding_of(ensemble)["position"]["chunksizes"] == (15, 100, 41, 2)
    modes = xr.Dataset({"mode_shape": (("mode", "particle"), np.zeros((60, 4000)))})
    assert archive.encoding_of(modes)["mode_shape"]["chunksizes"] == (60, 4000)


def test_fill_values_are_declared_only_where_data_have_gaps(tmp_path):
    netCDF4 = pytest.importorskip("netCDF4")
    path = write(make_ensemble(), tmp_path / "it.nc")
    with netCDF4.Dataset(path) as file:
        filled = {name for name, item in file.variables.items() if "_FillValue" in item.ncattrs()}
    assert filled == {"position"}
    gap = xr.Dataset({"a": ("m", [1.0, np.nan])}, {"cable_top_tension": ("m", [np.nan, 2.0])})
    assert np.isnan(archive.encoding_of(gap)["a"]["_FillValue"])
    assert archive.encoding_of(gap)["cable_top_tension"]["_FillValue"] is None
    if find_spec("dask"):  # what a lazy variable holds is not known before it is computed
        assert np.isnan(archive.encoding_of(make_trajectory().chunk())["position"]["_FillValue"])


# provenance


def stop_clock(monkeypatch, instant):
    class Clock(archive.datetime):
        @classmethod
        def now(cls, tz=None):
            return cls.strptime(instant, "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=tz)

    monkeypatch.setattr(archive, "datetime", Clock)


def test_each_stage_adds_one_line_and_keeps_the_earlier_ones(tmp_path, monkeypatch):
    stop_clock(monkeypatch, "2030-01-01T00:00:00Z")
    scene = read(write(make_scene(), tmp_path / "scene.nc"))
    assert scene.attrs["history"].startswith("2030-01-01T00:00:00Z cablepod ")
    assert scene.attrs["history"].count("\n") == 0
    stop_clock(monkeypatch, "2030-01-02T00:00:00Z")
    # as a science module does: the new dataset has only history_json from its input
    trajectory = make_trajectory(scene=scene).assign_attrs(wall_time_s=12.5)
    back = read(write(trajectory, tmp_path / "trajectory.nc"))
    lines = back.attrs["history"].split("\n")
    assert lines[0] == scene.attrs["history"]
    assert re.fullmatch(r"2030-01-02T00:00:00Z cablepod \S+: chain\.simulate\(.*\) id=\w{20} inputs=\w{20}", lines[1])
    assert len(lines) == 2
    old, new = json.loads(back.attrs["history_json"])
    assert old == json.loads(scene.attrs["history_json"])[0]
    assert {"program", "version", "written", "platform", "sha256"} <= set(new)
    assert new["wall_time_s"] == 12.5
    assert None not in [new.get("commit", "")]
    assert "wall_time_s" not in back.attrs
    assert back.attrs["date_created"] == "2030-01-02T00:00:00Z"
    # a history that came along, with a line of somebody else's, is appended to and never replaced
    carried = make_trajectory(scene=scene).assign_attrs(history="2029-12-31T00:00:00Z cut by hand\n" + lines[0])
    assert read(write(carried, tmp_path / "carried.nc")).attrs["history"].split("\n") == [
        "2029-12-31T00:00:00Z cut by hand",
        *lines,
    ]


def test_a_cut_in_time_tells_its_own_length_and_content(tmp_path):
    whole = read(write(make_trajectory(), tmp_path / "whole.nc"))
    assert whole.attrs["time_coverage_duration"] == "PT5.9S"
    assert whole.attrs["time_coverage_resolution"] == "PT0.1S"
    some = read(write(whole.isel(time=[0, 1, 5]), tmp_path / "some.nc"))
    assert some.attrs["time_coverage_duration"] == "PT0.5S"
    assert "time_coverage_resolution" not in some.attrs
    assert archive._stages(some)[-1]["sha256"] == archive._content_hash(some) != archive._content_hash(whole)
    none = read(write(whole.isel(time=0), tmp_path / "none.nc"))
    assert "time_coverage_duration" not in none.attrs


def test_texts_made_for_an_input_are_not_taken_over_but_a_given_title_is(tmp_path):
    del (scene := make_scene()).attrs["title"]
    scene = read(write(scene, tmp_path / "scene.nc"))
    assert scene.attrs["title"] == "Result of make_scene"
    shorter = provenance.record(scene.copy(), function="scene.cut", parameters={}, inputs=[scene])
    back = read(write(shorter, tmp_path / "cut.nc"))
    assert back.attrs["title"] == "Result of scene.cut"
    assert "scene.cut" in back.attrs["summary"]
    assert read(write(make_scene(), tmp_path / "titled.nc")).attrs["title"].startswith("Example 2")


def test_id_and_content_hash_depend_on_neither_clock_nor_machine(tmp_path, monkeypatch):
    plain = xr.Dataset({"mean": ("particle", np.arange(3.0), {"units": "m"})})
    first = read(write(plain, tmp_path / "first.nc"))
    stop_clock(monkeypatch, "2040-01-01T00:00:00Z")
    monkeypatch.setattr(archive.platform, "platform", lambda: "elsewhere")
    archive._program.cache_clear()
    try:
        second = read(write(plain, tmp_path / "second.nc"))
    finally:
        archive._program.cache_clear()
    assert first.attrs["history_json"] != second.attrs["history_json"]
    assert first.attrs["id"] == second.attrs["id"]
    assert archive._stages(first)[-1]["sha256"] == archive._stages(second)[-1]["sha256"]
    swapped = plain.assign(mean=("particle", np.array([0.0, 1.0, 2.0]).astype(">f8")))
    assert archive._content_hash(swapped) == archive._content_hash(plain)
    other = plain.assign(mean=("particle", [0.0, 1.0, np.nextafter(2.0, 3.0)]))
    assert read(write(other, tmp_path / "other.nc")).attrs["id"] != first.attrs["id"]


def test_commit_is_that_of_the_checkout_and_absent_without_one(tmp_path, monkeypatch):
    assert archive._commit(tmp_path) is None
    (tmp_path / "file").write_text("1")
    who = ["-c", "user.name=n", "-c", "user.email=e@example.org", "-c", "commit.gpgsign=false"]
    for command in (["init", "-q"], ["add", "."], [*who, "commit", "-qm", "one"]):
        assert subprocess.run(["git", *command], cwd=tmp_path, capture_output=True).returncode == 0
    commit = archive._commit(tmp_path)
    assert re.fullmatch("[0-9a-f]{40}", commit)
    (tmp_path / "inner").mkdir()
    assert archive._commit(tmp_path / "inner") is None
    (tmp_path / "file").write_text("22")
    assert archive._commit(tmp_path) == f"{commit}-dirty"
    monkeypatch.setenv("PATH", str(tmp_path))  # where no git is
    assert archive._commit(tmp_path) is None


def test_a_history_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(ArchiveError, match="'history_json' is not a list of stages"):
        write(make_scene().assign_attrs(history_json="{"), tmp_path / "it.nc")
    assert list(tmp_path.iterdir()) == []


# whole or not at all


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, MemoryError])
@pytest.mark.parametrize("place", ["to_netcdf", "fsync", "replace"])
def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(error, place, tmp_path, monkeypatch):
    path = write(make_scene(), tmp_path / "it.nc")
    old = path.read_bytes()

    def interrupt(*args, **kwargs):
        raise error

    def half(self, target, **kwargs):
        Path(target).write_bytes(b"\x89HDF")
        raise error

    if place == "to_netcdf":
        monkeypatch.setattr(xr.Dataset, place, half)
    else:
        monkeypatch.setattr(archive.os, place, interrupt)
    with pytest.raises(error):
        write(make_trajectory(), path, overwrite=True)
    assert [item.name for item in tmp_path.iterdir()] == ["it.nc"]
    assert path.read_bytes() == old


def test_the_file_is_written_beside_its_target_and_renamed_after_a_flush(tmp_path, monkeypatch):
    calls = []
    fsync, replace = os.fsync, os.replace

    def note_fsync(handle):
        calls.append(("fsync", Path(os.readlink(f"/proc/self/fd/{handle}")).name))
        fsync(handle)

    def note_replace(source, target):
        calls.append(("replace", Path(source).name))
        assert Path(source).parent == Path(target).parent
        replace(source, target)

    if not Path("/proc/self/fd").is_dir():
        pytest.skip("no /proc to tell which file a handle belongs to")
    monkeypatch.setattr(archive.os, "fsync", note_fsync)
    monkeypatch.setattr(archive.os, "replace", note_replace)
    write(make_scene(), tmp_path / "it.nc")
    part = calls[0][1]
    assert part.startswith(".")
    assert calls == [("fsync", part), ("replace", part), ("fsync", tmp_path.name)]


BIG_WRITE = """
import numpy as np, xarray as xr
from cablepod.archive import write
noise = np.random.default_rng(1).normal(size=({rows}, 200))
write(xr.Dataset({{"position": (("time", "particle"), noise)}}), {target!r})
"""


def test_a_killed_write_leaves_no_file_under_the_name(tmp_path):
    target = tmp_path / "it.nc"
    process = python("-c", BIG_WRITE.format(rows=40_000, target=str(target)))
    deadline = time.monotonic() + 60
    while not any(item.stat().st_size > 1e6 for item in tmp_path.iterdir()):  # 64 MB of noise take seconds
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.kill()
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    assert visible(tmp_path) == []
    assert write(make_scene(), target) == target  # what the dead process left is in nobody's way


FULL_DISK = """
import os, resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (2_000_000, 2_000_000))
from cablepod.archive import ArchiveError
try:
    exec(BODY)
except ArchiveError as error:
    print(error)
for handle in os.listdir("/proc/self/fd") if os.path.isdir("/proc/self/fd") else []:
    path = f"/proc/self/fd/{handle}"
    if os.path.islink(path) and os.readlink(path).endswith(".part (deleted)"):
        assert os.stat(path).st_size == 0, "space is held by a file that nobody sees"
"""


def test_a_full_disk_is_a_clear_error_and_leaves_nothing(tmp_path):
    # A limit on the size of files makes writes fail as a full disk does, and works without rights to mount one.
    body = BIG_WRITE.format(rows=5000, target=str(tmp_path / "it.nc"))
    done = run_python("-c", FULL_DISK.replace("BODY", repr(body)), timeout=120)
    out = done.stdout
    assert "it.nc: not written, nothing is left behind" in out, done.stderr
    assert re.search(r"is the disk full\? [\d.]+ MB are free in .*; make room, or give another path", out)
    assert list(tmp_path.iterdir()) == []
    assert done.stderr == ""


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.ENOSPC, "No space left on device"),
        RuntimeError("NetCDF: HDF error"),
        PermissionError(errno.EACCES, "Permission denied"),  # what the library says if it cannot even begin
    ],
)
def test_no_space_is_a_clear_error(error, tmp_path, monkeypatch):
    def fail(self, target, **kwargs):
        Path(target).write_bytes(b"half")
        raise error

    monkeypatch.setattr(xr.Dataset, "to_netcdf", fail)
    with pytest.raises(ArchiveError, match=re.escape(f"nothing is left behind: {error}; is the disk full? ")):
        write(make_scene(), tmp_path / "it.nc")
    assert list(tmp_path.iterdir()) == []


# refusals of write


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

    monkeypatch.setattr(archive.os, "fsync", meanwhile)
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
    monkeypatch.setattr(archive.os, "access", lambda *args: False)  # root may write anywhere
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


@pytest.mark.parametrize("value", ["", "é", 3, 2.5, np.float32(1.5), [1, 2], (0.5, 1.0), np.arange(3), ["a", "b"]])
def test_attributes_that_netcdf_can_hold_come_back(value, tmp_path):
    scene = make_scene().assign_attrs(note=value)
    scene["gravity"].attrs["note"] = value
    back = read(write(scene, tmp_path / "it.nc"))
    xr.testing.assert_identical(back, scene.assign_attrs({**back.attrs, "note": value}))


def test_names_that_would_be_decoded_and_types_that_change_are_refused(tmp_path):
    scene = make_scene()
    scene["gravity"].attrs["scale_factor"] = 2.0
    with pytest.raises(ArchiveError, match="variable 'gravity': no attribute of a file can be named 'scale_factor'"):
        write(scene, tmp_path / "it.nc")
    for wrong in (True, 1j, np.datetime64("2020-01-01", "ns"), np.array(["a", None], dtype=object)):
        with pytest.raises(ArchiveError, match=r"variable 'wrong': \S+ cannot be written; make it numbers or strings"):
            write(make_scene().assign(wrong=("n", np.atleast_1d(wrong))), tmp_path / "it.nc")
    assert list(tmp_path.iterdir()) == []


# refusals of read


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


def test_a_newer_file_is_refused_and_tells_both_versions(tmp_path):
    path = tmp_path / "it.nc"
    make_scene().drop_attrs().assign_attrs(cablepod_schema=2).to_netcdf(path, engine="netcdf4")
    with pytest.raises(ArchiveError, match=r"schema version 2, this cablepod \(.*\) knows versions up to 1; install a"):
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
    with pytest.raises(ArchiveError, match=r"damaged\.nc: is truncated or damaged .*make it again"):
        read(path)
    assert "damaged.nc" in describe(path)  # which reads no large array
    assert capfd.readouterr().err == ""


# describe


def test_describe_tells_what_a_file_is_and_how_it_came_about(tmp_path):
    scene = read(write(make_scene(), tmp_path / "scene.nc"))
    trajectory = make_trajectory(scene=scene).assign_attrs(title="Slow", wall_time_s=2.0)
    path = write(trajectory, tmp_path / "it.nc")
    text = describe(path)
    assert re.search(r"^file .*it\.nc \(.* MB, schema 1\)$", text, re.MULTILINE)
    assert re.search(r"^title +Slow$", text, re.MULTILINE)
    assert re.search(r"^stage +chain\.simulate$", text, re.MULTILINE)
    assert re.search(rf"^id +{trajectory.attrs['id']}$", text, re.MULTILINE)
    assert re.search(r"^sizes .*time 60, particle 9, coordinate 2", text, re.MULTILINE)
    assert "  position (time, particle, coordinate) [m]  position\n" in text
    first, second = text.split("history\n")[1].split("\n")
    assert first.startswith(f"  {scene.attrs['id']} make_scene(free=null, gravity=9.81); cablepod ")
    assert "links=8" in second
    assert f" from {scene.attrs['id']}; " in second
    assert second.endswith(", 2 s")
    assert describe(read(path)) == text.split("\n", 1)[1]


def test_long_parameters_are_cut_where_people_read_them_but_not_in_the_record(tmp_path):
    parameters = {"times": list(range(1000)), "title": "two\nlines"}
    scene = provenance.record(make_scene(), function="chain.simulate", parameters=parameters)
    back = read(write(scene, tmp_path / "it.nc"))
    assert archive._stages(back)[-1]["parameters"] == provenance.plain(parameters)
    assert back.attrs["history"].count("\n") == 0
    assert 200 < len(back.attrs["history"]) < 300
    assert max(map(len, describe(back).split("\n"))) < 300


def test_describe_shows_the_values_of_a_scene_before_it_is_written():
    text = describe(make_scene())
    assert "  gravity = 9.81 [m s-2]  acceleration of gravity\n" in text
    assert "  motion_upper_x_kind = 'one_minus_cosine' [1]" in text
    assert describe(xr.Dataset()).endswith("history")


# the real checker


def test_the_real_checker_finds_only_what_is_allowed(tmp_path):
    check_compliance({kind: write(make(), tmp_path / f"{kind}.nc") for kind, make in KINDS.items()}, tmp_path)
