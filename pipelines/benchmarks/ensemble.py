"""Measure overhead, scaling to two processes and opening time of an ensemble.

    python pipelines/benchmarks/ensemble.py [--members 2000] [--open 10000] [--folder DIR] [--skip-processes]

Members are Example 2 (n = 40, 125 s, step 2.5e-4 s) under top tensions of 9 to 16 kN, in batches of 64.

Overhead: processor time of `ensemble.run` in one thread over its time inside the compiled loop of the chain, and the same of
`chain.simulate` on the same members in the same batches, whose results are dropped.  The difference of the two is scheduling,
writing and provenance, the rest the preparation of each member.  Wall time is printed too.

Two processes: time of the same members on a cluster of one process over that on a cluster of two; and beside it the control, the
work of two processes that only count over that of one, before and after: the limit of the machine.

Opening: an ensemble of a small chain and few instants, but with 157 files for 10 000 members, opened three times.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, time_inside, timed, two_process_gain

import cablepod as cp
from cablepod.batch import _members as members
from cablepod.examples import scene

STEP = 2.5e-4
LOOP = "cablepod.chain._kernels_explicit.verlet"
#: Loops of the control, about a second.
COUNTED = 20_000_000


def study(number: int) -> xr.Dataset:
    """Draw members of Example 2."""
    return cp.ensemble.design(scene("example2"), {"cable.top_tension": [9e3, 16e3]}, members=number, seed=2011)


def overhead(scenes: xr.Dataset, folder: Path) -> None:
    """Measure a run in one thread against the time inside its kernel."""
    cp.ensemble.run(scenes.isel(member=slice(0, 2)), folder / "first", step=STEP, workers=1)  # compiles
    with time_inside(LOOP, clock=time.thread_time) as loop, members.thread_limit(1):
        begin = time.process_time()
        for first in range(0, scenes.sizes["member"], 64):
            cp.chain.simulate(scenes.isel(member=slice(first, first + 64)), step=STEP)
        alone = (time.process_time() - begin) / loop.seconds - 1.0
    with time_inside(LOOP, clock=time.thread_time) as loop:
        begin = time.process_time()
        _, wall = timed(lambda: cp.ensemble.run(scenes, folder / "one", step=STEP, workers=1))
        busy = time.process_time() - begin
    size = sum(path.stat().st_size for path in (folder / "one").iterdir()) / 1e6
    whole = busy / loop.seconds - 1.0
    print(f"{scenes.sizes['member']} members in one thread, {size:.0f} MB: {wall:.2f} s, of them busy {busy:.2f} s")
    print(f"  compiled loop {loop.seconds:.2f} s; beside it {whole:.1%}, of which chain.simulate has {alone:.1%}")
    print(f"  scheduling, writing and provenance: {whole - alone:.1%} of the compiled loop")


def processes(scenes: xr.Dataset, folder: Path) -> None:
    """Measure two processes against one, with the control before and after."""
    from distributed import Client, LocalCluster

    before = two_process_gain(COUNTED)
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
    after = two_process_gain(COUNTED)
    print(f"one process {taken[1]:.2f} s, two {taken[2]:.2f} s: {taken[1] / taken[2]:.2f} times as fast")
    print(f"  two processes that count do {before:.2f} (before) and {after:.2f} (after) times as much as one")


def opening(number: int, folder: Path) -> None:
    """Measure the opening time of a large ensemble."""
    small = scene("example2").assign(chain_links=4)
    scenes = cp.ensemble.design(small, {"cable.top_tension": [9e3, 16e3]}, members=number)
    cp.ensemble.run(scenes, folder / "large", step=2e-3, times=np.linspace(0.0, 0.1, 3))
    times = []
    for _ in range(3):
        whole, seconds = timed(lambda: cp.archive.open_ensemble(folder / "large"))
        times.append(seconds)
    files = len(list((folder / "large").glob("batch_*.nc")))
    print(f"{whole.sizes['member']} members in {files} files open in {', '.join(f'{item:.2f}' for item in times)} s")


def main() -> None:
    """Measure all."""
    parser = command_line(__doc__)
    parser.add_argument("--members", type=int, default=2000, help="number of members that run")
    parser.add_argument("--open", type=int, default=10_000, help="number of members of the ensemble that is opened")
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
