"""Damping by mass over a step, integrated exactly.

With v' = f / m - c v and a force that is constant over the time h,

    v(t + h) = exp(-c h) v(t) + (1 - exp(-c h)) / c  f / m

All explicit schemes take it so; hosts, with steps of changing length, in ``condensed/_kernels_host.py``.  Implicit schemes, masts
and their guys take -c v at the middle of a step, which gives the factor (1 - c h / 2) / (1 + c h / 2).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cablepod.errors import SceneError

#: Maximum of damping times an explicit step: the velocity half a step before the start grows by exp(c h / 2), and its square must
#: stay finite.
MAX_DAMPING_EXPONENT = 600.0


def decay_and_impulse(damping: Any, time: float) -> tuple[Any, Any]:
    """Return exp(-c h) and the velocity gained for unit acceleration [s] over a time [s], for damping c (any shape) [1/s]."""
    divisor = np.where(damping == 0.0, 1.0, damping)
    return np.exp(-damping * time), np.where(damping == 0.0, time, -np.expm1(-damping * time) / divisor)[()]


def half_step_back(damping: float, step: float) -> tuple[float, float]:
    """Return factor and impulse [s] of half an explicit step [s] backwards from the start, against damping [1/s]."""
    if damping * step > MAX_DAMPING_EXPONENT:
        raise SceneError(
            f"damping.mass_proportional: given {damping:g}; allowed: at most {MAX_DAMPING_EXPONENT / step:.4g} 1/s with explicit "
            f"steps of {step:.4g} s; an implicit scheme, or a shorter step, takes more"
        )
    return decay_and_impulse(damping, -0.5 * step)
