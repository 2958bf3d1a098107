"""Time many scenes in one call: 10 000 condensed models, and full chains.

    python pipelines/benchmarks/batch.py [--cases 10000] [--chains 64] [--repeats 5]

Condensed: the cable of Example 3 under tensions of 8 to 16 kN, its end moved by 0.01 to 0.1 m at 0.05 to 1 rad/s, 600 s each,
modes from the chain of Example 3 alone, r = 3, order "leading"; outputs are the extremes and, every half second, the tension of
the top link.  Wall time, and processor time per member and step (mean).  Difference of some members from runs of their scenes
alone.  Two errors of some of the cases, of the tension's deviation from its start over the maximum deviation: that of the step,
against a fifth of it, and that of the model, against the chain itself (n = 40, tolerance 1e-4).  Memory: the peak of a new
process that only does this.

Ensemble: 2000 members of the same scenes over 125 s with positions, one call with `member` and `ensemble.run` into files.

Chains: Example 2 (n = 40, 125 s, step 2.5e-4 s) under different tensions, one call with `member`, in two threads and in one, and
against the time inside the compiled loop alone.

Implicit chains: members of Example 3 as above over 124 s in one call, and each scene alone, in one thread: processor time inside
the compiled loop, and of the whole call.

Times are medians over the repeats, after compilation; BLAS on one thread.  The first line gives the work of two processes that
only count over that of one, the limit of the machine.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
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


def setting(cases: int) -> tuple[xr.Dataset, xr.Dataset, dict[str, Any]]:
    """Return members of Example 3, modes from its chain, and options of the condensed model."""
    base = scene("example3")
    modes = cp.pod.decompose(cp.chain.simulate(base), layout="normal", rank=3)
    ranges = {
        "cable_top_tension": (8e3, 16e3),
        "motion_upper_x_amplitude": (0.01, 0.1),
        "motion_upper_x_angular_frequency": (0.05, 1.0),
    }
    top = int(base["chain_links"])
    options = {"rank": 3, "times": TIMES, "outputs": ("tension", "tension_extremes"), "links": [top], "step": STEP}
    return varied(base, cases, ranges), modes, options


def peak_memory(cases: int) -> tuple[float, float]:
    """Run the cases once; return the peak memory of this process before and after [GB]."""
    scenes, modes, options = setting(cases)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    cp.condensed.simulate(scenes, modes, **options)
    return 1.024e-6 * before, 1.024e-6 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def condensed(cases: int, repeats: int) -> None:
    """Measure a batch of condensed models."""
    # first, because a process begins with the peak of the one that starts it
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        before, peak = pool.submit(peak_memory, cases).result()
    scenes, modes, options = setting(cases)

    def run(some: xr.Dataset, step: float = STEP) -> xr.Dataset:
        return cp.condensed.simulate(some, modes, **options | {"step": step})

    run(scenes.isel(member=slice(0, 64)))
    for threads in (2, 1):
        with members.thread_limit(threads):
            begin = time.process_time()
            took = median_time(lambda: run(scenes), repeats)
            busy = (time.process_time() - begin) / repeats
        each = 1e9 * busy / (cases * (TIMES[-1] / STEP + 1.0))
        print(f"condensed, {cases} cases of 600 s, step {STEP} s, {threads} threads: {took:.2f} s")
        print(f"  processor time {busy:.2f} s, {each:.1f} ns per member and step")
    result = run(scenes)
    print(
        f"  output {result.nbytes / 1e9:.2f} GB, peak memory of a new process {peak:.2f} GB, {before:.2f} GB before the run"
    )
    largest = 0.0
    for i in range(0, min(cases, 200), 10):
        alone, member = run(scenes.isel(member=i)), result.isel(member=i)
        for name in ("amplitude", "tension"):
            motion = float(abs(alone[name] - alone[name][0]).max())
            largest = max(largest, float(abs(member[name] - alone[name]).max()) / motion)
    print(f"  largest difference from runs of the scenes alone, over the motion: {largest:.1g}")
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


def ensembles(number: int, repeats: int) -> None:
    """Measure an ensemble of condensed models with positions."""
    scenes, modes, _ = setting(number)
    options: dict[str, Any] = {"rank": 3, "step": STEP, "outputs": ("position",)}

    def run() -> xr.Dataset:
        return cp.condensed.simulate(scenes, modes, **options)

    run()
    print(f"condensed with positions, {number} of 125 s, one call: {median_time(run, repeats):.2f} s")
    with tempfile.TemporaryDirectory() as folder:
        count = iter(range(repeats))
        took = median_time(
            lambda: cp.ensemble.run(scenes, f"{folder}/{next(count)}", model="condensed", modes=modes, **options),
            repeats,
        )
    print(f"  ensemble.run, into files: {took:.2f} s")


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


#: Scheme and step [s], or tolerance, of implicit chains.
IMPLICIT: tuple[tuple[str, dict[str, Any]], ...] = (
    ("trapezoidal", {"step": 0.1}),
    ("trapezoidal", {"step": 0.02}),
    ("generalized_alpha", {"step": 0.02}),
    ("energy_momentum", {"step": 0.02}),
    ("trapezoidal", {"tolerance": 1e-3, "outputs": ("position",)}),
    ("trapezoidal", {"tolerance": 1e-4, "outputs": ("position",)}),
)


def implicit_chains(number: int, repeats: int) -> None:
    """Measure members that are implicit chains, in lanes and one after the other, in one thread."""
    ranges = {
        "cable_top_tension": (8e3, 16e3),
        "motion_upper_x_amplitude": (0.01, 0.1),
        "motion_upper_x_angular_frequency": (0.05, 1.0),
    }
    scenes = varied(scene("example3"), number, ranges)
    each = [scenes.isel(member=i, drop=True) for i in range(number)]
    names = ("cablepod.chain._kernels_implicit.implicit",)
    for scheme, accuracy in IMPLICIT:
        options: dict[str, Any] = {"scheme": scheme, "links": 40, **accuracy}
        ways = {
            "together": lambda options=options: [cp.chain.simulate(scenes, **options)],
            "alone": lambda options=options: [cp.chain.simulate(one, **options) for one in each],
        }
        times: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
        with members.thread_limit(1):
            for run in ways.values():
                run()
            for _ in range(repeats):
                for name, run in ways.items():  # in turn, so that both see the same machine
                    with time_inside(*names, clock=time.thread_time) as loop:
                        begin = time.process_time()
                        run()
                        times[name].append((loop.seconds, time.process_time() - begin))
        own, single = (np.median(times[name], axis=0) / number * 1e3 for name in ways)
        print(
            f"implicit chains, {number} of Example 3, n = 40, {scheme}, {accuracy}, one thread, ms for each member: "
            f"loop {own[0]:.2f}, call {own[1]:.2f}; alone: loop {single[0]:.2f}, call {single[1]:.2f}; "
            f"ratios {single[0] / own[0]:.2f}, {single[1] / own[1]:.2f}"
        )


def main() -> None:
    """Measure all."""
    parser = command_line(__doc__, repeats=5)
    parser.add_argument("--cases", type=int, default=10_000, help="number of condensed models")
    parser.add_argument("--chains", type=int, default=64, help="number of full chains")
    asked = parser.parse_args()
    with threadpool_limits(1):
        print(f"two processes do {two_process_gain(10_000_000):.2f} times as much as one")
        condensed(asked.cases, asked.repeats)
        ensembles(max(asked.cases // 5, 1), asked.repeats)
        chains(asked.chains, asked.repeats)
        implicit_chains(asked.chains, asked.repeats)


if __name__ == "__main__":
    main()
