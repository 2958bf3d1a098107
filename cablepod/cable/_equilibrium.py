"""Equilibrium of the nodes of a mesh by Newton's method, and its tangent stiffness."""

from __future__ import annotations

import numpy as np

from cablepod.cable._mesh import SpectralMesh
from cablepod.discretisation._chain import square
from cablepod.discretisation._gll import gll_rule

#: Maximum number of Newton iterations, and growth of a correction at which they diverge.
MAX_ITERATIONS, DIVERGING = 30, 1e3
#: Last correction over the size of the cable; that which counts as rounding, at a higher level for a slack cable.
NEWTON_RTOL, ROUNDING_RTOL = 1e-13, 1e-9


def solve_equilibrium(
    mesh: SpectralMesh, position: np.ndarray, drag: np.ndarray | float = 0.0
) -> tuple[np.ndarray, bool]:
    """Solve for the equilibrium of the nodes (nodes, dims) [m] by Newton's method, starting at `position`.

    `drag` are further forces on the nodes (nodes, dims) [N].

    Also returns whether Newton's method converged.  It fails if elements are too long, or if strains are below the rounding error
    of positions (the inextensible limit); then `position` is returned unchanged.
    """
    from scipy.linalg import LinAlgError, solve_banded  # costly to import

    x, loads = position.copy(), mesh.loads(0.0) + drag
    scale = max(mesh.total_length, float(np.abs(position).max()))
    dims, (rows, columns) = mesh.p.dims, _places(mesh)
    width, size = (mesh.order + 1) * dims - 1, position.size
    places = ((width + rows - columns) * size + columns).ravel()
    norm, least = np.inf, np.inf
    for _ in range(MAX_ITERATIONS):
        band = np.bincount(places, _blocks(mesh, x).ravel(), (2 * width + 1) * size).reshape(-1, size)[:, dims:-dims]
        right = (mesh.forces(x) + loads)[1:-1].ravel()
        try:
            correction = solve_banded((width, width), band, right, check_finite=False)
        except LinAlgError:
            return position, False
        norm = float(np.abs(correction).max())
        if not norm < DIVERGING * least:  # diverges, or nan
            break
        x[1:-1] += correction.reshape(-1, dims)
        if norm <= NEWTON_RTOL * scale:
            break
        least = min(least, norm)
    converged = norm <= ROUNDING_RTOL * scale
    return (x if converged else position), converged


def tangent_stiffness(mesh: SpectralMesh, position: np.ndarray) -> np.ndarray:
    """Return the tangent stiffness of the inner nodes (unknowns, unknowns) [N/m], node by node, at positions (nodes, dims)."""
    dims, size, (rows, columns) = mesh.p.dims, position.size, _places(mesh)
    places = (rows * size + columns).ravel()
    full = np.bincount(places, _blocks(mesh, position).ravel(), size * size).reshape(size, size)
    return full[dims:-dims, dims:-dims]


def _places(mesh: SpectralMesh) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of the entries of the stiffness of each element among all unknowns, node by node."""
    dims = mesh.p.dims
    unknowns = (dims * mesh.nodes[:, :, None] + np.arange(dims)).reshape(mesh.sizes.size, -1)
    return unknowns[:, :, None], unknowns[:, None, :]


def _blocks(mesh: SpectralMesh, position: np.ndarray) -> np.ndarray:
    """Return the tangent stiffness of each element [N/m], at positions (nodes, dims) [m]: entries in the order of the places.

    It is the integral of D_i D_j (T/xi (I - t t) + dT/dxi t t) with the derivatives D of the shapes of two nodes and t along the
    cable; 0 where the cable is slack by the linear law.
    """
    d, dims = gll_rule(mesh.order)[2], mesh.p.dims
    g = mesh.gradient(position)
    stretch = np.sqrt(square(g))
    secant, tangent = mesh.moduli(stretch)
    if not mesh.green:
        secant, tangent = np.where(stretch > 1.0, (secant, tangent), 0.0)
    unit = g / stretch[:, None]
    moduli = secant[:, None, None] * np.eye(dims) + (tangent - secant)[:, None, None] * unit[:, :, None] * unit[:, None]
    weight = mesh.length.reshape(mesh.sizes.size, -1) * mesh.scale[:, None] ** 2
    weighted = weight[..., None, None] * moduli.reshape(*weight.shape, dims, dims)
    # over the points: (element, coordinate, coordinate, node, node)
    return np.tensordot(weighted, d[:, :, None] * d[:, None, :], (1, 0)).transpose(0, 3, 1, 4, 2)
