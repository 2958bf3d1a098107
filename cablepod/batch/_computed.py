"""Variables of members that are computed when they are read, as those of a file are read from the disk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from xarray.backends import BackendArray
from xarray.core import indexing

#: Number of members computed at once.
BLOCK = 256


class ComputedRows(BackendArray):
    """Array (members, ...) of numbers whose rows are computed on reading."""

    def __init__(self, shape: tuple[int, ...], compute: Callable[[int, int], np.ndarray]) -> None:
        self.shape, self.dtype, self.compute = shape, np.dtype(float), compute

    def __getitem__(self, key: Any) -> np.ndarray:
        """Compute the elements of a key of xarray."""
        values: np.ndarray = indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._read
        )
        return values

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        """Compute the elements of whole numbers and slices of positive step."""
        rows, rest = range(self.shape[0])[key[0]], (slice(None), *key[1:])
        if isinstance(rows, int):
            return np.asarray(self.compute(rows, rows + 1)[rest][0])
        result = np.empty(np.broadcast_to(0.0, (len(rows), *self.shape[1:]))[rest].shape)
        size = BLOCK if rows.step == 1 else 1
        for first in range(0, len(rows), size):
            block = rows[first : first + size]
            result[first : first + size] = self.compute(block[0], block[-1] + 1)[rest]
        return result


def computed_variable(
    dims: tuple[str, ...], shape: tuple[int, ...], compute: Callable[[int, int], np.ndarray]
) -> tuple[tuple[str, ...], Any]:
    """Return dimensions and values of a variable of all members that takes no memory until it is read, and is kept then.

    Parameters
    ----------
    dims, shape
        Those of the variable, ``member`` first.
    compute
        Returns the rows of the members `first` ... `last - 1`; can be pickled.
    """
    rows: Any = indexing.LazilyIndexedArray(ComputedRows(shape, compute))
    return dims, indexing.MemoryCachedArray(indexing.CopyOnWriteArray(rows))
