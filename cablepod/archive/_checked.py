"""Open netCDF files whose values are compared with their checksums when they are read."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Container, Iterable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray, BackendEntrypoint, NetCDF4BackendEntrypoint
from xarray.core import indexing

from cablepod.archive._checksums import CHECKSUMS, Blocks, Checksums
from cablepod.archive._seal import SCHEMA, is_intact, seal_of
from cablepod.errors import ArchiveError

#: Maximum size of a file of which all bytes are compared before a part of it is read [bytes]; of larger ones the blocks are.
WHOLE = 64 << 20
#: Time that the search for what changed in a damaged file may take [s].
SEARCH_TIME = 20.0
#: Program of that search, in a process of its own, which may crash or hang.
SEARCH = "import sys; from cablepod.archive import _checked; _checked.print_changes(sys.argv[1])"


def changed(path: Path, names: list[str]) -> ArchiveError:
    """Return the error for a file that is not as written; `names` are the variables and attributes that differ."""
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    return ArchiveError(
        f"{path}: changed since it was written: {', '.join(names[:8])}{more}; take it from a backup or make it again, or "
        "take it as it is with verify=False (command: --no-verify)"
    )


def check_bytes(path: Path, *, whole: bool) -> bool:
    """Tell whether all bytes of a file are as written; False if that is not known.

    Unknown is a file that was edited, is of a later version, and without `whole` one larger than :data:`WHOLE`.

    Raises
    ------
    ArchiveError
        If they are not.
    """
    seal = seal_of(path)
    if seal is None or seal.schema > SCHEMA or not (whole or seal.size <= WHOLE):
        return False
    if not is_intact(path, seal):
        raise changed(path, _search(path))
    return True


def check_has_checksums(path: Path, names: Container[Any]) -> None:
    """Refuse a file with global attributes of these names that has lost its checksums."""
    if CHECKSUMS not in names:
        raise changed(path, [f"attribute {CHECKSUMS}"])


class CheckedFile(BackendEntrypoint):
    """Engine of xarray for files with checksums: compares names and attributes at once, values when they are read."""

    def open_dataset(self, filename_or_obj: Any, *, drop_variables: Any = None) -> xr.Dataset:
        """Open a file lazily."""
        path = Path(filename_or_obj)
        opened = NetCDF4BackendEntrypoint().open_dataset(path, decode_times=False, decode_timedelta=False)
        schema = opened.attrs.get("cablepod_schema")
        if not isinstance(schema, np.integer) or schema > SCHEMA:
            return opened  # of another program or a later version, which is refused
        try:
            check_has_checksums(path, opened.attrs)
            checksums = Checksums(opened.attrs[CHECKSUMS])
            names = _changed_names(opened, checksums, opened.indexes)  # whose values xarray has in memory
            if names:
                raise changed(path, names)
        except BaseException:
            opened.close()
            raise
        checked = {
            name: variable if name in opened.dims else _checked_variable(path, str(name), variable, checksums)
            for name, variable in opened.variables.items()
        }
        coords = {name: checked.pop(name) for name in opened.coords}
        dataset = xr.Dataset(checked, coords, opened.attrs)
        dataset.encoding = opened.encoding
        dataset.set_close(opened.close)
        return dataset


class _CheckedArray(BackendArray):
    """Values of a variable in a file."""

    def __init__(self, path: Path, name: str, variable: xr.Variable, blocks: Blocks) -> None:
        self.path, self.name, self.variable, self.blocks = path, name, variable, blocks
        self.shape, self.dtype = variable.shape, variable.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self._values)

    def _values(self, key: tuple[Any, ...]) -> Any:
        values = self.blocks.checked(key, partial(_values_of, self.variable))
        if values is None:
            raise changed(self.path, [self.name])
        return np.asarray(values)


def _values_of(variable: xr.Variable, key: tuple[Any, ...]) -> np.ndarray:
    """Return the values of a lazy variable at integers and slices."""
    return np.asarray(variable[key].values)


def _checked_variable(path: Path, name: str, variable: xr.Variable, checksums: Checksums) -> xr.Variable:
    """Return a lazy variable whose values are compared when they are read."""
    array = _CheckedArray(path, name, variable, checksums.blocks(name, variable.shape))
    return xr.Variable(variable.dims, indexing.LazilyIndexedArray(array), variable.attrs, variable.encoding)


def blocks_of(path: Path, file: Any, name: str) -> Blocks | None:
    """Return the checksums of a variable of an opened netCDF4.Dataset; None if it never had it.

    Raises
    ------
    ArchiveError
        If the file has lost the variable, or its checksums.
    """
    check_has_checksums(path, file.ncattrs())
    status = path.stat()
    checksums = _parsed(path, file.getncattr(CHECKSUMS), status.st_ino, status.st_mtime_ns)
    if name not in file.variables:
        if name in checksums:
            raise changed(path, [name])
        return None
    return checksums.blocks(name, file.variables[name].shape)


@lru_cache(64)
def _parsed(path: Path, text: str, *_: int) -> Checksums:
    """Parse the checksums of a file; they remember the blocks that were found unchanged."""
    return Checksums(text)


def _changed_names(opened: xr.Dataset, checksums: Checksums, names: Iterable[Any]) -> list[str]:
    """Return what is not as written in an opened file: attributes, heads of variables, and values of the variables `names`."""
    found = checksums.changed_heads(opened)
    for name in names:
        variable = opened.variables[name]
        if str(name) not in found:
            blocks = checksums.blocks(str(name), variable.shape)
            try:
                same = blocks.checked((slice(None),) * variable.ndim, partial(_values_of, variable))
            except (OSError, RuntimeError, ValueError):  # its part of the file cannot be read
                same = None
            if same is None:
                found.append(str(name))
    return found


def changes(path: Path) -> list[str]:
    """Return the names of all variables and attributes of a file that are not as written; empty without checksums."""
    with NetCDF4BackendEntrypoint().open_dataset(path, decode_times=False, decode_timedelta=False) as opened:
        if CHECKSUMS not in opened.attrs:
            return []
        return _changed_names(opened, Checksums(opened.attrs[CHECKSUMS]), opened.variables)


def print_changes(path: str) -> None:
    """Print the names of what changed, as JSON."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (1 << 33, 1 << 33))  # damaged sizes may ask for any memory
    sys.stdout.write(json.dumps(changes(Path(path))))


def _search(path: Path) -> list[str]:
    """Return what changed in a damaged file; the library reads it in another process, which may crash or hang."""
    root = str(Path(__file__).resolve().parents[2])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))}
    command = [sys.executable, "-c", SEARCH, str(path)]
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, stdin=subprocess.DEVNULL, timeout=SEARCH_TIME, check=True
        )
        return list(json.loads(done.stdout)) or ["bytes outside of its values and attributes"]
    except (OSError, ValueError, subprocess.SubprocessError):
        return ["its structure, so that the netCDF library cannot read it"]
