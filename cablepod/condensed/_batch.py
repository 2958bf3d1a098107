"""Condensed models of many scenes on one set of modes: coefficients of one serve all, runs go side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod.batch._members import Arrays, gather, join
from cablepod.condensed import _estimate as condensed_estimate
from cablepod.condensed import _many as condensed_many
from cablepod.condensed import _output as condensed_output
from cablepod.condensed._model import Model
from cablepod.condensed._runs import Options, Solution, solve
from cablepod.discretisation._chain import Chain
from cablepod.parameters._parameters import Members, Parameters, solve_statics


def attributes_of(solution: Solution, modes: xr.Dataset, options: Options) -> dict[str, Any]:
    """Tell how a run was made and how far it can be trusted; with the estimate of its error, where asked for."""
    run, state, rate, limit, time_error = solution
    attrs = condensed_output.attributes(run.model, state, modes) | {"step_limit": limit}
    if time_error is not None:
        attrs["time_error_estimate"] = time_error
    if "error_estimate" in options.outputs:
        again = replace(run, outputs=(), progress=None)
        attrs["error_estimate"] = (time_error or 0.0) + condensed_estimate.estimate(
            run.model, lambda at, steps: replace(again, times=at)(steps), rate, float(run.times[-1])
        )
    return attrs


def result_of(solution: Solution, modes: xr.Dataset, options: Options, title: str) -> xr.Dataset:
    """Make the Dataset of one run."""
    attrs = attributes_of(solution, modes, options)
    return condensed_output.dataset(solution.run.model, solution.state, attrs, options.outputs, title, options.links)


def run(
    scene: xr.Dataset,
    modes: xr.Dataset,
    model: Model,
    members: Members,
    options: Options,
    make: Callable[[Parameters], Model],
    progress: Callable[[float], None] | None,
) -> xr.Dataset:
    """Run all members of a scene.

    Parameters
    ----------
    scene, modes
        As given.
    model
        Of the first member.
    members
        Their parameters.
    options
        What each run is asked for.
    make
        Makes the model of a member that differs from the first in more than numbers.
    progress
        Called with the part that is done.
    """
    many = condensed_many.plan(modes, model, members, options)

    def one(i: int) -> tuple[Arrays, Mapping[str, Any]]:
        p = members[i]
        own = sibling(model, p) if alike(p, model.chain.p) else make(p)
        solution = solve(own, options)
        made = condensed_output.variables(own, solution.state, options.outputs, options.links)
        made["arc_length"] = (("particle",), own.chain.arc_length)
        return made, attributes_of(solution, modes, options)

    stack = gather(one, len(members), progress, many)
    title = condensed_output.title_of(model, str(scene.attrs.get("title", "scene")))
    times = members[0].times() if options.times is None else options.times
    coords = condensed_output.coordinates_of(model, times, options.links)
    result = join(stack, scene, coords).set_coords("arc_length")
    result.attrs = {"title": title, **result.attrs}
    condensed_output.warn_of_members(stack.attrs)
    return result


def sibling(model: Model, p: Parameters) -> Model:
    """Make the model of a scene that differs from another in numbers only, by scaling the coefficients of the other."""
    statics = solve_statics(p, p.length_key, p.length_value)
    total = float(statics[0])
    stretch = total / model.chain.total_length
    chain = Chain(p, model.chain.length * stretch, model.chain.arc_length * stretch, model.chain.law)
    made = Model(chain, model.order, model.modes, model.quadrature, model.tests)
    scaled = condensed_many.scaled(model, np.array([p.mass]), np.array([total]))
    turns = [item[0] for item in scaled.turns]
    made.__dict__.update({name: item[0] for name, item in scaled.named.items()}, turned=(turns, scaled.squares[0]))
    made.__dict__["rest_tension"] = 0.5 * float(statics[4] + statics[5])
    return made


def alike(p: Parameters, other: Parameters) -> bool:
    """Tell whether two scenes differ in numbers only, as :func:`sibling` needs it."""
    return (
        p.dims == other.dims
        and p.free == other.free
        and p.link_viscosity == other.link_viscosity
        and list(p.motions) == list(other.motions)
        and [load.fraction for load in p.point_loads] == [load.fraction for load in other.point_loads]
    )
