"""Predict guys that the modes were not trained on.

    python pipelines/prediction/run.py [--out FOLDER] [--seed SEED] [--scenes COUNT] [--readme] [--quick]

Scenes over ranges of tension, motion, load and place.  Writes prediction.nc and prediction.png.

Training sets, each with modes of the deflection normal to the chord:
"example 2": the paper's Example 2 alone.
"designed": ten chains.  128 candidates are drawn over the ranges (another seed than the test's) and run by a surrogate, the
condensed model on 12 sine modes, which needs no training.  Candidates whose surrogate goes slack are left out, as the model does
not hold there.  The choice is greedy: the next sample is the candidate with the maximum distance (over time, over its motion)
from the span of RANK modes of the samples so far, each sample weighted alike (its snapshots are divided by its motion) and none
taken twice.  It prefers unusual shapes: tension near the minimum that carries the cable, wind, tops that move fast or inwards.
"itself": each scene's own chain.  Not a prediction, but the best that modes can do.
"static and vibration": cp.condensed.vibration_modes of each scene with static modes, from the scene at rest, without any run.
"vibration": the same without static modes.
"sines": sin(k pi sigma), the control.

Test: scenes from a scrambled Sobol sequence over the ranges, each against its chain of 40 links over 125 s, every 0.1 s, with
quadrature at the links, so that both share one discretisation.  Steps: the chain takes a fifth of its stability limit, the model
0.1 and 0.05 of that of its largest number of modes, extrapolated (second order), so that the error is the model's and not that
of its step.
Scenes stand apart, by the chain alone, where links go slack (the model itself reports a negative chordwise force), where two fine
steps disagree, or where a small change of the motion grows faster than in proportion to time; of those, statistics are compared,
as single trajectories mean nothing.

The Galerkin model of the paper, on separate modes of x and y from Example 2 and from the designed set, runs on the same scenes
for ESTIMATED_RANKS, by the chain's law.

Beside each error of a prediction stand the model's own error estimate, which uses no truth, and the distance of the scene from
the training scenes.
"""

from __future__ import annotations

import itertools
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, percent, publish
from scipy.stats import spearmanr
from tqdm import tqdm

import cablepod as cp
from cablepod import examples as shipped
from cablepod.condensed._assembly import model_of
from cablepod.condensed._coefficients import ORDERS
from cablepod.integrate._comparison import motion_scale
from cablepod.parameters._from_scene import parameters
from cablepod.pod import _normal as pod_normal
from prediction import figure
from prediction.scenes import LINKS, RANGES, Case, cases, draw, scene_of

HERE = Path(__file__).resolve().parent
SETS = ("example 2", "designed", "itself", "static and vibration", "vibration", "sines")
RANKS = (1, 2, 3, 4, 6, 8)
#: Numbers of modes in the table of the page.
TABLE_RANKS = (2, 4, 6, 8)
#: Number of modes that the training set is designed for.
RANK = 6
SAMPLES, CANDIDATES, DESIGN_SEED, SINES = 10, 128, 7, 12
#: Scenes and seed of the test.
SCENES, SEED = 48, 1974
#: Step of the model over the stability limit of the largest of RANKS; a second run takes half.  Nothing damps free vibrations,
#: so that errors of their phases add up: with few modes, steps near the stability limit are far too long.
PART = 0.1
#: Pairs of order and training set left out to save time (the effect of the order differs little from set to set).
SKIPPED = {("exact", name) for name in SETS if name != "designed"} | {("leading", "sines")}
#: Training sets with orders, and numbers of modes, whose error estimate is compared with the error.
ESTIMATED = (("example 2", "inertial"), ("designed", "leading"), ("designed", "inertial"))
ESTIMATED_RANKS = (2, 4, 6)
#: Training sets of the Galerkin model, with modes of each coordinate as in the paper, and its time error.
GALERKIN_SETS, GALERKIN_TOLERANCE = ("example 2", "designed"), 1e-5
#: Bounds of the classes of distance from the training scenes.
OUTSIDE = (-1.0, 0.0, 0.5, 1.0, 2.0, 4.0, np.inf)

