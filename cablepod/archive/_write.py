"""Write Datasets as netCDF files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod.archive._atomic import atomic_file
from cablepod.archive._attributes import _stamped
from cablepod.archive._read import LIBRARY_ERRORS, alone
from cablepod.batch._sigint import defer_sigint_during_dask
from cablepod.errors import ArchiveError

if TYPE_CHECKING:
    from collections.abc import Hashable

SMALL = 16_384  # bytes; below this a filter and its chunk index cost more than they save
CHUNK = 1 << 20  # bytes; aim for the size of one chunk
CHUNKED = ("time", "member")  # a decomposition reads complete rows of particles, so nothing else is ever cut
DTYPES = {np.dtype(code) for code in ("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8")}
# xarray takes these for its own and would decode them when it reads
RESERVED = (
    "_FillValue",
    "missing_value",
    "scale_factor",
    "add_offset",
    "_Unsigned",
    "_Encoding",
    "dtype",
    "coordinates",
)


def write(dataset: xr.Dataset, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
    """Write `dataset` to the netCDF-4 file `path`, whole or not at all, and return the path.

    Parameters
    ----------
    dataset
        Any dataset of the package; it is not modified.  One that is held in chunks is computed twice, for its content
        hash and for the file.  An attribute ``wall_time_s`` [s] moves into the record of the last stage.
    path
        The file; its folder must exist.
    overwrite
        Replace an existing file; the old one stays whole until the new one is.

    Raises
    ------
    ArchiveError
        If the file exists and `overwrite` is false, the folder is missing or not writable, the disk is full, or the
        dataset holds what netCDF cannot.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> path = cp.archive.write(cp.catenary.rest(scene), "rest.nc")
    >>> cp.archive.read(path).equals(cp.catenary.rest(scene))
    True
    """
    path = Path(path)
    check_target(path, overwrite=overwrite)
    _check_content(dataset)
    is_lazy = any(item.chunks is not None for item in dataset.variables.values())
    with defer_sigint_during_dask(dataset):
        stamped = _stamped(dataset)
    # what is computed on the way may need other threads to read
    library = defer_sigint_during_dask(dataset) if is_lazy else alone()
    try:
        with atomic_file(path, check=lambda: check_target(path, overwrite=overwrite)) as part, library:
            stamped.to_netcdf(part, engine="netcdf4", format="NETCDF4", encoding=encoding_of(stamped))
    except ArchiveError:
        raise
    except LIBRARY_ERRORS as error:
        raise ArchiveError(f"{path}: not written, nothing is left behind: {reason(error, path.parent)}") from error
    return path


def encoding_of(dataset: xr.Dataset) -> dict[Hashable, dict[str, Any]]:
    """Return how each variable of `dataset` is laid out in a file: fill value, compression, chunks, characters."""
    return {name: _encoding(str(name), item, name in dataset.coords) for name, item in dataset.variables.items()}


def _encoding(name: str, variable: xr.Variable, is_coordinate: bool) -> dict[str, Any]:
    if variable.dtype.kind in "UO":  # fixed-width characters: many tools fail on strings of variable length
        return {"dtype": "S1", "char_dim_name": f"{name}_characters"}
    encoding: dict[str, Any] = {"_FillValue": None}
    if variable.dtype.kind != "f":
        return encoding
    # CF wants gaps declared, and none in coordinates; what a lazy variable holds is not known yet
    if not is_coordinate and (variable.chunks is not None or np.isnan(variable.values).any()):
        encoding["_FillValue"] = variable.dtype.type(np.nan)
    if variable.nbytes > SMALL:
        encoding.update(zlib=True, complevel=4, shuffle=True, chunksizes=_chunk_sizes(variable))
    return encoding


def _chunk_sizes(variable: xr.Variable) -> tuple[int, ...]:
    """Return sizes of about :data:`CHUNK` bytes, cut along time first, then member, and along nothing else."""
    sizes = dict(variable.sizes)
    rows = max(1, CHUNK * int(np.prod([sizes[dim] for dim in CHUNKED if dim in sizes])) // variable.nbytes)
    for dim in CHUNKED:
        if dim in sizes:
            sizes[dim] = min(sizes[dim], rows)
            rows = max(1, rows // sizes[dim])
    return tuple(sizes.values())


def check_target(path: Path, *, overwrite: bool) -> None:
    """Refuse a path to which no file can be written.

    Raises
    ------
    ArchiveError
        Saying why.
    """
    folder = path.parent
    if not folder.is_dir():
        what = "is not a folder; give another path" if folder.exists() else "does not exist; make that folder first"
        raise ArchiveError(f"{path}: {folder} {what}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ArchiveError(f"{path}: no permission to write in the folder {folder}; change it, or give another path")
    if path.is_dir():
        raise ArchiveError(f"{path}: is a folder; give the path of a file in it")
    if path.exists() and not overwrite:
        raise ArchiveError(f"{path}: exists already; give another path, or overwrite=True to replace it")


def _check_content(dataset: xr.Dataset) -> None:
    for name, value in dataset.attrs.items():
        _check_attribute("dataset", name, value)
    for variable, item in dataset.variables.items():
        for name, value in item.attrs.items():
            _check_attribute(f"variable {variable!r}", name, value)
        kind = item.dtype.kind
        text = kind == "U" or (kind == "O" and all(isinstance(value, str) for value in item.values.flat))
        if not text and not (kind in "iuf" and item.dtype.newbyteorder("=") in DTYPES):
            raise ArchiveError(f"variable {variable!r}: {item.dtype} cannot be written; make it numbers or strings")


def _check_attribute(owner: str, name: Hashable, value: Any) -> None:
    if not isinstance(name, str) or name in RESERVED:
        raise ArchiveError(f"{owner}: no attribute of a file can be named {name!r}; give it another name")
    array = np.asarray(value, dtype=object)
    items = [item.item() if isinstance(item, np.generic) else item for item in array.flat]
    texts = [isinstance(item, str) for item in items]
    numbers = [isinstance(item, int | float) and not isinstance(item, bool) for item in items]
    if not items or not (all(texts) or all(numbers)) or array.ndim > 1:
        raise ArchiveError(
            f"{owner}: attribute {name!r} is {value!r}, but a file holds only strings, numbers and lists of one of "
            "them; leave it out, or make it a variable"
        )


def reason(error: BaseException, folder: Path) -> str:
    """Say why nothing could be written in a folder."""
    # On a full disk the library says "HDF error", or "Permission denied" when it cannot even begin.
    full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EACCES)
    if full or "HDF error" in str(error):
        free = shutil.disk_usage(folder).free / 1e6
        return f"{error}; is the disk full? {free:.1f} MB are free in {folder}; make room, or give another path"
    return f"{str(error) or type(error).__name__}; try another path or folder"
