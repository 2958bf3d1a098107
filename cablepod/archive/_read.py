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
from cablepod._resources import defer_sigint
from cablepod.archive._checked import CheckedFile, check_bytes
from cablepod.archive._checksums import CHECKSUMS
from cablepod.archive._folder import path_of
from cablepod.archive._seal import SCHEMA
from cablepod.errors import ArchiveError, scene_error
from cablepod.parameters._checks import truth

_LIBRARY = threading.RLock()
#: Exceptions of xarray and netCDF for files that they cannot read or write.
LIBRARY_ERRORS = (OSError, RuntimeError, ValueError, TypeError, KeyError, IndexError, AttributeError)
#: Those for damaged files.
READ_ERRORS = (*LIBRARY_ERRORS, ArithmeticError, AssertionError, LookupError, MemoryError, SystemError)


@contextmanager
def netcdf_lock() -> Iterator[None]:
    """Hold the lock of the netCDF library and defer SIGINT.

    The library is not thread-safe, and xarray locks only some of its calls.  Do not hold the lock if the call waits for other
    threads that need it, as in writing lazy data that dask reads from files.
    """
    with defer_sigint(), _LIBRARY:
        yield


def open_file(path: Path, chunks: Any, *, verify: bool = True, whole: bool = False) -> xr.Dataset:
    """Open a file lazily, after a check that this package wrote it.

    With `verify` it must be as written: all bytes are compared before the library opens the file, of a large one without `whole`
    its values when they are read.
    """
    if not path.exists():
        raise ArchiveError(f"{path}: does not exist; check the path")
    if not path.is_file():
        raise ArchiveError(f"{path}: is a folder or a device; give the path of a netCDF file")
    if path.stat().st_size == 0:
        raise ArchiveError(f"{path}: is empty; make it again")
    try:
        if verify and not check_bytes(path, whole=whole):
            engine: dict[str, Any] = {"engine": CheckedFile}
        else:
            engine = {"engine": "netcdf4", "decode_times": False, "decode_timedelta": False}
        with netcdf_lock():
            opened = xr.open_dataset(path, chunks=chunks, **engine)
    except ArchiveError:
        raise
    except PermissionError as error:
        raise ArchiveError(f"{path}: no permission to read it; change its permissions") from error
    except READ_ERRORS as error:
        if chunks is not None:
            open_file(path, None, verify=verify, whole=whole).close()  # refuses a damaged file
            raise scene_error("chunks", chunks, 'None, a whole number, "auto" or a mapping of dimensions') from error
        raise damaged(path, error) from error
    schema = opened.attrs.get("cablepod_schema")
    if isinstance(schema, np.integer) and schema <= SCHEMA:
        return opened
    opened.close()
    if not isinstance(schema, np.integer):
        raise ArchiveError(f"{path}: was not written by cablepod (no attribute cablepod_schema); open it with xarray")
    raise newer(path, schema)


def newer(path: Path, schema: Any) -> ArchiveError:
    """Return the error for a file of a later layout than this package knows."""
    known = f"this cablepod ({version()}) knows versions up to {SCHEMA}"
    return ArchiveError(f"{path}: has schema version {schema}, {known}; install a newer cablepod")


def version() -> str:
    """Return the version of the package."""
    try:
        return importlib.metadata.version("cablepod")
    except importlib.metadata.PackageNotFoundError:  # a checkout that is not installed
        return "unknown"


@contextmanager
def opened_file(path: Path, *, verify: bool = True) -> Iterator[xr.Dataset]:
    """Open a file as :func:`open_file`, with the lock of the library until it is closed."""
    with netcdf_lock(), open_file(path, None, verify=verify) as opened:
        yield opened


def damaged(path: Path, error: BaseException) -> ArchiveError:
    """Return the error for a file that the netCDF library cannot read; an ArchiveError as it is."""
    if isinstance(error, ArchiveError):
        return error
    try:
        with path.open("rb") as file:
            is_netcdf = file.read(8) == b"\x89HDF\r\n\x1a\n"
    except OSError as second:
        return ArchiveError(f"{path}: cannot be read: {second.strerror}; check the path and its permissions")
    if not is_netcdf:
        return ArchiveError(f"{path}: is not a netCDF-4 file ({error}); check the path")
    if isinstance(error, MemoryError):
        return ArchiveError(f"{path}: is larger than the memory, or damaged; read it with chunks, or make it again")
    return ArchiveError(f"{path}: is truncated or damaged ({error}); make it again, or take it from a backup")


def restored(opened: xr.Dataset) -> xr.Dataset:
    """Return `opened` as it was before writing: without encodings and content types, strings as fixed-width arrays."""
    dataset = fixed_width_texts(opened.drop_encoding())
    dataset.attrs = provenance.abridged({name: value for name, value in dataset.attrs.items() if name != CHECKSUMS})
    for name, content in content_types(dataset):
        attrs = dataset.variables[name].attrs  # a DataArray of each would take time with the square of their number
        if attrs.get("coverage_content_type") == content:
            del attrs["coverage_content_type"]
    return dataset


def fixed_width_texts(dataset: xr.Dataset) -> xr.Dataset:
    """Return a shallow copy with all strings as fixed-width arrays in memory."""
    texts = {name: variable for name, variable in dataset.variables.items() if variable.dtype.kind in "UO"}
    dataset = dataset.set_coords([name for name in texts if name in dataset.dims])  # xarray merges no others
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


def read(path: str | os.PathLike[str], *, chunks: Any = None, verify: bool = True) -> xr.Dataset:
    """Read a file of :func:`cablepod.archive.write`.

    Parameters
    ----------
    path
        The file.
    chunks
        None to read all values and close the file.  Otherwise as in :func:`xarray.open_dataset` (``{}`` for the chunks of the
        file): variables are dask arrays, and the file stays open until ``close`` of the dataset.
    verify
        Whether the file must be as written, in values, coordinates and attributes.  With `chunks`, the values of files above
        64 MiB are compared when they are read.  False takes a file that was edited as it is; if it is written again, it gets a
        stage and id of its own.

    Returns
    -------
    xarray.Dataset
        The dataset as written, with the global attributes of the file; ``time`` is elapsed time [s].

    Raises
    ------
    SceneError
        For chunks that do not fit the file.
    ArchiveError
        If the file is missing, empty, truncated or damaged, changed since it was written (the message names what), not from this
        package, or from a newer version.
    """
    path, verify = path_of(path), truth("verify", verify)
    if chunks is not None:
        if find_spec("dask") is None:
            raise ArchiveError(f"{path}: reading in chunks needs dask; install it, or read without chunks")
        opened = open_file(path, chunks, verify=verify)
        try:
            lazy = restored(opened)
        except READ_ERRORS as error:
            opened.close()
            raise damaged(path, error) from error
        lazy.set_close(defer_sigint()(opened.close))
        return lazy
    with netcdf_lock(), open_file(path, None, verify=verify, whole=True) as opened:
        try:
            return restored(opened.load())
        except READ_ERRORS as error:
            raise damaged(path, error) from error
