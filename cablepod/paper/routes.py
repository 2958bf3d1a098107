"""Compare the three routes to the modes (section 5.1): accuracy, run time, and the effect of weights."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
import xarray as xr

from cablepod import chain, pod
from cablepod.examples import scene
from cablepod.paper.datasets import described
from cablepod.paper.examples import CHAIN_TOLERANCE
from cablepod.pod import _svd_methods as svd_methods
from cablepod.pod._snapshots import relative_arc_length

METHODS = tuple(svd_methods.ROUTES)
#: (features n, snapshots m); the first of the paper, the last of 100 such runs with both coordinates.
SIZES = ((39, 125), (80, 500), (80, 2000), (80, 12500))
#: Maximum number of snapshots for the method of snapshots (its time grows with their cube).
MOST_SNAPSHOTS = 2000


def known_matrix(features: int, samples: int, *, smallest: float = 1e-13, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Make a matrix with singular values from 1 to `smallest`, equally spaced on a logarithmic scale.

    Returns
    -------
    tuple of numpy.ndarray
        The matrix (features, samples), its left singular vectors and its singular values.
    """
    rng = np.random.default_rng(seed)
    count = min(features, samples)
    values = np.geomspace(1.0, smallest, count)
    left = np.linalg.qr(rng.standard_normal((features, count)))[0]
    right = np.linalg.qr(rng.standard_normal((samples, count)))[0]
    return (left * values) @ right.T, left, values


def precision(*, features: int = 80, samples: int = 500, most_snapshots: int = MOST_SNAPSHOTS) -> xr.Dataset:
    """Measure the errors of each route for a matrix with known singular values.

    Parameters
    ----------
    features, samples
        Shape of the matrix.
    most_snapshots
        Maximum number of snapshots for the method of snapshots; nan above.

    Returns
    -------
    xarray.Dataset
        ``route_error (route, route_mode)``: relative error of the singular values; ``route_angle``: sine of the angle between
        mode and exact mode; ``route_exact (route_mode)``: the exact values; ``route_usable (route)``: the smallest exact value
        down to which all relative errors are below 0.1.
    """
    from threadpoolctl import threadpool_limits  # slow to import

    data, left, values = known_matrix(features, samples)
    error, angle = np.full((2, len(METHODS), values.size), np.nan)
    for i, method in enumerate(METHODS):
        if method == "snapshots" and samples > most_snapshots:
            continue
        with threadpool_limits(limits=1):  # reproducible rounding
            modes, singular_values = svd_methods.ROUTES[method](data)
        error[i] = np.abs(singular_values / values - 1.0)
        # norm of the component normal to the exact mode; sqrt(1 - cos^2) would lose half of the digits
        angle[i] = np.linalg.norm(modes - left * np.sum(left * modes, axis=0), axis=0)
    right = zip(np.logical_and.accumulate(error < 0.1, axis=1), np.isnan(error[:, 0]), strict=True)
    usable = [float(values[good].min(initial=np.nan if lost else 1.0)) for good, lost in right]
    return described(
        "routes.precision", {"features": features, "samples": samples},
        {
            "route_error": (("route", "route_mode"), error, "1", "relative error of the singular value"),
            "route_angle": (("route", "route_mode"), np.minimum(angle, 1.0),
                "1", "sine of the angle between the mode and the exact one"),
            "route_exact": ("route_mode", values, "1", "exact singular value, the largest being 1"),
            "route_usable": ("route", usable,
                "1", "smallest singular value down to which all are right to a tenth"),
        },
        {
            "route": (list(METHODS), "1", "route to the modes"),
            "route_mode": (np.arange(1, values.size + 1), "1", "number of the mode of the known matrix"),
        },
    )  # fmt: skip


