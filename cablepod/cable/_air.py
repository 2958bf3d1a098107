"""Drag of the wind on the nodes of spectral elements: forces at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from cablepod.cable._mesh import SpectralMesh
from cablepod.chain._air import ChainAir


@dataclass(frozen=True, eq=False)
class MeshAir(ChainAir):
    """Velocity of the air at the nodes of spectral elements."""

    chain: SpectralMesh
    #: The distance of two steps then falls as the square of the step from the longest stable one on; with 8 it does not.
    max_hold: ClassVar[int] = 4

    def force(self, position: np.ndarray, velocity: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Return the drag on all nodes (nodes, dims) [N] at an instant [s]; 0 at held ones."""
        from cablepod.cable import _kernels_air as kernel  # numba is imported only to compute

        mesh, shape = self.chain, position.shape[::-1]
        d, weight, scale, _, _, ratios = mesh.law_arguments
        x, u, points = np.ascontiguousarray(position.T), np.ascontiguousarray(velocity.T), (weight.size, scale.size)
        force = np.empty(shape)
        kernel.drag_forces(
            x, u, self.velocity, time * self.samples_per_second, self.drag, ratios, self.bodies, d, weight, scale, None,
            np.empty(points), np.empty((shape[0], *points)), force,
        )  # fmt: skip
        result = np.zeros_like(position)
        result[mesh.free_particles] = force.T[mesh.free_particles]
        return result

    @cached_property
    def _steady(self) -> MeshAir:
        return MeshAir(self.chain, self.air.steady)
