"""Small vibrations of a uniform chain about rest by dense matrices, written down link by link."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scenes import uniform_chain

import cablepod as cp


def chain_frequencies(scene: xr.Dataset, links: int, law: str = "linear") -> np.ndarray:
    """Return the six lowest eigenvalues of the tangent stiffness at rest, as angular frequencies [rad/s]."""
    rest = cp.chain.rest(scene, links=links, law=law)
    length, stiffness, mass = uniform_chain(scene, rest)
    dims = rest.sizes["coordinate"]
    matrix = np.zeros((links + 1, dims, links + 1, dims))
    for j, reach in enumerate(np.diff(rest.position.values, axis=0)):
        xi = np.linalg.norm(reach) / length[j]
        secant, along = (1.0 - 1.0 / xi, 1.0 / xi**3) if law == "linear" else (0.5 * (xi**2 - 1.0), 1.0)
        block = stiffness[j] * (secant * np.eye(dims) + along * np.outer(reach, reach) / length[j] ** 2)
        for a, b, sign in ((j, j, 1), (j + 1, j + 1, 1), (j, j + 1, -1), (j + 1, j, -1)):
            matrix[a, :, b] += sign * block
    inner = matrix[1:-1, :, 1:-1].reshape((links - 1) * dims, -1)
    return np.sqrt(np.linalg.eigvalsh(inner / mass[1])[:6])
