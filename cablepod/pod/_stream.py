"""Modes as a labelled Dataset, and a stream of snapshots that becomes one."""

from __future__ import annotations

import copy
from contextlib import nullcontext
from typing import Any

import numpy as np
import xarray as xr

from cablepod.batch._blas import one_blas_thread
from cablepod.batch._pool import map_threads
from cablepod.batch._sigint import defer_sigint_during_dask
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.errors import SceneError, scene_error
from cablepod.pod import _decompositions as decompositions
from cablepod.pod._blocks import count_snapshots, is_lazy, read_blocks, read_rows
from cablepod.pod._gram import COMPLETE
from cablepod.pod._incremental import IncrementalSVD
from cablepod.pod._label import SHARED, check_options, labelled
from cablepod.pod._snapshots import broken_member, position_of, relative_arc_length, weight_roots
from cablepod.pod._training_range import range_of, union_of_ranges


class Stream:
    """Karhunen-Loeve modes of snapshots that need not be kept: fed piece by piece, merged, asked at any time.

    What is held is a few arrays of the size of the modes, whatever the number of snapshots; it can be pickled.  Workers may
    each own one and merge them at the end.  The modes are those that :func:`cablepod.pod.decompose` gives of all snapshots
    together, but for rounding, in whatever order they came; :mod:`cablepod.pod._incremental` says how.

    Parameters
    ----------
    layout, weights, center
        As in :func:`cablepod.pod.decompose`.
    """

    def __init__(self, *, layout: str = "separate", weights: str | None = None, center: bool = True) -> None:
        check_options(layout, "svd", weights, None, None)
        self.layout, self.weights, self.center = layout, weights, bool(center) and layout != "normal"
        self.samples = 0
        self._reference: int | None = None  # of the first chord, for layout "normal"
        self._sums: list[IncrementalSVD] = []
        self._like: xr.Dataset | None = None
        self._inputs: dict[str, xr.Dataset] = {}
        self._trained: np.ndarray | None = None  # range of the training scenes

    def update(self, snapshots: xr.Dataset) -> Stream:
        """Count a trajectory or several, in memory or in chunks, and return the stream.

        Parameters
        ----------
        snapshots
            As in :func:`cablepod.pod.decompose`; the same particles (S / L0) and coordinates each time.

        Raises
        ------
        SceneError
            For other particles than before, and positions that are missing or not finite; the stream is then as it was
            before.
        """
        with defer_sigint_during_dask(snapshots):
            return self._updated(snapshots)

    def _updated(self, snapshots: xr.Dataset) -> Stream:
        position = position_of(snapshots)
        sigma = relative_arc_length(snapshots)
        dims, width = position.sizes["coordinate"], sigma.size - 2
        features = {"separate": [width] * dims, "vector": [dims * width], "normal": [width] * (dims - 1)}[self.layout]
        if self._like is not None:
            self._agrees(snapshots)
        # copies, so that a fault in the midst of many blocks leaves the stream as it was
        sums = copy.deepcopy(self._sums) or [IncrementalSVD(size, center=self.center) for size in features]
        root = None if self.weights is None else weight_roots(sigma, self.weights)
        samples, reference = count_snapshots(position), self._reference
        small = max(features, default=0) <= COMPLETE
        # with small matrices BLAS has one thread, so that what comes from files is shared out between two, and their sums merged
        shared = [sums]
        if small and is_lazy(position) and samples >= SHARED:
            shared.append([IncrementalSVD(size, center=self.center) for size in features])
        try:
            with one_blas_thread() if small else nullcontext():
                for block in read_blocks(position):
                    if reference is None and self.layout == "normal" and len(block):
                        reference = ChordFrame.of(block[:1, -1] - block[:1, 0]).reference
                    _share_out(shared, block, (sigma, root, self.layout, reference))
                for part in shared[1:]:
                    for mine, others in zip(sums, part, strict=True):
                        mine.merge(others)
        except FloatingPointError:
            where = broken_member(position)
            raise SceneError(f"snapshots: position is not finite everywhere{where}; allowed: finite numbers") from None
        self._sums, self._reference = sums, reference
        self._trained = union_of_ranges(self._trained, range_of(snapshots))
        return self._noted(samples, snapshots, [snapshots])

    def merge(self, other: Stream) -> Stream:
        """Count all that `other` has counted, which stays as it is, and return the stream.

        Parameters
        ----------
        other
            A stream of the same options, particles and coordinates.

        Raises
        ------
        SceneError
            Where they differ.
        """
        own, its = ((item.layout, item.weights, item.center) for item in (self, other))
        if own != its:
            raise scene_error("other", its, f"a stream of the same layout, weights and center, {own}")
        if other._like is None:
            return self
        if self._like is not None:
            self._agrees(other._like)
        references = {item for item in (self._reference, other._reference) if item is not None}
        if len(references) > 1:
            raise SceneError(
                "other: its first chord is so steep that another axis tells deflection in the plane from deflection out of it; "
                "allowed: streams that began with chords alike"
            )
        sums = copy.deepcopy(self._sums) or [IncrementalSVD(item.features, center=self.center) for item in other._sums]
        with one_blas_thread():
            for mine, others in zip(sums, other._sums, strict=True):
                mine.merge(others)
        self._sums, self._reference = sums, next(iter(references), None)
        self._trained = union_of_ranges(self._trained, other._trained)
        return self._noted(other.samples, other._like, list(other._inputs.values()))

    def modes(
        self, *, rank: int | None = None, energy: float | None = None, function: str = "pod.Stream.modes"
    ) -> xr.Dataset:
        """Return the modes of all snapshots so far; the stream may be fed further.

        Parameters
        ----------
        rank, energy
            As in :func:`cablepod.pod.decompose`.
        function
            The name that goes into the history.
        """
        check_options(self.layout, "svd", self.weights, rank, energy)
        if self._like is None or self.samples == 0:
            raise SceneError("snapshots: given none; allowed: at least two instants")
        sigma = relative_arc_length(self._like)
        root = weight_roots(sigma, self.weights)
        width = sigma.size - 2
        # all coordinates have as many modes as the one that has most
        most = max(item.axes.shape[1] for item in self._sums)
        with one_blas_thread() if most <= COMPLETE else nullcontext():
            found = [item.decomposed(most) for item in self._sums]
        count = min(self.samples, most)
        values = np.stack([item.values[:count] for item in found])
        lost = np.array([item.lost for item in found])
        shape = (self._sums[0].features, self.samples)
        unsure = np.stack(
            [decompositions.uncertainty(v, shape, "blocks", lost=x) for v, x in zip(values, lost, strict=True)]
        )
        # the stream has its features coordinate by coordinate
        fields = [item.left[:, :count].T.reshape(count, -1, width).transpose(0, 2, 1) / root[:, None] for item in found]
        mean = np.stack([item.mean().reshape(-1, width) for item in self._sums]).reshape(-1, width).T / root[:, None]
        return labelled(
            fields,
            values,
            unsure,
            lost,
            np.pad(mean, ((1, 1), (0, 0))),
            self.samples,
            choice=(rank, energy),
            options={"layout": self.layout, "method": "svd", "weights": self.weights, "center": self.center},
            algorithm=decompositions.ALGORITHMS["blocks"],
            like=self._like,
            inputs=list(self._inputs.values()),
            function=function,
            trained=self._trained,
        )

    def _agrees(self, snapshots: xr.Dataset) -> None:
        assert self._like is not None
        own, its = relative_arc_length(self._like), relative_arc_length(snapshots)
        same = own.shape == its.shape and np.abs(own - its).max() <= 1e-9
        coordinates = snapshots["coordinate"].values.tolist()
        if not same or coordinates != self._like["coordinate"].values.tolist():
            members = f" in members {np.ravel(snapshots['member'])[:5].tolist()}" if "member" in snapshots else ""
            raise SceneError(
                f"snapshots: given {its.size} particles{members} and coordinates {coordinates}; allowed: "
                f"the {own.size} particles, at the same S / L0, and the coordinates of those before"
            )

    def _noted(self, samples: int, like: xr.Dataset, inputs: list[xr.Dataset]) -> Stream:
        """Note how many snapshots came, and whence."""
        if self._like is None:
            self._like = like[["arc_length", "coordinate"]].load().copy(deep=True)
            self._like.attrs = dict(like.attrs)
        self.samples += samples
        for origin in inputs:
            stub = xr.Dataset(attrs={key: origin.attrs[key] for key in ("id", "history_json") if key in origin.attrs})
            self._inputs.setdefault(str(origin.attrs.get("id", "unknown")), stub)
        return self


