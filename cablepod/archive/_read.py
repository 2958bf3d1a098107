"""Read netCDF files; errors name missing, damaged, foreign and newer files."""

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

from cablepod import conventions, provenance
from cablepod.archive._folder import path_of
from cablepod.batch._sigint import defer_sigint
from cablepod.errors import ArchiveError

#: Version of the file layout, raised when an older package would misread new files.
SCHEMA = 1
_LIBRARY = threading.RLock()
#: Exceptions of xarray and netCDF for files that they cannot read or write.
LIBRARY_ERRORS = (OSError, RuntimeError, ValueError, TypeError, KeyError, IndexError, AttributeError)


@contextmanager
def netcdf_lock() -> Iterator[None]:
    """Hold the lock of the netCDF library and defer SIGINT.

    The library is not thread-safe, and xarray locks only some of its calls.  Do not hold the lock if the call waits for other
    threads that need it, as in writing lazy data that dask reads from files.
    """
    with defer_sigint(), _LIBRARY:
        yield


def open_file(path: Path, chunks: Any) -> xr.Dataset:
    """Open a file lazily, after a check that this package wrote it."""
    if not path.exists():
        raise ArchiveError(f"{path}: does not exist; check the path")
    if not path.is_file():
        raise ArchiveError(f"{path}: is a folder or a device; give the path of a netCDF file")
    if path.stat().st_size == 0:
        raise ArchiveError(f"{path}: is empty; make it again")
    try:
        with netcdf_lock():
            opened = xr.open_dataset(path, engine="netcdf4", chunks=chunks, decode_times=False, decode_timedelta=False)
    except PermissionError as error:
        raise ArchiveError(f"{path}: no permission to read it; change its permissions") from error
    except LIBRARY_ERRORS as error:
        raise damaged(path, error) from error
    schema = opened.attrs.get("cablepod_schema")
    if isinstance(schema, np.integer) and schema <= SCHEMA:
        return opened
    opened.close()
    if not isinstance(schema, np.integer):
        raise ArchiveError(f"{path}: was not written by cablepod (no attribute cablepod_schema); open it with xarray")
    raise ArchiveError(
        f"{path}: has schema version {schema}, this cablepod ({version()}) knows versions up to {SCHEMA}; "
        "install a newer cablepod"
    )


def version() -> str:
    """Return the version of the package."""
    try:
        return importlib.metadata.version("cablepod")
    except importlib.metadata.PackageNotFoundError:  # a checkout that is not installed
        return "unknown"


@contextmanager
def opened_file(path: Path) -> Iterator[xr.Dataset]:
    """Open a file as :func:`open_file`, with the lock of the library until it is closed."""
    with netcdf_lock(), open_file(path, None) as opened:
        yield opened


def damaged(path: Path, error: BaseException) -> ArchiveError:
    """Return the error for a file that the netCDF library cannot read."""
    with path.open("rb") as file:
        is_netcdf = file.read(8) == b"\x89HDF\r\n\x1a\n"
    if not is_netcdf:
        return ArchiveError(f"{path}: is not a netCDF-4 file ({error}); check the path")
    return ArchiveError(f"{path}: is truncated or damaged ({error}); make it again, or take it from a backup")


def restored(opened: xr.Dataset) -> xr.Dataset:
    """Return `opened` as it was before writing: without encodings and content types, strings as fixed-width arrays."""
    dataset = fixed_width_texts(opened.drop_encoding())
    dataset.attrs = provenance.abridged(dataset.attrs)
    for name, content in content_types(dataset):
        if dataset[name].attrs.get("coverage_content_type") == content:
            del dataset[name].attrs["coverage_content_type"]
    return dataset


def fixed_width_texts(dataset: xr.Dataset) -> xr.Dataset:
    """Return a shallow copy with all strings as fixed-width arrays in memory."""
    texts = {name: variable for name, variable in dataset.variables.items() if variable.dtype.kind in "UO"}
    return dataset.assign(
        {name: (variable.dims, variable.values.astype(str), variable.attrs) for name, variable in texts.items()}
    )


def content_types(dataset: xr.Dataset) -> Iterator[tuple[Hashable, str]]:
    """Yield names and ISO 19115-1 content codes of data variables and of coordinates with several dimensions."""
    for name in dataset.data_vars:
        yield name, "modelResult" if name in conventions.VARIABLES else "auxiliaryInformation"
    for name, coordinate in dataset.coords.items():
        if coordinate.ndim > 1:
            yield name, "coordinate"


def read(path: str | os.PathLike[str], *, chunks: Any = None) -> xr.Dataset:
    """Read a file of :func:`cablepod.archive.write`.

    Parameters
    ----------
    path
        The file.
    chunks
        None to read all values and close the file.  Otherwise as in :func:`xarray.open_dataset` (``{}`` for the chunks of the
        file): variables are dask arrays, and the file stays open until ``close`` of the dataset.

    Returns
    -------
    xarray.Dataset
        The dataset as written, with the global attributes of the file; ``time`` is elapsed time [s].

    Raises
    ------
    ArchiveError
        If the file is missing, empty, truncated or damaged, not from this package, or from a newer version.
    """
    path = path_of(path)
    if chunks is not None:
        if find_spec("dask") is None:
            raise ArchiveError(f"{path}: reading in chunks needs dask; install it, or read without chunks")
        opened = open_file(path, chunks)
        lazy = restored(opened)
        lazy.set_close(defer_sigint()(opened.close))
        return lazy
    with netcdf_lock(), open_file(path, None) as opened:
        try:
            return restored(opened.load())
        except LIBRARY_ERRORS as error:
            raise damaged(path, error) from error
