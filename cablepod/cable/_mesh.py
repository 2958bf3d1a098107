"""Spectral-element mesh of the continuous cable, eqs. (17)-(23): nodes, masses, loads, tensions, frequency bound."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from cablepod._resources import check_memory
from cablepod.cable._kernels_arguments import Elements
from cablepod.catenary._statics import unstretched_length
from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.discretisation._formulas import green_secant, green_tangent, linear_secant
from cablepod.discretisation._gll import gll_rule, lagrange_basis
from cablepod.discretisation._laws import LAWS, tangent_stiffness_ratio
from cablepod.errors import scene_error
from cablepod.parameters._checks import integer, numbers_list
from cablepod.parameters._nonuniform import SAME_PLACE, attachment_fractions
from cablepod.parameters._parameters import Parameters, PointLoad, Segment
from cablepod.parameters._particles import refuse_own

#: Default polynomial order of an element (its eight nodes fill vector registers completely).
ORDER = 7
#: Maximum polynomial order of an element.
MAX_ORDER = 16
#: Number of points at which runs with different elements are compared.
COMPARED_POINTS = 65
#: Default number of particles in the output for a scene without a chain.
DEFAULT_PARTICLES = 41


@dataclass(frozen=True)
class SpectralMesh(LumpedChain):
    """Spectral-element discretisation of a cable, with the interface of a lumped chain whose particles are the nodes.

    ``length`` holds the quadrature weights (elements (order + 1),) [m], element by element; the quadrature points of an element
    are its nodes.  ``arc_length`` is that of the nodes.  Point loads and attachments are on element borders, and segments end
    there, so that kinks cost no accuracy.
    """

    order: int = ORDER
    sizes: np.ndarray = field(default_factory=lambda: np.empty(0))  #: unstretched lengths of the elements [m]
    places: np.ndarray | None = None  #: arc lengths of the output particles [m]; None: the nodes

    @cached_property
    def links(self) -> int:
        """Number of nodes minus one."""
        return self.arc_length.size - 1

    @cached_property
    def scale(self) -> np.ndarray:
        """Derivative of the reference coordinate, 2 over the element length (elements,) [1/m]."""
        return 2.0 / self.sizes

    @cached_property
    def tributary_length(self) -> np.ndarray:
        """Tributary length of each node (nodes,) [m]."""
        result = np.zeros(self.arc_length.size)
        np.add.at(result, self.nodes, self.length.reshape(-1, self.order + 1))
        return result

    # --- segments and attachments ---

    @cached_property
    def segments(self) -> list[Segment]:
        """Segment of each element; empty for a uniform cable."""
        if not self.p.segments:
            return []
        middle = (self.arc_length[:: self.order][:-1] + 0.5 * self.sizes) / self.total_length
        return [self.p.segments[i] for i in np.searchsorted([part.end for part in self.p.segments], middle)]

    def largest_of_segments(self, values: np.ndarray) -> list[float]:
        """Return the largest of values at the quadrature points (points,) in each segment, one for a uniform cable."""
        if not self.segments:
            return [float(values.max())]
        of_elements = values.reshape(-1, self.order + 1).max(axis=1)
        return [
            max(float(value) for value, owner in zip(of_elements, self.segments, strict=True) if owner is part)
            for part in self.p.segments
        ]

    @cached_property
    def ratios(self) -> np.ndarray | None:
        """Axial stiffness and drag of the elements over those of the cable (2, elements); None for a uniform cable."""
        if not self.segments:
            return None
        drag = (self.p.drag_coefficient or 0.0) * (self.p.diameter or 0.0)
        of_elements = np.array([part.drag_width for part in self.segments])
        stiffness = np.array([part.stiffness for part in self.segments])
        return np.array([stiffness / self.p.stiffness, of_elements / drag if drag else np.ones(stiffness.size)])

    @cached_property
    def element_stiffness(self) -> np.ndarray:
        """Axial stiffness K of the elements (elements,) [N]."""
        return np.full(self.sizes.size, self.p.stiffness) * (1.0 if self.ratios is None else self.ratios[0])

    @cached_property
    def axial_stiffness(self) -> float | np.ndarray:
        """Axial stiffness K at the quadrature points [N]: one number for a uniform cable, or (points,)."""
        return self.p.stiffness if self.ratios is None else np.repeat(self.element_stiffness, self.order + 1)

    def _of_particles(self, name: str) -> np.ndarray:
        """Return mass or weight of the nodes with what is attached (nodes, ...)."""
        if self.segments:
            of_elements = np.array([getattr(part, name) for part in self.segments])
            columns = [self._sum_at_nodes(column) for column in of_elements.reshape(self.sizes.size, -1).T]
            result = np.stack(columns, axis=1).reshape(-1, *of_elements.shape[1:])
        else:
            result = np.multiply.outer(self.tributary_length, np.asarray(getattr(self.p, name)))
        for node, item in zip(self.attached_particles, self.p.attachments, strict=True):
            result[node] += getattr(item, name)
        return result

    def _sum_at_nodes(self, per_length: np.ndarray) -> np.ndarray:
        """Sum at the nodes (nodes,) what elements (elements,) have per length."""
        result = np.zeros(self.arc_length.size)
        np.add.at(result, self.nodes, per_length[:, None] * self.length.reshape(-1, self.order + 1))
        return result

    @cached_property
    def nodes(self) -> np.ndarray:
        """Node numbers of each element (elements, order + 1)."""
        return np.arange(self.sizes.size)[:, None] * self.order + np.arange(self.order + 1)

    @cached_property
    def point_arc_length(self) -> np.ndarray:
        """Unstretched arc lengths of the quadrature points (points,) [m]."""
        return self.arc_length[self.nodes].ravel()

    def _point_pattern(self, load: PointLoad) -> np.ndarray:
        """Return a point load at factor 1 on the node at its place (nodes, dims) [N]."""
        pattern = np.zeros((self.links + 1, self.p.dims))
        pattern[np.argmin(np.abs(self.arc_length - load.fraction * self.total_length))] = load.force
        return pattern

    # --- stretch, tension, force ---

    def gradient(self, position: np.ndarray) -> np.ndarray:
        """Differentiate nodal values (..., nodes, dims) by arc length at the quadrature points (..., points, dims)."""
        d = gll_rule(self.order)[2]
        parts = position[..., self.nodes, :]  # (..., elements, order + 1, dims)
        g = np.einsum("qi,...eic->...eqc", d, parts) * self.scale[:, None, None]
        return g.reshape(*position.shape[:-2], -1, position.shape[-1])

    def stretch(self, position: np.ndarray) -> np.ndarray:
        """Compute the stretch xi at the quadrature points (..., points) from nodal positions (..., nodes, dims) [m]."""
        return np.sqrt(square(self.gradient(position)))

    def tangent_stiffness_ratio(self, position: np.ndarray) -> np.ndarray:
        """Compute the tangent stiffness over K at the quadrature points (..., points): 1 by the linear law, >= 1 by law (21)."""
        if not self.green:
            return np.ones(self.length.size)
        return tangent_stiffness_ratio(square(self.gradient(position)))

    def moduli(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the secant modulus T / xi and the tangent modulus dT/dxi [N] of a taut cable."""
        k = self.axial_stiffness
        if self.green:
            return green_secant(stretch**2, k), green_tangent(stretch**2, k)
        return linear_secant(1.0 / stretch, k), k + np.zeros(stretch.shape)

    def forces(self, position: np.ndarray, velocity: np.ndarray | None = None) -> np.ndarray:
        """Compute the internal nodal forces (nodes, dims) [N]."""
        g, g_dot = self.gradient(position), None if velocity is None else self.gradient(velocity)
        return self.nodal_forces(self.tensions_along(g, g_dot, 1.0, self.axial_stiffness)[1])

    def nodal_forces(self, stress: np.ndarray) -> np.ndarray:
        """Return the forces on the nodes (nodes, dims) of those along the cable at the quadrature points (points, dims) [N]."""
        at_points = (self.length[:, None] * stress).reshape(self.sizes.size, self.order + 1, -1)
        at_nodes = np.einsum("qi,eqc,e->eic", gll_rule(self.order)[2], at_points, self.scale)
        result = np.zeros((self.links + 1, stress.shape[-1]))
        np.subtract.at(result, self.nodes, at_nodes)
        return result

    @property
    def own_masses(self) -> np.ndarray | None:
        """Masses of a chain through the output particles (particle,) [kg]; None where they are in proportion to its lengths."""
        return LumpedChain(self.p, np.diff(self.particles), self.particles, scene_length=self.scene_length).own_masses

    @cached_property
    def arguments(self) -> Elements:
        """Elements and law as the kernels take them."""
        free, (_, weight, d) = self.free_particles, gll_rule(self.order)
        # loops are unrolled for the default order only, as each compiles anew
        nodes = (0.0,) * (ORDER + 1) if self.order == ORDER else np.empty(self.order + 1)
        transposed = np.ascontiguousarray(d.T)
        arrays = np.array(d), transposed, transposed[:, None] * transposed, np.array(weight), self.scale
        law = self.element_stiffness, self.green, *rate_dampings(self.p)
        return Elements(free.start, free.stop, nodes, *arrays, *law)

    def tensions_and_forces(
        self, position: np.ndarray, velocity: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute tensions (..., links) and their vectors (..., links, dims) [N] midway between output particles.

        They are those of the quadrature points, interpolated: between these the strain of a stiff cable may be off by many times
        its size.  By the linear law what the polynomials have below 0 is slack.
        """
        g_dot = None
        if velocity is not None and rate_dampings(self.p) != (0.0, 0.0):
            g_dot = self.gradient(velocity)
        tension, force = self.tensions_along(self.gradient(position), g_dot, 1.0, self.axial_stiffness)
        element, weights = self.link_weights
        of_elements = np.zeros((element.size, self.sizes.size, self.order + 1))
        of_elements[np.arange(element.size), element] = weights
        matrix = of_elements.reshape(element.size, -1)
        tension, force = tension @ matrix.T, matrix @ force
        return tension if self.green else np.maximum(tension, 0.0), force

    # --- output particles ---

    @cached_property
    def particles(self) -> np.ndarray:
        """Arc lengths of the output particles (particle,) [m]."""
        return self.arc_length if self.places is None else self.places

    @cached_property
    def link_weights(self) -> tuple[np.ndarray, np.ndarray]:
        """Element (links,) and weights of its quadrature points (links, order + 1) midway between output particles."""
        return self._locate(0.5 * (self.particles[1:] + self.particles[:-1]))

    def _locate(self, arc_length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Element (points,) and nodal interpolation weights (points, order + 1) of given arc lengths [m]."""
        border = self.arc_length[:: self.order]
        element = np.clip(np.searchsorted(border, arc_length, side="right") - 1, 0, self.sizes.size - 1)
        coordinate = np.clip((arc_length - border[element]) * self.scale[element] - 1.0, -1.0, 1.0)
        return element, lagrange_basis(self.order, coordinate)

    def interpolate(self, values: np.ndarray, arc_length: np.ndarray | None = None) -> np.ndarray:
        """Interpolate nodal values (..., nodes, dims) at the output particles, or at given arc lengths [m]."""
        if arc_length is None:
            if self.places is None:
                return values
            arc_length = self.places
        element, rows = self._locate(arc_length)
        if self.sizes.size == 1:  # without a copy of all nodes for each point
            return rows @ values
        return np.einsum("ji,...jic->...jc", rows, values[..., self.nodes[element], :])

    def at_compared(self, position: np.ndarray) -> np.ndarray:
        """Return positions (..., points, dims) at equidistant points: nodes are not, and errors are means over the cable."""
        return self.interpolate(position, self.total_length * np.linspace(0.0, 1.0, COMPARED_POINTS))

    @property
    def end_places(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the prescribed coordinates in positions (dims, nodes), in the order of the motions."""
        motions = self.p.motions
        rows = np.array([COORDINATES.index(axis) for _, axis in motions], dtype=np.int64)
        return rows, np.array([self.links * ENDS.index(end) for end, _ in motions], dtype=np.int64)

    # --- frequencies ---

    def highest_frequency(self, ratio: np.ndarray | float = 1.0) -> float:
        """Compute an upper bound of the angular frequencies [rad/s] for given ratios of tangent stiffness to K.

        The stiffness is largest along the cable.  The highest frequency of the straight cable in axial motion, with springs along
        it, is therefore a bound for every shape.
        """
        springs = np.zeros(self.arc_length.size)
        springs[self.attached_particles] = [item.spring for item in self.p.attachments]
        return self._axial_frequency_at(-1, ratio, springs)

    def first_axial_frequency(self) -> float:
        """Compute the lowest angular frequency of the straight cable in axial motion by the linear law [rad/s]."""
        return self._axial_frequency_at(0, 1.0, np.zeros(self.arc_length.size))

    def _axial_frequency_at(self, place: int, ratio: np.ndarray | float, springs: np.ndarray) -> float:
        """Compute the lowest (place 0) or highest (-1) axial angular frequency [rad/s], with springs at nodes (nodes,) [N/m]."""
        from scipy.linalg import eig_banded  # costly to import

        first, last = self.free_particles.start, self.free_particles.stop
        count, order = self.links + 1, self.order
        _, weight, d = gll_rule(order)
        stiff = np.broadcast_to(np.asarray(ratio, dtype=float), self.length.shape).reshape(-1, order + 1)
        blocks = np.einsum("eq,q,qi,qj,e->eij", stiff, weight, d, d, self.element_stiffness * self.scale)
        mass = 1.0 / np.sqrt(self.mass)
        band = np.zeros((order + 1, count))
        for i in range(order + 1):
            below = np.arange(order + 1 - i)
            nodes = self.nodes[:, below]
            entries = blocks[:, below + i, below] * mass[nodes] * mass[nodes + i]
            band[i, nodes[:, :order]] = entries[:, :order]
            if i == 0:  # the last node of an element is the first of the next
                band[0, nodes[:, order]] += entries[:, order]
        band[0] += springs * mass**2
        band = band[:, first:last]
        unknowns = band.shape[1]
        only = place % unknowns
        square_of = eig_banded(
            band[: min(order + 1, unknowns)], lower=True, eigvals_only=True, select="i", select_range=(only, only)
        )
        return math.sqrt(float(square_of[0]))


def rate_dampings(p: Parameters) -> tuple[float, float]:
    """Return the viscosity over the stiffness and the damping by the tension [s], 0 without."""
    return p.link_viscosity or 0.0, p.tension_damping or 0.0


def mesh_of(
    p: Parameters, elements: int, order: int | None = None, law: str = LAWS[0], points: Any = None
) -> SpectralMesh:
    """Discretise the cable of a scene in spectral elements.

    Parameters
    ----------
    p
        Parameters of the scene.
    elements, order, law, points
        As in :func:`cablepod.cable.simulate`.

    Raises
    ------
    SceneError
        For fewer elements than parts between point loads, attachments and ends of segments, or invalid points.
    """
    order = check_order(order)
    refuse_own(p, "chain.simulate, chain.rest")
    total = unstretched_length(p)
    borders = part_borders(p)
    if elements < borders.size - 1:
        raise scene_error(
            "elements", elements, f"at least {borders.size - 1}, so that every {_on_borders(p)} is on an element border"
        )
    check_memory(1, elements * order, p.dims, key="elements")
    length = np.diff(borders)
    # each part has one element, and each further one divides the part with the longest elements
    counts = np.ones(length.size, dtype=int)
    for _ in range(elements - length.size):
        counts[np.argmax(length / counts)] += 1
    sizes = total * np.concatenate([np.full(n, part / n) for part, n in zip(length, counts, strict=True)])
    node, weight, _ = gll_rule(order)
    starts = total * np.concatenate(
        [start + part * np.arange(n) / n for start, part, n in zip(borders[:-1], length, counts, strict=True)]
    )
    arc_length = (starts[:, None] + 0.5 * sizes[:, None] * (1.0 + node[:-1])).ravel()
    arc_length = np.append(arc_length, total)
    quadrature = (0.5 * sizes[:, None] * weight).ravel()
    return SpectralMesh(p, quadrature, arc_length, law, order, sizes, _output_arc_lengths(p, points, total))


def part_borders(p: Parameters) -> np.ndarray:
    """Return the borders of the parts between point loads, attachments and ends of segments, as fractions of the length."""
    inner = [load.fraction for load in p.point_loads] + [segment.end for segment in p.segments]
    if p.attachments:
        inner += attachment_fractions(p, unstretched_length(p)).tolist()
    borders = [0.0]
    for place in sorted(inner):
        if borders[-1] + SAME_PLACE < place < 1.0 - SAME_PLACE:
            borders.append(place)
    return np.array([*borders, 1.0])


def _on_borders(p: Parameters) -> str:
    """Return what stands on element borders, for messages."""
    others = (["attachment"] if p.attachments else []) + (["end of a segment"] if p.segments else [])
    return " and ".join((["point load"] if p.point_loads or not others else []) + others)


def check_order(order: Any) -> int:
    """Check the polynomial order of the elements; None means the default."""
    return ORDER if order is None else integer(least=1, most=MAX_ORDER)("order", order)


def _output_arc_lengths(p: Parameters, points: Any, total: float) -> np.ndarray | None:
    """Arc lengths of the output particles [m], see ``points`` of :func:`cablepod.cable.simulate`; None for the nodes."""
    if isinstance(points, str) and points == "nodes":
        return None
    if points is None:
        if p.link_lengths is not None:
            fraction = np.concatenate([[0.0], np.cumsum(p.link_lengths)])
            return total * (fraction / fraction[-1])
        points = DEFAULT_PARTICLES if p.links is None else p.links + 1
    if (isinstance(points, Sequence) and not isinstance(points, str)) or (
        isinstance(points, np.ndarray) and points.ndim
    ):
        fraction = np.array(numbers_list(least_length=2)("points", points))
        if fraction[0] != 0.0 or fraction[-1] != 1.0 or (np.diff(fraction) <= 0.0).any():
            raise scene_error("points", points, "rising fractions of the unstretched length, from 0 to 1")
        return total * fraction
    if isinstance(points, str):
        raise scene_error("points", points, 'a number of particles, fractions of the length from 0 to 1, or "nodes"')
    count = integer(least=2)("points", points)
    check_memory(1, count, p.dims, key="points")
    return total * np.linspace(0.0, 1.0, count)
