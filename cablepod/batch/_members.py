"""Run the members of a scene in threads and join their results along ``member``.

Compiled loops release the interpreter lock, so that threads share the cores without copies.  A failed member holds nan and its
reason in the variable ``failure``; the other members are not affected.
"""

from __future__ import annotations

import functools
import inspect
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import SCENE, Kind, taken
from cablepod._resources import cores, fits
from cablepod.batch._pool import map_threads
from cablepod.batch._stack import (
    MEMBER_AND_TIMES,
    MemberResults,
    Variables,
    arrays_of,
    bytes_of_member,
    check_members_fit,
    labelled_like,
)
from cablepod.errors import (
    AllFailedError,
    MemberFailedWarning,
    RunStopped,
    SceneError,
    StoppedError,
    scene_error,
    shown,
    warn,
)
from cablepod.parameters._parameters import count_instants

F = TypeVar("F", bound=Callable[..., xr.Dataset])
#: Makes a variable of a chunk from name, dimensions and shape of one member: its rows of the array of all members.
Rows = Callable[[str, tuple[str, ...], tuple[int, ...]], np.ndarray]
#: Runs members `first` ... `last - 1` in one call; returns a mask of those completed, their variables and attributes by row.
#: Large variables need no copy where they are filled in place, in rows that the third argument makes.
RunChunk = Callable[[int, int, Rows], tuple[np.ndarray, Variables, Mapping[str, list[Any]]]]
#: Runs one member; returns its variables and attributes.
RunMember = Callable[[int], tuple[Variables, Mapping[str, Any]]]
#: Prepares members `first` ... `last - 1` together; calls `check()` regularly, which raises StoppedError on cancellation.
PrepareChunk = Callable[[int, int, Callable[[], None]], None]


class BatchPlan(NamedTuple):
    """Functions that run the members of a batch."""

    run_member: RunMember
    first: Callable[[], xr.Dataset]  #: returns the Dataset of one completed member, as of a single run
    prepare_chunk: PrepareChunk = lambda *_: None
    lanes: int = 1  #: members that `prepare_chunk` advances abreast


#: Maximum number of members that a thread takes at once, one after the other or in groups of lanes: the work arrays of more
#: members are so large that the allocator returns them to the system after each chunk, and their pages are cleared anew.
CHUNK, CHUNK_OF_LANES = 16, 128
#: Numbers at an instant which the result of a member rarely exceeds: if memory holds so many, there is no need to know more.
NUMBERS_AT_AN_INSTANT = 4096
_THREADS: ContextVar[int | None] = ContextVar("threads", default=None)
_STOP: ContextVar[Callable[[], bool] | None] = ContextVar("stop", default=None)
_INSIDE: ContextVar[bool] = ContextVar("inside", default=False)


def thread_limit(count: int) -> AbstractContextManager[None]:
    """Limit the threads over members to `count`, so that they do not compete with other workers."""
    return _set_within(_THREADS, count)


def stop_when(stop: Callable[[], bool]) -> AbstractContextManager[None]:
    """Raise :class:`cablepod.errors.StoppedError` before the next member once `stop()` is true."""
    return _set_within(_STOP, stop)


def inside_members() -> bool:
    """Tell whether the caller runs a member of a scene."""
    return _INSIDE.get()


