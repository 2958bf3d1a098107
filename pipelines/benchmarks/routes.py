"""Time the three routes to the modes up to 80 by 12 500, the method of snapshots included (minutes, 4 GB).

python pipelines/benchmarks/routes.py [--most-snapshots 12500] [--repeats 5]

One BLAS thread; medians of `repeats` after a call that does not count.  The error of each route on a matrix of the same size
stands beside its time: the smallest singular value, the largest being 1, down to which all are right to a tenth.
"""

from __future__ import annotations

import argparse

from cablepod.paper import routes


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--most-snapshots", type=int, default=12500)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    for size in routes.SIZES:
        times = routes.run_times(sizes=(size,), repeats=options.repeats, most_snapshots=options.most_snapshots)
        usable = routes.precision(features=size[0], samples=size[1], most_snapshots=options.most_snapshots)[
            "route_usable"
        ]
        for route in times["route"].values:
            seconds, down_to = float(times["route_time"].sel(route=route)[0]), float(usable.sel(route=route))
            print(
                f"{size[0]:>4} x {size[1]:<6} {route:<11}{1e3 * seconds:>12.2f} ms   right down to {down_to:.0e}",
                flush=True,
            )


if __name__ == "__main__":
    main()
