"""The folder for the files of one result: refused before anything runs, replaced when all files are written."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from cablepod._resources import defer_sigint
from cablepod.archive._atomic import clear_abandoned, part_in, sync_folder
from cablepod.errors import ArchiveError, shown
from cablepod.parameters._checks import truth


def path_of(path: Any, *, key: str = "path", allowed: str = "a path, as text or pathlib.Path") -> Path:
    """Return a path; refuse what is none."""
    if not isinstance(path, str | os.PathLike) or not str(path):
        raise ArchiveError(f"{key}: given {shown(path)}; allowed: {allowed}")
    return Path(path)


def check_folder(out: Path, files: Sequence[str], *, overwrite: bool, key: str = "out") -> None:
    """Create the folder for results; refuse one that is not writable or contains one of `files`.

    Messages name the argument `key`.

    Raises
    ------
    ArchiveError
        If the folder cannot be created or written, or contains one of `files` and `overwrite` is false.
    """
    truth("overwrite", overwrite)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ArchiveError(f"{key}: given {out}, which is or lies below a file; allowed: a folder") from None
    except OSError as error:
        raise ArchiveError(
            f"{key}: given {out}, which cannot be created: {error.strerror}; allowed: a folder"
        ) from None
    probe = out / f".cablepod-{os.getpid()}"
    try:
        probe.touch()
        probe.unlink(missing_ok=True)
    except OSError as error:
        raise ArchiveError(
            f"{key}: given {out}, which cannot be written: {error.strerror}; allowed: a folder"
        ) from None
    existing = [name for name in dict.fromkeys(files) if (out / name).exists()]
    if existing and not overwrite:
        raise ArchiveError(
            f"{key}: given {out}, which has {', '.join(existing)} already; "
            "allowed: another folder, or overwrite=True to replace them"
        )
    for name in existing:
        if (out / name).is_dir():
            raise ArchiveError(f"{key}: given {out}, where {name} is a folder; allowed: another folder")


def lock(handle: int, folder: Path) -> None:
    """Lock an open file of a folder, or the folder itself, until it is closed or the process ends, where the system has locks.

    Raises
    ------
    ArchiveError
        If another run has it.
    """
    try:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise ArchiveError(
            f"{folder}: another run is at work in this folder; wait for it, or give another one"
        ) from None
    except (ImportError, OSError):  # the system, or the file system, has no locks: each file is atomic nevertheless
        pass


@contextlib.contextmanager
def sole_run(folder: Path) -> Iterator[None]:
    """Keep other runs out of a folder.

    Raises
    ------
    ArchiveError
        If another run is at work there.
    """
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # this system opens no folders
        yield
        return
    try:
        lock(handle, folder)
        yield
    finally:
        os.close(handle)


@contextlib.contextmanager
def new_results(out: Path, files: Iterable[str]) -> Iterator[Path]:
    """Provide the folder for the files of a new result, which replace those of an old one in `out` when all are written.

    A study need not write all of `files`: what it leaves out would be the result of another scene, and is removed then.  Until
    then an old result remains as it is, also after an error, and if the process is killed.  Without one the folder is `out`
    itself, where each file is as soon as it is written.

    Raises
    ------
    ArchiveError
        If a file cannot be written or replaced.
    """
    old = {name for name in files if os.path.lexists(out / name)}
    if not old:
        yield out
        return
    clear_abandoned(out)
    part = part_in(out)
    try:
        part.mkdir()
        yield part
        with defer_sigint():
            _move(part, out, old)
    except ArchiveError as error:
        error.args = (str(error).replace(str(part), str(out)),)
        raise
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _move(part: Path, out: Path, old: set[str]) -> None:
    """Move all files of a folder into another one, and remove the old ones there that are not replaced."""
    new = {path.name for path in part.iterdir()}
    for name in sorted(new | old):
        try:
            if name in new:
                os.replace(part / name, out / name)
            else:
                (out / name).unlink(missing_ok=True)
        except OSError as error:
            raise ArchiveError(f"{out / name}: cannot be replaced: {error.strerror}; give another folder") from error
    sync_folder(out)
