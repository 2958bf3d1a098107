"""Time a step with drag beside one in still air, of the explicit chain and of the condensed model.

    python pipelines/benchmarks/drag.py [--repeats 15] [--readme]

A guy of 100 m, in the plane and in space, with mass damping.  The wind is steady: the drag is evaluated as in gusts, and no time
goes into making them.  Time per step is the difference of two whole calls, one three times as long, so that work done once
cancels.  CPU time of one thread, all calls in turns; the ratio is that of the least times.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, in_turns, markdown_table, show_table

os.environ.update(ONE_THREAD)

from collections.abc import Callable
from functools import partial

import numpy as np
import xarray as xr

import cablepod as cp

HERE = Path(__file__).resolve().parent
HEAD = ("model", "step [ms]", "still air [ns a step]", "wind [ns a step]", "ratio")
RANK = 4


def scene(dims: int, links: int, *, windy: bool) -> xr.Dataset:
    """Return the guy in still air or in the wind."""
    tables = {
        "cable": {
            "youngs_modulus": 1.6e11,
            "area": 1.25e-4,
            "density": 8000.0,
            "top_tension": 15000.0,
            "diameter": 0.016,
        },
        "ends": {"lower": [0.0, 0.0, 0.0][:dims], "upper": [60.0, 80.0, 0.0][:dims]},
        "damping": {"mass_proportional": 0.02},
        "chain": {"links": links},
    }
    wind = {"wind": {"speed": 25.0, "direction": [1.0, 0.0] if dims == 2 else [0.6, 0.0, 0.8]}}
    return cp.make_scene({**tables, **(wind if windy else {})})


def chain(dims: int, links: int, step: float, *, windy: bool) -> Callable[[int], object]:
    """Return a function that takes explicit steps of a chain."""
    given = scene(dims, links, windy=windy)
    return lambda steps: cp.chain.simulate(given, step=step, times=[0.0, steps * step], outputs=("position",))


def condensed(dims: int, step: float, *, windy: bool) -> Callable[[int], object]:
    """Return a function that takes steps of the condensed model with the tension of one link."""
    given = scene(dims, 40, windy=windy)
    modes = cp.condensed.vibration_modes(scene(dims, 40, windy=False), rank=RANK)
    return lambda steps: cp.condensed.simulate(
        given, modes, step=step, scheme="velocity_verlet", times=[0.0, steps * step], outputs=("tension",), links=[40]
    )


def seconds(run: Callable[[int], object], steps: int) -> float:
    """Return the CPU time of a call [s]."""
    begin = time.process_time()
    run(steps)
    return time.process_time() - begin


def main() -> None:
    """Print the table."""
    options = command_line(__doc__, repeats=15, readme=True).parse_args()
    cases: list[tuple[str, float, int, list[Callable[[int], object]]]] = []
    for dims, name in ((2, "in the plane"), (3, "in space")):
        for links, step in ((20, 1e-3), (40, 5e-4), (160, 1.25e-4)):
            runs = [chain(dims, links, step, windy=windy) for windy in (False, True)]
            cases.append((f"chain of {links} links, {name}", step, 800_000 // links, runs))
        for step in (0.01, 0.02, 0.05):  # the first is the default in this wind
            runs = [condensed(dims, step, windy=windy) for windy in (False, True)]
            cases.append((f"condensed, r = {RANK}, {name}", step, 10_000, runs))
    rows = []
    for name, step, steps, runs in cases:
        jobs = [partial(seconds, run, count) for run in runs for count in (steps, 3 * steps)]
        in_turns(jobs, 1)
        short, long, windy_short, windy_long = np.min(in_turns(jobs, options.repeats), axis=1)
        still, windy = (1e9 * value / (2 * steps) for value in (long - short, windy_long - windy_short))
        rows.append([name, f"{1e3 * step:.3g}", f"{still:.3g}", f"{windy:.3g}", f"{windy / still:.2f}"])
    show_table("drag", markdown_table(HEAD, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
