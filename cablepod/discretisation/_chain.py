"""Lumped-mass discretisation of a cable: links, masses, loads, tensions, bound of the frequencies."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from cablepod._resources import check_memory
from cablepod.catenary._statics import solve_statics, unstretched_length
from cablepod.discretisation._formulas import damping_by_tension, green_secant
from cablepod.discretisation._laws import (
    LAWS,
    strain_energy_density,
    tangent_stiffness_ratio,
    taut_secant,
)
from cablepod.discretisation._nonuniform import (
    compliances,
    lengths_between_attachments,
    lumped,
    nearest_particles,
)
from cablepod.discretisation._step_limit import highest_axial_frequency, verlet_step_limit
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import integer
from cablepod.parameters._ice import mass_of_ice
from cablepod.parameters._parameters import Parameters, PointLoad
from cablepod.parameters._particles import lengths_of_links, tributary_lengths
from cablepod.parameters._time_functions import TimeFunction


@dataclass(frozen=True)
class LumpedChain:
    """Links and masses of the chain of a scene.

    A particle carries half the mass and load of the links beside it, of a cable of several segments by the lever rule, unless the
    scene gives the mass of each particle and the stiffness of each link.  A point load acts on the two particles of its link by
    the lever rule; an attachment has a particle of its own.
    """

    p: Parameters
    length: np.ndarray  #: unstretched lengths of the links (n,) [m]
    arc_length: np.ndarray  #: unstretched arc length of the particles (n + 1,) [m]
    law: str = LAWS[0]  #: one of LAWS
    #: unstretched length of the scene, to which distances of attachments belong [m]; None for that of the chain
    scene_length: float | None = field(default=None, kw_only=True)

    @cached_property
    def green(self) -> bool:
        """Whether the law is "green", eq. (21) of the paper."""
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
        if (own := self.p.link_stiffness) is not None:
            return np.asarray(own / self.p.expansion)
        if not self.p.segments:
            return np.asarray(self.p.stiffness / self.length)
        return 1.0 / compliances(self.arc_length, self._borders, self._of_segments("stiffness"))

    @property
    def _has_one_stiffness(self) -> bool:
        """Whether the axial stiffness is the same along the cable."""
        return not self.p.segments and self.p.link_stiffness is None

    @cached_property
    def axial_stiffness(self) -> float | np.ndarray:
        """Axial stiffness K of the links [N]: one number, or (n,) where it differs along the cable."""
        return self.p.stiffness if self._has_one_stiffness else self.k * self.length

    @cached_property
    def stiffness_of_parts(self) -> np.ndarray:
        """Axial stiffness K of the segments, otherwise of the links, or one for all (parts,) [N]."""
        return self._of_segments("stiffness") if self.p.segments else np.atleast_1d(self.axial_stiffness)

    @cached_property
    def mass(self) -> np.ndarray:
        """Masses of the particles (n + 1,) [kg]."""
        p = self.p
        if p.masses is None:
            return self._of_particles("mass")
        return p.masses + mass_of_ice(p) * self.tributary_length

    @property
    def own_masses(self) -> np.ndarray | None:
        """Masses of the particles of a result (n + 1,) [kg]; None where they are in proportion to their tributary lengths."""
        p = self.p
        has_own = p.masses is not None or p.segments or any(attachment.mass for attachment in p.attachments)
        return self.mass if has_own else None

    @property
    def _weights(self) -> np.ndarray:
        """Weights of the particles (n + 1, dims) [N]."""
        if self.p.masses is None:
            return self._of_particles("weight")
        return self.mass[:, None] * (self.p.weight / self.p.mass)

    @property
    def _borders(self) -> list[float]:
        """Borders of the segments as fractions of the length (segments + 1,)."""
        return [0.0, *(segment.end for segment in self.p.segments)]

    def _of_segments(self, name: str) -> np.ndarray:
        """Return a property of the segments (segments, ...)."""
        return np.array([getattr(segment, name) for segment in self.p.segments])

    def _of_particles(self, name: str) -> np.ndarray:
        """Return mass or weight of the particles (n + 1, ...)."""
        p = self.p
        if p.segments:
            result = lumped(self.arc_length, self._borders, self._of_segments(name))
        else:
            result = np.multiply.outer(self.tributary_length, np.asarray(getattr(p, name)))
        for attachment, fraction in zip(p.attachments, self.attached_fractions, strict=True):
            j, weight = self.lever(fraction)
            result[j] += (1.0 - weight) * getattr(attachment, name)
            result[j + 1] += weight * getattr(attachment, name)
        return result

    @cached_property
    def attached_particles(self) -> np.ndarray:
        """Particles at the attachments, in their order (attachments,)."""
        return nearest_particles(self.arc_length, np.array(self.attached_fractions))

    @property
    def attached_fractions(self) -> list[float]:
        """Places of the attachments as fractions of the length (attachments,)."""
        length = self.total_length if self.scene_length is None else self.scene_length
        return [attachment.fraction(length) for attachment in self.p.attachments]

    @cached_property
    def drag_ratio(self) -> np.ndarray | None:
        """Drag coefficient times diameter at the particles over the mean of the cable (n + 1,); None for equal ones."""
        p = self.p
        if p.diameter is None or len({(part.drag_coefficient, part.diameter) for part in p.segments}) < 2:
            return None
        widths = self._of_segments("drag_coefficient") * self._of_segments("diameter")
        mean = p.drag_coefficient * p.diameter
        if mean == 0.0:
            return None
        return lumped(self.arc_length, self._borders, widths) / (mean * self.tributary_length)

    @cached_property
    def inverse_squares(self) -> np.ndarray | None:
        """Inverse squares of the unstretched lengths (n,) [1/m^2] for law (21), None for the linear law."""
        return 1.0 / (self.length * self.length) if self.green else None

    @cached_property
    def tributary_length(self) -> np.ndarray:
        """Unstretched length that each particle carries (n + 1,) [m]."""
        return tributary_lengths(self.length)

    @property
    def particles(self) -> np.ndarray:
        """Unstretched arc length of the particles of a result (particle,) [m]."""
        return self.arc_length

    @property
    def chord(self) -> float:
        """Distance of the ends at rest [m]."""
        return float(np.linalg.norm(self.p.upper - self.p.lower))

    def interpolate(self, values: Any) -> np.ndarray:
        """Return values (..., n + 1, dims) at the particles of the result."""
        return values

    def at_compared(self, position: np.ndarray) -> np.ndarray:
        """Return positions (..., n + 1, dims) at the points at which two runs are compared [m]."""
        return position

    @cached_property
    def statics(self) -> np.ndarray:
        """Elastic catenary of this length at rest, see :func:`cablepod.catenary._statics.solve_statics`."""
        return solve_statics(self.p, "unstretched_length", self.total_length)

    @cached_property
    def free_particles(self) -> slice:
        """Indices of the particles that are not held."""
        n = self.links
        return slice(0 if self.p.free_end == "lower" else 1, n + 1 if self.p.free_end == "upper" else n)

    def loads(self, time: float | None = None) -> np.ndarray:
        """Return the loads on the particles (n + 1, dims) [N]: the constant ones, or all at `time` [s]."""
        total = self._weights
        for pattern, factor in self._patterns:
            if factor is None:
                total = total + pattern
            elif time is not None:
                total = total + float(factor(time)) * pattern
        return total

    def time_dependent_loads(self) -> list[tuple[np.ndarray, TimeFunction]]:
        """Return the time-dependent loads: patterns (n + 1, dims) [N] and their factors."""
        return [(pattern, factor) for pattern, factor in self._patterns if factor is not None]

    def lever(self, fraction: float) -> tuple[int, float]:
        """Return the link at a fraction of the length: its lower particle, and the lever-rule weight of its upper one."""
        s = fraction * self.total_length
        j = min(int(np.searchsorted(self.arc_length, s, side="right")) - 1, self.links - 1)
        return j, (s - self.arc_length[j]) / self.length[j]

    @cached_property
    def _patterns(self) -> list[tuple[np.ndarray, Any]]:
        """Loads (n + 1, dims) [N] and their factors, None for constant ones."""
        patterns: list[tuple[np.ndarray, Any]] = []
        if self.p.load is not None:
            patterns.append((self.tributary_length[:, None] * self.p.load, self.p.load_factor))
        return patterns + [(self._point_pattern(load), load.factor) for load in self.p.point_loads]

    def _point_pattern(self, load: PointLoad) -> np.ndarray:
        """Distribute a point load at factor 1 over the particles (n + 1, dims) [N]."""
        j, weight = self.lever(load.fraction)
        pattern = np.zeros((self.links + 1, self.p.dims))
        pattern[j] = (1.0 - weight) * load.force
        pattern[j + 1] = weight * load.force
        return pattern

    def tensions_and_forces(
        self, position: np.ndarray, velocity: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return tensions (..., n) and forces of the links (..., n, dims) [N] at positions (..., n + 1, dims) [m].

        By law (21) a compressed link pushes: its tension is negative.
        """
        reach, rate = np.diff(position, axis=-2), None if velocity is None else np.diff(velocity, axis=-2)
        return self.tensions_along(reach, rate, self.length, self.k)

    def tensions_along(
        self, reach: np.ndarray, rate: np.ndarray | None, length: Any, stiffness: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return tensions (...) and forces (..., dims) [N] along vectors, with damping where their `rate` (..., dims) is known.

        Parameters
        ----------
        reach, rate
            Vectors of links (..., dims) [m] and their rates [m/s], or derivatives of the position by arc length and theirs.
        length, stiffness
            Unstretched lengths [m], 1 for derivatives; stiffness over them [N/m].
        """
        p, squares = self.p, square(reach)
        stretched = np.sqrt(squares)
        if self.green:
            secant = green_secant(squares * (1.0 / (length * length)), stiffness)
        else:
            is_viscous = rate is not None and p.link_viscosity is not None
            stretching = np.sum(reach * rate, axis=-1) if is_viscous else None
            secant = taut_secant(stretched, length, stiffness, p.link_viscosity, stretching)
        force = secant[..., None] * reach
        if rate is not None and p.tension_damping is not None:
            force += secant[..., None] * damping_by_tension(rate, secant[..., None], p.tension_damping)
        return secant * stretched, force

    def forces(self, position: np.ndarray, velocity: np.ndarray | None = None) -> np.ndarray:
        """Return the forces of the links on the particles (..., n + 1, dims) [N]."""
        force = self.tensions_and_forces(position, velocity)[1]
        zero = np.zeros_like(force[..., :1, :])
        return np.diff(np.concatenate([zero, force, zero], axis=-2), axis=-2)

    def stretch(self, position: np.ndarray) -> np.ndarray:
        """Return the stretch xi = |R| / l of the links (..., n) at positions (..., n + 1, dims) [m]."""
        return np.sqrt(square(np.diff(position, axis=-2))) / self.length

    def strain_energy(self, position: np.ndarray) -> np.ndarray:
        """Return the strain energy of all links (...) [J] at positions (..., n + 1, dims) [m]."""
        per_length = strain_energy_density(self.stretch(position), green=self.green)
        if self._has_one_stiffness:
            return self.p.stiffness * (per_length * self.length).sum(axis=-1)
        return (per_length * self.axial_stiffness * self.length).sum(axis=-1)

    def tangent_stiffness_ratio(self, position: np.ndarray) -> np.ndarray:
        """Return the tangent stiffness of the links over `k` (..., n) at positions (..., n + 1, dims) [m].

        It is 1 by the linear law, and max(1, (3 xi^2 - 1) / 2) by law (21): a compressed link returns through xi = 1.
        """
        return tangent_stiffness_ratio(self.stretch(position) ** 2) if self.green else np.ones(self.links)

    def largest_enforced_ratio(self, end_time: float) -> float:
        """Return the tangent stiffness over `k` at the largest stretch that the ends enforce until `end_time` [s].

        The distance of the ends is sampled at 1001 instants, independently of the output times.
        """
        ends = self.p.end_positions(np.linspace(0.0, end_time, 1001))
        stretch = float(np.sqrt(square(ends[:, 1] - ends[:, 0])).max() / self.total_length)
        if self.p.segments:  # that of the softest
            stretch = 1.0 + (stretch - 1.0) * self.p.stiffness / float(self.stiffness_of_parts.min())
        return float(tangent_stiffness_ratio(stretch**2)) if self.green else 1.0

    def highest_frequency(self, stiffness_ratio: np.ndarray | float = 1.0) -> float:
        """Return a bound of the angular frequencies [rad/s] for links of at most `stiffness_ratio` times `k`.

        A link is stiffest along itself, so that no shape has a higher frequency than the axial motion of the straight chain.  Its
        frequencies are the eigenvalues of a tridiagonal matrix.
        """
        if not self.green:
            return self._linear_frequency
        return self._axial_frequency(stiffness_ratio)

    @cached_property
    def _linear_frequency(self) -> float:
        """Highest axial frequency of links that do not stiffen [rad/s] (cached: a run needs it several times)."""
        return self._axial_frequency(1.0)

    def _axial_frequency(self, stiffness_ratio: np.ndarray | float) -> float:
        springs = None
        if any(attachment.spring for attachment in self.p.attachments):
            springs = np.zeros(self.links + 1)
            springs[self.attached_particles] = [attachment.spring for attachment in self.p.attachments]
        return highest_axial_frequency(self.mass, stiffness_ratio * self.k, self.free_particles, springs)

    def step_limit(self, stiffness_ratio: np.ndarray | float = 1.0) -> float:
        """Return the stability limit of velocity Verlet [s], see :mod:`cablepod.discretisation._step_limit`."""
        return verlet_step_limit(self.highest_frequency(stiffness_ratio), self._axial_viscosity)

    @property
    def _axial_viscosity(self) -> float | None:
        """Viscosity of the links [s], with that of the damping by the tension T at rest: along a link it is T/K times that.

        T is that of the cable of the mean mass and stiffness, K that of the softest link.
        """
        if self.p.tension_damping is None:
            return self.p.link_viscosity
        strain = float(self.statics[4:].max() / self.stiffness_of_parts.min())
        return (self.p.link_viscosity or 0.0) + self.p.tension_damping * strain


def square(vectors: np.ndarray) -> np.ndarray:
    """Return the squared length of vectors (..., dims), summed in the order of the kernels for equal bits."""
    total = vectors[..., 0] * vectors[..., 0] + vectors[..., 1] * vectors[..., 1]
    return total + vectors[..., 2] * vectors[..., 2] if vectors.shape[-1] == 3 else total


def chain_of(p: Parameters, links: int | None = None, law: str = LAWS[0], *, least: int = 2) -> LumpedChain:
    """Discretise a scene's parameters into a chain, with `links` (at least `least`) in place of the scene's."""
    if links is not None:
        integer(least=least)("links", links)
    count = p.links if links is None else int(links)
    if count is None:
        raise SceneError(
            "chain.links: missing; allowed: a whole number of at least 2 in the scene, or the argument links"
        )
    key = "links" if links is not None else "chain.links"
    check_memory(1, count, p.dims, key=key)
    for name, values, more in (
        ("link_lengths", p.link_lengths, 0),
        ("masses", p.masses, 1),
        ("stiffness", p.link_stiffness, 0),
    ):
        if values is not None and values.size != count + more:
            allowed = f"{values.size - more}, as many as chain.{name} has, or a scene without those"
            raise scene_error("links", links, allowed)
    total = unstretched_length(p)
    even = lengths_of_links(total, count, p.link_lengths)
    length = lengths_between_attachments(p, total, count, key) if p.attachments else even
    arc_length = np.concatenate([[0.0], np.cumsum(length)])
    arc_length[-1] = total
    return LumpedChain(p, length, arc_length, law)
