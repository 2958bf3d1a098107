"""Scenes with several members: run side by side in threads, put together along ``member``.

Compiled loops let go of the interpreter, so that threads share the cores without copies.  A member that fails holds nan, its
reason is in the variable ``failure``, and the others go on.
"""

from __future__ import annotations

import functools
import os
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.batch import _sigint as interrupts
from cablepod.conventions import ATTRIBUTE_UNITS, label
from cablepod.integrate._stepping import RunStopped
from cablepod.parameters._parameters import check_bytes
from cablepod.parameters._schema import SceneError

F = TypeVar("F", bound=Callable[..., xr.Dataset])
#: Dimensions and values of a variable.
Arrays = dict[str, tuple[tuple[str, ...], Any]]
#: Does the members from one number up to another at once: which of them it did, their variables and attributes, row by row.
Many = Callable[[int, int], tuple[np.ndarray, Arrays, Mapping[str, list[Any]]]]
#: Gives variables and attributes of a member.
One = Callable[[int], tuple[Arrays, Mapping[str, Any]]]
#: Makes the members from one number up to another ready, where that is faster together; calls what is given now and then, which
#: raises where the members are to stop.
Ahead = Callable[[int, int, Callable[[], None]], None]


class Way(NamedTuple):
    """A faster way to run members than one Dataset after the other."""

    one: One
    first: Callable[[], xr.Dataset]  #: the Dataset of one of the members that were run, as a single run gives it
    ahead: Ahead = lambda *_: None


#: Members that a thread takes at once.
CHUNK = 16
_THREADS: ContextVar[int | None] = ContextVar("threads", default=None)
_STOP: ContextVar[Callable[[], bool] | None] = ContextVar("stop", default=None)


class MemberFailedWarning(UserWarning):
    """Some members failed; they hold nan, and the variable ``failure`` says why."""


class AllFailedError(Exception):
    """The cause of the error that is raised where all members fail; `reasons` has those of each."""

    def __init__(self, reasons: list[str]) -> None:
        super().__init__(f"all {len(reasons)} members failed")
        self.reasons = reasons


