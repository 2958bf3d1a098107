"""Time a step with drag beside one in still air, of the explicit chain and of the condensed model.

    python pipelines/benchmarks/drag.py [--repeats 60] [--processes 9] [--readme]

A guy of 100 m, in the plane and in space, with mass damping.  The wind is steady: the drag is evaluated as in gusts, and no time
goes into making them.  The time of a chain's step is that inside its compiled loop, of the condensed model the difference of two
whole calls, one three times as long, so that work done once cancels.  CPU time of one thread, all calls in turns, with arrays at
other places in memory in each, on which a tenth of the time depends: lower quartiles.  It depends likewise on the place of the
compiled loop, which differs between processes: medians over some of them, and the range.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, in_turns, markdown_table, show_table, time_inside

os.environ.update(ONE_THREAD)

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
import xarray as xr

import cablepod as cp

HERE = Path(__file__).resolve().parent
HEAD = ("model", "step [ms]", "still air [ns a step]", "wind [ns a step]", "ratio", "in one process")
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


#: The compiled loop of explicit steps.
LOOP = "cablepod.chain._kernels_explicit.verlet"
RANDOM = np.random.default_rng(1)


def seconds(run: Callable[[int], object], steps: int, *, loop: bool) -> float:
    """Return the CPU time of a call, or of the compiled loop in it [s]."""
    taken = [np.empty(size) for size in RANDOM.integers(8, 20_000, 4)]
    del taken[::2]  # other places for the arrays of this call
    with time_inside(LOOP, clock=time.thread_time) as inside:
        begin = time.process_time()
        run(steps)
        return inside.seconds if loop else time.process_time() - begin


def measure(repeats: int) -> list[tuple[str, float, float, float]]:
    """Return model, step [s], and time of a step in still air and in wind [ns], for each case."""
    cases: list[tuple[str, float, int, list[Callable[[int], object]]]] = []
    for dims, name in ((2, "in the plane"), (3, "in space")):
        for links, step in ((20, 1e-3), (40, 5e-4), (160, 1.25e-4)):
            runs = [chain(dims, links, step, windy=windy) for windy in (False, True)]
            cases.append((f"chain of {links} links, {name}", step, 800_000 // links, runs))
        for step in (0.01, 0.02, 0.05):  # the first is the default in this wind
            runs = [condensed(dims, step, windy=windy) for windy in (False, True)]
            cases.append((f"condensed, r = {RANK}, {name}", step, 10_000, runs))
    measured = []
    for name, step, steps, runs in cases:
        loop = name.startswith("chain")
        lengths = (steps,) if loop else (steps, 3 * steps)
        jobs = [partial(seconds, run, count, loop=loop) for run in runs for count in lengths]
        in_turns(jobs, 1)
        times = np.quantile(in_turns(jobs, repeats), 0.25, axis=1).reshape(2, -1)
        still, windy = 1e9 * (times[:, 0] if loop else times[:, 1] - times[:, 0]) / (steps if loop else 2 * steps)
        measured.append((name, step, float(still), float(windy)))
    return measured


def main() -> None:
    """Print the table."""
    parser = command_line(__doc__, repeats=60, readme=True)
    parser.add_argument("--processes", type=int, default=9)
    options = parser.parse_args()
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        processes = list(pool.map(measure, [options.repeats] * options.processes))
    rows = []
    for case in zip(*processes, strict=True):
        name, step = case[0][:2]
        still, windy = np.array([row[2:] for row in case]).T
        low, ratio, high = np.quantile(windy / still, (0.0, 0.5, 1.0))
        row = [name, f"{1e3 * step:.3g}", f"{np.median(still):.3g}", f"{np.median(windy):.3g}"]
        rows.append([*row, f"{ratio:.2f}", f"{low:.2f} to {high:.2f}"])
    show_table("drag", markdown_table(HEAD, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
