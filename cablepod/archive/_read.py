"""Read a file, and refuse truncated, foreign or newer ones by name."""

from __future__ import annotations

import importlib.metadata
import os
import threading
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import conventions
from cablepod.batch._sigint import defer_sigint
from cablepod.errors import ArchiveError

SCHEMA = 1  # raised when files change so that an older package would misread them
_LIBRARY = threading.RLock()
LIBRARY_ERRORS = (OSError, RuntimeError, ValueError, TypeError, KeyError, IndexError, AttributeError)


@contextmanager
def alone() -> Iterator[None]:
    """Be the only thread in the netCDF library, and let Ctrl-C wait.

    The library crashes if two threads are in it, and xarray locks only some of its calls.  Where other threads have to get in for
    one to go on, as in writing what dask computes from files, it cannot be held.
    """
    with defer_sigint(), _LIBRARY:
        yield


def open_file(path: Path, chunks: Any) -> xr.Dataset:
    """Open `path` and make sure that it is one of ours; the values are not read yet."""
    if not path.exists():
        raise ArchiveError(f"{path}: does not exist; check the path")
    if not path.is_file():
        raise ArchiveError(f"{path}: is a folder or a device; give the path of a netCDF file")
    if path.stat().st_size == 0:
        raise ArchiveError(f"{path}: is empty; make it again")
    try:
        with alone():
            opened = xr.open_dataset(path, engine="netcdf4", chunks=chunks, decode_times=False, decode_timedelta=False)
    except PermissionError as error:
        raise ArchiveError(f"{path}: no permission to read it; change its permissions") from error
    except LIBRARY_ERRORS as error:
        raise damaged(path, error) from error
    found = opened.attrs.get("cablepod_schema")
    if isinstance(found, np.integer) and found <= SCHEMA:
        return opened
    opened.close()
    if not isinstance(found, np.integer):
        raise ArchiveError(f"{path}: was not written by cablepod (no attribute cablepod_schema); open it with xarray")
    raise ArchiveError(
        f"{path}: has schema version {found}, this cablepod ({version()}) knows versions up to {SCHEMA}; "
        "install a newer cablepod"
    )


def version() -> str:
    """Return the version of the package."""
    try:
        return importlib.metadata.version("cablepod")
    except importlib.metadata.PackageNotFoundError:  # run from a checkout that is not installed
        return "unknown"


@contextmanager
def opened_file(path: Path) -> Iterator[xr.Dataset]:
    """Open a file as :func:`open_file` does, alone with the library until it is closed again."""
    with alone(), open_file(path, None) as opened:
        yield opened


def damaged(path: Path, error: BaseException) -> ArchiveError:
    """Make the error for a file that netCDF does not read."""
    with path.open("rb") as file:
        is_netcdf = file.read(8) == b"\x89HDF\r\n\x1a\n"
    if not is_netcdf:
        return ArchiveError(f"{path}: is not a netCDF-4 file ({error}); check the path")
    return ArchiveError(f"{path}: is truncated or damaged ({error}); make it again, or take it from a backup")


def restored(opened: xr.Dataset) -> xr.Dataset:
    """Return `opened` without what the file added to its variables: layout, content types, objects for strings."""
    made = texts_fixed(opened.drop_encoding())
    for name, content in contents(made):
        if made[name].attrs.get("coverage_content_type") == content:
            del made[name].attrs["coverage_content_type"]
    return made


def texts_fixed(dataset: xr.Dataset) -> xr.Dataset:
    """Return a shallow copy in which strings lie in memory with fixed width, never as objects or lazily."""
    texts = {name: item for name, item in dataset.variables.items() if item.dtype.kind in "UO"}
    return dataset.assign({name: (item.dims, item.values.astype(str), item.attrs) for name, item in texts.items()})


def contents(dataset: xr.Dataset) -> Iterator[tuple[Hashable, str]]:
    """Tell the ISO 19115-1 codes: what the vocabulary names is a result, the rest describe it; places of several dimensions."""
    for name in dataset.data_vars:
        yield name, "modelResult" if name in conventions.VARIABLES else "auxiliaryInformation"
    for name, item in dataset.coords.items():
        if item.ndim > 1:
            yield name, "coordinate"


def read(path: str | os.PathLike[str], *, chunks: Any = None) -> xr.Dataset:
    """Read a file that :func:`write` wrote.

    Parameters
    ----------
    path
        The file.
    chunks
        None reads everything and closes the file.  Otherwise as in :func:`xarray.open_dataset` (``{}`` for the chunks
        of the file): variables are dask arrays, and the file stays open until the dataset's ``close``.

    Returns
    -------
    xarray.Dataset
        What was written, with the attributes of the root; ``time`` stays in elapsed seconds.

    Raises
    ------
    ArchiveError
        If the file is missing, empty, truncated or damaged, not from this package, or from a newer one.
    """
    path = Path(path)
    if chunks is not None:
        if find_spec("dask") is None:
            raise ArchiveError(f"{path}: reading in chunks needs dask; install it, or read without chunks")
        opened = open_file(path, chunks)
        lazy = restored(opened)
        lazy.set_close(defer_sigint()(opened.close))
        return lazy
    with alone(), open_file(path, None) as opened:
        try:
            return restored(opened.load())
        except LIBRARY_ERRORS as error:
            raise damaged(path, error) from error
