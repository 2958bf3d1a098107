"""Runs of the Galerkin model: velocity Verlet, trapezoidal rule, energy-momentum method."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from cablepod.chain._implicit import LARGEST, MOST_CUTS, SMALLEST, TENSION_LEFT
from cablepod.conventions import ENDS, label
from cablepod.galerkin._model import Model
from cablepod.integrate import _stepping as stepping
from cablepod.integrate._run import coordinates
from cablepod.integrate._stepping import Instants, RunStopped

#: Packed coefficients cost about (monomials x rows), links (coordinates x axes x links): explicit steps take what is less.
#: Implicit ones, whose tangent costs (modes^2 x rows), take packed ones if they have so many times fewer rows than links.  Both
#: as measured for 2 to 48 amplitudes and 20 to 320 links.
PACKED_COST, FEWER_ROWS = 1.0, 2.0
#: What rounding makes of a correction, by how much it turns the links.
ROUNDING = 32.0 * float(np.finfo(float).eps)


@dataclass
class State:
    """What one run gives."""

    instants: Instants
    q: np.ndarray  #: mass-orthonormal amplitudes at the instants (times, modes) [kg^1/2 m]
    rates: np.ndarray  #: their rates [kg^1/2 m/s]
    second: np.ndarray  #: their second rates [kg^1/2 m/s^2]; only with each instant on a step
    extremes: tuple[np.ndarray, np.ndarray] | None  #: of the tensions (n,) [N]
    notes: dict[str, Any] = field(default_factory=dict)  #: attributes of the result that this run alone knows


class Record:
    """What is kept of the steps of a run."""

    def __init__(self, run: Run, instants: Instants) -> None:
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
        time = np.arange(begin, end) / self.instants.rate
        for some in np.array_split(np.arange(end - begin), max(1, (end - begin) // 1024)):
            q = saved[some, 0] - model.displacements(time[some]) @ model.coupling
            tension = model.tension(model.positions(q, time[some]))
            np.minimum(low, tension.min(axis=0), out=low)
            np.maximum(high, tension.max(axis=0), out=high)


@dataclass(frozen=True)
class Run:
    """One scene on one set of modes, ready to be run with any step by one scheme."""

    model: Model
    times: np.ndarray
    q0: np.ndarray
    outputs: tuple[str, ...]
    progress: Callable[[float], None] | None
    scene: xr.Dataset
    modes: xr.Dataset
    scheme: str

    def __call__(self, rate: float) -> State:
        """Run with so many steps per second."""
        instants = Instants.of(self.times, rate)
        record = Record(self, instants)
        advance, state, total = self._begin(record)
        failed = stepping.march(advance, state, total, self.progress)
        notes = self._notes()
        if failed is not None:
            self._stop(record, failed, notes)
        return self._check(self._gather(record, instants, notes))

    def _begin(self, record: Record) -> tuple[Callable[[int, int], bool], tuple[np.ndarray, ...], int]:
        """Return what advances the state, the state, the number of steps."""
        raise NotImplementedError

    def _notes(self) -> dict[str, Any]:
        return {}

    def _check(self, state: State) -> State:
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
        from cablepod.galerkin import _kernels as kernel  # numba is imported only to compute

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

    @property
    def bound(self) -> float:
        """Amplitude that no sound run reaches [kg^1/2 m]."""
        model = self.model
        return 1e6 * math.sqrt(model.mass.sum()) * (model.chain.total_length + float(np.abs(model.shape).max()))

    def sound(self, p: np.ndarray) -> bool:
        """Whether amplitudes are finite and not absurd."""
        return bool(np.isfinite(p).all() and np.abs(p).max() < self.bound)

    def _gather(self, record: Record, instants: Instants, notes: dict[str, Any]) -> State:
        """Take what was saved at steps to the instants of the output; the lifting is known between steps too."""
        keep = instants.steps.size
        p, v, a = (record.saved[:keep, i] for i in range(3))
        model, time = self.model, instants.times
        q = instants.at_times(p, v, a) - model.displacements(time) @ model.coupling
        rates = v[instants.left]
        between = np.flatnonzero(instants.fraction)
        if between.size:
            i, s, h = instants.left[between], instants.fraction[between][:, None], 1.0 / instants.rate
            # the cubic with values and rates
            rates[between] = (
                (1 + 2 * s) * (1 - s) ** 2 * v[i]
                + s * (1 - s) ** 2 * h * a[i]
                + s**2 * (3 - 2 * s) * v[i + 1]
                - s**2 * (1 - s) * h * a[i + 1]
            )
        rates -= model.displacements(time, 1) @ model.coupling
        defect = {"energy_defect": _energy_defect(v, record.energy[:keep], float(self.start_energy))}
        second = a[instants.left] - model.displacements(time, 2) @ model.coupling
        return State(instants, q, rates, second, record.extremes, {**defect, **notes})

    @cached_property
    def start_energy(self) -> float:
        """Strain energy at the start [J]."""
        from cablepod.galerkin import _kernels as kernel

        model, packed, linked = self.model, *self.tables
        y = np.concatenate([self.q0, model.displacements(np.zeros(1))[0]])
        gradient, links = np.zeros(y.size), linked[1].size
        if self.law == kernel.PACKED:
            total = packed[0].shape[1]
            return kernel.packed_gradient(y, *packed, np.zeros(total), np.zeros(total), gradient)
        reach, e, s = np.zeros_like(linked[0]), np.zeros(links), np.zeros(links)
        return kernel.link_gradient(y, self.law, *linked, reach, e, s, gradient)

    def _stop(self, record: Record, done: int, notes: dict[str, Any]) -> None:
        instants, rate = record.instants, record.instants.rate
        # the state at the failing step itself is sound, but for explicit steps its second rate may not be
        count = int(np.searchsorted(instants.times, (done - 1) / rate * (1.0 + 1e-12), side="right")) if done else 0
        partial = None
        if count:
            few = Instants.of(instants.times[:count], rate)
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

    def dataset(self, state: State) -> xr.Dataset:
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
            **coordinates(model.chain),
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
            step=1.0 / state.instants.rate,
            number_of_steps=int(state.instants.steps[-1]),
            **state.notes,
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


class VerletRun(Run):
    """Velocity Verlet: second order, its energy swings and does not drift; stable below 2 over the highest frequency."""

    @property
    def packs(self) -> bool:
        """Whether packed coefficients are the faster way."""
        monomials = len(self.model.used) + self.model.pairs[0].size
        rows = min(monomials, self.model.chain.links)
        return monomials * rows <= PACKED_COST * self.model.used.sum() * self.model.chain.links

    def _begin(self, record: Record) -> tuple[Callable[[int, int], bool], tuple[np.ndarray, ...], int]:
        from cablepod.galerkin import _kernels as kernel  # numba is imported only to compute

        model, damping, rate = self.model, self.damping, record.instants.rate
        step = 1.0 / rate
        decay = math.exp(-damping * step)
        kick = -math.expm1(-damping * step) / damping if damping else step
        law, (packed, linked) = self.law, self.tables
        p, account = self.p0.copy(), np.zeros(3)
        slope, _ = model.gradient(np.concatenate([self.q0, model.displacements(np.zeros(1))[0]]))
        half = stepping.damped_growth(damping, step) / damping if damping else 0.5 * step
        velocity = -half * (
            model.loads_on_steps(0, 0, rate)[0] - slope
        )  # half a step before the start, which is from rest

        def advance(begin: int, steps: int) -> bool:
            marks, saved, energy = record.rows(begin, begin + steps)
            ends = model.displacements_on_steps(max(begin - 1, 0), steps + (begin > 0), rate)
            if begin == 0:
                ends = np.concatenate([ends[:1], ends])
            kernel.verlet(
                p, velocity, account, step, decay, kick, damping, model.coupling, model.loads_on_steps(begin, steps, rate),
                ends, law, packed, linked, begin, steps, marks, saved, energy,
            )  # fmt: skip
            if not self.sound(p):
                return False
            record.take(begin, begin + steps, saved, energy)
            return True

        return advance, (p, velocity, account), int(record.instants.steps[-1]) + 1

    def _check(self, state: State) -> State:
        """Stop where the highest frequency on the way is too high for the step."""
        rate = state.instants.rate
        picked = np.unique(np.linspace(0, len(state.q) - 1, 50).astype(int))
        for i in picked:
            time = float(state.instants.times[i])
            omega = self.model.highest_frequency(state.q[i], time)
            if omega >= 2.0 * rate:
                raise RunStopped(
                    f"the reduced model stiffened: at {time:.6g} s its stability limit is {2 / omega:.6g} s, below the step "
                    f"{1 / rate:.6g} s ({self.scheme}); try a shorter step, or scheme energy_momentum",
                    self.dataset(state),
                )
        return state


@dataclass(frozen=True)
class ImplicitRun(Run):
    """Trapezoidal rule or energy-momentum method: second order, stable at any step as far as linear theory goes."""

    counts: list[int] = field(default_factory=lambda: [0, 0])  #: of the last run: iterations, steps cut

    @property
    def fault(self) -> str:
        """What a stopped run says."""
        return f"Newton's method did not converge, with the step cut into {MOST_CUTS},"

    other = "scheme velocity_verlet"

    @property
    def packs(self) -> bool:
        """Whether packed coefficients are the faster way."""
        return FEWER_ROWS * (len(self.model.used) + self.model.pairs[0].size) <= self.model.chain.links

    def _begin(self, record: Record) -> tuple[Callable[[int, int], bool], tuple[np.ndarray, ...], int]:
        model, total = self.model, int(record.instants.steps[-1])
        p = self.p0.copy()
        state = (
            p,
            np.zeros_like(p),
            np.zeros((3, p.size)),
            np.zeros(3),
        )  # with rates, mean accelerations, energy account
        tension = float(np.abs(model.tension(model.positions(self.q0[None], np.zeros(1)))).mean())
        enough = min(max(math.sqrt(2.0 * TENSION_LEFT * tension / model.chain.p.stiffness), SMALLEST), LARGEST)
        rate = record.instants.rate
        self.counts[:] = [0, 0]

        def advance(begin: int, steps: int) -> bool:
            end = begin + steps + (begin + steps == total)  # a last step is saved when it is done
            rows = record.rows(begin, end)
            done = 0
            while True:
                first = int(np.searchsorted(rows[0], begin + done))
                done += self._kernel(state, enough, rate, begin + done, steps - done, *(item[first:] for item in rows))
                if done == steps:
                    break
                if not self._cut(state, enough, rate, begin + done):
                    return False
                done += 1
            if not self.sound(p):
                return False
            record.take(begin, end, *rows[1:])
            return True

        if total == 0:
            advance(0, 0)
        return advance, state, total

    def _cut(self, state: tuple[np.ndarray, ...], enough: float, rate: float, number: int) -> bool:
        """Take one step in pieces, so short that Newton's method converges; returns whether it did."""
        keep, pieces, nothing = [item.copy() for item in state], 2, np.zeros(0, dtype=np.int64)
        while pieces <= MOST_CUTS:
            saved = np.empty((0, 3, self.q0.size)), np.empty((0, 4))
            if self._kernel(state, enough, pieces * rate, pieces * number, pieces, nothing, *saved) == pieces:
                self.counts[1] += 1
                return True
            for target, source in zip(state, keep, strict=True):
                target[:] = source
            pieces *= 4
        return False

    def _kernel(
        self,
        state: tuple[np.ndarray, ...],
        enough: float,
        rate: float,
        start: int,
        steps: int,
        marks: np.ndarray,
        saved: np.ndarray,
        energy: np.ndarray,
    ) -> int:
        """Take steps of 1 / rate; returns how many were done."""
        from cablepod.galerkin import _kernels as kernel  # numba is imported only to compute

        model, law, (packed, linked) = self.model, self.law, self.tables
        stiffness = np.ones(packed[1].size) if law == kernel.PACKED else linked[4]
        done, iterations = kernel.implicit(
            *state, 1.0 / rate, self.scheme == "energy_momentum", self.damping, model.coupling,
            model.loads_on_steps(start, steps, rate), model.displacements_on_steps(start, steps, rate), law,
            np.ascontiguousarray(packed[0].T), packed[1:], linked, stiffness, model.turns, enough, ROUNDING, start, steps,
            marks, saved, energy,
        )  # fmt: skip
        self.counts[0] += iterations
        return done

    def _notes(self) -> dict[str, Any]:
        return {"newton_iterations": self.counts[0], "steps_cut": self.counts[1]}
