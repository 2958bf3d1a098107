"""Columns of the table of an ensemble of masts."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod.mast._fatigue import EXPONENT, FREQUENCY

#: Variables of the results that are read.
READ = (
    "guy_tension_maximum", "guy_tension_minimum", "fatigue_range", "utilisation", "displacement_minimum",
    "displacement_maximum", "bending_moment_minimum", "bending_moment_maximum", "smallest_tension",
)  # fmt: skip
#: Heading of equivalent ranges.
FATIGUE = f"fatigue range (exponent {EXPONENT:g} at {FREQUENCY:g} Hz) [N]"
#: Heading, variable and extreme over all guys; then heading and variable of each guy.
OVER_GUYS: tuple[tuple[str, str, Any], ...] = (
    ("largest tension [N]", "guy_tension_maximum", np.fmax.reduce),
    ("smallest tension [N]", "guy_tension_minimum", np.fmin.reduce),
    (f"largest {FATIGUE}", "fatigue_range", np.fmax.reduce),
    ("largest utilisation [1]", "utilisation", np.fmax.reduce),
)
OF_EACH_GUY = (
    ("largest tension [N]", "guy_tension_maximum"),
    (FATIGUE, "fatigue_range"),
    ("utilisation [1]", "utilisation"),
)
#: Heading and variable of the mast, the larger one of both signs and coordinates.
OF_THE_MAST = (
    ("largest displacement along x or z [m]", "displacement"),
    ("largest bending moment along x or z [N m]", "bending_moment"),
)


def columns(results: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the columns by heading: extremes over all guys, of the mast, and of each guy.

    Parameters
    ----------
    results
        Results of masts along ``member``, loaded.
    """
    found = {}
    for heading, name, extreme in OVER_GUYS:
        if name in results:
            found[heading] = extreme(results[name].transpose("member", "guy").values, axis=1)
    for heading, name in OF_THE_MAST:
        if f"{name}_maximum" in results:
            least, most = (results[f"{name}_{what}"] for what in ("minimum", "maximum"))
            sizes = np.maximum(abs(least.values), abs(most.values))  # (member, place, coordinate)
            found[heading] = sizes.reshape(sizes.shape[0], -1).max(axis=1)
    for g in range(results.sizes.get("guy", 0)):
        for heading, name in OF_EACH_GUY:
            if name in results:
                found[f"guy {int(results['guy'][g])} {heading}"] = results[name].isel(guy=g).values
    return found
