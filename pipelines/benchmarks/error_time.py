"""Error against run time of the chain and of the continuous cable on Examples 2 to 4: a Dataset, a figure, the Pareto front.

    python pipelines/benchmarks/error_time.py [--out out/error_time] [--repeats 5] [--figure pipelines/figures/error_time.png]

Largest error over time and its rms against the converged cable of the same law, (21), at every 0.1 s up to 124 s (rms over
particles over the largest rms displacement), and time of one whole call that gives positions every second, with the step given:
one thread, after compilation, median of the repeats, all in turn so that a busy machine hurts all alike.  The truth is computed
anew (24 elements of order 7; two resolutions of it differ by less than 1e-7), as the files in data/truth hold every other second
alone.
"""

from __future__ import annotations

import argparse
import statistics
import time
import warnings
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt

import cablepod as cp
from cablepod.conventions import label
from cablepod.shipped import scene

EXAMPLES = (2, 3, 4)
DURATION = 124.0
FINE = np.arange(0.0, DURATION + 1e-9, 0.1)
COARSE = np.arange(0.0, DURATION + 1e-9, 1.0)
TRUTH = {"elements": 24, "step": 2.5e-5}


def cases() -> list[dict]:
    """Return all settings that are tried; of an explicit scheme the step is a part of its limit, and so follows."""
    found: list[dict] = []
    for links in (5, 8, 10, 16, 20, 32, 40, 80, 160):
        found += [
            {"model": "chain", "scheme": "trapezoidal", "size": links, "order": 1, "step": step}
            for step in (1.0, 0.5, 0.2, 0.1, 0.02, 0.005)
        ]
        if links in (10, 20, 40, 80):
            found.append(
                {"model": "chain", "scheme": "velocity_verlet", "size": links, "order": 1, "step": 0.01 / links}
            )
    for order, counts in ((3, (2, 4, 8)), (5, (1, 2, 4)), (7, (1, 2, 3, 4, 8))):
        for count in counts:
            found += [
                {"model": "cable", "scheme": "trapezoidal", "size": count, "order": order, "step": step}
                for step in (1.0, 0.5, 0.2, 0.1, 0.02, 0.005)
            ]
            if order == 7:
                found.append(
                    {
                        "model": "cable",
                        "scheme": "velocity_verlet",
                        "size": count,
                        "order": 7,
                        "step": 6e-4 / max(count, 2),
                    }
                )
    return found


def run(given: xr.Dataset, case: dict, times: np.ndarray) -> xr.Dataset:
    """Run one setting."""
    options = {"times": times, "law": "green", "scheme": case["scheme"], "step": case["step"]}
    if case["model"] == "chain":
        return cp.chain.simulate(given, links=case["size"], **options)
    return cp.cable.simulate(given, elements=case["size"], order=case["order"], points=41, **options)


