"""Condensed models of many members: coefficients rescaled from the first member, runs in compiled blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod._resources import ARRAYS_OF_RUN, check_memory
from cablepod.batch._computed import computed_variable
from cablepod.batch._members import Rows, RunChunk, of_member, run_members
from cablepod.batch._stack import Variables, to_dataset
from cablepod.catenary._statics import member_statics
from cablepod.condensed._batch_fitted import first_steps, fit
from cablepod.condensed._error_equation import VALUES_AT_A_TIME
from cablepod.condensed._fields import close_leading, deflections, joined, running_sum
from cablepod.condensed._lanes import LANES, LaneResults, Lanes, MemberCoefficients
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._output import attributes_of, labels_of, places_of, shared_attributes, title_of, variables
from cablepod.condensed._runs import SCHEMES, CondensedRequest, solve
from cablepod.condensed._stepper import FOURTH_ORDER
from cablepod.errors import SceneError
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._window import steps_within, window_attributes
from cablepod.parameters._from_scene import Members
from cablepod.parameters._parameters import Parameters
from cablepod.pod import _normal as pod_normal
from cablepod.reduced._training_distance import distance_outside_training
from cablepod.reduced._validity import forcing_attributes, warn_condensed_members

#: Groups of lanes to take at once where members have steps of their own: those with equal steps advance together.
STEP_GROUPS = 2


def run(
    scene: xr.Dataset,
    modes: xr.Dataset,
    unit: CondensedModel,
    members: Members,
    request: CondensedRequest,
    make: Callable[[Parameters], CondensedModel],
    progress: Callable[[float], None] | None,
) -> xr.Dataset:
    """Run all members of a scene, in compiled blocks where possible.

    Parameters
    ----------
    scene, modes
        Scene with ``member``, and modes.
    unit
        Unit model of the first member.
    members
        Parameters of the members.
    request
        Checked options of each run.
    make
        Makes the model of a member.
    progress
        Called with the completed fraction.
    """

    def run_member(i: int) -> tuple[Variables, Mapping[str, Any]]:
        solution = solve(make(members[i]), replace(request, wind=of_member(request.wind, i)))
        model = solution.run.model  # with the loads of the wind
        result = variables(model, solution.state, request.outputs, request.links)
        result |= places_of(model, result, request.links)
        result.pop("link_number", None)  # which is the same of all members
        if in_blocks is not None:
            del result["end_position"]
        return result, attributes_of(solution, modes, request)

    in_blocks = plan(modes, unit, members, request)
    lanes = LANES if request.step is not None else LANES * STEP_GROUPS
    stack = run_members(run_member, len(members), progress, in_blocks, lanes=1 if in_blocks is None else lanes)
    title = title_of(unit, str(scene.attrs.get("title", "scene")))
    times = members[0].times() if request.times is None else request.times
    if in_blocks is not None:
        failed = np.array([error is not None for error in stack.failures])
        shape = len(members), times.size, 2, unit.chain.p.dims
        ends = computed_variable(("member", "time", "end", "coordinate"), shape, EndPositions(members, times, failed))
        stack.variables = {"end_position": ends, **stack.variables}
    numbers = places_of(unit, stack.variables, request.links).get("link_number")
    coords = labels_of(unit, times) | ({} if numbers is None else {"link_number": numbers})
    places = [name for name in ("arc_length", "particle_mass", "link_arc_length") if name in stack.variables]
    result = to_dataset(stack, scene, coords).set_coords(places)
    result.attrs = {"title": title, **result.attrs}
    warn_condensed_members(stack.attrs)
    return result


@dataclass(frozen=True)
class EndPositions:
    """Positions of both ends of members that can be stacked."""

    members: Members
    times: np.ndarray  #: instants [s]
    failed: np.ndarray  #: whether a member failed, and so holds nan (members,)

    def __call__(self, first: int, last: int) -> np.ndarray:
        """Return the positions of the members `first` ... `last - 1` (members, time, end, dims) [m]."""
        ends = self.members.stacked(first, last).end_positions(self.times)
        ends[self.failed[first:last]] = np.nan
        return ends


#: Outputs of compiled batches; the error is estimated of members with steps of their own.
BATCHED_OUTPUTS = {"position", "tension", "tension_extremes"}


def plan(modes: xr.Dataset, unit: CondensedModel, members: Members, request: CondensedRequest) -> RunChunk | None:
    """Return how to run many members in compiled blocks; None where these do not support the request."""
    step, outputs = request.step, set(request.outputs)
    if request.wind is not None or unit.order != "leading" or request.given_tolerance is not None:
        return None
    # the duration decides on the reference state
    if "time_duration" in members.varied or (request.times is None and "time_interval" in members.varied):
        return None
    if not members.can_be_stacked:
        return None
    if request.window is not None:
        request.instants(members[0])  # refuses a window outside of the run
    times = members[0].times() if request.times is None else request.times
    batch = CondensedPlan(
        modes, unit, members, outputs, request.links, members[0].duration or 0.0, request.window, times, step,
        request.scheme is None,
    )  # fmt: skip
    of_error = {"error_estimate"} if step is None else set()
    if request.scheme not in (None, batch.scheme) or outputs - BATCHED_OUTPUTS - of_error:
        return None
    if step is None and not times[-1] > 0.0:
        return None
    check_memory(times.size, unit.chain.links, unit.chain.p.dims, key="times", variables=ARRAYS_OF_RUN)
    if step is not None:
        instants = OutputTimes.of(times, 1.0 / step)
        if instants.needs_interpolation or instants.steps.size != times.size:
            return None
        if request.window is not None:
            steps_within(request.window, instants.steps_per_second)  # refuses one of less than two steps
    return batch


@dataclass(frozen=True)
class CondensedPlan:
    """Common data of all members; a call runs some of them."""

    modes: xr.Dataset
    unit: CondensedModel  #: unit model of all members
    members: Members
    outputs: set[str]
    links: np.ndarray | None  #: indices, from 0, of the links whose tensions are computed; None for all
    end_time: float  #: duration of the scenes, over which the reference state is taken [s]
    window: tuple[float, float] | None  #: part of the run over which extremes are taken [s]; None for all
    times: np.ndarray  #: instants of the output [s]
    step: float | None  #: given step [s]; None where each member has one that fits its model
    chooses_scheme: bool  #: whether the scheme is the default, which suits most members

    @property
    def scheme(self) -> str:
        """Scheme of all members."""
        return FOURTH_ORDER if self.step is None else SCHEMES[0]

    def __call__(self, first: int, last: int, rows: Rows) -> tuple[np.ndarray, Variables, dict[str, list[Any]]]:
        """Run the members `first` ... `last - 1`; return a mask of those completed, variables and attributes."""
        # invalid members become nan here: their single runs report the reason
        with np.errstate(all="ignore"):
            return Chunk(self, self.members.stacked(first, last)).run(rows)


class Chunk:
    """Members of one chunk: their coefficients, and results."""

    def __init__(self, plan: CondensedPlan, parameters: Parameters) -> None:
        self.plan = plan
        statics, self.solved = member_statics(parameters)
        self.members = MemberCoefficients.of(plan, parameters, statics)
        self.solved &= pod_normal.refer_to_axis_of(plan.modes, parameters.ends[:, 1] - parameters.ends[:, 0])

    def run(self, rows: Rows) -> tuple[np.ndarray, Variables, dict[str, list[Any]]]:
        """Run the members; return a mask of those completed, variables, the large ones in `rows`, and attributes."""
        plan, members, result = self.plan, self.members, Variables()
        q, v, limit, chord_tension = members.starts(plan.step or 0.0)  # without a step: the rates at the start
        if plan.step is None:
            rates, intervals = first_steps(plan, members, limit, chord_tension)
        else:
            rates, intervals = np.where(plan.step < limit, 1.0 / plan.step, 0.0), np.ones(limit.size)
        targets, completed = self.targets(rows, result), np.zeros(limit.size, dtype=bool)
        attributes: dict[str, list[Any]] = {}
        for part, rate, interval in _groups(np.where(self.solved, rates, 0.0), intervals):
            some, start = members.take(part), (q[part], v[part])
            lanes = Lanes(plan, some)
            if plan.step is None:
                done, of_error = fit(lanes, some, rate, interval, *start)
            else:
                done, of_error = lanes.advance(OutputTimes.of(plan.times, rate), *start, extremes=True), {}
            completed[part] = done.completed & self.fill(some, part, done, targets)
            for name, column in (self.attributes_of_run(done) | of_error).items():
                target = attributes.setdefault(name, [None] * limit.size)
                for m, value in zip(part.tolist(), column, strict=True):
                    target[m] = value
        result["unstretched_length"] = (), members.total
        places = places_of(plan.unit, result, plan.links)
        places.pop("link_number", None)  # which is the same of all members
        result |= {name: (dims, members.total[:, None] * of_unit) for name, (dims, of_unit) in places.items()}
        return completed, result, attributes | self.diagnostics(limit)

    def diagnostics(self, limit: np.ndarray) -> dict[str, list[Any]]:
        """Return the attributes of the members that do not depend on their runs, for step limits [s] (members,)."""
        p, total = self.members.parameters, self.members.total
        varied = {**forcing_attributes(p, total), **p.offsets(), "step_limit": limit}
        return {name: values.tolist() for name, values in varied.items()} | distance_outside_training(
            self.plan.modes, p, total, float(self.plan.times[-1]), self.members.rest_tension
        )

    def attributes_of_run(self, done: LaneResults) -> dict[str, list[Any]]:
        """Return the attributes of members with equal steps that depend on their run, a list for each name."""
        plan, instants = self.plan, done.instants
        shared = shared_attributes(plan.unit, instants, plan.scheme, plan.modes) | window_attributes(plan.window)
        return {name: [value] * done.least_force.size for name, value in shared.items()} | {
            "smallest_chordwise_force": done.least_force.tolist(),
            "time_of_smallest_force": (done.least_force_step / instants.steps_per_second).tolist(),
        }

    def targets(self, rows: Rows, result: Variables) -> dict[str, np.ndarray]:
        """Add the variables with many numbers to the result, and return their arrays."""
        plan, unit, outputs, times = self.plan, self.plan.unit, self.plan.outputs, self.plan.times.size
        links = unit.chain.links if plan.links is None else plan.links.size
        shapes: dict[str, tuple[tuple[str, ...], tuple[int, ...]]] = {
            f"amplitude{suffix}": (("time", "mode"), (times, unit.rank))
            for suffix, _ in zip(pod_normal.SETS, unit.sets, strict=False)
        }
        if "tension" in outputs:
            shapes["tension"] = ("time", "link"), (times, links)
        if "position" in outputs:
            shapes["position"] = ("time", "particle", "coordinate"), (times, unit.chain.links + 1, unit.chain.p.dims)
        if "tension_extremes" in outputs:
            shapes |= {f"tension_{which}": (("link",), (links,)) for which in ("minimum", "maximum")}
        for name, (dims, shape) in shapes.items():
            result[name] = dims, rows(name, dims, shape)
        if unit.chain.p.dims == 3:
            result["normal_reference"] = ("coordinate",), self.members.reference
        return {name: result[name][1] for name in shapes}

    def fill(
        self, members: MemberCoefficients, part: np.ndarray, done: LaneResults, targets: dict[str, np.ndarray]
    ) -> np.ndarray:
        """Fill the rows `part` of members with their results; return whether they always have chord frames (members,)."""
        unit, named, q, has_frames = self.plan.unit, members.scaled.named, done.q, np.ones(part.size, dtype=bool)
        for name, which, bases in zip(pod_normal.SETS, unit.sets, members.scaled.bases, strict=False):
            turned = q[:, :, which] @ np.swapaxes(bases, 1, 2)
            targets[f"amplitude{name}"][part, :, : turned.shape[2]] = turned
            targets[f"amplitude{name}"][part, :, turned.shape[2] :] = 0.0
        for name, values in (("tension_minimum", done.low), ("tension_maximum", done.high)):
            if name in targets:
                targets[name][part] = values
        if not {"tension", "position"} & targets.keys():
            return has_frames
        boundary_data = done.boundary_data
        if boundary_data is None:
            boundary_data = members.rows_at(done.instants.times, moving=True)
        if "tension" in targets:
            from cablepod.condensed import _kernels_recorder as kernel  # numba is imported only to compute

            chosen = slice(None) if self.plan.links is None else self.plan.links
            tables = (named[name][:, :, chosen] for name in ("slopes", "chordwise_force_patterns"))
            slopes, patterns = map(np.ascontiguousarray, tables)
            kernel.link_tensions(
                members.terms, boundary_data, q, slopes, unit.n_in_plane, patterns, np.empty(1), part, targets["tension"],
            )  # fmt: skip
        if "position" in targets:
            ends = members.parameters.end_positions(done.instants.times)
            count = max(1, VALUES_AT_A_TIME // (q.shape[1] * unit.chain.links))
            for first in range(0, part.size, count):
                some = slice(first, first + count)
                along, deflection = _fields(members, some, q[some], boundary_data[some])
                for k, m in enumerate(range(part.size)[some]):
                    try:
                        position = joined(ends[m], members.reference[m], along[k], deflection[:, k])
                    except SceneError:
                        has_frames[m] = False
                    else:
                        targets["position"][part[m]] = position
        return has_frames


def _fields(members: MemberCoefficients, some: slice, q: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distances along the chord (members, times, particle) and deflections [m] for coordinates and boundary data."""
    unit, named, states = members.unit, members.scaled.named, members.states
    length, patterns = members.total[some, None] * unit.chain.length, named["chordwise_force_patterns"][some]
    deflection, squared = deflections(named["shapes"][some], unit.sets, length, q)
    tau = rows[:, :, 1 : 1 + patterns.shape[1]] @ patterns
    factors = states.uniform[some, None] + states.sag[some, None] * unit.shear_under_uniform_load**2
    stiffness = members.parameters.stiffness[some, None]
    _, stretch = close_leading(squared * factors[:, None], tau, length, rows[:, :, 0], stiffness)
    return running_sum(stretch * length[:, None]), deflection


def _groups(rates: np.ndarray, intervals: np.ndarray) -> Iterator[tuple[np.ndarray, float, int]]:
    """Yield numbers of members with equal steps, LANES at most, their steps per second, and steps between samples.

    `rates` are steps per second of members, 0 for those that run alone.
    """
    keys = np.stack([rates, intervals], axis=1)
    for rate, interval in np.unique(keys[rates > 0.0], axis=0).tolist():
        equal = np.flatnonzero((keys == (rate, interval)).all(axis=1))
        for first in range(0, equal.size, LANES):
            yield equal[first : first + LANES], rate, int(interval)
