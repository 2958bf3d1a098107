"""Whether the instants of a series are too far apart for its cycles."""

from __future__ import annotations

import numpy as np
import xarray as xr

from cablepod.errors import CoarseWarning, warn
from cablepod.fatigue._cycles import _damage_sums

#: Maximum part of the equivalent range that half of the instants may miss: a shipped mast misses 6.5 % so, and 3 % at all
#: instants; the damage by an exponent of 4 lacks four times as much.
MAX_LOSS = 0.08
#: Minimum number of instants from which this is asked.
MIN_INSTANTS = 32


def warn_of_cut_cycles(series: xr.DataArray, exponent: float, of: str) -> None:
    """Warn where instants are so far apart that rainflow cycles lose their peaks.

    What every second instant misses of the equivalent range is one to two times what all instants miss of that of the motion.

    Parameters
    ----------
    series
        Numbers along ``time`` at equally spaced instants; every further dimension is a series of its own.
    exponent
        Exponent of the S-N curve.
    of
        What is too low then, for the message.
    """
    if series.sizes["time"] < MIN_INSTANTS:
        return
    ranges = []
    for step in (1, 2):
        some = series.isel(time=slice(None, None, step))
        scale, sums, _ = _damage_sums(some, exponent, "time")
        ranges.append(scale * sums ** (1.0 / exponent))
    with np.errstate(invalid="ignore", divide="ignore"):
        loss = 1.0 - np.divide(ranges[1], ranges[0])
    largest = float(np.nanmax(loss, initial=0.0))
    if largest > MAX_LOSS:
        interval = float(series["time"].values[1] - series["time"].values[0])
        warn(
            f"time.interval: {interval:g} s cuts cycles: at every second instant the equivalent range of a tension falls by "
            f"{100.0 * largest:.2g} %, so that {of} is likely too low by half of that or more; try: time.interval = "
            f"{0.25 * interval:.2g} s",
            CoarseWarning,
        )
