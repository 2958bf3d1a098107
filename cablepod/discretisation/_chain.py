"""Links and masses: the cable cut into pieces, which the chain and the reduced models share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cablepod._resources import check_memory
from cablepod.catenary._statics import solve_statics, unstretched_length
from cablepod.discretisation._laws import LAWS, green_secant, strain_energy_density, tangent_stiffness_ratio
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import integer
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._time_functions import TimeFunction


@dataclass(frozen=True)
class LumpedChain:
    """Links and masses of the chain of a scene.

    A particle carries half the mass and load of the links beside it.  A point load is shared by the two particles of the
    link on which it stands, by the lever rule.
    """

    p: Parameters
    length: np.ndarray  #: unstretched lengths of the links (n,) [m]
    arc_length: np.ndarray  #: unstretched arc length of the particles (n + 1,) [m]
    law: str = LAWS[0]  #: one of LAWS

    @cached_property
    def green(self) -> bool:
        """Whether law (21) holds."""
        return self.law == "green"

    @cached_property
    def links(self) -> int:
        """Number of links."""
        return self.length.size

    @cached_property
    def total_length(self) -> float:
        """Unstretched length [m]."""
        return float(self.arc_length[-1])

    @cached_property
    def k(self) -> np.ndarray:
        """Stiffness of the links (n,) [N/m]."""
        return self.p.stiffness / self.length

    @cached_property
    def inverse_squares(self) -> np.ndarray | None:
        """One over the squares of the unstretched lengths (n,) [1/m^2] for law (21), None for the linear one."""
        return 1.0 / (self.length * self.length) if self.green else None

    @cached_property
    def tributary_length(self) -> np.ndarray:
        """Unstretched length that each particle carries (n + 1,) [m]."""
        half = 0.5 * self.length
        return np.concatenate([half[:1], half[:-1] + half[1:], half[-1:]])

    @cached_property
    def statics(self) -> np.ndarray:
        """The elastic catenary of this length at rest, as :func:`cablepod.parameters._parameters.solve_statics` gives it."""
        return solve_statics(self.p, "unstretched_length", self.total_length)

    @cached_property
    def free_particles(self) -> slice:
        """The particles that move freely."""
        n = self.links
        return slice(0 if self.p.free_end == "lower" else 1, n + 1 if self.p.free_end == "upper" else n)

    def loads(self, time: float | None = None) -> np.ndarray:
        """Return forces on the particles (n + 1, dims) [N]: the constant ones, or all at `time` [s]."""
        total = self.tributary_length[:, None] * self.p.weight
        for pattern, factor in self._patterns:
            if factor is None:
                total = total + pattern
            elif time is not None:
                total = total + float(factor(time)) * pattern
        return total

    def time_dependent_loads(self) -> list[tuple[np.ndarray, TimeFunction]]:
        """Return loads that vary in time: patterns (n + 1, dims) [N] and their factors."""
        return [(pattern, factor) for pattern, factor in self._patterns if factor is not None]

    def lever(self, fraction: float) -> tuple[int, float]:
        """Find the link of a place, given as a fraction of the length: its left particle, and the share of the right one."""
        s = fraction * self.total_length
        j = min(int(np.searchsorted(self.arc_length, s, side="right")) - 1, self.links - 1)
        return j, (s - self.arc_length[j]) / self.length[j]

    @cached_property
    def _patterns(self) -> list[tuple[np.ndarray, Any]]:
        patterns: list[tuple[np.ndarray, Any]] = []
        if self.p.load is not None:
            patterns.append((self.tributary_length[:, None] * self.p.load, self.p.load_factor))
        for load in self.p.point_loads:
            j, right = self.lever(load.fraction)
            pattern = np.zeros((self.links + 1, self.p.dims))
            pattern[j] = (1.0 - right) * load.force
            pattern[j + 1] = right * load.force
            patterns.append((pattern, load.factor))
        return patterns

    def tensions_and_forces(
        self, position: np.ndarray, velocity: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Tensions (..., n) [N] and forces of the links (..., n, dims) [N] at positions (..., n + 1, dims) [m].

        By law (21) a compressed link pushes: its tension is negative.
        """
        reach = np.diff(position, axis=-2)
        inverse = self.inverse_squares
        if inverse is not None:
            squares = square(reach)
            s = green_secant(squares * inverse, self.k)
            return s * np.sqrt(squares), s[..., None] * reach
        size = np.sqrt(square(reach))
        with np.errstate(divide="ignore", invalid="ignore"):
            s = self.k * (1.0 - self.length / size)
            total = s
            if velocity is not None and self.p.link_viscosity is not None:
                rate = np.sum(reach * np.diff(velocity, axis=-2), axis=-1)
                total = s + self.p.link_viscosity * self.k * rate / size**2
        s = np.where((s > 0.0) & (total > 0.0), total, 0.0)
        return s * size, s[..., None] * reach

    def stretch(self, position: np.ndarray) -> np.ndarray:
        """Stretch xi = |R| / l of the links (..., n) at positions (..., n + 1, dims) [m]."""
        return np.sqrt(square(np.diff(position, axis=-2))) / self.length

    def strain_energy(self, position: np.ndarray) -> np.ndarray:
        """Strain energy of all links (...) at positions (..., n + 1, dims) [J]."""
        per_length = strain_energy_density(self.stretch(position), green=self.green)
        return self.p.stiffness * (per_length * self.length).sum(axis=-1)

    def tangent_stiffness_ratio(self, position: np.ndarray) -> np.ndarray:
        """Tangent stiffness of the links over `k` (..., n) at positions (..., n + 1, dims) [m]; 1 by the linear law.

        By law (21) it is (3 xi^2 - 1) / 2, but no less than 1 is returned: a compressed link comes back through xi = 1.
        """
        return tangent_stiffness_ratio(self.stretch(position) ** 2) if self.green else np.ones(self.links)

    def largest_enforced_ratio(self, until: float) -> float:
        """Tangent stiffness over `k` at the stretch that the distance of the ends enforces at some time until then [s].

        It is looked for at times of its own, so that it does not depend on the instants of an output.
        """
        ends = self.p.end_positions(np.linspace(0.0, until, 1001))
        stretch = np.sqrt(square(ends[:, 1] - ends[:, 0])).max() / self.total_length
        return float(tangent_stiffness_ratio(float(stretch) ** 2)) if self.green else 1.0

    def highest_frequency(self, stiffening: np.ndarray | float = 1.0) -> float:
        """Bound of the angular frequencies [rad/s] of the chain in any shape in which its links are no stiffer than said.

        A link resists no direction more than its own, so no shape has a higher frequency than the straight chain moved along
        itself, whose frequencies are the eigenvalues of a tridiagonal matrix.
        """
        if not self.green:
            return self._frequency
        return self._highest(stiffening)

    @cached_property
    def _frequency(self) -> float:
        """Highest angular frequency of links that do not stiffen [rad/s]; asked for several times in a run."""
        return self._highest(1.0)

    def _highest(self, stiffening: np.ndarray | float) -> float:
        from scipy.linalg import eigvalsh_tridiagonal  # takes longer to import than a short run

        first, last = self.free_particles.start, self.free_particles.stop
        m = self.p.mass * self.tributary_length[first:last]
        k = np.concatenate([[0.0], stiffening * self.k, [0.0]])
        diagonal = (k[first:last] + k[first + 1 : last + 1]) / m
        if diagonal.size == 1:
            return math.sqrt(diagonal[0])
        off = -k[first + 1 : last] / np.sqrt(m[:-1] * m[1:])
        top = diagonal.size - 1
        return math.sqrt(eigvalsh_tridiagonal(diagonal, off, select="i", select_range=(top, top))[0])

    def step_limit(self, stiffening: np.ndarray | float = 1.0) -> float:
        """Stability limit of the step of velocity Verlet [s]: 2 over the highest frequency, less with viscous links."""
        omega = self.highest_frequency(stiffening)
        if self.p.link_viscosity is None:
            # damping by mass, integrated exactly, only widens the limit
            return 2.0 / omega
        return _viscous_limit(omega, self.p.link_viscosity)


