"""Measure what the checks of Datasets at the border of public functions cost.

    python pipelines/benchmarks/labels.py [--repeats 9] [--readme]

One thread, processor time, the least of the repeats.  The first table has the time that :func:`cablepod._inputs.taken` takes for
a Dataset in the order of the package, called again and again.  The second has the part of all such checks in whole calls, where
they find colder caches, beside the time of the call.

first
    no Dataset of these names was seen before.
other
    a Dataset of other values, lengths and instants than the one before; no array and no index was seen before.
same
    the Dataset of the call before.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, percent, show_table, time_inside

import cablepod as cp
from cablepod import _inputs, examples
from cablepod._inputs import _labels, _seen

HERE = Path(__file__).resolve().parent
#: Calls of a check of one measurement.
CALLS = 200


def another(dataset: xr.Dataset) -> xr.Dataset:
    """Return a Dataset with other numbers, in which no array and no index is one of `dataset`."""
    other = dataset.copy(deep=True)
    for name, variable in other.variables.items():
        if variable.dtype.kind == "f" and name not in other.indexes:
            variable.values[...] *= 1.0 + 1e-9
    return other


def forget() -> None:
    """Forget all Datasets that were seen."""
    _seen._records.clear()
    for known in _labels.IN_ORDER.values():
        known.clear()


def least(call: Callable[..., Any], make: Callable[[], Any], repeats: int) -> float:
    """Return the least processor time of a call with what is made for it [s]."""
    found = []
    for _ in range(repeats):
        given = [make() for _ in range(CALLS)]
        begin = time.process_time()
        for one in given:
            call(one)
        found.append((time.process_time() - begin) / CALLS)
    return min(found)


def checked(dataset: xr.Dataset, kind: _inputs.Kind, repeats: int) -> list[str]:
    """Return the times of a check as texts: of a first, of other and of the same Dataset."""

    def first(one: xr.Dataset) -> None:
        forget()
        _inputs.taken("it", one, kind)

    def again(one: xr.Dataset) -> None:
        _inputs.taken("it", one, kind)

    times = [
        least(first, lambda: dataset, repeats) - least(lambda _: forget(), lambda: dataset, repeats),
        least(again, lambda: another(dataset), repeats),
        least(again, lambda: dataset, repeats),
    ]
    return [f"{1e6 * seconds:.1f} µs" for seconds in times]


def share(call: Callable[..., Any], make: Callable[[], list[xr.Dataset]], repeats: int) -> tuple[float, float]:
    """Return the processor time of a call with what is made for it [s], and the part that its checks take, both least."""
    call(*make())
    times, parts = [], []
    # wrapped once, as this goes through all modules
    with time_inside("cablepod._inputs.taken", clock=time.process_time) as inside:
        for _ in range(repeats):
            given, before = make(), inside.seconds
            begin = time.process_time()
            call(*given)
            times.append(time.process_time() - begin)
            parts.append(inside.seconds - before)
    return min(times), min(parts)


def shares(instants: int, links: int, repeats: int) -> list[list[str]]:
    """Return the rows of the second table for a run of so many instants and links."""
    scene = examples.scene("example2")
    times = np.linspace(0.0, 124.0, instants)
    run = cp.chain.simulate(scene, links=links, times=times, outputs=("position", "velocity", "tension"))
    separate, normal = (cp.pod.decompose(run, rank=6, layout=layout) for layout in ("separate", "normal"))
    model = cp.condensed.simulate(scene, normal, times=times)
    calls: dict[str, tuple[Callable[..., Any], list[xr.Dataset]]] = {
        "pod.decompose": (cp.pod.decompose, [run]),
        "pod.decompose, normal": (partial(cp.pod.decompose, layout="normal"), [run]),
        "pod.project": (cp.pod.project, [run, separate]),
        "pod.reconstruct": (cp.pod.reconstruct, [cp.pod.project(run, separate), separate]),
        "compare.errors": (cp.compare.errors, [model, run]),
        "condensed.simulate": (partial(cp.condensed.simulate, times=times), [scene, normal]),
    }
    rows = []
    for name, (call, given) in calls.items():
        whole, same = share(call, lambda given=given: given, repeats)
        _, other = share(call, lambda given=given: [another(one) for one in given], repeats)
        parts = [f"{1e6 * part:.0f} µs, {percent(part / whole)}" for part in (other, same)]
        rows.append([name, f"{instants} x {links + 1}", f"{1e3 * whole:.2f} ms", *parts])
    return rows


def main() -> None:
    """Run the benchmark and print its tables."""
    options = command_line(__doc__, readme=True, repeats=25).parse_args()
    page = HERE if options.readme else None
    scene = examples.scene("example2")
    members = cp.ensemble.design(scene, {"cable.top_tension": [14e3, 16e3]}, members=100, seed=1)
    run = cp.chain.simulate(scene, outputs=("position", "velocity", "tension"))
    modes = {layout: cp.pod.decompose(run, rank=6, layout=layout) for layout in ("separate", "vector", "normal")}
    given: dict[str, tuple[Any, _inputs.Kind]] = {
        "scene": (scene, _inputs.SCENE),
        "100 members": (members, _inputs.SCENE),
        **{f"modes, {layout}": (one, _inputs.MODES) for layout, one in modes.items()},
        "amplitudes": (cp.pod.project(run, modes["separate"]), _inputs.AMPLITUDES),
        "snapshots": (run, _inputs.SNAPSHOTS),
        "trajectory": (run, _inputs.TRAJECTORY),
    }
    rows = [[name, *checked(one, kind, options.repeats)] for name, (one, kind) in given.items()]
    show_table("labels", markdown_table(["Dataset", "first", "other", "same"], rows), page)
    rows = [row for size in ((125, 40), (1001, 80)) for row in shares(*size, options.repeats)]
    head = ["call", "instants x particles", "time", "checks, other Datasets", "checks, same"]
    show_table("label shares", markdown_table(head, rows), page)


if __name__ == "__main__":
    main()
