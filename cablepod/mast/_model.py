"""Modal model of the mast, shared by all kinds of guys, and the fitted leapfrog scheme of its coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from cablepod.mast._piecewise_guys import mass_at_mast
from cablepod.mast._statics import MastRest, load_vectors, seen_by


@dataclass(frozen=True, eq=False)
class ModalMast:
    """Mast in the modes of mast and guys' static stiffness about rest, with the guys' mass at their upper ends by thirds."""

    rest: MastRest

    @cached_property
    def guy_masses(self) -> np.ndarray:
        """Mass of each guy at its upper end, a third of that of a uniform one (guys,) [kg]."""
        return np.array([mass_at_mast(guy.p, guy.length) for guy in self.rest.bare])

    @cached_property
    def mass_with_guys(self) -> np.ndarray:
        """Mass of the mast with these of its guys (count, count)."""
        return self.rest.beam.mass + seen_by(self.rest.rows, self.guy_masses[:, None, None] * np.eye(2))

    @cached_property
    def _modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Angular frequencies (modes,) [rad/s] and unit-mass modes (count, modes).

        Where a guy breaks, those of the space that also has the static displacements by forces at its level: a mast without
        the guy is then as well described as one with it.
        """
        from scipy.linalg import eigh

        rest, p = self.rest, self.rest.p
        count = min(2 * p.modes, rest.beam.count)
        omega, modes = lowest_vibrations(rest.stiffness, self.mass_with_guys, count)
        broken = np.unique(rest.beam.nodes_at([guy.level for guy in p.guys if guy.breaks is not None]))
        if broken.size and count + 2 * broken.size <= rest.beam.count:
            rows = rest.beam.all_rows[broken]
            space = np.hstack([modes, np.linalg.solve(rest.stiffness, rows.reshape(-1, rest.beam.count).T)])
            space /= np.sqrt(np.einsum("ia,ij,ja->a", space, self.mass_with_guys, space))
            squared, turned = eigh(space.T @ rest.stiffness @ space, space.T @ self.mass_with_guys @ space)
            omega, modes, count = np.sqrt(squared), space @ turned, space.shape[1]
        sign = np.sign(modes[np.abs(modes).argmax(axis=0), np.arange(count)])
        return omega, modes * sign

    @property
    def omega(self) -> np.ndarray:
        """Angular frequencies of the modes [rad/s]."""
        return self._modes[0]

    @property
    def modes(self) -> np.ndarray:
        """Modes (count, modes) [kg^-1/2]."""
        return self._modes[1]

    @cached_property
    def stiffness(self) -> np.ndarray:
        """Stiffness of the mast without guys (modes, modes) [1/s2]."""
        return self.modes.T @ self.rest.mast_stiffness @ self.modes

    @cached_property
    def mass(self) -> np.ndarray:
        """Mass of the mast without guys (modes, modes)."""
        return self.modes.T @ self.rest.beam.mass @ self.modes

    @cached_property
    def heights(self) -> np.ndarray:
        """Heights of the guys, each once, and of the top [m]."""
        return self.rest.p.levels

    @cached_property
    def level_of_guy(self) -> np.ndarray:
        """Index into `heights` of each guy."""
        return np.searchsorted(self.heights, self.rest.levels)

    @cached_property
    def _levels(self) -> np.ndarray:
        return self.rest.beam.rows_at(self.heights)

    @cached_property
    def level_rows(self) -> np.ndarray:
        """Displacement of the levels by the modes (levels, 2, modes) [kg^-1/2]."""
        return np.ascontiguousarray(self._levels @ self.modes)

    @cached_property
    def level_rest(self) -> np.ndarray:
        """Displacement of the levels at rest (levels, 2) [m]."""
        return np.ascontiguousarray(self._levels @ self.rest.unknowns)

    @cached_property
    def pull_stiffness(self) -> np.ndarray:
        """Geometric stiffness of a unit pull of the guys at each level, downwards, by the modes (levels, modes, modes).

        It lowers the levels, see :func:`cablepod.mast._kernels_mast._begin_step`.
        """
        of_levels = [self.modes.T @ self.rest.beam.of_pull(height) @ self.modes for height in self.heights.tolist()]
        return np.ascontiguousarray(of_levels)

    @cached_property
    def pull_at_rest(self) -> np.ndarray:
        """The same times the displacement at rest (levels, modes)."""
        displaced = [self.rest.beam.of_pull(height) @ self.rest.unknowns for height in self.heights.tolist()]
        return np.ascontiguousarray(displaced @ self.modes)

    @cached_property
    def node_rows(self) -> np.ndarray:
        """Displacement of the nodes by the modes (nodes, 2, modes) [kg^-1/2]."""
        return np.ascontiguousarray(self.rest.beam.all_rows @ self.modes)

    @cached_property
    def guy_rows(self) -> np.ndarray:
        """Displacement of the guys' upper ends by the modes (guys, 2, modes) [kg^-1/2]."""
        return self.rest.rows @ self.modes

    def upper_ends(self, modal: np.ndarray) -> np.ndarray:
        """Return the upper ends of the guys for coordinates (outputs, modes), at their heights at rest (outputs, guys, 3) [m]."""
        result = np.repeat(self.rest.upper[None], len(modal), axis=0)
        result[..., [0, 2]] += np.einsum("gia,ta->tgi", self.guy_rows, modal, optimize=True)
        return result

    @cached_property
    def load_vectors(self) -> np.ndarray:
        """Loads of the mast on the modes for factors of one (loads, modes)."""
        return load_vectors(self.rest.p, self.rest.beam) @ self.modes

    def ends(self, matrices: np.ndarray) -> np.ndarray:
        """Return matrices of the upper ends in x and z (guys, 2, 2), seen by the modes (modes, modes)."""
        return seen_by(self.guy_rows, matrices)

    def step_matrices(self, mass: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, step: float) -> StepMatrices:
        """Return the matrices of the scheme.

        Parameters
        ----------
        mass, stiffness, damping
            Of mast and guys' upper ends, the coordinates of the guys held (modes, modes); `damping` beside that of the modes.
        step
            [s]
        """
        from scipy.linalg import eigh

        squared, turn = eigh(stiffness, mass)
        omega = np.sqrt(np.maximum(squared, 0.0))
        fitted = sinc_squared(omega * step)
        total = damping + np.diag(2.0 * self.rest.p.damping_ratio * self.omega)
        # with the fitted mass the damping ratios stay those of the modes
        half = 0.5 * step * turn.T @ total @ turn
        one, root = np.eye(fitted.size), np.sqrt(fitted)
        implicit = np.linalg.inv(one + half)
        inverse = turn.T @ mass
        keep = (turn * root) @ implicit @ (one - half) @ (inverse / root[:, None])
        gain = step * (turn * root) @ implicit @ (turn * root).T
        return StepMatrices(np.ascontiguousarray(keep.T), np.ascontiguousarray(gain.T), inverse.T / fitted @ inverse)

    def step_matrices_with(self, mass: np.ndarray, step: float) -> StepMatrices:
        """Return the matrices of the scheme for guys that give the mast masses (guys,) [kg], damped as the guys are."""
        ends = self.ends(mass[:, None, None] * np.eye(2))
        return self.step_matrices(self.mass + ends, np.diag(self.omega**2), self.rest.p.mass_damping * ends, step)


