"""Collect the results of members and join them along ``member``."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from types import NoneType
from typing import Any, cast

import numpy as np
import xarray as xr

from cablepod._resources import check_bytes
from cablepod.conventions import AIR_OF_EACH, attribute_labels, label
from cablepod.errors import SceneError

#: What to change where memory does not hold the results of all members.
MEMBER_AND_TIMES = "member and times"
#: Dimensions and values of a variable.
Variables = dict[str, tuple[tuple[str, ...], Any]]


class MemberResults:
    """Arrays with a row for each member, allocated when the first result is stored."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.variables: Variables = {}
        self.attrs: dict[str, list[Any]] = {}
        self.failures: list[Exception | None] = [None] * count
        self.shapes: list[dict[str, tuple[int, ...]]] = [{}] * count
        self.done = 0
        self._first_with: dict[tuple[str, ...], int] = {}  # first member with these attributes
        self._lock = threading.Lock()

    def rows(self, first: int, last: int, name: str, dims: tuple[str, ...], shape: tuple[int, ...]) -> np.ndarray:
        """Return the rows of the members `first` ... `last - 1` of a variable of numbers, to be filled."""
        with self._lock:
            if name not in self.variables:
                self._allocate({name: (dims, np.broadcast_to(0.0, shape))})
        return self.variables[name][1][first:last]

    def store(self, i: int, variables: Variables, attrs: Mapping[str, Any]) -> None:
        """Store the result of member `i`."""
        if not variables.keys() <= self.variables.keys():
            with self._lock:
                self._allocate({name: entry for name, entry in variables.items() if name not in self.variables})
        self.shapes[i] = {name: np.shape(values) for name, (_, values) in variables.items()}
        for name, (_, values) in variables.items():
            if self.variables[name][1].shape[1:] == self.shapes[i][name]:
                self.variables[name][1][i] = values
        with self._lock:
            names = tuple(attrs)
            self._first_with[names] = min(i, self._first_with.get(names, i))
            for name, value in attrs.items():
                self.attrs.setdefault(name, [None] * self.count)[i] = value

    def store_chunk(
        self, first: int, completed: np.ndarray, variables: Variables, attrs: Mapping[str, list[Any]]
    ) -> None:
        """Store the results of members from `first` on, those of the mask `completed`."""
        rows = np.flatnonzero(completed)
        if not rows.size:
            return
        i = int(rows[0])
        self.store(
            first + i,
            {name: (dims, values[i]) for name, (dims, values) in variables.items()},
            {name: values[i] for name, values in attrs.items()},
        )
        for name, (_, values) in variables.items():
            target = self.variables[name][1][first : first + completed.size]
            if not np.may_share_memory(values, target):  # others are filled in place
                target[rows] = values[rows]
        for row in rows.tolist():
            self.shapes[first + row] = self.shapes[first + i]
        for name, column in attrs.items():
            for row in rows.tolist():
                self.attrs[name][first + row] = column[row]

    def check_shapes(self) -> None:
        """Refuse members whose arrays differ in shape from those of the first successful member."""
        successful = [i for i, error in enumerate(self.failures) if error is None]
        first = self.shapes[successful[0]]
        different = [i for i in successful if self.shapes[i] != first]
        if different:
            other = self.shapes[different[0]]
            name = next(name for name in first | other if other.get(name) != first.get(name))
            dims = ", ".join(self.variables[name][0][1:])
            raise SceneError(
                f"member {different[0]} (and {len(different) - 1} more): given {name} ({dims}) of shape "
                f"{other.get(name)}; allowed: one shape for all, member {successful[0]} has {first.get(name)}"
            )

    @property
    def attribute_names(self) -> list[str]:
        """Names of all attributes in the order of the members, whichever of them ended first."""
        return list(
            dict.fromkeys(
                name for names in sorted(self._first_with, key=self._first_with.__getitem__) for name in names
            )
        )

    def attributes(self) -> dict[str, Any]:
        """Return the attributes of the first successful member."""
        first = next(i for i, error in enumerate(self.failures) if error is None)
        return {name: self.attrs[name][first] for name in self.attribute_names if self.attrs[name][first] is not None}

    def _allocate(self, variables: Variables) -> None:
        """Allocate arrays for all members, shaped as the variables of one."""
        allocated = sum(values.nbytes for _, values in self.variables.values())
        needed = float(allocated + self.count * sum(np.asarray(values).nbytes for _, values in variables.values()))
        check_members_fit(needed, MEMBER_AND_TIMES, f"{self.count} members")
        arrays: Variables = {}
        for name, (dims, values) in variables.items():
            first = np.asarray(values)
            dtype = object if first.dtype.kind in "UO" else first.dtype
            arrays[name] = ("member", *dims), np.empty((self.count, *first.shape), dtype)
        self.variables |= arrays

    def fill_failed(self, i: int) -> None:
        """Fill the row of a failed member with nan, zero or empty text."""
        for _, values in self.variables.values():
            values[i] = blank(values.dtype)


