"""Compare the guys of a mast under a pulse at its tip with MoorDyn, whose lines get the motion of the mast.

    python pipelines/mast/moordyn_lines.py [--links 20] [--readme]

Needs the extra ``peers`` (MoorDyn).  The mast of ``opensees.py`` with chains as guys moves under its push; nine lines of MoorDyn,
without water, start at the rest of the chains and have their upper ends where the mast moves them.  Written is the largest
difference of the tension of each guy at the mast over the largest change of its tension: worst guy of each level, of chains
with as many links and of condensed guys.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _moordyn import Line, moordyn_of
from _study import command_line, markdown_table, show_table

import cablepod as cp
from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import chain_of
from cablepod.mast._static_guys import StaticGuy
from cablepod.mast._statics import rest_of
from cablepod.parameters._mast import mast_parameters

HERE = Path(__file__).parent
#: Step of MoorDyn, interval in which an upper end keeps its velocity, interval of the output [s].
STEP, CALL, INTERVAL = 2e-4, 0.005, 0.02


def by_moordyn(guys: list[StaticGuy], gravity: float, links: int, moved: np.ndarray) -> tuple[np.ndarray, float]:
    """Return tensions at the mast (outputs, guys) [N] and the stepping time [s], for upper ends moved (calls, guys, 3) [m]."""
    import moordyn as md

    shapes = np.array([rest_shape(chain_of(guy.p, links), None)[0] for guy in guys])[..., [0, 2, 1]]  # z is up
    moved, every = moved[..., [0, 2, 1]], round(INTERVAL / CALL)
    ends = [(kind, 0.0) for _ in guys for kind in ("Fixed", "Coupled")]
    given = [
        Line(shape, guy.p.mass, guy.p.stiffness, guy.length, (2 * g + 1, 2 * g + 2))
        for g, (guy, shape) in enumerate(zip(guys, shapes, strict=True))
    ]
    model, lines = moordyn_of(given, ends, STEP, gravity)
    velocity = np.diff(moved, axis=0) / CALL
    acceleration = np.gradient(np.gradient(moved, CALL, axis=0), CALL, axis=0)
    tensions, spent = [], 0.0
    for i in range(len(moved)):
        if i % every == 0:
            tensions.append(
                [_tension(md, *own, links, gravity, a) for *own, a in zip(lines, guys, acceleration[i], strict=True)]
            )
        if i < len(velocity):
            upper, begin = shapes[:, -1] + moved[i], time.perf_counter()
            md.Step(model, upper.ravel().tolist(), velocity[i].ravel().tolist(), i * CALL, CALL)
            spent += time.perf_counter() - begin
    md.Close(model)
    return np.array(tensions), spent


def _tension(md: Any, line: Any, guy: StaticGuy, links: int, gravity: float, acceleration: np.ndarray) -> float:
    """Return the force on the mast [N]: upper link, weight and inertia of half a link."""
    below, above = (np.array(md.GetLineNodePos(line, j)) for j in (links - 1, links))
    reach, length = above - below, guy.length / links
    present = float(np.linalg.norm(reach))
    half = 0.5 * guy.p.mass * length
    force = -guy.p.stiffness * (present / length - 1.0) * reach / present
    force -= half * (np.array([0.0, 0.0, gravity]) + acceleration)
    return float(np.linalg.norm(force))


def compare(scene: xr.Dataset, links: int) -> list[list[str]]:
    """Return the rows of the table."""
    rest = rest_of(mast_parameters(scene))
    end = float(scene["time_duration"])
    calls = CALL * np.arange(round(end / CALL) + 1)
    times = INTERVAL * np.arange(round(end / INTERVAL) + 1)
    chain = cp.mast.simulate(scene, guys="chain", links=links, times=calls)
    moved = chain["displacement"].sel(level=chain["guy_level"]).transpose("time", "guy", "coordinate").values
    theirs, spent = by_moordyn(rest.bare, rest.p.gravity, links, moved)
    change, level = theirs - theirs[0], chain["guy_level"].values
    rows = []
    for name, options in (
        (f"chain, {links} links", {"guys": "chain", "links": links}), ("condensed, r = 4", {"rank": 4}),
        ("condensed, r = 8", {"rank": 8}),
    ):  # fmt: skip
        cp.mast.simulate(scene, times=times[:2], **options)  # compiles
        begin = time.perf_counter()
        run = cp.mast.simulate(scene, times=times, **options)
        seconds = time.perf_counter() - begin
        own = run["guy_tension"].values - run["guy_tension"].values[0]
        error = np.abs(own - change).max(axis=0) / np.abs(change).max(axis=0)
        worst = [f"{100.0 * float(error[level == height].max()):.2g} %" for height in np.unique(level)[::-1]]
        rows.append([str(links), f"{spent:.3g} s", name, f"{seconds:.2g} s", *worst])
    return rows


def main() -> None:
    """Run both and write the table."""
    from opensees import still_mast  # of the same folder

    parser = command_line(__doc__, readme=True)
    parser.add_argument("--links", type=int, nargs="+", default=[20, 40], help="segments of a line")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scene = still_mast(Path(folder))
        rows = [row for links in options.links for row in compare(scene, links)]
    heads = ["segments a line", "MoorDyn", "beside", "time", "guys at 115 m", "at 80 m", "at 40 m"]
    show_table("moordyn", markdown_table(heads, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
