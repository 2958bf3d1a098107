"""Lifting of moving ends, eq. (35): a position is the straight line between the ends plus a deflection that both ends lack."""

from __future__ import annotations

import numpy as np

from cablepod.discretisation._formulas import on_line


def weights_of_ends(sigma: np.ndarray) -> np.ndarray:
    """Return the weights (2, P) of lower and upper end in their straight line at the relative arc lengths `sigma` (P,)."""
    return np.stack([1.0 - sigma, sigma])


def line_between(ends: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return points (..., P, dims) of the straight lines between `ends` (..., 2, dims) at relative arc lengths `sigma` (P,)."""
    return np.asarray(on_line(ends[..., :1, :], ends[..., 1:, :], sigma[:, None]))