def front(seconds: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Tell which settings no other one beats in both."""
    order = np.lexsort((error, seconds))
    best, result = np.inf, np.zeros(seconds.size, dtype=bool)
    for i in order:
        if error[i] < best:
            best, result[i] = error[i], True
    return result


def study(repeats: int) -> xr.Dataset:
    """Measure errors and times of all settings."""
    settings = cases()
    shape = (len(EXAMPLES), len(settings))
    worst, rms, seconds = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
    for e, number in enumerate(EXAMPLES):
        given = scene(f"example{number}")
        wanted = sorted({41} | {case["size"] + 1 for case in settings if case["model"] == "chain"})
        truth = interpolated(given, cp.cable.simulate(given, times=FINE, points="nodes", **TRUTH), wanted)
        sound = []
        for i, case in enumerate(settings):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", cp.NotConvergedWarning)
                    result = run(given, case, FINE)
            except (cp.RunStopped, cp.SceneError):
                continue
            error = cp.compare.errors(result, truth[result.sizes["particle"]])
            worst[e, i], rms[e, i] = float(error["error_max"]), float(error["error_rms"])
            sound.append(i)
        taken: dict[int, list[float]] = {i: [] for i in sound}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cp.NotConvergedWarning)
            for i in sound:
                run(given, settings[i], COARSE)  # compiled, and warm
            for _ in range(repeats):
                for i in sound:
                    begin = time.perf_counter()
                    run(given, settings[i], COARSE)
                    taken[i].append(time.perf_counter() - begin)
        seconds[e, sound] = [statistics.median(taken[i]) for i in sound]
    result = xr.Dataset(
        {
            "error_max": (("example", "setting"), worst),
            "error_rms": (("example", "setting"), rms),
            "run_time": (("example", "setting"), seconds),
            "on_front": (
                ("example", "setting"),
                np.array([front(s, w) for s, w in zip(seconds, worst, strict=True)]).astype(np.int8),
            ),
        },
        coords={
            "example": list(EXAMPLES),
            **{
                key: ("setting", [case[key] for case in settings])
                for key in ("model", "scheme", "size", "order", "step")
            },
        },
    )
    label(
        result,
        run_time=("s", "median time of one whole call"),
        on_front=("1", "1 where no other setting is both faster and better"),
        example=("1", "number of the example of the paper"),
        model=("1", "model"),
        scheme=("1", "time scheme"),
        size=("1", "number of links of a chain, of elements of a cable"),
        order=("1", "order of the elements"),
        step=("s", "time step"),
    )
    result.attrs.update(title="Error against run time of chain and cable", repeats=repeats, law="green")
    return result


def interpolated(given: xr.Dataset, nodes: xr.Dataset, wanted: list[int]) -> dict[int, xr.Dataset]:
    """Return the truth at equidistant particles, by the polynomials of its elements."""
    from cablepod.elements import mesh_of
    from cablepod.parameters import parameters

    mesh = mesh_of(parameters(given), TRUTH["elements"], law="green", points="nodes")
    found = {}
    for points in wanted:
        place = mesh.total_length * np.linspace(0.0, 1.0, points)
        position = mesh.at(nodes["position"].values, place)
        found[points] = nodes[["time", "coordinate"]].assign(position=(("time", "particle", "coordinate"), position))
        found[points] = found[points].assign_coords(arc_length=("particle", place))
    return found


def draw(result: xr.Dataset) -> plt.Figure:
    """Draw error against run time, the front as a line."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), sharey=True, layout="constrained")
    styles = {
        ("chain", "trapezoidal"): ("o", "#0072B2"),
        ("chain", "velocity_verlet"): ("s", "#56B4E9"),
        ("cable", "trapezoidal"): ("^", "#D55E00"),
        ("cable", "velocity_verlet"): ("v", "#E69F00"),
    }
    for ax, number in zip(axes, result["example"].values, strict=True):
        of = result.sel(example=number)
        for (model, scheme), (marker, colour) in styles.items():
            rows = (of["model"].values == model) & (of["scheme"].values == scheme)
            ax.loglog(
                1e3 * of["run_time"].values[rows], of["error_max"].values[rows], marker, color=colour, ms=4.5, alpha=0.75,
                label=f"{model}, {scheme.replace('_', ' ')}",
            )  # fmt: skip
        best = np.flatnonzero(of["on_front"].values)
        best = best[np.argsort(of["run_time"].values[best])]
        ax.loglog(
            1e3 * of["run_time"].values[best],
            of["error_max"].values[best],
            "-",
            color="0.3",
            lw=1,
            zorder=0,
            label="front",
        )
        ax.set(title=f"Example {number}", xlabel="time of a whole call [ms]", ylim=(5e-9, 1.0))
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("largest error over 124 s [1]")
    axes[-1].legend(fontsize=8, loc="lower left")
    return figure


def main() -> None:
    """Measure, write, draw, print the front."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/error_time"))
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    result = study(options.repeats)
    cp.archive.write(result, options.out / "error_time.nc", overwrite=True)
    picture = draw(result)
    picture.savefig(options.figure or options.out / "error_time.png", dpi=75)
    for number in EXAMPLES:
        of = result.sel(example=number)
        print(f"Example {number}: front")
        best = np.flatnonzero(of["on_front"].values)
        for i in best[np.argsort(of["run_time"].values[best])]:
            row = of.isel(setting=i)
            name = f"{row['model'].values!s} {int(row['size'])} x {int(row['order'])}, {row['scheme'].values!s}"
            print(
                f"  {1e3 * float(row['run_time']):8.2f} ms  {float(row['error_max']):.1e}  {name}, step "
                f"{float(row['step']):.3g} s"
            )


if __name__ == "__main__":
    main()
