"""Initial shape of the nodes: equilibrium, or the shape given in the scene's table ``initial``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cablepod.cable._air import MeshAir
from cablepod.cable._equilibrium import TooFewElements, solve_equilibrium
from cablepod.cable._mesh import SpectralMesh, mesh_of
from cablepod.catenary._end_stiffness import gauss_rule
from cablepod.catenary._piecewise import is_piecewise
from cablepod.catenary._statics import length_and_strain, piecewise_statics
from cablepod.chain import _start as chain_start
from cablepod.chain._air import ChainAir
from cablepod.chain._attached import AttachedForces
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.discretisation._laws import LAWS
from cablepod.errors import SceneError
from cablepod.parameters._nonuniform import attachment_fractions
from cablepod.parameters._parameters import Parameters
from cablepod.wind._air import CableAir, mean_air_of

#: Number of Gauss points between two nodes, for the integration of the equilibrium shape.
GAUSS_POINTS = 8
#: Numbers of intervals between two nodes, tried in turn (a cable that turns sharply at its lowest point needs more).
REFINEMENTS = (1, 4)
#: Relative tolerance of the shape at rest in wind.
DRAG_RTOL = 1e-12


@dataclass(frozen=True)
class CatenaryChain(LumpedChain):
    """Continuous cable in equilibrium, as a chain for :func:`cablepod.chain._start.start`.

    The force at the lower end determines the shape: x(S) is the integral of F/|F| xi(|F|), and F changes by the loads.  Each
    point of Gauss's rule becomes a link whose length is the quadrature weight.  The load between two points acts on the particle
    between their links.
    """

    def loads(self, time: float | None = None) -> np.ndarray:
        """Return the forces on the particles (n + 1, dims) at time 0 [N]; those at both ends are not used."""
        nodes = self.arc_length[::GAUSS_POINTS]
        point = (nodes[:-1, None] + np.diff(nodes)[:, None] * gauss_rule(GAUSS_POINTS)[0]).ravel()
        result = np.zeros((self.links + 1, self.p.dims))
        result[1:-1] = np.diff(point)[:, None] * self.p.load_at(0.0)
        for load in self.p.point_loads:
            where = int(np.searchsorted(point, load.fraction * self.total_length))
            result[where] += load.force * (1.0 if load.factor is None else float(load.factor(0.0)))
        return result


def catenary_chain(mesh: SpectralMesh, nodes: np.ndarray) -> CatenaryChain:
    """Return the continuous cable in equilibrium; every GAUSS_POINTS-th particle is at one of the arc lengths `nodes` [m]."""
    length = (np.diff(nodes)[:, None] * gauss_rule(GAUSS_POINTS)[1]).ravel()
    arc_length = np.concatenate([[0.0], np.cumsum(length)])
    arc_length[::GAUSS_POINTS] = nodes
    return CatenaryChain(mesh.p, length, arc_length, mesh.law)


# --- initial positions ------------------------------------------------------------------------------------------------


def catenary_nodes(mesh: SpectralMesh, arc_length: np.ndarray | None = None, air: CableAir | None = None) -> np.ndarray:
    """Integrate the shape of the continuous cable in equilibrium.

    Returns positions (nodes, dims) [m] at the nodes, or at given arc lengths [m], which must include the nodes.  In wind, given
    by `air`, they are of second order in the distance of Gauss's points.  Of a cable of several segments, or with masses on it,
    they are those by the linear law in still air, from which Newton's method starts.
    """
    if is_piecewise(mesh.p):
        places = mesh.arc_length if arc_length is None else arc_length
        at_rest = replace(mesh.p, initial={})
        position = (
            at_rest.initial_ends[0] + piecewise_statics(at_rest, "unstretched_length", mesh.total_length).at(places)[0]
        )
        position[-1] = at_rest.initial_ends[1]
        return position
    coarse = mesh.arc_length if arc_length is None else arc_length
    for intervals in REFINEMENTS:
        fine = np.interp(np.arange((coarse.size - 1) * intervals + 1) / intervals, np.arange(coarse.size), coarse)
        try:
            chain = catenary_chain(mesh, fine)
            return chain_start.start(chain, None if air is None else ChainAir(chain, air))[:: GAUSS_POINTS * intervals]
        except SceneError as error:
            if intervals == REFINEMENTS[-1]:
                raise SceneError(str(error).replace("chain:", "cable:").replace("links taut", "places taut")) from None
    raise AssertionError("the last try returns or raises")


def equilibrium_in_wind(mesh: SpectralMesh, air: MeshAir) -> np.ndarray:
    """Solve for the equilibrium of the nodes (nodes, dims) [m] in the mean wind of the start.

    Raises
    ------
    SceneError
        Where the drag and the shape do not settle, or for too few elements.
    """
    position = catenary_nodes(mesh, air=air.air)
    for _ in range(chain_start.MAX_DRAG_ITERATIONS):
        before = position
        position = solve_equilibrium(mesh, position, air.at_rest(position))
        if np.abs(position - before).max() <= DRAG_RTOL * mesh.total_length:
            break
    else:
        chain_start.refuse_rest_in_wind()
    return position


def equilibrium_with_error(mesh: SpectralMesh) -> tuple[np.ndarray, float]:
    """Solve for the equilibrium of the nodes (nodes, dims), with its largest distance from the continuous cable [m].

    The distance is taken at the nodes and midway between them.  By law (21) that of a cable of several pieces is the distance of
    its nodes from the shape in twice as many elements.
    """
    if mesh.green and is_piecewise(mesh.p):
        finer = mesh_of(mesh.p, 2 * mesh.sizes.size, mesh.order, mesh.law)
        position, exact = (solve_equilibrium(of, catenary_nodes(of)) for of in (mesh, finer))
        return position, float(np.sqrt(square(finer.interpolate(exact, mesh.arc_length) - position)).max())
    nodes_and_middles = np.sort(np.concatenate([mesh.arc_length, 0.5 * (mesh.arc_length[1:] + mesh.arc_length[:-1])]))
    exact = catenary_nodes(mesh, nodes_and_middles)
    position = solve_equilibrium(mesh, exact[::2])
    return position, float(np.sqrt(square(mesh.interpolate(position, nodes_and_middles) - exact)).max())


def converged_equilibrium(
    p: Parameters, counts: list[int], tolerance: float, order: int | None = None, law: str = LAWS[0], points: Any = None
) -> tuple[SpectralMesh, np.ndarray, float]:
    """Refine the mesh until the equilibrium in the mean wind of a scene converges; return mesh, nodes (nodes, dims) and error.

    Parameters
    ----------
    p
        Parameters of the scene; its table ``initial`` is the start of a run and has no part in this.
    counts
        Numbers of elements, tried in turn.
    tolerance
        Of the error: the largest distance from the continuous cable over the unstretched length, at nodes and midway between
        them; in wind that of the nodes from those of twice as many elements.
    order, law, points
        As in :func:`cablepod.cable.simulate`.

    Raises
    ------
    SceneError
        Where no number of elements has an equilibrium.
    """
    p = replace(p, initial={})
    air, found = mean_air_of(p), None
    for count in counts:
        mesh = mesh_of(p, count, order, law, points)
        try:
            if air is None:
                position, distance = equilibrium_with_error(mesh)
            else:
                finer = mesh_of(p, 2 * count, order, law, points)
                position, exact = (equilibrium_in_wind(of, MeshAir(of, air)) for of in (mesh, finer))
                distance = float(np.sqrt(square(finer.interpolate(exact, mesh.arc_length) - position)).max())
        except TooFewElements:
            if count == counts[-1] and found is None:
                raise
            continue
        found = mesh, position, distance / mesh.total_length
        if found[2] <= tolerance:
            break
    assert found is not None
    return found


def attached_forces(mesh: SpectralMesh, initial: np.ndarray, air: MeshAir | None) -> AttachedForces | None:
    """Return the dampers and springs of a cable; None without.

    Parameters
    ----------
    mesh
        The elements.
    initial
        Positions at the start (nodes, dims) [m], at rest unless the scene has a table ``[initial]``.
    air
        Drag, in which the springs have no force at rest.
    """
    p = mesh.p
    has_spring = any(attachment.spring for attachment in p.attachments)
    rest = start(replace(mesh, p=replace(p, initial={})), air) if has_spring and p.initial else initial
    return AttachedForces.of(mesh, rest)


def _with_initial_length(mesh: SpectralMesh) -> SpectralMesh:
    """Return the elements of a cable that is as long as its scene's table ``initial`` says, without this table."""
    p = mesh.p
    ((key, value),) = p.initial.items()
    length = length_and_strain(p, key, float(value), prefix="initial")[0]
    factor = length / mesh.total_length
    fractions = attachment_fractions(p, mesh.total_length)
    p = replace(
        p,
        attachments=tuple(
            replace(item, place_key="arc_length", place=float(place))
            for place, item in zip(fractions, p.attachments, strict=True)
        ),
        initial={},
        length_key="unstretched_length",
        length_value=length,
    )
    return replace(
        mesh,
        p=p,
        length=factor * mesh.length,
        arc_length=factor * mesh.arc_length,
        sizes=factor * mesh.sizes,
        places=None,
    )


