"""Compare the error estimate of condensed guys with their error against continuous guys.

    python pipelines/mast/estimate.py [--readme] [--quick]

A minute of the storm of the mast of 120 m, the same turned by 60 degrees, and the pull of the mast of 30 m (``mast30``, 10 s).
The guys have two to twelve modes and the default step.  Continuous guys are chains of 160 and 80 links, extrapolated as in
run.py.  Error and estimate are the rms difference of the tensions over their standard deviation, of the worst guy.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, percent, show_table
from mast.run import LINKS, extrapolated

import cablepod as cp
from cablepod import examples

HERE = Path(__file__).resolve().parent
RANKS = (2, 4, 6, 8, 12)


def storm(degrees: float) -> xr.Dataset:
    """Return the mast of 120 m in its storm, turned."""
    scene = cp.read_scene(examples.scene_path("mast120")).copy(deep=True)
    angle = np.deg2rad(degrees)
    scene["wind_direction"].values[:] = [np.cos(angle), 0.0, np.sin(angle)]
    return scene


def error(run: xr.Dataset, truth: xr.Dataset) -> float:
    """Return the rms difference of the tensions over their standard deviation, of the worst guy."""
    own, tension = run["guy_tension"], truth["guy_tension"]
    return float((np.sqrt(((own - tension) ** 2).mean("time")) / tension.std("time")).max())


def compare(scene: xr.Dataset, times: np.ndarray) -> list[tuple[float, float]]:
    """Return error and estimate for each number of modes, over all instants."""
    fine, coarse = (cp.mast.simulate(scene, guys="chain", links=links, times=times) for links in LINKS[:2])
    truth = extrapolated(fine, coarse)
    outputs = ("guy_tension", "error_estimate")
    runs = [cp.mast.simulate(scene, rank=rank, times=times, outputs=outputs) for rank in RANKS]
    return [(error(run, truth), float(run.attrs["error_estimate"])) for run in runs]


def main() -> None:
    """Compare and write the table."""
    given = command_line(__doc__, readme=True, quick="the pull alone").parse_args()
    pull = cp.read_scene(examples.scene_path("mast30"))
    cases = {"pull of 30 m": (pull, np.arange(501) * 0.02)}
    if not given.quick:
        minute = np.arange(601) * 0.1
        cases |= {"storm": (storm(0.0), minute), "storm, turned by 60 degrees": (storm(60.0), minute)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cp.OutOfRangeWarning)
        found = {name: compare(*case) for name, case in cases.items()}
    rows = [
        [name, *(f"{percent(actual)}, said {percent(told)}" for actual, told in pairs)] for name, pairs in found.items()
    ]
    table = markdown_table(["error and estimate", *(f"r = {rank}" for rank in RANKS)], rows)
    show_table("estimate", table, HERE if given.readme else None)
    ratio = [told / actual for pairs in found.values() for actual, told in pairs]
    print(f"estimate over error: {min(ratio):.2f} to {max(ratio):.2f}")


if __name__ == "__main__":
    main()
