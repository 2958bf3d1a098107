"""Orbits and growth rates over frequencies and amplitudes, in threads; edges of the stable regions."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cablepod._resources import cores
from cablepod.batch._pool import map_threads
from cablepod.condensed._kernels_layout import LeadingTerms
from cablepod.periodic._kernels_layout import Forced
from cablepod.periodic._model import PeriodicModel, harmonics_at
from cablepod.periodic._period import check_period
from cablepod.periodic._solve import MAX_HARMONICS, MAX_PHASE_STEP, MAX_PHASES, MIN_STRIDE

#: Number of harmonics of the first map, and share of the last two in the motion above which a column is computed with more.
HARMONICS, TAIL_RTOL = 5, 1e-5
#: Largest size of the boundary data of all amplitudes [bytes].
MAX_BYTES = 3e8
#: Number of columns that a thread takes at once.
COLUMNS = 4
#: Kind of a point without an orbit, see ``_kernels_map``.
NO_ORBIT = 4


class MapResult(NamedTuple):
    """Orbits of a map."""

    growth: np.ndarray  #: of the sets (2, amplitudes, frequencies) [1/s]
    kind: np.ndarray  #: of the sets, see ``_kernels_map`` (2, amplitudes, frequencies)
    response: np.ndarray  #: largest deflections from the mean (amplitudes, frequencies) [m]
    smallest_force: np.ndarray  #: (amplitudes, frequencies) [N]
    tail: np.ndarray  #: share of the last two harmonics (amplitudes, frequencies)
    edges: dict[tuple[int, int, int], tuple[float, int]]
    """Set, amplitude and frequency before the edge -> its angular frequency [rad/s] and kind."""
    finished: np.ndarray  #: whether a point was computed (amplitudes, frequencies)

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> MapResult:
        """Return a map of which no point is finished."""
        growth, kind = np.full((2, *shape), np.nan), np.full((2, *shape), NO_ORBIT)
        response, force, tail = (np.full(shape, np.nan) for _ in range(3))
        return cls(growth, kind, response, force, tail, {}, np.zeros(shape, dtype=bool))


def _stacked(models: list[PeriodicModel], n: int, phases: int) -> Forced:
    """Return terms and forcing of the first n coordinates of all amplitudes, these first."""
    parts = [model.forced(n, phases, 1) for model in models]
    terms = LeadingTerms(*map(np.stack, zip(*(part.terms for part in parts), strict=True)))
    candidates, rows = (np.stack([getattr(part, name) for part in parts]) for name in ("candidates", "rows"))
    return Forced(terms, candidates, rows, parts[0].damping)


def compute_map(
    base: PeriodicModel,
    models: list[PeriodicModel],
    omega: np.ndarray,
    amplitudes: np.ndarray,
    result: MapResult,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Compute a map for angular frequencies [rad/s] (frequencies,) and models of rising amplitudes, with the scales of `base`.

    After Ctrl-C `result` has the columns that were finished.
    """
    from cablepod.periodic import _kernels_map as kernel  # numba is imported only to compute

    frequency_scale, length_scale, _ = base.scales
    split = base.n_in_plane if base.is_planar else base.size  # coordinates that the forcing moves
    scaled = omega / frequency_scale
    check_period(base, 2.0 * np.pi / scaled[0])
    equal = _equal_steps(amplitudes)
    moved = base.sets[:1] if base.is_planar else base.sets
    shapes, first = np.zeros((split, len(moved), moved[0].shape[1])), 0
    for normal, own in enumerate(moved):
        shapes[first : first + len(own), normal] = own * length_scale
        first += len(own)
    columns_of_rows = base.rows(1, 1).shape[2]
    most = int(min(MAX_PHASES, MAX_BYTES / (24 * len(models) * columns_of_rows)))

    def compute(columns: np.ndarray, own: np.ndarray, stride: int, harmonics: int) -> np.ndarray:
        """Compute columns with a number of harmonics, the `own` ones for the result; return those that need more."""
        samples, shape = 4 * harmonics + 4, (len(models), columns.size)
        phases = samples * stride
        terms = [_stacked(models, size, phases) for size in (split, base.size)]
        for model in models:
            model.forget_rows()
        steps = harmonics_at(samples, 2 * harmonics), harmonics_at(phases, harmonics), stride, samples
        rest = np.zeros((1 + 2 * harmonics, split))
        rest[0] = base.rest[:split] / length_scale
        orbits = np.full((*shape, rest.size + 1), np.nan)
        growth, kind = np.full((2, *shape), np.nan), np.zeros((2, *shape), np.int64)
        response, force, tail = (np.full(shape, np.nan) for _ in range(3))
        computed = np.zeros(columns.size, dtype=bool)

        def do(begin: int) -> None:
            kernel.map_columns(
                begin, min(begin + COLUMNS, columns.size), scaled[columns], equal, rest.ravel(), *terms, shapes, split, *steps,
                orbits, growth, kind, response, force, tail,
            )  # fmt: skip
            computed[begin : begin + COLUMNS] = True

        def settled() -> np.ndarray:
            return computed & ((harmonics >= MAX_HARMONICS) | ~(np.nanmax(tail, axis=0, initial=0.0) > TAIL_RTOL))

        def told(_: int) -> None:
            progress((int(result.finished[0].sum()) + int((settled() & own).sum())) / omega.size)

        try:
            map_threads(do, range(0, columns.size, COLUMNS), cores(), done=told)
        finally:  # after Ctrl-C the columns that are settled
            flagged = ~settled()
            kept = own & ~flagged
            into = columns[kept]
            result.growth[:, :, into], result.kind[:, :, into] = growth[:, :, kept] * frequency_scale, kind[:, :, kept]
            result.response[:, into], result.smallest_force[:, into] = (
                response[:, kept],
                force[:, kept] * base.force_scale,
            )
            result.tail[:, into], result.finished[:, into] = tail[:, kept], True

        def refine(place: tuple[int, int, int]) -> None:
            k, a, f = place
            of_set = (0, 2 * split) if k == 0 else (2 * split, 2 * base.size)
            kind_of_edge = int(max(kind[k, a, f], kind[k, a, f + 1]))
            value = kernel.refine_edge(kind_of_edge, orbits[a, f], orbits[a, f + 1], *of_set, a, *terms, split, *steps)
            if np.isfinite(value):
                result.edges[(k, a, int(columns[f]))] = (value * frequency_scale, kind_of_edge)

        places = [
            (k, a, f)
            for k, found in _changes(kind, base.size > split)
            for a, f in zip(*(index.tolist() for index in found), strict=True)
            if columns[f + 1] == columns[f] + 1 and not (flagged[f] and flagged[f + 1])
        ]
        map_threads(refine, places, cores())
        return columns[flagged & own]

    todo, harmonics = np.arange(omega.size), HARMONICS
    while todo.size:
        strides, again = _strides(scaled[todo], base.fastest_rate, 4 * harmonics + 4, most), []
        for stride in np.unique(strides).tolist():
            columns = todo[strides == stride]
            own = np.ones(columns.size, dtype=bool)
            if columns[-1] + 1 in todo:  # with other steps; here for the edge before it alone
                columns, own = np.append(columns, columns[-1] + 1), np.append(own, False)
            again.append(compute(columns, own, stride, harmonics))
        todo = np.concatenate(again)
        harmonics = min(2 * harmonics, MAX_HARMONICS)


