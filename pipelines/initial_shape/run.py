"""Search the initial shape of Example 2 that explains Table 2.

    python pipelines/initial_shape/run.py [--draws 3000] [--polished 8] [--seed 0] [--integrators]

Prints the best initial shapes; data/starts.csv keeps those in use.  With --integrators, tests whether a standard integrator
with loose tolerances explains it instead.  Minutes each.
"""

from __future__ import annotations

import sys
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

        found = starts.search(draws=options.draws, polished=options.polished, seed=options.seed, progress=progress)
    drawn = found["search_misfit"].values
    for limit in (0.25, 0.15, 0.1, 0.05):
        print(f"{100 * np.mean(drawn < limit):6.2f} % of {drawn.size} draws have a misfit below {limit}")
    for i in range(found.sizes["polished"]):
        cable, start, misfit = (
            float(found[f"polished_{name}"][i]) for name in ("cable_length", "start_length", "misfit")
        )
        print(f"cable {cable:.7f} m  start {start:.7f} m  misfit {misfit:.4f}")


def integrators() -> None:
    """Run Example 2 from equilibrium with standard integrators at tolerances near their defaults."""
    given = scene("example2")
    times = np.arange(125.0)
    target = starts.printed()
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
