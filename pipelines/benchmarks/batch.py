"""Time many scenes in one call: 10 000 condensed models, and full chains.

    python pipelines/benchmarks/batch.py [--cases 10000] [--chains 64] [--repeats 5] [--readme]

Condensed: the cable of Example 3 under tensions of 8 to 16 kN, its end moved by 0.01 to 0.1 m at 0.05 to 1 rad/s, 600 s each,
modes from the chain of Example 3 alone, order "leading"; outputs are the extremes and, every half second, the tension of the top
link.  A tenth of the cases with r = 4 and 8 too, and with positions, error estimates and steps of their own over the duration of
Example 3, in one call, each alone, and into files by `ensemble.run`.  Difference of some members from runs of their scenes alone.
Two errors of some of the cases, of the tension's deviation from its start over the maximum deviation: that of the step, against a
fifth of it, and that of the model, against the chain itself (n = 40, tolerance 1e-4).  Memory: the peak of a new process that
only does this.

Chains: Example 2 (n = 40, 125 s, step 2.5e-4 s) under different tensions; implicit ones are the members of Example 3 over 124 s.

Times are processor times of one thread, medians over the repeats, after compilation; BLAS on one thread.
"""

from __future__ import annotations

import multiprocessing
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, in_turns, markdown_table, show_table
from threadpoolctl import threadpool_limits

import cablepod as cp
from cablepod.batch import _members as members
from cablepod.examples import scene

HERE = Path(__file__).parent
STEP = 0.05
#: Steps that are stable for more modes [s].
FINER = {4: 0.025, 8: 0.0125}
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


def processor_times(jobs: list[Callable[[], Any]], repeats: int) -> list[float]:
    """Return the median processor time of each job in one thread [s], after a call of each."""

    def seconds(job: Callable[[], Any]) -> float:
        begin = time.process_time()
        job()
        return time.process_time() - begin

    with members.thread_limit(1):
        for job in jobs:
            job()
        return [statistics.median(found) for found in in_turns([partial(seconds, job) for job in jobs], repeats)]


