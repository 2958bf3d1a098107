"""Compare the time error of runs of random scenes with the tolerance asked for.

    python pipelines/tolerance/run.py [--models chain,tension,reduced] [--scenes 250] [--seed 1] [--processes 2]
        [--part FILE] [--readme]

Each scene runs by each scheme with each tolerance, with one output instant (the last) and with many.  The step that was chosen is
then run at 401 instants and compared with a truth: the same equations, with steps so short that their error is below a fifth of
the smallest tolerance, which follows from halving them.  Runs of scenes without such a truth are left out, as chaotic.  Counted
are errors above the tolerance and above three times the tolerance, of runs that did not warn.

``chain`` judges the motion of chains, ``tension`` the larger one of the errors of motion and link tensions where both are asked
for, ``reduced`` the motion of reduced models on three modes.
"""

from __future__ import annotations

import itertools
import json
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, show_table

import cablepod as cp
from cablepod.integrate._comparison import tension_distance

TOLERANCES = {"chain": (1e-2, 1e-3, 1e-4, 1e-5), "tension": (1e-2, 1e-3, 1e-5), "reduced": (1e-2, 1e-3, 1e-5)}
DURATION, INSTANTS, RANK = 4.0, 401, 3
TABLES = {"chain": "errors", "tension": "tensions", "reduced": "reduced"}
#: Maximum error of the truth.
TRUTH = 0.2e-5
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Subject:
    """What runs of one model and one set of outputs promise."""

    name: str
    simulate: Callable[..., xr.Dataset]  #: of scene and modes
    schemes: tuple[str | None, ...]
    #: Scheme of the truth, its least order (2 where ends move abruptly), and steps per stability limit of the explicit scheme,
    #: tried in turn
    truth: tuple[str, float, tuple[float, ...]] = ("velocity_verlet", 2.0, (64.0, 512.0))
    layout: str | None = None  #: of the modes
    outputs: tuple[str, ...] = ("position",)


def _chain(scene: xr.Dataset, _: xr.Dataset | None, **options: Any) -> xr.Dataset:
    return cp.chain.simulate(scene, **options)


def _condensed(order: str) -> Callable[..., xr.Dataset]:
    return lambda scene, modes, **options: cp.condensed.simulate(scene, modes, order=order, **options)


CHAIN_SCHEMES = (None, "velocity_verlet", "trapezoidal", "generalized_alpha", "energy_momentum")
GALERKIN_SCHEMES = (None, "velocity_verlet", "filtered_verlet", "trapezoidal")
EXACT = ("velocity_verlet", 2.0, (200.0, 1000.0))
SUBJECTS = {
    "chain": (Subject("chain", _chain, CHAIN_SCHEMES),),
    "tension": (Subject("chain", _chain, CHAIN_SCHEMES, outputs=("position", "tension")),),
    "reduced": (
        Subject(
            "condensed, leading", _condensed("leading"), (None, "velocity_verlet", "trapezoidal", "numerov"),
            ("numerov", 2.0, (20.0, 60.0, 200.0)), "normal",
        ),
        Subject("condensed, exact", _condensed("exact"), (None, "velocity_verlet", "trapezoidal"), EXACT, "normal"),
        Subject("condensed, inertial", _condensed("inertial"), (None, "velocity_verlet", "trapezoidal"), EXACT, "normal"),
        Subject("galerkin", cp.galerkin.simulate, GALERKIN_SCHEMES, layout="separate"),
    ),
}  # fmt: skip


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
    """Return the largest rms distance over time as a fraction of the motion, or that of the tensions over their range."""
    motion = float(cp.compare.errors(run, truth)["error_max"])
    return (
        max(motion, tension_distance(truth["tension"].values, run["tension"].values)) if "tension" in truth else motion
    )


def truth_of(subject: Subject, scene: xr.Dataset, modes: xr.Dataset | None, dense: np.ndarray) -> xr.Dataset | None:
    """Return a run with very short steps at the instants `dense`; None where none is confirmed."""
    scheme, order, parts = subject.truth
    start = {"times": [0.0], "scheme": "velocity_verlet", "tolerance": 1e-3, "outputs": ("position",)}
    limit = subject.simulate(scene, modes, **start).attrs["step_limit"]
    for part in parts:
        options = {"times": dense, "scheme": scheme, "outputs": subject.outputs}
        coarse, fine = (subject.simulate(scene, modes, step=limit / n, **options) for n in (part, 2.0 * part))
        if error_of(coarse, fine) <= TRUTH * (2.0**order - 1.0):
            return fine
    return None


def judged(model: str, number: int, scene: xr.Dataset | None) -> list[tuple[Any, ...]]:
    """Return (subject, scheme, tolerance, many instants, error over tolerance, warned) of all runs of a scene."""
    warnings.simplefilter("ignore")
    return [] if scene is None else list(_judged(model, number, scene))


