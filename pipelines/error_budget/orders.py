"""Measure each order of the condensed model in Examples 2 to 4 against the continuous cable.

    python pipelines/error_budget/orders.py [--readme] [--quick]

Modes come from the chain of 40 links (125 s, every 0.1 s), or from that of Example 2 in the other examples.  Steps are STEP long.
The error is the largest over all tenths of a second of the rms distance over the particles from the continuous cable (linear law,
ELEMENTS elements), over its largest rms displacement.  The distance from the chain that the modes come from stands beside it: it
leaves out the links, so that it tells the orders apart.  What half as many elements change is printed.

A second table has the largest relative error of the three lowest frequencies about rest, on eight static and vibration modes of
40 and of 320 links, from those of the continuous cable.

With --readme both are written to the page of the condensed model.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, percent, show_table

import cablepod as cp
from cablepod import examples as shipped
from cablepod.condensed._assembly import model_of
from cablepod.condensed._model import CondensedModel
from cablepod.parameters._from_scene import parameters

#: Folder of the page.
PAGE = Path(cp.condensed.__file__).parent
EXAMPLES = ("example2", "example3", "example4")
RANKS = (1, 2, 4, 8)
LINKS, CHAIN_STEP = 40, 1.25e-4
STEP = 0.005
#: Elements of the continuous cable, and its step [s].
ELEMENTS, CABLE_STEP = 16, 3e-5
WITHOUT = "leading without step 8"
MODELS = ("leading", WITHOUT, "exact", "inertial")
CHAIN = f"chain of {LINKS} links"
FOREIGN = "leading, modes of Example 2"
#: Modes of the frequencies, number of frequencies, and links; so many links err by less than 10^-4.
RANK, FREQUENCIES, MANY_LINKS = 8, 3, 320


@contextmanager
def order_of(model: str) -> Iterator[str]:
    """Give the order of a model of the table; within the block "leading" has no terms of second order where it says so."""
    if model != WITHOUT:
        yield model
        return
    cp.clear_caches()
    with mock.patch.object(CondensedModel, "reference_state", None):
        yield "leading"
    cp.clear_caches()


def cable_of(scene: xr.Dataset, times: np.ndarray, elements: int, step: float) -> xr.Dataset:
    """Return the continuous cable at the particles of the chain."""
    return cp.cable.simulate(
        scene, law="linear", elements=elements, step=step, points=LINKS + 1, times=times, outputs=("position",)
    )


def distance(run: xr.Dataset, reference: xr.Dataset) -> float:
    """Return the largest distance over time, over the motion of the reference."""
    return float(cp.compare.errors(run, reference)["error_max"])


def errors(duration: float) -> tuple[dict[str, list[list[list[float]]]], list[float]]:
    """Return errors by model over (example, rank, reference), and the change by half as many elements by example.

    The references are the continuous cable and the chain.
    """
    times = np.arange(round(10 * duration) + 1) / 10
    found: dict[str, list[list[list[float]]]] = {CHAIN: [], **{name: [] for name in MODELS}, FOREIGN: []}
    changes: list[float] = []
    foreign: xr.Dataset | None = None
    for name in EXAMPLES:
        scene = shipped.scene(name)
        chain = cp.chain.simulate(scene, links=LINKS, times=times, scheme="velocity_verlet", step=CHAIN_STEP)
        cable = cable_of(scene, times, ELEMENTS, CABLE_STEP)
        changes.append(distance(cable_of(scene, times, ELEMENTS // 2, 2.0 * CABLE_STEP), cable))
        modes = cp.pod.decompose(chain, rank=RANKS[-1], layout="normal")
        foreign = modes if foreign is None else foreign

        def pairs(
            order: str, modes: xr.Dataset, scene: xr.Dataset = scene, references: Any = (cable, chain)
        ) -> list[list[float]]:
            options: dict[str, Any] = {"order": order, "times": times, "step": STEP, "outputs": ("position",)}
            runs = [cp.condensed.simulate(scene, modes, rank=rank, **options) for rank in RANKS]
            return [[distance(run, reference) for reference in references] for run in runs]

        found[CHAIN].append([[distance(chain, cable), np.nan]])
        for model in MODELS:
            with order_of(model) as order:
                found[model].append(pairs(order, modes))
        found[FOREIGN].append(pairs("leading", foreign))
    return found, changes


def error_table(found: dict[str, list[list[list[float]]]]) -> str:
    """Write errors against the cable, and beside them those against the chain."""

    def cell(rows: list[list[float]], reference: int) -> str:
        numbers = [percent(row[reference]).removesuffix(" %") for row in rows]
        return " / ".join(numbers) + " %" if np.isfinite(rows[0][reference]) else ""

    lines = []
    for model, examples in found.items():
        rank = "" if model == CHAIN else " / ".join(map(str, RANKS))
        lines.append([model, rank, *(cell(rows, reference) for reference in (0, 1) for rows in examples)])
    titles = [f"Example {name[-1]}" for name in EXAMPLES]
    return markdown_table(["model", "r", *titles, *(f"{title}, from the chain" for title in titles)], lines)


def about_rest(model: CondensedModel) -> np.ndarray:
    """Return the lowest frequencies of a model about rest [rad/s], by central differences of its forces."""
    q, data = model.initial()[0], model.static_boundary_data
    change = 1e-5 * np.abs(q).max()
    columns = [
        (model.force(q - change * u, 0.0 * q, data)[0] - model.force(q + change * u, 0.0 * q, data)[0]) / (2.0 * change)
        for u in np.eye(q.size)
    ]
    return np.asarray(np.sqrt(np.sort(np.linalg.eigvals(np.array(columns).T).real)[:FREQUENCIES]))


def frequency_table() -> str:
    """Write the largest relative errors of frequencies about rest."""
    found: dict[str, list[float]] = {}
    for example in EXAMPLES:
        moving = shipped.scene(example)
        scene = moving.drop_vars([key for key in moving.variables if str(key).startswith("motion_")])

        def lowest(scene: xr.Dataset = scene, **options: Any) -> np.ndarray:
            found = cp.cable.frequencies(scene, count=FREQUENCIES, law="linear", **options)
            return np.asarray(found["angular_frequency"].values)

        exact = lowest()
        frequencies = {CHAIN: lowest(elements=LINKS, order=1)}  # such elements are links
        for links in (LINKS, MANY_LINKS):
            modes = cp.condensed.vibration_modes(scene, rank=RANK, links=links, static_modes=True)
            for model in MODELS[:2]:
                with order_of(model) as order:
                    assembled = model_of(parameters(scene), modes, rank=None, order=order, law="linear")
                    frequencies[f"{model}, {links} links"] = about_rest(assembled)
        for name, values in frequencies.items():
            found.setdefault(name, []).append(float(np.abs(values / exact - 1.0).max()))
    lines = [[name, *map(percent, values)] for name, values in found.items()]
    return markdown_table(["frequencies about rest", *(f"Example {name[-1]}" for name in EXAMPLES)], lines)


def main() -> None:
    """Measure and write both tables."""
    given = command_line(__doc__, readme=True, quick="10 s").parse_args()
    page = PAGE if given.readme else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cp.CoarseWarning)
        found, changes = errors(10.0 if given.quick else 125.0)
    show_table("orders", error_table(found), page)
    show_table("frequencies", frequency_table(), page)
    print(f"{ELEMENTS // 2} elements change the cable by", ", ".join(f"{value:.1e}" for value in changes))


if __name__ == "__main__":
    main()
