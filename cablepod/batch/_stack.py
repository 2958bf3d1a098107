"""Results of the members of a scene, joined along ``member``."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import xarray as xr

from cablepod._resources import check_bytes
from cablepod.conventions import ATTRIBUTE_UNITS, label
from cablepod.errors import SceneError

#: Dimensions and values of a variable.
Variables = dict[str, tuple[tuple[str, ...], Any]]


class MemberResults:
    """Arrays with a row for each member, made from the first that arrives."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.variables: Variables = {}
        self.attrs: dict[str, list[Any]] = {}
        self.failures: list[Exception | None] = [None] * count
        self.shapes: list[dict[str, tuple[int, ...]]] = [{}] * count
        self.done = 0
        self._lock = threading.Lock()

    def store(self, i: int, variables: Variables, attrs: Mapping[str, Any]) -> None:
        """Keep what member `i` gave."""
        if not self.variables:
            with self._lock:
                if not self.variables:
                    self.variables = self._empty(variables)
        self.shapes[i] = {name: np.shape(values) for name, (_, values) in variables.items()}
        for name, (_, values) in variables.items():
            if self.variables[name][1].shape[1:] == self.shapes[i][name]:
                self.variables[name][1][i] = values
        for name, value in attrs.items():
            with self._lock:
                self.attrs.setdefault(name, [None] * self.count)[i] = value

    def store_chunk(self, first: int, did: np.ndarray, variables: Variables, attrs: Mapping[str, list[Any]]) -> None:
        """Keep what members from `first` on gave, those that `did`."""
        rows = np.flatnonzero(did)
        if not rows.size:
            return
        i = int(rows[0])
        self.store(
            first + i,
            {name: (dims, values[i]) for name, (dims, values) in variables.items()},
            {name: values[i] for name, values in attrs.items()},
        )
        for name, (_, values) in variables.items():
            if did.all():
                self.variables[name][1][first : first + did.size] = values
            else:
                self.variables[name][1][first + rows] = values[rows]
        for row in rows:
            self.shapes[first + row] = self.shapes[first + i]
            for name, item in attrs.items():
                self.attrs[name][first + row] = item[row]

    def check_shapes(self) -> None:
        """Refuse members whose arrays differ in shape from those of the first that did not fail."""
        good = [i for i, error in enumerate(self.failures) if error is None]
        first = self.shapes[good[0]]
        odd = [i for i in good if self.shapes[i] != first]
        if odd:
            name = next(name for name in first if self.shapes[odd[0]].get(name) != first[name])
            dims = ", ".join(self.variables[name][0][1:])
            raise SceneError(
                f"member {odd[0]} (and {len(odd) - 1} more): given {name} ({dims}) of shape {self.shapes[odd[0]].get(name)}; "
                f"allowed: one shape for all, member {good[0]} has {first[name]}"
            )

    def attributes(self) -> dict[str, Any]:
        """Attributes of the first member that did not fail."""
        good = next(i for i, error in enumerate(self.failures) if error is None)
        return {name: values[good] for name, values in self.attrs.items() if values[good] is not None}

    def _empty(self, variables: Variables) -> Variables:
        needed = float(self.count * sum(np.asarray(values).nbytes for _, values in variables.values()))
        check_bytes(needed, "member and times", f"{self.count} members, {needed / 1e9:.3g} GB of output")
        made: Variables = {}
        for name, (dims, values) in variables.items():
            first = np.asarray(values)
            kind = object if first.dtype.kind in "UO" else first.dtype
            made[name] = ("member", *dims), np.empty((self.count, *first.shape), kind)
        return made

    def fill_failed(self, i: int) -> None:
        """Fill the row of a member that failed."""
        for _, values in self.variables.values():
            values[i] = np.nan if values.dtype.kind == "f" else "" if values.dtype.kind == "O" else 0


def to_dataset(stack: MemberResults, scene: xr.Dataset, coords: Any) -> xr.Dataset:
    """Make a Dataset of stacked members, with the varied parameters of the scene as coordinates along ``member``.

    Numbers among the attributes that differ become variables; `coords` are shared by all.
    """
    variables, attrs, first = dict(stack.variables), {}, stack.attributes()
    for name, values in stack.attrs.items():
        present = [value for i, value in enumerate(values) if stack.failures[i] is None]
        if all(_same(value, present[0]) for value in present[1:]):
            attrs[name] = present[0]
        elif all(isinstance(value, int | float | np.number) or value is None for value in present):
            numbers = np.array([np.nan if value is None else float(value) for value in values])
            variables[name] = (("member",), numbers)
        elif name in ("title", "id", "history_json"):
            attrs[name] = first[name]
    if any(stack.failures):
        reasons = np.array([str(error or "") for error in stack.failures], dtype=object)
        variables["failure"] = (("member",), reasons)
    made = {
        name: (dims, values, {"units": ATTRIBUTE_UNITS.get(name, "1"), "long_name": name.replace("_", " ")})
        for name, (dims, values) in variables.items()
    }
    joined = label(xr.Dataset(made, coords=coords, attrs=attrs))
    varied = {
        str(name): variable.copy()
        for name, variable in scene.variables.items()
        if variable.dims == ("member",) and name != "member"
    }
    number = {"member": scene["member"].variable} if "member" in scene.coords else {}
    return joined.assign_coords({**varied, **number})


def _same(a: Any, b: Any) -> bool:
    return bool(np.array_equal(a, b)) if isinstance(a, np.ndarray) else a == b


def arrays_of(result: xr.Dataset) -> Variables:
    """Take the arrays of all variables out of a Dataset."""
    return {str(name): (cast(Any, item.dims), item.values) for name, item in result.variables.items()}


def labelled_like(stack: MemberResults, scene: xr.Dataset, first: xr.Dataset) -> xr.Dataset:
    """Join members as the Dataset of one of them tells coordinates from variables, and their attributes."""
    joined = to_dataset(stack, scene, _shared(stack, first))
    for name, variable in joined.variables.items():
        if name in first.variables:
            variable.attrs = dict(first.variables[name].attrs)
    return joined.set_coords([name for name in first.coords if name in joined.data_vars])


def _shared(stack: MemberResults, first: xr.Dataset) -> dict[str, Any]:
    """Take coordinates that all members have alike out of the stack."""
    rows = [i for i, error in enumerate(stack.failures) if error is None]
    shared = {}
    for name, coordinate in first.coords.items():
        values = stack.variables[str(name)][1]
        alike = all(np.array_equal(values[i], values[rows[0]]) for i in rows)
        if alike:
            del stack.variables[str(name)]
            shared[str(name)] = coordinate.variable
        elif name in first.dims:
            raise SceneError(f"members: they differ in {name}; allowed: members with the same {name}")
    return shared
