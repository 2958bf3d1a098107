"""Time integration of the Galerkin model, common to all schemes: sampling, energy balance, labelled output."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES, ENDS, labelled_dataset
from cablepod.galerkin._model import GalerkinModel
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._means import Means, means, wants_means, with_steps_of_means
from cablepod.integrate._output import (
    Extremes,
    mean_variables,
    peak_variables,
    stop,
    trajectory_attributes,
    trajectory_variables,
)
from cablepod.integrate._output_times import OutputTimes, with_judged
from cablepod.integrate._step_control import motion_scale
from cablepod.integrate._window import steps_within, window_attributes

#: Cost of the polynomial form, monomials x rows, relative to the link form, coordinates x axes x links (explicit steps take the
#: cheaper one); and minimum ratio of links to rows for the polynomial form in implicit steps, whose tangent costs modes^2 x rows.
#: Both as measured for 2 to 48 amplitudes and 20 to 320 links.
POLYNOMIAL_COST, MIN_ROW_RATIO = 1.0, 2.0
#: Number of samples at which the scale of the motion is computed (twice as many at most).
MOTION_SAMPLES = 500
#: Rounding error of a Newton correction, as a mean rotation of the links [rad].
ROUNDING = 32.0 * float(np.finfo(float).eps)


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
    def q(self) -> np.ndarray:
        """Mass-orthonormal amplitudes (times, modes) [kg^1/2 m]; the lifting is evaluated exactly at the instants."""
        p, v, a, _ = self._saved
        return self.instants.at_times(p, v, a) - self.displacements @ self.model.coupling

    @cached_property
    def rates(self) -> np.ndarray:
        """First time derivatives of `q` (times, modes) [kg^1/2 m/s]."""
        _, v, a, _ = self._saved
        lifted = self.model.displacements(self.instants.times, 1) @ self.model.coupling
        return self.instants.rates_at_times(v, a) - lifted

    @cached_property
    def rms_displacements(self) -> np.ndarray:
        """Vectors (times, coordinates) whose norm is the rms displacement of the particles [m] from the mean shape."""
        return np.concatenate([self.q, self.displacements], axis=1) @ self.model.rms_root

    @cached_property
    def motion(self) -> float:
        """Largest rms displacement from the start [m]; the chord if nothing moves."""
        p, vectors = self.model.chain.p, self.rms_displacements[:, None]
        start = np.concatenate([self.record.run.q0, self.record.run.start_displacements]) @ self.model.rms_root
        return motion_scale(vectors, start, float(np.linalg.norm(p.upper - p.lower)))

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

    def at_output_times(self) -> GalerkinTrajectory:
        """Return the trajectory at the output times, without the instants at which runs are compared."""
        run = self.record.run
        if run.judged is None:
            return self
        return replace(self, instants=OutputTimes.of(run.times, self.instants.steps_per_second))

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
    states: (
        np.ndarray
    )  #: z and d, see `fields_of_projections`, and first and second time derivatives (3, times, coordinates)
    per_second: float  #: [1/s]

    @property
    def count(self) -> int:
        """Number of samples."""
        return self.states.shape[1]

    @property
    def motion(self) -> float:
        """Largest rms displacement from the start at up to about MOTION_SAMPLES samples [m]; the chord if nothing moves."""
        p, chosen = self.model.chain.p, self.states[0, :: -(-self.count // MOTION_SAMPLES)]
        vectors = chosen @ self.model.rms_root_of_projections
        return motion_scale(vectors[:, None], vectors[0], float(np.linalg.norm(p.upper - p.lower)))


class RunRecord:
    """Arrays saved at steps of a run."""

    def __init__(self, run: GalerkinRun, instants: OutputTimes, interval: int) -> None:
        self.run, self.instants, self.interval = run, instants, interval
        #: Numbers of the saved steps: those of the output, and multiples of the interval of the samples
        sampled = instants.with_multiples(self.interval) if self.interval else instants
        self.with_means = with_steps_of_means(sampled, run.outputs, run.window)
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


def _no_samples(steps_per_second: float) -> int:
    """Interval of samples of a run without any."""
    return 0


@dataclass(frozen=True)
class GalerkinRun:
    """Galerkin model of a scene with one scheme, callable with the number of steps per second."""

    model: GalerkinModel
    times: np.ndarray
    q0: np.ndarray
    outputs: tuple[str, ...]
    progress: Callable[[float], None] | None
    scene: xr.Dataset
    modes: xr.Dataset
    scheme: str
    sample_interval: Callable[[float], int] = (
        _no_samples  #: steps between samples for the error estimate, by steps per second
    )
    sampled: bool = False  #: whether runs have samples
    #: Part of the run over which extremes and means are taken [s]; None for all
    window: tuple[float, float] | None = None
    #: Further instants at which runs are compared [s]; None without
    judged: np.ndarray | None = None

    def __call__(self, steps_per_second: float, *, sampled: bool | None = None) -> GalerkinTrajectory:
        """Integrate the equations of motion with a given number of steps per second; `sampled` overrides the attribute."""
        instants = OutputTimes.of(with_judged(self.times, self.judged), steps_per_second)
        sampled = self.sampled if sampled is None else sampled
        record = RunRecord(self, instants, self.sample_interval(steps_per_second) if sampled else 0)
        advance, state, total = self._stepper(record)
        failed_step = advance_in_blocks(advance, state, total, self.progress)
        diagnostics = self._diagnostics()
        if failed_step is not None:
            self._stop(record, failed_step, diagnostics)
        return self._check(GalerkinTrajectory(record, instants, diagnostics))

    def _stepper(self, record: RunRecord) -> tuple[Callable[[int, int], bool], tuple[np.ndarray, ...], int]:
        """Return the function that advances the state by a block of steps, the state, and the number of steps."""
        raise NotImplementedError

    def _diagnostics(self) -> dict[str, Any]:
        """Return attributes of the last run."""
        return {}

    def _check(self, trajectory: GalerkinTrajectory) -> GalerkinTrajectory:
        """Return a valid trajectory; a scheme raises RunStopped for an invalid one."""
        return trajectory

    def second_derivatives(self, differences: np.ndarray, step: float) -> np.ndarray:
        """Return second time derivatives from the differences that a scheme saves (saves, modes)."""
        return differences

    @cached_property
    def displacements(self) -> np.ndarray:
        """Displacements of the moving ends at the output instants (times, moving) [m]."""
        return self.model.displacements(self.times)

    @cached_property
    def start_displacements(self) -> np.ndarray:
        """Displacements of the moving ends at the start (moving,) [m]."""
        return self.model.displacements(np.zeros(1))[0]

    @cached_property
    def p0(self) -> np.ndarray:
        """Projection z = q + C^T d at the start (modes,) [kg^1/2 m]."""
        return self.q0 + self.start_displacements @ self.model.coupling

    @property
    def damping(self) -> float:
        """Damping per mass [1/s]."""
        return self.model.chain.p.mass_damping or 0.0

    @property
    def use_polynomial_form(self) -> bool:
        """Select the polynomial form of the energy if it is the faster one."""
        raise NotImplementedError

    @cached_property
    def law(self) -> int:
        """Form in which the kernels evaluate the energy, a constant of ``_kernels_energy``."""
        from cablepod.galerkin import _kernels_energy as kernel  # numba is imported only to compute

        if self.model.law == "linear":
            return kernel.LINEAR_LINKS
        return kernel.POLYNOMIAL if self.use_polynomial_form else kernel.GREEN_LINKS

    @cached_property
    def tables(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """Coefficients of the polynomial form and of the link form; those not needed are empty."""
        model = self.model
        no_pairs = np.zeros(0, dtype=np.int64)
        count, dims = len(model.modes) + len(model.moving), model.chain.p.dims
        if self.law == 0:
            unused = np.zeros((dims, 0)), np.zeros(0), np.zeros((count, dims, 0)), model.active_axes, np.zeros(0)
            return model.polynomial_form, unused
        return (np.zeros((0, 0)), np.zeros(0), no_pairs, no_pairs), model.link_form

    @cached_property
    def divergence_bound(self) -> float:
        """Amplitude above which a run counts as divergent [kg^1/2 m]."""
        model = self.model
        return 1e6 * math.sqrt(model.mass.sum()) * (model.chain.total_length + float(np.abs(model.shape).max()))

    def is_finite(self, p: np.ndarray) -> bool:
        """Check that all amplitudes are finite and below the divergence bound."""
        return bool(np.isfinite(p).all() and np.abs(p).max() < self.divergence_bound)

    @cached_property
    def initial_energy(self) -> float:
        """Strain energy at the start [J]."""
        from cablepod.galerkin import _kernels_energy as kernel

        polynomial_form, link_form = self.tables
        y = np.concatenate([self.q0, self.start_displacements])
        gradient, links = np.zeros(y.size), link_form[1].size
        if self.law == kernel.POLYNOMIAL:
            return kernel.polynomial_energy(y, *polynomial_form, np.zeros(polynomial_form[0].shape[1]))
        slopes, e, s = np.zeros_like(link_form[0]), np.zeros(links), np.zeros(links)
        return kernel.link_gradient(y, self.law, *link_form, slopes, e, s, gradient)

    def _stop(self, record: RunRecord, failed_step: int, diagnostics: dict[str, Any]) -> None:
        """Raise RunStopped with the output before the failed step."""
        instants = OutputTimes.of(self.times, record.instants.steps_per_second)
        steps_per_second = instants.steps_per_second
        time, completed, partial = failed_step / steps_per_second, instants.before_step(failed_step), None
        # the state at the failed step is finite, but the second rate of an explicit step may not be
        if completed is not None:
            record.extremes = None
            partial = self.dataset(GalerkinTrajectory(record, completed, diagnostics))
        stop(
            partial,
            time,
            float(instants.times[-1]),
            f"{self.failure} at {time:.6g} s ({self.scheme}, step {1 / steps_per_second:.4g} s, step number {failed_step}); "
            f"try a shorter step, {self.alternative}, more modes, or the chain itself",
        )

    @property
    def failure(self) -> str:
        """Reason for stopping, as stated in the message."""
        return "the reduced model left the finite numbers"

    #: Scheme to try instead, as stated in the message.
    alternative = "scheme energy_momentum"

    def dataset(self, trajectory: GalerkinTrajectory) -> xr.Dataset:
        """Convert a trajectory to a labelled Dataset."""
        from scipy.linalg import solve_triangular  # costly to import

        model, time = self.model, trajectory.instants.times
        amplitude = solve_triangular(model.mass_cholesky, trajectory.q.T, lower=True, trans="T").T
        lead: tuple[str, ...] = ()
        count = len(model.modes)
        if model.layout == "separate":
            lead, count = ("coordinate",), count // model.chain.p.dims
        dims = ("time", *lead, "mode")
        variables: dict[str, Any] = {
            "amplitude": (dims, amplitude.reshape(time.size, *[-1] * len(lead), count)),
            "end_position": (("time", "end", "coordinate"), model.chain.p.end_positions(time)),
            "unstretched_length": ((), model.chain.total_length),
        }
        # always computed, because the minimum stretch shows whether the cable went slack
        position = model.positions(trajectory.q, time)
        values = {
            "position": lambda: position,
            "tension": lambda: model.tension(position),
            "velocity": lambda: model.velocities(trajectory.rates, time),
        }
        variables |= trajectory_variables(self.outputs, trajectory.extremes, values)
        if wants_means(self.outputs) and trajectory.instants.times.size == self.times.size:
            variables |= mean_variables(self.outputs, trajectory.means)
        if trajectory.extremes is not None:
            (_, least), (_, largest) = trajectory.record.peaks
            arc_length = model.chain.arc_length
            middles = 0.5 * (arc_length[1:] + arc_length[:-1])
            variables |= peak_variables(trajectory.extremes, (least, largest), middles)
        labels = {
            "coordinate": np.array(COORDINATES[: model.chain.p.dims]),
            "time": time,
            "mode": self.modes.variables["mode"].values[:count],
            "end": np.array(ENDS),
        }
        options = {"law": model.law, "rank": count}
        result = labelled_dataset(variables, labels, {"arc_length": (("particle",), model.chain.arc_length)})
        stretch = model.chain.stretch(position)
        result.attrs = {
            "smallest_stretch": float(stretch.min()),
            "largest_stretch": float(stretch.max()),
            "title": f"{self.scene.attrs.get('title', 'scene')}: Galerkin model, r = {count}, {model.law} law",
            **trajectory_attributes("Galerkin", self.scheme, trajectory.instants, **options),
            "energy_defect": trajectory.energy_defect,
            **model.chain.p.offsets(),
            **window_attributes(self.window),
            **trajectory.diagnostics,
        }
        return result


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
