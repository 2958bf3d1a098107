"""Compare bifurcations of the condensed model with those of the full chain, both by harmonic balance: error and run time.

    python pipelines/periodic/run.py [--out FOLDER] [--readme] [--quick] [--case NAME]

Writes guy.nc, chord.nc, sagging.nc and periodic.png.

The planar branch of a guy whose top moves harmonically is traced through a range of frequencies, by the condensed model on
vibration modes and on modes of a chain's run, and by chains of several numbers of links.  Both use the same continuation.  The
truth is extrapolated from the two finest chains (order 2).  Errors are relative errors of the frequencies of bifurcations.  Times
are processor times of one thread for one point of the branch, without and with all Floquet multipliers, in and out of the plane.
"""

from __future__ import annotations

import math
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    import _study

    os.environ.update(_study.ONE_THREAD)

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, publish
from matplotlib import pyplot as plt

import cablepod as cp
from cablepod.periodic._continuation import Branch, Limits, trace
from cablepod.periodic._events import DOUBLING, FOLD, PITCHFORK
from cablepod.periodic._general import solver_of
from cablepod.periodic._members import model_of
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._solve import IN_PLANE, MIN_HARMONICS, OUT_OF_PLANE, State
from periodic.chain import ChainModel, ChainSolver, main_branch

HERE = Path(__file__).resolve().parent
#: Kind, set and number along the branch of a bifurcation.
Name = tuple[str, str, int]
#: Number of links on which vibration modes are computed, so that their error is not that of links.
MODE_LINKS = 320
#: Number of points of a branch that are timed, and of repetitions.
TIMED_POINTS, REPEATS = 20, 5


@dataclass(frozen=True)
class Case:
    """A guy, motion and range of frequencies of its top, and the bifurcations that are compared."""

    title: str
    top_tension: float  #: [N]
    damping: float  #: mass-proportional [1/s]
    amplitude: float  #: of the top [m]
    frequency: tuple[float, float]  #: [rad/s]
    harmonics: int  #: of the chain, with which the last two hold 1e-5 of the motion; the condensed model adapts them
    names: tuple[Name, ...]
    ranks: tuple[int, ...]
    pod_ranks: tuple[int, ...]
    direction: tuple[float, float] = (1.0, 0.0)  #: of the motion
    tauter: float = 0.0  #: top tension of a guy whose vibration modes serve too [N]; 0 for none

    def scene(
        self,
        omega: float | None = None,
        amplitude: float | None = None,
        *,
        spatial: bool = False,
        points: list[list[float]] | None = None,
    ) -> xr.Dataset:
        """Return the guy of Example 2 with these numbers, from rest or from other positions of its particles."""
        omega, amplitude = omega or sum(self.frequency) / 2.0, self.amplitude if amplitude is None else amplitude
        motion = {
            axis: {"kind": "harmonic", "amplitude": amplitude * part, "angular_frequency": omega}
            for axis, part in zip("xy", self.direction, strict=True)
            if part
        }
        cable = {
            "youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": self.top_tension,
        }  # fmt: skip
        out = [0.0] if spatial else []
        return cp.make_scene(
            ({} if points is None else {"initial": {"points": points}})
            | {
                "title": self.title,
                "cable": cable,
                "ends": {"lower": [0.0, 0.0, *out], "upper": [20.4, 57.7, *out]},
                "motion": {"upper": motion},
                "damping": {"mass_proportional": self.damping},
                "chain": {"links": 40},
            }
        )


