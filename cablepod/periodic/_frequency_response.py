"""Public function: branches of periodic responses over the frequency of the forcing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from cablepod._inputs import NORMAL_MODES, SCENE, check_units, taken
from cablepod.conventions import INTERRUPTED
from cablepod.errors import RunStopped, scene_error
from cablepod.parameters._checks import integer, number
from cablepod.periodic import _estimate as estimate
from cablepod.periodic import _output as output
from cablepod.periodic._continuation import POINTS, Branch, Limits, adapted_at, distance, trace
from cablepod.periodic._events import DOUBLING, Event, entering, first_point, leaving
from cablepod.periodic._frequency_output import labelled
from cablepod.periodic._general import solver_of
from cablepod.periodic._members import given_names, model_of, one_member, rising
from cablepod.periodic._solve import MAX_HARMONICS, MIN_HARMONICS, Solver, State
from cablepod.periodic._start import grown_from_rest

#: Outputs of a frequency response.
OUTPUTS = ("multipliers", "tension_extremes", "harmonics", "error_estimate")
#: Units and name of the estimate.
ERROR_LABEL = {"units": "1", "long_name": "estimated relative error of the angular frequency of the bifurcation"}
#: Branches that are followed from where they leave.
FOLLOW = ("whirling", "period_doubling")
#: Largest number of periods of the forcing in one of the motion, and of bifurcations between a main branch and another.
MAX_PERIODS, MAX_DEPTH = 4, 3
#: Relative distance in frequency within which a branch that comes back meets a known bifurcation.
MEETING_RTOL = 5e-3
#: Size of the difference of two states over that of either, below which they are one.
SAME_RTOL = 1e-4
#: Work of a study, in unknowns cubed of all linear systems, after which no more points are traced: some seconds.
MAX_WORK = 5e10


def frequency_response(
    scene: xr.Dataset,
    modes: xr.Dataset,
    *,
    frequency: tuple[float, float],
    rank: int | None = None,
    order: str = "leading",
    harmonics: int | None = None,
    follow: tuple[str, ...] = FOLLOW,
    points: int = 5000,
    out_of_plane: bool = True,
    outputs: tuple[str, ...] = ("multipliers", "tension_extremes"),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Follow periodic responses over the frequency of the forcing, through folds, with their stability and bifurcations.

    Parameters
    ----------
    scene, modes
        As in :func:`orbit`.
    frequency
        Lowest and highest angular frequency of the forcing [rad/s], in place of the scene's.
    rank
        Number of modes of each deflection; all by default.
    order
        "leading" or "exact", see :func:`cablepod.condensed.simulate`; "exact" takes some ten times as long.
    harmonics
        Least number of harmonics of a period of the forcing; more are taken where the last two hold more than 1e-6 of the motion.
    follow
        Branches that are followed: "whirling", which leave at pitchforks out of the plane, and "period_doubling".
    points
        Largest number of points of all branches; fewer where they need so many harmonics that the study would take long.
    out_of_plane
        Whether disturbances out of the plane are judged in a planar scene.
    outputs
        Some of "multipliers", "tension_extremes", "harmonics" and "error_estimate", some tenths of a second for each bifurcation.
    progress
        Callback receiving the completed fraction, which never falls and ends at 1.

    Returns
    -------
    xarray.Dataset
        Along ``point``, one branch after the other: ``angular_frequency`` [rad/s], ``branch``, ``amplitude (point, mode)`` [m],
        half of the range over a period, ``deflection_maximum`` [m], from its mean over a period, ``stable``, ``periods``,
        ``harmonic_count``, ``harmonic_tail``, the share of the last two harmonics in the motion,
        ``smallest_chordwise_force`` [N], and what `outputs` names: ``multiplier_real``, ``multiplier_imag (point, multiplier)``,
        ``tension_minimum``, ``tension_maximum (point, link)`` [N], ``harmonic_cosine``, ``harmonic_sine`` [m].  Along
        ``bifurcation``: ``bifurcation_kind`` ("fold", "pitchfork", "period_doubling", "torus"), ``bifurcation_set`` ("in_plane",
        "out_of_plane", on whirling branches "coupled"), ``bifurcation_angular_frequency``, ``bifurcation_branch``, ``leads_to``,
        and ``bifurcation_error_estimate``, the relative distance of the frequency from that of a richer model as in
        :func:`orbit`, nan where that has no such bifurcation nearby.  Attributes ``branch_1_ended`` and so on: "range", "loop"
        (back at its start or at another bifurcation), "points", "slack", "diverged".

    Raises
    ------
    SceneError
        For a scene, modes or options that it does not support; the key is named.
    RunStopped
        If no response is found at the ends of the range, and on Ctrl-C; `partial` has what was traced.

    Warns
    -----
    OutOfRangeWarning
        As :func:`orbit`.

    Notes
    -----
    Pseudo-arclength continuation; bifurcations are zeros of the products of 1 - mu and 1 + mu over the multipliers mu of one set
    of coordinates, found on the secant by Brent's method.  Branches that leave start along the null vector.
    """
    scene, modes = taken("scene", scene, SCENE), taken("modes", modes, NORMAL_MODES)
    wanted = given_names("outputs", outputs, OUTPUTS)
    low, high = frequency_range(frequency)
    integer(least=2)("points", points)
    if harmonics is not None:
        harmonics = integer(least=2, most=MAX_HARMONICS)("harmonics", harmonics)
    names = given_names("follow", follow, FOLLOW)
    one_member(scene, "frequency_response")
    model, _ = model_of(scene, modes, rank=rank, order=order, out_of_plane=out_of_plane)
    if "error_estimate" in wanted:
        estimate.refuse_things(model)
    study = _Study(solver_of(model), (low, high), names, int(points), harmonics or MIN_HARMONICS, progress)
    study.run()
    result = labelled(study.solver.model, study.branches, study.events, wanted)
    if "error_estimate" in wanted and not study.interrupted:
        try:
            rich, gained = estimate.richer_solver(scene, modes, rank, out_of_plane)
            errors = estimate.bifurcation_errors(study.solver, study.events, rich)
            result["bifurcation_error_estimate"] = (("bifurcation",), errors, ERROR_LABEL)
            result.attrs["error_estimate_by"] = gained
        except KeyboardInterrupt:
            study.interrupted = True
    parameters = {
        "frequency": [low, high], "rank": rank, "order": order, "harmonics": harmonics, "follow": list(names),
        "points": int(points), "out_of_plane": bool(out_of_plane), "outputs": list(wanted),
    }  # fmt: skip
    kept = f"{result.sizes['point']} points" if study.interrupted else ""
    result = output.record(result, "periodic.frequency_response", scene, modes, parameters, kept=kept)
    output.warn_of_result(result.attrs, model.undamped)
    return result