@contextmanager
def _set_within(variable: ContextVar[Any], value: Any) -> Iterator[None]:
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def run_members(
    run_member: RunMember,
    count: int,
    progress: Callable[[float], None] | None,
    run_chunk: RunChunk | None = None,
    prepare_chunk: PrepareChunk = lambda *_: None,
    lanes: int = 1,
) -> MemberResults:
    """Run all members in threads and collect their results.

    Parameters
    ----------
    run_member
        Runs one member; returns its variables and attributes.
    count
        Number of members.
    progress
        Callback receiving the completed fraction, 0 to 1.
    run_chunk
        Runs several members in one call; those not completed are left to `run_member`.
    prepare_chunk
        Prepares several members for `run_member`.
    lanes
        Number of members that `run_chunk` or `prepare_chunk` advances abreast.

    Raises
    ------
    Exception
        The exception of the first member if all fail; its cause is an :class:`cablepod.errors.AllFailedError`.
    StoppedError
        On cancellation by :func:`stop_when`.

    Warns
    -----
    MemberFailedWarning
        If some members fail.
    """
    stack, lock, stop, ended = MemberResults(count), threading.Lock(), _STOP.get(), threading.Event()

    def check() -> None:
        if ended.is_set() or (stop is not None and stop()):
            raise StoppedError

    def chunk(first: int) -> None:
        last = min(first + size, count)
        remaining = np.arange(first, last)
        if run_chunk is not None:
            check()
            completed, variables, attrs = run_chunk(first, last, functools.partial(stack.rows, first, last))
            stack.store_chunk(first, completed, variables, attrs)
            remaining = remaining[~completed]
        prepare_chunk(first, last, check)
        for i in remaining.tolist():
            check()
            try:
                with _set_within(_INSIDE, True), provenance.unrecorded():  # each thread has its own context
                    result = run_member(i)
            except (RunStopped, ValueError, ArithmeticError) as error:
                stack.failures[i] = error
            else:
                stack.store(i, *result)
        with lock:
            stack.done += last - first
            if progress is not None:
                progress(stack.done / count)

    workers = min(_THREADS.get() or cores(), count)
    size = _chunk_size(count, workers, lanes)
    _run_chunks(chunk, range(0, count, size), workers, ended)
    failed = [(i, error) for i, error in enumerate(stack.failures) if error is not None]
    if failed and len(failed) == count:
        raise failed[0][1] from AllFailedError([str(error) for _, error in failed])
    stack.check_shapes()
    for i, _ in failed:
        stack.fill_failed(i)
    if failed:
        warn(
            f"{len(failed)} of {count} members failed and hold nan, the first of them member {failed[0][0]}: "
            f"{failed[0][1]}; see the variable failure for each",
            MemberFailedWarning,
        )
    return stack


