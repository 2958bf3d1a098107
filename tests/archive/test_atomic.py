"""Whole files or none: interrupted, killed and failing writes, full disks."""

import errno
import os
import re
import signal
import time
from pathlib import Path

import pytest
from children import finish, python, run_python
from results import make_modes, make_scene, make_trajectory
from xarray.backends import NetCDF4DataStore

from cablepod.archive import ArchiveError, write


def visible(folder):
    return [item.name for item in folder.iterdir() if not item.name.startswith(".")]


def fail_in_the_library(monkeypatch, error):
    """Let the library of netCDF files write the beginning of a file, and then raise an error."""

    def half(target, **options):
        Path(target).write_bytes(b"\x89HDF")
        raise error

    monkeypatch.setattr(NetCDF4DataStore, "open", half)


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, MemoryError])
@pytest.mark.parametrize("place", ["library", "fsync", "replace"])
def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(error, place, tmp_path, monkeypatch):
    path = write(make_scene(), tmp_path / "it.nc")
    old = path.read_bytes()

    def interrupt(*args, **kwargs):
        raise error

    if place == "library":
        fail_in_the_library(monkeypatch, error)
    else:
        monkeypatch.setattr(os, place, interrupt)
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
    monkeypatch.setattr(os, "fsync", note_fsync)
    monkeypatch.setattr(os, "replace", note_replace)
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
    fail_in_the_library(monkeypatch, error)
    said = getattr(error, "strerror", None) or error
    with pytest.raises(ArchiveError, match=re.escape(f"nothing is left behind: {said}; is the disk full? ")):
        write(make_scene(), tmp_path / "it.nc")
    assert list(tmp_path.iterdir()) == []


#: A writer that waits for ever when its file is complete.
WRITER = """
import os, sys, time
import xarray as xr
from cablepod.archive import write

os.replace = lambda *paths: (print("ready", flush=True), time.sleep(600))
write(xr.Dataset({"a": 1.0}), sys.argv[1])
"""


def test_the_next_write_clears_what_killed_writers_left(tmp_path):
    killed, alive = (python("-c", WRITER, tmp_path / f"{name}.nc") for name in ("killed", "alive"))
    try:
        for writer in (killed, alive):
            assert writer.stdout.readline() == "ready\n"
        killed.kill()
        finish(killed, timeout=20.0)
        others = [tmp_path / f".cablepod-{place}-1-5-{'0' * 12}.part" for place in ("0" * 12, "1" * 12)]
        for other in others:  # of other machines
            other.touch()
        os.utime(others[0], (0.0, 0.0))
        assert len(list(tmp_path.glob(".cablepod-*.part"))) == 4
        write(make_modes(), tmp_path / "it.nc")
        left = {path.name for path in tmp_path.iterdir()} - {"it.nc"}
        assert left == {others[1].name, *(path.name for path in tmp_path.glob(f".cablepod-*-{alive.pid}-*.part"))}
        assert len(left) == 2
    finally:
        for writer in (killed, alive):
            writer.kill()
            finish(writer, timeout=20.0)


def test_a_later_process_with_the_same_number_is_another_writer(tmp_path, monkeypatch):
    parts, replace = [], os.replace
    monkeypatch.setattr(os, "replace", lambda source, target: (parts.append(Path(source)), replace(source, target)))
    write(make_scene(), tmp_path / "it.nc")
    place, process, start, _ = re.fullmatch(r"\.cablepod-(\w+)-(\d+)-(\w+)-(\w+)\.part", parts[0].name).groups()
    assert int(process) == os.getpid()
    kept, left = (tmp_path / f".cablepod-{place}-{process}-{begin}-{'0' * 12}.part" for begin in (start, "1"))
    kept.touch()
    left.touch()
    write(make_scene(), tmp_path / "other.nc")
    assert kept.exists()
    assert not left.exists()