def _equal_steps(amplitudes: np.ndarray) -> np.ndarray:
    """Return whether the last four amplitudes differ by equal steps, up to a hundredth, at each of them."""
    result = np.zeros(amplitudes.size, dtype=bool)
    steps = np.diff(amplitudes)
    for a in range(3, amplitudes.size):
        last = steps[a - 3 : a]
        result[a] = np.ptp(last) < 0.01 * last.max()
    return result


def _changes(kind: np.ndarray, both: bool) -> list[tuple[int, tuple[np.ndarray, ...]]]:
    """Return for each set the places (amplitudes, frequencies) after which stable and unstable orbits change."""
    found = []
    for k in range(1 + both):
        unstable, failed = kind[k] > 0, kind[k] == 4
        change = (unstable[:, 1:] != unstable[:, :-1]) & ~failed[:, 1:] & ~failed[:, :-1]
        found.append((k, np.nonzero(change)))
    return found


def _strides(omega: np.ndarray, highest: float, samples: int, most: int) -> np.ndarray:
    """Return the numbers of steps of the scheme for multipliers for each sample, powers of two, at most `most` in all."""
    steps = 2.0 * np.pi / omega * highest / MAX_PHASE_STEP
    strides = np.maximum(MIN_STRIDE, 2 ** np.ceil(np.log2(np.maximum(steps / samples, 1.0)))).astype(int)
    return np.minimum(strides, max(MIN_STRIDE, most // samples))
