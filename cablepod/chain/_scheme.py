"""Request, preparation and run of a chain, with scheme and step given or chosen by a tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, Self

import numpy as np

from cablepod._resources import ARRAYS_OF_RUN, check_memory
from cablepod.chain import _implicit as implicit
from cablepod.chain._air import ChainAir
from cablepod.chain._attached import attached_forces
from cablepod.chain._explicit import ExplicitChainRun
from cablepod.chain._implicit import ImplicitChainRun
from cablepod.chain._start import start
from cablepod.conventions import OUTPUTS
from cablepod.discretisation._chain import chain_of
from cablepod.discretisation._laws import LAWS, check_law, check_viscous_law
from cablepod.discretisation._modal_damping import check_count, implicit_scheme
from cablepod.errors import RunStopped, SceneError, scene_error
from cablepod.integrate._chain_run import ChainRun
from cablepod.integrate._request import Request, check_scheme
from cablepod.integrate._scheme import SchemeChoice, Solution
from cablepod.integrate._space_error import (
    FEWER_IMPLICIT_STEPS,
    FEWER_STEPS,
    MANY_TIMES,
    MOTION_OVER_SAMPLING,
    companion_cells,
    companion_steps,
    distance_of,
    extrapolated,
)
from cablepod.integrate._step_control import GivenStep, Refinement, Search, complete
from cablepod.parameters._checks import number
from cablepod.parameters._parameters import Parameters
from cablepod.wind._air import air_of

SCHEMES = ("velocity_verlet", *implicit.SCHEMES)
#: Cost of an implicit step, with its Newton iterations, in explicit steps.
IMPLICIT_COST = 25.0
#: Run time of an explicit step for each link [s].
LINK_STEP = 2e-9


@dataclass(frozen=True, kw_only=True)
class ChainRequest(Request):
    """Options of a run of the chain, checked as far as possible without a scene."""

    links: int | None = None
    law: str = LAWS[0]
    radius: float = ImplicitChainRun.spectral_radius  #: spectral radius of generalized alpha
    wind: Any = None  #: field of the wind, in place of that of the scene

    @classmethod
    def of(
        cls, *, scheme: str | None = None, law: str = LAWS[0], spectral_radius: float | None = None, **options: Any
    ) -> Self:
        """Check the options of :func:`cablepod.chain.simulate`."""
        check_law(law)
        check_scheme(scheme, SCHEMES)
        radius = _check_radius(spectral_radius, scheme)
        return super().of(scheme=scheme, law=law, radius=radius, allowed=(*OUTPUTS, "error_estimate"), **options)


class PreparedScene(NamedTuple):
    """A scene prepared for runs."""

    explicit: ExplicitChainRun
    run: ChainRun  #: by the requested scheme, explicit if there is none
    steps_per_second: float | None  #: by the given step, None without


def prepare(
    p: Parameters,
    request: ChainRequest,
    title: str,
    progress: Callable[[float], None] | None = None,
    *,
    averaged: bool = False,
) -> PreparedScene:
    """Check a scene against the request and compute the initial shape; `averaged` is the air of a companion.

    Raises
    ------
    SceneError
        For options that do not fit this scene, a scene without equilibrium, an output that would not fit in memory.
    """
    check_viscous_law(request.law, p.link_viscosity)
    if p.own_keys and "error_estimate" in request.outputs:
        allowed = f"none beside {p.own_keys[0]}, as fewer links would be another chain"
        raise scene_error("outputs", "error_estimate", allowed)
    chain = chain_of(p, request.links, request.law)
    instants = request.instants(p)
    key = "links" if request.links is not None else "chain.links and times"
    check_memory(instants.size, chain.links, p.dims, key=key, variables=ARRAYS_OF_RUN)
    check_count(p, key.partition(" and ")[0], chain.links)
    cable_air = air_of(p, float(instants[-1]), request.wind)
    if averaged and cable_air is not None:
        cable_air = cable_air.averaged(chain.arc_length / chain.total_length)
    air = None if cable_air is None else ChainAir(chain, cable_air)
    initial = start(chain, air)
    attached = attached_forces(chain, initial, air)
    options = request.of_run(instants, progress=progress, air=air, attached=attached)
    explicit = ExplicitChainRun(chain, initial, title, **options)
    run: ChainRun = explicit
    scheme = implicit_scheme(p, request.scheme, implicit.SCHEMES)
    if scheme not in (None, explicit.scheme):
        run = ImplicitChainRun(chain, initial, title, scheme, request.radius, **options)
    explicit_limit = explicit.step_limit if run is explicit else None
    others = "; implicit schemes have none"
    steps_per_second = request.steps_per_second(p, float(instants[-1]), explicit_limit, explicit.limit_text + others)
    return PreparedScene(explicit, run, steps_per_second)


def solve(ready: PreparedScene, request: ChainRequest) -> Solution:
    """Run a scene as :func:`search_of` says.

    Raises
    ------
    RunStopped
        If the motion is no longer finite, or the links hold excessive strain energy.

    Warns
    -----
    NotConvergedWarning
        If no step meets the tolerance, and if the links hold excessive strain energy with a given step.
    """
    search = search_of(ready, request)
    complete(search)
    return with_space_error(solution_of(search), request)


def with_space_error(solved: Solution, request: ChainRequest) -> Solution:
    """Add the estimate of the error in space, where it is an output, by a companion run with fewer links; nan without one.

    Particles that miss points of gusts err by more than second order.  The companion has the air averaged over its links, so that
    its distance contains that error of the run, which extrapolation would divide by the factor of second order.
    """
    if "error_estimate" not in request.outputs:
        return solved
    run, rate, links = solved.run, solved.steps_per_second, solved.run.chain.links
    is_given = solved.time_error is None
    part = 1.0 / (rate * run.step_limit) if run.scheme == SCHEMES[0] else None
    fewer = companion_cells(links, part, is_given=is_given)
    if fewer < 2:  # no inner particle
        return solved._replace(space_error=math.nan)
    p = _with_links(run.chain.p, fewer)
    every = 2 if is_given and part is None and run.times.size >= MANY_TIMES else 1
    try:
        plain = replace(
            request, links=None, scheme=run.scheme, step=None, window=None, outputs=(), times=run.times[::every]
        )
        explicit, coarse = prepare(p, plain, "", averaged=True)[:2]
        # steps at least as much longer as the links, so that errors of both fall alike
        least = min(fewer / links, FEWER_IMPLICIT_STEPS if part is None else FEWER_STEPS) if is_given else fewer / links
        state = coarse.as_companion()(rate * companion_steps(least, part, run.step_limit / explicit.step_limit))
    except (RunStopped, SceneError):  # too few links for this scene
        return solved._replace(space_error=math.nan)
    distance = distance_of(coarse, state, run, solved.trajectory, every)
    error = extrapolated(distance, links / fewer)
    if run.air is not None:  # particles between points of the wind, which the companion's load does not lack
        error = min(distance, error + MOTION_OVER_SAMPLING * run.air.sampling_error)
    return solved._replace(space_error=error)


def _with_links(p: Parameters, links: int) -> Parameters:
    """Return parameters with fewer links; unequal ones are cut anew, in the same gradation along the cable."""
    relative = p.link_lengths
    if relative is not None:
        known = np.concatenate([[0.0], np.cumsum(relative)])
        relative = np.diff(np.interp(np.linspace(0.0, relative.size, links + 1), np.arange(relative.size + 1), known))
    return replace(p, links=links, link_lengths=relative)


def search_of(ready: PreparedScene, request: ChainRequest) -> Search:
    """Return the search of the solution of a scene: with the given scheme and step, or with those chosen by tolerance."""
    explicit, run, steps_per_second = ready
    if steps_per_second is not None:
        return GivenStep(run, steps_per_second)
    if request.scheme is not None or run is not explicit:
        return Refinement(run.comparable_runs(), request.tolerance)
    trapezoidal = ImplicitChainRun(**{item.name: getattr(explicit, item.name) for item in fields(explicit)})
    return SchemeChoice.of_runs(
        explicit,
        trapezoidal,
        request.tolerance,
        # the explicit runs of a search take at least three times their first steps, all implicit ones twice their maximum
        implicit_cost=0.5 * IMPLICIT_COST,
        step_time=None if request.given_tolerance is not None else LINK_STEP,
    )


def solution_of(search: Search) -> Solution:
    """Return the solution at the end of a search; warn if the links hold excessive strain energy with a given step."""
    solved = Solution.of(search)
    solved.warn_of_energy_excess("the links hold", "half the step or with scheme energy_momentum")
    return solved


def _check_radius(radius: float | None, scheme: str | None) -> float:
    """Return the spectral radius of generalized alpha; refuse it with other schemes."""
    if radius is None:
        return ImplicitChainRun.spectral_radius
    if scheme != "generalized_alpha":
        raise scene_error("spectral_radius", radius, 'none, but for scheme "generalized_alpha"')
    return number(least=0.0, most=1.0)("spectral_radius", radius)
