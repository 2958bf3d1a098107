"""Public function: motion of a mast and its guys."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import NORMAL_MODES, taken
from cablepod._resources import check_memory
from cablepod.batch._members import no_plan, over_members_by
from cablepod.errors import NotConvergedWarning, OutOfRangeWarning, RunStopped, SceneError, scene_error, user_stacklevel
from cablepod.integrate._request import check_outputs, check_times
from cablepod.mast import _output as output
from cablepod.mast._catenary_run import CatenaryGuys
from cablepod.mast._chain_run import ChainGuys
from cablepod.mast._condensed_guy import shapes_of
from cablepod.mast._condensed_run import CondensedGuys
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastRequest, MastTrajectory, request_of
from cablepod.mast._statics import rest_of
from cablepod.parameters._checks import choice, integer, number
from cablepod.parameters._mast import MastParameters, mast_parameters
from cablepod.scene._mast import MAST_SCENE
from cablepod.wind._mast_air import mast_air

#: Kinds of guys.
KINDS = ("condensed", "chain", "catenary")
#: Default number of modes of each deflection of a guy, and of those beyond them in the error estimate.
RANK, RICHER = 4, 4
#: Maximum number of halved steps to meet a tolerance.
MAX_HALVINGS = 6


@over_members_by(no_plan, kind=MAST_SCENE)
def simulate(
    scene: xr.Dataset,
    modes: xr.Dataset | None = None,
    *,
    guys: str = "condensed",
    rank: int | None = None,
    links: int | None = None,
    times: Any = None,
    step: float | None = None,
    tolerance: float | None = None,
    window: tuple[float, float] | None = None,
    wind: xr.Dataset | None = None,
    outputs: tuple[str, ...] = ("displacement", "guy_tension", "extremes"),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate a mast and its guys from rest in the mean wind, under loads, wind and turbulence.

    Parameters
    ----------
    scene
        Scene with a mast.
    modes
        Modes of layout "normal" of the guys' deflections, carried over by the relative arc length; sines by default.
    guys
        "condensed": reduced models of the guys; "chain": lumped masses and elastic links; "catenary": static catenaries in still
        air, which have the drag's part at the mast but no motion of their own.
    rank
        Number of modes of each deflection of a condensed guy; 4 by default.
    links
        Number of links of a guy with "chain", instead of the scene's.
    times
        Equally spaced output times from 0 on [s], instead of the scene's.
    step
        Step [s], which divides the interval of the output; chosen by default.
    tolerance
        Largest difference of the guys' tensions from those of half the step, rms over their standard deviation; the step is
        halved until it is met.
    window
        Start and end [s] of the part of the run over which extremes, means and standard deviations are taken.
    wind
        Field of the air, as of :func:`cablepod.wind.field`, in place of that of the scene.
    outputs
        Some of "displacement", "guy_tension", "guy_force", "bending_moment", "extremes"; with condensed guys also
        "guy_position" (at 21 points of each guy), "energy" (without wind) and "error_estimate" (one more run with richer guys).
    progress
        Callback receiving the completed fraction, 1 at the end.

    Returns
    -------
    xarray.Dataset
        ``displacement (time, level, coordinate)`` [m], ``guy_tension (time, guy)`` [N] at the mast, ``guy_force (time, guy,
        coordinate)`` [N] on the mast, ``guy_position (time, guy, point, coordinate)`` [m] from anchor to mast,
        ``bending_moment (time, node, coordinate)`` [N m]; with "extremes" least and largest
        values, their times, means and standard deviations over all steps (of bending moments, over the outputs).  Attributes:
        kind of guys, step [s], number of steps, least chordwise force of the guys [N] (chains: least tension).

    Raises
    ------
    SceneError
        For invalid options, a step above the stability limit, guys that break without chains, and as :func:`rest`.
    RunStopped
        If the motion leaves the finite numbers or stiffens beyond the stability limit; ``partial`` is the result until then.

    Warns
    -----
    OutOfRangeWarning
        If a condensed guy goes slack, and for a motion beyond the table of static guys.
    NotConvergedWarning
        If the tolerance is not met.

    Notes
    -----
    One compiled loop advances mast and guys by a leapfrog scheme whose mass matrix is constant and block diagonal in the momentum
    coordinates of the guys, so that stiffness and mass are coupled without iterations.  Accelerations times sinc^2(omega step/2)
    give modes of the mast and of the guys their exact frequencies.  See the equations in the README of this sub-package.

    Examples
    --------
    >>> import cablepod as cp
    >>> scene = cp.read_scene("data/scenes/mast30.toml")
    >>> run = cp.mast.simulate(scene)
    >>> run.guy_tension.dims, run.displacement.dims, run.attrs["guys"]
    (('time', 'guy'), ('time', 'level', 'coordinate'), 'condensed')
    """
    wanted = check_outputs(outputs, output.OUTPUTS)
    choice(*KINDS)("guys", guys)
    if modes is not None:
        modes = taken("modes", modes, NORMAL_MODES)
    p = mast_parameters(scene)
    _check_numbers(rank, links, step, tolerance, window)
    _check_kind(p, guys, wanted, in_wind=p.wind is not None or wind is not None, rank=rank, modes=modes, links=links)
    instants = p.times() if times is None else check_times(times)
    check_memory(instants.size, max(len(p.guys), 1), 3, key="time.interval" if times is None else "times")
    air = mast_air(p, float(instants[-1]), wind)
    mast = ModalMast(rest_of(p, None if air is None or air.has_profile else air))
    count = RANK if rank is None else int(rank)
    model = _model_of(mast, guys, modes, count, links, air)
    request = request_of(
        instants, model.default_step, step, window, energy="energy" in wanted, keeps_guys="guy_position" in wanted
    )
    run, notes = _converged(model, request, tolerance)
    result = output.trajectory(mast, run, wanted)
    if "error_estimate" in wanted and not run.status:
        richer = _model_of(mast, guys, None if modes is None else modes, count + RICHER, links, air)
        every = max(request.every, int(np.ceil(request.interval / richer.default_step * (1.0 - 1e-9))))
        finer = richer.run(MastRequest(request.times, every, window))
        notes["error_estimate"] = float(difference(run, finer).max(initial=0.0))
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: mast with guys of kind {guys}",
        stage="mast",
        guys=guys,
        scheme="velocity_verlet",
        step=run.request.step,
        number_of_steps=run.request.steps,
        **({"rank": count} if guys == "condensed" else {"links": model.links} if isinstance(model, ChainGuys) else {}),
        **({} if window is None else {"window_start": float(window[0]), "window_end": float(window[1])}),
        **notes,
        **_least_force(p, run, guys),
    )
    result = provenance.record(
        result,
        function="mast.simulate",
        parameters={
            "guys": guys, "rank": count if guys == "condensed" else None,
            "links": model.links if isinstance(model, ChainGuys) else None, "times": instants, "step": run.request.step,
            "tolerance": tolerance, "window": None if window is None else list(window), "outputs": list(wanted),
        },
        inputs=[scene, *(given for given in (modes, wind) if given is not None)],
        chosen=provenance.defaulted_options(rank=rank, links=links, times=times, step=step, tolerance=tolerance),
    )  # fmt: skip
    if progress is not None:
        progress(1.0)
    if run.status:
        where = p.guys[run.guy].key if p.guys else "mast"
        reason = (
            "left the finite numbers"
            if run.status == 1
            else f"stiffened beyond the stability limit of the step ({where})"
        )
        result.attrs["incomplete"] = f"stopped at {run.stopped_at:.9g} s"
        raise RunStopped(
            f"the mast {reason} at {run.stopped_at:.6g} s; partial holds the result until then; try a shorter step"
            + (', or guys="chain"' if guys == "condensed" else ""),
            result,
        )
    return result


