"""Datasets altered in every way that xarray, numpy or a user can think of, and what a call must make of them.

An alteration is legal, and then has an equivalent: a Dataset in the order of the package with the same labels and values, for
which the call gives the same bits.  Or it is not legal, and the call either says so or does not depend on what was altered.
"""

from __future__ import annotations

import inspect
import math
import pickle
import shutil
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from public_calls import CALLS, datasets, function_of

import cablepod as cp

#: Errors that speak to the user.
CLEAR = (cp.SceneError, cp.ArchiveError, cp.RunStopped)
#: Orders that labels have in the package; others are sorted.
ORDERS = {"coordinate": "xyz", "end": ["lower", "upper"], "bound": ["least", "largest"]}
#: Calls of every function, as in `public_calls`, with arguments that reach their results; the last part of a name is a variant.
MORE: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "archive.write/modes": (("modes",), {"path": "new.nc"}),
    "archive.write/scene": (("scene",), {"path": "new.nc"}),
    "cable.simulate": (("scene",), {"step": 5e-4}),
    "chain.simulate/members": (("members",), {"step": 1e-3}),
    "chain.simulate/implicit": (("scene",), {"step": 1e-2, "scheme": "trapezoidal", "outputs": ("tension",)}),
    "condensed.resume": (("prepared",), {}),
    "condensed.simulate/members": (("members", "normal modes"), {"step": 1e-2}),
    "condensed.simulate/exact": (("scene", "normal modes"), {"order": "exact", "step": 1e-2}),
    "galerkin.simulate/vector": (("scene", "vector modes"), {}),
    "plots.amplitudes/projected": (("amplitudes",), {}),
    "plots.modes/normal": (("normal modes",), {}),
    "plots.modes/vector": (("vector modes",), {}),
    "plots.parameter_map": (
        ("catenaries",), {"variable": "tension_upper", "x": "cable.top_tension", "y": "ends.upper.x"}
    ),
    "plots.shapes/deflection": (("chain", "condensed"), {"deflection": True}),
    "pod.decompose/vector": (("chain",), {"layout": "vector", "weights": "length"}),
    "pod.decompose/normal": (("chain",), {"layout": "normal", "rank": 2}),
    "pod.project/normal": (("chain", "normal modes"), {}),
    "pod.reconstruct/normal": (("condensed", "normal modes"), {}),
}  # fmt: skip
#: Tables of pipelines, which no function of the package makes, and a call that takes a minute.
LEFT_OUT = ("plots.error_against_run_time", "study.run")
VARIANTS = {name: call for name, call in (CALLS | MORE).items() if name not in LEFT_OUT}
SLOW = ("ensemble.run",)
#: Calls and alterations whose result is another one: variables that stay in the scenes, units and long names on axes.
ALLOWED = {
    ("ensemble.design", "more_variables"), ("plots.frequency_response", "without_attributes_of_variables"),
    ("plots.parameter_map", "without_attributes_of_variables"),
}  # fmt: skip
#: Alterations of one variable, dimension or attribute, of which each is altered in turn.
OF_EACH = (
    "units: km", "units: number", "values: nan", "kinds: text", "kinds: dates", "kinds: half", "kinds: complex",
    "attribute: text", "attribute: list", "attribute: array", "attribute_dropped", "dimension_renamed", "dimension_picked",
    "dimension_cut", "dimension_added", "variable_dropped", "variable_mean", "scalar: nan", "scalar: negative",
    "labels_over: elsewhere", "labels_over: of a dimension", "labels_as_a_variable",
)  # fmt: skip


class Altered(NamedTuple):
    """An altered Dataset, and one in the order of the package for which the call gives the same bits.

    None: not legal; the call says so, or gives what it gives for the Dataset as it was.  "other": a Dataset with other contents,
    legal or not; the call gives some result, or says why not.
    """

    dataset: xr.Dataset
    equivalent: xr.Dataset | str | None


ALTERATIONS: dict[str, Callable[[xr.Dataset, np.random.Generator], Altered | None]] = {}


