"""Snapshots: their form, what is left of them when the straight line between the ends is taken off, and how they are read.

Positions come in blocks, whether they lie in memory or in files.  A block is read while the one before is worked on, so that the
disk and the arithmetic wait for each other as little as possible.  Blocks are so small that the allocator hands the same memory
out again and again.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import xarray as xr

from cablepod.batch import _sigint as interrupts
from cablepod.parameters._schema import SceneError
from cablepod.pod import _normal as pod_normal

#: Bytes of chunks that are computed together, and of the largest chunk that is computed while another is in use.
BLOCK, LARGEST = 1 << 24, 1 << 28
#: Bytes of the rows that are worked on at a time: they stay in the cache of a core.
CACHED = 3 << 18


def arc_length(snapshots: xr.Dataset) -> np.ndarray:
    """Return the arc length (particle) [m], of the first member where there are several."""
    s = snapshots.variables["arc_length"]  # a tenth of the time that a DataArray takes
    return s.values if s.ndim == 1 else s.transpose("particle", ...).values.reshape(s.sizes["particle"], -1)[:, 0]


def relative_arc_length(dataset: xr.Dataset) -> np.ndarray:
    """Return sigma = S / L0 of the particles, from 0 to 1."""
    s = arc_length(dataset)
    return s / s[-1]


def shares(sigma: np.ndarray) -> np.ndarray:
    """Return the length that each particle carries, scaled to mean 1 over the inner particles."""
    step = np.diff(sigma)
    share = 0.5 * np.concatenate([step[:1], step[:-1] + step[1:], step[-1:]])
    return share / share[1:-1].mean()


def weight_roots(sigma: np.ndarray, weights: str | None) -> np.ndarray:
    """Return the roots of the weights of the inner particles."""
    return np.ones(sigma.size - 2) if weights is None else np.sqrt(shares(sigma)[1:-1])


def position_of(snapshots: xr.Dataset) -> xr.DataArray:
    """Return the positions, which may be lazy, after a look at their form."""
    if "position" not in snapshots or "arc_length" not in snapshots.variables:
        raise SceneError("snapshots: given a Dataset without position or arc_length; allowed: a trajectory")
    position = snapshots["position"]
    for name in ("time", "particle", "coordinate"):
        if name not in position.dims:
            raise SceneError(f"snapshots: position lacks the dimension {name}; allowed: (time, particle, coordinate)")
    if position.sizes["particle"] < 3:
        raise SceneError(
            f"snapshots: given {position.sizes['particle']} particles; allowed: at least 3, because modes vanish at both ends"
        )
    _check_members(snapshots["arc_length"])
    return position


def _check_members(lengths: xr.DataArray) -> None:
    """Refuse members whose particles lie at different S / L0: their rows cannot stand in one matrix."""
    if lengths.ndim == 1:
        return
    lead = [name for name in lengths.dims if name != "particle"]
    s = lengths.transpose(*lead, "particle").values.reshape(-1, lengths.sizes["particle"])
    names = lengths[lead[0]].values if len(lead) == 1 else np.arange(len(s))
    # members of unlike shapes that xarray has joined are filled up with what is not a number
    there = np.isfinite(s).sum(axis=1)
    if there.min(initial=s.shape[1]) < s.shape[1]:
        kinds = [f"{number} particles in {_some(names[there == number])}" for number in np.unique(there)]
        raise SceneError(f"snapshots: given members with {', '.join(kinds)}; allowed: the same particles in all")
    sigma = s / s[:, -1:]
    other = np.abs(sigma - sigma[0]).max(axis=1) > 1e-9
    if other.any():
        raise SceneError(
            "snapshots: given members whose particles lie at different S / L0, from the first one differ "
            f"{_some(names[other])}; allowed: the same particles in all"
        )


def check_alike(parts: Sequence[xr.Dataset]) -> None:
    """Refuse trajectories of different particles or coordinates, naming them by their place."""
    if not parts:
        raise SceneError("snapshots: given no trajectory; allowed: at least one")
    if len(parts) == 1:
        return
    lines = [position_of(part).sizes["particle"] for part in parts]
    if len(set(lines)) > 1:
        places = np.arange(len(parts))
        kinds = [f"{number} particles in {_some(places[np.equal(lines, number)])}" for number in sorted(set(lines))]
        raise SceneError(f"snapshots: given trajectories with {', '.join(kinds)}; allowed: the same particles in all")
    first = parts[0]
    other = [
        place
        for place, part in enumerate(parts)
        if np.abs(relative_arc_length(part) - relative_arc_length(first)).max() > 1e-9
        or list(part["coordinate"].values) != list(first["coordinate"].values)
    ]
    if other:
        raise SceneError(
            "snapshots: given trajectories whose particles lie at different S / L0, or of other coordinates, from the first one "
            f"differ {_some(np.array(other))}; allowed: the same in all"
        )


def _some(names: np.ndarray) -> str:
    """Name the first five."""
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return str(names[:5].tolist()) + more


def broken_member(position: xr.DataArray) -> str:
    """Return words for the first member whose positions are not finite; nothing where there are no members."""
    if "member" not in position.dims:
        return ""
    names = position["member"].values
    for number, name in enumerate(names):
        if not all(np.isfinite(block).all() for block in blocks(position.isel(member=number))):
            return f" in member {name}"
    return ""


def positions(snapshots: xr.Dataset) -> np.ndarray:
    """Return the positions (samples, particle, coordinate) [m], all further dimensions counted as samples.

    Raises
    ------
    SceneError
        Where positions are missing or not finite.
    """
    position = position_of(snapshots).transpose(..., "time", "particle", "coordinate").values
    position = position.reshape(-1, *position.shape[-2:]).astype(float)
    if not np.isfinite(position).all():
        where = broken_member(snapshots["position"])
        raise SceneError(f"snapshots: position is not finite everywhere{where}; allowed: finite numbers")
    return position


def lift(snapshots: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Take the straight line between the ends off the positions, eq. (35).

    Returns
    -------
    tuple
        Lifted positions (samples, particle, coordinate) and positions of the ends (samples, 2, coordinate) [m].
    """
    position = positions(snapshots)
    sigma = relative_arc_length(snapshots)[None, :, None]
    ends = position[:, (0, -1)]
    return position - (1.0 - sigma) * ends[:, :1] - sigma * ends[:, 1:], ends


