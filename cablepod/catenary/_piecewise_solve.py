"""Searches for cables of several pieces: the force at the lower end for a length, the length for any other quantity.

The force is the minimum of a convex function, the complementary energy, so that Newton's method with a line search finds it.  A
given tension determines the length by a bracketed root search.  Derivatives are exact, by complex steps.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cablepod.catenary._bracket import force_by_sag
from cablepod.catenary._end_force import GAP_RTOL, force_to_reach
from cablepod.catenary._formulas import FOUND
from cablepod.catenary._piecewise import (
    ALONG_LOAD,
    Pieces,
    PiecewiseCatenary,
    has_no_shape,
    pieces_of,
    quantity,
    reach_of,
    size_of,
)
from cablepod.catenary._uniform import resolved, solve_catenary
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._nonuniform import attachment_fractions
from cablepod.parameters._parameters import Parameters

#: Complex step over the size of what is changed (its square is far below rounding).
COMPLEX_STEP = 1e-30
#: Relative error of the given quantity, and last change of the length, at which the search ends; maximum of trials.
VALUE_RTOL, LENGTH_RTOL, LENGTH_TRIALS = 1e-13, 1e-9, 300
#: Relative bracket of the length of least tension, near which the tension is quadratic; largest factor of a step.
MINIMUM_RTOL, LONGEST_STEP = 1e-7, 2.0
#: Length over chord up to which a cable is so taut that its tension falls with the length.
TAUT = 1.02
#: Lengths beyond a minimum at which a scan looks for another one: their number, and the last over the first.
SCANNED, LONGEST_SCAN = 60, 30.0
#: Strain of a first guess where the uniform cable has no solution.
FIRST_STRAIN = 1e-3


class _Solved(NamedTuple):
    """Solution of one length."""

    catenary: PiecewiseCatenary
    change: np.ndarray  #: derivative of the force at the lower end with respect to the length (dims,) [N/m]
    value: float  #: of the given quantity [N]
    slope: float  #: its derivative with respect to the length [N/m]


class _Search:
    """Searches of a cable: the force at its lower end for a length, and the length for a given quantity."""

    def __init__(self, p: Parameters, key: str) -> None:
        self.p, self.key = p, key
        self.chord = p.initial_ends[1] - p.initial_ends[0]

    def at(self, length: float, guess: np.ndarray) -> _Solved | None:
        """Solve a cable of a length [m] from a first force [N]; None without a solution."""
        pieces = pieces_of(self.p, length)
        force = _force(pieces, self.chord, guess)
        if force is None:
            return None
        _, compliance, growth = _chord(pieces, force)
        catenary = PiecewiseCatenary(pieces, force)
        loads = catenary.end_forces[0] - catenary.end_forces[1]
        change = np.linalg.solve(compliance, -growth)  # of the force with the length
        growing = (pieces.rate[:, None] * pieces.load).sum(axis=0)
        step = (
            COMPLEX_STEP
            * max(float(size_of(force)), 1.0)
            / max(float(size_of(change)), float(size_of(growing)), 1e-300)
        )
        moved = quantity(self.key, force + 1j * step * change, loads + 1j * step * growing)
        return _Solved(catenary, change, float(moved.real), float(moved.imag / step))

    def uniform(self, value: float, length: float) -> tuple[float, np.ndarray]:
        """Return length [m] and force at the lower end [N] of the uniform cable of the mean stiffness and load.

        Weights of attached masses are spread over `length`; without a solution, the cable is as long as its chord.
        """
        return _uniform(pieces_of(self.p, length), self.chord, self.key, value, length)


def _uniform(pieces: Pieces, chord: np.ndarray, key: str, value: float, length: float) -> tuple[float, np.ndarray]:
    """Return length [m] and force [N] of the uniform cable, as :meth:`_Search.uniform`."""
    load = pieces.drops(pieces.length)[-1:] / length
    stiffness = length / float((pieces.length / pieces.stiffness).sum())
    *plane, across, against = (field[0] for field in resolved(chord[None], load))
    for name, given in ((key, value), ("unstretched_length", plane[2] * (1.0 - FIRST_STRAIN))):
        found, status = solve_catenary(plane, stiffness, name, given)
        if status == FOUND:
            break
    horizontal, middle = found[2:4]
    return float(found[0]), horizontal * across + middle * against + 0.5 * length * load[0]


def _chord(pieces: Pieces, force: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the chord (dims,) [m], its derivatives with respect to the force (dims, dims), and to the length (dims,)."""
    dims = force.size
    step = COMPLEX_STEP * (float(size_of(force)) or 1.0)
    forces = np.concatenate([force + 1j * step * np.eye(dims), force[None]])
    lengths = np.tile(pieces.length.astype(complex), (dims + 1, 1))
    step_length = COMPLEX_STEP * float(pieces.length.sum())
    lengths[-1] += 1j * step_length * pieces.rate
    lower = forces[:, None, :] - pieces.drops(lengths)[:, :-1]
    reach = reach_of(lower, pieces.load, lengths, pieces.stiffness).sum(axis=1)
    return reach[-1].real, reach[:-1].imag / step, reach[-1].imag / step_length


