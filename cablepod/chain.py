"""The elastic chain, eqs. (1)-(3) of the paper with the signs repaired: scene -> chain at rest, scene -> trajectory."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance, stepping
from cablepod.conventions import COORDINATES, label
from cablepod.links import LAWS, Chain, chain_of, check_law, square
from cablepod.members import over_members
from cablepod.parameters import check_memory, load_plane, parameters, solve_statics
from cablepod.schema import SceneError, refuse
from cablepod.stepping import Instants, RunStopped

SCHEMES = ("velocity_verlet",)


# --- rest -----------------------------------------------------------------------------------------------------------


@over_members
def rest(scene: xr.Dataset, *, links: int | None = None, law: str = LAWS[0]) -> xr.Dataset:
    """Compute the chain at rest between its ends, under all loads of the scene at time 0.

    Parameters
    ----------
    scene
        A scene; an end that is free during the run is held here.
    links
        Number of links, instead of the scene's.
    law
        "linear" or "green", see :func:`simulate`.

    Returns
    -------
    xarray.Dataset
        ``position (particle, coordinate)`` [m], ``tension (link)`` [N], ``arc_length (particle)`` [m] and the scalars
        ``unstretched_length``, ``stretched_length`` [m], ``tension_lower``, ``tension_upper``, ``residual`` [N].

    Raises
    ------
    SceneError
        For a law that is not known, a scene without rest, and a chain that at rest has a link without force (folded on itself).

    Notes
    -----
    Newton's method on the force in the first link, which determines all else (the discrete catenary).  The residual is
    that of the tensions along the links as they are stored; tensions computed again from the positions carry the rounding
    of these, about K/l 2^-53 times the chord.

    Where a scene gives a tension, its unstretched length follows by the linear law whatever `law` is: both laws have the same
    cable, and by law (21), T = K xi (xi^2 - 1) / 2, the tension at rest is not quite the one given: with a strain e it is off by
    1.5 e at most, relatively, and by much less where the sag decides.
    """
    check_law(law)
    p = parameters(scene)
    chain = chain_of(p, links, law)
    position, tension = _rest(chain)
    reach = np.diff(position, axis=0)
    force = (tension / np.sqrt(square(reach)))[:, None] * reach
    unbalanced = force[1:] - force[:-1] + chain.loads(0.0)[1:-1]
    scalars = {
        "unstretched_length": chain.total_length,
        "stretched_length": float(np.sum(np.sqrt(square(reach)))),
        "tension_lower": tension[0],
        "tension_upper": tension[-1],
        "residual": float(np.sqrt(square(unbalanced)).max()),
    }
    result = xr.Dataset(
        {
            "position": (("particle", "coordinate"), position),
            "tension": ("link", tension),
            **{name: ((), value) for name, value in scalars.items()},
        },
        coords=_coordinates(chain),
    )
    label(result)
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: chain at rest{_suffix(chain)}", stage="rest", law=chain.law
    )
    options = {"links": chain.links, "law": chain.law}
    return provenance.record(result, function="chain.rest", parameters=options, inputs=[scene])


def _suffix(chain: Chain) -> str:
    return f", {chain.law} law" if chain.green else ""


def _coordinates(chain: Chain) -> dict[str, Any]:
    return {"arc_length": ("particle", chain.arc_length), "coordinate": list(COORDINATES[: chain.p.dims])}


def _rest(chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n + 1, dims) [m] and tensions (n,) [N] of a chain at rest."""
    from cablepod.kernels import chain as kernel  # numba is imported only to compute

    p = chain.p
    ends = p.end_positions(np.zeros(1))[0]
    chord = ends[1] - ends[0]
    loads = chain.loads(0.0)[1:-1]
    solution = solve_statics(p, "unstretched_length", chain.total_length)
    _, _, _, q, across, against = load_plane(p)
    v0 = solution[3] - 0.5 * q * (chain.total_length - chain.length[0])
    force = solution[2] * across + v0 * against
    if not np.isfinite(force).all() or not force.any():
        # weightless and slack but for point loads, or just without tension: begin with any pull along the chord
        force = chord / np.linalg.norm(chord) * max(float(np.abs(loads).sum()), 1e-6 * p.stiffness)
    gap = kernel.equilibrium(chord, loads, chain.length, p.stiffness, chain.green, force)
    scale = max(float(np.linalg.norm(chord)), chain.total_length)
    forces = force - np.concatenate([np.zeros((1, p.dims)), np.cumsum(loads, axis=0)])
    tension = np.sqrt(square(forces))
    if not gap <= 1e-11 * scale or not tension.min() > 0.0:
        left = f" (a gap of {gap:.2g} m is left)" if np.isfinite(gap) else ""
        raise SceneError(
            f"chain: no rest found with all links taut{left}; allowed: a scene whose chain does not fold on itself at rest and "
            f"is not far softer than its loads (its stiffness is {p.stiffness:.3g} N), or a start from initial.points"
        )
    secant = np.array([kernel.secant_modulus(size, p.stiffness, chain.green) for size in tension])
    reach = chain.length[:, None] * (forces / tension[:, None] + forces / secant[:, None])
    position = ends[0] + np.concatenate([np.zeros((1, p.dims)), np.cumsum(reach, axis=0)])
    position[-1] = ends[1]
    return position, tension


