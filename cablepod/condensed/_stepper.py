"""Advance of one condensed run with a fixed step, block by block, and the arrays that the kernels fill."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.condensed._fields import CondensedTrajectory
from cablepod.condensed._kernels_layout import (
    AIR_ROWS,
    Damped,
    ExactWork,
    ExplicitState,
    Links,
    RateTerms,
    Record,
    RunAir,
    initial_monitor,
)
from cablepod.discretisation._mass_damping import decay_and_impulse, half_step_back

if TYPE_CHECKING:
    from cablepod.condensed._runs import CondensedRun

#: Name of the scheme of fourth order.
FOURTH_ORDER = "numerov"
#: Schemes whose steps must not be too long for the damping.
EXPLICIT = ("velocity_verlet", FOURTH_ORDER)
#: Maximum number of coordinates that is a constant of the compiled steps: each is compiled for itself, and faster by a third.
MAX_CONSTANT_SIZE = 16
#: Coordinates beyond this multiple of sqrt(mass) times length have diverged.
DIVERGENCE_FACTOR = 1e6


class CondensedStepper:
    """State and results of one run with a fixed step.

    Parameters
    ----------
    run
        Model, initial state, scheme and outputs.
    steps_per_second
        Inverse of the step [1/s].
    samples
        Whether to save samples for the error estimate, where the run has some.
    """

    def __init__(self, run: CondensedRun, steps_per_second: float, *, samples: bool = True) -> None:
        model, self.run = run.model, run
        self.steps_per_second, self.step = steps_per_second, 1.0 / steps_per_second
        self.instants = run.instants(steps_per_second)
        #: Steps to take; an explicit run takes one more, for the rates half a step after the last instant.
        self.total = int(self.instants.steps[-1]) + (1 if run.explicit else 0)
        self.sample_interval = run.sample_interval(steps_per_second) if samples else 0
        self.instants = run.saving(self.instants, self.sample_interval)
        count, r = self.instants.steps.size, len(model.shapes)
        self.saved, self.half_step_rates = np.empty((count, r)), np.empty((count, 2, r))
        #: Boundary data of the saved steps (steps, columns).
        self.boundary_data = np.empty((count, 1 + len(model.load_patterns) * model.chain.p.dims))
        self.monitor = initial_monitor(run.stable_phase**2 * steps_per_second**2, run.start.chord_tension)
        self.wants_extremes = "tension_extremes" in run.outputs
        # to leading order a tension needs no other link, with the exact stretch it does
        chosen: Any = slice(None) if run.links is None or not run.leading else run.links
        if not self.wants_extremes:
            chosen = slice(0)
        links = model.chain.length[chosen].size
        self.low, self.high = np.full(links, np.inf), np.full(links, -np.inf)
        self.modal_damping = model.damping_matrix.reshape(-1)  #: flat, without entries where there is none
        dampers = model.damper_matrix
        if run.scheme not in EXPLICIT and dampers.size:  # implicit steps solve for all rates alike
            self.modal_damping = (self.modal_damping if self.modal_damping.size else 0.0) + dampers.reshape(-1)
        #: Coordinates, rates and damped accelerations (3, r); an explicit run to leading order has a state of its own.
        self.state = self._initial_state()
        before = 3.0 * self.state[1] - 2.0 * run.start.rates  # the prediction at the start gives the rates there
        self.explicit_state = ExplicitState.of(self.state[0], self.state[1], before)
        self.exact_work: ExactWork | None = None  #: stretch and work arrays; None to leading order
        if run.leading:
            patterns = model.chordwise_force_patterns[:, chosen]
            tables = model.slopes[:, chosen], model.n_in_plane, patterns
            self.links = Links.of(*tables, self.low, self.high) if self.wants_extremes else None
        else:
            self.exact_work = model.exact_work(model.initial_boundary_data, tangent=not run.explicit)
        self.bounds = model.bounds()
        self.rate_terms, self.air = self._terms_of_rates()
        self.divergence_bound = DIVERGENCE_FACTOR * model.root_total_mass * model.chain.total_length

    @property
    def q(self) -> np.ndarray:
        """Coordinates of the last step (r,)."""
        return self.explicit_state.q if self.run.leading and self.run.scheme in EXPLICIT else self.state[0]

    @property
    def changed(self) -> tuple[np.ndarray, ...]:
        """All arrays that a step changes and the next one needs."""
        held = () if self.air is None else (self.air.held,)
        stretch = () if self.exact_work is None else (self.exact_work.stretch,)
        return self.state, *stretch, self.monitor, *self.explicit_state, *held

    def _initial_state(self) -> np.ndarray:
        """Return coordinates, rates (velocity Verlet: half a step before the start) and damped accelerations (3, r)."""
        start, damping = self.run.start, self.run.model.chain.p.damping
        rates, model, acceleration = start.rates, self.run.model, start.acceleration
        for matrix in (model.damping_matrix, model.damper_matrix):
            if not (matrix.size and rates.any()):
                continue
            damped = matrix @ rates
            acceleration = acceleration - (
                model.accelerations(damped, start.q, rates) if model.inertia.size else damped
            )
        if self.run.explicit:
            factor, back = half_step_back(damping, self.step)
            rates = factor * start.rates + back * acceleration
        return np.array([start.q, rates, acceleration - damping * start.rates])

    def _terms_of_rates(self) -> tuple[RateTerms | None, RunAir | None]:
        """Return damping beside that by mass, and air; None where there is neither."""
        run, damping, matrix = self.run, self.run.model.chain.p.tension_damping, self.modal_damping
        dampers = run.model.damper_matrix
        if damping is None and run.air is None and not matrix.size and not dampers.size:
            return None, None
        impulse = float(self._damped.impulse[0])  # as of all forces beside the damping by mass, for the second order
        half = 0.5 * impulse * dampers
        of_step = np.linalg.solve(np.eye(len(half)) + half, half).reshape(-1)
        terms, air = RateTerms(damping or 0.0, matrix, of_step), None
        if run.air is not None:
            hold = run.air.hold(run.start.chord_tension, self.step) if run.leading else 1
            velocity, rate, drag, shapes = run.air.arguments
            held, work = np.zeros((4, len(run.model.shapes))), np.empty(AIR_ROWS * drag.size)
            air = RunAir(velocity, rate, drag, shapes, run.model.n_in_plane, hold, held, work, run.air.bodies)
        return terms, air

    def advance(self, begin: int, steps: int) -> bool:
        """Take `steps` steps from number `begin`; return whether all were done and the coordinates are bounded."""
        run, output_steps = self.run, self.instants.steps
        final = begin + steps == self.total
        first = np.searchsorted(output_steps, begin)
        last = np.searchsorted(output_steps, begin + steps + (1 if final and not run.explicit else 0))
        after = steps - 1 if run.explicit else steps  # the last row of the boundary data
        if begin == 0 and run.scheme == FOURTH_ORDER:  # whose first step takes the loads of three instants
            after = max(after, min(2, self.total))
        boundary_data = run.model.boundary_data(begin, after, self.steps_per_second)
        self.boundary_data[first:last] = boundary_data[output_steps[first:last] - begin]
        record = Record.at(begin, output_steps, self.saved[None], self.half_step_rates[None])
        advance = self._advance_leading if run.leading else self._advance_exact
        done = advance(boundary_data, begin, steps, record)
        # not a number is not below the bound either
        return done in (None, steps) and float(np.abs(self.q).max()) < self.divergence_bound

    def _advance_leading(self, boundary_data: np.ndarray, begin: int, steps: int, record: Record) -> int | None:
        """Advance to leading order; return the steps done, None for an explicit run, which does all."""
        model, rows = self.run.model, boundary_data
        constant = self.run.scheme in EXPLICIT and len(model.shapes) <= MAX_CONSTANT_SIZE
        shared = model.sizes(constant=constant), model.terms, self.bounds, self.links
        if self.run.scheme not in EXPLICIT:
            from cablepod.condensed import _kernels_implicit  # numba is imported only to compute

            damping = model.chain.p.damping
            return _kernels_implicit.trapezoidal(
                *shared, self.step, damping, self.modal_damping, rows, steps, self.state, begin, record, self.monitor
            )
        from cablepod.condensed import _kernels_explicit as kernel

        if self.run.explicit:
            kernel.verlet(
                *shared, self._damped, self.rate_terms, self.air, rows, steps, self.explicit_state, begin, record,
                self.monitor,
            )  # fmt: skip
        else:
            kernel.numerov(*shared, self._damped, rows, steps, self.explicit_state, begin, record, self.monitor)
        return None

    def _advance_exact(self, boundary_data: np.ndarray, begin: int, steps: int, record: Record) -> int | None:
        """Advance with the exact chordwise stretch; return the steps done, None for an explicit run, which does all."""
        model = self.run.model
        shared = model.exact_terms, model.sizes(constant=False), model.terms, self.bounds
        outputs = boundary_data, self.state, self.exact_work, begin, record, self.low, self.high, self.monitor
        if self.run.explicit:
            from cablepod.condensed import _kernels_exact as kernel  # numba is imported only to compute

            kernel.exact_verlet(*shared, self._damped, self.rate_terms, self.air, *outputs)
            return None
        from cablepod.condensed import _kernels_implicit as kernel_implicit

        return kernel_implicit.exact_trapezoidal(
            *shared, self.step, model.chain.p.damping, self.modal_damping, *outputs
        )

    @property
    def _damped(self) -> Damped:
        """Step and damping of an explicit scheme."""
        model = self.run.model
        return damped_step(np.full(len(model.shapes), model.chain.p.damping, float), self.step, self.run.scheme)

    def trajectory(self, peak_times: tuple[float, float] | None = None) -> CondensedTrajectory:
        """Return what was computed so far; `peak_times` are those of the smallest and the largest tension [s]."""
        low, high, run = self.low, self.high, self.run
        if self.wants_extremes and run.links is not None and not run.leading:
            low, high = low[run.links], high[run.links]
        extremes = (low, high) if self.wants_extremes else None
        return CondensedTrajectory(
            self.instants, self.saved, self.half_step_rates, extremes, self.monitor, run.scheme, self.sample_interval,
            self.boundary_data, peak_times, run.window,
        )  # fmt: skip


def damped_step(damping: np.ndarray, step: float, scheme: str) -> Damped:
    """Return step [s] and damping (r lanes,) [1/s] as an explicit scheme needs them."""
    if scheme == FOURTH_ORDER:
        return Damped(step, damping, np.exp(-0.5 * damping * step), np.exp(0.5 * damping * step))
    return Damped(step, damping, *decay_and_impulse(damping, step))
