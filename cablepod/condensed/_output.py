"""Condensed trajectories as labelled Datasets, with their diagnostics as attributes; why runs stop, with the result so far."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import xarray as xr

from cablepod.condensed._fields import (
    CondensedTrajectory,
    boundary_data_of,
    close_chord_of,
    close_outputs,
    link_tensions,
    positions_of,
    selected_tensions,
    tension_means,
    velocities,
)
from cablepod.condensed._kernels_layout import MAX_OMEGA_SQUARED, MIN_FORCE, MIN_FORCE_STEP
from cablepod.condensed._model import CondensedModel
from cablepod.conventions import COORDINATES, ENDS, labelled_dataset
from cablepod.integrate._means import wants_means
from cablepod.integrate._output import (
    is_over_links,
    law_suffix,
    mean_variables,
    middles_of,
    particle_coordinates,
    peak_variables,
    trajectory_attributes,
    trajectory_variables,
)
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._window import window_attributes
from cablepod.pod import _normal as pod_normal
from cablepod.reduced._training_distance import distance_outside_training
from cablepod.reduced._validity import energy_attributes, forcing_attributes

if TYPE_CHECKING:
    from cablepod.condensed._runs import CondensedRequest, CondensedResult, CondensedRun


def labels_of(model: CondensedModel, times: np.ndarray) -> dict[str, np.ndarray]:
    """Return the labels of the dimensions of a result."""
    return {
        "coordinate": np.array(COORDINATES[: model.chain.p.dims]),
        "mode": np.array(model.mode_numbers),
        "end": np.array(ENDS),
        "time": times,
    }


def places_of(
    model: CondensedModel, variables: Mapping[str, Any], links: np.ndarray | None
) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Return the coordinates of particles and, where `variables` need them, links, which are no labels.

    `links` are indices, from 0, or None for all links.
    """
    places = particle_coordinates(model.chain)
    if is_over_links(variables):
        middles = middles_of(model.chain.arc_length)
        places["link_arc_length"] = (("link",), middles[slice(None) if links is None else links])
        if links is not None:
            places["link_number"] = (("link",), links + 1)
    return places


def variables(
    model: CondensedModel, state: CondensedTrajectory, outputs: tuple[str, ...], links: np.ndarray | None = None
) -> dict[str, tuple[tuple[str, ...], Any]]:
    """Return dimensions and values of the variables of a result; tensions of `links` only, where given."""
    chain, p = model.chain, model.chain.p
    times, q = state.instants.times, state.q
    result: dict[str, tuple[tuple[str, ...], Any]] = {
        f"amplitude{suffix}": (("time", "mode"), padded(q[:, which] @ turn.T, model.rank))
        for suffix, which, turn in zip(pod_normal.SETS, model.sets, model.spectral_basis[0], strict=False)
    }
    ends = p.end_positions(times)
    result["end_position"] = (("time", "end", "coordinate"), ends)
    if p.dims == 3:
        result["normal_reference"] = (("coordinate",), model.reference)
    result["unstretched_length"] = ((), chain.total_length)
    if state.closed is not None or {"position", "velocity"} & set(outputs):
        closed = (
            close_chord_of(model, q, boundary_data_of(model, state, ends)) if state.closed is None else state.closed
        )
        stretch, force, squared, deflection = closed
        values: dict[str, Callable[[], np.ndarray]] = {
            "position": lambda: positions_of(model, stretch, deflection, ends),
            "velocity": lambda: velocities(model, stretch, deflection, state.rates, times),
            "tension": lambda: link_tensions(model, stretch, force, squared)[
                :, slice(None) if links is None else links
            ],
        }
    else:
        values = {"tension": lambda: selected_tensions(model, q, times, links)}
    peaks = {}
    if state.peak_times is not None:
        middles = middles_of(chain.arc_length)
        peaks = peak_variables(state.extremes, state.peak_times, middles if links is None else middles[links])
    means = None
    if wants_means(outputs):
        means = tension_means(model, state, links) if state.means is None else state.means
    return result | trajectory_variables(outputs, state.extremes, values) | peaks | mean_variables(outputs, means)


def attributes(model: CondensedModel, state: CondensedTrajectory, modes: xr.Dataset | None) -> dict[str, Any]:
    """Return the attributes of a run: scheme, step and diagnostics, without the error estimate."""
    end_time = float(state.instants.times[-1])
    forcing = forcing_attributes(model.chain.p, model.chain.total_length)
    return {
        **shared_attributes(model, state.instants, state.scheme, modes),
        "smallest_chordwise_force": float(state.monitor[MIN_FORCE]),
        "time_of_smallest_force": float(state.monitor[MIN_FORCE_STEP]) / state.instants.steps_per_second,
        **{name: float(value) for name, value in forcing.items()},
        **model.chain.p.offsets(),
        **distance_outside_training(modes, model.chain.p, model.chain.total_length, end_time, model.rest_tension),
    }


