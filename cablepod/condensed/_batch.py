"""Condensed models of many members: coefficients rescaled from the first member, runs in compiled blocks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from cablepod._resources import check_memory
from cablepod.batch._members import RunChunk, run_members
from cablepod.batch._stack import Variables, to_dataset
from cablepod.catenary._statics import member_statics
from cablepod.condensed._kernels_layout import MIN_FORCE, MIN_FORCE_STEP, UNSTABLE_STEP, initial_monitor
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._output import attributes_of, labels_of, padded, shared_attributes, title_of, variables
from cablepod.condensed._rescale import MemberStates, rescale_coefficients, rescaled_model, same_structure
from cablepod.condensed._runs import SCHEMES, CondensedRequest, solve
from cablepod.condensed._stepper import DIVERGENCE_FACTOR
from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._chord_frame import reference_axis
from cablepod.integrate._output_times import OutputTimes
from cablepod.parameters._from_scene import Members
from cablepod.parameters._parameters import Parameters
from cablepod.pod import _normal as pod_normal
from cablepod.reduced._training_distance import distance_outside_training
from cablepod.reduced._validity import forcing_attributes, warn_condensed_members


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
        Makes the model of a member whose structure differs from that of the first.
    progress
        Called with the completed fraction.
    """

    def run_member(i: int) -> tuple[Variables, Mapping[str, Any]]:
        p = members[i]
        member_model = rescaled_model(unit, p) if same_structure(p, unit.chain.p) else make(p)
        solution = solve(member_model, request)
        result = variables(member_model, solution.state, request.outputs, request.links)
        result["arc_length"] = (("particle",), member_model.chain.arc_length)
        return result, attributes_of(solution, modes, request)

    stack = run_members(run_member, len(members), progress, plan(modes, unit, members, request))
    title = title_of(unit, str(scene.attrs.get("title", "scene")))
    times = members[0].times() if request.times is None else request.times
    coords = labels_of(unit, times, request.links)
    result = to_dataset(stack, scene, coords).set_coords("arc_length")
    result.attrs = {"title": title, **result.attrs}
    warn_condensed_members(stack.attrs)
    return result


#: Number of steps in a block: its tables of end positions fit in the cache.  It divides the block of single runs, and is a
#: multiple of the block of the sine recurrence, which restarts at the same steps then.
BLOCK = 512


def plan(modes: xr.Dataset, unit: CondensedModel, members: Members, request: CondensedRequest) -> RunChunk | None:
    """Return how to run many members in compiled blocks; None where these do not support the request."""
    step, outputs = request.step, set(request.outputs)
    allowed = {"tension_extremes"} if request.links is None else {"tension", "tension_extremes"}
    if (
        unit.raw_test_functions is not None
        or step is None
        or unit.order != "leading"
        or request.scheme not in (None, SCHEMES[0])
        or outputs - allowed
    ):
        return None
    # the duration decides on the reference state
    if "time_duration" in members.varied or (request.times is None and "time_interval" in members.varied):
        return None
    if not members.can_be_stacked:
        return None
    times = members[0].times() if request.times is None else request.times
    check_memory(times.size, unit.chain.links, unit.chain.p.dims, key="times", variables=3)
    instants = OutputTimes.of(times, 1.0 / step)
    if instants.needs_interpolation or instants.steps.size != times.size:
        return None
    shared = shared_attributes(unit, instants, SCHEMES[0], modes)
    end_time = members[0].duration or 0.0
    return CondensedBatchPlan(modes, unit, members, instants, outputs, request.links, shared, end_time)


@dataclass(frozen=True)
class CondensedBatchPlan:
    """Common data of all members; a call runs some of them."""

    modes: xr.Dataset
    unit: CondensedModel  #: unit model of all members
    members: Members
    instants: OutputTimes
    outputs: set[str]
    links: np.ndarray | None  #: indices, from 0, of the links whose tensions are computed; None for all
    shared: dict[str, Any]  #: attributes of all members
    end_time: float  #: duration of the scenes, over which the reference state is taken [s]

    def __call__(self, first: int, last: int) -> tuple[np.ndarray, Variables, dict[str, list[Any]]]:
        """Run the members `first` ... `last - 1`; return a mask of those completed, variables and attributes."""
        # invalid members become nan here: their single runs report the reason
        with np.errstate(all="ignore"):
            return CondensedBatch(self, self.members.stacked(first, last)).run()


