"""Run time and error of the implicit chain on Example 2, beside the explicit one and the plain C loop.

    python pipelines/benchmarks/implicit.py [--repeats 7]

125 s of Example 2 with steps as given.  One thread; compilation and a warm-up run lie outside; medians over the repeats, all in
turn so that a busy machine hurts all.  Kernel: inside the compiled loop; whole call: chain.simulate with a given step and
positions at every second.  Error: largest particle distance over the largest displacement against the explicit chain of as many
links at a step of 1.25e-4 s, at 45 s and at its worst.  The C loop's time is that of chain_step.c for 125 s at 2.5e-4 s, n = 40.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np
from chain import c_time, compiled_yardstick

import cablepod as cp
from cablepod.kernels import implicit as kernel
from cablepod.shipped import scene

CASES = (
    ("trapezoidal", 40, 0.1),
    ("trapezoidal", 40, 0.01),
    ("trapezoidal", 16, 1.0),
    ("trapezoidal", 640, 0.1),
    ("generalized_alpha", 40, 0.1),
    ("energy_momentum", 40, 0.1),
    ("energy_momentum", 40, 0.01),
)
TIMES = np.arange(126.0)
INSIDE = {"generalized_alpha": 0.0, "energy_momentum": 0.0}


def watch(name: str) -> None:
    """Add up the time spent in a compiled function."""
    plain = getattr(kernel, name)

    def timed(*arguments):
        begin = time.perf_counter()
        result = plain(*arguments)
        INSIDE[name] += time.perf_counter() - begin
        return result

    setattr(kernel, name, timed)


def measured(given, links: int, **options) -> tuple[float, float, np.ndarray]:
    """Milliseconds in the kernel and of the whole call, and positions."""
    INSIDE.update(dict.fromkeys(INSIDE, 0.0))
    begin = time.perf_counter()
    run = cp.chain.simulate(given, links=links, times=TIMES, **options)
    whole = time.perf_counter() - begin
    return 1e3 * sum(INSIDE.values()), 1e3 * whole, run["position"].values


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=7)
    repeats = parser.parse_args().repeats
    given, program = scene("example2"), compiled_yardstick()
    for name in INSIDE:
        watch(name)
    truths = {
        links: measured(given, links, scheme="velocity_verlet", step=1.25e-4 * min(1.0, 40 / links))[2]
        for links in (16, 40, 640)
    }
    for scheme, links, step in CASES:
        measured(given, links, scheme=scheme, step=step)
    rows: dict[tuple[str, int, float], list[tuple[float, float]]] = {case: [] for case in CASES}
    yardstick, errors = [], {}
    for _ in range(repeats):
        yardstick.append(c_time(program, 40) * 1e-6 * 40 * 500_000)
        for case in CASES:
            inside, whole, position = measured(given, case[1], scheme=case[0], step=case[2])
            rows[case].append((inside, whole))
            truth = truths[case[1]]
            gap = np.sqrt(((position - truth) ** 2).sum(-1)).max(axis=1)
            errors[case] = (gap[45], gap.max()) / np.sqrt(((truth - truth[0]) ** 2).sum(-1)).max()
    c = statistics.median(yardstick)
    print(f"125 s of Example 2, median of {repeats}; C loop, n = 40, 2.5e-4 s: {c:.0f} ms")
    head = ("links", "step [s]", "kernel", "whole call", "C / kernel", "error 45 s", "worst")
    print(f"{'scheme':<20}" + "".join(f"{item:>12}" for item in head))
    for (scheme, links, step), times in rows.items():
        inside, whole = (statistics.median(column) for column in zip(*times, strict=True))
        at45, worst = errors[scheme, links, step]
        print(
            f"{scheme:<20}{links:>12}{step:>12g}{inside:>9.2f} ms{whole:>9.2f} ms{c / inside:>12.1f}{at45:>12.1e}{worst:>12.1e}"
        )


if __name__ == "__main__":
    main()
