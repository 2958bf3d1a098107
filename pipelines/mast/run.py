"""Compare the guys of a mast in a storm: chains, condensed models and static catenaries.

    python pipelines/mast/run.py [--seeds 1 2 3] [--direction 0] [--ice 0] [--scene mast120] [--quick] [--readme]

The mast of 120 m with nine guys runs 660 s in turbulent wind, of which the last 600 s count.  Guys are chains, condensed models
or static catenaries.  The reference has continuous guys: chains of 160 and 80 links, extrapolated to infinitely many.  Two rows
judge it, the same extrapolation from 80 and 40 links and from 40 and 20.

Written are means over the winds: rms difference of the tension of the median guy over its standard deviation; for the worst guy
the differences of standard deviation, peak and equivalent fatigue range; rms difference of the displacement of the top over its
standard deviation; run times of the kernel and of the whole call (CPU, medians).
"""

from __future__ import annotations

import itertools
import os
import statistics
import sys
import time
import warnings
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from _study import ONE_THREAD

    os.environ.update(ONE_THREAD)

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, short, show_table
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import cablepod as cp
from cablepod import examples
from cablepod.mast import _kernels_march

HERE = Path(__file__).parent
#: Links of the chains, each half of the one before; the reference is extrapolated from the first two.
LINKS = (160, 80, 40, 20, 10)
#: Results of a run that errors are taken of.
COMPARED = ["guy_tension", "displacement", "guy_tension_std", "guy_tension_maximum"]
CASES: list[tuple[str, dict[str, Any]]] = [
    ("condensed, r = 4, 20 ms", {"rank": 4, "step": 0.02}),
    ("condensed, r = 6, 20 ms", {"rank": 6, "step": 0.02}),
    ("condensed, r = 6, 10 ms", {"rank": 6, "step": 0.01}),
    ("static catenaries", {"guys": "catenary"}),
]
COLUMNS = ("tension rms, median guy", "std", "peak", "fatigue range (m = 4)", "top", "kernel [s]", "call [s]")


class Timed:
    """The kernel with its CPU time."""

    def __init__(self) -> None:
        self.last = 0.0
        _kernels_march.march = self.wrapped(_kernels_march.march)

    def wrapped(self, kernel: Any) -> Any:
        """Return a kernel that notes its time."""

        def call(*arguments: Any) -> Any:
            begin = time.process_time()
            result = kernel(*arguments)
            self.last = time.process_time() - begin
            return result

        return call


def extrapolated(fine: xr.Dataset, coarse: xr.Dataset) -> xr.Dataset:
    """Return results of continuous guys from chains of n and n/2 links, whose errors fall with the square of n (Richardson)."""
    return fine[COMPARED] + (fine[COMPARED] - coarse[COMPARED]) / 3.0


def errors(run: xr.Dataset, truth: xr.Dataset, start: float) -> list[float]:
    """Return the five errors of a run."""
    own, tension = (result["guy_tension"].sel(time=slice(start, None)) for result in (run, truth))
    top, expected = (
        result["displacement"].isel(level=-1).sel(time=slice(start, None)).drop_vars("level") for result in (run, truth)
    )
    spread = np.sqrt(float(expected.var("time").sum()))
    return [
        float((np.sqrt(((own - tension) ** 2).mean("time")) / tension.std("time")).median()),
        *(
            float(abs(run[f"guy_tension_{name}"] / truth[f"guy_tension_{name}"] - 1.0).max())
            for name in ("std", "maximum")
        ),
        float(abs(cp.fatigue.equivalent(own) / cp.fatigue.equivalent(tension) - 1.0).max()),
        np.sqrt(float(((top - expected) ** 2).sum("coordinate").mean("time"))) / spread,
    ]


def iced(scene: xr.Dataset, thickness: float) -> xr.Dataset:
    """Return a scene with ice of a thickness [m] on guys and mast."""
    return cp.ensemble.design(scene, {"ice.thickness": [thickness]}, members=1, sampling="list").isel(
        member=0, drop=True
    )