@dataclass(frozen=True, eq=False)
class StepMatrices:
    """v <- v keep + F gain in a step: both matrices are transposed, as the kernels take them."""

    keep: np.ndarray
    gain: np.ndarray
    fitted_mass: np.ndarray  #: with which the leapfrog scheme has the exact frequencies


def lowest_vibrations(stiffness: np.ndarray, mass: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest angular frequencies (count,) [rad/s] and unit-mass shapes (n, count), by rising frequency.

    The eigenvalues are 1 / omega^2: nodes of a beam close to one another have frequencies whose squares, as the largest
    eigenvalues, would leave no digit of the lowest ones.

    Raises
    ------
    numpy.linalg.LinAlgError
        Where the stiffness (n, n) is not positive definite.
    """
    from scipy.linalg import eigh

    n = len(mass)
    inverse, shapes = eigh(mass, stiffness, subset_by_index=[n - count, n - 1])
    omega = 1.0 / np.sqrt(inverse[::-1])
    return omega, shapes[:, ::-1] * omega


def with_guys(
    rows: np.ndarray, mass: np.ndarray, stiffness: np.ndarray, end_mass: np.ndarray, tangents: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mass and stiffness of mast and guys in momentum coordinates of the guys, which have a mass of one.

    Parameters
    ----------
    rows
        Displacement of the guys' upper ends by the coordinates of the mast (guys, 2, n).
    mass, stiffness
        Of the mast without guys (n, n).
    end_mass, tangents
        Mass of the upper ends (guys, 2, 2); stiffness of the coordinates of each guy and its end (guys, r + 2, r + 2).
    """
    n, count, r = len(mass), len(tangents), tangents.shape[1] - 2
    total_mass, total = np.eye(n + r * count), np.zeros((n + r * count,) * 2)
    total_mass[:n, :n] = mass + seen_by(rows, end_mass)
    total[:n, :n] = stiffness + seen_by(rows, tangents[:, r:, r:])
    for g in range(count):
        tangent, where = tangents[g], slice(n + r * g, n + r * (g + 1))
        total[where, where] = tangent[:r, :r]
        total[where, :n] = tangent[:r, r:] @ rows[g]
        total[:n, where] = total[where, :n].T
    return total_mass, total


def sinc_squared(phase: Any) -> Any:
    """Return (sin(phase / 2) / (phase / 2))^2 for a phase of at most half a turn, held beyond.

    The leapfrog scheme with accelerations times this factor has the exact frequency phase / step.
    """
    half = np.minimum(0.5 * np.asarray(phase, dtype=float), 0.45 * np.pi)
    return np.sinc(half / np.pi) ** 2


@lru_cache(16)
def modal_mast(rest: MastRest) -> ModalMast:
    """Return the modal model of a mast at rest, the same for all storms of a mean wind."""
    return ModalMast(rest)
