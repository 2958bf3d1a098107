"""A cable that is quasi-static along its chord, restricted to modes of the deflection normal to it: coefficients and states."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cablepod.catenary._statics import solve_statics
from cablepod.chain._start import start
from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._chain import Chain
from cablepod.discretisation._chord_frame import Frame
from cablepod.discretisation._gll import gll_rule, integration_matrix
from cablepod.errors import SceneError

#: "leading": closure and force to the first order in slope squared and strain; "exact": the chordwise stretch as it is;
#: "inertial": exact, with the inertia of the motion along the chord that the deflection brings with it.
ORDERS = ("leading", "exact", "inertial")
#: Newton's method has found an equilibrium where its last step is this share of the deflection it began with.
SETTLED = 1e-9
#: Modes whose products in mass have a condition above this are sums of one another but for rounding.
DEPENDENT = 1e12
#: Test functions whose products in mass with the modes have a condition above this do not tell the modes apart.
BLIND = 1e6


@dataclass(frozen=True)
class Model:
    """Coefficients of the condensed model.

    Coordinates q are mass-orthonormal; ``plane`` of them are deflections in the plane.  Chordwise force N = H + tau, where tau
    is the sum of a pattern for each load; deflections normal to the chord are sums of modes.
    """

    chain: Chain  #: links and masses on the particles of the modes
    order: str  #: one of ORDERS
    modes: tuple[np.ndarray, ...]  #: of each set as given, (mode, particle)
    quadrature: int | None = None  #: points at which the chordwise stretch is evaluated; None for the links
    #: Test functions of each set (mode, particle); None for the modes themselves (Galerkin)
    tests: tuple[np.ndarray, ...] | None = None

    @cached_property
    def green(self) -> bool:
        """Whether law (21) holds."""
        return self.chain.green

    @cached_property
    def plane(self) -> int:
        """Number of coordinates in the plane."""
        return len(self.modes[0])

    @cached_property
    def rank(self) -> int:
        """Number of modes of the larger set."""
        return max(self.ranks)

    @cached_property
    def ranks(self) -> tuple[int, ...]:
        """Number of coordinates of each set."""
        return tuple(len(item) for item in self.modes)

    @cached_property
    def mass(self) -> np.ndarray:
        """Masses of the particles (n + 1,) [kg]."""
        return self.chain.p.mass * self.chain.share

    @cached_property
    def turned(self) -> tuple[list[np.ndarray], np.ndarray]:
        """Coordinates in terms of modes, set by set, and the squares of their slopes (r,) [1/(kg m)].

        In each set they are orthogonal in mass and slope.
        """
        from scipy.linalg import eigh  # costly to import

        turns, squares = [], []
        for psi in self.modes:
            slope, gram = np.diff(psi, axis=1) / self.chain.length, (psi * self.mass) @ psi.T
            if gram.size and not np.linalg.cond(gram) < DEPENDENT:
                raise SceneError(
                    "modes: given some that are sums of others; allowed: independent ones, as pod.decompose gives"
                )
            values, vectors = eigh((slope * self.chain.length) @ slope.T, gram)
            turns.append(vectors)
            squares.append(values)
        return turns, np.concatenate(squares)

    @cached_property
    def shapes(self) -> np.ndarray:
        """Mass-orthonormal shapes of the coordinates (r, particle) [kg^-1/2]."""
        return np.concatenate([turn.T @ psi for turn, psi in zip(self.turned[0], self.modes, strict=True)])

    @cached_property
    def slopes(self) -> np.ndarray:
        """Their slopes on the links (r, n)."""
        return np.diff(self.shapes, axis=1) / self.chain.length

    @cached_property
    def duals(self) -> np.ndarray:
        """Test functions whose products in mass with the shapes are those of a unit matrix (r, particle) [kg^-1/2]."""
        if self.tests is None:
            return self.shapes
        parts = []
        for psi, at in zip(self.tests, (slice(0, self.plane), slice(self.plane, None)), strict=False):
            gram = (psi * self.mass) @ self.shapes[at].T
            if gram.size and not np.linalg.cond(gram / np.abs(gram).max(axis=1, keepdims=True)) < BLIND:
                raise SceneError(
                    "modes: given test functions that do not tell the modes apart; allowed: those of oblique.train"
                )
            parts.append(np.linalg.solve(gram, psi))
        return np.concatenate(parts)

    @cached_property
    def grips(self) -> np.ndarray | None:
        """What the duals feel of a tension of one beside what the shapes would (r, r) [1/(kg m)]; None where they are these."""
        if self.tests is None:
            return None
        felt = self._same * ((self.dual_slopes * self.chain.length) @ self.slopes.T)
        return felt - np.diag(self.turned[1])

    @cached_property
    def dual_slopes(self) -> np.ndarray:
        """Slopes of the duals on the links (r, n)."""
        return self.slopes if self.tests is None else np.diff(self.duals, axis=1) / self.chain.length

    @cached_property
    def gain(self) -> float:
        """By how much, at most, test functions may raise the squares of the frequencies."""
        if self.grips is None:
            return 1.0
        squares = self.turned[1]
        return max(1.0, float(np.linalg.norm(np.eye(squares.size) + self.grips / squares, 2)))

    @property
    def _same(self) -> np.ndarray:
        """Which coordinates belong to the same set (r, r)."""
        within = np.arange(len(self.shapes)) < self.plane
        return within[:, None] == within

    @cached_property
    def patterns(self) -> np.ndarray:
        """Loads on the particles for patterns of size one (patterns, particle): lengths [m] but for point loads."""
        chain, p = self.chain, self.chain.p
        rows = [chain.share]
        if p.motions:
            rows.append(chain.share * chain.arc_length / chain.total_length)
        rows += [_lever(chain, load.fraction) for load in p.point_loads]
        return np.array(rows)

    @cached_property
    def taus(self) -> np.ndarray:
        """Chordwise force on the links for patterns of size one, but for H (patterns, n)."""
        inner = np.cumsum(self.patterns[:, 1:-1], axis=1)
        return np.concatenate([np.zeros((len(inner), 1)), inner], axis=1)

    @cached_property
    def means(self) -> np.ndarray:
        """Their means over the length (patterns,)."""
        return self.taus @ self.chain.length / self.chain.total_length

    @cached_property
    def knots(self) -> np.ndarray:
        """The same on the links where the sum may be least: at the ends and beside point loads (patterns, knots)."""
        places = {0, self.chain.links - 1}
        for load in self.chain.p.point_loads:
            j = np.flatnonzero(_lever(self.chain, load.fraction)[1:-1])
            places |= {int(item) for item in np.concatenate([j, j + 1])}
        return np.ascontiguousarray(self.taus[:, sorted(places)])

    @cached_property
    def bends(self) -> np.ndarray:
        """What patterns of chordwise force do to the coordinates (patterns, r, r)."""
        return np.einsum("an,n,in,jn->aij", self.taus, self.chain.length, self.dual_slopes, self.slopes) * self._same

    @cached_property
    def rule(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Slopes (r, m), chordwise forces of the patterns (patterns, m) and weights (m,) [m] for sums along the chord.

        On the links, or at the points of a Gauss-Lobatto rule, which has the ends, where the chordwise force is least, and with
        m points is exact to degree 2 m - 3: products of few smooth modes need few.
        """
        chain = self.chain
        if self.quadrature is None:
            return self.slopes, self.taus, chain.length
        from scipy.interpolate import CubicSpline  # costly to import

        nodes, weights, _ = gll_rule(self.quadrature - 1)
        place = 0.5 * chain.total_length * (nodes + 1.0)
        middles = 0.5 * (chain.arc_length[1:] + chain.arc_length[:-1])
        taus = CubicSpline(middles, self.taus, axis=1)(place)
        return self._at_points(self.shapes), np.ascontiguousarray(taus), 0.5 * chain.total_length * weights

    @cached_property
    def felt(self) -> np.ndarray | None:
        """Slopes of the duals (r, m) for the same sums; None where they are the shapes."""
        if self.tests is None:
            return None
        return self.dual_slopes if self.quadrature is None else self._at_points(self.duals)

    def _at_points(self, shapes: np.ndarray) -> np.ndarray:
        """Slopes of smooth shapes (r, particle) at the points of the rule (r, m)."""
        from scipy.interpolate import CubicSpline  # costly to import

        chain, points = self.chain, gll_rule((self.quadrature or 0) - 1)[0]
        return np.ascontiguousarray(
            CubicSpline(chain.arc_length, shapes, axis=1)(0.5 * chain.total_length * (points + 1.0), 1)
        )

    @cached_property
    def norms(self) -> np.ndarray:
        """Norms of `bends` (patterns,)."""
        return np.linalg.norm(self.bends, 2, axis=(1, 2))

    @cached_property
    def pushes(self) -> np.ndarray:
        """Normal patterns on the coordinates (normals times patterns, r)."""
        full = self.patterns @ self.duals.T
        parts = []
        for k in range(self.chain.p.dims - 1):
            part = np.zeros_like(full)
            at = slice(0, self.plane) if k == 0 else slice(self.plane, None)
            part[:, at] = full[:, at]
            parts.append(part)
        return np.concatenate(parts)

    @cached_property
    def inertia(self) -> np.ndarray:
        """What the kernel must know of inertia along the chord; empty without it.

        On the links, masses [kg] and relative arc lengths of the particles above them (2, n).  At points of quadrature the mass
        that goes with rates of stretch there (m, m) [kg m^2]: a point moves by their integral up to it, less its share of the
        whole, as the ends do not give.
        """
        if self.order != "inertial":
            return np.empty((0, 0))
        chain = self.chain
        if self.quadrature is None:
            return np.stack([self.mass[1:], chain.arc_length[1:] / chain.total_length])
        nodes, weights, _ = gll_rule(self.quadrature - 1)
        half = 0.5 * chain.total_length
        moved = half * (integration_matrix(self.quadrature - 1) - np.outer(0.5 * (nodes + 1.0), weights))
        return np.ascontiguousarray(chain.p.mass * half * (moved.T * weights) @ moved)

    @cached_property
    def reference(self) -> int:
        """Axis that tells the normals apart in space."""
        if self.chain.p.dims == 2:
            return 1
        ends = self.chain.p.end_positions(np.zeros(1))
        return Frame.of(ends[:, 1] - ends[:, 0]).reference

    def rows(self, begin: int, steps: int, rate: float) -> np.ndarray:
        """Tell what the steps `begin` ... `begin + steps` must know of ends and loads; see ``kernels.condensed.frames``."""
        p, count = self.chain.p, steps + 1
        ends, second = np.empty((2 * p.dims, count)), np.zeros((2 * p.dims, count if p.motions else 0))
        ends[: p.dims], ends[p.dims :] = p.lower[:, None], p.upper[:, None]
        derivatives = (0, 2, 1) if p.mass_damping else (0, 2)
        for (end, axis), function in p.motions.items():
            at = ENDS.index(end) * p.dims + COORDINATES.index(axis)
            tables = function.all_on_steps(begin, steps, rate, derivatives, ends[at, 0])
            ends[at] = tables[0]
            second[at] = tables[1] + p.mass_damping * tables[2] if p.mass_damping else tables[1]
        return self._filled(ends, second, begin, steps, rate)

    def rows_at(self, times: np.ndarray) -> np.ndarray:
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
            return function.on_steps(begin, steps, rate) if rate else function(begin)

        load = p.weight[:, None] if p.load is None else (p.weight + p.load)[:, None]
        if p.load is not None and p.load_factor is not None:
            load = p.weight[:, None] + p.load[:, None] * factor(p.load_factor)
        varying = any(item.factor is not None for item in p.point_loads)
        points = np.empty((len(p.point_loads), p.dims, ends.shape[1] if varying else 1))
        for target, item in zip(points, p.point_loads, strict=True):
            target[:] = item.force[:, None] * (1.0 if item.factor is None else factor(item.factor))
        rows = np.empty((ends.shape[1], 1 + len(self.patterns) * p.dims))
        kernel.frames(ends, second, np.ascontiguousarray(load), points, self.reference, p.mass, rows)
        return rows

    def coordinates(self, deflection: np.ndarray) -> np.ndarray:
        """Coordinates (times, r) of deflections (normals, times, particle) [m]: nearest in mass, or what test functions see."""
        sets = [
            (part * self.mass) @ self.duals[at].T
            for part, at in zip(deflection, (slice(0, self.plane), slice(self.plane, None)), strict=False)
        ]
        return np.concatenate(sets, axis=1)

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates at the start and their rates; a run from equilibrium starts from the model's own."""
        p, q = self.chain.p, self.first_guess
        if q is not None:
            q = self.equilibrium(q)
        if q is None:
            position = start(self.chain)
            q = self.coordinates(Frame.of((position[-1] - position[0])[None], self.reference).split(position[None])[1])[
                0
            ]
            if not p.initial:
                rest = self.equilibrium(q)
                q = q if rest is None else rest
        rates = p.end_positions(np.zeros(1), 1)[0]
        if not rates.any():
            return q, np.zeros_like(q)
        # the particles are at rest, the frame is not
        ends = p.end_positions(np.zeros(1))
        frame = Frame.of(ends[:, 1] - ends[:, 0], self.reference)
        sigma = self.chain.arc_length / self.chain.total_length
        speed = rates[0] + sigma[:, None] * (rates[1] - rates[0])
        return q, self.coordinates(-np.einsum("pc,kc->kp", speed, frame.normals[0])[:, None])[0]

    @cached_property
    def first_guess(self) -> np.ndarray | None:
        """Coordinates of a parabola near the shape at rest, at less cost than the chain at rest; None where none is near."""
        p = self.chain.p
        if p.initial or p.point_loads:
            return None
        row, sigma = self.still_row, self.chain.arc_length / self.chain.total_length
        across = row[1 + len(self.patterns) :: len(self.patterns)]  # the uniform load along each normal
        sag = 0.5 * self.chain.total_length**2 / self.rest_tension * sigma * (1.0 - sigma)
        return self.coordinates(across[:, None, None] * sag)[0]

    def equilibrium(self, q: np.ndarray) -> np.ndarray | None:
        """Find the equilibrium near q by Newton's method; None where it fails, or ends at another one."""
        # rest knows no acceleration: its forces are those of the loads alone
        still = self.still_row
        if self.order == "leading":
            from cablepod.condensed import _kernels_leading as kernel

            chain, q = self.chain, q.copy()
            about = (
                chain.p.stiffness,
                chain.total_length,
                self.turned[1],
                self.grips,
                self.means,
                self.bends,
                self.pushes,
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
        found = np.abs(change).max() <= SETTLED * size and np.abs(q - first).max() <= size
        return q if found else None

    @cached_property
    def first_row(self) -> np.ndarray:
        """What the start must know of ends and loads."""
        return self.rows_at(np.zeros(1))[0]

    @cached_property
    def still_row(self) -> np.ndarray:
        """The same with the ends at rest."""
        p = self.chain.p
        if not p.motions:
            return self.first_row
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
            about = k, chain.total_length, self.turned[1], self.grips, self.means, self.bends, self.pushes
            h = kernel_leading.leading_force(q, row[None], 0, *about, f, tangent)
            return f, tangent, mass, h
        slopes, taus, weights = self.rule
        n = weights.size
        work = np.empty((6, n)), np.empty((2, n)), np.empty((2, n)), np.empty((2 * r, n))
        h = kernel_exact.exact_force(
            q, v, row[None], 0, slopes, self.felt, self.plane, taus, weights, k, self.green, self.pushes, self.inertia,
            self.guess(row, q), np.full(n, self.first_stretch(row)), *work, f, tangent, mass,
        )  # fmt: skip
        return f, tangent, mass, h

    def guess(self, row: np.ndarray, q: np.ndarray) -> float:
        """H to leading order, to begin a search with [N]."""
        chain, k = self.chain, self.chain.p.stiffness
        grown = 0.5 * k / chain.total_length * float(self.turned[1] @ q**2)
        h = k * (row[0] / chain.total_length - 1.0) - row[1 : 1 + self.means.size] @ self.means + grown
        # far from small slopes it may be off: at least what carries the loads with a sag of an eighth of the chord
        sideways = np.abs(row[1 + self.means.size :]).sum() * chain.total_length / 8.0
        return max(h, sideways, 1e-6 * k)

    def first_stretch(self, row: np.ndarray) -> float:
        """Chordwise stretch to begin a search with."""
        return max(1.0, float(row[0]) / self.chain.total_length)

    def highest_square(self, q: np.ndarray, row: np.ndarray, h: float) -> float:
        """Bound of the square of the frequencies [1/s^2]."""
        squares = self.turned[1]
        stray = float(np.abs(row[1 : 1 + self.norms.size]) @ self.norms)
        sag = self.chain.p.stiffness / self.chain.total_length * float(((squares * q) ** 2).sum())
        return self.gain * (abs(h) * float(squares.max()) + sag) + stray

    def taut_square(self, until: float) -> float:
        """Return the same at the largest distance of the ends until some time, without sag [1/s^2]."""
        ends = self.chain.p.end_positions(np.linspace(0.0, until, 1001))
        reach = np.sqrt(np.sum((ends[:, 1] - ends[:, 0]) ** 2, axis=1)).max()
        h = self.chain.p.stiffness * max(float(reach) / self.chain.total_length - 1.0, 0.0)
        return self.gain * h * float(self.turned[1].max())

    @cached_property
    def rest_tension(self) -> float:
        """Mean of the tensions at the ends at rest [N]."""
        columns = solve_statics(self.chain.p, "unstretched_length", self.chain.total_length)
        return 0.5 * float(columns[4] + columns[5])

    @cached_property
    def growth(self) -> float:
        """Rate at which small vibrations about rest grow [1/s]; with the modes as test functions none does."""
        if self.tests is None:
            return 0.0
        q, v = self.initial()
        _, tangent, mass, _ = self._forces(q, np.zeros_like(v), self.still_row)
        squares = np.linalg.eigvals(np.linalg.solve(mass, tangent) if self.inertia.size else tangent)
        return float(np.abs(np.sqrt(squares.astype(complex)).imag).max()) - 0.5 * (self.chain.p.mass_damping or 0.0)


def _lever(chain: Chain, fraction: float) -> np.ndarray:
    """Shares of the particles (n + 1,) in a point load, as in the chain."""
    j, right = chain.lever(fraction)
    shares = np.zeros(chain.links + 1)
    shares[j], shares[j + 1] = 1.0 - right, right
    return shares
