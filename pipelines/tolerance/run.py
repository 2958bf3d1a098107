"""Compare the time error of chains of random scenes with the tolerance asked for.

    python pipelines/tolerance/run.py [--scenes 250] [--seed 1] [--readme]

Each scene runs by each scheme with each tolerance, with one output instant (the last) and with many.  The step that was chosen is
then run at 401 instants and compared with a truth: velocity Verlet with a 64th of the stability limit and the same links,
confirmed by half that step.  Scenes whose truth is not confirmed to a fifth of the smallest tolerance are left out, as chaotic.
Counted are errors of the motion above the tolerance and above three times the tolerance, of runs that did not warn.
"""

from __future__ import annotations

import itertools
import sys
import warnings
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, show_table

import cablepod as cp

SCHEMES = (None, "velocity_verlet", "trapezoidal", "generalized_alpha", "energy_momentum")
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
DURATION, INSTANTS = 4.0, 401
HERE = Path(__file__).parent


def random_scene(rng: np.random.Generator) -> xr.Dataset:
    """Return a random scene: chord, sag, stiffness, links, end motions, damping."""
    chord = rng.uniform(5.0, 50.0)
    angle = rng.uniform(0.0, 1.3)
    weight = 9.81 * rng.uniform(0.5, 2.0)
    tension = weight * chord * 10.0 ** rng.uniform(-0.3, 1.5)
    stiffness = tension * 10.0 ** rng.uniform(1.5, 3.5)
    period = 10.0 ** rng.uniform(-0.3, 0.8)
    size = chord * tension / stiffness * 10.0 ** rng.uniform(-1.0, 0.3)
    motions: list[dict[str, Any]] = [
        {"kind": "one_minus_cosine", "amplitude": size / 2.0, "angular_frequency": 2.0 * np.pi / period},
        {"kind": "harmonic", "amplitude": size, "angular_frequency": 2.0 * np.pi / period},
        {"kind": "harmonic", "amplitude": size, "angular_frequency": 2.0 * np.pi / period, "ramp": 1.0},
        {"kind": "ramp", "amplitude": size, "duration": period},
    ]
    mapping: dict[str, Any] = {
        "cable": {
            "youngs_modulus": stiffness / 1e-4,
            "area": 1e-4,
            "density": weight / 9.81 / 1e-4,
            "top_tension": tension + weight * chord * np.sin(angle),
        },
        "ends": {"lower": [0.0, 0.0], "upper": [chord * np.cos(angle), chord * np.sin(angle)]},
        "motion": {"upper": {str(rng.choice(["x", "y"])): motions[rng.integers(len(motions))]}},
        "chain": {"links": int(rng.integers(4, 17))},
        "time": {"duration": DURATION, "interval": 0.1},
    }
    if rng.random() < 0.3:
        mapping["damping"] = {"mass_proportional": rng.uniform(0.1, 2.0)}
    return cp.make_scene(mapping)


def error_of(run: xr.Dataset, truth: xr.Dataset) -> float:
    """Return the largest rms distance over time as a fraction of the motion."""
    return float(cp.compare.errors(run, truth)["error_max"])


def entry(found: list[tuple[float, bool]]) -> str:
    """Write the runs above the tolerance, the largest error over it, both without a warning, and the runs that warned."""
    silent = np.array([ratio for ratio, warned in found if not warned])
    warned = sum(warned for _, warned in found)
    return f"{int((silent > 1.0).sum())} of {silent.size}, {silent.max(initial=0.0):.2g}" + f" ({warned} warned)" * (
        warned > 0
    )


def main() -> None:
    """Run the study and print its table."""
    parser = command_line(__doc__, readme=True)
    parser.add_argument("--scenes", type=int, default=250)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, dense = np.random.default_rng(options.seed), np.linspace(0.0, DURATION, INSTANTS)
    found: dict[tuple[Any, ...], list[tuple[float, bool]]] = {}
    used = 0
    warnings.simplefilter("ignore")
    for number in range(options.scenes):
        try:
            scene = random_scene(rng)
            limit = cp.chain.simulate(scene, times=[0.0], scheme="velocity_verlet", outputs=("position",)).attrs[
                "step_limit"
            ]
            coarse, truth = (
                cp.chain.simulate(
                    scene, times=dense, scheme="velocity_verlet", step=limit / part, outputs=("position",)
                )
                for part in (64.0, 128.0)
            )
        except (cp.SceneError, cp.RunStopped):
            continue
        if error_of(coarse, truth) > 0.2 * min(TOLERANCES):
            continue
        used += 1
        for scheme, tolerance, many in itertools.product(SCHEMES, TOLERANCES, (False, True)):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                try:
                    run = cp.chain.simulate(
                        scene,
                        times=dense if many else [DURATION],
                        scheme=scheme,
                        tolerance=tolerance,
                        outputs=("position",),
                    )
                    if not many:
                        same = {"scheme": run.attrs["scheme"], "step": run.attrs["step"], "outputs": ("position",)}
                        run = cp.chain.simulate(scene, times=dense, **same)
                except cp.RunStopped:
                    continue
            warned = any(issubclass(item.category, cp.NotConvergedWarning) for item in caught)
            ratio = error_of(run, truth) / tolerance
            found.setdefault((scheme, tolerance, many), []).append((ratio, warned))
            if ratio > 3.0 and not warned:
                print(f"scene {number}: {scheme}, {tolerance:g}, {'many' if many else 'one'}: {ratio:.3g}", flush=True)
    print(f"{used} of {options.scenes} scenes, seed {options.seed}")
    head = ["scheme", "output instants", *(f"{tolerance:g}" for tolerance in TOLERANCES)]
    rows = [
        [
            scheme or "chosen",
            "many" if many else "one",
            *(entry(found[scheme, tolerance, many]) for tolerance in TOLERANCES),
        ]
        for scheme in SCHEMES
        for many in (False, True)
    ]
    show_table("errors", markdown_table(head, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
