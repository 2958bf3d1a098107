"""A run of a mast: checks of its options, models of its guys, steps that meet a tolerance, its result."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import NORMAL_MODES, check_times, taken
from cablepod._resources import check_memory
from cablepod.batch._members import inside_members
from cablepod.errors import (
    NotConvergedWarning,
    OutOfRangeWarning,
    RunStopped,
    SceneError,
    UnusualSceneWarning,
    scene_error,
    warn,
)
from cablepod.integrate._request import check_outputs, check_window
from cablepod.integrate._window import window_attributes
from cablepod.mast import _output as output
from cablepod.mast._beam import slopes_of, warn_of_slopes
from cablepod.mast._catenary_run import CatenaryGuys
from cablepod.mast._chain_run import ChainGuys, links_of
from cablepod.mast._condensed_guy import shapes_of
from cablepod.mast._condensed_run import CondensedGuys, CondensedRun, guys_in_mean_wind
from cablepod.mast._kernels_layout import UNSTABLE
from cablepod.mast._model import ModalMast, modal_mast
from cablepod.mast._piecewise_guys import KINDS, first_thing, kind_of_guys, refuse_ratios, refuse_things
from cablepod.mast._request import MastRequest, MastTrajectory, request_of
from cablepod.mast._sections import NEED_FORCES
from cablepod.mast._statics import check_shapes, rest_in
from cablepod.parameters._checks import choice, integer, number
from cablepod.parameters._mast import MastParameters, calm_parameters, mast_parameters
from cablepod.parameters._parameters import has_record
from cablepod.parameters._time_functions import check_reach
from cablepod.pod._normal import sets
from cablepod.scene._mast_notes import warn_of_unusual_mast
from cablepod.scene._warnings import without_warnings
from cablepod.wind._mast_air import mast_air

#: Default and largest number of modes of each deflection of a guy, and number of those beyond them in the error estimate.
RANK, MAX_RANK, RICHER = 4, 60, 4
#: Maximum number of halved steps to meet a tolerance, and where guys stiffen: at 16^2 times its tension at rest a guy has broken.
MAX_HALVINGS, STIFF_HALVINGS = 6, 4
#: Standard deviation of a tension over its mean up to which it is the rounding of a guy at rest.
STILL = 1e-9


class MastCase:
    """A scene with checked options, its model and its request; options as of :func:`cablepod.mast.simulate`."""

    def __init__(
        self, scene: xr.Dataset, modes: xr.Dataset | None, *, guys: str | None, rank: int | None, links: int | None, times: Any,
        step: float | None, tolerance: float | None, window: tuple[float, float] | None, wind: xr.Dataset | None,
        outputs: tuple[str, ...],
    ) -> None:  # fmt: skip
        self.wanted = check_outputs(outputs, output.OUTPUTS)
        if guys is not None:
            choice(*KINDS)("guys", guys)
        if modes is not None:
            modes = taken("modes", modes, NORMAL_MODES)
        self.p = p = mast_parameters(scene)
        if guys is None:
            guys = kind_of_guys(p)
        _check_numbers(rank, links, step, tolerance)
        window = None if window is None else check_window(window)
        in_wind = p.wind is not None or wind is not None
        _check_kind(p, guys, self.wanted, in_wind=in_wind, rank=rank, modes=modes, links=links)
        self.instants = instants = p.times() if times is None else check_times(times)
        check_reach(p.time_functions(), float(instants[-1]))
        warn_of_late_breaks(p, float(instants[-1]))
        check_memory(instants.size, max(len(p.guys), 1), 3, key="time.interval" if times is None else "times")
        self.scene, self.modes, self.guys, self.tolerance, self.window = scene, modes, guys, tolerance, window
        self.wind, self.links, self.step, self.count = wind, links, step, _rank_of(modes, rank)
        self.chosen = provenance.defaulted_options(rank=rank, links=links, times=times, step=step, tolerance=tolerance)
        self.air = air = mast_air(p, float(instants[-1]), wind)
        self.mast = modal_mast(rest_in(calm_parameters(scene), air))
        check_shapes(self.mast.rest)
        warn_of_unusual_mast(p, self.mast.rest.tension)
        self.model = self._model()
        self.request = request_of(
            instants, self.model.default_step, step, window, energy="energy" in self.wanted,
            keeps_guys="guy_position" in self.wanted, keeps_drag=bool(NEED_FORCES & set(self.wanted)),
        )  # fmt: skip

    def _model(self) -> Any:
        """Return the model of the guys."""
        if self.guys == "chain":
            return ChainGuys(self.mast, self.links or links_of(self.p), self.air)
        if self.guys == "catenary":
            return CatenaryGuys(self.mast, self.air)
        return self._condensed(self.modes, self.count)

    def _condensed(self, modes: xr.Dataset | None, rank: int) -> CondensedRun:
        """Return condensed guys with a number of modes, sines by default."""
        if modes is None and self.wind is None and not has_record(self.p):  # in the mean wind of the scene
            return CondensedRun(guys_in_mean_wind(self.mast, rank), self.air)
        return CondensedRun(CondensedGuys(self.mast, shapes_of(modes, rank), self.air), self.air)

    @property
    def size(self) -> dict[str, int]:
        """Number of modes of condensed guys, or of links of chains, by the name of the option."""
        if isinstance(self.model, ChainGuys):
            return {"links": self.model.links}
        return {"rank": self.count} if self.guys == "condensed" else {}

    def run(self) -> tuple[MastTrajectory, dict[str, Any]]:
        """Run, with an estimate of the error where it is asked; return the trajectory and what is known of its errors."""
        start = _run_stably(self.model, self.request) if self.step is None else self.model.run(self.request)
        run, notes = _converged(self.model, start, self.tolerance)
        if "error_estimate" in self.wanted and not run.status:
            richer, request = self._condensed(None, self.count + RICHER), run.request
            step = 0.5 * min(request.step, richer.default_step)  # with the same step both would have its error
            finer = _run_stably(richer, request_of(request.times, step, None, self.window))
            notes["error_estimate"] = np.nan if finer.status else float(difference(run, finer).max(initial=0.0))
        return run, notes

    def result(self, run: MastTrajectory, notes: dict[str, Any]) -> xr.Dataset:
        """Return the result of a run; warn of what is out of range.

        Raises
        ------
        RunStopped
            If the run stopped before its end.
        """
        guys, window = self.guys, self.window
        result = output.trajectory(self.mast, run, self.wanted, guys)
        _warn_of_slopes(self.mast, run)
        result.attrs = {
            "title": f"{self.scene.attrs.get('title', 'scene')}: mast with guys of kind {guys}", "stage": "mast", "guys": guys,
            "scheme": "velocity_verlet", "step": run.request.step, "number_of_steps": run.request.steps, **self.size,
            **window_attributes(window), **notes, **_least_force(self.p, run, guys),
        }  # fmt: skip
        if run.status:
            result.attrs["incomplete"] = f"stopped at {run.stopped_at:.9g} s"
        result = provenance.record(
            result,
            function="mast.simulate",
            parameters={
                "guys": guys, "rank": None, "links": None, **self.size, "times": self.instants,
                "step": run.request.step if self.step is None else self.step, "tolerance": self.tolerance,
                "window": None if window is None else list(window),
                "outputs": list(self.wanted),
            },
            inputs=[self.scene, *(given for given in (self.modes, self.wind) if given is not None)],
            chosen=self.chosen,
        )  # fmt: skip
        if run.status:
            where = self.p.guys[run.guy].key if self.p.guys else "mast"
            reason = (
                "left the finite numbers"
                if run.status != UNSTABLE
                else f"stiffened beyond the stability limit of the step {run.request.step:.4g} s ({where})"
            )
            raise RunStopped(
                f"the mast {reason} at {run.stopped_at:.6g} s; partial holds the result until then; try a shorter step"
                + (', or guys="chain"' if guys == "condensed" else ""),
                result,
            )
        return result


def check_run(scene: xr.Dataset, *, outputs: tuple[str, ...], **options: Any) -> None:
    """Refuse what :func:`cablepod.mast.simulate` refuses of a scene and options, without a run and without warnings.

    Raises
    ------
    SceneError
        As that function.
    """
    given = dict.fromkeys(("guys", "rank", "links", "times", "step", "tolerance", "window", "wind")) | options
    with warnings.catch_warnings(), without_warnings():  # the run gives them
        warnings.simplefilter("ignore")
        MastCase(scene, None, outputs=outputs, **given)


def warn_of_late_breaks(p: MastParameters, end_time: float) -> None:
    """Warn of guys that do not break before the end of a run [s]; not within members, and not of a start alone."""
    texts = p.late_breaks(end_time) if end_time and not inside_members() else []
    if texts:
        warn(f"{'; '.join(texts)}; try a longer run", UnusualSceneWarning)


def _check_kind(p: MastParameters, guys: str, wanted: tuple[str, ...], *, in_wind: bool, **options: Any) -> None:
    """Refuse options and outputs that the kind of guys lacks."""
    thing = first_thing(p)
    if guys != "chain":
        refuse_things(p, guys)
    for key, kind in (("rank", "condensed"), ("modes", "condensed"), ("links", "chain")):
        if options[key] is not None and guys != kind:
            remedy = f'; try: guys="{kind}"' if thing is None else f", as a guy has {thing}"
            raise SceneError(f'{key}: given with guys "{guys}"; allowed: none{remedy}')
    for name in ("energy", "error_estimate", "guy_position"):
        if name in wanted and guys != "condensed":
            remedy = '; try: guys="condensed"' if thing is None else f", as a guy has {thing}"
            raise scene_error("outputs", name, f'none with guys "{guys}"{remedy}')
    if "energy" in wanted and in_wind:
        raise scene_error("outputs", "energy", "none with wind, which supplies energy")
    for guy in p.guys:
        if guy.breaks is not None and guys == "catenary":
            raise scene_error(f"{guy.key}.breaks", guy.breaks, 'none with guys "catenary"; try: guys="condensed"')
    refuse_ratios(p, guys)


def _rank_of(modes: xr.Dataset | None, rank: Any) -> int:
    """Return the number of modes of each deflection; refuse one that given modes, those that move, do not have."""
    most = MAX_RANK if modes is None else max(len(shapes) for _, shapes in sets(modes))
    if rank is not None and rank > most:
        raise scene_error("rank", rank, f"at most {most}, the number of modes")
    if not most:
        raise SceneError("modes: given none that moves; allowed: a singular value above 0")
    return min(RANK, most) if rank is None else int(rank)


def _check_numbers(rank: Any, links: Any, step: Any, tolerance: Any) -> None:
    """Refuse numbers that are invalid or do not go together."""
    for key, value, check in (
        ("rank", rank, integer(least=1, most=MAX_RANK)),
        ("links", links, integer(least=2, most=10**4)),
        ("step", step, number(above=0.0)),
        ("tolerance", tolerance, number(above=0.0, most=1.0)),
    ):
        if value is not None:
            check(key, value)
    if tolerance is not None and step is not None:
        raise scene_error("tolerance", tolerance, "none beside step")


def _run_stably(model: Any, request: MastRequest) -> MastTrajectory:
    """Run; halve the step where the guys stiffen beyond its stability limit, as they do at many times their tension at rest."""
    run = model.run(request)
    for _ in range(STIFF_HALVINGS):
        if run.status != UNSTABLE:
            break
        request = replace(request, every=2 * request.every)
        run = model.run(request)
    return run


def _converged(model: Any, run: MastTrajectory, tolerance: float | None) -> tuple[MastTrajectory, dict[str, Any]]:
    """Halve the step of a run until a tolerance is met."""
    if tolerance is None or run.status:
        return run, {}
    error, request = np.inf, run.request
    for _ in range(MAX_HALVINGS):
        request = replace(request, every=2 * request.every)
        finer = model.run(request)
        if finer.status:
            break
        error, run = float(difference(run, finer).max(initial=0.0)), finer
        if error <= tolerance:
            break
    else:
        warn(
            f"tensions still differ by {error:.3g} of their standard deviation from those of half the step, more than the "
            f"tolerance {tolerance:g}; the finest run is returned; try a larger tolerance",
            NotConvergedWarning,
        )
    return run, {"time_error_estimate": error}


def difference(run: MastTrajectory, other: MastTrajectory) -> np.ndarray:
    """Return the rms difference of the guys' tensions over their standard deviation, or their mean where they rest (guys,)."""
    spread, mean = other.tension.std(axis=0), np.abs(other.tension).mean(axis=0)
    scale = np.where(spread > STILL * mean, spread, np.maximum(mean, 1e-300))
    return np.sqrt(((run.tension - other.tension) ** 2).mean(axis=0)) / scale


