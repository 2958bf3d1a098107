"""Atomic replacement of files."""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import os
import platform
import re
import shutil
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

from cablepod.errors import ArchiveError

#: Name of an unfinished file, or of a folder for new files that are not all there yet.
NAME = re.compile(r"\.cablepod-(?P<place>[0-9a-f]{12})-(?P<process>\d{1,10})-(?P<start>\d+)-[0-9a-f]{12}\.part")
#: Time for which another machine may leave an unfinished file as it is [s].
PATIENCE = 7 * 86400.0


@contextlib.contextmanager
def atomic_file(path: Path, *, check: Callable[[], None] | None = None) -> Iterator[Path]:
    """Provide a temporary path that replaces `path` on exit, or is removed on an error.

    Files that killed writers left in the folder are removed.  The file is flushed to the disk first.  `check` is called just
    before the renaming, because another process may have created the file meanwhile.

    Raises
    ------
    ArchiveError
        If it cannot be written, as on a full disk.
    """
    clear_abandoned(path.parent)
    part = part_in(path.parent)
    try:
        yield part
        with part.open("r+b") as file:
            os.fsync(file.fileno())
        if check is not None:
            check()
        os.replace(part, path)
    except OSError as error:
        raise not_written(path, error) from error
    finally:  # also after Ctrl-C
        _discard(part)
    sync_folder(path.parent)


def not_written(path: Path, error: BaseException) -> ArchiveError:
    """Return the error for a file that could not be written, with the reason and a remedy."""
    folder = path.parent
    # on a full disk the netCDF library reports "HDF error", or "Permission denied" when it opens the file
    full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EACCES)
    remedy = "try another path or folder"
    if full or "HDF error" in str(error):
        free = shutil.disk_usage(folder).free / 1e6
        remedy = f"is the disk full? {free:.1f} MB are free in {folder}; make room, or give another path"
    what = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return ArchiveError(f"{path}: not written, nothing is left behind: {what}; {remedy}")


def part_in(folder: Path) -> Path:
    """Return a path in a folder for what is not finished; its name tells the writer."""
    return folder / f".cablepod-{_place()}-{os.getpid()}-{_start_of(os.getpid())}-{uuid.uuid4().hex[:12]}.part"


def clear_abandoned(folder: Path) -> None:
    """Remove unfinished files and folders whose writer is gone.

    Writers of this machine are looked up by process number and start time.  The files of others, as on a shared file system, are
    removed when they were not written to for :data:`PATIENCE`.
    """
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        parts = [entry for entry in entries if entry.name.startswith(".cablepod-") and entry.name.endswith(".part")]
        for entry in parts:
            with contextlib.suppress(OSError):  # another process removes it too
                if _is_abandoned(entry):
                    remove = shutil.rmtree if entry.is_dir(follow_symlinks=False) else os.unlink
                    remove(entry.path)


def _is_abandoned(entry: os.DirEntry[str]) -> bool:
    """Tell whether the writer of an unfinished file is gone."""
    found = NAME.fullmatch(entry.name)
    if found is not None and found["place"] == _place():
        return _start_of(int(found["process"])) != found["start"]
    return time.time() - entry.stat(follow_symlinks=False).st_mtime > PATIENCE


@functools.cache
def _place() -> str:
    """Return a name of this machine, since it was started, and of the processes that are seen from here."""
    parts = [platform.node()]
    for source in ("/proc/sys/kernel/random/boot_id", "/etc/machine-id"):
        with contextlib.suppress(OSError):
            parts.append(Path(source).read_text(encoding="ascii", errors="replace").strip())
    with contextlib.suppress(OSError):
        parts.append(os.readlink("/proc/self/ns/pid"))  # of a container
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()[:12]


def _start_of(process: int) -> str:
    """Return when a process started, in ticks of the system; "0" where that is not known, "gone" without the process."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        return "gone" if fields[0] in ("Z", "X") else fields[19]
    except (OSError, IndexError):
        if Path("/proc/self/stat").exists():
            return "gone"
    if os.name != "posix":  # where a signal to look for it would end it
        return "0"
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return "gone"
    except OSError:  # of another user
        pass
    return "0"


def _discard(part: Path) -> None:
    """Truncate and remove `part` if it exists."""
    with contextlib.suppress(FileNotFoundError):
        os.truncate(part, 0)  # frees the space even if a failed library keeps the file open
        part.unlink()


def sync_folder(folder: Path) -> None:
    """Flush the folder entry of a new file to the disk, where the system allows it."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