CASES = {
    "guy": Case(
        "Example 2's guy, top moved by 3 mm", 15000.0, 0.05, 0.003, (12.0, 14.0), 8,
        ((PITCHFORK, OUT_OF_PLANE, 1), (PITCHFORK, OUT_OF_PLANE, 2), (DOUBLING, OUT_OF_PLANE, 1),
         (DOUBLING, IN_PLANE, 1), (FOLD, IN_PLANE, 1), (FOLD, IN_PLANE, 2)),
        (2, 3, 4, 6), (2, 3, 4), tauter=20000.0,
    ),
    "chord": Case(
        "Example 2's guy, top moved along the chord", 15000.0, 0.05, 0.003, (5.0, 14.0), 8,
        ((PITCHFORK, OUT_OF_PLANE, 1), (PITCHFORK, OUT_OF_PLANE, 2), (FOLD, IN_PLANE, 1), (FOLD, IN_PLANE, 2),
         (DOUBLING, OUT_OF_PLANE, 1), (DOUBLING, OUT_OF_PLANE, 2), (DOUBLING, IN_PLANE, 1), (DOUBLING, IN_PLANE, 2)),
        (1, 2, 3, 4), (), direction=(20.4 / math.hypot(20.4, 57.7), 57.7 / math.hypot(20.4, 57.7)),
    ),
    "sagging": Case(
        "sagging guy", 4050.0, 0.15, 0.003, (4.0, 7.0), 16,
        ((FOLD, IN_PLANE, 1), (FOLD, IN_PLANE, 2), (PITCHFORK, OUT_OF_PLANE, 1), (PITCHFORK, OUT_OF_PLANE, 2),
         (FOLD, IN_PLANE, 3), (DOUBLING, OUT_OF_PLANE, 1)),
        (2, 4, 6, 8), (2, 4, 6),
    ),
}  # fmt: skip
LINKS = (10, 20, 40, 80, 160)


def numbered(events: Iterable[tuple[str, str, float]]) -> dict[Name, float]:
    """Return the angular frequencies of bifurcations (kind, set, frequency) by kind, set and number along the branch."""
    found: dict[Name, float] = {}
    for kind, which, omega in events:
        number = 1 + sum(name[:2] == (kind, which) for name in found)
        found[kind, which, number] = omega
    return found


