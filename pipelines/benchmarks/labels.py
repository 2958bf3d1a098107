"""Measure what the checks of Datasets at the border of public functions cost.

    python pipelines/benchmarks/labels.py [--repeats 9] [--readme]

One thread, processor time, the least of the repeats.  ``check`` is the time that :func:`cablepod._inputs.taken` takes for a
Dataset in the order of the package.  ``of the call`` is the part of all such checks in a whole call, whose time stands beside it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from _study import command_line, markdown_table, show_table, time_inside

import cablepod as cp
from cablepod import _inputs, examples

HERE = Path(__file__).resolve().parent
#: Calls of a check of one measurement.
CALLS = 200


def least(call: Callable[[], Any], repeats: int, calls: int = 1) -> float:
    """Return the least processor time of a call [s]."""
    found = []
    for _ in range(repeats):
        begin = time.process_time()
        for _ in range(calls):
            call()
        found.append((time.process_time() - begin) / calls)
    return min(found)


def share(call: Callable[[], Any], repeats: int) -> tuple[float, float]:
    """Return the processor time of a call [s], and the part of it that its checks take, both least."""
    call()
    times, parts = [], []
    for _ in range(repeats):
        with time_inside("cablepod._inputs.taken", clock=time.process_time) as inside:
            begin = time.process_time()
            call()
            times.append(time.process_time() - begin)
        parts.append(inside.seconds)
    return min(times), min(parts)


def main() -> None:
    """Run the benchmark and print its tables."""
    options = command_line(__doc__, readme=True, repeats=9).parse_args()
    scene = examples.scene("example2")
    members = cp.ensemble.design(scene, {"cable.top_tension": [14e3, 16e3]}, members=100, seed=1)
    run = cp.chain.simulate(scene, outputs=("position", "velocity", "tension"))
    modes = {layout: cp.pod.decompose(run, rank=6, layout=layout) for layout in ("separate", "vector", "normal")}
    model = cp.condensed.simulate(scene, modes["normal"])
    amplitudes = cp.pod.project(run, modes["separate"])
    given: dict[str, tuple[Any, _inputs.Kind]] = {
        "scene": (scene, _inputs.SCENE),
        "100 members": (members, _inputs.SCENE),
        **{f"modes, {layout}": (one, _inputs.MODES) for layout, one in modes.items()},
        "amplitudes": (amplitudes, _inputs.AMPLITUDES),
        "snapshots": (run, _inputs.SNAPSHOTS),
        "trajectory": (run, _inputs.TRAJECTORY),
    }
    rows = [
        [
            name,
            f"{1e6 * least(lambda one=one, kind=kind: _inputs.taken('it', one, kind), options.repeats, CALLS):.0f} µs",
        ]
        for name, (one, kind) in given.items()
    ]
    show_table("labels", markdown_table(["Dataset", "check"], rows), HERE if options.readme else None)
    calls: dict[str, Callable[[], Any]] = {
        "pod.decompose": lambda: cp.pod.decompose(run),
        "pod.decompose, normal": lambda: cp.pod.decompose(run, layout="normal"),
        "pod.project": lambda: cp.pod.project(run, modes["separate"]),
        "pod.reconstruct": lambda: cp.pod.reconstruct(amplitudes, modes["separate"]),
        "compare.errors": lambda: cp.compare.errors(model, run),
        "condensed.simulate": lambda: cp.condensed.simulate(scene, modes["normal"]),
    }
    rows = []
    for name, call in calls.items():
        whole, part = share(call, options.repeats)
        rows.append([name, f"{1e3 * whole:.2f} ms", f"{100.0 * part / whole:.2g} %"])
    sizes = f"{np.prod(run['position'].shape[:2])} places"
    print(f"run of {sizes}")
    show_table("label shares", markdown_table(["call", "time", "of the call"], rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
