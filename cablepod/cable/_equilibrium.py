"""Equilibrium of the nodes of a mesh by Newton's method, and its tangent stiffness."""

from __future__ import annotations

import numpy as np

from cablepod.cable._mesh import SpectralMesh
from cablepod.discretisation._chain import square
from cablepod.discretisation._gll import gll_rule
from cablepod.errors import SceneError

#: Maximum number of Newton iterations.
MAX_ITERATIONS = 30
#: Last correction over the size of the cable; that below which one that grows is rounding.
NEWTON_RTOL, ROUNDING_RTOL = 1e-13, 1e-11


class TooFewElements(SceneError):
    """Elements that do not follow the curvature of the cable at rest."""


def solve_equilibrium(mesh: SpectralMesh, position: np.ndarray, drag: np.ndarray | float = 0.0) -> np.ndarray:
    """Solve for the equilibrium of the nodes (nodes, dims) [m] by Newton's method, starting at `position`.

    `drag` are further forces on the nodes (nodes, dims) [N].

    The stiffness across the cable takes the tension of the iteration, which is an unknown of its own and starts at that of the
    catenary, and not the tension of the shape (Magisano, Leonetti & Garcea, Int. J. Numer. Meth. Eng. 109, 1237, 2017).  The
    nodes of the continuous cable are off by a strain that may be much more than that of a stiff cable at rest, so that by the
    shape some places push and others pull with many times the tension.

    Raises
    ------
    TooFewElements
        Where Newton's method finds no equilibrium whose places are all taut.
    """
    from scipy.linalg import LinAlgError, solve_banded  # costly to import

    x, loads = position.copy(), mesh.loads(0.0) + drag
    scale = max(mesh.total_length, float(np.abs(position).max()))
    dims, (rows, columns) = mesh.p.dims, _places(mesh)
    width, size = (mesh.order + 1) * dims - 1, position.size
    places = ((width + rows - columns) * size + columns).ravel()
    tension = max(float(mesh.statics[4:].mean()), float(np.abs(loads).sum()))
    secant, last = np.full(mesh.length.size, tension), np.inf
    for _ in range(MAX_ITERATIONS):
        g = mesh.gradient(x)
        stretch = np.sqrt(square(g))
        of_shape, tangent = mesh.moduli(stretch)
        blocks = _blocks(mesh, g, secant, tangent)
        band = np.bincount(places, blocks.ravel(), (2 * width + 1) * size).reshape(-1, size)[:, dims:-dims]
        right = (mesh.nodal_forces(of_shape[:, None] * g) + loads)[1:-1].ravel()
        try:
            correction = solve_banded((width, width), band, right, check_finite=False)
        except LinAlgError:
            break
        norm = float(np.abs(correction).max())
        is_rounding = norm > last and last <= ROUNDING_RTOL * scale
        if not is_rounding:
            change = np.zeros(x.shape)
            change[1:-1] = correction.reshape(-1, dims)
            secant = of_shape + (tangent - of_shape) * np.sum(g * mesh.gradient(change), axis=-1) / stretch**2
            x, last = x + change, norm
        if is_rounding or norm <= NEWTON_RTOL * scale:
            if secant.min() > 0.0:
                return x
            break
        if not norm < np.inf:
            break
    raise TooFewElements(
        f"elements: with {mesh.sizes.size} of order {mesh.order} no rest is found with all places taut; allowed: enough elements "
        "for the curvature of the cable at rest"
    )


def tangent_stiffness(mesh: SpectralMesh, position: np.ndarray) -> np.ndarray:
    """Return the tangent stiffness of the inner nodes (unknowns, unknowns) [N/m], node by node, at taut `position`."""
    dims, size, (rows, columns) = mesh.p.dims, position.size, _places(mesh)
    g = mesh.gradient(position)
    blocks = _blocks(mesh, g, *mesh.moduli(np.sqrt(square(g))))
    full = np.bincount((rows * size + columns).ravel(), blocks.ravel(), size * size).reshape(size, size)
    return full[dims:-dims, dims:-dims]


def _places(mesh: SpectralMesh) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of the entries of the stiffness of each element among all unknowns, node by node."""
    dims = mesh.p.dims
    unknowns = (dims * mesh.nodes[:, :, None] + np.arange(dims)).reshape(mesh.sizes.size, -1)
    return unknowns[:, :, None], unknowns[:, None, :]


def _blocks(mesh: SpectralMesh, g: np.ndarray, secant: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Return the tangent stiffness of each element [N/m], entries in the order of the places.

    It is the integral of D_i D_j (T/xi (I - t t) + dT/dxi t t) with the derivatives D of the shapes of two nodes, and with t
    along the derivatives `g` of the position at the quadrature points (points, dims), T/xi and dT/dxi there (points,) [N].
    """
    d, dims = gll_rule(mesh.order)[2], mesh.p.dims
    unit = g / np.sqrt(square(g))[:, None]
    moduli = secant[:, None, None] * np.eye(dims) + (tangent - secant)[:, None, None] * unit[:, :, None] * unit[:, None]
    weight = mesh.length.reshape(mesh.sizes.size, -1) * mesh.scale[:, None] ** 2
    weighted = weight[..., None, None] * moduli.reshape(*weight.shape, dims, dims)
    # over the points: (element, coordinate, coordinate, node, node)
    return np.tensordot(weighted, d[:, :, None] * d[:, None, :], (1, 0)).transpose(0, 3, 1, 4, 2)
