"""The condensed model: quasi-static along the chord, Karhunen-Loeve modes for the deflection normal to it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod import condensed_estimate, condensed_output, provenance, stepping
from cablepod.condensed_model import Model, model_of
from cablepod.condensed_output import State
from cablepod.conventions import OUTPUTS
from cablepod.members import over_members
from cablepod.parameters import check_memory, parameters
from cablepod.schema import refuse
from cablepod.stepping import Instants, RunStopped

SCHEMES = ("velocity_verlet", "trapezoidal")
#: Where the stretching of the sag takes the explicit limit below this share of what the tension alone would allow, steps are
#: implicit by default.
STIFF = 0.3
#: First step of a search times the highest frequency (implicit: the lowest).  Nothing damps free vibrations, so that with longer
#: steps their phases are off by turns at the end of a run, and two runs tell nothing of each other.
RESOLVING = 0.4


@over_members
def simulate(
    scene: xr.Dataset,
    modes: xr.Dataset,
    *,
    rank: int | None = None,
    times: Any = None,
    order: str = "leading",
    law: str = "linear",
    scheme: str | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    outputs: tuple[str, ...] = ("position", "error_estimate"),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the cable of a scene, quasi-static along its chord, on modes of the deflection normal to it.

    Parameters
    ----------
    scene
        A scene with both ends held, with or without ``member``; it need not be the one the modes come from.
    modes
        What :func:`cablepod.pod.decompose` gives with layout "normal"; they are carried over by sigma = S / L0.
    rank
        Number of modes of each deflection; all by default.
    times
        Instants of the output [s], rising from 0 on; by default those of the scene.
    order
        "leading": closure and force to first order in strain and slope squared, a step costs a product of r by r; "exact": the
        chordwise stretch at each link as it is, the tension from Newton's method; "inertial": exact, with the inertia of the
        motion along the chord that the deflection brings with it.
    law
        "linear", the chain's law; with orders "exact" and "inertial" also "green", eq. (21).
    scheme
        "velocity_verlet" is explicit, "trapezoidal" implicit and stable at any step.  By default explicit, unless the stretching
        of the sag makes its steps short.
    step
        Time step [s]; by default it is shortened until two runs agree within `tolerance`.
    tolerance
        Wanted time error as a fraction of the largest rms displacement; 1e-6 by default.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps), "error_estimate" (of the model, see
        :func:`cablepod.condensed_estimate.estimate`; it takes longer than the run itself); nothing else is computed.
    progress
        Called now and then with the part of the run that is done, from 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``amplitude (time, mode)`` [m], in space also ``amplitude_out_of_plane``, ``end_position`` [m] and the outputs asked for,
        on the particles of the modes.  Attributes say scheme, step [s], number of steps, ``step_limit`` [s] of explicit steps,
        and how far the run stayed from where the model fails: ``smallest_chordwise_force`` [N] over all steps,
        ``forcing_over_axial_frequency``, ``energy_share_kept`` of the snapshots by the modes, ``outside_training``, how far the
        scene lies from those of the snapshots, see :func:`cablepod.training.outside`; ``error_estimate`` is the largest error to
        be expected over time, as a fraction of the motion, ``time_error_estimate`` the part of the steps in it.

    Raises
    ------
    SceneError
        For options that cannot be, modes of another layout, a scene with a free end, a step above the stability limit.
    RunStopped
        Where the motion leaves the finite numbers, its frequencies outgrow a given step, or Newton's method fails.

    Warns
    -----
    OutOfRangeWarning
        Where the chordwise force becomes negative somewhere (the model is then ill-posed, a real cable goes slack there), or the
        ends move as fast as waves along the cable.
    NotConvergedWarning
        Where no step meets the tolerance.

    Notes
    -----
    mu w'' = (N w' / zeta')' + p.n - mu (c0'' + S/L0 c'').n for the deflection w normal to the chord c, with N = H(t) + tau(S),
    tau' = -p.e + mu (c0'' + S/L0 c'').e, and H from the closure, that the stretch zeta' along the chord adds up to |c|
    (dashes of w and zeta by S, of c by time).  An idea of Irvine and Caughey (1974) with modes from snapshots.  Left out are the
    turning of the chord as far as it acts on the deflection itself and, but for order "inertial", inertia of what moves along
    the chord relative to it.
    """
    names = stepping.check_outputs(outputs, (*OUTPUTS, "error_estimate"))
    if step is not None and tolerance is not None:
        raise refuse("step and tolerance", (step, tolerance), "one of them: a tolerance chooses the step")
    if scheme is not None:
        stepping.check_scheme(scheme, SCHEMES)
    goal = stepping.DEFAULT_TOLERANCE if tolerance is None else stepping.check_positive("tolerance", tolerance)
    p = parameters(scene)
    model = model_of(p, modes, rank=rank, order=order, law=law)
    instants = p.times() if times is None else stepping.check_times(times)
    p.check_reach(float(instants[-1]))
    check_memory(instants.size, model.chain.links, p.dims, key="times", variables=3)
    q0, v0 = model.initial()
    push, _, h = model.force(q0, v0, model.first_row)
    fastest = model.highest_square(q0, model.first_row, h)
    limit = 2.0 / math.sqrt(fastest)
    if scheme is None:
        explicit = limit >= STIFF * 2.0 / math.sqrt(max(abs(h) * model.turned[1].max(), 1e-300))
        scheme = SCHEMES[0] if explicit or (step is not None and step < limit) else SCHEMES[1]
    run = Run(model, instants, Start(q0, v0, push, h), names, progress, scheme)
    if step is None:
        first = min(_unforced_step(run, fastest), p.time_scale / stepping.STEPS_PER_CHANGE)
        chord = float(np.linalg.norm(p.upper - p.lower))
        initial = condensed_output.positions(model, q0[None], np.zeros(1))[0]

        def position(state: State) -> np.ndarray:
            return condensed_output.positions(model, state.q, state.instants.times)

        state, rate, estimate = stepping.refine(
            run,
            position,
            lambda s: stepping.motion_scale(position(s), initial, chord),
            stepping.preferred_rate(1.0 / first),
            goal,
        )
    else:
        if scheme == SCHEMES[0]:
            stepping.check_step(step, limit, f"2 over the highest angular frequency, {2 / limit:.6g} rad/s")
        rate = 1.0 / stepping.check_positive("step", step)
        state, estimate = run(rate), None
    result = condensed_output.dataset(model, state, modes, names, str(scene.attrs.get("title", "scene")))
    result.attrs.update(step_limit=limit, scheme=scheme)
    if estimate is not None:
        result.attrs["time_error_estimate"] = estimate
    if "error_estimate" in names:
        again = replace(run, outputs=(), progress=None)
        result.attrs["error_estimate"] = (estimate or 0.0) + condensed_estimate.estimate(
            model, lambda at, steps: replace(again, times=at)(steps), rate, float(instants[-1])
        )
    condensed_output.warn_out_of_range(result)
    options = {
        "rank": model.rank,
        "times": instants,
        "order": order,
        "law": law,
        "scheme": scheme,
        "step": 1.0 / rate,
        "tolerance": None if step is not None else goal,
        "outputs": list(names),
    }
    return provenance.record(result, function="condensed.simulate", parameters=options, inputs=[scene, modes])