def _least_force(p: MastParameters, run: MastTrajectory, guys: str) -> dict[str, float]:
    """Return the least force of a guy and its time as attributes; warn of slack condensed guys."""
    if not p.guys or guys == "catenary":
        return {}
    worst = int(run.least.argmin())
    least, time = float(run.least[worst]), float(run.least_step[worst]) * run.request.step
    name = "smallest_chordwise_force" if guys == "condensed" else "smallest_tension"
    if guys == "condensed" and least < 0.0 and not run.status:
        warn(
            f"{p.guys[worst].key}: the chordwise force of guy {worst + 1} became negative, {least:.3g} N at {time:.6g} s: it "
            'goes slack, where the condensed model resists compression; compare with guys="chain"',
            OutOfRangeWarning,
        )
    return {name: least, f"time_of_{name}": time}


def _warn_of_slopes(mast: ModalMast, run: MastTrajectory) -> None:
    """Warn of slopes of the mast that are not small."""
    beam, n = mast.rest.beam, run.completed
    if run.status or not n:
        return
    at_rest = slopes_of(beam, beam.all_rows @ mast.rest.unknowns)
    slopes = at_rest + output.seen_from(slopes_of(beam, mast.node_rows), run.modal[:n])
    warn_of_slopes(beam, slopes, run.request.times)
