"""Time a step of the explicit chain per link, beside a plain C loop.

    python pipelines/benchmarks/chain.py [--repeats 7] [--readme]

One thread (the kernel has no other); compilation and a warm-up run are left out; medians over the repeats, C and ours in turns so
that a busy machine slows both.  Stepping is all between the first state and the last: the kernel, the motion of the end (which
the C loop has too), and the check of each block of steps for numbers that are not finite or out of bounds.  The C loop is the
same step of a planar chain without any other term (chain_step.c, gcc -O3 -march=native -ffast-math); without gcc its column is
nan.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from _study import command_line, in_turns, markdown_table, medians, show_table, time_inside, timed

import cablepod as cp
from cablepod.discretisation._chain import chain_of
from cablepod.examples import scene
from cablepod.parameters._from_scene import parameters

HERE = Path(__file__).resolve().parent
WORK = 12_000_000  #: links times steps in one measurement


def compiled_yardstick() -> Path | None:
    """Compile chain_step.c and return the program; None without gcc."""
    if shutil.which("gcc") is None:
        return None
    target = Path(tempfile.mkdtemp()) / "chain_step"
    source = HERE / "chain_step.c"
    subprocess.run(["gcc", "-O3", "-march=native", "-ffast-math", str(source), "-o", str(target), "-lm"], check=True)
    return target


def c_time(program: Path | None, links: int, steps: int | None = None) -> float:
    """Return nanoseconds per link and step of the C loop, over WORK by default."""
    if program is None:
        return float("nan")
    command = [str(program), str(links), str(steps or WORK // links)]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return float(printed.split("step")[1].split()[0])


def our_time(links: int) -> tuple[float, float]:
    """Return nanoseconds per link and step of the stepping and of the whole call."""
    given = scene("example2")
    step = 0.5 * chain_of(parameters(given), links).step_limit()
    steps = WORK // links
    with time_inside("cablepod.integrate._march.advance_in_blocks") as stepping:
        _, whole = timed(lambda: cp.chain.simulate(given, links=links, step=step, times=[0.0, steps * step]))
    return 1e9 * stepping.seconds / (steps * links), 1e9 * whole / (steps * links)


def main() -> None:
    """Print the table."""
    options = command_line(__doc__, repeats=7, readme=True).parse_args()
    program = compiled_yardstick()
    print(f"ns per link and step, median of {options.repeats}, {WORK:,} link-steps each, numpy {np.__version__}")
    lines = []
    for links in (40, 160, 640):
        our_time(links)
        jobs = [lambda links=links: our_time(links), lambda links=links: c_time(program, links)]
        ours, c = in_turns(jobs, options.repeats)
        values = medians((*times, yardstick, times[0] / yardstick) for times, yardstick in zip(ours, c, strict=True))
        lines.append([str(links), *(f"{value:.2f}" for value in values)])
    table = markdown_table(["links", "stepping", "whole call", "C loop", "ours / C"], lines)
    show_table("chain", table, HERE if options.readme else None)


if __name__ == "__main__":
    main()
