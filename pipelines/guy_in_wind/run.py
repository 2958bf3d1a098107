"""Compare the condensed model of a guy in gusts with the cheapest chain that is as good.

    python pipelines/guy_in_wind/run.py [--rank 4] [--duration 600] [--readme]

A guy of 100 m in Kaimal's turbulence.  The truth is the continuous cable by the chain's law, 32 elements by velocity Verlet,
in the middle of the uppermost link of each model; rows of the cable of half as many elements and of the chain of 160 links
show how well it is known.  Standard deviation, peak and equivalent range (exponent 4) of the top tension are compared from 20
s on.  Chains of 16 to 44 links run by velocity Verlet at nine tenths of the stability limit, and by two implicit schemes with
steps of 10 to 50 ms.  All runs give the top tension alone at 20 instants a second; those of the chain from positions, which
are its only way.  Listed are the cheapest chains that are as good as the condensed model in each of the three, and those whose
largest error of the three is not above its own.  Times are processor times on one thread of whole calls with the given field
of wind, the least of several interleaved groups of three calls in a row; the time that makes the field is a row of its own.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, markdown_table, percent, show_table

os.environ.update(ONE_THREAD)

import numpy as np
import xarray as xr
from error_vs_runtime.top_tension import POINTS, top_tension

import cablepod as cp
from cablepod.wind import _air, _turbulence

HERE = Path(__file__).resolve().parent
#: Elements of the truth, links of the finest chain and of the others.
ELEMENTS, FINEST, LINKS = 32, 160, range(16, 45, 2)
#: Steps of the implicit schemes and of the condensed model [s], interval of the output [s].
IMPLICIT, IMPLICIT_STEPS = ("trapezoidal", "generalized_alpha"), (0.01, 0.025, 0.05)
CONDENSED_STEP, INTERVAL = 0.05, 0.05
#: Start of the comparison [s], number of timed groups of calls, part of the stability limit.
START, REPEATS, OF_LIMIT = 20.0, 9, 0.9
HEAD = (
    "model",
    "step [ms]",
    "standard deviation",
    "peak",
    "equivalent range",
    "as good in",
    "time [ms]",
    "over the condensed model",
)


class Candidate(NamedTuple):
    """A model of the guy with its options; `call` runs it and returns the top tension."""

    name: str
    step: float  #: [s]
    call: Callable[[], xr.DataArray]


def tables(duration: float, links: int = 40) -> dict[str, Any]:
    """Return the tables of the guy in gusts."""
    return {
        "title": "Guy in gusts",
        "cable": {
            "youngs_modulus": 1.6e11,
            "area": 1.25e-4,
            "density": 8000.0,
            "top_tension": 15000.0,
            "diameter": 0.016,
        },
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": [60.0, 80.0, 0.0]},
        "damping": {"mass_proportional": 0.02},
        "wind": {"speed": 25.0, "direction": [0.6, 0.0, 0.8], "turbulence": {"spectrum": "kaimal", "seed": 7}},
        "chain": {"links": links},
        "time": {"duration": duration, "interval": INTERVAL},
    }


def scene(duration: float, links: int = 40) -> xr.Dataset:
    """Return the guy in gusts."""
    return cp.make_scene(tables(duration, links))


def chain(wind: xr.Dataset, duration: float, links: int, scheme: str, step: float | None) -> Candidate:
    """Return a chain; velocity Verlet by the longest round step below the limit where none is given [s]."""
    given = scene(duration, links)
    if step is None:
        limit = float(cp.chain.simulate(given, step=1e-5, times=[0.0]).attrs["step_limit"])
        step = INTERVAL / np.ceil(INTERVAL / (OF_LIMIT * limit))

    def call() -> xr.DataArray:
        run = cp.chain.simulate(given, scheme=scheme, step=step, outputs=("tension",), wind=wind)
        return run.tension.isel(link=-1)

    return Candidate(f"chain of {links} links, {scheme}", float(step), call)


def cable(wind: xr.Dataset, duration: float, elements: int = ELEMENTS) -> xr.Dataset:
    """Return tensions of the continuous cable, by a round step below the stability limit."""
    options: dict[str, Any] = {
        "law": "linear",
        "elements": elements,
        "scheme": "velocity_verlet",
        "outputs": ("tension",),
        "points": POINTS,
    }
    limit = float(cp.cable.simulate(scene(duration), step=1e-5, times=[0.0], **options).attrs["step_limit"])
    step = INTERVAL / np.ceil(INTERVAL / (OF_LIMIT * limit))
    return cp.cable.simulate(scene(duration), step=step, wind=wind, **options)


def condensed(wind: xr.Dataset, duration: float, rank: int) -> Candidate:
    """Return the condensed model on vibration modes."""
    given = scene(duration)
    modes = cp.condensed.vibration_modes(given, rank=rank)

    def call() -> xr.DataArray:
        run = cp.condensed.simulate(given, modes, step=CONDENSED_STEP, outputs=("tension",), links=[40], wind=wind)
        return run.tension.isel(link=0)

    return Candidate(f"condensed, r = {rank}", CONDENSED_STEP, call)


def measures(tension: xr.DataArray) -> np.ndarray:
    """Return standard deviation, peak and equivalent range of a tension [N]."""
    series = tension.sel(time=slice(START, None))
    return np.array([float(series.std()), float(series.max()), float(cp.fatigue.equivalent(series))])


def errors(tension: xr.DataArray, truth: xr.Dataset) -> np.ndarray:
    """Return the relative errors of the measures of a top tension, against the cable at its place."""
    true = top_tension(truth, float(tension.link_arc_length / truth.arc_length[-1]))
    return np.abs(measures(tension) / measures(tension.copy(data=true)) - 1.0)


def seconds_of(call: Callable[[], Any]) -> float:
    """Return the least processor time of three calls in a row [s]."""
    spent = []
    for _ in range(3):
        begin = time.process_time()
        call()
        spent.append(time.process_time() - begin)
    return min(spent)


def seconds_of_field(given: xr.Dataset) -> float:
    """Return the processor time that makes the field of a scene [s]."""

    def call() -> None:
        for kept in (_air._of_scene, _air._kept_turbulence, _turbulence._phases):
            kept.cache_clear()
        cp.wind.field(given)

    return seconds_of(call)


def main() -> None:
    """Compute and print."""
    parser = command_line(__doc__, readme=True)
    parser.add_argument("--rank", type=int, default=4)
    parser.add_argument("--duration", type=float, default=600.0, help="[s]")
    options = parser.parse_args()
    duration = options.duration
    wind = cp.wind.field(scene(duration))
    truth = cable(wind, duration)
    model = condensed(wind, duration, options.rank)
    error = errors(model.call(), truth)
    chains = [chain(wind, duration, links, "velocity_verlet", None) for links in LINKS]
    chains += [
        chain(wind, duration, links, scheme, step) for scheme in IMPLICIT for links in LINKS for step in IMPLICIT_STEPS
    ]
    rows = []
    good: list[list[tuple[Candidate, np.ndarray, float]]] = [[], []]
    for candidate in chains:
        own = errors(candidate.call(), truth)
        if own.max() <= error.max():
            good[0 if (own <= error).all() else 1].append((candidate, own, seconds_of(candidate.call)))
    chosen = [(entry, which) for which in (0, 1) for entry in sorted(good[which], key=lambda entry: entry[2])[:2]]
    timed = [model, *(entry[0] for entry, _ in chosen)]
    seconds = np.array([[seconds_of(candidate.call) for candidate in timed] for _ in range(REPEATS)]).min(axis=0)
    field = min(seconds_of_field(scene(duration)) for _ in range(REPEATS))
    found = [error, *(entry[1] for entry, _ in chosen)]
    names = ["", *(("each", "the largest")[which] for _, which in chosen)]
    for candidate, own, name, spent in zip(timed, found, names, seconds, strict=True):
        texts = [percent(value) for value in own]
        ratio = f"{spent / seconds[0]:.1f}"
        rows.append([candidate.name, f"{1e3 * candidate.step:.3g}", *texts, name, f"{1e3 * spent:.1f}", ratio])
    finest = chain(wind, duration, FINEST, "velocity_verlet", None)
    half = cable(wind, duration, ELEMENTS // 2).tension.isel(link=-1)
    for name, series in ((finest.name, finest.call()), (f"cable of {ELEMENTS // 2} elements", half)):
        rows.append([name, "", *(percent(value) for value in errors(series, truth)), "", "", ""])
    rows.append(["making the wind", "", "", "", "", "", f"{1e3 * field:.0f}", ""])
    show_table("gusts", markdown_table(HEAD, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