# --- training -----------------------------------------------------------------------------------------------------------


def sines(count: int = LINKS - 1) -> xr.Dataset:
    """Return sine modes of the layout "normal"."""
    sigma = np.linspace(0.0, 1.0, LINKS + 1)
    shape = np.sqrt(2.0 / LINKS) * np.sin(np.pi * np.outer(np.arange(1, count + 1), sigma))
    shape[:, [0, -1]] = 0.0
    return xr.Dataset(
        {
            "mode_shape": (("mode", "particle"), shape),
            "singular_value": ("mode", np.ones(count)),
            "unstretched_length": 1.0,
        },
        coords={"mode": np.arange(1, count + 1), "coordinate": ["x", "y"], "arc_length": ("particle", sigma)},
        attrs={"layout": "normal", "weights": "None"},
    )


def motion_of(trajectory: xr.Dataset) -> float:
    """Return the maximum rms displacement from the first shape [m]."""
    position = trajectory["position"].values
    return motion_scale(position, position[0], float(np.linalg.norm(position[0, -1] - position[0, 0])))


def joint_modes(runs: list[xr.Dataset], **options: Any) -> xr.Dataset:
    """Decompose several trajectories, each weighted alike."""
    sigma = np.linspace(0.0, 1.0, LINKS + 1)
    scaled = [
        xr.Dataset(
            {"position": run["position"].variable / motion_of(run), "scene_feature": run["scene_feature"].variable},
            coords={"coordinate": run["coordinate"].values, "feature": run["feature"].values},
        )
        for run in runs
    ]
    joined = xr.concat(scaled, dim="member", join="override").assign_coords(arc_length=("particle", sigma))
    return cp.pod.decompose(joined, **options)


def candidates(count: int, duration: float) -> tuple[list[dict[str, float]], list[np.ndarray]]:
    """Return scenes over the ranges, and their deflections (times, particle) over their motion by the surrogate."""
    base, kept, shapes = sines(SINES), [], []
    for values in draw(count, DESIGN_SEED):
        try:
            scene = scene_of(values, duration)
            times = np.arange(0.0, duration, 0.5)
            run = cp.condensed.simulate(scene, base, order="leading", scheme="trapezoidal", step=0.02, times=times)
        except (cp.SceneError, cp.RunStopped):
            continue
        if run.attrs["smallest_chordwise_force"] > 0.0:
            kept.append(values)
            shapes.append(pod_normal.deflections(run["position"].values)[0] / motion_of(run))
    return kept, shapes


def greedy(shapes: list[np.ndarray], count: int) -> list[int]:
    """Choose candidates greedily by their distance from RANK modes of earlier choices."""
    squares = [part.T @ part / len(part) for part in shapes]
    chosen: list[int] = []
    while len(chosen) < min(count, len(shapes)):
        total = np.sum([squares[i] for i in chosen], axis=0) if chosen else np.zeros_like(squares[0])
        modes = np.linalg.eigh(total)[1][:, ::-1][:, : RANK if chosen else 0]
        left = [np.sqrt(np.mean((part - part @ modes @ modes.T) ** 2, axis=1)).max() for part in shapes]
        chosen.append(max((i for i in range(len(shapes)) if i not in chosen), key=left.__getitem__))
    return chosen


def training_sets(
    samples: int, count: int, duration: float
) -> tuple[dict[str, xr.Dataset], dict[str, xr.Dataset], list[dict[str, float]]]:
    """Return modes, those of the Galerkin model, and the samples of the designed set.

    Modes by training set, without "itself".
    """
    given = shipped.scene("example2")
    times = np.arange(round(duration * 10) + 1) * 0.1
    example = cp.chain.simulate(given, links=LINKS, times=times, scheme="velocity_verlet", step=2e-4)
    values, shapes = candidates(count, duration)
    chosen = [values[i] for i in greedy(shapes, samples)]
    runs = [Case(item, duration).truth for item in chosen]
    normal = {"layout": "normal"}
    modes = {
        "example 2": cp.pod.decompose(example, **normal), "designed": joint_modes(runs, **normal), "sines": sines(),
    }  # fmt: skip
    # not centred: the mean of scenes scaled by their motion is no shape of a cable
    separate = {"example 2": cp.pod.decompose(example), "designed": joint_modes(runs, center=False)}
    return modes, separate, chosen


