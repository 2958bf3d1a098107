"""Members abreast in lanes by Numerov's method, which saves their states for the error estimate and dense output."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._lanes import (
    LaneGroups,
    link_coefficients,
    matrices,
    member_motions,
    member_numbers,
    watched_steps,
)
from cablepod.condensed._runs import STABLE_PHASE
from cablepod.condensed._stepper import DIVERGENCE_FACTOR, FOURTH_ORDER
from cablepod.integrate._output_times import OutputTimes
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._time_functions import ramped

if TYPE_CHECKING:
    from cablepod.condensed._batch_fitted import FittedBatch


@dataclass(frozen=True)
class MemberEnds:
    """Ends of stacked members that move by sines."""

    rows: np.ndarray  #: coordinate of the ends that each motion moves (motions,)
    motions: np.ndarray  #: (members, motions, MOTION_ROWS), see :mod:`cablepod.parameters._kernels_sines`
    initial: np.ndarray  #: ends at rest (members, 2, dims) [m]

    @classmethod
    def of(cls, parameters: Parameters) -> MemberEnds:
        """Collect the motions of stacked members."""
        return cls(*member_motions(parameters), parameters.ends)

    def take(self, part: np.ndarray) -> MemberEnds:
        """Return the ends of some members."""
        return MemberEnds(self.rows, self.motions[part], self.initial[part])

    def positions(self, times: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Return positions, or their first or second derivatives (members, times, end, dims) [m]."""
        members, _, dims = self.initial.shape
        result = np.zeros((members, times.size, 2 * dims))
        if derivative == 0:
            result[:] = self.initial.reshape(members, 1, 2 * dims)
        for k, row in enumerate(self.rows.tolist()):
            omega, phase, amplitude, _, _, ramp = (self.motions[:, k, i, None] for i in range(6))
            angle = omega * times + phase
            change = [
                amplitude * (np.sin(angle) - np.sin(phase)),
                *([amplitude * omega * np.cos(angle)] if derivative > 0 else []),
                *([-amplitude * omega * omega * np.sin(angle)] if derivative > 1 else []),
            ]
            result[:, :, row] += ramped(times, ramp, change) if ramp.any() else change[-1]
        return result.reshape(members, times.size, 2, dims)


@dataclass(frozen=True)
class NumerovResults:
    """Saved states of members with equal steps, and their extremes."""

    instants: OutputTimes
    saved: np.ndarray  #: coordinates at the saved steps (members, steps, r)
    half_step_rates: np.ndarray  #: rates half a step before and after (members, steps, 2, r)
    boundary_data: np.ndarray  #: boundary data at the saved steps (members, steps, columns)
    low: np.ndarray  #: least tensions (members, links or 0) [N]
    high: np.ndarray  #: largest tensions (members, links or 0) [N]
    least_force: np.ndarray  #: least chordwise forces (members,) [N]
    least_force_step: np.ndarray  #: numbers of their steps (members,)
    completed: np.ndarray  #: whether a member remained stable and bounded (members,)

    @property
    def q(self) -> np.ndarray:
        """Coordinates at the instants of the output (members, times, r)."""
        saved = np.swapaxes(self.saved, 0, 1)
        if not self.instants.needs_interpolation:
            return self.saved[:, self.instants.left]
        before, after = (np.swapaxes(self.half_step_rates[:, :, k], 0, 1) for k in (0, 1))
        rates, accelerations = 0.5 * (before + after), (after - before) * self.instants.steps_per_second
        return np.ascontiguousarray(np.swapaxes(self.instants.at_times(saved, rates, accelerations), 0, 1))


class NumerovLanes:
    """Arrays of the members of a batch for the kernel; :meth:`advance` runs some of them with one step.

    Parameters
    ----------
    batch
        Parameters and coefficients.
    q, v
        Coordinates and rates at the start (members, r).
    """

    def __init__(self, batch: FittedBatch, q: np.ndarray, v: np.ndarray) -> None:
        self.batch, parameters = batch, batch.parameters
        stiffness, norms, projection, bases = matrices(batch)
        self.state = q, v
        self.given = (
            batch.ends.motions, parameters.ends.reshape(len(q), -1), batch.load[:, :, 0],
            None if parameters.dims == 2 else np.eye(3)[batch.reference],
        )  # fmt: skip
        self.coefficients = (
            parameters.damping, batch.scaled.slope_norms_squared, member_numbers(batch, 1.0), stiffness, projection, norms, bases,
        )  # fmt: skip
        self.bound = DIVERGENCE_FACTOR * np.sqrt(parameters.mass * batch.total) * batch.total

    def advance(self, part: np.ndarray, instants: OutputTimes, *, extremes: bool) -> NumerovResults:
        """Run the members with the numbers `part`, with the steps of `instants`."""
        from cablepod.condensed import _kernels_leading_numerov_lanes as kernel  # numba is imported only to compute

        batch, unit, groups, count = self.batch, self.batch.plan.unit, LaneGroups(part.size), part.size
        slopes, force_patterns = link_coefficients(unit, batch.plan.links)
        links = len(slopes) if extremes else 0
        low, high = groups.full(links, np.inf), groups.full(links, -np.inf)
        least_force, least_force_step, largest_omega_squared = (
            np.full((groups.groups, groups.lanes), value) for value in (np.inf, 0.0, 0.0)
        )
        motions, ends, load, reference = (None if array is None else groups.split(array[part]) for array in self.given)
        damping, kappa, members, stiffness, projection, norms, bases = (
            groups.split(array[part]) for array in self.coefficients
        )
        q, v = (groups.split(array[part]) for array in self.state)
        steps, r = instants.steps.size, q.shape[1]
        saved, half_step_rates = np.empty((count, steps, r)), np.empty((count, steps, 2, r))
        boundary_data = np.empty((count, steps, 1 + batch.load_rows))
        kernel.leading_numerov_lanes(
            count, *((0,) * number for number in (*unit.ranks, 0)[:2]), (0,) * len(unit.load_patterns),
            int(instants.steps[-1]), instants.steps_per_second, instants.steps, batch.ends.rows, motions, ends, load,
            reference, q, v, damping, kappa, members, unit.mean_chordwise_forces, stiffness, projection, norms,
            np.ascontiguousarray(unit.chordwise_forces_at_candidates[:, [0, -1]]), slopes, force_patterns, bases,
            watched_steps(batch.plan.window, instants.steps_per_second), low, high,
            least_force, least_force_step, largest_omega_squared, saved, half_step_rates, boundary_data,
        )  # fmt: skip
        completed = (np.abs(groups.join(q)) < self.bound[part, None]).all(axis=1)
        limit = STABLE_PHASE[FOURTH_ORDER] ** 2 * instants.steps_per_second**2
        completed &= largest_omega_squared.ravel()[:count] < limit
        low, high = (np.copysign(np.sqrt(np.abs(square)), square) for square in (groups.join(low), groups.join(high)))
        return NumerovResults(
            instants, saved, half_step_rates, boundary_data, low, high, least_force.ravel()[:count],
            least_force_step.ravel()[:count], completed & math.isfinite(limit),
        )  # fmt: skip
