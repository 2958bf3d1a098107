"""Describe a Dataset or a file in words."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from cablepod.archive._attributes import _call, _own_stage, _stages
from cablepod.archive._read import LIBRARY_ERRORS, alone
from cablepod.archive._read import damaged as _damaged
from cablepod.archive._read import open_file as _open
from cablepod.errors import ArchiveError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


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
