"""Runs of the chain of rigid links by RATTLE or by the index-1 form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cablepod.discretisation._chain import square
from cablepod.discretisation._mass_damping import decay_and_impulse
from cablepod.errors import SceneError
from cablepod.integrate._chain_run import Trajectory
from cablepod.integrate._march import cut_step, not_converged
from cablepod.integrate._means import means, wants_means
from cablepod.integrate._newton_run import NewtonRun
from cablepod.integrate._output import Extremes, time_scale_attributes, trajectory_attributes
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._window import window_attributes
from cablepod.rigid import _kernels_layout as layout

FORMULATIONS = ("rattle", "index1")
#: Maximum energy imbalance, relative to the exchanged energy, and maximum rotation of a link per step [rad], without a warning.
DRIFT_WARN, ROTATION_WARN = 0.1, 1.0
#: Maximum energy imbalance that never stops a run, relative to the work of the loads over the length of the cable.
IMBALANCE_FLOOR = 1e-6
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class RigidRun(NewtonRun):
    """One scene, prepared for runs with rigid links."""

    formulation: str = FORMULATIONS[0]

    @property
    def scheme(self) -> str:
        """Name of the scheme."""
        return self.formulation

    @property
    def unforced_step(self) -> float:
        """Step of the first run [s], about a third of the stability limit of the fastest initial vibration."""
        stepper = RigidStepper(self, OutputTimes.of(self.times, 1.0))
        chain = self.chain
        max_tension = np.abs(stepper.s[layout.T, : chain.links]).max() + np.abs(chain.loads(0.0)).sum(axis=0).max()
        # a link under a tension T has the transverse stiffness T / l at most
        per_length = np.concatenate([[0.0], 1.0 / chain.length, [0.0]])
        inverse = stepper.s[layout.INVERSE_MASS, : chain.links + 1]
        omega = math.sqrt(2.0 * max_tension * float(((per_length[:-1] + per_length[1:]) * inverse).max()))
        return min(0.7 / max(omega, 1e-300), (self.end_time or 1.0) / 20.0)

    def new_stepper(self, instants: OutputTimes) -> RigidStepper:
        """Return the stepper of a run."""
        return RigidStepper(self, instants)

    def check_energy(self, state: Trajectory) -> Trajectory:
        """Return the trajectory: the kernels check the balance of the energies in every step."""
        return state

    def _gather(self, stepper: RigidStepper, instants: OutputTimes, extremes: Extremes) -> Trajectory:
        """Make a trajectory of the saved steps, with tensions if they are an output."""
        saves = instants.steps.size
        rows = np.searchsorted(stepper.instants.steps, instants.steps)
        x, v = (np.ascontiguousarray(stepper.saved[rows, i]) for i in range(2))
        tension, of_steps = None, None
        wants = wants_means(self.outputs) and instants is stepper.instants
        if instants.needs_interpolation or wants:
            a, tension = stepper.states(instants.steps / instants.steps_per_second, x, v, np.zeros(saves, dtype=bool))
            if wants:
                of_steps = means(instants, self.window, tension.__getitem__, self.chain.links)
        if instants.needs_interpolation:
            x, v = instants.at_times(x, v, a), instants.rates_at_times(v, a)
            tension = stepper.states(instants.times, x, v, instants.fraction > 0)[1]
        else:
            x, v = x[instants.left], v[instants.left]
            if tension is not None:
                tension = tension[instants.left]
            elif "tension" in self.outputs:
                tension = stepper.states(instants.times, x, v, np.zeros(len(x), dtype=bool))[1]
        x, v = (np.ascontiguousarray(np.moveaxis(array, 1, 2)) for array in (x, v))
        output = tension if "tension" in self.outputs else None
        return Trajectory(instants, x, v, extremes, stepper.diagnostics(), means=of_steps, tension=output)

    def initial_velocity_jump(self) -> dict[str, float]:
        """Return attributes about ends that start with a nonzero speed; empty for all other runs.

        Rigid links transmit the jump without delay: the initial velocities are those at rest, projected orthogonally by mass.
        """
        rates = self.chain.p.end_positions(np.zeros(1), 1)[0]
        return {"start_jolt_speed": math.sqrt(square(rates).max())} if rates.any() else {}

    def tension(self, state: Trajectory) -> np.ndarray:
        """Return the tensions (times, links) [N]."""
        assert state.tension is not None
        return state.tension

    def has_kinks(self, state: Trajectory) -> bool:
        """Return False: rigid links carry compression."""
        return False

    def features(self, end_time: float) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return none: the similarity numbers are those of elastic cables."""
        return {}, {}

    def attributes(self, state: Trajectory) -> dict[str, Any]:
        """Return the attributes of the result."""
        diagnostics = dict(state.diagnostics)
        if state.tension is not None:
            diagnostics |= _compression(state.tension, state.instants.times)
        if state.extremes is not None:
            diagnostics["smallest_tension"] = float(state.extremes[0].min())
        return {
            "title": f"{self.title}: chain of {self.chain.links} rigid links",
            **trajectory_attributes("rigid chain", self.scheme, state.instants, formulation=self.formulation),
            **diagnostics,
            **self.initial_velocity_jump(),
            **time_scale_attributes(self.chain.p),
            **self.chain.p.offsets(),
            **window_attributes(self.window),
        }


