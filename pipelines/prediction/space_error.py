"""Compare the chain's own estimate of its error in space with the true one, and the warning of too few links.

    python pipelines/prediction/space_error.py [--scenes 48] [--readme] [--quick]

The 48 scenes of the prediction, as chains of 5, 10, 20 and 40 links with the default tolerance and
``outputs=("position", "error_estimate")``.  The true error is the largest over all tenths of a second of the rms distance over
the particles from the continuous cable, over its largest rms displacement (``compare.errors``).  The continuous cable is
``cable.simulate`` by the linear law with a tolerance of 1e-5.  The price of the estimate is the processor time of the call with
it over that of the call without, in turns, the median of all scenes.  A warning is right where the true error is above 1 %.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, in_turns, markdown_table, percent, show_table
from tqdm import tqdm

import cablepod as cp
from prediction.run import SCENES, SEED
from prediction.scenes import Case, cases

HERE = Path(__file__).resolve().parent
LINKS = (5, 10, 20, 40)
#: Number of points at which the continuous cable is given: all particles of these chains.
POINTS = 41
TRUTH_TOLERANCE = 1e-5
#: Factor within which the estimate is to be, and error that a warning announces.
FACTOR, LIKELY = 3.0, 0.01
OUTPUTS = ("position", "error_estimate")
#: Columns of a measured chain.
COLUMNS = ("error", "estimate", "warned", "price")


def truth_of(case: Case) -> xr.Dataset:
    """Return the converged continuous cable."""
    return cp.cable.simulate(case.scene, law="linear", points=POINTS, tolerance=TRUTH_TOLERANCE, outputs=("position",))


def measured(case: Case, truth: xr.Dataset, links: int, repeats: int) -> list[float]:
    """Return true error, estimate, whether a default call warns, and price of the estimate, see COLUMNS."""

    def seconds(outputs: tuple[str, ...]) -> float:
        begin = time.process_time()
        cp.chain.simulate(case.scene, links=links, outputs=outputs)
        return time.process_time() - begin

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        cp.chain.simulate(case.scene, links=links, times=truth["time"].values[[0, -1]], outputs=("position",))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = cp.chain.simulate(case.scene, links=links, outputs=OUTPUTS)
        plain, asked = in_turns([lambda: seconds(OUTPUTS[:1]), lambda: seconds(OUTPUTS)], repeats)
    return [
        float(cp.compare.errors(run, truth)["error_max"]),
        run.attrs["space_error_estimate"],
        float(any(item.category is cp.CoarseWarning for item in caught)),
        float(np.median(asked) / np.median(plain) - 1.0),
    ]


def report(scenes: int, duration: float, repeats: int) -> xr.DataArray:
    """Return what :func:`measured` gives over scenes, links and columns."""
    rows = []
    for case in tqdm(cases(scenes, SEED, duration)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cp.NotConvergedWarning)
            truth = truth_of(case)
        rows.append([measured(case, truth, links, repeats) for links in LINKS])
    return xr.DataArray(
        np.array(rows), dims=("scene", "links", "column"), coords={"links": list(LINKS), "column": list(COLUMNS)}
    )


def table_of(result: xr.DataArray) -> str:
    """Write errors, quality of the estimate and of the warning for each number of links, and for all."""
    lines = []
    parts = [(f"{links}", result.sel(links=[links])) for links in LINKS]
    for name, part in [*parts, ("all", result)]:
        error, estimate, warned, price = (part.sel(column=name).values.ravel() for name in COLUMNS)
        ratio = estimate / error
        near = (ratio > 1.0 / FACTOR) & (ratio < FACTOR)
        wrong = warned.astype(bool), error > LIKELY
        lines.append(
            [
                name,
                " / ".join(percent(value) for value in np.quantile(error, (0.5, 0.95, 1.0))),
                f"{near.sum()} of {near.size}",
                " / ".join(f"{value:.2f}" for value in np.quantile(ratio, (0.0, 0.05, 0.5, 0.95, 1.0))),
                f"{100.0 * np.median(price):.0f} %",
                f"{wrong[1].sum()}",
                f"{wrong[0].sum()}",
                f"{(wrong[0] & wrong[1]).sum()}",
                percent(error[~wrong[0]].max()) if (~wrong[0]).any() else "",
            ]
        )
    head = [
        "links",
        "error: median / 95 % / largest",
        "estimate within a factor of 3",
        "estimate over error: least / 5 % / median / 95 % / largest",
    ]
    head += ["time more", "above 1 %", "warned", "of these above 1 %", "largest error without a warning"]
    return markdown_table(head, lines)


def main() -> None:
    """Measure and print the table."""
    parser = command_line(__doc__, readme=True, repeats=3, quick="three scenes of 10 s")
    parser.add_argument("--scenes", type=int, default=SCENES, help="number of scenes")
    given = parser.parse_args()
    scenes, duration, repeats = (3, 10.0, 1) if given.quick else (given.scenes, 125.0, given.repeats)
    show_table("space_error", table_of(report(scenes, duration, repeats)), HERE if given.readme else None)


if __name__ == "__main__":
    main()
