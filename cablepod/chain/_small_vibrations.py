"""Stiffness of the links of a chain in small vibrations about rest."""

from __future__ import annotations

import numpy as np


def stiffness_of_links(reach: np.ndarray, tension: np.ndarray, axial: np.ndarray) -> np.ndarray:
    """Return the stiffness of links along a reach (n, dims) [m]: secant across them, tangent along (n, dims, dims) [N/m].

    Parameters
    ----------
    reach
        From the lower to the upper particle of each link (n, dims) [m].
    tension, axial
        Tensions [N], and tangent stiffness of each link along itself [N/m] (n,).
    """
    square = (reach * reach).sum(axis=1)
    along = reach[:, :, None] * reach[:, None, :] / square[:, None, None]
    secant = (tension / np.sqrt(square))[:, None, None]
    return secant * (np.eye(reach.shape[1]) - along) + axial[:, None, None] * along


def assembled(links: np.ndarray) -> np.ndarray:
    """Return the stiffness of all particles (n + 1, dims, n + 1, dims) for that of the links (n, dims, dims)."""
    count, dims = links.shape[:2]
    result = np.zeros((count + 1, dims, count + 1, dims))
    lower, upper = np.arange(count), np.arange(1, count + 1)
    for i, j, sign in ((lower, lower, 1.0), (upper, upper, 1.0), (lower, upper, -1.0), (upper, lower, -1.0)):
        result[i, :, j] += sign * links
    return result