# --- the model against the chain ----------------------------------------------------------------------------------------


def run_model(
    scene: xr.Dataset,
    modes: xr.Dataset,
    rank: int | None,
    order: str,
    times: np.ndarray,
    outputs: tuple[str, ...] = ("position",),
) -> xr.Dataset:
    """Run the condensed model with two steps and extrapolate the positions."""
    most = min(max(rank or 0, RANKS[-1]), pod_normal.sets(modes)[0][1].shape[0])
    model = model_of(parameters(scene), modes, rank=None if rank is None else most, order=order, law="linear")
    q, v = model.initial()
    h = model.force(q, v, model.initial_boundary_data)[2]
    square = max(model.omega_max_squared(q, model.initial_boundary_data, h), model.omega_taut_squared(float(times[-1])))
    step = PART * 2.0 / np.sqrt(square)
    options: dict[str, Any] = {"rank": rank, "order": order, "scheme": "velocity_verlet", "times": times}
    coarse = cp.condensed.simulate(scene, modes, step=step, outputs=("position",), **options)
    fine = cp.condensed.simulate(scene, modes, step=0.5 * step, outputs=outputs, **options)
    change = (fine["position"].values - coarse["position"].values) / 3.0
    moved = motion_scale(fine["position"].values, fine["position"].values[0], 1.0)
    result = fine.assign(position=fine["position"] + change)
    result.attrs["step_error"] = float(np.sqrt(np.mean(np.sum(change**2, axis=-1), axis=-1)).max() / moved)
    return result


def error_of(
    case: Case, modes: xr.Dataset, rank: int, order: str, *, estimate: bool = False
) -> tuple[float, float, float, float]:
    """Return maximum error over time, its estimate, distance from the training scenes, and step error.

    The error is infinite where the model stops or refuses.
    """
    try:
        names = ("position", "error_estimate") if estimate else ("position",)
        run = run_model(case.scene, modes, rank, order, case.truth["time"].values, names)
    except (cp.RunStopped, cp.SceneError):
        return np.inf, np.nan, np.nan, np.nan
    error = float(cp.compare.errors(run, case.truth)["error_max"])
    told = [run.attrs.get(name, np.nan) for name in ("error_estimate", "outside_training", "step_error")]
    return error, told[0], told[1], told[2]


def galerkin_errors(case: Case, modes: dict[str, xr.Dataset]) -> np.ndarray:
    """Return errors of the Galerkin model and their estimates (2, training set, rank).

    Errors are infinite where the model stops or refuses.
    """
    result = np.full((2, len(GALERKIN_SETS), len(ESTIMATED_RANKS)), np.nan)
    for j, name in enumerate(GALERKIN_SETS):
        for k, rank in enumerate(ESTIMATED_RANKS):
            if rank > modes[name].sizes["mode"]:
                continue
            try:
                run = cp.galerkin.simulate(
                    case.scene, modes[name], rank=rank, law="linear", times=case.truth["time"].values,
                    tolerance=GALERKIN_TOLERANCE,
                )  # fmt: skip
            except (cp.RunStopped, cp.SceneError):
                result[0, j, k] = np.inf
                continue
            result[:, j, k] = float(cp.compare.errors(run, case.truth)["error_max"]), run.attrs["error_estimate"]
    return result


