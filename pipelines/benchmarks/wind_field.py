"""Time turbulence at many points beside a plain factorisation at every frequency.

    python pipelines/benchmarks/wind_field.py [--repeats 5] [--readme]

Kaimal turbulence at 58 heights, 660 s at 0.1 s, one component, CPU time of one thread, medians in turns.  The plain way
factorises the matrix of cross spectra at each of 3300 frequencies.
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

import numpy as np

import cablepod as cp
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._parameters import Parameters
from cablepod.wind import _turbulence

HERE = Path(__file__).resolve().parent
POINTS, COUNT, INTERVAL, SPEED, ROUGHNESS, DECAY = 58, 6600, 0.1, 25.0, 0.03, 10.0
SCENE = {
    "cable": {"youngs_modulus": 1.6e11, "area": 2.5e-4, "density": 7850.0, "top_tension": 4e4, "diameter": 0.02},
    "ends": {"lower": [0.0, 2.0, 0.0], "upper": [80.0, 120.0, 0.0]},
    "wind": {
        "speed": SPEED, "direction": [0.0, 0.0, 1.0], "profile": "logarithmic", "roughness_length": ROUGHNESS,
        "turbulence": {"spectrum": "kaimal", "seed": 1},
    },
    "time": {"duration": 600.0, "interval": 1.0},
}  # fmt: skip


def plain(height: np.ndarray) -> np.ndarray:
    """Return speeds (point, time) [m/s] along the wind, by a factorisation at each frequency."""
    n = np.arange(1, COUNT // 2) / (COUNT * INTERVAL)
    speed = SPEED * np.log(height / ROUGHNESS) / np.log(10.0 / ROUGHNESS)
    friction = 0.4 * SPEED / np.log(10.0 / ROUGHNESS)
    decay = DECAY * np.abs(height[:, None] - height) / (0.5 * (speed[:, None] + speed))
    phase = np.exp(2j * np.pi * np.random.default_rng(0).random((height.size, n.size)))
    amplitude = np.zeros((height.size, COUNT // 2 + 1), dtype=complex)
    for k in range(n.size):
        f = n[k] * height / speed
        spectrum = friction**2 * 200.0 * f / (1.0 + 50.0 * f) ** (5 / 3) / n[k]
        cross = np.sqrt(np.outer(spectrum, spectrum)) * np.exp(-n[k] * decay)
        amplitude[:, k + 1] = np.linalg.cholesky(cross + 1e-9 * np.diag(np.diag(cross))) @ phase[:, k]
    return np.fft.irfft(amplitude, COUNT, axis=1)


def ours(p: Parameters, place: np.ndarray) -> np.ndarray:
    """Return the speeds (point, time) of the package, with nothing kept of earlier fields."""
    _turbulence._phases.cache_clear()
    return _turbulence.gusts(p.wind, p.turbulence, place, COUNT, INTERVAL, 1, across=[False])[0]


def seconds(job: Callable[[], object]) -> float:
    """Return the CPU time of a call [s]."""
    begin = time.process_time()
    job()
    return time.process_time() - begin


def main() -> None:
    """Print both times and their ratio."""
    options = command_line(__doc__, repeats=5, readme=True).parse_args()
    p = parameters(cp.make_scene(SCENE))
    height = np.linspace(2.0, 120.0, POINTS)
    place = np.column_stack([np.zeros(POINTS), height, np.zeros(POINTS)])
    jobs = [
        lambda: seconds(lambda: plain(height)),
        lambda: seconds(lambda: ours(p, place)),
    ]
    in_turns(jobs, 1)
    base, own = in_turns(jobs, options.repeats)
    values = medians((1e3 * a, 1e3 * b, a / b) for a, b in zip(base, own, strict=True))
    head = ["plain factorisations", "cablepod", f"ratio (medians of {options.repeats})"]
    cells = [f"{values[0]:.0f} ms", f"{values[1]:.0f} ms", f"{values[2]:.1f}"]
    show_table("wind_field", markdown_table(head, [cells]), HERE if options.readme else None)


if __name__ == "__main__":
    main()