def _force(pieces: Pieces, chord: np.ndarray, guess: np.ndarray) -> np.ndarray | None:
    """Return the force at the lower end that makes pieces reach the `chord` [m]; None if none is found."""
    tolerance = GAP_RTOL * max(float(pieces.length.sum()), float(size_of(chord)))
    force, gap = force_to_reach(lambda force: _chord(pieces, force)[:2], chord, guess, tolerance)
    return force if gap <= tolerance else None


@lru_cache(64)
def solve_pieces(p: Parameters, key: str, value: float, name: str) -> PiecewiseCatenary:
    """Solve a cable of several pieces for one given quantity; the shorter one of two.

    Parameters
    ----------
    p
        Parameters; loads act with their values at time 0.
    key, value
        One of ``LENGTH_KEYS`` and its value [N or m].
    name
        Key in errors.

    Raises
    ------
    SceneError
        If no such cable exists; the message names the least possible tension.
    """
    if key == "sag":
        catenary = _of_sag(p, value, name)
        attachment_fractions(p, catenary.total)
        return catenary
    search = _Search(p, key)
    if key == "unstretched_length":
        attachment_fractions(p, value)
        return between_ends(pieces_of(search.p, value), search.chord, value, name)
    catenary = _of_quantity(search, value, name)
    attachment_fractions(p, catenary.total)
    return catenary


def between_ends(pieces: Pieces, chord: np.ndarray, length: float, name: str) -> PiecewiseCatenary:
    """Solve pieces of known lengths, `length` in sum [m], for the force that makes them reach a chord (dims,) [m].

    Raises
    ------
    SceneError
        If no such cable exists; the message begins with the key `name` of the length.
    """
    if has_no_shape(pieces, chord):
        longest = float(size_of(chord))
        allowed = f"at most the chord, {longest:.12g} m, as a slack cable without load has no shape at rest"
        raise scene_error(name, length, allowed)
    force = _force(pieces, chord, _uniform(pieces, chord, "unstretched_length", length, length)[1])
    if force is None:
        raise scene_error(name, length, "a value with a catenary in double precision")
    return PiecewiseCatenary(pieces, force)


def end_stiffness(catenary: PiecewiseCatenary) -> np.ndarray:
    """Return the static stiffness of the upper end of a cable, the lower one held (dims, dims) [N/m]."""
    return np.linalg.inv(_chord(catenary.pieces, catenary.force)[1])


def _of_quantity(search: _Search, value: float, name: str) -> PiecewiseCatenary:
    """Find the shortest cable of a given tension or force across the load [N].

    Heavy masses can make several minima over the length; those beyond the first one are looked for in a scan.
    """
    chord, low = float(size_of(search.chord)), _shortest(search, value, name)
    length, guess = search.uniform(value, chord)
    if not low < length < TAUT * chord:
        length, guess = low, search.uniform(value, low)[1]
    catenary, least, beyond = _root(search, value, (low, length, math.inf), guess)
    if catenary is None:
        for length in beyond * np.geomspace(1.0, LONGEST_SCAN, SCANNED):
            solved = search.at(length, guess)
            if solved is not None and solved.value <= value:
                catenary, *_ = _root(search, value, (beyond, length, length), solved.catenary.force)
                break
            if solved is not None:
                beyond, guess, least = length, solved.catenary.force, min(least, solved.value)
    if catenary is None:
        raise scene_error(name, value, f"at least {least:.6g} N, the minimum over all lengths of this cable")
    return catenary


