"""Fatigue ranges of the guys of a mast."""

from __future__ import annotations

import xarray as xr

from cablepod import fatigue
from cablepod.fatigue._cut_cycles import warn_of_cut_cycles
from cablepod.fatigue._cycles import EXPONENT, FREQUENCY
from cablepod.integrate._window import within


def guy_fatigue(motion: xr.Dataset, window: tuple[float, float] | None = None) -> xr.DataArray | None:
    """Return the equivalent range of the tension of each guy [N], over a run or its window; None without guys or two instants.

    Parameters
    ----------
    motion
        Result of :func:`cablepod.mast.simulate` with the output "guy_tension", with or without ``member``.
    window
        Start and end [s] of the part that counts.
    """
    if "guy_tension" not in motion or not motion.sizes["guy"]:
        return None
    tension = motion["guy_tension"]
    if window is not None:
        tension = tension.isel(time=within(tension["time"].values, window))
    if tension.sizes["time"] < 2:
        return None
    warn_of_cut_cycles(tension, EXPONENT, "the fatigue range")
    return fatigue.equivalent(tension, exponent=EXPONENT, frequency=FREQUENCY).assign_attrs(
        units="N", long_name=f"equivalent tension range of the guy, exponent {EXPONENT:g}, one cycle in a second"
    )
