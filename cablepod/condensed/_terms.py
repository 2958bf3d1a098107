"""Coefficients to leading order as the kernels take them: named flat arrays, of one lane."""

from __future__ import annotations

import numpy as np

from cablepod.condensed._kernels_layout import LeadingTerms, Sizes


def constant_sizes(size: int, patterns: int, normal_loads: int, lanes: int = 1) -> Sizes:
    """Return numbers that are constants of the compiled code, which is compiled for each of them."""
    return Sizes(*((0,) * number for number in (lanes, size, patterns, normal_loads)))


def runtime_sizes(size: int, patterns: int, normal_loads: int) -> Sizes:
    """Return numbers of one lane that one compilation serves."""
    return Sizes((0,), *(np.empty(number) for number in (size, patterns, normal_loads)))


def terms_of_lane(
    stiffness: float,
    length: float,
    kappa: np.ndarray,
    mean_chordwise_forces: np.ndarray,
    geometric_stiffness: np.ndarray,
    load_projection: np.ndarray,
) -> LeadingTerms:
    """Return the coefficients of one lane, from K [N], L0 [m] and arrays as in :class:`LeadingTerms` of any dimensions."""
    numbers = (np.array([number]) for number in (stiffness, 1.0 / length, 0.5 * stiffness / length))
    arrays = (kappa, mean_chordwise_forces, geometric_stiffness, load_projection)
    return LeadingTerms(*numbers, *(np.ravel(array) for array in arrays))
