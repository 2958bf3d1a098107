"""Statics of a cable of several pieces: segments with properties of their own, weights attached between them.

The force t that the upper part exerts on the lower one falls by the load q along a piece, and by the weight P of what is
attached at its upper end.  With the means t_m and T_m of the force and of its size over both ends of a piece of length l, the
part p of t_m across q, and z = |q| l / (2 T_m), the piece reaches by the linear law

    R = l t_m / K + (l / T_m) (t_m + p (artanh(z) / z - 1)),

without differences that cancel, whatever the directions of the loads.  The force at the lower end makes the sum of all R the
chord.  It is the minimum of a convex function (the complementary energy), so that Newton's method with a line search finds it.
A given tension determines the length by a bracketed root search, with exact derivatives by complex steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from cablepod.errors import scene_error
from cablepod.parameters._keys import LENGTH_KEYS
from cablepod.parameters._nonuniform import attachment_fractions
from cablepod.parameters._parameters import Parameters

#: Complex step over the size of what is changed (its square is far below rounding).
COMPLEX_STEP = 1e-30
#: Relative change of the force in the last step of Newton's method, and maximum number of steps.
FORCE_RTOL, FORCE_STEPS = 1e-15, 200
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
#: Component of the chord across the load, over the chord, below which the chord lies along the load.
ALONG_LOAD = 1e-15


def is_piecewise(p: Parameters) -> bool:
    """Tell whether the statics of a cable are not those of a uniform one; dampers and springs are without force at rest."""
    return bool(p.segments) or any(attachment.mass for attachment in p.attachments)


class Pieces(NamedTuple):
    """Pieces of a cable of one length, from the lower end on."""

    length: np.ndarray  #: unstretched (pieces,) [m]
    rate: np.ndarray  #: derivative of `length` with respect to the length of the cable (pieces,)
    stiffness: np.ndarray  #: (pieces,) [N]
    load: np.ndarray  #: per unstretched length (pieces, dims) [N/m]
    attached: np.ndarray  #: weight at the upper end of each piece (pieces, dims) [N]

    def drops(self, length: np.ndarray) -> np.ndarray:
        """Return the loss of force from the lower end to the lower end of each piece and to the upper end (pieces + 1, dims)."""
        own = length[..., None] * self.load + self.attached
        return np.concatenate([np.zeros_like(own[..., :1, :]), np.cumsum(own, axis=-2)], axis=-2)


def pieces_of(p: Parameters, total: float) -> Pieces:
    """Cut a cable of `total` unstretched length [m] at the ends of its segments and at its attached masses."""
    bounds = [segment.end for segment in p.segments[:-1]]
    masses = [attachment for attachment in p.attachments if attachment.mass]
    places = np.array(bounds + [attachment.fraction(total) for attachment in masses])
    # place = slope times length of the cable + a constant
    slopes = np.array(bounds + [_slope(attachment.place_key, attachment.place) for attachment in masses])
    weights = np.array([np.zeros(p.dims) for _ in bounds] + [attachment.weight for attachment in masses])
    outside = (places < 0.0) | (places > 1.0)
    places, slopes = np.clip(places, 0.0, 1.0), np.where(outside, np.round(places > 1.0), slopes)
    order = np.argsort(places, kind="stable")
    borders, slopes = (np.concatenate([[0.0], array[order], [1.0]]) for array in (places, slopes))
    middle = 0.5 * (borders[1:] + borders[:-1])
    attached = np.concatenate([weights[order], np.zeros((1, p.dims))])
    segments = p.segments or ()
    which = np.minimum(np.searchsorted([segment.end for segment in segments], middle), max(len(segments) - 1, 0))
    uniform = p.load_at(0.0) - p.weight
    stiffness = np.array([segments[i].stiffness if segments else p.stiffness for i in which])
    weight = np.array([segments[i].weight if segments else p.weight for i in which])
    return Pieces(total * np.diff(borders), np.diff(slopes), stiffness, weight + uniform, attached)


def _slope(place_key: str, place: float) -> float:
    """Return the change of the place [m] of an attachment with the length of the cable [m]."""
    return {"arc_length": place, "distance_from_lower": 0.0, "distance_from_upper": 1.0}[place_key]


def _size(vectors: np.ndarray) -> np.ndarray:
    """Return the size of vectors (..., dims), complex ones by the analytic continuation."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


