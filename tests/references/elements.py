"""Spectral elements by Legendre polynomials: integrals and derivatives of what is given at their nodes."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre


class Elements:
    """Elements of a cable whose nodes have the unstretched arc lengths `arc_length` (nodes,) [m]."""

    def __init__(self, arc_length: np.ndarray, order: int = 7) -> None:
        last = np.eye(order + 1)[-1]  # P_p
        inner = legendre.legroots(legendre.legder(last))
        place = np.concatenate([[-1.0], inner, [1.0]])
        slopes = np.stack([legendre.legval(place, legendre.legder(row)) for row in np.eye(order + 1)], axis=1)
        self.derivative = slopes @ np.linalg.inv(legendre.legvander(place, order))
        self.half = 0.5 * np.diff(arc_length[::order])  # of the elements
        self.nodes = np.arange(self.half.size)[:, None] * order + np.arange(order + 1)
        #: Weights of the integral over the arc length (elements, order + 1) [m]
        self.weight = self.half[:, None] * 2.0 / (order * (order + 1) * legendre.legval(place, last) ** 2)
        expected = (arc_length[::order][:-1] + self.half)[:, None] + np.outer(self.half, place)
        np.testing.assert_allclose(arc_length[self.nodes], expected, atol=1e-12 * arc_length[-1])

    @property
    def share(self) -> np.ndarray:
        """Length that each node carries (nodes,) [m]."""
        result = np.zeros(self.nodes.max() + 1)
        np.add.at(result, self.nodes, self.weight)
        return result

    def stretch(self, position: np.ndarray) -> np.ndarray:
        """Return the stretch at the nodes of each element (..., elements, order + 1) for positions (..., nodes, dims) [m]."""
        slope = self.derivative @ position[..., self.nodes, :] / self.half[:, None, None]
        return np.linalg.norm(slope, axis=-1)
