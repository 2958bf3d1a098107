"""Content hash of a Dataset: SHA-256 over its variables, block by block."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from cablepod.archive._checksums import BlockSums
from cablepod.provenance import VariableContent

if TYPE_CHECKING:
    from collections.abc import Iterator


def content_hash(
    dataset: xr.Dataset, sums: dict[str, BlockSums] | None = None, contents: dict[str, VariableContent] | None = None
) -> str:
    """Return the SHA-256 of names, dimensions, types and values, independent of attributes, layout and byte order.

    The checksums of the blocks of each variable are put into `sums`, and what a history keeps of it into `contents`, in the same
    pass over the values.
    """
    total = hashlib.sha256()
    for name in sorted(map(str, dataset.variables)):
        variable = dataset.variables[name]
        is_text = variable.dtype.kind in "UO"
        kind = "text" if is_text else variable.dtype.newbyteorder("<").str
        total.update(json.dumps([name, list(variable.dims), list(variable.shape), kind]).encode())
        blocks = None if sums is None else sums.setdefault(name, BlockSums(variable))
        content = None if contents is None else contents.setdefault(name, VariableContent(variable))
        for values in _slabs(variable):
            if blocks is not None:
                blocks.update(values)
            if content is not None:
                content.update(values)
            total.update(json.dumps(values.tolist()).encode() if is_text else np.ascontiguousarray(values, kind).data)
    return total.hexdigest()


def _slabs(variable: xr.Variable) -> Iterator[np.ndarray]:
    """Yield the values in order, for a lazy variable chunk by chunk along its first dimension."""
    if variable.chunks is None or variable.dtype.kind in "UO":
        yield variable.values
        return
    stops = np.cumsum(variable.chunks[0])
    for stop, size in zip(stops, variable.chunks[0], strict=True):
        yield variable.isel({variable.dims[0]: slice(stop - size, stop)}).values