def _share_out(shared: list[list[IncrementalSVD]], block: np.ndarray, how: tuple[Any, ...]) -> None:
    """Let a thread for each of the `shared` sums add its part of a block."""
    if len(shared) == 1:
        _count_in(shared[0], block, how)
        return
    parts = list(zip(shared, np.array_split(block, len(shared)), strict=True))
    map_threads(lambda part: _count_in(part[0], part[1], how), parts, len(shared))


def _count_in(sums: list[IncrementalSVD], block: np.ndarray, how: tuple[Any, ...]) -> None:
    """Add a block (samples, particle, coordinate) to sums, in rows as :func:`cablepod.pod._snapshots.rows` makes them `how`."""
    if sums[0].count == 0 and len(block):
        # snapshots from all over the block, a few for each feature: they know of motions that come late
        some = block[:: max(1, len(block) // (4 * min(sums[0].features, COMPLETE)))]
        for part in read_rows(some[: 8 * COMPLETE], *how):
            for own, rows in zip(sums, part, strict=True):
                own.prepare(rows)
    noise = decompositions.EPSILON * float(np.abs(block[:, (0, -1)]).max(initial=0.0))
    for part in read_rows(block, *how):
        for own, rows in zip(sums, part, strict=True):
            own.add(rows, noise=noise)