class _Piece(NamedTuple):
    """What the reach and the stretched length of pieces follow from."""

    mean: np.ndarray  #: mean force of both ends (..., dims)
    across: np.ndarray  #: its part across the load (..., dims)
    size: np.ndarray  #: mean of the sizes of the forces at both ends (...)
    excess: np.ndarray  #: artanh(z) / z - 1 (...)


def _piece(force: np.ndarray, load: np.ndarray, length: np.ndarray) -> _Piece:
    """Return the means of pieces (...) with a force at their lower end and a load (..., dims)."""
    q = np.sqrt((load * load).sum(axis=-1))
    drop = load * length[..., None]
    upper = force - drop
    unit = -load / np.where(q > 0.0, q, 1.0)[..., None]  # the force grows along it
    size, size_upper = _size(force), _size(upper)
    along, along_upper = (force * unit).sum(axis=-1), (upper * unit).sum(axis=-1)
    mean = 0.5 * (force + upper)
    across = mean - (mean * unit).sum(axis=-1)[..., None] * unit
    across = across - (across * unit).sum(axis=-1)[..., None] * unit  # the first difference may have cancelled
    square = (across * across).sum(axis=-1)
    total = size + size_upper
    z = q * length / np.where(total == 0.0, 1.0, total)
    with np.errstate(all="ignore"):
        # 1 - z without cancellation, of a cable that is nearly folded on itself
        lower_part = np.where(along.real < 0.0, square / (size - along), size + along)
        upper_part = np.where(along_upper.real > 0.0, square / (size_upper + along_upper), size_upper - along_upper)
        folded = 0.5 * np.log((total + q * length) / (lower_part + upper_part)) / z
        ratio = np.where(z.real > 0.5, folded, np.arctanh(z) / z)
    excess = np.where(z.real > 1e-8, ratio - 1.0, z * z / 3.0)
    return _Piece(mean, across, 0.5 * total, np.where(square == 0.0, 0.0, excess))


