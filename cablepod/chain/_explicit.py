"""Explicit runs of the chain: velocity Verlet in leapfrog form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from cablepod.chain import _kernels_layout as layout
from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._mass_damping import decay_and_impulse, half_step_back
from cablepod.errors import RunStopped
from cablepod.integrate._chain_run import ChainRun, Trajectory
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._output import Extremes
from cablepod.integrate._output_times import OutputTimes

if TYPE_CHECKING:
    from cablepod.chain._air import ChainAir
    from cablepod.parameters._parameters import Parameters
    from cablepod.parameters._time_functions import TimeFunction


class ExplicitChainRun(ChainRun):
    """Velocity Verlet: second order, symplectic without damping, stable below 2 over the highest angular frequency."""

    @property
    def scheme(self) -> str:
        """Name of the scheme."""
        return "velocity_verlet"

    @property
    def unforced_step(self) -> float:
        """Step of the first run without regard to motions, loads and wind [s]."""
        chain = self.chain
        if not chain.green:
            return 0.9 * self.step_limit
        # with a margin for waves beyond the stretch that the ends enforce in the run
        enforced = np.maximum(chain.tangent_stiffness_ratio(self.initial), chain.largest_enforced_ratio(self.end_time))
        return min(0.8 * chain.step_limit(enforced), 0.9 * self.step_limit)

    def __call__(self, steps_per_second: float) -> Trajectory:
        """Run with a number of steps per second."""
        stepper = ExplicitStepper([self.begin(steps_per_second)])
        low, high = (stepper.states[0, row, : self.chain.links] for row in (layout.LOW, layout.HIGH))
        watch = self.watch(steps_per_second, stepper.total, (low, high) if "tension_extremes" in self.outputs else None)

        def advance(start: int, steps: int) -> bool:
            return bool(stepper.advance(start, steps)[0])

        failed = advance_in_blocks(advance, (stepper.states,), stepper.total, self.progress, watch)
        if failed is not None:
            half_velocities = None if stepper.half_velocities is None else stepper.half_velocities[0]
            self._stop(stepper.instants, stepper.saved[0], half_velocities, failed, steps_per_second)
        times = None if watch is None else watch.finish(advance, (stepper.states,), steps_per_second)
        return replace(self.finish(stepper, 0), peak_times=times)

    def begin(self, steps_per_second: float) -> PreparedRun:
        """Prepare a run with a number of steps per second."""
        return PreparedRun(self, self.instants(steps_per_second), *self._first_state(1.0 / steps_per_second))

    @staticmethod
    def groups(prepared: Sequence[PreparedRun]) -> list[list[int]]:
        """Return the places of runs of equal shape that are advanced together: all."""
        return [list(range(len(prepared)))]

    @staticmethod
    def together(prepared: Sequence[PreparedRun]) -> ExplicitStepper:
        """Return what advances runs of equal shape together."""
        return ExplicitStepper(prepared)

    def finish(self, stepper: ExplicitStepper, place: int) -> Trajectory:
        """Return the trajectory of this run, number `place` of a stepper, after its last step.

        Raises
        ------
        RunStopped
            If the links hold excessive strain energy, or became too stiff for the step.
        """
        links = slice(self.chain.links)
        low, high = (_root(stepper.states[place, row, links]) for row in (layout.LOW, layout.HIGH))
        result = self._gather(
            stepper.instants,
            stepper.saved[place],
            None if stepper.half_velocities is None else stepper.half_velocities[place],
            (low, high) if "tension_extremes" in self.outputs else None,
        )
        self._check_limit(result)
        return self.check_energy(result)

    @property
    def shape(self) -> tuple[Any, ...]:
        """Key of runs that can be advanced in one kernel call, see :class:`ExplicitStepper`."""
        chain, p = self.chain, self.chain.p
        damping = (p.mass_damping is None, p.link_viscosity is None, p.tension_damping is None)
        attached = None if self.attached is None else self.attached.particles.size
        terms = (damping, attached, len(chain.time_dependent_loads()), tuple(p.motions))
        return chain.links, p.dims, chain.law, terms, self.outputs, self.times.tobytes()

    def _first_state(self, step: float) -> tuple[np.ndarray, float, np.ndarray | None]:
        """Return the kernel state at the start from rest, the damping factor, and the patterns of time-dependent loads."""
        from cablepod.chain import _kernels_explicit as kernel_explicit

        chain, p, free = self.chain, self.chain.p, self.chain.free_particles
        state = kernel_explicit.new_states(1, chain.links)[0]
        links, particles = slice(chain.links), slice(chain.links + 1)
        mass = chain.mass[free]
        damping_factor, impulse = decay_and_impulse(p.mass_damping or 0.0, step)
        back = half_step_back(p.mass_damping or 0.0, step)[1]
        state[layout.PER_MASS, free] = impulse / mass
        per_mass = state[layout.PER_MASS, particles]
        varying = chain.time_dependent_loads()
        force, loads = self.first_force(), chain.loads()
        for c in range(p.dims):
            state[layout.X + c, particles] = self.initial[:, c]
            state[layout.VX + c, free] = back * force[free, c] / mass
            state[(layout.STEADY_X if varying else layout.LOAD_X) + c, particles] = per_mass * loads[:, c]
            if self.air is not None:
                state[layout.BASE_X + c, particles] = per_mass * loads[:, c]
            # with viscosity the predicted velocity, 1.5 v - 0.5 v_before, is then 0 at the start
            state[layout.BX + c] = 3.0 * state[layout.VX + c]
        state[layout.DRAG_PER_MASS, particles] = per_mass * (1.0 if chain.drag_ratio is None else chain.drag_ratio)
        state[layout.STIFFNESS, links], state[layout.LENGTH, links] = chain.k, chain.length
        if chain.inverse_squares is not None:
            state[layout.INVERSE, links] = chain.inverse_squares
        state[layout.LOW], state[layout.HIGH] = np.inf, -np.inf
        patterns = (
            np.array([np.ascontiguousarray((per_mass[:, None] * load).T) for load, _ in varying]) if varying else None
        )
        return state, damping_factor, patterns

    def _gather(
        self, instants: OutputTimes, saved: np.ndarray, half_velocities: np.ndarray | None, extremes: Extremes
    ) -> Trajectory:
        """Make a trajectory of saved positions and half-step velocities."""
        x = np.ascontiguousarray(np.moveaxis(saved, 1, 2))
        v = a = None
        if half_velocities is not None:
            v = np.ascontiguousarray(np.moveaxis(0.5 * (half_velocities[:, 0] + half_velocities[:, 1]), 1, 2))
            a = np.ascontiguousarray(
                np.moveaxis((half_velocities[:, 1] - half_velocities[:, 0]) * instants.steps_per_second, 1, 2)
            )
        state = self.state(instants, x, v, a, extremes)
        state.diagnostics = {"step_limit": self.step_limit}
        return state

    def _check_limit(self, state: Trajectory, *, incomplete: int | None = None) -> None:
        """Raise ``RunStopped`` if the links became too stiff for the step, which happens by law (21) only."""
        chain, steps_per_second = self.chain, state.instants.steps_per_second
        if not chain.green:
            return
        step = 1.0 / steps_per_second
        stiffness_ratios = chain.tangent_stiffness_ratio(state.position)
        if chain.step_limit(stiffness_ratios.max(axis=0)) > step:
            return  # stable even with every link at its stiffest
        for time, ratios in zip(state.instants.times, stiffness_ratios, strict=True):
            limit = chain.step_limit(ratios)
            if limit <= step:
                why = (
                    f"the chain stiffened: at {time:.6g} s its stability limit is {limit:.6g} s, below the step "
                    f"{step:.6g} s (velocity Verlet, law {chain.law}); try a shorter step"
                )
                if incomplete is None:
                    raise RunStopped(why, self.dataset(self.at_output_times(state)))
                self.stop(self.dataset(state), incomplete / steps_per_second, why)

    def _stop(
        self,
        instants: OutputTimes,
        saved: np.ndarray,
        half_velocities: np.ndarray | None,
        done: int,
        steps_per_second: float,
    ) -> None:
        """Raise :class:`cablepod.errors.RunStopped` with the trajectory before step `done`."""
        time = done / steps_per_second
        before, partial = instants.before_time(time), None
        if before is not None:
            rows = np.searchsorted(instants.steps, before.steps)
            partial = self._gather(
                before, saved[rows], None if half_velocities is None else half_velocities[rows], None
            )
            self._check_limit(partial, incomplete=done)  # names stiffening as the reason, if an output time shows it
        why = (
            f"the chain left the finite numbers at {time:.6g} s (velocity Verlet, step "
            f"{1 / steps_per_second:.4g} s, step number {done}, stability limit {self.step_limit:.4g} s); try scheme "
            "energy_momentum, a step half as long, gentler loads or motion, or damping"
        )
        self.stop(None if partial is None else self.dataset(partial), time, why)


@dataclass(frozen=True)
class PreparedRun:
    """A run with the kernel state of its start."""

    run: ExplicitChainRun
    instants: OutputTimes
    state: np.ndarray  #: rows of :mod:`cablepod.chain._kernels_layout` (ROWS, columns)
    damping_factor: float  #: factor of the velocity by mass damping in a step, 1 without
    patterns: np.ndarray | None  #: velocity increments by time-dependent loads at factor 1 (loads, dims, n + 1) [m/s]

    @property
    def saved_bytes(self) -> int:
        """Memory of the saved positions and half-step velocities [bytes]."""
        arrays = 3 if self.run.wants_velocity(self.instants) else 1
        return 8 * arrays * self.instants.steps.size * self.run.initial.size


class ExplicitStepper:
    """Runs of equal :attr:`ExplicitChainRun.shape` and step, advanced together by one compiled call."""

    def __init__(self, prepared: Sequence[PreparedRun]) -> None:
        from cablepod.chain import _kernels_explicit as kernel_explicit

        first = prepared[0]
        run, chain, p = first.run, first.run.chain, first.run.chain.p
        self.instants, self.bounds = first.instants, np.array([member.run.divergence_bound for member in prepared])
        self.states = kernel_explicit.new_states(len(prepared), chain.links)
        np.stack([member.state for member in prepared], out=self.states)
        count, saves = len(prepared), self.instants.steps.size
        self.total = int(self.instants.steps[-1]) + 1
        self.work = count * (chain.links + 1)  #: of a step, in steps of one link
        self.is_finite = np.ones(count, dtype=bool)  #: False for runs that are no longer advanced (runs,)
        self.saved = np.empty((count, saves, p.dims, chain.links + 1))
        half = saves if run.wants_velocity(self.instants) else 0
        self._half_saved = np.empty((count, half, 2, *self.saved.shape[2:]))
        self.half_velocities = self._half_saved if half else None
        self._position = self.states[:, layout.X : layout.X + p.dims, : chain.links + 1]
        rows = np.array([layout.X + COORDINATES.index(axis) for _, axis in p.motions], dtype=np.int64)
        columns = np.array([chain.links * ENDS.index(end) for end, _ in p.motions], dtype=np.int64)
        self._places = rows, columns
        #: Time functions of each run with what is added to their values.
        ends = [_motions(member.run.chain.p) for member in prepared]
        factors = [[(factor, 0.0) for _, factor in member.run.chain.time_dependent_loads()] for member in prepared]
        self._functions = {"ends": ends, "rates": ends, "factors": factors}
        self._tables: dict[str, np.ndarray] = {}
        self._patterns = _stacked([member.patterns for member in prepared])
        self._damping_factors = np.array([member.damping_factor for member in prepared])
        own = [member.run.chain.p for member in prepared]
        #: Viscosity and damping by the tension (runs,) [s]; None without either.
        self._dampings = None
        if p.link_viscosity is not None or p.tension_damping is not None:
            viscosity = np.array([each.link_viscosity or 0.0 for each in own])
            self._dampings = viscosity, np.array([each.tension_damping or 0.0 for each in own])
        attached = [member.run.attached for member in prepared]
        self._attached = None
        if run.attached is not None:
            arrays = (np.stack([getattr(one, name) for one in attached]) for name in ("particles", "numbers"))
            self._attached = layout.Attached(*arrays)
        self._air = None
        if run.air is not None:  # such runs are alone
            tension = float(chain.tensions_and_forces(run.initial)[0].max())
            hold = run.air.hold(tension, 1.0 / self.instants.steps_per_second, run.end_time)
            bodies = cast("ChainAir", run.air).bodies
            self._air = layout.Air(run.air.velocity, run.air.drag, bodies, run.air.samples_per_second, hold)
        self._spatial = True if p.dims == 3 else None
        step, extremes = 1.0 / self.instants.steps_per_second, "tension_extremes" in run.outputs
        self._shared = layout.Shared(chain.links, step, chain.green, extremes)

    def advance(self, start: int, steps: int) -> np.ndarray:
        """Take `steps` steps from number `start` on; returns which runs are still finite (runs,)."""
        from cablepod.chain import _kernels_explicit as kernel  # numba is imported only to compute

        first, last = np.searchsorted(self.instants.steps, (start, start + steps))
        rates = loads = None
        if self._dampings is not None:
            rates = layout.Rates(*self._dampings, self._table("rates", start, steps))
        if self._patterns is not None:
            loads = layout.Loads(self._patterns, self._table("factors", start, steps))
        kernel.verlet(
            self.states, self.is_finite, self._spatial, self._shared, self._damping_factors, rates, self._attached, self._air,
            loads, layout.Ends(*self._places, self._table("ends", start, steps)), layout.Block(start, steps),
            layout.Record(self.instants.steps[first:last], int(first), self.saved, self._half_saved),
        )  # fmt: skip
        axes = (1, 2)
        with np.errstate(invalid="ignore"):
            return np.isfinite(self._position).all(axis=axes) & (np.abs(self._position).max(axis=axes) < self.bounds)

    def _table(self, name: str, start: int, steps: int) -> np.ndarray:
        """Evaluate time functions at the steps from `start` on (runs, functions, steps + 1)."""
        functions = self._functions[name]
        shape = len(self.states), len(functions[0]), steps + 1
        table = self._tables.get(name)
        # the memory is reused: the system clears new memory, which costs as much as filling it
        if table is None or table.shape != shape:
            table = self._tables[name] = np.empty(shape)
        for rows, own in zip(table, functions, strict=True):
            for row, (function, origin) in zip(rows, own, strict=True):
                row[:] = function.at_steps(start, steps, self.instants.steps_per_second, int(name == "rates"), origin)
        return table


def _motions(p: Parameters) -> list[tuple[TimeFunction, float]]:
    """Return the motions of the ends with the coordinate where each begins [m]."""
    places = ((ENDS.index(end), COORDINATES.index(axis)) for end, axis in p.motions)
    return [(motion, p.ends[place]) for place, motion in zip(places, p.motions.values(), strict=True)]


def _stacked(values: list[Any]) -> np.ndarray | None:
    """Stack the values of all runs; None if the term is absent."""
    return None if values[0] is None else np.stack(values)


def _root(signed_square: np.ndarray) -> np.ndarray:
    """Return T from T |T|."""
    return np.copysign(np.sqrt(np.abs(signed_square)), signed_square)
