"""Statics of a cable of several pieces: segments with properties of their own, weights attached between them.

The force t that the upper part exerts on the lower one falls by the load q along a piece, and by the weight P of what is
attached at its upper end.  With the means t_m and T_m of the force and of its size over both ends of a piece of length l, the
part p of t_m across q, and z = |q| l / (2 T_m), the piece reaches by the linear law

    R = l t_m / K + (l / T_m) (t_m + p (artanh(z) / z - 1)),

without differences that cancel, whatever the directions of the loads.  The force at the lower end makes the sum of all R the
chord.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cablepod.parameters._parameters import Parameters

#: Distance of two cuts that are one, over the length.
SAME_CUT = 1e-9
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

    def cut(self, places: np.ndarray) -> Pieces:
        """Return the same cable cut at further unstretched arc lengths [m] too, but for those at a cut that is there."""
        ends = np.cumsum(self.length)
        near = np.abs(np.append(ends, 0.0)[:, None] - places).min(axis=0) <= SAME_CUT * ends[-1]
        borders = np.union1d(ends, places[~near])
        length = np.diff(borders, prepend=0.0)
        which = np.searchsorted(ends, borders - 0.5 * length)
        attached = np.zeros((length.size, self.attached.shape[1]))
        attached[np.searchsorted(borders, ends)] = self.attached
        rate = self.rate[which] * length / self.length[which]
        return Pieces(length, rate, self.stiffness[which], self.load[which], attached)


def pieces_of(p: Parameters, total: float) -> Pieces:
    """Cut a cable of `total` unstretched length [m] at the ends of its segments and at its attached masses."""
    bounds = [segment.end for segment in p.segments[:-1]]
    masses = [attachment for attachment in p.attachments if attachment.mass]
    places = np.array(bounds + [attachment.fraction(total) for attachment in masses])
    # place = slope times length of the cable + a constant
    slopes = np.array(bounds + [attachment.slope(total) for attachment in masses])
    weights = np.array([np.zeros(p.dims) for _ in bounds] + [attachment.weight for attachment in masses])
    weights = weights.reshape(-1, p.dims)
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


def size_of(vectors: np.ndarray) -> np.ndarray:
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
    size, size_upper = size_of(force), size_of(upper)
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


def reach_of(force: np.ndarray, load: np.ndarray, length: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
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
        reach = reach_of(force, pieces.load, pieces.length, pieces.stiffness)
        position = np.concatenate([np.zeros((1, self.force.size)), np.cumsum(reach, axis=0)[:-1]])
        return np.concatenate([[0.0], np.cumsum(pieces.length)[:-1]]), position, force

    def at(self, arc_length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions from the lower end (points, dims) [m] and forces (points, dims) [N] at unstretched arc lengths [m].

        The force jumps at an attached mass; there it is the one below.
        """
        start, position, force = self._starts
        which = np.maximum(np.searchsorted(start, arc_length) - 1, 0)
        length, load = arc_length - start[which], self.pieces.load[which]
        reach = reach_of(force[which], load, length, self.pieces.stiffness[which])
        return position[which] + reach, force[which] - load * length[:, None]

    @cached_property
    def end_forces(self) -> np.ndarray:
        """Forces at both ends of the cable (end, dims) [N]."""
        return np.stack([self.force, self.force - self.pieces.drops(self.pieces.length)[-1]])

    @cached_property
    def columns(self) -> np.ndarray:
        """Solution (6,) as in ``_formulas.COLUMNS``; forces against and across the sum of all loads."""
        pieces = self.pieces
        tension = _tension_integral(self._starts[2], pieces.load, pieces.length)
        ends = self.end_forces
        loads = ends[0] - ends[1]
        unit = loads / (math.hypot(*loads) or 1.0)
        mid = self.at(np.array([0.5 * self.total]))[1][0]
        stretched = self.total + float((tension / pieces.stiffness).sum())
        horizontal = float(quantity("horizontal_force", self.force, loads))
        lower, upper = np.sqrt((ends * ends).sum(axis=1))
        return np.array([self.total, stretched, horizontal, -float(mid @ unit), lower, upper])

    @cached_property
    def sag(self) -> float:
        """Largest distance from the chord along the sum of all loads [m]; 0 without loads or along them.

        Where it is largest inside of a piece, the force has no part along the normal of the chord in its plane with the loads;
        the force is linear in the arc length.
        """
        start, _, force = self._starts
        ends, chord = self.end_forces, self.at(np.array([self.total]))[0][0]
        loads = ends[0] - ends[1]
        load = loads / (math.hypot(*loads) or 1.0)
        across = chord - (chord @ load) * load
        if not across @ across > ALONG_LOAD * (chord @ chord):
            return 0.0
        # of a position: its distance from the chord along the load
        measure = load - (chord @ load) / (across @ across) * across
        rates = self.pieces.load @ measure
        with np.errstate(all="ignore"):
            inside = np.clip(force @ measure / rates, 0.0, self.pieces.length)
        inside = np.where(np.isfinite(inside), inside, 0.0)
        places = np.clip(np.concatenate([start + inside, start]), 0.0, self.total)
        return float(max((self.at(places)[0] @ measure).max(), 0.0))

    @cached_property
    def largest_strain(self) -> float:
        """Largest strain; that of a piece is at one of its ends."""
        lower = self._starts[2]
        upper = lower - self.pieces.load * self.pieces.length[:, None]
        return float((np.maximum(size_of(lower), size_of(upper)) / self.pieces.stiffness).max())


def quantity(key: str, force: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """Return a given quantity from the force at the lower end and the sum of all loads (..., dims) [N]."""
    if key == "bottom_tension":
        return size_of(force)
    if key == "top_tension":
        return size_of(force - loads)
    square = (loads * loads).sum(axis=-1)
    along = (force * loads).sum(axis=-1) / np.where(square == 0.0, 1.0, square)
    return size_of(force - along[..., None] * loads)


def has_no_shape(pieces: Pieces, chord: np.ndarray) -> bool:
    """Tell whether pieces are longer than their chord (dims,) [m] and have no load."""
    is_slack = float(pieces.length.sum()) > float(size_of(chord))
    return is_slack and not pieces.load.any() and not pieces.attached.any()