def condensed(cases: int, repeats: int) -> list[list[str]]:
    """Measure batches of condensed models with a given step; return rows of the table."""
    # first, because a process begins with the peak of the one that starts it
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        before, peak = pool.submit(peak_memory, cases).result()
    scenes, modes, options = setting(cases)
    fewer = scenes.isel(member=slice(0, max(cases // 10, 1)))
    rows = []
    for some, rank, step in ((scenes, 3, STEP), *((fewer, rank, step) for rank, step in FINER.items())):
        run = partial(
            cp.condensed.simulate, some, modes if rank == 3 else more_modes(), **options | {"rank": rank, "step": step}
        )
        (took,) = processor_times([run], repeats)
        count = some.sizes["member"]
        each = 1e9 * took / (count * (TIMES[-1] / step + 1.0))
        memory = f"; {peak:.2f} GB at most, {before:.2f} GB before the run" if rank == 3 else ""
        case = f"{count} condensed cases of 600 s (r = {rank}, steps of {step:g} s)"
        rows.append([case, f"{1e3 * took / count:.2f} ms, {each:.0f} ns a step{memory}"])
    return rows


def more_modes() -> xr.Dataset:
    """Return eight modes of the chain of Example 3."""
    return cp.pod.decompose(cp.chain.simulate(scene("example3")), layout="normal", rank=8)


def print_errors(cases: int) -> None:
    """Print how members differ from runs of their scenes alone, and errors of step and model."""
    scenes, modes, options = setting(cases)

    def run(some: xr.Dataset, step: float = STEP) -> xr.Dataset:
        return cp.condensed.simulate(some, modes, **options | {"step": step})

    result, largest = run(scenes), 0.0
    for i in range(0, min(cases, 200), 10):
        alone, member = run(scenes.isel(member=i)), result.isel(member=i)
        for name in ("amplitude", "tension"):
            motion = float(abs(alone[name] - alone[name][0]).max())
            largest = max(largest, float(abs(member[name] - alone[name]).max()) / motion)
    print(f"largest difference from runs of the scenes alone, over the motion: {largest:.1g}")
    some = scenes.isel(member=slice(0, 20))
    fine = run(some, STEP / 5)
    chain = cp.chain.simulate(some, times=TIMES, outputs=("tension", "tension_extremes"), tolerance=1e-4)
    own = [item.tension.isel(link=-1).values for item in (result.isel(member=slice(0, 20)), fine, chain)]
    for name, truth in (("step", own[1]), ("model", own[2])):
        errors = [deviation(tension, other) for tension, other in zip(own[0], truth, strict=True)]
        print(
            f"error of the {name}, of the tension of the top link: median {np.median(errors):.2g}, largest {max(errors):.2g}"
        )
    tops = (item.tension_maximum.isel(member=slice(0, 20), link=-1).values for item in (result, chain))
    ratio = np.abs(np.divide(*tops) - 1.0)
    print(f"largest tension against that of the chain: median {np.median(ratio):.2g}, largest {ratio.max():.2g}")


def alone(simulate: Callable[..., xr.Dataset], scenes: xr.Dataset) -> Callable[[], None]:
    """Return a job that runs the members of a scene one after the other."""
    each = [scenes.isel(member=i, drop=True) for i in range(scenes.sizes["member"])]

    def job() -> None:
        for one in each:
            simulate(one)

    return job


def own_steps(number: int, repeats: int) -> list[list[str]]:
    """Measure condensed members that choose their steps, also into files; return rows of the table."""
    scenes, modes, _ = setting(number)
    few = scenes.isel(member=slice(0, max(number // 10, 1)))
    with tempfile.TemporaryDirectory() as folder:
        calls = iter(range(2 * repeats + 2))
        jobs: list[Callable[[], Any]] = [
            partial(cp.condensed.simulate, scenes, modes),
            alone(lambda one: cp.condensed.simulate(one, modes), few),
            lambda: cp.ensemble.run(scenes, f"{folder}/{next(calls)}", model="condensed", modes=modes),
        ]
        together, one_by_one, files = processor_times(jobs, repeats)
    each = [
        1e3 * took / count
        for took, count in zip((together, one_by_one, files), (number, few.sizes["member"], number), strict=True)
    ]
    case = f"{number} condensed members, positions and error estimates, steps of their own"
    return [[case, f"{each[0]:.2f} ms; alone {each[1]:.2f} ms; by `ensemble.run` into files {each[2]:.2f} ms"]]


#: Scheme and step [s], or tolerance, of chains.
CHAINS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("velocity_verlet", {"step": 2.5e-4}),
    ("trapezoidal", {"step": 0.1}),
    ("trapezoidal", {"step": 0.02}),
    ("generalized_alpha", {"step": 0.02}),
    ("energy_momentum", {"step": 0.02}),
    ("trapezoidal", {"tolerance": 1e-3, "outputs": ("position",)}),
)


def chains(number: int, repeats: int) -> list[list[str]]:
    """Measure members that are chains of 40 links, together and one after the other; return rows of the table."""
    rows, implicit = [], setting(number)[0]
    explicit = varied(scene("example2"), number, {"cable_top_tension": (9e3, 16e3)})
    for scheme, accuracy in CHAINS:
        scenes = explicit if scheme == "velocity_verlet" else implicit
        simulate = partial(cp.chain.simulate, scheme=scheme, **{"links": 40} if scenes is implicit else {}, **accuracy)
        together, one_by_one = processor_times([partial(simulate, scenes), alone(simulate, scenes)], repeats)
        text = ", ".join(f"{name} {value:g}" for name, value in accuracy.items() if name != "outputs")
        rows.append(
            [
                f"{number} chains, {scheme}, {text}",
                f"{1e3 * together / number:.1f} ms; alone {1e3 * one_by_one / number:.1f} ms",
            ]
        )
    return rows


def main() -> None:
    """Measure all."""
    parser = command_line(__doc__, repeats=5, readme=True)
    parser.add_argument("--cases", type=int, default=10_000, help="number of condensed models")
    parser.add_argument("--chains", type=int, default=64, help="number of full chains")
    asked = parser.parse_args()
    with threadpool_limits(1):
        rows = condensed(asked.cases, asked.repeats)
        rows += own_steps(max(asked.cases // 10, 1), asked.repeats)
        rows += chains(asked.chains, asked.repeats)
        show_table("batch", markdown_table(["case", "processor time, a member"], rows), HERE if asked.readme else None)
        print_errors(min(asked.cases, 200))


if __name__ == "__main__":
    main()
