"""Measure error and run time of the Galerkin model and of coarser chains.

    python pipelines/benchmarks/galerkin.py [--repeats 5] [--readme]

Examples 2 to 4; the truth is the converged continuous cable, by the law of each model. Online time of one whole call with a
given step, and of its compiled kernel alone, 125 s, positions at every 0.1 s, one thread; compilation and a warm-up are left
out; medians. The offline cost of the reduced models, snapshots and decomposition, stands beside. Explicit chains take 0.9 of
their limit, explicit Galerkin models the largest step, halved from there, that adds less than a tenth to their error;
the trapezoidal rule the steps in the table. Errors are those of cablepod.compare over every 0.1 s; the chain's law is the linear
one, the Galerkin model has law (21). The modes come from the chain of 40 links.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, in_turns, markdown_table, medians, show_table, time_inside, timed

import cablepod as cp
from benchmarks.default_calls import cable_of
from cablepod.discretisation._chain import chain_of
from cablepod.examples import scene as shipped
from cablepod.galerkin import _scheme as galerkin_scheme
from cablepod.parameters._from_scene import parameters

HERE = Path(__file__).resolve().parent
TIMES = np.arange(1251) / 10.0
KERNELS = (
    "cablepod.chain._kernels_explicit.verlet",
    "cablepod.chain._kernels_implicit.implicit",
    "cablepod.galerkin._kernels_explicit.verlet",
    "cablepod.galerkin._kernels_implicit.implicit",
)
STEPS = (0.01, 0.02, 0.05, 0.1, 0.25, 0.5)


def run_times(job: Callable[[], xr.Dataset]) -> tuple[float, float]:
    """Return the time of a job and of its kernel [s]."""
    with time_inside(*KERNELS) as kernel:
        _, seconds = timed(job)
    return seconds, kernel.seconds


def largest_step(run: Callable[[float], xr.Dataset], limit: float, truth: xr.Dataset) -> float:
    """Return the largest step that adds less than a tenth to the error.

    It is halved from 0.9 of the stability limit.
    """
    step = 0.9 * limit
    while True:
        errors = []
        for h in (step, step / 2):
            try:
                errors.append(float(cp.compare.errors(run(h), truth).error_max))
            except cp.RunStopped:
                errors.append(np.inf)
        if abs(errors[0] - errors[1]) <= 0.1 * errors[1]:
            return step
        step /= 2


def row_of(name: str, run: Callable[[float], xr.Dataset], step: float, truth: xr.Dataset, repeats: int) -> list[str]:
    """Return one row; the truth is interpolated to the particles of a coarser chain."""
    result = run(step)
    seconds, kernel = medians(in_turns([partial(run_times, partial(run, step))], repeats)[0])
    error = float(cp.compare.errors(result, truth).error_max)
    defect = f"{result.attrs['energy_defect']:.1e}" if "energy_defect" in result.attrs else ""
    return [name, f"{100 * error:.4f} %", f"{step:.3g}", f"{1e3 * seconds:.1f}", f"{1e3 * kernel:.2f}", defect]


def rows_of(scene: xr.Dataset, modes: xr.Dataset, repeats: int) -> list[list[str]]:
    """Return the rows of one example."""
    truth, green = (cable_of(scene, law, TIMES) for law in ("linear", "green"))

    def chain(step: float, **options) -> xr.Dataset:
        return cp.chain.simulate(scene, times=TIMES, step=step, **options)

    def model(step: float, **options) -> xr.Dataset:
        return cp.galerkin.simulate(scene, modes, times=TIMES, step=step, **options)

    rows = []
    for links in (5, 10, 20, 40):
        limit = chain_of(parameters(scene), links).step_limit()
        rows.append(row_of(f"chain n={links}", partial(chain, links=links), 0.9 * limit, truth, repeats))
    for links, step in ((10, 0.5), (20, 0.2), (40, 0.1), (40, 0.02)):
        implicit = partial(chain, links=links, scheme="trapezoidal")
        rows.append(row_of(f"implicit n={links}", implicit, step, truth, repeats))
    for rank in (1, 2, 3, 4, 8):
        limit = cp.galerkin.simulate(scene, modes, rank=rank, times=[0.0], step=1e-6).attrs["step_limit"]
        for scheme in galerkin_scheme.SCHEMES:
            run = partial(model, rank=rank, scheme=scheme)
            steps = STEPS if scheme == "trapezoidal" else (largest_step(run, limit, green),)
            rows += [row_of(f"Galerkin r={rank} {scheme}", run, step, green, repeats) for step in steps]
    return rows


def main() -> None:
    """Print a table for each example."""
    options = command_line(__doc__, repeats=5, readme=True).parse_args()
    for number in (2, 3, 4):
        scene = shipped(f"example{number}")
        limit = chain_of(parameters(scene)).step_limit()
        begin = time.perf_counter()
        snapshots = cp.chain.simulate(scene, step=0.9 * limit)
        modes = cp.pod.decompose(snapshots, rank=8)
        offline = time.perf_counter() - begin
        print(f"\nExample {number}; offline cost of the modes {1e3 * offline:.0f} ms")
        head = [f"Example {number}", "maximum error", "step [s]", "call [ms]", "kernel [ms]", "energy defect"]
        table = markdown_table(head, rows_of(scene, modes, options.repeats))
        show_table(f"galerkin_example{number}", table, HERE if options.readme else None)


if __name__ == "__main__":
    main()
