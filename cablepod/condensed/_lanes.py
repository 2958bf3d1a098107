"""Members side by side in lanes: their coefficients as the explicit steps take them, and results of runs with equal steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._kernels_layout import (
    MIN_FORCE,
    MIN_FORCE_STEP,
    MONITOR_ROWS,
    OMEGA_SQUARED_LIMIT,
    UNSTABLE_STEP,
    Bounds,
    ExplicitState,
    LeadingTerms,
    Links,
    Record,
    constant_sizes,
)
from cablepod.condensed._runs import STABLE_PHASE
from cablepod.condensed._stepper import DIVERGENCE_FACTOR, FOURTH_ORDER, damped_step
from cablepod.conventions import COORDINATES, ENDS
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._window import steps_within
from cablepod.parameters._parameters import positions_of_ends
from cablepod.parameters._time_functions import TimeFunction

if TYPE_CHECKING:
    from cablepod.condensed._batch import MemberCoefficients

#: Number of lanes: the numbers of so many members fit in the first cache; a constant of the compiled steps.
LANES = 32
#: Number of steps whose boundary data are computed at once: a multiple of that after which rotations begin anew.
BLOCK = 512


@dataclass(frozen=True)
class MemberEnds:
    """Ends of stacked members that move by sines."""

    initial: np.ndarray  #: ends at rest (members, 2, dims) [m]
    motions: Mapping[tuple[str, str], TimeFunction]  #: (end, axis) -> displacements [m]

    def take(self, part: np.ndarray) -> MemberEnds:
        """Return the ends of some members."""
        of_part = {
            key: replace(motion, values={name: value[part] for name, value in motion.values.items()})
            for key, motion in self.motions.items()
        }
        return MemberEnds(self.initial[part], of_part)

    def positions(self, times: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Return positions, or their first or second derivatives (members, times, end, dims) [m]."""
        return positions_of_ends(self.initial, self.motions, times, derivative)

    @property
    def rows(self) -> np.ndarray:
        """Coordinate of the ends that each motion moves (motions,)."""
        dims = self.initial.shape[-1]
        rows = [dims * ENDS.index(end) + COORDINATES.index(axis) for end, axis in self.motions]
        return np.array(rows, dtype=np.int64)

    def for_rotations(self, damping: np.ndarray) -> np.ndarray:
        """Return the motions (motions, MOTION_ROWS, members) of :mod:`cablepod.parameters._kernels_sines`.

        `damping` is the mass-proportional damping of the members [1/s].
        """
        from cablepod.parameters._kernels_sines import MOTION_ROWS  # numba is imported only to compute

        count = len(self.initial)
        initial = self.initial.reshape(count, -1)
        motions = np.empty((len(self.motions), MOTION_ROWS, count))
        for row, motion, values in zip(self.rows, self.motions.values(), motions, strict=True):
            numbers = *motion.sine, initial[:, row], damping, motion.ramp
            values[:] = [np.broadcast_to(np.ravel(number), count) for number in numbers]
        return motions


@dataclass(frozen=True)
class LaneResults:
    """Saved states of members with equal steps, and their extremes."""

    instants: OutputTimes
    saved: np.ndarray  #: coordinates at the saved steps (members, steps, r)
    half_step_rates: np.ndarray  #: rates half a step before and after (members, steps, 2, r), or without steps
    boundary_data: np.ndarray  #: boundary data at the saved steps (members, steps, columns), or without steps
    low: np.ndarray  #: least tensions (members, links or 0) [N]
    high: np.ndarray  #: largest tensions (members, links or 0) [N]
    least_force: np.ndarray  #: least chordwise forces (members,) [N]
    least_force_step: np.ndarray  #: numbers of their steps (members,)
    completed: np.ndarray  #: whether a member remained stable and bounded (members,)

    @property
    def q(self) -> np.ndarray:
        """Coordinates at the instants of the output (members, times, r)."""
        saved = np.swapaxes(self.saved, 0, 1)
        left = self.instants.left
        if not self.instants.needs_interpolation:
            return self.saved if np.array_equal(left, np.arange(self.saved.shape[1])) else self.saved.take(left, axis=1)
        before, after = (np.swapaxes(self.half_step_rates[:, :, k], 0, 1) for k in (0, 1))
        rates, accelerations = 0.5 * (before + after), (after - before) * self.instants.steps_per_second
        return np.ascontiguousarray(np.swapaxes(self.instants.at_times(saved, rates, accelerations), 0, 1))


