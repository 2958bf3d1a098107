"""Split the error of the condensed model into its terms, in Examples 2 to 4.

    python pipelines/error_budget/run.py [--out FOLDER] [--readme] [--quick]

Writes error_budget.nc and error_budget.png.

Modes come from a chain of 40 links (125 s, every 0.1 s).  All numbers are maximum distances over time, over the motion.
"against the cable": distance of the model of order "inertial" from the continuous cable by the same law, all that follows in one.
"links": distance of the chain from the continuous cable.  The other terms are those beside the links, against that chain.
"projection": distance of the chain's deflection from the span of the modes, the minimum for any model on them.
"leading", "exact", "inertial": the orders of the model, extrapolated in the step.
"..., all modes": the same with all modes that moved (29 to 39): the error of the model, without that of the truncation.
"step": correction of "inertial" by extrapolation at 0.05 of the stability limit (of eight modes where there are fewer).
"rotation of the chord": change of the model with chordwise inertia when mu [(zeta - S/L0 c) theta'' + 2 (zeta - S/L0 c)' theta'
- w theta'^2] normal to the chord is added, zeta the distance along the chord and theta its angle.
"truncated, ...": change of the retained amplitudes in the model with all modes when the truncated ones do not act on them: in
the tension, in the force, in both.  (Without chordwise inertia; each from its own equilibrium.)
"oblique": the model with chordwise inertia whose equations are projected not onto the modes but onto as many vibration modes of
the chain at its mean tension, chosen by a QR decomposition with pivoting of their products with the modes; extrapolated in the
step.  Their product with the force of the truncated modes is smaller; that force is the larger part of "truncated, in both" in
Examples 2 and 3 at r = 3.
"oblique, tension given": the same with the shortening of the cable by the truncated modes given from the chain at each instant:
the one number of the tension that such a model lacks.
"explained": the share of the variance of that number, over the second half of the time, explained by a polynomial of second order
in the amplitudes, their rates, the chord and its rate that was fitted over the first half (below 0 the mean does better).  The
rest does not follow from the state of the model by such a fit.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, percent, publish
from matplotlib import pyplot as plt
from prediction.run import motion_of, run_model
from scipy.linalg import eigh, qr
from tqdm import tqdm

import cablepod as cp
from cablepod import examples as shipped
from cablepod.condensed._coefficients import ORDERS
from cablepod.discretisation._chain import chain_of
from cablepod.parameters._from_scene import parameters
from cablepod.pod._normal import deflections
from error_budget.model import Switched, taken_length

HERE = Path(__file__).resolve().parent
EXAMPLES = ("example2", "example3", "example4")
RANKS = (1, 2, 3, 4, 6, 8)
LINKS = 40
#: Elements of the continuous cable (32 differ by 1e-6 of the motion or less, see data/truth) and its step [s].
ELEMENTS, CABLE_STEP = 8, 8e-5
TERMS = (
    "against the cable", "links", "projection", *ORDERS, *(f"{order}, all modes" for order in ORDERS), "step",
    "rotation of the chord", "truncated, in the tension", "truncated, in the force", "truncated, in both",
    "oblique projection", "oblique", "oblique, tension given",
)  # fmt: skip
#: Terms of the table of the page, by their names there.
PAGE_TERMS = {
    "against the cable": "**model, inertial, against the continuous cable**",
    "links": "chain of 40 links against the continuous cable",
    "projection": "projection",
    "inertial": "model, inertial",
    "truncated, in the tension": "truncated modes, not seen in the tension",
    "truncated, in the force": "truncated modes, not seen in the force",
    "truncated, in both": "truncated modes, in both",
    "step": "what the step adds before extrapolation",
    "rotation of the chord": "rotation of the chord",
    "oblique": "oblique model",
    "oblique, tension given": "oblique model, tension given",
}
#: Step of the model with switches [s]: a third of the stability limit of 39 modes in Example 3; its error cancels in differences.
STEP = 0.005


def distance(a: np.ndarray, b: np.ndarray, motion: float) -> float:
    """Return the maximum rms distance of deflections (times, particle) over the motion."""
    return float(np.sqrt(np.mean((a - b) ** 2, axis=1)).max() / motion)


def vibration_modes(scene: xr.Dataset, tension: np.ndarray) -> np.ndarray:
    """Return mass-orthonormal modes (mode, particle) of a chain without sag at given tensions of its links [N]."""
    p = parameters(scene)
    chain = chain_of(p, LINKS)
    difference = np.diff(np.eye(LINKS + 1), axis=0) / chain.length[:, None]
    stiffness = (difference.T * (chain.length * tension)) @ difference
    vectors = eigh(stiffness[1:-1, 1:-1], np.diag(p.mass * chain.tributary_length[1:-1]))[1]
    return np.pad(vectors.T, ((0, 0), (1, 1)))


def chosen_tests(modes: np.ndarray, vibrations: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Choose as many vibration modes as there are modes, by their products with them."""
    order = qr((modes * mass) @ vibrations.T, mode="r", pivoting=True)[1]
    return vibrations[order[: len(modes)]]


