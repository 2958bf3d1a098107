"""Runs of the chain as they are asked for: request checked, scheme and step given or chosen by a tolerance."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import xarray as xr

from cablepod._resources import check_memory
from cablepod.chain import _implicit as implicit
from cablepod.chain._explicit import ExplicitChainRun
from cablepod.chain._implicit import ImplicitChainRun
from cablepod.chain._start import start
from cablepod.discretisation._chain import chain_of
from cablepod.discretisation._laws import LAWS, check_law
from cablepod.errors import NotConvergedWarning, scene_error
from cablepod.integrate._energy_check import ENERGY_WARN
from cablepod.integrate._request import Request, check_scheme, check_step, implicit_steps_per_second
from cablepod.integrate._run import ChainRun, Trajectory
from cablepod.integrate._step_control import (
    STEPS_PER_CHANGE,
    ComparableRuns,
    halve_step_while_cheaper,
    motion_scale,
    preferred_steps_per_second,
    refine_step,
)
from cablepod.parameters._checks import number
from cablepod.parameters._parameters import Parameters

SCHEMES = ("velocity_verlet", *implicit.SCHEMES)


@dataclass(frozen=True, kw_only=True)
class ChainRequest(Request):
    """What is asked of a run of the chain, checked as far as no scene is needed for that."""

    links: int | None = None
    law: str = LAWS[0]
    radius: float = ImplicitChainRun.spectral_radius  #: spectral radius of generalized alpha

    @classmethod
    def of(
        cls, *, scheme: str | None = None, law: str = LAWS[0], spectral_radius: float | None = None, **given: Any
    ) -> Self:
        """Check what a caller gives; options as those of :func:`cablepod.chain.simulate`."""
        check_law(law)
        check_scheme(scheme, SCHEMES)
        radius = _check_radius(spectral_radius, scheme)
        return super().of(scheme=scheme, law=law, radius=radius, **given)


class PreparedScene(NamedTuple):
    """A scene ready to be run."""

    explicit: ExplicitChainRun
    run: ChainRun  #: by the scheme asked for, explicit where none is
    limit: float  #: largest stable explicit step at the start [s]
    steps_per_second: float | None  #: steps per second, where the step is given


class ChainResult(NamedTuple):
    """A run and how it was chosen."""

    run: ChainRun
    state: Trajectory
    steps_per_second: float  #: steps per second
    estimate: float | None  #: of the time error, where a tolerance chose the step
    reason: str  #: for the scheme

    @property
    def diagnostics(self) -> dict[str, Any]:
        """Attributes of the result that follow those of the run."""
        found = {} if self.estimate is None else {"time_error_estimate": self.estimate}
        return found | {"choice_of_scheme": self.reason}

    def dataset(self) -> xr.Dataset:
        """Label what the run gave."""
        return self.run.dataset(self.state).assign_attrs(self.diagnostics)


def prepare(
    p: Parameters, request: ChainRequest, title: str, progress: Callable[[float], None] | None = None
) -> PreparedScene:
    """Check a scene against what is asked for, and find where it starts from.

    Raises
    ------
    SceneError
        For options that cannot be with this scene, a scene without rest, an output that would not fit in memory.
    """
    if request.law == "green" and p.link_viscosity is not None:
        raise scene_error(
            "law and damping.link_viscosity",
            (request.law, p.link_viscosity),
            'viscous links with law "linear"; with "green" none, mass_proportional is possible',
        )
    chain = chain_of(p, request.links, request.law)
    instants = request.instants(p)
    key = "links" if request.links is not None else "chain.links and times"
    check_memory(instants.size, chain.links, p.dims, key=key, variables=3)
    initial = start(chain)
    limit = chain.step_limit(chain.tangent_stiffness_ratio(initial))
    about = (chain, instants, initial, request.outputs, progress, title)
    explicit = ExplicitChainRun(*about)
    run: ChainRun = explicit
    if request.scheme not in (None, explicit.scheme):
        run = ImplicitChainRun(*about, method=request.scheme, spectral_radius=request.radius)
    rate = None
    if request.step is not None:
        if run is explicit:
            why = f"2 over the highest angular frequency, {2 / limit:.6g} rad/s; implicit schemes have none"
            rate = 1.0 / check_step(request.step, limit, why)
        else:
            rate = implicit_steps_per_second(request.step, float(instants[-1]), p.shortest_time_scale)
    return PreparedScene(explicit, run, limit, rate)


def solve(ready: PreparedScene, request: ChainRequest, state: Trajectory | None = None) -> ChainResult:
    """Run a scene with the scheme and step given, or chosen by tolerance.

    Parameters
    ----------
    ready
        The scene.
    request
        What is asked for.
    state
        What a run with the given step gave, where it was made already.

    Raises
    ------
    RunStopped
        Where the motion leaves the finite numbers, or its links hold far more energy than can be explained.

    Warns
    -----
    NotConvergedWarning
        Where no step meets the tolerance, and where a given step leaves more energy than can be explained.
    """
    explicit, run, limit, rate = ready
    if rate is not None:
        state = run(rate) if state is None else state
        if state.diagnostics["energy_excess"] > ENERGY_WARN:
            warnings.warn(
                f"the links hold up to {state.diagnostics['energy_excess']:.2g} times the energy that rest, loads and ends "
                "explain: a resonance, or a step too long for links that slacken and snap taut; compare with half the step or "
                "with scheme energy_momentum",
                NotConvergedWarning,
                stacklevel=4,
            )
        return ChainResult(run, state, rate, None, "given")
    if request.scheme is not None:
        return ChainResult(run, *_refine_in_time(run, limit, request.tolerance), "given")
    trapezoidal = ImplicitChainRun(
        explicit.chain, explicit.times, explicit.initial, explicit.outputs, explicit.progress, explicit.title
    )
    run, found, reason = _choose_scheme(
        explicit, trapezoidal, limit, request.tolerance, asked=request.given_tolerance is not None
    )
    return ChainResult(run, *found, reason)


def _check_radius(radius: float | None, scheme: str | None) -> float:
    if radius is None:
        return ImplicitChainRun.spectral_radius
    if scheme != "generalized_alpha":
        raise scene_error("spectral_radius", radius, 'none, but for scheme "generalized_alpha"')
    return number(least=0.0, most=1.0)("spectral_radius", radius)


#: An implicit step costs about as much as so many explicit ones, with the iterations of Newton's method.
IMPLICIT_COST = 25.0
#: Below so many seconds of explicit run time, at about 2 ns per link and step, no other scheme is tried unasked.
CHOICE_MIN_SECONDS, LINK_STEP = 0.3, 2e-9
#: Steps of the first implicit run in the period of the first transverse vibration.
STEPS_PER_PERIOD = 8.0


def _choose_scheme(
    explicit: ExplicitChainRun, trapezoidal: ImplicitChainRun, limit: float, tolerance: float, *, asked: bool
) -> tuple[ChainRun, tuple[Trajectory, float, float], str]:
    """Pick scheme and step for a tolerance: implicit as long as its steps are so long that it is the faster one."""
    rate = 1.0 / _first_step(explicit, limit)
    cost = 3.0 * float(explicit.times[-1]) * rate * explicit.chain.links * LINK_STEP
    if not asked and cost < CHOICE_MIN_SECONDS:
        return explicit, _refine_in_time(explicit, limit, tolerance), f"explicit: all its runs take about {cost:.1g} s"
    most = 2.0 * rate / IMPLICIT_COST
    accepted = halve_step_while_cheaper(_comparable_runs(trapezoidal, limit), tolerance, most)
    if accepted is not None:
        ratio = 1.0 / (accepted[1] * limit)
        return trapezoidal, accepted, f"implicit: its steps may be {ratio:.3g} times the explicit limit"
    return (
        explicit,
        _refine_in_time(explicit, limit, tolerance),
        f"explicit: implicit steps would have to be shorter than {1 / most:.3g} s",
    )


def _refine_in_time(run: ChainRun, limit: float, tolerance: float) -> tuple[Trajectory, float, float]:
    """Shorten the step until two runs agree; returns the trajectory, its steps per second, the estimate of its error."""
    return refine_step(_comparable_runs(run, limit), tolerance)


def _comparable_runs(run: ChainRun, limit: float) -> ComparableRuns:
    """Describe runs with any step for the step control."""
    chord = float(np.linalg.norm(run.chain.p.upper - run.chain.p.lower))

    def position(state: Trajectory) -> np.ndarray:
        return state.position

    def scale(state: Trajectory) -> float:
        return motion_scale(state.position, run.initial, chord)

    def slackened(state: Trajectory) -> bool:
        # law (21) has no kink
        return not run.chain.green and bool((run.chain.stretch(state.position) < 1.0).any())

    first = preferred_steps_per_second(1.0 / _first_step(run, limit))
    return ComparableRuns(run, position, scale, first, float(run.times[-1]), run.chain.links, slackened)


def _first_step(run: ChainRun, limit: float) -> float:
    """Choose the step to begin with [s]."""
    return min(_unforced_step(run, limit), run.chain.p.shortest_time_scale / STEPS_PER_CHANGE)


def _unforced_step(run: ChainRun, limit: float) -> float:
    chain, initial, until = run.chain, run.initial, float(run.times[-1])
    if isinstance(run, ImplicitChainRun):
        period = (
            2.0 * chain.total_length / np.sqrt(max(chain.tensions_and_forces(initial)[0].mean(), 1e-300) / chain.p.mass)
        )
        return float(max(min(until / 20.0, period / STEPS_PER_PERIOD), limit))
    if not chain.green:
        return 0.9 * limit
    # for the stretch to come, as far as the ends enforce it, and waves on top
    return 0.8 * chain.step_limit(
        np.maximum(chain.tangent_stiffness_ratio(initial), chain.largest_enforced_ratio(until))
    )
