"""Distances of runs and orders of errors, where a step or a size is halved each time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np


def distances(runs: Sequence[Any]) -> list[float]:
    """Return the largest differences of each array and the next one."""
    return [float(np.abs(a - b).max()) for a, b in pairwise(runs)]


def orders(errors: Sequence[Any]) -> np.ndarray:
    """Return by which powers of two errors fall from each to the next one."""
    return np.log2(np.divide(errors[:-1], errors[1:]))
