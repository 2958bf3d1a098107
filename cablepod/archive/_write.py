"""Write Datasets as netCDF files, atomically."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK, NetCDF4DataStore

from cablepod._inputs import ANY, taken
from cablepod._resources import defer_sigint_during_dask
from cablepod.archive._atomic import atomic_file, not_written
from cablepod.archive._attributes import with_file_attributes
from cablepod.archive._checksums import chunk_shape
from cablepod.archive._folder import path_of
from cablepod.archive._read import LIBRARY_ERRORS, netcdf_lock
from cablepod.archive._seal import add_seal
from cablepod.errors import ArchiveError
from cablepod.parameters._checks import truth

if TYPE_CHECKING:
    from collections.abc import Hashable

#: Maximum bytes of an uncompressed variable (filter and chunk index would cost more than they save).
MAX_UNCOMPRESSED = 16_384
#: Data types that netCDF-4 can store.
DTYPES = {np.dtype(code) for code in ("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8")}
#: Attributes that are texts where they are there, but for the last one, a number.
OWN = ("id", "stage", "title", "summary", "history", "history_json", "wall_time_s")
#: Attribute names that xarray decodes on reading.
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
    """Write a dataset to a netCDF-4 file, atomically.

    Parameters
    ----------
    dataset
        Any dataset of the package; it is not modified.  A lazy dataset is computed twice, for its content hash and for the file.
        An attribute ``wall_time_s`` [s] moves into the record of the last stage.
    path
        The file; its folder must exist.
    overwrite
        Replace an existing file; the old one remains until the new one is complete.

    Returns
    -------
    pathlib.Path
        The path of the file.

    Raises
    ------
    ArchiveError
        If the file exists and `overwrite` is false, the folder is missing or not writable, the disk is full, or netCDF cannot
        store a variable or attribute.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> path = cp.archive.write(cp.catenary.rest(scene), "rest.nc")
    >>> cp.archive.read(path).equals(cp.catenary.rest(scene))
    True
    """
    taken("dataset", dataset, ANY)
    path = path_of(path)
    check_target(path, overwrite=overwrite)
    _check_content(dataset)
    is_lazy = any(variable.chunks is not None for variable in dataset.variables.values())
    with defer_sigint_during_dask(dataset):
        stamped = with_file_attributes(dataset)
    # other threads may read files while lazy data are computed: do not hold the lock
    library = defer_sigint_during_dask(dataset) if is_lazy else netcdf_lock()
    try:
        with atomic_file(path, check=lambda: check_target(path, overwrite=overwrite)) as part, library:
            if is_lazy:
                stamped.to_netcdf(part, engine="netcdf4", format="NETCDF4", encoding=encoding_of(stamped))
            else:
                _write_arrays(stamped, part)
            add_seal(part, stamped.attrs["id"])
    except ArchiveError:
        raise
    except LIBRARY_ERRORS as error:
        raise not_written(path, error) from error
    return path


def _write_arrays(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset in memory as ``to_netcdf`` does, which would import ``distributed`` to ask for its locks."""
    store = NetCDF4DataStore.open(os.fspath(path), mode="w", format="NETCDF4", lock=NETCDF4_PYTHON_LOCK)
    try:
        dataset.dump_to_store(store, encoding=encoding_of(dataset))
    finally:
        store.close()


def encoding_of(dataset: xr.Dataset) -> dict[Hashable, dict[str, Any]]:
    """Return the netCDF encoding of each variable: fill value, compression, chunks, characters."""
    return {
        name: _encoding(str(name), variable, name in dataset.coords) for name, variable in dataset.variables.items()
    }


def _encoding(name: str, variable: xr.Variable, is_coordinate: bool) -> dict[str, Any]:
    """Return the encoding of one variable."""
    if variable.dtype.kind in "UO":  # fixed width: many tools fail on strings of variable length
        # xarray takes a number in the name of the dimension for the length of the text: tables with a number get its default name
        named = {} if any(map(str.isdigit, str(name))) else {"char_dim_name": f"{name}_characters"}
        return {"dtype": "S1", **named}
    encoding: dict[str, Any] = {"_FillValue": None}
    if variable.dtype.kind != "f":
        return encoding
    # CF: missing values are declared, and coordinates have none; lazy variables may have some
    if not is_coordinate and (variable.chunks is not None or np.isnan(variable.values).any()):
        encoding["_FillValue"] = variable.dtype.type(np.nan)
    if variable.nbytes > MAX_UNCOMPRESSED:
        encoding.update(zlib=True, complevel=4, shuffle=True, chunksizes=chunk_shape(variable))
    return encoding


def check_target(path: Path, *, overwrite: bool) -> None:
    """Refuse a path that cannot be written.

    Raises
    ------
    ArchiveError
        If the folder is missing or not writable, the path is a folder, or the file exists and `overwrite` is false.
    """
    truth("overwrite", overwrite)
    folder = path.parent
    if not folder.is_dir():
        problem = "is not a folder; give another path" if folder.exists() else "does not exist; make that folder first"
        raise ArchiveError(f"{path}: {folder} {problem}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ArchiveError(f"{path}: no permission to write in the folder {folder}; change it, or give another path")
    if path.is_dir():
        raise ArchiveError(f"{path}: is a folder; give the path of a file in it")
    if path.exists() and not overwrite:
        raise ArchiveError(f"{path}: exists already; give another path, or overwrite=True to replace it")


def _check_content(dataset: xr.Dataset) -> None:
    """Refuse variables and attributes that netCDF cannot store."""
    for key, value in dataset.attrs.items():
        _check_attribute("dataset", key, value)
        own = (int, float, np.integer, np.floating) if key == OWN[-1] else str
        if key in OWN and not isinstance(value, own):
            raise ArchiveError(f"dataset: attribute {key!r} is {value!r}, which cannot be written; leave it out")
    for name, variable in dataset.variables.items():
        if not isinstance(name, str):
            raise ArchiveError(f"variable {name!r}: a name that is no text cannot be written; leave it out")
        for key, value in variable.attrs.items():
            _check_attribute(f"variable {name!r}", key, value)
        kind = variable.dtype.kind if isinstance(variable.dtype, np.dtype) else "of pandas"
        is_text = kind == "U" or (kind == "O" and all(isinstance(value, str) for value in variable.values.flat))
        if not is_text and kind != "b" and not (kind in "iuf" and variable.dtype.newbyteorder("=") in DTYPES):
            raise ArchiveError(f"variable {name!r}: {variable.dtype} cannot be written; make it numbers or strings")


def _check_attribute(owner: str, name: Hashable, value: Any) -> None:
    """Refuse an attribute that netCDF cannot store; `owner` names its variable in messages."""
    if not isinstance(name, str) or name in RESERVED:
        raise ArchiveError(f"{owner}: no attribute of a file can be named {name!r}; give it another name")
    array = np.asarray(value, dtype=object)
    entries = [entry.item() if isinstance(entry, np.generic) else entry for entry in array.flat]
    texts = [isinstance(entry, str) for entry in entries]
    numbers = [isinstance(entry, int | float) and not isinstance(entry, bool) for entry in entries]
    if not entries or not (all(texts) or all(numbers)) or array.ndim > 1:
        raise ArchiveError(
            f"{owner}: attribute {name!r} is {value!r}, but a file stores only strings, numbers and lists of one of "
            "them; leave it out, or make it a variable"
        )