def projection_error(case: Case, modes: xr.Dataset, rank: int) -> float:
    """Return the maximum distance of the deflection from the span of the modes, over the motion."""
    deflection = pod_normal.deflections(case.truth["position"].values)[0]
    basis = np.linalg.qr(modes["mode_shape"].values[:rank].T)[0]
    left = deflection - deflection @ basis @ basis.T
    return float(np.sqrt(np.mean(left**2, axis=1)).max() / motion_of(case.truth))


def statistics(run: xr.Dataset) -> np.ndarray:
    """Return statistics of a run.

    Quantiles 1 % and 99 % of the tension at the top [N], and rms displacement from the first shape [m].
    """
    top, position = run["tension"].values[:, -1], run["position"].values
    moved = np.sqrt(np.mean(np.sum((position - position[0]) ** 2, axis=-1)))
    return np.array([*np.quantile(top, (0.01, 0.99)), moved])


def statistics_of(case: Case, modes: xr.Dataset) -> np.ndarray:
    """Return statistics of chain, chain with longer steps and model (3, 3).

    The model has RANK modes; a stopped run gives nan.
    """
    try:
        run = run_model(case.scene, modes, RANK, "inertial", case.truth["time"].values, ("position", "tension"))
        model = statistics(run)
    except (cp.RunStopped, cp.SceneError):
        model = np.full(3, np.nan)
    again = np.full(3, np.nan) if case.coarse is None else statistics(case.coarse)
    return np.array([statistics(case.truth), again, model])


def paper_examples(modes: xr.Dataset, duration: float, names: tuple[str, ...] = ("example3", "example4")) -> np.ndarray:
    """Return errors of modes of Example 2 in the paper's other examples (example, order, rank)."""
    times = np.arange(round(duration * 10) + 1) * 0.1
    result = np.empty((len(names), len(ORDERS), len(RANKS)))
    for i, name in enumerate(names):
        given = shipped.scene(name)
        truth = cp.chain.simulate(given, links=LINKS, times=times, scheme="velocity_verlet", step=1.25e-4)
        for j, order in enumerate(ORDERS):
            for k, rank in enumerate(RANKS):
                run = run_model(given, modes, rank, order, times)
                result[i, j, k] = float(cp.compare.errors(run, truth)["error_max"])
    return result


# --- report -------------------------------------------------------------------------------------------------------------


