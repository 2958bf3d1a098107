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
from cablepod.discretisation._chain import Chain, square
from cablepod.discretisation._laws import strain_energy_density
from cablepod.discretisation._similarity import describe
from cablepod.errors import RunStopped
from cablepod.integrate._output_times import Instants

#: Strain energy over what rest, loads and ends can explain: a run above the second number has broken down, one above the first is
#: suspect (resonance, or a step too long for links that slacken and snap taut).  Sound runs of hard cases stay below 1.
SUSPECT, BROKEN = 10.0, 1e3
#: Strain energy over what start, loads and ends have put in until then, for which positions and tensions of the run count: never
#: above 1 but for what happens between two instants and the error of the scheme; garbage of the hardest scenes has 12 and more.
#: Not looked at below the second number times what can be put in at all, where rounding and small errors decide.
UNEXPLAINED, NOTICED = 10.0, 1e-2
#: Instants at which the way of the ends and the variation of the loads are added up: in a period or ramp, and at most.
PER_CHANGE, MOST_INSTANTS = 16.0, 1_000_000


@dataclass
class State:
    """What one run gives."""

    instants: Instants
    position: np.ndarray  #: (times, n + 1, dims) [m]
    velocity: np.ndarray | None  #: the same [m/s]
    extremes: tuple[np.ndarray, np.ndarray] | None  #: of the tensions (n,) [N]
    notes: dict[str, Any] = field(default_factory=dict)  #: attributes of the result that this run alone knows


def coordinates(chain: Chain) -> dict[str, Any]:
    """Coordinates of a result on the particles of a chain."""
    return {"arc_length": ("particle", chain.arc_length), "coordinate": _axes(chain.p.dims)}


@lru_cache
def _axes(dims: int) -> xr.IndexVariable:
    """Names of the axes; to make their index takes as long as a hundred steps of a chain."""
    return xr.IndexVariable("coordinate", list(COORDINATES[:dims]))


def suffix(chain: Chain) -> str:
    """Return what a title says of the law."""
    return f", {chain.law} law" if chain.green else ""


