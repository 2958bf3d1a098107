"""Run of a mast with chains as guys."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cablepod.chain._air import ChainAir
from cablepod.chain._attached import AttachedForces
from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import LumpedChain, chain_of
from cablepod.discretisation._step_limit import verlet_step_limit
from cablepod.errors import scene_error
from cablepod.mast._air import drive_of
from cablepod.mast._kernels_layout import (
    BODY,
    DRAG,
    LINK_LENGTH,
    LINK_STIFFNESS,
    PER_MASS,
    PLACE,
    ChainTerms,
    ChainWind,
)
from cablepod.mast._march import march
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastRequest, MastTrajectory
from cablepod.parameters._mast import MastParameters
from cablepod.scene._mast_field import GUY_POINTS
from cablepod.wind._air import CableAir, refined
from cablepod.wind._drag import drag_of, drag_rate, drag_step_limit, straight_drag
from cablepod.wind._mast_air import MastAir

#: Step over the stability limit of the links: a chain that goes slack and taut again breaks down near 1.
STEP_OVER_LIMIT = 0.5
#: Viscosity of the links over the stability limit of the step: the highest axial frequency is damped by this ratio, others by
#: less.  Without it links that go slack and taut gain energy from explicit steps.
VISCOSITY = 0.05
#: Maximum time over which the drag is held [s], and number of steps.
MAX_HOLD_TIME, MAX_HOLD = 0.01, 8


def links_of(p: MastParameters) -> int:
    """Return the number of links of a guy that the scene gives, or that of scenes without one."""
    return (p.guys[0].p.links if p.guys else None) or 2


@dataclass(frozen=True, eq=False)
class ChainGuys:
    """The guys of a mast as chains, all of the same number of links."""

    mast: ModalMast
    links: int
    air: MastAir | None

    @cached_property
    def chains(self) -> list[LumpedChain]:
        """The chains, with their upper ends at rest."""
        guys = zip(self.mast.rest.bare, self.mast.rest.upper, strict=True)
        return [chain_of(replace(guy.p, upper=end), self._given(guy.p.links)) for guy, end in guys]

    def _given(self, of_scene: int | None) -> int | None:
        """Return the number of links where it is not that of the scene, whose key errors name then."""
        return None if self.links == of_scene else self.links

    @cached_property
    def drag(self) -> np.ndarray:
        """Half the density of the air times drag coefficient and diameter of the guys [kg/m2]."""
        assert self.air is not None
        return np.array([drag_of(chain.p, self.air.density) for chain in self.chains])

    @property
    def default_step(self) -> float:
        """Step by the stability limit of the links [s]."""
        return STEP_OVER_LIMIT * self.step_limit

    @cached_property
    def step_limit(self) -> float:
        """Stability limit of links, mast, and drag on the guys [s]."""
        limits = [chain.step_limit() for chain in self.chains]
        return min([*limits, verlet_step_limit(float(self.mast.omega[-1])), drag_step_limit(self.drag_rate)])

    @cached_property
    def drag_rate(self) -> float:
        """Bound of the rate at which drag takes away a motion of the guys [1/s]."""
        if self.air is None:
            return 0.0
        rates = [self.air.drag_rate(self.mast.rest.p)]
        if any(guy.pieces is not None for guy in self.mast.rest.bare):  # of segments, or with attachments
            for g, (chain, air) in enumerate(zip(self.chains, self._airs, strict=True)):
                own = self.air.of_guys(self.air.velocity)[:, g]
                speed = float(np.sqrt((own * own).sum(axis=-1)).max())
                rates.append(float(drag_rate(air.of_particles, chain.mass, speed)[1:-1].max()))
        return max(rates)

    @cached_property
    def _airs(self) -> list[ChainAir]:
        """The steady air of the start along each guy."""
        assert self.air is not None
        sigma, airs = np.linspace(0.0, 1.0, GUY_POINTS), []
        for g, chain in enumerate(self.chains):
            start = self.air.of_guys(self.air.start)[g]
            velocity = np.repeat(start[None], 2, axis=0)
            airs.append(ChainAir(chain, CableAir(velocity, sigma, 1.0, float(self.drag[g]), start, np.inf)))
        return airs

    @cached_property
    def rest(self) -> np.ndarray:
        """Positions at rest in the mean wind (guys, 3, n + 1) [m]."""
        result = np.empty((len(self.chains), 3, self.links + 1))
        for g, chain in enumerate(self.chains):
            result[g] = rest_shape(chain, None if self.air is None else self._airs[g])[0].T
        return result

    def _terms(self, limit: float) -> ChainTerms:
        """Return links and particles at rest for the kernel, with the viscosity for a stability limit [s]."""
        p, count, n = self.mast.rest.p, len(self.chains), self.links
        links, particles = np.empty((count, 2, n)), np.zeros((count, 4, n + 1))
        attached = [AttachedForces.of(chain, x.T) for chain, x in zip(self.chains, self.rest, strict=True)]
        for g, chain in enumerate(self.chains):
            links[g, LINK_STIFFNESS], links[g, LINK_LENGTH] = chain.k, chain.length
            particles[g, PER_MASS] = 1.0 / chain.mass
            particles[g, PLACE] = chain.arc_length / chain.total_length * (GUY_POINTS - 1.0)
            if self.air is not None:
                bodies = self._airs[g].bodies
                particles[g, DRAG], particles[g, BODY] = self._airs[g].drags, 0.0 if bodies is None else bodies
        counts = [0 if own is None else own.particles.size for own in attached]
        acting = [own for own in attached if own is not None]
        return ChainTerms(
            self.rest.copy(), np.zeros_like(self.rest), self.rest[:, 1, -1].copy(), links, particles, self.end_mass,
            np.concatenate([[0], np.cumsum(counts, dtype=int)]),
            np.concatenate([np.zeros(0, dtype=int), *(own.particles for own in acting)]),
            np.concatenate([own.numbers for own in acting]) if acting else np.zeros((0, 0)),
            VISCOSITY * limit, p.gravity, p.mass_damping, np.zeros((3, n)), np.zeros((count, 3, n + 1)),
        )  # fmt: skip

    @cached_property
    def end_mass(self) -> np.ndarray:
        """Masses of the upper particles (guys,) [kg]."""
        return np.array([chain.mass[-1] for chain in self.chains])

    def run(self, request: MastRequest) -> MastTrajectory:
        """Run from rest.

        Raises
        ------
        SceneError
            For a step above the stability limit.
        """
        mast, step, limit = self.mast, request.step, self.step_limit
        if not step < limit:
            raise scene_error("step", step, f"below the stability limit of links, mast and drag, {limit:.6g} s")
        drive, wind = drive_of(mast, self.air, request), None
        if self.air is not None:
            hold = max(1, min(MAX_HOLD, int(min(MAX_HOLD_TIME, drag_step_limit(self.drag_rate)) / step)))
            velocity = refined(np.ascontiguousarray(self.air.of_guys(self.air.velocity)))
            wind = ChainWind(velocity, drive.refined_samples_per_step, hold)
        forces = np.zeros((len(self.chains), 3))
        for g, (chain, x) in enumerate(zip(self.chains, self.rest, strict=True)):
            forces[g] = -chain.tensions_and_forces(x.T)[1][-1]
            if self.air is not None:
                forces[g] += self._top_drag(g, x)
        return march(
            mast, request, mast.step_matrices_with(self.end_mass, step), drive, self.end_mass, forces,
            chains=self._terms(limit), guy_wind=wind,
        )  # fmt: skip

    def _top_drag(self, g: int, x: np.ndarray) -> np.ndarray:
        """Return the drag on the upper particle at rest (3,) [N]."""
        assert self.air is not None
        wind = self.air.of_guys(self.air.start)[g, -1]
        return straight_drag(0.5 * self._airs[g].drags[-1], x[:, -1] - x[:, -2], wind)[0]
