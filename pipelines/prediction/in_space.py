"""Compare errors of the condensed model with their estimates for guys in space whose ends leave the plane.

    python pipelines/prediction/in_space.py [--scenes COUNT] [--readme] [--quick]

Guys of 2 to 20 kN with chords of 30 to 120 m at 10 to 85 degrees, turned anyhow about the vertical.  Their upper ends move by
harmonics of 0.3 to 2.5 times the first frequency of the taut string, over six of its periods: out of the plane, across the chord
in it, along the chord, or both across.  Amplitudes are 0.002 to 0.02 of the chord; along it, those that change the strain by half
of that at rest.  Every second guy has two parts, a mass, a spring or a damper in any direction.

The model is of order "leading" with the default step, on RANK static and vibration modes of each scene.  The truth is the scene's
chain, whose links the modes share.  Scenes where chain or model go slack are set apart.
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, percent, show_table
from scipy.stats import qmc
from tqdm import tqdm

import cablepod as cp

HERE = Path(__file__).resolve().parent
SCENES, SEED, LINKS, RANK = 64, 1974, 80, 8
#: Cable of the paper's examples, of 1 kg/m: Young's modulus [N/m^2], area [m^2], density [kg/m^3].
CABLE = {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0}
MASS, STIFFNESS = CABLE["density"] * CABLE["area"], CABLE["youngs_modulus"] * CABLE["area"]
MOTIONS = ("out of the plane", "across, in the plane", "along the chord", "both across")
#: What is on the cables, in turn; every second one is bare.
THINGS = ("nothing", "segments", "nothing", "mass", "nothing", "spring", "nothing", "damper")
#: Time error of the chains, and damping ratio of the first vibration (by mass).
TOLERANCE, DAMPING_RATIO = 1e-4, 0.02
#: Largest factor between estimate and error that counts as right.
FACTOR = 3.0


def things_on(name: str, tension: float, chord: float, draw: np.ndarray) -> dict[str, Any]:
    """Return the tables of what is on a cable, from numbers between 0 and 1."""
    if name == "nothing":
        return {}
    place = round(0.05 + 0.9 * float(draw[0]), 3)
    if name == "segments":
        return {"segment": [{"to": place}, {"from": place, "youngs_modulus": 1.1e11, "area": 9e-5, "density": 7000.0}]}
    size = 0.1 * 10.0 ** float(draw[1])  # 0.1 to 1
    if name == "mass":
        return {"attachment": [{"arc_length": place, "mass": 0.3 * size * MASS * chord}]}
    direction = qmc.scale(draw[2:5][None], -1.0, 1.0)[0]
    value = {"spring": 10.0 * size * tension / chord, "damper": 3.0 * size * math.sqrt(tension * MASS)}[name]
    return {
        "attachment": [{"arc_length": place, name: value, "direction": list(direction / np.linalg.norm(direction))}]
    }


def scene_of(number: int, draw: np.ndarray, links: int = LINKS) -> xr.Dataset:
    """Make a scene from its number, which decides motion and things, and numbers between 0 and 1."""
    tension, chord = 2e3 * 10.0 ** draw[0], 30.0 * 4.0 ** draw[1]
    inclination, azimuth = math.radians(10.0 + 75.0 * draw[2]), 2.0 * math.pi * draw[3]
    omega = math.pi / chord * math.sqrt(tension / MASS)
    level, up = np.array([math.cos(azimuth), 0.0, math.sin(azimuth)]), np.array([0.0, 1.0, 0.0])
    along = math.cos(inclination) * level + math.sin(inclination) * up
    across = -math.sin(inclination) * level + math.cos(inclination) * up
    out, size, angle = np.cross(along, across), 0.002 * 10.0 ** draw[4], 2.0 * math.pi * draw[5]
    moved = {
        MOTIONS[0]: size * out,
        MOTIONS[1]: size * across,
        MOTIONS[2]: 0.5 * tension / STIFFNESS * along,
        MOTIONS[3]: size * (math.cos(angle) * across + math.sin(angle) * out),
    }[MOTIONS[number % len(MOTIONS)]]
    sine = {
        "kind": "harmonic",
        "angular_frequency": 0.3 * (2.5 / 0.3) ** draw[6] * omega,
        "ramp": 2.0 * math.pi / omega,
    }
    thing = THINGS[number // len(MOTIONS) % len(THINGS)]
    return cp.make_scene(
        {
            "title": f"guy {number}: {thing}",
            "cable": {**CABLE, "top_tension": tension},
            "ends": {"lower": [0.0, 0.0, 0.0], "upper": list(chord * along)},
            "motion": {"upper": {axis: {**sine, "amplitude": chord * part} for axis, part in zip("xyz", moved, strict=True)}},
            "damping": {"mass_proportional": 2.0 * DAMPING_RATIO * omega},
            "time": {"duration": 12.0 * math.pi / omega, "interval": 0.04 * math.pi / omega},
            "chain": {"links": links},
            **things_on(thing, tension, chord, draw[7:]),
        }
    )  # fmt: skip


def measured(scene: xr.Dataset) -> tuple[float, float]:
    """Return the largest error over time and its estimate; not a number where the cable goes slack."""
    try:
        chain = cp.chain.simulate(scene, tolerance=TOLERANCE, outputs=("position", "tension_extremes"))
        modes = cp.condensed.vibration_modes(scene, rank=RANK, static_modes=True)
        run = cp.condensed.simulate(scene, modes)
    except cp.RunStopped:
        return np.nan, np.nan
    if min(float(chain["tension_minimum"].min()), run.attrs["smallest_chordwise_force"]) < 0.0:
        return np.nan, np.nan
    return float(cp.compare.errors(run, chain)["error_max"]), float(run.attrs["error_estimate"])


def report(scenes: int, links: int = LINKS) -> xr.Dataset:
    """Return ``error (scene)`` and ``error_estimate (scene)`` with the motion and the things of each scene."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of slack, of waves, of coarse links
        draws = qmc.Sobol(12, rng=SEED).random(scenes)
        found = [measured(scene_of(k, draw, links)) for k, draw in enumerate(tqdm(draws, leave=False))]
    error, estimate = np.array(found).T
    numbers = np.arange(scenes)
    return xr.Dataset(
        {"error": ("scene", error), "error_estimate": ("scene", estimate)},
        coords={
            "motion": ("scene", np.array(MOTIONS)[numbers % len(MOTIONS)]),
            "thing": ("scene", np.array(THINGS)[numbers // len(MOTIONS) % len(THINGS)]),
        },
    )


def table_of(result: xr.Dataset) -> str:
    """Write errors and their ratios to the estimates by motion, and by what is on the cable."""
    regular, lines = result.isel(scene=np.flatnonzero(np.isfinite(result["error"].values))), []
    parts = {name: regular["motion"].values == name for name in MOTIONS}
    bare = regular["thing"].values == "nothing"
    parts |= {
        "bare cables": bare,
        "with segments, masses, springs, dampers": ~bare,
        "all": np.ones(bare.size, dtype=bool),
    }
    for name, chosen in parts.items():
        if not chosen.any():
            continue
        error = regular["error"].values[chosen]
        ratio = error / regular["error_estimate"].values[chosen]
        share = np.mean(np.abs(np.log(ratio)) <= math.log(FACTOR))
        spread = " / ".join(percent(value) for value in np.quantile(error, (0.5, 0.95, 1.0)))
        ratios = " / ".join(f"{value:.2g}" for value in np.quantile(ratio, (0.0, 0.5, 1.0)))
        lines.append([name, f"{error.size}", spread, ratios, f"{100.0 * share:.0f} %"])
    head = [
        "scenes", "number", "error: median / 95th percentile / largest", "error over estimate: least / median / largest",
        "within a factor of 3",
    ]  # fmt: skip
    return markdown_table(head, lines)


def main() -> None:
    """Measure, print and write the table."""
    parser = command_line(__doc__, readme=True, quick="four scenes of 20 links")
    parser.add_argument("--scenes", type=int, default=SCENES, help="number of scenes")
    given = parser.parse_args()
    begin = time.perf_counter()
    result = report(4, 20) if given.quick else report(given.scenes)
    show_table("in_space", table_of(result), HERE if given.readme else None)
    apart = int(np.isnan(result["error"]).sum())
    print(f"{apart} of {result.sizes['scene']} scenes go slack, {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
