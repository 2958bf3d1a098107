"""Run of a mast with condensed guys: start, stability, steps, energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from cablepod.discretisation._modal_damping import modal_damping
from cablepod.errors import scene_error
from cablepod.mast._air import Drive, along_guys, drive_of, steady_along_guys
from cablepod.mast._beam import kept
from cablepod.mast._condensed_guy import GuySet, Shapes, guy_set, sines
from cablepod.mast._condensed_lanes import Lanes, damping_of, terms_of, watched, wind_of
from cablepod.mast._kernels_layout import CondensedScheme, CondensedState, CondensedTerms, CondensedWind
from cablepod.mast._march import constant_forces, march
from cablepod.mast._model import ModalMast, StepMatrices, sinc_squared, with_guys
from cablepod.mast._request import MastRequest, MastTrajectory
from cablepod.wind._drag import STEP_OVER_DRAG_LIMIT, drag_of, drag_step_limit
from cablepod.wind._mast_air import MastAir, mean_mast_air

#: Gauss points of the drag beyond the number of modes.
EXTRA_POINTS = 2
#: Steps in the shortest period of the guys' modes, and the maximum step over the stability limit.
STEPS_PER_PERIOD, MAX_STEP_OVER_LIMIT = 9.0, 0.8
#: Steps over which drag is held, and its least evaluations in the shortest period of the guys' modes: with fewer the damping of
#: these modes is wrong.
STEPS_OF_DRAG, EVALUATIONS_PER_PERIOD = 2, 4.0
#: Points of a guy whose positions are an output.
DRAWN_POINTS = 21


@dataclass(frozen=True, eq=False)
class CondensedGuys:
    """The guys of a mast as condensed models about rest."""

    mast: ModalMast
    shapes: tuple[Shapes, Shapes]
    air: MastAir | None  #: in whose mean they are at rest

    @cached_property
    def guys(self) -> GuySet:
        """The guys with their upper ends at rest, without drag."""
        return guy_set(self.mast.rest.bare, self.mast.rest.upper, self.shapes)

    @property
    def rank(self) -> int:
        """Number of modes of each deflection."""
        return len(self.shapes[0].slopes)

    @cached_property
    def axes(self) -> np.ndarray:
        """Axes of the guys at rest (guys, 3, 3)."""
        return self.guys.frame(self.guys.upper)[1]

    @cached_property
    def rest(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (guys, 2 r) at rest in the mean wind, and the forces on the mast there (guys, 3) [N]."""
        guys, r = self.guys, self.rank
        if not guys.count:
            return np.empty((0, 2 * r)), np.empty((0, 3))
        forces = self._forces_in_still_air if self.air is None else self._forces_in_mean_wind(self.air)
        coordinates = guys.rest(guys.upper, lambda q: forces(q)[0])
        on_q, on_mast = forces(coordinates)
        shared = (guys.moments * on_q).reshape(-1, 2, r).sum(axis=2)
        return coordinates, on_mast - np.einsum("gp,gpd->gd", shared, self.axes[:, 1:])

    def _forces_in_still_air(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the forces on coordinates (guys, 2 r) and on the mast (guys, 3) [N]."""
        return self.guys.forces(q, self.guys.upper)

    def _forces_in_mean_wind(self, air: MastAir) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Return a function of the coordinates (guys, 2 r) that returns the same with drag."""
        from cablepod.mast import _kernels_condensed as kernel  # numba is imported only to compute

        guys, lanes = self.guys, self.lanes
        terms, wind = self.terms, self.wind(air, np.empty((0, 0)))
        state = CondensedState.of(np.zeros(terms.kappa.shape), np.zeros((0, 3, *terms.kappa.shape)))
        wind.air[:] = steady_along_guys(air, self.drag_points, lanes.size).ravel()
        state.stretch[: guys.count] = guys.frame(guys.upper)[0] / guys.length

        def forces(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            state.q[:] = lanes.coordinates(q)
            kernel.drag_at_rest(terms, state, wind)
            on_q, on_mast = self._forces_in_still_air(q)
            return on_q + lanes.back(wind.held_q), on_mast + wind.held[:, : guys.count].T

        return forces

    @cached_property
    def damping(self) -> np.ndarray:
        """Damping matrices of the ratios of the scene, of vibrations about rest in still air (guys, 2 r, 2 r); or no entries."""
        guys, r2 = self.guys, 2 * self.rank
        if self.mast.rest.p.guy_damping_ratios is None or not guys.count:
            return np.empty((0, 0, 0))
        stiffness = guys.tangent(guys.rest(guys.upper), guys.upper)[:, :r2, :r2]
        return np.stack([modal_damping(self.mast.rest.p.guy_damping_ratios, k, np.ones(len(k))) for k in stiffness])

    @cached_property
    def lanes(self) -> Lanes:
        """Places of guys and modes in the arrays of the kernels."""
        return Lanes(self.guys.count, self.rank)

    @cached_property
    def terms(self) -> CondensedTerms:
        """Coefficients of the guys for the kernels."""
        return terms_of(self.lanes, self.guys, self.axes)

    def wind(self, air: MastAir, velocity: np.ndarray) -> CondensedWind:
        """Return the drag of an air for the kernels, for its velocities at the points of the drag (samples, 3 points lanes)."""
        drag = np.array([drag_of(guy.p, air.density) for guy in self.mast.rest.p.guys])
        return wind_of(self.lanes, self.guys, drag, self.drag_points, velocity)

    @property
    def drag_points(self) -> int:
        """Number of Gauss points of the drag on a guy."""
        return self.rank + self.rank % 2 + EXTRA_POINTS  # the kernel takes two together

    @cached_property
    def end_mass(self) -> np.ndarray:
        """Mass of the upper ends without that of the coordinates, in x and z (guys, 2, 2) [kg]."""
        return np.ascontiguousarray(self.reaction_mass[:, [0, 2]])

    @cached_property
    def reaction_mass(self) -> np.ndarray:
        """The same with the vertical force that holds the ends at their height (guys, 3, 2) [kg]."""
        guys, r = self.guys, self.rank
        result = (guys.mass * guys.length / 3.0)[:, None, None] * np.eye(3)
        for part in range(2):
            own = (guys.moments[:, part * r : (part + 1) * r] ** 2).sum(axis=1)
            axis = self.axes[:, 1 + part]
            result = result - own[:, None, None] * axis[:, :, None] * axis[:, None, :]
        return np.ascontiguousarray(result[:, :, [0, 2]])

    @cached_property
    def tangents(self) -> np.ndarray:
        """Tangents of the guys by (p, x, z) at rest (guys, 2 r + 2, 2 r + 2)."""
        r, r2, guys = self.rank, 2 * self.rank, self.guys
        whole = guys.tangent(self.rest[0], guys.upper)
        turn = np.zeros((guys.count, r2 + 3, r2 + 2))  # q = p - m n.u
        turn[:, np.arange(r2), np.arange(r2)] = 1.0
        turn[:, r2, r2] = turn[:, r2 + 2, r2 + 1] = 1.0
        for part in range(2):
            which = slice(part * r, (part + 1) * r)
            turn[:, which, r2:] = -guys.moments[:, which, None] * self.axes[:, None, 1 + part, [0, 2]]
        return np.swapaxes(turn, 1, 2) @ whole @ turn

    # --- time stepping ------------------------------------------------------------------------------------------------

    @kept
    def scheme(self, step: float) -> tuple[StepMatrices, np.ndarray]:
        """Return the matrices of the mast and the fitted factors of the guys."""
        mast, n, r2 = self.mast, len(self.mast.omega), 2 * self.rank
        mass, total = self._about_rest
        damping = mast.rest.p.mass_damping * mast.ends(self.end_mass)
        omega = np.sqrt(np.maximum(np.diag(total)[n:], 0.0)).reshape(self.guys.count, r2)
        return mast.step_matrices(mass[:n, :n], total[:n, :n], damping, step), sinc_squared(omega * step)

    @cached_property
    def _about_rest(self) -> tuple[np.ndarray, np.ndarray]:
        """Mass and stiffness of mast and guys in the modes of the mast and the coordinates of the guys."""
        return with_guys(self.mast.guy_rows, self.mast.mass, self.mast.stiffness, self.end_mass, self.tangents)

    @kept
    def has_phases_below(self, step: float, limit: float) -> bool:
        """Tell whether all squared phases of a step are below a limit (stability: 4): limit M - step^2 K is positive definite."""
        matrices, fitted = self.scheme(step)
        n = len(self.mast.omega)
        scale = step * np.concatenate([np.ones(n), np.sqrt(fitted).ravel()])
        mass, total = self._about_rest
        difference = limit * mass - scale[:, None] * total * scale
        difference[:n, :n] += limit * (matrices.fitted_mass - mass[:n, :n])
        try:
            np.linalg.cholesky(difference)
        except np.linalg.LinAlgError:
            return False
        return True

    @cached_property
    def highest_frequency(self) -> float:
        """Highest angular frequency of the guys' modes, of the mast without guys [rad/s]."""
        tangents = self.tangents[:, : 2 * self.rank, : 2 * self.rank]
        of_mast = self.mast.omega[-1] ** 2 if not len(tangents) else 0.0
        return float(np.sqrt(np.linalg.eigvalsh(tangents).max(initial=of_mast)))

    def run(self, request: MastRequest, air: MastAir | None, hold: int) -> MastTrajectory:
        """Run from rest in the air of a run, with drag held over a number of steps."""
        mast, lanes, step = self.mast, self.lanes, request.step
        matrices, fitted = self.scheme(step)
        half = 0.5 * mast.rest.p.mass_damping * step
        scheme = CondensedScheme(
            (1.0 - half) / (1.0 + half), lanes.coordinates(step * fitted / (1.0 + half)),
            damping_of(lanes, self.damping, step, fitted),
        )  # fmt: skip
        terms = watched(self.terms, (self.guys.kappa * fitted).max(axis=1, initial=0.0))
        # momentum coordinates are the deflections at the displacement of rest
        p = lanes.coordinates(self.rest[0])
        saved = np.zeros((request.outputs_count if request.energy or request.keeps_guys else 0, 3, *p.shape))
        drive = drive_of(mast, air, request)
        result = march(
            mast, request, matrices, drive, lanes.of(self.reaction_mass.reshape(-1, 6)), self.rest[1], hold=hold,
            condensed=(terms, scheme, CondensedState.of(p, saved)),
            guy_wind=None if air is None else self.wind(air, along_guys(air, self.drag_points, lanes.size)),
        )  # fmt: skip
        states = lanes.back(saved)
        if request.keeps_guys:
            result.guy_position = self._positions(result, states[:, 0])
        if request.energy:
            result.energy = self._energy(result, matrices, fitted, drive, states)
        return result

    def _positions(self, result: MastTrajectory, q: np.ndarray) -> np.ndarray:
        """Return positions of points of the guys from anchor to mast, for coordinates q (outputs, guys, 2 r) [m]."""
        sigma, r, guys = np.linspace(0.0, 1.0, DRAWN_POINTS), self.rank, self.guys
        upper = self.mast.upper_ends(result.modal)
        axes = guys.frame(upper)[1]
        positions = guys.lower[:, None] + sigma[:, None] * (upper - guys.lower)[:, :, None]
        for part, shape in enumerate(self.shapes):
            deflection = guys.scale[:, None] * (q[..., part * r : (part + 1) * r] @ shape.basis(sigma, 0))
            positions += deflection[..., None] * axes[:, :, 1 + part, None]
        positions[result.request.broken_at_outputs(self.mast.rest.p)] = np.nan
        return positions

    def _energy(
        self, result: MastTrajectory, matrices: StepMatrices, fitted: np.ndarray, drive: Drive, saved: np.ndarray
    ) -> np.ndarray:
        """Return kinetic and potential energy at the outputs, less that at rest; broken guys have none [J].

        `saved` has coordinates and their rates half a step before and after (outputs, 3, guys, 2 r).
        """
        mast, request = self.mast, result.request
        before, after = result.rates[:, 0], result.rates[:, 1]
        kinetic = 0.5 * np.einsum("ta,ab,tb->t", before, matrices.fitted_mass, after)
        kinetic += 0.5 * np.einsum("tgi,tgi,gi->t", saved[:, 1], saved[:, 2], 1.0 / fitted)
        geometric, geometric_rest = mast.pull_stiffness, mast.pull_at_rest
        # which the energy of the guys has
        pull = -np.bincount(mast.level_of_guy, self.rest[1][:, 1], len(mast.heights))
        stiffness = mast.stiffness - np.tensordot(pull, geometric, 1)
        potential = 0.5 * np.einsum("ta,ab,tb->t", result.modal, stiffness, result.modal)
        potential -= result.modal @ (constant_forces(mast, drive, self.rest[1]) + pull @ geometric_rest)
        potential -= np.einsum(
            "ta,na,nt->t", result.modal, drive.loads.vectors, drive.loads.factors[:, :: request.every]
        )
        upper, bent = mast.upper_ends(result.modal), np.tensordot(result.modal, geometric, (1, 1))
        lowered = result.modal @ geometric_rest.T + 0.5 * np.einsum("tna,ta->tn", bent, result.modal)
        upper[..., 1] += lowered[:, mast.level_of_guy]
        energies = self.guys.energy(saved[:, 0], upper)
        energies[request.broken_at_outputs(mast.rest.p)] = 0.0
        potential += energies.sum(axis=1) - self.guys.energy(self.rest[0], self.guys.upper).sum()
        return kinetic + potential


@lru_cache(16)
def guys_in_mean_wind(mast: ModalMast, rank: int) -> CondensedGuys:
    """Return condensed guys on sines about rest in the mean wind of their scene, the same for all its storms."""
    return CondensedGuys(mast, (sines(rank),) * 2, mean_mast_air(mast.rest.p))


@dataclass(frozen=True, eq=False)
class CondensedRun:
    """Condensed guys in the air of one run."""

    model: CondensedGuys
    air: MastAir | None

    @cached_property
    def default_step(self) -> float:
        """Step by the shortest period of the guys' modes [s], stable with a margin."""
        step = min(
            2.0 * np.pi / (STEPS_PER_PERIOD * self.model.highest_frequency), STEP_OVER_DRAG_LIMIT * self.drag_limit
        )
        while not self.model.has_phases_below(step, 4.0 * MAX_STEP_OVER_LIMIT**2):
            step *= 0.8
        return step

    def steps_of_drag(self, step: float) -> int:
        """Return the number of steps over which the drag is held: two, but one where they are long beside a period."""
        resolved = self.model.highest_frequency * step * STEPS_OF_DRAG <= 2.0 * np.pi / EVALUATIONS_PER_PERIOD
        resolved = resolved and not self.model.damping.size  # which takes the rates of the ends at each step
        resolved = resolved and STEPS_OF_DRAG * step <= self.drag_limit
        return STEPS_OF_DRAG if resolved and self.model.has_phases_below(step, 4.0 * MAX_STEP_OVER_LIMIT**2) else 1

    @cached_property
    def drag_limit(self) -> float:
        """Longest stable time from one evaluation of the drag on the guys to the next [s]."""
        return drag_step_limit(0.0 if self.air is None else self.air.drag_rate(self.model.mast.rest.p))

    def run(self, request: MastRequest) -> MastTrajectory:
        """Run from rest.

        Raises
        ------
        SceneError
            For a step above the stability limit.
        """
        step = request.step
        if not (self.model.has_phases_below(step, 4.0) and step < self.drag_limit):
            raise scene_error(
                "step",
                step,
                f"below the stability limit of mast, guys and drag on them; try: {self.default_step:.4g} s",
            )
        return self.model.run(request, self.air, self.steps_of_drag(step))
