"""Maps of stability by the general solver, where damping is not by mass alone: all frequencies, amplitude by amplitude."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from cablepod.periodic import _fields as fields
from cablepod.periodic._continuation import adapted_at
from cablepod.periodic._general import solver_of
from cablepod.periodic._map import HARMONICS, MapResult
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._multipliers import FAILED, growth_of
from cablepod.periodic._period import check_period
from cablepod.periodic._solve import Solver, State, sets_of


def compute_general_map(
    base: PeriodicModel,
    models: list[PeriodicModel],
    omega: np.ndarray,
    amplitudes: np.ndarray,
    result: MapResult,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Do :func:`cablepod.periodic._map.compute_map` with the number of harmonics of single orbits, in one thread."""
    scale = base.scales[0]
    check_period(base, 2.0 * np.pi / omega[0] * scale)
    known: list[list[State]] = [[] for _ in omega]  # the last three responses at each frequency, without a gap
    last: list[State | None] = [None for _ in omega]
    for a, model in enumerate(models):
        solver = solver_of(model)
        now: list[State | None] = []
        for f, value in enumerate(omega):
            state = _found(solver, float(value) / scale, known[f], last[f])
            now.append(state)
            known[f] = [] if state is None else [*known[f][-2:], state]
            last[f] = last[f] if state is None else state
            if state is not None:
                _judge(solver, state, result, (a, f))
            result.finished[a, f] = True
            progress((a * omega.size + f + 1) / result.response.size)
        _add_edges(solver, now, result, a)
        model.forget_rows()


def _found(solver: Solver, omega: float, known: list[State], last: State | None) -> State | None:
    """Return the response at a frequency from one of the first guesses; None for none."""
    for guess in _guesses(solver, omega, known, last):
        state, _, iterations = adapted_at(solver, guess)
        if iterations > 0:
            return state
    return None


def _guesses(solver: Solver, omega: float, known: list[State], last: State | None) -> Iterator[State]:
    """Yield first guesses: along the last three or two responses, the last one, rest, others, as the compiled map does."""
    from cablepod.periodic._kernels_map import SIZES, TURNS, scaled_and_turned  # numba is imported only to compute

    if known:
        most = max(state.harmonics for state in known)
        z = [state.resized(most).z for state in known]
        like = known[-1].resized(most)
        if len(z) == 3:
            yield like.changed((3.0 * (z[2] - z[1]) + z[0])[:-1].reshape(-1, like.size), omega)
        if len(z) > 1:
            yield like.changed((2.0 * z[-1] - z[-2])[:-1].reshape(-1, like.size), omega)
    if last is not None:
        yield last
    yield solver.rest(omega, HARMONICS)
    if last is not None:
        for k in range(SIZES * TURNS):
            other = last.z.copy()
            scaled_and_turned(last.z, last.size, 2.0 ** (k % SIZES), k // SIZES / TURNS, other)
            yield last.changed(other[:-1].reshape(-1, last.size))


def _judge(solver: Solver, state: State, result: MapResult, place: tuple[int, int]) -> None:
    """Enter growth rates, deflection and smallest force of a response."""
    model = solver.model
    stability = solver.stability(state)
    scale = model.scales[0]
    for k, (_, part) in enumerate(sets_of(model, state)):
        growth, result.kind[k][place] = growth_of(stability.multipliers[part], 2.0 * np.pi / state.omega)
        result.growth[k][place] = growth * scale
    phases = max(fields.PHASES, 4 * state.harmonics)
    result.response[place] = fields.largest_deflection(model, fields.coordinates(model, state, phases))
    result.smallest_force[place] = stability.smallest_force
    result.tail[place] = state.tail


def _add_edges(solver: Solver, states: list[State | None], result: MapResult, a: int) -> None:
    """Locate the changes of stability between neighbouring frequencies at one amplitude."""
    for f, (first, second) in enumerate(pairwise(states)):
        if first is None or second is None:
            continue
        for k in range(len(sets_of(solver.model, first))):
            kinds = result.kind[k, a, f : f + 2]
            if (kinds[0] > 0) != (kinds[1] > 0) and kinds.max() < FAILED:
                result.add_edge(solver, first, second, (k, a, f), int(kinds.max()))
