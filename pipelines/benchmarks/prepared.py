"""Time prepared models: a step of a host, from Python and compiled, and runs of the scene.

    python pipelines/benchmarks/prepared.py [--repeats 9] [--readme]

The guy of Example 2 on sines, one thread, warm, CPU times, medians over the repeats, all in turns.  A run of one
step is what a run costs beside the loop: tables, start, output at two instants, end force.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, in_turns, markdown_table, medians, show_table

os.environ.update(ONE_THREAD)

from collections.abc import Callable
from functools import partial

import numba
import numpy as np
import xarray as xr

import cablepod as cp
from cablepod.examples import scene

HERE = Path(__file__).resolve().parent
RANKS, POINTS, STEP, RUN_STEP = (2, 4, 8), 41, 1e-3, 0.02
CALLS, COMPILED_STEPS = 2000, 50_000


def sines(rank: int) -> xr.Dataset:
    """Return sines as modes."""
    sigma = np.linspace(0.0, 1.0, POINTS)
    shape = np.array([np.sin((i + 1) * np.pi * sigma) for i in range(rank)])
    return xr.Dataset(
        {"mode_shape": (("mode", "particle"), shape), "singular_value": ("mode", np.ones(rank))},
        coords={"coordinate": ["x", "y"], "arc_length": ("particle", sigma)},
        attrs={"layout": "normal", "stage": "modes"},
    )


def seconds_per_call(job: Callable[[], object], calls: int, steps: int = 1) -> tuple[float]:
    """Return the CPU time of a call, over `steps` [s]."""
    begin = time.process_time()
    for _ in range(calls):
        job()
    return ((time.process_time() - begin) / calls / steps,)


def compiled_host(guy: cp.condensed.PreparedModel) -> Callable[[], object]:
    """Return a host of COMPILED_STEPS steps, compiled."""
    kernel = guy.kernel

    @numba.njit
    def host(coefficients, accepted, trial, rest, step, steps):
        position, velocity, unknown = rest.copy(), np.zeros(rest.size), np.empty(0)
        for k in range(steps):
            position[0] = rest[0] + 1e-3 * np.sin(k * step)
            velocity[0] = 1e-3 * np.cos(k * step)
            if kernel(coefficients, accepted, trial, position, velocity, unknown, step) != 0:
                return k
            accepted, trial = trial, accepted
        return steps

    arguments = guy.coefficients, guy.state, guy.state, guy.end_position, STEP, COMPILED_STEPS
    assert host(*arguments) == COMPILED_STEPS
    return partial(host, *arguments)


def main() -> None:
    """Print the table."""
    options = command_line(__doc__, repeats=9, readme=True).parse_args()
    given = scene("example2")
    rows: list[tuple[str, Callable[[], tuple[float]]]] = []
    for rank in RANKS:
        modes = sines(rank)
        guy = cp.condensed.prepare(given, modes, step=RUN_STEP)
        end, velocity = guy.end_position, np.zeros(2)
        guy.step(end, velocity, STEP)
        host = compiled_host(guy)
        step = partial(guy.step, end, velocity, STEP)
        rows.append((f"step from Python, r = {rank}", partial(seconds_per_call, step, CALLS)))
        rows.append((f"step from compiled code, r = {rank}", partial(seconds_per_call, host, 1, COMPILED_STEPS)))
        short = cp.condensed.prepare(given.assign(time_duration=RUN_STEP, time_interval=RUN_STEP), modes, step=RUN_STEP)
        for name, model in (("one step", short), (f"{124 / RUN_STEP:.0f} steps", guy)):
            model.run()
            rows.append((f"run of {name}, r = {rank}", partial(seconds_per_call, model.run, CALLS // 10)))
    results = in_turns([job for _, job in rows], options.repeats)
    lines = [[name, f"{1e6 * medians(result)[0]:.3g} µs"] for (name, _), result in zip(rows, results, strict=True)]
    table = markdown_table(["prepared model", "CPU time"], lines)
    show_table("prepared", table, HERE if options.readme else None)
    print(f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
