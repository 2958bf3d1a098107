"""Doubtful members of an ensemble: time error of the largest tension, from the estimate for all tensions; slack cables."""

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


def along_members(results: xr.Dataset, name: str) -> np.ndarray:
    """Return a variable of numbers along ``member``, its minimum over links; nan if there is none."""
    if name in results and results[name].dtype.kind == "f":
        array = results[name].min("link") if results[name].dims == ("member", "link") else results[name]
        if array.dims == ("member",):
            return np.asarray(array.values)
    return np.full(results.sizes["member"], np.nan)


def slack_members(results: xr.Dataset) -> np.ndarray:
    """Tell which members go slack at times (member,): by their links, those of a mast's guys, or the chordwise force."""
    links, of_guys = (along_members(results, name) <= 0.0 for name in ("tension_minimum", "smallest_tension"))
    return np.asarray(links | of_guys | (along_members(results, "smallest_chordwise_force") < 0.0))
