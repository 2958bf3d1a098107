"""Breaks of guys: from its break on a guy carries nothing, counted in steps; the steps leave it out in ``_kernels_mast.py``."""

from __future__ import annotations

import numpy as np

from cablepod.mast._request import ROUNDING, MastRequest
from cablepod.parameters._mast import MastParameters


def times_of_breaks(p: MastParameters) -> np.ndarray:
    """Return the time at which each guy breaks (guys,) [s], infinite where it does not."""
    return np.array([np.inf if guy.breaks is None else guy.breaks for guy in p.guys])


def steps_of_breaks(p: MastParameters, step: float) -> np.ndarray:
    """Return the first step at which each guy is broken (guys,): that at its break to rounding, or the next one."""
    return np.ceil(times_of_breaks(p) / step * (1.0 - ROUNDING))


def broken_at_outputs(p: MastParameters, request: MastRequest) -> np.ndarray:
    """Tell which guys are broken at the outputs (outputs, guys)."""
    return request.every * np.arange(request.outputs_count)[:, None] >= steps_of_breaks(p, request.step)