def start(mesh: SpectralMesh, air: MeshAir | None = None) -> np.ndarray:
    """Return the initial positions (nodes, dims) [m]: equilibrium, or the shape given in the scene's table ``initial``."""
    p = mesh.p
    if "points" not in p.initial:
        if p.initial:
            mesh = _with_initial_length(mesh)
            air = None if air is None else MeshAir(mesh, air.air)
        return solve_equilibrium(mesh, catenary_nodes(mesh)) if air is None else equilibrium_in_wind(mesh, air)
    line = np.asarray(p.initial["points"], dtype=float)
    # one point for each particle of the chain: the cable runs through them
    if p.links is not None and len(line) == p.links + 1:
        relative = np.ones(p.links) if p.link_lengths is None else p.link_lengths
        fraction = np.concatenate([[0.0], np.cumsum(relative)]) / relative.sum()
        sigma = mesh.arc_length / mesh.total_length
        position = np.stack([np.interp(sigma, fraction, line[:, c]) for c in range(p.dims)], axis=1)
        ends = p.end_positions(np.zeros(1))[0]
        for index, end in ((0, "lower"), (-1, "upper")):
            if p.free_end != end:
                position[index] = ends[index]
        return position
    # a further point, because particles_on_line takes one point for each node as positions of the nodes
    if len(line) == mesh.links + 1:
        line = np.insert(line, 1, 0.5 * (line[0] + line[1]), axis=0)
    return chain_start.particles_on_line(mesh, line)
