"""Initial shape of the elements: equilibrium, or the shape of the scene's table ``initial``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cablepod.cable._mesh import SpectralMesh
from cablepod.chain import _start as chain_start
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.errors import SceneError

#: Points between two nodes at which the shape at rest is integrated.
GAUSS_POINTS = 8
#: Where that is too coarse, for a cable that turns sharply at its lowest point, the distances of nodes are cut into so many.
REFINEMENTS = (1, 4)


@dataclass(frozen=True)
class CatenaryChain(LumpedChain):
    """The continuous cable at rest, as the chain that :func:`cablepod.chain._start.start` knows how to hang.

    The force at the lower end determines all else: x(S) is the integral of F/|F| xi(|F|), with F falling by the loads.  By
    Gauss's rule between two nodes each point stands for some length, a link, and what acts between two points is the load on a
    particle.
    """

    def loads(self, time: float | None = None) -> np.ndarray:
        """Return forces on the particles (n + 1, dims) at time 0 [N]; what it returns at both ends is not used."""
        point = gauss_points(self.arc_length[::GAUSS_POINTS])
        result = np.zeros((self.links + 1, self.p.dims))
        result[1:-1] = np.diff(point)[:, None] * self.p.load_at(0.0)
        for load in self.p.point_loads:
            where = int(np.searchsorted(point, load.fraction * self.total_length))
            result[where] += load.force * (1.0 if load.factor is None else float(load.factor(0.0)))
        return result


def gauss_points(arc_length: np.ndarray) -> np.ndarray:
    """Return the points of Gauss's rule between all neighbours [m]."""
    inner = np.polynomial.legendre.leggauss(GAUSS_POINTS)[0]
    return (arc_length[:-1, None] + 0.5 * np.diff(arc_length)[:, None] * (1.0 + inner)).ravel()


def catenary_chain(mesh: SpectralMesh, places: np.ndarray) -> CatenaryChain:
    """Return the continuous cable at rest whose particles are, every GAUSS-th, at `places` [m]."""
    weight = np.polynomial.legendre.leggauss(GAUSS_POINTS)[1]
    length = (0.5 * np.diff(places)[:, None] * weight).ravel()
    arc_length = np.concatenate([[0.0], np.cumsum(length)])
    arc_length[::GAUSS_POINTS] = places
    return CatenaryChain(mesh.p, length, arc_length, mesh.law)


# --- positions to start from ------------------------------------------------------------------------------------------


def catenary_nodes(mesh: SpectralMesh, places: np.ndarray | None = None) -> np.ndarray:
    """Positions (nodes, dims) [m] of the continuous cable, at rest or in the shape of its scene's other length.

    They are those of the nodes, or at `places` [m], the nodes among them.
    """
    wanted = mesh.arc_length if places is None else places
    for pieces in REFINEMENTS:
        fine = np.interp(np.arange((wanted.size - 1) * pieces + 1) / pieces, np.arange(wanted.size), wanted)
        try:
            return chain_start.start(catenary_chain(mesh, fine))[:: GAUSS_POINTS * pieces]
        except SceneError as error:
            if pieces == REFINEMENTS[-1]:
                raise SceneError(str(error).replace("chain:", "cable:").replace("links taut", "places taut")) from None
    raise AssertionError("the last try returns or raises")


def solve_equilibrium(mesh: SpectralMesh, position: np.ndarray) -> tuple[np.ndarray, bool]:
    """Rest of the elements (nodes, dims) [m], near that of the continuous cable, and whether Newton's method found it.

    It fails where elements are too large, and where a strain is below the rounding of positions, in the inextensible limit; the
    position is then returned as it was.
    """
    from cablepod.cable import _kernels_implicit as kernel  # numba is imported only to compute

    x = np.ascontiguousarray(position.T)
    loads = np.ascontiguousarray(mesh.loads(0.0)[1:-1].T)
    scale = max(mesh.total_length, float(np.abs(position).max()))
    small, size = kernel.equilibrium(x, 1, mesh.links - 1, *mesh.law_arguments, loads, 1e-13 * scale)
    # corrections of a taut cable end at some rounding of positions, those of a slack one at more of it
    found = small or size <= 1e-9 * scale
    return (np.ascontiguousarray(x.T) if found else position), found


def equilibrium_with_error(mesh: SpectralMesh) -> tuple[np.ndarray, float]:
    """Rest of the elements (nodes, dims) and its largest distance from the continuous cable, at nodes and between them [m]."""
    places = np.sort(np.concatenate([mesh.arc_length, 0.5 * (mesh.arc_length[1:] + mesh.arc_length[:-1])]))
    exact = catenary_nodes(mesh, places)
    position, _ = solve_equilibrium(mesh, exact[::2])
    return position, float(np.sqrt(square(mesh.interpolate(position, places) - exact)).max())


def start(mesh: SpectralMesh) -> np.ndarray:
    """Positions from which a run starts (nodes, dims) [m]: at rest, or the shape that the scene's initial table says."""
    p = mesh.p
    if "points" not in p.initial:
        shape = catenary_nodes(mesh)
        return shape if p.initial else solve_equilibrium(mesh, shape)[0]
    line = np.asarray(p.initial["points"], dtype=float)
    if (
        p.links is not None and len(line) == p.links + 1
    ):  # one for each particle of the chain: the cable runs through them
        relative = np.ones(p.links) if p.link_lengths is None else p.link_lengths
        share = np.concatenate([[0.0], np.cumsum(relative)]) / relative.sum()
        sigma = mesh.arc_length / mesh.total_length
        position = np.stack([np.interp(sigma, share, line[:, c]) for c in range(p.dims)], axis=1)
        ends = p.end_positions(np.zeros(1))[0]
        for index, end in ((0, "lower"), (-1, "upper")):
            if p.free_end != end:
                position[index] = ends[index]
        return position
    if len(line) == mesh.links + 1:  # a line all the same, not one point for each node
        line = np.insert(line, 1, 0.5 * (line[0] + line[1]), axis=0)
    return chain_start.particles_on_line(mesh, line)
