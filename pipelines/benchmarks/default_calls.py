"""Measure whole default calls of the reduced models beside the fastest chain that errs no more.

    python pipelines/benchmarks/default_calls.py [--repeats 9] [--readme]

Examples 2 to 4, positions at the scene's 125 instants, one thread, CPU time, medians of calls in turns, compilation and a
warm-up left out. Errors are those of the same calls at every 0.1 s, against the converged continuous cable by the law of the
model (the Galerkin model has law (21), all others the linear one). The modes (r = 2) come from the chain of 40 links
converged in time, whose error in space is in the table too, and which the reduced models share. The reduced models run as
``simulate(scene, modes, rank=2)``, error estimate included. The chain runs as ``simulate(scene, links=, tolerance=, scheme=,
outputs=("position",))`` for all combinations of LINKS, TOLERANCES and its schemes, and the fastest one is named whose error
is no larger than that of the model. The time error of a model is its distance from its own run with an eighth of the explicit
limit (Galerkin), or with a tolerance of 1e-7 (condensed).
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, in_turns, markdown_table, show_table

import cablepod as cp
from cablepod.examples import scene as shipped

HERE = Path(__file__).resolve().parent
TIMES = np.arange(1241) / 10.0
#: Elements of the continuous cable, whose error is below 1e-5 in these scenes, and points at which it is given.
ELEMENTS, POINTS = 4, 201
LINKS = (5, 8, 10, 13, 15, 20, 26, 30, 32, 40)
TOLERANCES = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4)
SCHEMES = (None, "velocity_verlet", "trapezoidal", "generalized_alpha", "energy_momentum")


def cpu_time(job: Callable[[], xr.Dataset]) -> float:
    """Return the CPU time of a call [s]."""
    begin = time.process_time()
    job()
    return time.process_time() - begin


def cable_of(scene: xr.Dataset, law: str, times: np.ndarray) -> xr.Dataset:
    """Return the converged continuous cable at times [s]."""
    return cp.cable.simulate(
        scene, law=law, elements=ELEMENTS, times=times, points=POINTS, tolerance=1e-6, outputs=("position",)
    )


def error_of(run: xr.Dataset, truth: xr.Dataset) -> float:
    """Return the largest rms distance over time as a fraction of the motion."""
    return float(cp.compare.errors(run, truth)["error_max"])


def chains_of(scene: xr.Dataset, truth: xr.Dataset) -> list[tuple[float, str, Callable[[], xr.Dataset]]]:
    """Return error, name and call of the chains."""
    found = []
    for links, tolerance, scheme in itertools.product(LINKS, TOLERANCES, SCHEMES):
        call = partial(
            cp.chain.simulate,
            scene,
            links=links,
            tolerance=tolerance,
            scheme=scheme,
            outputs=("position",),
        )
        try:
            error = error_of(call(times=TIMES), truth)
        except cp.RunStopped:  # long steps may break down
            continue
        found.append((error, f"n = {links}, {tolerance:g}, {scheme or 'default'}", call))
    return found


def rows_of(name: str, repeats: int) -> list[list[str]]:
    """Return the rows of one example."""
    scene = shipped(name)
    snapshots = cp.chain.simulate(scene, links=40, times=TIMES, tolerance=1e-7)
    separate, normal = cp.pod.decompose(snapshots), cp.pod.decompose(snapshots, layout="normal")
    truth, green = cable_of(scene, "linear", TIMES), cable_of(scene, "green", TIMES)
    models = {
        "galerkin": (
            partial(cp.galerkin.simulate, scene, separate, rank=2),
            {"scheme": "velocity_verlet", "part": 0.125},
        ),
        "condensed": (partial(cp.condensed.simulate, scene, normal, rank=2), {"tolerance": 1e-7}),
    }
    chains, rows = chains_of(scene, truth), []
    of_links = error_of(snapshots, truth)
    for model, (call, options) in models.items():
        run = call(times=TIMES)
        part = options.pop("part", None)
        exact = call(times=TIMES, **options, **({} if part is None else {"step": part * run.attrs["step_limit"]}))
        error, time_error = error_of(run, green if model == "galerkin" else truth), error_of(run, exact)
        rivals = [chain for chain in chains if chain[0] <= error]
        # a first round picks the ten that may be the fastest
        first = [min(in_turns([partial(cpu_time, chain[2])], 2)[0]) for chain in rivals]
        rivals = [rivals[k] for k in np.argsort(first)[:10]]
        jobs = [call, *(chain[2] for chain in rivals)]
        seconds = [float(np.median(part)) for part in in_turns([partial(cpu_time, job) for job in jobs], repeats)]
        best = int(np.argmin(seconds[1:]))
        own, rival = 1e3 * seconds[0], 1e3 * seconds[1 + best]
        row = [
            name,
            model,
            f"{own:.1f}",
            f"{error:.1e}",
            f"{run.attrs['error_estimate']:.1e}",
            f"{of_links:.1e}",
            f"{time_error / error:.3f}",
        ]
        row += [
            run.attrs["scheme"],
            f"{run.attrs['step']:.3g}",
            f"{rival:.1f}",
            f"{rivals[best][0]:.1e}",
            rivals[best][1],
        ]
        rows.append([*row, f"{own / rival:.3f}"])
    return rows


def main() -> None:
    """Print the table."""
    options = command_line(__doc__, repeats=9, readme=True).parse_args()
    head = [
        "scene",
        "model",
        "call [ms]",
        "error",
        "estimate of the modes",
        "error of 40 links",
        "time error / error",
        "scheme",
        "step [s]",
    ]
    head += ["chain [ms]", "its error", "links, tolerance, scheme", "model / chain"]
    rows = [row for number in (2, 3, 4) for row in rows_of(f"example{number}", options.repeats)]
    show_table("default_calls", markdown_table(head, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