def start(chain: Chain) -> np.ndarray:
    """Positions from which a run starts (n + 1, dims) [m]: at rest, or the shape that the scene's initial table says."""
    p = chain.p
    if "points" in p.initial:
        return _along_line(chain, np.asarray(p.initial["points"], dtype=float))
    for key in ("top_tension", "unstretched_length"):
        if key in p.initial:
            other = solve_statics(p, key, p.initial[key], prefix="initial")[0]
            factor = other / chain.total_length
            return _rest(replace(chain, length=factor * chain.length, arc_length=factor * chain.arc_length))[0]
    return _rest(chain)[0]


def _along_line(chain: Chain, line: np.ndarray) -> np.ndarray:
    """Lay the particles on a line: one on each point, or by unstretched length.

    Between two held ends the line is shared out in proportion; a free end lies where the unstretched length ends.
    """
    if len(line) == chain.links + 1:
        position = line.copy()
    else:
        reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        place = chain.arc_length / chain.total_length * reach[-1]
        if chain.p.free is not None:
            spare = reach[-1] - chain.total_length
            if spare < -1e-9 * chain.total_length:
                raise SceneError(
                    f"initial.points: given a line of {reach[-1]:.9g} m; allowed: at least the unstretched length, "
                    f"{chain.total_length:.9g} m, so that the free end can lie on it"
                )
            place = chain.arc_length + (spare if chain.p.free == "lower" else 0.0)
        position = np.stack([np.interp(place, reach, line[:, c]) for c in range(line.shape[1])], axis=1)
    ends = chain.p.end_positions(np.zeros(1))[0]
    for index, end in ((0, "lower"), (-1, "upper")):
        if chain.p.free != end:
            position[index] = ends[index]
    return position


# --- motion ---------------------------------------------------------------------------------------------------------