def _chunk_size(count: int, workers: int, lanes: int) -> int:
    """Return the number of members that a thread takes at once: about a quarter of its share, in full groups of lanes."""
    if lanes == 1:
        return max(1, min(CHUNK, count // (4 * workers)))
    return min(CHUNK_OF_LANES, -(-count // (4 * workers * lanes)) * lanes)


def _run_chunks(chunk: Callable[[int], None], starts: range, workers: int, ended: threading.Event) -> None:
    """Run all chunks, in threads if there are several workers; set `ended` at the end."""
    if workers == 1:
        for first in starts:
            chunk(first)
    else:
        map_threads(chunk, starts, workers, ended=ended.set)


def check_common_times(scene: xr.Dataset, times: Any) -> None:
    """Refuse members whose output times differ, as one coordinate ``time`` labels them all; `times` replaces those of the scene.

    Raises
    ------
    SceneError
        Names ``time.interval`` or ``time.duration``.
    """
    if times is not None or "time_interval" not in scene or "time_duration" not in scene:
        return
    columns = xr.broadcast(scene["time_interval"], scene["time_duration"])
    interval, duration = (np.atleast_1d(column.values).astype(float) for column in columns)
    valid = (interval > 0.0) & (duration >= 0.0) & np.isfinite(duration)  # others fail alone, with the reason
    interval, duration = interval[valid], duration[valid]
    counts = {count_instants(*pair) for pair in zip(duration.tolist(), interval.tolist(), strict=True)}
    for key, values, differ in (
        ("time.interval", interval, len(set(interval.tolist())) > 1),
        ("time.duration", duration, len(counts) > 1),
    ):
        if differ:
            given = f"{values.min():g} to {values.max():g} s in {scene.sizes['member']} members"
            raise SceneError(f"{key}: given {given}; allowed: one value for all members, or the option times")


def has_members(field: Any) -> bool:
    """Tell whether a field of wind, or a scene, is along ``member``."""
    return isinstance(field, xr.Dataset) and "member" in field.dims


def of_member(field: Any, i: int) -> Any:
    """Return what a member has of a field of wind, or of a scene: its own where it is along ``member``."""
    # not drop=True: parameters may be coordinates
    return field.isel(member=i).drop_vars("member", errors="ignore") if has_members(field) else field


def check_members_of_field(field: Any, scene: xr.Dataset) -> None:
    """Refuse a field of wind along ``member`` whose members are not those of the scene, in their order.

    Raises
    ------
    SceneError
        Names ``wind``.
    """
    if not has_members(field):
        return
    given, own = (data.get("member", np.arange(data.sizes["member"])) for data in (field, scene))
    if not np.array_equal(given, own):
        of_each = [np.asarray(labels).tolist() for labels in (given, own)]
        raise scene_error(
            "wind: member", of_each[0], f"those of the scene, {shown(of_each[1])}, or a field without member"
        )


def no_plan(*_: Any, **__: Any) -> None:
    """Run member by member, see :func:`over_members_by`."""


def over_members(function: F) -> F:
    """Decorate a function of one scene to accept the dimension ``member``; varied parameters become coordinates."""
    return over_members_by(no_plan)(function)


def over_members_by(
    plan: Callable[..., BatchPlan | None],
    check: Callable[[xr.Dataset], None] = lambda _: None,
    kind: Kind | Callable[[Any], Kind] = SCENE,
) -> Callable[[F], F]:
    """Make a decorator as :func:`over_members` with a faster `plan` for some scenes and options.

    `plan` takes the arguments of the function except `progress`, and returns None for scenes and options that it does not cover.
    `check` is called with a scene with members before the run; `kind` is what the scene may be, or tells it of a scene.
    """

    def decorator(function: F) -> F:
        has_times = "times" in inspect.signature(function).parameters

        @functools.wraps(function)
        def wrapper(scene: xr.Dataset, *args: Any, **options: Any) -> xr.Dataset:
            scene = taken("scene", scene, kind if isinstance(kind, Kind) else kind(scene))
            if "member" not in scene.dims:
                return function(scene, *args, **options)
            if has_times:
                check_common_times(scene, options.get("times"))
            check(scene)
            check_members_of_field(options.get("wind"), scene)
            if has_times and _THREADS.get() is None:  # an ensemble has looked at all its batches
                _check_memory(function, scene, args, options)
            given = {name: value for name, value in options.items() if name != "progress"}
            datasets = [value for value in (*args, *given.values()) if isinstance(value, xr.Dataset)]
            batch = plan(scene, *args, **given)
            if batch is None or has_members(options.get("wind")):
                batch = _member_by_member(function, scene, args, options)
            stack = run_members(
                batch.run_member, scene.sizes["member"], options.get("progress"), prepare_chunk=batch.prepare_chunk,
                lanes=batch.lanes,
            )  # fmt: skip
            return provenance.record(
                labelled_like(stack, scene, batch.first()),
                function=provenance.public_name(function),
                parameters={name: value for name, value in given.items() if not isinstance(value, xr.Dataset)},
                inputs=[scene, *datasets],
            )

        return cast(F, wrapper)

    return decorator


def _check_memory(function: F, scene: xr.Dataset, args: tuple[Any, ...], options: Mapping[str, Any]) -> None:
    """Refuse results that memory would not hold, by that of the first member at its start, before any member runs."""
    count, instants = scene.sizes["member"], number_of_instants(scene, options.get("times"))
    if fits(8.0 * count * instants * NUMBERS_AT_AN_INSTANT):
        return
    start = {name: value for name, value in options.items() if name != "window"} | {"times": [0.0]}
    plan = _member_by_member(function, scene, args, start)
    try:
        with warnings.catch_warnings(), _set_within(_INSIDE, True):
            warnings.simplefilter("ignore")
            plan.run_member(0)
    except (RunStopped, ValueError, ArithmeticError):
        return  # of this member, or of the options: the run says so
    check_members_fit(count * bytes_of_member(plan.first(), instants), MEMBER_AND_TIMES, f"{count} members")


def number_of_instants(scene: xr.Dataset, times: Any) -> int:
    """Return the number of output times of a scene, or of `times` that replace its own; 1 where it has none."""
    if times is not None or "time_interval" not in scene or "time_duration" not in scene:
        return 1 if times is None else np.size(times)
    duration, interval = (float(scene[name].values.flat[0]) for name in ("time_duration", "time_interval"))
    return count_instants(duration, interval) if interval > 0.0 and np.isfinite(duration) else 1


def _member_by_member(function: F, scene: xr.Dataset, args: tuple[Any, ...], options: Mapping[str, Any]) -> BatchPlan:
    """Make the plan that runs each member as a single scene."""
    first: list[xr.Dataset] = []
    single = {**options, "progress": None} if "progress" in options else options

    def run_member(i: int) -> tuple[Variables, Mapping[str, Any]]:
        own = {name: of_member(value, i) if name == "wind" else value for name, value in single.items()}
        result = function(of_member(scene, i), *args, **own)
        first[:] = [result]
        return arrays_of(result), result.attrs

    return BatchPlan(run_member, lambda: first[0])