def spent(call: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Return the median processor time of a call [s], after one to warm up."""
    call()
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return statistics.median(times)


def traced(solver: Any, start: State, frequency: tuple[float, float]) -> Branch:
    """Trace some points from a solution near the lower frequency, without multipliers."""
    scale = solver.model.scales[0]
    state, direction, _ = solver.at_frequency(start)
    branch = Branch(0)
    limits = Limits(frequency[0] / scale, frequency[1] / scale, TIMED_POINTS)
    turned = direction if direction[-1] > 0.0 else -direction
    trace(solver, branch, state, turned, limits, lambda branch, is_least: True, stability=False)
    return branch


def times_of(
    solver: Any, start: State, frequency: tuple[float, float], multipliers: Callable[[State], Any]
) -> tuple[float, float]:
    """Return the time of a point [s], and that with all its multipliers."""
    states = [point.state for point in traced(solver, start, frequency).points]
    orbit = spent(lambda: traced(solver, start, frequency)) / len(states)
    some = states[:: max(1, len(states) // 5)]
    return orbit, orbit + spent(lambda: [multipliers(state) for state in some]) / len(some)


def reduced(case: Case, modes: xr.Dataset, rank: int, order: str = "leading") -> tuple[dict[Name, float], float, float]:
    """Return the bifurcations of the condensed model, and its times of a point [s]."""
    found = cp.periodic.frequency_response(
        case.scene(), modes, frequency=case.frequency, rank=rank, order=order, follow=(), outputs=()
    )
    found = found.isel(bifurcation=found["bifurcation_branch"].values == 1)
    events = numbered(
        (str(kind), str(which), float(omega))
        for kind, which, omega in zip(
            found["bifurcation_kind"].values, found["bifurcation_set"].values,
            found["bifurcation_angular_frequency"].values, strict=True,
        )
    )  # fmt: skip
    model, _ = model_of(case.scene(), modes, rank=rank, order=order, out_of_plane=True)
    solver = solver_of(model)
    start = solver.rest(case.frequency[0] / model.scales[0], MIN_HARMONICS)
    return events, *times_of(solver, start, case.frequency, solver.stability)


def full(case: Case, scales: PeriodicModel, links: int) -> tuple[dict[Name, float], float, float]:
    """Return the bifurcations of a chain, and its times of a point [s]."""
    solver = ChainSolver(ChainModel.of(case.scene(), scales, links), case.harmonics)
    _, events = main_branch(solver, case.frequency)
    found = numbered((event.kind, event.which, event.state.omega * scales.scales[0]) for event in events)
    start = solver.rest(case.frequency[0] / scales.scales[0])
    return found, *times_of(solver, start, case.frequency, solver.multipliers)


def snapshots(case: Case, links: int, duration: float = 60.0) -> xr.Dataset:
    """Return a run of the chain from rest at the middle frequency, transients included."""
    times = np.arange(round(duration / 0.05) + 1) * 0.05
    return cp.chain.simulate(case.scene(), links=links, times=times, tolerance=1e-3, outputs=("position",))


def study(
    case: Case, links: tuple[int, ...] = LINKS, progress: Callable[[str], None] = lambda text: None
) -> xr.Dataset:
    """Return errors and times of chains and condensed models of one case, along `setting`."""
    scene = case.scene()
    vibrations = cp.condensed.vibration_modes(scene, rank=max(case.ranks), links=MODE_LINKS)
    scales, _ = model_of(scene, vibrations, rank=2, order="leading", out_of_plane=True)
    rows: list[tuple[str, int, tuple[dict[Name, float], float, float]]] = []
    for count in links:
        progress(f"{case.title}: chain of {count} links")
        rows.append(("chain", count, full(case, scales, count)))
    for rank in case.ranks:
        rows.append(("vibration modes", rank, reduced(case, vibrations, rank)))
    for rank in case.ranks[:3]:
        rows.append(("order exact", rank, reduced(case, vibrations, rank, "exact")))
    if case.tauter:
        tauter = cp.condensed.vibration_modes(replace(case, top_tension=case.tauter).scene(), rank=2, links=MODE_LINKS)
        rows.append(("tauter modes", 2, reduced(case, tauter, 2)))
    if case.pod_ranks:
        progress(f"{case.title}: snapshots")
        pod = cp.pod.decompose(snapshots(case, links[-1]), layout="normal", rank=max(case.pod_ranks))
        rows += [("POD modes", rank, reduced(case, pod, rank)) for rank in case.pod_ranks]
    omega = np.array([[found.get(name, np.nan) for name in case.names] for _, _, (found, _, _) in rows])
    fine, coarse = omega[len(links) - 1], omega[len(links) - 2]
    truth = fine + (fine - coarse) / ((links[-1] / links[-2]) ** 2 - 1.0)
    result = xr.Dataset(
        {
            "angular_frequency": (("setting", "bifurcation"), omega),
            "truth": ("bifurcation", truth),
            "error": (("setting", "bifurcation"), np.abs(omega / truth - 1.0)),
            "error_max": ("setting", np.abs(omega / truth - 1.0).max(axis=1)),
            "orbit_time": ("setting", np.array([row[2][1] for row in rows])),
            "multiplier_time": ("setting", np.array([row[2][2] for row in rows])),
            "family": ("setting", np.array([row[0] for row in rows])),
            "size": ("setting", np.array([row[1] for row in rows])),
        },
        coords={"bifurcation": [f"{kind}, {which}, {number}" for kind, which, number in case.names]},
    )
    names = {
        "angular_frequency": ("rad s-1", "angular frequency of the bifurcation"),
        "truth": ("rad s-1", "angular frequency extrapolated from the two finest chains"),
        "error": ("1", "relative error of the frequency"),
        "error_max": ("1", "largest relative error of the frequencies, nan where one is missing"),
        "orbit_time": ("s", "processor time of a point of the branch"),
        "multiplier_time": ("s", "processor time of a point with all its multipliers"),
        "family": ("1", "chain, or basis of the condensed model"),
        "size": ("1", "number of links or modes"),
    }
    for name, (units, text) in names.items():
        result[name].attrs.update(units=units, long_name=text)
    result.attrs.update(title=case.title, stage="comparison", harmonics=case.harmonics, mode_links=MODE_LINKS)
    return result


# --- figure and tables ------------------------------------------------------------------------------------------------

STYLES = {
    "chain": ("s-", "0.35"), "vibration modes": ("o-", "#0072B2"), "order exact": ("^-", "#009E73"),
    "tauter modes": ("v", "#CC79A7"), "POD modes": ("D-", "#D55E00"),
}  # fmt: skip


def draw(results: dict[str, xr.Dataset], path: Path) -> None:
    """Draw the largest error over the time of a point with all multipliers, a panel for each case."""
    picture, axes = plt.subplots(
        1,
        len(results),
        figsize=(4.9 * len(results), 4.0),
        sharex=True,
        sharey=True,
        layout="constrained",
        squeeze=False,
    )
    for ax, result in zip(axes[0], results.values(), strict=True):
        for family, (style, color) in STYLES.items():
            part = result.isel(setting=result["family"].values == family)
            if not part.sizes["setting"]:
                continue
            label = f"{family}, links" if family == "chain" else f"condensed, {family}"
            ax.loglog(1e3 * part["multiplier_time"], part["error_max"], style, color=color, ms=5, label=label)
            for size, x, y in zip(
                part["size"].values, part["multiplier_time"].values, part["error_max"].values, strict=True
            ):
                if np.isfinite(y):
                    ax.annotate(
                        str(size), (1e3 * x, y), xytext=(4, 4), textcoords="offset points", fontsize=8, color=color
                    )
        ax.set_title(result.attrs["title"], fontsize=10)
        ax.set_xlabel("processor time of a point with all multipliers [ms]")
        ax.grid(alpha=0.3, which="both", lw=0.4)
    axes[0, 0].set_ylabel("largest relative error of the frequencies [1]")
    axes[0, 0].legend(fontsize=8)
    picture.savefig(path, dpi=75)
    plt.close(picture)


def table_of_times(result: xr.Dataset) -> str:
    """Write errors and times of all settings, and the times of a chain as accurate over those of condensed models."""
    chains = result.isel(setting=result["family"].values == "chain").sortby("error_max")
    known = np.log(chains["error_max"].values)
    lines = []
    for row in rows_of(result):
        cells = [str(row["family"].values), str(int(row["size"])), f"{float(row['error_max']):.1e}"]
        cells += [f"{1e3 * float(row[name]):.2g}" for name in ("orbit_time", "multiplier_time")]
        error = np.log(float(row["error_max"]))
        if row["family"] != "chain" and known[0] <= error <= known[-1]:
            for name in ("orbit_time", "multiplier_time"):  # powers of the error between two chains
                as_good = np.exp(np.interp(error, known, np.log(chains[name].values)))
                cells.append(f"{as_good / float(row[name]):.0f}")
        lines.append(cells + [""] * (7 - len(cells)))
    head = (
        "model",
        "links or modes",
        "largest error",
        "orbit, ms",
        "with multipliers, ms",
        "orbit, ratio",
        "all, ratio",
    )
    return markdown_table(head, lines)


def rows_of(result: xr.Dataset) -> list[xr.Dataset]:
    """Return the settings one by one."""
    return [result.isel(setting=i) for i in range(result.sizes["setting"])]


def table_of_frequencies(result: xr.Dataset) -> str:
    """Write the extrapolated frequencies, and the relative errors of all settings."""
    head = ["bifurcation", "frequency, rad/s"]
    letters = {
        "chain": "n",
        "vibration modes": "r",
        "order exact": "exact r",
        "tauter modes": "tauter r",
        "POD modes": "POD r",
    }
    head += [f"{letters[str(row['family'].values)]} = {int(row['size'])}" for row in rows_of(result)]
    lines = []
    for i, name in enumerate(result["bifurcation"].values):
        part = result.isel(bifurcation=i)
        text = str(name).replace("_", " ").replace(", out of plane", " out of the plane").replace(", in plane", "")
        lines.append([text, f"{float(part['truth']):.5f}", *(f"{value:.1e}" for value in part["error"].values)])
    return markdown_table(head, lines)


def main() -> None:
    """Run, write, print and draw."""
    quick = "chains of 10 to 40 links, the first case only"
    parser = command_line(__doc__, out="out/periodic", readme=True, quick=quick)
    parser.add_argument("--case", choices=tuple(CASES), action="append", help="a case; others are read from --out")
    given = parser.parse_args()
    names = ("guy",) if given.quick else tuple(given.case or CASES)
    links = (10, 20, 40) if given.quick else LINKS
    results = {name: study(CASES[name], links, progress=lambda text: print(text, flush=True)) for name in names}
    for name in CASES if given.case else ():
        if name not in results and (given.out / f"{name}.nc").exists():
            results[name] = cp.archive.read(given.out / f"{name}.nc")
    page = HERE if given.readme else None
    tables = {f"{name} times": table_of_times(result) for name, result in results.items()}
    tables |= {f"{name} frequencies": table_of_frequencies(result) for name, result in results.items()}
    given.out.mkdir(parents=True, exist_ok=True)
    for name, result in results.items():
        cp.archive.write(result, given.out / f"{name}.nc", overwrite=True)
    publish(given.out, "periodic", None, draw=lambda path: draw(results, path), page=page, tables=tables)
    print("\n\n".join(tables.values()))


if __name__ == "__main__":
    main()
