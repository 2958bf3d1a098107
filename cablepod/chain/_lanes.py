"""Members of a batch by an implicit scheme, in lanes: arrays of their numbers, laid out for the kernel that advances them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cablepod.chain._implicit import MIN_ROUNDING, ROUNDING, ImplicitStepper
from cablepod.integrate._march import BLOCK

#: Largest number of lanes.
LANES = 32
#: The number of lanes is a multiple of that of double-precision numbers in the longest vector registers.
VECTOR = 8
#: Smallest number of members in lanes, and smallest part of the lanes in use: fewer members are faster alone.
MIN_MEMBERS, MIN_PART = 5, 0.25
#: Instants at which the speeds of the ends are compared.
INSTANTS = 64


def groups_of_lanes(steppers: Sequence[ImplicitStepper]) -> list[list[int]]:
    """Return the places of the runs of each group of lanes: of similar speeds of the ends, which need as many iterations."""
    if len(steppers) < MIN_MEMBERS or steppers[0].run.chain.p.tension_damping is not None:
        return []
    time = np.linspace(0.0, float(steppers[0].run.times[-1]), INSTANTS)
    speeds = [np.abs(stepper.run.chain.p.end_positions(time, 1)).max() for stepper in steppers]
    order = np.argsort(speeds, kind="stable")
    return [places.tolist() for places in np.array_split(order, -(-order.size // LANES))]


class ImplicitLanes:
    """Runs of equal :attr:`cablepod.chain._implicit.ImplicitChainRun.shape` and step, advanced together in lanes.

    The last lanes may repeat the last run.  A step in which Newton's method fails in some lanes is cut in these alone.
    """

    def __init__(self, steppers: Sequence[ImplicitStepper]) -> None:
        first, padding = steppers[0], -len(steppers) % VECTOR
        self._steppers, self.instants, self._run = steppers, first.instants, first.run
        count, chain, p = len(steppers), first.run.chain, first.run.chain.p
        lanes = count + padding
        self._running, self._failed = np.arange(lanes) < count, np.zeros(lanes, dtype=bool)
        self.is_finite = self._running[:count]  #: False for runs that are left to a single run (runs,)
        self.total, self._step = int(first.instants.steps[-1]), 1.0 / first.instants.steps_per_second
        self.work = 25 * count * chain.links  #: of a step, in explicit steps of one link
        self._saved = np.empty((count, first.instants.steps.size, first.variables, *first.x.shape))
        for stepper, saved in zip(steppers, self._saved, strict=True):
            stepper.saved = saved
        self._states = np.empty((3 if self._is_conserving else 6, first.x.size, lanes))
        for m, stepper in enumerate([*steppers, *[steppers[-1]] * padding]):
            self._put(m, stepper)
        dims, held = p.dims, (chain.free_particles.start, chain.free_particles.stop)
        self._links = (
            *held,
            self._stack(lambda one: one.run.chain.k),
            self._stack(lambda one: one.run.chain.length),
            self._stack(lambda one: one.run.chain.inverse_squares) if chain.inverse_squares is not None else None,
            self._stack(lambda one: np.tile(one.mass, dims)),
            None if p.mass_damping is None else self._stack(lambda one: np.full(one.x.size, one.run.chain.p.mass_damping)),
            self._stack(lambda one: one.loads.ravel()),
            self._stack(lambda one: np.reshape(np.asarray(one.patterns), (len(one.varying), -1))) if first.varying else None,
        )  # fmt: skip
        self._viscosity = (
            None if p.link_viscosity is None else self._stack(lambda one: np.array(one.run.chain.p.link_viscosity))
        )
        self._bound = self._stack(lambda one: np.array(one.run.divergence_bound))
        self._extremes = None if first.extremes is None else tuple(
            np.full((chain.links, lanes), value) for value in (np.inf, -np.inf)
        )  # fmt: skip
        self._iterations, self._rotation = np.zeros(lanes, dtype=np.int64), np.zeros(lanes)

    @property
    def _is_conserving(self) -> bool:
        return self._run.method == "energy_momentum"

    def _stack(self, values: Callable[[ImplicitStepper], Any]) -> np.ndarray:
        """Lay out an array of each run in lanes."""
        rows = [values(stepper) for stepper in self._steppers]
        return np.stack([*rows, *rows[-1:] * (self._running.size - len(rows))], axis=-1, dtype=float)

    def _put(self, m: int, stepper: ImplicitStepper) -> None:
        """Set a lane to the state of a run, from which the prediction starts anew."""
        rows = [stepper.x, stepper.v]
        if self._is_conserving:
            rows += [self._step * stepper.v]
        else:
            rows += [stepper.a, stepper.force, stepper.a, stepper.a]
        for state, row in zip(self._states, rows, strict=True):
            state[:, m] = row.ravel()

    def stepper(self, place: int) -> ImplicitStepper:
        """Return a run with the state of its lane."""
        stepper = self._steppers[place]
        targets = (stepper.x, stepper.v) if self._is_conserving else (stepper.x, stepper.v, stepper.a, stepper.force)
        for target, state in zip(targets, self._states, strict=False):
            target[:] = state[:, place].reshape(target.shape)
        stepper.iterations += int(self._iterations[place])
        self._iterations[place] = 0
        if self._extremes is not None and stepper.extremes is not None:
            np.minimum(stepper.extremes[0], self._extremes[0][:, place], out=stepper.extremes[0])
            np.maximum(stepper.extremes[1], self._extremes[1][:, place], out=stepper.extremes[1])
        return stepper

    def advance(self, start: int, steps: int) -> np.ndarray:
        """Take `steps` steps from number `start` on; returns which runs are still finite (runs,)."""
        if start % BLOCK == 0 and start:  # single runs predict anew here
            for m in range(len(self._steppers)):
                self._put(m, self.stepper(m))
        time = np.arange(start, start + steps + 1) / self.instants.steps_per_second
        tables = self._tables(time)
        for m, stepper in enumerate(self._steppers):
            self._rotation[m] = self._rotation_of(m, stepper, tables)
        self._rotation[len(self._steppers) :] = self._rotation[len(self._steppers) - 1]
        done = 0
        while done < steps and self._running.any():
            done += self._kernel(
                start + done, steps - done, [None if table is None else table[done:] for table in tables]
            )
            for m in np.flatnonzero(self._failed & self._running).tolist():
                self._cut(m, start + done - 1)
                self._rotation[m] = self._rotation_of(m, self._steppers[m], tables)
            if self._running.sum() < MIN_PART * self._running.size:
                self._running[:] = False
        return self.is_finite

    def _tables(self, time: np.ndarray) -> list[np.ndarray | None]:
        """Return factors of loads, positions of both ends, and their velocities, at instants [s]; None for those not needed."""
        moving, viscous = self._run.moving, self._viscosity is not None
        ends = self._stack(lambda one: one.run.chain.p.end_positions(time)) if moving else None
        return [
            self._stack(lambda one: np.stack([factor(time) for _, factor in one.varying], axis=1))
            if self._steppers[0].varying
            else None,
            None if ends is None or "lower" not in moving else np.ascontiguousarray(ends[:, 0]),
            None if ends is None or "upper" not in moving else np.ascontiguousarray(ends[:, 1]),
            self._stack(lambda one: one.run.chain.p.end_positions(time, 1)) if viscous else None,
        ]

    def _rotation_of(self, m: int, stepper: ImplicitStepper, tables: list[np.ndarray | None]) -> float:
        ends = [table[..., m] for table in tables[1:3] if table is not None]
        stepper.x[:] = self._states[0, :, m].reshape(stepper.x.shape)
        return stepper.rotation_by_rounding(np.concatenate(ends) if ends else None)

    def _cut(self, m: int, number: int) -> None:
        """Take step `number` of a run in substeps, as a single run does; a run that fails is taken out of its lane."""
        stepper = self.stepper(m)
        if stepper.substep(number) and stepper.is_finite():
            self._put(m, stepper)
        else:
            self._running[m] = False

    def _kernel(self, start: int, steps: int, tables: list[np.ndarray | None]) -> int:
        """Call the kernel; returns the number of steps done."""
        from cablepod.chain import _kernels_lane_steps as kernel  # numba is imported only to compute

        factors, lower, upper, rates = tables
        first, last = np.searchsorted(self.instants.steps, (start, start + steps))
        low, high = self._extremes or (None, None)
        links = (self._running, self._failed, self._states, *self._links, factors, self._viscosity, lower, upper)
        end = (
            self._bound, start, steps, self.instants.steps[first:last], self._saved[:, first:last], low, high,
            self._iterations,
        )  # fmt: skip
        if self._is_conserving:
            return kernel.conserving_lanes(
                *links, self._step, MIN_ROUNDING * self._rotation, ROUNDING * self._rotation, *end
            )
        tolerance = self._stack(lambda one: np.array(one.rotation_tolerance))
        return kernel.alpha_lanes(
            *links, rates, self._step, *self._run.parameters, np.maximum(tolerance, ROUNDING * self._rotation), *end
        )
