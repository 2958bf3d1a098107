"""Members side by side: their coefficients and starts, and runs with equal steps in lanes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._frame import chord_and_loads
from cablepod.condensed._kernels_layout import (
    MIN_FORCE,
    MIN_FORCE_STEP,
    UNSTABLE_STEP,
    Bounds,
    ExplicitState,
    LeadingTerms,
    Links,
    Record,
    constant_sizes,
    initial_monitor,
)
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._newton import equilibria, leading_forces
from cablepod.condensed._rescale import MemberStates, RescaledCoefficients, rescale_coefficients
from cablepod.condensed._runs import STABLE_PHASE
from cablepod.condensed._stepper import DIVERGENCE_FACTOR, FOURTH_ORDER, damped_step
from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._chord_frame import normals_at_start
from cablepod.discretisation._mass_damping import decay_and_impulse
from cablepod.discretisation._step_limit import largest_frequencies_squared, verlet_step_limit
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._window import steps_within
from cablepod.parameters._parameters import Parameters

if TYPE_CHECKING:
    from cablepod.condensed._batch import CondensedPlan

#: Number of lanes: the numbers of so many members fit in the first cache; a constant of the compiled steps.
LANES = 32
#: Number of steps whose boundary data are computed at once: a multiple of that after which rotations begin anew.
BLOCK = 512


@dataclass(frozen=True)
class MemberCoefficients:
    """Rescaled coefficients of members, and their starts; all arrays have a leading dimension of members."""

    unit: CondensedModel
    parameters: Parameters
    total: np.ndarray  #: unstretched lengths [m]
    rest_tension: np.ndarray  #: means of the tensions of both ends at rest [N]
    reference: np.ndarray  #: first normals at the start (members, dims)
    states: MemberStates
    scaled: RescaledCoefficients

    @classmethod
    def of(cls, plan: CondensedPlan, parameters: Parameters, statics: np.ndarray) -> MemberCoefficients:
        """Rescale the coefficients of a unit cable, for the results of :func:`member_statics`."""
        total = statics[:, 0].copy()
        states = MemberStates.of(plan.unit, parameters, total, plan.end_time)
        scaled = rescale_coefficients(plan.unit, parameters.mass, total, states)
        reference = normals_at_start(parameters.ends[:, 1] - parameters.ends[:, 0])
        return cls(plan.unit, parameters, total, 0.5 * (statics[:, 4] + statics[:, 5]), reference, states, scaled)

    def take(self, part: np.ndarray) -> MemberCoefficients:
        """Return those of some members, by their numbers."""
        scaled = RescaledCoefficients(
            {name: values[part] for name, values in self.scaled.named.items()},
            [basis[part] for basis in self.scaled.bases],
            self.scaled.slope_norms_squared[part],
        )
        numbers = self.total[part], self.rest_tension[part], self.reference[part]
        states = MemberStates(*(values[part] for values in self.states))
        return MemberCoefficients(self.unit, self.parameters.take(part), *numbers, states, scaled)

    @cached_property
    def terms(self) -> LeadingTerms:
        """Coefficients of the forces to leading order, of one lane each."""
        names = "mean_chordwise_forces", "geometric_stiffness", "load_projection"
        coefficients = self.scaled.slope_norms_squared, *(self.scaled.named[name] for name in names)
        return LeadingTerms.of(self.parameters.stiffness, self.total, *coefficients)

    def starts(self, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return coordinates, rates half a `step` before the start (members, r), step limits [s] and H [N] (members,)."""
        parameters, model, start = self.parameters, self.unit, np.zeros(1)
        chain, scaled, size = model.chain, self.scaled, len(model.load_patterns)
        rest = self.rows_at(start, moving=False)[:, 0]
        # first guess: the parabola whose tension is that at rest
        sigma = chain.arc_length / chain.total_length
        sag = parameters.mass * self.total * 0.5 * self.total**2 / self.rest_tension
        parabola = sag[:, None] * (scaled.named["shapes"] @ (chain.tributary_length * sigma * (1.0 - sigma)))
        for k, which in enumerate(model.sets):
            parabola[:, which] *= rest[:, 1 + (1 + k) * size, None]

        def forces(q: np.ndarray, part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return leading_forces(self.terms.take(part), rest[part], q)[:2]

        q, found = equilibria(parabola, forces)
        q[~found] = np.nan
        now = self.rows_at(start, moving=True)[:, 0].copy()
        f, _, chord_tension = leading_forces(self.terms, now, q)
        norms, kappa = scaled.named["geometric_stiffness_norms"], self.terms.kappa
        stiffness = 2.0 * self.terms.sag_stiffness[:, 0]
        limit = verlet_step_limit(np.sqrt(largest_frequencies_squared(kappa, norms, stiffness, q, now, chord_tension)))
        v, speeds = np.zeros_like(q), self.speeds_of_frames
        if speeds is not None:
            v = (speeds[:, None] @ self.terms.load_projection.reshape(*speeds.shape, -1))[:, 0]
        factor, back = decay_and_impulse(parameters.damping, -0.5 * step)
        return q, factor[:, None] * v + back[:, None] * f, limit, chord_tension

    @cached_property
    def speeds_of_frames(self) -> np.ndarray | None:
        """Loads along the normals (members, loads) whose projections are the rates of the coordinates; None without motions.

        At the start the particles are at rest, the chord frame moves: its velocity is projected as its acceleration is.
        """
        p, start = self.parameters, np.zeros(1)
        if not p.motions:
            return None
        rows = self._projected(p.end_positions(start), p.end_positions(start, 1), np.zeros_like(p.load_at(0.0)))
        return rows[:, 0, 1 + len(self.unit.load_patterns) :]

    def rows_at(self, times: np.ndarray, *, moving: bool) -> np.ndarray:
        """Return the boundary data at times [s] (members, times, columns); if not `moving`, of ends at rest."""
        p = self.parameters
        ends, load = p.end_positions(times), p.load_at(0.0)
        if not p.motions:
            return self._projected(ends, None, load)
        accelerations = np.zeros_like(ends)
        if moving:
            # damping acts on the motion of the chord frame too
            accelerations = p.end_positions(times, 2) + p.damping[:, None, None, None] * p.end_positions(times, 1)
        return self._projected(ends, accelerations, load)

    def _projected(self, ends: np.ndarray, accelerations: np.ndarray | None, load: np.ndarray) -> np.ndarray:
        """Return boundary data (members, times, columns) for ends and accelerations (members, times, 2, dims), and loads."""
        count, times, _, dims = ends.shape

        def rows(values: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(values.reshape(count * times, 2 * dims).T)

        loads, mass, reference = (
            np.repeat(array, times, axis=0) for array in (load, self.parameters.mass, self.reference)
        )
        still = np.empty((2 * dims, 0)) if accelerations is None else rows(accelerations)
        return chord_and_loads(rows(ends), still, loads.T, mass, reference).reshape(count, times, -1)


@dataclass(frozen=True)
class LaneResults:
    """Saved states of members with equal steps, and their extremes."""

    instants: OutputTimes
    saved: np.ndarray  #: coordinates at the saved steps (members, steps, r)
    half_step_rates: np.ndarray  #: rates half a step before and after (members, steps, 2, r), or without steps
    saved_boundary_data: np.ndarray  #: boundary data at the saved steps (members, steps, columns)
    low: np.ndarray  #: least tensions (members, links or 0) [N]
    high: np.ndarray  #: largest tensions (members, links or 0) [N]
    least_force: np.ndarray  #: least chordwise forces (members,) [N]
    least_force_step: np.ndarray  #: numbers of their steps (members,)
    completed: np.ndarray  #: whether a member remained stable and bounded (members,)

    @property
    def q(self) -> np.ndarray:
        """Coordinates at the instants of the output (members, times, r)."""
        if not self.instants.needs_interpolation:
            return self._at_output_times(self.saved)
        saved = np.swapaxes(self.saved, 0, 1)
        before, after = (np.swapaxes(self.half_step_rates[:, :, k], 0, 1) for k in (0, 1))
        rates, accelerations = 0.5 * (before + after), (after - before) * self.instants.steps_per_second
        return np.ascontiguousarray(np.swapaxes(self.instants.at_times(saved, rates, accelerations), 0, 1))

    @property
    def boundary_data(self) -> np.ndarray | None:
        """Boundary data at the instants of the output (members, times, columns); None where these lie between steps."""
        return None if self.instants.needs_interpolation else self._at_output_times(self.saved_boundary_data)

    def _at_output_times(self, saved: np.ndarray) -> np.ndarray:
        """Return what is saved at the instants of the output, all of which are steps."""
        left = self.instants.left
        return saved if np.array_equal(left, np.arange(saved.shape[1])) else saved.take(left, axis=1)

    def only(self, times: np.ndarray) -> LaneResults:
        """Return the results with some of the instants of the output [s]."""
        return replace(self, instants=self.instants.only(times))


class Lanes:
    """Members, LANES at most, for the explicit steps; :meth:`advance` runs them with equal steps.

    Parameters
    ----------
    plan
        Request of the batch.
    members
        Parameters and coefficients.
    """

    def __init__(self, plan: CondensedPlan, members: MemberCoefficients) -> None:
        self.plan, self.count = plan, len(members.total)
        self.numbers = np.minimum(np.arange(LANES), self.count - 1)  #: of the member in each lane; the last one repeats
        members = members if self.count == LANES else members.take(self.numbers)
        p, named, unit = members.parameters, members.scaled.named, members.unit
        patterns = len(unit.load_patterns)
        self.unit, self.damping, self.columns = unit, p.damping, 1 + patterns * p.dims
        self.sizes = constant_sizes(sum(unit.ranks), patterns, patterns * (p.dims - 1), LANES)
        self.terms = LeadingTerms(*(_flat(array) for array in members.terms))
        candidates = _flat(np.swapaxes(named["chordwise_forces_at_candidates"], 1, 2))
        norms = _flat(named["geometric_stiffness_norms"])
        self.bounds = Bounds(norms, candidates.reshape(-1, patterns * LANES), np.empty(LANES))
        chosen = slice(None) if plan.links is None else plan.links
        if "tension_extremes" not in plan.outputs:
            chosen = slice(0)
        tables = (named["slopes"], named["chordwise_force_patterns"])
        #: slopes and chordwise force patterns of the links (r or patterns, links lanes)
        self.tables = tuple(_flat(table[:, :, chosen]).reshape(table.shape[1], -1) for table in tables)
        mass = p.mass * members.total * unit.chain.tributary_length.sum()
        self.bound = DIVERGENCE_FACTOR * np.sqrt(mass) * members.total  #: of coordinates
        self._prepare_ends(members)

    def _prepare_ends(self, members: MemberCoefficients) -> None:
        """Prepare the arguments of the kernel of the boundary data, see there."""
        from cablepod.parameters._kernels_sines import MOTION_ROWS, TURN_ROWS  # numba is imported only to compute

        p, dims = members.parameters, members.parameters.dims
        ends = p.ends.reshape(LANES, 2 * dims).T.copy()
        moved = [dims * ENDS.index(end) + COORDINATES.index(axis) for end, axis in p.motions]
        motions = np.empty((len(moved), MOTION_ROWS, LANES))
        for row, motion, values in zip(moved, p.motions.values(), motions, strict=True):
            numbers = *motion.sine, ends[row], p.damping, motion.ramp
            values[:] = [np.broadcast_to(np.ravel(number), LANES) for number in numbers]
        work = (
            np.empty((len(moved), TURN_ROWS, LANES)), np.empty((len(moved), 2, 4, LANES)), np.empty((9, LANES)),
        )  # fmt: skip
        reference = None if dims == 2 else members.reference.T.copy()
        self.of_ends = np.array(moved, dtype=np.int64), motions, work
        self.of_frames = ends, np.zeros_like(ends), p.load_at(0.0).T.copy(), p.mass, reference
        self.rows = np.empty((BLOCK + 1, self.columns * LANES))  #: boundary data of a block of steps

    def advance(self, instants: OutputTimes, q: np.ndarray, v: np.ndarray, *, extremes: bool) -> LaneResults:
        """Run the members with the steps of `instants`.

        `q` and `v` are coordinates and rates at the start, the latter half a step before for velocity Verlet; `extremes` tells
        whether extremes of tensions are kept.  Velocity Verlet keeps no rates.
        """
        from cablepod.condensed import _kernels_explicit as kernel  # numba is imported only to compute

        rate, saved, r, scheme = instants.steps_per_second, instants.steps, q.shape[1], self.plan.scheme
        is_verlet, total = scheme != FOURTH_ORDER, int(saved[-1])
        start = _flat(q[self.numbers]), _flat(v[self.numbers])
        state = ExplicitState.of(*start, np.zeros(r * LANES), LANES)
        damped = damped_step(np.tile(self.damping, r), 1.0 / rate, scheme)
        monitor = np.repeat(initial_monitor((STABLE_PHASE[scheme] * rate) ** 2, 0.0)[:, None], LANES, axis=1)
        slopes, patterns = self.tables
        size, none = slopes.shape[1] if extremes else 0, np.empty(0)
        low, high = np.full(size, np.inf), np.full(size, -np.inf)
        links = Links(slopes, self.unit.n_in_plane, patterns, low, high) if size else None
        outside = None if links is None else links._replace(low=none, high=none)  # of the window
        coordinates, boundary_data = np.empty((LANES, saved.size, r)), np.empty((LANES, saved.size, self.columns))
        rates = np.empty((LANES, 0 if is_verlet else saved.size, 2, r))
        for begin, end, counts in self._blocks(total, rate):
            steps = end - begin - is_verlet
            rows = self._boundary_data(begin, steps if begin else max(steps, min(2, total)), rate)
            record = Record.at(begin, saved, coordinates, rates)
            kept = slice(record.first, int(np.searchsorted(saved, begin + len(rows))))
            of_steps = rows[saved[kept] - begin].reshape(-1, self.columns, LANES)
            boundary_data[:, kept] = of_steps.transpose(2, 0, 1)
            shared = self.sizes, self.terms, self.bounds, links if counts else outside, damped
            outputs = state, begin, record, monitor.reshape(-1)
            if is_verlet:
                kernel.verlet(*shared, None, None, rows, end - begin, *outputs)
            else:
                kernel.numerov(*shared, rows, end - begin, *outputs)
        completed = (np.abs(state.q.reshape(r, LANES)) < self.bound).all(axis=0) & np.isinf(monitor[UNSTABLE_STEP])
        extremes_of_links = (array.reshape(-1, LANES).T for array in (low, high))
        of_members = *extremes_of_links, *monitor[[MIN_FORCE, MIN_FORCE_STEP]], completed
        results = coordinates, rates, boundary_data, *of_members
        return LaneResults(instants, *(array[: self.count] for array in results))

    def _blocks(self, total: int, rate: float) -> Iterator[tuple[int, int, bool]]:
        """Yield begin and end of blocks of steps, and whether their extremes count: they end at the borders of the window.

        Numerov's method takes `end - begin` steps; velocity Verlet takes one for each row of the boundary data, also the last.
        """
        is_verlet, window = self.plan.scheme != FOURTH_ORDER, self.plan.window
        first, last = (0, total) if window is None else steps_within(window, rate)
        starts = sorted({*range(0, total + 1, BLOCK), first, min(last, total) + is_verlet})
        for begin, end in zip(starts, [*starts[1:], total + is_verlet], strict=True):
            if end > begin or (begin == 0 and not is_verlet):
                yield begin, end, first <= begin and end - is_verlet <= last

    def _boundary_data(self, begin: int, steps: int, rate: float) -> np.ndarray:
        """Return the boundary data of the steps `begin` ... `begin + steps` (steps + 1, columns lanes)."""
        from cablepod.condensed import _kernels_frame as kernel

        before = begin % BLOCK  # rotations start at whole blocks
        rows = self.rows[: before + steps + 1]
        kernel.boundary_data_of_lanes(
            self.sizes.lanes, self.sizes.patterns, begin - before, before + steps, rate, *self.of_ends, *self.of_frames, rows,
        )  # fmt: skip
        return rows[before:]


def _flat(array: np.ndarray) -> np.ndarray:
    """Return an array (lanes, ...) as (..., lanes), flat."""
    return np.ascontiguousarray(array.reshape(LANES, -1).T).reshape(-1)
