"""Maps of stability by the general solver, where damping is not by mass alone: all frequencies, amplitude by amplitude."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from cablepod.periodic import _fields as fields
from cablepod.periodic._continuation import adapted_at
from cablepod.periodic._general import solver_of
from cablepod.periodic._map import HARMONICS, MapResult, changes, even_steps
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._multipliers import growth_of
from cablepod.periodic._period import check_period
from cablepod.periodic._solve import Solver, State, sets_of
from cablepod.periodic._start import grown


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
    is_even = even_steps(amplitudes)
    states: list[list[State | None]] = [[] for _ in omega]  # at each frequency, by rising amplitude
    for a, model in enumerate(models):
        solver, now = solver_of(model), dict[int, State]()
        for f, value in enumerate(omega):
            rest = solver.rest(float(value) / scale, HARMONICS)
            state = _solved(solver, guesses(rest, states[f], bool(is_even[a])))
            if a == 0 and state is None:
                start, solved = grown(solver, rest.omega, HARMONICS)
                state = _solved(solver, [start]) if solved else None
            states[f].append(state)
            if state is not None:
                now[f] = state
                _judge(solver, state, result, (a, f))
            result.finished[a, f] = True
            progress((a * omega.size + f + 1) / result.response.size)
        for k, _, f in changes(result.kind[:, a : a + 1]):
            result.add_edge(solver, now[f], now[f + 1], (k, a, f), int(result.kind[k, a, f : f + 2].max()))
        model.forget_rows()


def guesses(rest: State, states: Sequence[State | None], is_even: bool) -> Iterator[State]:
    """Yield first guesses of a response, as the compiled map takes them.

    Parameters
    ----------
    rest
        State of rest at the frequency.
    states
        Responses of all smaller amplitudes, None where none was found.
    is_even
        Whether the last four amplitudes differ by equal steps.
    """
    from cablepod.periodic._kernels_map import GUESSES, first_guess  # numba is imported only to compute

    newest = list(reversed(states))
    known = [state for state in newest if state is not None][:3]
    count = next((i for i, state in enumerate(newest) if state is None), len(newest)) if known else -1
    rest = rest.resized(max([rest.harmonics, *(state.harmonics for state in known)]))
    last = np.stack([state.resized(rest.harmonics).z for state in [*known, rest, rest, rest][:3]])
    for number in range(GUESSES):
        z = rest.z.copy()
        if first_guess(number, last, count, is_even, rest.z[:-1], rest.size, z):
            yield replace(rest, z=z)


def _solved(solver: Solver, guesses: Iterable[State]) -> State | None:
    """Return the response from the first guess that leads to one; None for none."""
    for guess in guesses:
        state, _, iterations = adapted_at(solver, guess)
        if iterations > 0:
            return state
    return None


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
