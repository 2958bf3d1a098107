"""Prepared models as labelled Datasets, and back."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import floats
from cablepod.condensed._host import vector
from cablepod.condensed._kernels_layout import HostCoefficients
from cablepod.condensed._model import CondensedModel
from cablepod.conventions import COORDINATES, VARIABLES, label
from cablepod.errors import scene_error
from cablepod.parameters._key_paths import key_of_variable

if TYPE_CHECKING:
    from cablepod.condensed._prepared_model import PreparedModel

#: Stage of the Dataset of a prepared model, and prefixes of the variables that it takes from scene and modes.
STAGE, PREFIXES = "prepared model", ("scene_", "modes_")
#: Name of the function that makes it, in histories.
FUNCTION = "condensed.PreparedModel.dataset"
#: Variables that follow from the state, and what messages allow.
DERIVED = ("time", "end_position", "end_force", "amplitude")
UNCHANGED = "a prepared model, unchanged, as PreparedModel.dataset() gives it"
#: What stands for the id of a field without one.
NO_ID = "none"
#: Relative difference of coefficients from machine to machine (rounding of their eigenproblem).
ROUNDING = 1e-7


class StoredModel(NamedTuple):
    """Contents of the Dataset of a prepared model."""

    scene: xr.Dataset
    modes: xr.Dataset
    rank: int
    order: str
    step: float  #: [s]
    coefficients: HostCoefficients
    state: np.ndarray
    wind: str  #: id of the field that was given; empty without
    step_is_chosen: bool  #: by `prepare`


def dataset_of(
    prepared: PreparedModel, scene: xr.Dataset, modes: xr.Dataset, model: CondensedModel, **further: str
) -> xr.Dataset:
    """Make the Dataset of a prepared model in its accepted state with `further` attributes; see :meth:`PreparedModel.dataset`."""
    rank = model.rank
    coordinates = list(COORDINATES[: model.chain.p.dims])
    variables: dict[str, Any] = {
        "amplitude": (("normal", "mode"), _amplitudes(prepared)),
        "end_position": (("coordinate",), prepared.end_position),
        "end_force": (("coordinate",), prepared.force),
        "state": (("state_row", "state_column"), prepared.state),
    }
    for name, array in prepared.coefficients._replace(air=None)._asdict().items():
        if array is None:  # the air follows from scene and field
            continue
        dims = tuple(f"{name}_{axis}" for axis in range(array.ndim))
        variables[f"coefficient_{name}"] = (dims, array)
    result = xr.Dataset(variables, coords={"coordinate": coordinates, "mode": np.array(model.mode_numbers)})
    result = result.assign_coords(time=prepared.time)
    for prefix, source in zip(PREFIXES, (scene, modes), strict=True):
        for key, variable in source.variables.items():
            names = [dim if dim == "coordinate" else f"{prefix}{dim}" for dim in variable.dims]
            if key != "coordinate":
                result[f"{prefix}{key}"] = (names, variable.values, variable.attrs)
    extra = {
        str(name): ("1", "numbers of the compiled steps")
        for name in result.variables
        if str(name).startswith(("state", "coefficient"))
    }
    extra |= {
        "end_position": ("m", "position of the upper end"),
        "end_force": ("N", "force of the cable on the host"),
    }
    for key, variable in result.variables.items():
        if str(key).startswith(PREFIXES) and "units" not in variable.attrs:
            name = str(key).removeprefix(PREFIXES[0]).removeprefix(PREFIXES[1])
            of_scene = key_of_variable(name) if str(key).startswith(PREFIXES[0]) else None
            units = VARIABLES.get(name, ("1",))[0] if of_scene is None else of_scene.units or "1"
            extra[str(key)] = (units, str(key))
    attrs = {
        "title": f"{scene.attrs.get('title', 'scene')}: prepared condensed model, r = {rank}, order {model.order}",
        "stage": STAGE,
        "model": "condensed",
        "order": model.order,
        "rank": rank,
        "step": prepared.prepared_step,
        **({} if prepared.wind is None else {"wind_id": prepared.wind.attrs.get("id", NO_ID)}),
        "scene_attributes_json": json.dumps(provenance.to_json(dict(scene.attrs)), sort_keys=True),
        "modes_attributes_json": json.dumps(provenance.to_json(dict(modes.attrs)), sort_keys=True),
    }
    result = label(result, **extra)
    result.attrs = attrs | further
    state = {"time": prepared.time, "state_sha256": _state_digest(prepared.state)}
    parameters = {"rank": rank, "order": model.order, "step": prepared.prepared_step}
    return provenance.record(
        result,
        function=FUNCTION,
        parameters=parameters | state,
        identity=parameters if prepared.is_at_rest else parameters | state,
        chosen=["step"] if prepared.step_is_chosen else [],
        inputs=[scene, modes] if prepared.wind is None else [scene, modes, prepared.wind],
    )


def stored_model(dataset: xr.Dataset) -> StoredModel:
    """Return the contents of the Dataset of a prepared model.

    Raises
    ------
    SceneError
        For another Dataset.
    """
    fields = [f"coefficient_{name}" for name in HostCoefficients._fields if name != "air"]
    for key in (*DERIVED, "state", *fields):
        if key not in dataset.variables:
            raise scene_error("dataset", f"no variable {key}", UNCHANGED)
    try:
        scene, modes = (_source(dataset, prefix) for prefix in PREFIXES)
        rank, order, step = int(dataset.attrs["rank"]), str(dataset.attrs["order"]), float(dataset.attrs["step"])
    except (KeyError, ValueError) as error:
        raise scene_error("dataset", f"attributes with {error!r}", UNCHANGED) from None
    arrays: Any = (_array(dataset, key) for key in fields)
    wind = str(dataset.attrs.get("wind_id", ""))
    state = _array(dataset, "state")
    stages = provenance.stages_of(dataset)[-1:]
    is_chosen = any(stage["function"] == FUNCTION and "step" in stage.get("chosen", ()) for stage in stages)
    return StoredModel(scene, modes, rank, order, step, HostCoefficients(*arrays), state, wind, is_chosen)


def _array(dataset: xr.Dataset, key: str) -> np.ndarray:
    """Return a variable with its dimensions in the order in which :func:`dataset_of` makes them."""
    variable = dataset.variables[key]
    known = {"state_row": 0, "state_column": 1, "normal": 0, "coordinate": 1, "mode": 1}
    order = sorted(variable.dims, key=lambda dim: known.get(str(dim), str(dim).rpartition("_")[2]))
    values = variable.transpose(*order).values
    return (
        floats(values) if values.dtype.kind == "f" else np.require(values, requirements=("C", "ALIGNED", "WRITEABLE"))
    )


def checked_state(state: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return a copy of a state as an array of a given shape; refuse others, and nan."""
    try:
        given = vector(state)
    except (OverflowError, TypeError, ValueError):
        given = np.empty(0)
    if given.shape != shape or np.isnan(given).any():
        text = "nan in it" if given.shape == shape else given.shape
        raise scene_error("state", text, f"an array of shape {shape}, as `state` gives it")
    return given