def shared_attributes(
    model: CondensedModel, instants: OutputTimes, scheme: str, modes: xr.Dataset | None
) -> dict[str, Any]:
    """Return the attributes that runs with the same modes, scheme and step share."""
    energy = energy_attributes(modes, *map(len, model.modes))
    options = {"order": model.order, "law": model.chain.law, "rank": model.rank, "layout": "normal"}
    return trajectory_attributes("condensed", scheme, instants, **options) | energy


def dataset(
    model: CondensedModel,
    state: CondensedTrajectory,
    attrs: Mapping[str, Any],
    outputs: tuple[str, ...],
    title: str,
    links: np.ndarray | None = None,
) -> xr.Dataset:
    """Make the labelled Dataset of a run with given attributes."""
    arrays = variables(model, state, outputs, links)
    result = labelled_dataset(arrays, labels_of(model, state.instants.times), places_of(model, arrays, links))
    result.attrs = {"title": title_of(model, title), **attrs}
    return result


def title_of(model: CondensedModel, title: str) -> str:
    """Return the title of a result for that of its scene."""
    return f"{title}: condensed model, r = {model.rank}, order {model.order}{law_suffix(model.chain)}"


def padded(amplitude: np.ndarray, rank: int) -> np.ndarray:
    """Pad amplitudes (..., modes) to `rank` modes with zeros, for the smaller set of deflections."""
    missing = rank - amplitude.shape[-1]
    return np.pad(amplitude, [(0, 0)] * (amplitude.ndim - 1) + [(0, missing)]) if missing else amplitude


def attributes_of(solution: CondensedResult, modes: xr.Dataset, request: CondensedRequest) -> dict[str, Any]:
    """Return all attributes of a run, with the error estimate where it was requested."""
    run, state, time_error = solution.run, solution.state, solution.time_error
    attrs = attributes(run.model, state, modes) | {"step_limit": solution.limit} | window_attributes(run.window)
    if time_error is not None:
        attrs["time_error_estimate"] = time_error
    if "error_estimate" in request.outputs:
        attrs["error_estimate"] = (time_error or 0.0) + solution.model_error
    return attrs


def stop_unstable(run: CondensedRun, state: CondensedTrajectory, step_number: int) -> NoReturn:
    """Stop a run whose frequencies have outgrown the step."""
    limit = 2 / math.sqrt(state.monitor[MAX_OMEGA_SQUARED])
    rate = state.instants.steps_per_second
    time = step_number / rate
    needs_explicit = run.air is not None or run.model.chain.p.tension_damping is not None
    why = (
        f"the condensed model stiffened: from {time:.6g} s on its stability limit is below the step {1.0 / rate:.6g} s "
        f"({run.scheme}), at least {limit:.6g} s; try a shorter step{'' if needs_explicit else ', or scheme trapezoidal'}"
    )
    _stop(run, state, time, why)


def stop_diverged(run: CondensedRun, state: CondensedTrajectory, step_number: int) -> NoReturn:
    """Stop a run that has left the finite numbers, or whose steps found no equilibrium along the chord."""
    rate = state.instants.steps_per_second
    time = step_number / rate
    why = (
        f"the condensed model left the finite numbers or found no equilibrium along the chord at {time:.6g} s "
        f"({run.scheme}, step {1.0 / rate:.4g} s, step number {step_number}, least chordwise force "
        f"{state.monitor[MIN_FORCE]:.3g} N); try a shorter step or, where the cable goes slack, chain.simulate"
    )
    _stop(run, state, time, why)


def stop_open(run: CondensedRun, state: CondensedTrajectory, time: float) -> NoReturn:
    """Stop a run at the first instant [s] whose chord does not close."""
    why = (
        f"the condensed model found no equilibrium along the chord at {time:.6g} s: the ends are nearer to each other than links "
        f"of these slopes can be pushed together ({run.scheme}, step {1.0 / state.instants.steps_per_second:.4g} s, least "
        f"chordwise force {state.monitor[MIN_FORCE]:.3g} N); try chain.simulate"
    )
    _stop(run, state, time, why)


def _stop(run: CondensedRun, state: CondensedTrajectory, time: float, why: str) -> NoReturn:
    """Raise :class:`cablepod.errors.RunStopped` with the result at the instants before `time` [s]."""
    instants, partial = state.only(run.times).instants.before_time(time), None
    if instants is not None:
        rows = np.searchsorted(state.instants.steps, instants.steps)
        saved, half_step_rates = state.saved[rows], state.half_step_rates[rows]
        part = CondensedTrajectory(instants, saved, half_step_rates, None, state.monitor, run.scheme)
        if not run.leading and (earlier := close_outputs(run.model, part)) is not None:
            stop_open(run, state, earlier)
        partial = dataset(run.model, part, attributes(run.model, part, None), ("position",), "stopped")
    run.stop(partial, time, why)
