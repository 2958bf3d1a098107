"""Members whose steps fit their models: two runs in lanes and an estimate, as :func:`cablepod.condensed._runs.solve` of one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod._resources import ARRAYS_OF_RUN, check_memory
from cablepod.batch._members import Rows
from cablepod.batch._stack import Variables
from cablepod.condensed._batch import MemberCoefficients, MembersPlan
from cablepod.condensed._error_coefficients import Cables, scaled_terms, unit_coefficients
from cablepod.condensed._error_equation import LinkSlopes, errors_at_rest, mean_squares
from cablepod.condensed._estimate import (
    MAX_ERROR,
    MOTION_SAMPLES,
    POINTS,
    POINTS_PER_MODE,
    largest_motions,
    sample_interval,
)
from cablepod.condensed._estimate_neglected import INTEGRATED_RATIO, chord_direction, waves_of_start
from cablepod.condensed._lanes import LANES, LaneResults, Lanes
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._runs import (
    FIT_INTERVALS,
    FOURTH_ORDER_AT_FIRST,
    CondensedRequest,
    fourth_order_step,
    suits_fourth_order,
    taut_limit,
    time_tolerance,
    whole_steps_per_second,
)
from cablepod.condensed._stepper import FOURTH_ORDER
from cablepod.discretisation._lifting import line_between
from cablepod.integrate._output_times import OutputTimes, judged_instants, with_judged
from cablepod.integrate._refinement import MAX_WORK, economical_error
from cablepod.integrate._step_control import STEPS_PER_CHANGE
from cablepod.parameters._from_scene import Members
from cablepod.reduced._validity import forcing_attributes

#: Outputs of these members.
FITTED_OUTPUTS = {"position", "tension", "tension_extremes", "error_estimate"}
#: Maximum memory for the saved states of members that run together [bytes].
MAX_SAVED = 16_000_000
#: Minimum number of steps: the first one needs the loads of three instants.
MIN_STEPS = 2


def plan_fitted(
    modes: xr.Dataset, unit: CondensedModel, members: Members, request: CondensedRequest
) -> FittedBatchPlan | None:
    """Return how to run many members with steps that fit their models; None where lanes do not support the request."""
    if request.given_tolerance is not None or request.scheme not in (None, FOURTH_ORDER):
        return None
    outputs = set(request.outputs)
    if outputs - FITTED_OUTPUTS:
        return None
    times = members[0].times() if request.times is None else request.times
    if not times[-1] > 0.0:
        return None
    check_memory(times.size, unit.chain.links, unit.chain.p.dims, key="times", variables=ARRAYS_OF_RUN)
    end_time = members[0].duration or 0.0
    return FittedBatchPlan(
        modes, unit, members, outputs, request.links, end_time, request.window, times, request.scheme is None
    )


@dataclass(frozen=True)
class FittedBatchPlan(MembersPlan):
    """Common data of all members; a call runs some of them."""

    times: np.ndarray  #: instants of the output [s]
    chooses_scheme: bool  #: whether the scheme is the default, which suits most members

    def __call__(self, first: int, last: int, rows: Rows) -> tuple[np.ndarray, Variables, dict[str, list[Any]]]:
        """Run the members `first` ... `last - 1`; return a mask of those completed, variables and attributes."""
        # invalid members become nan here: their single runs report the reason
        with np.errstate(all="ignore"):
            return FittedBatch(self, self.members.stacked(first, last)).run(rows)


class _Choice(NamedTuple):
    """First steps per second of members, and bounds that decide on their samples."""

    steps_per_second: np.ndarray  #: of the first run [1/s]; 0 for members that run alone
    sample_intervals: np.ndarray  #: steps of the second run between samples of the error estimate
    limit: np.ndarray  #: stability limits of velocity Verlet [s]


class FittedBatch(MemberCoefficients):
    """Rescaled coefficients and results of the members of one chunk."""

    plan: FittedBatchPlan

    def run(self, rows: Rows) -> tuple[np.ndarray, Variables, dict[str, list[Any]]]:
        """Run the members; return a mask of those completed, variables, the large ones in `rows`, and attributes."""
        q, v, limit, chord_tension = self.starts(0.0)  # no step: the rates at the start
        self.q_rest, self.v_rest = q, v
        choice = self._first_steps(limit, chord_tension)
        result: Variables = {}
        targets = self.targets(rows, result, self.plan.times.size)
        count = limit.size
        attributes: dict[str, list[Any]] = {}
        completed, lanes = np.zeros(count, dtype=bool), Lanes(self, FOURTH_ORDER)
        keys = np.stack([choice.steps_per_second, choice.sample_intervals], axis=1)
        for rate, interval in np.unique(keys[self.active & (choice.steps_per_second > 0.0)], axis=0).tolist():
            group = np.flatnonzero(self.active & (keys == (rate, interval)).all(axis=1))
            compared = with_judged(self.plan.times, judged_instants(self.plan.times, rate))
            fine = OutputTimes.of(compared, 2.0 * rate).with_multiples(int(interval))
            numbers = 8 * fine.steps.size * (3 * q.shape[1] + 1 + self.load_rows)
            most = max(LANES, MAX_SAVED // numbers // LANES * LANES)
            for begin in range(0, group.size, most):
                part = group[begin : begin + most]
                done = self._run_group(lanes, part, OutputTimes.of(compared, rate), fine, int(interval), targets)
                self._set_attributes(attributes, part, done)
                completed[part] = done.completed
        result["unstretched_length"] = (), self.total
        end_time = float(self.plan.times[-1])
        return completed, result | self.places(result), attributes | self.diagnostics(limit, end_time)

    @property
    def load_rows(self) -> int:
        """Number of loads along the chord and along the normals."""
        return len(self.plan.unit.load_patterns) * self.plan.unit.chain.p.dims

    def _first_steps(self, limit: np.ndarray, chord_tension: np.ndarray) -> _Choice:
        """Choose the steps of the first runs, as :func:`cablepod.condensed._runs.solve` does."""
        p, times = self.parameters, self.plan.times
        end_time, kappa = float(times[-1]), self.scaled.slope_norms_squared.max(axis=1)
        at_start = 4.0 / (limit * limit)
        ends = self.ends.positions(np.linspace(0.0, end_time, FIT_INTERVALS + 1))
        longest = np.sqrt(((ends[:, :, 1] - ends[:, :, 0]) ** 2).sum(axis=2).max(axis=1))
        omega_squared = np.maximum(at_start, p.stiffness * np.maximum(longest / self.total - 1.0, 0.0) * kappa)
        suited = self.active & np.isfinite(omega_squared) & (omega_squared > 0.0)
        suited &= self.forcing_ratio <= INTEGRATED_RATIO  # waves by the start alone
        if self.plan.chooses_scheme:
            suited &= suits_fourth_order(limit, taut_limit(chord_tension, kappa), p.damping, at_start)
        free = fourth_order_step(omega_squared, p.damping)
        time_scales = np.broadcast_to(p.shortest_time_scale, free.shape)
        first = np.minimum(free, time_scales / STEPS_PER_CHANGE)
        largest = MAX_WORK / (end_time * self.plan.unit.chain.links)
        window = end_time if self.plan.window is None else self.plan.window[1] - self.plan.window[0]
        rates, intervals, modes = np.zeros(limit.size), np.ones(limit.size), self.plan.unit.n_in_plane
        for m in np.flatnonzero(suited).tolist():
            rate = whole_steps_per_second(1.0 / float(first[m]))
            if rate <= largest and end_time * rate >= MIN_STEPS and window * rate > 2.0:
                rates[m] = rate
                bound = float(omega_squared[m]), modes, 2.0 * rate, end_time
                intervals[m] = sample_interval(*bound, time_scale=float(time_scales[m]))
        return _Choice(rates, intervals, limit)

    @property
    def forcing_ratio(self) -> np.ndarray:
        """Forcing frequency over the first axial one (members,)."""
        return forcing_attributes(self.parameters, self.total)["forcing_over_axial_frequency"]

    def _run_group(
        self,
        lanes: Lanes,
        part: np.ndarray,
        coarse: OutputTimes,
        fine: OutputTimes,
        interval: int,
        targets: dict[str, np.ndarray],
    ) -> _Done:
        """Run members with equal steps twice, estimate their errors, and fill their rows of the targets."""
        mass = self.parameters.mass[part] * self.total[part]
        start = self.q_rest, self.v_rest
        first = lanes.advance(part, coarse, *start, extremes=False, rates=True, loads=True)
        q_first, stable = first.q, first.completed
        second = lanes.advance(
            part, fine, *start, extremes="tension_extremes" in self.plan.outputs, rates=True, loads=True
        )
        q = second.q
        runs = MemberRuns(self, part, second, interval)
        scale = motions_of(runs)
        error = errors_of(runs, scale)
        gap = q - q_first
        distance = np.sqrt((gap * gap).sum(axis=2).max(axis=1) / mass) / scale
        time_error = economical_error(distance, 2.0, FOURTH_ORDER_AT_FIRST)
        tolerance = time_tolerance(error)
        if q.shape[1] > self.plan.times.size:  # also compared between the output times
            q = q[:, np.isin(fine.times, self.plan.times)]
        completed = stable & second.completed & (time_error <= tolerance)
        completed &= self.fill(part, np.ascontiguousarray(q), self.plan.times, second, targets)
        return _Done(completed, time_error, error + time_error, second)

    def _set_attributes(self, attributes: dict[str, list[Any]], part: np.ndarray, done: _Done) -> None:
        """Set the attributes of members with equal steps."""
        columns = self.attributes_of_run(done.lanes, FOURTH_ORDER) | {"time_error_estimate": done.time_error.tolist()}
        if "error_estimate" in self.plan.outputs:
            columns["error_estimate"] = done.error.tolist()
        for name, column in columns.items():
            target = attributes.setdefault(name, [None] * self.total.size)
            for m, value in zip(part.tolist(), column, strict=True):
                target[m] = value


class _Done(NamedTuple):
    """Results of members with equal steps."""

    completed: np.ndarray  #: whether a run was stable and meets its tolerance (members,)
    time_error: np.ndarray  #: estimated time error as a fraction of the motion (members,)
    error: np.ndarray  #: estimated error (members,)
    lanes: LaneResults


# --- estimates of the error, as _estimate makes that of one run -------------------------------------------------------


class MemberRuns:
    """Runs of members with equal steps, and what their estimates share.

    Parameters
    ----------
    batch
        Parameters and coefficients of the chunk.
    part
        Numbers of the members (members,).
    results
        Saved states, those of the samples among them.
    interval
        Number of steps between two samples.
    """

    def __init__(self, batch: FittedBatch, part: np.ndarray, results: LaneResults, interval: int) -> None:
        self.batch, self.part, self.results, self.interval = batch, part, results, interval
        self.total, self.mass = batch.total[part], batch.parameters.mass[part]
        self.ends, self.shapes = batch.ends.take(part), batch.scaled.named["shapes"][part]
        self.samples = np.flatnonzero(results.instants.steps % interval == 0)

    @cached_property
    def normals(self) -> np.ndarray:
        """Normals of the chord at the start (members, normals, dims)."""
        along = chord_direction(self.batch.parameters.initial_ends[self.part])
        if along.shape[1] == 2:
            return np.stack([-along[:, 1], along[:, 0]], axis=1)[:, None]
        first = self.batch.reference[self.part]
        return np.stack([first, np.cross(along, first)], axis=1)


def motions_of(runs: MemberRuns) -> np.ndarray:
    """Return the largest rms displacements of members from their initial shapes [m].

    See :func:`cablepod.condensed._estimate.motion_of`.
    """
    batch, results = runs.batch, runs.results
    stride = -(-runs.samples.size // MOTION_SAMPLES)
    q, unit = results.saved[:, runs.samples[::stride]], batch.plan.unit
    ends = None
    if runs.ends.motions:
        times = np.arange(q.shape[1]) * (stride * runs.interval / results.instants.steps_per_second)
        ends = runs.ends.positions(times)
    of_upper = runs.shapes @ (unit.chain.tributary_length * unit.chain.arc_length)
    of_lower = runs.shapes @ unit.chain.tributary_length - of_upper
    count = [of_upper[:, which].shape[1] for which in unit.sets]
    normals = np.repeat(runs.normals, count, axis=1)
    largest = np.sqrt(largest_motions(q, ends, (runs.mass * runs.total)[:, None], normals, of_lower, of_upper))
    reach = runs.ends.initial[:, 1] - runs.ends.initial[:, 0]
    chord = np.sqrt((reach * reach).sum(axis=1))
    return np.where(largest > 1e-9 * chord, largest, chord)


def errors_of(runs: MemberRuns, scale: np.ndarray) -> np.ndarray:
    """Estimate the largest errors of members over time as fractions of their motions `scale` [m]."""
    batch, results, part, total = runs.batch, runs.results, runs.part, runs.total
    model, p, shapes = batch.plan.unit, batch.parameters, runs.shapes
    unit, at = unit_coefficients(
        model.modes, model.chain.arc_length, model.chain.p, POINTS + POINTS_PER_MODE * max(map(len, model.modes))
    )
    shape = (1.0 / np.sqrt(runs.mass * total))[:, None, None]
    length, projection = total[:, None, None], (unit.shapes * unit.mass) / shape
    change = projection @ np.swapaxes(shapes, 1, 2)
    in_plane, enriched_in_plane = model.n_in_plane, unit.n_in_plane
    change[:, :enriched_in_plane, in_plane:] = change[:, enriched_in_plane:, :in_plane] = 0.0
    cables = Cables(p.stiffness[part], runs.mass, p.damping[part], total)
    load = np.repeat(total[:, None], len(model.load_patterns), axis=1)  # there are no point loads
    terms = scaled_terms(unit, at, cables, load, change, in_plane, leading=True, green=False)
    q, rates, boundary_data = results.saved, results.half_step_rates, results.boundary_data
    if runs.samples.size < q.shape[1]:
        q, rates, boundary_data = (array.take(runs.samples, axis=1) for array in (q, rates, boundary_data))
    rate, start = results.instants.steps_per_second, np.zeros(1)
    rest = batch.rows_at(part, start, moving=False)[:, 0]
    error = errors_at_rest(terms, batch.q_rest[part], rest)
    error_rates = _initial_error_rates(runs, projection, change, enriched_in_plane)
    before, after = rates[:, :, 0], rates[:, :, 1]
    motion = q, 0.5 * (before + after), (after - before) * rate
    mass, chain = (runs.mass * total)[:, None], model.chain
    on_links = LinkSlopes((shape / length) * unit.slopes, total[:, None] * chain.length, mass * chain.tributary_length)
    squares = mean_squares(terms, on_links, mass, motion, boundary_data, runs.interval / rate, error, error_rates)
    return np.minimum(np.sqrt(squares.max(axis=1) + _waves(runs) ** 2) / scale, MAX_ERROR)


def _waves(runs: MemberRuns) -> np.ndarray:
    """Return the rms displacements of waves along the cables that their starts excite (members,) [m]."""
    p = runs.batch.parameters
    rates = np.moveaxis(p.initial_end_rates, 0, 1)[runs.part]
    if not rates.any():
        return np.zeros(runs.part.size)
    along = chord_direction(p.initial_ends[runs.part])
    omega = math.pi / runs.total * np.sqrt(p.stiffness[runs.part] / runs.mass)
    return waves_of_start(rates, along, omega, p.damping[runs.part])


def _initial_error_rates(
    runs: MemberRuns, projection: np.ndarray, change: np.ndarray, enriched_in_plane: int
) -> np.ndarray:
    """Return the rates of the errors at the start (members, R): the particles are at rest, the chord frame moves."""
    rates, result = runs.batch.parameters.initial_end_rates[0][runs.part], np.zeros(change.shape[:2])
    if not rates.any():
        return result
    unit, q_rates = runs.batch.plan.unit, np.zeros((len(rates), change.shape[2]))
    mass = (runs.mass * runs.total)[:, None, None] * unit.chain.tributary_length
    sets = (slice(enriched_in_plane), slice(enriched_in_plane, None))
    for k, (which, enriched) in enumerate(zip(unit.sets, sets, strict=False)):
        ends = -(rates @ runs.normals[:, k, :, None])
        deflection = line_between(ends, unit.chain.arc_length)  # (members, particle, 1)
        shapes = runs.shapes[:, which]
        momenta = (shapes * mass) @ deflection
        q_rates[:, which] = np.linalg.solve((shapes * mass) @ np.swapaxes(shapes, 1, 2), momenta)[:, :, 0]
        result[:, enriched] = (projection[:, enriched] @ deflection)[:, :, 0]
    return result - (change @ q_rates[:, :, None])[:, :, 0]
