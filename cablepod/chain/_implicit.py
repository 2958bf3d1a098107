"""Implicit runs of the chain: trapezoidal rule, generalized alpha, energy-momentum."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cablepod.integrate._march import BLOCK
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._run import ChainRun, Trajectory

SCHEMES = ("trapezoidal", "generalized_alpha", "energy_momentum")
#: Newton's method ends with a correction that turns the links by so little, in the mean, that what the tangent does not know
#: of it changes the mean tension by no more than the first number: turned by an angle d a link is longer by half its square,
#: which pulls with K d^2/2.  The angle is kept between the other two.
TENSION_RTOL, MIN_ROTATION, MAX_ROTATION = 1e-10, 1e-9, 1e-6
#: What rounding makes of a correction, over the coordinates, in stiff chains; and in most.
ROUNDING, MIN_ROUNDING = 64.0 * float(np.finfo(float).eps), 8.0 * float(np.finfo(float).eps)
#: A step in which Newton's method does not converge is cut into so many at most.
MAX_SUBSTEPS = 1024


@dataclass(frozen=True)
class ImplicitChainRun(ChainRun):
    """One scene, ready to be run implicitly.

    All are of second order and stable at any step as far as linear theory goes.  The trapezoidal rule is generalized alpha with
    alphas 0; the energy-momentum method keeps the energy at any step.
    """

    method: str = SCHEMES[0]
    spectral_radius: float = 0.8  #: of generalized alpha, for frequencies that the step does not resolve

    @property
    def scheme(self) -> str:
        """Name of the scheme."""
        return self.method

    def __call__(self, rate: float) -> Trajectory:
        """Run with so many steps per second."""
        instants = self.instants(rate)
        total = int(instants.steps[-1])
        march = self.march(instants)
        done = 0
        while done < total:
            steps = min(BLOCK, total - done)
            reached = march.advance(done, steps)
            done += reached
            if reached < steps:
                if not march.substep(done):
                    self._stop(march, done, f"Newton's method did not converge, with the step cut into {MAX_SUBSTEPS},")
                done += 1
            if not march.is_finite():
                self._stop(march, done, "the chain left the finite numbers")
            if self.progress is not None:
                self.progress(done / total)
        march.save_last()
        return self.watch(self._gather(march, instants, instants.steps.size, march.extremes))

    def march(self, instants: OutputTimes) -> ImplicitStepper:
        """Return the state of a run; a model with steps of its own overrides it."""
        return ImplicitStepper(self, instants)

    def _gather(
        self, march: ImplicitStepper, instants: OutputTimes, keep: int, extremes: tuple[np.ndarray, np.ndarray] | None
    ) -> Trajectory:
        x, v, a = (np.ascontiguousarray(np.moveaxis(march.saved[:keep, i], 1, 2)) for i in range(3))
        if not self.wants_velocity(instants):
            state = self.state(instants, x, None, None, extremes)
        else:
            if self.method == "energy_momentum":
                a = self._accelerations(march, instants, x, v)
            state = self.state(instants, x, v, a, extremes)
        state.diagnostics = {"newton_iterations": march.iterations, "steps_cut": march.substepped}
        if self.method == "generalized_alpha":
            state.diagnostics["spectral_radius"] = self.spectral_radius
        return state

    def _accelerations(self, march: ImplicitStepper, instants: OutputTimes, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Accelerations at the saved steps, which the energy-momentum method does not have, from the forces there."""
        chain = self.chain
        time = instants.steps[: len(x)] / instants.steps_per_second
        force = chain.tensions_and_forces(x, v)[1]
        zero = np.zeros_like(force[:, :1])
        total = np.diff(np.concatenate([zero, force, zero], axis=1), axis=1) + chain.loads()
        for pattern, factor in chain.time_dependent_loads():
            total += factor(time)[:, None, None] * pattern
        a = np.zeros_like(x)
        a[:, chain.free_particles] = total[:, chain.free_particles] / march.mass[chain.free_particles, None]
        if chain.p.mass_damping is not None:
            a[:, chain.free_particles] -= chain.p.mass_damping * v[:, chain.free_particles]
        return a

    def _stop(self, march: ImplicitStepper, done: int, what: str) -> None:
        rate, times = march.instants.steps_per_second, march.instants.times
        # the step before the last one done is saved for certain, and so is what lies before it
        count = int(np.searchsorted(times, (done - 1) / rate * (1.0 + 1e-12), side="right")) if done > 0 else 0
        partial = None
        if count:
            few = OutputTimes.of(times[:count], rate)
            partial = self._gather(march, few, few.steps.size, None)
        why = (
            f"{what} at {done / rate:.6g} s ({self.method}, step {1 / rate:.4g} s, step number {done}); try a shorter step, "
            "scheme velocity_verlet, gentler loads or motion, or damping"
        )
        self.stop(partial, done, rate, why)