def _check_kind(p: MastParameters, guys: str, wanted: tuple[str, ...], *, in_wind: bool, **options: Any) -> None:
    """Refuse options and outputs that the kind of guys lacks."""
    for key, kind in (("rank", "condensed"), ("modes", "condensed"), ("links", "chain")):
        if options[key] is not None and guys != kind:
            raise SceneError(f'{key}: given with guys "{guys}"; allowed: none; try: guys="{kind}"')
    for name in ("energy", "error_estimate", "guy_position"):
        if name in wanted and guys != "condensed":
            raise scene_error("outputs", name, f'none with guys "{guys}"; try: guys="condensed"')
    if "energy" in wanted and in_wind:
        raise scene_error("outputs", "energy", "none with wind, which supplies energy")
    for guy in p.guys:
        if guy.breaks is not None and guys != "chain":
            raise scene_error(f"{guy.key}.breaks", guy.breaks, f'none with guys "{guys}"; try: guys="chain"')


def _check_numbers(rank: Any, links: Any, step: Any, tolerance: Any, window: Any) -> None:
    """Refuse numbers that are invalid or do not go together."""
    for key, value, check in (
        ("rank", rank, integer(least=1, most=60)),
        ("links", links, integer(least=2, most=10**4)),
        ("step", step, number(above=0.0)),
        ("tolerance", tolerance, number(above=0.0, most=1.0)),
    ):
        if value is not None:
            check(key, value)
    if tolerance is not None and step is not None:
        raise scene_error("tolerance", tolerance, "none beside step")
    if window is not None:
        if not isinstance(window, tuple | list) or len(window) != 2:
            raise scene_error("window", window, "start and end [s]")
        start, end = (number(least=0.0)("window", value) for value in window)
        if not start < end:
            raise scene_error("window", window, "start and end [s], rising")


