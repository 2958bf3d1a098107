"""Tension at both ends of a cable in the wind: over time, mean, standard deviation, extremes, fatigue range, utilisation."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from cablepod import chain, fatigue
from cablepod.conventions import ENDS, label
from cablepod.fatigue._cycles import EXPONENT, FREQUENCY
from cablepod.integrate._window import within
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._parameters import ramp_of
from cablepod.parameters._utilisation import utilisation
from cablepod.study._models import recorded

#: Instants in a period of the fastest vibration that the summary tells, the third one, and their least and largest number.
SAMPLES, MIN_SAMPLES, MAX_SAMPLES = 20, 200, 50_000
#: Statistics begin where the last ramp ends, if at least this part of the run is left then.
LEAST_PART = 0.1
OUTPUTS = ("tension", "tension_extremes", "tension_mean", "tension_rms")
#: Variables that are those of the chain, over the whole run.
OF_THE_RUN = tuple(f"tension_{kind}{of}" for kind in ("maximum", "minimum") for of in ("", "_time", "_arc_length"))
#: Name -> (units, long name) of the others.
NAMES = {
    "tension_maximum": ("N", "largest tension anywhere, over all steps of the run"),
    "tension_minimum": ("N", "smallest tension anywhere, over all steps of the run"),
    "end_tension": ("N", "tension of the first and the last link"),
    "end_tension_mean": ("N", "time mean of the tension at the end"),
    "end_tension_std": ("N", "standard deviation of the tension at the end over time"),
    "end_tension_minimum": ("N", "smallest tension at the end over all steps"),
    "end_tension_maximum": ("N", "largest tension at the end over all steps"),
    "end_tension_maximum_time": ("s", "instant of the largest tension at the end, one of the output times"),
    "fatigue_range": ("N", f"equivalent tension range at the end, exponent {EXPONENT:g}, one cycle in a second"),
    "utilisation": ("1", "largest tension anywhere over the breaking strength"),
}


def tension_in_wind(
    scene: xr.Dataset, reference: xr.Dataset, numbers: xr.Dataset, progress: Callable[[str, float], None] | None = None
) -> xr.Dataset:
    """Return the tension at both ends over time, with its statistics, from a run of the chain with the step of another.

    The steps are those of the reference solution; the instants of the output are closer, so that cycles are not cut.  Mean,
    standard deviation, extremes and fatigue range at the ends begin where the last ramp ends.

    Parameters
    ----------
    scene, reference, numbers
        Scene with wind, its converged chain, its summary.
    progress
        Called with a label and the completed fraction.

    Returns
    -------
    xarray.Dataset
        ``end_tension (time, end)`` [N]; over the end ``end_tension_mean``, ``_std``, ``_minimum``, ``_maximum`` [N],
        ``end_tension_maximum_time`` [s], ``fatigue_range`` [N]; of the whole run and all links ``tension_maximum`` [N] with
        ``_time`` [s] and ``_arc_length`` [m], the same of the minimum, and ``utilisation`` where there is a breaking strength.
        The attributes ``window_start``, ``window_end`` [s] tell the part of the statistics.
    """
    p = parameters(scene)
    end = float(reference["time"][-1])
    ramps = (ramp_of(p), *(item.ramp for item in p.time_functions().values()))
    window = (start_of_statistics(ramps, end), end)
    found = np.concatenate([numbers[f"frequency_{plane}"].values for plane in ("in_plane", "out_of_plane")])
    highest = float(np.nanmax(found, initial=0.0))
    count = min(max(math.ceil(SAMPLES * highest * end), reference.sizes["time"], MIN_SAMPLES), MAX_SAMPLES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the run of the reference solution has warned
        run = chain.simulate(
            scene,
            times=np.linspace(0.0, end, count + 1),
            scheme=reference.attrs["scheme"],
            step=reference.attrs["step"],
            outputs=OUTPUTS,
            window=window,
            progress=None if progress is None else partial(progress, "tension at the ends"),
        )
    ends = run.isel(link=[0, -1])
    mean, rms = ends["tension_mean"].values, ends["tension_rms"].values
    series = xr.DataArray(
        ends["tension"].values,
        coords={"time": run["time"], "end": list(ENDS)},
        dims=("time", "end"),
        name="end_tension",
    )
    counted = series.isel(time=within(series["time"].values, window))
    peak = counted["time"].values[counted.values.argmax(axis=0)]
    largest = float(reference["tension_maximum"].max())
    of_run = {name: reference[name].min() for name in OF_THE_RUN} | {
        "tension_maximum": reference["tension_maximum"].max()
    }
    table = xr.Dataset(
        {
            "end_tension": series,
            "end_tension_mean": ("end", mean),
            "end_tension_std": ("end", np.sqrt(np.maximum(rms**2 - mean**2, 0.0))),
            "end_tension_minimum": ("end", ends["tension_minimum"].values),
            "end_tension_maximum": ("end", ends["tension_maximum"].values),
            "end_tension_maximum_time": ("end", peak),
            "fatigue_range": fatigue.equivalent(counted, exponent=EXPONENT, frequency=FREQUENCY),
            **{name: ((), value.item()) for name, value in of_run.items()},
            **({} if p.breaking_strength is None else {"utilisation": ((), utilisation(largest, p.breaking_strength))}),
        }
    )
    label(table, **NAMES)
    table.attrs = {
        "title": f"{scene.attrs['title']}: tension at the ends", "stage": "tension", "air": numbers.attrs["air"],
        "exponent": EXPONENT, "frequency": FREQUENCY, "step": run.attrs["step"], "window_start": window[0],
        "window_end": window[1],
    }  # fmt: skip
    return recorded(table, "tension", [run, reference])


def start_of_statistics(ramps: Iterable[Any], end: float) -> float:
    """Return the instant at which the last ramp ends [s]; 0, for the whole run, without one or if too little is left then."""
    last = max((float(ramp) for ramp in ramps), default=0.0)
    return last if end - last >= LEAST_PART * end else 0.0
