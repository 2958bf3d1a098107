"""Run of a mast with condensed guys: arrays of the kernel, stability, start."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cablepod.errors import scene_error
from cablepod.mast._air import MastAir, to_gauss
from cablepod.mast._condensed_guy import CondensedGuy, Shapes, condensed_guy
from cablepod.mast._drive import drive_of
from cablepod.mast._guys import static_guys
from cablepod.mast._model import ModalMast, StepMatrices, sinc_squared
from cablepod.mast._request import MastRequest, MastTrajectory, empty_trajectory
from cablepod.wind._air import drag_of, refined

#: Gauss points of the drag beyond the number of modes.
EXTRA_POINTS = 2
#: Steps in the shortest period of the guys' modes, and the maximum step over the stability limit.
STEPS_PER_PERIOD, MAX_STEP_OVER_LIMIT = 7.0, 0.8
#: Passes of the equilibrium with drag, which depends on the shape.
PASSES = 6


@dataclass(frozen=True, eq=False)
class CondensedGuys:
    """The guys of a mast as condensed models about rest."""

    mast: ModalMast
    shapes: tuple[Shapes, Shapes]
    air: MastAir | None

    @cached_property
    def guys(self) -> list[CondensedGuy]:
        """The guys with their upper ends at rest, without drag."""
        bare = static_guys(self.mast.rest.p)
        return [
            condensed_guy(guy.at(at_rest.p.upper), self.shapes)
            for guy, at_rest in zip(bare, self.mast.rest.guys, strict=True)
        ]

    @property
    def rank(self) -> int:
        """Number of modes of each deflection."""
        return len(self.shapes[0].slopes)

    @cached_property
    def axes(self) -> np.ndarray:
        """Axes of the guys at rest (guys, 3, 3)."""
        return np.array([guy.frame(guy.guy.p.upper)[1] for guy in self.guys]).reshape(-1, 3, 3)

    @cached_property
    def numbers(self) -> np.ndarray:
        """Numbers of the guys, see :mod:`cablepod.mast._kernels_condensed`; the last one of the exact scheme."""
        rows = [
            (guy.guy.p.stiffness, guy.guy.length, guy.weight, 1.0 - 2.0 * guy.strain, guy.strain * guy.rest_force,
             guy.guy.p.mass * guy.guy.length / 3.0, guy.kappa.max())
            for guy in self.guys
        ]  # fmt: skip
        return np.array(rows).reshape(-1, 7)

    @cached_property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """Slope norms, moments, loads (guys, 2 r), tilt (guys, 2, r, r)."""
        r = self.rank
        tilt = np.zeros((len(self.guys), 2, r, r))
        for target, guy in zip(tilt, self.guys, strict=True):
            whole = guy.tilt
            target[0], target[1] = whole[:r, :r], whole[r:, r:]
        rows = [
            np.array([getattr(guy, name) for guy in self.guys]).reshape(-1, 2 * r)
            for name in ("kappa", "moments", "loads")
        ]
        return *rows, tilt

    @cached_property
    def drag(self) -> tuple[Any, ...]:
        """Weights of the drag (guys, points) [kg/m], places, shapes and slopes (guys, 2, points, r); None in still air."""
        if self.air is None:
            return None, None, None, None
        places, weights, _ = to_gauss(self.rank + EXTRA_POINTS)
        assert self.mast.rest.p.wind is not None
        density = float(self.mast.rest.p.wind["air_density"])
        drag = np.array([drag_of(guy.guy.p, density) * guy.guy.length * weights for guy in self.guys])
        shapes, slopes = (
            np.array([
                [part.basis(places, order).T * guy.scale / (guy.guy.length if order else 1.0) for part in self.shapes]
                for guy in self.guys
            ])
            for order in (0, 1)
        )  # fmt: skip
        return drag, places, np.ascontiguousarray(shapes), np.ascontiguousarray(slopes)

    def wind(self, velocity: np.ndarray) -> np.ndarray:
        """Return velocities of the air (samples, points, 3) along the axes of the guys at the Gauss points."""
        assert self.air is not None
        matrix, own = to_gauss(self.rank + EXTRA_POINTS)[2], self.air.of_guys(velocity)
        result = np.empty((len(own), len(self.guys), 3, len(matrix)))
        for g, axes in enumerate(self.axes):
            both = np.einsum("kc,np->pckn", axes, matrix).reshape(own[0, g].size, -1)
            result[:, g] = (own[:, g].reshape(len(own), -1) @ both).reshape(len(own), 3, -1)
        return result

    @cached_property
    def rest(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (guys, 2 r) at rest in the mean wind, and the forces on the mast there (guys, 3) [N]."""
        from cablepod.mast import _kernels_condensed as kernel  # numba is imported only to compute

        kappa, moments, loads, tilt = self.arrays
        drag, places, shapes, slopes = self.drag
        wind = None if self.air is None else self.wind(np.repeat(self.air.start[None], 2, axis=0))
        coordinates, forces = np.empty_like(kappa), np.empty((len(self.guys), 3))
        for g, guy in enumerate(self.guys):
            upper, r2 = guy.guy.p.upper, 2 * self.rank
            on_q, on_end = np.empty(r2), np.empty(3)
            q = guy.rest(upper)
            for _ in range(PASSES if wind is not None else 1):
                own = (drag[g], places, shapes[g], slopes[g]) if wind is not None else (None,) * 4
                kernel.guy_state(
                    self.numbers[g], kappa[g], loads[g], tilt[g], guy.guy.p.lower, upper[1], upper[0], upper[2], q, wind, 0.0, g,
                    *own, on_q, on_end,
                )  # fmt: skip
                if wind is None:
                    break
                q = guy.rest(upper, on_q - guy.forces(q, upper)[0])
            coordinates[g] = q
            shared = [(moments[g] * on_q)[part * self.rank : (part + 1) * self.rank].sum() for part in range(2)]
            forces[g] = on_end - shared[0] * self.axes[g, 1] - shared[1] * self.axes[g, 2]
        return coordinates, forces

    @cached_property
    def end_mass(self) -> np.ndarray:
        """Mass of the upper ends without that of the coordinates, in x and z (guys, 2, 2) [kg]."""
        moments, result = self.arrays[1], np.empty((len(self.guys), 2, 2))
        for g, guy in enumerate(self.guys):
            whole = guy.guy.p.mass * guy.guy.length / 3.0 * np.eye(3)
            for part in range(2):
                own = (moments[g, part * self.rank : (part + 1) * self.rank] ** 2).sum()
                whole -= own * np.outer(self.axes[g, 1 + part], self.axes[g, 1 + part])
            result[g] = whole[np.ix_((0, 2), (0, 2))]
        return result

    @cached_property
    def tangents(self) -> np.ndarray:
        """Tangents of the guys by (p, x, z) at rest (guys, 2 r + 2, 2 r + 2)."""
        r2, moments = 2 * self.rank, self.arrays[1]
        result = np.empty((len(self.guys), r2 + 2, r2 + 2))
        for g, guy in enumerate(self.guys):
            whole = guy.tangent(self.rest[0][g], guy.guy.p.upper)
            turn = np.zeros((r2 + 3, r2 + 2))  # q = p - m n.u
            turn[:r2, :r2] = np.eye(r2)
            turn[r2, r2] = turn[r2 + 2, r2 + 1] = 1.0
            for part in range(2):
                which = slice(part * self.rank, (part + 1) * self.rank)
                turn[which, r2:] = -np.outer(moments[g, which], self.axes[g, 1 + part][[0, 2]])
            result[g] = turn.T @ whole @ turn
        return result

    def system(self, rows: np.ndarray, mass: np.ndarray, stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mass and stiffness of mast and guys about rest.

        Parameters
        ----------
        rows
            Displacement of the guys' upper ends by the coordinates of the mast (guys, 2, n).
        mass, stiffness
            Of the mast without guys (n, n).
        """
        n, r2, count = len(mass), 2 * self.rank, len(self.guys)
        total_mass, total = np.eye(n + r2 * count), np.zeros((n + r2 * count,) * 2)
        total_mass[:n, :n] = mass + np.einsum("gia,gij,gjb->ab", rows, self.end_mass, rows)
        total[:n, :n] = stiffness
        for g in range(count):
            tangent, where = self.tangents[g], slice(n + r2 * g, n + r2 * (g + 1))
            total[:n, :n] += rows[g].T @ tangent[r2:, r2:] @ rows[g]
            total[where, where] = tangent[:r2, :r2]
            total[where, :n] = tangent[:r2, r2:] @ rows[g]
            total[:n, where] = total[where, :n].T
        return total_mass, total

    # --- time stepping ------------------------------------------------------------------------------------------------

    def scheme(self, step: float) -> tuple[StepMatrices, np.ndarray, float]:
        """Return the matrices of the mast, the fitted factors of the guys, and the largest squared phase of a step."""
        from scipy.linalg import eigh

        mast, n, r2 = self.mast, len(self.mast.omega), 2 * self.rank
        mass, total = self.system(mast.guy_rows, mast.mass, mast.stiffness)
        damping = mast.rest.p.mass_damping * mast.ends(self.end_mass)
        matrices = mast.step_matrices(mass[:n, :n], total[:n, :n], damping, step)
        omega = np.sqrt(np.maximum(np.diag(total)[n:], 0.0)).reshape(len(self.guys), r2)
        fitted = sinc_squared(omega * step)
        scale = np.concatenate([np.ones(n), np.sqrt(fitted).ravel()])
        mass[:n, :n] = matrices.fitted_mass
        phase = eigh(
            scale[:, None] * total * scale * step * step, mass, eigvals_only=True, subset_by_index=[len(total) - 1] * 2
        )
        return matrices, fitted, float(phase[0])

    @cached_property
    def default_step(self) -> float:
        """Step by the shortest period of the guys' modes [s], stable with a margin."""
        tangents = self.tangents[:, : 2 * self.rank, : 2 * self.rank]
        omega = np.sqrt(
            np.linalg.eigvalsh(tangents).max(initial=self.mast.omega[-1] ** 2 if not len(tangents) else 0.0)
        )
        step = 2.0 * np.pi / (STEPS_PER_PERIOD * float(omega))
        while self.scheme(step)[2] > 4.0 * MAX_STEP_OVER_LIMIT**2:
            step *= 0.8
        return step

    def run(self, request: MastRequest) -> MastTrajectory:
        """Run from rest.

        Raises
        ------
        SceneError
            For a step above the stability limit.
        RunStopped
            If the motion leaves the finite numbers or stiffens beyond the stability limit.
        """
        from cablepod.mast import _kernels_condensed as kernel

        mast, step, count = self.mast, request.step, len(self.guys)
        matrices, fitted, phase = self.scheme(step)
        if not phase < 4.0:
            raise scene_error(
                "step", step, f"below the stability limit of mast and guys; try: {self.default_step:.4g} s"
            )
        coordinates, forces = self.rest
        kappa, moments, loads, tilt = self.arrays
        alpha = mast.rest.p.mass_damping
        guy_keep = np.full(count, (1.0 - 0.5 * alpha * step) / (1.0 + 0.5 * alpha * step))
        guy_gain = step * fitted / (1.0 + 0.5 * alpha * step)
        numbers = self.numbers.copy()
        numbers[:, kernel.LARGEST_KAPPA] = (kappa * fitted).max(axis=1, initial=0.0)
        drag, places, shapes, slopes = self.drag
        drive = drive_of(mast, self.air, request)
        constant = drive.constant - np.einsum("gi,gia->a", forces[:, [0, 2]], mast.guy_rows)
        wind = None if self.air is None else refined(self.wind(self.air.velocity))
        result = empty_trajectory(request, len(mast.omega), len(mast.heights), count)
        monitor = np.tile([np.inf, 0.0], (count, 1))
        p = coordinates.copy()  # momentum coordinates are the deflections at the displacement of rest
        saved = np.zeros((request.outputs_count if request.energy else 0, 3, count, 2 * self.rank))
        status, at, guy = kernel.condensed_run(
            step, request.every, request.steps, np.array(request.window_steps), np.zeros(len(mast.omega)),
            np.zeros(len(mast.omega)),
            p, np.zeros_like(p), constant, mast.stiffness, matrices.keep, matrices.gain, mast.level_rows, mast.level_rest,
            mast.heights, mast.level_of_guy, np.array([guy.guy.p.lower for guy in self.guys]).reshape(-1, 3), self.axes, numbers,
            kappa, moments, loads, tilt, guy_keep, guy_gain, self.end_mass,
            drive.load_vectors, drive.factors, drive.samples_per_step, drive.mast_wind, drive.node_rows, drive.node_drag, wind,
            drag, places, shapes, slopes, result.modal, result.rates, saved, result.force, result.tension, result.level_extremes,
            result.level_sums, result.tension_extremes, result.tension_sums, monitor,
        )  # fmt: skip
        result.finish(status, at, guy, monitor)
        if request.energy:
            result.energy = self._energy(result, matrices, fitted, constant, drive.factors, request, saved)
        return result

    def _energy(
        self, result: MastTrajectory, matrices: StepMatrices, fitted: np.ndarray, constant: np.ndarray, factors: Any,
        request: MastRequest, saved: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Return kinetic and potential energy at the outputs, less that at rest [J]."""
        mast = self.mast
        before, after = result.rates[:, 0], result.rates[:, 1]
        kinetic = 0.5 * np.einsum("ta,ab,tb->t", before, matrices.fitted_mass, after)
        kinetic += 0.5 * np.einsum("tgi,tgi,gi->t", saved[:, 1], saved[:, 2], 1.0 / fitted)
        potential = 0.5 * np.einsum("ta,ab,tb->t", result.modal, mast.stiffness, result.modal) - result.modal @ constant
        if factors is not None:
            potential -= np.einsum("ta,na,nt->t", result.modal, mast.load_vectors, factors[:, :: request.every])
        ends = np.einsum("gia,ta->tgi", mast.guy_rows, result.modal)
        for g, guy in enumerate(self.guys):
            for t in range(len(result.modal)):
                upper = guy.guy.p.upper.copy()
                upper[[0, 2]] += ends[t, g]
                potential[t] += guy.energy(saved[t, 0, g], upper)
            potential -= guy.energy(self.rest[0][g], guy.guy.p.upper)
        return kinetic + potential
