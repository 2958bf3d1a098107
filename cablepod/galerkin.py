"""The paper's reduced model, eqs. (34)-(36): modes + scene -> trajectory."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from cablepod import pod, provenance, stepping
from cablepod.conventions import label
from cablepod.galerkin_model import Model, model_of
from cablepod.members import over_members
from cablepod.parameters import check_memory, parameters
from cablepod.schema import refuse
from cablepod.stepping import Instants, RunStopped

SCHEMES = ("velocity_verlet",)


@over_members
def simulate(
    scene: xr.Dataset,
    modes: xr.Dataset,
    *,
    rank: int | None = None,
    times: Any = None,
    law: str = "green",
    scheme: str | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    outputs: tuple[str, ...] = ("position",),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the extensible cable of a scene on Karhunen-Loeve modes.

    Parameters
    ----------
    scene
        A scene with both ends held, with or without ``member``; it need not be the one the modes come from.
    modes
        What :func:`cablepod.pod.decompose` gives; they are carried over by sigma = S / L0.
    rank
        Number of modes (of each coordinate where they are separate); all by default.
    times
        Instants of the output [s], rising from 0 on; by default those of the scene.
    law
        "green": eq. (21), T / xi = K (xi^2 - 1) / 2, whose coefficients are computed once, so that the cost of a step does not
        depend on the number of particles.  It resists compression, where a cable goes slack.  "linear": the chain's law,
        evaluated link by link, for verification.
    scheme
        "velocity_verlet".
    step
        Time step [s]; by default it follows from the highest frequency of the model and is shortened until two runs agree within
        `tolerance`.
    tolerance
        Wanted time error as a fraction of the largest rms displacement; 1e-6 by default.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps); nothing else is computed.
    progress
        Called now and then with the part of the run that is done, from 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``amplitude (time, coordinate, mode)`` or ``(time, mode)`` [m], ``end_position`` [m] and the outputs asked for, on the
        particles of the modes.  The attribute ``smallest_stretch`` says the least xi met at the instants of the output where
        positions or tensions were asked for.

    Raises
    ------
    SceneError
        For options that cannot be, a scene with a free end, a step above the stability limit.
    RunStopped
        Where the motion leaves the finite numbers or its highest frequency outgrows a given step.

    Warns
    -----
    NotConvergedWarning
        Where no step meets the tolerance.

    Notes
    -----
    Lifting by the analytic motion of the ends, strain taken link by link as in the chain, masses of the chain.  A run from
    equilibrium starts from the model's own.
    """
    stepping.check_scheme(scheme, SCHEMES)
    names = stepping.check_outputs(outputs)
    if step is not None and tolerance is not None:
        raise refuse("step and tolerance", (step, tolerance), "one of them: a tolerance chooses the step")
    goal = stepping.DEFAULT_TOLERANCE if tolerance is None else stepping.check_positive("tolerance", tolerance)
    p = parameters(scene)
    model = model_of(p, modes, rank=rank, law=law)
    instants = p.times() if times is None else stepping.check_times(times)
    p.check_reach(float(instants[-1]))
    check_memory(instants.size, model.chain.links, p.dims, key="times", variables=3)
    q0 = model.initial()
    run = _Run(model, instants, q0, names, progress, scene, modes)
    limit = 2.0 / model.highest_frequency(q0, 0.0)
    if step is None:
        chord = float(np.linalg.norm(p.upper - p.lower))
        initial = model.positions(q0[None], np.zeros(1))[0]
        state, rate, estimate = stepping.refine(
            run,
            lambda s: model.positions(s.q, s.instants.times),
            lambda s: stepping.motion_scale(model.positions(s.q, s.instants.times), initial, chord),
            stepping.preferred_rate(1.0 / min(0.8 * limit, p.time_scale / stepping.STEPS_PER_CHANGE)),
            goal,
        )
    else:
        rate = 1.0 / stepping.check_step(step, limit, f"2 over the highest angular frequency, {2 / limit:.6g} rad/s")
        state, estimate = run(rate), None
    result = run.dataset(state)
    result.attrs["step_limit"] = limit
    if estimate is not None:
        result.attrs["time_error_estimate"] = estimate
    options = {
        "rank": len(model.modes) // (p.dims if model.layout == "separate" else 1),
        "times": instants,
        "law": law,
        "scheme": SCHEMES[0],
        "step": 1.0 / rate,
        "tolerance": None if step is not None else goal,
        "outputs": list(names),
    }
    return provenance.record(result, function="galerkin.simulate", parameters=options, inputs=[scene, modes])


