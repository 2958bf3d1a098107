"""Map the range of validity of the chain's basis for the extensible cable, left open by the paper."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from cablepod import chain, compare, galerkin, pod
from cablepod.batch._pool import map_threads
from cablepod.errors import NotConvergedWarning, OutOfRangeWarning
from cablepod.examples import scene
from cablepod.paper.datasets import described
from cablepod.paper.examples import fraction_of

#: Tensions at the upper end at rest [N], axial stiffnesses [N], modes of each coordinate.
TENSIONS = (1e3, 3e3, 8e3, 20e3, 60e3)
STIFFNESSES = (2e5, 2e6, 2e7, 2e8, 2e9)
RANKS = (2, 4)
#: Duration, about one period of the end motion of Example 2, and interval of 125 snapshots [s].
DURATION, INTERVAL = 62.5, 0.5
#: Tolerance of the time error (a hundredth of the errors in the maps).
TOLERANCE = 1e-5
PLACE = ("validity_tension", "validity_stiffness")
VARIABLES = {
    "validity_model_error": (
        "1",
        "largest error of the reduced model on the chain's modes against the extensible cable",
    ),
    "validity_own_error": ("1", "the same on the cable's own modes, with the fewest modes"),
    "validity_basis_error": ("1", "largest error of the cable's motion projected on the chain's modes"),
    "validity_own_basis_error": ("1", "the same on the cable's own modes"),
    "validity_law_gap": ("1", "largest distance between chain (linear law) and extensible cable, law (21)"),
    "validity_sag_parameter": ("1", "Irvine's lambda^2 at rest"),
    "validity_strain": ("1", "strain at the upper end at rest"),
    "validity_smallest_stretch": ("1", "least stretch of the cable over all particles and instants"),
    "validity_settled": ("1", "1 where halving the step moved no run by more than the tolerance"),
}
BY_RANK = ("validity_model_error", "validity_basis_error", "validity_own_basis_error")


def maps(
    *,
    tensions: Sequence[float] = TENSIONS,
    stiffnesses: Sequence[float] = STIFFNESSES,
    ranks: Sequence[int] = RANKS,
    angular_frequency: float = 0.1,
    workers: int = 2,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Map errors of the chain's modes for the extensible cable over pretension and stiffness.

    In each cell, the modes are those of Example 2's chain of 40 links with the linear law.  The reference is the same chain with
    law (21).  The reduced model of the paper uses the modes of the chain and, for comparison, those of the reference.

    Parameters
    ----------
    tensions
        Tensions T1 of the cable at rest [N].
    stiffnesses
        Axial stiffnesses K [N].
    ranks
        Modes of each coordinate.
    angular_frequency
        Angular frequency of the end motion [rad/s].
    workers
        Number of threads.
    progress
        Callback receiving the completed fraction, 0 to 1.

    Returns
    -------
    xarray.Dataset
        The variables of :data:`VARIABLES` along ``validity_tension`` and ``validity_stiffness``, those of :data:`BY_RANK` also
        along ``validity_rank``.
    """
    base = scene("example2")
    units = {name: base[name].attrs for name in base.variables}
    base = base.assign(
        motion_upper_x_angular_frequency=angular_frequency, time_duration=DURATION, time_interval=INTERVAL
    )
    for name, attributes in units.items():
        base[name].attrs = attributes
    cells = [(i, j) for j in reversed(range(len(stiffnesses))) for i in range(len(tensions))]  # slow ones first
    shape = (len(tensions), len(stiffnesses))
    values = {name: np.full((*shape, len(ranks)) if name in BY_RANK else shape, np.nan) for name in VARIABLES}

    def values_of(cell: tuple[int, int]) -> dict[str, object]:
        return _cell(base, tensions[cell[0]], stiffnesses[cell[1]], ranks)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotConvergedWarning)  # such cells are marked in the map
        warnings.simplefilter("ignore", OutOfRangeWarning)  # where the laws part is what the map shows
        computed = map_threads(values_of, cells, workers, done=fraction_of(len(cells), progress))
        for cell, errors in zip(cells, computed, strict=True):
            for name, value in errors.items():
                values[name][cell] = value
    over = {name: ((*PLACE, "validity_rank") if name in BY_RANK else PLACE) for name in VARIABLES}
    return described(
        "validity.maps",
        {
            "tensions": list(tensions), "stiffnesses": list(stiffnesses), "ranks": list(ranks),
            "angular_frequency": angular_frequency,
        },
        {name: (over[name], values[name], *VARIABLES[name]) for name in VARIABLES}
        | {"validity_angular_frequency": ((), angular_frequency, "rad s-1", "angular frequency of the end motion")},
        {
            "validity_tension": (list(tensions), "N", "tension at the upper end at rest T1"),
            "validity_stiffness": (list(stiffnesses), "N", "axial stiffness K"),
            "validity_rank": (list(ranks), "1", "modes of each coordinate"),
        },
        [base],
    )  # fmt: skip


def _cell(base: xr.Dataset, tension: float, stiffness: float, ranks: Sequence[int]) -> dict[str, object]:
    """Return all errors of one cell."""
    changed = base.assign(cable_top_tension=tension, cable_youngs_modulus=stiffness / float(base["cable_area"]))
    # the same scheme in all cells
    elastic, cable = (
        chain.simulate(changed, tolerance=TOLERANCE, scheme="velocity_verlet", law=law, outputs=("position",))
        for law in ("linear", "green")
    )
    runs = [elastic, cable]
    model, basis = np.empty((2, 2, len(ranks)))
    for i, modes in enumerate(pod.decompose(run, rank=max(ranks)) for run in (elastic, cable)):
        amplitudes = pod.project(cable, modes)
        for j, rank in enumerate(ranks):
            projected = pod.reconstruct(amplitudes.isel(mode=slice(rank)), modes)
            basis[i, j] = compare.errors(projected, cable)["error_max"]
            if i == 1 and j > 0:
                continue  # one rank separates errors of basis and model; these runs take most of the time
            runs.append(galerkin.simulate(changed, modes, rank=rank, tolerance=TOLERANCE))
            model[i, j] = compare.errors(runs[-1], cable)["error_max"]
    at_rest = chain.rest(changed)
    mean = float(at_rest["tension"].mean())
    chord = base["ends_upper"].values - base["ends_lower"].values
    weight = float(base["cable_specific_weight"] * base["cable_area"])
    return {
        "validity_model_error": model[0],
        "validity_own_error": model[1, 0],
        "validity_basis_error": basis[0],
        "validity_own_basis_error": basis[1],
        "validity_law_gap": float(compare.errors(elastic, cable)["error_max"]),
        "validity_sag_parameter": (weight * chord[0] / mean) ** 2 * stiffness / mean,
        "validity_strain": tension / stiffness,
        "validity_smallest_stretch": cable.attrs["smallest_stretch"],
        "validity_settled": float(all(run.attrs["time_error_estimate"] <= TOLERANCE for run in runs)),
    }
