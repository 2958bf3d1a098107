"""Orbits and growth rates over frequencies and amplitudes, in threads; edges of the stable regions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from cablepod._resources import cores
from cablepod.batch._pool import map_threads
from cablepod.condensed._kernels_layout import LeadingTerms
from cablepod.periodic._continuation import zero_between
from cablepod.periodic._kernels_layout import Forced
from cablepod.periodic._model import PeriodicModel, harmonics_at
from cablepod.periodic._multipliers import FAILED, STABLE, eigenvalues, growth_of, signed_stability
from cablepod.periodic._period import check_period
from cablepod.periodic._solve import (
    MAX_HARMONICS,
    MAX_PHASES,
    MIN_STRIDE,
    Solver,
    State,
    strides,
    tail_of,
)
from cablepod.periodic._start import grown

#: Number of harmonics of the first map, and share of the last two in the motion above which a column is computed with more.
HARMONICS, TAIL_RTOL = 5, 1e-5
#: Largest size of the boundary data of all amplitudes [bytes].
MAX_BYTES = 3e8
#: Number of columns that a thread takes at once.
COLUMNS = 8
#: Relative tolerance of the angular frequency of an edge, and growth over a period above which it is none: the square root.
EDGE_RTOL, MAX_GROWTH = 1e-10, 1e-5


class MapResult(NamedTuple):
    """Orbits of a map."""

    growth: np.ndarray  #: of the sets (2, amplitudes, frequencies) [1/s]
    kind: np.ndarray  #: of the sets, see ``_multipliers`` (2, amplitudes, frequencies)
    response: np.ndarray  #: largest deflections from the mean (amplitudes, frequencies) [m]
    smallest_force: np.ndarray  #: (amplitudes, frequencies) [N]
    tail: np.ndarray  #: share of the last two harmonics (amplitudes, frequencies)
    edges: dict[tuple[int, int, int], tuple[float, int]]
    """Set, amplitude and frequency before the edge -> its angular frequency [rad/s] and kind."""
    finished: np.ndarray  #: whether a point was computed (amplitudes, frequencies)

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> MapResult:
        """Return a map of which no point is finished."""
        growth, kind = np.full((2, *shape), np.nan), np.full((2, *shape), FAILED)
        response, force, tail = (np.full(shape, np.nan) for _ in range(3))
        return cls(growth, kind, response, force, tail, {}, np.zeros(shape, dtype=bool))

    def take(self, other: MapResult, which: np.ndarray, columns: np.ndarray) -> None:
        """Enter some frequencies of another map, without its edges, as some columns."""
        for name in ("growth", "kind", "response", "smallest_force", "tail", "finished"):
            getattr(self, name)[..., columns] = getattr(other, name)[..., which]

    def add_edge(self, solver: Solver, first: State, second: State, place: tuple[int, int, int], kind: int) -> None:
        """Enter where multipliers of a set cross the unit circle between two orbits; nothing where the response jumps."""
        most, stride = max(first.harmonics, second.harmonics), solver.stride(first)

        def matrix(state: State) -> np.ndarray:
            return solver.monodromies(state, stride)[0][place[0]]

        def between(low: State, high: State, share: float) -> State | None:
            state, _, iterations = solver.at_frequency(low.towards(high, share))
            return None if iterations < 0 else state

        tolerance = EDGE_RTOL * first.omega / (second.omega - first.omega)
        found = zero_between(
            (first.resized(most), second.resized(most)),
            between,
            lambda state: signed_stability(kind, matrix(state)),
            tolerance,
        )
        if found is not None and abs(growth_of(eigenvalues(matrix(found[1])), 1.0)[0]) < MAX_GROWTH:
            self.edges[place] = (found[1].omega * solver.model.scales[0], kind)


def _stacked(models: list[PeriodicModel], sizes: tuple[int, ...], phases: int) -> list[Forced]:
    """Return terms and forcing of all amplitudes, these first, of the first coordinates of each number in `sizes`."""
    parts = [[model.forced(n, phases, 1) for model in models] for n in sizes]
    candidates, rows = (np.stack([getattr(part, name) for part in parts[0]]) for name in ("candidates", "rows"))
    terms = [LeadingTerms(*map(np.stack, zip(*(part.terms for part in own), strict=True))) for own in parts]
    return [Forced(own, candidates, rows, models[0].damping) for own in terms]


def _responses(model: PeriodicModel, coefficients: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Return the largest deflections from the mean [m] at the phases of a basis (M, 1 + 2 H), of orbits (..., 1 + 2 H, n)."""
    q, n = basis[:, 1:] @ coefficients[..., 1:, :] * model.scales[1], model.n_in_plane
    squared = np.square(q[..., :n] @ model.sets[0])
    if q.shape[-1] > n:
        squared += np.square(q[..., n:] @ model.sets[1])
    return np.sqrt(squared.max(axis=(-2, -1)))


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

    frequency_scale = base.scales[0]
    split = base.n_in_plane if base.is_planar else base.size  # coordinates that the forcing moves
    scaled = omega / frequency_scale
    check_period(base, 2.0 * np.pi / scaled[0])
    is_even = even_steps(amplitudes)
    columns_of_rows = base.rows(1, 1).shape[2]
    most = int(min(MAX_PHASES, MAX_BYTES / (24 * len(models) * columns_of_rows)))

    def compute(columns: np.ndarray, own: np.ndarray, stride: int, harmonics: int) -> np.ndarray:
        """Compute columns with a number of harmonics, the `own` ones for the result; return those that need more."""
        samples, shape = 4 * harmonics + 4, (len(models), columns.size)
        phases = samples * stride
        terms = _stacked(models, (split, base.size), phases)
        steps = harmonics_at(samples, 2 * harmonics), harmonics_at(phases, harmonics), stride
        starts = np.tile(Solver(base).rest(1.0, harmonics).z[:-1], (columns.size, 1))
        orbits, found = np.full((*shape, starts.shape[1] + 1), np.nan), MapResult.empty(shape)

        def do(begin: int) -> None:
            part = slice(begin, min(begin + COLUMNS, columns.size))
            here = len(models), part.stop - part.start
            matrices = [np.empty((*here, 2 * n, 2 * n)) for n in (split, base.size - split)]

            follow = partial(
                kernel.map_columns, part.start, part.stop, scaled[columns], is_even, starts, *terms, *steps, orbits,
                *matrices, found.smallest_force,
            )  # fmt: skip
            _follow_from_rest(follow, models[0], scaled[columns], harmonics, part, orbits[0], starts)
            found.smallest_force[:, part] *= base.force_scale
            duration = 2.0 * np.pi / scaled[columns[part]]
            decay = np.exp(-0.5 * base.damping * duration)
            for k in range(1 + (base.size > split)):
                growth, found.kind[k, :, part] = growth_of(eigenvalues(matrices[k]) * decay[:, None], duration)
                found.growth[k, :, part] = growth * frequency_scale
            coefficients = orbits[:, part, :-1].reshape(*here, -1, split)
            found.tail[:, part] = tail_of(coefficients)
            for a in range(len(models)):
                found.response[a, part] = _responses(base, coefficients[a], steps[1])
            found.finished[:, part] = True

        def settled() -> np.ndarray:
            largest = np.nanmax(found.tail, axis=0, initial=0.0)
            return found.finished[0] & ((harmonics >= MAX_HARMONICS) | ~(largest > TAIL_RTOL))

        def told(_: int) -> None:
            progress((int(result.finished[0].sum()) + int((settled() & own).sum())) / omega.size)

        try:
            map_threads(do, range(0, columns.size, COLUMNS), cores(), done=told)
        finally:  # after Ctrl-C the columns that are settled
            flagged = ~settled()
            kept = own & ~flagged
            result.take(found, kept, columns[kept])

        def refine(place: tuple[int, int, int]) -> None:
            k, a, f = place
            first, second = (State(z, base.is_planar, split) for z in orbits[a, f : f + 2])
            kinds = found.kind[k, a, f : f + 2]
            result.add_edge(Solver(models[a]), first, second, (k, a, int(columns[f])), int(kinds.max()))

        places = [
            (k, a, f)
            for k, a, f in changes(found.kind)
            if columns[f + 1] == columns[f] + 1 and not (flagged[f] and flagged[f + 1])
        ]
        map_threads(refine, places, cores())
        for model in models:
            model.forget_rows()
        return columns[flagged & own]

    todo, harmonics = np.arange(omega.size), HARMONICS
    while todo.size:
        samples, again = 4 * harmonics + 4, []
        wanted = strides(2.0 * np.pi / scaled[todo], base.fastest_rate, samples)
        own_strides = np.minimum(wanted, max(MIN_STRIDE, most // samples))
        for stride in np.unique(own_strides).tolist():
            columns = todo[own_strides == stride]
            own = np.ones(columns.size, dtype=bool)
            if columns[-1] + 1 in todo:  # with other steps; here for the edge before it alone
                columns, own = np.append(columns, columns[-1] + 1), np.append(own, False)
            again.append(compute(columns, own, stride, harmonics))
        todo = np.concatenate(again)
        harmonics = min(2 * harmonics, MAX_HARMONICS)


def _follow_from_rest(
    follow: Callable[[], None],
    first: PeriodicModel,
    omega: np.ndarray,
    harmonics: int,
    part: slice,
    orbits: np.ndarray,
    starts: np.ndarray,
) -> None:
    """Follow a part of the columns, and again where the orbit of the first amplitude is reached from rest in several steps only.

    Parameters
    ----------
    follow
        Fills `orbits` from the first guesses `starts`.
    first, omega, harmonics
        Model of the first amplitude, angular frequencies of all columns, number of harmonics.
    part
        The columns.
    orbits, starts
        Orbits of the first amplitude (columns, unknowns), nan for none; their first guesses (columns, unknowns - 1), changed.
    """
    follow()
    again = False
    for f in part.start + np.flatnonzero(np.isnan(orbits[part, 0])):
        state, solved = grown(Solver(first), float(omega[f]), harmonics)
        if solved:
            starts[f], again = state.z[:-1], True
    if again:
        follow()


def even_steps(amplitudes: np.ndarray) -> np.ndarray:
    """Return whether the last four amplitudes differ by equal steps, up to a hundredth, at each of them."""
    result = np.zeros(amplitudes.size, dtype=bool)
    steps = np.diff(amplitudes)
    for a in range(3, amplitudes.size):
        last = steps[a - 3 : a]
        result[a] = np.ptp(last) < 0.01 * last.max()
    return result


def changes(kind: np.ndarray) -> list[tuple[int, int, int]]:
    """Return set, amplitude and frequency after which one of two neighbours is unstable; kinds (2, amplitudes, frequencies)."""
    unstable, known = kind > STABLE, kind != FAILED
    change = (unstable[..., 1:] != unstable[..., :-1]) & known[..., 1:] & known[..., :-1]
    return [(k, a, f) for k, a, f in np.argwhere(change).tolist()]