def check_coefficients(stored: HostCoefficients, made: HostCoefficients) -> None:
    """Refuse stored coefficients that differ by more than rounding from those that scene and modes give."""
    for name, old, new in zip(stored._fields[:-1], stored[:-1], made[:-1], strict=True):
        if old.shape != new.shape or old.dtype != new.dtype:
            raise scene_error(f"coefficient_{name}", f"shape {old.shape}, {old.dtype}", UNCHANGED)
        for row, other in zip(old, new, strict=True):
            if not np.allclose(row, other, rtol=ROUNDING, atol=ROUNDING * np.abs(other).max(initial=0.0)):
                raise scene_error(f"coefficient_{name}", "numbers that scene and modes do not give", UNCHANGED)


def check_contents(dataset: xr.Dataset, prepared: PreparedModel) -> None:
    """Refuse a Dataset whose state is not the recorded one, or whose other variables are not those of its state."""
    stages = [stage for stage in provenance.stages_of(dataset) if stage.get("function") == FUNCTION]
    if not stages or stages[-1]["parameters"].get("state_sha256") != _state_digest(prepared.state):
        raise scene_error("state", "one that differs from the record in history_json", UNCHANGED)
    amplitudes = _amplitudes(prepared)
    values = np.array(prepared.time), prepared.end_position, prepared.force, amplitudes
    for key, value in zip(DERIVED, values, strict=True):
        stored = _array(dataset, key)
        if stored.shape != value.shape or not np.allclose(stored, value, rtol=ROUNDING, atol=ROUNDING):
            raise scene_error(key, "numbers that differ from those of the state", UNCHANGED)


def _amplitudes(prepared: PreparedModel) -> np.ndarray:
    """Return the amplitudes of all normals (normal, mode) [m]; zero for modes that a normal lacks."""
    parts = prepared.amplitude
    rank = max(part.size for part in parts)
    return np.array([np.pad(part, (0, rank - part.size)) for part in parts])


def _state_digest(state: np.ndarray) -> str:
    return hashlib.sha256(state.tobytes()).hexdigest()[:16]


def _source(dataset: xr.Dataset, prefix: str) -> xr.Dataset:
    """Return the scene or the modes from variables with a prefix."""
    variables = {
        str(name).removeprefix(prefix): (
            [str(dim).removeprefix(prefix) for dim in variable.dims], variable.values,
            {} if variable.attrs.get("long_name") == name else variable.attrs,  # labels that it had not before
        )
        for name, variable in dataset.variables.items()
        if str(name).startswith(prefix)
    }  # fmt: skip
    variables["coordinate"] = (["coordinate"], dataset["coordinate"].values, dataset["coordinate"].attrs)
    return xr.Dataset(variables, attrs=json.loads(dataset.attrs[f"{prefix}attributes_json"]))
