"""Runs of the Galerkin model: velocity Verlet, trapezoidal rule, energy-momentum method."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import ENDS, label
from cablepod.errors import RunStopped
from cablepod.galerkin._model import GalerkinModel
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._run import chain_coordinates

#: Packed coefficients cost about (monomials x rows), links (coordinates x axes x links): explicit steps take what is less.
#: Implicit ones, whose tangent costs (modes^2 x rows), take packed ones if they have so many times fewer rows than links.  Both
#: as measured for 2 to 48 amplitudes and 20 to 320 links.
PACKED_COST, FEWER_ROWS = 1.0, 2.0
#: What rounding makes of a correction, by how much it turns the links.
ROUNDING = 32.0 * float(np.finfo(float).eps)


@dataclass
class GalerkinTrajectory:
    """What one run gives."""

    instants: OutputTimes
    q: np.ndarray  #: mass-orthonormal amplitudes at the instants (times, modes) [kg^1/2 m]
    rates: np.ndarray  #: their rates [kg^1/2 m/s]
    second: np.ndarray  #: their second rates [kg^1/2 m/s^2]; only with each instant on a step
    extremes: tuple[np.ndarray, np.ndarray] | None  #: of the tensions (n,) [N]
    diagnostics: dict[str, Any] = field(default_factory=dict)  #: attributes of the result that this run alone knows


class RunRecord:
    """What is kept of the steps of a run."""

    def __init__(self, run: GalerkinRun, instants: OutputTimes) -> None:
        self.run, self.instants = run, instants
        modes, count = run.q0.size, instants.steps.size
        self.saved = np.zeros((count, 3, modes))  # amplitudes of the particles, rates, second rates
        self.energy = np.zeros((count, 4))  # strain energy, work of loads, work of ends, dissipated
        links = run.model.chain.links
        self.extremes = (np.full(links, np.inf), np.full(links, -np.inf)) if "tension_extremes" in run.outputs else None

    def rows(self, begin: int, end: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which of the steps begin ... end - 1 the kernel is to save, and where."""
        if self.extremes is not None:
            return np.arange(begin, end), np.empty((end - begin, *self.saved.shape[1:])), np.empty((end - begin, 4))
        first, last = np.searchsorted(self.instants.steps, (begin, end))
        return self.instants.steps[first:last], self.saved[first:last], self.energy[first:last]

    def take(self, begin: int, end: int, saved: np.ndarray, energy: np.ndarray) -> None:
        """Take over what the kernel saved, and the extremes of the tensions."""
        if self.extremes is None:
            return
        first, last = np.searchsorted(self.instants.steps, (begin, end))
        picked = self.instants.steps[first:last] - begin
        self.saved[first:last], self.energy[first:last] = saved[picked], energy[picked]
        model, (low, high) = self.run.model, self.extremes
        time = np.arange(begin, end) / self.instants.steps_per_second
        for some in np.array_split(np.arange(end - begin), max(1, (end - begin) // 1024)):
            q = saved[some, 0] - model.displacements(time[some]) @ model.coupling
            tension = model.tension(model.positions(q, time[some]))
            np.minimum(low, tension.min(axis=0), out=low)
            np.maximum(high, tension.max(axis=0), out=high)


@dataclass(frozen=True)
class GalerkinRun:
    """One scene on one set of modes, ready to be run with any step by one scheme."""

    model: GalerkinModel
    times: np.ndarray
    q0: np.ndarray
    outputs: tuple[str, ...]
    progress: Callable[[float], None] | None
    scene: xr.Dataset
    modes: xr.Dataset
    scheme: str

    def __call__(self, rate: float) -> GalerkinTrajectory:
        """Run with so many steps per second."""
        instants = OutputTimes.of(self.times, rate)
        record = RunRecord(self, instants)
        advance, state, total = self._begin(record)
        failed = advance_in_blocks(advance, state, total, self.progress)
        notes = self._notes()
        if failed is not None:
            self._stop(record, failed, notes)
        return self._check(self._gather(record, instants, notes))

    def sample(self, times: np.ndarray, rate: float) -> GalerkinTrajectory:
        """Return the trajectory at other instants [s]: the run with so many steps per second, saved there."""
        return replace(self, times=times, outputs=(), progress=None)(rate)

    def _begin(self, record: RunRecord) -> tuple[Callable[[int, int], bool], tuple[np.ndarray, ...], int]:
        """Return what advances the state, the state, the number of steps."""
        raise NotImplementedError

    def _notes(self) -> dict[str, Any]:
        return {}

    def _check(self, state: GalerkinTrajectory) -> GalerkinTrajectory:
        return state

    @cached_property
    def p0(self) -> np.ndarray:
        """Amplitudes of the particles at the start."""
        return self.q0 + self.model.displacements(np.zeros(1))[0] @ self.model.coupling

    @property
    def damping(self) -> float:
        """Damping per mass [1/s]."""
        return self.model.chain.p.mass_damping or 0.0

    @property
    def packs(self) -> bool:
        """Whether packed coefficients are the faster way."""
        raise NotImplementedError

    @cached_property
    def law(self) -> int:
        """How the kernel evaluates the energy."""
        from cablepod.galerkin import _kernels_energy as kernel  # numba is imported only to compute

        if self.model.law == "linear":
            return kernel.LINEAR_LINKS
        return kernel.PACKED if self.packs else kernel.GREEN_LINKS

    @cached_property
    def tables(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """Packed and linked coefficients; those not used are of size zero."""
        model = self.model
        none = np.zeros(0, dtype=np.int64)
        count, dims = len(model.modes) + len(model.moving), model.chain.p.dims
        if self.law == 0:
            unused = np.zeros((dims, 0)), np.zeros(0), np.zeros((count, dims, 0)), model.used, np.zeros(0)
            return model.packed, unused
        return (np.zeros((0, 0)), np.zeros(0), none, none), model.linked

    @cached_property
    def divergence_bound(self) -> float:
        """Amplitude that no sound run reaches [kg^1/2 m]."""
        model = self.model
        return 1e6 * math.sqrt(model.mass.sum()) * (model.chain.total_length + float(np.abs(model.shape).max()))

    def is_finite(self, p: np.ndarray) -> bool:
        """Whether amplitudes are finite and not absurd."""
        return bool(np.isfinite(p).all() and np.abs(p).max() < self.divergence_bound)

    def _gather(self, record: RunRecord, instants: OutputTimes, notes: dict[str, Any]) -> GalerkinTrajectory:
        """Take what was saved at steps to the instants of the output; the lifting is known between steps too."""
        keep = instants.steps.size
        p, v, a = (record.saved[:keep, i] for i in range(3))
        model, time = self.model, instants.times
        q = instants.at_times(p, v, a) - model.displacements(time) @ model.coupling
        rates = instants.rates_at_times(v, a) - model.displacements(time, 1) @ model.coupling
        defect = {"energy_defect": _energy_defect(v, record.energy[:keep], float(self.start_energy))}
        second = a[instants.left] - model.displacements(time, 2) @ model.coupling
        return GalerkinTrajectory(instants, q, rates, second, record.extremes, {**defect, **notes})

    @cached_property
    def start_energy(self) -> float:
        """Strain energy at the start [J]."""
        from cablepod.galerkin import _kernels_energy as kernel

        model, packed, linked = self.model, *self.tables
        y = np.concatenate([self.q0, model.displacements(np.zeros(1))[0]])
        gradient, links = np.zeros(y.size), linked[1].size
        if self.law == kernel.PACKED:
            total = packed[0].shape[1]
            return kernel.packed_gradient(y, *packed, np.zeros(total), np.zeros(total), gradient)
        reach, e, s = np.zeros_like(linked[0]), np.zeros(links), np.zeros(links)
        return kernel.link_gradient(y, self.law, *linked, reach, e, s, gradient)

    def _stop(self, record: RunRecord, done: int, notes: dict[str, Any]) -> None:
        instants, rate = record.instants, record.instants.steps_per_second
        # the state at the failing step itself is sound, but for explicit steps its second rate may not be
        count = int(np.searchsorted(instants.times, (done - 1) / rate * (1.0 + 1e-12), side="right")) if done else 0
        partial = None
        if count:
            few = OutputTimes.of(instants.times[:count], rate)
            record.extremes = None
            partial = self.dataset(self._gather(record, few, notes))
            partial.attrs["incomplete"] = f"stopped at {done / rate:.6g} s of {instants.times[-1]:.6g} s"
        raise RunStopped(
            f"{self.fault} at {done / rate:.6g} s ({self.scheme}, step {1 / rate:.4g} s, step number {done}); try a shorter "
            f"step, {self.other}, more modes, or the chain itself",
            partial,
        )

    @property
    def fault(self) -> str:
        """What a stopped run says."""
        return "the reduced model left the finite numbers"

    other = "scheme energy_momentum"

    def dataset(self, state: GalerkinTrajectory) -> xr.Dataset:
        """Label what a run gave."""
        from scipy.linalg import solve_triangular  # costly to import

        model, time = self.model, state.instants.times
        amplitude = solve_triangular(model.root, state.q.T, lower=True, trans="T").T
        lead: tuple[str, ...] = ()
        count = len(model.modes)
        if model.layout == "separate":
            lead, count = ("coordinate",), count // model.chain.p.dims
        # one Dataset made at once: each variable added later costs as much as hundreds of steps
        variables: dict[str, Any] = {
            "amplitude": (("time", *lead, "mode"), amplitude.reshape(time.size, *[-1] * len(lead), count)),
            "end_position": (("time", "end", "coordinate"), model.chain.p.end_positions(time)),
            "unstretched_length": ((), model.chain.total_length),
        }
        place, attrs = ("time", "particle", "coordinate"), {}
        # asked for or not: the least stretch says whether the cable went slack
        position = model.positions(state.q, time)
        if "position" in self.outputs:
            variables["position"] = (place, position)
        if "tension" in self.outputs:
            variables["tension"] = (("time", "link"), model.tension(position))
        attrs["smallest_stretch"] = float(model.chain.stretch(position).min())
        if "velocity" in self.outputs:
            variables["velocity"] = (place, model.velocities(state.rates, time))
        if state.extremes is not None:
            variables["tension_minimum"], variables["tension_maximum"] = (("link", item) for item in state.extremes)
        coords = {
            "time": time,
            "mode": self.modes["mode"].values[:count],
            "end": list(ENDS),
            **chain_coordinates(model.chain),
        }
        result = xr.Dataset(variables, coords=coords, attrs=attrs)
        label(result)
        result.attrs.update(
            title=f"{self.scene.attrs.get('title', 'scene')}: Galerkin model, r = {count}, {model.law} law",
            stage="trajectory",
            model="Galerkin",
            law=model.law,
            rank=count,
            scheme=self.scheme,
            step=1.0 / state.instants.steps_per_second,
            number_of_steps=int(state.instants.steps[-1]),
            **state.diagnostics,
        )
        return result


def _energy_defect(rates: np.ndarray, energy: np.ndarray, start: float) -> float:
    """Largest energy at the saved steps that start, work and damping do not explain, over the largest exchanged until then.

    `rates` (saves, modes) are those of the particles, `energy` (saves, 4) the strain energy, the work of loads and of ends and
    what was dissipated [J]; `start` is the strain energy at the start, where nothing moves.
    """
    kinetic = 0.5 * np.sum(rates**2, axis=1)
    terms = np.stack([kinetic, energy[:, 0] - start, -energy[:, 1], -energy[:, 2], energy[:, 3]])
    # of nothing exchanged, rounding of the energy itself is no defect
    exchanged = max(float(np.abs(terms).max()), 1e-6 * start)
    return float(np.abs(terms.sum(axis=0)).max() / exchanged) if exchanged > 0.0 else 0.0
