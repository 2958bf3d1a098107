"""Compare error and run time of whole default calls of all models on the five scenes of the study.

    python pipelines/error_vs_runtime/whole_calls.py [--out out/error_against_run_time] [--readme] [--repeats 5] [--quick]

No call gives a scheme or a step.  Full models have their default tolerance or one of TOLERANCES, and positions as their only
output.  Reduced models run as ``simulate(scene, modes, rank=r)``, error estimate included.  Error, truth, laws and modes are
those of ``run.py``.  The time of a call is its wall time with positions every second, warm, on one thread, the median of
`repeats` rounds in turns.  Beside it stands the kernel time of the same model with the scheme and the step that the call has
chosen.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, in_turns, markdown_table, medians, percent, publish, short, timed

os.environ.update(ONE_THREAD)

import warnings
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt

import cablepod as cp
from cablepod.conventions import label
from error_vs_runtime.figure import LEVELS, TITLES
from error_vs_runtime.models import (
    ELEMENTS,
    EXAMPLES,
    TRAINED,
    UNSEEN,
    Setting,
    Training,
    kernel_calls,
    scene_of,
    seconds_of,
    trained_on,
    truth_of,
)
from error_vs_runtime.run import DURATION, POSITIONS, front

HERE = Path(__file__).resolve().parent
LINKS = (5, 8, 10, 13, 16, 20, 26, 32, 40, 56, 80, 113, 160)
TOLERANCES = (None, 1e-1, 1e-2, 1e-3)
RANKS = (1, 2, 3, 4, 6, 8)
#: Label -> marker, colour, and whether the model is a reduced one.
STYLES = {
    "chain": ("o", "#0072B2", False),
    "cable": ("d", "#56B4E9", False),
    "Galerkin": ("v", "#CC79A7", True),
    "condensed": ("^", "#D55E00", True),
    "condensed, exact": ("<", "#E69F00", True),
}
LAWS = {"Galerkin": "green"}


def calls_of(given: xr.Dataset, training: Training, *, quick: bool) -> list[tuple[str, str, partial[xr.Dataset]]]:
    """Return model, name and call, a function of `times`, of all settings of a scene."""
    separate, normal = training.modes["separate", TRAINED[0]], training.modes["normal", TRAINED[0]]
    found: list[tuple[str, str, partial[xr.Dataset]]] = []
    for tolerance in TOLERANCES[2:3] if quick else TOLERANCES:
        said = "" if tolerance is None else f", {tolerance:g}"
        options: dict[str, Any] = {"outputs": POSITIONS} | ({} if tolerance is None else {"tolerance": tolerance})
        for links in (8, 20) if quick else LINKS:
            found.append(
                ("chain", f"chain, n = {links}{said}", partial(cp.chain.simulate, given, links=links, **options))
            )
        for elements in () if quick else (1, 2):
            call = partial(cp.cable.simulate, given, elements=elements, points=41, law="linear", **options)
            found.append(("cable", f"cable, elements = {elements}{said}", call))
    for rank in (2,) if quick else RANKS:
        found.append(("Galerkin", f"Galerkin, r = {rank}", partial(cp.galerkin.simulate, given, separate, rank=rank)))
        for order, model in (("leading", "condensed"), ("exact", "condensed, exact")):
            call = partial(cp.condensed.simulate, given, normal, rank=rank, order=order)
            found.append((model, f"{model}, r = {rank}", call))
    return found


def kernel_time(model: str, call: partial[xr.Dataset], run: xr.Dataset, times: np.ndarray) -> float:
    """Return the kernel time of a model with the scheme and step of a run [s]."""
    options = {key: value for key, value in call.keywords.items() if key != "tolerance"}
    options |= {"scheme": run.attrs["scheme"], "step": run.attrs["step"]}
    job = partial(call.func, *call.args, **options)
    setting = Setting("", model.split(",")[0], "", 0)
    return seconds_of(kernel_calls(job, times, setting, POSITIONS)[0])


def measured(
    given: xr.Dataset, truths: dict[str, Any], training: Training, duration: float, repeats: int, *, quick: bool
) -> dict[str, list[Any]]:
    """Return names, errors and times of all settings of a scene; nan for calls that stop."""
    fine, coarse = np.arange(round(10 * duration) + 1) / 10.0, np.arange(round(duration) + 1.0)
    found: dict[str, list[Any]] = {key: [] for key in ("model", "name", "error_max", "kernel_time", "step", "scheme")}
    jobs = []
    for model, name, call in calls_of(given, training, quick=quick):
        row: dict[str, Any] = {"error_max": np.nan, "kernel_time": np.nan, "step": np.nan, "scheme": ""}
        try:
            run = call(times=fine)
        except cp.RunStopped:
            jobs.append(lambda: np.nan)
        else:
            row["error_max"] = truths[LAWS.get(model, "linear")].errors(run["position"].values)[0]
            run = call(times=coarse)
            row |= {"step": run.attrs["step"], "scheme": run.attrs["scheme"]}
            row["kernel_time"] = kernel_time(model, call, run, coarse)
            jobs.append(partial(lambda call: timed(lambda: call(times=coarse))[1], call))
        for key, value in {"model": model, "name": name, **row}.items():
            found[key].append(value)
    found["call_time"] = list(medians(zip(*in_turns(jobs, repeats), strict=True)))
    return found


def study(names: list[str], *, quick: bool, repeats: int, folder: Path) -> xr.Dataset:
    """Measure all scenes."""
    duration, elements = (10.0, 4) if quick else (DURATION, ELEMENTS)
    sizes, rank = TRAINED[:1], (4 if quick else 10)
    fine = np.arange(round(10 * duration) + 1) / 10.0
    load, rows, bases = os.getloadavg()[0], [], {}
    with warnings.catch_warnings():
        for kind in (cp.NotConvergedWarning, cp.OutOfRangeWarning):  # the errors show such settings
            warnings.simplefilter("ignore", kind)
        for name in names:
            given = scene_of(name, duration)
            truths = {law: truth_of(name, given, law, fine, folder, elements) for law in ("linear", "green")}
            base = EXAMPLES if name in UNSEEN else (name,)
            if base not in bases:
                bases[base] = trained_on([scene_of(item, duration) for item in base], sizes, rank)
            rows.append(measured(given, truths, bases[base], duration, repeats, quick=quick))
            print(f"{name}: {len(rows[-1]['name'])} calls measured", flush=True)
    values = ("error_max", "call_time", "kernel_time", "step")
    result = xr.Dataset(
        {key: (("scene", "setting"), np.array([row[key] for row in rows])) for key in (*values, "scheme")},
        coords={"scene": names, **{key: ("setting", rows[0][key]) for key in ("model", "name")}},
    )
    label(
        result,
        error_max=("1", "largest error over time"),
        call_time=("s", "time of the whole call"),
        kernel_time=("s", "kernel time with the scheme and the step of the call"),
        step=("s", "time step that the call has chosen"),
        scheme=("1", "time scheme that the call has chosen"),
        scene=("1", "scene"),
        model=("1", "model"),
        name=("1", "setting"),
    )
    result.attrs.update(
        title="Error against run time of whole default calls",
        repeats=repeats,
        duration=duration,
        load_average_before=load,
        load_average_after=os.getloadavg()[0],
    )
    return result


def best(of: xr.Dataset, level: float, *, reduced: bool) -> xr.Dataset | None:
    """Return the fastest full or reduced call of a scene whose error is `level` at most."""
    kind = np.array([STYLES[str(model)][2] for model in of["model"].values])
    rows = np.flatnonzero((kind == reduced) & (of["error_max"].values <= level))
    return of.isel(setting=int(rows[np.argmin(of["call_time"].values[rows])])) if rows.size else None


def table(result: xr.Dataset) -> str:
    """Write the fastest full and reduced call of each scene and level."""
    head = ["scene", "error", "fastest full call", "call, kernel", "fastest reduced call", "call, kernel"]
    head += ["calls: full over reduced", "kernels"]
    lines = []
    for name in result["scene"].values:
        for level in LEVELS[:2]:
            pair = [best(result.sel(scene=name), level, reduced=reduced) for reduced in (False, True)]
            cells = [TITLES[str(name)], "≤ " + percent(level)]
            for of in pair:
                if of is None:
                    cells += ["none", ""]
                else:
                    times = ", ".join(short(1e3 * float(of[key])) for key in ("call_time", "kernel_time"))
                    cells += [
                        f"{of['name'].values!s}: {of['scheme'].values!s}, {float(of['step']):.3g} s",
                        f"{times} ms",
                    ]
            full, small = pair
            for key in ("call_time", "kernel_time"):
                cells.append("" if full is None or small is None else short(float(full[key] / small[key])))
            lines.append(cells)
    return markdown_table(head, lines)


def draw(result: xr.Dataset) -> plt.Figure:
    """Draw error against the time of the call, a panel for each scene, with the fronts of calls and of their kernels."""
    names = [str(name) for name in result["scene"].values]
    columns = min(len(names), 3)
    lines = -(-(len(names) + 1) // columns)
    size = (4.6 * columns, 3.9 * lines)
    figure, grid = plt.subplots(
        lines, columns, figsize=size, sharex=True, sharey=True, layout="constrained", squeeze=False
    )
    reduced = np.array([STYLES[str(model)][2] for model in result["model"].values])
    for ax, name in zip(grid.flat, names, strict=False):
        of = result.sel(scene=name)
        error = of["error_max"].values
        for model, (marker, colour, _) in STYLES.items():
            rows = of["model"].values == model
            ax.plot(1e3 * of["call_time"].values[rows], error[rows], marker, color=colour, ms=5, mew=0.8, label=model)
        for kind, colour, what in ((False, "#003a5c", "full"), (True, "#a33c00", "reduced")):
            for key, line, said in (("call_time", "-", "calls"), ("kernel_time", ":", "kernels of the same settings")):
                seconds = of[key].values
                rows = np.flatnonzero(reduced == kind)
                rows = rows[front(seconds[rows], error[rows])]
                rows = rows[np.argsort(seconds[rows])]
                ax.plot(
                    1e3 * seconds[rows], error[rows], line, color=colour, lw=1.5, drawstyle="steps-post",
                    label=f"front, {what}, {said}", zorder=1,
                )  # fmt: skip
        several = name in UNSEEN
        ax.set_title(f"{TITLES[name]}; modes from " + ("Examples 2 to 4" if several else "itself"), fontsize=10)
        ax.set(xscale="log", yscale="log", xlabel="time [ms]", ylim=(1e-6, 1.0))
        ax.grid(alpha=0.3)
        ax.tick_params(labelbottom=True)
    for ax in grid[:, 0]:
        ax.set_ylabel("largest error over the run [1]")
    for ax in list(grid.flat)[len(names) :]:
        ax.axis("off")
    handles, labels = grid.flat[0].get_legend_handles_labels()
    grid.flat[len(names)].legend(handles, labels, fontsize=9, loc="upper center")
    return figure


def main() -> None:
    """Measure, write, draw, print."""
    parser = command_line(
        __doc__,
        out="out/error_against_run_time",
        readme=True,
        quick="few settings, Example 2 and one unseen scene, 10 s",
        repeats=5,
    )
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    names = ["example2", "guy"] if options.quick else [*EXAMPLES, *UNSEEN]
    result = study(names, quick=options.quick, repeats=options.repeats, folder=options.out)
    text = table(result)
    publish(
        options.out,
        "whole_calls",
        result,
        draw=lambda path: draw(result).savefig(path, dpi=75),
        page=HERE if options.readme else None,
        tables={"whole_calls": text},
    )
    print(text)
    before, after = (result.attrs[f"load_average_{when}"] for when in ("before", "after"))
    print(f"load average {before:.2f} before, {after:.2f} after, {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
