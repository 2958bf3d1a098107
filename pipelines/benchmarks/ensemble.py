"""What an ensemble costs beside its kernel, what two processes give, and how long a large one takes to open.

    python pipelines/benchmarks/ensemble.py [--members 2000] [--open 10000] [--folder DIR] [--skip-processes]

Members are Example 2 (n = 40, 125 s, step 2.5e-4 s) under top tensions of 9 to 16 kN, in batches of 64.

Overhead: processor time of `ensemble.run` in one thread over what the same run spends inside the compiled loop of the chain,
and the same of `chain.simulate` on the same members in the same batches, whose results are dropped.  What the first is more than
the second is scheduling, writing and provenance, the rest the preparation of each member.  Wall time is told too.

Two processes: the same members on a cluster of one process and of two, over each other; and beside it the control, two processes
that only count over one, before and after: what the machine has to offer.

Opening: an ensemble of a small chain and few instants, but with 157 files for 10 000 members, opened three times.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import cablepod as cp
from cablepod import members
from cablepod.kernels import chain as kernel
from cablepod.shipped import scene

STEP = 2.5e-4


def study(number: int) -> xr.Dataset:
    """Make members of Example 2."""
    return cp.ensemble.design(scene("example2"), {"cable.top_tension": [9e3, 16e3]}, members=number, seed=2011)


def count(_: int = 0) -> int:
    """Do nothing but count, for about a second."""
    total = 0
    for i in range(20_000_000):
        total += i
    return total


def offered() -> float:
    """Tell how many times as much two processes do as one."""

    def median(call: Callable[[], Any]) -> float:
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            call()
            times.append(time.perf_counter() - begin)
        return statistics.median(times)

    with ProcessPoolExecutor(2) as pool:
        list(pool.map(count, range(2)))
        one = median(lambda: pool.submit(count).result())
        return 2.0 * one / median(lambda: list(pool.map(count, range(2))))


def overhead(scenes: xr.Dataset, folder: Path) -> None:
    """Measure a run in one thread against the time inside its kernel."""
    inside = [0.0]
    plain = kernel.verlet

    def watched(*arguments: Any) -> Any:
        begin = time.thread_time()
        result = plain(*arguments)
        inside[0] += time.thread_time() - begin
        return result

    cp.ensemble.run(scenes.isel(member=slice(0, 2)), folder / "first", step=STEP, workers=1)  # compiles
    kernel.verlet = watched
    try:
        begin = time.process_time()
        with members.threads(1):
            for first in range(0, scenes.sizes["member"], 64):
                cp.chain.simulate(scenes.isel(member=slice(first, first + 64)), step=STEP)
        bare, loop = time.process_time() - begin, inside[0]
        inside[0] = 0.0
        wall, begin = time.perf_counter(), time.process_time()
        cp.ensemble.run(scenes, folder / "one", step=STEP, workers=1)
        wall, busy = time.perf_counter() - wall, time.process_time() - begin
    finally:
        kernel.verlet = plain
    size = sum(path.stat().st_size for path in (folder / "one").iterdir()) / 1e6
    print(f"{scenes.sizes['member']} members in one thread, {size:.0f} MB: {wall:.2f} s, of them busy {busy:.2f} s")
    alone, whole = bare / loop - 1.0, busy / inside[0] - 1.0
    print(f"  compiled loop {inside[0]:.2f} s; beside it {whole:.1%}, of which chain.simulate has {alone:.1%}")
    print(f"  scheduling, writing and provenance: {whole - alone:.1%} of the compiled loop")


def processes(scenes: xr.Dataset, folder: Path) -> None:
    """Measure two processes against one, and what the machine gives to two that count."""
    from distributed import Client, LocalCluster

    before = offered()
    taken = {}
    for workers in (1, 2):
        with (
            LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster, set_as_default=False) as client,
        ):
            cp.ensemble.run(
                scenes.isel(member=slice(0, 2 * workers)),
                folder / f"warm{workers}",
                step=STEP,
                scheduler=client,
                batch=1,
            )
            begin = time.perf_counter()
            cp.ensemble.run(scenes, folder / f"processes{workers}", step=STEP, scheduler=client)
            taken[workers] = time.perf_counter() - begin
    after = offered()
    print(f"one process {taken[1]:.2f} s, two {taken[2]:.2f} s: {taken[1] / taken[2]:.2f} times as fast")
    print(f"  two processes that count do {before:.2f} (before) and {after:.2f} (after) times as much as one")


def opening(number: int, folder: Path) -> None:
    """Measure how long a large ensemble takes to open."""
    small = scene("example2").assign(chain_links=4)
    scenes = cp.ensemble.design(small, {"cable.top_tension": [9e3, 16e3]}, members=number)
    cp.ensemble.run(scenes, folder / "large", step=2e-3, times=np.linspace(0.0, 0.1, 3))
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        whole = cp.archive.open_ensemble(folder / "large")
        times.append(time.perf_counter() - begin)
    files = len(list((folder / "large").glob("batch_*.nc")))
    print(f"{whole.sizes['member']} members in {files} files open in {', '.join(f'{item:.2f}' for item in times)} s")


def main() -> None:
    """Measure all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--members", type=int, default=2000)
    parser.add_argument("--open", type=int, default=10_000)
    parser.add_argument("--folder", type=Path, help="where to write (default: a temporary folder)")
    parser.add_argument("--skip-processes", action="store_true")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=asked.folder) as name:
        folder, scenes = Path(name), study(asked.members)
        overhead(scenes, folder)
        if not asked.skip_processes:
            processes(scenes, folder)
        opening(asked.open, folder)


if __name__ == "__main__":
    main()