def is_lazy(position: xr.DataArray) -> bool:
    """Tell whether `position` is held in chunks of which nothing has been computed."""
    return position.chunks is not None


def count(position: xr.DataArray) -> int:
    """Return the number of snapshots in `position`."""
    return position.size // max(1, position.sizes["particle"] * position.sizes["coordinate"])


def blocks(position: xr.DataArray) -> Iterator[np.ndarray]:
    """Yield `position` as arrays (samples, particle, coordinate) [m] in memory, in the order of its chunks where it has some."""
    position = position.transpose(..., "time", "particle", "coordinate")
    shape = position.shape[-2:]
    if not is_lazy(position):
        yield position.values.reshape(-1, *shape)
        return
    jobs, ahead = _jobs(position.data.rechunk({position.ndim - 2: -1, position.ndim - 1: -1}))
    with ThreadPoolExecutor(1, thread_name_prefix="cablepod-read") as executor:
        coming = None
        for number in range(len(jobs)):
            interrupts.check()
            with interrupts.held():
                if coming is not None:
                    interrupts.wait([coming])
                ready = coming.result() if coming is not None else jobs[number]()
                more = ahead and number + 1 < len(jobs)
                coming = executor.submit(jobs[number + 1]) if more else None
            while ready:  # what has been used may go
                yield np.asarray(ready.pop(0)).reshape(-1, *shape)


