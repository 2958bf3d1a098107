"""What each term of a scene costs a step: a plain planar scene against the same with one term added, and the spatial form.

    python pipelines/benchmarks/terms.py [--repeats 7] [--links 160]

Example 2's guy.  Time per link and step is the difference of two whole calls of chain.simulate, one twice as long, so
that all that is done once falls out and all that is done in each step counts, the tables of end motions and loads and the watch
included; of implicit schemes it is per iteration of Newton's method, of which a step needs two to four.  One
thread; compilation and a warm-up run lie outside; all terms of a scheme in turn, medians over the repeats.
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any

import cablepod as cp
from cablepod.links import chain_of
from cablepod.parameters import parameters
from cablepod.shipped import scene_path

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
    """Return a function of a number of steps that makes a run of so many, and tells of how many solutions."""
    import tomllib

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
    """Seconds for one step, or one iteration, more."""
    begin = time.perf_counter()
    short = run(steps)
    middle = time.perf_counter()
    long = run(2 * steps)
    return (time.perf_counter() - 2 * middle + begin) / (long - short)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--links", type=int, default=160)
    options = parser.parse_args()
    table: dict[str, dict[str, float]] = {name: {} for name in TERMS}
    for scheme, steps in STEPS.items():
        runs = {name: runner(scheme, options.links, term) for name, term in TERMS.items()}
        found: dict[str, list[float]] = {name: [] for name in TERMS}
        for run in runs.values():
            run(steps)
        for _ in range(options.repeats):
            for name, run in runs.items():
                found[name].append(slope(run, steps) / options.links)
        for name, values in found.items():
            table[name][scheme] = 1e9 * statistics.median(values)
    print(
        f"ns per link and step or iteration, {options.links} links, median of {options.repeats}; in brackets over plain"
    )
    print(f"{'term':<28}" + "".join(f"{scheme:>22}" for scheme in STEPS))
    for name, row in table.items():
        cells = (f"{value:.3g} ({value / table['plain, planar'][scheme]:.2f})" for scheme, value in row.items())
        print(f"{name:<28}" + "".join(f"{cell:>22}" for cell in cells))


if __name__ == "__main__":
    main()
