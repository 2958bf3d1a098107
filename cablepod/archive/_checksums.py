"""Checksums of the content of a file: CRC-32 of attributes and of blocks of values.

They stand as JSON in the attribute :data:`CHECKSUMS` of the file: one for each global attribute; for each variable one of its
dimensions, type and attributes, and one for each block of its values, so that a part of it can be checked when it is read.
Blocks are folded (:mod:`cablepod.archive._folded`).
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from cablepod.archive._folded import FoldedCrc, folded_crc

#: Attribute that holds the checksums of a file.
CHECKSUMS = "cablepod_checksums"
#: Target bytes of a block, also of a chunk of the file.
BLOCK = 1 << 20
#: Maximum number of blocks of a variable, so that the attribute stays small.
MAX_BLOCKS = 1024
#: Dimensions split into blocks and chunks (decompositions read complete rows of particles).
SPLIT = ("time", "member")
#: Digits of a checksum.
DIGITS = 8


def chunk_shape(variable: xr.Variable) -> tuple[int, ...]:
    """Return the shape of chunks of about :data:`BLOCK` bytes, split along time first, then member."""
    sizes = dict(variable.sizes)
    rows = BLOCK * math.prod(sizes[dim] for dim in SPLIT if dim in sizes) // max(variable.nbytes, 1)
    for dim in SPLIT:
        if dim in sizes:
            sizes[dim] = min(sizes[dim], max(rows, 1))
            rows //= max(sizes[dim], 1)
    return tuple(max(size, 1) for size in sizes.values())


def block_shape(variable: xr.Variable) -> tuple[int, ...]:
    """Return the shape of blocks: that of chunks or a multiple of it; texts are one block."""
    if variable.dtype.kind in "UO":
        return tuple(max(size, 1) for size in variable.shape)
    block = list(chunk_shape(variable))
    while math.prod(counts := _counts(variable.shape, block)) > MAX_BLOCKS:
        axis = counts.index(max(counts))
        block[axis] *= 2
    return tuple(block)


class BlockSums:
    """Checksums of the blocks of a variable, of values given in order."""

    def __init__(self, variable: xr.Variable) -> None:
        self.shape, self.block = variable.shape, block_shape(variable)
        counts = _counts(self.shape, self.block)
        self._inner = list(product(*map(range, counts[1:])))
        self._sums = [[FoldedCrc() for _ in self._inner] for _ in range(counts[0] if counts else 1)]
        self._start = 0

    def update(self, slab: np.ndarray) -> None:
        """Add the next values along the first dimension; all of a scalar."""
        rows = slab if self.shape else slab.reshape(1)
        step = self.block[0] if self.shape else 1
        for number in range(self._start // step, -(-(self._start + len(rows)) // step)):
            part = rows[max(number * step - self._start, 0) : (number + 1) * step - self._start]
            sums = self._sums[number]
            for place, index in enumerate(self._inner):
                sums[place].update(_bytes(part[(slice(None), *_slices(index, self.block[1:], self.shape[1:]))]))
        self._start += len(rows)

    def digits(self) -> str:
        """Return the checksums as digits."""
        return "".join(_hex(crc.value()) for sums in self._sums for crc in sums)


def as_text(stamped: xr.Dataset, sums: Mapping[str, BlockSums]) -> str:
    """Return the text of the attribute :data:`CHECKSUMS` for a dataset as it is given to the netCDF library."""
    variables = {
        str(name): {
            "block": list(sums[str(name)].block),
            "crc32": _hex(_head(variable, name in stamped.coords)) + sums[str(name)].digits(),
        }
        for name, variable in stamped.variables.items()
    }
    tables = {"variables": variables, "attributes": _of_attributes(stamped.attrs)}
    return json.dumps(tables, sort_keys=True)


class Checksums:
    """Checksums of a file, to be compared with its content."""

    def __init__(self, text: str) -> None:
        """Parse the attribute; of damaged text, everything is changed."""
        try:
            tables = json.loads(text)
            self._variables, self._attributes = dict(tables["variables"]), dict(tables["attributes"])
        except (ValueError, TypeError, KeyError, RecursionError):
            self._variables, self._attributes = {}, {}
        self._blocks: dict[tuple[str, tuple[int, ...]], Blocks] = {}

    def changed_heads(self, dataset: xr.Dataset) -> list[str]:
        """Return what is not as written in an opened file without its values: attributes, and heads of variables."""
        now, before = _of_attributes(dataset.attrs), self._attributes
        attributes = [
            f"attribute {name}" for name in dict.fromkeys([*before, *now]) if before.get(name) != now.get(name)
        ]
        variables = [
            str(name)
            for name in dict.fromkeys([*self._variables, *dataset.variables])
            if name not in dataset.variables
            or self._digits(str(name))[:DIGITS] != _hex(_head(dataset.variables[name], name in dataset.coords))
        ]
        return variables + attributes

    def blocks(self, name: str, shape: Sequence[int]) -> Blocks:
        """Return the blocks of a variable, once for all; of a damaged entry, no block matches."""
        if (name, tuple(shape)) in self._blocks:
            return self._blocks[name, tuple(shape)]
        block = self._variables.get(name, {}).get("block") if isinstance(self._variables.get(name), dict) else None
        if (
            not isinstance(block, list)
            or len(block) != len(shape)
            or not all(isinstance(n, int) and n > 0 for n in block)
        ):
            block = [max(size, 1) for size in shape]
        found = Blocks(tuple(shape), tuple(block), self._digits(name)[DIGITS:])
        return self._blocks.setdefault((name, tuple(shape)), found)

    def __contains__(self, name: str) -> bool:
        return name in self._variables

    def _digits(self, name: str) -> str:
        """Return the checksums of a variable as digits; none of a damaged entry."""
        entry = self._variables.get(name)
        digits = entry.get("crc32") if isinstance(entry, dict) else None
        return digits if isinstance(digits, str) else ""


class Blocks:
    """Checksums of the blocks of one variable; blocks that were found unchanged are not compared again."""

    def __init__(self, shape: tuple[int, ...], block: tuple[int, ...], digits: str) -> None:
        self.shape, self.block, self.digits = shape, block, digits
        self.counts = _counts(shape, block)
        self._unchanged: set[tuple[int, ...]] = set()

    def checked(self, key: tuple[int | slice, ...], read: Callable[[tuple[Any, ...]], np.ndarray]) -> np.ndarray | None:
        """Return the values at integers and slices, None if they are not as written.

        `read` is called for whole blocks that are not compared yet, once for all, otherwise for the values alone.
        """
        bounds = [_bounds(entry, size) for entry, size in zip(key, self.shape, strict=True)]
        if any(low >= high for low, high in bounds) and 0 not in self.shape:
            return read(key)  # nothing selected
        first = [low // step for (low, _), step in zip(bounds, self.block, strict=True)]
        last = [max(high - 1, low) // step for (low, high), step in zip(bounds, self.block, strict=True)]
        missing = set(product(*(range(low, high + 1) for low, high in zip(first, last, strict=True)))) - self._unchanged
        if not missing:
            return read(key)
        start = [low * step for low, step in zip(first, self.block, strict=True)]
        stop = [min((high + 1) * step, size) for high, step, size in zip(last, self.block, self.shape, strict=True)]
        values = np.asarray(read(tuple(map(slice, start, stop))))
        for index in sorted(missing):
            places = _slices(index, self.block, self.shape)
            part = tuple(slice(p.start - low, p.stop - low) for p, low in zip(places, start, strict=True))
            if not self._matches(index, values[part]):
                return None
        self._unchanged |= missing
        return values[
            tuple(_shifted(entry, size, low) for entry, size, low in zip(key, self.shape, start, strict=True))
        ]

    def _matches(self, index: tuple[int, ...], values: np.ndarray) -> bool:
        number = 0
        for place, count in zip(index, self.counts, strict=True):
            number = number * count + place
        return self.digits[DIGITS * number : DIGITS * (number + 1)] == _hex(folded_crc(_bytes(values)))

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_unchanged": set()}


def _of_attributes(attrs: Mapping[str, Any]) -> dict[str, str]:
    """Return the checksum of each global attribute."""
    return {str(name): _hex(zlib.crc32(_plain(value))) for name, value in attrs.items() if name != CHECKSUMS}


def _head(variable: xr.Variable, is_coordinate: bool) -> int:
    """Return the checksum of dimensions, type and attributes of a variable."""
    is_text = variable.dtype.kind in "UO"
    kind = "text" if is_text else variable.dtype.newbyteorder("<").str
    head = [list(map(str, variable.dims)), list(variable.shape), kind, is_coordinate]
    attrs = sorted((str(name), _plain(value).decode()) for name, value in variable.attrs.items())
    return zlib.crc32(json.dumps([head, attrs]).encode())


def _plain(value: Any) -> bytes:
    """Return an attribute as text, equal before and after a file: a list of one entry is that entry."""
    array = np.atleast_1d(np.asarray(value))
    if array.dtype.kind not in "iuf":
        return json.dumps(
            [str(entry).rstrip("\0") for entry in np.atleast_1d(np.asarray(value, dtype=object)).flat]
        ).encode()
    return json.dumps([array.dtype.newbyteorder("<").str, array.tolist()]).encode()


def _bytes(values: np.ndarray) -> Any:
    """Return values as a buffer of bytes: those of little-endian numbers, of texts as JSON."""
    values = np.asarray(values)
    if values.dtype.kind in "UO":
        return json.dumps(np.atleast_1d(values).tolist()).encode()
    if not values.size:
        return b""
    return np.ascontiguousarray(values, values.dtype.newbyteorder("<")).reshape(-1).view(np.uint8).data


def _hex(crc: int) -> str:
    return f"{crc:08x}"


def _counts(shape: Sequence[int], block: Sequence[int]) -> list[int]:
    """Return the numbers of blocks along each dimension, at least one."""
    return [max(1, -(-size // step)) for size, step in zip(shape, block, strict=True)]


def _slices(index: Sequence[int], block: Sequence[int], shape: Sequence[int]) -> tuple[slice, ...]:
    """Return the place of a block in the variable."""
    return tuple(
        slice(number * step, min((number + 1) * step, size))
        for number, step, size in zip(index, block, shape, strict=True)
    )


def _bounds(entry: int | slice, size: int) -> tuple[int, int]:
    """Return the least index of a selection, and one more than the largest."""
    if not isinstance(entry, slice):
        place = int(entry) % max(size, 1)
        return place, place + 1
    places = range(*entry.indices(size))
    return (min(places[0], places[-1]), max(places[0], places[-1]) + 1) if places else (0, 0)


def _shifted(entry: int | slice, size: int, start: int) -> int | slice:
    """Return a selection in values that begin at index `start`."""
    if not isinstance(entry, slice):
        return int(entry) % max(size, 1) - start
    places = range(*entry.indices(size))
    end = places.stop - start
    return slice(places.start - start, end if end >= 0 else None, places.step) if places else slice(0, 0)
