"""Energy of modes: shares, and the number of modes that a share needs."""

from __future__ import annotations

import numpy as np

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import integer, number


def fractions(parts: np.ndarray, outside: np.ndarray | float = 0.0) -> np.ndarray:
    """Return parts (matrix, mode) divided by their sum plus `outside`, zero for a zero sum."""
    total = parts.sum(axis=1, keepdims=True) + outside
    return np.divide(parts, total, out=np.zeros_like(parts), where=total > 0)


def choose_rank(squares: np.ndarray, outside: np.ndarray, rank: int | None, energy: float | None, most: int) -> int:
    """Return the number of modes to keep, at most `most`, from squared singular values (matrix, mode)."""
    most = min(squares.shape[1], most)
    if most < 1:
        raise SceneError("snapshots: given one instant; allowed: at least two, because the time mean is taken off")
    if rank is not None:
        integer(least=1)("rank", rank)
        if rank > most:
            raise scene_error("rank", rank, f"at most {most}, as many as particles and snapshots give")
        return int(rank)
    if energy is None:
        return most
    number(above=0.0, most=1.0)("energy", energy)
    needed = 1
    for row, rest in zip(squares, outside[:, 0], strict=True):
        if row.sum() > 0.0:
            cumulative = np.cumsum(row) / (row.sum() + rest)
            needed = max(needed, int(np.searchsorted(cumulative, energy * (1.0 - 1e-15))) + 1)
    return min(needed, most)