def draw(results: dict[str, list[list[float]]]) -> Figure:
    """Draw four errors over the time of a call, one marker for each kind of guys."""
    kinds = {"chain": ("s", "#555555"), "condensed": ("o", "#0072B2"), "static": ("^", "#D55E00")}
    figure, places = plt.subplots(1, 4, figsize=(12.0, 3.4), sharex=True, sharey=True, layout="constrained")
    for k, ax in enumerate(places):
        for kind, (marker, colour) in kinds.items():
            names = [name for name in results if name.startswith(kind)]
            seconds = [statistics.median(one[6] for one in results[name]) for name in names]
            error = [100.0 * statistics.mean(one[k] for one in results[name]) for name in names]
            ax.loglog(seconds, error, marker, color=colour, label=kind)
            for name, x, y in zip(names, seconds, error, strict=True):
                text = (
                    name.removeprefix(kind).strip(", ").removesuffix(" links").removesuffix(" ms").replace("r = ", "")
                )
                ax.annotate(
                    text.split(",")[0].replace("catenaries", ""), (x, y), (4, 4), textcoords="offset points", fontsize=8
                )
        ax.set(title=COLUMNS[k], xlabel="time of a call [s]")
        ax.margins(x=0.15)
        ax.grid(alpha=0.3)
    places[0].set_ylabel("error [%]")
    places[0].legend(title="guys", fontsize=8)
    return figure


def main() -> None:
    """Run all cases and write the table."""
    parser = command_line(__doc__, readme=True, quick="60 s of one wind")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3], help="seeds of the winds")
    parser.add_argument("--direction", type=float, default=0.0, help="degrees by which the wind is turned")
    parser.add_argument("--ice", type=float, default=0.0, help="radial thickness of ice on guys and mast [m]")
    parser.add_argument("--scene", default="mast120", help="a shipped scene, or a file")
    options = parser.parse_args()
    base = cp.read_scene(examples.scene_path(options.scene))
    if options.ice:
        base = iced(base, options.ice)
    duration, start = (90.0, 30.0) if options.quick else (660.0, 60.0)
    seeds = options.seeds[:1] if options.quick else options.seeds
    times = 0.1 * np.arange(round(duration / 0.1) + 1)
    angle = np.deg2rad(options.direction)
    timed = Timed()
    results: dict[str, list[list[float]]] = {}
    for seed in seeds:
        scene = base.copy(deep=True)
        scene["wind_turbulence_seed"].values[...] = seed
        scene["wind_direction"].values[:] = [np.cos(angle), 0.0, np.sin(angle)]

        def simulate(scene: xr.Dataset = scene, **case: Any) -> tuple[xr.Dataset, list[float]]:
            begin = time.process_time()
            run = cp.mast.simulate(scene, times=times, window=(start, duration), **case)
            return run, [timed.last, time.process_time() - begin]

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cp.OutOfRangeWarning)
            simulate(guys="chain", links=LINKS[-1])  # compiles, and makes the turbulence
            chains, costs = {}, {}
            for links in LINKS:
                chains[links], costs[links] = simulate(guys="chain", links=links)
                print(seed, links, np.round(costs[links], 3), flush=True)
            truth = extrapolated(chains[LINKS[0]], chains[LINKS[1]])
            for links, run in chains.items():
                results.setdefault(f"chain, {links} links", []).append(errors(run, truth, start) + costs[links])
            for fine, coarse in itertools.pairwise(LINKS[1:4]):
                found = errors(extrapolated(chains[fine], chains[coarse]), truth, start)
                results.setdefault(f"extrapolated, {fine} and {coarse} links", []).append([*found, np.nan, np.nan])
            for name, case in CASES:
                if not results.get(name):
                    simulate(**case)  # compiles
                run, seconds = simulate(**case)
                results.setdefault(name, []).append(errors(run, truth, start) + seconds)
        for name, found in results.items():
            print(seed, name, np.round(found[-1], 5), flush=True)
        finest = chains[LINKS[0]]
        least = min(float(finest["guy_tension"].min()), finest.attrs["smallest_tension"])
        print(f"seed {seed}: least tension of the finest chain {least:.4g} N", flush=True)
    rows = []
    for name, found in results.items():
        columns = list(zip(*found, strict=True))
        means = [f"{short(100.0 * statistics.mean(column))} %" for column in columns[:5]]
        times_spent = [statistics.median(column) for column in columns[5:]]
        rows.append([name, *means, *("" if np.isnan(one) else f"{one:.3g}" for one in times_spent)])
    table = markdown_table(["guys", *COLUMNS], rows)
    name = "turned" if options.direction else "iced" if options.ice else "storm"
    show_table(name, table, HERE if options.readme else None)
    if options.readme and name == "storm":
        draw(results).savefig(HERE / "mast.png", dpi=75)


if __name__ == "__main__":
    main()
