"""Time the condensed model on Example 2, beside a plain C loop of the chain.

    python pipelines/benchmarks/condensed.py [--repeats 9] [--readme]

Computed is the kernel time of pipelines/error_vs_runtime/run.py: the compiled loop, and the tables of the end's motion that it
needs.  The whole call gives amplitudes only, every second (`outputs=()`): the median of five in a row, and beside it the first
one after other programs filled the caches.  The C loop (chain_step.c, gcc -O3 -march=native -ffast-math) steps a chain of 40
links by 2.5e-4 s through the same 125 s; without gcc its column is nan.  One thread, warm; medians over the repeats, all in turns
so that a busy machine slows all alike.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, in_turns, markdown_table, medians, show_table, timed

os.environ.update(ONE_THREAD)

import statistics
from collections.abc import Callable
from functools import partial

import numpy as np
from error_vs_runtime.models import Setting, kernel_calls, seconds_of

import cablepod as cp
from benchmarks.chain import c_time, compiled_yardstick
from cablepod.examples import scene

HERE = Path(__file__).resolve().parent
LINKS, C_STEP, DURATION = 40, 2.5e-4, 125.0
TIMES = np.arange(DURATION + 1.0)
CASES = (
    ("leading", "velocity_verlet", 2, 0.1),
    ("leading", "velocity_verlet", 4, 0.05),
    ("leading", "trapezoidal", 2, 1.0),
    ("exact", "velocity_verlet", 2, 0.1),
    ("exact", "trapezoidal", 2, 1.0),
)


def c_seconds(program: Path | None) -> float:
    """Return the time of the C loop for the run [s]."""
    steps = round(DURATION / C_STEP)
    return 1e-9 * c_time(program, LINKS, steps) * LINKS * steps


def times_of(job: Callable[[], object], recorded: list, program: Path | None) -> tuple[float, ...]:
    """Return times of kernel, call, first call and C loop [s]."""
    kernel = seconds_of(recorded, least=5e-3)
    first, *others = (timed(job)[1] for _ in range(6))
    return kernel, statistics.median(others), first, c_seconds(program)


def main() -> None:
    """Print the table."""
    options = command_line(__doc__, repeats=9, readme=True).parse_args()
    program = compiled_yardstick()
    given = scene("example2")
    snapshots = cp.chain.simulate(given, links=LINKS, scheme="velocity_verlet", step=C_STEP, times=TIMES)
    modes = cp.pod.decompose(snapshots, rank=max(case[2] for case in CASES), layout="normal")
    jobs = []
    for order, scheme, rank, step in CASES:
        job = partial(
            cp.condensed.simulate, given, modes, order=order, scheme=scheme, rank=rank, step=step, times=TIMES
        )
        setting = Setting("reduced", "condensed", scheme, LINKS, order, rank, step=step)
        recorded = kernel_calls(lambda times, outputs, job=job: job(outputs=outputs), TIMES, setting)[0]
        jobs.append(partial(times_of, partial(job, outputs=()), recorded, program))
    lines = []
    for (order, scheme, rank, step), row in zip(CASES, in_turns(jobs, options.repeats), strict=True):
        kernel, call, first, c = (1e3 * value for value in medians(row))
        ratio = statistics.median(item[-1] / item[0] for item in row)
        name = f"{order}, {scheme.replace('_', ' ')}, {rank}, {step:g} s"
        lines.append([name, f"{kernel:.4f} ms", f"{call:.2f} ms", f"{first:.2f} ms", f"{c:.1f} ms", f"{ratio:.0f}"])
    print(f"Example 2, {DURATION:g} s, medians of {options.repeats}; C loop: {LINKS} links, steps of {C_STEP:g} s")
    head = ["order, scheme, r, step", "computed", "call", "first call", "C loop", "C / computed"]
    show_table("condensed", markdown_table(head, lines), HERE if options.readme else None)
    print(f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
