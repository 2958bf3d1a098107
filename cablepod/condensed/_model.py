"""The condensed model: boundary data of each step, initial state, forces and frequencies, on given coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cablepod.catenary._statics import solve_statics
from cablepod.chain._start import start
from cablepod.condensed._coefficients import Coefficients
from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._chord_frame import ChordFrame

#: Newton's method has found an equilibrium where its last step is this share of the deflection it began with.
EQUILIBRIUM_RTOL = 1e-9


@dataclass(frozen=True)
class CondensedModel(Coefficients):
    """A cable that is quasi-static along its chord, restricted to modes of the deflection normal to it."""

    def boundary_data(self, begin: int, steps: int, rate: float) -> np.ndarray:
        """Tell what the steps `begin` ... `begin + steps` must know of ends and loads; see ``kernels.condensed.frames``."""
        p, count = self.chain.p, steps + 1
        ends, second = np.empty((2 * p.dims, count)), np.zeros((2 * p.dims, count if p.motions else 0))
        ends[: p.dims], ends[p.dims :] = p.lower[:, None], p.upper[:, None]
        derivatives = (0, 2, 1) if p.mass_damping else (0, 2)
        for (end, axis), function in p.motions.items():
            at = ENDS.index(end) * p.dims + COORDINATES.index(axis)
            tables = function.all_at_steps(begin, steps, rate, derivatives, ends[at, 0])
            ends[at] = tables[0]
            second[at] = tables[1] + p.mass_damping * tables[2] if p.mass_damping else tables[1]
        return self._filled(ends, second, begin, steps, rate)

    def boundary_data_at(self, times: np.ndarray) -> np.ndarray:
        """Do the same at any instants [s]."""
        p = self.chain.p
        ends, second = p.end_positions(times), np.zeros((0, 2, p.dims))
        if p.motions:
            second = p.end_positions(times, 2)
            if p.mass_damping:  # it acts on the motion of the frame as on that of the deflection
                second += p.mass_damping * p.end_positions(times, 1)
        places, pushed = (np.ascontiguousarray(item.reshape(-1, 2 * p.dims).T) for item in (ends, second))
        return self._filled(places, pushed, times, 0, 0.0)

    def _filled(self, ends: np.ndarray, second: np.ndarray, begin: Any, steps: int, rate: float) -> np.ndarray:
        from cablepod.condensed import _kernels_frame as kernel  # numba is imported only to compute

        p = self.chain.p

        def factor(function: Any) -> np.ndarray:
            return function.at_steps(begin, steps, rate) if rate else function(begin)

        load = p.weight[:, None] if p.load is None else (p.weight + p.load)[:, None]
        if p.load is not None and p.load_factor is not None:
            load = p.weight[:, None] + p.load[:, None] * factor(p.load_factor)
        varying = any(item.factor is not None for item in p.point_loads)
        points = np.empty((len(p.point_loads), p.dims, ends.shape[1] if varying else 1))
        for target, item in zip(points, p.point_loads, strict=True):
            target[:] = item.force[:, None] * (1.0 if item.factor is None else factor(item.factor))
        rows = np.empty((ends.shape[1], 1 + len(self.load_patterns) * p.dims))
        kernel.frames(ends, second, np.ascontiguousarray(load), points, self.reference, p.mass, rows)
        return rows

    def coordinates(self, deflection: np.ndarray) -> np.ndarray:
        """Coordinates (times, r) of deflections (normals, times, particle) [m]: nearest in mass, or what test functions see."""
        sets = [
            (part * self.mass) @ self.test_functions[at].T
            for part, at in zip(deflection, (slice(0, self.n_in_plane), slice(self.n_in_plane, None)), strict=False)
        ]
        return np.concatenate(sets, axis=1)

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates at the start and their rates; a run from equilibrium starts from the model's own."""
        p, q = self.chain.p, self.first_guess
        if q is not None:
            q = self.equilibrium(q)
        if q is None:
            position = start(self.chain)
            q = self.coordinates(
                ChordFrame.of((position[-1] - position[0])[None], self.reference).split(position[None])[1]
            )[0]
            if not p.initial:
                rest = self.equilibrium(q)
                q = q if rest is None else rest
        rates = p.end_positions(np.zeros(1), 1)[0]
        if not rates.any():
            return q, np.zeros_like(q)
        # the particles are at rest, the frame is not
        ends = p.end_positions(np.zeros(1))
        frame = ChordFrame.of(ends[:, 1] - ends[:, 0], self.reference)
        sigma = self.chain.arc_length / self.chain.total_length
        speed = rates[0] + sigma[:, None] * (rates[1] - rates[0])
        return q, self.coordinates(-np.einsum("pc,kc->kp", speed, frame.normals[0])[:, None])[0]

    @cached_property
    def first_guess(self) -> np.ndarray | None:
        """Coordinates of a parabola near the shape at rest, at less cost than the chain at rest; None where none is near."""
        p = self.chain.p
        if p.initial or p.point_loads:
            return None
        row, sigma = self.static_boundary_data, self.chain.arc_length / self.chain.total_length
        across = row[1 + len(self.load_patterns) :: len(self.load_patterns)]  # the uniform load along each normal
        sag = 0.5 * self.chain.total_length**2 / self.rest_tension * sigma * (1.0 - sigma)
        return self.coordinates(across[:, None, None] * sag)[0]

    def equilibrium(self, q: np.ndarray) -> np.ndarray | None:
        """Find the equilibrium near q by Newton's method; None where it fails, or ends at another one."""
        # rest knows no acceleration: its forces are those of the loads alone
        still = self.static_boundary_data
        if self.order == "leading":
            from cablepod.condensed import _kernels_leading as kernel

            chain, q = self.chain, q.copy()
            about = (
                chain.p.stiffness,
                chain.total_length,
                self.spectral_basis[1],
                self.test_stiffness_defect,
                self.mean_chordwise_forces,
                self.geometric_stiffness,
                self.load_projection,
            )
            return q if kernel.leading_rest(q, still[None], *about) else None
        size, first = np.abs(q).max(), q
        for _ in range(60):
            force, tangent, *_ = self._forces(q, np.zeros_like(q), still)
            try:
                change = np.linalg.solve(tangent, force)
            except np.linalg.LinAlgError:
                return None
            q = q + change
            if not np.isfinite(q).all() or np.abs(q).max() > 10.0 * size:
                return None
            if np.abs(change).max() <= 1e-14 * size:
                break
        # what still moves by more than rounding has found none; further off than the deflection is the cable turned over
        found = np.abs(change).max() <= EQUILIBRIUM_RTOL * size and np.abs(q - first).max() <= size
        return q if found else None

    @cached_property
    def initial_boundary_data(self) -> np.ndarray:
        """What the start must know of ends and loads."""
        return self.boundary_data_at(np.zeros(1))[0]

    @cached_property
    def static_boundary_data(self) -> np.ndarray:
        """The same with the ends at rest."""
        p = self.chain.p
        if not p.motions:
            return self.initial_boundary_data
        still = self._filled(
            np.ascontiguousarray(p.end_positions(np.zeros(1)).reshape(1, -1).T),
            np.zeros((2 * p.dims, 1)), np.zeros(1), 0, 0.0,
        )  # fmt: skip
        return still[0]

    def force(self, q: np.ndarray, v: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Accelerations of the coordinates without damping, tangent of the forces, H [N]."""
        f, tangent, mass, h = self._forces(q, v, row)
        return (np.linalg.solve(mass, f) if self.inertia.size else f), tangent, h

    def _forces(
        self, q: np.ndarray, v: np.ndarray, row: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Return forces on the coordinates, their tangent, masses, H [N]."""
        from cablepod.condensed import _kernels_exact as kernel_exact
        from cablepod.condensed import _kernels_leading as kernel_leading

        chain, r = self.chain, q.size
        f, tangent, mass, k = np.empty(r), np.empty((r, r)), np.eye(r), chain.p.stiffness
        if self.order == "leading":
            about = (
                k,
                chain.total_length,
                self.spectral_basis[1],
                self.test_stiffness_defect,
                self.mean_chordwise_forces,
                self.geometric_stiffness,
                self.load_projection,
            )
            h = kernel_leading.leading_force(q, row[None], 0, *about, f, tangent)
            return f, tangent, mass, h
        slopes, taus, weights = self.rule
        n = weights.size
        work = np.empty((6, n)), np.empty((2, n)), np.empty((2, n)), np.empty((2 * r, n))
        h = kernel_exact.exact_force(
            q, v, row[None], 0, slopes, self.test_slopes_at_points, self.n_in_plane, taus, weights, k, self.green, self.load_projection, self.inertia,
            self.guess(row, q), np.full(n, self.first_stretch(row)), *work, f, tangent, mass,
        )  # fmt: skip
        return f, tangent, mass, h

    def guess(self, row: np.ndarray, q: np.ndarray) -> float:
        """H to leading order, to begin a search with [N]."""
        chain, k = self.chain, self.chain.p.stiffness
        grown = 0.5 * k / chain.total_length * float(self.spectral_basis[1] @ q**2)
        h = (
            k * (row[0] / chain.total_length - 1.0)
            - row[1 : 1 + self.mean_chordwise_forces.size] @ self.mean_chordwise_forces
            + grown
        )
        # far from small slopes it may be off: at least what carries the loads with a sag of an eighth of the chord
        sideways = np.abs(row[1 + self.mean_chordwise_forces.size :]).sum() * chain.total_length / 8.0
        return max(h, sideways, 1e-6 * k)

    def first_stretch(self, row: np.ndarray) -> float:
        """Chordwise stretch to begin a search with."""
        return max(1.0, float(row[0]) / self.chain.total_length)

    def omega_max_squared(self, q: np.ndarray, row: np.ndarray, h: float) -> float:
        """Bound of the square of the frequencies [1/s^2]."""
        squares = self.spectral_basis[1]
        stray = float(np.abs(row[1 : 1 + self.geometric_stiffness_norms.size]) @ self.geometric_stiffness_norms)
        sag = self.chain.p.stiffness / self.chain.total_length * float(((squares * q) ** 2).sum())
        return self.frequency_amplification * (abs(h) * float(squares.max()) + sag) + stray

    def omega_taut_squared(self, until: float) -> float:
        """Return the same at the largest distance of the ends until some time, without sag [1/s^2]."""
        ends = self.chain.p.end_positions(np.linspace(0.0, until, 1001))
        reach = np.sqrt(np.sum((ends[:, 1] - ends[:, 0]) ** 2, axis=1)).max()
        h = self.chain.p.stiffness * max(float(reach) / self.chain.total_length - 1.0, 0.0)
        return self.frequency_amplification * h * float(self.spectral_basis[1].max())

    @cached_property
    def rest_tension(self) -> float:
        """Mean of the tensions at the ends at rest [N]."""
        columns = solve_statics(self.chain.p, "unstretched_length", self.chain.total_length)
        return 0.5 * float(columns[4] + columns[5])

    @cached_property
    def unstable_growth_rate(self) -> float:
        """Rate at which small vibrations about rest grow [1/s]; with the modes as test functions none does."""
        if self.tests is None:
            return 0.0
        q, v = self.initial()
        _, tangent, mass, _ = self._forces(q, np.zeros_like(v), self.static_boundary_data)
        squares = np.linalg.eigvals(np.linalg.solve(mass, tangent) if self.inertia.size else tangent)
        return float(np.abs(np.sqrt(squares.astype(complex)).imag).max()) - 0.5 * (self.chain.p.mass_damping or 0.0)
