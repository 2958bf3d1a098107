"""Compare peaks of tension of chain and condensed model with the cable's after starts with a jump and with a ramp.

    python pipelines/starts/run.py [--members 16] [--rank 8] [--ramp 6] [--readme]

A taut guy whose upper end moves by a sine: 16 members of a Latin hypercube over tension, amplitude and angular frequency, 30 s.
The truth is the continuous cable of 16 elements by the chain's law, in the middles of the links; that of 8 shows how well
it is known.  The chain has 64 links, the condensed model of order "inertial" vibration modes, both with a time error of 1e-4.
Without ramp the ends start from rest at their full speed.  Prints one row for each start: axial wave by the jump, errors of the
peaks (median and largest), steps and processor time of the chain.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, percent, show_table

import cablepod as cp
from cablepod.integrate._velocity_jump import wave_tensions
from cablepod.parameters._from_scene import Members

HERE = Path(__file__).resolve().parent
RANGES = {
    "cable.top_tension": [8000.0, 20000.0],
    "motion.upper.x.amplitude": [0.01, 0.03],
    "motion.upper.x.angular_frequency": [0.5, 4.0],
}
TOLERANCE, LINKS, DURATION = 1e-4, 64, 30.0
#: Elements of the truth and its step [s]; half as many take twice the step.
ELEMENTS, STEP = 16, 2.5e-5
HEAD = (
    "start", "axial wave / tension at rest", "error of the peaks, condensed model", "chain", "cable of 8 elements",
    "steps of the chain, median", "its processor time [s]", "of the condensed model [s]",
)  # fmt: skip


def scene(ramp: float) -> xr.Dataset:
    """Return the guy, with a ramp [s] or none for 0."""
    sine = {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 2.0}
    return cp.make_scene(
        {
            "title": "Guy with a sine",
            "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 15000.0},
            "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
            "motion": {"upper": {"x": sine | ({"ramp": ramp} if ramp else {})}},
            "time": {"duration": DURATION, "interval": 0.1},
            "chain": {"links": LINKS},
        }
    )


def cable(scenes: xr.Dataset, elements: int) -> xr.Dataset:
    """Return the continuous cable of scenes."""
    step = STEP * ELEMENTS / elements
    outputs = ("position", "tension_extremes")
    return cp.cable.simulate(
        scenes, law="linear", elements=elements, step=step, points=LINKS + 1, outputs=outputs, times=[0.0, DURATION]
    )


def study(ramp: float, members: int, rank: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[float, float]]:
    """Return waves over tensions at rest, errors of the peaks, steps of the chain (members,), processor times [s].

    The errors (3, members) are those of the condensed model, the chain and a coarser cable.
    """
    scenes = cp.ensemble.design(scene(ramp), RANGES, members=members, seed=1)
    modes = cp.condensed.vibration_modes(scene(ramp), rank=rank)
    options = {"tolerance": TOLERANCE, "outputs": ("position", "tension_extremes")}
    begin = time.process_time()
    chain = cp.chain.simulate(scenes, **options)
    middle = time.process_time()
    model = cp.condensed.simulate(scenes, modes, order="inertial", **options)
    times = middle - begin, time.process_time() - middle
    runs = (model, chain, cable(scenes, ELEMENTS // 2), cable(scenes, ELEMENTS))
    *peaks, true = (run.tension_maximum.max("link").values for run in runs)
    waves = np.array([waves.max() / rest for waves, rest in map(wave_tensions, Members(scenes))])
    steps = DURATION / chain["step"].values  # a variable, because the members differ in it
    return waves, np.abs(np.array(peaks) / true - 1.0), steps, times


def main() -> None:
    """Compute and print."""
    parser = command_line(__doc__, readme=True)
    parser.add_argument("--members", type=int, default=16)
    parser.add_argument("--rank", type=int, default=8)
    parser.add_argument("--ramp", type=float, default=6.0, help="duration of the smooth start [s]")
    options = parser.parse_args()
    rows = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cp.VelocityJumpWarning)
        study(options.ramp, 2, options.rank)  # compiles
        for ramp in (0.0, options.ramp):
            waves, errors, steps, times = study(ramp, options.members, options.rank)
            wave = f"{percent(waves.min())} to {percent(waves.max())}" if waves.any() else "0"
            spread = [f"{percent(np.median(part))} / {percent(part.max())}" for part in errors]
            texts = (*spread, f"{np.median(steps):.0f}")
            rows.append([f"ramp of {ramp:g} s" if ramp else "jump", wave, *texts, *(f"{value:.1f}" for value in times)])
    show_table("starts", markdown_table(HEAD, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
