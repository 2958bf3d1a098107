"""Datasets with the units and long names of the vocabulary, whose equal labels and instants are the same index."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from cablepod.conventions._vocabulary import VARIABLES

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    import xarray as xr
    from xarray.indexes import PandasIndex


def label(dataset: xr.Dataset, **extra: tuple[str, str]) -> xr.Dataset:
    """Set ``units`` and ``long_name`` on every variable and coordinate of `dataset`, in place, and return it.

    `extra` has (units, long name) of variables outside :data:`VARIABLES`.  All other variables keep their attributes and must
    have units.
    """
    known = {**VARIABLES, **extra}
    for name, variable in dataset.variables.items():  # ten times as fast as DataArrays
        if str(name) in known:
            units, long_name = known[str(name)]
            variable.attrs.update(units=units, long_name=long_name)
        elif "units" not in variable.attrs:
            raise KeyError(f"variable {name!r} has no entry in the vocabulary and no units")
    return dataset


def is_in_memory(variable: xr.Variable) -> bool:
    """Tell whether the values of a variable are in memory, neither in a file nor a dask array; no public method tells."""
    return variable._in_memory


def plain_indexes(dataset: xr.Dataset) -> dict[Any, Any]:
    """Return the labels of dimensions as indexes of pandas, which become lists ten times as fast as variables do."""
    from xarray.indexes import PandasIndex

    indexes = dataset.xindexes
    return {name: indexes[name].to_pandas_index() for name in indexes if type(indexes[name]) is PandasIndex}


#: Maximum size of the labels of a template that is kept [bytes]; longer ones cost less than the run itself.
MAX_TEMPLATE_LABELS = 131072


def labelled_dataset(
    variables: Mapping[str, tuple[tuple[str, ...], Any]],
    indexes: Mapping[str, np.ndarray],
    coordinates: Mapping[str, tuple[tuple[str, ...], Any]] | None = None,
) -> xr.Dataset:
    """Make a Dataset with units and long names, as ``label(xr.Dataset(variables, coords))`` does, in a third of the time.

    xarray aligns and checks all coordinates of a new Dataset, which costs as much as a thousand steps of a reduced model.  A
    Dataset with the same names, dimensions, shapes and labels as an earlier one is that with other values; it shares the indexes,
    which cannot be changed, but no values and attributes.

    Parameters
    ----------
    variables
        Dimensions and values of the data variables.
    indexes
        Labels of dimensions.
    coordinates
        Dimensions and values of further coordinates, without an index.
    """
    import numpy as np
    import xarray as xr

    values = {name: np.asarray(array) for name, (_, array) in variables.items()}
    further = {name: np.asarray(array) for name, (_, array) in (coordinates or {}).items()}
    layout = tuple((name, tuple(dims), values[name].shape) for name, (dims, _) in variables.items())
    extra = tuple((name, tuple(dims), further[name].shape) for name, (dims, _) in (coordinates or {}).items())
    labels = tuple((name, array.dtype.str, array.tobytes()) for name, array in indexes.items())
    kept = sum(array.nbytes for array in indexes.values()) <= MAX_TEMPLATE_LABELS
    template = (_template if kept else _template.__wrapped__)(layout, extra, labels)
    arrays: dict[Any, Any] = {**values, **{name: array.copy() for name, array in further.items()}}  # models keep theirs
    made: dict[Any, xr.Variable] = {}
    for name, variable in template.variables.items():
        if name in arrays:
            made[name] = xr.Variable(variable.dims, arrays[name], dict(variable.attrs), fastpath=True)
        else:
            made[name] = variable.copy(deep=False)
    return template._replace(made)  # Dataset.copy would make all indexes anew, which takes ten times as long


@lru_cache(64)
def _template(
    layout: tuple[tuple[str, tuple[str, ...], tuple[int, ...]], ...],
    extra: tuple[tuple[str, tuple[str, ...], tuple[int, ...]], ...],
    labels: tuple[tuple[str, str, bytes], ...],
) -> xr.Dataset:
    """Make a Dataset of names, dimensions and shapes without values, and of the labels of dimensions."""
    import numpy as np
    import xarray as xr

    def empty(shapes: tuple[tuple[str, tuple[str, ...], tuple[int, ...]], ...]) -> dict[str, Any]:
        return {name: (dims, np.broadcast_to(np.nan, shape)) for name, dims, shape in shapes}

    indexes = {name: np.frombuffer(content, dtype) for name, dtype, content in labels}
    return label(xr.Dataset(empty(layout), coords=shared_coordinates({**indexes, **empty(extra)})))


def shared_coordinates(coords: Mapping[str, Any]) -> xr.Coordinates:
    """Return coordinates of a Dataset, in which labels that other results have too are the same index.

    To make an index of two labels takes xarray as long as a hundred steps of a chain, and an index cannot be changed.

    Parameters
    ----------
    coords
        Labels of dimensions as a list or an array; (dimensions, values) of coordinates without an index.
    """
    import numpy as np
    import xarray as xr
    from xarray.indexes import PandasIndex

    indexes, variables = {}, {}
    for name, given in coords.items():
        if isinstance(given, tuple):
            variables[name] = given
            continue
        labels = np.asarray(given)
        if labels.dtype.kind in "fiuU" and labels.nbytes <= MAX_TEMPLATE_LABELS:
            indexes[name] = _index(name, labels.dtype.str, labels.tobytes())
        else:
            indexes[name] = PandasIndex(labels, name, coord_dtype=labels.dtype)
        variables |= indexes[name].create_variables()  # anew, as their attributes may be changed
    return xr.Coordinates(variables, indexes=indexes)


@lru_cache(64)
def _index(name: str, dtype: str, content: bytes) -> PandasIndex:
    """Make the index of a dimension."""
    import numpy as np
    from xarray.indexes import PandasIndex

    labels = np.frombuffer(content, dtype)
    return PandasIndex(labels, name, coord_dtype=labels.dtype)
