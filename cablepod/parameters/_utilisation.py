"""Utilisation of cables: tension over breaking strength."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np


def strengths_of(cables: Iterable[Any]) -> np.ndarray:
    """Return the breaking strengths of cables or segments (cables,) [N], nan where none is given."""
    return np.array([np.nan if cable.breaking_strength is None else float(cable.breaking_strength) for cable in cables])


def utilisation(tension: Any, strength: Any) -> Any:
    """Return tensions over breaking strengths [N], of arrays of any kind; nan where a strength is."""
    return tension / strength


def utilisation_of(cables: Iterable[Any], tension: Any) -> np.ndarray | None:
    """Return the utilisation of cables or segments by their tensions (cables,) [N], nan without a strength; None without any."""
    strength = strengths_of(cables)
    return utilisation(np.asarray(tension), strength) if np.isfinite(strength).any() else None
