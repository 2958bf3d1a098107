"""Compare errors of position and of the top tension with the time of default calls, on the five scenes of the study.

    python pipelines/error_vs_runtime/top_tension.py [--out out/error_against_run_time] [--readme] [--repeats 3] [--quick]

Every call asks for positions and tensions, and gives neither a scheme nor a step.  The top tension is that of the uppermost
link; the truth is the tension of the converged continuous cable at the middle of that link, by the law of the model.  Its error
is the largest difference over 124 s (every 0.1 s), that of the peak the difference of the largest tensions; both are fractions
of the range of the true top tension.  The error of the position is that of ``run.py``.  The time of a call is its processor time
with output every second, warm, on one thread, the median of calls in turns.  Modes come from the scene itself (chains of 40
links).
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, in_turns, markdown_table, publish, short

os.environ.update(ONE_THREAD)

import time
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from scipy.interpolate import CubicSpline

import cablepod as cp
from cablepod.conventions import label
from error_vs_runtime.figure import TITLES
from error_vs_runtime.models import EXAMPLES, TRAINED, UNSEEN, Training, scene_of, trained_on
from error_vs_runtime.run import DURATION
from error_vs_runtime.whole_calls import LAWS, STYLES

HERE = Path(__file__).resolve().parent
OUTPUTS = ("position", "tension")
#: Elements of the truth, its step [s], and its points, between which tensions are interpolated.
ELEMENTS, STEP, POINTS = 8, 5e-5, 321
LINKS, RANKS = (10, 20, 40, 80), (2, 4, 8)
#: Errors and time of a call.
MEASURED = ("position_error", "tension_error", "peak_error", "call_time")


def calls_of(given: xr.Dataset, training: Training, *, quick: bool) -> list[tuple[str, str, partial[xr.Dataset]]]:
    """Return model, name and call, a function of `times`, of all settings of a scene."""
    separate, normal = training.modes["separate", TRAINED[0]], training.modes["normal", TRAINED[0]]
    found: list[tuple[str, str, partial[xr.Dataset]]] = [
        ("chain", f"chain, n = {links}", partial(cp.chain.simulate, given, links=links))
        for links in LINKS[: 2 if quick else None]
    ]
    for elements in () if quick else (1, 2):
        call = partial(cp.cable.simulate, given, elements=elements, points=TRAINED[0] + 1, law="linear")
        found.append(("cable", f"cable, elements = {elements}", call))
    for rank in RANKS[:1] if quick else RANKS:
        found.append(("Galerkin", f"Galerkin, r = {rank}", partial(cp.galerkin.simulate, given, separate, rank=rank)))
    for order, model in (("leading", "condensed"), ("exact", "condensed, exact")):
        for rank in RANKS[:1] if quick else RANKS:
            found.append(
                (model, f"{model}, r = {rank}", partial(cp.condensed.simulate, given, normal, rank=rank, order=order))
            )
    return [(model, name, partial(call, outputs=OUTPUTS)) for model, name, call in found]


def truth_of(given: xr.Dataset, law: str, times: np.ndarray, elements: int = ELEMENTS) -> xr.Dataset:
    """Return the continuous cable with positions and tensions at all instants."""
    return cp.cable.simulate(given, elements=elements, law=law, step=STEP, points=POINTS, times=times, outputs=OUTPUTS)


def top_tension(truth: xr.Dataset, share: float) -> np.ndarray:
    """Return the tension of the truth [N] at a share of its unstretched length."""
    known = truth["link_arc_length"].values
    return CubicSpline(known, truth["tension"].values, axis=1)(share * float(truth["arc_length"][-1]))


def errors_of(run: xr.Dataset, truth: xr.Dataset) -> dict[str, float]:
    """Return the errors of position, top tension and its peak."""
    top = run["tension"].values[:, -1]
    true = top_tension(truth, float(run["link_arc_length"][-1] / run["arc_length"][-1]))
    extent = np.ptp(true)
    return {
        "position_error": float(cp.compare.errors(run, truth)["error_max"]),
        "tension_error": float(np.abs(top - true).max() / extent),
        "peak_error": float(abs(top.max() - true.max()) / extent),
    }


def processor_time(call: partial[xr.Dataset], times: np.ndarray) -> float:
    """Return the processor time of a call [s]."""
    begin = time.process_time()
    call(times=times)
    return time.process_time() - begin


def measured(given: xr.Dataset, duration: float, repeats: int, *, quick: bool) -> dict[str, list[Any]]:
    """Return models, names, errors and times of all settings of a scene; nan for calls that stop."""
    fine, coarse = np.arange(round(10 * duration) + 1) / 10.0, np.arange(round(duration) + 1.0)
    truths = {law: truth_of(given, law, fine) for law in ("linear", "green")}
    training = trained_on([given], TRAINED[:1], 4 if quick else max(RANKS))
    found: dict[str, list[Any]] = {key: [] for key in ("model", "name", *MEASURED)}
    jobs: list[Callable[[], float]] = []
    for model, name, call in calls_of(given, training, quick=quick):
        errors = dict.fromkeys(MEASURED[:-1], np.nan)
        try:
            errors = errors_of(call(times=fine), truths[LAWS.get(model, "linear")])
            jobs.append(partial(processor_time, call, coarse))
        except cp.RunStopped:
            jobs.append(lambda: np.nan)
        for key, value in {"model": model, "name": name, **errors}.items():
            found[key].append(value)
    found["call_time"] = [float(np.median(seconds)) for seconds in in_turns(jobs, repeats)]
    return found


def study(names: list[str], *, quick: bool, repeats: int) -> xr.Dataset:
    """Measure all scenes."""
    duration = 10.0 if quick else DURATION
    with warnings.catch_warnings():
        for kind in (cp.CoarseWarning, cp.NotConvergedWarning, cp.OutOfRangeWarning):  # the errors show such settings
            warnings.simplefilter("ignore", kind)
        rows = [measured(scene_of(name, duration), duration, repeats, quick=quick) for name in names]
    result = xr.Dataset(
        {key: (("scene", "setting"), np.array([row[key] for row in rows])) for key in MEASURED},
        coords={"scene": names, **{key: ("setting", rows[0][key]) for key in ("model", "name")}},
    )
    label(
        result,
        position_error=("1", "largest error of the position over the motion"),
        tension_error=("1", "largest error of the top tension over its range"),
        peak_error=("1", "error of the largest top tension over its range"),
        call_time=("s", "processor time of the whole call"),
        scene=("1", "scene"),
        model=("1", "model"),
        name=("1", "setting"),
    )
    result.attrs.update(title="Errors of position and top tension against run time", repeats=repeats, duration=duration)
    return result


def table(result: xr.Dataset) -> str:
    """Write the errors and times of all settings, with a column for each scene."""
    names = [str(name) for name in result["scene"].values]
    lines = []
    for i, name in enumerate(result["name"].values):
        cells = [str(name)]
        for scene in names:
            position, tension, peak, seconds = (float(result[key].sel(scene=scene)[i]) for key in MEASURED)
            errors = " / ".join(f"{100.0 * value:.2g}" for value in (position, tension, peak))
            cells.append(f"{errors} %, {short(1e3 * seconds)} ms" if np.isfinite(position) else "stops")
        lines.append(cells)
    return markdown_table(["default call", *(TITLES[name] for name in names)], lines)


def draw(result: xr.Dataset) -> plt.Figure:
    """Draw the error of the position, and of the top tension, against the time of a call: a column for each scene."""
    names = [str(name) for name in result["scene"].values]
    size = (3.6 * len(names), 6.6)
    figure, grid = plt.subplots(
        2, len(names), figsize=size, sharex=True, sharey=True, layout="constrained", squeeze=False
    )
    for column, name in enumerate(names):
        of = result.sel(scene=name)
        for ax, key in zip(grid[:, column], MEASURED[:2], strict=True):
            for model, (marker, colour, _) in STYLES.items():
                rows = of["model"].values == model
                if rows.any():
                    ax.plot(
                        1e3 * of["call_time"].values[rows],
                        of[key].values[rows],
                        marker + "-",
                        color=colour,
                        label=model,
                    )
            ax.set(xscale="log", yscale="log")
            ax.grid(alpha=0.3)
        grid[0, column].set_title(TITLES[name], fontsize=10)
        grid[1, column].set_xlabel("processor time of the call [ms]")
    grid[0, 0].set_ylabel("position: largest error / motion [1]")
    grid[1, 0].set_ylabel("top tension: largest error / range [1]")
    grid[0, -1].legend(fontsize=8)
    return figure


def main() -> None:
    """Measure, write, draw, print."""
    parser = command_line(
        __doc__, out="out/error_against_run_time", readme=True, quick="few settings, Example 2, 10 s", repeats=3
    )
    options = parser.parse_args()
    names = ["example2"] if options.quick else [*EXAMPLES, *UNSEEN]
    result = study(names, quick=options.quick, repeats=options.repeats)
    text = table(result)
    publish(
        options.out,
        "top_tension",
        result,
        draw=lambda path: draw(result).savefig(path, dpi=75),
        page=HERE if options.readme else None,
        tables={"top_tension": text},
    )
    print(text)


if __name__ == "__main__":
    main()
