"""Condensed models of many members: coefficients rescaled from the first member, runs in compiled blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from cablepod._resources import ARRAYS_OF_RUN, check_memory
from cablepod.batch._computed import computed_variable
from cablepod.batch._members import Rows, RunChunk, run_members
from cablepod.batch._stack import Variables, to_dataset
from cablepod.catenary._statics import member_statics
from cablepod.condensed._error_equation import VALUES_AT_A_TIME
from cablepod.condensed._fields import close_leading, deflections, joined, running_sum
from cablepod.condensed._frame import chord_and_loads
from cablepod.condensed._kernels_layout import LeadingTerms
from cablepod.condensed._lanes import LANES, LaneResults, Lanes, MemberEnds
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._newton import equilibria
from cablepod.condensed._output import attributes_of, labels_of, places_of, shared_attributes, title_of, variables
from cablepod.condensed._rescale import MemberStates, rescale_coefficients
from cablepod.condensed._runs import SCHEMES, CondensedRequest, solve
from cablepod.discretisation._chord_frame import normals_at_start
from cablepod.discretisation._mass_damping import decay_and_impulse
from cablepod.discretisation._step_limit import largest_frequencies_squared, verlet_step_limit
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
        solution = solve(make(members[i]), request)
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
    places = [name for name in ("arc_length", "link_arc_length") if name in stack.variables]
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


#: Outputs of compiled batches.
BATCHED_OUTPUTS = {"position", "tension", "tension_extremes"}


def plan(modes: xr.Dataset, unit: CondensedModel, members: Members, request: CondensedRequest) -> RunChunk | None:
    """Return how to run many members in compiled blocks; None where these do not support the request."""
    step, outputs = request.step, set(request.outputs)
    if request.wind is not None or unit.order != "leading":
        return None
    # the duration decides on the reference state
    if "time_duration" in members.varied or (request.times is None and "time_interval" in members.varied):
        return None
    if not members.can_be_stacked:
        return None
    if request.window is not None:
        request.instants(members[0])  # refuses a window outside of the run
    if step is None:
        from cablepod.condensed._batch_fitted import plan_fitted  # whose batch is one of this file

        return plan_fitted(modes, unit, members, request)
    if request.scheme not in (None, SCHEMES[0]) or outputs - BATCHED_OUTPUTS:
        return None
    times = members[0].times() if request.times is None else request.times
    check_memory(times.size, unit.chain.links, unit.chain.p.dims, key="times", variables=ARRAYS_OF_RUN)
    instants = OutputTimes.of(times, 1.0 / step)
    if instants.needs_interpolation or instants.steps.size != times.size:
        return None
    if request.window is not None:
        steps_within(request.window, instants.steps_per_second)  # refuses one of less than two steps
    end_time = members[0].duration or 0.0
    return CondensedBatchPlan(modes, unit, members, outputs, request.links, end_time, request.window, instants)


@dataclass(frozen=True)
class MembersPlan:
    """Common data of all members."""

    modes: xr.Dataset
    unit: CondensedModel  #: unit model of all members
    members: Members
    outputs: set[str]
    links: np.ndarray | None  #: indices, from 0, of the links whose tensions are computed; None for all
    end_time: float  #: duration of the scenes, over which the reference state is taken [s]
    window: tuple[float, float] | None  #: part of the run over which extremes are taken [s]; None for all


@dataclass(frozen=True)
class CondensedBatchPlan(MembersPlan):
    """Common data of all members with a given step; a call runs some of them."""

    instants: OutputTimes

    def __call__(self, first: int, last: int, rows: Rows) -> tuple[np.ndarray, Variables, dict[str, list[Any]]]:
        """Run the members `first` ... `last - 1`; return a mask of those completed, variables and attributes."""
        # invalid members become nan here: their single runs report the reason
        with np.errstate(all="ignore"):
            return CondensedBatch(self, self.members.stacked(first, last)).run(rows)


class MemberCoefficients:
    """Rescaled coefficients of the members of one chunk, and their starts."""

    def __init__(self, plan: MembersPlan, parameters: Parameters) -> None:
        self.plan, self.parameters = plan, parameters
        statics, self.active = member_statics(parameters)
        self.total, self.rest_tension = statics[:, 0].copy(), 0.5 * (statics[:, 4] + statics[:, 5])
        self.states = MemberStates.of(plan.unit, parameters, self.total, plan.end_time)
        self.scaled = rescale_coefficients(plan.unit, parameters.mass, self.total, self.states)
        named = self.scaled.named
        stiffness, length, count = parameters.stiffness[:, None], self.total[:, None], self.total.size
        self.terms = LeadingTerms(  # of one lane each
            stiffness, 1.0 / length, 0.5 * stiffness / length, self.scaled.slope_norms_squared,
            named["mean_chordwise_forces"], named["geometric_stiffness"].reshape(count, -1),
            named["load_projection"].reshape(count, -1),
        )  # fmt: skip
        self.ends = MemberEnds(parameters.ends, parameters.motions)
        self.load = np.ascontiguousarray(parameters.load_at(0.0)[:, :, None])
        self.reference = normals_at_start(parameters.ends[:, 1] - parameters.ends[:, 0])

    def starts(self, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return coordinates, rates half a `step` before the start (members, r), step limits [s] and H [N] (members,)."""
        from cablepod.condensed import _kernels_closure as kernel  # numba is imported only to compute

        parameters, model, start = self.parameters, self.plan.unit, np.zeros(1)
        chain, scaled, everyone, size = model.chain, self.scaled, np.arange(self.total.size), len(model.load_patterns)
        rest = self.rows_at(everyone, start, moving=False)[:, 0]
        # first guess: the parabola whose tension is that at rest
        sigma = chain.arc_length / chain.total_length
        sag = parameters.mass * self.total * 0.5 * self.total**2 / self.rest_tension
        parabola = sag[:, None] * (scaled.named["shapes"] @ (chain.tributary_length * sigma * (1.0 - sigma)))
        for k, which in enumerate(model.sets):
            parabola[:, which] *= rest[:, 1 + (1 + k) * size, None]

        chord_tension = np.empty(len(rest))

        def forces(q: np.ndarray, part: np.ndarray, rows: np.ndarray = rest) -> tuple[np.ndarray, np.ndarray]:
            force, tangent = np.empty_like(q), np.empty((*q.shape, q.shape[1]))
            own = LeadingTerms(*(array[part] for array in self.terms))
            kernel.leading_forces(own, rows[part], q, force, tangent, chord_tension[: len(q)])
            return force, tangent

        q, found = equilibria(parabola, forces)
        q[~found] = np.nan
        now = self.rows_at(everyone, start, moving=True)[:, 0]
        f, _ = forces(q, everyone, now)
        norms, kappa = scaled.named["geometric_stiffness_norms"], self.terms.kappa
        stiffness = 2.0 * self.terms.sag_stiffness[:, 0]
        limit = verlet_step_limit(np.sqrt(largest_frequencies_squared(kappa, norms, stiffness, q, now, chord_tension)))
        v = np.zeros_like(q)
        if parameters.motions:
            # the particles are at rest, the chord frame moves: its velocity is projected as its acceleration is
            ends = parameters.end_positions(start)
            rates = parameters.end_positions(start, 1)
            moved = self._projected(everyone, ends, rates, np.zeros_like(self.load))[:, 0, 1 + size :]
            v = (moved[:, None] @ self.terms.load_projection.reshape(*moved.shape, -1))[:, 0]
        factor, back = decay_and_impulse(parameters.damping, -0.5 * step)
        return q, factor[:, None] * v + back[:, None] * f, limit, chord_tension

    def rows_at(self, part: np.ndarray, times: np.ndarray, *, moving: bool) -> np.ndarray:
        """Return the boundary data of members at times [s] (members, times, columns); if not `moving`, of ends at rest."""
        p, ends = self.parameters, self.ends.take(part)
        if not p.motions:
            return self._projected(part, ends.positions(times), None, self.load[part])
        accelerations = np.zeros((part.size, times.size, 2, p.dims))
        if moving:
            # damping acts on the motion of the chord frame too
            damped = 0.0 if p.damping is None else p.damping[part, None, None, None] * ends.positions(times, 1)
            accelerations = ends.positions(times, 2) + damped
        return self._projected(part, ends.positions(times), accelerations, self.load[part])

    def _projected(
        self, part: np.ndarray, ends: np.ndarray, accelerations: np.ndarray | None, load: np.ndarray
    ) -> np.ndarray:
        """Return the boundary data of members (members, times, columns) for ends and accelerations (members, times, 2, dims)."""
        count, times, dims = part.size, ends.shape[1], ends.shape[3]

        def rows(values: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(values.reshape(count * times, 2 * dims).T)

        loads, mass, reference = (
            np.repeat(array, times, axis=0)
            for array in (load[:, :, 0], self.parameters.mass[part], self.reference[part])
        )
        still = np.empty((2 * dims, 0)) if accelerations is None else rows(accelerations)
        return chord_and_loads(rows(ends), still, loads.T, mass, reference).reshape(count, times, -1)

    def places(self, result: Variables) -> Variables:
        """Return the coordinates of the particles and, where the result needs them, the links of the members."""
        places = places_of(self.plan.unit, result, self.plan.links)
        return {
            name: (dims, self.total[:, None] * of_unit)
            for name, (dims, of_unit) in places.items()
            if name != "link_number"
        }

    def diagnostics(self, limit: np.ndarray, end_time: float) -> dict[str, list[Any]]:
        """Return the attributes of the members that do not depend on their runs, for step limits [s] (members,)."""
        parameters = self.parameters
        varied = {**forcing_attributes(parameters, self.total), **parameters.offsets(), "step_limit": limit}
        return {name: values.tolist() for name, values in varied.items()} | distance_outside_training(
            self.plan.modes, parameters, self.total, end_time, self.rest_tension
        )

    def attributes_of_run(self, done: LaneResults, scheme: str) -> dict[str, list[Any]]:
        """Return the attributes of members with equal steps that depend on their run, a list for each name."""
        plan, instants = self.plan, done.instants
        shared = shared_attributes(plan.unit, instants, scheme, plan.modes) | window_attributes(plan.window)
        return {name: [value] * done.least_force.size for name, value in shared.items()} | {
            "smallest_chordwise_force": done.least_force.tolist(),
            "time_of_smallest_force": (done.least_force_step / instants.steps_per_second).tolist(),
        }

    def targets(self, rows: Rows, result: Variables, times: int) -> dict[str, np.ndarray]:
        """Add the variables with many numbers at `times` instants to the result, and return their arrays."""
        unit, outputs = self.plan.unit, self.plan.outputs
        links = unit.chain.links if self.plan.links is None else self.plan.links.size
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
            result["normal_reference"] = ("coordinate",), self.reference
        return {name: result[name][1] for name in shapes}

    def fill(
        self, part: np.ndarray, q: np.ndarray, times: np.ndarray, done: LaneResults, targets: dict[str, np.ndarray]
    ) -> np.ndarray:
        """Fill the rows of members from coordinates q (members, times, r); return whether they always have chord frames."""
        for name, which, bases in zip(pod_normal.SETS, self.plan.unit.sets, self.scaled.bases, strict=False):
            turned = q[:, :, which] @ np.swapaxes(bases[part], 1, 2)
            targets[f"amplitude{name}"][part, :, : turned.shape[2]] = turned
            targets[f"amplitude{name}"][part, :, turned.shape[2] :] = 0.0
        for name, values in (("tension_minimum", done.low), ("tension_maximum", done.high)):
            if name in targets:
                targets[name][part] = values
        unit, has_frames = self.plan.unit, np.ones(part.size, dtype=bool)
        if "tension" in targets:
            from cablepod.condensed import _kernels_recorder as kernel  # numba is imported only to compute

            chosen = slice(None) if self.plan.links is None else self.plan.links
            tables = (self.scaled.named[name][part][:, :, chosen] for name in ("slopes", "chordwise_force_patterns"))
            slopes, patterns = map(np.ascontiguousarray, tables)
            if done.instants.needs_interpolation:
                boundary_data = self.rows_at(part, times, moving=True)
            else:
                rows, boundary_data = done.instants.left[np.isin(done.instants.times, times)], done.boundary_data
                if rows.size < boundary_data.shape[1]:  # otherwise all of them, which need no copy
                    boundary_data = boundary_data.take(rows, axis=1)
            kernel.link_tensions(
                LeadingTerms(*(array[part] for array in self.terms)), boundary_data, q, slopes, unit.n_in_plane, patterns,
                np.empty(1), part, targets["tension"],
            )  # fmt: skip
        if "position" in targets:
            count = max(1, VALUES_AT_A_TIME // (times.size * unit.chain.links))
            for first in range(0, part.size, count):
                some = slice(first, first + count)
                has_frames[some] = self._fill_positions(part[some], q[some], times, targets["position"])
        return has_frames

    def _fill_positions(self, part: np.ndarray, q: np.ndarray, times: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Fill the positions of members; return whether there are always chord frames."""
        unit, named, has_frames = self.plan.unit, self.scaled.named, np.ones(part.size, dtype=bool)
        length, patterns = self.total[part, None] * unit.chain.length, named["chordwise_force_patterns"][part]
        deflection, squared = deflections(named["shapes"][part], unit.sets, length, q)
        rows = self.rows_at(part, times, moving=True)
        tau = rows[:, :, 1 : 1 + patterns.shape[1]] @ patterns
        factors = self.states.uniform[part, None] + self.states.sag[part, None] * unit.shear_under_uniform_load**2
        stiffness = self.parameters.stiffness[part, None]
        _, stretch = close_leading(squared * factors[:, None], tau, length, rows[:, :, 0], stiffness)
        along, ends = running_sum(stretch * length[:, None]), self.ends.take(part).positions(times)
        for k, m in enumerate(part.tolist()):
            try:
                target[m] = joined(ends[k], self.reference[m], along[k], deflection[:, k])
            except SceneError:
                has_frames[k] = False
        return has_frames


class CondensedBatch(MemberCoefficients):
    """Coefficients and results of the members of one chunk with a given step."""

    plan: CondensedBatchPlan

    def run(self, rows: Rows) -> tuple[np.ndarray, Variables, dict[str, list[Any]]]:
        """Run the members; return a mask of those completed, variables, the large ones in `rows`, and attributes."""
        instants = self.plan.instants
        q, v, limit, _ = self.starts(1.0 / instants.steps_per_second)
        result: Variables = {}
        targets = self.targets(rows, result, instants.times.size)
        lanes, everyone = Lanes(self, SCHEMES[0]), np.arange(len(q))
        wants_extremes = "tension_extremes" in self.plan.outputs
        loads = "tension" in self.plan.outputs
        done = lanes.advance(everyone, instants, q, v, extremes=wants_extremes, rates=False, loads=loads)
        has_frames = self.fill(everyone, np.ascontiguousarray(done.q), instants.times, done, targets)
        self.active &= (1.0 / instants.steps_per_second < limit) & done.completed & has_frames
        result["unstretched_length"] = (), self.total
        attributes = self.attributes_of_run(done, SCHEMES[0]) | self.diagnostics(limit, float(instants.times[-1]))
        return self.active, result | self.places(result), attributes
