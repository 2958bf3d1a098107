"""Implicit runs of the chain: trapezoidal rule, generalized alpha, energy-momentum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from cablepod.chain._kernels_arguments import Record, State
from cablepod.chain._lanes import ImplicitLanes, Kernel, groups_of_lanes
from cablepod.chain._small_vibrations import assembled, stiffness_of_links
from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._formulas import green_tangent
from cablepod.discretisation._modal_damping import NodalDamping
from cablepod.integrate._chain_run import Trajectory
from cablepod.integrate._comparison import ComparableRuns
from cablepod.integrate._march import cut_step, not_converged
from cablepod.integrate._newton_run import NewtonRun
from cablepod.integrate._output import Extremes
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._scheme import first_implicit_step
from cablepod.integrate._space_error import COMPANION_NEWTON

SCHEMES = ("trapezoidal", "generalized_alpha", "energy_momentum")
#: Newton tolerance: the mean link rotation of the last correction is so small that its second-order effect on the mean tension
#: is below TENSION_RTOL (a link turned by an angle d is longer by d^2/2, which adds the tension K d^2/2); bounds of d [rad].
TENSION_RTOL, MIN_ROTATION, MAX_ROTATION = 1e-10, 1e-9, 1e-6


@dataclass(frozen=True)
class ImplicitChainRun(NewtonRun):
    """One scene, prepared for runs by an implicit scheme.

    All schemes are of second order and unconditionally stable in linear theory.  The trapezoidal rule is generalized alpha with
    alphas 0; the energy-momentum method conserves the energy at any step.
    """

    method: str = SCHEMES[0]
    spectral_radius: float = 0.8  #: of generalized alpha at unresolved frequencies
    newton_factor: float = 1.0  #: Newton tolerance over the usual one; energy_momentum iterates to rounding

    @property
    def scheme(self) -> str:
        """Name of the scheme."""
        return self.method

    @property
    def unforced_step(self) -> float:
        """Step of the first run without regard to motions, loads and wind [s]."""
        tension = self.chain.tensions_and_forces(self.initial)[0]
        return first_implicit_step(self.chain, tension, self.end_time, self.step_limit)

    def comparable_runs(self) -> ComparableRuns:
        """Describe runs with any step for the step control."""
        return replace(super().comparable_runs(), resolved=1.0 / self.step_limit)

    def as_companion(self) -> Self:
        """Return this run with the larger Newton tolerance of a companion."""
        return replace(self, newton_factor=COMPANION_NEWTON)

    @property
    def alternatives(self) -> str:
        """What to try where a run stops: the scheme that completed all scenes of the stability study first."""
        other = "" if self.method == "energy_momentum" else "scheme energy_momentum, "
        return f"{other}a shorter step, scheme velocity_verlet, gentler loads or motion, or damping"

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        """Parameters alpha_m, alpha_f, beta, gamma of Chung and Hulbert (1993); alphas 0 give the trapezoidal rule."""
        if self.method == "trapezoidal":
            return 0.0, 0.0, 0.25, 0.5
        radius = self.spectral_radius
        alpha_m, alpha_f = (2.0 * radius - 1.0) / (radius + 1.0), radius / (radius + 1.0)
        return alpha_m, alpha_f, 0.25 * (1.0 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f

    @cached_property
    def modal_damping(self) -> NodalDamping:
        """Damping by the ratios of the scene, of vibrations of the chain about rest."""
        p, chain = self.chain.p, self.chain
        if p.damping_ratios is None:
            return NodalDamping.none()
        links, stiffness = stiffness_at_rest(chain)
        if self.attached is not None:
            self.attached.add_stiffness(stiffness)
        mass = np.repeat(chain.mass[chain.free_particles], p.dims)
        rows = np.zeros((3 * p.dims - 3, chain.links + 2))  # as Newton.s
        rows[:, 1:-1] = links[:, *np.triu_indices(p.dims)].T
        return NodalDamping.of(p, stiffness, mass, chain.arc_length / chain.total_length, rows)

    def new_stepper(self, instants: OutputTimes) -> ImplicitStepper:
        """Return the stepper of a run; models with other kernels override this."""
        return ImplicitStepper(self, instants)

    def begin(self, steps_per_second: float) -> ImplicitStepper:
        """Prepare a run with a number of steps per second, to be advanced in a lane."""
        return self.new_stepper(self.instants(steps_per_second))

    @property
    def shape(self) -> tuple[Any, ...]:
        """Key of runs that can be advanced in lanes of one kernel call, see :class:`cablepod.chain._lanes.ImplicitLanes`."""
        chain, p, free = self.chain, self.chain.p, self.chain.free_particles
        damping = (
            p.mass_damping is None,
            p.link_viscosity is None,
            p.tension_damping is None,
            p.damping_ratios is None,
        )
        terms = (damping, self.attached is None, len(chain.time_dependent_loads()))
        sizes = (chain.links, p.dims, chain.law, free.start, free.stop, *sorted(self.moving))
        return self.method, self.spectral_radius, sizes, terms, self.outputs, self.times.tobytes()

    @staticmethod
    def groups(steppers: Sequence[ImplicitStepper]) -> list[list[int]]:
        """Return the places of runs of equal shape that are advanced together; others are left to single runs."""
        if steppers[0].run.chain.p.damping_ratios is not None or steppers[0].run.attached is not None:
            return []
        return groups_of_lanes(steppers)

    @staticmethod
    def together(steppers: Sequence[ImplicitStepper]) -> ImplicitLanes:
        """Return what advances runs of equal shape together."""
        return ImplicitLanes(steppers)

    def finish(self, lanes: ImplicitLanes, place: int) -> Trajectory:
        """Return the trajectory of this run, number `place` of some in lanes, after its last step; raises as a single run."""
        return self.end(lanes.stepper(place), lanes.instants)

    def _gather(self, stepper: ImplicitStepper, instants: OutputTimes, extremes: Extremes) -> Trajectory:
        saved = stepper.saved
        rows: Any = slice(None)
        if instants.steps.size < stepper.instants.steps.size:
            rows = np.searchsorted(stepper.instants.steps, instants.steps)
        x = np.ascontiguousarray(np.moveaxis(saved[rows, 0], 1, 2))
        if not self.wants_velocity(instants):
            state = self.state(instants, x, None, None, extremes)
        else:
            v, a = (np.ascontiguousarray(np.moveaxis(saved[rows, i], 1, 2)) for i in (1, 2))
            if self.method == "energy_momentum":
                a = self._accelerations(stepper, instants, x, v)
            state = self.state(instants, x, v, a, extremes)
        state.diagnostics = {"newton_iterations": stepper.iterations, "steps_cut": stepper.substepped}
        if self.method == "generalized_alpha":
            state.diagnostics["spectral_radius"] = self.spectral_radius
        return state

    def _accelerations(
        self, stepper: ImplicitStepper, instants: OutputTimes, x: np.ndarray, v: np.ndarray
    ) -> np.ndarray:
        """Return the accelerations at the saved steps from the forces; the energy-momentum method has none of its own."""
        chain = self.chain
        time = instants.steps[: len(x)] / instants.steps_per_second
        total = chain.forces(x, v) + chain.loads()
        for pattern, factor in chain.time_dependent_loads():
            total += factor(time)[:, None, None] * pattern
        if self.attached is not None:
            total += np.array([self.attached.force(*state) for state in zip(x, v, strict=True)])
        if self.air is not None:
            for i, instant in enumerate(time):
                total[i] += self.air.force(x[i], v[i], float(instant))
        if stepper.modal.matrix.size:
            total += [stepper.modal.forces(rates, chain.free_particles.start) for rates in v]
        a = np.zeros_like(x)
        a[:, chain.free_particles] = total[:, chain.free_particles] / stepper.mass[chain.free_particles, None]
        if chain.p.mass_damping is not None:
            a[:, chain.free_particles] -= chain.p.mass_damping * v[:, chain.free_particles]
        return a


def stiffness_at_rest(chain: LumpedChain) -> tuple[np.ndarray, np.ndarray]:
    """Return the tangent stiffness at rest of the links (n, dims, dims) and of the free particles (unknowns, unknowns) [N/m]."""
    position, tension = rest_shape(chain)
    reach, free = np.diff(position, axis=0), chain.free_particles
    axial = green_tangent(chain.stretch(position) ** 2, chain.k) if chain.green else chain.k
    links = stiffness_of_links(reach, tension, axial)
    unknowns = chain.p.dims * (free.stop - free.start)
    return links, assembled(links)[free, :, free].reshape(unknowns, unknowns)


class ImplicitStepper:
    """State of an implicit run, advanced in place by the kernels."""

    failure = staticmethod(not_converged)
    out_of_balance = False  #: the energy is checked at the output times

    def __init__(self, run: ImplicitChainRun, instants: OutputTimes) -> None:
        chain, p, free = run.chain, run.chain.p, run.chain.free_particles
        self.run, self.instants = run, instants
        # the kernels loop over all particles: mass, loads, velocity and acceleration are 0 at the held ones
        self.mass = np.zeros(chain.links + 1)
        self.mass[free] = chain.mass[free]
        self.x = np.ascontiguousarray(run.initial.T)
        self.v = np.zeros_like(self.x)
        self.modal, first_force = run.modal_damping, run.first_force()
        if self.modal.matrix.size:
            rates = np.zeros_like(run.initial)
            rates[[0, -1]] = p.end_positions(np.zeros(1), 1)[0]
            first_force = first_force + self.modal.forces(rates, free.start)
        self.force, self.a = self._of_free(first_force), np.zeros_like(self.x)
        self.a[:, free] = self.force[:, free] / self.mass[free]
        self.loads = self._of_free(chain.loads())
        self.varying = chain.time_dependent_loads()
        self.patterns = np.array([self._of_free(pattern) for pattern, _ in self.varying]) if self.varying else None
        self.saved = np.zeros((instants.steps.size, 3, p.dims, chain.links + 1))
        self.extremes = run.extremes()
        tension = float(np.abs(chain.tensions_and_forces(run.initial)[0]).mean())
        rotation = math.sqrt(2.0 * TENSION_RTOL * tension / chain.stiffness_of_parts.max())
        self.rotation_tolerance = run.newton_factor * min(max(rotation, MIN_ROTATION), MAX_ROTATION)
        self.iterations, self.substepped = 0, 0

    def _of_free(self, values: np.ndarray) -> np.ndarray:
        """Transpose (n + 1, dims) to (dims, n + 1), with 0 at the held particles."""
        free, result = self.run.chain.free_particles, np.zeros(values.shape[::-1])
        result[:, free] = values[free].T
        return result

    @cached_property
    def _lane(self) -> Kernel:
        return Kernel([self], 1)

    def advance(self, start: int, steps: int) -> int:
        """Take steps on the grid of the run; returns the number of steps done."""
        first, last = np.searchsorted(self.instants.steps, (start, start + steps))
        rate = self.instants.steps_per_second
        time, step = np.arange(start, start + steps + 1) / rate, 1.0 / rate
        return self._kernel(time, step, start, self.instants.steps[first:last], int(first))

    def substep(self, number: int) -> bool:
        """Take one step in substeps short enough for Newton's method; returns whether it converged."""

        def take(substeps: int) -> int:
            time = (number + np.arange(substeps + 1) / substeps) / self.instants.steps_per_second
            step = 1.0 / (substeps * self.instants.steps_per_second)
            # the beginning of the step was saved at the first attempt
            return self._kernel(time, step, 0, np.empty(0, dtype=np.int64), 0)

        converged = cut_step(take, (self.x, self.v, self.a, self.force))
        self.substepped += converged
        return converged

    def save_last(self) -> Extremes:
        """Save the state after the last step, as the kernels do at the beginning of steps; returns the tension extremes."""
        self.saved[-1] = (self.x, self.v, self.a)[: self.saved.shape[1]]
        if self.extremes is not None:
            tension = self.run.chain.tensions_and_forces(self.x.T)[0]
            np.minimum(self.extremes[0], tension, out=self.extremes[0])
            np.maximum(self.extremes[1], tension, out=self.extremes[1])
        return self.extremes

    @property
    def state(self) -> tuple[np.ndarray, ...]:
        """All arrays that a step changes, but for the extremes."""
        return self.x, self.v, self.a, self.force

    @property
    def watched(self) -> tuple[np.ndarray, np.ndarray]:
        """Tension extremes that the kernels update (n,) [N]."""
        assert self.extremes is not None
        return self.extremes

    def is_finite(self) -> bool:
        """Whether all positions are finite and below the divergence bound."""
        return bool(np.isfinite(self.x).all() and np.abs(self.x).max() < self.run.divergence_bound)

    def rotation_by_rounding(self, ends: list[np.ndarray]) -> float:
        """Return the rotation of a link by rounding errors over their relative size, for positions of the ends in a run."""
        # errors scale with the coordinates of the chain now, which may be far from the start; those beyond the bound are not
        # reached
        largest = max(float(np.abs(positions).max()) for positions in (self.x, *ends))
        return min(self.run.divergence_bound, largest) * math.sqrt((1.0 / self.run.chain.length**2).mean())

    @property
    def saved_bytes(self) -> int:
        """Memory of the saved steps of a run in a lane [bytes]."""
        return 8 * self.variables * self.instants.steps.size * self.x.size

    @property
    def variables(self) -> int:
        """Number of variables saved in a lane: positions, or also velocities and accelerations."""
        return 3 if self.run.wants_velocity(self.instants) else 1

    def start(self, step: float) -> tuple[np.ndarray, ...]:
        """Return the state as the kernels take it, flat, from which the prediction starts anew."""
        if self.run.method == "energy_momentum":
            return self.x.reshape(-1), self.v.reshape(-1), step * self.v.reshape(-1)
        x, v, a, force = (state.reshape(-1) for state in self.state)
        return x, v, a, force, a.copy(), a.copy()

    def _kernel(self, time: np.ndarray, step: float, start: int, save: np.ndarray, at: int) -> int:
        """Call the kernel for steps at the instants `time`; returns the number of steps done."""
        tables, none = self._lane.tables(time), np.empty(0)
        ends = [table for table in (tables.lower, tables.upper) if table.size]
        rotation = np.array([self.rotation_by_rounding(ends)])
        saved = self.saved.reshape(1, *self.saved.shape[:2], -1)
        record = Record(start, save, at, saved, *(self.extremes or (none, none)))
        states = self.start(step)
        state = State(*states, *[none] * (6 - len(states)))
        failed, iterations = np.zeros(1, dtype=bool), np.zeros(1, dtype=np.int64)
        done = self._lane.advance(
            time, step, tables, state, rotation, np.ones(1, dtype=bool), failed, iterations, record
        )
        self.iterations += int(iterations[0])
        return done - int(failed[0])