class CondensedBatch:
    """Rescaled coefficients and results of the members of one chunk."""

    def __init__(self, plan: CondensedBatchPlan, parameters: Parameters) -> None:
        self.plan, self.parameters = plan, parameters
        statics, self.active = member_statics(parameters)
        self.total, self.rest_tension = statics[:, 0].copy(), 0.5 * (statics[:, 4] + statics[:, 5])
        states = MemberStates.of(plan.unit, parameters, self.total, plan.end_time)
        self.scaled = rescale_coefficients(plan.unit, parameters.mass, self.total, states)
        named, links = self.scaled.named, plan.links
        slopes, patterns = (
            array if links is None else np.take(array, links, axis=2)
            for array in (named["slopes"], named["chordwise_force_patterns"])
        )
        self.links = slopes, plan.unit.n_in_plane, patterns
        self.coefficients = (
            parameters.mass, parameters.stiffness, self.total, self.scaled.slope_norms_squared,
            named["mean_chordwise_forces"], named["geometric_stiffness"], named["load_projection"],
            named["geometric_stiffness_norms"],
        )  # fmt: skip
        self.load = np.ascontiguousarray(parameters.load_at(0.0)[:, :, None])
        self.reference = reference_axis(parameters.ends[:, 1] - parameters.ends[:, 0])

    def run(self) -> tuple[np.ndarray, Variables, dict[str, list[Any]]]:
        """Run the members; return a mask of those completed, variables and attributes."""
        instants, links = self.plan.instants, self.links[0].shape[2]
        count, r = self.scaled.slope_norms_squared.shape
        q, v, limit = self._start()
        self.active &= 1.0 / instants.steps_per_second < limit
        saved = np.empty((count, instants.steps.size, r))
        tension_series = np.empty((count, instants.steps.size, links if "tension" in self.plan.outputs else 0))
        n_extremes = links if "tension_extremes" in self.plan.outputs else 0
        low, high = np.full((count, n_extremes), np.inf), np.full((count, n_extremes), -np.inf)
        monitor = np.tile(initial_monitor(4.0 * instants.steps_per_second**2, 0.0), (count, 1))
        self._advance(q, v, saved, tension_series, low, high, monitor)
        self.active &= monitor[:, UNSTABLE_STEP] == np.inf
        result = self._amplitudes(saved)
        result["end_position"] = ("time", "end", "coordinate"), self.parameters.end_positions(instants.times)
        result["unstretched_length"] = (), self.total
        if "tension" in self.plan.outputs:
            result["tension"] = ("time", "link"), tension_series
        if n_extremes:
            result["tension_minimum"], result["tension_maximum"] = (("link",), low), (("link",), high)
        result["arc_length"] = ("particle",), self.total[:, None] * self.plan.unit.chain.arc_length
        return self.active, result, self._attributes(monitor, limit)

    def _start(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return coordinates, rates half a step before the start (members, r), and step limits (members,) [s]."""
        from cablepod.condensed import _kernels_leading_batch as kernel  # numba is imported only to compute

        parameters, model, start = self.parameters, self.plan.unit, np.zeros(1)
        count, _, dims = parameters.ends.shape
        chain, scaled = model.chain, self.scaled
        ends, rates, accelerations = (
            np.ascontiguousarray(parameters.end_positions(start, k).reshape(count, 2 * dims, 1)) for k in (0, 1, 2)
        )
        # damping acts on the motion of the chord frame too
        accelerations += parameters.damping[:, None, None] * rates
        if not parameters.motions:
            rates = accelerations = np.zeros((count, 2 * dims, 0))
        # first guess: the parabola whose tension is that at rest
        sigma = chain.arc_length / chain.total_length
        sag = parameters.mass * self.total * 0.5 * self.total**2 / self.rest_tension
        parabola = sag[:, None] * (scaled.named["shapes"] @ (chain.tributary_length * sigma * (1.0 - sigma)))
        q, v, limit = np.empty_like(parabola), np.empty_like(parabola), np.empty(count)
        kernel.leading_starts(
            ends, rates, accelerations, self.load, self.reference, 1.0 / self.plan.instants.steps_per_second,
            parameters.damping, *self.coefficients, model.n_in_plane, parabola, q, v, limit,
        )  # fmt: skip
        return q, v, limit

    def _advance(
        self,
        q: np.ndarray,
        v: np.ndarray,
        saved: np.ndarray,
        tension_series: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        monitor: np.ndarray,
    ) -> None:
        """Advance all members, block by block."""
        from cablepod.condensed import _kernels_leading_batch as kernel

        instants, damping = self.plan.instants, self.parameters.damping
        step, total = 1.0 / instants.steps_per_second, int(instants.steps[-1]) + 1
        damping_factor, damped = np.exp(-damping * step), damping != 0.0
        impulse = np.where(damped, -np.expm1(-damping * step) / np.where(damped, damping, 1.0), step)
        model = self.plan.unit
        masses = self.parameters.mass * self.total * model.chain.tributary_length.sum()
        divergence_bound = DIVERGENCE_FACTOR * np.sqrt(masses) * self.total
        fill, ends, accelerations = self._end_tables()
        blocks = range(0, total, BLOCK)
        bounds = np.searchsorted(instants.steps, [*blocks, total]).tolist()
        for begin, first, last in zip(blocks, bounds[:-1], bounds[1:], strict=True):
            fill(begin)
            kernel.leading_members(
                q, v, step, damping_factor, impulse, ends, accelerations, self.load, self.reference,
                *self.coefficients, self.scaled.named["chordwise_forces_at_candidates"], *self.links, begin,
                min(BLOCK, total - begin), instants.steps, first, last, saved, low, high, monitor, tension_series,
                divergence_bound, self.active,
            )  # fmt: skip

    def _end_tables(self) -> tuple[Callable[[int], None], np.ndarray, np.ndarray]:
        """Make tables of end positions [m] and accelerations [m/s^2] of a block, (members, 2 dims, BLOCK) each.

        Returns a function that fills both from a given step on, and the two tables.
        """
        from cablepod.parameters import _kernels_sines as kernel

        parameters, steps_per_second = self.parameters, self.plan.instants.steps_per_second
        count, _, dims = parameters.ends.shape
        initial = parameters.ends.reshape(count, 2 * dims)
        ends = np.repeat(initial[:, :, None], BLOCK, axis=2)
        accelerations = np.zeros((count, 2 * dims, BLOCK if parameters.motions else 0))
        damping = parameters.damping if parameters.damping.any() else None
        motions = []
        for (end, axis), motion in parameters.motions.items():
            row = dims * ENDS.index(end) + COORDINATES.index(axis)
            values = {name: np.ascontiguousarray(value[:, 0]) for name, value in motion.values.items()}
            phase = values.get("phase", np.full(count, -0.5 * math.pi))  # that of one_minus_cosine
            origin = np.ascontiguousarray(initial[:, row])
            motions.append((values["angular_frequency"], phase, values["amplitude"], origin, damping, row))

        def fill(begin: int) -> None:
            for motion in motions:
                kernel.ends_of_members(begin, steps_per_second, *motion, ends, accelerations)

        return fill, ends, accelerations

    def _amplitudes(self, saved: np.ndarray) -> Variables:
        """Return the amplitudes of the modes as given for saved coordinates (members, times, r)."""
        model = self.plan.unit
        return {
            f"amplitude{suffix}": (
                ("time", "mode"),
                padded(saved[:, :, which] @ basis.transpose(0, 2, 1), model.rank),
            )
            for suffix, which, basis in zip(pod_normal.SETS, model.sets, self.scaled.bases, strict=False)
        }

    def _attributes(self, monitor: np.ndarray, limit: np.ndarray) -> dict[str, list[Any]]:
        """Return the attributes of the members, a list for each name."""
        parameters, instants = self.parameters, self.plan.instants
        varied = {
            "smallest_chordwise_force": monitor[:, MIN_FORCE],
            "time_of_smallest_force": monitor[:, MIN_FORCE_STEP] / instants.steps_per_second,
            **forcing_attributes(parameters, self.total),
            "step_limit": limit,
        }
        return (
            {name: [value] * limit.size for name, value in self.plan.shared.items()}
            | {name: values.tolist() for name, values in varied.items()}
            | distance_outside_training(
                self.plan.modes, parameters, self.total, float(instants.times[-1]), self.rest_tension
            )
        )