def judged_all(model: str, scenes: list[xr.Dataset | None], options: Any) -> list[list[tuple[Any, ...]]]:
    """Return what :func:`judged` gives for each scene; those of the file ``--part`` are read, others are added to it."""
    done: dict[int, list[tuple[Any, ...]]] = {}
    place = [model, options.seed]
    if options.part is not None and options.part.exists():
        for line in options.part.read_text(encoding="utf-8").splitlines():
            of, number, runs = json.loads(line)
            if of == place and number < len(scenes):
                done[number] = [tuple(run) for run in runs]

    def keep(number: int, runs: list[tuple[Any, ...]]) -> None:
        done[number] = runs
        if options.part is not None:
            with options.part.open("a", encoding="utf-8") as file:
                file.write(json.dumps([place, number, runs]) + "\n")

    todo = [number for number in range(len(scenes)) if number not in done]
    if options.processes > 1:
        with ProcessPoolExecutor(options.processes) as pool:
            jobs = {pool.submit(judged, model, number, scenes[number]): number for number in todo}
            for job in as_completed(jobs):
                keep(jobs[job], job.result())
    else:
        for number in todo:
            keep(number, judged(model, number, scenes[number]))
    return [done[number] for number in range(len(scenes))]


def _judged(model: str, number: int, scene: xr.Dataset) -> Iterator[tuple[Any, ...]]:
    dense, modes = np.linspace(0.0, DURATION, INSTANTS), {}
    for subject in SUBJECTS[model]:
        try:
            if subject.layout is not None and subject.layout not in modes:
                options = {"times": np.linspace(0.0, DURATION, 81), "tolerance": 1e-3, "outputs": ("position",)}
                chain = cp.chain.simulate(scene, **options)
                modes[subject.layout] = cp.pod.decompose(chain, layout=subject.layout, rank=RANK)
            given = scene, modes.get(subject.layout)
            truth = truth_of(subject, *given, dense)
        except (cp.SceneError, cp.RunStopped):
            continue
        if truth is None:
            continue
        for scheme, tolerance, many in itertools.product(subject.schemes, TOLERANCES[model], (False, True)):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                try:
                    asked = {"scheme": scheme, "tolerance": tolerance, "outputs": subject.outputs}
                    run = subject.simulate(*given, times=dense if many else [DURATION], **asked)
                    if not many:
                        same = {"scheme": run.attrs["scheme"], "step": run.attrs["step"], "outputs": subject.outputs}
                        run = subject.simulate(*given, times=dense, **same)
                except cp.RunStopped:
                    continue
            warned = any(issubclass(item.category, cp.NotConvergedWarning) for item in caught)
            ratio = error_of(run, truth) / tolerance
            if ratio > 1.0 and not warned:
                told = f"{subject.name}, {scheme}, {tolerance:g}, {'many' if many else 'one'}: {ratio:.3g}"
                print(f"scene {number}: {told}", flush=True)
            yield subject.name, scheme, tolerance, many, ratio, warned


def entry(found: list[tuple[float, bool]]) -> str:
    """Write the runs above the tolerance, the largest error over it, both without a warning, and the runs that warned."""
    silent = np.array([ratio for ratio, warned in found if not warned])
    warned = sum(warned for _, warned in found)
    return f"{int((silent > 1.0).sum())} of {silent.size}, {silent.max(initial=0.0):.2g}" + f" ({warned} warned)" * (
        warned > 0
    )


def main() -> None:
    """Run the study and print its tables."""
    parser = command_line(__doc__, readme=True)
    parser.add_argument("--models", default=",".join(SUBJECTS), help=f"some of {', '.join(SUBJECTS)}")
    parser.add_argument("--scenes", type=int, default=250)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--part", type=Path, metavar="FILE", help="file of the scenes that are done")
    options = parser.parse_args()
    rng, scenes = np.random.default_rng(options.seed), []
    for _ in range(options.scenes):
        try:
            scenes.append(random_scene(rng))
        except cp.SceneError:
            scenes.append(None)
    for model in options.models.split(","):
        found: dict[tuple[Any, ...], list[tuple[float, bool]]] = {}
        begin = time.process_time()
        results = judged_all(model, scenes, options)
        for name, scheme, tolerance, many, ratio, warned in itertools.chain(*results):
            found.setdefault((name, scheme, tolerance, many), []).append((ratio, warned))
        used, spent = sum(map(bool, results)), time.process_time() - begin
        print(f"{model}: {used} of {options.scenes} scenes, seed {options.seed}, {spent:.0f} s of this process")
        silent = [ratio for runs in found.values() for ratio, warned in runs if not warned]
        print(f"{model}: {sum(ratio > 1.0 for ratio in silent)} of {len(silent)} runs without a warning are above")
        several = len(SUBJECTS[model]) > 1
        head = [
            *["model"] * several,
            "scheme",
            "output instants",
            *(f"{tolerance:g}" for tolerance in TOLERANCES[model]),
        ]
        rows = []
        for subject in SUBJECTS[model]:
            for scheme, many in itertools.product(subject.schemes, (False, True)):
                entries = [
                    entry(found.get((subject.name, scheme, tolerance, many), [])) for tolerance in TOLERANCES[model]
                ]
                rows.append([*[subject.name] * several, scheme or "chosen", "many" if many else "one", *entries])
        show_table(TABLES[model], markdown_table(head, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