def alteration(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add an alteration to the table, under its name."""
    ALTERATIONS[function.__name__.strip("_")] = function
    return function


def over(table: dict[str, Any]) -> Callable[..., Any]:
    """Add an alteration for each entry of a table."""

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        for name, value in table.items():
            ALTERATIONS[f"{function.__name__}: {name}"] = lambda ds, rng, value=value: function(ds, rng, value)
        return function

    return add


class Nth:
    """In the place of random numbers: picks the n-th of the names that an alteration chooses from."""

    def __init__(self, n: int) -> None:
        self.n, self.count, self.permutation = n, 0, np.random.default_rng(n).permutation

    def integers(self, count: int) -> int:
        """The n-th at first, 0 afterwards."""
        first, self.count = self.count == 0, self.count or count
        return min(self.n, count - 1) if first else 0


def pick(names: Any, rng: Any) -> Any:
    """One of some names, None without any."""
    found = sorted(names, key=str)
    return found[rng.integers(len(found))] if found else None


def numeric(ds: xr.Dataset) -> list[str]:
    """Names of the variables of numbers with dimensions, but for labels."""
    return [str(n) for n, v in ds.variables.items() if v.dtype.kind == "f" and v.ndim and n not in ds.indexes]


def scalars(ds: xr.Dataset) -> list[str]:
    """Names of the variables that are a single number."""
    return [str(n) for n, v in ds.variables.items() if v.dtype.kind == "f" and not v.ndim]


def changed(ds: xr.Dataset, change: Callable[[np.ndarray], Any], names: Any = None) -> xr.Dataset:
    """A copy with other arrays in the place of variables (all of numbers, but for labels)."""
    result = ds.copy()
    for name in numeric(ds) if names is None else names:
        variable = ds.variables[name]
        made = xr.Variable(variable.dims, change(variable.values), variable.attrs)
        result = result.assign_coords({name: made}) if name in ds.coords else result.assign({name: made})
    return result


# --- legal --------------------------------------------------------------------------------------------------------------


@over({name: name for name in ("coordinate", "mode", "end", "bound", "feature", "particle", "node", "level")})
def shuffled(ds, rng, dim):
    """Labels in another order, with their values; particles with their arc length."""
    if ds.sizes.get(dim, 0) < 2:
        return None
    order = rng.permutation(ds.sizes[dim])
    if np.array_equal(order, np.arange(order.size)):
        order = order[::-1]
    return Altered(ds.isel({dim: order}), ds)


@over({name: name for name in ("coordinate", "mode", "end", "bound", "particle")})
def reversed_(ds, rng, dim):
    """Labels in the opposite order, as views of negative stride."""
    return Altered(ds.isel({dim: slice(None, None, -1)}), ds) if ds.sizes.get(dim, 0) > 1 else None


@alteration
def transposed(ds, rng):
    """Dimensions of all variables in another order."""
    return Altered(ds.transpose(*rng.permutation(list(ds.dims)).tolist()), ds)


@alteration
def everything_reordered(ds, rng):
    """All labels and dimensions in another order."""
    result = ds
    for dim in ("coordinate", "mode", "particle", "end", "feature"):
        found = ALTERATIONS[f"shuffled: {dim}"](result, rng)
        result = result if found is None else found.dataset
    return Altered(result.transpose(*rng.permutation(list(ds.dims)).tolist()), ds)


@alteration
def variables_in_another_order(ds, rng):
    """Variables in another order."""
    names = rng.permutation([str(name) for name in ds.data_vars]).tolist()
    return Altered(ds[names].assign_coords(ds.coords).assign_attrs(ds.attrs), ds)


@over({
    "big-endian": lambda a: a.astype(a.dtype.newbyteorder(">")),
    "Fortran order": np.asfortranarray,
    "strided": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
    "unaligned": lambda a: np.frombuffer(b"\0" + a.tobytes(), np.uint8)[1:].view(a.dtype).reshape(a.shape),
    "extended precision": lambda a: a.astype(np.longdouble),
})  # fmt: skip
def arrays(ds, rng, change):
    """The same numbers in memory in another way."""
    return Altered(changed(ds, change), ds)


@alteration
def read_only(ds, rng):
    """Arrays that must not be written."""

    def frozen(array):
        array = array.copy()
        array.setflags(write=False)
        return array

    return Altered(changed(ds, frozen), ds)


@alteration
def float32(ds, rng):
    """Numbers of single precision."""
    return Altered(
        changed(ds, lambda a: a.astype(np.float32)), changed(ds, lambda a: a.astype(np.float32).astype(float))
    )


@alteration
def float32_times(ds, rng):
    """Instants of single precision."""
    if "time" not in ds.indexes:
        return None
    times = ds["time"].values.astype(np.float32)
    label = ds["time"].attrs
    return Altered(
        ds.assign_coords(time=("time", times, label)), ds.assign_coords(time=("time", times.astype(float), label))
    )


@alteration
def integers(ds, rng):
    """Whole numbers for the coordinates of points."""
    names = [name for name in ("position", "ends_lower", "ends_upper", "end_position") if name in ds]
    names = [name for name in names if (ds[name].values == np.round(ds[name].values)).all()]
    return Altered(changed(ds, lambda a: a.astype(np.int32), names), ds) if names else None


@over({"one": "one", "random": "random", "all": -1})
def chunks(ds, rng, kind):
    """Arrays of dask."""
    if kind == "random":
        kind = {dim: int(rng.integers(1, max(1, size) + 1)) for dim, size in ds.sizes.items()}
    return Altered(ds.chunk(dict.fromkeys(ds.dims, 1) if kind == "one" else kind), ds)


@alteration
def labels_as_objects(ds, rng):
    """Texts of labels as Python objects, as some files give them."""
    names = [name for name in ds.indexes if ds[name].dtype.kind == "U"]
    return (
        Altered(ds.assign_coords({n: (n, ds[n].values.astype(object), ds[n].attrs) for n in names}), ds)
        if names
        else None
    )


@over(
    {
        "unpickled": lambda dtype: pickle.loads(pickle.dumps(dtype)),
        "metadata": lambda dtype: np.dtype(dtype, metadata={"a": 1}),
    }
)
def types(ds, rng, change):
    """Types of numbers that are equal to numpy's, and other objects, as from another process."""
    return Altered(changed(ds, lambda a: a.view(change(a.dtype)), numeric(ds) + scalars(ds)), ds)


@alteration
def without_attributes_of_variables(ds, rng):
    """No units and long names, as after arithmetic."""
    result = ds.copy()
    for name in ds.variables:
        result[name].attrs = {}
    return Altered(result, ds)


@alteration
def more_variables(ds, rng):
    """Variables that no function asks for."""
    return Altered(ds.assign(mine=("somewhere", np.arange(3.0)), note="text").assign_coords(run=7), ds)


@alteration
def swapped_labels(ds, rng):
    """The labels of two coordinates exchanged, as of data of other axes."""
    if ds.sizes.get("coordinate", 0) < 2 or "motion_upper_x_kind" in ds:
        return None
    labels = ds["coordinate"].values.copy()
    labels[[0, 1]] = labels[[1, 0]]
    other = ds.assign_coords(coordinate=("coordinate", labels, ds["coordinate"].attrs))
    order = [1, 0, *range(2, labels.size)]
    return Altered(other, other.isel(coordinate=order))


@alteration
def relabelled_modes(ds, rng):
    """Modes with the numbers of others."""
    if ds.sizes.get("mode", 0) < 2:
        return None
    labels = ds["mode"].values[::-1]
    other = ds.assign_coords(mode=("mode", labels, ds["mode"].attrs))
    return Altered(other, other.isel(mode=slice(None, None, -1)))


# --- not legal ----------------------------------------------------------------------------------------------------------


def renamed_labels(ds, dim, labels):
    """The Dataset with other labels of a dimension."""
    if dim not in ds.dims:
        return None
    labels = [labels[i % len(labels)] for i in range(ds.sizes[dim])]
    return Altered(ds.assign_coords({dim: (dim, labels)}), None)


@over({
    "repeated": ["x"], "unknown": ["a", "b", "c"], "capitals": ["X", "Y", "Z"], "numbers": [0, 1, 2], "nan": [np.nan, 1.0],
    "not from x": ["y", "z", "x2"], "bytes": [b"x", b"y", b"z"],
})  # fmt: skip
def coordinates(ds, rng, labels):
    """Labels that no coordinate has."""
    return renamed_labels(ds, "coordinate", labels)


@over({"repeated": [1], "nan": [np.nan], "text": ["first", "second", "third"]})
def modes(ds, rng, labels):
    """Labels that no mode has."""
    return renamed_labels(ds, "mode", labels)


@over({"repeated": ["lower"], "unknown": ["left", "right"]})
def ends(ds, rng, labels):
    """Labels that no end has."""
    return renamed_labels(ds, "end", labels)


@over({
    "reversed": lambda t: t[::-1], "repeated": lambda t: np.r_[t[:1], t[:-1]], "nan": lambda t: np.r_[np.nan, t[1:]],
    "all alike": np.zeros_like, "infinite": lambda t: np.r_[t[:-1], np.inf],
    "dates": lambda t: np.arange(t.size).astype("datetime64[s]"), "texts": lambda t: t.astype(str),
    "complex": lambda t: t + 1j, "spans": lambda t: np.arange(t.size).astype("timedelta64[s]"),
    "shuffled": lambda t: np.random.default_rng(1).permutation(t),
})  # fmt: skip
def times(ds, rng, change):
    """Instants that do not rise, or are none."""
    if "time" not in ds.indexes:
        return None
    return Altered(ds.assign_coords(time=("time", change(ds["time"].values), ds["time"].attrs)), None)


@over({"twice": lambda n: [0, *range(n)], "reversed": lambda n: slice(None, None, -1), "none": lambda n: []})
def instants(ds, rng, pick):
    """Instants with their values in an order that is no time."""
    return Altered(ds.isel(time=pick(ds.sizes["time"])), None) if "time" in ds.indexes else None


@over({
    "negative": lambda s: -s, "repeated": lambda s: np.r_[s[:1], s[:-1]], "nan": lambda s: np.r_[s[:-1], np.nan],
    "zero": np.zeros_like, "texts": lambda s: s.astype(str), "kilometres": lambda s: s / 1000.0, "other": lambda s: s * 1.7,
    "complex": lambda s: s + 0j, "infinite": lambda s: np.r_[s[:-1], np.inf], "of another cable": lambda s: s + 1.0,
})  # fmt: skip
def arc_lengths(ds, rng, change):
    """Arc lengths that are not those of the particles."""
    if "arc_length" not in ds.variables or ds["arc_length"].ndim > 1:
        return None
    return Altered(changed(ds, change, ["arc_length"]), None)


@over({"repeated": lambda n: [0, *range(n)], "without the lower end": lambda n: range(1, n), "one": lambda n: [0]})
def particles(ds, rng, pick):
    """Particles twice, or without an end."""
    return Altered(ds.isel(particle=list(pick(ds.sizes["particle"]))), None) if "particle" in ds.dims else None


@over({"km": "km", "kN": "kN", "ms": "ms", "mm": "mm", "number": 3, "unknown": "furlong", "empty": ""})
def units(ds, rng, unit):
    """Units that are not the package's."""
    name = pick([n for n, v in ds.variables.items() if v.attrs.get("units", "1") != "1"], rng)
    if name is None:
        return None
    result = ds.copy()
    result[name].attrs = ds[name].attrs | {"units": unit}
    return Altered(result, None)


@over({"nan": np.nan, "inf": np.inf, "-inf": -np.inf, "huge": 1e300})
def values(ds, rng, value):
    """A number that is none."""
    name = pick(set(numeric(ds)) - {"scene_feature"}, rng)  # nan there: unknown
    if name is None or not ds[name].size:
        return None

    def put(array):
        array = array.copy()
        array.flat[rng.integers(array.size)] = value
        return array

    return Altered(changed(ds, put, [name]), None if value != 1e300 else "other")


@over({"nan": np.nan, "inf": np.inf, "huge": 1e200, "negative": -7.0})
def scalar(ds, rng, value):
    """A single number that is none, or another one."""
    name = pick(scalars(ds), rng)
    if name is None:
        return None
    lacks = "scene" in str(ds.attrs.get("stage"))  # nan there: a key that a member lacks
    legal = None if math.isnan(value) and not lacks else "other"
    return Altered(changed(ds, lambda a: np.full_like(a, value), [name]), legal)


@over({"1e200": 1e200, "1e-200": 1e-200})
def lengths(ds, rng, factor):
    """Lengths of another cable."""
    names = [name for name in ("arc_length", "link_arc_length", "unstretched_length") if name in ds.variables]
    return Altered(changed(ds, lambda a: a * factor, names), "other") if names else None


@over({
    "text": lambda a: a.astype(str), "object": lambda a: a.astype(object), "complex": lambda a: a + 1j,
    "truth": lambda a: a > 0, "dates": lambda a: np.zeros(a.shape, "datetime64[s]"), "half": lambda a: a.astype("f2"),
    "None": lambda a: np.full(a.shape, None),
})  # fmt: skip
def kinds(ds, rng, change):
    """Arrays of something else than numbers, or of too few digits."""
    name = pick(numeric(ds), rng)
    return None if name is None else Altered(changed(ds, change, [name]), None)


@over({"elsewhere": ("my",), "of a dimension": None})
def labels_over(ds, rng, dims):
    """Labels of a dimension that they do not belong to."""
    name = pick(set(ds.indexes) - {"time", "particle", "link"}, rng)
    others = [dim for dim in ds.dims if dim != name]
    if name is None or (dims is None and not others):
        return None
    dims = (pick(others, rng),) if dims is None else dims
    labels = ds[name].values[::-1] if dims == ("my",) else np.resize(ds[name].values, ds.sizes[dims[0]])
    return Altered(ds.drop_vars(name).assign({name: (dims, labels)}), "other")


@alteration
def labels_as_a_variable(ds, rng):
    """Labels that are no coordinate."""
    name = pick(ds.indexes, rng)
    return None if name is None else Altered(ds.drop_indexes(name).reset_coords(name), "other")


@over({"number": 1, "tuple": (1, 2)})
def name_of_a_variable(ds, rng, name):
    """A variable whose name is no text."""
    return Altered(ds.assign({name: 3.0}), "other")


@alteration
def dimension_renamed(ds, rng):
    """A dimension with another name."""
    dim = pick(ds.dims, rng)
    return None if dim is None else Altered(ds.rename({dim: f"my_{dim}"}), None)


@alteration
def dimension_picked(ds, rng):
    """One element of a dimension, which is lost."""
    dim = pick([dim for dim, size in ds.sizes.items() if size], rng)
    return None if dim is None else Altered(ds.isel({dim: 0}), "other")


@alteration
def dimension_cut(ds, rng):
    """The first elements of a dimension."""
    dim = pick(ds.dims, rng)
    return None if dim is None else Altered(ds.isel({dim: slice(ds.sizes[dim] // 2)}), "other")


@over({name: name for name in ("time", "particle", "link", "coordinate", "mode", "member")})
def emptied(ds, rng, dim):
    """No element of a dimension is left."""
    return Altered(ds.isel({dim: []}), "other") if dim in ds.dims else None


@alteration
def dimension_added(ds, rng):
    """A dimension that the variable does not have."""
    name = pick(numeric(ds), rng)
    return None if name is None else Altered(ds.assign({name: ds[name].expand_dims(extra=2)}), "other")


@alteration
def variable_dropped(ds, rng):
    """A variable is missing."""
    return Altered(ds.drop_vars(pick(ds.variables, rng)), "other")


@alteration
def variable_mean(ds, rng):
    """A scalar in the place of a variable."""
    name = pick(numeric(ds), rng)
    return (
        None if name is None else Altered(changed(ds, lambda a: a.mean(), []).assign({name: ds[name].mean()}), "other")
    )


@alteration
def variables_swapped(ds, rng):
    """A variable in the place of another one."""
    names = rng.permutation(numeric(ds))[:2].tolist()
    if len(names) < 2:
        return None
    return Altered(ds.assign({names[0]: ds[names[1]].variable}), "other")


@over({"None": None, "number": 3, "unknown": "mine", "list": ["scene"], "rest": "rest", "modes": "modes"})
def stage(ds, rng, value):
    """Another stage."""
    return Altered(ds.assign_attrs(stage=value), None) if ds.attrs.get("stage") != value else None


@over({"None": None, "number": 3, "unknown": "mine", "normal": "normal", "vector": "vector", "separate": "separate"})
def layout(ds, rng, value):
    """Another layout of modes."""
    if "layout" not in ds.attrs or ds.attrs["layout"] == value:
        return None
    return Altered(ds.assign_attrs(layout=value), None)


@alteration
def attribute_dropped(ds, rng):
    """An attribute is missing."""
    name = pick(ds.attrs, rng)
    if name is None:
        return None
    result = ds.copy()
    result.attrs = {key: value for key, value in ds.attrs.items() if key != name}
    return Altered(result, "other")


class Unhashable(str):
    """A text that is no key."""

    __hash__ = None  # type: ignore[assignment]


@over({
    "no list of inputs": '[{"id": "a", "function": "f", "inputs": 3}]', "number": '[{"id": "a", "function": "f", "x": 1}]',
    "twice": '[{"id": "a", "function": "f"}, {"id": "a", "function": "f"}]', "no id": '[{"id": "", "function": "f"}]',
    "no table": '[{"id": "a", "function": "f", "parameters": []}]', "unhashable": Unhashable("[]"),
    "numpy": np.str_("[]"), "deep": "[" * 100_000,
})  # fmt: skip
def history(ds, rng, text):
    """A history of another form."""
    return Altered(ds.assign_attrs(history_json=text), "other") if "history_json" in ds.attrs else None


@over({"None": None, "number": 3, "array": np.zeros(2), "text": "text", "list": [1, "a"]})
def attribute(ds, rng, value):
    """Another value of an attribute."""
    name = pick(set(ds.attrs) - {"stage", "layout"}, rng)
    return None if name is None else Altered(ds.assign_attrs({name: value}), "other")


# --- calls and their results ----------------------------------------------------------------------------------------------


def ordered(ds: xr.Dataset) -> dict[str, Any]:
    """Dimensions and bytes of all variables by name, with labels and dimensions in one order."""
    for dim, labels in ORDERS.items():
        if dim in ds.indexes and set(ds[dim].values) <= set(labels):
            ds = ds.isel({dim: np.argsort([list(labels).index(label) for label in ds[dim].values])})
    for dim in ("mode", "feature", "member"):
        if dim in ds.indexes and ds[dim].dtype.kind in "iuUO":
            ds = ds.isel({dim: np.argsort(ds[dim].values, kind="stable")})
    if "arc_length" in ds.variables and ds["arc_length"].dims == ("particle",) and ds["arc_length"].dtype.kind in "fiu":
        ds = ds.isel(particle=np.argsort(ds["arc_length"].values, kind="stable"))
    result = {}
    for name, variable in ds.variables.items():
        values = variable.transpose(*sorted(variable.dims, key=str)).values
        if values.dtype.kind in "fiu":
            values = values.astype(float)
        content = values.astype(str).tolist() if values.dtype.kind in "UO" else values.tobytes()
        result[str(name)] = (sorted(map(str, variable.dims)), content)
    return result


def drawn(ax: Any) -> list[Any]:
    """Data of the lines, points and maps of a figure, with its labels."""
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    found: list[Any] = [ax.get_xlabel(), ax.get_ylabel()]
    found += [np.asarray(line.get_xydata(), float).tobytes() for line in ax.findobj(mpl.lines.Line2D)]
    found += [np.asarray(item.get_offsets(), float).tobytes() for item in ax.findobj(mpl.collections.PathCollection)]
    found += [text.get_text() for legend in ax.findobj(mpl.legend.Legend) for text in legend.get_texts()]
    plt.close(ax.figure)
    return found


def contents(result: Any) -> Any:
    """What is compared of a result."""
    if isinstance(result, xr.Dataset):
        return ordered(result)
    if isinstance(result, Path):
        return ordered(cp.archive.read(result))
    if hasattr(result, "show_frame"):
        return drawn(result.show_frame(1))
    if hasattr(result, "findobj"):
        return drawn(result)
    if hasattr(result, "coefficients"):
        return [
            result.state.tobytes(),
            *(array.tobytes() for array in result.coefficients if isinstance(array, np.ndarray)),
            result.run().amplitude.tobytes(),
        ]
    return result


def run(name: str, arguments: list[xr.Dataset]) -> Any:
    """Contents of the result of a call, or its clear error; raises all others."""
    for path in (Path("new.nc"), Path("folder")):
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    function, options = function_of(name.partition("/")[0]), VARIANTS[name][1]
    if name == "plots.error_over_time":
        arguments = [{"a": arguments[0]}]  # type: ignore[list-item]
    try:
        result = function(*arguments, **options)
        if inspect.isgenerator(result):
            result = next(result)
        if name.startswith("archive.write"):
            result = Path("new.nc")
        return contents(result)
    except CLEAR as error:
        return error


@cache
def usual(name: str, spatial: bool) -> Any:
    """Contents of the result of a call as it is meant."""
    result = run(name, [datasets(spatial)[stage] for stage in VARIANTS[name][0]])
    assert not isinstance(result, Exception), f"{name}: {result}"
    return result


class Attempt(NamedTuple):
    """A call with one altered Dataset."""

    name: str
    spatial: bool
    place: int
    kind: str
    seed: int  #: of random numbers; below 0 for :class:`Nth`


def attempts(count: int, seed: int) -> list[Attempt]:
    """So many calls, spread over all functions, arguments and alterations."""
    rng = np.random.default_rng(seed)
    every = [
        (name, place, kind) for name in VARIANTS for place in range(len(VARIANTS[name][0])) for kind in ALTERATIONS
    ]
    weights = np.array([0.1 if name in SLOW else 1.0 for name, _, _ in every])
    found: list[Attempt] = []
    while len(found) < count:
        name, place, kind = every[rng.choice(len(every), p=weights / weights.sum())]
        attempt = Attempt(name, bool(rng.integers(2)), place, kind, int(rng.integers(1 << 30)))
        if altered(attempt) is not None:
            found.append(attempt)
    return found


def altered(attempt: Attempt) -> Altered | None:
    """The altered argument of a call; None where the alteration does not apply."""
    dataset = datasets(attempt.spatial)[VARIANTS[attempt.name][0][attempt.place]]
    rng: Any = np.random.default_rng(attempt.seed) if attempt.seed >= 0 else Nth(-1 - attempt.seed)
    return ALTERATIONS[attempt.kind](dataset, rng)


def each(name: str) -> Iterator[Attempt]:
    """Calls with each variable, dimension and attribute altered in turn, by the alterations of :data:`OF_EACH`."""
    spatial = len(name) % 2 == 0
    for place, stage in enumerate(VARIANTS[name][0]):
        for kind in OF_EACH:
            n, count = 0, 1
            while n < count:
                nth = Nth(n)
                if ALTERATIONS[kind](datasets(spatial)[stage], nth) is not None:
                    yield Attempt(name, spatial, place, kind, -1 - n)
                n, count = n + 1, nth.count


def fault(attempt: Attempt) -> str | None:
    """Make a call; tell what is wrong with its outcome, None where it is as it should be."""
    name, spatial, place, kind, _ = attempt
    given = altered(attempt)
    assert given is not None
    arguments = [datasets(spatial)[stage] for stage in VARIANTS[name][0]]
    before = ordered(given.dataset)

    def call(dataset: xr.Dataset) -> Any:
        return run(name, [*arguments[:place], dataset, *arguments[place + 1 :]])

    try:
        result = call(given.dataset)
    except Exception as error:
        return f"raw {type(error).__name__}: {error}"
    if ordered(given.dataset) != before:
        return "altered its argument"
    if isinstance(result, Exception):
        text = str(result)
        if len(text) < 10 or "\n" in text:
            return f"unclear: {text}"
        # the state of a prepared model is checked bit by bit; files have no longer floats
        rounded = (
            name == "condensed.resume" and kind in ("float32", "relabelled_modes", "swapped_labels")
        ) or "cannot be written" in text
        if not isinstance(given.equivalent, xr.Dataset) or rounded or str(call(given.equivalent)) == text:
            return None
        return f"refused: {text}"
    # what is not there is left out of a figure, and a member that lacks a variable fails alone
    gap = kind.startswith(("values", "scalar")) and (name.startswith("plots.") or "member" in given.dataset.dims)
    if isinstance(given.equivalent, str) or gap:  # "other"; a Dataset compares its values with a text
        return None
    if name.startswith("archive."):
        return None if name.startswith("archive.describe") or result == before else "silent: another file"
    if (name, kind) in ALLOWED:
        return None
    if name == "pod.at_times" and result == ordered(given.dataset.sel(time=VARIANTS[name][1]["times"])):
        return None  # as it was given, at these instants
    expected = (
        usual(name, spatial)
        if given.equivalent is None or given.equivalent is arguments[place]
        else call(given.equivalent)
    )
    if isinstance(expected, Exception):
        return f"silent: its equivalent is refused, {expected}"
    return None if result == expected else "silent: another result"
