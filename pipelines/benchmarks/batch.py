"""Many scenes in one call: condensed models of 10 000 cases, and full chains of equal shape.

    python pipelines/benchmarks/batches.py [--cases 10000] [--chains 64] [--repeats 5]

Condensed: the cable of Example 3 under tensions of 8 to 16 kN, its end moved by 0.01 to 0.1 m at 0.05 to 1 rad/s, 600 s each,
modes from the chain of Example 3 alone, r = 3, order "leading"; kept are the extremes and, every half second, the tension of the
top link.  Two errors are taken on some of the cases, of the tension's deviation from its start over the largest such deviation:
of the step, against a fifth of it, and of the model, against the chain itself (n = 40, tolerance 1e-4).  Memory: the largest of
the process.

Chains: Example 2 (n = 40, 125 s, step 2.5e-4 s) under different tensions, one call with `member`, in two threads and in one, and
against the time inside the compiled loop alone.

Times are medians over the repeats, after compilation; BLAS on one thread.  The first line tells what two processes that only
count do over one: what the machine has to offer.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

import cablepod as cp
from cablepod import members
from cablepod.kernels import chain as kernel
from cablepod.shipped import scene

STEP = 0.05
TIMES = np.arange(0.0, 600.1, 0.5)


def varied(base: xr.Dataset, count: int, ranges: dict[str, tuple[float, float]]) -> xr.Dataset:
    """Make members of a scene that lie anywhere in the ranges of its parameters."""
    draw = np.random.default_rng(2011)
    return base.assign(
        {name: ("member", draw.uniform(*ends, count), base[name].attrs) for name, ends in ranges.items()}
    )


def median(call: Callable[[], Any], repeats: int) -> float:
    """Median wall time of a call [s]."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def count(_: int = 0) -> int:
    """Do nothing but count, for some tenths of a second."""
    total = 0
    for i in range(10_000_000):
        total += i
    return total


def offered() -> float:
    """Tell how many times as much two processes do as one."""
    with ProcessPoolExecutor(2) as pool:
        list(pool.map(count, range(2)))
        one = median(lambda: pool.submit(count).result(), 3)
        two = median(lambda: list(pool.map(count, range(2))), 3)
    return 2.0 * one / two


def deviation(tension: np.ndarray, truth: np.ndarray) -> float:
    """Largest difference of two series (time,) over the largest change of the second."""
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
        with members.threads(threads):
            took = median(lambda: run(scenes), repeats)
        print(f"condensed, {cases} cases of 600 s, step {STEP} s, {threads} threads: {took:.2f} s")
    print(
        f"  output {result.nbytes / 1e9:.2f} GB, largest memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB"
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
    inside = [0.0]
    plain = kernel.verlet

    def watched(*arguments: Any) -> Any:
        begin = time.thread_time()
        result = plain(*arguments)
        inside[0] += time.thread_time() - begin
        return result

    def run() -> xr.Dataset:
        return cp.chain.simulate(scenes, step=2.5e-4)

    run()
    for threads in (2, 1):
        with members.threads(threads):
            took = median(run, repeats)
        print(f"chains, {number} of 125 s, n = 40, step 2.5e-4 s, {threads} threads: {took:.2f} s")
    kernel.verlet = watched
    with members.threads(1):
        run()
    kernel.verlet = plain
    print(
        f"  in one thread, inside the compiled loop {inside[0]:.2f} s; the call took {took / inside[0]:.3f} times as long"
    )


def main() -> None:
    """Measure both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--chains", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=5)
    asked = parser.parse_args()
    with threadpool_limits(1):
        print(f"two processes do {offered():.2f} times as much as one")
        condensed(asked.cases, asked.repeats)
        chains(asked.chains, asked.repeats)


if __name__ == "__main__":
    main()