def run_times(
    *,
    sizes: tuple[tuple[int, int], ...] = SIZES,
    repeats: int = 5,
    most_snapshots: int = MOST_SNAPSHOTS,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Measure the run time of each route on one BLAS thread.

    Parameters
    ----------
    sizes
        Pairs of features and snapshots.
    repeats
        Number of timed calls, of which the median is taken, after one untimed call.
    most_snapshots
        Maximum number of snapshots for the method of snapshots; nan above.
    progress
        Callback receiving the completed fraction, 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``route_time (route, route_size)`` [s] and ``route_features``, ``route_samples (route_size)``.
    """
    from threadpoolctl import threadpool_limits  # slow to import

    seconds = np.full((len(METHODS), len(sizes)), np.nan)
    jobs = [(i, j) for j in range(len(sizes)) for i in range(len(METHODS))]
    with threadpool_limits(limits=1):
        for done, (i, j) in enumerate(jobs):
            if METHODS[i] != "snapshots" or sizes[j][1] <= most_snapshots:
                data = known_matrix(*sizes[j])[0]
                seconds[i, j] = _median(svd_methods.ROUTES[METHODS[i]], data, repeats)
            if progress is not None:
                progress((done + 1) / len(jobs))
    return described(
        "routes.run_times", {"sizes": [list(size) for size in sizes], "repeats": repeats, "most_snapshots": most_snapshots},
        {
            "route_time": (("route", "route_size"), seconds,
                "s", f"time of one decomposition, one BLAS thread, median of {repeats}"),
            "route_features": ("route_size", [size[0] for size in sizes], "1", "features n"),
            "route_samples": ("route_size", [size[1] for size in sizes], "1", "snapshots m"),
        },
        {"route": (list(METHODS), "1", "route to the modes")},
    )  # fmt: skip


def _median(decompose: Callable[[np.ndarray], object], data: np.ndarray, repeats: int) -> float:
    """Return the median run time [s] of several calls, after one untimed call."""
    decompose(data)
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        decompose(data)
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def weights(*, ratio: float = 9.0, links: int = 40, count: int = 3) -> xr.Dataset:
    """Compare inner products of the decomposition for the chain of Example 2 with graded links.

    The modes of the cable do not depend on its division into links.  With equal weights of all particles, as in the paper, the
    finely divided part counts more; weights by length correct this.

    Parameters
    ----------
    ratio
        Longest link over shortest.
    links
        Number of links of both chains.
    count
        Number of compared modes.

    Returns
    -------
    xarray.Dataset
        ``weight_mode_gap (weights, coordinate, mode)``: distance of the mode from that of the uniform chain, both of unit
        length-weighted norm; ``weight_value_gap``: relative difference of the singular values.
    """
    even = scene("example2")
    lengths = np.geomspace(1.0, ratio, links)
    uneven = even.assign(chain_links=links, chain_link_lengths=("chain_link_lengths_item", lengths, {"units": "1"}))
    uniform, graded = (
        chain.simulate(each, scheme="velocity_verlet", tolerance=CHAIN_TOLERANCE, outputs=("position",))
        for each in (even.assign(chain_links=links), uneven)
    )
    target = pod.decompose(uniform, rank=count)
    fine = relative_arc_length(uniform)
    kinds = (None, "length", "mass")
    gaps, values = np.empty((2, len(kinds), 2, count))
    for i, kind in enumerate(kinds):
        modes = pod.decompose(graded, rank=count, weights=kind)
        sigma = relative_arc_length(graded)
        values[i] = modes["singular_value"] / target["singular_value"] - 1.0
        for c in range(2):
            for m in range(count):
                shape = np.interp(fine, sigma, modes["mode_shape"].values[c, m])
                shape /= np.linalg.norm(shape)
                reference = target["mode_shape"].values[c, m]
                gaps[i, c, m] = np.linalg.norm(shape * np.sign(shape @ reference) - reference)
    return described(
        "routes.weights", {"ratio": ratio, "links": links, "count": count},
        {
            "weight_mode_gap": (("weights", "coordinate", "mode"), gaps,
                "1", "distance of the mode of a chain of unequal links from that of the uniform chain"),
            "weight_value_gap": (("weights", "coordinate", "mode"), values, "1", "relative difference of the singular values"),
        },
        {
            "weights": ([str(kind) for kind in kinds], "1", "inner product of the decomposition"),
            "coordinate": (target["coordinate"].values,),
            "mode": (target["mode"].values,),
        },
        [uniform, graded],
    )  # fmt: skip
