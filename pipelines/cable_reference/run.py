"""Compute the truth files: the continuous cable, converged to 1e-6 of the motion.

    python pipelines/cable_reference/run.py [--out data/truth] [--only example2 ...] [--laws green linear]

Five scenes, both laws.  Each scene is run with 8, 16, 24 and 32 elements of order 7 by velocity Verlet, each at 0.85 of its
stability limit, so that the step shrinks with the elements.  The last run is kept, at 41 particles and every 2 s, with a
table: elements, step, and the maximum distance from the last run (rms over particles, over the maximum rms displacement).  The
last row of the table but one is the difference of two resolutions, which bounds the error of the last.  About ten minutes in
all on one core.
"""

from __future__ import annotations

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from _study import command_line

import cablepod as cp
from cablepod.cable._mesh import mesh_of
from cablepod.cable._runs import ExplicitCableRun
from cablepod.cable._start import start
from cablepod.conventions import label
from cablepod.discretisation._laws import LAWS
from cablepod.examples import data_folder, scene
from cablepod.integrate._output_times import preferred_steps_per_second
from cablepod.parameters._from_scene import parameters

SCENES = ("example2", "example3", "example4", "sagging", "stiff_spatial")
ELEMENTS = (8, 16, 24, 32)
INTERVAL = 2.0  # s
GOAL = 1e-6


def step_of(given, elements: int, law: str) -> float:
    """Return 0.85 of the stability limit [s], rounded so that steps hit the instants."""
    mesh = mesh_of(parameters(given), elements, None, law)
    shape = start(mesh)
    run = ExplicitCableRun(mesh, shape, times=np.array([0.0, float(given["time_duration"])]))
    limit = run.unforced_step / (0.8 if law == "green" else 0.9)
    return 1.0 / preferred_steps_per_second(1.0 / (0.85 * limit))


def truth(name: str, law: str):
    """Run a scene at all resolutions; return the last run with the table of convergence."""
    given = scene(name)
    times = np.arange(0.0, float(given["time_duration"]) + 1e-9, INTERVAL)
    steps = [step_of(given, count, law) for count in ELEMENTS]
    runs = [
        cp.cable.simulate(given, elements=count, step=step, law=law, times=times, points=41)
        for count, step in zip(ELEMENTS, steps, strict=True)
    ]
    best = runs[-1]
    errors = [float(cp.compare.errors(run, best)["error_max"]) for run in runs[:-1]] + [np.nan]
    result = best.assign(
        convergence_elements=("resolution", np.array(ELEMENTS, dtype=np.int64)),
        convergence_step=("resolution", np.array(steps)),
        convergence_error=("resolution", np.array(errors)),
    )
    label(
        result,
        convergence_elements=("1", "number of elements"),
        convergence_step=("s", "time step"),
        convergence_error=("1", "largest rms distance from the last resolution over the largest rms displacement"),
    )
    result.attrs["title"] = f"{best.attrs['title']}: truth"
    return result


def main() -> None:
    """Write the files and print the tables."""
    parser = command_line(__doc__, out=data_folder() / "truth")
    parser.add_argument("--only", nargs="+", default=SCENES, choices=SCENES)
    parser.add_argument("--laws", nargs="+", default=LAWS[::-1], choices=LAWS)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.only:
        for law in options.laws:
            result = truth(name, law)
            errors = result["convergence_error"].values
            cp.archive.write(result, options.out / f"{name}_{law}.nc", overwrite=True)
            rows = zip(ELEMENTS, result["convergence_step"].values, errors, strict=True)
            print(f"{name}, {law}: smallest stretch {result.attrs['smallest_stretch']:.8f}")
            for count, step, error in rows:
                print(f"  {count:>3} elements, step {step:.3g} s: {error:.1e}", flush=True)
            if not errors[-2] <= GOAL:
                raise SystemExit(f"{name}, {law}: two resolutions differ by {errors[-2]:.1e} of the motion")


if __name__ == "__main__":
    main()