def _model_of(mast: ModalMast, guys: str, modes: Any, rank: int, links: int | None, air: Any) -> Any:
    """Return the model of the guys."""
    if guys == "condensed":
        if modes is not None:
            rank = min(rank, modes.sizes["mode"])
        return CondensedGuys(mast, shapes_of(modes, rank), air)
    if guys == "chain":
        return ChainGuys(mast, links or (mast.rest.p.guys[0].p.links if mast.rest.p.guys else 2) or 2, air)
    return CatenaryGuys(mast, air)


def _converged(model: Any, request: MastRequest, tolerance: float | None) -> tuple[MastTrajectory, dict[str, Any]]:
    """Run, with halved steps until a tolerance is met."""
    run = model.run(request)
    if tolerance is None or run.status:
        return run, {}
    error = np.inf
    for _ in range(MAX_HALVINGS):
        request = replace(request, every=2 * request.every)
        finer = model.run(request)
        if finer.status:
            break
        error, run = float(difference(run, finer).max(initial=0.0)), finer
        if error <= tolerance:
            break
    else:
        warnings.warn(
            f"tensions still differ by {error:.3g} of their standard deviation from those of half the step, more than the "
            f"tolerance {tolerance:g}; the finest run is returned; try a larger tolerance",
            NotConvergedWarning,
            stacklevel=user_stacklevel(),
        )
    return run, {"time_error_estimate": error}


def difference(run: MastTrajectory, other: MastTrajectory) -> np.ndarray:
    """Return the rms difference of the guys' tensions over their standard deviation (guys,)."""
    spread = other.tension.std(axis=0)
    scale = np.where(spread > 0.0, spread, np.maximum(np.abs(other.tension).mean(axis=0), 1e-300))
    return np.sqrt(((run.tension - other.tension) ** 2).mean(axis=0)) / scale


def _least_force(p: MastParameters, run: MastTrajectory, guys: str) -> dict[str, float]:
    """Return the least force of a guy and its time as attributes; warn of slack condensed guys."""
    if not p.guys or guys == "catenary":
        return {}
    worst = int(run.monitor[:, 0].argmin())
    least, time = float(run.monitor[worst, 0]), float(run.monitor[worst, 1]) * run.request.step
    name = "smallest_chordwise_force" if guys == "condensed" else "smallest_tension"
    if guys == "condensed" and least < 0.0 and not run.status:
        warnings.warn(
            f"{p.guys[worst].key}: the chordwise force of guy {worst + 1} became negative, {least:.3g} N at {time:.6g} s: it "
            'goes slack, where the condensed model resists compression; compare with guys="chain"',
            OutOfRangeWarning,
            stacklevel=user_stacklevel(),
        )
    return {name: least, f"time_of_{name}": time}
