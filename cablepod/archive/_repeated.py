"""What the scripts of :mod:`cablepod.archive._lineage` call: results made again, compared with the record of their stage."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.errors import SceneError, scene_error, warn

#: Largest difference of a value that counts as rounding, as a fraction of the largest absolute value of variables of its unit.
ROUNDING = 1e-9
#: Beginnings of the names of variables whose rounding grows as singular values come close.
OF_MODES = ("mode_shape", "mode_uncertainty")


class RepeatedWarning(UserWarning):
    """A result made again differs from its record within rounding, or in its id alone."""


def check(dataset: xr.Dataset, identifier: str, *, values: Mapping[str, Any]) -> None:
    """Compare a reproduced dataset with the record of its stage.

    Parameters
    ----------
    dataset
        The reproduced dataset.
    identifier
        Id of the original.
    values
        Name of a variable -> hash, shape and, of real numbers, largest absolute value and weighted sum, as recorded.  Empty for
        a record without values, as of an ensemble, of which the id is compared.

    Raises
    ------
    SceneError
        If values differ by more than a relative 1e-9 of the largest absolute value of the variables of their unit (1 for
        fractions; for shapes of modes times the largest singular value over the smallest gap of two), or in anything else than
        real numbers; with empty `values`, if the id differs.

    Warns
    -----
    RepeatedWarning
        If values differ within that, and if only the id differs.
    """
    found = str(dataset.attrs.get("id"))
    if not values:
        if found != identifier:
            _refuse(dataset, identifier, f"the id is {found}")
        return
    lacking = sorted({*values} ^ {*map(str, dataset.variables)})
    if lacking:
        _refuse(dataset, identifier, f"variables {', '.join(lacking)} are in one of both alone")
    scales, differences = _scales(dataset), []
    for name, recorded in values.items():
        variable = dataset.variables[name]
        if not recorded[0] or variable.chunks is not None:
            continue
        entry = provenance.VariableContent(variable).update(variable.values).entry()
        if entry[0] == recorded[0]:
            continue
        difference = _difference(entry, recorded, scales.get(_unit(variable), 0.0))
        if not difference <= ROUNDING * (_gap_factor(dataset) if name.startswith(OF_MODES) else 1.0):
            how = (
                f"by {difference:.2g} of the largest absolute value"
                if math.isfinite(difference)
                else "in shape or type"
            )
            _refuse(dataset, identifier, f"{name} differs {how}")
        differences.append((difference, name))
    if differences:
        most, name = max(differences)
        names = ", ".join(name for _, name in differences)
        warn(
            f"{_name(dataset)}, {identifier}: differs from the record within rounding, in {names}, {name} by {most:.1g} of the "
            "largest absolute value; going on; try: its file, where that matters",
            RepeatedWarning,
        )
    if found != identifier:
        warn(
            f"{_name(dataset)}: has the id {found} in place of {identifier}, with the same values; going on; "
            "try: the versions in both histories",
            RepeatedWarning,
        )


def _unit(variable: xr.Variable) -> str:
    return str(variable.attrs.get("units", ""))


def _scales(dataset: xr.Dataset) -> dict[str, float]:
    """Return the largest absolute value of the real variables of each unit, at least 1 of fractions.

    Residual forces, or errors, are as large as the rounding of forces, or of the motion.
    """
    scales = {"1": 1.0}
    for variable in dataset.variables.values():
        if variable.dtype.kind == "f" and variable.chunks is None:
            values = np.abs(variable.values)
            largest = float(values[np.isfinite(values)].max(initial=0.0))
            scales[_unit(variable)] = max(largest, scales.get(_unit(variable), 0.0))
    return scales


def _gap_factor(dataset: xr.Dataset) -> float:
    """Return the largest singular value over the smallest gap of two; rounding turns modes by so much more than the data."""
    factor = 1.0
    for name, variable in dataset.variables.items():
        if str(name).removesuffix("_out_of_plane") == "singular_value":
            values = np.atleast_2d(variable.transpose(..., "mode").values)
            gaps = -np.diff(np.pad(values, ((0, 0), (0, 1))))
            factor = max(factor, float(np.max(values[:, :1] / np.maximum(np.abs(gaps), 1e-300))))
    return factor


def _difference(entry: list[Any], recorded: list[Any], scale: float) -> float:
    """Return the difference of two entries as a fraction of the largest absolute value; infinite for other shapes and types."""
    if entry[1] != recorded[1] or len(entry) < 4 or len(recorded) < 4:
        return math.inf
    scale = max(entry[2], recorded[2], scale)
    return max(abs(entry[2] - recorded[2]), abs(entry[3] - recorded[3])) / scale if scale else 0.0


def _name(dataset: xr.Dataset) -> str:
    stages = provenance.stages_of(dataset)
    return str(stages[-1]["function"]) if stages else "result"


def _refuse(dataset: xr.Dataset, identifier: str, what: str) -> NoReturn:
    """Raise the error for values that are not the recorded ones."""
    raise SceneError(
        f"{_name(dataset)}: given a result made again, of which {what}; allowed: the values of {identifier} within a relative "
        f"{ROUNDING:g}; try: the version of the package, and of its libraries, that its history names"
    )


def changed(scene: xr.Dataset, *, values: Mapping[str, Any], lacks: list[str]) -> xr.Dataset:
    """Apply a change recorded in a history.

    Parameters
    ----------
    scene
        The dataset before the change, in most cases a scene.
    values
        Name of a variable -> its value, or its dimensions, values and attributes.
    lacks
        Names of the variables that were left out.

    Returns
    -------
    xarray.Dataset
        The changed dataset.
    """
    variables: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, list):
            dims, numbers, attrs = value
            kind = scene[name].dtype if name in scene else None
            variables[name] = (tuple(dims), np.asarray(numbers, dtype=kind), attrs)
        else:
            variables[name] = scene[name].copy(data=value) if name in scene and not scene[name].dims else value
    return scene.drop_vars([*lacks, *(name for name in variables if name in scene.variables)]).assign(variables)


def selected(
    dataset: xr.Dataset, labels: Mapping[str, Any], *, lacks: list[str], values: Mapping[str, Any]
) -> xr.Dataset:
    """Select labels that a history recorded of a changed dataset.

    Parameters
    ----------
    dataset
        The dataset before the change.
    labels
        Dimension -> its labels after the change, or the one of which it is.  Other names, such as of coordinates along it, are
        left out.
    lacks
        Names of the variables that were left out.
    values
        As of :func:`check`.

    Returns
    -------
    xarray.Dataset
        The part of the dataset.

    Raises
    ------
    SceneError
        If there are no such labels, and as :func:`check`: the change was no selection.
    """
    try:
        part = dataset.drop_vars(lacks)
        part = part.sel({name: label for name, label in labels.items() if name in part.indexes}).compute()
    except (KeyError, ValueError) as error:
        raise scene_error("labels", dict(labels), f"labels of the result ({error})") from None
    check(part, str(dataset.attrs.get("id")), values=values)
    return part
