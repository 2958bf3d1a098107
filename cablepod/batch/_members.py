"""Scenes with several members: run side by side in threads, put together along ``member``.

Compiled loops let go of the interpreter, so that threads share the cores without copies.  A member that fails holds nan, its
reason is in the variable ``failure``, and the others go on.
"""

from __future__ import annotations

import functools
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._resources import cores
from cablepod.batch._pool import map_threads
from cablepod.batch._stack import MemberResults, Variables, arrays_of, labelled_like
from cablepod.errors import AllFailedError, MemberFailedWarning, RunStopped, StoppedError

F = TypeVar("F", bound=Callable[..., xr.Dataset])
#: Does the members from one number up to another at once: which of them it did, their variables and attributes, row by row.
RunChunk = Callable[[int, int], tuple[np.ndarray, Variables, Mapping[str, list[Any]]]]
#: Gives variables and attributes of a member.
RunMember = Callable[[int], tuple[Variables, Mapping[str, Any]]]
#: Makes the members from one number up to another ready, where that is faster together; calls what is given now and then, which
#: raises where the members are to stop.
PrepareChunk = Callable[[int, int, Callable[[], None]], None]


class BatchPlan(NamedTuple):
    """A faster way to run members than one Dataset after the other."""

    one: RunMember
    first: Callable[[], xr.Dataset]  #: the Dataset of one of the members that were run, as a single run gives it
    ahead: PrepareChunk = lambda *_: None


#: Members that a thread takes at once.
CHUNK = 16
_THREADS: ContextVar[int | None] = ContextVar("threads", default=None)
_STOP: ContextVar[Callable[[], bool] | None] = ContextVar("stop", default=None)


@contextmanager
def thread_limit(count: int) -> Iterator[None]:
    """Run members in so many threads, where more would compete with other workers."""
    token = _THREADS.set(count)
    try:
        yield
    finally:
        _THREADS.reset(token)


@contextmanager
def stop_when(stop: Callable[[], bool]) -> Iterator[None]:
    """Begin no further member once `stop` says so, but raise :class:`StoppedError`."""
    token = _STOP.set(stop)
    try:
        yield
    finally:
        _STOP.reset(token)


def run_members(
    one: RunMember,
    count: int,
    progress: Callable[[float], None] | None,
    many: RunChunk | None = None,
    ahead: PrepareChunk = lambda *_: None,
) -> MemberResults:
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
    stack, lock, stop, halted = MemberResults(count), threading.Lock(), _STOP.get(), threading.Event()

    def check() -> None:
        if halted.is_set() or (stop is not None and stop()):
            raise StoppedError

    def chunk(first: int) -> None:
        last = min(first + size, count)
        left = np.arange(first, last)
        if many is not None:
            check()
            did, variables, attrs = many(first, last)
            stack.store_chunk(first, did, variables, attrs)
            left = left[~did]
        ahead(first, last, check)
        for i in left.tolist():
            check()
            try:
                result = one(i)
            except (RunStopped, ValueError, ArithmeticError) as error:
                stack.failures[i] = error
            else:
                stack.store(i, *result)
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
        stack.fill_failed(i)
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
    map_threads(chunk, starts, workers, ended=halted.set)


def over_members(function: F) -> F:
    """Let a function of a scene take scenes with a dimension ``member``; the varied parameters become coordinates along it."""
    return over_members_by(lambda *_, **__: None)(function)


def over_members_by(plan: Callable[..., BatchPlan | None]) -> Callable[[F], F]:
    """Do the same as :func:`over_members` for a function of which `plan` knows a faster way.

    `plan` takes what the function takes but for its progress, and returns None where it does not cover what is asked for.
    """

    def decorator(function: F) -> F:
        @functools.wraps(function)
        def wrapper(scene: xr.Dataset, *args: Any, **options: Any) -> xr.Dataset:
            if not isinstance(scene, xr.Dataset) or "member" not in scene.dims:
                return function(scene, *args, **options)
            given = {name: value for name, value in options.items() if name != "progress"}
            one, first, ahead = plan(scene, *args, **given) or _member_by_member(function, scene, args, options)
            stack = run_members(one, scene.sizes["member"], options.get("progress"), ahead=ahead)
            return provenance.record(
                labelled_like(stack, scene, first()),
                function=provenance.public_name(function),
                parameters=given | values_of_members(scene),
                inputs=[scene, *(item for item in args if isinstance(item, xr.Dataset))],
            )

        return cast(F, wrapper)

    return decorator


def _member_by_member(function: F, scene: xr.Dataset, args: tuple[Any, ...], options: Mapping[str, Any]) -> BatchPlan:
    """Run each member as a scene of its own."""
    first: list[xr.Dataset] = []
    own = {**options, "progress": None} if "progress" in options else options

    def one(i: int) -> tuple[Variables, Mapping[str, Any]]:
        result = function(scene.isel(member=i, drop=True), *args, **own)
        first[:] = [result]
        return arrays_of(result), result.attrs

    return BatchPlan(one, lambda: first[0])


def values_of_members(scene: xr.Dataset) -> dict[str, Any]:
    """Values of all that differs between members of a scene that has no id, which make the identity of what comes of them."""
    if "values_sha256" in scene.attrs:
        return {}
    values = {str(name): variable.values for name, variable in scene.variables.items() if "member" in variable.dims}
    return {"members": values}
