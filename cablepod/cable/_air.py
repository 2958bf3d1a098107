"""Drag of the wind on the nodes of spectral elements: forces at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from cablepod.cable._mesh import SpectralMesh
from cablepod.chain._air import ChainAir
from cablepod.wind._drag import straight_drag


@dataclass(frozen=True, eq=False)
class MeshAir(ChainAir):
    """Velocity of the air at the nodes of spectral elements."""

    chain: SpectralMesh
    #: The distance of two steps then falls as the square of the step from the longest stable one on; with 8 it does not.
    max_hold: ClassVar[int] = 4

    @property
    def element_drag(self) -> np.ndarray:
        """Half the density of the air times drag coefficient and diameter of the elements (elements,) [kg/m2]."""
        return np.full(self.chain.sizes.size, self.drag) * (1.0 if self.chain.ratios is None else self.chain.ratios[1])

    def force(self, position: np.ndarray, velocity: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Return the drag on all nodes (nodes, dims) [N] at an instant [s]; 0 at held ones."""
        mesh, relative = self.chain, self.relative_velocity(velocity, time)
        drag = np.repeat(self.element_drag, mesh.order + 1) * mesh.length
        at_points = straight_drag(drag, mesh.gradient(position), relative[mesh.nodes.ravel()])[0]
        force = np.zeros(position.shape)
        np.add.at(force, mesh.nodes.ravel(), at_points)
        return self._of_free(force, relative)

    @cached_property
    def _steady(self) -> MeshAir:
        return MeshAir(self.chain, self.air.steady)