@dataclass
class _State:
    """What one run gives."""

    instants: Instants
    q: np.ndarray  # (times, modes)
    rates: np.ndarray
    extremes: tuple[np.ndarray, np.ndarray] | None


@dataclass(frozen=True)
class _Run:
    """One scene on one set of modes, ready to be run with any step."""

    model: Model
    times: np.ndarray
    q0: np.ndarray
    outputs: tuple[str, ...]
    progress: Callable[[float], None] | None
    scene: xr.Dataset
    modes: xr.Dataset

    def __call__(self, rate: float) -> _State:
        from cablepod.kernels import reduced as kernel  # numba is imported only to compute

        model, damping = self.model, self.model.chain.p.mass_damping
        instants = Instants.of(self.times, rate)
        total, step = int(instants.steps[-1]) + 1, 1.0 / rate
        decay = None if damping is None else math.exp(-damping * step)
        kick = step if damping is None else -math.expm1(-damping * step) / damping
        q, velocity = self.q0.copy(), self._first_half_step(step)
        packed = model.packed if model.law == "green" else None
        linked = model.linked if model.law == "linear" else None
        saved = np.empty((instants.steps.size, q.size))
        halves = np.empty((instants.steps.size, 2, q.size))
        low, high = np.full(model.chain.links, np.inf), np.full(model.chain.links, -np.inf)
        every = "tension_extremes" in self.outputs
        bound = 1e6 * math.sqrt(model.mass.sum()) * (model.chain.total_length + float(np.abs(model.shape).max()))

        def advance(begin: int, steps: int) -> bool:
            time = np.arange(begin, begin + steps + 1) / rate
            first, last = np.searchsorted(instants.steps, (begin, begin + steps))
            frozen = model.displacements(time) if model.moving else None
            marks = np.arange(begin, begin + steps) if every else instants.steps[first:last]
            rows = np.empty((marks.size, q.size)) if every else saved[first:last]
            sides = np.empty((marks.size, 2, q.size)) if every else halves[first:last]
            kernel.verlet(
                q,
                velocity,
                step,
                decay,
                kick,
                model.drive(time),
                frozen,
                packed,
                linked,
                steps,
                begin,
                marks,
                rows,
                sides,
            )
            if not (np.isfinite(q).all() and np.abs(q).max() < bound):
                return False
            if every:
                saved[first:last], halves[first:last] = (
                    item[instants.steps[first:last] - begin] for item in (rows, sides)
                )
                for some in np.array_split(np.arange(steps), max(1, steps // 1024)):
                    tension = model.tension(model.positions(rows[some], time[some]))
                    np.minimum(low, tension.min(axis=0), out=low)
                    np.maximum(high, tension.max(axis=0), out=high)
            return True

        failed = stepping.march(advance, (q, velocity), total, self.progress)
        if failed is not None:
            self._stop(instants, saved, halves, failed, rate)
        state = self._gather(instants, saved, halves, rate)
        state.extremes = (low, high) if every else None
        self._check_limit(state, rate)
        return state

    def _first_half_step(self, step: float) -> np.ndarray:
        """Rates half a step before the start: the particles start from rest, so the amplitudes oppose the lifting."""
        model = self.model
        damping = model.chain.p.mass_damping
        rates = -model.displacements(np.zeros(1), 1)[0] @ model.coupling
        slope, _ = model.gradient(np.concatenate([self.q0, model.displacements(np.zeros(1))[0]]))
        push = model.drive(np.zeros(1))[0] - slope
        if damping is None:
            return rates - 0.5 * step * push
        grow = math.expm1(0.5 * damping * step)
        return rates * (1.0 + grow) - grow / damping * push

    def _gather(self, instants: Instants, saved: np.ndarray, halves: np.ndarray, rate: float) -> _State:
        v = 0.5 * (halves[:, 0] + halves[:, 1])
        a = (halves[:, 1] - halves[:, 0]) * rate
        q = instants.at_times(saved, v, a)
        s = instants.fraction[:, None]
        after = np.minimum(instants.left + 1, len(v) - 1)
        rates = np.where(s > 0, (1 - s) * v[instants.left] + s * v[after], v[instants.left])
        return _State(instants, q, rates, None)

    def _check_limit(self, state: _State, rate: float) -> None:
        """Stop where the highest frequency on the way is too high for the step."""
        picked = np.unique(np.linspace(0, len(state.q) - 1, 50).astype(int))
        for i in picked:
            time = float(state.instants.times[i])
            omega = self.model.highest_frequency(state.q[i], time)
            if omega >= 2.0 * rate:
                raise RunStopped(
                    f"the reduced model stiffened: at {time:.6g} s its stability limit is {2 / omega:.6g} s, below the step "
                    f"{1 / rate:.6g} s (velocity Verlet); try a shorter step",
                    self.dataset(state),
                )

    def _stop(self, instants: Instants, saved: np.ndarray, halves: np.ndarray, done: int, rate: float) -> None:
        count = int(np.searchsorted(instants.times, done / rate * (1.0 - 1e-12)))
        partial = None
        if count:
            few = Instants.of(instants.times[:count], rate)
            partial = self.dataset(self._gather(few, saved[: few.steps.size], halves[: few.steps.size], rate))
            partial.attrs["incomplete"] = f"stopped at {done / rate:.6g} s of {instants.times[-1]:.6g} s"
        raise RunStopped(
            f"the reduced model left the finite numbers at {done / rate:.6g} s (velocity Verlet, step {1 / rate:.4g} s, step "
            f"number {done}); try a shorter step, more modes, or the chain itself",
            partial,
        )

    def dataset(self, state: _State) -> xr.Dataset:
        """Label what a run gave."""
        from scipy.linalg import solve_triangular  # costly to import

        model, time = self.model, state.instants.times
        amplitude = solve_triangular(model.root, state.q.T, lower=True, trans="T").T
        result = pod.amplitude_dataset(amplitude, model.chain.p.end_positions(time), time, self.modes)
        result = result.assign_coords(arc_length=("particle", model.chain.arc_length))
        result["unstretched_length"] = ((), model.chain.total_length)
        place = ("time", "particle", "coordinate")
        if {"position", "tension"} & set(self.outputs):
            position = model.positions(state.q, time)
            if "position" in self.outputs:
                result["position"] = (place, position)
            if "tension" in self.outputs:
                result["tension"] = (("time", "link"), model.tension(position))
            size = np.sqrt(np.sum(np.diff(position, axis=1) ** 2, axis=-1))
            result.attrs["smallest_stretch"] = float((size / model.chain.length).min())
        if "velocity" in self.outputs:
            result["velocity"] = (place, model.velocities(state.rates, time))
        if state.extremes is not None:
            result["tension_minimum"], result["tension_maximum"] = (("link", item) for item in state.extremes)
        label(result)
        rank = result.sizes["mode"]
        result.attrs.update(
            title=f"{self.scene.attrs.get('title', 'scene')}: Galerkin model, r = {rank}, {model.law} law",
            stage="trajectory",
            model="Galerkin",
            law=model.law,
            rank=rank,
            scheme=SCHEMES[0],
            step=1.0 / state.instants.rate,
            number_of_steps=int(state.instants.steps[-1]),
        )
        return result