@dataclass(frozen=True)
class Run:
    """One scene, ready to be run with any step by one scheme."""

    chain: Chain
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
    def cure(self) -> str:
        """What to try where a run gains energy from nothing."""
        return "a step half as long" + ("" if self.scheme == "energy_momentum" else ", or scheme energy_momentum")

    def __call__(self, rate: float) -> State:
        """Run with so many steps per second."""
        raise NotImplementedError

    @cached_property
    def moving(self) -> set[str]:
        """The ends that move as the scene says."""
        return {end for end, _ in self.chain.p.motions}

    @cached_property
    def bound(self) -> float:
        """A distance that no sound run reaches [m]."""
        return 1e6 * (self.chain.total_length + float(np.abs(self.initial).max()))

    def instants(self, rate: float) -> Instants:
        """Place the instants of the output on the steps."""
        instants = Instants.of(self.times, rate)
        if instants.dense:  # both neighbours of an instant are kept, with rates on either side
            links, dims = self.chain.links, self.chain.p.dims
            check_memory(instants.times.size, links, dims, key="times between two steps", variables=12)
        return instants

    def wants_velocity(self, instants: Instants) -> bool:
        """Whether velocities are needed for what is asked for."""
        viscous = "tension" in self.outputs and self.chain.p.link_viscosity is not None
        return instants.dense or "velocity" in self.outputs or viscous

    def extremes(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Extremes of the tensions before the run, where they are asked for."""
        if "tension_extremes" not in self.outputs:
            return None
        return np.full(self.chain.links, np.inf), np.full(self.chain.links, -np.inf)

    def first_force(self) -> np.ndarray:
        """Total forces on all particles (n + 1, dims) at the start, which is from rest [N]."""
        p, free = self.chain.p, self.chain.free
        rates = np.zeros_like(self.initial)
        rates[0], rates[-1] = p.end_positions(np.zeros(1), 1)[0]
        rates[free] = 0.0
        _, force = self.chain.pull(self.initial, rates)
        zero = np.zeros((1, p.dims))
        return np.diff(np.concatenate([zero, force, zero]), axis=0) + self.chain.loads(0.0)

    def state(
        self,
        instants: Instants,
        x: np.ndarray,
        v: np.ndarray | None,
        a: np.ndarray | None,
        extremes: tuple[np.ndarray, np.ndarray] | None,
    ) -> State:
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
            return State(instants, instants.at_times(x, None, None), None, extremes)
        p, free, rate = self.chain.p, self.chain.free, instants.rate
        held = [end for end in (0, -1) if not free.start <= end % len(self.initial) < free.stop]
        time = instants.steps / rate
        for target, order in ((v, 1), (a, 2)):
            target[:, held] = p.end_positions(time, order)[:, held]
        velocity = None
        if "velocity" in self.outputs or "tension" in self.outputs:
            velocity = instants.rates_at_times(v, a)
        return State(instants, instants.at_times(x, v, a), velocity, extremes)

    def jolt(self) -> dict[str, float]:
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

    def watch(self, state: State) -> State:
        """Stop a run whose links hold more energy than anything can explain: finite numbers may be garbage too.

        The stability limit of the step holds for taut links; where links slacken and snap taut, explicit runs well below it may
        gain energy in every snap, and stay finite because slack links do not pull.
        """
        energy = self._strain_energy(state.position)
        at_hand = self._energy_at_hand()
        excess = energy / at_hand
        state.notes["energy_excess"] = float(excess.max(initial=0.0))
        broken = excess > BROKEN
        if state.notes["energy_excess"] > NOTICED:
            put_in = self._energy_put_in(state) + NOTICED / UNEXPLAINED * at_hand
            broken |= energy > UNEXPLAINED * put_in
            excess = np.maximum(excess, energy / put_in)
        if not broken.any():
            return state
        first, rate = int(np.argmax(broken)), state.instants.rate
        when = float(state.instants.times[first])
        limit = f", limit {state.notes['step_limit']:.4g} s for taut links" if "step_limit" in state.notes else ""
        kept = None
        if first:
            kept = (
                self.dataset(state)
                .isel(time=slice(first))
                .drop_vars(["tension_minimum", "tension_maximum"], errors="ignore")
            )
            kept.attrs["incomplete"] = f"stopped at {when:.6g} s of {self.times[-1]:.6g} s"
        raise RunStopped(
            f"the run broke down: at {when:.6g} s the links hold {energy[first]:.3g} J, {excess[first]:.1g} times what rest, "
            f"loads and ends explain ({self.scheme}, step {1 / rate:.4g} s{limit}); try {self.cure}",
            kept,
        )

    def _strain_energy(self, position: np.ndarray) -> np.ndarray:
        """Strain energy of all links (times,) [J]."""
        chain = self.chain
        stretch = chain.stretch(position)
        per_length = strain_energy_density(stretch, green=chain.green)
        return chain.p.stiffness * (per_length * chain.length).sum(axis=-1)

    def _energy_at_hand(self) -> float:
        """Energy that the start, the loads over the length of the cable, and the distance of the ends can put into links [J]."""
        chain, p = self.chain, self.chain.p
        loads = np.abs(chain.loads()).sum() + sum(
            float(np.abs(factor(self.times)).max() * np.abs(pattern).sum()) for pattern, factor in chain.varying()
        )
        reach = chain.total_length + float(np.abs(np.diff(self.initial[[0, -1]], axis=0)).sum())
        grid = np.linspace(0.0, float(self.times[-1]), 1001)
        ends, speed = p.end_positions(grid), math.sqrt(square(p.end_positions(grid, 1)).max())
        drawn = 0.0
        if p.free is None:
            drawn = max(math.sqrt(square(ends[:, 1] - ends[:, 0]).max()) / chain.total_length - 1.0, 0.0)
        enforced = 0.5 * p.stiffness * chain.total_length * (drawn + 1.5 * drawn**2) ** 2
        pushed = 0.5 * p.mass * chain.total_length * speed**2
        return float(self._strain_energy(self.initial[None])[0]) + float(loads) * reach + enforced + pushed + 1e-300

    def _energy_put_in(self, state: State) -> np.ndarray:
        """Most energy that the start, the loads, and the ends on their way can have put in until each instant (times,) [J].

        Constant loads have done the work that the positions show.  A load that varies does no more, by partial integration, than
        its variation times the reach, and an end no more than its way times the largest tension beside it.
        """
        chain, p, times = self.chain, self.chain.p, state.instants.times
        total = float(self._strain_energy(self.initial[None])[0]) + np.maximum(
            np.sum((state.position - self.initial) * chain.loads(), axis=(1, 2)), 0.0
        )
        until = float(times[-1])
        count = int(min(max(1000.0, math.ceil(PER_CHANGE * until / p.time_scale)), MOST_INSTANTS))
        grid = np.linspace(0.0, until, count + 1)

        def added_up(steps: np.ndarray) -> np.ndarray:
            return np.interp(times, grid, np.concatenate([[0.0], np.cumsum(steps)]))

        if self.moving:
            way = np.sqrt(square(np.diff(p.end_positions(grid), axis=0))).sum(axis=1)
            tension = np.abs(chain.pull(state.position)[0])
            # the mean of all, as at few instants that of the end may be missed
            beside = np.maximum(tension[:, [0, -1]].max(axis=1), tension.mean(axis=1))
            total = total + added_up(way) * np.maximum.accumulate(beside)
        reach = chain.total_length + float(np.abs(np.diff(self.initial[[0, -1]], axis=0)).sum())
        for pattern, factor in chain.varying():
            total = (
                total
                + (np.abs(factor(times)) + added_up(np.abs(np.diff(factor(grid))))) * np.abs(pattern).sum() * reach
            )
        return total

    def stop(self, partial: State | None, done: int, rate: float, why: str) -> None:
        """Raise :class:`RunStopped`, with what was computed before step `done`."""
        kept = None
        if partial is not None:
            kept = self.dataset(partial)
            kept.attrs["incomplete"] = f"stopped at {done / rate:.6g} s of {self.times[-1]:.6g} s"
        raise RunStopped(why, kept)

    def dataset(self, state: State) -> xr.Dataset:
        """Label what a run gave."""
        result = xr.Dataset(*self.arrays(state))
        label(result)
        result.attrs.update(self.attributes(state))
        return result

    def arrays(self, state: State) -> tuple[dict[str, Any], dict[str, Any]]:
        """Variables of the result, and its coordinates."""
        chain = self.chain
        variables: dict[str, Any] = {}
        if "position" in self.outputs:
            variables["position"] = (("time", "particle", "coordinate"), state.position)
        if "velocity" in self.outputs:
            variables["velocity"] = (("time", "particle", "coordinate"), state.velocity)
        if "tension" in self.outputs:
            variables["tension"] = (("time", "link"), chain.pull(state.position, state.velocity)[0])
        if state.extremes is not None:
            variables["tension_minimum"], variables["tension_maximum"] = (("link", item) for item in state.extremes)
        variables["unstretched_length"] = ((), chain.total_length)
        about, names = describe(
            chain.p,
            chain.total_length,
            float(state.instants.times[-1]),
            0.5 * float(chain.statics[4] + chain.statics[5]),
        )
        return {**variables, **about}, {"time": state.instants.times, **coordinates(chain), **names}

    def attributes(self, state: State) -> dict[str, Any]:
        """Attributes of the result."""
        chain, rate = self.chain, state.instants.rate
        attrs = {
            "title": f"{self.title}: elastic chain of {chain.links} links{suffix(chain)}",
            "stage": "trajectory",
            "model": "elastic chain",
            "law": chain.law,
            "scheme": self.scheme,
            "step": 1.0 / rate,
            "number_of_steps": int(state.instants.steps[-1]),
            "highest_angular_frequency": chain.highest_frequency(chain.stiffening(self.initial)),
            **state.notes,
            **self.jolt(),
        }
        if chain.green:
            attrs["smallest_stretch"] = float(chain.stretch(state.position).min())
        return attrs
