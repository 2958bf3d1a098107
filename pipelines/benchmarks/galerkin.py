"""Error against run time of the Galerkin model and of coarser chains, against the chain of 40 links, Examples 2 to 4.

    python pipelines/benchmarks/models.py [--repeats 5]

Online time of one whole call with a given step, and of its compiled kernel alone, 125 s, positions at every 0.1 s, one thread;
compilation and a warm-up lie outside; medians.  Offline cost of the reduced models, the snapshots and the decomposition, is
printed beside.  Explicit chains take 0.9 of their limit, explicit Galerkin models the largest step, halved from there, that adds
less than a tenth to their error; implicit ones the steps in the table.
Errors are those of cablepod.compare over every 0.1 s; the chain's law is the linear one, the Galerkin model has law (21).
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import cablepod as cp
from cablepod.kernels import chain as chain_kernel
from cablepod.kernels import implicit as implicit_kernel
from cablepod.kernels import reduced as reduced_kernel
from cablepod.links import chain_of
from cablepod.parameters import parameters

SCENES = Path(__file__).resolve().parent.parent.parent / "data" / "scenes"
TIMES = np.arange(1251) / 10.0
KERNELS = (
    (chain_kernel, "verlet"),
    (implicit_kernel, "generalized_alpha"),
    (reduced_kernel, "verlet"),
    (reduced_kernel, "implicit"),
)
SPENT = [0.0]
IMPLICIT = ("trapezoidal", "energy_momentum")
STEPS = (0.01, 0.02, 0.05, 0.1, 0.25, 0.5)


def watch_kernels() -> None:
    """Let the compiled kernels add the time that they take to SPENT."""

    def watched(kernel: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any) -> Any:
            begin = time.perf_counter()
            result = kernel(*arguments)
            SPENT[0] += time.perf_counter() - begin
            return result

        return run

    for module, name in KERNELS:
        setattr(module, name, watched(getattr(module, name)))


def timed(job: Callable[[], xr.Dataset], repeats: int) -> tuple[xr.Dataset, float, float]:
    """Return result and median time [s] of a job and of its kernel, after one run outside."""
    result = job()
    seconds, kernels = [], []
    for _ in range(repeats):
        SPENT[0] = 0.0
        begin = time.perf_counter()
        result = job()
        seconds.append(time.perf_counter() - begin)
        kernels.append(SPENT[0])
    return result, statistics.median(seconds), statistics.median(kernels)


def largest_step(run: Callable[[float], xr.Dataset], limit: float, truth: xr.Dataset) -> float:
    """Largest step, halving from the stability limit, at which time adds less than a tenth to the error."""
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


def main() -> None:
    """Print a table for each example."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    watch_kernels()
    for number in (2, 3, 4):
        scene = cp.read_scene(SCENES / f"example{number}.toml")
        truth = cp.chain.simulate(scene, times=TIMES)
        begin = time.perf_counter()
        snapshots = cp.chain.simulate(scene, step=0.9 * truth.attrs["step_limit"])
        modes = cp.pod.decompose(snapshots, rank=8)
        offline = time.perf_counter() - begin
        print(f"\nExample {number}; offline cost of the modes {1e3 * offline:.0f} ms")
        print(
            f"{'model':<28}{'largest error':>15}{'step [s]':>11}{'call [ms]':>11}{'kernel [ms]':>13}{'energy defect':>15}"
        )
        for links in (5, 10, 20, 40):
            limit = chain_of(parameters(scene), links).step_limit()

            def chain(step: float, links: int = links, scene: xr.Dataset = scene) -> xr.Dataset:
                return cp.chain.simulate(scene, links=links, times=TIMES, step=step)

            show(f"chain n={links}", chain, 0.9 * limit, truth, repeats)
        for links, step in ((10, 0.5), (20, 0.2), (40, 0.1), (40, 0.02)):

            def implicit(step: float, links: int = links, scene: xr.Dataset = scene) -> xr.Dataset:
                return cp.chain.simulate(scene, links=links, times=TIMES, step=step, scheme="trapezoidal")

            show(f"implicit n={links}", implicit, step, truth, repeats)
        for rank in (1, 2, 3, 4, 8):
            limit = cp.galerkin.simulate(scene, modes, rank=rank, times=[0.0], step=1e-6).attrs["step_limit"]

            for scheme in cp.galerkin.SCHEMES:

                def model(
                    step: float,
                    rank: int = rank,
                    scene: xr.Dataset = scene,
                    modes: xr.Dataset = modes,
                    scheme: str = scheme,
                ) -> xr.Dataset:
                    return cp.galerkin.simulate(scene, modes, rank=rank, times=TIMES, step=step, scheme=scheme)

                steps = STEPS if scheme in IMPLICIT else (largest_step(model, limit, truth),)
                for step in steps:
                    show(f"Galerkin r={rank} {scheme}", model, step, truth, repeats)


def show(name: str, run: Callable[[float], xr.Dataset], step: float, truth: xr.Dataset, repeats: int) -> None:
    """Print one row; a coarser chain has other particles, so the truth is interpolated to them."""
    result, seconds, kernel = timed(lambda: run(step), repeats)
    error = float(cp.compare.errors(result, truth).error_max)
    defect = f"{result.attrs['energy_defect']:>15.1e}" if "energy_defect" in result.attrs else ""
    print(
        f"{name:<28}{100 * error:>13.4f} %{step:>11.3g}{1e3 * seconds:>11.1f}{1e3 * kernel:>13.2f}{defect}", flush=True
    )


if __name__ == "__main__":
    main()