def report(
    *, scenes: int = SCENES, seed: int = SEED, samples: int = SAMPLES, count: int = CANDIDATES, duration: float = 125.0,
    progress: Callable[[list[Case]], Any] = iter,
) -> xr.Dataset:  # fmt: skip
    """Train, predict and compare; return a Dataset over (scene, training_set, order, rank)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cp.OutOfRangeWarning)
        warnings.simplefilter("ignore", cp.NotConvergedWarning)  # links that snap taut: their scenes stand apart
        modes, separate, chosen = training_sets(samples, count, duration)
        tested = cases(scenes, seed, duration)
        error = np.full((4, len(tested), len(SETS), len(ORDERS), len(RANKS)), np.nan)
        projected = np.full((len(tested), len(SETS), len(RANKS)), np.nan)
        numbers = np.full((len(tested), 3, 3), np.nan)
        galerkin = np.full((2, len(tested), len(GALERKIN_SETS), len(ESTIMATED_RANKS)), np.nan)
        apart = []
        for i, case in enumerate(progress(tested)):
            apart.append(case.apart)
            own = modes | {
                "itself": cp.pod.decompose(case.truth, layout="normal"),
                "static and vibration": cp.condensed.vibration_modes(case.scene, rank=RANKS[-1], static_modes=True),
                "vibration": cp.condensed.vibration_modes(case.scene, rank=RANKS[-1]),
            }
            _fill(case, own, error[:, i], projected[i])
            if not apart[-1]:
                galerkin[:, i] = galerkin_errors(case, separate)
            else:
                numbers[i] = statistics_of(case, own["designed"])
        examples = paper_examples(modes["example 2"], duration)
    place = ("scene", "training_set", "order", "rank")
    result = xr.Dataset(
        {
            "error": (place, error[0]),
            "error_estimate": (place, error[1]),
            "step_error": (place, error[3]),
            "galerkin_error": (("scene", "galerkin_set", "galerkin_rank"), galerkin[0]),
            "galerkin_error_estimate": (("scene", "galerkin_set", "galerkin_rank"), galerkin[1]),
            # the same for all numbers of modes and orders that ran
            "outside_training": (place[:2], np.fmax.reduce(error[2].reshape(len(tested), len(SETS), -1), axis=2)),
            "projection_error": (("scene", "training_set", "rank"), projected),
            "apart": ("scene", np.array(apart, dtype=str)),
            "time_error": ("scene", [case.time_error for case in tested]),
            "sensitivity": (("scene", "half"), [case.sensitivity for case in tested]),
            "least_tension": ("scene", [case.least_tension for case in tested], {"units": "N"}),
            "statistics": (("scene", "run", "statistic"), numbers),
            "example_error": (("example", "order", "rank"), examples),
            **{key: ("scene", [case.values[key] for case in tested], {"units": RANGES[key][0]}) for key in RANGES},
            **{f"sample_{key}": ("sample", [v[key] for v in chosen], {"units": RANGES[key][0]}) for key in RANGES},
        },
        coords={
            "training_set": list(SETS), "order": list(ORDERS), "rank": list(RANKS), "example": ["example3", "example4"],
            "half": ["first", "second"], "run": ["chain", "chain, longer steps", "model"],
            "galerkin_set": list(GALERKIN_SETS), "galerkin_rank": list(ESTIMATED_RANKS),
            "statistic": ["tension at the top, quantile 0.01, N", "tension at the top, quantile 0.99, N", "rms motion, m"],
        },
    )  # fmt: skip
    for name in result.variables:
        result[name].attrs.setdefault("units", "1")
        result[name].attrs["long_name"] = LONG_NAMES.get(str(name), str(name).replace("_", " "))
    result.attrs.update(
        title="Prediction of guys that the modes were not trained on", stage="comparison", seed=seed, duration=duration,
        comment="infinite: the model refused or stopped; not a number: not computed",
    )  # fmt: skip
    return result


def _fill(case: Case, modes: dict[str, xr.Dataset], error: np.ndarray, projected: np.ndarray) -> None:
    """Fill results of `error_of` (4, training_set, order, rank) and projection errors (training_set, rank) of a scene."""
    for j, name in enumerate(SETS):
        for k, rank in enumerate(RANKS):
            if rank > pod_normal.sets(modes[name])[0][1].shape[0]:
                continue
            projected[j, k] = projection_error(case, modes[name], rank)
            for m, order in enumerate(ORDERS):
                if (order, name) not in SKIPPED and not case.apart:
                    estimate = (name, order) in ESTIMATED and rank in ESTIMATED_RANKS
                    error[:, j, m, k] = error_of(case, modes[name], rank, order, estimate=estimate)


LONG_NAMES = {
    "error": "largest error over time, over the motion of the chain",
    "error_estimate": "error as the model estimates it, without any truth",
    "outside_training": "distance of the scene from the training scenes, see cablepod.reduced",
    "galerkin_error": "largest error over time of the Galerkin model, over the motion of the chain",
    "galerkin_error_estimate": "error as the Galerkin model estimates it, without any truth",
    "step_error": "error of the step before it was taken off by extrapolation",
    "projection_error": "largest distance over time of the chain's deflection from the modes, over its motion",
    "apart": "why the scene stands apart; empty where it does not",
    "time_error": "distance of chains with 0.4 and 0.2 of the longest stable step",
    "sensitivity": "change of the cable's motion over that of its end, in parts",
    "least_tension": "least tension of any link",
    "statistics": "statistics of scenes that stand apart",
    "example_error": "largest error over time, modes of Example 2",
    "size": "size of the motion of the top end along x", "frequency": "its angular frequency",
    "load": "horizontal load over weight", "tension": "tension at the top at rest",
    "inclination": "angle of the chord to the horizontal", "chord": "distance of the ends",
}  # fmt: skip


def tables(result: xr.Dataset) -> dict[str, str]:
    """Return all tables of the page by name."""
    regular = result.sel(scene=result["apart"].values == "")
    return {
        "errors": error_table(regular),
        "estimates": estimate_table(regular),
        "outside": outside_table(regular),
        "galerkin": galerkin_table(regular),
        "examples": example_table(result),
    }


def error_table(regular: xr.Dataset) -> str:
    """Write the quantiles of the errors over the scenes."""
    lines, shown = [], [rank for rank in TABLE_RANKS if rank in RANKS]
    for name in SETS:
        rows = [(order, regular["error"].sel(order=order, training_set=name)) for order in ORDERS]
        for order, values in [*rows, ("projection", regular["projection_error"].sel(training_set=name))]:
            if values.isnull().all():
                continue
            spread = [figure.quantiles(values.sel(rank=rank).values, (0.5, 0.95, 1.0)) for rank in shown]
            lines.append([name, order, *(" / ".join(percent(v) for v in three) for three in spread)])
    return markdown_table(["modes of", "order", *(f"r = {rank}" for rank in shown)], lines)


def example_table(result: xr.Dataset) -> str:
    """Write the errors of modes of Example 2 in the paper's other examples."""
    lines = [
        [str(example), order, *map(percent, result["example_error"].sel(example=example, order=order).values)]
        for example in result["example"].values
        for order in ORDERS
    ]
    return markdown_table(["example", "order", *(f"r = {rank}" for rank in RANKS)], lines)