def frequency_range(given: Any) -> tuple[float, float]:
    """Check the ends of a range of angular frequencies [rad/s].

    Raises
    ------
    SceneError
        If they are no positive finite numbers, not in order, or have other units.
    """
    key = "frequency"
    check_units(key, given, "rad s-1")
    try:
        first, second = given
    except (TypeError, ValueError):
        raise scene_error(key, given, "two angular frequencies [rad/s], the lower one first") from None
    low, high = number(above=0.0)(f"{key}[0]", first), number(above=0.0)(f"{key}[1]", second)
    if not low < high:
        raise scene_error(key, (low, high), "two different angular frequencies [rad/s], the lower one first")
    return low, high


class _Study:
    """Branches and bifurcations found so far."""

    def __init__(
        self,
        solver: Solver,
        frequency: tuple[float, float],
        follow: tuple[str, ...],
        points: int,
        harmonics: int,
        progress: Callable[[float], None] | None,
    ) -> None:
        self.solver, self.follow, self.points, self.harmonics = solver, follow, points, harmonics
        scale = solver.model.scales[0]
        self.low, self.high = frequency[0] / scale, frequency[1] / scale
        self.progress = rising(progress)
        self.branches: list[Branch] = []
        self.events: list[Event] = []
        self.depth: dict[int, int] = {}
        self.interrupted = False

    def run(self) -> None:
        """Trace the main branches, then those that leave.

        Raises
        ------
        RunStopped
            If no response is found at either end of the range.
        """
        try:
            self._main()
            self._others()
        except KeyboardInterrupt:
            if not self._count():
                raise  # nothing to keep
            self.interrupted = True
            for branch in self.branches:
                branch.ended = branch.ended or INTERRUPTED
        self.branches = [branch for branch in self.branches if branch.points]
        if not self.interrupted:
            self.progress(1.0)

    def _main(self) -> None:
        """Trace what grows from rest at the lowest frequency, and at the highest where the first branch does not end in it."""
        found = False
        for omega, sign in ((self.low, 1.0), (self.high, -1.0)):
            if found and self._is_over():
                break
            state, direction, iterations = adapted_at(self.solver, grown_from_rest(self.solver, omega, self.harmonics))
            same = SAME_RTOL * float(np.linalg.norm(state.z))
            ends = (branch.points[-1].state for branch in self.branches if branch.points)
            if iterations < 0 or any(float(np.linalg.norm(distance(end, state))) < same for end in ends):
                continue
            if sign * direction[-1] < 0.0:
                direction = -direction
            found = True
            self._trace(Branch(len(self.branches) + 1), state, direction)
        if not any(branch.points for branch in self.branches):
            model = self.solver.model
            why = f" (the first branch ended at once: {self.branches[0].ended})" if found else ""
            raise RunStopped(
                f"no periodic response grows from rest at {self.low * model.scales[0]:.6g} nor at "
                f"{self.high * model.scales[0]:.6g} rad/s{why}; try another range, or smaller amplitudes{model.remedy}"
            )

    def _others(self) -> None:
        """Trace the branches that leave at bifurcations, in the order in which these were found."""
        for event in self.events:  # grows in the loop
            wanted = "period_doubling" if event.kind == DOUBLING else "whirling"
            if event.leads_to or wanted not in self.follow or self._is_over():
                continue
            depth = self.depth.get(event.branch, 0) + 1
            if depth > MAX_DEPTH or (event.kind == DOUBLING and 2 * event.state.periods > MAX_PERIODS):
                continue
            start = leaving(self.solver, event)
            found = None if start is None else first_point(self.solver, start[0], start[1])
            if start is None or found is None:
                continue
            state, direction = found
            if direction @ start[1] < 0.0:
                direction = -direction
            branch = Branch(len(self.branches) + 1, asymmetric=start[2])
            event.leads_to = branch.number
            self.depth[branch.number] = depth
            self._trace(branch, state, direction)
            self._join(branch, event)

    def _join(self, branch: Branch, origin: Event) -> None:
        """Where a branch comes back to another bifurcation, let that lead to it."""
        if branch.ended != "loop":
            return
        omega = branch.points[-1].state.omega
        near = [
            event
            for event in self.events
            if event is not origin and event.branch == origin.branch and event.kind == origin.kind
            and event.which == origin.which and not event.leads_to and abs(event.state.omega / omega - 1.0) < MEETING_RTOL
        ]  # fmt: skip
        if near:
            min(near, key=lambda event: abs(event.state.omega - omega)).leads_to = branch.number

    def _count(self) -> int:
        return sum(len(branch.points) for branch in self.branches)

    def _is_over(self) -> bool:
        """Return whether no more points are traced."""
        return self._count() >= self.points or self.solver.work > MAX_WORK

    def _trace(self, branch: Branch, state: State, direction: np.ndarray) -> None:
        """Trace one branch, with its bifurcations."""
        self.branches.append(branch)
        before = self._count()
        enter = entering(self.solver, self.events)

        def on_point(branch: Branch, is_least: bool) -> bool:
            if len(self.branches) == 1:  # the share of the range that the main branch has passed
                share = (branch.points[-1].state.omega - self.low) / (self.high - self.low)
                self.progress(0.9 * min(max(share, 0.0), 1.0))
            return enter(branch, is_least)

        limits = Limits(
            self.low, self.high, self.points - before, lambda point: POINTS if self.solver.work > MAX_WORK else ""
        )
        if limits.points < 2:
            branch.ended = POINTS
        trace(self.solver, branch, state, direction, limits, on_point)