def _reach(force: np.ndarray, load: np.ndarray, length: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Return the upper from the lower end of pieces (..., dims) [m], see the equation of this module."""
    piece = _piece(force, load, length)
    direction = piece.mean + piece.across * piece.excess[..., None]
    size = np.where(piece.size == 0.0, 1.0, piece.size)
    return length[..., None] * (piece.mean / stiffness[..., None] + direction / size[..., None])


def _tension_integral(force: np.ndarray, load: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Return the integral of the tension over the unstretched length of pieces (...) [N m]."""
    piece = _piece(force, load, length)
    squares = (piece.mean * piece.mean).sum(axis=-1), (piece.across * piece.across).sum(axis=-1)
    size = np.where(piece.size == 0.0, 1.0, piece.size)
    # the mean force has the size of its parts along and across the load
    return 0.5 * length * (piece.size + (squares[0] + squares[1] * piece.excess) / size)


@dataclass(frozen=True)
class PiecewiseCatenary:
    """Cable of several pieces at rest."""

    pieces: Pieces
    force: np.ndarray  #: at the lower end (dims,) [N]

    @cached_property
    def total(self) -> float:
        """Unstretched length [m]."""
        return float(self.pieces.length.sum())

    @cached_property
    def _starts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Arc length [m], position [m] from the lower end and force [N] at the lower end of each piece."""
        pieces = self.pieces
        force = self.force - pieces.drops(pieces.length)[:-1]
        reach = _reach(force, pieces.load, pieces.length, pieces.stiffness)
        position = np.concatenate([np.zeros((1, self.force.size)), np.cumsum(reach, axis=0)[:-1]])
        return np.concatenate([[0.0], np.cumsum(pieces.length)[:-1]]), position, force

    def at(self, arc_length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions from the lower end (points, dims) [m] and forces (points, dims) [N] at unstretched arc lengths [m].

        The force jumps at an attached mass; there it is the one below.
        """
        start, position, force = self._starts
        which = np.maximum(np.searchsorted(start, arc_length) - 1, 0)
        length, load = arc_length - start[which], self.pieces.load[which]
        reach = _reach(force[which], load, length, self.pieces.stiffness[which])
        return position[which] + reach, force[which] - load * length[:, None]

    @cached_property
    def end_forces(self) -> np.ndarray:
        """Forces at both ends of the cable (end, dims) [N]."""
        return np.stack([self.force, self.force - self.pieces.drops(self.pieces.length)[-1]])

    @cached_property
    def columns(self) -> np.ndarray:
        """Solution (6,) as in ``_kernels_solve.COLUMNS``; forces against and across the sum of all loads."""
        pieces = self.pieces
        tension = _tension_integral(self._starts[2], pieces.load, pieces.length)
        ends = self.end_forces
        loads = ends[0] - ends[1]
        unit = loads / (math.hypot(*loads) or 1.0)
        mid = self.at(np.array([0.5 * self.total]))[1][0]
        stretched = self.total + float((tension / pieces.stiffness).sum())
        horizontal = float(_quantity("horizontal_force", self.force, loads))
        lower, upper = np.sqrt((ends * ends).sum(axis=1))
        return np.array([self.total, stretched, horizontal, -float(mid @ unit), lower, upper])

    @cached_property
    def largest_strain(self) -> float:
        """Largest strain; that of a piece is at one of its ends."""
        lower = self._starts[2]
        upper = lower - self.pieces.load * self.pieces.length[:, None]
        return float((np.maximum(_size(lower), _size(upper)) / self.pieces.stiffness).max())


def _quantity(key: str, force: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """Return a given quantity from the force at the lower end and the sum of all loads (..., dims) [N]."""
    if key == "bottom_tension":
        return _size(force)
    if key == "top_tension":
        return _size(force - loads)
    square = (loads * loads).sum(axis=-1)
    along = (force * loads).sum(axis=-1) / np.where(square == 0.0, 1.0, square)
    return _size(force - along[..., None] * loads)


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
        step = COMPLEX_STEP * max(float(_size(force)), 1.0) / max(float(_size(change)), float(_size(growing)), 1e-300)
        moved = _quantity(self.key, force + 1j * step * change, loads + 1j * step * growing)
        return _Solved(catenary, change, float(moved.real), float(moved.imag / step))

    def uniform(self, value: float, length: float) -> tuple[float, np.ndarray]:
        """Return length [m] and force at the lower end [N] of the uniform cable of the mean stiffness and load.

        Weights of attached masses are spread over `length`; without a solution, the cable is as long as its chord.
        """
        from cablepod.catenary import _kernels_plane, _kernels_solve  # numba is imported only to compute

        pieces = pieces_of(self.p, length)
        load = pieces.drops(pieces.length)[-1:] / length
        stiffness = np.array([length / float((pieces.length / pieces.stiffness).sum())])
        plane, across, against = np.empty((4, 1)), np.empty_like(load), np.empty_like(load)
        _kernels_plane.load_planes(self.chord[None], load, plane, across, against)
        found, status = np.empty((1, 6)), np.empty(1, dtype=np.int64)
        for key, given in ((self.key, value), ("unstretched_length", float(plane[2, 0]) * (1.0 - FIRST_STRAIN))):
            _kernels_solve.solve_many(*plane, stiffness, LENGTH_KEYS.index(key), np.array([given]), found, status)
            if status[0] == _kernels_solve.FOUND:
                break
        horizontal, middle = found[0, 2:4]
        return float(found[0, 0]), horizontal * across[0] + middle * against[0] + 0.5 * length * load[0]


def _chord(pieces: Pieces, force: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the chord (dims,) [m], its derivatives with respect to the force (dims, dims), and to the length (dims,)."""
    dims = force.size
    step = COMPLEX_STEP * (float(_size(force)) or 1.0)
    forces = np.concatenate([force + 1j * step * np.eye(dims), force[None]])
    lengths = np.tile(pieces.length.astype(complex), (dims + 1, 1))
    step_length = COMPLEX_STEP * float(pieces.length.sum())
    lengths[-1] += 1j * step_length * pieces.rate
    lower = forces[:, None, :] - pieces.drops(lengths)[:, :-1]
    reach = _reach(lower, pieces.load, lengths, pieces.stiffness).sum(axis=1)
    return reach[-1].real, reach[:-1].imag / step, reach[-1].imag / step_length


def _force(pieces: Pieces, chord: np.ndarray, force: np.ndarray) -> np.ndarray | None:
    """Return the force at the lower end that makes pieces reach the `chord` [m]; None if Newton's method does not end."""
    reach, compliance, _ = _chord(pieces, force)
    residual = reach - chord
    before = math.inf
    for _ in range(FORCE_STEPS):
        try:
            step = np.linalg.solve(compliance, -residual)
        except np.linalg.LinAlgError:
            return None
        slope = float(residual @ step)
        size = float(_size(step)) / max(float(_size(force)), 1e-300)
        if not np.isfinite(size):
            return None
        # rounding ends the decrease of the steps
        if size <= FORCE_RTOL or (size < 1e-9 and size >= 0.5 * before):
            return force + step if size < before else force
        before, factor = size, 1.0
        for _ in range(60):
            trial = force + factor * step
            reach, compliance, _ = _chord(pieces, trial)
            residual = reach - chord
            if np.isfinite(residual).all() and float(residual @ step) <= 0.5 * abs(slope):
                break
            factor *= 0.5
        force = trial
    return None


def is_slack_weightless(p: Parameters, length: float) -> bool:
    """Tell whether a cable of a length [m] is longer than its chord and has no load."""
    pieces = pieces_of(p, length)
    chord = float(_size(p.initial_ends[1] - p.initial_ends[0]))
    return length > chord and not pieces.load.any() and not pieces.attached.any()


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
    search = _Search(p, key)
    if key == "unstretched_length":
        attachment_fractions(p, value)
        return _of_length(search, value, name)
    catenary = _of_quantity(search, value, name)
    attachment_fractions(p, catenary.total)
    return catenary


def _of_length(search: _Search, length: float, name: str) -> PiecewiseCatenary:
    """Solve a cable of a length [m]."""
    pieces = pieces_of(search.p, length)
    if is_slack_weightless(search.p, length):
        chord = float(_size(search.chord))
        allowed = f"at most the chord, {chord:.12g} m, as a slack cable without load has no shape at rest"
        raise scene_error(name, length, allowed)
    force = _force(pieces, search.chord, search.uniform(length, length)[1])
    if force is None:
        raise scene_error(name, length, "a value with a catenary in double precision")
    return PiecewiseCatenary(pieces, force)


def _of_quantity(search: _Search, value: float, name: str) -> PiecewiseCatenary:
    """Find the shortest cable of a given tension or force across the load [N].

    Heavy masses can make several minima over the length; those beyond the first one are looked for in a scan.
    """
    chord, low = float(_size(search.chord)), _shortest(search, value, name)
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


def _shortest(search: _Search, value: float, name: str) -> float:
    """Return a length [m] at which the given quantity is larger than its `value` [N].

    The mean strain of a cable is at least that of its chord, and the tensions differ by the loads at most.
    """
    chord = float(_size(search.chord))
    pieces = pieces_of(search.p, chord)
    loads, stiffness = pieces.drops(pieces.length)[-1], chord / float((pieces.length / pieces.stiffness).sum())
    load, share = float(_size(loads)), 1.0
    if search.key == "horizontal_force" and load > 0.0:
        across = search.chord - float(search.chord @ loads) / load**2 * loads
        share = float(_size(across)) / chord
        if share <= ALONG_LOAD:
            allowed = "a tension or a length, as the chord lies along the load and no force acts across it"
            raise scene_error(name, value, allowed)
    return chord / (1.0 + 2.0 * (value / share + 2.0 * load) / stiffness)
