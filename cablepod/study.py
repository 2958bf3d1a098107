"""Study one scene: rest, snapshots of the chain, modes, Galerkin models and their errors."""

from __future__ import annotations

import functools
import operator
import os
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import archive, catenary, chain, compare, galerkin, pod
from cablepod.archive._atomic import atomic_file
from cablepod.archive._folder import prepare_folder
from cablepod.discretisation._chain import chain_of
from cablepod.errors import RunStopped, SceneError, scene_error
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._parameters import Parameters

__all__ = ["run"]
#: Interval between the instants of the comparison [s], and their maximum number beside the snapshots (for long runs).
REPORT_INTERVAL, REPORT_INSTANTS = 0.1, 2000
#: Tolerance of the time error of the Galerkin models, small beside the error of their modes.
REDUCED_TOLERANCE = 1e-5
#: Maximum number of modes that are computed.
MAX_MODES = 20
#: Fractions of the duration at which shapes are drawn (without a common period, so that a periodic motion shows its phases).
DRAWN_AT = (0.0, 0.12, 0.37, 0.58, 0.83)
#: Names of the figures, in the order in which they are written.
FIGURES = ("shapes", "deflection", "modes", "singular_values", "error_over_time")


def run(
    scene: xr.Dataset,
    out: str | os.PathLike[str] | None = None,
    *,
    ranks: Iterable[int] = (1, 2, 3, 4),
    overwrite: bool = False,
    progress: Callable[[str, float], None] | None = None,
    report: Callable[[str, xr.Dataset], None] | None = None,
) -> xr.DataTree:
    """Compute rest, snapshots of the chain, modes, Galerkin models of several ranks and their errors.

    The command ``cablepod run`` calls this function.  The run of the chain gives the snapshots of the modes and the reference
    solution of the errors.

    Parameters
    ----------
    scene
        A scene with a table ``[time]``, both ends held, and no viscous links.
    out
        Folder for a netCDF file of each stage, such as ``chain.nc``, and for five figures; made if missing.  A file is written
        as soon as its stage is done.  Without `out` nothing is written or drawn.
    ranks
        Numbers of modes of each coordinate, one Galerkin model for each.  At most 20 modes are computed, fewer from few links or
        snapshots; larger ranks are left out with a warning.
    overwrite
        Replace results that are already in `out`.
    progress
        Called with a label, such as "chain" or "Galerkin r = 1", and the completed fraction of that run, 0 to 1.
    report
        Called with name and Dataset of each stage when it is done, and written where `out` is given.

    Returns
    -------
    xarray.DataTree
        A node for each stage: "scene", "catenary", "chain_rest", "chain", "modes", "galerkin_r1" and so on, "comparison".
        ``study["chain"].to_dataset()`` is the Dataset that ``chain.simulate`` gives.  The attribute ``wall_time_s`` [s] of
        "chain" and of the Galerkin models is the time of the whole call, with the check of its step and with compilation.

    Raises
    ------
    SceneError
        For unsupported scenes and ranks, before anything runs.
    ArchiveError
        Before anything runs, for a folder that cannot be made or written, or that holds results; later for a full disk.
    RunStopped
        If a run diverges.  What it computed is in ``partial``, and in ``chain_incomplete.nc`` where `out` is given.

    Warns
    -----
    UserWarning
        For ranks larger than the number of modes.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> study = cp.study.run(examples.scene("example2"), ranks=(1, 2))
    >>> list(study)
    ['scene', 'catenary', 'chain_rest', 'chain', 'modes', 'galerkin_r1', 'galerkin_r2', 'comparison']
    >>> study["comparison"]["error_max"].values.round(4).tolist()
    [0.0146, 0.0004]
    >>> axes = cp.plots.modes(study["modes"].to_dataset())
    """
    p = parameters(scene)
    snapshots_at = p.times()  # refuses a scene without [time]
    available = min(MAX_MODES, chain_of(p).links - 1, snapshots_at.size - 1)
    _check_scene(p)
    ranks = _checked_ranks(ranks, available)
    folder = None
    if out is not None:
        folder = Path(out)
        names = ("scene", "catenary", "chain_rest", "chain", "modes", "comparison", *(f"galerkin_r{r}" for r in ranks))
        prepare_folder(folder, [f"{name}.nc" for name in names], overwrite=overwrite)

    stages = _Stages(folder, progress, report)
    stages.add("scene", scene)
    stages.add("catenary", catenary.rest(scene))
    stages.add("chain_rest", chain.rest(scene))
    report_at = _report_times(snapshots_at)
    simulate = functools.partial(chain.simulate, scene, times=report_at, outputs=("position", "tension"))
    reference = stages.simulate("chain", "chain", simulate)
    snapshots = reference if report_at.size == snapshots_at.size else pod.at_times(reference, times=snapshots_at)
    modes = pod.decompose(snapshots, rank=available)
    stages.add("modes", modes)
    too_large = [r for r in ranks if r > modes.sizes["mode"]]
    if too_large:
        warnings.warn(
            f"ranks: {too_large} left out, only {modes.sizes['mode']} modes; use smaller ranks, or more links and snapshots",
            stacklevel=2,
        )
    comparisons = {}
    for r in ranks[: len(ranks) - len(too_large)]:
        options: dict[str, Any] = {"rank": r, "times": report_at, "tolerance": REDUCED_TOLERANCE}
        simulate = functools.partial(galerkin.simulate, scene, modes, **options)
        reduced = stages.simulate(f"galerkin_r{r}", f"Galerkin r = {r}", simulate)
        comparisons[r] = compare.errors(reduced, reference)
    stages.add("comparison", _comparison(comparisons))
    if folder is not None:
        _write_figures(folder, reference, modes, reduced, comparisons)
    return stages.tree()


