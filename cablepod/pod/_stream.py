"""Modes of a stream of snapshots that are not stored."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from contextlib import nullcontext
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import SNAPSHOTS, taken
from cablepod._resources import defer_sigint_during_dask
from cablepod.batch._blas import one_blas_thread
from cablepod.batch._pool import map_threads
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import truth
from cablepod.pod import _normal as pod_normal
from cablepod.pod import _svd_methods as svd_methods
from cablepod.pod._blocks import count_snapshots, is_lazy, read_blocks, read_rows
from cablepod.pod._graded_svd import COMPLETE
from cablepod.pod._incremental import IncrementalSVD
from cablepod.pod._label import check_options, labelled
from cablepod.pod._snapshots import (
    MASS,
    are_alike,
    broken_member,
    check_same_masses,
    position_of,
    relative_arc_length,
    weight_roots,
)
from cablepod.pod._training_range import range_of, union_of_ranges

#: Minimum number of lazy snapshots that are processed by two threads (fixed, so that results do not depend on the machine).
TWO_THREAD_SAMPLES = 20_000


class Stream:
    """Karhunen-Loeve modes of snapshots that are added piece by piece and not stored.

    The memory is a few arrays of the size of the modes, independent of the number of snapshots.  A stream can be pickled: workers
    may own one each, and the streams are merged at the end.  Except for rounding, the modes equal those of
    :func:`cablepod.pod.decompose` for all snapshots together, in any order; :mod:`cablepod.pod._incremental` has the algorithm.

    Parameters
    ----------
    layout, weights, center
        As in :func:`cablepod.pod.decompose`.
    """

    def __init__(self, *, layout: str = "separate", weights: str | None = None, center: bool = True) -> None:
        check_options(layout, "svd", weights, None, None)
        self.layout, self.weights, self.center = layout, weights, truth("center", center) and layout != "normal"
        self.samples = 0
        self._reference: np.ndarray | None = None  # axis that the normals in space refer to, layout "normal"
        self._sums: list[IncrementalSVD] = []
        self._like: xr.Dataset | None = None
        self._inputs: dict[str, provenance.Input] = {}
        self._trained: np.ndarray | None = None  # range of the training scenes

    def update(self, snapshots: xr.Dataset) -> Stream:
        """Add the snapshots of a trajectory, in memory or in chunks, and return the stream.

        Parameters
        ----------
        snapshots
            As in :func:`cablepod.pod.decompose`; the same particles (S / L0) and coordinates each time.

        Raises
        ------
        SceneError
            If particles or coordinates differ from those before, or positions are missing or not finite.  The stream is then
            unchanged.
        """
        snapshots = taken("snapshots", snapshots, SNAPSHOTS)
        with defer_sigint_during_dask(snapshots):
            return self._update(snapshots)

    def _update(self, snapshots: xr.Dataset) -> Stream:
        """Add checked snapshots to copies of the sums, and keep these if there was no error."""
        position = position_of(snapshots)
        sigma = relative_arc_length(snapshots)
        dims, width = position.sizes["coordinate"], sigma.size - 2
        features = {"separate": [width] * dims, "vector": [dims * width], "normal": [width] * (dims - 1)}[self.layout]
        if self._like is not None:
            self._check_particles(snapshots)
        # copies: an error in a later block leaves the stream unchanged
        sums = copy.deepcopy(self._sums) or [IncrementalSVD(width, center=self.center) for width in features]
        root = None if self.weights is None else weight_roots(snapshots, self.weights)
        samples, reference = count_snapshots(position), self._reference
        small = max(features, default=0) <= COMPLETE
        # BLAS has one thread for small matrices: two threads then add the blocks of long lazy data to sums of their own
        thread_sums = [sums]
        if small and is_lazy(position) and samples >= TWO_THREAD_SAMPLES:
            thread_sums.append([IncrementalSVD(width, center=self.center) for width in features])
        try:
            with one_blas_thread() if small else nullcontext():
                for block in read_blocks(position):
                    if reference is None and self.layout == "normal" and len(block):
                        reference = pod_normal.reference_of(block)
                    _add_in_threads(thread_sums, block, (sigma, root, self.layout, reference))
                for second_sums in thread_sums[1:]:
                    for total, second in zip(sums, second_sums, strict=True):
                        total.merge(second)
        except FloatingPointError:
            where = broken_member(position)
            raise SceneError(f"snapshots: position is not finite everywhere{where}; allowed: finite numbers") from None
        self._sums, self._reference = sums, reference
        self._trained = union_of_ranges(self._trained, range_of(snapshots))
        return self._record(samples, snapshots, [provenance.input_of(snapshots)])

    def merge(self, other: Stream) -> Stream:
        """Add all snapshots of the stream `other`, which is not changed, and return this stream.

        Parameters
        ----------
        other
            A stream with the same options, particles and coordinates.

        Raises
        ------
        SceneError
            If they differ.
        """
        options, other_options = ((stream.layout, stream.weights, stream.center) for stream in (self, other))
        if options != other_options:
            raise scene_error("other", other_options, f"a stream of the same layout, weights and center, {options}")
        if other._like is None:
            return self
        if self._like is not None:
            self._check_particles(other._like)
        axis, other_axis = self._reference, other._reference
        if axis is not None and other_axis is not None and not np.array_equal(axis, other_axis):
            raise SceneError(
                "other: its first chord is so steep that its normals refer to another axis; "
                "allowed: streams whose first chords have similar directions"
            )
        sums = copy.deepcopy(self._sums) or [IncrementalSVD(svd.features, center=self.center) for svd in other._sums]
        with one_blas_thread():
            for total, added in zip(sums, other._sums, strict=True):
                total.merge(added)
        self._sums, self._reference = sums, other_axis if axis is None else axis
        self._trained = union_of_ranges(self._trained, other._trained)
        return self._record(other.samples, other._like, other._inputs.values())

    def modes(
        self, *, rank: int | None = None, energy: float | None = None, function: str = "pod.Stream.modes"
    ) -> xr.Dataset:
        """Return the modes of all snapshots so far; more snapshots may follow.

        Parameters
        ----------
        rank, energy
            As in :func:`cablepod.pod.decompose`.
        function
            Function name in the history.
        """
        check_options(self.layout, "svd", self.weights, rank, energy)
        if self._like is None or self.samples == 0:
            raise SceneError("snapshots: given none; allowed: at least two instants")
        # the same number of modes for all coordinates
        most = max(svd.axes.shape[1] for svd in self._sums)
        with one_blas_thread() if most <= COMPLETE else nullcontext():
            parts = [svd.decompose(most) for svd in self._sums]
        count = min(self.samples, most)
        values = np.stack([part.values[:count] for part in parts])
        discarded = np.array([part.discarded for part in parts])
        shape = (self._sums[0].features, self.samples)
        errors = np.stack(
            [
                svd_methods.uncertainty(row, shape, "blocks", discarded=norm)
                for row, norm in zip(values, discarded, strict=True)
            ]
        )
        return labelled(
            [part.left for part in parts],
            values,
            errors,
            discarded,
            [svd.mean() for svd in self._sums],
            self.samples,
            choice=(rank, energy),
            options={"layout": self.layout, "method": "svd", "weights": self.weights, "center": self.center},
            algorithm=svd_methods.ALGORITHMS["blocks"],
            like=self._like,
            inputs=list(self._inputs.values()),
            function=function,
            trained=self._trained,
            reference=self._reference,
        )

    def _check_particles(self, snapshots: xr.Dataset) -> None:
        """Refuse snapshots with other particles or coordinates than before."""
        assert self._like is not None
        if not are_alike(self._like, snapshots):
            coordinates = snapshots["coordinate"].values.tolist()
            members = f" in members {np.ravel(snapshots['member'])[:5].tolist()}" if "member" in snapshots else ""
            raise SceneError(
                f"snapshots: given {snapshots.sizes['particle']} particles{members} and coordinates {coordinates}; allowed: "
                f"the {self._like.sizes['particle']} particles at the same S / L0 and the coordinates of the previous snapshots"
            )
        if self.weights == "mass":
            check_same_masses(self._like, snapshots)

    def _record(self, samples: int, like: xr.Dataset, inputs: Iterable[provenance.Input]) -> Stream:
        """Record the number of snapshots and their history; return the stream."""
        if self._like is None:
            self._like = like[["arc_length", "coordinate", *({MASS} & set(like.coords))]].load().copy(deep=True)
            self._like.attrs = dict(like.attrs)
        elif self._like.attrs.get("law") != like.attrs.get("law"):  # modes of several laws name none
            self._like.attrs.pop("law", None)
        self.samples += samples
        for found in inputs:
            self._inputs.setdefault(found.id, found)
        return self


def add_checked(stream: Stream, snapshots: xr.Dataset) -> None:
    """Add snapshots that :func:`cablepod._inputs.taken` gave to a stream."""
    with defer_sigint_during_dask(snapshots):
        stream._update(snapshots)


def _add_in_threads(thread_sums: list[list[IncrementalSVD]], block: np.ndarray, row_options: tuple[Any, ...]) -> None:
    """Add a block (samples, particle, coordinate), split between one thread for each of `thread_sums`."""
    if len(thread_sums) == 1:
        _add_block(thread_sums[0], block, row_options)
        return
    parts = list(zip(thread_sums, np.array_split(block, len(thread_sums)), strict=True))
    map_threads(lambda part: _add_block(part[0], part[1], row_options), parts, len(thread_sums))


def _add_block(sums: list[IncrementalSVD], block: np.ndarray, row_options: tuple[Any, ...]) -> None:
    """Add a block (samples, particle, coordinate) [m]; `row_options` are the other arguments of ``read_rows``."""
    if sums[0].count == 0 and len(block):
        # snapshots spread over the whole block, a few per feature, so that the basis includes late motions
        sample = block[:: max(1, len(block) // (4 * min(sums[0].features, COMPLETE)))]
        for batch in read_rows(sample[: 8 * COMPLETE], *row_options):
            for svd, rows in zip(sums, batch, strict=True):
                svd.prepare(rows)
    noise = svd_methods.EPSILON * float(np.abs(block[:, (0, -1)]).max(initial=0.0))
    for batch in read_rows(block, *row_options):
        for svd, rows in zip(sums, batch, strict=True):
            svd.add(rows, noise=noise)