def _compression(tension: np.ndarray, times: np.ndarray) -> dict[str, Any]:
    """Return attributes about links in compression, which a cable cannot bear; rounding errors do not count."""
    negative = tension < -1e-9 * np.abs(tension).max()
    attributes: dict[str, Any] = {
        "smallest_tension": float(tension.min()),
        "links_in_compression": int(negative.any(axis=0).sum()),
    }
    if negative.any():
        attributes["first_compression"] = float(times[negative.any(axis=1)][0])
    return attributes


class RigidStepper:
    """State of a run, advanced in place by the kernels."""

    def __init__(self, run: RigidRun, instants: OutputTimes) -> None:
        from cablepod.rigid import _kernels_steps as kernel  # numba is imported only to compute

        self.kernel = kernel
        chain, p = run.chain, run.chain.p
        self.run, self.instants = run, instants
        self.links, self.spatial = chain.links, True if p.dims == 3 else None
        self.s, self.counts = layout.new_state(self.links), np.zeros(layout.COUNTS)
        self.damping = p.mass_damping or 0.0
        self.substepped, self.status = 0, layout.DONE
        self.moving = bool(run.moving)
        s, particles, free = self.s, slice(self.links + 1), chain.free_particles
        mass = chain.mass[free]
        s[layout.MASS, free], s[layout.INVERSE_MASS, free] = mass, 1.0 / mass
        s[layout.LENGTH, : self.links], s[layout.INVERSE_LENGTH, : self.links] = chain.length, 1.0 / chain.length
        per_mass = s[layout.INVERSE_MASS, particles, None]
        s[layout.X : layout.X + p.dims, particles] = run.initial.T
        s[layout.STEADY : layout.STEADY + p.dims, particles] = (per_mass * chain.loads()).T
        s[layout.LOAD : layout.LOAD + p.dims, particles] = (per_mass * chain.loads(0.0)).T
        s[layout.LOW], s[layout.HIGH] = np.inf, -np.inf
        self.varying = chain.time_dependent_loads()
        self.patterns = np.zeros((len(self.varying), p.dims, self.links + 1))
        for target, (pattern, _) in zip(self.patterns, self.varying, strict=True):
            target[:] = (per_mass * pattern).T
        self.counts[layout.FLOOR] = IMBALANCE_FLOOR * float(np.abs(chain.loads(0.0)).sum()) * chain.total_length
        self.saved = np.zeros((instants.steps.size, 2, p.dims, self.links + 1))
        self.wants_extremes = "tension_extremes" in run.outputs
        self._start()

    def _start(self) -> None:
        """Make the initial state consistent with the constraints and their time derivative."""
        s = self.s
        x = np.ascontiguousarray(self.run.initial.T)[None]
        tension = self._states(s, np.zeros(1), x, np.zeros_like(x), np.ones(1, dtype=bool))[1]
        if self.status != layout.DONE:
            raise SceneError(
                f"initial.points: at the start {self.failure(cut=False)}; allowed: a shape from which the links can move"
            )
        s[[layout.T, layout.T_BEFORE], : self.links] = tension[0]
        self.force_scale = float(np.abs(self.run.chain.loads(0.0)).sum() + np.abs(tension).max())
        velocity = s[layout.V : layout.V + x.shape[1], : self.links + 1]
        self.counts[[layout.FIRST_KINETIC, layout.KINETIC, layout.MAX_KINETIC]] = 0.5 * float(
            (s[layout.MASS, : self.links + 1] * square(velocity.T)).sum()
        )

    def _ends(self, time: np.ndarray) -> np.ndarray:
        """Return positions, velocities and accelerations of the ends (times, 3, end, dims)."""
        return np.stack([self.run.chain.p.end_positions(time, order) for order in range(3)], axis=1)

    def _length_rounding(self, time: np.ndarray) -> float:
        """Return the relative length error by rounding of the positions."""
        p = self.run.chain.p
        reach = float(np.abs(self.s[layout.X : layout.X + 3]).max())
        if self.moving:
            reach = max(reach, float(np.abs(p.end_positions(time)).max()))
        return 4.0 * _EPS * (1.0 + reach / float(self.run.chain.length.min()))

    def _factors(self, time: np.ndarray) -> np.ndarray:
        """Return the factors of the time-dependent loads (times, loads)."""
        return np.array([factor(time) for _, factor in self.varying]).reshape(len(self.varying), time.size).T.copy()

    def _tables(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return tables of the ends, of load patterns and of load factors for the kernels."""
        # absent terms are tables without rows: another type would compile the kernels anew, for seconds
        ends = self._ends(time) if self.moving else np.empty((0, 3, 2, self.run.chain.p.dims))
        return ends, self.patterns, self._factors(time)

    def advance(self, start: int, steps: int) -> int:
        """Take steps on the grid of the run; returns the number of steps done."""
        first, last = np.searchsorted(self.instants.steps, (start, start + steps))
        save = self.instants.steps[first:last]
        return self._kernel(start, 1.0 / self.instants.steps_per_second, steps, 1, save, self.saved[first:last])

    def substep(self, number: int) -> bool:
        """Take one step in substeps short enough for Newton's method; returns whether it converged."""

        def take(substeps: int) -> int:
            step = 1.0 / (substeps * self.instants.steps_per_second)
            # the beginning of the step was saved at the first attempt
            return self._kernel(number, step, substeps, substeps, np.empty(0, dtype=np.int64), self.saved[:0])

        converged = cut_step(take, (self.s, self.counts), substeps=4)
        self.substepped += converged
        return converged

    @property
    def out_of_balance(self) -> bool:
        """Whether the last step ended with energies that are far out of balance."""
        return self.status == layout.OUT_OF_BALANCE

    def _kernel(self, number: int, step: float, steps: int, substeps: int, save: np.ndarray, saved: np.ndarray) -> int:
        """Take `steps` substeps, `substeps` per step of the grid, from step `number` of the grid on."""
        run, steps_per_second = self.run, self.instants.steps_per_second
        head = (self.s, self.links, self.spatial)
        last = (self.wants_extremes, steps, number, save, saved, self.counts)
        if run.formulation == "rattle":
            time = (number + np.arange(steps + 1) / substeps) / steps_per_second
            decay, half = decay_and_impulse(self.damping, 0.5 * step)
            done, self.status = self.kernel.rattle(
                *head, *self._tables(time), step, half, decay, self.damping, self._length_rounding(time), *last
            )
        else:
            time = (number + np.arange(2 * steps + 1) / (2 * substeps)) / steps_per_second
            done, self.status = self.kernel.index1(
                *head, *self._tables(time), step, self.damping, self._length_rounding(time), *last
            )
        return done

    def failure(self, *, cut: bool = True) -> str:
        """Describe the failure of the last step, or of a state for which no step can be cut."""
        if self.status == layout.SINGULAR:
            return "the multipliers are singular (all links lie on a line between held ends)"
        return not_converged() if cut else "Newton's method did not converge"

    def save_last(self) -> Extremes:
        """Save the state after the last step, as the kernels do at the beginning of steps; returns the tension extremes."""
        dims = self.saved.shape[2]
        for i, row in enumerate((layout.X, layout.V)):
            self.saved[-1, i] = self.s[row : row + dims, : self.links + 1]
        if not self.wants_extremes:
            return None
        last = self.instants.steps[-1:] / self.instants.steps_per_second
        tension = self.states(last, self.saved[-1:, 0].copy(), self.saved[-1:, 1].copy(), np.zeros(1, dtype=bool))[1][0]
        low, high = (self.s[row, : self.links] for row in (layout.LOW, layout.HIGH))
        return np.minimum(low, tension), np.maximum(high, tension)

    def states(
        self, time: np.ndarray, x: np.ndarray, v: np.ndarray, is_projected: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return accelerations (times, dims, n + 1) and tensions (times, n) at states `x`, `v` (times, dims, n + 1).

        States with `is_projected` (times,) are projected onto the constraints in place.
        """
        a, tension, done = self._states(self.s.copy(), time, x, v, is_projected)
        if self.status != layout.DONE:
            why = f"{self.failure(cut=False)} at {time[done]:.6g} s, an output time; try a shorter step, or other times"
            self.run.stop(None, 0.0, why)
        return a, tension

    def _states(
        self, s: np.ndarray, time: np.ndarray, x: np.ndarray, v: np.ndarray, is_projected: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Do ``states`` with a state array `s` to work in; returns the number of states done too."""
        a, tension = np.empty_like(x), np.empty((len(x), self.links))
        done, self.status = self.kernel.states(
            s, self.links, self.spatial, self._ends(time), self.patterns, self._factors(time), self.damping,
            is_projected, self._length_rounding(time), x, v, a, tension, self.counts,
        )  # fmt: skip
        return a, tension, done

    @property
    def state(self) -> tuple[np.ndarray, ...]:
        """All arrays that a step changes."""
        return self.s, self.counts

    @property
    def watched(self) -> tuple[np.ndarray, np.ndarray]:
        """Tension extremes that the kernels update (n,) [N]."""
        return self.s[layout.LOW, : self.links], self.s[layout.HIGH, : self.links]

    def is_finite(self) -> bool:
        """Whether all positions are finite and below the divergence bound."""
        position = self.s[layout.X : layout.X + 3]
        return bool(np.isfinite(position).all() and np.abs(position).max() < self.run.divergence_bound)

    def diagnostics(self) -> dict[str, Any]:
        """Return the attributes of the result from the run itself."""
        counts = self.counts
        exchanged = max(counts[layout.MAX_KINETIC], counts[layout.MAX_LOADS], counts[layout.MAX_ENDS])
        # exchanged energies below this are rounding errors
        rounding = 1e3 * _EPS * self.force_scale * self.run.chain.total_length
        diagnostics = {
            "length_error": float(counts[layout.LENGTH_ERROR]),
            "energy_drift": float(counts[layout.BALANCE] / max(exchanged, rounding, 1e-300)),
            "energy_exchanged": float(exchanged),
            "largest_turn_rate": math.sqrt(counts[layout.MAX_ROTATION_SQUARED]),
            "newton_iterations": int(counts[layout.ITERATIONS]),
            "steps_cut": self.substepped,
        }
        if counts[layout.FIRST_KINETIC] > 0.0:
            diagnostics["start_jolt_energy"] = float(counts[layout.FIRST_KINETIC])
        return diagnostics