@dataclass(frozen=True)
class _Stages:
    """Results of the stages by name; each is written and reported as soon as it is added."""

    folder: Path | None
    progress: Callable[[str, float], None] | None
    report: Callable[[str, xr.Dataset], None] | None
    results: dict[str, xr.Dataset] = field(default_factory=dict)

    def add(self, name: str, result: xr.Dataset) -> None:
        """Store, write and report the result of a stage."""
        if self.folder is not None:
            archive.write(result, self.folder / f"{name}.nc", overwrite=True)
        self.results[name] = result
        if self.report is not None:
            self.report(name, result)

    def simulate(self, name: str, label: str, simulate: Callable[..., xr.Dataset]) -> xr.Dataset:
        """Add the result of a run with its wall time [s], or the partial result of a stopped run."""
        progress = None if self.progress is None else functools.partial(self.progress, label)
        if progress is not None:
            progress(0.0)
        begin = time.perf_counter()
        try:
            result = simulate(progress=progress)
        except RunStopped as error:
            if error.partial is not None:
                self.add(f"{name}_incomplete", error.partial)
            raise
        result.attrs["wall_time_s"] = time.perf_counter() - begin
        if progress is not None:
            progress(1.0)
        self.add(name, result)
        return result

    def tree(self) -> xr.DataTree:
        """Return a tree with a node for each stage."""
        root = xr.Dataset(attrs={"title": self.results["scene"].attrs["title"]})
        return xr.DataTree.from_dict({"/": root, **self.results}, name="study")


def _check_scene(p: Parameters) -> None:
    """Refuse scenes that the Galerkin model does not support."""
    if p.free_end is not None:
        raise SceneError("ends.free: given a free end; allowed: two held ends, because the reduced model lifts by both")
    if p.link_viscosity is not None:
        raise SceneError(
            f"damping.link_viscosity: given {p.link_viscosity:g}; allowed: none, because the reduced model has no viscous links; "
            "mass_proportional is possible, and chain.simulate does both"
        )


def _checked_ranks(ranks: Iterable[int], available: int) -> list[int]:
    """Return the distinct ranks in increasing order."""
    try:
        rising = sorted({operator.index(r) for r in ranks})
    except TypeError:
        rising = []
    if not rising or rising[0] < 1:
        raise scene_error("ranks", ranks, "whole numbers of at least 1")
    if rising[0] > available:
        raise scene_error("ranks", rising, f"one or more of at most {available}, the number of modes of this scene")
    return rising


def _report_times(snapshots_at: np.ndarray) -> np.ndarray:
    """Return the instants of the comparison [s]: those of the snapshots and, between them, a uniform grid."""
    last = float(snapshots_at[-1])
    count = round(last / REPORT_INTERVAL)
    if count > REPORT_INSTANTS or abs(count * REPORT_INTERVAL - last) > 1e-9 * last:
        count = max(1, min(REPORT_INSTANTS, int(last / REPORT_INTERVAL)))
    grid = np.linspace(0.0, last, count + 1)
    right = np.clip(np.searchsorted(snapshots_at, grid), 1, snapshots_at.size - 1)
    distance = np.minimum(np.abs(grid - snapshots_at[right - 1]), np.abs(snapshots_at[right] - grid))
    return np.sort(np.concatenate([snapshots_at, grid[distance > 1e-9 * last]]))


def _comparison(comparisons: dict[int, xr.Dataset]) -> xr.Dataset:
    """Concatenate the errors of the Galerkin models along ``rank``."""
    errors = list(comparisons.values())
    table = xr.concat(errors, dim="rank", data_vars="all", coords="minimal", compat="override", join="exact")
    table = table.assign_coords(
        rank=("rank", list(comparisons), {"units": "1", "long_name": "modes of each coordinate"})
    )
    table.attrs = {**errors[0].attrs, "title": "errors of the Galerkin models against the elastic chain"}
    return table


def _write_figures(
    folder: Path, reference: xr.Dataset, modes: xr.Dataset, best: xr.Dataset, comparisons: dict[int, xr.Dataset]
) -> None:
    """Write :data:`FIGURES` without pyplot, which would change the caller's open figures and backend."""
    from matplotlib.figure import Figure

    from cablepod import plots

    picked = np.rint(np.array(DRAWN_AT) * (reference.sizes["time"] - 1)).astype(int)
    times = [float(t) for t in reference["time"].values[np.unique(picked)]]
    errors = {f"r = {r}": error for r, error in comparisons.items()}
    drawings: tuple[Callable[..., Any], ...] = (
        functools.partial(plots.shapes, reference, best, times=times),
        functools.partial(plots.shapes, reference, best, times=times, deflection=True),
        functools.partial(plots.modes, modes),
        functools.partial(plots.singular_values, modes),
        functools.partial(plots.error_over_time, errors),
    )
    for name, draw in zip(FIGURES, drawings, strict=True):
        figure = Figure(figsize=(7.5, 4.2), layout="constrained")
        draw(ax=figure.subplots())
        with atomic_file(folder / f"{name}.png") as unfinished:
            figure.savefig(unfinished, dpi=150, format="png")