def square(vectors: np.ndarray) -> np.ndarray:
    """Square of the length of vectors (..., dims), summed in the order of the kernels: planar and spatial agree bit for bit."""
    total = vectors[..., 0] * vectors[..., 0] + vectors[..., 1] * vectors[..., 1]
    return total + vectors[..., 2] * vectors[..., 2] if vectors.shape[-1] == 3 else total


def _viscous_limit(omega: float, viscosity: float) -> float:
    """Largest stable step [s] of the scheme with predicted velocity for one frequency, by its amplification matrix."""
    damping = viscosity * omega  # twice the damping ratio

    def radius(h: float) -> float:
        # state: position, velocity half a step before, and that a step earlier; times in 1/omega
        a = np.array([-1.0, -1.5 * damping, 0.5 * damping])
        v = np.array([0.0, 1.0, 0.0]) + h * a
        return float(np.abs(np.linalg.eigvals(np.array([np.array([1.0, 0.0, 0.0]) + h * v, v, [0.0, 1.0, 0.0]]))).max())

    low, high = 0.0, 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if radius(middle) <= 1.0 + 1e-12 else (low, middle)
    return low / omega


def chain_of(p: Parameters, links: int | None = None, law: str = LAWS[0], *, least: int = 2) -> LumpedChain:
    """Make the chain of a scene's parameters, with `links` links in place of the scene's, at least `least`, by one of LAWS."""
    if links is not None:
        integer(least=least)("links", links)
    count = p.links if links is None else int(links)
    if count is None:
        raise SceneError(
            "chain.links: missing; allowed: a whole number of at least 2 in the scene, or the argument links"
        )
    check_memory(1, count, p.dims, key="links" if links is not None else "chain.links")
    relative = np.ones(count) if p.link_lengths is None else p.link_lengths
    if relative.size != count:
        raise scene_error(
            "links", links, f"{relative.size}, as many as chain.link_lengths has, or a scene without those"
        )
    total = unstretched_length(p)
    length = total * (relative / relative.sum())
    arc_length = np.concatenate([[0.0], np.cumsum(length)])
    arc_length[-1] = total
    return LumpedChain(p, length, arc_length, law)
