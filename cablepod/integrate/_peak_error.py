"""Time error of the largest tension of a run, from the estimate for all tensions."""

from __future__ import annotations

import numpy as np
import xarray as xr

#: Maximum estimated time error of the largest tension over that tension (above, a map of it marks the member).
MAX_PEAK_ERROR = 1e-2


def peak_errors(results: xr.Dataset) -> np.ndarray:
    """Return the estimated time error of the largest tension over that tension (member,); nan where it is not estimated.

    Parameters
    ----------
    results
        Members with ``tension_maximum``, ``tension_minimum (member, link)`` [N] and ``tension_time_error_estimate (member)``, a
        fraction of the largest range of a link: a small part of the tension where this hardly changes.
    """
    names = ("tension_maximum", "tension_minimum", "tension_time_error_estimate")
    if any(name not in results or "member" not in results[name].dims for name in names):
        return np.full(results.sizes["member"], np.nan)
    high, low, error = (results[name] for name in names)
    largest = abs(high.max("link"))
    ratio = (error * (high - low).max("link") / largest.where(largest > 0.0)).values
    return np.asarray(ratio, dtype=float)
