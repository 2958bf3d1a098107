"""Saved steps of a run of the Galerkin model, and what follows: amplitudes at instants, means, samples, energy balance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.galerkin._model import GalerkinModel
from cablepod.integrate._comparison import motion_scale
from cablepod.integrate._means import Means, means
from cablepod.integrate._output import Extremes
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._window import steps_within

if TYPE_CHECKING:
    from cablepod.galerkin._runs import GalerkinRun

#: Number of samples at which the scale of the motion is computed (twice as many at most).
MOTION_SAMPLES = 500


@dataclass(frozen=True)
class GalerkinTrajectory:
    """One run at given instants, computed from the saved steps when it is needed."""

    record: RunRecord
    instants: OutputTimes
    diagnostics: dict[str, Any]  #: attributes of the result

    @property
    def model(self) -> GalerkinModel:
        """Model of the run."""
        return self.record.run.model

    @cached_property
    def _saved(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        return self.record.at(self.instants.steps)

    @cached_property
    def displacements(self) -> np.ndarray:
        """Displacements of the moving ends (times, moving) [m]."""
        run, times = self.record.run, self.instants.times
        return run.displacements if times is run.times else self.model.displacements(times)

    @cached_property
    def projection(self) -> np.ndarray:
        """Projection z = q + C^T d (times, modes) [kg^1/2 m]."""
        return self.instants.at_times(*self._saved[:3])

    @cached_property
    def q(self) -> np.ndarray:
        """Mass-orthonormal amplitudes (times, modes) [kg^1/2 m]; the lifting is evaluated exactly at the instants."""
        return self.projection - self.displacements @ self.model.coupling

    @cached_property
    def rates(self) -> np.ndarray:
        """First time derivatives of `q` (times, modes) [kg^1/2 m/s]."""
        _, v, a, _ = self._saved
        lifted = self.model.displacements(self.instants.times, 1) @ self.model.coupling
        return self.instants.rates_at_times(v, a) - lifted

    @cached_property
    def rms_displacements(self) -> np.ndarray:
        """Vectors (times, coordinates) whose norm is the rms displacement of the particles [m] from the mean shape."""
        return np.concatenate([self.projection, self.displacements], axis=1) @ self.model.rms_root

    @cached_property
    def motion(self) -> float:
        """Largest rms displacement from the start [m]; the chord if nothing moves."""
        vectors = self.rms_displacements[:, None]
        start = np.concatenate([self.record.run.p0, self.model.initial_displacements]) @ self.model.rms_root
        return motion_scale(vectors, start, self.model.chain.chord)

    @property
    def extremes(self) -> Extremes:
        """Minimum and maximum tensions of the links (n,) [N]; None if they are not requested."""
        return self.record.extremes

    @property
    def means(self) -> Means:
        """Time mean and root mean square of the tensions (n,) [N]; only of complete runs that save the steps of means."""
        record, model = self.record, self.model
        instants = record.with_means
        time = instants.steps / instants.steps_per_second

        def tension(part: slice) -> np.ndarray:
            q = record.saved[part, 0] - model.displacements(time[part]) @ model.coupling
            return model.tension(model.positions(q, time[part]))

        return means(instants, record.run.window, tension, model.chain.links)

    @property
    def energy_defect(self) -> float:
        """Largest violation of the energy balance at the saved steps, over the largest energy exchanged."""
        _, v, _, energy = self._saved
        return _energy_defect(v, energy, float(self.record.run.initial_energy))

    def only(self, times: np.ndarray) -> GalerkinTrajectory:
        """Return the trajectory at some of its instants [s]."""
        if times.size == self.instants.times.size:
            return self
        return replace(self, instants=OutputTimes.of(times, self.instants.steps_per_second))

    @cached_property
    def samples(self) -> Samples | None:
        """The run at equal intervals, for the error estimate; None if it has no samples."""
        record, interval = self.record, self.record.interval
        if not interval:
            return None
        steps = np.arange(int(self.instants.steps[-1]) // interval + 1) * interval
        rate = self.instants.steps_per_second / interval
        projections, rates, second_rates, _ = record.at(steps)
        end_motions = self.model.motions_at_steps(0, steps.size - 1, rate, (0, 1, 2))
        states = np.concatenate([np.stack([projections, rates, second_rates]), end_motions], axis=2)
        return Samples(self.model, states, rate)


@dataclass(frozen=True)
class Samples:
    """A run at equal intervals from the start."""

    model: GalerkinModel
    #: z and d, see `fields_of_projections`, and first and second time derivatives (3, times, coordinates)
    states: np.ndarray
    per_second: float  #: [1/s]

    @property
    def count(self) -> int:
        """Number of samples."""
        return self.states.shape[1]

    @property
    def motion(self) -> float:
        """Largest rms displacement from the start at up to about MOTION_SAMPLES samples [m]; the chord if nothing moves."""
        chosen = self.states[0, :: -(-self.count // MOTION_SAMPLES)]
        vectors = chosen @ self.model.rms_root
        return motion_scale(vectors[:, None], vectors[0], self.model.chain.chord)


class RunRecord:
    """Arrays saved at steps of a run."""

    def __init__(self, run: GalerkinRun, instants: OutputTimes, interval: int) -> None:
        self.run, self.instants, self.interval = run, instants, interval
        #: Numbers of the saved steps: those of the output, and multiples of the interval of the samples
        self.with_means = run.saving(instants, self.interval)
        self.steps = self.with_means.steps
        modes, count = run.q0.size, self.steps.size
        self.saved = np.zeros((count, 3, modes))  # projection z = q + C^T d, first and second time derivatives
        self.energy = np.zeros((count, 4))  # strain energy, work of loads, work of ends, dissipated energy [J]
        links = run.model.chain.links
        self.extremes = (np.full(links, np.inf), np.full(links, -np.inf)) if "tension_extremes" in run.outputs else None

        #: Minus the smallest tension and the largest [N], and their times [s]
        self.peaks = [(-np.inf, 0.0), (-np.inf, 0.0)]

    def targets(self, begin: int, end: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the steps of [begin, end) to save, and the arrays for the kernel (saves, 3, modes), (saves, 4)."""
        if self.extremes is not None:
            return np.arange(begin, end), np.empty((end - begin, *self.saved.shape[1:])), np.empty((end - begin, 4))
        first, last = np.searchsorted(self.steps, (begin, end))
        return self.steps[first:last], self.saved[first:last], self.energy[first:last]

    def is_output(self, steps: np.ndarray) -> np.ndarray:
        """Tell which of some steps, up to the last one of the output, are needed for the output times."""
        outputs = self.instants.steps
        return outputs[np.searchsorted(outputs, steps)] == steps

    def store(self, begin: int, end: int, saved: np.ndarray, energy: np.ndarray) -> None:
        """Update the tension extremes from all steps [begin, end), and keep the steps that the output needs."""
        if self.extremes is None:
            return
        first, last = np.searchsorted(self.steps, (begin, end))
        kept = self.steps[first:last] - begin
        self.saved[first:last], self.energy[first:last] = saved[kept], energy[kept]
        model, (low, high) = self.run.model, self.extremes
        time = np.arange(begin, end) / self.instants.steps_per_second
        watched = np.arange(end - begin)
        if self.run.window is not None:
            first, last = steps_within(self.run.window, self.instants.steps_per_second)
            watched = watched[(begin + watched >= first) & (begin + watched <= last)]
        for block in np.array_split(watched, max(1, watched.size // 1024)) if watched.size else ():
            q = saved[block, 0] - model.displacements(time[block]) @ model.coupling
            tension = model.tension(model.positions(q, time[block]))
            for i, sign in enumerate((-1.0, 1.0)):
                peaks = (sign * tension).max(axis=1)
                if peaks.max() > self.peaks[i][0]:
                    self.peaks[i] = float(peaks.max()), float(time[block[int(peaks.argmax())]])
            np.minimum(low, tension.min(axis=0), out=low)
            np.maximum(high, tension.max(axis=0), out=high)

    def at(self, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the projection, its first and second time derivatives (steps, modes) and energies (steps, 4) at saved steps."""
        rows = slice(None) if steps.size == self.steps.size else np.searchsorted(self.steps, steps)
        saved = self.saved[rows]
        differences = self.run.second_derivatives(saved[:, 2], 1.0 / self.instants.steps_per_second)
        return saved[:, 0], saved[:, 1], differences, self.energy[rows]


def _energy_defect(rates: np.ndarray, energy: np.ndarray, initial: float) -> float:
    """Largest violation of the energy balance at the saved steps, over the largest energy exchanged.

    `rates` (saves, modes) are the time derivatives of z.  `energy` (saves, 4) holds the strain energy, the work of the loads
    and of the ends, and the dissipated energy [J].  `initial` is the strain energy at the start, where the cable is at rest.
    """
    kinetic = 0.5 * np.sum(rates**2, axis=1)
    terms = np.stack([kinetic, energy[:, 0] - initial, -energy[:, 1], -energy[:, 2], energy[:, 3]])
    # the floor keeps rounding of the energy from counting if hardly any energy is exchanged
    exchanged = max(float(np.abs(terms).max()), 1e-6 * initial)
    return float(np.abs(terms.sum(axis=0)).max() / exchanged) if exchanged > 0.0 else 0.0
