"""Prepared models as labelled Datasets, and back."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.condensed._kernels_host_layout import HostCoefficients
from cablepod.condensed._model import CondensedModel
from cablepod.conventions import COORDINATES, label
from cablepod.errors import scene_error

if TYPE_CHECKING:
    from cablepod.condensed._prepared import PreparedModel

#: Stage of the Dataset of a prepared model, and prefixes of the variables that it takes from scene and modes.
STAGE, PREFIXES = "prepared model", ("scene_", "modes_")


class StoredModel(NamedTuple):
    """Contents of the Dataset of a prepared model."""

    scene: xr.Dataset
    modes: xr.Dataset
    rank: int
    order: str
    step: float  #: [s]
    coefficients: HostCoefficients
    state: np.ndarray


def dataset_of(prepared: PreparedModel, scene: xr.Dataset, modes: xr.Dataset, model: CondensedModel) -> xr.Dataset:
    """Make the Dataset of a prepared model with its accepted state; see :meth:`PreparedModel.dataset`."""
    q_sets = prepared.amplitude
    rank = model.rank
    coordinates = list(COORDINATES[: model.chain.p.dims])
    variables: dict[str, Any] = {
        "amplitude": (("normal", "mode"), np.array([np.pad(part, (0, rank - part.size)) for part in q_sets])),
        "end_position": (("coordinate",), prepared.end_position),
        "end_force": (("coordinate",), prepared.force),
        "state": (("state_row", "state_column"), prepared.state),
    }
    for name, array in prepared.coefficients._asdict().items():
        dims = tuple(f"{name}_{axis}" for axis in range(array.ndim))
        variables[f"coefficient_{name}"] = (dims, array)
    result = xr.Dataset(variables, coords={"coordinate": coordinates, "mode": np.arange(1, rank + 1)})
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
            extra[str(key)] = ("1", str(key))
    attrs = {
        "title": f"{scene.attrs.get('title', 'scene')}: prepared condensed model, r = {rank}, order {model.order}",
        "stage": STAGE,
        "model": "condensed",
        "order": model.order,
        "rank": rank,
        "step": prepared.prepared_step,
        "scene_attributes_json": json.dumps(provenance.to_json(dict(scene.attrs)), sort_keys=True),
        "modes_attributes_json": json.dumps(provenance.to_json(dict(modes.attrs)), sort_keys=True),
    }
    result = label(result, **extra)
    result.attrs = attrs
    return provenance.record(
        result,
        function="condensed.PreparedModel.dataset",
        parameters={
            "rank": rank,
            "order": model.order,
            "step": prepared.prepared_step,
            "time": prepared.time,
            "state_sha256": hashlib.sha256(prepared.state.tobytes()).hexdigest()[:16],
        },
        inputs=[scene, modes],
    )


def stored_model(dataset: xr.Dataset) -> StoredModel:
    """Return the contents of the Dataset of a prepared model.

    Raises
    ------
    SceneError
        For another Dataset.
    """
    stage = dataset.attrs.get("stage") if isinstance(dataset, xr.Dataset) else dataset
    if not isinstance(dataset, xr.Dataset) or stage != STAGE or "state" not in dataset:
        raise scene_error("dataset", stage, "a prepared model, as PreparedModel.dataset() gives it")
    scene, modes = (_source(dataset, prefix) for prefix in PREFIXES)
    arrays = (np.ascontiguousarray(dataset[f"coefficient_{name}"].values) for name in HostCoefficients._fields)
    rank, order, step = (dataset.attrs[name] for name in ("rank", "order", "step"))
    return StoredModel(
        scene, modes, int(rank), str(order), float(step), HostCoefficients(*arrays), dataset["state"].values
    )


def _source(dataset: xr.Dataset, prefix: str) -> xr.Dataset:
    """Return the scene or the modes from variables with a prefix."""
    variables = {
        str(name).removeprefix(prefix): (
            [str(dim).removeprefix(prefix) for dim in variable.dims], variable.values, variable.attrs,
        )
        for name, variable in dataset.variables.items()
        if str(name).startswith(prefix)
    }  # fmt: skip
    variables["coordinate"] = (["coordinate"], dataset["coordinate"].values, dataset["coordinate"].attrs)
    return xr.Dataset(variables, attrs=json.loads(dataset.attrs[f"{prefix}attributes_json"]))
