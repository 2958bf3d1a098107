"""What runs of a chain share, whatever the scheme: the scene made ready, what is kept of a run, how it is labelled."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import xarray as xr

from cablepod._resources import check_memory
from cablepod.conventions import COORDINATES, label
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.discretisation._similarity import describe
from cablepod.errors import RunStopped
from cablepod.integrate._energy_check import check_energy
from cablepod.integrate._output_times import OutputTimes


@dataclass
class Trajectory:
    """What one run gives."""

    instants: OutputTimes
    position: np.ndarray  #: (times, n + 1, dims) [m]
    velocity: np.ndarray | None  #: the same [m/s]
    extremes: tuple[np.ndarray, np.ndarray] | None  #: of the tensions (n,) [N]
    diagnostics: dict[str, Any] = field(default_factory=dict)  #: attributes of the result that this run alone knows


def chain_coordinates(chain: LumpedChain) -> dict[str, Any]:
    """Coordinates of a result on the particles of a chain."""
    return {"arc_length": ("particle", chain.arc_length), "coordinate": _axes(chain.p.dims)}


@lru_cache
def _axes(dims: int) -> xr.IndexVariable:
    """Names of the axes; to make their index takes as long as a hundred steps of a chain."""
    return xr.IndexVariable("coordinate", list(COORDINATES[:dims]))


def law_suffix(chain: LumpedChain) -> str:
    """Return what a title says of the law."""
    return f", {chain.law} law" if chain.green else ""


@dataclass(frozen=True)
class ChainRun:
    """One scene, ready to be run with any step by one scheme."""

    chain: LumpedChain
    times: np.ndarray
    initial: np.ndarray
    outputs: tuple[str, ...]
    progress: Callable[[float], None] | None
    title: str

    @property
    def scheme(self) -> str:
        """Name of the scheme."""
        raise NotImplementedError

    @property
    def remedy(self) -> str:
        """What to try where a run gains energy from nothing."""
        return "a step half as long" + ("" if self.scheme == "energy_momentum" else ", or scheme energy_momentum")

    def __call__(self, rate: float) -> Trajectory:
        """Run with so many steps per second."""
        raise NotImplementedError

    @cached_property
    def moving(self) -> set[str]:
        """The ends that move as the scene says."""
        return {end for end, _ in self.chain.p.motions}

    @cached_property
    def divergence_bound(self) -> float:
        """A distance that no sound run reaches [m]."""
        return 1e6 * (self.chain.total_length + float(np.abs(self.initial).max()))

    def instants(self, rate: float) -> OutputTimes:
        """Place the instants of the output on the steps."""
        instants = OutputTimes.of(self.times, rate)
        if instants.needs_interpolation:  # both neighbours of an instant are kept, with rates on either side
            links, dims = self.chain.links, self.chain.p.dims
            check_memory(instants.times.size, links, dims, key="times between two steps", variables=12)
        return instants

    def wants_velocity(self, instants: OutputTimes) -> bool:
        """Whether velocities are needed for what is asked for."""
        viscous = "tension" in self.outputs and self.chain.p.link_viscosity is not None
        return instants.needs_interpolation or "velocity" in self.outputs or viscous

    def extremes(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Extremes of the tensions before the run, where they are asked for."""
        if "tension_extremes" not in self.outputs:
            return None
        return np.full(self.chain.links, np.inf), np.full(self.chain.links, -np.inf)

    def first_force(self) -> np.ndarray:
        """Total forces on all particles (n + 1, dims) at the start, which is from rest [N]."""
        p, free = self.chain.p, self.chain.free_particles
        rates = np.zeros_like(self.initial)
        rates[0], rates[-1] = p.end_positions(np.zeros(1), 1)[0]
        rates[free] = 0.0
        _, force = self.chain.tensions_and_forces(self.initial, rates)
        zero = np.zeros((1, p.dims))
        return np.diff(np.concatenate([zero, force, zero]), axis=0) + self.chain.loads(0.0)

    def state(
        self,
        instants: OutputTimes,
        x: np.ndarray,
        v: np.ndarray | None,
        a: np.ndarray | None,
        extremes: tuple[np.ndarray, np.ndarray] | None,
    ) -> Trajectory:
        """Take what was saved at steps to the instants of the output.

        Parameters
        ----------
        instants
            Where they are.
        x, v, a
            Positions (saves, n + 1, dims), velocities and accelerations at the saved steps; the latter two None where not wanted,
            and of the ends filled in here.
        extremes
            Of the tensions.
        """
        if v is None or a is None:
            return Trajectory(instants, instants.at_times(x, None, None), None, extremes)
        p, free, rate = self.chain.p, self.chain.free_particles, instants.steps_per_second
        held = [end for end in (0, -1) if not free.start <= end % len(self.initial) < free.stop]
        time = instants.steps / rate
        for target, order in ((v, 1), (a, 2)):
            target[:, held] = p.end_positions(time, order)[:, held]
        velocity = None
        if "velocity" in self.outputs or "tension" in self.outputs:
            velocity = instants.rates_at_times(v, a)
        return Trajectory(instants, instants.at_times(x, v, a), velocity, extremes)

    def initial_velocity_jump(self) -> dict[str, float]:
        """Attributes of a run whose ends start to move at once, at a speed other than 0; empty for others.

        The chain is at rest until then.  A jump of the speed along the cable by v sends out an axial wave, behind which the
        tension has changed by v sqrt(K mu); when it has run along the cable once it carries the energy mu L v^2.
        """
        p, total = self.chain.p, self.chain.total_length
        rates = p.end_positions(np.zeros(1), 1)[0]
        reach = np.diff(self.initial[[0, 1, -2, -1]], axis=0)[[0, 2]]
        size = np.sqrt(square(reach))
        if not rates.any() or not size.all():
            return {}
        along = (rates * reach).sum(axis=1) / size
        return {
            "start_jolt_speed": math.sqrt(square(rates).max()),
            "start_jolt_tension": float(np.abs(along).max()) * math.sqrt(p.stiffness * p.mass),
            "start_jolt_energy": p.mass * total * float((along**2).sum()),
        }

    def watch(self, state: Trajectory) -> Trajectory:
        """Stop a run whose links hold more energy than anything can explain, see :mod:`cablepod.integrate._energy_check`."""
        energy, excess, broken = check_energy(
            self.chain, self.initial, self.times, state.instants.times, state.position
        )
        state.diagnostics["energy_excess"] = float(excess.max(initial=0.0))
        if not broken.any():
            return state
        first, rate = int(np.argmax(broken > 0.0)), state.instants.steps_per_second
        when = float(state.instants.times[first])
        limit = (
            f", limit {state.diagnostics['step_limit']:.4g} s for taut links"
            if "step_limit" in state.diagnostics
            else ""
        )
        kept = None
        if first:
            kept = (
                self.dataset(state)
                .isel(time=slice(first))
                .drop_vars(["tension_minimum", "tension_maximum"], errors="ignore")
            )
            kept.attrs["incomplete"] = f"stopped at {when:.6g} s of {self.times[-1]:.6g} s"
        raise RunStopped(
            f"the run broke down: at {when:.6g} s the links hold {energy[first]:.3g} J, {broken[first]:.1g} times what rest, "
            f"loads and ends explain ({self.scheme}, step {1 / rate:.4g} s{limit}); try {self.remedy}",
            kept,
        )

    def stop(self, partial: Trajectory | None, done: int, rate: float, why: str) -> None:
        """Raise :class:`RunStopped`, with what was computed before step `done`."""
        kept = None
        if partial is not None:
            kept = self.dataset(partial)
            kept.attrs["incomplete"] = f"stopped at {done / rate:.6g} s of {self.times[-1]:.6g} s"
        raise RunStopped(why, kept)

    def dataset(self, state: Trajectory) -> xr.Dataset:
        """Label what a run gave."""
        result = xr.Dataset(*self.arrays(state))
        label(result)
        result.attrs.update(self.attributes(state))
        return result

    def arrays(self, state: Trajectory) -> tuple[dict[str, Any], dict[str, Any]]:
        """Variables of the result, and its coordinates."""
        chain = self.chain
        variables: dict[str, Any] = {}
        if "position" in self.outputs:
            variables["position"] = (("time", "particle", "coordinate"), state.position)
        if "velocity" in self.outputs:
            variables["velocity"] = (("time", "particle", "coordinate"), state.velocity)
        if "tension" in self.outputs:
            variables["tension"] = (("time", "link"), chain.tensions_and_forces(state.position, state.velocity)[0])
        if state.extremes is not None:
            variables["tension_minimum"], variables["tension_maximum"] = (("link", item) for item in state.extremes)
        variables["unstretched_length"] = ((), chain.total_length)
        about, names = describe(
            chain.p,
            chain.total_length,
            float(state.instants.times[-1]),
            0.5 * float(chain.statics[4] + chain.statics[5]),
        )
        return {**variables, **about}, {"time": state.instants.times, **chain_coordinates(chain), **names}

    def attributes(self, state: Trajectory) -> dict[str, Any]:
        """Attributes of the result."""
        chain, rate = self.chain, state.instants.steps_per_second
        attrs = {
            "title": f"{self.title}: elastic chain of {chain.links} links{law_suffix(chain)}",
            "stage": "trajectory",
            "model": "elastic chain",
            "law": chain.law,
            "scheme": self.scheme,
            "step": 1.0 / rate,
            "number_of_steps": int(state.instants.steps[-1]),
            "highest_angular_frequency": chain.highest_frequency(chain.tangent_stiffness_ratio(self.initial)),
            **state.diagnostics,
            **self.initial_velocity_jump(),
        }
        if chain.green:
            attrs["smallest_stretch"] = float(chain.stretch(state.position).min())
        return attrs
