"""Time the rainflow count beside the ``rainflow`` package, over the length and number of series.

    python pipelines/benchmarks/rainflow_count.py [--repeats 5] [--readme]

Random walks.  The package takes the values of a labelled array, one series after the other; its equivalent range is the sum over
its cycles.  cablepod takes and gives labelled arrays, in whole calls.  Wall time, medians in turns: of many samples
``fatigue.ranges`` makes the hash that the history keeps in a second thread.  Needs the extra ``test``.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, in_turns, markdown_table, medians, show_table

os.environ.update(ONE_THREAD)

from collections.abc import Callable

import numpy as np
import xarray as xr

import cablepod as cp

HERE = Path(__file__).resolve().parent
#: Number of series and of samples in each.
SIZES = ((1, 1000), (1, 12000), (1, 100000), (1, 1000000), (64, 12000))
EXPONENT = 4
HEAD = (
    "series", "samples", "`rainflow` cycles [ms]", "`fatigue.ranges` [ms]", "ratio", "`rainflow` equivalent [ms]",
    "`fatigue.equivalent` [ms]", "ratio",
)  # fmt: skip


def seconds(job: Callable[[], object]) -> float:
    """Return the time of a call [s]."""
    begin = time.perf_counter()
    job()
    return time.perf_counter() - begin


def row(count: int, samples: int, repeats: int) -> list[str]:
    """Return the cells of one size."""
    import rainflow

    values = np.cumsum(np.random.default_rng(0).normal(size=(count, samples)), axis=1)
    series = xr.DataArray(values, dims=("member", "time"), coords={"time": 0.05 * np.arange(samples)})
    if count == 1:
        series = series.isel(member=0)

    def damage(plain: np.ndarray) -> float:
        return sum(part * extent**EXPONENT for extent, _, part, _, _ in rainflow.extract_cycles(plain))

    jobs = [
        lambda: seconds(lambda: [list(rainflow.extract_cycles(plain)) for plain in values]),
        lambda: seconds(lambda: cp.fatigue.ranges(series)),
        lambda: seconds(lambda: [damage(plain) for plain in values]),
        lambda: seconds(lambda: cp.fatigue.equivalent(series, exponent=EXPONENT)),
    ]
    in_turns(jobs, 1)
    spent = in_turns(jobs, repeats)
    a, b, cycles, c, d, equivalent = medians(
        (1e3 * a, 1e3 * b, a / b, 1e3 * c, 1e3 * d, c / d) for a, b, c, d in zip(*spent, strict=True)
    )
    times = [f"{value:.2g}" if value < 100.0 else f"{value:.0f}" for value in (a, b, c, d)]
    return [str(count), str(samples), times[0], times[1], f"{cycles:.2g}", times[2], times[3], f"{equivalent:.2g}"]


def main() -> None:
    """Print the times and their ratios."""
    options = command_line(__doc__, repeats=5, readme=True).parse_args()
    rows = [row(count, samples, options.repeats) for count, samples in SIZES]
    show_table("rainflow_count", markdown_table(HEAD, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
