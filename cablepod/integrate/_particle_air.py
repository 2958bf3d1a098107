"""What a run of the chain needs of the wind."""

from __future__ import annotations

from typing import Protocol

import numpy as np

#: How a stability limit follows that the drag sets.
OF_DRAG = "by the rate at which drag changes the velocity of so light a cable"


class ParticleForces(Protocol):
    """Forces of dampers and springs on the particles of a chain."""

    @property
    def particles(self) -> np.ndarray:
        """Particles on which they act (attachments,)."""

    @property
    def numbers(self) -> np.ndarray:
        """Numbers of each for the kernels (attachments, ...)."""

    def force(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the forces on the particles (n + 1, dims) [N]."""

    def energy(self, position: np.ndarray) -> float:
        """Return the energy of the springs [J] at positions (n + 1, dims) [m]."""

    def add_stiffness(self, matrix: np.ndarray) -> None:
        """Add the springs to the stiffness of the free particles (unknowns, unknowns) [N/m]."""


class ParticleAir(Protocol):
    """Drag of the wind on the particles of a chain."""

    @property
    def drag(self) -> float:
        """Half the density of the air times drag coefficient and diameter [kg/m2]."""

    @property
    def samples_per_second(self) -> float:
        """Samples of the velocity of the air per second."""

    @property
    def interval(self) -> float:
        """Interval of the gusts, which the steps of a run resolve [s]."""

    @property
    def velocity(self) -> np.ndarray:
        """Velocity of the air (samples, dims, n + 1) [m/s]."""

    @property
    def sampling_error(self) -> float:
        """Error of the load by gusts on the first vibration, as a part of its rms, by the places of the particles."""

    def step_limit(self, end_time: float) -> float:
        """Return the longest step [s] from one evaluation of the drag to the next for which a run until `end_time` is stable."""

    def hold(self, tension: float, step: float, end_time: float) -> int:
        """Return the number of explicit steps [s] from one evaluation of the drag to the next, for a tension [N]."""

    def force(self, position: np.ndarray, velocity: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Return the drag on the particles (n + 1, dims) [N] at an instant [s]."""

    def energy_bound(self, position: np.ndarray) -> float:
        """Return the work of the largest drag over the reach of the cable [J]."""
