"""Condensed trajectories as labelled Datasets, with attributes that say how far to trust them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from xarray.indexes import PandasIndex

from cablepod.condensed import _estimate as condensed_estimate
from cablepod.condensed._fields import CondensedTrajectory, _closed, _joined, _tension, _tensions, _velocities, sets
from cablepod.condensed._model import CondensedModel
from cablepod.conventions import COORDINATES, ENDS, label
from cablepod.integrate._output_times import OutputTimes
from cablepod.pod import _normal as pod_normal
from cablepod.reduced._training_distance import distance_outside_training
from cablepod.reduced._validity import forcing_attributes

if TYPE_CHECKING:
    from cablepod.condensed._runs import CondensedRequest, CondensedResult


@lru_cache
def _fixed(dims: int, rank: int) -> tuple[dict[Any, PandasIndex], dict[Any, xr.Variable]]:
    """Make names of axes and ends, numbers of modes, which takes longer than a run of a thousand steps."""
    names = {"coordinate": np.array(COORDINATES[:dims]), "mode": np.arange(1, rank + 1), "end": np.array(ENDS)}
    indexes = {key: PandasIndex(values, key, coord_dtype=values.dtype) for key, values in names.items()}
    return indexes, {name: item for index in indexes.values() for name, item in index.create_variables().items()}


def coordinates_of(
    model: CondensedModel, times: np.ndarray, links: np.ndarray | None, *, with_arc_length: bool = False
) -> xr.Coordinates:
    """Coordinates of a result, with the indexes that xarray would make of them."""
    fixed, made = _fixed(model.chain.p.dims, model.rank)
    own = {"time": PandasIndex(times, "time")}
    if links is not None:
        own["link"] = PandasIndex(links + 1, "link")
    variables = dict(made)  # a Dataset takes copies of what it is made of
    for index in own.values():
        variables |= index.create_variables()
    if with_arc_length:  # members have each its own
        variables["arc_length"] = xr.Variable("particle", model.chain.arc_length)
    return xr.Coordinates(variables, indexes={**fixed, **own})


def variables(
    model: CondensedModel, state: CondensedTrajectory, outputs: tuple[str, ...], links: np.ndarray | None = None
) -> dict[str, tuple[tuple[str, ...], Any]]:
    """Dimensions and values of what a run gave and of the outputs asked for; tensions of some `links` only, where given."""
    chain, p = model.chain, model.chain.p
    times, q = state.instants.times, state.q
    made: dict[str, tuple[tuple[str, ...], Any]] = {
        f"amplitude{suffix}": (("time", "mode"), padded(q[:, at] @ turn.T, model.rank))
        for suffix, at, turn in zip(pod_normal.SETS, sets(model), model.spectral_basis[0], strict=False)
    }
    made["end_position"] = (("time", "end", "coordinate"), p.end_positions(times))
    made["unstretched_length"] = ((), chain.total_length)
    if {"position", "velocity"} & set(outputs):
        z, force, squared, deflection = _closed(model, q, times)
        place = ("time", "particle", "coordinate")
        if "position" in outputs:
            made["position"] = (place, _joined(model, z, deflection, times))
        if "velocity" in outputs:
            made["velocity"] = (place, _velocities(model, z, deflection, state.rates, times))
        if "tension" in outputs:
            tension = _tension(model, z, force, squared)
            made["tension"] = (("time", "link"), tension if links is None else tension[:, links])
    elif "tension" in outputs:
        taken = state.tension
        made["tension"] = (("time", "link"), _tensions(model, q, times, links) if taken is None else taken)
    if state.extremes is not None:
        made["tension_minimum"], made["tension_maximum"] = ((("link",), item) for item in state.extremes)
    return made


def attributes(model: CondensedModel, state: CondensedTrajectory, modes: xr.Dataset | None) -> dict[str, Any]:
    """Tell how a run was made and how far it can be trusted."""
    forcing = forcing_attributes(model.chain.p, model.chain.total_length)
    return {
        **shared_attributes(model, state.instants, state.scheme, modes),
        "smallest_chordwise_force": float(state.watch[0]),
        "time_of_smallest_force": float(state.watch[1]) / state.instants.steps_per_second,
        **{name: float(value) for name, value in forcing.items()},
        **(
            {}
            if model.tests is None
            else {"growth_over_run": model.unstable_growth_rate * float(state.instants.times[-1])}
        ),
        **distance_outside_training(
            modes, model.chain.p, model.chain.total_length, float(state.instants.times[-1]), model.rest_tension
        ),
    }


def shared_attributes(
    model: CondensedModel, instants: OutputTimes, scheme: str, modes: xr.Dataset | None
) -> dict[str, Any]:
    """Tell what runs of scenes on the same modes, with the same scheme and step, have alike."""
    kept = {}
    if modes is not None and "energy_share" in modes:
        kept["energy_share_kept"] = float(modes.variables["energy_share"].values[: model.n_in_plane].sum())
    return {
        "stage": "trajectory",
        "model": "condensed",
        "order": model.order,
        "law": model.chain.law,
        "rank": model.rank,
        "scheme": scheme,
        "step": 1.0 / instants.steps_per_second,
        "number_of_steps": int(instants.steps[-1]),
        **kept,
    }


def dataset(
    model: CondensedModel,
    state: CondensedTrajectory,
    attrs: Mapping[str, Any],
    outputs: tuple[str, ...],
    title: str,
    links: np.ndarray | None = None,
) -> xr.Dataset:
    """Label what a run gave."""
    coords = coordinates_of(model, state.instants.times, links, with_arc_length=True)
    result = label(xr.Dataset(variables(model, state, outputs, links), coords=coords))
    result.attrs = {"title": title_of(model, title), **attrs}
    return result


def title_of(model: CondensedModel, title: str) -> str:
    """Title of a result from that of the scene."""
    return f"{title}: condensed model, r = {model.rank}, order {model.order}" + (
        f", {model.chain.law} law" if model.green else ""
    )


def padded(amplitude: np.ndarray, rank: int) -> np.ndarray:
    """Amplitudes (..., modes) with zeros for modes that never moved."""
    missing = rank - amplitude.shape[-1]
    return np.pad(amplitude, [(0, 0)] * (amplitude.ndim - 1) + [(0, missing)]) if missing else amplitude


def attributes_of(solution: CondensedResult, modes: xr.Dataset, request: CondensedRequest) -> dict[str, Any]:
    """Tell how a run was made and how far it can be trusted; with the estimate of its error, where asked for."""
    run, state, rate, limit, time_error = solution
    attrs = attributes(run.model, state, modes) | {"step_limit": limit}
    if time_error is not None:
        attrs["time_error_estimate"] = time_error
    if "error_estimate" in request.outputs:
        estimate = condensed_estimate.estimate(run.model, run.sample, rate, float(run.times[-1]))
        attrs["error_estimate"] = (time_error or 0.0) + estimate
    return attrs


def result_of(solution: CondensedResult, modes: xr.Dataset, request: CondensedRequest, title: str) -> xr.Dataset:
    """Make the Dataset of one run."""
    attrs = attributes_of(solution, modes, request)
    return dataset(solution.run.model, solution.state, attrs, request.outputs, title, request.links)