def _jobs(data: Any) -> tuple[list[Callable[[], list[np.ndarray]]], bool]:
    """Return calls that give the chunks of a dask array, some at a time, and whether to make one ahead of its need.

    Slices of the array would be optimised as a whole graph each time, which for thousands of chunks takes longer than to read
    them; so the graph is optimised once, and its tasks are picked out.  Where chunks are no more than ranges of something that
    can be sliced, as a variable in a file is, that is sliced itself: small chunks in one piece, large ones in several.
    """
    import dask
    from dask.base import get_scheduler
    from dask.optimization import cull

    largest = data.dtype.itemsize * math.prod(max(sizes) for sizes in data.chunks)
    get = get_scheduler()
    graph = dict(data.__dask_graph__())
    sources = [_source(graph, (data.name, *index)) for index in np.ndindex(*data.numblocks)]
    if get is None and all(source is not None for source in sources):
        row = data.dtype.itemsize * math.prod(data.shape[1:])
        pieces = _ranges(sources, max(1, BLOCK // row))
        if row > BLOCK and data.ndim > 3:  # members so long that they are cut in time
            most = max(1, BLOCK // (row // data.shape[1]))
            pieces = (piece for source, region in pieces for piece in _cut(source, region, most))
        return [functools.partial(_sliced, *item) for item in pieces], True
    get = get or dask.get
    (data,) = dask.optimize(data)
    graph = dict(data.__dask_graph__())
    keys = [(data.name, *index) for index in np.ndindex(*data.numblocks)]
    together = max(1, BLOCK // max(1, largest))
    groups = [keys[i : i + together] for i in range(0, len(keys), together)]
    return [functools.partial(_computed, get, cull, graph, group) for group in groups], largest <= LARGEST


def _computed(get: Callable[..., Any], cull: Callable[..., Any], graph: dict[Any, Any], group: list[Any]) -> list[Any]:
    return list(get(cull(graph, group)[0], group))


def _sliced(source: Any, region: tuple[slice, ...]) -> list[np.ndarray]:
    return [np.asarray(source[region])]


def _source(graph: dict[Any, Any], key: Any) -> tuple[Any, tuple[slice, ...]] | None:
    """Return what chunk `key` is a range of, and the range; None where it is anything else, as a computed one."""
    task = graph.get(key)
    while isinstance(task, tuple) or hasattr(task, "target"):  # another name, as of the parts of what is joined
        task = graph.get(getattr(task, "target", task))
    args: Any = getattr(task, "args", ())
    func = getattr(task, "func", None)
    if getattr(func, "__name__", "") != "getter" or len(args) != 2 or getattr(task, "kwargs", None):
        return None
    source = graph.get(getattr(args[0], "key", None))
    source, region = getattr(source, "value", source), getattr(args[1], "value", args[1])
    if source is None or not isinstance(region, tuple):
        return None
    plain = all(isinstance(item, slice) and item.step in (None, 1) for item in region)
    return (source, region) if plain else None


def _ranges(sources: list[Any], most: int) -> Iterator[tuple[Any, tuple[slice, ...]]]:
    """Join ranges that follow one another along the first dimension, and cut them again into `most` of its rows."""
    start = 0
    while start < len(sources):
        source, (first, *others) = sources[start]
        stop, end = start + 1, first.stop
        while stop < len(sources) and sources[stop][0] is source:
            then, *rest = sources[stop][1]
            if rest != others or then.start != end:
                break
            end, stop = then.stop, stop + 1
        size = first.stop - first.start
        step = most // size * size or most  # along the chunks, where they are small
        for low in range(first.start, end, step):
            yield source, (slice(low, min(end, low + step)), *others)
        start = stop


def _cut(source: Any, region: tuple[slice, ...], most: int) -> Iterator[tuple[Any, tuple[slice, ...]]]:
    """Cut a range into `most` along the second dimension."""
    first, second, *others = region
    for low in range(second.start, second.stop, most):
        yield source, (first, slice(low, min(second.stop, low + most)), *others)


def rows(
    position: np.ndarray, sigma: np.ndarray, root: np.ndarray | None, layout: str, reference: int | None = None
) -> Iterator[np.ndarray]:
    """Yield lifted snapshots, eq. (35), as rows of inner particles, a few thousand numbers at a time.

    Parameters
    ----------
    position
        (samples, particle, coordinate) [m].
    sigma
        S / L0 of the particles.
    root
        Roots of the weights of the inner particles; None for ones.
    layout
        "separate" yields arrays (coordinate, samples, particle), "vector" (1, samples, coordinate * particle), coordinate
        by coordinate; "normal" (normals, samples, particle), deflections normal to the chord.
    reference
        The axis that tells the normals apart in space, see :class:`cablepod.discretisation._chord_frame.Frame`.
    """
    samples, particles, dims = position.shape
    inner = particles - 2
    lines = np.stack([1.0 - sigma[1:-1], sigma[1:-1]])
    step = max(64, CACHED // (8 * inner * (dims if layout == "vector" else 1)))
    for start in range(0, samples, step):
        part = position[start : start + step]
        if layout == "normal":
            if not np.isfinite(part[:, (0, -1)]).all():
                raise FloatingPointError("ends are not finite")
            hat = pod_normal.deflections(part.astype(float, copy=False), reference)[:, :, 1:-1]
            yield np.multiply(hat, 1.0 if root is None else root, order="C")
            continue
        # one product for all coordinates, in the order in which they are wanted
        order = (2, 0, 1) if layout == "separate" else (0, 2, 1)
        ends, inside = (item.astype(float, copy=False).transpose(order) for item in (part[:, (0, -1)], part[:, 1:-1]))
        hat = (ends.reshape(-1, 2) @ lines).reshape(inside.shape)
        np.subtract(inside, hat, out=hat)
        if root is not None:
            hat *= root
        yield hat if layout == "separate" else hat.reshape(1, len(part), -1)
