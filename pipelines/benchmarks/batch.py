"""Time many scenes in one call: 10 000 condensed models, and full chains.

    python pipelines/benchmarks/batch.py [--cases 10000] [--chains 64] [--repeats 5]

Condensed: the cable of Example 3 under tensions of 8 to 16 kN, its end moved by 0.01 to 0.1 m at 0.05 to 1 rad/s, 600 s each,
modes from the chain of Example 3 alone, r = 3, order "leading"; outputs are the extremes and, every half second, the tension of
the top link.  Two errors of some of the cases, of the tension's deviation from its start over the maximum deviation: that of the
step, against a fifth of it, and that of the model, against the chain itself (n = 40, tolerance 1e-4).  Memory: the peak of the
process.

Chains: Example 2 (n = 40, 125 s, step 2.5e-4 s) under different tensions, one call with `member`, in two threads and in one, and
against the time inside the compiled loop alone.

Times are medians over the repeats, after compilation; BLAS on one thread.  The first line gives the work of two processes that
only count over that of one, the limit of the machine.
"""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, median_time, time_inside, two_process_gain
from threadpoolctl import threadpool_limits

import cablepod as cp
from cablepod.batch import _members as members
from cablepod.examples import scene

STEP = 0.05
TIMES = np.arange(0.0, 600.1, 0.5)


def varied(base: xr.Dataset, count: int, ranges: dict[str, tuple[float, float]]) -> xr.Dataset:
    """Draw members of a scene uniformly from ranges of its parameters."""
    draw = np.random.default_rng(2011)
    return base.assign(
        {name: ("member", draw.uniform(*ends, count), base[name].attrs) for name, ends in ranges.items()}
    )


def deviation(tension: np.ndarray, truth: np.ndarray) -> float:
    """Return the maximum difference of two series (time,) over the maximum change of the second."""
    return float(np.abs(tension - truth).max() / np.abs(truth - truth[0]).max())


def condensed(cases: int, repeats: int) -> None:
    """Measure a batch of condensed models."""
    base = scene("example3")
    modes = cp.pod.decompose(cp.chain.simulate(base), layout="normal", rank=3)
    ranges = {
        "cable_top_tension": (8e3, 16e3),
        "motion_upper_x_amplitude": (0.01, 0.1),
        "motion_upper_x_angular_frequency": (0.05, 1.0),
    }
    scenes = varied(base, cases, ranges)
    top = int(base["chain_links"])
    options: dict[str, Any] = {"rank": 3, "times": TIMES, "outputs": ("tension", "tension_extremes"), "links": [top]}

    def run(some: xr.Dataset, step: float = STEP) -> xr.Dataset:
        return cp.condensed.simulate(some, modes, step=step, **options)

    run(scenes.isel(member=slice(0, 64)))
    result = run(scenes)
    for threads in (2, 1):
        with members.thread_limit(threads):
            took = median_time(lambda: run(scenes), repeats)
        print(f"condensed, {cases} cases of 600 s, step {STEP} s, {threads} threads: {took:.2f} s")
    print(
        f"  output {result.nbytes / 1e9:.2f} GB, peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB"
    )
    some = scenes.isel(member=slice(0, 20))
    fine = run(some, STEP / 5)
    chain = cp.chain.simulate(some, times=TIMES, outputs=("tension", "tension_extremes"), tolerance=1e-4)
    own = [item.tension.isel(link=-1).values for item in (result.isel(member=slice(0, 20)), fine, chain)]
    for name, truth in (("step", own[1]), ("model", own[2])):
        errors = [deviation(tension, other) for tension, other in zip(own[0], truth, strict=True)]
        print(
            f"  error of the {name}, of the tension of the top link: median {np.median(errors):.2g}, largest {max(errors):.2g}"
        )
    peak = (
        result.tension_maximum.isel(member=slice(0, 20), link=-1) / chain.tension_maximum.isel(link=-1) - 1.0
    ).values
    print(
        f"  largest tension against that of the chain: median {np.median(np.abs(peak)):.2g}, largest {np.abs(peak).max():.2g}"
    )


def chains(number: int, repeats: int) -> None:
    """Measure members that are full chains."""
    base = scene("example2")
    scenes = varied(base, number, {"cable_top_tension": (9e3, 16e3)})

    def run() -> xr.Dataset:
        return cp.chain.simulate(scenes, step=2.5e-4)

    run()
    for threads in (2, 1):
        with members.thread_limit(threads):
            took = median_time(run, repeats)
        print(f"chains, {number} of 125 s, n = 40, step 2.5e-4 s, {threads} threads: {took:.2f} s")
    with (
        members.thread_limit(1),
        time_inside("cablepod.chain._kernels_explicit.verlet", clock=time.thread_time) as loop,
    ):
        run()
    print(
        f"  in one thread, inside the compiled loop {loop.seconds:.2f} s; the call took {took / loop.seconds:.3f} times as long"
    )


def main() -> None:
    """Measure both."""
    parser = command_line(__doc__, repeats=5)
    parser.add_argument("--cases", type=int, default=10_000, help="number of condensed models")
    parser.add_argument("--chains", type=int, default=64, help="number of full chains")
    asked = parser.parse_args()
    with threadpool_limits(1):
        print(f"two processes do {two_process_gain(10_000_000):.2f} times as much as one")
        condensed(asked.cases, asked.repeats)
        chains(asked.chains, asked.repeats)


if __name__ == "__main__":
    main()
