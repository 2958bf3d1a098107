"""Datasets as netCDF files that tell where they come from: stamp, write, read, describe.

The only module that touches files of results, the clock, the machine or git.  A file appears whole or not at all: it is
written beside its target under a name that begins with a dot, flushed to the disk, and renamed.  What is read is
identical to what was written, plus the attributes of the root that :func:`write` sets.
"""

from __future__ import annotations

import errno
import functools
import hashlib
import json
import os
import platform
import shutil
import subprocess
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.archive._atomic import whole_file
from cablepod.archive._read import LIBRARY_ERRORS, SCHEMA, ArchiveError, alone, contents, version
from cablepod.archive._read import damaged as _damaged
from cablepod.archive._read import open_file as _open
from cablepod.archive._read import restored as _restored
from cablepod.archive._read import texts_fixed as _texts_fixed
from cablepod.batch import _sigint as interrupts

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterator, Mapping

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
ROOT = {
    "keywords": "cable, catenary, chain, proper orthogonal decomposition, Karhunen-Loeve, reduced order model",
    "comment": "Time is elapsed time in seconds since the start of the run and belongs to no date. Positions are "
    "Cartesian with y pointing up; arc length is unstretched and counts from the lower end.",
    "references": "Escalante, Faure, Rougier, Rosales, Filipich: A reduced order model of taut cable dynamics using "
    "Karhunen-Loeve decomposition",
    "license": "Freely distributed: cablepod (MIT license) sets no terms on what it computes",
}
SUMMARY = (
    "What the stage {} of cablepod gave, a package for reduced-order models of the dynamics of cables. "
    "The history says from which inputs and with which parameters."
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
    with interrupts.between_tasks(dataset):
        stamped = _stamped(dataset)
    # what is computed on the way may need other threads to read
    library = interrupts.between_tasks(dataset) if is_lazy else alone()
    try:
        with whole_file(path, check=lambda: check_target(path, overwrite=overwrite)) as part, library:
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


def _stamped(dataset: xr.Dataset) -> xr.Dataset:
    """Return a copy of `dataset` without inherited encodings, with the attributes of a file."""
    stamped = _texts_fixed(dataset.drop_encoding())
    for name, content in contents(stamped):
        stamped[name].attrs.setdefault("coverage_content_type", content)
    stamped.attrs = root_attributes(dataset)
    return stamped


def root_attributes(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the attributes of `dataset` as a file bears them, dates and program included; one that was read keeps its own."""
    digest = _content_hash(dataset)
    attrs: dict[str, Any] = {**ROOT, **dataset.attrs}
    attrs["id"] = str(attrs.get("id") or digest[:20])
    stages = _stages(dataset) or [{"id": attrs["id"], "function": "archive.write", "parameters": {}, "inputs": []}]
    new = [stage for stage in stages if "written" not in stage]
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    for stage in new:
        stage.update(_program(), written=now)
    own = _own_stage(stages, attrs["id"])
    own["sha256"] = digest
    if "wall_time_s" in attrs:
        own["wall_time_s"] = float(attrs.pop("wall_time_s"))
    # Texts made for an earlier stage may have come along with the attributes of an input.
    for name, text in (("title", "Result of {}"), ("summary", SUMMARY)):
        if attrs.get(name) in {None, *(text.format(stage["function"]) for stage in stages)}:
            attrs[name] = text.format(own["function"])
    if new or not {"source", "date_created"} <= set(attrs):
        attrs.update(source=f"cablepod {_program()['version']}", date_created=now)
    for name in ("time_coverage_duration", "time_coverage_resolution"):
        attrs.pop(name, None)  # of an input with other times, perhaps
    attrs.update(_time_coverage(dataset))
    attrs.update(Conventions="CF-1.11, ACDD-1.3", history=_history(str(attrs.get("history", "")), stages))
    attrs.update(history_json=json.dumps(stages, sort_keys=True), cablepod_schema=SCHEMA)
    return attrs


def _stages(dataset: xr.Dataset) -> list[dict[str, Any]]:
    try:
        stages = provenance.stages_of(dataset)
        if all(isinstance(stage["id"], str) and isinstance(stage["function"], str) for stage in stages):
            return stages
    except (ValueError, TypeError, KeyError):
        pass
    raise ArchiveError("attribute 'history_json' is not a list of stages, each with id and function; leave it out")


def _own_stage(stages: list[dict[str, Any]], identifier: str) -> dict[str, Any]:
    """Return the stage that made the dataset `identifier`; the last one where none bears that name."""
    return next((stage for stage in stages if stage["id"] == identifier), stages[-1])


def _history(history: str, stages: list[dict[str, Any]]) -> str:
    """Return `history` with a line for each stage that it does not name yet."""
    known = set(history.split())
    lines = [history] if history else []
    for stage in stages:
        if f"id={stage['id']}" not in known:
            inputs = f" inputs={','.join(stage['inputs'])}" if stage.get("inputs") else ""
            program = f"{stage['program']} {stage['version']}"
            lines.append(f"{stage['written']} {program}: {_call(stage)} id={stage['id']}{inputs}")
    return "\n".join(lines)


def _call(stage: Mapping[str, Any], width: int = 160) -> str:
    """Return a stage as a call, its parameters cut at `width` characters; history_json holds them all."""
    given = ", ".join(f"{name}={json.dumps(value)}" for name, value in stage.get("parameters", {}).items())
    return f"{stage['function']}({given if len(given) <= width else given[: width - 3] + '...'})"


def _time_coverage(dataset: xr.Dataset) -> dict[str, str]:
    """Return the length and, where it is constant, the step of ``time`` as ISO 8601 durations."""
    time = dataset.variables.get("time")
    if time is None or time.dims != ("time",) or time.size < 2 or time.dtype.kind not in "fi":
        return {}
    steps = np.diff(time.values)
    coverage = {"time_coverage_duration": time.values[-1] - time.values[0]}
    if np.allclose(steps, steps[0], rtol=1e-6, atol=0):
        coverage["time_coverage_resolution"] = steps.mean()
    return {name: f"PT{np.format_float_positional(x, 9, trim='-')}S" for name, x in coverage.items() if np.isfinite(x)}


def _content_hash(dataset: xr.Dataset) -> str:
    """Return the SHA-256 of names, dimensions, types and values: no attributes, no layout, no byte order."""
    total = hashlib.sha256()
    for name in sorted(map(str, dataset.variables)):
        variable = dataset.variables[name]
        is_text = variable.dtype.kind in "UO"
        kind = "text" if is_text else variable.dtype.newbyteorder("<").str
        total.update(json.dumps([name, list(variable.dims), list(variable.shape), kind]).encode())
        for values in _slabs(variable):
            total.update(json.dumps(values.tolist()).encode() if is_text else np.ascontiguousarray(values, kind).data)
    return total.hexdigest()


def _slabs(variable: xr.Variable) -> Iterator[np.ndarray]:
    """Yield the values in order; those of a lazy variable chunk by chunk along its first dimension."""
    if variable.chunks is None or variable.dtype.kind in "UO":
        yield variable.values
        return
    stops = np.cumsum(variable.chunks[0])
    for stop, size in zip(stops, variable.chunks[0], strict=True):
        yield variable.isel({variable.dims[0]: slice(stop - size, stop)}).values


@functools.cache
def _program() -> dict[str, str]:
    """Return program, version, platform and, in a checkout, commit: what stands beside every hash."""
    program = {"program": "cablepod", "version": version(), "platform": platform.platform()}
    commit = _commit(Path(__file__).resolve().parents[2])
    return program | ({"commit": commit} if commit else {})


def _commit(root: Path) -> str | None:
    """Return the commit of the checkout `root`, with "-dirty" behind it if files differ; None where there is none."""
    if not (root / ".git").exists():  # git would answer for a checkout around an installed package
        return None
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    environment["GIT_OPTIONAL_LOCKS"] = "0"  # look, but never write to the checkout
    try:
        answer = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):  # no git, no commit yet, not our checkout
        return None
    return answer.stdout.strip() or None


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
        opened = _open(path, chunks)
        lazy = _restored(opened)
        lazy.set_close(interrupts.held()(opened.close))
        return lazy
    with alone(), _open(path, None) as opened:
        try:
            return _restored(opened.load())
        except LIBRARY_ERRORS as error:
            raise _damaged(path, error) from error


def describe(source: xr.Dataset | str | os.PathLike[str]) -> str:
    """Tell in some lines what a file or dataset is and how it came about.

    Parameters
    ----------
    source
        A dataset, or the path of a file that :func:`write` wrote; of a file, no large array is read.

    Returns
    -------
    str
        Title, stage, id and sizes, then each variable with its units, then the history, a stage a line.

    Raises
    ------
    ArchiveError
        As :func:`read` does.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> print(cp.archive.describe(scene).splitlines()[0])
    title     Example 2: slow end motion
    """
    if isinstance(source, xr.Dataset):
        return "\n".join(_description(source))
    path = Path(source)
    with alone(), _open(path, None) as opened:
        try:
            size = f"file      {path} ({path.stat().st_size / 1e6:.3g} MB, schema {opened.attrs['cablepod_schema']})"
            return "\n".join([size, *_description(opened)])
        except ArchiveError as error:
            raise ArchiveError(f"{path}: {error}") from error
        except LIBRARY_ERRORS as error:
            raise _damaged(path, error) from error


def _description(dataset: xr.Dataset) -> Iterator[str]:
    stages = _stages(dataset)
    identifier = str(dataset.attrs.get("id", "none"))
    yield f"title     {dataset.attrs.get('title', 'none')}"
    yield f"stage     {_own_stage(stages, identifier)['function'] if stages else 'unknown'}"
    yield f"id        {identifier}"
    yield f"sizes     {', '.join(f'{dim} {size}' for dim, size in dataset.sizes.items()) or 'scalars only'}"
    for heading, names in (("coordinates", dataset.coords), ("variables", dataset.data_vars)):
        yield heading
        for name, item in ((name, dataset.variables[name]) for name in names):
            shape = f"({', '.join(map(str, item.dims))})" if item.dims else f"= {item.values.item()!r}"
            units = f" [{item.attrs['units']}]" if "units" in item.attrs else ""  # texts have none
            yield f"  {name} {shape}{units}  {item.attrs.get('long_name', '')}".rstrip()
    yield "history"
    yield from (_stage_line(stage) for stage in stages)


def _stage_line(stage: Mapping[str, Any]) -> str:
    inputs = f" from {', '.join(stage['inputs'])}" if stage.get("inputs") else ""
    commit = f" ({stage['commit'][:12]})" if "commit" in stage else ""
    seconds = f", {stage['wall_time_s']:.3g} s" if "wall_time_s" in stage else ""
    made = f"; {stage['program']} {stage['version']}{commit}, {stage['written']}" if "written" in stage else ""
    return f"  {stage['id']} {_call(stage)}{inputs}{made}{seconds}"
