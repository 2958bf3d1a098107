"""Content of a Dataset: hashes of variables and attributes, and numbers that tell rounding from other differences."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.conventions import is_in_memory, plain_indexes

if TYPE_CHECKING:
    import xarray as xr

#: Attributes that are not part of the content: texts for readers, and what follows from contents or writing.
NOT_CONTENT = frozenset((
    "keywords", "comment", "references", "license", "title", "summary", "acknowledgement", "creator_email", "creator_name",
    "institution", "project", "Conventions", "cablepod_schema", "cablepod_checksums", "date_created", "history", "history_json",
    "id", "source", "stage", "time_coverage_duration", "time_coverage_resolution", "wall_time_s",
))  # fmt: skip
#: Attributes of variables that are not part of it.
NOT_CONTENT_OF_VARIABLES = frozenset(("coverage_content_type", "long_name"))
#: Stages whose content is the values alone.
SCENES = ("scene", "scenes")
#: Length of a hash in hexadecimal digits, and of the period of the weights of a sum.
DIGITS, PERIOD = 16, 4096
#: Hash of a variable that was not computed.
UNKNOWN = ""
#: Number of rows that are read at once of a variable that is not in memory.
ROWS = 256
#: Texts of values and of tables that are hashed; ``json.dumps`` would make such an object in each call.
PLAIN, SORTED = json.JSONEncoder(default=str), json.JSONEncoder(sort_keys=True, default=str)


# --- variables ------------------------------------------------------------------------------------------------------------


class VariableContent:
    """Hash, and for real numbers largest absolute value and a weighted sum, of values that are given in order.

    The weights of the sum have random signs and sizes from 0.5 to 1.5.  A difference in one value changes it by about as much;
    rounding of n values by a relative e changes it by about e times the largest one times the square root of n.
    """

    def __init__(self, variable: xr.Variable) -> None:
        kind = variable.dtype.kind
        self.shape, self.is_text, self.is_real = variable.shape, not _has_bytes(variable.dtype), kind == "f"
        self.dtype = variable.dtype if self.is_text else variable.dtype.newbyteorder("<")
        has_attrs = variable.attrs and not self.is_text  # the units of all texts are 1
        attrs = _lists(variable.attrs, NOT_CONTENT_OF_VARIABLES) if has_attrs else {}
        kind = "text" if self.is_text else self.dtype.str
        head = [[*map(str, variable.dims)], [*variable.shape], kind, attrs]
        self._hash = hashlib.sha256(SORTED.encode(head).encode())
        self._largest, self._sum, self._done = 0.0, 0.0, 0

    def update(self, slab: Any, *, sums: bool = True) -> VariableContent:
        """Add the next values, an array or an index of pandas; return the content."""
        if self.is_text:
            self._hash.update(PLAIN.encode(slab.tolist()).encode())
            return self
        values = np.ascontiguousarray(slab, self.dtype)
        if not self.is_real:
            self._hash.update(_bytes(values))
            return self
        flat = values.reshape(-1)
        finite = math.isfinite(largest := _largest(flat))  # many times as fast as a mask
        if not finite and (missing := np.isnan(flat)).any():
            flat = np.where(missing, self.dtype.type(np.nan), flat)  # a file keeps no other bits of nan
        self._hash.update(_bytes(flat) if self.dtype.char == "g" else flat.data)
        if sums:
            if not finite:
                flat = np.where(np.isfinite(flat), flat, 0.0)
                largest = _largest(flat)
            self._largest = max(self._largest, largest)
            with np.errstate(over="ignore", invalid="ignore"):
                self._sum += weighted_sum(flat, self._done)
            self._done += flat.size
        return self

    @property
    def hash(self) -> str:
        """Hash of dimensions, sizes, type, attributes and values."""
        return self._hash.hexdigest()[:DIGITS]

    def entry(self) -> list[Any]:
        """Return what a history keeps: hash, shape and, of real numbers, largest absolute value and weighted sum."""
        shape = list(self.shape)
        if not self.is_real:
            return [self.hash, shape]
        return [self.hash, shape, self._largest, self._sum if math.isfinite(self._sum) else 0.0]


def _largest(flat: np.ndarray) -> float:
    """Return the largest absolute value, which is not finite where one is not; 0 without values.

    The methods ``max`` and ``min`` take four times as long for a few values.
    """
    return max(float(flat[flat.argmax()]), -float(flat[flat.argmin()])) if flat.size else 0.0


def weighted_sum(flat: np.ndarray, start: int = 0) -> float:
    """Return the sum of values times weights that depend on the place; `start` is the place of the first one."""
    block, place = divmod(start, PERIOD)
    inner, outer = weights(PERIOD), weights(1 << max(10, (block + flat.size // PERIOD + 2).bit_length()))
    first, total = flat[: PERIOD - place], 0.0
    if place or flat.size < PERIOD:
        total += float(outer[block] * np.einsum("i,i", first, inner[place : place + first.size]))
        flat, block = flat[first.size :], block + 1
    whole = flat.size // PERIOD
    if whole:
        sums = np.einsum("ij,j->i", flat[: whole * PERIOD].reshape(whole, PERIOD), inner)
        total += float(np.einsum("i,i", outer[block : block + whole], sums))
    if rest := flat.size - whole * PERIOD:
        total += float(outer[block + whole] * np.einsum("i,i", flat[-rest:], inner[:rest]))
    return total


@lru_cache(8)
def weights(count: int) -> np.ndarray:
    """Return the first numbers of a fixed sequence, from 0.5 to 1.5 with random signs (SplitMix64, the same on all machines)."""
    with np.errstate(over="ignore"):
        z = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    size = 0.5 + (z >> np.uint64(11)).astype(float) * 2.0**-53
    return np.where(z & np.uint64(1), size, -size)


def content_of_variable(variable: xr.Variable, labels: Any = None, *, sums: bool = True) -> VariableContent | None:
    """Return the content of a variable, None of a chunked one; one that is read on demand is not kept in memory.

    `labels` are those that :func:`cablepod.conventions.plain_indexes` gives of it.
    """
    if labels is not None:
        return VariableContent(variable).update(labels, sums=sums)
    in_memory = is_in_memory(variable)
    if not in_memory and variable.chunks is not None:
        return None
    content = VariableContent(variable)
    if in_memory or not variable.ndim or content.is_text:
        return content.update(np.asarray(variable.values), sums=sums)
    for first in range(0, variable.shape[0], ROWS):
        content.update(variable[first : first + ROWS].values, sums=sums)
    return content


# --- Datasets -------------------------------------------------------------------------------------------------------------


def is_scene(dataset: xr.Dataset) -> bool:
    """Tell whether a Dataset is a scene, or several of them."""
    return dataset.attrs.get("stage") in SCENES


def content_of(dataset: xr.Dataset, contents: Mapping[str, VariableContent] | None = None) -> dict[str, Any]:
    """Return what a history keeps of the content of a Dataset: a hash, that of attributes, and an entry of each variable.

    `contents` are those of its variables, computed if None, but not those of chunked variables.
    """
    entries: dict[str, list[Any]] = {}
    indexes = plain_indexes(dataset)
    for key, variable in dataset.variables.items():
        name = str(key)
        content = contents[name] if contents is not None else content_of_variable(variable, indexes.get(key))
        entries[name] = [UNKNOWN, list(variable.shape)] if content is None else content.entry()
    attributes = own_hash(dataset)
    total = total_hash(dataset, {name: entry[0] for name, entry in entries.items()}, attributes)
    return {"hash": total, "attributes": attributes, "variables": entries}


def total_hash(dataset: xr.Dataset, hashes: Mapping[str, str], attributes: str) -> str:
    """Return the hash of a Dataset from those of its variables and attributes; that of a scene is its :func:`digest`."""
    if is_scene(dataset):
        return digest(dataset)
    return hashlib.sha256(PLAIN.encode([sorted(hashes.items()), attributes]).encode()).hexdigest()[:DIGITS]


def own_hash(dataset: xr.Dataset) -> str:
    """Return the hash of the attributes of a Dataset without those of its variables."""
    own = _lists(dataset.attrs, NOT_CONTENT)
    return hashlib.sha256(SORTED.encode(own).encode()).hexdigest()[:DIGITS]


def _lists(attrs: Mapping[Any, Any], left_out: frozenset[str]) -> dict[str, list[Any]]:
    """Return attributes as lists, as a file does not tell a list of one number from a number."""
    return {
        str(key): [value] if isinstance(value, str) or type(value) in (int, float) else np.ravel(value).tolist()
        for key, value in attrs.items()
        if key not in left_out
    }


def digest(dataset: xr.Dataset) -> str:
    """Return a hash of names, dimensions and values of all variables."""
    parts = []
    for name, variable in sorted((str(name), variable) for name, variable in dataset.variables.items()):
        values = np.asarray(variable.values)
        parts += [_described(name, variable.dims, values.shape), _bytes(values)]
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


@lru_cache(1024)
def _described(name: str, dims: tuple[Any, ...], shape: tuple[int, ...]) -> bytes:
    """Return name, dimensions and shape of a variable as bytes (kept: to write tuples takes as long as to hash a scene)."""
    return f"{name}{dims}{shape}".encode()


def _has_bytes(dtype: Any) -> bool:
    """Tell whether values are kept as bytes, unlike Python objects, texts, and types of pandas."""
    return isinstance(dtype, np.dtype) and dtype.kind not in "UOT"


def _bytes(values: np.ndarray) -> bytes:
    """Return the content of an array as bytes."""
    if not _has_bytes(values.dtype):
        return str(values.tolist()).encode()
    if values.dtype.char in "gG":  # two doubles for each number, as bytes that hold no digits have any value
        parts = np.ascontiguousarray(values).reshape(-1).view(np.longdouble)
        with np.errstate(over="ignore", invalid="ignore"):
            head = parts.astype(np.float64)
            values = np.stack([head, (parts - head).astype(np.float64)])
    return values.tobytes()
