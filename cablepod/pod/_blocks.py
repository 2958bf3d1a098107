"""Snapshots read block by block, also from files."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import xarray as xr

from cablepod.batch._sigint import check_sigint, defer_sigint, wait_for_any
from cablepod.pod import _normal as pod_normal

#: Bytes of chunks that are computed together, and of the largest chunk that is computed while another is in use.
BLOCK, LARGEST = 1 << 24, 1 << 28
#: Bytes of the rows that are worked on at a time: they stay in the cache of a core.
CACHED = 3 << 18


def is_lazy(position: xr.DataArray) -> bool:
    """Tell whether `position` is held in chunks of which nothing has been computed."""
    return position.chunks is not None


def count_snapshots(position: xr.DataArray) -> int:
    """Return the number of snapshots in `position`."""
    return position.size // max(1, position.sizes["particle"] * position.sizes["coordinate"])


def read_blocks(position: xr.DataArray) -> Iterator[np.ndarray]:
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
            check_sigint()
            with defer_sigint():
                if coming is not None:
                    wait_for_any([coming])
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


def read_rows(
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
