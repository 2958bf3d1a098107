"""Finite elements of the mast: Euler-Bernoulli beam-column in two horizontal directions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, wraps
from typing import Any, TypeVar

import numpy as np

from cablepod.catenary._end_stiffness import gauss_rule
from cablepod.errors import OutOfRangeWarning, warn
from cablepod.parameters._mast import CLOSE, MastParameters

#: Points of Gauss quadrature of an element: products of cubic shapes with a linear axial force are exact.
GAUSS_POINTS = 4
#: Columns of the sections of :class:`MastParameters`.
BOTTOM, TOP, BENDING_STIFFNESS, MASS, DRAG_AREA = range(5)
#: Directions of the displacement: x and z.
DIRECTIONS = (0, 2)
#: Slope of the mast above which it is not small: its square is about the relative error of the beam's equations.
LARGE_SLOPE = 0.1

F = TypeVar("F", bound=Callable[..., Any])


def kept(method: F) -> F:
    """Keep the results of a method in its object, by the arguments."""
    name = f"_{method.__name__}_kept"

    @wraps(method)
    def of_arguments(self: Any, *arguments: Any) -> Any:
        known = vars(self).setdefault(name, {})
        if arguments not in known:
            known[arguments] = method(self, *arguments)
        return known[arguments]

    return of_arguments  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class Beam:
    """Mesh and matrices of a mast.

    Unknowns are displacement and slope of each node, first all in x, then all in z, without those that the base holds.
    """

    sections: np.ndarray  #: of the mast, see :class:`MastParameters`
    base: str  #: "pinned" or "clamped"
    gravity: float  #: [m/s2]
    height: np.ndarray  #: of the nodes (node,) [m]; guys, loads and ends of sections are at nodes

    @cached_property
    def length(self) -> np.ndarray:
        """Lengths of the elements [m]."""
        return np.diff(self.height)

    @cached_property
    def middle(self) -> np.ndarray:
        """Heights of the middles of the elements [m]: what is above an element, whatever the rounding of its nodes."""
        return 0.5 * (self.height[1:] + self.height[:-1])

    @cached_property
    def section(self) -> np.ndarray:
        """Rows of the sections of the elements (element, 5)."""
        index = np.searchsorted(self.sections[:, TOP], self.middle)
        return self.sections[np.minimum(index, len(self.sections) - 1)]

    @cached_property
    def free(self) -> np.ndarray:
        """Indices of the free unknowns of one direction."""
        return np.arange(1 if self.base == "pinned" else 2, 2 * self.height.size)

    @property
    def count(self) -> int:
        """Number of free unknowns in both directions."""
        return 2 * self.free.size

    @cached_property
    def mass(self) -> np.ndarray:
        """Consistent mass matrix (count, count) [kg, kg m, kg m2]."""
        return self._both(self._assembled(0, self.section[:, MASS, None] * np.ones(GAUSS_POINTS)))

    @cached_property
    def bending(self) -> np.ndarray:
        """Stiffness matrix of bending (count, count)."""
        return self._both(self._assembled(2, self.section[:, BENDING_STIFFNESS, None] * np.ones(GAUSS_POINTS)))

    def geometric(self, levels: np.ndarray, pull: np.ndarray) -> np.ndarray:
        """Return the stiffness of the axial force (count, count), negative under compression.

        Parameters
        ----------
        levels, pull
            Heights of the guys [m] and their vertical pull on the mast, downwards (guys,) [N].
        """
        total = self._of_weight.copy()
        for level, force in zip(levels.tolist(), pull.tolist(), strict=True):
            total += force * self._of_pull(level)
        return self._both(total)

    def of_pull(self, level: float) -> np.ndarray:
        """Return the geometric stiffness of a downward pull of one at a height [m] (count, count) [1/m]."""
        return self._both(self._of_pull(level))

    @cached_property
    def _of_weight(self) -> np.ndarray:
        """Stiffness of the weight of the mast, of one direction."""
        return self._assembled(1, -self.compression(self._places, np.zeros(0), np.zeros(0)))

    @kept
    def _of_pull(self, level: float) -> np.ndarray:
        """Return the stiffness of a pull of one at a height [m], of one direction."""
        return self._assembled(1, -1.0 * (level > self.middle[:, None]))

    def compression(self, place: np.ndarray, levels: np.ndarray, pull: np.ndarray) -> np.ndarray:
        """Return the axial force at heights [m] within elements, positive in compression: weight and guys above [N]."""
        weight = self.section[:, MASS] * self.gravity
        above = np.concatenate([np.cumsum((weight * self.length)[::-1])[::-1], [0.0]])
        element = np.clip(np.searchsorted(self.height, place, side="right") - 1, 0, self.length.size - 1)
        own = above[element] - weight[element] * (place - self.height[element])
        return own + (pull * (levels > self.middle[element][..., None])).sum(axis=-1)

    @cached_property
    def _places(self) -> np.ndarray:
        """Heights of the quadrature points (element, point) [m]."""
        return self.height[:-1, None] + self.length[:, None] * gauss_rule(GAUSS_POINTS)[0]

    def _blocks(self, derivative: int, values: np.ndarray) -> np.ndarray:
        """Integrate values (element, point) times products of derivatives of the shapes, for each element (element, 4, 4)."""
        shapes = self._shapes(derivative)
        return (shapes * (self.length[:, None] * gauss_rule(GAUSS_POINTS)[1] * values)[:, None]) @ np.swapaxes(
            shapes, 1, 2
        )

    def _assembled(self, derivative: int, values: np.ndarray) -> np.ndarray:
        """Return the same for all unknowns of one direction."""
        matrix = np.zeros((2 * self.height.size, 2 * self.height.size))
        for e, block in enumerate(self._blocks(derivative, values)):
            matrix[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += block
        return matrix[np.ix_(self.free, self.free)]

    @kept
    def _shapes(self, derivative: int) -> np.ndarray:
        """Return a derivative of the shapes at the quadrature points (element, 4, point)."""
        return np.array([hermite(gauss_rule(GAUSS_POINTS)[0], s, derivative) for s in self.length.tolist()])

    def _both(self, matrix: np.ndarray) -> np.ndarray:
        zero = np.zeros_like(matrix)
        return np.block([[matrix, zero], [zero, matrix]])

    @cached_property
    def all_rows(self) -> np.ndarray:
        """Matrix from the unknowns to the displacement of all nodes in x and z (node, 2, count)."""
        return self.along_both(np.eye(2 * self.height.size)[::2])

    def nodes_at(self, heights: Sequence[float] | np.ndarray) -> np.ndarray:
        """Return the indices of the nodes that places at heights [m] have (heights,)."""
        return np.abs(self.height - np.reshape(heights, (-1, 1))).argmin(axis=1)

    def rows_at(self, heights: Sequence[float] | np.ndarray) -> np.ndarray:
        """Return the matrix from the unknowns to the displacement in x and z at heights [m] of nodes or close to them.

        Its dimensions are (heights, 2, count).  Beside a node the slope of the node adds to its displacement, and forces there
        have their moment about the node.
        """
        node, unknowns = self.nodes_at(heights), np.eye(2 * self.height.size)
        beside = np.reshape(heights, -1) - self.height[node]
        return self.along_both(unknowns[2 * node] + beside[:, None] * unknowns[2 * node + 1])

    def section_rows(self, levels: np.ndarray, pull: np.ndarray) -> np.ndarray:
        """Return the matrix from the unknowns to the section forces in x and z (node + element ends, 2, count).

        First the bending moments at the nodes, then the horizontal force at the lower and the upper end of each element, of what
        is above on what is below.  They are the forces on the ends of the elements, bending and axial force together: in
        equilibrium with the loads, which moments by EI w'' of cubic shapes are to the order of the mesh only.  Loads on the
        elements themselves add :meth:`sections_of_loads`.

        Parameters
        ----------
        levels, pull
            Heights of the guys [m] and their vertical pull on the mast, downwards (guys,) [N].
        """
        total = self._sections_without_guys.copy()
        for level in np.unique(levels).tolist():
            total += float(pull[levels == level].sum()) * self.sections_of_pull(level)
        return total

    @kept
    def sections_of_pull(self, level: float) -> np.ndarray:
        """Return what a downward pull of one at a height [m] adds to :meth:`section_rows`."""
        return self._sections(self._blocks(1, -1.0 * (level > self.middle[:, None])))

    @cached_property
    def _sections_without_guys(self) -> np.ndarray:
        weight = self._blocks(1, -self.compression(self._places, np.zeros(0), np.zeros(0)))
        return self._sections(
            self._blocks(2, self.section[:, BENDING_STIFFNESS, None] * np.ones(GAUSS_POINTS)) + weight
        )

    @cached_property
    def inertia_sections(self) -> np.ndarray:
        """Matrix from accelerations of the unknowns to section forces by a load of mass times acceleration, the unknowns held."""
        return self._sections(-self._blocks(0, self.section[:, MASS, None] * np.ones(GAUSS_POINTS)))

    def _sections(self, blocks: np.ndarray) -> np.ndarray:
        """Return the matrix from the unknowns to section forces, for the stiffness of each element (element, 4, 4)."""
        loads = np.zeros((self.length.size, 4, 2 * self.height.size))
        for e, block in enumerate(blocks):
            loads[e, :, 2 * e : 2 * e + 4] = -block
        return self.along_both(self.sections_of_loads(loads))

    def sections_of_loads(self, loads: np.ndarray) -> np.ndarray:
        """Return section forces by loads on the elements themselves, of one direction (node + element ends, columns).

        Parameters
        ----------
        loads
            Force and moment at the lower, then at the upper end of each element, which have the work of its loads on cubic
            displacements (element, 4, columns).
        """
        nodes, count = self.height.size, self.length.size
        sides = np.full(nodes, 2.0)
        sides[[0, -1]] = 1.0
        moments, forces = np.zeros((nodes, loads.shape[2])), np.empty((count, 2, loads.shape[2]))
        moments[:-1] += loads[:, 1] / sides[:-1, None]
        moments[1:] -= loads[:, 3] / sides[1:, None]
        moments[-1] = 0.0  # ends that turn freely have no moment, in motion either
        if self.base == "pinned":
            moments[0] = 0.0
        forces[:, 0], forces[:, 1] = loads[:, 0], -loads[:, 2]
        return np.concatenate([moments, forces.reshape(2 * count, -1)])

    def along_both(self, single: np.ndarray) -> np.ndarray:
        """Return rows of the unknowns of one direction, held ones too (rows, 2 nodes), as rows in x and z (rows, 2, count)."""
        result = np.zeros((len(single), 2, self.count))
        for direction in range(2):
            result[:, direction, direction * self.free.size : (direction + 1) * self.free.size] = single[:, self.free]
        return result


def beam_of(p: MastParameters) -> Beam:
    """Make the mesh of a mast: nodes at all guys, loads and ends of sections, the other elements where they are longest."""
    nodes = [0.0, p.height]
    for place in (*p.sections[:, TOP], *(guy.level for guy in p.guys), *(load.level for load in p.loads)):
        if np.abs(place - np.array(nodes)).min() > CLOSE * p.height:
            nodes.append(place)
    places = np.sort(nodes)
    spans = np.diff(places)
    count = np.ones(spans.size, dtype=int)
    while count.sum() < p.elements:
        count[int((spans / count).argmax())] += 1
    parts = [a + (b - a) / n * np.arange(n) for a, b, n in zip(places[:-1], places[1:], count.tolist(), strict=True)]
    height = np.concatenate([*parts, places[-1:]])
    return _kept_beam(np.ascontiguousarray(p.sections).tobytes(), p.base, p.gravity, height.tobytes())


@lru_cache(16)
def _kept_beam(sections: bytes, base: str, gravity: float, height: bytes) -> Beam:
    """Return a mesh by its values, as masts that differ in their guys share it with its matrices."""
    return Beam(np.frombuffer(sections).reshape(-1, DRAG_AREA + 1), base, gravity, np.frombuffer(height))


def hermite(xi: np.ndarray, length: float, derivative: int) -> np.ndarray:
    """Return cubic shapes of displacement and slope at both ends, or a derivative by the height: (4, points)."""
    x, s = xi, length
    if derivative == 0:
        rows = [1 - 3 * x**2 + 2 * x**3, s * (x - 2 * x**2 + x**3), 3 * x**2 - 2 * x**3, s * (x**3 - x**2)]
    elif derivative == 1:
        rows = [(6 * x**2 - 6 * x) / s, 1 - 4 * x + 3 * x**2, (6 * x - 6 * x**2) / s, 3 * x**2 - 2 * x]
    else:
        rows = [(12 * x - 6) / s**2, (6 * x - 4) / s, (6 - 12 * x) / s**2, (6 * x - 2) / s]
    return np.array(rows)


def slopes_of(beam: Beam, displacement: np.ndarray) -> np.ndarray:
    """Return the mean slopes of the elements for displacements of the nodes (nodes, 2, ...) [m]: (elements, 2, ...)."""
    return np.diff(displacement, axis=0) / beam.length.reshape(-1, *[1] * (displacement.ndim - 1))


def warn_of_slopes(beam: Beam, slopes: np.ndarray, times: np.ndarray | None = None) -> None:
    """Warn of slopes (instants, elements, 2) that are not small, at instants [s] or at rest."""
    squares = np.einsum("tnd,tnd->tn", slopes, slopes)
    at, element = np.unravel_index(int(squares.argmax()), squares.shape)
    if (largest := float(np.sqrt(squares[at, element]))) > LARGE_SLOPE:
        instant = "at rest" if times is None else f"at {times[at]:.6g} s"
        warn(
            f"the mast slopes by {largest:.3g} (above {LARGE_SLOPE:g}) {instant}, {beam.height[element]:.4g} m above its foot: "
            f"its equations hold for small slopes and err by about their square, {largest**2:.0%}; check guys and loads",
            OutOfRangeWarning,
        )
