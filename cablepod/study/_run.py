"""Study one scene: rest, snapshots of the chain, modes, reduced models, their errors and run times."""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
import xarray as xr

from cablepod import catenary, chain, compare, pod
from cablepod._inputs import taken
from cablepod._models import REDUCED, Model, model_of
from cablepod.cable._summary import summary
from cablepod.discretisation._chain import chain_of
from cablepod.errors import RunStopped, SceneError, scene_error, warn
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._particles import refuse_own
from cablepod.scene._mast import scene_kind
from cablepod.scene._warnings import warn_once
from cablepod.study._figures import write_figures
from cablepod.study._models import chains_of, coarser_chain, recorded, table_of, timed_twice, with_row
from cablepod.study._stages import Stages, stages_in
from cablepod.study._tension import tension_in_wind
from cablepod.study._timing import timed

#: Interval between the instants of the comparison [s], and their maximum number beside the snapshots (for long runs).
REPORT_INTERVAL, REPORT_INSTANTS = 0.1, 2000
#: Tolerance of the chain that is the reference solution, in motion and tension.  Its tensions decide the step: the motion is then
#: right to some 1e-7 in Examples 1 to 4.  With 1e-6 they would need four to ten times the steps, or not converge.
TRUTH_TOLERANCE = 1e-5
#: Wall time above which it is not repeated for its run time, which no other is compared with [s].
TRUTH_REPEATED = 0.2
#: Outputs of this chain.
OUTPUTS = ("position", "tension", "tension_extremes", "tension_peaks", "error_estimate")
#: Maximum number of modes that are computed.
MAX_MODES = 20


@warn_once
def run(
    scene: xr.Dataset,
    out: str | os.PathLike[str] | None = None,
    *,
    ranks: Iterable[int] = (1, 2, 4),
    models: Iterable[str | Callable[..., xr.Dataset]] = REDUCED,
    overwrite: bool = False,
    progress: Callable[[str, float], None] | None = None,
    report: Callable[[str, xr.Dataset], None] | None = None,
) -> xr.DataTree:
    """Compute rest, snapshots of the chain, modes, reduced models of several ranks, their errors and run times.

    The command ``cablepod run`` calls this function.  The run of the chain gives the snapshots of the modes and the reference
    solution of the errors.  The reduced models are the condensed and the Galerkin model with their defaults.  Chains with fewer
    links and larger tolerances stand beside them, so that run times can be compared at equal error.

    Parameters
    ----------
    scene
        A scene with a table ``[time]``, of a cable or of a mast.  Reduced models that refuse it are left out: with a free end
        both, with viscous links the Galerkin model.
    out
        Folder for a netCDF file of each stage, such as ``chain.nc``, and for figures; made if missing.  A file is written as soon
        as its stage is done, beside older results in a hidden folder.  Without `out` nothing is written or drawn.
    ranks
        Of a cable: numbers of modes of each coordinate, a condensed and a Galerkin model for each.  At most 20 are computed,
        fewer from few links or snapshots; larger ranks are left out with a warning.
    models
        Of a cable: reduced models by name, or models of your own as functions or "module:function", which have the option `rank`
        (see the page of :mod:`cablepod.ensemble`).
    overwrite
        Replace results that are already in `out`, when all new ones are written; they remain after an error.
    progress
        Called with a label, such as "chain" or "galerkin, r = 1: compiling", and the completed fraction, 0 to 1.
    report
        Called with name and Dataset of each stage when it is done, and written where `out` is given.

    Returns
    -------
    xarray.DataTree
        A node for each stage: "scene", "summary", "catenary", "chain_rest", "chain", "chain_half" (tensions with half the links,
        which tell the error of the tensions), "tension" (of a scene with wind: tension at both ends over time, with its mean,
        standard deviation, extremes, fatigue range and utilisation), "modes", "normal_modes", "condensed_r1" and so on,
        "galerkin_r1" and so on, "comparison", "chains".  ``study["chain"].to_dataset()`` is the Dataset that ``chain.simulate``
        gives, with the wall time of the call in the attribute ``wall_time_s`` [s] and the estimated distance from the continuous
        cable in ``space_error_estimate``.  "comparison" has errors and run times over
        ``model`` and ``rank``; "chains" has those of the cheaper chains.  The attribute ``left_out`` of the tree lists the models
        that are left out, with the reason, ``compile_time_s`` is the time of compilation [s], of which no run time has any, and
        ``notes_left_out`` the number of warnings that repeat an earlier one for another model.  Of a mast: "scene", "rest",
        "frequencies", "motion" and "guys", a table of tensions.

    Raises
    ------
    SceneError
        For unsupported scenes and ranks, before anything runs.
    ArchiveError
        Before anything runs, for a folder that cannot be made or written, that holds results, or where another run is at
        work; later for a full disk.
    RunStopped
        If the run of the chain, or of a mast, diverges.  What it computed is in ``partial``, and where `out` is given in
        ``chain_incomplete.nc``, or ``motion_incomplete.nc``.

    Warns
    -----
    UserWarning
        For ranks larger than the number of modes.
    UnusualSceneWarning
        Once, of the worst that :func:`cablepod.summary` notes.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> study = cp.study.run(examples.scene("example2"), ranks=(1, 2))
    >>> study["comparison"]["error_max"].sel(model="galerkin").values.round(4).tolist()
    [0.0146, 0.0004]
    >>> axes = cp.plots.modes(study["modes"].to_dataset())
    """
    scene = taken("scene", scene, scene_kind(scene))
    if "mast_height" in scene:
        from cablepod.study._mast import run_mast  # costly to import, not needed for a cable

        return run_mast(scene, out, overwrite=overwrite, progress=progress, report=report)
    p = parameters(scene)
    refuse_own(p, "chain.simulate, pod.decompose")
    snapshots_at = p.times()  # refuses a scene without [time]
    available = min(MAX_MODES, chain_of(p).links - 1, snapshots_at.size - 1)
    ranks = _checked_ranks(ranks, available)
    chosen = _checked_models(models)
    with stages_in(out, chosen, overwrite=overwrite, progress=progress, report=report) as stages:
        stages.add("scene", scene)
        numbers = stages.add("summary", summary(scene))
        stages.add("catenary", catenary.rest(scene))
        stages.add("chain_rest", chain.rest(scene))
        report_at = _report_times(snapshots_at)
        truth = partial(chain.simulate, scene, times=report_at, tolerance=TRUTH_TOLERANCE, outputs=OUTPUTS)
        reference, seconds = stages.simulate("chain", "chain", partial(timed, longest_repeated=TRUTH_REPEATED), truth)
        half = coarser_chain(scene, reference)
        if half is not None:
            stages.add("chain_half", half)
        if p.wind is not None:
            stages.add("tension", tension_in_wind(scene, reference, numbers, progress))
        snapshots = reference if report_at.size == snapshots_at.size else pod.at_times(reference, times=snapshots_at)
        modes = _modes(
            stages, snapshots, available, [name for name, model in chosen.items() if model.layout == "normal"]
        )
        ranks = _ranks_of(ranks, min(part.sizes["mode"] for part in modes.values()))
        rows: dict[tuple[str, int], xr.Dataset] = {}
        for name, model in chosen.items():
            measure = partial(timed_twice, repeated=not model.own)
            try:
                basis = modes.get(model.layout or "")
                for r in () if basis is None else ranks:
                    call = partial(model.simulate, scene, basis, rank=r, times=report_at)
                    reduced, row = stages.simulate(f"{name}_r{r}", f"{name}, r = {r}", measure, call)
                    rows[name, r] = with_row(compare.errors(reduced, reference), row)
            except (SceneError, RunStopped) as error:  # the other models go on
                stages.left_out.append(f"{name}: {error}")
        if rows:
            compared = [stages.results[f"{model}_r{r}"] for model, r in rows]
            stages.add("comparison", recorded(table_of(rows), "comparison", [*compared, reference]))
            chains = chains_of(scene, reference, seconds["call_time"], progress)
            if chains is not None:
                stages.add("chains", chains)
        if stages.folder is not None:
            best = min(rows, key=lambda key: float(rows[key]["error_max"]), default=None)
            drawn = None if best is None else stages.results[f"{best[0]}_r{best[1]}"]
            errors = {f"{model}, r = {r}": row for (model, r), row in rows.items()}
            ends, title = stages.results.get("tension"), str(scene.attrs["title"])
            write_figures(stages.folder, reference, stages.results["modes"], drawn, errors, ends=ends, title=title)
        return stages.tree()


