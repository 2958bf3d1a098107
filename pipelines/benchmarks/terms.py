"""Time each term of a scene in a step of each scheme.

    python pipelines/benchmarks/terms.py [--repeats 7] [--links 160] [--readme]

Example 2's guy: a plain planar scene, the same with one term added, and the spatial form.  Time per link and step is the
difference of two whole calls of chain.simulate, one twice as long, so that work done once cancels and all work of a step
counts, tables of end motions and loads and the check of the energy included; of implicit schemes it is per iteration of
Newton's method, of which a step needs two to four.  One thread; compilation and a warm-up run are left out; all terms of a
scheme in turns, medians over the repeats.
"""

from __future__ import annotations

import statistics
import sys
import time
import tomllib
from functools import partial
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import command_line, in_turns, markdown_table, show_table

import cablepod as cp
from cablepod.discretisation._chain import chain_of
from cablepod.examples import scene_path
from cablepod.parameters._from_scene import parameters

HERE = Path(__file__).resolve().parent
WAVE = {"kind": "harmonic", "amplitude": 1.0, "angular_frequency": 1.0}
SWAY = {**WAVE, "amplitude": 1e-3}
TERMS: dict[str, dict[str, Any]] = {
    "plain, planar": {},
    "ends at rest": {"motion": {}},
    "both ends move in x and y": {"motion": {end: {"x": SWAY, "y": SWAY} for end in ("lower", "upper")}},
    "steady point load": {"point_load": [{"arc_length": 0.3, "force": [3.0, -3.0]}]},
    "uniform load that varies": {"load": {"uniform": [0.5, 0.0], **WAVE}},
    "point load that varies": {"point_load": [{"arc_length": 0.3, "force": [3.0, -3.0], **WAVE}]},
    "mass damping": {"damping": {"mass_proportional": 0.1}},
    "viscous links": {"damping": {"link_viscosity": 1e-5}},
    "law (21)": {"law": "green"},
    "tension extremes": {"outputs": ("position", "tension_extremes")},
    "spatial": {"spatial": True},
}
STEPS = {"velocity_verlet": 40_000, "trapezoidal": 1_000, "generalized_alpha": 1_000, "energy_momentum": 1_000}


def runner(scheme: str, links: int, term: dict[str, Any]) -> Any:
    """Return a function that runs a number of steps and returns the number of solutions."""
    tables = {key: value for key, value in term.items() if key not in ("law", "outputs", "spatial")}
    mapping = {**tomllib.loads(scene_path("example2").read_text()), **tables}
    if term.get("spatial"):
        mapping["ends"] = {name: [*end, 0.0] for name, end in mapping["ends"].items()}
        mapping.pop("load", None)  # a planar load of zero
    given = cp.make_scene(mapping)
    # implicit steps of 0.05 s take two or three iterations each, whatever the term
    step = 0.8 * chain_of(parameters(given), links).step_limit() if scheme == "velocity_verlet" else 0.05
    options = {key: value for key, value in term.items() if key in ("law", "outputs")}

    def run(steps: int) -> int:
        result = cp.chain.simulate(given, links=links, scheme=scheme, step=step, times=[0.0, steps * step], **options)
        return result.attrs.get("newton_iterations", steps)

    return run


def slope(run: Any, steps: int) -> float:
    """Return the time of one more step, or iteration [s]."""
    begin = time.perf_counter()
    short = run(steps)
    middle = time.perf_counter()
    long = run(2 * steps)
    return (time.perf_counter() - 2 * middle + begin) / (long - short)


def main() -> None:
    """Print the table."""
    parser = command_line(__doc__, repeats=7, readme=True)
    parser.add_argument("--links", type=int, default=160)
    options = parser.parse_args()
    table: dict[str, dict[str, float]] = {name: {} for name in TERMS}
    for scheme, steps in STEPS.items():
        runs = {name: runner(scheme, options.links, term) for name, term in TERMS.items()}
        for run in runs.values():
            run(steps)
        found = in_turns([partial(slope, run, steps) for run in runs.values()], options.repeats)
        for name, values in zip(runs, found, strict=True):
            table[name][scheme] = 1e9 * statistics.median(values) / options.links
    print(
        f"ns per link and step or iteration, {options.links} links, median of {options.repeats}; in brackets over plain"
    )
    plain = table["plain, planar"]
    lines = [
        [name, *(f"{value:.3g} ({value / plain[scheme]:.2f})" for scheme, value in row.items())]
        for name, row in table.items()
    ]
    show_table("terms", markdown_table(["term", *STEPS], lines), HERE if options.readme else None)


if __name__ == "__main__":
    main()