def show(result: xr.Dataset) -> None:
    """Print all tables, the worst scenes and the scenes apart."""
    regular = result.sel(scene=result["apart"].values == "")
    others = result.sizes["scene"] - regular.sizes["scene"]
    table = tables(result)
    print(f"\n{regular.sizes['scene']} scenes, {others} apart; median / 95th percentile / largest")
    print(table["errors"])
    share = regular["step_error"] / regular["error"]
    print(f"steps: extrapolation removed {percent(float(share.median()))} of the error (median over all runs), "
          f"{percent(float(share.quantile(0.95)))} (95th percentile)")  # fmt: skip
    print("\n" + table["estimates"])
    print("\n" + table["outside"])
    for name, correlation in outside_correlations(regular).items():
        print(f"rank correlation of distance and error, {name}: {correlation:.2f}")
    print("\nGalerkin model\n" + table["galerkin"])
    keys = list(RANGES)
    print("\ndesigned samples: " + "; ".join(" ".join(f"{float(result[f'sample_{key}'][i]):.4g}" for key in keys)
          for i in range(result.sizes["sample"])) + f"  ({', '.join(keys)})")  # fmt: skip
    at = regular["error"].sel(training_set="designed", order="inertial", rank=RANK).values
    own = regular["error"].sel(training_set="itself", order="inertial", rank=RANK).values
    for i in np.argsort(at)[::-1][:6]:
        where = " ".join(f"{float(regular[key][i]):.4g}" for key in keys)
        least = float(regular["least_tension"][i])
        print(f"worst: {percent(at[i])} (on its own modes {percent(own[i])}) {where}, least tension {least:.0f} N")
    for i in np.flatnonzero(result["apart"].values != ""):
        item = result.isel(scene=i)
        text = " ".join(f"{float(item[key]):.4g}" for key in keys)
        numbers = "; ".join(" ".join(f"{v:.4g}" for v in row) for row in item["statistics"].values.T)
        print(f"apart, {item['apart'].values!s}: {text}; chain, longer steps, model: {numbers}")
    print("\nmodes of Example 2\n" + table["examples"])


def estimate_quality(error: np.ndarray, estimate: np.ndarray) -> tuple[int, float, float]:
    """Return number of pairs, rank correlation, and share within a factor of five."""
    known = np.isfinite(error) & np.isfinite(estimate)
    error, estimate = error[known], estimate[known]
    if error.size < 3:
        return error.size, np.nan, np.nan
    near = np.abs(np.log(estimate / error)) < np.log(5.0)
    return error.size, float(spearmanr(error, estimate)[0]), float(near.mean())


