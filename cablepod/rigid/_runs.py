"""Runs of the chain of rigid links, by RATTLE or by the index-1 form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from cablepod._resources import check_memory
from cablepod.conventions import label
from cablepod.discretisation._chain import square
from cablepod.errors import SceneError
from cablepod.integrate._march import BLOCK
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._run import ChainRun, Trajectory, chain_coordinates
from cablepod.integrate._step_control import STEPS_PER_CHANGE
from cablepod.rigid import _kernels_layout as layout

FORMULATIONS = ("rattle", "index1")
#: Error of the energies, as a part of what was exchanged, and angle by which a link turns in a step [rad], from which a given
#: step is warned of.
DRIFT_WARN, TURN_WARN = 0.1, 1.0
#: A step in which Newton's method does not converge is cut into so many at most.
MAX_SUBSTEPS = 1024
#: An imbalance below this part of what the loads do over the length of the cable is no reason to stop.
FLOOR = 1e-6
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class RigidRun(ChainRun):
    """One scene, ready to be run with rigid links."""

    formulation: str = FORMULATIONS[0]
    baumgarte: float | None = None  #: rate of Baumgarte's terms in place of the projection [1/s]

    @property
    def scheme(self) -> str:
        """Name of the scheme."""
        return self.formulation

    def instants(self, rate: float) -> OutputTimes:
        """Place the instants of the output on the steps."""
        instants = OutputTimes.of(self.times, rate)
        if instants.needs_interpolation:
            links, dims = self.chain.links, self.chain.p.dims
            check_memory(instants.times.size, links, dims, key="times between two steps", variables=12)
        return instants

    def first_step(self) -> float:
        """Choose the step to begin with [s]: about a third of what the fastest vibration of the start allows."""
        march = RigidStepper(self, OutputTimes.of(self.times, 1.0))
        chain, p = self.chain, self.chain.p
        pull = np.abs(march.s[layout.T, : chain.links]).max() + np.abs(chain.loads(0.0)).sum(axis=0).max()
        # links under a tension T hold their particles across with T / l at most
        per_length = np.concatenate([[0.0], 1.0 / chain.length, [0.0]])
        inverse = march.s[layout.INVERSE_MASS, : chain.links + 1]
        omega = math.sqrt(2.0 * pull * float(((per_length[:-1] + per_length[1:]) * inverse).max()))
        until = float(self.times[-1]) or 1.0
        return min(0.7 / max(omega, 1e-300), until / 20.0, p.shortest_time_scale / STEPS_PER_CHANGE)

    def __call__(self, rate: float) -> Trajectory:
        """Run with so many steps per second."""
        instants = self.instants(rate)
        total = int(instants.steps[-1])
        march = RigidStepper(self, instants)
        done = 0
        while done < total:
            steps = min(BLOCK, total - done)
            reached = march.advance(done, steps)
            done += reached
            if march.status == layout.BROKEN:
                self._stop(march, done, "the energies are far out of balance")
            if reached < steps:
                if not march.substep(done):
                    self._stop(march, done, march.why())
                done += 1
            if not march.is_finite():
                self._stop(march, done, "the chain left the finite numbers")
            if self.progress is not None:
                self.progress(done / total)
        march.save_last()
        return self._gather(march, instants, march.extremes())

    def _gather(
        self, march: RigidStepper, instants: OutputTimes, extremes: tuple[np.ndarray, np.ndarray] | None
    ) -> Trajectory:
        keep = instants.steps.size
        x, v = (np.ascontiguousarray(march.saved[:keep, i]) for i in range(2))
        tension = None
        if instants.needs_interpolation:
            a, tension = march.states(instants.steps / instants.steps_per_second, x, v, np.zeros(keep, dtype=bool))
            x, v = instants.at_times(x, v, a), instants.rates_at_times(v, a)
            onto = (instants.fraction > 0) & (self.baumgarte is None)
            tension = march.states(instants.times, x, v, onto)[1]
        elif "tension" in self.outputs:
            tension = march.states(instants.times, x, v, np.zeros(keep, dtype=bool))[1]
        x, v = (np.ascontiguousarray(np.moveaxis(item, 1, 2)) for item in (x, v))
        state = Trajectory(instants, x, v, extremes)
        state.diagnostics = march.diagnostics()
        if tension is not None and "tension" in self.outputs:
            state.diagnostics["tension"] = tension
        return state

    def _stop(self, march: RigidStepper, done: int, what: str) -> None:
        rate, times = march.instants.steps_per_second, march.instants.times
        # the step before the last one done is saved for certain, and so is what lies before it
        count = int(np.searchsorted(times, (done - 1) / rate * (1.0 + 1e-12), side="right")) if done > 0 else 0
        partial = None
        if count:
            partial = self._gather(march, OutputTimes.of(times[:count], rate), None)
        why = (
            f"{what} at {done / rate:.6g} s ({self.formulation}, step {1 / rate:.4g} s, step number {done}); try a shorter step, "
            "gentler loads or motion, or damping"
        )
        self.stop(partial, done, rate, why)

    def initial_velocity_jump(self) -> dict[str, float]:
        """Attributes of a run whose ends start to move at once, at a speed other than 0; empty for others.

        Rigid links pass the jump on at once: velocities after it are those at rest, projected orthogonally by mass.
        """
        rates = self.chain.p.end_positions(np.zeros(1), 1)[0]
        return {"start_jolt_speed": math.sqrt(square(rates).max())} if rates.any() else {}

    def dataset(self, state: Trajectory) -> xr.Dataset:
        """Label what a run gave."""
        chain, rate = self.chain, state.instants.steps_per_second
        notes = dict(state.diagnostics)
        tension = notes.pop("tension", None)
        variables: dict[str, Any] = {}
        if "position" in self.outputs:
            variables["position"] = (("time", "particle", "coordinate"), state.position)
        if "velocity" in self.outputs:
            variables["velocity"] = (("time", "particle", "coordinate"), state.velocity)
        if tension is not None:
            variables["tension"] = (("time", "link"), tension)
            notes |= _compression(tension, state.instants.times)
        if state.extremes is not None:
            variables["tension_minimum"], variables["tension_maximum"] = (("link", item) for item in state.extremes)
            notes["smallest_tension"] = float(state.extremes[0].min())
        variables["unstretched_length"] = ((), chain.total_length)
        result = xr.Dataset(variables, coords={"time": state.instants.times, **chain_coordinates(chain)})
        label(result)
        result.attrs.update(
            title=f"{self.title}: chain of {chain.links} rigid links",
            stage="trajectory",
            model="rigid chain",
            formulation=self.formulation,
            scheme=self.scheme,
            step=1.0 / rate,
            number_of_steps=int(state.instants.steps[-1]),
            **notes,
            **self.initial_velocity_jump(),
        )
        return result


def _compression(tension: np.ndarray, times: np.ndarray) -> dict[str, Any]:
    """Say in attributes whether links push, which a cable cannot; rounding of a link without force does not count."""
    negative = tension < -1e-9 * np.abs(tension).max()
    notes: dict[str, Any] = {
        "smallest_tension": float(tension.min()),
        "links_in_compression": int(negative.any(axis=0).sum()),
    }
    if negative.any():
        notes["first_compression"] = float(times[negative.any(axis=1)][0])
    return notes


class RigidStepper:
    """The state of a run, advanced in place by the kernels."""

    def __init__(self, run: RigidRun, instants: OutputTimes) -> None:
        from cablepod.rigid import _kernels_steps as kernel_steps  # numba is imported only to compute

        self.kernel = kernel_steps
        chain, p = run.chain, run.chain.p
        self.run, self.instants = run, instants
        self.links, self.spatial = chain.links, True if p.dims == 3 else None
        self.s, self.counts = kernel_steps.new_state(self.links), np.zeros(layout.COUNTS)
        self.damping = p.mass_damping or 0.0
        self.stabilise = -1.0 if run.baumgarte is None else float(run.baumgarte)  # below 0: projection
        self.substepped, self.status = 0, layout.DONE
        self.moving = bool(run.moving)
        s, particles, free = self.s, slice(self.links + 1), chain.free_particles
        mass = p.mass * chain.tributary_length[free]
        s[layout.MASS, free], s[layout.INVERSE_MASS, free] = mass, 1.0 / mass
        s[layout.LENGTH, : self.links], s[layout.INVERSE_LENGTH, : self.links] = chain.length, 1.0 / chain.length
        per_mass = s[layout.INVERSE_MASS, particles, None]
        s[layout.X : layout.X + p.dims, particles] = run.initial.T
        s[layout.STEADY : layout.STEADY + p.dims, particles] = (per_mass * chain.loads()).T
        s[layout.DRIVE : layout.DRIVE + p.dims, particles] = (per_mass * chain.loads(0.0)).T
        s[layout.LOW], s[layout.HIGH] = np.inf, -np.inf
        self.varying = chain.time_dependent_loads()
        self.patterns = np.zeros((len(self.varying), p.dims, self.links + 1))
        for target, (pattern, _) in zip(self.patterns, self.varying, strict=True):
            target[:] = (per_mass * pattern).T
        self.counts[layout.FLOOR] = FLOOR * float(np.abs(chain.loads(0.0)).sum()) * chain.total_length
        self.saved = np.zeros((instants.steps.size, 2, p.dims, self.links + 1))
        self.wants_extremes = "tension_extremes" in run.outputs
        self._start()

    def _start(self) -> None:
        """Make the state consistent: lengths to rounding, velocities that stretch no link, link vectors, multipliers."""
        s = self.s
        x = np.ascontiguousarray(self.run.initial.T)[None]
        tension = self._states(s, np.zeros(1), x, np.zeros_like(x), np.ones(1, dtype=bool))[1]
        if self.status != layout.DONE:
            raise SceneError(
                f"initial.points: at the start {self.why(0)}; allowed: a shape from which the links can move"
            )
        s[[layout.T, layout.T_BEFORE], : self.links] = tension[0]
        self.force_scale = float(np.abs(self.run.chain.loads(0.0)).sum() + np.abs(tension).max())
        velocity = s[layout.V : layout.V + x.shape[1], : self.links + 1]
        self.counts[[layout.FIRST_KINETIC, layout.KINETIC, layout.MOST_KINETIC]] = 0.5 * float(
            (s[layout.MASS, : self.links + 1] * square(velocity.T)).sum()
        )

    def _ends(self, time: np.ndarray) -> np.ndarray:
        """Positions, velocities and accelerations of the ends (time, 3, end, dims)."""
        return np.stack([self.run.chain.p.end_positions(time, order) for order in range(3)], axis=1)

    def _tolerance(self, time: np.ndarray) -> float:
        """Relative length error that rounding of the positions leaves."""
        p = self.run.chain.p
        reach = float(np.abs(self.s[layout.X : layout.X + 3]).max())
        if self.moving:
            reach = max(reach, float(np.abs(p.end_positions(time)).max()))
        return 4.0 * _EPS * (1.0 + reach / float(self.run.chain.length.min()))

    def _factors(self, time: np.ndarray) -> np.ndarray:
        """Factors of the loads that vary in time (time, loads)."""
        return np.array([factor(time) for _, factor in self.varying]).reshape(len(self.varying), time.size).T.copy()

    def _tables(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # one type for all scenes: a table without rows costs a branch in a step, another type seconds of compilation
        ends = self._ends(time) if self.moving else np.empty((0, 3, 2, self.run.chain.p.dims))
        return ends, self.patterns, self._factors(time)

    def advance(self, start: int, steps: int) -> int:
        """Take steps on the grid of the run; returns how many were done."""
        first, last = np.searchsorted(self.instants.steps, (start, start + steps))
        save = self.instants.steps[first:last]
        return self._kernel(start, 1.0 / self.instants.steps_per_second, steps, 1, save, self.saved[first:last])

    def substep(self, number: int) -> bool:
        """Take one step in pieces, so short that Newton's method converges; returns whether it did."""
        keep = self.s.copy(), self.counts.copy()
        pieces = 4
        while pieces <= MAX_SUBSTEPS:
            # the step's own instant was saved when it was tried first
            none = np.empty(0, dtype=np.int64)
            step = 1.0 / (pieces * self.instants.steps_per_second)
            if self._kernel(number, step, pieces, pieces, none, self.saved[:0]) == pieces:
                self.substepped += 1
                return True
            self.s[:], self.counts[:] = keep
            pieces *= 4
        return False

    def _kernel(self, number: int, step: float, steps: int, pieces: int, save: np.ndarray, saved: np.ndarray) -> int:
        """Take `steps` steps from step `number` of the grid on, of which a step of the grid has `pieces`."""
        kernel, run, rate = self.kernel, self.run, self.instants.steps_per_second
        head = (self.s, self.links, self.spatial)
        last = (self.wants_extremes, steps, number, save, saved, self.counts)
        if run.formulation == "rattle":
            time = (number + np.arange(steps + 1) / pieces) / rate
            half, decay = 0.5 * step, 1.0
            if self.damping:
                decay = math.exp(-0.5 * self.damping * step)
                half = -math.expm1(-0.5 * self.damping * step) / self.damping
            done, self.status = kernel.rattle(
                *head, *self._tables(time), step, half, decay, self.damping, self._tolerance(time), *last
            )
        else:
            time = (number + np.arange(2 * steps + 1) / (2 * pieces)) / rate
            done, self.status = kernel.index1(
                *head, *self._tables(time), step, self.damping, self.stabilise, self._tolerance(time), *last
            )
        return done

    def why(self, cuts: int = MAX_SUBSTEPS) -> str:
        """Say what went wrong."""
        if self.status == layout.SINGULAR:
            return "the multipliers are singular (all links lie on a line between held ends)"
        return "Newton's method did not converge" + (f", with the step cut into {cuts}," if cuts else "")

    def save_last(self) -> None:
        """Save the state after the last step, which no step begins with."""
        dims = self.saved.shape[2]
        for i, row in enumerate((layout.X, layout.V)):
            self.saved[-1, i] = self.s[row : row + dims, : self.links + 1]

    def extremes(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Extremes of the tensions at all steps, the last one included."""
        if not self.wants_extremes:
            return None
        last = self.instants.steps[-1:] / self.instants.steps_per_second
        tension = self.states(last, self.saved[-1:, 0].copy(), self.saved[-1:, 1].copy(), np.zeros(1, dtype=bool))[1][0]
        low, high = (self.s[row, : self.links] for row in (layout.LOW, layout.HIGH))
        return np.minimum(low, tension), np.maximum(high, tension)

    def states(self, time: np.ndarray, x: np.ndarray, v: np.ndarray, onto: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (times, dims, n + 1) and tensions (times, n); x and v are projected where asked for, in place."""
        a, tension, done = self._states(self.s.copy(), time, x, v, onto)
        if self.status != layout.DONE:
            why = f"{self.why(0)} at {time[done]:.6g} s, an instant of the output; try a shorter step, or other times"
            self.run.stop(None, 0, self.instants.steps_per_second, why)
        return a, tension

    def _states(
        self, s: np.ndarray, time: np.ndarray, x: np.ndarray, v: np.ndarray, onto: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, int]:
        a, tension = np.empty_like(x), np.empty((len(x), self.links))
        done, self.status = self.kernel.states(
            s, self.links, self.spatial, self._ends(time), self.patterns, self._factors(time), self.damping,
            onto, self._tolerance(time), x, v, a, tension, self.counts,
        )  # fmt: skip
        return a, tension, done

    def is_finite(self) -> bool:
        """Whether all positions are finite and near."""
        position = self.s[layout.X : layout.X + 3]
        return bool(np.isfinite(position).all() and np.abs(position).max() < self.run.divergence_bound)

    def diagnostics(self) -> dict[str, Any]:
        """Return what is said of the run in attributes."""
        counts = self.counts
        exchanged = max(counts[layout.MOST_KINETIC], counts[layout.MOST_LOADS], counts[layout.MOST_ENDS])
        # below this rounding alone is left
        rounding = 1e3 * _EPS * self.force_scale * self.run.chain.total_length
        notes = {
            "length_error": float(counts[layout.LENGTH_ERROR]),
            "energy_drift": float(counts[layout.BALANCE] / max(exchanged, rounding, 1e-300)),
            "energy_exchanged": float(exchanged),
            "largest_turn_rate": math.sqrt(counts[layout.TURN]),
            "newton_iterations": int(counts[layout.ITERATIONS]),
            "steps_cut": self.substepped,
        }
        if counts[layout.FIRST_KINETIC] > 0.0:
            notes["start_jolt_energy"] = float(counts[layout.FIRST_KINETIC])
        if self.run.baumgarte is not None:
            notes["baumgarte"] = self.run.baumgarte
        return notes