class Lanes:
    """Members of a batch for the explicit steps; :meth:`advance` runs some of them with one step.

    Parameters
    ----------
    batch
        Parameters and coefficients.
    scheme
        An explicit scheme.
    """

    def __init__(self, batch: MemberCoefficients, scheme: str) -> None:
        self.batch, self.scheme = batch, scheme
        p, unit = batch.parameters, batch.plan.unit
        self.bound = DIVERGENCE_FACTOR * np.sqrt(p.mass * batch.total * unit.chain.tributary_length.sum()) * batch.total
        patterns = len(unit.load_patterns)
        self.sizes = constant_sizes(sum(unit.ranks), patterns, patterns * (p.dims - 1), LANES)
        candidates = np.swapaxes(batch.scaled.named["chordwise_forces_at_candidates"], 1, 2)
        self.of_monitor = batch.scaled.named["geometric_stiffness_norms"], candidates

    def advance(
        self,
        part: np.ndarray,
        instants: OutputTimes,
        q: np.ndarray,
        v: np.ndarray,
        *,
        extremes: bool,
        rates: bool,
        loads: bool,
    ) -> LaneResults:
        """Run the members with the numbers `part`, with the steps of `instants`.

        `q` and `v` are coordinates and rates of all members at the start, the latter half a step before for velocity Verlet;
        `extremes`, `rates` and `loads` tell whether extremes of tensions, rates and boundary data are kept.
        """
        plan, count, r = self.batch.plan, part.size, q.shape[1]
        saved = instants.steps.size
        columns = 1 + len(self.sizes.patterns) + len(self.sizes.normal_loads)
        links = 0 if not extremes else plan.unit.chain.links if plan.links is None else plan.links.size
        shapes = (
            (saved, r),
            (saved if rates else 0, 2, r),
            (saved if loads else 0, columns),
            (links,),
            (links,),
            (MONITOR_ROWS,),
        )
        groups = -(-count // LANES)
        results = [np.empty((groups * LANES, *shape)) for shape in shapes]
        final = np.empty((groups * LANES, r))
        for g in range(groups):
            lanes = slice(g * LANES, (g + 1) * LANES)
            members = part[np.minimum(np.arange(lanes.start, lanes.stop), count - 1)]  # the last lanes repeat a member
            group = _Group(self, members, instants, q[members], v[members], links, rates=rates, loads=loads)
            group.run()
            for result, values in zip(results, group.results(), strict=True):
                result[lanes] = values
            final[lanes] = group.state.q.reshape(r, LANES).T
        coordinates, half_step_rates, boundary_data, low, high, monitor = (result[:count] for result in results)
        completed = (np.abs(final[:count]) < self.bound[part, None]).all(axis=1) & np.isinf(monitor[:, UNSTABLE_STEP])
        least_force, least_force_step = monitor[:, MIN_FORCE], monitor[:, MIN_FORCE_STEP]
        return LaneResults(
            instants, coordinates, half_step_rates, boundary_data, low, high, least_force, least_force_step, completed
        )


class _Group:
    """One group of lanes in a run with equal steps."""

    def __init__(
        self,
        lanes: Lanes,
        members: np.ndarray,
        instants: OutputTimes,
        q: np.ndarray,
        v: np.ndarray,
        links: int,
        *,
        rates: bool,
        loads: bool,
    ) -> None:
        batch, p = lanes.batch, lanes.batch.parameters
        plan, named = batch.plan, batch.scaled.named
        self.lanes, self.instants, self.r = lanes, instants, q.shape[1]
        self.terms = LeadingTerms(*(_flat(array[members]) for array in batch.terms))
        norms, candidates = (array[members] for array in lanes.of_monitor)
        by_candidate = np.moveaxis(candidates, 0, -1).reshape(candidates.shape[1], -1)
        self.bounds = Bounds(_flat(norms), np.ascontiguousarray(by_candidate), np.empty(LANES))
        chosen = np.arange(links) if plan.links is None else plan.links[:links]
        tables = (named[name][members][:, :, chosen] for name in ("slopes", "chordwise_force_patterns"))
        slopes, patterns = (np.moveaxis(table, 0, -1).reshape(table.shape[1], -1) for table in tables)
        size = links * LANES
        low, high = np.full(size, np.inf), np.full(size, -np.inf)
        self.links = Links.of(slopes, plan.unit.n_in_plane, patterns, low, high)
        none = np.empty(0)
        self.links_outside = (
            self.links._replace(low=none, high=none) if links else None
        )  #: of the window; None: no extremes
        self.damped = damped_step(np.tile(p.damping[members], self.r), 1.0 / instants.steps_per_second, lanes.scheme)
        self.state = ExplicitState.of(_flat(q), _flat(v), np.zeros(q.size), LANES)
        limit = (STABLE_PHASE[lanes.scheme] * instants.steps_per_second) ** 2
        self.monitor = np.zeros((MONITOR_ROWS, LANES))
        self.monitor[[MIN_FORCE, UNSTABLE_STEP]], self.monitor[OMEGA_SQUARED_LIMIT] = np.inf, limit
        saved, columns = instants.steps.size, 1 + len(lanes.sizes.patterns) + len(lanes.sizes.normal_loads)
        self.coordinates = np.empty((saved, self.r, LANES))
        self.rates = np.empty((saved if rates else 0, 2, self.r, LANES))
        self.boundary_data = np.empty((saved if loads else 0, columns, LANES))
        ends = batch.ends.take(members)
        motions, moved = ends.for_rotations(p.damping[members]), ends.rows
        count, dims = len(moved), p.dims
        work = np.empty((count, 5, LANES)), np.empty((count, 2, 4, LANES)), np.empty((9, LANES))
        reference = None if dims == 2 else np.ascontiguousarray(batch.reference[members].T)
        self.of_ends = moved, motions, work
        self.of_frames = (
            _flat(p.ends[members]).reshape(2 * dims, LANES), np.zeros((2 * dims, LANES)),
            np.ascontiguousarray(batch.load[members, :, 0].T), p.mass[members], reference,
        )  # fmt: skip
        self.rows = np.empty((BLOCK + 1, columns * LANES))

    def run(self) -> None:
        """Take all steps, block by block; blocks end at the borders of the window of the extremes."""
        from cablepod.condensed import _kernels_explicit as kernel  # numba is imported only to compute

        lanes, steps = self.lanes, self.instants.steps
        is_verlet = lanes.scheme != FOURTH_ORDER
        total = int(steps[-1])
        window = lanes.batch.plan.window
        first, last = (0, total) if window is None else steps_within(window, self.instants.steps_per_second)
        starts = sorted({*range(0, total + 1, BLOCK), first, min(last + is_verlet, total + is_verlet)})
        ends = [*starts[1:], total + is_verlet]
        for begin, end in zip(starts, ends, strict=True):
            count = end - begin  # steps of Numerov's method, rows of velocity Verlet
            if count <= 0 and not (begin == 0 and not is_verlet):
                continue
            rows = self._boundary_data(begin, max(count - is_verlet, min(2, total) if begin == 0 else 0))
            from_saved, to_saved = np.searchsorted(steps, [begin, end if is_verlet or end < total else end + 1])
            saved = slice(int(from_saved), int(to_saved))
            self._keep_boundary_data(rows, begin, saved)
            rates = self.rates[saved].reshape(-1) if len(self.rates) else self.rates.reshape(-1)
            record = Record(steps[saved], self.coordinates[saved].reshape(-1), rates)
            counts = self.links_outside is not None and first <= begin and end - is_verlet <= last
            shared = lanes.sizes, self.terms, self.bounds, self.links if counts else self.links_outside, self.damped
            outputs = self.state, begin, record, self.monitor.reshape(-1)
            if is_verlet:
                kernel.verlet(*shared, None, None, rows, count, *outputs)
            else:
                kernel.numerov(*shared, rows, count, *outputs)

    def _boundary_data(self, begin: int, steps: int) -> np.ndarray:
        """Return the boundary data of the steps `begin` ... `begin + steps` (steps + 1, columns lanes)."""
        from cablepod.condensed import _kernels_frame as kernel

        sizes, before = self.lanes.sizes, begin % BLOCK  # rotations start at whole blocks
        rows = self.rows[: before + steps + 1]
        moved, motions, work = self.of_ends
        kernel.boundary_data_of_lanes(
            sizes.lanes, sizes.patterns, begin - before, before + steps, self.instants.steps_per_second, moved, motions, work,
            *self.of_frames, rows,
        )  # fmt: skip
        return rows[before:]

    def _keep_boundary_data(self, rows: np.ndarray, begin: int, saved: slice) -> None:
        """Keep the boundary data of the saved steps of a block."""
        if len(self.boundary_data):
            kept = self.boundary_data[saved]
            kept[:] = rows[self.instants.steps[saved] - begin].reshape(kept.shape)

    def results(self) -> tuple[np.ndarray, ...]:
        """Return coordinates, rates, boundary data, extremes and monitor, members first."""
        links = self.links.low.reshape(-1, LANES), self.links.high.reshape(-1, LANES)
        arrays = self.coordinates, self.rates, self.boundary_data, *links, self.monitor
        return tuple(np.moveaxis(array, -1, 0) for array in arrays)


def _flat(array: np.ndarray) -> np.ndarray:
    """Return an array (lanes, ...) as (..., lanes), flat."""
    return np.ascontiguousarray(array.reshape(LANES, -1).T).reshape(-1)
