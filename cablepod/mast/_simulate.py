"""Public function: motion of a mast and its guys."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import xarray as xr

from cablepod.batch._blas import one_blas_thread
from cablepod.batch._members import over_members_by
from cablepod.integrate._request import check_progress
from cablepod.mast._output import check_levels
from cablepod.mast._runs import MastCase
from cablepod.scene._mast import MAST_SCENE
from cablepod.scene._mast_notes import warn_of_unusual_mast_members

#: Outputs by default.
DEFAULT = ("displacement", "guy_tension", "extremes")


def _one_by_one(scene: xr.Dataset, *_: Any, outputs: tuple[str, ...] = DEFAULT, **__: Any) -> None:
    """Refuse members of other levels; there is no faster plan than one by one."""
    check_levels(scene, outputs)


@over_members_by(_one_by_one, warn_of_unusual_mast_members, kind=MAST_SCENE)
def simulate(
    scene: xr.Dataset,
    modes: xr.Dataset | None = None,
    *,
    guys: str | None = None,
    rank: int | None = None,
    links: int | None = None,
    times: Any = None,
    step: float | None = None,
    tolerance: float | None = None,
    window: tuple[float, float] | None = None,
    wind: xr.Dataset | None = None,
    outputs: tuple[str, ...] = DEFAULT,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate a mast and its guys from rest in the mean wind, under loads, wind and turbulence.

    Parameters
    ----------
    scene
        Scene with a mast.
    modes
        Modes of layout "normal" of the deflections of all guys, in and out of their vertical planes, carried over by the relative
        arc length; sines by default.  Modes of a cable that moved in its plane serve for both.
    guys
        "condensed": reduced models of the guys; "chain": lumped masses and elastic links; "catenary": static catenaries in still
        air, which have the drag's part at the mast but no motion of their own.  Condensed by default; chains where a cable of a
        guy has segments or attachments, which the other kinds refuse.
    rank
        Number of modes of each deflection of a condensed guy; 4 by default, or that of the modes if these are fewer.
    links
        Number of links of a guy with "chain", instead of the scene's.
    times
        Equally spaced output times from 0 on [s], instead of the scene's.
    step
        Step [s], which divides the interval of the output; chosen by default, and halved where a guy stiffens beyond its
        stability limit.
    tolerance
        Largest difference of the guys' tensions from those of half the step, rms over their standard deviation; the step is
        halved until it is met.
    window
        Start and end [s] of the part of the run over which extremes, means and standard deviations are taken.
    wind
        Field of :func:`cablepod.wind.field`, or a record with the same variables, in place of mean wind and gusts of the scene,
        whose ramp, air density, drag and ice it has; along ``member``, that of each member.
    outputs
        Some of "displacement", "guy_tension", "guy_force", "bending_moment", "shear_force", "axial_compression", "foot_force",
        "anchor_force", "extremes", "envelopes"; with condensed guys also "guy_position" (at 21 points of each guy), "energy"
        (without wind) and "error_estimate" (one more run with richer guys, on sines, and
        at most half the step; nan where that stops; without what order "leading" neglects, up to 1 %).
    progress
        Callback receiving the completed fraction, 1 at the end.

    Returns
    -------
    xarray.Dataset
        ``displacement (time, level, coordinate)`` [m], ``guy_tension (time, guy)`` [N] at the mast, ``guy_force (time, guy,
        coordinate)`` [N] on the mast, ``guy_position (time, guy, point, coordinate)`` [m] from anchor to mast,
        ``bending_moment (time, node, coordinate)`` [N m], ``shear_force (time, element, end, coordinate)`` [N] horizontal, of the
        mast above on the mast below, ``axial_compression (time, element)`` [N] at its lower end, ``foot_force (time,
        coordinate)`` [N] on the foundation, ``anchor_force (time, guy, coordinate)`` [N] on the anchors; with "extremes" least
        and largest values, their times, means and standard deviations over all steps (of bending moments, over the outputs); with
        "envelopes" over the outputs the largest magnitude of displacement (along an axis over all steps), moment, shear (of
        both ends of an element) and reactions, least and largest axial force and reactions, and ``guy_axial_force_minimum
        (guy)``, which is not above 0 where a guy is slack before it breaks.  Of a guy that breaks, tension and force are 0
        afterwards.  Attributes: kind of guys, step [s], number of steps, least chordwise force of the guys [N] (chains: least
        tension).

    Raises
    ------
    SceneError
        For invalid options, a step above the stability limit, static guys that break, segments or attachments with other guys
        than chains, modes of a cable within 12 degrees of the vertical, and as :func:`rest`.
    RunStopped
        If the motion leaves the finite numbers or stiffens beyond the stability limit of a given step, or of the shortest one;
        ``partial`` is the result until then.

    Warns
    -----
    OutOfRangeWarning
        If a condensed or a static guy goes slack, for a motion beyond the table of static guys, for static guys whose tension in
        still air differs by more than 5 % from that at rest in the mean wind, and for slopes of the mast above a tenth,
        for which it is no beam of small slopes.
    NotConvergedWarning
        If the tolerance is not met.
    UnusualSceneWarning
        For guys that do not break before the end of the run, and of the worst that :func:`summary` notes of units.

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
    check_progress(progress)
    with one_blas_thread():  # the matrices are small
        case = MastCase(
            scene, modes, guys=guys, rank=rank, links=links, times=times, step=step, tolerance=tolerance, window=window,
            wind=wind, outputs=outputs,
        )  # fmt: skip
        result = case.result(*case.run())
    if progress is not None:
        progress(1.0)
    return result