class ImplicitStepper:
    """The state of an implicit run, advanced in place by the kernels."""

    def __init__(self, run: ImplicitChainRun, instants: OutputTimes) -> None:
        chain, p, free = run.chain, run.chain.p, run.chain.free_particles
        self.run, self.instants = run, instants
        # the kernels loop over all particles: what moves them is 0 at those that are held
        self.mass = np.zeros(chain.links + 1)
        self.mass[free] = p.mass * chain.tributary_length[free]
        self.x = np.ascontiguousarray(run.initial.T)
        self.v = np.zeros_like(self.x)
        self.force, self.a = self._of_free(run.first_force()), np.zeros_like(self.x)
        self.a[:, free] = self.force[:, free] / self.mass[free]
        self.loads = self._of_free(chain.loads())
        self.varying = chain.time_dependent_loads()
        self.patterns = np.array([self._of_free(pattern) for pattern, _ in self.varying]) if self.varying else None
        self.saved = np.zeros((instants.steps.size, 3, p.dims, chain.links + 1))
        self.extremes = run.extremes()
        tension = float(np.abs(chain.tensions_and_forces(run.initial)[0]).mean())
        self.enough = min(max(math.sqrt(2.0 * TENSION_RTOL * tension / p.stiffness), MIN_ROTATION), MAX_ROTATION)
        self.iterations, self.substepped = 0, 0

    def _of_free(self, values: np.ndarray) -> np.ndarray:
        """(dims, n + 1) from (n + 1, dims), with 0 at the particles that are held."""
        free, result = self.run.chain.free_particles, np.zeros(values.shape[::-1])
        result[:, free] = values[free].T
        return result

    def advance(self, start: int, steps: int) -> int:
        """Take steps on the grid of the run; returns how many were done."""
        first, last = np.searchsorted(self.instants.steps, (start, start + steps))
        time = np.arange(start, start + steps + 1) / self.instants.steps_per_second
        return self._kernel(
            time,
            1.0 / self.instants.steps_per_second,
            start,
            steps,
            self.instants.steps[first:last],
            self.saved[first:last],
        )

    def substep(self, number: int) -> bool:
        """Take one step in pieces, so short that Newton's method converges; returns whether it did."""
        keep = [item.copy() for item in (self.x, self.v, self.a, self.force)]
        pieces = 2
        while pieces <= MAX_SUBSTEPS:
            time = (number + np.arange(pieces + 1) / pieces) / self.instants.steps_per_second
            # the step's own instant was saved when it was tried first
            if (
                self._kernel(
                    time,
                    1.0 / (pieces * self.instants.steps_per_second),
                    0,
                    pieces,
                    np.empty(0, dtype=np.int64),
                    self.saved[:0],
                )
                == pieces
            ):
                self.substepped += 1
                return True
            for target, source in zip((self.x, self.v, self.a, self.force), keep, strict=True):
                target[:] = source
            pieces *= 4
        return False

    def save_last(self) -> None:
        """Save the state after the last step, which no step begins with."""
        self.saved[-1] = self.x, self.v, self.a
        if self.extremes is not None:
            tension = self.run.chain.tensions_and_forces(self.x.T)[0]
            np.minimum(self.extremes[0], tension, out=self.extremes[0])
            np.maximum(self.extremes[1], tension, out=self.extremes[1])

    def is_finite(self) -> bool:
        """Whether all positions are finite and near."""
        return bool(np.isfinite(self.x).all() and np.abs(self.x).max() < self.run.divergence_bound)

    def _kernel(
        self, time: np.ndarray, step: float, start: int, steps: int, save: np.ndarray, saved: np.ndarray
    ) -> int:
        from cablepod.chain import _kernels_implicit as kernel  # numba is imported only to compute

        run, chain, p = self.run, self.run.chain, self.run.chain.p
        moving = run.moving
        ends = p.end_positions(time) if moving else None
        low, high = self.extremes or (None, None)
        links = (
            chain.free_particles.start,
            chain.free_particles.stop,
            chain.k,
            chain.length,
            chain.inverse_squares,
            self.mass,
            p.mass_damping,
        )
        loads = (
            self.loads,
            self.patterns,
            np.stack([factor(time) for _, factor in self.varying], axis=1) if self.varying else None,
            p.link_viscosity,
            np.ascontiguousarray(ends[:, 0]) if ends is not None and "lower" in moving else None,
            np.ascontiguousarray(ends[:, 1]) if ends is not None and "upper" in moving else None,
        )
        # where the chain is now and where its ends go: it may have been moved far from where it began
        largest = max(float(np.abs(self.x).max()), 0.0 if ends is None else float(np.abs(ends).max()))
        turned = largest * math.sqrt((1.0 / chain.length**2).mean())  # a link, by a coordinate that is off by itself
        last = (start, steps, save, saved, low, high)
        if run.method == "energy_momentum":
            rounding = (MIN_ROUNDING * turned, ROUNDING * turned)
            done, iterations = kernel.energy_momentum(self.x, self.v, *links, *loads, step, *rounding, *last)
        else:
            rates = p.end_positions(time, 1) if p.link_viscosity is not None else None
            done, iterations = kernel.generalized_alpha(
                self.x,
                self.v,
                self.a,
                self.force,
                *links,
                *loads,
                rates,
                step,
                *_weights(run),
                max(self.enough, ROUNDING * turned),
                *last,
            )
        self.iterations += iterations
        return done


def _weights(run: ImplicitChainRun) -> tuple[float, float, float, float]:
    """alpha_m, alpha_f, beta, gamma of Chung and Hulbert (1993) for a spectral radius; alphas 0 are the trapezoidal rule."""
    if run.method == "trapezoidal":
        return 0.0, 0.0, 0.25, 0.5
    radius = run.spectral_radius
    alpha_m, alpha_f = (2.0 * radius - 1.0) / (radius + 1.0), radius / (radius + 1.0)
    return alpha_m, alpha_f, 0.25 * (1.0 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f
