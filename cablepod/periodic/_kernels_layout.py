"""Arguments of the periodic kernels: named arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cablepod.condensed._kernels_layout import LeadingTerms


class Forced(NamedTuple):
    """Terms of the condensed model without dimension, and its forcing at M equidistant phases."""

    terms: LeadingTerms
    candidates: np.ndarray  #: chordwise force patterns where their sum may be least (patterns, candidates)
    rows: np.ndarray  #: boundary data as three terms with the factors 1, omega and omega squared (3, M, columns)
    damping: float  #: by mass
