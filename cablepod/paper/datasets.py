"""Make the Datasets of the paper's tables: each variable with its units and long name, the call in the history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from cablepod import provenance
from cablepod.conventions import label


def described(
    function: str,
    options: Mapping[str, Any],
    variables: Mapping[str, tuple[Any, Any, str, str]],
    labels: Mapping[str, tuple[Any, ...]],
    inputs: Sequence[xr.Dataset] = (),
) -> xr.Dataset:
    """Return the result of a function of this sub-package.

    Parameters
    ----------
    function, options, inputs
        Name below ``paper``, parameters and inputs of the call, for the history.
    variables
        Dimensions, values, units and long name of each variable, by its name.
    labels
        Values, units and long name of the labels of each dimension; of names that the package knows the values alone.
    """
    data = {name: entry[:2] for name, entry in variables.items()}
    result = xr.Dataset(data, coords={name: (name, entry[0]) for name, entry in labels.items()})
    label(result, **{name: entry[-2:] for name, entry in (*variables.items(), *labels.items()) if len(entry) > 2})
    return provenance.record(result, function=f"paper.{function}", parameters=options, inputs=inputs)
