"""Compare the condensed model of a guy with an insulator in gusts with chains.

    python pipelines/guy_in_wind/insulator.py [--duration 600] [--readme]

The guy of ``run.py`` with an insulator of 60 kg and a drag area of 0.2 m2 at a tenth of its length.  The truth is the chain of
160 links, by velocity Verlet at nine tenths of its stability limit.  Standard deviation, peak and equivalent range (exponent 4)
of the tension in the uppermost of 160 links are compared from 20 s on; chains of 40 links give it in the middle of theirs, from
which the truth at the same place is taken.  Modes of the condensed model are six vibrations of the chain of 160 links, of which
static modes replace two, and the kink shape of the insulator; a row shows what they are without that shape, and one what a
model without the insulator says.  Times are processor times on one thread of whole calls with the given field of wind.
"""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, markdown_table, percent, show_table

os.environ.update(ONE_THREAD)

import numpy as np
import xarray as xr

import cablepod as cp
from guy_in_wind.run import FINEST, INTERVAL, OF_LIMIT, measures, seconds_of, tables
from guy_in_wind.run import scene as bare_guy

HERE = Path(__file__).resolve().parent
#: Insulator, rank, links of a coarse chain.
INSULATOR = {"arc_length": 0.1, "mass": 60.0, "drag_area": 0.2}
RANK, COARSE = 6, 40
#: Steps of the condensed model [s].
STEPS = (0.01, 0.025)
HEAD = ("model", "step [ms]", "standard deviation", "peak", "equivalent range", "time [ms]", "truth over it")


def scene(duration: float, links: int = FINEST) -> xr.Dataset:
    """Return the guy with the insulator."""
    return cp.make_scene(
        tables(duration, links) | {"title": "Guy with an insulator in gusts", "attachment": [INSULATOR]}
    )


def chain(wind: xr.Dataset, duration: float, links: int, scheme: str = "velocity_verlet", step: float = 0.0) -> Any:
    """Return name, step [s] and call of a chain; with nine tenths of the stability limit where no step is given."""
    given = scene(duration, links)
    if not step:
        limit = float(cp.chain.simulate(given, step=1e-5, times=[0.0]).attrs["step_limit"])
        step = INTERVAL / np.ceil(INTERVAL / (OF_LIMIT * limit))
    call = partial(cp.chain.simulate, given, scheme=scheme, step=step, outputs=("tension",), wind=wind)
    return f"chain of {links} links, {scheme}", step, call


def condensed(wind: xr.Dataset, given: xr.Dataset, modes: xr.Dataset, name: str, step: float) -> Any:
    """Return name, step [s] and call of a condensed model."""
    call = partial(
        cp.condensed.simulate,
        given,
        modes,
        step=step,
        outputs=("tension",),
        links=[modes.sizes["particle"] - 1],
        wind=wind,
    )
    return f"condensed, {name}", step, call


def top(run: xr.Dataset, place: float) -> xr.DataArray:
    """Return the tension at an arc length [m], linear between the middles of links."""
    places, tension = run.link_arc_length.values, run.tension
    right = int(np.clip(np.searchsorted(places, place), 1, max(places.size - 1, 1)))
    if places.size == 1 or place >= places[-1]:
        return tension.isel(link=-1)
    share = (place - places[right - 1]) / (places[right] - places[right - 1])
    return (1.0 - share) * tension.isel(link=right - 1) + share * tension.isel(link=right)


def main() -> None:
    """Compute and print."""
    parser = command_line(__doc__, readme=True)
    parser.add_argument("--duration", type=float, default=600.0, help="[s]")
    options = parser.parse_args()
    duration = options.duration
    given = scene(duration)
    wind = cp.wind.field(given)
    modes = cp.condensed.vibration_modes(given, rank=RANK, static_modes=True)
    without = modes.isel(mode=slice(RANK))
    bare = bare_guy(duration, FINEST)
    finest = chain(wind, duration, FINEST)
    truth = finest[2]()
    candidates = [condensed(wind, given, modes, f"r = {RANK} and kink", step) for step in STEPS]
    candidates += [
        condensed(wind, given, without, f"r = {RANK}", STEPS[0]),
        condensed(wind, bare, without, "without the insulator", STEPS[0]),
        chain(wind, duration, COARSE),
        chain(wind, duration, COARSE, "generalized_alpha", INTERVAL),
        finest,
    ]
    spent = [seconds_of(call) for _, _, call in candidates]
    rows = []
    for (name, step, call), seconds in zip(candidates, spent, strict=True):
        run = call()
        series = run.tension.isel(link=-1)
        true = top(truth, float(run.link_arc_length.values[-1]))
        texts = [percent(value) for value in np.abs(measures(series) / measures(true) - 1.0)]
        rows.append([name, f"{1e3 * step:.3g}", *texts, f"{1e3 * seconds:.0f}", f"{spent[-1] / seconds:.1f}"])
    rows[-1][2:5] = ["", "", ""]
    show_table("insulator", markdown_table(HEAD, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
