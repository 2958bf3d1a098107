"""What all public functions do first: checks of options, the model of a scene, members one by one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from cablepod.batch._stack import MemberResults, arrays_of, labelled_like
from cablepod.conventions import INTERRUPTED
from cablepod.errors import RunStopped, SceneError, one_of, scene_error
from cablepod.integrate._request import check_progress
from cablepod.parameters._checks import truth
from cablepod.parameters._from_scene import Members
from cablepod.periodic._forcing import periodic_forcing
from cablepod.periodic._model import PeriodicModel


def given_names(key: str, given: Any, allowed: tuple[str, ...]) -> tuple[str, ...]:
    """Return names, one or several, as a tuple.

    Raises
    ------
    SceneError
        If one is none of the allowed ones.
    """
    if not isinstance(given, str | list | tuple):
        raise scene_error(key, given, f"some of {', '.join(allowed)}")
    names = (given,) if isinstance(given, str) else tuple(given)
    for name in names:
        if not isinstance(name, str) or name not in allowed:
            raise scene_error(key, name, one_of(allowed, name))
    return names


def model_of(
    scene: xr.Dataset, modes: xr.Dataset, *, rank: int | None, order: str, out_of_plane: bool
) -> tuple[PeriodicModel, float]:
    """Return the model of a scene of one member, and the angular frequency of its forcing [rad/s]."""
    truth("out_of_plane", out_of_plane)
    forcing = periodic_forcing(Members(scene)[0])
    return PeriodicModel.of(forcing, modes, rank=rank, order=order, out_of_plane=out_of_plane), forcing.omega


def rising(progress: Callable[[float], None] | None) -> Callable[[float], None]:
    """Return a callback that passes on completed fractions where they have grown; None to no callback."""
    check_progress(progress)
    told = 0.0

    def tell(share: float) -> None:
        nonlocal told
        if share > told:
            told = share
            if progress is not None:
                progress(share)

    return tell


def one_member(scene: xr.Dataset, function: str) -> None:
    """Refuse a scene with ``member``."""
    Members(scene)  # refuses what is no scene
    if "member" in scene.dims:
        raise SceneError(
            f"scene: given {scene.sizes['member']} members; allowed: one, scene.isel(member=0), as {function} follows branches"
        )


def each_member(
    scene: xr.Dataset,
    one: Callable[[xr.Dataset, Callable[[float], None]], xr.Dataset],
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Compute a scene, or each of its members one by one; `one` takes a scene and a callback of the completed fraction.

    `progress` is told the end unless Ctrl-C came before.

    Members that fail hold nan or no text, and their reason in ``failure``.  Lists of edges and harmonics are filled up to the
    longest one.  Numeric attributes that differ become variables along ``member``, instants that differ ``member_time (member,
    time)``.  After Ctrl-C the result has what was computed, and the attribute ``incomplete``.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C before anything was computed.
    """
    check_progress(progress)
    members, told = Members(scene), progress or (lambda share: None)
    result = _of_members(scene, members, one, told) if "member" in scene.dims else one(scene, told)
    if "incomplete" not in result.attrs:
        told(1.0)
    return result


def _of_members(
    scene: xr.Dataset,
    members: Members,
    one: Callable[[xr.Dataset, Callable[[float], None]], xr.Dataset],
    told: Callable[[float], None],
) -> xr.Dataset:
    """Do :func:`each_member` for a scene with ``member``."""
    results, failures, interrupted = _results(scene, len(members), one, told)
    found = _with_own_times(_of_equal_size([result for result in results if result is not None]))
    if not found and interrupted:
        raise KeyboardInterrupt
    if not found:
        raise SceneError(
            f"scene: given no member with a result ({failures[0]}); allowed: members with periodic responses"
        )
    stack, rest = MemberResults(len(members)), iter(found)
    for i, failure in enumerate(failures):
        if failure is None:
            result = next(rest)
            own = {name: value for name, value in result.attrs.items() if name not in (*result.variables, "incomplete")}
            stack.store(i, arrays_of(result), own)
    stack.failures = failures
    reasons = np.array(["" if failure is None else str(failure) for failure in failures])
    for i in np.flatnonzero(reasons).tolist():
        stack.fill_failed(i)
    labels = {"units": "1", "long_name": "reason why the member has no result"}
    failed: tuple[Any, ...] = ("member", reasons, labels)
    if "failure" in found[0]:  # of the points of a map
        dims, texts = stack.variables["failure"]
        failed = (
            dims,
            np.where(reasons[:, None, None], reasons[:, None, None], texts.astype(str)),
            found[0].failure.attrs,
        )
    joined = labelled_like(stack, scene, found[0]).assign(failure=failed)
    if "member" not in joined.coords:
        joined = joined.assign_coords(member=np.arange(len(members)))
    joined["member"].attrs.update(units="1", long_name="number of the member of an ensemble")
    if interrupted:
        joined.attrs["incomplete"] = 1
    return joined


def _results(
    scene: xr.Dataset,
    count: int,
    one: Callable[[xr.Dataset, Callable[[float], None]], xr.Dataset],
    told: Callable[[float], None],
) -> tuple[list[xr.Dataset | None], list[Exception | None], bool]:
    """Return results of members, reasons of those without one, and whether Ctrl-C came before the last of them was complete."""

    def share_of(i: int) -> Callable[[float], None]:
        return lambda share: told((i + share) / count)

    results: list[xr.Dataset | None] = []
    failures: list[Exception | None] = []
    interrupted = False
    for i in range(count):
        try:
            part = one(scene.isel(member=i), share_of(i))
            results.append(part)
            failures.append(None)
            interrupted = "incomplete" in part.attrs
            told((i + 1) / count)
        except (SceneError, RunStopped) as error:
            results.append(None)
            failures.append(error)
        except KeyboardInterrupt:
            interrupted = True
        if interrupted:
            break
    left = count - len(results)
    return [*results, *[None] * left], [*failures, *[RunStopped(INTERRUPTED)] * left], interrupted


def _of_equal_size(results: list[xr.Dataset]) -> list[xr.Dataset]:
    """Fill lists of edges up to the longest one, with nan and empty text, and harmonics with 0."""
    for dim, missing in (("edge", np.nan), ("harmonic", 0.0)):
        if not any(dim in result.dims for result in results):
            continue
        number = max((result[dim].values for result in results), key=np.size)
        along = {name: v.dtype.kind for name, v in results[0].data_vars.items() if dim in v.dims}
        fill = {name: "" if kind == "U" else missing for name, kind in along.items()}
        results = [result.reindex({dim: number}, fill_value=fill) for result in results]
    return results


def _with_own_times(results: list[xr.Dataset]) -> list[xr.Dataset]:
    """Replace instants that differ between members by the coordinate ``member_time``, over a dimension without labels.

    Those that differ by rounding are the first ones.
    """
    if not results or "time" not in results[0].coords:
        return results
    if all(np.allclose(result["time"], results[0]["time"], rtol=1e-12, atol=0.0) for result in results):
        return [result.assign_coords(time=results[0]["time"]) for result in results]
    return [
        result.drop_vars("time").assign_coords(member_time=("time", result["time"].values, result["time"].attrs))
        for result in results
    ]
