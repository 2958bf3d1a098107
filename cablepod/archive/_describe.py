"""Describe a Dataset or a file as text."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import xarray as xr

from cablepod.archive._attributes import call_text, checked_stages, stage_of
from cablepod.archive._folder import path_of
from cablepod.archive._read import READ_ERRORS, damaged, netcdf_lock, open_file
from cablepod.errors import ArchiveError, printable
from cablepod.parameters._checks import truth

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


def describe(source: xr.Dataset | str | os.PathLike[str], *, verify: bool = True) -> str:
    """Describe contents and history of a file or dataset.

    Parameters
    ----------
    source
        A dataset, or the path of a file of :func:`cablepod.archive.write`; large arrays of a file are not read.
    verify
        Whether a file must be as written, as for :func:`cablepod.archive.read`.

    Returns
    -------
    str
        Title, stage, id and sizes, then each variable with its units, then the history, one line per stage.

    Raises
    ------
    ArchiveError
        As :func:`cablepod.archive.read`.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> print(cp.archive.describe(scene).splitlines()[0])
    title     Example 2: slow end motion
    """
    truth("verify", verify)
    if isinstance(source, xr.Dataset):
        return "\n".join(map(printable, _description(source)))
    path = path_of(source, key="source", allowed="a Dataset, or the path of a netCDF file")
    with netcdf_lock(), open_file(path, None, verify=verify) as opened:
        try:
            size = f"file      {path} ({path.stat().st_size / 1e6:.3g} MB, schema {opened.attrs['cablepod_schema']})"
            return "\n".join(map(printable, [size, *_description(opened)]))
        except ArchiveError as error:
            raise ArchiveError(f"{path}: {error}") from error
        except READ_ERRORS as error:
            raise damaged(path, error) from error


def _description(dataset: xr.Dataset) -> Iterator[str]:
    """Yield the lines of the description."""
    stages = checked_stages(dataset)
    identifier = str(dataset.attrs.get("id", "none"))
    yield f"title     {dataset.attrs.get('title', 'none')}"
    yield f"stage     {stage_of(stages, identifier)['function'] if stages else 'unknown'}"
    yield f"id        {identifier}"
    yield f"sizes     {', '.join(f'{dim} {size}' for dim, size in dataset.sizes.items()) or 'scalars only'}"
    for heading, names in (("coordinates", dataset.coords), ("variables", dataset.data_vars)):
        yield heading
        for name, variable in ((name, dataset.variables[name]) for name in names):
            shape = f"({', '.join(map(str, variable.dims))})" if variable.dims else f"= {variable.values.item()!r}"
            is_text = variable.dtype.kind in "UO"
            units = f" [{variable.attrs['units']}]" if "units" in variable.attrs and not is_text else ""
            yield f"  {name} {shape}{units}  {variable.attrs.get('long_name', '')}".rstrip()
    yield "history"
    yield from (f"  {stage_line(stage)}" for stage in stages)


def stage_line(stage: Mapping[str, Any]) -> str:
    """Return the line of a stage: id, call, inputs, program, run time."""
    inputs = f" from {', '.join(stage['inputs'])}" if stage.get("inputs") else ""
    commit = f" ({stage['commit'][:12]})" if "commit" in stage else ""
    seconds = f", {stage['wall_time_s']:.3g} s" if "wall_time_s" in stage else ""
    written = f"; {stage['program']} {stage['version']}{commit}, {stage['written']}" if "written" in stage else ""
    return f"{stage['id']} {call_text(stage)}{inputs}{written}{seconds}"