def explained(taken: np.ndarray, state: np.ndarray) -> float:
    """Return the share of the variance of `taken` explained by a quadratic of `state`.

    The fit is over the first half of the times, the share over the second.
    """
    x = (state - state.mean(axis=0)) / state.std(axis=0)
    i, j = np.triu_indices(x.shape[1])
    features = np.concatenate([np.ones((len(x), 1)), x, x[:, i] * x[:, j]], axis=1)
    half = len(x) // 2
    fitted = features @ np.linalg.lstsq(features[:half], taken[:half], rcond=1e-8)[0]
    return float(1.0 - np.mean((taken - fitted)[half:] ** 2) / np.var(taken[half:]))


def budget(name: str, duration: float, ranks: tuple[int, ...] = RANKS) -> tuple[np.ndarray, np.ndarray]:
    """Return all terms of one example (term, rank), and the explained share (rank,)."""
    scene = shipped.scene(name)
    times = np.arange(round(duration * 10) + 1) * 0.1
    chain = cp.chain.simulate(
        scene, links=LINKS, times=times, scheme="velocity_verlet", step=1.25e-4, outputs=("position", "tension")
    )
    options: dict[str, Any] = {"law": "linear", "elements": ELEMENTS, "step": CABLE_STEP, "points": LINKS + 1}
    cable = cp.cable.simulate(scene, times=times, outputs=("position",), **options)
    modes = cp.pod.decompose(chain, layout="normal")
    shape, motion = modes["mode_shape"].values, motion_of(chain)
    real = deflections(chain["position"].values)[0]
    model = Switched(scene, times, LINKS)
    whole = model.run(shape, STEP)
    mass, length = (model.parts(STEP)[key] for key in ("mass", "length"))
    vibrations = vibration_modes(scene, chain["tension"].values.mean(axis=0))
    result, shares = np.full((len(TERMS), len(ranks)), np.nan), np.full(len(ranks), np.nan)
    chord = np.linalg.norm(np.diff(chain["position"].values[:, [0, -1]], axis=1)[:, 0], axis=1)

    def put(term: str, k: int | slice, value: float) -> None:
        result[TERMS.index(term), k] = value

    def model_error(rank: int | None, order: str) -> float:
        return float(cp.compare.errors(run_model(scene, modes, rank, order, times), chain)["error_max"])

    put("links", slice(None), float(cp.compare.errors(chain, cable)["error_max"]))
    for order in ORDERS:
        put(f"{order}, all modes", slice(None), model_error(None, order))
    for k, rank in enumerate(ranks):
        few = np.ascontiguousarray(shape[:rank])
        project = few.T @ few
        put("projection", k, distance(real @ project, real, motion))
        for order in ORDERS:
            put(order, k, model_error(rank, order))
        run = run_model(scene, modes, rank, "inertial", times)
        put("against the cable", k, float(cp.compare.errors(run, cable)["error_max"]))
        put("step", k, run.attrs["step_error"])
        plain = model.run(few, STEP, inertia=True)
        put("rotation of the chord", k, distance(model.run(few, STEP, inertia=True, frame=True), plain, motion))
        for what in ("tension", "force", "both"):
            seen = model.run(shape, STEP, rank=rank, hidden=what)
            change = distance(seen @ project, whole @ project, motion)
            put(f"truncated, in {'both' if what == 'both' else 'the ' + what}", k, change)
        tests = chosen_tests(few, vibrations, mass)
        onto = np.linalg.solve((tests * mass) @ few.T, tests * mass)
        put("oblique projection", k, distance(real @ onto.T @ few, real, motion))
        coarse, fine = (model.run(few, step, tests=tests, inertia=True) for step in (STEP, 0.5 * STEP))
        put("oblique", k, distance((4.0 * fine - coarse) / 3.0, real, motion))
        known = real @ onto.T
        taken = taken_length(real, length) - taken_length(known @ few, length)
        coarse, fine = (model.run(few, step, tests=tests, inertia=True, taken=taken) for step in (STEP, 0.5 * STEP))
        put("oblique, tension given", k, distance((4.0 * fine - coarse) / 3.0, real, motion))
        state = np.column_stack([known, chord])
        shares[k] = explained(taken, np.column_stack([state, np.gradient(state, times, axis=0)]))
    return result, shares


