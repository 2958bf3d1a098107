"""Snapshots: their form, what is left of them when the straight line between the ends is taken off, and how they are read.

Positions come in blocks, whether they lie in memory or in files.  A block is read while the one before is worked on, so that the disk and the arithmetic wait for each other as little as possible.
Blocks are so small that the allocator hands the same memory out again and again.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from cablepod.schema import SceneError

#: Bytes of a block that is asked for from files, and of the largest chunk that is taken whole.
BLOCK, LARGEST = 1 << 24, 1 << 27
#: Bytes of the rows that are worked on at a time: they stay in the cache of a core.
CACHED = 3 << 18


def arc_length(snapshots: xr.Dataset) -> np.ndarray:
    """Return the arc length (particle) [m], of the first member where there are several."""
    s = snapshots["arc_length"]
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
    s = lengths.transpose(..., "particle").values.reshape(-1, lengths.sizes["particle"])
    sigma = s / s[:, -1:]
    other = np.flatnonzero(np.abs(sigma - sigma[0]).max(axis=1) > 1e-9)
    if other.size:
        raise SceneError(
            f"snapshots: given members whose particles lie at different S / L0, from the first one differ {other[:5].tolist()}; "
            "allowed: the same particles in all"
        )


def lift(snapshots: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Take the straight line between the ends off the positions, eq. (35).

    Returns
    -------
    tuple
        Lifted positions (samples, particle, coordinate) and positions of the ends (samples, 2, coordinate) [m].

    Raises
    ------
    SceneError
        Where positions are missing or not finite.
    """
    position = position_of(snapshots).transpose(..., "time", "particle", "coordinate").values
    position = position.reshape(-1, *position.shape[-2:]).astype(float)
    if not np.isfinite(position).all():
        raise SceneError("snapshots: position is not finite everywhere; allowed: finite numbers")
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
    """Yield `position` as arrays (samples, particle, coordinate) [m], in memory, in an order that suits the chunks."""
    position = position.transpose(..., "time", "particle", "coordinate")
    if not is_lazy(position):
        yield position.values.reshape(-1, *position.shape[-2:])
        return
    from concurrent.futures import ThreadPoolExecutor  # only who reads files needs it

    def read(region: tuple[slice, ...]) -> np.ndarray:
        return np.asarray(position.variable[region].data)

    with ThreadPoolExecutor(1, thread_name_prefix="cablepod-read") as reader:
        ahead = None
        for region in _regions(position):
            coming = reader.submit(read, region)
            if ahead is not None:
                yield ahead.result().reshape(-1, *position.shape[-2:])
            ahead = coming
        if ahead is not None:
            yield ahead.result().reshape(-1, *position.shape[-2:])


def _regions(position: xr.DataArray) -> Iterator[tuple[slice, ...]]:
    """Cut the leading dimensions along the chunks: small ones are taken together, very large ones cut."""
    chunks: Any = position.chunks
    row = position.dtype.itemsize * position.sizes["particle"] * position.sizes["coordinate"]
    lead = position.dims[:-2]
    chunk_rows = int(np.prod([max(chunks[i]) for i in range(len(lead))]))
    wanted = max(1, BLOCK // row)
    whole = chunk_rows * row <= LARGEST
    cuts: list[list[slice]] = []
    # whole chunks: how many of them may go together; otherwise how many rows
    left = max(1, wanted // chunk_rows) if whole else wanted
    for i in range(len(lead) - 1, -1, -1):
        ranges = _joined(chunks[i], left) if whole else _cut(chunks[i], left)
        longest = max(part.stop - part.start for part in ranges)
        left = max(1, left // (max(1, longest // max(chunks[i])) if whole else longest))
        cuts.insert(0, ranges)
    yield from product(*cuts)


def _joined(sizes: tuple[int, ...], together: int) -> list[slice]:
    stops = np.concatenate([[0], np.cumsum(sizes)])
    return [slice(int(stops[i]), int(stops[min(i + together, len(sizes))])) for i in range(0, len(sizes), together)]


def _cut(sizes: tuple[int, ...], most: int) -> list[slice]:
    stops = np.cumsum(sizes)
    return [
        slice(int(start), int(min(start + most, stop)))
        for stop, size in zip(stops, sizes, strict=True)
        for start in range(stop - size, stop, most)
    ]


def rows(position: np.ndarray, sigma: np.ndarray, root: np.ndarray | None, layout: str) -> Iterator[np.ndarray]:
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
        by coordinate.
    """
    samples, particles, dims = position.shape
    inner = particles - 2
    lines = np.stack([1.0 - sigma[1:-1], sigma[1:-1]])
    step = max(64, CACHED // (8 * inner * (dims if layout == "vector" else 1)))
    for start in range(0, samples, step):
        part = position[start : start + step]
        hat = np.empty((dims, len(part), inner) if layout == "separate" else (len(part), dims, inner))
        for c in range(dims):
            out = hat[c] if layout == "separate" else hat[:, c]
            ends = np.stack([part[:, 0, c], part[:, -1, c]], axis=1).astype(float)
            np.subtract(part[:, 1:-1, c], ends @ lines, out=out)
            if root is not None:
                out *= root
        yield hat if layout == "separate" else hat.reshape(1, len(part), -1)