def _modes(stages: Stages, snapshots: xr.Dataset, rank: int, normal: list[str]) -> dict[str, xr.Dataset]:
    """Add the modes of each layout; models that need `normal` ones are left out without a chord, which these need."""
    modes = {"separate": stages.add("modes", pod.decompose(snapshots, rank=rank))}
    try:
        modes["normal"] = stages.add("normal_modes", pod.decompose(snapshots, rank=rank, layout="normal"))
    except SceneError as error:
        stages.left_out.extend(f"{name}: {error}" for name in normal)
    return modes


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


def _checked_models(models: Iterable[str | Callable[..., xr.Dataset]]) -> dict[str, Model]:
    """Return the distinct reduced models by name."""
    if isinstance(models, str) or not isinstance(models, Iterable):
        raise scene_error("models", models, f"a list, such as {list(REDUCED)}, or of functions of your own")
    found: dict[str, Model] = {}
    for given in models:
        model = model_of(given, allowed=REDUCED)
        if found.get(model.name, model) != model:
            raise SceneError(f"models: given two of the name {model.name}; allowed: one of each name")
        if "rank" not in model.options():
            raise SceneError(f"models: given {model.key}, without the option rank; allowed: functions that have it")
        found[model.name] = model
    return found


def _ranks_of(ranks: list[int], modes: int) -> list[int]:
    """Return the ranks that the modes have; warn of those that are left out."""
    left = [r for r in ranks if r <= modes]
    if len(left) < len(ranks):
        warn(
            f"ranks: {ranks[len(left) :]} left out, only {modes} modes; use smaller ranks, or more links and snapshots"
        )
    return left


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