def blank(dtype: np.dtype) -> Any:
    """Return what a failed member holds in an array: nan, an empty text, or zero."""
    return np.nan if dtype.kind == "f" else "" if dtype.kind in "OU" else 0


def to_dataset(stack: MemberResults, scene: xr.Dataset, coords: Any) -> xr.Dataset:
    """Make a Dataset of all members, with the varied parameters of the scene as coordinates along ``member``.

    Numeric attributes that differ between members become variables, and so does the scheme; `coords` are shared by all members.
    """
    variables, attrs, first = dict(stack.variables), {}, stack.attributes()
    successful = [i for i, error in enumerate(stack.failures) if error is None] if any(stack.failures) else None
    for name in stack.attribute_names:
        values = stack.attrs[name]
        present = values if successful is None else [values[i] for i in successful]
        if _all_same(present):
            attrs[name] = present[0]
        elif all(issubclass(kind, int | float | np.number | NoneType) for kind in set(map(type, present))):
            numbers = np.array([np.nan if value is None else float(value) for value in values])
            variables[name] = (("member",), numbers)
        elif name == "scheme":
            variables[name] = (("member",), np.array([value or "" for value in values], dtype=object))
        elif name in ("title", "id", "history_json"):
            attrs[name] = first[name]
        elif name == "air":
            attrs[name] = AIR_OF_EACH
    if any(stack.failures):
        reasons = np.array([str(error or "") for error in stack.failures], dtype=object)
        variables["failure"] = (("member",), reasons)
    labelled = {name: (dims, values, attribute_labels(name)) for name, (dims, values) in variables.items()}
    joined = label(xr.Dataset(labelled, coords=coords, attrs=attrs))
    varied = {
        str(name): variable.copy()
        for name, variable in scene.variables.items()
        if name != "member" and is_varied(variable)
    }
    number = {"member": scene["member"].variable} if "member" in scene.coords else {}
    return joined.assign_coords({**varied, **number})


def bytes_of_member(start: xr.Dataset, instants: int) -> float:
    """Return the size of the result of a member at so many instants [bytes], by its result at the start alone."""
    longer = instants / max(start.sizes.get("time", 1), 1)  # a model of one's own may give all its instants
    return float(sum(item.nbytes * (longer if "time" in item.dims else 1.0) for item in start.variables.values()))


def check_members_fit(needed: float, key: str, given: str) -> None:
    """Refuse results of members of so many bytes that memory would not hold them.

    Raises
    ------
    SceneError
        Names `key`, with the members that are `given`.
    """
    check_bytes(needed, key, f"{given}, {needed / 1e9:.3g} GB of output")


def is_varied(variable: xr.Variable) -> bool:
    """Tell whether a variable of scenes is a number or text of each member, or a list of numbers that is no vector."""
    return variable.dims == ("member",) or (
        variable.ndim == 2 and variable.dims[0] == "member" and str(variable.dims[1]).endswith("_item")
    )


def _all_same(values: list[Any]) -> bool:
    """Return whether all values equal the first, which nan does not."""
    first = values[0]
    if any(issubclass(kind, np.ndarray) for kind in set(map(type, values))):
        return all(np.array_equal(value, first) for value in values[1:])
    return values.count(first) == len(values) and (len(values) == 1 or bool(first == first))


def arrays_of(result: xr.Dataset) -> Variables:
    """Return dimensions and values of all variables of a Dataset."""
    return {str(name): (cast(Any, variable.dims), variable.values) for name, variable in result.variables.items()}


def labelled_like(stack: MemberResults, scene: xr.Dataset, first: xr.Dataset) -> xr.Dataset:
    """Make a Dataset of all members, labelled as the Dataset `first` of one of them."""
    joined = to_dataset(stack, scene, _shared(stack, first))
    for name, variable in joined.variables.items():
        if name in first.variables:
            variable.attrs = dict(first.variables[name].attrs)
    return joined.set_coords([name for name in first.coords if name in joined.data_vars])


def _shared(stack: MemberResults, first: xr.Dataset) -> dict[str, Any]:
    """Return the coordinates that are equal in all members, and remove them from the stack."""
    rows = [i for i, error in enumerate(stack.failures) if error is None]
    shared = {}
    for name, coordinate in first.coords.items():
        values = stack.variables[str(name)][1]
        if all(np.array_equal(values[i], values[rows[0]]) for i in rows):
            del stack.variables[str(name)]
            shared[str(name)] = coordinate.variable
        elif name in first.dims:
            raise SceneError(f"members: they differ in {name}; allowed: members with the same {name}")
    return shared
