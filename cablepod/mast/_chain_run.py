"""Run of a mast with chains as guys."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cablepod.chain._air import ChainAir
from cablepod.chain._attached import AttachedForces
from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import LumpedChain, chain_of
from cablepod.errors import scene_error
from cablepod.mast._drive import drive_of
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastRequest, MastTrajectory, empty_trajectory
from cablepod.parameters._mast import MastParameters
from cablepod.scene._mast_field import GUY_POINTS
from cablepod.wind._air import CableAir, drag_of, refined
from cablepod.wind._drag_rate import drag_step_limit
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
    """The guys of a mast as chains, of equal links but for guys with segments or attachments."""

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
    def has_things(self) -> bool:
        """Whether a guy has segments or attachments."""
        return any(guy.pieces is not None for guy in self.mast.rest.bare)

    @cached_property
    def drag(self) -> np.ndarray:
        """Half the density of the air times drag coefficient and diameter of the guys [kg/m2]."""
        assert self.air is not None
        return np.array([drag_of(chain.p, self.air.density) for chain in self.chains])

    @cached_property
    def link_lengths(self) -> np.ndarray:
        """Unstretched length of a link of each guy (guys,) [m]."""
        return np.array([chain.total_length / self.links for chain in self.chains])

    @property
    def default_step(self) -> float:
        """Step by the stability limit of the links [s]."""
        return STEP_OVER_LIMIT * self.step_limit

    @cached_property
    def step_limit(self) -> float:
        """Stability limit of links, mast, and drag on the guys [s]."""
        limits = [chain.step_limit() for chain in self.chains]
        return min([*limits, 2.0 / float(self.mast.omega[-1]), drag_step_limit(self.drag_rate)])

    @cached_property
    def drag_rate(self) -> float:
        """Bound of the rate at which drag takes away a motion of the guys [1/s]."""
        if self.air is None:
            return 0.0
        rates = [self.air.drag_rate(self.mast.rest.p)]
        if self.has_things:
            for g, (chain, air) in enumerate(zip(self.chains, self._airs, strict=True)):
                own = self.air.of_guys(self.air.velocity)[:, g]
                areas = air.drags * chain.tributary_length + (0.0 if air.bodies is None else air.bodies)
                speed = float(np.sqrt((own * own).sum(axis=-1)).max())
                rates.append(2.0 * speed * float((areas / chain.mass)[1:-1].max()))
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

    def _unequal(self) -> Any:
        """Return links and particles of guys with segments or attachments for the kernel; None without any."""
        from cablepod.mast import _kernels_chain as kernel

        if not self.has_things:
            return None
        count = len(self.chains)
        links, particles = np.empty((count, 2, self.links)), np.zeros((count, 4, self.links + 1))
        attached = [AttachedForces.of(chain, x.T) for chain, x in zip(self.chains, self.rest, strict=True)]
        for g, chain in enumerate(self.chains):
            links[g, kernel.LINK_STIFFNESS], links[g, kernel.LINK_LENGTH] = chain.axial_stiffness, chain.length
            particles[g, kernel.PER_MASS] = 1.0 / chain.mass
            particles[g, kernel.PLACE] = chain.arc_length / chain.total_length * (GUY_POINTS - 1.0)
            if self.air is not None:
                bodies = self._airs[g].bodies
                particles[g, kernel.DRAG], particles[g, kernel.BODY] = (
                    self._airs[g].drags, 0.0 if bodies is None else bodies
                )  # fmt: skip
        counts = [0 if own is None else own.particles.size for own in attached]
        acting = [own for own in attached if own is not None]
        numbers = [own.numbers for own in acting]
        return kernel.UnequalLinks(
            links, particles, np.concatenate([[0], np.cumsum(counts)]),
            np.concatenate([own.particles for own in acting]) if acting else np.zeros(0, dtype=np.int64),
            np.concatenate(numbers) if numbers else np.zeros((0, 0)),
        )  # fmt: skip

    def run(self, request: MastRequest) -> MastTrajectory:
        """Run from rest.

        Raises
        ------
        SceneError
            For a step above the stability limit.
        """
        from cablepod.mast import _kernels_chain as kernel  # numba is imported only to compute

        mast, step, count = self.mast, request.step, len(self.chains)
        limit = self.step_limit
        if not step < limit:
            raise scene_error("step", step, f"below the stability limit of links, mast and drag, {limit:.6g} s")
        hold = max(1, min(MAX_HOLD, int(min(MAX_HOLD_TIME, drag_step_limit(self.drag_rate)) / step)))
        p = mast.rest.p
        x = self.rest.copy()
        mass = np.array([chain.p.mass for chain in self.chains]) * self.link_lengths
        end_mass = 0.5 * mass
        if self.has_things:
            end_mass = np.array([chain.mass[-1] for chain in self.chains])
        drive, matrices = drive_of(mast, self.air, request), mast.step_matrices_with(end_mass, step)
        wind = drag = None
        forces = np.zeros((count, 2))
        if self.air is not None:
            wind, drag = refined(np.ascontiguousarray(self.air.of_guys(self.air.velocity))), self.drag
        for g, chain in enumerate(self.chains):
            upper = -chain.tensions_and_forces(x[g].T)[1][-1]
            forces[g] = upper[[0, 2]] + (0.0 if self.air is None else self._top_drag(g, x[g])[[0, 2]])
        constant = drive.constant - np.einsum("gi,gia->a", forces, mast.guy_rows)
        breaks = [np.inf if guy.breaks is None else guy.breaks / step for guy in p.guys]
        result = empty_trajectory(request, mast, drive.node_drag)
        monitor = np.tile([np.inf, 0.0], (count, 1))
        status, at, guy = kernel.chain_run(
            step, request.every, request.steps, hold, np.array(request.window_steps), np.zeros(len(mast.omega)),
            np.zeros(len(mast.omega)), x, np.zeros_like(x), constant, mast.stiffness, mast.pulls(),
            matrices.keep, matrices.gain, mast.level_rows, mast.level_rest, mast.level_of_guy,
            np.array([chain.p.stiffness for chain in self.chains]), self.link_lengths,
            mass, end_mass, self._unequal(), VISCOSITY * limit, p.gravity, p.mass_damping, np.array(breaks),
            drive.load_vectors, drive.factors,
            drive.samples_per_step, drive.table, drive.mast_wind, drive.node_columns, drive.node_rows, drive.node_drag,
            drive.refined_samples_per_step, wind, drag, result.modal, result.rates, result.force,
            result.tension, result.drag, result.level_extremes, result.level_sums, result.tension_extremes, result.tension_sums,
            monitor,
        )  # fmt: skip
        result.finish(status, at, guy, monitor)
        return result

    def _top_drag(self, g: int, x: np.ndarray) -> np.ndarray:
        """Return the drag on the upper particle at rest (3,) [N]."""
        assert self.air is not None
        reach = x[:, -1] - x[:, -2]
        wind = self.air.of_guys(self.air.start)[g, -1]
        normal = wind - (wind @ reach) / (reach @ reach) * reach
        return 0.5 * self._airs[g].drags[-1] * np.linalg.norm(reach) * np.linalg.norm(normal) * normal
