"""Measure what the checks of Datasets at the border of public functions cost.

    python pipelines/benchmarks/labels.py [--repeats 25] [--readme]

One thread.  The first table has the time that :func:`cablepod._inputs.taken` takes for a Dataset in the order of the package, the
second the part of all such checks in whole calls, where they find colder caches, beside the time of the call.

first
    no Dataset of these names was seen before; least time.
new
    what was just made by calls of the package, each time of another scene, with its own values, instants and indexes; medians.
same
    the Datasets of the call before; least time of a check, medians of whole calls.
"""

from __future__ import annotations

import sys
import time
import tomllib
from collections.abc import Callable
from functools import partial
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
from cablepod._inputs import _seen
from cablepod.conventions import IN_ORDER

HERE = Path(__file__).resolve().parent
TREE = tomllib.loads(examples.scene_path("example2").read_text())
OUTPUTS = ("position", "velocity", "tension")
#: Calls of a check of one measurement, and of whole calls with the same Datasets per repeat.
CALLS, SAME = 200, 20
#: Makes a Dataset of its own for each number.
Make = Callable[[int], xr.Dataset]


def scene_of(number: int) -> xr.Dataset:
    """Return Example 2 with its own tension."""
    return cp.make_scene(TREE | {"cable": TREE["cable"] | {"top_tension": 15e3 + number}})


def members_of(number: int) -> xr.Dataset:
    """Return a hundred scenes of which no other number has one."""
    return cp.ensemble.design(scene_of(number), {"cable.area": [1e-4, 1.2e-4]}, members=100, seed=number)


def times_of(number: int, instants: int) -> np.ndarray:
    """Return instants that no other number has [s]."""
    return np.linspace(0.0, 124.0 - 1e-3 * number, instants)


def run_of(number: int, instants: int = 125, links: int = 40) -> xr.Dataset:
    """Return a run of the chain."""
    times, step = times_of(number, instants), 0.0125 / links
    return cp.chain.simulate(scene_of(number), links=links, times=times, step=step, outputs=OUTPUTS)


def forget() -> None:
    """Forget all Datasets that were seen."""
    _seen._records.clear()
    for known in IN_ORDER.values():
        known.clear()


def least(call: Callable[[], Any], repeats: int) -> float:
    """Return the least time of a call [s]."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        for _ in range(CALLS):
            call()
        times.append((time.perf_counter() - begin) / CALLS)
    return min(times)


def checked(make: Make, kind: _inputs.Kind, repeats: int) -> list[str]:
    """Return the times of a check as texts: of a first, of new ones and of the same Dataset."""
    dataset, new = make(0), []

    def first() -> None:
        forget()
        _inputs.taken("it", dataset, kind)

    def same() -> None:
        _inputs.taken("it", dataset, kind)

    unseen = least(first, repeats) - least(forget, repeats)
    seen = least(same, repeats)
    for number in range(1, repeats + 1):
        other = make(number)
        begin = time.perf_counter()
        _inputs.taken("it", other, kind)
        new.append(time.perf_counter() - begin)
    return [f"{1e6 * seconds:.1f} µs" for seconds in (unseen, median(new), seen)]


def share(call: Callable[..., Any], make: Callable[[int], tuple[xr.Dataset, ...]], repeats: int) -> list[str]:
    """Return as texts the time of the checks of snapshots and of all Datasets beside that of a call: new ones, then the same."""
    texts = []
    seconds = dict.fromkeys((False, True), 0.0)  # of snapshots, of other Datasets

    def watched(function: Callable[..., Any]) -> Callable[..., Any]:
        def run(key: str, given: xr.Dataset, kind: _inputs.Kind) -> xr.Dataset:
            begin = time.perf_counter()
            result = function(key, given, kind)
            seconds[kind.is_small] += time.perf_counter() - begin
            return result

        return run

    # wrapped once, as this goes through all modules; reading the processor's time would take as long as half a check
    with wrapped(watched, "cablepod._inputs.taken"):
        for counted in (range(1, repeats + 1), [0] * (SAME * repeats)):
            given, times, parts = make(0), [], []
            for number in counted:
                given = make(number) if number else given
                seconds.update({False: 0.0, True: 0.0})
                begin = time.perf_counter()
                call(*given)
                times.append(time.perf_counter() - begin)
                parts.append((seconds[False], sum(seconds.values())))
            whole = median(times)
            of_snapshots, of_all = (median(column) for column in zip(*parts, strict=True))
            texts.append(f"{1e6 * of_snapshots:.0f} µs, {percent(of_snapshots / whole)}" if of_snapshots else "")
            texts.append(f"{1e6 * of_all:.0f} µs of {1e3 * whole:.2f} ms, {percent(of_all / whole)}")
    return texts


def shares(instants: int, links: int, repeats: int) -> list[list[str]]:
    """Return the rows of the second table for a run of so many instants and links."""
    run = partial(run_of, instants=instants, links=links)
    separate, normal = (cp.pod.decompose(run(0), rank=6, layout=layout) for layout in ("separate", "normal"))

    def condensed(number: int) -> xr.Dataset:
        return cp.condensed.simulate(scene_of(number), normal, times=times_of(number, instants))

    calls: dict[str, tuple[Callable[..., Any], Callable[[int], tuple[xr.Dataset, ...]]]] = {
        "pod.decompose": (cp.pod.decompose, lambda number: (run(number),)),
        "pod.decompose, normal": (partial(cp.pod.decompose, layout="normal"), lambda number: (run(number),)),
        "pod.project": (cp.pod.project, lambda number: (run(number), separate)),
        "pod.reconstruct": (cp.pod.reconstruct, lambda number: (cp.pod.project(run(number), separate), separate)),
        "compare.errors": (cp.compare.errors, lambda number: (condensed(number), run(number))),
        "condensed.simulate": (cp.condensed.simulate, lambda number: (scene_of(number), normal)),
    }
    return [[name, f"{instants} x {links + 1}", *share(call, make, repeats)] for name, (call, make) in calls.items()]


def main() -> None:
    """Run the benchmark and print its tables."""
    options = command_line(__doc__, readme=True, repeats=25).parse_args()
    page = HERE if options.readme else None

    def modes_of(number: int, layout: str) -> xr.Dataset:
        return cp.pod.decompose(run_of(number), rank=6, layout=layout)

    separate = modes_of(0, "separate")
    given: dict[str, tuple[Make, _inputs.Kind]] = {
        "scene": (scene_of, _inputs.SCENE),
        "100 members": (members_of, _inputs.SCENE),
        **{f"modes, {layout}": (partial(modes_of, layout=layout), _inputs.MODES) for layout in ("separate", "normal")},
        "amplitudes": (lambda number: cp.pod.project(run_of(number), separate), _inputs.AMPLITUDES),
        "snapshots": (run_of, _inputs.SNAPSHOTS),
        "snapshots, positions alone": (run_of, _inputs.MOTION),
    }
    rows = [[name, *checked(one, kind, options.repeats)] for name, (one, kind) in given.items()]
    show_table("labels", markdown_table(["Dataset", "first", "new", "same"], rows), page)
    rows = [row for size in ((125, 40), (1001, 80)) for row in shares(*size, options.repeats)]
    header = ["call", "instants x particles", "new: snapshots", "new: all", "same: snapshots", "same: all"]
    show_table("label shares", markdown_table(header, rows), page)


if __name__ == "__main__":
    main()
