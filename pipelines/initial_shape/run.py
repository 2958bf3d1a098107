"""Search the initial shape of Example 2 that explains Table 2.

    python pipelines/initial_shape/run.py [--draws 3000] [--polished 8] [--seed 0] [--integrators]

Prints the best initial shapes; data/starts.csv keeps those in use.  With --integrators, tests whether a standard integrator
with loose tolerances explains it instead.  Minutes each.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line
from tqdm import tqdm

import cablepod as cp
from cablepod.examples import scene
from cablepod.paper import examples
from cablepod.paper import independent_chain as wilson
from cablepod.paper import initial_shape as starts
from cablepod.paper.datasets import described


def main() -> None:
    """Search and print."""
    parser = command_line(__doc__)
    parser.add_argument("--draws", type=int, default=3000, help="number of random draws")
    parser.add_argument("--polished", type=int, default=8, help="number of the best draws that are optimised")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--integrators", action="store_true", help="test standard integrators with loose tolerances instead"
    )
    options = parser.parse_args()
    if options.integrators:
        integrators()
        return
    with tqdm(total=1.0, disable=None, bar_format="{percentage:3.0f}% {bar} {elapsed}<{remaining}") as bar:

        def progress(part: float) -> None:
            bar.n = part
            bar.update(0)

        found = search(draws=options.draws, polished=options.polished, seed=options.seed, progress=progress)
    drawn = found["search_misfit"].values
    for limit in (0.25, 0.15, 0.1, 0.05):
        print(f"{100 * np.mean(drawn < limit):6.2f} % of {drawn.size} draws have a misfit below {limit}")
    for i in range(found.sizes["polished"]):
        cable, start, misfit = (
            float(found[f"polished_{name}"][i]) for name in ("cable_length", "start_length", "misfit")
        )
        print(f"cable {cable:.7f} m  start {start:.7f} m  misfit {misfit:.4f}")


def search(
    *,
    draws: int = 1000,
    polished: int = 5,
    cable_lengths: tuple[float, float] = (61.1530, 61.1562),
    differences: tuple[float, float] = (-0.036, 0.028),
    most_evaluations: int = 150,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Search initial shapes of another cable length: random draws, the best refined by Nelder-Mead.

    Parameters
    ----------
    draws
        Number of random pairs.
    polished
        Number of the best draws that are refined.
    cable_lengths, differences
        Ranges of the unstretched length of the cable, and of the additional length of the initial shape [m].
    most_evaluations
        Maximum number of runs of each refinement.
    seed
        Seed of the random numbers.
    progress
        Callback receiving the completed fraction, 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``search_cable_length``, ``search_start_length`` [m] and ``search_misfit (draw)`` of the draws; ``polished_*`` of the
        refined ones, best first.
    """
    from scipy.optimize import minimize  # slow to import

    base, target = scene("example2"), examples.printed_values()
    rng = np.random.default_rng(seed)
    cable = rng.uniform(*cable_lengths, size=draws)
    start = cable + rng.uniform(*differences, size=draws)

    def gap(point: np.ndarray, part: float) -> float:
        if progress is not None:
            progress(part)
        values = starts.simulated(starts.with_start(base, {"cable_length_m": point[0], "start_length_m": point[1]}))
        value = float(examples.misfit(values[:, : target.shape[1]], target))
        return value if np.isfinite(value) else 99.0  # no such cable, or diverged

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # logarithm of nan
        misfits = np.array([gap(pair, 0.7 * i / draws) for i, pair in enumerate(np.stack([cable, start], axis=1))])
        best = np.argsort(misfits)[:polished]
        ends = [
            minimize(
                lambda point, i=i: gap(point, 0.7 + 0.3 * i / polished),
                [cable[k], start[k]],
                method="Nelder-Mead",
                options={
                    "initial_simplex": np.array([cable[k], start[k]]) + 3e-4 * np.array([[0, 0], [1, 0], [0, 1]]),
                    "xatol": 1e-7,
                    "fatol": 1e-4,
                    "maxfev": most_evaluations,
                },
            )
            for i, k in enumerate(best)
        ]
    refined = sorted(ends, key=lambda end: end.fun)
    columns = {
        "search_cable_length": ("draw", cable, "m"), "search_start_length": ("draw", start, "m"),
        "search_misfit": ("draw", misfits, "1"), "polished_cable_length": ("polished", [end.x[0] for end in refined], "m"),
        "polished_start_length": ("polished", [end.x[1] for end in refined], "m"),
        "polished_misfit": ("polished", [end.fun for end in refined], "1"),
    }  # fmt: skip
    options = {
        "draws": draws, "polished": polished, "cable_lengths": list(cable_lengths), "differences": list(differences),
        "most_evaluations": most_evaluations, "seed": seed,
    }  # fmt: skip
    variables = {name: (*column, name.replace("_", " ")) for name, column in columns.items()}
    return described("initial_shape.search", options, variables, {}, [base])


def integrators() -> None:
    """Run Example 2 from equilibrium with standard integrators at tolerances near their defaults."""
    given = scene("example2")
    times = np.arange(125.0)
    target = examples.printed_values()
    for method, rtol, atol in (
        ("RK45", 1e-3, 1e-6),
        ("RK23", 1e-3, 1e-6),
        ("Radau", 1e-3, 1e-6),
        ("Radau", 1e-2, 1e-3),
    ):
        position = wilson.simulate(given, times, method=method, rtol=rtol, atol=atol)
        run = xr.Dataset(
            {"position": (("time", "particle", "coordinate"), position)},
            coords={
                "arc_length": ("particle", np.linspace(0.0, 1.0, position.shape[1])),
                "time": times,
                "coordinate": ["x", "y"],
            },
        )
        values = cp.pod.decompose(run, rank=examples.SUMMED)["singular_value"].values[:, : target.shape[1]]
        print(f"{method:<6} rtol {rtol:g} atol {atol:g}: {np.array2string(values, precision=4, suppress_small=True)}")
        print(f"       misfit {float(examples.misfit(values, target)):.3g}", flush=True)


if __name__ == "__main__":
    main()