class StoppedError(Exception):
    """Members were stopped on demand, see :func:`until`."""


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Run members in so many threads, where more would compete with other workers."""
    token = _THREADS.set(count)
    try:
        yield
    finally:
        _THREADS.reset(token)


@contextmanager
def until(stop: Callable[[], bool]) -> Iterator[None]:
    """Begin no further member once `stop` says so, but raise :class:`StoppedError`."""
    token = _STOP.set(stop)
    try:
        yield
    finally:
        _STOP.reset(token)


def cores() -> int:
    """Count the processor cores that this process may use."""
    # where the system tells
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Stack:
    """Arrays with a row for each member, made from the first that arrives."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.variables: Arrays = {}
        self.attrs: dict[str, list[Any]] = {}
        self.failures: list[Exception | None] = [None] * count
        self.shapes: list[dict[str, tuple[int, ...]]] = [{}] * count
        self.done = 0
        self._lock = threading.Lock()

    def put(self, i: int, variables: Arrays, attrs: Mapping[str, Any]) -> None:
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

    def put_many(self, first: int, did: np.ndarray, variables: Arrays, attrs: Mapping[str, list[Any]]) -> None:
        """Keep what members from `first` on gave, those that `did`."""
        rows = np.flatnonzero(did)
        if not rows.size:
            return
        i = int(rows[0])
        self.put(
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

    def _empty(self, variables: Arrays) -> Arrays:
        needed = float(self.count * sum(np.asarray(values).nbytes for _, values in variables.values()))
        check_bytes(needed, "member and times", f"{self.count} members, {needed / 1e9:.3g} GB of output")
        made: Arrays = {}
        for name, (dims, values) in variables.items():
            first = np.asarray(values)
            kind = object if first.dtype.kind in "UO" else first.dtype
            made[name] = ("member", *dims), np.empty((self.count, *first.shape), kind)
        return made

    def blank(self, i: int) -> None:
        """Fill the row of a member that failed."""
        for _, values in self.variables.values():
            values[i] = np.nan if values.dtype.kind == "f" else "" if values.dtype.kind == "O" else 0


def gather(
    one: One,
    count: int,
    progress: Callable[[float], None] | None,
    many: Many | None = None,
    ahead: Ahead = lambda *_: None,
) -> Stack:
    """Run all members and stack what they give.

    Parameters
    ----------
    one
        Gives variables and attributes of a member.
    count
        Number of members.
    progress
        Called with the part that is done.
    many
        Does several at once, where there is a faster way; those that it did not are left to `one`.
    ahead
        Makes several ready for `one`.

    Raises
    ------
    Exception
        What the first member raised, where all fail; its cause is an :class:`AllFailedError`.
    StoppedError
        Where :func:`until` asks for it.

    Warns
    -----
    MemberFailedWarning
        Where some fail.
    """
    stack, lock, stop, halted = Stack(count), threading.Lock(), _STOP.get(), threading.Event()

    def check() -> None:
        if halted.is_set() or (stop is not None and stop()):
            raise StoppedError

    def chunk(first: int) -> None:
        last = min(first + size, count)
        left = np.arange(first, last)
        if many is not None:
            check()
            did, variables, attrs = many(first, last)
            stack.put_many(first, did, variables, attrs)
            left = left[~did]
        ahead(first, last, check)
        for i in left.tolist():
            check()
            try:
                result = one(i)
            except (RunStopped, ValueError, ArithmeticError) as error:
                stack.failures[i] = error
            else:
                stack.put(i, *result)
        with lock:
            stack.done += last - first
            if progress is not None:
                progress(stack.done / count)

    workers = min(_THREADS.get() or cores(), count)
    size = max(1, min(CHUNK, count // (4 * workers)))
    _side_by_side(chunk, range(0, count, size), workers, halted)
    failed = [(i, error) for i, error in enumerate(stack.failures) if error is not None]
    if failed and len(failed) == count:
        raise failed[0][1] from AllFailedError([str(error) for _, error in failed])
    stack.check_shapes()
    for i, _ in failed:
        stack.blank(i)
    if failed:
        warnings.warn(
            f"{len(failed)} of {count} members failed and hold nan, the first of them member {failed[0][0]}: "
            f"{failed[0][1]}; see the variable failure for each",
            MemberFailedWarning,
            stacklevel=4,
        )
    return stack


def _side_by_side(chunk: Callable[[int], None], starts: range, workers: int, halted: threading.Event) -> None:
    if workers == 1:
        for first in starts:
            chunk(first)
        return
    interrupts.over(chunk, starts, workers, ended=halted.set)


def join(stack: Stack, scene: xr.Dataset, coords: Any) -> xr.Dataset:
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


def over_members(function: F) -> F:
    """Let a function of a scene take scenes with a dimension ``member``; the varied parameters become coordinates along it."""
    return in_one_go(lambda *_, **__: None)(function)


def in_one_go(plan: Callable[..., Way | None]) -> Callable[[F], F]:
    """Do the same as :func:`over_members` for a function of which `plan` knows a faster way.

    `plan` takes what the function takes but for its progress, and returns None where it does not cover what is asked for.
    """

    def decorator(function: F) -> F:
        @functools.wraps(function)
        def wrapper(scene: xr.Dataset, *args: Any, **options: Any) -> xr.Dataset:
            if not isinstance(scene, xr.Dataset) or "member" not in scene.dims:
                return function(scene, *args, **options)
            given = {name: value for name, value in options.items() if name != "progress"}
            one, first, ahead = plan(scene, *args, **given) or _one_by_one(function, scene, args, options)
            stack = gather(one, scene.sizes["member"], options.get("progress"), ahead=ahead)
            return provenance.record(
                _labelled(stack, scene, first()),
                function=provenance.public_name(function),
                parameters=given | unnamed_values(scene),
                inputs=[scene, *(item for item in args if isinstance(item, xr.Dataset))],
            )

        return cast(F, wrapper)

    return decorator


def _one_by_one(function: F, scene: xr.Dataset, args: tuple[Any, ...], options: Mapping[str, Any]) -> Way:
    """Run each member as a scene of its own."""
    first: list[xr.Dataset] = []
    own = {**options, "progress": None} if "progress" in options else options

    def one(i: int) -> tuple[Arrays, Mapping[str, Any]]:
        result = function(scene.isel(member=i, drop=True), *args, **own)
        first[:] = [result]
        return arrays_of(result), result.attrs

    return Way(one, lambda: first[0])


def arrays_of(result: xr.Dataset) -> Arrays:
    """Take the arrays of all variables out of a Dataset."""
    return {str(name): (cast(Any, item.dims), item.values) for name, item in result.variables.items()}


def _labelled(stack: Stack, scene: xr.Dataset, first: xr.Dataset) -> xr.Dataset:
    """Join members as the Dataset of one of them tells coordinates from variables, and their attributes."""
    joined = join(stack, scene, _shared(stack, first))
    for name, variable in joined.variables.items():
        if name in first.variables:
            variable.attrs = dict(first.variables[name].attrs)
    return joined.set_coords([name for name in first.coords if name in joined.data_vars])


def unnamed_values(scene: xr.Dataset) -> dict[str, Any]:
    """Values of all that differs between members of a scene that has no id, which make the identity of what comes of them."""
    if "values_sha256" in scene.attrs:
        return {}
    values = {str(name): variable.values for name, variable in scene.variables.items() if "member" in variable.dims}
    return {"members": values}


def _shared(stack: Stack, first: xr.Dataset) -> dict[str, Any]:
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
