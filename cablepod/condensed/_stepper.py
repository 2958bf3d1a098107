"""Advance of one condensed run with a fixed step, block by block, and the arrays that the kernels fill."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.condensed._fields import CondensedTrajectory
from cablepod.condensed._kernels_layout import initial_monitor
from cablepod.integrate._march import BLOCK
from cablepod.integrate._means import with_steps_of_means
from cablepod.integrate._output_times import OutputTimes, with_judged
from cablepod.integrate._step_control import damped_growth

if TYPE_CHECKING:
    from cablepod.condensed._model import CondensedModel
    from cablepod.condensed._runs import CondensedRun

#: Name of the scheme of fourth order.
FOURTH_ORDER = "numerov"
#: Schemes whose steps must not be too long for the damping.
EXPLICIT = ("velocity_verlet", FOURTH_ORDER)
#: Coordinates beyond this multiple of sqrt(mass) times length have diverged.
DIVERGENCE_FACTOR = 1e6


class BoundaryDataOfTwo:
    """Boundary data of a run and of the next one with twice the steps: the first has every second row of the second.

    Parameters
    ----------
    model
        Model of the runs.
    steps_per_second
        Of the first run [1/s].
    """

    def __init__(self, model: CondensedModel, steps_per_second: float) -> None:
        self.model, self.steps_per_second = model, steps_per_second
        self.rows = np.empty((0, 0))  #: of the second run

    def __call__(self, begin: int, steps: int, steps_per_second: float) -> np.ndarray:
        """Return the boundary data of the steps `begin` ... `begin + steps`, both included."""
        if begin == 0 and 2 * steps < BLOCK and steps_per_second == self.steps_per_second:
            self.rows = self.model.boundary_data(0, 2 * steps, 2.0 * steps_per_second)
            return self.rows[::2].copy()
        if begin == 0 and steps < len(self.rows) and steps_per_second == 2.0 * self.steps_per_second:
            return self.rows[: steps + 1]
        return self.model.boundary_data(begin, steps, steps_per_second)


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
        self.instants = OutputTimes.of(with_judged(run.times, run.judged), steps_per_second)
        #: Steps to take; an explicit run takes one more, for the rates half a step after the last instant.
        self.total = int(self.instants.steps[-1]) + (1 if run.explicit else 0)
        self.sample_interval = run.sample_interval(steps_per_second) if samples else 0
        if self.sample_interval:
            self.instants = self.instants.with_multiples(self.sample_interval)
        self.instants = with_steps_of_means(self.instants, run.outputs, run.window)
        self.q, self.v, self.acceleration, self.stretch = self._initial_arrays()
        damping = model.chain.p.tension_damping
        #: Rates one and a half steps before the start, damping by the tension, and wind; None for absent terms.
        self._velocity_terms: tuple[Any, ...] = (None,) * 6
        #: Number of steps over which the drag is held, and its evaluations (4, r); None without wind.
        self._held_drag: tuple[Any, ...] = (None, None)
        if damping is not None or run.air is not None:
            before = 3.0 * self.v - 2.0 * run.start.rates  # the prediction at the start gives the rates there
            self._velocity_terms = (before, damping, *((None,) * 4 if run.air is None else run.air.arguments))
        if run.air is not None and run.leading:
            self._held_drag = (run.air.hold(run.start.chord_tension, self.step), np.zeros((4, len(model.shapes))))
        self.previous_acceleration = self.acceleration.copy()
        self.monitor = initial_monitor(run.stable_phase**2 * steps_per_second**2, run.start.chord_tension)
        count, r = self.instants.steps.size, len(model.shapes)
        self.saved, self.half_step_rates = np.empty((count, r)), np.empty((count, 2, r))
        #: Boundary data of the saved steps (steps, columns).
        self.boundary_data = np.empty((count, 1 + len(model.load_patterns) * model.chain.p.dims))
        #: Slopes (r, n), number of in-plane coordinates and chordwise force patterns (patterns, n) of the links with tensions.
        self.links = (model.slopes, model.n_in_plane, model.chordwise_force_patterns)
        chosen = run.links if run.leading else None  # to leading order a tension needs no other link
        if chosen is not None:
            slopes, patterns = (table.take(chosen, axis=1) for table in (self.links[0], self.links[2]))  # in C order
            self.links = (slopes, model.n_in_plane, patterns)
        links = self.links[0].shape[1]
        self.wants_extremes = "tension_extremes" in run.outputs
        self.low, self.high = (np.full(links if self.wants_extremes else 0, value) for value in (np.inf, -np.inf))
        #: Whether tensions are saved on the way; otherwise they follow from the saved coordinates.
        self.saves_tension = (
            chosen is not None and run.explicit and "tension" in run.outputs and not self.instants.needs_interpolation
        )
        self.tension_series = np.empty((count, links if self.saves_tension else 0))
        self.divergence_bound = DIVERGENCE_FACTOR * model.root_total_mass * model.chain.total_length

    @property
    def changed(self) -> tuple[np.ndarray, ...]:
        """All arrays that a step changes."""
        of_drag = [array for array in (self._velocity_terms[0], self._held_drag[1]) if array is not None]
        return self.q, self.v, self.acceleration, self.previous_acceleration, self.stretch, self.monitor, *of_drag

    def _initial_arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return q, rates (explicit: half a step before the start), accelerations (r,), and chordwise stretch (2, m)."""
        model, start = self.run.model, self.run.start
        damping = model.chain.p.damping
        stretch = np.empty((2, 0))
        if not self.run.leading:
            stretch = np.full((2, model.rule[2].size), model.stretch_guess(model.initial_boundary_data))
        damped = start.acceleration - damping * start.rates
        if self.run.scheme not in EXPLICIT:
            return start.q.copy(), start.rates.copy(), damped, stretch
        growth = damped_growth(damping, self.step)
        if not self.run.explicit:
            return start.q.copy(), start.rates.copy(), damped, stretch
        impulse_back = 0.5 * self.step if not damping else growth / damping
        return start.q.copy(), start.rates * (1.0 + growth) - impulse_back * start.acceleration, damped, stretch

    def advance(self, begin: int, steps: int) -> bool:
        """Take `steps` steps from number `begin`; return whether all were done and the coordinates are bounded."""
        run, output_steps = self.run, self.instants.steps
        final = begin + steps == self.total
        first = np.searchsorted(output_steps, begin)
        last = np.searchsorted(output_steps, begin + steps + (1 if final and not run.explicit else 0))
        table = run.model.boundary_data if run.boundary_data is None else run.boundary_data
        boundary_data = table(begin, steps - 1 if run.explicit else steps, self.steps_per_second)
        self.boundary_data[first:last] = boundary_data[output_steps[first:last] - begin]
        outputs = (
            begin, output_steps[first:last], self.saved[first:last], self.half_step_rates[first:last], self.low,
            self.high, self.monitor,
        )  # fmt: skip
        if run.leading:
            done = self._advance_leading(boundary_data, outputs, self.tension_series[first:last])
        else:
            done = self._advance_exact(boundary_data, outputs)
        # not a number is not below the bound either
        return done in (None, steps) and float(np.abs(self.q).max()) < self.divergence_bound

    def _advance_leading(
        self, boundary_data: np.ndarray, outputs: tuple[Any, ...], tension_series: np.ndarray
    ) -> int | None:
        """Advance to leading order; return the steps done, None for an explicit run, which does all."""
        # numba is imported only to compute
        model = self.run.model
        rest = (
            *model.leading_coefficients, model.geometric_stiffness_norms, model.chordwise_forces_at_candidates, *self.links,
            *outputs,
        )  # fmt: skip
        if self.run.explicit:
            from cablepod.condensed import _kernels_leading as kernel

            kernel.leading_verlet(
                self.q, self.v, self.step, *self._damping_factors, *self._velocity_terms, *self._held_drag, boundary_data,
                *rest,
                tension_series,
            )  # fmt: skip
            return None
        damping = model.chain.p.damping
        if self.run.scheme == FOURTH_ORDER:
            if self.q.size == 2:
                from cablepod.condensed._kernels_numerov_of_two import numerov_of_two as march
            else:
                from cablepod.condensed._kernels_leading_numerov import leading_numerov as march

            march(
                self.q, self.v, self.acceleration, self.previous_acceleration, self.step, damping, boundary_data, *rest
            )
            return None
        from cablepod.condensed import _kernels_leading_implicit as kernel_implicit

        return kernel_implicit.leading_implicit(
            self.q, self.v, self.acceleration, self.step, damping, boundary_data, *rest
        )

    def _advance_exact(self, boundary_data: np.ndarray, outputs: tuple[Any, ...]) -> int | None:
        """Advance with the exact chordwise stretch; return the steps done, None for an explicit run, which does all."""
        model, p = self.run.model, self.run.model.chain.p
        slopes, patterns, weights = model.rule
        rest = (
            p.stiffness, model.chain.total_length, model.slope_norms_squared, model.load_projection,
            model.geometric_stiffness_norms, slopes, model.n_in_plane, patterns, weights, model.green, model.inertia,
            self.stretch, *outputs,
        )  # fmt: skip
        state = (self.q, self.v, self.acceleration, self.step)
        if self.run.explicit:
            from cablepod.condensed import _kernels_exact as kernel

            kernel.exact_verlet(*state, *self._damping_factors, *self._velocity_terms[1:], boundary_data, *rest)
            return None
        from cablepod.condensed import _kernels_exact_implicit as kernel_implicit

        return kernel_implicit.exact_implicit(*state, p.damping, boundary_data, *rest)

    @property
    def _damping_factors(self) -> tuple[float, float]:
        """Factor of the rates by damping over a step, and rate gained in a step for unit acceleration [s]."""
        damping, step = self.run.model.chain.p.damping, self.step
        return math.exp(-damping * step), -math.expm1(-damping * step) / damping if damping else step

    def trajectory(self, peak_times: tuple[float, float] | None = None) -> CondensedTrajectory:
        """Return what was computed so far; `peak_times` are those of the smallest and the largest tension [s]."""
        low, high, run = self.low, self.high, self.run
        if self.wants_extremes and run.links is not None and not run.leading:
            low, high = low[run.links], high[run.links]
        extremes = (low, high) if self.wants_extremes else None
        tension = self.tension_series[self.instants.left] if self.saves_tension else None
        return CondensedTrajectory(
            self.instants, self.saved, self.half_step_rates, extremes, self.monitor, run.scheme, tension,
            self.sample_interval, self.boundary_data, peak_times, run.window,
        )  # fmt: skip
