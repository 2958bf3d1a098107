"""Compare error and run time of all models on five scenes.

    python pipelines/error_vs_runtime/run.py [--out out/error_against_run_time] [--readme] [--repeats 5] [--quick]

The scenes are Examples 2 to 4 and two on which no modes are trained.  Full models are the chain and the continuous cable,
explicit and implicit; reduced models are the Galerkin and the condensed model. Quasi-static sequences of catenaries with cubic
splines in time stand apart.

The error is the maximum over all tenths of a second (124 s) of the rms distance over the particles from the converged
continuous cable, divided by its maximum rms displacement.  Between steps each model's own dense output holds.  All models obey
the linear law but the Galerkin model, whose fast form has law (21) and which is compared with the truth of that law.  The
truth is computed anew, as the files in data/truth hold every other second alone, and compared with them.  Modes for Examples 2
to 4 come from the example itself, modes for the unseen scenes from Examples 2 to 4 together.

Times, on one thread, warm:

kernel
    Computation between the first state and the last, the same in every model: the compiled loops and the tables of the ends'
    motion and the loads, without the Python code around them.  The state is saved every second.  The calls are recorded in a run
    and repeated with the same arguments; a sample is the median of as many repetitions as fit in 2 ms.  (Above 20 ms they are
    timed within the run.)
call
    The whole public call with positions every second (a sequence of catenaries: with its splines).

All settings run once, those below a millisecond twice.  Settings that no other of their family beats by a factor of two in time
at no larger error are measured again, in turns so that a busy machine slows all alike; their medians make the fronts and the
table.  A front at an error e is the minimum time of a setting whose error is at most e: nothing is interpolated.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, publish, update_tables

os.environ.update(ONE_THREAD)

import statistics
import time
import warnings
from typing import Any

import numpy as np
import xarray as xr
from tqdm import tqdm

import cablepod as cp
from cablepod.conventions import label
from cablepod.integrate._output_times import preferred_steps_per_second
from error_vs_runtime.figure import LEVELS, draw, markdown, markdown_of_first_page
from error_vs_runtime.models import (
    ELEMENTS,
    EXAMPLES,
    TRAINED,
    UNSEEN,
    Setting,
    Training,
    basis,
    from_file,
    job_of,
    kernel_calls,
    law_of,
    limit_of,
    scene_of,
    seconds_of,
    seconds_within,
    settings,
    trained_on,
    truth_of,
)

HERE = Path(__file__).resolve().parent
DURATION = 124.0
#: Outputs of a whole call; an estimate of its error is not among them.
POSITIONS = ("position",)
#: Maximum time over that of a setting with no larger error of those measured again: below LONG, and above, where times vary less.
NEAR, LITTLE = 2.0, 1.3
FAMILIES = ("full", "reduced", "quasi-static")
#: Maximum error of a setting that is measured again.
COARSE = 0.3
#: Maximum time of a kernel that is timed by itself [s]; longer ones make nearly all of their call and are timed inside it.
LONG = 0.02
#: Maximum time of a kernel that runs twice before the selection [s]: a slow moment of the machine would leave out the best.
SHORT = 1e-3


def front(seconds: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return a mask of the Pareto front, without settings that are not finite."""
    best, result = np.inf, np.zeros(seconds.size, dtype=bool)
    for i in np.lexsort((error, seconds)):
        if np.isfinite(seconds[i]) and error[i] < best:
            best, result[i] = error[i], True
    return result