def _unforced_step(run: Run, fastest: float) -> float:
    until = float(run.times[-1])
    if run.scheme == SCHEMES[0]:
        return RESOLVING / math.sqrt(max(fastest, run.model.taut_square(until)))
    h = max(run.model.taut_square(until), 1e-300) / run.model.turned[1].max()
    slowest = math.sqrt(max(h, 1e-9 * run.model.chain.p.stiffness) * run.model.turned[1].min())
    return min(max(until, 1e-300) / 20.0, RESOLVING / slowest)


class Start(NamedTuple):
    """What a run starts from."""

    q: np.ndarray  #: coordinates (r,)
    rates: np.ndarray  #: their rates
    push: np.ndarray  #: their accelerations but for damping
    h: float  #: H [N]


@dataclass(frozen=True)
class Run:
    """One scene on one set of modes, ready to be run with any step."""

    model: Model
    times: np.ndarray
    start: Start
    outputs: tuple[str, ...]
    progress: Callable[[float], None] | None
    scheme: str

    def __call__(self, rate: float) -> State:
        """Run with so many steps per second."""
        from cablepod.kernels import condensed as kernel  # numba is imported only to compute

        model, step = self.model, 1.0 / rate
        chain, p, r = model.chain, model.chain.p, len(model.shapes)
        instants = Instants.of(self.times, rate)
        explicit, leading = self.scheme == SCHEMES[0], model.order == "leading"
        damping = p.mass_damping or 0.0
        q, v, acc, z = self._first_state(step, explicit)
        saved, halves = np.empty((instants.steps.size, r)), np.empty((instants.steps.size, 2, r))
        wanted = chain.links if "tension_extremes" in self.outputs else 0
        low, high = np.full(wanted, np.inf), np.full(wanted, -np.inf)
        watch = np.array([np.inf, 0.0, 0.0, 4.0 * rate**2 if explicit else np.inf, np.inf, self.start.h])
        decay = math.exp(-damping * step)
        kick = -math.expm1(-damping * step) / damping if damping else step
        total = int(instants.steps[-1]) + (1 if explicit else 0)
        about = (p.stiffness, chain.total_length, model.turned[1])
        links = (model.slopes, model.plane, model.taus)
        bound = 1e6 * math.sqrt(model.mass.sum()) * chain.total_length

        def advance(begin: int, steps: int) -> bool:
            final = begin + steps == total
            first = np.searchsorted(instants.steps, begin)
            last = np.searchsorted(instants.steps, begin + steps + (1 if final and not explicit else 0))
            rows = model.rows(begin, steps - 1 if explicit else steps, rate)
            kept = (begin, instants.steps[first:last], saved[first:last], halves[first:last], low, high, watch)
            done = steps
            if leading:
                rest: tuple[Any, ...] = (
                    *about,
                    model.means,
                    model.bends,
                    model.pushes,
                    model.norms,
                    model.knots,
                    *links,
                    *kept,
                )
                if explicit:
                    kernel.leading_verlet(q, v, step, decay, kick, rows, *rest)
                else:
                    done = kernel.leading_implicit(q, v, acc, step, damping, rows, *rest)
            else:
                rest = (*about, model.pushes, model.norms, *links, chain.length, model.green, model.inertia, z, *kept)
                if explicit:
                    kernel.exact_verlet(q, v, acc, step, decay, kick, rows, *rest)
                else:
                    done = kernel.exact_implicit(q, v, acc, step, damping, rows, *rest)
            return done == steps and bool(np.isfinite(q).all()) and float(np.abs(q).max()) < bound

        failed = stepping.march(advance, (q, v, acc, z, watch), max(total, 1) if explicit else total, self.progress)
        if total == 0:  # an implicit run of no length has only its start
            advance(0, 0)
        state = State(instants, saved, halves, (low, high) if wanted else None, watch, self.scheme)
        if watch[4] < np.inf:  # before any breakdown, whose cause it is
            first = int(watch[4])
            raise RunStopped(
                f"the condensed model stiffened: from {first / rate:.6g} s on its stability limit is below the step {step:.6g} s "
                f"({self.scheme}), at least {2 / math.sqrt(watch[2]):.6g} s; try a shorter step, or scheme trapezoidal",
                self._partial(state, first, rate),
            )
        if failed is not None:
            self._stop(state, failed, rate)
        return state

    def _first_state(self, step: float, explicit: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates, rates (half a step before the start for explicit steps), accelerations, chordwise stretch."""
        model, damping = self.model, self.model.chain.p.mass_damping or 0.0
        q, rates, push, _ = self.start
        z = model.first_stretch(model.first_row)
        if not explicit:
            return q.copy(), rates.copy(), push - damping * rates, z
        grow = math.expm1(0.5 * damping * step)
        back = 0.5 * step if not damping else grow / damping
        return q.copy(), rates * (1.0 + grow) - back * push, push - damping * rates, z

    def _stop(self, state: State, done: int, rate: float) -> None:
        raise RunStopped(
            f"the condensed model left the finite numbers or found no equilibrium along the chord at {done / rate:.6g} s "
            f"({self.scheme}, step {1 / rate:.4g} s, step number {done}, least chordwise force {state.watch[0]:.3g} N); try a "
            "shorter step or, where the cable goes slack, the chain itself",
            self._partial(state, done, rate),
        )

    def _partial(self, state: State, done: int, rate: float) -> xr.Dataset | None:
        """Make a Dataset of the instants before the step number `done`."""
        count = int(np.searchsorted(state.instants.times, done / rate * (1.0 - 1e-12)))
        if not count:
            return None
        few = Instants.of(state.instants.times[:count], rate)
        saved, halves = state.saved[: few.steps.size], state.halves[: few.steps.size]
        part = State(few, saved, halves, None, state.watch, self.scheme)
        result = condensed_output.dataset(self.model, part, None, ("position",), "stopped")
        result.attrs["incomplete"] = f"stopped at {done / rate:.6g} s of {state.instants.times[-1]:.6g} s"
        return result
