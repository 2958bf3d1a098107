"""Reproduce Examples 2 to 4: Table 2, energy shares of Example 3, errors of the reduced model."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import xarray as xr

from cablepod import catenary, chain, compare, galerkin, pod
from cablepod.batch._pool import map_threads
from cablepod.errors import RunStopped
from cablepod.examples import scene, table
from cablepod.paper.datasets import described

#: Number of modes in the sums of the paper.
SUMMED = 20
#: Initial shapes of Table 2: name of the scene -> description.
STARTS = {
    "example2": "equilibrium",
    "example2_out_of_equilibrium": "shape of a longer cable",
    "example2_tauter_start": "shape of a tauter cable",
    "example2_as_printed": "L0 as printed, K = EA",
    "example2_soft": "L0 as printed, K = EA / 100",
    "example2_outward": "equilibrium, end moving outwards (+0.07)",
}
#: Time steps of Example 3 from swapped rows [s].  Links slacken and snap taut, so that results depend on the step; steps above
#: FINE_STEP are too long for it, though below the stability limit of the taut chain.
SWAPPED_STEPS = (3.2e-4, 2.8e-4, 2.5e-4, 2e-4, 1.6e-4, 1.43e-4, 1.33e-4, 1.25e-4, 1e-4, 8e-5, 5e-5, 4e-5, 2.5e-5)
FINE_STEP = 2e-4
#: Modes of each coordinate in the table of errors.
RANKS = (1, 2, 3, 4, 6, 8)


#: Tolerance of the time error of chains without a given step.
CHAIN_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Study:
    """Scene, trajectory of the chain at the 125 instants of the paper, and its modes."""

    scene: xr.Dataset
    chain: xr.Dataset
    modes: xr.Dataset


@functools.cache
def study(name: str) -> Study:
    """Simulate the chain of a shipped scene and decompose its motion; cached for several tables and figures."""
    base = scene(name)
    explicit = partial(chain.simulate, base, scheme="velocity_verlet")
    step = explicit(tolerance=CHAIN_TOLERANCE, outputs=("position",)).attrs["step"]
    run = explicit(step=step, outputs=("position", "tension"))
    return Study(base, run, pod.decompose(run, rank=SUMMED))


def fraction_of(count: int, progress: Callable[[float], None] | None) -> Callable[[int], None]:
    """Return a callback that converts the number of completed cases to a fraction."""

    def report(done: int) -> None:
        if progress is not None:
            progress(done / count)

    return report


def misfit(values: np.ndarray, printed: np.ndarray) -> np.ndarray:
    """Return the rms of ln(values / printed) over the last two axes."""
    return np.sqrt(np.mean(np.log(values / printed) ** 2, axis=(-2, -1)))


def printed_values() -> np.ndarray:
    """Return the singular values of Table 2 (coordinate, row) [m]."""
    rows = table("table2")
    return np.stack([rows[f"singular_value_{axis}_m"] for axis in "xy"])


def printed_of(example: int) -> np.ndarray:
    """Return what the text prints of 20 singular values (coordinate,): of Example 2 the sum [m], of 3 the share of five [%]."""
    rows = table("energy_shares")
    row = int(np.flatnonzero(rows["example"] == example)[0])
    return np.array([rows[name][row] for name in ("horizontal", "vertical")])


def table2(*, starts: Sequence[str] = tuple(STARTS), workers: int = 2) -> xr.Dataset:
    """Compute Table 2 from several initial shapes, with the printed values.

    Parameters
    ----------
    starts
        Names of shipped scenes.
    workers
        Number of threads.

    Returns
    -------
    xarray.Dataset
        ``table2_singular_value (start, coordinate, table2_row)`` [m], ``table2_share``: cumulative sigma / sum sigma over 20
        modes, ``table2_energy_share``: cumulative sigma^2 / sum sigma^2, ``table2_proper_orthogonal_value`` [m2],
        ``table2_sum (start, coordinate)`` [m], ``table2_misfit (start)`` over all rows and ``table2_misfit_3`` over the first
        three, and the print.
    """
    rows, printed = table("table2"), printed_values()
    printed_share = np.stack([rows[f"cumulative_share_{axis}_percent"] for axis in "xy"]) / 100.0
    count = printed.shape[1]
    studies = map_threads(study, starts, workers)
    values = np.stack([base.modes["singular_value"].values for base in studies])
    squares = values**2
    samples = studies[0].modes.attrs["number_of_snapshots"]

    def cumulative(part: np.ndarray) -> np.ndarray:
        return (np.cumsum(part, axis=-1) / part.sum(axis=-1, keepdims=True))[..., :count]

    place = ("start", "coordinate", "table2_row")
    return described(
        "examples.table2", {"starts": list(starts)},
        {
            "table2_singular_value": (place, values[..., :count], "m", "singular value of the centred, lifted snapshots"),
            "table2_share": (place, cumulative(values), "1", "cumulative share of the sum of 20 singular values"),
            "table2_energy_share": (place, cumulative(squares),
                "1", "cumulative share of the sum of 20 squared singular values"),
            "table2_proper_orthogonal_value": (place, squares[..., :count] / samples,
                "m2", "squared singular value over the number of snapshots"),
            "table2_sum": (place[:2], values.sum(axis=-1), "m", "sum of 20 singular values"),
            "table2_top_tension": ("start", [float(catenary.rest(base.scene)["tension_upper"]) for base in studies],
                "N", "tension at the upper end of the cable at rest"),
            "table2_misfit": ("start", misfit(values[..., :count], printed),
                "1", "rms of ln(ours / print) over all rows and both columns"),
            "table2_misfit_3": ("start", misfit(values[..., :3], printed[:, :3]),
                "1", "rms of ln(ours / print) over the first three rows and both columns"),
            "table2_singular_value_printed": (place[1:], printed, "m", "singular value as printed"),
            "table2_share_printed": (place[1:], printed_share, "1", "cumulative share as printed"),
        },
        {
            "start": (list(starts), "1", "shipped scene from which the chain starts"),
            "coordinate": (["x", "y"],),
            "table2_row": (np.arange(1, count + 1), "1", "row of Table 2"),
        },
        [base.modes for base in studies],
    )  # fmt: skip


def share_of_five(modes: xr.Dataset) -> np.ndarray:
    """Return the share of five singular values in their sum (coordinate,)."""
    values = modes["singular_value"].values
    return values[:, :5].sum(axis=1) / values.sum(axis=1)


def example3_share(*, steps: Sequence[float] = SWAPPED_STEPS, workers: int = 2) -> xr.Dataset:
    """Compute the share of five singular values of Example 3 in the sum of 20.

    Parameters
    ----------
    steps
        Time steps of the runs from swapped rows [s].
    workers
        Number of threads.

    Returns
    -------
    xarray.Dataset
        ``example3_share_equilibrium (coordinate)``, ``example3_share_swapped (example3_step, coordinate)``, nan for stopped
        runs, and the printed shares.
    """
    swapped = scene("example3_swapped_rows")

    def of_step(step: float) -> np.ndarray:
        try:
            return share_of_five(pod.decompose(chain.simulate(swapped, step=step), rank=SUMMED))
        except RunStopped:  # step too long for links that snap taut
            return np.full(2, np.nan)

    shares = map_threads(of_step, steps, workers)
    return described(
        "examples.example3_share", {"steps": list(steps)},
        {
            "example3_share_equilibrium": ("coordinate", share_of_five(study("example3").modes),
                "1", "share of five in the sum of 20 singular values, from equilibrium"),
            "example3_share_swapped": (("example3_step", "coordinate"), shares,
                "1", "the same from the shape of 3750 N with the length of 7500 N"),
            "example3_share_printed": ("coordinate", printed_of(3) / 100.0,
                "1", "share as printed"),
        },
        {
            "coordinate": (["x", "y"],),
            "example3_step": (list(steps), "s", "time step of the run from swapped rows"),
        },
        [study("example3").modes, swapped],
    )  # fmt: skip


#: Instants of Figure 7 [s].
INSTANTS = (0.0, 15.0, 30.0, 45.0, 60.0, 90.0)
#: Tolerance of the time error of the reduced models, small compared with the table of errors; the second for initial shapes out
#: of equilibrium, for which the model errs by some per cent.
ERROR_TOLERANCE, INITIAL_SHAPE_TOLERANCE = 1e-5, 1e-3
#: Scenes of the table of errors.
ERROR_SCENES = (
    "example2",
    "example2_out_of_equilibrium",
    "example2_tauter_start",
    "example3",
    "example4",
    "example4_opposite_load",
)


def errors(
    *,
    scenes: Sequence[str] = ERROR_SCENES,
    ranks: Sequence[int] = RANKS,
    workers: int = 2,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Compute the errors of the paper's reduced model, law (21), against the chain of its modes.

    Parameters
    ----------
    scenes
        Names of shipped scenes.
    ranks
        Modes of each coordinate.
    workers
        Number of threads.
    progress
        Callback receiving the completed fraction, 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``reduced_error (scene, reduced_rank)``: largest error over time, ``reduced_error_45``: that at 45 s,
        ``reduced_error_six``: the largest at the instants of Figure 7, ``projection_error``: largest error of the projected
        motion, with the same dimensions; ``scene_unstretched_length (scene)`` [m], ``scene_smallest_tension (scene)`` [N].
    """

    def errors_of(case: tuple[int, int]) -> tuple[float, ...]:
        base, rank = studies[case[0]], ranks[case[1]]
        has_initial_shape = any(str(name).startswith("initial") for name in base.scene.variables)
        tolerance = INITIAL_SHAPE_TOLERANCE if has_initial_shape else ERROR_TOLERANCE
        run = galerkin.simulate(base.scene, base.modes, rank=rank, tolerance=tolerance)
        error = compare.errors(run, base.chain)
        amplitudes = pod.project(base.chain, base.modes).isel(mode=slice(rank))
        projection = compare.errors(pod.reconstruct(amplitudes, base.modes), base.chain)
        at_six = float(error["error"].sel(time=list(INSTANTS)).max())
        at_45 = float(error["error"].sel(time=45.0))
        return float(error["error_max"]), at_45, at_six, float(projection["error_max"])

    studies = map_threads(study, scenes, workers)
    # largest models first: they take longest
    cases = [(i, j) for j in reversed(range(len(ranks))) for i in range(len(scenes))]
    worst, at45, six, projected = np.empty((4, len(scenes), len(ranks)))
    for case, values in zip(
        cases, map_threads(errors_of, cases, workers, done=fraction_of(len(cases), progress)), strict=True
    ):
        worst[case], at45[case], six[case], projected[case] = values
    return described(
        "examples.errors", {"scenes": list(scenes), "ranks": list(ranks)},
        {
            "reduced_error": (("scene", "reduced_rank"), worst,
                "1", "largest error of the reduced model over time, over the largest rms displacement"),
            "reduced_error_45": (("scene", "reduced_rank"), at45, "1", "error of the reduced model at 45 s"),
            "reduced_error_six": (("scene", "reduced_rank"), six,
                "1", "largest error of the reduced model at the six instants of Figure 7"),
            "projection_error": (("scene", "reduced_rank"), projected, "1", "largest error of the projected motion over time"),
            "scene_unstretched_length": ("scene", [float(base.chain["arc_length"][-1]) for base in studies],
                "m", "unstretched length of the scene"),
            "scene_smallest_tension": ("scene", [float(base.chain["tension"].min()) for base in studies],
                "N", "smallest tension of a link at the instants of the snapshots"),
        },
        {
            "scene": (list(scenes), "1", "shipped scene"),
            "reduced_rank": (list(ranks), "1", "modes of each coordinate"),
        },
        [base.modes for base in studies],
    )  # fmt: skip
