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

    def force(self, position: np.ndarray, velocity: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Return the drag on all nodes (nodes, dims) [N] at an instant [s]; 0 at held ones."""
        mesh, relative = self.chain, self.relative_velocity(velocity, time)
        drag = self.drag * mesh.length
        if mesh.ratios is not None:
            drag = drag * np.repeat(mesh.ratios[1], mesh.order + 1)
        at_points = straight_drag(drag, mesh.gradient(position), relative[mesh.nodes.ravel()])[0]
        force = np.zeros(position.shape)
        np.add.at(force, mesh.nodes.ravel(), at_points)
        return self._of_free(force, relative)

    @cached_property
    def _steady(self) -> MeshAir:
        return MeshAir(self.chain, self.air.steady)
