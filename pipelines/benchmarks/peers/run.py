"""Measure error and run time of the elastic chain beside other packages.

    pip install -e '.[peers]' && python pipelines/benchmarks/peers/run.py [--out out/peers] [--readme]

Also: --slow (settings with long runs), --repeats 5, and --from out/peers/peers.nc (print and draw a result without measuring).
Packages that are not installed are named.

System.  Examples 2 and 3, one system for all: 40 tension-only links, linear law, lumped masses, weight, the upper end moved by
the scene, planar, from rest, 125 s; positions every 5 s.  Right sides and Jacobians for general solvers are compiled by numba,
the Jacobian is analytic and banded, so that Python costs a solver only the callback; solvers.py lists the settings that were
tried.

Error.  Maximum distance of a particle from the truth at t = 45 s over the maximum displacement of the motion; beside it the
maximum over all instants.  The truth is velocity Verlet at a step of 1.25e-5 s; its maximum distance from an independent scheme
on an independent right side, the eighth-order formula of DOP853 at 2e-4 s, is printed.

Time.  Stepping only: inside our kernels; the solve call of a general solver; SolveDynamic of Exudyn; all calls of MoorDyn's Step.
Whole: with the assembly of the model, and for ours all of chain.simulate with a given step.  One thread for all; warm-up and
compilation are left out; medians of five runs below 2 s, three below 5 s, one above (column "runs").  The cases take turns, so
that a busy machine slows all.

Ratio.  Our stepping time over the package's at equal error.  The time at an error is that of the fastest method of a package,
interpolated in logarithms on the Pareto front of its settings.  Errors above 10 % are not drawn.
"""

from __future__ import annotations

import platform
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import matplotlib as mpl

mpl.use("Agg")

import numba
import numpy as np
import xarray as xr
from _study import command_line, markdown_table, publish, time_inside
from matplotlib import pyplot as plt
from threadpoolctl import threadpool_limits

import cablepod as cp
from benchmarks.peers.solvers import DISTRIBUTIONS, Case, cases, quiet, versions
from benchmarks.peers.system import System, check_of, error_of, largest_displacement, system_of
from cablepod.examples import scene

HERE = Path(__file__).resolve().parent
EXAMPLES = ("example2", "example3")
TIMES = np.arange(0.0, 126.0, 5.0)
AT = 45.0  #: instant of the error [s]
OURS = "cablepod"
SETTINGS = {
    "trapezoidal": (1.0, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001),
    "generalized_alpha": (0.1, 0.02, 0.01, 0.005, 0.002),
    "energy_momentum": (0.1, 0.01, 0.002),
    "velocity_verlet": (3.2e-4, 1e-4, 2.5e-5),
}
KERNELS = {"velocity_verlet": "cablepod.chain._kernels_explicit.verlet"}  # of the other schemes the implicit one
GOAL = 1e-6  #: error at which packages are compared
#: Maximum time of the warm-up run [s], and repeats up to it (None: as many as wanted).
FEWER = ((2.0, None), (5.0, 3))
COLOURS = {OURS: "#D55E00", "scikit-sundae": "#0072B2", "SciPy": "#009E73", "Exudyn": "#CC79A7", "MoorDyn": "#000000"}
MARKS = {OURS: "o", "scikit-sundae": "s", "SciPy": "^", "Exudyn": "D", "MoorDyn": "X"}


@dataclass
class Measured:
    """Errors and times of one case on one example."""

    error: float = np.nan  #: at 45 s
    worst: float = np.nan  #: over all instants
    stepping: list[float] = field(default_factory=list)  #: [s]
    whole: list[float] = field(default_factory=list)  #: [s]
    failure: str = ""


def ours(given: xr.Dataset, scheme: str, step: float) -> tuple[np.ndarray, float]:
    """Return positions and the time inside the kernels [s]."""
    with time_inside(KERNELS.get(scheme, "cablepod.chain._kernels_implicit.implicit")) as kernel:
        run = cp.chain.simulate(given, times=TIMES, scheme=scheme, step=step)
    return run["position"].values, kernel.seconds