def report(
    *,
    examples: tuple[str, ...] = EXAMPLES,
    ranks: tuple[int, ...] = RANKS,
    duration: float = 125.0,
    progress: Callable[..., Any] = iter,
) -> xr.Dataset:
    """Return the budget as a Dataset over (example, term, rank)."""
    found = [budget(name, duration, ranks) for name in progress(examples)]
    error = (
        ("example", "term", "rank"),
        np.array([item[0] for item in found]),
        {"units": "1", "long_name": "largest distance over time, over the motion"},
    )
    shares = (
        ("example", "rank"),
        np.array([item[1] for item in found]),
        {
            "units": "1",
            "long_name": "share of what truncated modes take from the length that the model's state explains",
        },
    )
    result = xr.Dataset(
        {"error": error, "explained": shares},
        coords={"example": list(examples), "term": list(TERMS), "rank": list(ranks)},
    )
    result["rank"].attrs.update(units="1", long_name="number of modes")
    result.attrs.update(title="Error budget of the condensed model", stage="comparison", duration=duration)
    return result


def draw(result: xr.Dataset, path: Path) -> None:
    """Draw the budget."""
    styles = {
        "against the cable": ("o-", "black", 2.2), "links": ("--", "black", 1.0),
        "inertial": ("-", "#56B4E9", 1.8), "exact": ("-", "#0072B2", 1.8), "leading": ("-", "#D55E00", 1.8),
        "projection": (":", "black", 1.8),
        "truncated, in the force": ("^--", "#009E73", 1.0), "truncated, in the tension": ("v--", "#CC79A7", 1.0),
        "oblique": ("s-", "#E69F00", 1.0), "oblique, tension given": ("+:", "#E69F00", 1.4),
        "rotation of the chord": ("x:", "0.4", 1.0),
    }  # fmt: skip
    shared: dict[str, Any] = {"sharex": True, "sharey": True, "layout": "constrained", "squeeze": False}
    picture, axes = plt.subplots(1, result.sizes["example"], figsize=(13, 4.4), **shared)
    for ax, name in zip(axes[0], result["example"].values, strict=True):
        part = result["error"].sel(example=name)
        for term, (style, color, width) in styles.items():
            ax.semilogy(part["rank"], part.sel(term=term), style, color=color, lw=width, ms=4, label=term)
        ax.set_title(f"Example {name[-1]}", fontsize=10)
        ax.set_xticks(part["rank"].values)
        ax.grid(alpha=0.3)
    axes[0, 0].set_ylabel("largest error over time, over the motion [1]")
    axes[0, 0].set_ylim(1e-7, 0.1)
    axes[0, -1].legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    picture.supxlabel("number of modes r [1]", fontsize=10)
    picture.savefig(path, dpi=75)
    plt.close(picture)


def tables(result: xr.Dataset) -> dict[str, str]:
    """Write a table for each example."""
    found = {}
    for name in result["example"].values:
        of = result.sel(example=name)
        lines = [[str(term), *map(percent, of["error"].sel(term=term).values)] for term in of["term"].values]
        lines.append(["explained", *(f"{value:.2g}" for value in of["explained"].values)])
        found[str(name)] = markdown_table([str(name), *(f"r = {rank}" for rank in of["rank"].values)], lines)
    return found


def page_table(result: xr.Dataset) -> str:
    """Write the table of Example 3 for the page."""
    of = result["error"].sel(example="example3")
    lines = [[text, *map(percent, of.sel(term=term).values)] for term, text in PAGE_TERMS.items()]
    return markdown_table(["Example 3", *(f"r = {rank}" for rank in of["rank"].values)], lines)


def main() -> None:
    """Run, write, print and draw."""
    quick = "Example 2, two numbers of modes, 10 s"
    given = command_line(__doc__, out="out/error_budget", readme=True, quick=quick).parse_args()
    begin = time.perf_counter()
    options: dict[str, Any] = {"examples": EXAMPLES[:1], "ranks": (2, 4), "duration": 10.0} if given.quick else {}
    result = report(progress=tqdm, **options)
    publish(
        given.out,
        "error_budget",
        result,
        draw=lambda path: draw(result, path),
        page=HERE if given.readme else None,
        tables={} if given.quick else {"example3": page_table(result)},
    )
    print("\n\n".join(tables(result).values()))
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