@over_members
def simulate(
    scene: xr.Dataset,
    *,
    links: int | None = None,
    times: Any = None,
    law: str = LAWS[0],
    scheme: str | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    outputs: tuple[str, ...] = ("position",),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the elastic chain of a scene.

    Parameters
    ----------
    scene
        A scene, with or without ``member``.
    links
        Number of links, instead of the scene's.
    times
        Instants of the output [s], rising from 0 on; by default 0, interval, ... up to the scene's duration.  They change
        no bit of the motion: what lies between two steps is interpolated to the order of the scheme.
    law
        "linear": T = K (xi - 1), xi = |R| / l, where that is positive; a slack link carries nothing.  "green": eq. (21) of the
        paper, T / xi = K (xi^2 - 1) / 2, the extensible cable cut into lumped linear elements; it resists compression.  A run
        from equilibrium starts from that of its law.
    scheme
        "velocity_verlet".
    step
        Time step [s].  By default it follows from the highest frequency and is then halved or shortened until two runs agree
        within `tolerance`; with a given step there is one run and no such check.
    tolerance
        Wanted time error as a fraction of the largest rms displacement; 1e-6 by default.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps); nothing else is computed.
    progress
        Called now and then with the part of the run that is done, from 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``position (time, particle, coordinate)`` [m], ``velocity`` [m/s], ``tension (time, link)`` [N],
        ``tension_minimum``, ``tension_maximum (link)`` [N] as asked for; by law "green" compression is negative.  Attributes say
        law, scheme, step [s], number of steps, stability limit of the step [s], highest angular frequency [rad/s] and the
        estimate of the time error; with law "green" limit and frequency are those of the start, and ``smallest_stretch`` says
        the least xi at the instants of the output.

    Raises
    ------
    SceneError
        For options that cannot be, law "green" with viscous links, a step above the stability limit, an output that would not
        fit in memory.
    RunStopped
        Where the motion leaves the finite numbers; its ``partial`` holds what was computed until then.  With law "green" also
        where at an instant of the output the links have become too stiff for a given step.

    Warns
    -----
    NotConvergedWarning
        Where no step meets the tolerance, as in chaotic scenes.

    Notes
    -----
    m r'' = P + T_j - T_(j-1) with T = k (1 - l/|R|) R for |R| > l, else 0; eqs. (1)-(3) of the paper.  Second order in step
    and in 1/n.  Damping by mass is integrated exactly; viscous links use a velocity predicted from the last two half steps,
    which keeps the order.

    By law (21) T = k/2 (|R|^2/l^2 - 1) R, from the energy K (xi^2 - 1)^2 / 8 per unstretched length.  Along a link it is
    (3 xi^2 - 1) / 2 times as stiff as unstretched, so the limit of the step is that of the stretch at the start and falls as the
    links are pulled; the step that is chosen here counts on the largest distance of the ends, keeps a margin, and is halved where
    that is not enough.
    """
    check_law(law)
    stepping.check_scheme(scheme, SCHEMES)
    names = stepping.check_outputs(outputs)
    if step is not None and tolerance is not None:
        raise refuse("step and tolerance", (step, tolerance), "one of them: a tolerance chooses the step")
    goal = stepping.DEFAULT_TOLERANCE if tolerance is None else stepping.check_positive("tolerance", tolerance)
    p = parameters(scene)
    if law == "green" and p.link_viscosity is not None:
        raise refuse(
            "law and damping.link_viscosity",
            (law, p.link_viscosity),
            'viscous links with law "linear"; with "green" none, mass_proportional is possible',
        )
    chain = chain_of(p, links, law)
    instants = p.times() if times is None else stepping.check_times(times)
    p.check_reach(float(instants[-1]))
    check_memory(
        instants.size, chain.links, p.dims, key="links" if links is not None else "chain.links and times", variables=3
    )
    initial = start(chain)
    limit = chain.step_limit(chain.stiffening(initial))
    run = _Run(chain, instants, initial, names, progress, str(scene.attrs.get("title", "scene")))
    if step is None:
        chord = float(np.linalg.norm(p.upper - p.lower))
        state, rate, estimate = stepping.refine(
            run,
            lambda s: s.position,
            lambda s: stepping.motion_scale(s.position, initial, chord),
            stepping.preferred_rate(1.0 / _first_step(chain, initial, limit, float(instants[-1]))),
            goal,
        )
    else:
        rate = 1.0 / stepping.check_step(step, limit, f"2 over the highest angular frequency, {2 / limit:.6g} rad/s")
        state, estimate = run(rate), None
    result = run.dataset(state)
    if estimate is not None:
        result.attrs["time_error_estimate"] = estimate
    options = {
        "links": chain.links,
        "times": instants,
        "law": law,
        "scheme": SCHEMES[0],
        "step": 1.0 / rate,
        "tolerance": None if step is not None else goal,
        "outputs": list(names),
    }
    return provenance.record(result, function="chain.simulate", parameters=options, inputs=[scene])


def _first_step(chain: Chain, initial: np.ndarray, limit: float, until: float) -> float:
    """Choose the step to begin with [s]; by law (21) for the stretch to come, as far as the ends enforce it, and waves on top."""
    if not chain.green:
        return 0.9 * limit
    return 0.8 * chain.step_limit(np.maximum(chain.stiffening(initial), chain.enforced_stiffening(until)))


@dataclass
class _State:
    """What one run gives."""

    instants: Instants
    position: np.ndarray  # (times, n + 1, dims)
    velocity: np.ndarray | None
    extremes: tuple[np.ndarray, np.ndarray] | None


@dataclass(frozen=True)
class _Run:
    """One scene, ready to be run with any step."""

    chain: Chain
    times: np.ndarray
    initial: np.ndarray
    outputs: tuple[str, ...]
    progress: Callable[[float], None] | None
    title: str

    def __call__(self, rate: float) -> _State:
        from cablepod.kernels import chain as kernel  # numba is imported only to compute

        chain, p, free = self.chain, self.chain.p, self.chain.free
        instants = Instants.of(self.times, rate)
        if instants.dense:  # both neighbours of an instant are kept, with rates on either side
            check_memory(instants.times.size, chain.links, p.dims, key="times between two steps", variables=12)
        total = int(instants.steps[-1]) + 1
        step = 1.0 / rate
        mass = p.mass * chain.share[free]
        decay, per_mass = None, step / mass
        if p.mass_damping is not None:
            decay = math.exp(-p.mass_damping * step)
            per_mass = -math.expm1(-p.mass_damping * step) / (p.mass_damping * mass)
        state = tuple(np.ascontiguousarray(self.initial[:, c]) for c in range(p.dims))
        velocity, before = self._first_half_step(step, mass)
        planar = p.dims == 2
        xyz = (*state, None) if planar else state
        uvw = (*velocity, None) if planar else velocity
        work = (None, None) if planar else (np.zeros(chain.links + 2), np.zeros(chain.links + 1))
        drive = tuple(np.ascontiguousarray(column) for column in (per_mass[:, None] * chain.loads()[free]).T)
        varying = chain.varying()
        patterns = np.array([np.ascontiguousarray(item[0][free].T) for item in varying]) if varying else None
        wants_velocity = (
            instants.dense or "velocity" in self.outputs or ("tension" in self.outputs and p.link_viscosity is not None)
        )
        saved = np.empty((instants.steps.size, p.dims, chain.links + 1))
        halves = np.empty((instants.steps.size, 2, p.dims, mass.size)) if wants_velocity else None
        low = np.full(chain.links, np.inf) if "tension_extremes" in self.outputs else None
        high = np.full(chain.links, -np.inf) if low is not None else None
        inverse = chain.inverse_squares
        moving = {end for end, _ in p.motions}
        bound = 1e6 * (chain.total_length + float(np.abs(self.initial).max()) + 1.0)

        def advance(start: int, steps: int) -> bool:
            time = np.arange(start, start + steps + 1) / rate
            ends = p.end_positions(time) if moving else None
            first, last = np.searchsorted(instants.steps, (start, start + steps))
            kernel.verlet(
                *xyz, *uvw, *work, free.start, free.stop, chain.k, chain.length, inverse, per_mass, drive, step, decay,
                np.ascontiguousarray(ends[:, 0]) if ends is not None and "lower" in moving else None,
                np.ascontiguousarray(ends[:, 1]) if ends is not None and "upper" in moving else None,
                patterns,
                np.stack([factor(time) for _, factor in varying], axis=1) if varying else None,
                p.link_viscosity, before,
                p.end_positions(time, 1) if before is not None else None,
                steps, start, instants.steps[first:last], saved[first:last],
                halves[first:last] if halves is not None else None, low, high,
            )  # fmt: skip
            return all(np.isfinite(x).all() and np.abs(x).max() < bound for x in state)

        failed = stepping.march(advance, (*state, *velocity, *(before or ())), total, self.progress)
        if failed is not None:
            self._stop(instants, saved, halves, failed, rate)
        extremes = None if low is None or high is None else (low, high)
        result = self._gather(instants, saved, halves, extremes, rate)
        self._check_limit(result)
        return result

    def _first_half_step(
        self, step: float, mass: np.ndarray
    ) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...] | None]:
        """Velocities half a step before the start from rest, and with viscosity those a step earlier."""
        p, free = self.chain.p, self.chain.free
        rates = p.end_positions(np.zeros(1), 1)[0]
        all_rates = np.zeros_like(self.initial)
        all_rates[0], all_rates[-1] = rates
        all_rates[free] = 0.0
        _, force = self.chain.pull(self.initial, all_rates)
        zero = np.zeros((1, p.dims))
        net = np.diff(np.concatenate([zero, force, zero]), axis=0) + self.chain.loads(0.0)
        half = 0.5 * step if p.mass_damping is None else math.expm1(0.5 * p.mass_damping * step) / p.mass_damping
        back = -half * net[free] / mass[:, None]
        velocity = tuple(np.ascontiguousarray(column) for column in back.T)
        # the prediction 1.5 v - 0.5 before then gives rest at the start
        return velocity, None if p.link_viscosity is None else tuple(3.0 * v for v in velocity)

    def _gather(
        self,
        instants: Instants,
        saved: np.ndarray,
        halves: np.ndarray | None,
        extremes: tuple[np.ndarray, np.ndarray] | None,
        rate: float,
    ) -> _State:
        x = np.ascontiguousarray(np.moveaxis(saved, 1, 2))
        if halves is None:
            return _State(instants, instants.at_times(x, None, None), None, extremes)
        p, free = self.chain.p, self.chain.free
        time = instants.steps / rate
        v, a = np.zeros_like(x), np.zeros_like(x)
        for target, order in ((v, 1), (a, 2)):
            target[:, (0, -1)] = p.end_positions(time, order)
        v[:, free] = np.moveaxis(0.5 * (halves[:, 0] + halves[:, 1]), 1, 2)
        a[:, free] = np.moveaxis((halves[:, 1] - halves[:, 0]) * rate, 1, 2)
        velocity = None
        if "velocity" in self.outputs or "tension" in self.outputs:
            velocity = v[instants.left]
            between = instants.fraction > 0
            i, s = instants.left[between], instants.fraction[between].reshape(-1, 1, 1)
            # the cubic with values and rates
            velocity[between] = (
                (1 + 2 * s) * (1 - s) ** 2 * v[i]
                + s * (1 - s) ** 2 / rate * a[i]
                + s**2 * (3 - 2 * s) * v[np.minimum(i + 1, len(v) - 1)]
                - s**2 * (1 - s) / rate * a[np.minimum(i + 1, len(v) - 1)]
            )
        return _State(instants, instants.at_times(x, v, a), velocity, extremes)

    def _check_limit(self, state: _State, partial: xr.Dataset | None = None) -> None:
        """Raise :class:`RunStopped` where the links became too stiff for the step, which only law (21) lets them."""
        chain, rate = self.chain, state.instants.rate
        if not chain.green:
            return
        stiffening = chain.stiffening(state.position)
        if chain.step_limit(stiffening.max(axis=0)) > 1.0 / rate:
            return  # not even all links at their stiffest
        for time, now in zip(state.instants.times, stiffening, strict=True):
            limit = chain.step_limit(now)
            if limit <= 1.0 / rate:
                raise RunStopped(
                    f"the chain stiffened: at {time:.6g} s its stability limit is {limit:.6g} s, below the step "
                    f"{1 / rate:.6g} s (velocity Verlet, law {chain.law}); try a shorter step",
                    self.dataset(state) if partial is None else partial,
                )

    def _limit(self) -> float:
        """Stability limit of the step at the start [s]."""
        return self.chain.step_limit(self.chain.stiffening(self.initial))

    def _stop(self, instants: Instants, saved: np.ndarray, halves: np.ndarray | None, done: int, rate: float) -> None:
        """Raise :class:`RunStopped` with what was computed before step `done`."""
        count = int(np.searchsorted(instants.times, done / rate * (1.0 - 1e-12)))
        partial = None
        if count:
            few = Instants.of(instants.times[:count], rate)
            keep = few.steps.size
            state = self._gather(few, saved[:keep], None if halves is None else halves[:keep], None, rate)
            partial = self.dataset(state)
            partial.attrs["incomplete"] = f"stopped at {done / rate:.6g} s of {instants.times[-1]:.6g} s"
            self._check_limit(state, partial)  # why it broke down, if that shows at an instant of the output
        raise RunStopped(
            f"the chain left the finite numbers at {done / rate:.6g} s (velocity Verlet, step {1 / rate:.4g} s, step number "
            f"{done}, stability limit {self._limit():.4g} s); try a shorter step, gentler loads or motion, or damping",
            partial,
        )

    def dataset(self, state: _State) -> xr.Dataset:
        """Label what a run gave."""
        chain, rate = self.chain, state.instants.rate
        variables: dict[str, Any] = {}
        if "position" in self.outputs:
            variables["position"] = (("time", "particle", "coordinate"), state.position)
        if "velocity" in self.outputs:
            variables["velocity"] = (("time", "particle", "coordinate"), state.velocity)
        if "tension" in self.outputs:
            variables["tension"] = (("time", "link"), chain.pull(state.position, state.velocity)[0])
        if state.extremes is not None:
            variables["tension_minimum"], variables["tension_maximum"] = (("link", item) for item in state.extremes)
        result = xr.Dataset(variables, coords={"time": state.instants.times, **_coordinates(chain)})
        result["unstretched_length"] = ((), chain.total_length)
        label(result)
        result.attrs.update(
            title=f"{self.title}: elastic chain of {chain.links} links{_suffix(chain)}",
            stage="trajectory",
            model="elastic chain",
            law=chain.law,
            scheme=SCHEMES[0],
            step=1.0 / rate,
            number_of_steps=int(state.instants.steps[-1]),
            step_limit=self._limit(),
            highest_angular_frequency=chain.highest_frequency(chain.stiffening(self.initial)),
        )
        if chain.green:
            result.attrs["smallest_stretch"] = float(chain.stretch(state.position).min())
        return result
