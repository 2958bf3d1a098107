"""Measure what the checks of Datasets at the border of public functions cost.

    python pipelines/benchmarks/labels.py [--repeats 25] [--readme]

Processor time of one thread.  The first table has the least time that :func:`cablepod._inputs.taken` takes for a Dataset in the
order of the package, repeated at once.  The second has the part of all such checks in whole calls, where they find colder caches,
beside the time of the call; medians.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, percent, show_table, wrapped

import cablepod as cp
from cablepod import _inputs, examples

HERE = Path(__file__).resolve().parent
OUTPUTS = ("position", "velocity", "tension")
#: Calls of a check of one measurement, and of whole calls for each repeat.
CALLS, WHOLE_CALLS = 200, 20


def check(dataset: xr.Dataset, kind: _inputs.Kind, repeats: int) -> str:
    """Return the least time of a check as text."""
    times = []
    for _ in range(repeats):
        begin = time.thread_time()
        for _ in range(CALLS):
            _inputs.taken("it", dataset, kind)
        times.append((time.thread_time() - begin) / CALLS)
    return f"{1e6 * min(times):.0f} µs"


def share(call: Callable[[], Any], repeats: int) -> list[str]:
    """Return the time of the checks in a call, that of the call, and their ratio as texts."""
    seconds = 0.0

    def watched(function: Callable[..., Any]) -> Callable[..., Any]:
        def run(key: str, given: xr.Dataset, kind: _inputs.Kind) -> xr.Dataset:
            nonlocal seconds
            begin = time.thread_time()
            result = function(key, given, kind)
            seconds += time.thread_time() - begin
            return result

        return run

    call()
    times, parts = [], []
    with wrapped(watched, "cablepod._inputs.taken"):  # once, as this goes through all modules
        for _ in range(WHOLE_CALLS * repeats):
            seconds, begin = 0.0, time.thread_time()
            call()
            times.append(time.thread_time() - begin)
            parts.append(seconds)
    of_checks, whole = median(parts), median(times)
    return [f"{1e6 * of_checks:.0f} µs", f"{1e3 * whole:.2f} ms", percent(of_checks / whole)]


def rows_of(instants: int, links: int, repeats: int) -> tuple[list[list[str]], list[list[str]]]:
    """Return the rows of both tables for a run of so many instants and links."""
    scene = examples.scene("example2")
    times = np.linspace(0.0, 124.0, instants)
    run = cp.chain.simulate(scene, links=links, times=times, step=0.0125 / links, outputs=OUTPUTS)
    separate, normal = (cp.pod.decompose(run, rank=6, layout=layout) for layout in ("separate", "normal"))
    reduced = cp.condensed.simulate(scene, normal, times=times)
    given = {
        "scene": (scene, _inputs.SCENE),
        "100 members": (cp.ensemble.design(scene, {"cable.area": [1e-4, 1.2e-4]}, members=100), _inputs.SCENE),
        "modes, separate": (separate, _inputs.MODES),
        "modes, normal": (normal, _inputs.MODES),
        "amplitudes": (cp.pod.project(run, separate), _inputs.AMPLITUDES),
        "snapshots": (run, _inputs.SNAPSHOTS),
        "snapshots, positions alone": (run, _inputs.MOTION),
    }
    calls: dict[str, Callable[[], Any]] = {
        "pod.decompose": lambda: cp.pod.decompose(run),
        "pod.project": lambda: cp.pod.project(run, separate),
        "compare.errors": lambda: cp.compare.errors(reduced, run),
        "condensed.simulate": lambda: cp.condensed.simulate(scene, normal),
    }
    size = f"{instants} x {links + 1}"
    checks = [[name, check(*one, repeats)] for name, one in given.items()]
    return checks, [[name, size, *share(call, repeats)] for name, call in calls.items()]


def main() -> None:
    """Run the benchmark and print its tables."""
    options = command_line(__doc__, readme=True, repeats=25).parse_args()
    page = HERE if options.readme else None
    (checks, few), (_, many) = (rows_of(*size, options.repeats) for size in ((125, 40), (1001, 80)))
    show_table("labels", markdown_table(["Dataset", "check"], checks), page)
    header = ["call", "instants x particles", "checks", "whole call", "share"]
    show_table("label shares", markdown_table(header, few + many), page)


if __name__ == "__main__":
    main()
