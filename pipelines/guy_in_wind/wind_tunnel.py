"""Compare the chain in a steady wind with MoorDyn, whose water has the density of air.

    python pipelines/guy_in_wind/wind_tunnel.py [--links 20] [--duration 20] [--readme]

A guy whose upper end swings across the wind.  Links, masses, stiffness, drag coefficient and start are the same.  What differs is
made equal: the buoyancy of MoorDyn's water is a load of the chain, and MoorDyn, whose drag acts on the unstretched diameter and
length, gets a drag coefficient larger by the mean strain of the run.  Both take the same step; MoorDyn's end moves at a constant
velocity over each of its calls.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _moordyn import Line, moordyn_of, nodes_of
from _study import command_line, markdown_table, percent, show_table

import cablepod as cp

HERE = Path(__file__).resolve().parent
AREA, STIFFNESS, MASS, DIAMETER, TENSION = 1.25e-4, 2.0e7, 1.0, 0.016, 15000.0
AIR, DRAG, SPEED, GRAVITY = 1.25, 1.2, 20.0, 9.81
AMPLITUDE, OMEGA = 0.5, 2.0  #: of the upper end across the wind [m, rad/s]
STEP, CALL, INTERVAL = 1e-4, 0.005, 0.05  #: of both, of MoorDyn's calls, of the output [s]
DEPTH = 200.0  #: of the lower end below MoorDyn's surface [m]
#: Root mean squares of differences may be these parts of the standard deviations.
POSITION_RTOL, TENSION_RTOL = 1e-4, 1e-3
HEAD = ("", "positions", "tensions", "run time [s]")
CURRENT = """--- steady current ---
uniform
z ux uy uz
-1000 {speed!r} 0 0
0 {speed!r} 0 0
"""


class Tunnel(NamedTuple):
    """Results of both programs."""

    position: np.ndarray  #: of MoorDyn (time, particle, coordinate) [m]
    tension: np.ndarray  #: the same (time, link) [N]
    chain: xr.Dataset
    seconds: tuple[float, float]  #: of MoorDyn's steps, and of the whole call of the chain [s]

    @property
    def errors(self) -> tuple[float, float]:
        """Root mean squares of the differences in positions and tensions over the largest standard deviations."""
        result = []
        for other, own in ((self.position, self.chain.position.values), (self.tension, self.chain.tension.values)):
            result.append(float(np.sqrt(((other - own) ** 2).mean(axis=0)).max() / own.std(axis=0).max()))
        return result[0], result[1]


def scene(links: int, duration: float) -> xr.Dataset:
    """Return the guy; MoorDyn's buoyancy is a load."""
    swing = {"kind": "one_minus_cosine", "amplitude": AMPLITUDE, "angular_frequency": OMEGA}
    buoyancy = AIR * 0.25 * np.pi * DIAMETER**2 * GRAVITY
    cable = {"youngs_modulus": STIFFNESS / AREA, "area": AREA, "density": MASS / AREA, "top_tension": TENSION}
    return cp.make_scene(
        {
            "title": "Guy in a wind tunnel",
            "gravity": GRAVITY,
            "cable": {**cable, "diameter": DIAMETER, "drag_coefficient": DRAG},
            "ends": {"lower": [0.0, 0.0, 0.0], "upper": [20.4, 57.7, 0.0]},
            "chain": {"links": links},
            "load": {"uniform": [0.0, buoyancy, 0.0]},
            "wind": {"speed": SPEED, "direction": [1.0, 0.0, 0.0], "profile": "uniform", "air_density": AIR},
            "motion": {"upper": {"z": swing}},
            "time": {"duration": duration, "interval": INTERVAL},
        }
    )


def compare(links: int, duration: float) -> Tunnel:
    """Run both programs."""
    given = scene(links, duration)
    cp.chain.simulate(given, step=STEP, times=[0.0])  # compiles
    begin = time.perf_counter()
    chain = cp.chain.simulate(given, step=STEP)
    spent = time.perf_counter() - begin
    position, tension, theirs = moordyn(chain)
    return Tunnel(position, tension, chain, (theirs, spent))


def moordyn(chain: xr.Dataset) -> tuple[np.ndarray, np.ndarray, float]:
    """Return positions (time, particle, coordinate) [m] and tensions (time, link) [N] of MoorDyn, and its stepping time [s]."""
    import moordyn as md

    own = chain.position.values
    model, line = _model(chain)
    grid = CALL * np.arange(round(float(chain.time[-1]) / CALL) + 1)
    place = AMPLITUDE * (1.0 - np.cos(OMEGA * grid))
    velocity, upper, every = np.diff(place) / CALL, own[0, -1], round(INTERVAL / CALL)
    position, spent = [_nodes(line, chain)], 0.0
    for i in range(grid.size - 1):
        begin = time.perf_counter()
        md.Step(model, [upper[0], place[i], upper[1] - DEPTH], [0.0, velocity[i], 0.0], grid[i], CALL)
        spent += time.perf_counter() - begin
        if (i + 1) % every == 0:
            position.append(_nodes(line, chain))
    md.Close(model)
    result = np.array(position)
    result[:, -1] = own[:, -1]
    reach = np.sqrt((np.diff(result, axis=1) ** 2).sum(axis=2))
    return result, STIFFNESS * (reach * chain.sizes["link"] / float(chain.unstretched_length) - 1.0), spent


def _nodes(line: Any, chain: xr.Dataset) -> np.ndarray:
    """Return the positions of MoorDyn's nodes in the axes of the chain [m]; its z is up, from the surface."""
    x, y, z = nodes_of(line, chain.sizes["particle"]).T
    return np.stack([x, z + DEPTH, y], axis=1)


def _model(chain: xr.Dataset) -> tuple[Any, Any]:
    """Load the guy at the start of the chain; return system and line."""
    x, y, z = chain.position.values[0].T
    drag = DRAG * (1.0 + float(chain.tension.mean()) / STIFFNESS)
    length = float(chain.unstretched_length)
    guy = Line(np.stack([x, z, y - DEPTH], axis=1), MASS, STIFFNESS, length, (1, 2), DIAMETER, drag)
    water = {"WtrDnsty": AIR, "WtrDpth": 2.0 * DEPTH, "Currents": 1}
    ends = [("Fixed", 0.0), ("Coupled", 0.0)]
    model, (line,) = moordyn_of([guy], ends, STEP, GRAVITY, options=water, current=CURRENT.format(speed=SPEED))
    return model, line


def main() -> None:
    """Compute and print."""
    parser = command_line(__doc__, readme=True)
    parser.add_argument("--links", type=int, default=20)
    parser.add_argument("--duration", type=float, default=20.0, help="[s]")
    options = parser.parse_args()
    tunnel = compare(options.links, options.duration)
    deviations = [f"{float(values.std('time').max()):.3g}" for values in (tunnel.chain.position, tunnel.chain.tension)]
    rows = [
        ["largest standard deviation", f"{deviations[0]} m", f"{deviations[1]} N", ""],
        ["rms difference over it", *(percent(error) for error in tunnel.errors), ""],
        ["MoorDyn", "", "", f"{tunnel.seconds[0]:.1f}"],
        ["cablepod", "", "", f"{tunnel.seconds[1]:.2f}"],
    ]
    show_table("tunnel", markdown_table(HEAD, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
