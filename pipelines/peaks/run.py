"""How often the intervals of peaks hold the true value.

    python pipelines/peaks/run.py [--sets 4000] [--storms 200] [--readme]

Sets of Gumbel peaks, and of the largest values of Gaussian records with 600 crossings, have known means and quantiles.  Storms of
one scene do not: the mean of all of them stands for it, and tens of them are the sets.  Beside the intervals of
`extremes.peaks` are those of Student's t and of a percentile bootstrap.  The scene is the guy in gusts of 660 s of
`guy_in_wind`, by the condensed model with four modes, compared from 60 s on.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import ONE_THREAD, command_line, markdown_table, show_table

os.environ.update(ONE_THREAD)

import numpy as np
import xarray as xr
from guy_in_wind.run import scene
from scipy import stats

import cablepod as cp

HERE = Path(__file__).resolve().parent
LEVEL, PROBABILITY, CROSSINGS = 0.9, 0.78, 600.0
COUNTS = (5, 10, 20, 50)
HEAD = ("peaks", "mean, here", "Student's t", "bootstrap", "quantile, here", "length over that of t")
DURATION, START, RANK = 660.0, 60.0, 4


def largest(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Draw largest values of Gaussian records, over the standard deviation: P(x) = exp(-crossings exp(-x^2 / 2))."""
    return np.sqrt(-2.0 * np.log(-np.log(rng.random(shape)) / CROSSINGS))


def students(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the intervals of the mean by Student's t, for rows of peaks."""
    n = data.shape[1]
    half = stats.t.ppf(0.5 + 0.5 * LEVEL, n - 1) * data.std(axis=1, ddof=1) / np.sqrt(n)
    return data.mean(axis=1) - half, data.mean(axis=1) + half


def bootstrap(data: np.ndarray, rng: np.random.Generator, draws: int = 1000) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the intervals of the mean by a percentile bootstrap, for rows of peaks."""
    n = data.shape[1]
    low, high = np.empty(len(data)), np.empty(len(data))
    for i, row in enumerate(data):
        means = row[rng.integers(n, size=(draws, n))].mean(axis=1)
        low[i], high[i] = np.quantile(means, [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL])
    return low, high


def covered(low: np.ndarray, high: np.ndarray, truth: float) -> float:
    """Return the part of the intervals that holds a value."""
    return float(np.mean((low <= truth) & (truth <= high)))


def row_of(name: str, data: np.ndarray, mean: float, quantile: float) -> list[str]:
    """Return the row of the table of sets of peaks (sets, n) with known mean and quantile."""
    result = cp.extremes.peaks(xr.DataArray(data, dims=("set", "member")), level=LEVEL, probability=PROBABILITY)
    low, high = students(data)
    parts = (
        covered(result.mean_low.values, result.mean_high.values, mean),
        covered(low, high, mean),
        covered(*bootstrap(data, np.random.default_rng(3)), mean),
        covered(result.quantile_low.values, result.quantile_high.values, quantile),
    )
    length = float((result.mean_high - result.mean_low).mean()) / float(np.mean(high - low))
    return [name, *(f"{100.0 * part:.1f} %" for part in parts), f"{length:.2f}"]


def synthetic(sets: int) -> list[list[str]]:
    """Return the rows of Gumbel peaks and of Gaussian records."""
    rng = np.random.default_rng(11)
    rows = [
        row_of(
            f"{n} of a Gumbel distribution",
            rng.gumbel(size=(sets, n)),
            float(np.euler_gamma),
            -np.log(-np.log(PROBABILITY)),
        )
        for n in COUNTS
    ]
    many = largest(rng, 2_000_000)
    mean, quantile = float(many.mean()), float(np.quantile(many, PROBABILITY))
    return rows + [row_of(f"{n} of Gaussian records", largest(rng, sets, n), mean, quantile) for n in COUNTS]


def storms(count: int) -> str:
    """Return a sentence on the storms of one scene, in tens."""
    guy = scene(DURATION)
    modes = cp.condensed.vibration_modes(guy, rank=RANK)
    members = cp.ensemble.design(guy, {"wind.turbulence.seed": [1, count, count]})
    parts = cp.ensemble.batches(
        members, model="condensed", modes=modes, outputs=("tension_extremes",), window=[START, DURATION]
    )
    peaks = np.concatenate([part.tension_maximum.max("link").values for part in parts])
    tens = peaks[: 10 * (count // 10)].reshape(-1, 10)
    result = cp.extremes.peaks(xr.DataArray(tens, dims=("set", "member")))
    truth = peaks.mean()
    held = int(((result.mean_low <= truth) & (truth <= result.mean_high)).sum())
    half = float((result.mean_high - result.mean_low).mean()) / 2.0
    return (
        f"{count} storms: mean peak {truth / 1e3:.2f} kN, standard deviation {peaks.std() / 1e3:.2f} kN. The intervals of "
        f"{held} of {len(tens)} tens hold that mean; half of their length is {half / 1e3:.2f} kN on average."
    )


def main() -> None:
    """Print the table and the sentence."""
    parser = command_line(__doc__, readme=True)
    parser.add_argument("--sets", type=int, default=4000, help="number of sets of each row")
    parser.add_argument("--storms", type=int, default=200, help="number of storms")
    options = parser.parse_args()
    page = HERE if options.readme else None
    show_table("coverage", markdown_table(HEAD, synthetic(options.sets)), page)
    show_table("storms", storms(options.storms), page)


if __name__ == "__main__":
    main()
