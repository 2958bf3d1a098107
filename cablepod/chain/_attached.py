"""Dampers and springs at the particles of a chain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import LumpedChain

if TYPE_CHECKING:
    from cablepod.chain._air import ChainAir


@dataclass(frozen=True, eq=False)
class AttachedForces:
    """Dampers and springs between particles and the ground."""

    chain: LumpedChain
    particles: np.ndarray  #: (attachments,)
    numbers: np.ndarray  #: (attachments, COLUMNS), see :mod:`cablepod.chain._kernels_attached`

    @classmethod
    def of(cls, chain: LumpedChain, rest: np.ndarray) -> AttachedForces | None:
        """Return the dampers and springs of a chain, without force at `rest` (n + 1, dims) [m]; None without any."""
        from cablepod.chain import _kernels_attached as kernel

        p = chain.p
        acting = [k for k, attachment in enumerate(p.attachments) if attachment.damper or attachment.spring]
        if not acting:
            return None
        particles = chain.attached_particles[acting]
        numbers = np.zeros((len(acting), kernel.COLUMNS))
        for row, particle, attachment in zip(numbers, particles, (p.attachments[k] for k in acting), strict=True):
            row[kernel.DIRECTION : kernel.DIRECTION + p.dims] = attachment.direction
            row[kernel.REST : kernel.REST + p.dims] = rest[particle]
            row[kernel.DAMPER], row[kernel.SPRING] = attachment.damper, attachment.spring
        return cls(chain, particles, numbers)

    def energy(self, position: np.ndarray) -> float:
        """Return the energy of the springs [J] at positions (n + 1, dims) [m]."""
        spring, _, stretch = self._springs(position)
        return 0.5 * float(spring @ stretch**2)

    def force(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return their forces on all particles (n + 1, dims) [N]."""
        from cablepod.chain import _kernels_attached as kernel

        spring, direction, stretch = self._springs(position)
        rate = (velocity[self.particles] * direction).sum(axis=1)
        along = -(spring * stretch + self.numbers[:, kernel.DAMPER] * rate)
        force = np.zeros(position.shape)
        np.add.at(force, self.particles, along[:, None] * direction)
        return force

    def _springs(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return stiffness [N/m], direction (attachments, dims) and displacement along it [m] at positions (n + 1, dims) [m]."""
        from cablepod.chain import _kernels_attached as kernel

        axes = np.arange(self.chain.p.dims)
        direction = self.numbers[:, kernel.DIRECTION + axes]
        moved = position[self.particles] - self.numbers[:, kernel.REST + axes]
        return self.numbers[:, kernel.SPRING], direction, (moved * direction).sum(axis=1)

    def add_stiffness(self, matrix: np.ndarray) -> None:
        """Add the springs to the stiffness of the free particles (unknowns, unknowns) [N/m]."""
        from cablepod.chain import _kernels_attached as kernel

        dims, first = self.chain.p.dims, self.chain.free_particles.start
        for particle, numbers in zip(self.particles, self.numbers, strict=True):
            direction = numbers[kernel.DIRECTION : kernel.DIRECTION + dims]
            rows = slice(dims * (particle - first), dims * (particle - first + 1))
            matrix[rows, rows] += numbers[kernel.SPRING] * np.outer(direction, direction)


def attached_forces(chain: LumpedChain, initial: np.ndarray, air: ChainAir | None) -> AttachedForces | None:
    """Return the dampers and springs of a chain; None without.

    Parameters
    ----------
    chain
        The chain.
    initial
        Positions at the start (n + 1, dims) [m], at rest unless the scene has a table ``[initial]``.
    air
        Drag, in which the springs have no force at rest.
    """
    p = chain.p
    has_spring = any(attachment.spring for attachment in p.attachments)
    return AttachedForces.of(chain, rest_shape(chain, air)[0] if has_spring and p.initial else initial)
