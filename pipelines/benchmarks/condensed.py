"""Time of the condensed model for 125 s of Example 2, computed and whole call, beside a plain C loop of the full chain.

    python pipelines/benchmarks/condensed.py [--repeats 9]

Computed is what pipelines/error_against_run_time.py calls kernel time: the compiled loop, and the tables of the end's motion that
it needs.  The whole call gives amplitudes only, every second (`outputs=()`): the median of five in a row, and beside it the
first one after other programs had the caches.  The C loop (chain_step.c, gcc -O3 -march=native
-ffast-math) steps a chain of 40 links by 2.5e-4 s through the same 125 s; where there is no gcc its column is empty.  One thread,
warm; medians over the repeats, all in turn so that a busy machine hurts all alike.
"""

from __future__ import annotations

import os

os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")})

import argparse
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from chain import compiled_yardstick

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from run_time_models import Setting, kernel_calls, seconds_of

import cablepod as cp
from cablepod.shipped import scene

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
    """Time that the C loop takes for the run [s]."""
    if program is None:
        return float("nan")
    command = [str(program), str(LINKS), str(round(DURATION / C_STEP))]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return 1e-9 * float(said.split("step")[1].split()[0]) * LINKS * round(DURATION / C_STEP)


def timed(job: Callable[[], object]) -> float:
    """Wall time of a call [s]."""
    begin = time.perf_counter()
    job()
    return time.perf_counter() - begin


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    repeats = parser.parse_args().repeats
    program = compiled_yardstick()
    given = scene("example2")
    snapshots = cp.chain.simulate(given, links=LINKS, scheme="velocity_verlet", step=C_STEP, times=TIMES)
    modes = cp.pod.decompose(snapshots, rank=max(case[2] for case in CASES), layout="normal")
    jobs, calls = [], []
    for order, scheme, rank, step in CASES:
        job = partial(
            cp.condensed.simulate, given, modes, order=order, scheme=scheme, rank=rank, step=step, times=TIMES
        )
        setting = Setting("reduced", "condensed", scheme, LINKS, order, rank, step=step)
        jobs.append(partial(job, outputs=()))
        calls.append(kernel_calls(lambda times, outputs, job=job: job(outputs=outputs), TIMES, setting)[0])
    taken: list[list[tuple[float, ...]]] = [[] for _ in CASES]
    for _ in range(repeats):
        for row, job, recorded in zip(taken, jobs, calls, strict=True):
            kernel = seconds_of(recorded, least=5e-3)
            first, *others = (timed(job) for _ in range(6))
            row.append((kernel, statistics.median(others), first, c_seconds(program)))
    print(f"Example 2, {DURATION:g} s, medians of {repeats}; C loop: {LINKS} links, steps of {C_STEP:g} s")
    print(
        f"{'order, scheme, r, step':<40}{'computed':>10}{'call':>9}{'first call':>12}{'C loop':>10}{'C / computed':>14}"
    )
    for (order, scheme, rank, step), row in zip(CASES, taken, strict=True):
        kernel, call, first, c = (1e3 * statistics.median(column) for column in zip(*row, strict=True))
        ratio = statistics.median(item[-1] / item[0] for item in row)
        name = f"{order}, {scheme.replace('_', ' ')}, {rank}, {step:g} s"
        print(f"{name:<40}{kernel:>7.4f} ms{call:>6.2f} ms{first:>9.2f} ms{c:>7.1f} ms{ratio:>14.0f}")
    print(f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
