"""Run light lines in wind by every scheme of chain, cable and condensed model, with the steps that they choose.

    python pipelines/stability/light_lines.py [--quick] [--readme]

Lines of 1e-3 to 50 kg/m from the ground to 50 m height, 30 m aside, in 0 to 80 m/s: steady, rising in a second, in gusts; 3 s.
Below 50 g/m they are of fibre (3 GPa, 1000 kg/m3), else of steel; the tension at the top is three times the weight and at least
10 N.  Every run is a default call but for the scheme.  Errors in time are those against velocity Verlet with a tolerance of 1e-6,
of the position as a fraction of the largest displacement (or of a millimetre), of tensions as a fraction of the largest one.
The condensed model, with four vibration modes of each direction, and the cable have no such reference here: they must end, and
their own estimates count.
"""

from __future__ import annotations

import itertools
import math
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, show_table

import cablepod as cp

#: Mass per length [kg/m], speed of the wind [m/s], numbers of links, kinds of wind.
MASSES, SPEEDS, LINKS = (1e-3, 1e-2, 0.1, 1.0, 10.0, 50.0), (0.0, 20.0, 40.0, 80.0), (5, 20, 80)
KINDS: dict[str, dict[str, Any]] = {
    "steady": {}, "ramp": {"ramp": 1.0}, "gusts": {"turbulence": {"spectrum": "kaimal", "seed": 3}},
}  # fmt: skip
#: Below this mass per length lines are of fibre [kg/m].
FIBRE = 0.05
#: Links of the scenes that cable and condensed model take.
LINKS_OF_OTHERS = 20
#: Least displacement [m] by which errors are divided.
LEAST_MOTION = 1e-3


def scene_of(mass: float, speed: float, links: int, kind: str) -> xr.Dataset:
    """Make a scene; masses in kg/m, speeds in m/s."""
    density, modulus = (1000.0, 3e9) if mass < FIBRE else (7850.0, 1.6e11)
    area = mass / density
    return cp.make_scene(
        {
            "title": f"{mass:g} kg/m in {speed:g} m/s",
            "cable": {
                "area": area, "youngs_modulus": modulus, "density": density, "diameter": math.sqrt(4.0 * area / math.pi),
                "top_tension": max(10.0, 3.0 * mass * 9.81 * 60.0),
            },
            "ends": {"lower": [0.0, 1.0, 0.0], "upper": [30.0, 51.0, 0.0]},
            "wind": {"speed": speed, "direction": [1.0, 0.0, 0.0], "profile": "uniform", **KINDS[kind]},
            "chain": {"links": links},
            "time": {"duration": 3.0, "interval": 0.05},
        }
    )  # fmt: skip


def timed(run: Callable[[], xr.Dataset]) -> tuple[xr.Dataset | None, list[str], float]:
    """Return the result, None if the run stopped, the names of its warnings, and its run time [s]."""
    begin = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result: xr.Dataset | None = run()
        except (cp.RunStopped, cp.SceneError) as error:
            print(f"    {type(error).__name__}: {error}")
            result = None
    return result, [warning.category.__name__ for warning in caught], time.perf_counter() - begin


def errors(result: xr.Dataset, truth: xr.Dataset) -> tuple[float, float]:
    """Return the largest rms distance over the largest rms displacement, and the largest rms difference of tensions over T."""
    x, y = result["position"].values, truth["position"].values
    gap, motion = (np.sqrt((difference**2).sum(axis=-1).mean(axis=-1)).max() for difference in (x - y, y - y[:1]))
    tension, true_tension = result["tension"].values, truth["tension"].values
    of_tension = np.sqrt(((tension - true_tension) ** 2).mean(axis=-1)).max() / true_tension.max()
    return float(gap / max(motion, LEAST_MOTION)), float(of_tension)


def runs_of(scene: xr.Dataset, links: int) -> dict[str, Callable[[], xr.Dataset]]:
    """Return the runs of a scene by the names of their rows."""
    chains = ("velocity_verlet", "trapezoidal", "generalized_alpha", "energy_momentum")
    runs: dict[str, Callable[[], xr.Dataset]] = {"chain, default": lambda: cp.chain.simulate(scene)}
    for name in chains:
        runs[f"chain, {name}"] = lambda name=name: cp.chain.simulate(scene, scheme=name)  # type: ignore[misc]
    if links == LINKS_OF_OTHERS:
        runs["cable, default"] = lambda: cp.cable.simulate(scene)
        runs["condensed, default"] = lambda: cp.condensed.simulate(
            scene, cp.condensed.vibration_modes(scene, rank=4), outputs=("position", "tension", "error_estimate")
        )
    return runs


def table_of(rows: dict[str, list[tuple[Any, ...]]]) -> str:
    """Return the table of the page: a row for each model and scheme."""
    lines = []
    for name, found in rows.items():
        ended = [row for row in found if row[0]]
        position, tension = (np.array([row[k] for row in ended if row[k] is not None]) for k in (1, 2))
        shown = (
            ("", "", "") if position.size == 0
            else (f"{position.max():.1e}", f"{(position <= 1e-4).mean() * 100:.0f} %", f"{tension.max():.1e}")
        )  # fmt: skip
        warned = sum("NotConvergedWarning" in row[3] for row in ended)
        lines.append(
            [name, f"{len(ended)} of {len(found)}", *shown, str(warned), f"{max(row[4] for row in found):.1f} s"]
        )
    head = ["model, scheme", "runs that end", "largest error", "within 10⁻⁴", "of tensions", "warnings", "longest"]
    return markdown_table(head, lines)


def main() -> None:
    """Run the scenes and print the table."""
    parser = command_line(__doc__, readme=True, quick="two masses, one speed, chains of 5 and 20 links, no gusts")
    arguments = parser.parse_args()
    masses, speeds, links, kinds = MASSES, SPEEDS, LINKS, tuple(KINDS)
    if arguments.quick:
        masses, speeds, links, kinds = (1e-3, 1.0), (40.0,), (5, 20), ("steady", "ramp")
    for run in runs_of(scene_of(1e-3, 20.0, LINKS_OF_OTHERS, "ramp"), LINKS_OF_OTHERS).values():
        timed(run)  # compiled before it is timed
    rows: dict[str, list[tuple[Any, ...]]] = {}
    for mass, speed, n, kind in itertools.product(masses, speeds, links, kinds):
        scene = scene_of(mass, speed, n, kind)
        truth = timed(lambda scene=scene: cp.chain.simulate(scene, scheme="velocity_verlet", tolerance=1e-6))[0]
        for name, run in runs_of(scene, n).items():
            result, warned, seconds = timed(run)
            pair = (None, None) if result is None or truth is None or "chain" not in name else errors(result, truth)
            rows.setdefault(name, []).append((result is not None, *pair, warned, seconds))
            if result is None or warned:
                what = f"{mass:g} kg/m, {speed:g} m/s, {n} links, {kind}, {name}"
                print(f"{what}: {pair} {sorted(set(warned))} {seconds:.2f} s")
    show_table("light lines", table_of(rows), Path(__file__).parent if arguments.readme else None)


if __name__ == "__main__":
    main()
