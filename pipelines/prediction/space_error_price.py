"""Measure what the estimate of the error in space costs with a given step.

    python pipelines/prediction/space_error_price.py [--repeats 9] [--readme] [--quick]

Examples 2 to 4 of the paper (125 s), once with ``outputs=("position",)`` and once with ``("position", "error_estimate")``, in
turns.  The price is the processor time of a call with the estimate over that of the call before it, less one: the median.
"""

from __future__ import annotations

import statistics
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import xarray as xr
from _study import command_line, in_turns, markdown_table, show_table

import cablepod as cp
from cablepod import examples

HERE = Path(__file__).resolve().parent
SCENES = ("example2", "example3", "example4")
OUTPUTS = ("position", "error_estimate")
#: Name of a row -> function and options.
IMPLICIT = {"scheme": "trapezoidal", "step": 0.02}
CALLS: dict[str, tuple[Callable[..., xr.Dataset], dict[str, Any]]] = {
    "chain, 5 links, explicit, 0.3 ms": (cp.chain.simulate, {"links": 5, "step": 3e-4}),
    "chain, 10 links, explicit, 0.3 ms": (cp.chain.simulate, {"links": 10, "step": 3e-4}),
    "chain, 20 links, explicit, 0.3 ms": (cp.chain.simulate, {"links": 20, "step": 3e-4}),
    "chain, 40 links, explicit, 0.3 ms": (cp.chain.simulate, {"links": 40, "step": 3e-4}),
    "chain, 10 links, implicit, 20 ms": (cp.chain.simulate, {"links": 10, **IMPLICIT}),
    "chain, 40 links, implicit, 20 ms": (cp.chain.simulate, {"links": 40, **IMPLICIT}),
    "chain, 40 links, implicit, 0.1 s": (cp.chain.simulate, {"links": 40, **IMPLICIT, "step": 0.1}),
    "chain, 40 links, energy-momentum, 20 ms": (
        cp.chain.simulate,
        {"links": 40, "scheme": "energy_momentum", "step": 0.02},
    ),
    "cable, 1 element, explicit, 0.5 ms": (cp.cable.simulate, {"elements": 1, "step": 5e-4, "law": "linear"}),
    "cable, 4 elements, explicit, 0.1 ms": (cp.cable.simulate, {"elements": 4, "step": 1e-4, "law": "linear"}),
    "cable, 1 element, implicit, 20 ms": (cp.cable.simulate, {"elements": 1, "law": "linear", **IMPLICIT}),
    "cable, 4 elements, implicit, 20 ms": (cp.cable.simulate, {"elements": 4, "law": "linear", **IMPLICIT}),
    "cable, 4 elements, implicit, 0.1 s": (
        cp.cable.simulate,
        {"elements": 4, "law": "linear", **IMPLICIT, "step": 0.1},
    ),
}


def price(scene: xr.Dataset, simulate: Callable[..., xr.Dataset], options: dict[str, Any], repeats: int) -> float:
    """Return the processor time of the estimate over that of the run."""

    def seconds(outputs: tuple[str, ...]) -> float:
        begin = time.process_time()
        simulate(scene, outputs=outputs, **options)
        return time.process_time() - begin

    seconds(OUTPUTS)  # compiles
    plain, asked = in_turns([lambda: seconds(OUTPUTS[:1]), lambda: seconds(OUTPUTS)], repeats)
    return statistics.median(after / before for before, after in zip(plain, asked, strict=True)) - 1.0


def table_of(scenes: tuple[str, ...], repeats: int) -> str:
    """Write the price of each call in each scene."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = [
            [name, *(f"{100.0 * price(examples.scene(scene), *call, repeats):.0f} %" for scene in scenes)]
            for name, call in CALLS.items()
        ]
    return markdown_table(["run with a given step", *(f"Example {scene[-1]}" for scene in scenes)], rows)


def main() -> None:
    """Measure and print the table."""
    parser = command_line(__doc__, readme=True, repeats=9, quick="one scene, once")
    given = parser.parse_args()
    scenes, repeats = (SCENES[:1], 1) if given.quick else (SCENES, given.repeats)
    show_table("space_error_price", table_of(scenes, repeats), HERE if given.readme else None)


if __name__ == "__main__":
    main()
