"""Values of options as a history keeps them: JSON types, long arrays by a formula or a digest."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

#: Maximum size of an array stored in a history; longer ones are stored as a digest.
MAX_HISTORY_ITEMS = 64
#: Maximum size of a non-uniform time array stored in a history (a run cannot be repeated without it).
MAX_HISTORY_FLOATS = 4096
#: Formulas for equidistant numbers, see :func:`equidistant`.
EQUIDISTANT = ("multiples", "quotients", "linspace")


def to_json(value: Any) -> Any:
    """Convert a value to JSON types; long arrays become first, last and count if equidistant, else a digest."""
    if isinstance(value, dict):
        return {str(key): to_json(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        if len(value) > MAX_HISTORY_ITEMS and isinstance(value[0], float):
            return to_json(np.array(value))
        return [to_json(entry) for entry in value]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        if value.size <= MAX_HISTORY_ITEMS:
            return value.tolist()
        if value.size > MAX_HISTORY_FLOATS or value.dtype.kind != "f":
            return _array_to_json(value)
        found = _kept_array_to_json(value.tobytes(), value.dtype, value.shape)
        return found.copy()  # the caller may change it
    return value


def _array_to_json(value: np.ndarray) -> Any:
    """Convert a long array to JSON types, see :func:`to_json`."""
    for way, candidate in _equidistant(value):
        if np.array_equal(candidate, value):
            return {"equidistant": way, "first": float(value[0]), "last": float(value[-1]), "count": value.size}
    if value.ndim == 1 and value.dtype.kind == "f" and value.size <= MAX_HISTORY_FLOATS:
        return value.tolist()  # non-uniform time array
    digest = hashlib.sha256(np.ascontiguousarray(value).data).hexdigest()[:16]
    return {"shape": list(value.shape), "dtype": str(value.dtype), "sha256": digest}


@lru_cache(64)
def _kept_array_to_json(content: bytes, dtype: np.dtype, shape: tuple[int, ...]) -> Any:
    """Do :func:`_array_to_json` once for the same content: many runs have the same instants."""
    return _array_to_json(np.frombuffer(content, dtype).reshape(shape))


def _equidistant(value: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield formula and equidistant numbers with first, last and count of `value` (formulas differ in the last bits)."""
    if value.ndim == 1 and value.dtype.kind == "f" and np.isfinite(value).all():
        for way in EQUIDISTANT:
            yield way, equidistant(way, float(value[0]), float(value[-1]), value.size)


def equidistant(way: str, first: float, last: float, count: int) -> np.ndarray:
    """Return equidistant numbers: multiples of an interval, quotients by a frequency, or ``numpy.linspace``."""
    span = last - first
    if way == "multiples":
        return first + float(f"{span / (count - 1):.12g}") * np.arange(count)
    if way == "quotients" and span:
        return first + np.arange(count) / float(f"{(count - 1) / span:.12g}")
    return np.linspace(first, last, count)
