"""Bounds of the angular frequencies of a model, from which steps follow."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cablepod.parameters._parameters import Parameters

#: Number of scenes whose longest chords are kept.
KEPT_CHORDS = 64


def largest_frequencies_squared(
    kappa: np.ndarray,
    norms: np.ndarray,
    stiffness: float | np.ndarray,
    q: np.ndarray,
    rows: np.ndarray,
    chord_tension: float | np.ndarray,
) -> np.ndarray:
    """Return |H| max kappa + K / L0 sum (kappa q)^2 + sum |g_a| |G_a|, which bounds squared angular frequencies [1/s^2].

    All arrays may have a leading dimension of members.

    Parameters
    ----------
    kappa, norms
        Squared slope norms (r,) [1/(kg m)], spectral norms of the geometric stiffness (patterns,).
    stiffness, chord_tension
        K / L0 [N/m] and H [N], numbers or (members,).
    q, rows
        Coordinates (r,) and boundary data (columns,).
    """
    loads = (np.abs(rows[..., 1 : 1 + norms.shape[-1]]) * norms).sum(axis=-1)
    return np.abs(chord_tension) * kappa.max(axis=-1) + stiffness * ((kappa * q) ** 2).sum(axis=-1) + loads


@lru_cache(KEPT_CHORDS)
def longest_chord(p: Parameters, end_time: float, intervals: int) -> float:
    """Return the longest distance of the ends at equal intervals up to `end_time` [s], in m; kept for the same scenes."""
    ends = p.end_positions(np.linspace(0.0, end_time, intervals + 1))
    return float(np.sqrt(np.sum((ends[:, 1] - ends[:, 0]) ** 2, axis=1)).max())
