"""Measure condensed models without snapshots, and the chain of 40 links, against the continuous cable.

    python pipelines/prediction/continuous.py [--scenes 48] [--readme] [--quick]

The scenes of the prediction study with "static and vibration" modes of each (on 40 links, orders "leading" and "inertial",
extrapolated in the step), and their chains of 40 links.  The error is the largest over all tenths of a second of the rms distance
over the particles from the continuous cable, over its largest rms displacement (``compare.errors``).  The same distance from the
scene's own chain stands beside it: that is what ``error_estimate`` estimates, which leaves out the links.

The continuous cable has ELEMENTS elements by the linear law, with steps of a time error of TOLERANCE.  What half as many elements
change is written beside the errors, as a share of the smallest error of the scene.
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
from _study import command_line, markdown_table, percent, show_table
from tqdm import tqdm

import cablepod as cp
from prediction import figure
from prediction.run import SCENES, SEED, run_model
from prediction.scenes import LINKS, Case, cases

HERE = Path(__file__).resolve().parent
ELEMENTS, TOLERANCE = 16, 1e-5
RANKS = (2, 4, 6, 8)
ORDERS = ("leading", "inertial")
CHAIN = f"chain of {LINKS} links"
#: Models of the table; the chain is the first.
MODELS = (CHAIN, *(f"static and vibration, {order}, r = {rank}" for order in ORDERS for rank in RANKS))
REFERENCES = ("continuous cable", "own chain")


def cable_of(scene: xr.Dataset, elements: int) -> xr.Dataset:
    """Return the continuous cable at the particles of the chain."""
    return cp.cable.simulate(
        scene, law="linear", elements=elements, scheme="velocity_verlet", tolerance=TOLERANCE, points=LINKS + 1,
        outputs=("position",),
    )  # fmt: skip


def distance(run: xr.Dataset, reference: xr.Dataset) -> float:
    """Return the largest distance over time, over the motion of the reference."""
    return float(cp.compare.errors(run, reference)["error_max"])


def measured(case: Case, elements: int = ELEMENTS) -> tuple[np.ndarray, float]:
    """Return errors (model, reference), and the distance of the cable of half as many elements.

    The errors of a model that stops or refuses are infinite.
    """
    cable = cable_of(case.scene, elements)
    references = (cable, case.truth)
    modes = cp.condensed.vibration_modes(case.scene, rank=RANKS[-1], static_modes=True)
    rows = [[distance(case.truth, cable), np.nan]]
    for order in ORDERS:
        for rank in RANKS:
            try:
                run = run_model(case.scene, modes, rank, order, case.truth["time"].values)
            except (cp.RunStopped, cp.SceneError):
                rows.append([np.inf, np.inf])
            else:
                rows.append([distance(run, reference) for reference in references])
    return np.array(rows), distance(cable_of(case.scene, elements // 2), cable)


def report(scenes: int, duration: float, elements: int = ELEMENTS) -> xr.Dataset:
    """Return ``error (scene, model, reference)`` and ``change (scene)``, that by half as many elements, of regular scenes."""
    with warnings.catch_warnings():
        for category in (cp.CoarseWarning, cp.OutOfRangeWarning, cp.NotConvergedWarning):
            warnings.simplefilter("ignore", category)
        found = [measured(case, elements) for case in tqdm(cases(scenes, SEED, duration)) if not case.apart]
    return xr.Dataset(
        {
            "error": (("scene", "model", "reference"), np.array([errors for errors, _ in found])),
            "change": ("scene", [change for _, change in found]),
        },
        coords={"model": list(MODELS), "reference": list(REFERENCES)},
    )


def table_of(result: xr.Dataset) -> str:
    """Write median, 95th percentile and largest error of each model."""
    lines = []
    for name in MODELS:
        cells = []
        for reference in REFERENCES:
            values = result["error"].sel(model=name, reference=reference).values
            spread = figure.quantiles(values, (0.5, 0.95, 1.0))
            cells.append("" if np.isnan(values).all() else " / ".join(percent(value) for value in spread))
        lines.append([name, *cells])
    return markdown_table(["model", "against the continuous cable", "against the scene's own chain"], lines)


def main() -> None:
    """Measure, print and write the table."""
    parser = command_line(__doc__, readme=True, quick="three scenes of 10 s")
    parser.add_argument("--scenes", type=int, default=SCENES, help="number of scenes")
    given = parser.parse_args()
    begin = time.perf_counter()
    scenes, duration = (3, 10.0) if given.quick else (given.scenes, 125.0)
    result = report(scenes, duration)
    show_table("continuous", table_of(result), HERE if given.readme else None)
    error = result["error"].sel(reference="continuous cable")
    change = result["change"]
    print(
        f"{result.sizes['scene']} regular scenes; errors from {percent(float(error.min()))} on; {ELEMENTS // 2} elements change "
        f"the cable by {float(change.max()):.1e} at most, {percent(float((change / error.min('model')).max()))} of the smallest "
        f"error of the scene at most; {time.perf_counter() - begin:.0f} s"
    )


if __name__ == "__main__":
    main()