def near_front(seconds: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return a mask of settings near the Pareto front.

    No other setting beats them by the factor NEAR in time (long ones LITTLE) at no larger error.
    """
    result = np.zeros(seconds.size, dtype=bool)
    for i in np.flatnonzero(np.isfinite(seconds) & np.isfinite(error)):
        rivals = seconds[error <= error[i]]
        result[i] = not ((NEAR if seconds[i] < LONG else LITTLE) * rivals < seconds[i]).any()
    return result


def first_look(
    given: xr.Dataset,
    truths: dict[str, Any],
    training: Training,
    tried: list[Setting],
    fine: np.ndarray,
    coarse: np.ndarray,
) -> tuple[dict[str, np.ndarray], dict[int, Any]]:
    """Run all settings in one scene once; return errors, first times and calls."""
    found = {key: np.full(len(tried), np.nan) for key in ("error_max", "error_rms", "kernel_time", "call_time", "step")}
    jobs: dict[int, Any] = {}
    for i, setting in enumerate(tqdm(tried, desc=str(given.attrs.get("title", "")), disable=None)):
        if setting.family == "trained" and basis(setting) not in training.modes:
            continue  # test functions are trained on the scene itself only
        try:
            step = setting.step
            if setting.share:  # rounded down, so that steps hit seconds
                step = 1.0 / preferred_steps_per_second(1.0 / (setting.share * limit_of(given, setting, training)))
            job = job_of(given, setting, step, training)
            calls, run = kernel_calls(job, fine, setting, POSITIONS)
        except (cp.RunStopped, cp.SceneError):
            continue  # an explicit step above the limit, a rule too coarse for the modes, or a run that broke down
        found["error_max"][i], found["error_rms"][i] = truths[law_of(setting)].errors(run["position"].values)
        found["kernel_time"][i], found["step"][i] = seconds_of(calls, least=1e-3), step
        jobs[i] = job
    for i, job in jobs.items():
        if found["kernel_time"][i] < SHORT:
            once_more = seconds_of(kernel_calls(job, coarse, tried[i])[0], least=1e-3)
            found["kernel_time"][i] = min(found["kernel_time"][i], once_more)
    return found, jobs


def measured(
    given: xr.Dataset, truths: dict[str, Any], training: Training, tried: list[Setting], duration: float, repeats: int
) -> dict[str, np.ndarray]:
    """Measure errors and times of all settings in one scene."""
    fine, coarse = np.arange(round(10 * duration) + 1) / 10.0, np.arange(round(duration) + 1.0)
    found, jobs = first_look(given, truths, training, tried, fine, coarse)
    families = np.array([setting.family for setting in tried])
    again = np.zeros(len(tried), dtype=bool)
    for family in FAMILIES:
        own = np.flatnonzero(families == family)
        again[own] = near_front(
            found["kernel_time"][own], np.where(found["error_max"] < COARSE, found["error_max"], np.nan)[own]
        )
    picked = [int(i) for i in np.flatnonzero(again)]
    calls_of = {i: kernel_calls(jobs[i], coarse, tried[i])[0] for i in picked if found["kernel_time"][i] < LONG}
    taken: dict[int, list[tuple[float, float]]] = {i: [] for i in picked}
    for _ in range(repeats):
        for i in picked:
            if i in calls_of:
                kernel = seconds_of(calls_of[i])
                begin = time.perf_counter()
                jobs[i](times=coarse, outputs=POSITIONS)
                taken[i].append((kernel, time.perf_counter() - begin))
            else:
                taken[i].append(seconds_within(jobs[i], coarse, POSITIONS))
    for i in picked:
        for key, column in (("kernel_time", 0), ("call_time", 1)):
            found[key][i] = statistics.median(row[column] for row in taken[i])
    found["offline_time"] = np.array([training.seconds.get(basis(setting), 0.0) for setting in tried])
    found["measured_again"] = again
    found["on_front"] = np.zeros(len(tried), dtype=bool)
    for family in FAMILIES:
        own = np.flatnonzero((families == family) & again)
        found["on_front"][own] = front(found["kernel_time"][own], found["error_max"][own])
    return found


def study(names: list[str], *, quick: bool, repeats: int, folder: Path) -> xr.Dataset:
    """Measure all scenes."""
    duration, elements = (10.0, 4) if quick else (DURATION, ELEMENTS)
    sizes, rank = (TRAINED[:1], 4) if quick else (TRAINED, 10)
    fine = np.arange(round(10 * duration) + 1) / 10.0
    tried = settings(quick=quick)
    load = os.getloadavg()[0]
    rows, bases, apart = [], {}, []
    with warnings.catch_warnings():
        for kind in (cp.NotConvergedWarning, cp.OutOfRangeWarning):  # the errors show such settings
            warnings.simplefilter("ignore", kind)
        laws = sorted({law_of(setting) for setting in tried})
        for name in names:
            given = scene_of(name, duration)
            truths = {law: truth_of(name, given, law, fine, folder, elements) for law in laws}
            apart.append([from_file(name, truth, fine) for truth in truths.values()])
            base = EXAMPLES if name in UNSEEN else (name,)
            if base not in bases:
                bases[base] = trained_on([scene_of(item, duration) for item in base], sizes, rank)
            begin = time.perf_counter()
            rows.append(measured(given, truths, bases[base], tried, duration, repeats))
            print(f"{name}: {len(tried)} settings in {time.perf_counter() - begin:.0f} s", flush=True)
    result = xr.Dataset(
        {key: (("scene", "setting"), np.array([row[key] for row in rows])) for key in rows[0]},
        coords={
            "scene": names,
            "trained_on": ("scene", [", ".join(EXAMPLES) if name in UNSEEN else name for name in names]),
            "name": ("setting", [setting.name for setting in tried]),
            **{
                key: ("setting", [getattr(setting, key) for setting in tried])
                for key in ("family", "model", "scheme", "size", "order", "rank", "points")
            },
        },
    )
    for key in ("measured_again", "on_front"):
        result[key] = result[key].astype(np.int8)
    for key, of in (("time_ratio", "kernel_time"), ("call_ratio", "call_time")):
        result[key] = (("scene", "error_level"), np.array([ratios(result.sel(scene=name), of) for name in names]))
    result["truth_difference"] = (("scene", "law"), np.array(apart))
    result = result.assign_coords(error_level=list(LEVELS), law=laws)
    label(
        result,
        error_max=("1", "largest error over time"),
        error_rms=("1", "rms error over time"),
        kernel_time=("s", "time of what is computed between first and last state"),
        call_time=("s", "time of the whole call"),
        offline_time=("s", "time of the snapshots and modes of a reduced model"),
        step=("s", "time step"),
        measured_again=("1", "1 where times are medians of turns, 0 where of one look"),
        on_front=("1", "1 where no other setting of the family is both faster and better"),
        time_ratio=("1", "kernel time of the best full model over that of the best reduced model"),
        call_ratio=("1", "time of a call of the full model whose call is shortest over that of the reduced one"),
        truth_difference=("1", "largest difference of the truth from the one on file, where there is one"),
        error_level=("1", "error that both keep"),
        law=("1", "law of elasticity"),
        scene=("1", "scene"),
        trained_on=("1", "scenes that the modes of reduced models come from"),
        name=("1", "setting"),
        family=("1", "full, reduced or quasi-static"),
        model=("1", "model"),
        scheme=("1", "time scheme"),
        size=("1", "links of a chain or of the chain trained on, elements of a cable"),
        order=("1", "order of the elements or of the condensed model"),
        rank=("1", "number of modes"),
        points=("1", "points of quadrature along the cable, 0 for the links"),
    )
    result.attrs.update(
        title="Error against run time of full and reduced models",
        repeats=repeats,
        duration=duration,
        load_average_before=load,
        load_average_after=os.getloadavg()[0],
    )
    return result


def best(of: xr.Dataset, family: str, level: float, key: str = "kernel_time") -> int | None:
    """Return the fastest setting of a family whose error is `level` at most."""
    again, own = of["measured_again"].values == 1, of["family"].values == family
    rows = np.flatnonzero(again & own & (of["error_max"].values <= level))
    return int(rows[np.argmin(of[key].values[rows])]) if rows.size else None


def ratios(of: xr.Dataset, key: str) -> list[float]:
    """Return the time of the best full model over that of the best reduced one at each level."""
    seconds = of[key].values
    pairs = [[best(of, family, level, key) for family in ("full", "reduced")] for level in LEVELS]
    return [
        np.nan if full is None or reduced is None else float(seconds[full] / seconds[reduced])
        for full, reduced in pairs
    ]


def rows_of(result: xr.Dataset) -> list[dict[str, Any]]:
    """Return the best setting of each family for each scene and level."""
    return [
        {
            "scene": name,
            "level": level,
            "ratio": float(of["time_ratio"].sel(error_level=level)),
            "call_ratio": float(of["call_ratio"].sel(error_level=level)),
            "best": {
                family: None if (i := best(of, family, level)) is None else of.isel(setting=i) for family in FAMILIES
            },
        }
        for name in result["scene"].values
        for of in [result.sel(scene=name)]
        for level in LEVELS
    ]


def fronts_as_text(result: xr.Dataset) -> str:
    """List all settings on the fronts."""
    lines = []
    for name in result["scene"].values:
        of = result.sel(scene=name)
        for family in FAMILIES:
            lines.append(f"{name}: {family}")
            rows = np.flatnonzero((of["on_front"].values == 1) & (of["family"].values == family))
            for i in rows[np.argsort(of["kernel_time"].values[rows])]:
                row = of.isel(setting=i)
                lines.append(
                    f"  {1e3 * float(row['kernel_time']):10.4f} ms {1e3 * float(row['call_time']):9.2f} ms "
                    f"{float(row['error_max']):9.2e}  {row['name'].values!s}, step {float(row['step']):.3g} s"
                )
    return "\n".join(lines)


def main() -> None:
    """Measure, write, draw, print."""
    parser = command_line(
        __doc__,
        out="out/error_against_run_time",
        readme=True,
        quick="few settings, Example 2 and one unseen scene, 10 s",
        repeats=5,
    )
    parser.add_argument("--scenes", nargs="+", choices=(*EXAMPLES, *UNSEEN))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    names = options.scenes or (["example2", "guy"] if options.quick else [*EXAMPLES, *UNSEEN])
    result = study(names, quick=options.quick, repeats=options.repeats, folder=options.out)
    rows = rows_of(result)
    text = markdown(rows)
    (options.out / "error_against_run_time.md").write_text(text + "\n")
    publish(
        options.out,
        "error_against_run_time",
        result,
        draw=lambda path: draw(result).savefig(path, dpi=75),
        page=HERE if options.readme else None,
        tables={"models": text},
    )
    if options.readme:
        update_tables(HERE.parents[1] / "README.md", {"fronts": markdown_of_first_page(rows)})
    print(fronts_as_text(result))
    print(text)
    before, after = (result.attrs[f"load_average_{when}"] for when in ("before", "after"))
    print(f"load average {before:.2f} before, {after:.2f} after, {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