def our_cases(given: xr.Dataset) -> list[Case]:
    """Return our schemes as cases."""

    def prepare(scheme: str, step: float) -> Callable[..., Callable[[], tuple[np.ndarray, float]]]:
        return lambda system, times: lambda: ours(given, scheme, step)

    return [
        Case(
            OURS, scheme.replace("_", " "), f"{step:g} s", prepare(scheme, step), slow=scheme[0] == "v" and step < 1e-4
        )
        for scheme, steps in SETTINGS.items()
        for step in steps
    ]


def once(case: Case, system: System, truth: np.ndarray, scale: float, into: Measured) -> None:
    """Run a case once and note times and errors, or its failure."""
    begin = time.perf_counter()
    try:
        with quiet():
            position, stepping = case.prepare(system, TIMES)()
    except Exception as failure:  # any exception of a package, for the table
        into.failure = f"{type(failure).__name__}: {failure}".splitlines()[0]
        return
    into.whole.append(time.perf_counter() - begin)
    into.stepping.append(stepping)
    error = error_of(position, truth, scale)
    if not np.isfinite(error).all():
        into.failure = "left the finite numbers"
    into.error, into.worst = float(error[TIMES == AT][0]), float(error.max())


def repeats_for(seconds: float, wanted: int) -> int:
    """Return the number of runs after a warm-up of some time [s]."""
    for limit, count in FEWER:
        if seconds < limit:
            return wanted if count is None else min(count, wanted)
    return 0


def measure(chosen: list[Case], system: System, truth: np.ndarray, scale: float, wanted: int) -> dict[Case, Measured]:
    """Run all cases in turns, with progress on standard error."""
    results, left = {case: Measured() for case in chosen}, {}
    for case in chosen:
        print(f"  {case.package}, {case.method}, {case.setting}", file=sys.stderr, flush=True)
        warm = results[case]
        once(case, system, truth, scale, warm)
        left[case] = 0 if warm.failure else repeats_for(warm.stepping[0], wanted)
        if left[case]:
            once(case, system, truth, scale, warm)  # the first run compiled and may have been slow
            left[case] = repeats_for(warm.stepping[1], wanted)
            warm.stepping.clear()
            warm.whole.clear()
    while any(left.values()):
        for case in chosen:
            if left[case]:
                once(case, system, truth, scale, results[case])
                left[case] -= 1
    return results


def truth_of(given: xr.Dataset, system: System) -> tuple[np.ndarray, float, float]:
    """Return positions at the instants, maximum displacement [m], and maximum distance from the check [m]."""
    dense = np.unique(np.concatenate([TIMES, np.arange(1251) / 10.0]))
    run = cp.chain.simulate(given, scheme="velocity_verlet", step=1.25e-5, times=dense)["position"].values
    truth, scale = run[np.searchsorted(dense, TIMES)], largest_displacement(run)
    return truth, scale, float(error_of(check_of(system, TIMES, 2e-4), truth, 1.0).max())


def run_all(*, slow: bool, wanted: int) -> xr.Dataset:
    """Measure every case on every example."""
    found = versions()
    columns: dict[str, list[np.ndarray]] = {"error": [], "error_worst": [], "stepping": [], "whole": [], "repeats": []}
    failures, distance, scales = [], [], []
    for example in EXAMPLES:
        given = scene(example)
        system = system_of(given)
        truth, scale, gap = truth_of(given, system)
        chosen = [case for case in our_cases(given) + cases() if slow or not case.slow]
        chosen = [case for case in chosen if case.package == OURS or found[case.package] is not None]
        results = measure(chosen, system, truth, scale, wanted)
        rows = list(results.values())
        columns["error"].append(np.array([row.error for row in rows]))
        columns["error_worst"].append(np.array([row.worst for row in rows]))
        columns["stepping"].append(np.array([statistics.median(row.stepping or [np.nan]) for row in rows]))
        columns["whole"].append(np.array([statistics.median(row.whole or [np.nan]) for row in rows]))
        columns["repeats"].append(np.array([len(row.stepping) for row in rows]))
        failures.append([row.failure for row in rows])
        distance.append(gap)
        scales.append(scale)
    names = list(results)
    dims = ("example", "case")
    units = {"stepping": "s", "whole": "s"}
    data = {name: (dims, np.array(column), {"units": units.get(name, "1")}) for name, column in columns.items()}
    return xr.Dataset(
        {
            **data,
            "failure": (dims, np.array(failures)),
            "check_distance": (
                "example",
                distance,
                {"units": "m", "long_name": "largest distance of the truth from its check"},
            ),
            "displacement_scale": ("example", scales, {"units": "m"}),
        },
        coords={
            "example": list(EXAMPLES),
            "package": ("case", [case.package for case in names]),
            "method": ("case", [case.method for case in names]),
            "setting": ("case", [case.setting for case in names]),
        },
        attrs={
            "title": "the elastic chain on other packages: error against run time",
            "versions": ", ".join(f"{name} {version or 'not installed'}" for name, version in found.items()),
            "machine": f"{platform.machine()}, Python {platform.python_version()}, one thread",
            "missing": ", ".join(name for name, version in found.items() if version is None),
        },
    )


