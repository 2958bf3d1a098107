"""Measure run time and error of the implicit chain, beside a plain C loop.

    python pipelines/benchmarks/implicit.py [--repeats 7] [--readme]

125 s of Example 2 with given steps.  One thread; compilation and a warm-up run are left out; medians over the repeats, all in
turns so that a busy machine slows all.  Kernel: inside the compiled loop; whole call: chain.simulate with a given step and
positions at every second.  Error: maximum particle distance over the maximum displacement, at 45 s and over all instants,
against the continuous cable by the chain's law, and that of the step alone over all instants, against the explicit chain of as
many links at a step of 1.25e-4 s.  The C loop's time is that of chain_step.c for 125 s at 2.5e-4 s, n = 40.
"""

from __future__ import annotations

import statistics
import sys
from functools import partial
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from _study import command_line, in_turns, markdown_table, medians, show_table, time_inside, timed

import cablepod as cp
from benchmarks.chain import c_time, compiled_yardstick
from cablepod.examples import scene

HERE = Path(__file__).resolve().parent
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
#: The continuous cable; 32 elements differ by 1e-8 of the motion (data/truth).
CABLE = {"law": "linear", "elements": 8, "step": 8e-5, "outputs": ("position",)}
KERNELS = ("cablepod.chain._kernels_implicit.implicit",)


def measured(given, links: int, **options) -> tuple[float, float, np.ndarray]:
    """Return milliseconds in the kernel and of the whole call, and positions."""
    with time_inside(*KERNELS) as kernel:
        run, whole = timed(lambda: cp.chain.simulate(given, links=links, times=TIMES, **options))
    return 1e3 * kernel.seconds, 1e3 * whole, run["position"].values


def errors(position: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Return the error at 45 s and its maximum over all instants."""
    gap = np.sqrt(((position - truth) ** 2).sum(-1)).max(axis=1)
    at45, worst = (gap[45], gap.max()) / np.sqrt(((truth - truth[0]) ** 2).sum(-1)).max()
    return float(at45), float(worst)


def main() -> None:
    """Print the table."""
    options = command_line(__doc__, repeats=7, readme=True).parse_args()
    given, program = scene("example2"), compiled_yardstick()
    cables = {
        links: cp.cable.simulate(given, points=links + 1, times=TIMES, **CABLE)["position"].values
        for links in (16, 40, 640)
    }
    chains = {
        links: measured(given, links, scheme="velocity_verlet", step=1.25e-4 * min(1.0, 40 / links))[2]
        for links in (16, 40, 640)
    }
    jobs = [partial(measured, given, links, scheme=scheme, step=step) for scheme, links, step in CASES]
    in_turns(jobs, 1)
    yardstick, *rows = in_turns([partial(c_time, program, 40), *jobs], options.repeats)
    c = statistics.median(yardstick) * 1e-6 * 40 * 500_000
    print(f"125 s of Example 2, median of {options.repeats}; C loop, n = 40, 2.5e-4 s: {c:.0f} ms")
    lines = []
    for (scheme, links, step), row in zip(CASES, rows, strict=True):
        inside, whole = medians(times[:2] for times in row)
        at45, worst = errors(row[-1][2], cables[links])
        of_step = errors(row[-1][2], chains[links])[1]
        times = [f"{inside:.2f} ms", f"{whole:.2f} ms", f"{c / inside:.1f}"]
        lines.append([scheme, str(links), f"{step:g}", *times, f"{at45:.1e}", f"{worst:.1e}", f"{of_step:.1e}"])
    head = ["scheme", "links", "step [s]", "kernel", "whole call", "C / kernel"]
    head += ["error at 45 s", "maximum", "of the step alone"]
    show_table("implicit", markdown_table(head, lines), HERE if options.readme else None)


if __name__ == "__main__":
    main()
