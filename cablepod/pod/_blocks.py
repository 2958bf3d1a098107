"""Read snapshots block by block, from memory or from files."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import xarray as xr

from cablepod._inputs import floats
from cablepod._resources import check_sigint, defer_sigint, wait_for_any
from cablepod.discretisation._lifting import weights_of_ends
from cablepod.pod import _normal as pod_normal

#: Maximum bytes of chunks read in one call, and of a chunk read ahead while the previous one is in use.
BLOCK_BYTES, MAX_AHEAD_BYTES = 1 << 24, 1 << 28
#: Maximum bytes of the rows processed at a time (they fit in the cache of a core).
CACHE_BYTES = 3 << 18


def is_lazy(position: xr.DataArray) -> bool:
    """Tell whether `position` is a dask array."""
    return position.chunks is not None


def count_snapshots(position: xr.DataArray) -> int:
    """Return the number of snapshots in `position`."""
    return position.size // max(1, position.sizes["particle"] * position.sizes["coordinate"])


def read_blocks(position: xr.DataArray) -> Iterator[np.ndarray]:
    """Yield `position` as arrays (samples, particle, coordinate) [m] in memory, in the order of its chunks."""
    position = position.transpose(..., "time", "particle", "coordinate")
    shape = position.shape[-2:]
    if not is_lazy(position):
        yield floats(position.values.reshape(-1, *shape))
        return
    readers, ahead = _readers(position.data.rechunk({position.ndim - 2: -1, position.ndim - 1: -1}))
    with ThreadPoolExecutor(1, thread_name_prefix="cablepod-read") as executor:
        future = None
        for number in range(len(readers)):
            check_sigint()
            with defer_sigint():
                if future is not None:
                    wait_for_any([future])
                chunks = future.result() if future is not None else readers[number]()
                more = ahead and number + 1 < len(readers)
                future = executor.submit(readers[number + 1]) if more else None
            while chunks:  # pop: a chunk is freed after use
                yield floats(chunks.pop(0)).reshape(-1, *shape)


def _readers(data: Any) -> tuple[list[Callable[[], list[np.ndarray]]], bool]:
    """Return functions that read chunks of a dask array in order, and whether to read one call ahead.

    Computing slices of the array would optimise the whole graph each time, which for thousands of chunks takes longer than
    reading them.  The graph is therefore optimised once, and its tasks are computed one by one.  Chunks that are plain ranges of
    a sliceable source, such as a variable of a file, are read from the source: small chunks together, large ones in parts.
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
        ranges = _merge_ranges(sources, max(1, BLOCK_BYTES // row))
        if row > BLOCK_BYTES and data.ndim > 3:  # one member exceeds a block: split it along time
            max_rows = max(1, BLOCK_BYTES // (row // data.shape[1]))
            ranges = (part for source, region in ranges for part in _split_second(source, region, max_rows))
        return [functools.partial(_read_range, source, region) for source, region in ranges], True
    get = get or dask.get
    (data,) = dask.optimize(data)
    graph = dict(data.__dask_graph__())
    keys = [(data.name, *index) for index in np.ndindex(*data.numblocks)]
    per_call = max(1, BLOCK_BYTES // max(1, largest))
    groups = [keys[i : i + per_call] for i in range(0, len(keys), per_call)]
    return [functools.partial(_compute_chunks, get, cull, graph, group) for group in groups], largest <= MAX_AHEAD_BYTES


def _compute_chunks(
    get: Callable[..., Any], cull: Callable[..., Any], graph: dict[Any, Any], group: list[Any]
) -> list[Any]:
    """Compute the chunks with the keys `group` by the scheduler function `get`."""
    return list(get(cull(graph, group)[0], group))


def _read_range(source: Any, region: tuple[slice, ...]) -> list[np.ndarray]:
    """Read a range of a source as a list of one array."""
    return [np.asarray(source[region])]


def _source(graph: dict[Any, Any], key: Any) -> tuple[Any, tuple[slice, ...]] | None:
    """Return source array and range of chunk `key`; None if it is no plain range."""
    task = graph.get(key)
    while isinstance(task, tuple) or hasattr(task, "target"):  # an alias, such as a part of a concatenation
        task = graph.get(getattr(task, "target", task))
    args: Any = getattr(task, "args", ())
    func = getattr(task, "func", None)
    if getattr(func, "__name__", "") != "getter" or len(args) != 2 or getattr(task, "kwargs", None):
        return None
    source = graph.get(getattr(args[0], "key", None))
    source, region = getattr(source, "value", source), getattr(args[1], "value", args[1])
    if source is None or not isinstance(region, tuple):
        return None
    plain = all(isinstance(index, slice) and index.step in (None, 1) for index in region)
    return (source, region) if plain else None


def _merge_ranges(sources: list[Any], max_rows: int) -> Iterator[tuple[Any, tuple[slice, ...]]]:
    """Join consecutive ranges along the first dimension, and split them into ranges of at most `max_rows` rows."""
    start = 0
    while start < len(sources):
        source, (first, *others) = sources[start]
        stop, end = start + 1, first.stop
        while stop < len(sources) and sources[stop][0] is source:
            following, *rest = sources[stop][1]
            if rest != others or following.start != end:
                break
            end, stop = following.stop, stop + 1
        size = first.stop - first.start
        step = max_rows // size * size or max_rows  # whole chunks, if they are small
        for low in range(first.start, end, step):
            yield source, (slice(low, min(end, low + step)), *others)
        start = stop


def _split_second(source: Any, region: tuple[slice, ...], max_rows: int) -> Iterator[tuple[Any, tuple[slice, ...]]]:
    """Split a range along its second dimension into ranges of at most `max_rows` rows."""
    first, second, *others = region
    for low in range(second.start, second.stop, max_rows):
        yield source, (first, slice(low, min(second.stop, low + max_rows)), *others)


def read_rows(
    position: np.ndarray, sigma: np.ndarray, root: np.ndarray | None, layout: str, reference: np.ndarray | None = None
) -> Iterator[np.ndarray]:
    """Yield lifted snapshots, eq. (35), or normal deflections as rows of inner particles, in small batches.

    Parameters
    ----------
    position
        (samples, particle, coordinate) [m].
    sigma
        S / L0 of the particles.
    root
        Square roots of the weights of the inner particles; None for ones.
    layout
        "separate" yields arrays (coordinate, samples, particle), "vector" (1, samples, coordinate * particle), coordinate
        by coordinate; "normal" (normals, samples, particle), deflections normal to the chord.
    reference
        Axis that the normals in space refer to, see :class:`cablepod.discretisation._chord_frame.ChordFrame`.
    """
    samples, particles, dims = position.shape
    inner = particles - 2
    lines = weights_of_ends(sigma[1:-1])
    step = max(64, CACHE_BYTES // (8 * inner * (dims if layout == "vector" else 1)))
    for start in range(0, samples, step):
        part = position[start : start + step]
        if layout == "normal":
            if not np.isfinite(part[:, (0, -1)]).all():
                raise FloatingPointError("ends are not finite")
            lifted = pod_normal.deflections(part.astype(float, copy=False), reference)[:, :, 1:-1]
            yield np.multiply(lifted, 1.0 if root is None else root, order="C")
            continue
        # one matrix product for all coordinates, in the order of the result
        order = (2, 0, 1) if layout == "separate" else (0, 2, 1)
        ends, inside = (array.astype(float, copy=False).transpose(order) for array in (part[:, (0, -1)], part[:, 1:-1]))
        lifted = (ends.reshape(-1, 2) @ lines).reshape(inside.shape)
        np.subtract(inside, lifted, out=lifted)
        if root is not None:
            lifted *= root
        yield lifted if layout == "separate" else lifted.reshape(1, len(part), -1)