# --- fronts -----------------------------------------------------------------------------------------------------------


def front(error: np.ndarray, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return errors and times of the Pareto front, errors ascending."""
    sound = np.isfinite(error) & np.isfinite(seconds) & (error > 0.0)
    error, seconds = error[sound], seconds[sound]
    order = np.lexsort((seconds, error))
    error, seconds = error[order], seconds[order]
    best = np.concatenate([[np.inf], np.minimum.accumulate(seconds)[:-1]])
    return error[seconds < best], seconds[seconds < best]


def time_at(wanted: float, error: np.ndarray, seconds: np.ndarray) -> float:
    """Interpolate the time of a front [s] at an error in logarithms.

    It is nan below the errors of the front, and its minimum above.
    """
    if error.size == 0 or wanted < error[0]:
        return float("nan")
    return float(np.exp(np.interp(np.log(wanted), np.log(error), np.log(seconds))))


def package_time(table: xr.Dataset, package: str, wanted: float, error_name: str = "error") -> float:
    """Return the stepping time of a package's fastest method at an error [s].

    It is nan below the errors of all its methods.
    """
    least = float("nan")
    for method in dict.fromkeys(table["method"].values[table["package"].values == package]):
        chosen = (table["package"].values == package) & (table["method"].values == method)
        best = front(table[error_name].values[chosen], table["stepping"].values[chosen])
        least = float(np.fmin(least, time_at(wanted, *best)))
    return least


# --- tables and figure ------------------------------------------------------------------------------------------------


def table_lines(data: xr.Dataset) -> list[str]:
    """Return the lines of the report: all settings, the goal, and the missing packages."""
    lines = [f"{data.attrs['versions']}; {data.attrs['machine']}"]
    for example in data["example"].values:
        table = data.sel(example=example)
        lines += [
            "",
            f"{example}: distance of the truth from its check {float(table['check_distance']):.1e} m, "
            f"largest displacement {float(table['displacement_scale']):.4f} m",
            f"{'package':<15}{'method':<22}{'setting':<13}{'error 45 s':>11}{'worst':>9}{'stepping':>12}{'whole':>12}"
            f"{'runs':>6}{'ours / it':>11}",
        ]
        for i in range(table.sizes["case"]):
            row = table.isel(case=i)
            head = f"{row['package'].item():<15}{row['method'].item():<22}{row['setting'].item():<13}"
            if row["failure"].item():
                lines.append(f"{head} {row['failure'].item()}")
                continue
            error, worst, stepping, whole = (float(row[n]) for n in ("error", "error_worst", "stepping", "whole"))
            ratio = package_time(table, OURS, error) / stepping
            lines.append(
                f"{head}{error:>11.1e}{worst:>9.1e}{1e3 * stepping:>9.2f} ms{1e3 * whole:>9.2f} ms{int(row['repeats']):>6}"
                + (f"{ratio:>11.3f}" if row["package"].item() != OURS else "")
            )
        lines += goal_lines(table)
    lines += [
        f"{name}: not installed (pip install 'cablepod[peers]')" for name in data.attrs["missing"].split(", ") if name
    ]
    return lines


def goal_lines(table: xr.Dataset) -> list[str]:
    """Return the lines of the comparison at the goal's error, by both measures of it."""
    lines = []
    for name, said in (("error", "at 45 s"), ("error_worst", "at the worst instant")):
        at = {p: package_time(table, p, GOAL, name) for p in (OURS, *DISTRIBUTIONS)}
        parts = [f"{p} {1e3 * seconds:.1f} ms" for p, seconds in at.items() if np.isfinite(seconds)]
        best = min((at[p] for p in DISTRIBUTIONS if np.isfinite(at[p])), default=np.nan)
        lines.append(
            f"error {GOAL:g} {said}: {', '.join(parts)}; ours over the best of the others {at[OURS] / best:.3f}"
        )
    return lines


def goal_table(table: xr.Dataset) -> str:
    """Write stepping times at the goal's error in one example."""
    seconds = {package: package_time(table, package, GOAL) for package in (OURS, *DISTRIBUTIONS)}
    lines = [
        [package, f"{1e3 * value:.3g} ms", "" if package == OURS else f"{seconds[OURS] / value:.2g}"]
        for package, value in seconds.items()
        if np.isfinite(value)
    ]
    return markdown_table(["package", f"time at {GOAL:g}", "ours over it"], lines)


def figure(data: xr.Dataset, size: tuple[float, float] = (11.0, 4.6)) -> plt.Figure:
    """Draw error against time: settings as marks, fronts as named lines."""
    drawn, axes = plt.subplots(1, 2, figsize=size, layout="constrained", sharex=True, sharey=True)
    for ax, example in zip(axes, data["example"].values, strict=True):
        table = data.sel(example=example)
        for package, colour in COLOURS.items():
            chosen = table["package"].values == package
            error, seconds = front(table["error"].values[chosen], table["stepping"].values[chosen])
            if not error.size:
                continue
            style = {"color": colour, "marker": MARKS[package], "linestyle": "none"}
            ax.plot(table["stepping"].values[chosen], table["error"].values[chosen], **style, markersize=4, alpha=0.35)
            ax.plot(seconds, error, **{**style, "linestyle": "-"}, markersize=5, linewidth=1.5)
            name_line(ax, package, seconds, error, colour)
        ax.set(xscale="log", yscale="log", xlabel="time of stepping through 125 s [s]", title=f"Example {example[-1]}")
        ax.set(xlim=(1.5e-4, 20.0), ylim=(3e-10, 0.1))
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("largest particle distance at 45 s\nover the largest displacement [1]")
    return drawn


def name_line(ax: plt.Axes, package: str, seconds: np.ndarray, error: np.ndarray, colour: str) -> None:
    """Write a package's name beside its line, clear of the other lines."""
    place = {
        OURS: (0, (-6, -12), "right"),
        "scikit-sundae": (-1, (0, 8), "right"),
        "SciPy": (0, (-7, -11), "right"),
        "Exudyn": (-1, (0, 8), "left"),
        "MoorDyn": (0, (0, -14), "center"),
    }
    index, offset, side = place[package]
    ax.annotate(
        package, (seconds[index], error[index]), xytext=offset, textcoords="offset points", color=colour, ha=side, fontsize=9
    )  # fmt: skip


def main() -> None:
    """Measure, print, write, draw."""
    parser = command_line(__doc__, out="out/peers", readme=True, repeats=5)
    parser.add_argument("--slow", action="store_true", help="also the settings with long runs")
    parser.add_argument("--from", dest="source", type=Path, help="netCDF file of an earlier run, instead of measuring")
    options = parser.parse_args()
    if options.source is None:
        numba.set_num_threads(1)
        with threadpool_limits(1):
            data = run_all(slow=options.slow, wanted=options.repeats)
    else:
        data = cp.archive.read(options.source)
    tables = {f"peers_{example}": goal_table(data.sel(example=example)) for example in data["example"].values}
    publish(
        options.out,
        "peers",
        data if options.source is None else None,
        draw=lambda path: figure(data).savefig(path, dpi=150),
        draw_small=lambda path: figure(data).savefig(path, dpi=75),
        page=HERE if options.readme else None,
        tables=tables,
    )
    print("\n".join(table_lines(data)))


if __name__ == "__main__":
    main()
