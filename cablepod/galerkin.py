"""The paper's reduced model, eqs. (34)-(36): modes + scene -> trajectory."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from cablepod import pod, provenance, stepping
from cablepod.chain import Chain, start
from cablepod.conventions import COORDINATES, ENDS, label
from cablepod.members import over_members
from cablepod.scene import Parameters, check_memory, parameters, solve_statics
from cablepod.schema import SceneError, refuse
from cablepod.stepping import Instants, RunStopped

LAWS = ("green", "linear")
SCHEMES = ("velocity_verlet",)


@dataclass(frozen=True)
class Model:
    """A cable restricted to modes.

    Coordinates y are the mass-orthonormal amplitudes q, then the displacements of the ends that move (the lifting needs no
    code of its own).  Positions are shape + sum y_k field_k on the particles of the modes, with the links and masses of a chain
    on those particles.
    """

    chain: Chain
    law: str
    mean: np.ndarray  #: (particle, dims) [m]
    modes: np.ndarray  #: modes as given (modes, particle, dims)
    layout: str

    @cached_property
    def sigma(self) -> np.ndarray:
        """Relative arc length of the particles."""
        return self.chain.arc_length / self.chain.total_length

    @cached_property
    def mass(self) -> np.ndarray:
        """Masses of the free particles (n - 1,) [kg]."""
        return self.chain.p.mass * self.chain.share[1:-1]

    @cached_property
    def root(self) -> np.ndarray:
        """Lower Cholesky factor of the mass matrix of the modes [kg^1/2]."""
        inner = self.modes[:, 1:-1]
        return np.linalg.cholesky(np.einsum("ipc,p,kpc->ik", inner, self.mass, inner))

    @cached_property
    def fields(self) -> np.ndarray:
        """Mass-orthonormal modes (modes, particle, dims) [kg^-1/2]."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - costly to import

        flat = solve_triangular(self.root, self.modes.reshape(len(self.modes), -1), lower=True)
        return flat.reshape(self.modes.shape)

    @cached_property
    def moving(self) -> tuple[tuple[str, str], ...]:
        """The (end, axis) that move."""
        return tuple(self.chain.p.motions)

    @cached_property
    def lifts(self) -> np.ndarray:
        """Fields of the displacements of the ends (moving, particle, dims)."""
        result = np.zeros((len(self.moving), self.sigma.size, self.chain.p.dims))
        for field, (end, axis) in zip(result, self.moving, strict=True):
            field[:, COORDINATES.index(axis)] = self.sigma if end == ENDS[1] else 1.0 - self.sigma
        return result

    @cached_property
    def shape(self) -> np.ndarray:
        """Mean shape between the undisplaced ends (particle, dims) [m]."""
        s = self.sigma[:, None]
        return (1.0 - s) * self.chain.p.lower + s * self.chain.p.upper + self.mean

    @cached_property
    def coupling(self) -> np.ndarray:
        """What acceleration of the ends does to the amplitudes (moving, modes) [kg^1/2]."""
        return np.einsum("fpc,p,kpc->fk", self.lifts[:, 1:-1], self.mass, self.fields[:, 1:-1])

    @cached_property
    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Differences over the links by their lengths: of the shape (n, dims), of the fields (coordinates, n, dims)."""
        length = self.chain.length[:, None]
        fields = np.concatenate([self.fields, self.lifts])
        return np.diff(self.shape, axis=0) / length, np.diff(fields, axis=1) / length

    @cached_property
    def packed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Law (21) in packed form: triangular factor, offset, pairs; see ``kernels.reduced``."""
        shape, rates = self.slopes
        length = self.chain.length
        count = len(rates)
        # axes of a field: two fields without a common axis have no product, and cost nothing
        axes = np.abs(rates).max(axis=1) > 0.0
        pairs = [(j, k) for j in range(count) for k in range(j, count) if (axes[j] & axes[k]).any()]
        first, second = (np.array(item, dtype=np.int64) for item in zip(*pairs, strict=True))
        # the strain (xi^2 - 1)/2 about the mean shape, where differences of large numbers are gone
        reach = np.diff(self.shape, axis=0)
        size = np.sqrt(np.sum(reach**2, axis=1))
        strain = 0.5 * (size - length) / length * (size + length) / length
        linear = np.einsum("jc,kjc->jk", shape, rates)
        quadratic = np.einsum("pjc,pjc->jp", rates[first], rates[second]) * np.where(first == second, 0.5, 1.0)
        weight = np.sqrt(self.chain.p.stiffness * length)[:, None]
        table = weight * np.concatenate([linear, quadratic, strain[:, None]], axis=1)
        factor = np.linalg.qr(table, mode="r")
        return np.ascontiguousarray(factor[:, :-1]), np.ascontiguousarray(factor[:, -1]), first, second

    @cached_property
    def linked(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The linear law link by link; see ``kernels.reduced``."""
        shape, rates = self.slopes
        k = self.chain.p.stiffness * self.chain.length
        return np.ascontiguousarray(shape.T), np.ascontiguousarray(np.moveaxis(rates, 1, 2)), k

    def drive(self, time: np.ndarray) -> np.ndarray:
        """Generalised loads on the amplitudes at times (time, modes); one row where they stand still."""
        p = self.chain.p
        total = np.einsum("pc,kpc->k", self.chain.loads(), self.fields)[None]
        varying = self.chain.varying()
        if not varying and not self.moving:
            return total
        result = np.repeat(total, time.size, axis=0)
        for pattern, factor in varying:
            result += factor(time)[:, None] * np.einsum("pc,kpc->k", pattern, self.fields)
        if self.moving:
            pull = self.displacements(time, 2)
            if p.mass_damping is not None:
                pull = pull + p.mass_damping * self.displacements(time, 1)
            result -= pull @ self.coupling
        return result

    def displacements(self, time: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Displacements of the ends that move, or their rates: (time, moving)."""
        time = np.asarray(time, dtype=float)
        columns = [self.chain.p.motions[key](time, derivative) for key in self.moving]
        return np.stack(columns, axis=1) if columns else np.zeros((time.size, 0))

    def gradient(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (modes,) and Hessian (modes, modes) of the potential energy by the amplitudes."""
        shape, rates = self.slopes
        stiffness = self.chain.p.stiffness * self.chain.length
        reach = shape + np.tensordot(y, rates, axes=1)
        square = np.sum(reach**2, axis=1)
        along = np.einsum("jc,kjc->kj", reach, rates[: len(self.modes)])
        own = rates[: len(self.modes)]
        if self.law == "green":
            s, ds = stiffness * 0.5 * (square - 1.0), stiffness
        else:
            xi = np.sqrt(square)
            taut = xi > 1.0
            s, ds = np.where(taut, stiffness * (1.0 - 1.0 / xi), 0.0), np.where(taut, stiffness / xi**3, 0.0)
        hessian = (along * ds) @ along.T + np.einsum("kjc,j,ljc->kl", own, s, own)
        return along @ s, hessian

    def highest_frequency(self, q: np.ndarray, time: float) -> float:
        """Highest angular frequency [rad/s] of small motions about the amplitudes `q`."""
        _, hessian = self.gradient(np.concatenate([q, self.displacements(np.array([time]))[0]]))
        return math.sqrt(max(float(np.linalg.eigvalsh(hessian)[-1]), 0.0))

    def initial(self) -> np.ndarray:
        """Amplitudes at the start: the model's own equilibrium, or the projection of the shape that the scene says."""
        frozen = self.displacements(np.zeros(1))[0]
        p = self.chain.p
        offset = start(self.chain) - self.shape - np.tensordot(frozen, self.lifts, axes=1)
        q = np.einsum("pc,p,kpc->k", offset[1:-1], self.mass, self.fields[:, 1:-1])
        if p.initial:
            return q
        load = np.einsum("pc,kpc->k", self.chain.loads(0.0), self.fields)
        return _equilibrium(lambda q: self.gradient(np.concatenate([q, frozen])), load, q)

    def tension(self, position: np.ndarray) -> np.ndarray:
        """Tensions of the links (..., n) [N] by the law of the model."""
        size = np.sqrt(np.sum(np.diff(position, axis=-2) ** 2, axis=-1))
        strain = (size - self.chain.length) / self.chain.length
        if self.law == "linear":
            return self.chain.p.stiffness * np.maximum(strain, 0.0)
        return self.chain.p.stiffness * strain * (1.0 + 0.5 * strain) * (1.0 + strain)

    def positions(self, q: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Positions (time, particle, dims) [m] from amplitudes (time, modes)."""
        position = pod.compose(q, self.chain.p.end_positions(time), self.fields, self.mean, self.sigma)
        return position

    def velocities(self, rates: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Velocities (time, particle, dims) [m/s] from the rates of the amplitudes."""
        moving = np.tensordot(self.displacements(time, 1), self.lifts, axes=1)
        return np.tensordot(rates, self.fields, axes=1) + moving


def _equilibrium(gradient: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], load: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Find the amplitudes at rest by Newton's method, beginning with the projected rest of the chain.

    Where the Hessian is not positive or the steps do not settle (a locked or slack model) the projection itself is the start.
    """
    found = q
    last = math.inf
    for _ in range(50):
        slope, hessian = gradient(found)
        try:
            move = np.linalg.solve(hessian, load - slope)
        except np.linalg.LinAlgError:
            return q
        size = float(np.abs(move).max())
        if not size < last and last < 1e-6 * (float(np.abs(q).max()) + 1e-3):
            return found  # rounding: the steps shrink no more
        found = found + move
        if size == 0.0:
            return found
        last = size
    return found if last <= 1e-9 * (float(np.abs(q).max()) + 1e-3) else q


def model_of(p: Parameters, modes: xr.Dataset, *, rank: int | None, law: str) -> Model:
    """Make the reduced model of a scene's parameters on modes.

    Raises
    ------
    SceneError
        For a scene that this model cannot do.
    """
    if law not in LAWS:
        raise refuse("law", law, "one of " + ", ".join(f'"{name}"' for name in LAWS))
    if p.free is not None:
        raise refuse("ends.free", p.free, "two held ends, because the modes vanish at both; chain.simulate does a free end")
    if p.link_viscosity is not None:
        raise refuse("damping.link_viscosity", p.link_viscosity, "none for a reduced model; mass_proportional is possible")
    fields = pod.mode_fields(modes, rank)
    if fields.shape[2] != p.dims:
        raise SceneError(f"modes: given {fields.shape[2]} coordinates; allowed: the {p.dims} coordinates of the scene")
    sigma = pod.relative_arc_length(modes)
    total = float(solve_statics(p, p.length_key, p.length_value)[0])
    arc_length = total * sigma
    chain = Chain(p, np.diff(arc_length), arc_length)
    mean = modes["mean"].transpose("particle", "coordinate").values
    return Model(chain, law, mean, fields, modes.attrs["layout"])


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
            stepping.preferred_rate(1.0 / (0.8 * limit)),
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
        from cablepod.kernels import reduced as kernel  # noqa: PLC0415 - numba is imported only to compute

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
                q, velocity, step, decay, kick, model.drive(time), frozen, packed, linked, steps, begin, marks, rows, sides
            )
            if not (np.isfinite(q).all() and np.abs(q).max() < bound):
                return False
            if every:
                saved[first:last], halves[first:last] = (item[instants.steps[first:last] - begin] for item in (rows, sides))
                for some in np.array_split(np.arange(steps), max(1, steps // 1024)):
                    tension = model.tension(model.positions(rows[some], time[some]))
                    np.minimum(low, tension.min(axis=0), out=low)
                    np.maximum(high, tension.max(axis=0), out=high)
            return True

        done = 0
        while done < total:
            steps = min(stepping.BLOCK, total - done)
            keep = q.copy(), velocity.copy()
            if not advance(done, steps):
                q[:], velocity[:] = keep
                while advance(done, 1):  # once more, step by step, to say when
                    done += 1
                self._stop(instants, saved, halves, done, rate)
            done += steps
            if self.progress is not None:
                self.progress(min(1.0, done / total))
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
            f"the reduced model left the finite numbers at {done / rate:.6g} s (velocity Verlet, step {1 / rate:.4g} s, step number "
            f"{done}); try a shorter step, more modes, or the chain itself",
            partial,
        )

    def dataset(self, state: _State) -> xr.Dataset:
        """Label what a run gave."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - costly to import

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