def _quality_cells(error: np.ndarray, estimate: np.ndarray) -> list[str]:
    count, correlation, near = estimate_quality(error, estimate)
    return [f"{count}", f"{correlation:.3f}", f"{100.0 * near:.0f} %"]


def estimate_table(regular: xr.Dataset) -> str:
    """Write the quality of the condensed model's own error estimate."""
    lines = []
    for name, order in ESTIMATED:
        for rank in sorted(set(RANKS) & set(ESTIMATED_RANKS)):
            part = regular.sel(training_set=name, order=order, rank=rank)
            lines.append([name, order, f"{rank}", *_quality_cells(part["error"].values, part["error_estimate"].values)])
    pairs = regular["error"].values.ravel(), regular["error_estimate"].values.ravel()
    lines.append(["all", "", "", *_quality_cells(*pairs)])
    return markdown_table(["modes of", "order", "r", "pairs", "rank correlation", "within a factor of 5"], lines)


def _outside(regular: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return distances from the training scenes and errors of the scenes."""
    part = regular.sel(training_set=name)
    return part["outside_training"].values, part["error"].sel(order="inertial", rank=RANKS[-2]).values


def outside_table(regular: xr.Dataset) -> str:
    """Write the errors by the distance from the training scenes."""
    lines = []
    for name in SETS[:2]:
        far, error = _outside(regular, name)
        for low, high in itertools.pairwise(OUTSIDE):
            chosen = error[(far > low) & (far <= high)]
            if chosen.size:
                place = "0" if low < 0.0 else f"{low:.2g} to {high:.2g}"
                lines.append([name, place, f"{chosen.size}", percent(np.median(chosen)), percent(chosen.max())])
    return markdown_table(["modes of", "outside by", "scenes", "median", "largest"], lines)


def outside_correlations(regular: xr.Dataset) -> dict[str, float]:
    """Return the rank correlation of distance and error by training set."""
    pairs = {name: _outside(regular, name) for name in SETS[:2]}
    return {
        name: float(spearmanr(far, error, nan_policy="omit")[0])
        for name, (far, error) in pairs.items()
        if np.isfinite(far).sum() > 2
    }


def galerkin_table(regular: xr.Dataset) -> str:
    """Write errors of the Galerkin model and the quality of its estimate."""
    lines = []
    errors, estimates = regular["galerkin_error"], regular["galerkin_error_estimate"]
    for name in GALERKIN_SETS:
        for rank in ESTIMATED_RANKS:
            pair = [item.sel(galerkin_set=name, galerkin_rank=rank).values for item in (errors, estimates)]
            spread = " / ".join(percent(v) for v in figure.quantiles(pair[0], (0.5, 1.0)))
            lines.append([name, f"{rank}", spread, *_quality_cells(*pair)])
    lines.append(["all", "", "", *_quality_cells(errors.values.ravel(), estimates.values.ravel())])
    head = ["modes of", "r", "median / largest error", "pairs", "rank correlation", "within a factor of 5"]
    return markdown_table(head, lines)


def main() -> None:
    """Run, write, print and draw."""
    parser = command_line(__doc__, out="out/prediction", readme=True, quick="three scenes of 10 s, in seconds")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--scenes", type=int, default=SCENES, help="number of scenes")
    given = parser.parse_args()
    begin = time.perf_counter()
    options: dict[str, Any] = {"scenes": given.scenes}
    if given.quick:
        options = {"scenes": 3, "samples": 3, "count": 8, "duration": 10.0}
    result = report(seed=given.seed, progress=tqdm, **options)
    publish(
        given.out,
        "prediction",
        result,
        draw=lambda path: figure.draw_errors(result, path),
        page=HERE if given.readme else None,
        tables=tables(result),
    )
    show(result)
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
