"""Run of one scene on a chain, a mesh or rigid links: energy check and labels of the result, for all schemes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NoReturn, Self

import numpy as np
import xarray as xr

from cablepod._resources import check_memory
from cablepod.conventions import label, shared_coordinates
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.discretisation._similarity import describe
from cablepod.integrate._comparison import ComparableRuns, motion_scale
from cablepod.integrate._energy_check import ENERGY_STOP, check_energy, max_energy_of_run
from cablepod.integrate._means import Means, means, wants_means
from cablepod.integrate._output import (
    Extremes,
    chain_coordinates,
    is_over_links,
    law_suffix,
    mean_variables,
    middles_of,
    peak_variables,
    time_scale_attributes,
    trajectory_attributes,
    trajectory_variables,
)
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._particle_air import OF_DRAG, ParticleAir, ParticleForces
from cablepod.integrate._run import Run
from cablepod.integrate._window import window_attributes

#: Rounding error of a link's stretch over its coordinates in links.
ROUNDING = 16.0 * float(np.finfo(float).eps)


@dataclass
class Trajectory:
    """Arrays of one run at the output times."""

    instants: OutputTimes
    position: np.ndarray  #: (times, n + 1, dims) [m]
    velocity: np.ndarray | None  #: as `position` [m/s]
    extremes: Extremes  #: minimum and maximum of the tensions (n,) [N]
    diagnostics: dict[str, Any] = field(default_factory=dict)  #: attributes of the result from the run itself
    peak_times: tuple[float, float] | None = None  #: of the smallest and the largest tension [s]; None if not requested
    means: Means = None  #: time mean and root mean square of the tensions (n,) [N]
    #: Of rigid links, whose positions do not tell them (times, n) [N]; None for elastic ones, and where they are no output
    tension: np.ndarray | None = None

    def only(self, times: np.ndarray) -> Trajectory:
        """Return the trajectory at some of its instants [s]."""
        rows = np.isin(self.instants.times, times)
        if rows.all():
            return self
        return replace(
            self,
            instants=OutputTimes.of(self.instants.times[rows], self.instants.steps_per_second),
            position=self.position[rows],
            velocity=None if self.velocity is None else self.velocity[rows],
            tension=None if self.tension is None else self.tension[rows],
        )


def note_tension_error(state: Trajectory, error: float) -> None:
    """Add the estimated time error of the tensions, as a fraction of their range, to the attributes of the result."""
    state.diagnostics["tension_time_error_estimate"] = error


@dataclass(frozen=True)
class ChainRun(Run):
    """One scene on a chain, prepared for runs with any step by one scheme."""

    chain: LumpedChain
    initial: np.ndarray  #: positions at the start (n + 1, dims) [m]
    title: str = "scene"  #: of the scene
    #: Drag of the wind on the particles; None for still air
    air: ParticleAir | None = field(default=None, kw_only=True)
    #: Dampers and springs on the particles; None without
    attached: ParticleForces | None = field(default=None, kw_only=True)

    @property
    def cells(self) -> LumpedChain:
        """Discretisation of the cable in space."""
        return self.chain

    @property
    def scheme(self) -> str:
        """Name of the scheme."""
        raise NotImplementedError

    @property
    def remedy(self) -> str:
        """Advice for a run that gains energy from numerical errors."""
        return ("" if self.scheme == "energy_momentum" else "scheme energy_momentum, or ") + "a step half as long"

    def as_companion(self) -> Self:
        """Return this run as one that only estimates the error of another: the same, but for implicit steps."""
        return self

    @cached_property
    def step_limit(self) -> float:
        """Stability limit of explicit steps at the start: that of the links or elements, and of the drag [s]."""
        limit = self.chain.step_limit(self.chain.tangent_stiffness_ratio(self.initial))
        return limit if self.air is None else min(limit, self.air.step_limit(self.end_time))

    @property
    def limit_text(self) -> str:
        """How the stability limit follows."""
        if self.air is not None and self.step_limit == self.air.step_limit(self.end_time):
            return OF_DRAG
        return f"2 over the highest angular frequency, {2 / self.step_limit:.6g} rad/s"

    @property
    def unforced_step(self) -> float:
        """Step of the first run without regard to motions, loads and wind [s]."""
        raise NotImplementedError

    @property
    def step_of_air(self) -> float:
        """Longest step that resolves the wind [s]."""
        return math.inf if self.air is None else 0.5 * self.air.interval

    @cached_property
    def moving(self) -> set[str]:
        """Names of the ends with a motion."""
        return {end for end, _ in self.chain.p.motions}

    @cached_property
    def divergence_bound(self) -> float:
        """Coordinate above which a run is considered divergent [m]."""
        return 1e6 * (self.chain.total_length + float(np.abs(self.initial).max()))

    def instants(self, steps_per_second: float) -> OutputTimes:
        """Place the output times on the steps, with the steps that means of the tensions need."""
        instants = self.saving(super().instants(steps_per_second))
        links, dims = self.chain.links, self.chain.p.dims
        if instants.needs_interpolation:
            # at both neighbours: positions, velocities and accelerations, as kernels save and as outputs order them (12), in
            # explicit runs half-step velocities of all nodes (4); the terms of the polynomials (10)
            check_memory(instants.times.size, links, dims, key="times between two steps", variables=26)
        if wants_means(self.outputs):
            check_memory(instants.steps.size, links, dims, key="steps of the means", variables=6)
        return instants

    def wants_velocity(self, instants: OutputTimes) -> bool:
        """Whether the outputs need velocities at the saved steps."""
        viscous = ("tension" in self.outputs or wants_means(self.outputs)) and self.chain.p.link_viscosity is not None
        return instants.needs_interpolation or "velocity" in self.outputs or viscous

    def extremes(self) -> Extremes:
        """Return initial values of the tension extremes, None if they are not an output."""
        if "tension_extremes" not in self.outputs:
            return None
        links = self.chain.particles.size - 1
        return np.full(links, np.inf), np.full(links, -np.inf)

    def first_force(self) -> np.ndarray:
        """Return the total forces on all particles at the start from rest (n + 1, dims) [N]."""
        p, free = self.chain.p, self.chain.free_particles
        rates = np.zeros_like(self.initial)
        rates[0], rates[-1] = p.end_positions(np.zeros(1), 1)[0]
        rates[free] = 0.0
        total = self.chain.forces(self.initial, rates) + self.chain.loads(0.0)
        if self.attached is not None:
            total = total + self.attached.force(self.initial, rates)
        return total if self.air is None else total + self.air.force(self.initial, rates)

    def state(
        self,
        instants: OutputTimes,
        x: np.ndarray,
        v: np.ndarray | None,
        a: np.ndarray | None,
        extremes: Extremes,
    ) -> Trajectory:
        """Interpolate a trajectory from the saved steps to the output times.

        Parameters
        ----------
        instants
            Output times on the steps.
        x, v, a
            Positions, velocities and accelerations at the saved steps (saves, n + 1, dims); the latter two None if they are not
            needed.  Values of the held ends are filled in here.
        extremes
            Minimum and maximum of the tensions (n,) [N].
        """
        if v is None or a is None:
            position, of_steps = instants.at_times(x, None, None), self.means_of(instants, x, None)
            return Trajectory(instants, position, None, extremes, means=of_steps)
        p, free = self.chain.p, self.chain.free_particles
        held = [end for end in (0, -1) if not free.start <= end % len(self.initial) < free.stop]
        time = instants.steps / instants.steps_per_second
        for target, order in ((v, 1), (a, 2)):
            target[:, held] = p.end_positions(time, order)[:, held]
        velocity = None
        if "velocity" in self.outputs or "tension" in self.outputs:
            velocity = instants.rates_at_times(v, a)
        return Trajectory(instants, instants.at_times(x, v, a), velocity, extremes, means=self.means_of(instants, x, v))

    def means_of(self, instants: OutputTimes, x: np.ndarray, v: np.ndarray | None) -> Means:
        """Return time mean and root mean square of the tensions (n,) [N] of saved steps; None if not requested.

        Parameters
        ----------
        instants
            Output times on the steps.
        x, v
            Positions and, for viscous links, velocities at the saved steps (saves, n + 1, dims).
        """
        if not wants_means(self.outputs) or instants.times.size < self.times.size:
            return None

        def tension(part: slice) -> np.ndarray:
            return self.chain.tensions_and_forces(x[part], None if v is None else v[part])[0]

        return means(instants, self.window, tension, self.chain.particles.size - 1)

    def initial_velocity_jump(self) -> dict[str, float]:
        """Return attributes about ends that start with a nonzero speed; empty for all other runs.

        The chain itself starts from rest.  A jump v of the end speed along the cable sends out an axial wave, behind which the
        tension has changed by v sqrt(K mu) of its segment.  After one passage the wave carries the energy mu L v^2.
        """
        p, total = self.chain.p, self.chain.total_length
        rates = p.end_positions(np.zeros(1), 1)[0]
        reach = np.diff(self.initial[[0, 1, -2, -1]], axis=0)[[0, 2]]
        length = np.sqrt(square(reach))
        if not rates.any() or not length.all():
            return {}
        along = (rates * reach).sum(axis=1) / length
        parts = (p.segments[0], p.segments[-1]) if p.segments else (p, p)
        impedance = np.array([math.sqrt(part.stiffness * part.mass) for part in parts])
        return {
            "start_jolt_speed": math.sqrt(square(rates).max()),
            "start_jolt_tension": float((np.abs(along) * impedance).max()),
            "start_jolt_energy": p.mass * total * float((along**2).sum()),
        }

    def compared(self, state: Trajectory) -> np.ndarray:
        """Return the positions of a trajectory that are compared (times, points, dims) [m]."""
        return self.chain.at_compared(state.position)

    def motion(self, state: Trajectory) -> float:
        """Return the largest rms displacement, or the chord if nothing moves [m]."""
        return self.motion_of(self.compared(state))

    def motion_of(self, compared: np.ndarray) -> float:
        """Return the same of positions at the points at which runs are compared."""
        return motion_scale(compared, self.chain.at_compared(self.initial), self.chain.chord)

    def has_kinks(self, state: Trajectory) -> bool:
        """Whether links go slack, which are kinks of the linear law only."""
        return not self.chain.green and bool((self.chain.stretch(state.position) < 1.0).any())

    def comparable_runs(self) -> ComparableRuns:
        """Describe runs with any step for the step control."""
        return self.comparable(self.unforced_step, **self.compared_tensions())

    def compared_tensions(self) -> dict[str, Any]:
        """Return how tensions are compared, where they are among the outputs."""
        if not {"tension", "tension_extremes"} & set(self.outputs):
            return {}
        # by rounding of the coordinates, which stiff links turn into tension
        reach, link = float(np.abs(self.initial).max()), self.chain.total_length / self.chain.links
        own = self.chain.p.link_stiffness
        stiffness = self.chain.p.stiffness if own is None else link * float(np.max(own))
        rounding = ROUNDING * stiffness * (1.0 + reach / link)
        return {"tension": self.compared_tension, "tension_rounding": rounding, "note_tension": note_tension_error}

    def compared_tension(self, state: Trajectory) -> np.ndarray:
        """Return the tensions among the outputs (rows, links) [N]: at the output times, and extremes."""
        rows = [self.tension(state)] if "tension" in self.outputs else []
        return np.concatenate([*rows, *([] if state.extremes is None else [np.stack(state.extremes)])])

    @cached_property
    def energy_bound(self) -> float:
        """Bound of the energy that can be supplied over the whole run [J]."""
        return max_energy_of_run(self.chain, self.initial, self.times) + self.held_energy

    @property
    def held_energy(self) -> float:
        """Energy of springs to the ground at the start [J]."""
        return 0.0 if self.attached is None else self.attached.energy(self.initial)

    def check_energy(self, state: Trajectory) -> Trajectory:
        """Stop a run with excessive strain energy, see :mod:`cablepod.integrate._energy_check`."""
        if self.air is None:
            energy, excess, broken = check_energy(
                self.chain,
                self.initial,
                self.energy_bound,
                state.instants.times,
                state.position,
                self.held_energy,
            )
        else:  # the work of the wind until an instant is not bounded
            energy = self.chain.strain_energy(state.position)
            excess = energy / (self.energy_bound + self.air.energy_bound(self.initial))
            broken = np.where(excess > ENERGY_STOP, excess, 0.0)
        state.diagnostics["energy_excess"] = float(excess.max(initial=0.0))
        if broken.any():
            first = int(np.argmax(broken > 0.0))
            self._stop_broken(state, first, energy[first], broken[first])
        return state

    def _stop_broken(self, state: Trajectory, first: int, energy: float, ratio: float) -> NoReturn:
        """Raise :class:`cablepod.errors.RunStopped` for excessive strain energy [J] at output time number `first`."""
        time, limit, partial = float(state.instants.times[first]), "", None
        if "step_limit" in state.diagnostics:
            limit = f", limit {state.diagnostics['step_limit']:.4g} s for taut links"
        if first:
            partial = self.dataset(replace(state, extremes=None, means=None)).isel(time=slice(first))
        self.stop(
            partial,
            time,
            f"the run broke down: at {time:.6g} s the links hold {energy:.3g} J, {ratio:.1g} times what rest, loads and ends "
            f"explain ({self.scheme}, step {1 / state.instants.steps_per_second:.4g} s{limit}); try {self.remedy}",
        )

    def dataset(self, state: Trajectory) -> xr.Dataset:
        """Make the result of a run: variables with units, attributes."""
        variables, coords = self.arrays(state)
        result = label(xr.Dataset(variables, coords=shared_coordinates(coords)))
        result.attrs.update(self.attributes(state))
        return result

    def arrays(self, state: Trajectory) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the variables of the result and its coordinates."""
        values = {
            "position": lambda: self.chain.interpolate(state.position),
            "velocity": lambda: self.chain.interpolate(state.velocity),
            "tension": lambda: self.tension(state),
        }
        variables: dict[str, Any] = trajectory_variables(self.outputs, state.extremes, values)
        variables["unstretched_length"] = ((), self.chain.total_length)
        middles = middles_of(self.chain.particles)
        variables |= peak_variables(state.extremes, state.peak_times, middles) | mean_variables(
            self.outputs, state.means
        )
        coords = chain_coordinates(self.chain, has_links=is_over_links(variables))
        features, names = self.features(float(state.instants.times[-1]))
        return variables | features, {"time": state.instants.times, **coords, **names}

    def tension(self, state: Trajectory) -> np.ndarray:
        """Return the tensions (times, links) [N]."""
        return self.chain.tensions_and_forces(state.position, state.velocity)[0]

    def features(self, end_time: float) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the variables of the similarity numbers until `end_time` [s], and their coordinate."""
        chain = self.chain
        return describe(chain.p, chain.total_length, end_time, 0.5 * float(chain.statics[4] + chain.statics[5]))

    def attributes(self, state: Trajectory) -> dict[str, Any]:
        """Return the attributes of the result."""
        chain = self.chain
        attrs = {
            "title": f"{self.title}: elastic chain of {chain.links} links{law_suffix(chain)}",
            **trajectory_attributes("elastic chain", self.scheme, state.instants, law=chain.law),
            "highest_angular_frequency": chain.highest_frequency(chain.tangent_stiffness_ratio(self.initial)),
            **state.diagnostics,
            **self.initial_velocity_jump(),
            **time_scale_attributes(chain.p),
            **chain.p.offsets(),
            **window_attributes(self.window),
        }
        if chain.green:
            attrs["smallest_stretch"] = float(chain.stretch(state.position).min())
        return attrs
