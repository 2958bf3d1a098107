"""Time masts as members of one call, beside calls one after the other.

    python pipelines/mast/members.py [--members 56] [--readme]

The mast of 120 m with nine guys, 600 s of turbulent wind, with other tensions of two tables of guys.  All members share one wind,
which is made before.  Written are wall-clock and processor time of a mast (medians of three calls, taken in turns), with the step
chosen by default and with 25 ms.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import xarray as xr
from _study import command_line, markdown_table, show_table

import cablepod as cp
from cablepod import examples

HERE = Path(__file__).parent
REPEATS = 3
#: Largest step that meets the default of every member [s], and one that is a fifth longer.
STEPS = (None, 0.025)


def scenes(members: int) -> xr.Dataset:
    """Return the masts."""
    ranges = {"guy.1.top_tension": [13000.0, 17000.0], "guy.3.top_tension": [22000.0, 28000.0]}
    return cp.ensemble.design(examples.scene("mast120"), ranges, members=members, seed=1)


def one_by_one(scene: xr.Dataset, **options: Any) -> None:
    """Run masts one after the other."""
    for i in range(scene.sizes["member"]):
        cp.mast.simulate(scene.isel(member=i, drop=True), **options)


def seconds(run: Any, scene: xr.Dataset, **options: Any) -> tuple[float, float]:
    """Return wall-clock and processor time of a mast [s]."""
    begin, processor = time.perf_counter(), time.process_time()
    run(scene, **options)
    count = scene.sizes["member"]
    return (time.perf_counter() - begin) / count, (time.process_time() - processor) / count


def main() -> None:
    """Measure and write the table."""
    parser = command_line(__doc__, readme=True)
    parser.add_argument("--members", type=int, default=56)
    options = parser.parse_args()
    scene = scenes(options.members)
    few = scene.isel(member=slice(0, 8))
    cp.mast.simulate(few, times=[0.0, 0.1])  # compiles
    cp.mast.simulate(few)
    rows = []
    for step in STEPS:
        found = [
            (seconds(cp.mast.simulate, scene, step=step), seconds(one_by_one, few, step=step)) for _ in range(REPEATS)
        ]
        text = "default" if step is None else f"{1e3 * step:g} ms"
        for k, name in enumerate(("members of one call", "one after the other")):
            wall, processor = (1e3 * statistics.median(one[k][j] for one in found) for j in range(2))
            rows.append([text, name, f"{wall:.0f} ms", f"{processor:.0f} ms"])
    heads = ["step", "masts", "wall clock, a mast", "processor, a mast"]
    show_table("members", markdown_table(heads, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
