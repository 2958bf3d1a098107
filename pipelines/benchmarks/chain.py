"""Time per link and step of the explicit chain, stepping and whole call, beside a plain C loop compiled on the spot.

    python pipelines/benchmarks/chain.py [--repeats 7]

One thread (the kernel has no other); compilation and a warm-up run lie outside; medians over the repeats, C and ours taken in
turn so that a busy machine hurts both.  Stepping is all between the first state and the last: the kernel, the motion of the end,
which the C loop has too, and the look at each block of steps for numbers that are not finite or not near.  The C loop is the
same step of a planar chain without any other term
(chain_step.c, gcc -O3 -march=native -ffast-math); where there is no gcc its column is empty.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import cablepod as cp
from cablepod import stepping
from cablepod.links import chain_of
from cablepod.parameters import parameters
from cablepod.shipped import scene

HERE = Path(__file__).resolve().parent
WORK = 12_000_000  # links times steps in one measurement


def compiled_yardstick() -> Path | None:
    """Compile chain_step.c; None without gcc."""
    if shutil.which("gcc") is None:
        return None
    target = Path(tempfile.mkdtemp()) / "chain_step"
    source = HERE / "chain_step.c"
    subprocess.run(["gcc", "-O3", "-march=native", "-ffast-math", str(source), "-o", str(target), "-lm"], check=True)
    return target


def c_time(program: Path | None, links: int) -> float:
    """Nanoseconds per link and step of the C loop."""
    if program is None:
        return float("nan")
    said = subprocess.run(
        [str(program), str(links), str(WORK // links)], check=True, capture_output=True, text=True
    ).stdout
    return float(said.split("step")[1].split()[0])


def our_time(links: int) -> tuple[float, float]:
    """Nanoseconds per link and step of the stepping and of the whole call."""
    given = scene("example2")
    step = 0.5 * chain_of(parameters(given), links).step_limit()
    steps = WORK // links
    stepping_time = 0.0
    plain = stepping.march

    def timed(*arguments):
        nonlocal stepping_time
        begin = time.perf_counter()
        failed = plain(*arguments)
        stepping_time += time.perf_counter() - begin
        return failed

    stepping.march = timed
    try:
        begin = time.perf_counter()
        cp.chain.simulate(given, links=links, step=step, times=[0.0, steps * step])
        whole = time.perf_counter() - begin
    finally:
        stepping.march = plain
    return 1e9 * stepping_time / (steps * links), 1e9 * whole / (steps * links)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=7)
    repeats = parser.parse_args().repeats
    program = compiled_yardstick()
    print(f"ns per link and step, median of {repeats}, {WORK:,} link-steps each")
    print(f"{'links':>6}{'stepping':>9}{'whole call':>12}{'C loop':>9}{'ours / C':>12}")
    for links in (40, 160, 640):
        our_time(links)
        rows = [(*our_time(links), c_time(program, links)) for _ in range(repeats)]
        inside, whole, c = (statistics.median(column) for column in zip(*rows, strict=True))
        ratio = statistics.median(row[0] / row[2] for row in rows)
        print(f"{links:>6}{inside:>9.2f}{whole:>12.2f}{c:>9.2f}{ratio:>12.2f}")
    print(f"\nnumpy {np.__version__}")


if __name__ == "__main__":
    main()
