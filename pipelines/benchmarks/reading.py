"""Measure what comparing a file with its checksums adds to reading it.

    python pipelines/benchmarks/reading.py [--repeats 9] [--readme]

One thread.  Files are a scene, and runs of chains with as many instants as make the size; in the last row positions are random
numbers, which hardly compress.  ``read`` is `archive.read` with ``verify=False`` in milliseconds of processor time, ``lazily``
the same in chunks, with all values loaded; both from the page cache of the system.  "added" is the median over the repeats of
the ratio of a read with the comparison to one without, taken in turns, less 1.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, show_table

import cablepod as cp
from cablepod import examples
from cablepod.archive import _checked, _seal

HERE = Path(__file__).resolve().parent
#: Instants of the runs with 40 links, by name.
FILES = {"run, 126 instants": 126, "run, 15 000 instants": 15_000, "run, 200 000 instants": 200_000}
#: The run whose positions are random in another row.
RANDOM = "run, 15 000 instants"


def run_of(instants: int) -> xr.Dataset:
    """Return a run of Example 2 with so many instants."""
    times = np.linspace(0.0, 125.0, instants)
    return cp.chain.simulate(examples.scene("example2"), times=times, step=2.5e-4, outputs=("position",))


def seconds(call: Callable[[], Any]) -> float:
    """Return the processor time of a call [s], on a file that was not read before."""
    _seal._is_intact.cache_clear()
    _checked._parsed.cache_clear()
    begin = time.process_time()
    call()
    return time.process_time() - begin


def added(path: Path, repeats: int, **options: Any) -> tuple[float, float]:
    """Return the time of reading without comparison [s], and what the comparison adds to it."""

    def read(verify: bool) -> None:
        with cp.archive.read(path, verify=verify, **options) as opened:
            opened.load()

    read(True)
    pairs = [(seconds(lambda: read(False)), seconds(lambda: read(True))) for _ in range(repeats)]
    return statistics.median(plain for plain, _ in pairs), statistics.median(
        both / plain for plain, both in pairs
    ) - 1.0


def main() -> None:
    """Run the benchmark and print its table."""
    options = command_line(__doc__, readme=True, repeats=9).parse_args()
    rng, rows = np.random.default_rng(0), []
    with tempfile.TemporaryDirectory() as folder:
        datasets: dict[str, Callable[[], xr.Dataset]] = {"scene": lambda: examples.scene("example2")}
        for name, instants in FILES.items():
            datasets[name] = lambda instants=instants: run_of(instants)
        datasets[f"{RANDOM}, random"] = lambda: _random(run_of(FILES[RANDOM]), rng)
        for name, make in datasets.items():
            path = cp.archive.write(make(), Path(folder) / "file.nc", overwrite=True)
            found = [added(path, options.repeats), added(path, options.repeats, chunks={})]
            times = [f"{1e3 * plain:.3g} | {100 * more:.2g} %" for plain, more in found]
            rows.append([name, f"{path.stat().st_size / 1e6:.2g}", *times])
    head = ["file", "MB", "read", "added", "lazily", "added"]
    show_table("reading", markdown_table(head, rows), HERE if options.readme else None)


def _random(run: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
    """Return the run with random numbers for positions."""
    return run.assign(position=run["position"].copy(data=rng.normal(size=run["position"].shape)))


if __name__ == "__main__":
    main()
