"""Arguments of the kernels of the continuous cable: named arrays, which both schemes share.

N is the number of nodes, p the order of the elements.  Arrays of elements have the shape (p + 1, elements), so that the inner
loop over elements vectorises.  What a scene does not have is an array without entries.  Kernels take None in place of air and of
attachments, whose terms are then left out of the compiled code.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

#: Array without entries, which stands for an absent term.
NOTHING = np.empty(0)


class Elements(NamedTuple):
    """Elements of a cable, and their law."""

    first: int  #: first free node
    last: int  #: one after the last free node
    #: as many entries as an element has nodes: a tuple, whose length is a constant of the compiled code, so that sums over the
    #: nodes are unrolled; or an array, with which one compilation serves all orders
    nodes: Any
    #: derivative matrix of the reference element of length 2, points in rows, nodes in columns (p + 1, p + 1)
    d: np.ndarray
    d_transposed: np.ndarray
    pairs: np.ndarray  #: products D_qi D_qj at [i, j, q] (p + 1, p + 1, p + 1)
    weight: np.ndarray  #: quadrature weights, with sum 2 (p + 1,)
    scale: np.ndarray  #: 2 over the unstretched lengths of the elements (elements,) [1/m]
    stiffness: np.ndarray  #: axial stiffness (elements,) [N]
    green: bool  #: whether law (21) holds in place of the linear one
    viscosity: float  #: viscosity over stiffness [s], 0 without; only with the linear law
    tension_damping: float  #: damping by the tension [s], 0 without


class Air(NamedTuple):
    """Wind on a cable."""

    velocity: np.ndarray  #: of the air at the nodes, linear between the samples (samples, dims, N) [m/s]
    drag: np.ndarray  #: half the density of the air times drag coefficient and diameter (elements,) [kg/m2]
    bodies: np.ndarray  #: half the density of the air times drag area at the nodes (N,) [kg/m]
    hold: int  #: number of explicit steps from one evaluation of the drag to the next


class Attached(NamedTuple):
    """Dampers and springs to the ground, see :mod:`cablepod.chain._kernels_attached`."""

    particles: np.ndarray  #: their nodes (attachments,)
    numbers: np.ndarray  #: (attachments, COLUMNS)


class Nodes(NamedTuple):
    """Masses of the nodes, 0 at held ones, and what acts on them, for steps of the trapezoidal rule."""

    mass: np.ndarray  #: (N,) [kg]
    damping: float  #: damping by mass [1/s], 0 without
    loads: np.ndarray  #: constant loads (dims, N) [N]
    patterns: np.ndarray  #: time-dependent loads at factor 1 (loads, dims, N) [N]
    modal: Any  #: damping by ratios, see :class:`cablepod.discretisation._modal_damping.NodalDamping`


class NodesInStep(NamedTuple):
    """The same for steps of velocity Verlet."""

    per_mass: np.ndarray  #: step over mass, with damping (1 - damping_factor) / (damping mass) (N,) [s/kg]
    damping_factor: float  #: exp(-damping step) with the damping by mass, 1 without
    load_increment: np.ndarray  #: velocity increments by constant loads (dims, N) [m/s]
    patterns: np.ndarray  #: time-dependent loads at factor 1 (loads, dims, N) [N]


class Tables(NamedTuple):
    """What changes from step to step, at the steps of a call."""

    rows: np.ndarray  #: coordinates that are prescribed (moving,)
    columns: np.ndarray  #: their nodes (moving,)
    ends: np.ndarray  #: their values (moving, steps + 1) [m]
    end_rates: np.ndarray  #: velocities of both ends, unless no force depends on them (steps + 1, 2, dims) [m/s]
    factors: np.ndarray  #: of the time-dependent loads (steps + 1, loads)
    #: places between the samples of the wind (steps + 1,): of the steps, or of half a step before in velocity Verlet
    places: np.ndarray


class State(NamedTuple):
    """State of an implicit run, advanced in place (dims, N); velocities and accelerations are 0 at held nodes."""

    x: np.ndarray  #: positions [m]
    v: np.ndarray  #: velocities [m/s]
    a: np.ndarray  #: accelerations [m/s2]


class ExplicitState(NamedTuple):
    """State of an explicit run, advanced in place (dims, N); all but the positions are 0 at held nodes."""

    x: np.ndarray  #: positions [m]
    v: np.ndarray  #: velocities half a step before [m/s]
    v_before: np.ndarray  #: velocities one step before these; only where the cable has damping of its own [m/s]
    drag_before: np.ndarray  #: velocity increments by the last drag [m/s]; in wind
    drag_increment: np.ndarray  #: the same by loads and drag until the next evaluation [m/s]; in wind


class Record(NamedTuple):
    """What is kept of a run."""

    start: int  #: number of the first step
    steps: np.ndarray  #: rising numbers of the steps to save, from the first one on (saves,)
    #: filled: positions; or also velocities and accelerations, of velocity Verlet the velocities half a step before and after
    #: (saves, 1 or 3, dims, N)
    saved: np.ndarray
    element: np.ndarray  #: elements of the points for tension extremes (links,)
    link_weights: np.ndarray  #: weights of the quadrature points there (links, p + 1)
    low: np.ndarray  #: least tensions there, updated (links,) [N]; without entries: unasked
    high: np.ndarray  #: largest tensions there, updated (links,) [N]
    #: first step with a stretch below 1 (-1 if none) and its point; step, point and square of the least stretch below 1 (5,)
    slack: np.ndarray


class Work(NamedTuple):
    """Work arrays of the forces."""

    g: np.ndarray  #: derivative of the position by arc length at the quadrature points (dims, p + 1, elements)
    g_dot: np.ndarray  #: its rate (dims, p + 1, elements) [1/s]
    square: np.ndarray  #: squared stretch (p + 1, elements)
    stretching: np.ndarray  #: product of `g` and its rate (p + 1, elements) [1/s]
    s: np.ndarray  #: weight times tension over stretch (p + 1, elements) [N]
    nodal: np.ndarray  #: values at the nodes of each element, and others (p + 1, elements)
    position: np.ndarray  #: at the end of a step that is solved for, or half a step before (dims, N) [m]
    u: np.ndarray  #: velocities of all nodes (dims, N) [m/s]
    force: np.ndarray  #: forces on all nodes (dims, N) [N]

    @classmethod
    def of(cls, elements: Elements, position: np.ndarray) -> Work:
        """Return arrays of zeros, with positions (dims, N) [m]."""
        shape = elements.weight.size, elements.scale.size
        g, g_dot = np.zeros((2, len(position), *shape))
        square, stretching, s, nodal = np.zeros((4, *shape))
        u, force = np.zeros((2, *position.shape))
        return cls(g, g_dot, square, stretching, s, nodal, position.copy(), u, force)


class Newton(NamedTuple):
    """Work arrays of Newton's method; unknowns are dims node + coordinate, of which those of held nodes are not solved for."""

    b: np.ndarray  #: weight times coefficient of g g^T in the tangent stiffness (p + 1, elements) [N]
    line: np.ndarray  #: (elements,)
    block: np.ndarray  #: tangent of forces on nodes: xx, xy, yy, or xx, xy, xz, yy, yz, zz (3 or 6, N) [N/m]
    #: lower triangle of the tangent: entry (row, column) is at [column, row - column] (dims N, dims (p + 1)) [N/m]
    band: np.ndarray
    base: np.ndarray  #: the part of it that does not change in a call: inertia and damping
    height: np.ndarray  #: number of entries below the diagonal of each column, by the elements (dims N,)
    right: np.ndarray  #: right side, then correction (dims N,)
    increment: np.ndarray  #: displacements in the step, 0 at held nodes (dims, N) [m]

    @classmethod
    def of(cls, elements: Elements, dims: int) -> Newton:
        """Return arrays of zeros, and the heights of the columns."""
        order, count = elements.weight.size - 1, elements.scale.size
        nodes, unknown = count * order + 1, np.arange(dims * (count * order + 1))
        last = np.minimum((unknown // (dims * order) + 1) * order, elements.last - 1)  # node of the element
        points, block = np.zeros((order + 1, count)), np.zeros((dims * (dims + 1) // 2, nodes))
        band, base = np.zeros((2, unknown.size, dims * (order + 1)))
        height, right = dims * (last + 1) - 1 - unknown, np.zeros(unknown.size)
        return cls(points, np.zeros(count), block, band, base, height, right, np.zeros((dims, nodes)))

    def start_tangent(self, elements: Elements, nodes: Nodes, step: float) -> None:
        """Fill the tangent with that of inertia and damping for a step [s]; damping by ratios counts as more inertia in it."""
        dims, rate = len(self.increment), 2.0 / step
        if nodes.modal.matrix.size:
            self.base[dims * elements.first : dims * elements.last] = nodes.modal.stiffness
        else:
            self.base[:] = 0.0
        inertia = rate * rate + nodes.damping * rate + nodes.modal.half_ratio * rate * rate
        self.base[:, 0] += np.repeat(nodes.mass * inertia, dims)
