"""Runs by an implicit scheme in lanes: arrays of their numbers, laid out for the kernels that advance them.

A run alone is one lane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.chain._kernels_arguments import Chain, Lanes, Newton, RateTerms, Record, Sizes, State, Tables
from cablepod.integrate._march import BLOCK

if TYPE_CHECKING:
    from cablepod.chain._implicit import ImplicitStepper

#: Number of lanes of members, a constant of the compiled steps.
LANES = 16
#: Smallest number of members in lanes, and smallest part of them that still run: fewer members are faster alone.
MIN_MEMBERS, MIN_PART = 6, 0.5
#: Instants at which the speeds of the ends are compared.
INSTANTS = 64
#: Rounding error of a correction over the coordinates: its maximum, in stiff chains, and its usual size.
ROUNDING, MIN_ROUNDING = 64.0 * float(np.finfo(float).eps), 8.0 * float(np.finfo(float).eps)
#: With drag, whose tangent leaves out the direction of the cable: tolerance of what remains over that of the last correction.
REMAINDER = 1e-3
#: The same with damping by ratios, whose tangent is an approximation: what remains acts against the motion in every step.
MODAL_REMAINDER = 1e-6


def groups_of_lanes(steppers: Sequence[ImplicitStepper]) -> list[list[int]]:
    """Return the places of the runs of each group of lanes: of similar speeds of the ends, which need as many iterations."""
    if len(steppers) < MIN_MEMBERS:
        return []
    time = np.linspace(0.0, float(steppers[0].run.times[-1]), INSTANTS)
    speeds = [np.abs(stepper.run.chain.p.end_positions(time, 1)).max() for stepper in steppers]
    order = np.argsort(speeds, kind="stable")
    return [places.tolist() for places in np.array_split(order, -(-order.size // LANES))]


class Kernel:
    """Arguments of the kernels for runs of equal shape, the last of them repeated up to the number of lanes."""

    def __init__(self, steppers: Sequence[ImplicitStepper], lanes: int) -> None:
        self._steppers, self._lanes = [*steppers, *[steppers[-1]] * (lanes - len(steppers))], lanes
        self._run, first = steppers[0].run, steppers[0]
        chain, p = self._run.chain, self._run.chain.p
        dims, links, none = p.dims, chain.links, np.empty(0)
        self._sizes = Sizes((0,) * lanes, (0,) * dims)

        def of_links(name: str) -> np.ndarray:
            if getattr(p, name) is None:
                return none
            return self._flat(lambda one: np.full(links, getattr(one.run.chain.p, name)))

        k, viscosity = self._flat(lambda one: one.run.chain.k), of_links("link_viscosity")
        mass = self._flat(lambda one: np.tile(one.mass, dims))
        varying, size = len(first.varying), dims * (links + 1)
        self._chain = Chain(
            first=chain.free_particles.start,
            last=chain.free_particles.stop,
            k=k,
            length=self._flat(lambda one: one.run.chain.length),
            inverse_squares=none
            if chain.inverse_squares is None
            else self._flat(lambda one: one.run.chain.inverse_squares),
            viscosity=viscosity * k if viscosity.size else none,
            tension_damping=of_links("tension_damping"),
            per_length=self._flat(lambda one: np.tile(np.append(1.0 / one.run.chain.length, 0.0), dims)),
            mass=mass,
            damped_mass=none
            if p.mass_damping is None
            else mass * self._flat(lambda one: np.full(size, one.run.chain.p.mass_damping)),
            loads=self._flat(lambda one: one.loads),
            patterns=self._flat(lambda one: one.patterns).reshape(varying, -1) if varying else none.reshape(0, 0),
        )
        self._terms = _rate_terms(first)
        self._newton = Newton.of(dims, links, lanes)
        self._bound = self._flat(lambda one: one.run.divergence_bound)

    @property
    def _has_rates(self) -> bool:
        """Whether forces depend on velocities, beside damping by mass."""
        return self._terms is not None or bool(self._chain.viscosity.size or self._chain.tension_damping.size)

    def _flat(self, values: Callable[[ImplicitStepper], Any]) -> np.ndarray:
        """Lay out an array of each run in lanes, flat."""
        return self._stacked(values).reshape(-1)

    def _stacked(self, values: Callable[[ImplicitStepper], Any]) -> np.ndarray:
        """Lay out an array of each run in lanes."""
        if self._lanes == 1:
            return np.asarray(values(self._steppers[0]), dtype=float)[..., None]
        return np.stack([values(stepper) for stepper in self._steppers], axis=-1, dtype=float)

    def tables(self, time: np.ndarray) -> Tables:
        """Return what changes from step to step, at instants [s]."""
        run, moving = self._run, self._run.moving
        none = np.empty((0, run.chain.p.dims, self._lanes))
        ends = self._stacked(lambda one: one.run.chain.p.end_positions(time)) if moving else None
        is_conserving = run.method == "energy_momentum"
        factors, end_rates, places = none, none[:, None], np.empty(0)
        if self._steppers[0].varying:
            factors = self._stacked(lambda one: np.stack([factor(time) for _, factor in one.varying], axis=1))
        if self._has_rates and not is_conserving:
            end_rates = self._stacked(lambda one: one.run.chain.p.end_positions(time, 1))
        if run.air is not None:
            places = (0.5 * (time[1:] + time[:-1]) if is_conserving else time) * run.air.samples_per_second
        return Tables(
            factors,
            none if ends is None or "lower" not in moving else np.ascontiguousarray(ends[:, 0]),
            none if ends is None or "upper" not in moving else np.ascontiguousarray(ends[:, 1]),
            end_rates,
            places,
        )

    def advance(
        self,
        time: np.ndarray,
        step: float,
        tables: Tables,
        state: State,
        rotation: np.ndarray,
        is_running: np.ndarray,
        failed: np.ndarray,
        iterations: np.ndarray,
        record: Record,
    ) -> int:
        """Call the kernel for steps at the instants `time`; returns the number of steps done.

        `rotation` is that of the links by rounding errors over their relative size (lanes,).
        """
        from cablepod.chain import _kernels_implicit as kernel  # numba is imported only here

        run, newton, modal = self._run, self._newton, self._steppers[0].modal
        alpha_m, alpha_f, beta, gamma = run.parameters
        remainder = REMAINDER if run.air is not None or modal.matrix.size else 0.0
        if run.method == "energy_momentum":
            inertia, rate, more = 2.0 / (step * step), 1.0 / step, 2.0 * modal.half_ratio / (step * step)
            tolerance = MIN_ROUNDING * rotation
        else:
            rate = gamma / (beta * step)
            inertia = (1.0 - alpha_m) / (1.0 - alpha_f) / (beta * step * step)
            more = modal.half_ratio * rate * rate
            own = np.array([stepper.rotation_tolerance for stepper in self._steppers])
            tolerance = np.maximum(own, ROUNDING * rotation)
            remainder = MODAL_REMAINDER if modal.matrix.size else remainder
        mass, damped = self._chain.mass, self._chain.damped_mass
        newton.diagonal[:] = inertia * mass + (rate * damped if damped.size else 0.0)
        newton.solved[:] = (newton.diagonal + more * mass)[: newton.solved.size]
        newton.start_blocks(len(self._sizes.dims))
        marks = Lanes(is_running, failed, iterations, tolerance, ROUNDING * rotation, remainder, self._bound)
        numbers = step, alpha_m, alpha_f, beta, gamma
        conserving = True if run.method == "energy_momentum" else None
        arguments = self._sizes, self._chain, self._terms, tables, time.size - 1, numbers, state, marks, record, newton
        done: int = kernel.implicit(*arguments, conserving)
        return done


def _rate_terms(stepper: ImplicitStepper) -> RateTerms | None:
    """Return the forces on particles of a run that depend on velocities, None without any."""
    attached, none = stepper.run.attached, np.empty(0)
    air: Any = stepper.run.air
    if attached is None and air is None and not stepper.modal.matrix.size:
        return None
    return RateTerms(
        stepper.modal,
        np.empty(0, dtype=np.int64) if attached is None else attached.particles,
        np.empty((0, 0)) if attached is None else attached.numbers,
        np.empty((0, 0, 0)) if air is None else air.velocity,
        none if air is None else air.drags,
        none if air is None or air.bodies is None else air.bodies,
    )


class ImplicitLanes:
    """Runs of equal :attr:`cablepod.chain._implicit.ImplicitChainRun.shape` and step, advanced together in lanes.

    A step in which Newton's method fails in some lanes is cut in these alone.
    """

    def __init__(self, steppers: Sequence[ImplicitStepper]) -> None:
        first, count = steppers[0], len(steppers)
        self._steppers, self.instants, self._run = steppers, first.instants, first.run
        self._kernel = Kernel(steppers, LANES)
        self._running, self._failed = np.arange(LANES) < count, np.zeros(LANES, dtype=bool)
        self.is_finite = self._running[:count]  #: False for runs that are left to a single run (runs,)
        self.total, self._step = int(first.instants.steps[-1]), 1.0 / first.instants.steps_per_second
        self.work = 25 * count * first.run.chain.links  #: of a step, in explicit steps of one link
        self._saved = np.empty((count, first.instants.steps.size, first.variables, first.x.size))
        for stepper, saved in zip(steppers, self._saved, strict=True):
            stepper.saved = saved.reshape(*saved.shape[:2], *first.x.shape)
        self._states = np.empty((6, first.x.size, LANES))
        for m in range(LANES):
            self._put(m, steppers[min(m, count - 1)])
        links = 0 if first.extremes is None else first.run.chain.links
        self._low, self._high = np.full((links, LANES), np.inf), np.full((links, LANES), -np.inf)
        self._iterations, self._rotation = np.zeros(LANES, dtype=np.int64), np.zeros(LANES)

    def _put(self, m: int, stepper: ImplicitStepper) -> None:
        """Set a lane to the state of a run, from which the prediction starts anew."""
        for state, row in zip(self._states, stepper.start(self._step), strict=False):
            state[:, m] = row

    def stepper(self, place: int) -> ImplicitStepper:
        """Return a run with the state of its lane."""
        stepper = self._steppers[place]
        for target, state in zip(stepper.state, self._states, strict=False):
            target[:] = state[:, place].reshape(target.shape)
        stepper.iterations += int(self._iterations[place])
        self._iterations[place] = 0
        if stepper.extremes is not None:
            np.minimum(stepper.extremes[0], self._low[:, place], out=stepper.extremes[0])
            np.maximum(stepper.extremes[1], self._high[:, place], out=stepper.extremes[1])
        return stepper

    def advance(self, start: int, steps: int) -> np.ndarray:
        """Take `steps` steps from number `start` on; returns which runs are still finite (runs,)."""
        if start % BLOCK == 0 and start:  # single runs predict anew here
            for m in range(len(self._steppers)):
                self._put(m, self.stepper(m))
        time = np.arange(start, start + steps + 1) / self.instants.steps_per_second
        tables = self._kernel.tables(time)
        for m in range(LANES):
            self._rotation[m] = self._rotation_of(min(m, len(self._steppers) - 1), tables)
        done = 0
        while done < steps and self._running.any():
            done += self._call(start + done, time[done:], Tables(*(table[done:] for table in tables)))
            for m in np.flatnonzero(self._failed & self._running).tolist():
                self._cut(m, start + done - 1)
                self._rotation[m] = self._rotation_of(m, tables)
            if self._running.sum() < MIN_PART * len(self._steppers):
                self._running[:] = False
        return self.is_finite

    def _call(self, start: int, time: np.ndarray, tables: Tables) -> int:
        """Call the kernel; returns the number of steps done."""
        steps = self.instants.steps
        first, last = np.searchsorted(steps, (start, start + time.size - 1))
        record = Record(
            start, steps[first:last], int(first), self._saved, self._low.reshape(-1), self._high.reshape(-1)
        )
        state = State(*self._states.reshape(6, -1))
        marks = self._running, self._failed, self._iterations
        return self._kernel.advance(time, self._step, tables, state, self._rotation, *marks, record)

    def _rotation_of(self, m: int, tables: Tables) -> float:
        stepper = self._steppers[m]
        ends = [table[..., m] for table in (tables.lower, tables.upper) if table.size]
        stepper.x[:] = self._states[0, :, m].reshape(stepper.x.shape)
        return stepper.rotation_by_rounding(ends)

    def _cut(self, m: int, number: int) -> None:
        """Take step `number` of a run in substeps, as a single run does; a run that fails is taken out of its lane."""
        stepper = self.stepper(m)
        if stepper.substep(number) and stepper.is_finite():
            self._put(m, stepper)
        else:
            self._running[m] = False