def _root(
    search: _Search, value: float, lengths: tuple[float, float, float], guess: np.ndarray
) -> tuple[PiecewiseCatenary | None, float, float]:
    """Find a given quantity by Newton's method in a bracket of the length.

    Parameters
    ----------
    search, value
        As in :func:`_of_quantity`.
    lengths
        Lower bound, at which the quantity is larger than its value, first length and upper bound [m].
    guess
        First force at the lower end (dims,) [N].

    Returns
    -------
    tuple
        Cable, None if the quantity has a minimum above the value; least quantity of all trials [N]; length from which on it
        rises [m].
    """
    low, length, high = lengths
    least, rises_at = math.inf, math.inf
    for _ in range(LENGTH_TRIALS):
        solved = search.at(length, guess)
        if solved is None:
            high, length = length, 0.5 * (low + length)
            continue
        guess, least = solved.catenary.force, min(least, solved.value)
        falls = solved.slope < 0.0
        change = (value - solved.value) / solved.slope if falls else math.nan
        if abs(change) <= LENGTH_RTOL * length or abs(solved.value - value) <= VALUE_RTOL * value:
            # the given quantity is met, although the length is rounded
            change = change if falls else 0.0
            return (
                PiecewiseCatenary(pieces_of(search.p, length + change), guess + change * solved.change),
                least,
                length,
            )
        if solved.value > value and falls:
            low = length
        else:
            high = length
            rises_at = math.inf if falls else length
        new = min(length + change, LONGEST_STEP * length)
        if not low < new < high:
            new = 0.5 * (low + high) if high < math.inf else LONGEST_STEP * length
        if rises_at - low <= MINIMUM_RTOL * low and solved.value > (1.0 + MINIMUM_RTOL) * value:
            return None, least, rises_at
        length = new
    return None, least, length


def _of_sag(p: Parameters, sag: float, name: str) -> PiecewiseCatenary:
    """Find the cable of a given sag [m], which falls as the force across the load rises, by a bracket of this force."""
    search = _Search(p, "horizontal_force")
    chord = float(size_of(search.chord))
    pieces = pieces_of(p, chord)
    load = float(size_of(pieces.drops(pieces.length)[-1]))
    if not load > 0.0:
        raise scene_error(name, sag, "a tension or a length, as a cable without load has no sag")

    def excess(logarithm: float) -> float:
        try:
            found = _of_quantity(search, math.exp(logarithm), name).sag
        except SceneError:
            raise scene_error(name, sag, "a tension or a length, as the chord lies along the load") from None
        return math.log(max(found, 1e-300) / sag)

    force = force_by_sag(excess, math.log(load * chord / (8.0 * sag)))  # of a parabola
    return _of_quantity(search, force, name)


def _shortest(search: _Search, value: float, name: str) -> float:
    """Return a length [m] at which the given quantity is larger than its `value` [N].

    The mean strain of a cable is at least that of its chord, and the tensions differ by the loads at most.
    """
    chord = float(size_of(search.chord))
    pieces = pieces_of(search.p, chord)
    loads, stiffness = pieces.drops(pieces.length)[-1], chord / float((pieces.length / pieces.stiffness).sum())
    load, share = float(size_of(loads)), 1.0
    if search.key == "horizontal_force" and load > 0.0:
        across = search.chord - float(search.chord @ loads) / load**2 * loads
        share = float(size_of(across)) / chord
        if share <= ALONG_LOAD:
            allowed = "a tension or a length, as the chord lies along the load and no force acts across it"
            raise scene_error(name, value, allowed)
    return chord / (1.0 + 2.0 * (value / share + 2.0 * load) / stiffness)
