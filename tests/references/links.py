"""The tangent stiffness of a chain about rest, link by link."""

from __future__ import annotations

import numpy as np
from scenes import uniform_chain

import cablepod as cp


def tangent_at_rest(scene, law="linear", links=None):
    """Return tangent (n - 1, dims, n - 1, dims) [N/m] and masses [kg] of the inner particles, and positions of all [m]."""
    rest = cp.chain.rest(scene, law=law, links=links)
    x, chain = rest.position.values, uniform_chain(scene, rest)
    n, dims = chain.length.size, x.shape[1]
    matrix = np.zeros((n + 1, dims, n + 1, dims))
    for j, reach in enumerate(np.diff(x, axis=0)):
        xi = np.linalg.norm(reach) / chain.length[j]
        secant, along = (1.0 - 1.0 / xi, 1.0 / xi**3) if law == "linear" else (0.5 * (xi**2 - 1.0), 1.0)
        block = chain.stiffness[j] * (secant * np.eye(dims) + along * np.outer(reach, reach) / chain.length[j] ** 2)
        for a, b, sign in ((j, j, 1), (j + 1, j + 1, 1), (j, j + 1, -1), (j + 1, j, -1)):
            matrix[a, :, b] += sign * block
    return matrix[1:-1, :, 1:-1], chain.mass[1:-1], x


def chain_frequencies(scene, links, law="linear"):
    """Return the six lowest angular frequencies about rest [rad/s], of equal masses."""
    matrix, mass, _ = tangent_at_rest(scene, law, links)
    size = matrix.shape[0] * matrix.shape[1]
    return np.sqrt(np.linalg.eigvalsh(matrix.reshape(size, size) / mass[0])[:6])
