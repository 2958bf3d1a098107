"""Coefficients of the condensed model: shapes, mass, geometric stiffness, load projections, quadrature."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.discretisation._gll import gll_rule, integration_matrix
from cablepod.errors import SceneError

#: "leading": closure and force to the first order in slope squared and strain; "exact": the chordwise stretch as it is;
#: "inertial": exact, with the inertia of the motion along the chord that the deflection brings with it.
ORDERS = ("leading", "exact", "inertial")
#: Modes whose products in mass have a condition above this are sums of one another but for rounding.
MAX_MODE_CONDITION = 1e12
#: Test functions whose products in mass with the modes have a condition above this do not tell the modes apart.
MAX_TEST_CONDITION = 1e6


@dataclass(frozen=True)
class Coefficients:
    """Coefficients of the condensed model.

    Coordinates q are mass-orthonormal; ``plane`` of them are deflections in the plane.  Chordwise force N = H + tau, where tau
    is the sum of a pattern for each load; deflections normal to the chord are sums of modes.
    """

    chain: LumpedChain  #: links and masses on the particles of the modes
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
    def n_in_plane(self) -> int:
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
        return self.chain.p.mass * self.chain.tributary_length

    @cached_property
    def spectral_basis(self) -> tuple[list[np.ndarray], np.ndarray]:
        """Coordinates in terms of modes, set by set, and the squares of their slopes (r,) [1/(kg m)].

        In each set they are orthogonal in mass and slope.
        """
        from scipy.linalg import eigh  # costly to import

        turns, squares = [], []
        for psi in self.modes:
            slope, gram = np.diff(psi, axis=1) / self.chain.length, (psi * self.mass) @ psi.T
            if gram.size and not np.linalg.cond(gram) < MAX_MODE_CONDITION:
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
        return np.concatenate([turn.T @ psi for turn, psi in zip(self.spectral_basis[0], self.modes, strict=True)])

    @cached_property
    def slopes(self) -> np.ndarray:
        """Their slopes on the links (r, n)."""
        return np.diff(self.shapes, axis=1) / self.chain.length

    @cached_property
    def test_functions(self) -> np.ndarray:
        """Test functions whose products in mass with the shapes are those of a unit matrix (r, particle) [kg^-1/2]."""
        if self.tests is None:
            return self.shapes
        parts = []
        for psi, at in zip(self.tests, (slice(0, self.n_in_plane), slice(self.n_in_plane, None)), strict=False):
            gram = (psi * self.mass) @ self.shapes[at].T
            if gram.size and not np.linalg.cond(gram / np.abs(gram).max(axis=1, keepdims=True)) < MAX_TEST_CONDITION:
                raise SceneError(
                    "modes: given test functions that do not tell the modes apart; allowed: those of oblique.train"
                )
            parts.append(np.linalg.solve(gram, psi))
        return np.concatenate(parts)

    @cached_property
    def test_stiffness_defect(self) -> np.ndarray | None:
        """What the duals feel of a tension of one beside what the shapes would (r, r) [1/(kg m)]; None where they are these."""
        if self.tests is None:
            return None
        felt = self._same * ((self.dual_slopes * self.chain.length) @ self.slopes.T)
        return felt - np.diag(self.spectral_basis[1])

    @cached_property
    def dual_slopes(self) -> np.ndarray:
        """Slopes of the duals on the links (r, n)."""
        return self.slopes if self.tests is None else np.diff(self.test_functions, axis=1) / self.chain.length

    @cached_property
    def frequency_amplification(self) -> float:
        """By how much, at most, test functions may raise the squares of the frequencies."""
        if self.test_stiffness_defect is None:
            return 1.0
        squares = self.spectral_basis[1]
        return max(1.0, float(np.linalg.norm(np.eye(squares.size) + self.test_stiffness_defect / squares, 2)))

    @property
    def _same(self) -> np.ndarray:
        """Which coordinates belong to the same set (r, r)."""
        within = np.arange(len(self.shapes)) < self.n_in_plane
        return within[:, None] == within

    @cached_property
    def load_patterns(self) -> np.ndarray:
        """Loads on the particles for patterns of size one (patterns, particle): lengths [m] but for point loads."""
        chain, p = self.chain, self.chain.p
        rows = [chain.tributary_length]
        if p.motions:
            rows.append(chain.tributary_length * chain.arc_length / chain.total_length)
        rows += [_particle_shares(chain, load.fraction) for load in p.point_loads]
        return np.array(rows)

    @cached_property
    def chordwise_force_patterns(self) -> np.ndarray:
        """Chordwise force on the links for patterns of size one, but for H (patterns, n)."""
        inner = np.cumsum(self.load_patterns[:, 1:-1], axis=1)
        return np.concatenate([np.zeros((len(inner), 1)), inner], axis=1)

    @cached_property
    def mean_chordwise_forces(self) -> np.ndarray:
        """Their means over the length (patterns,)."""
        return self.chordwise_force_patterns @ self.chain.length / self.chain.total_length

    @cached_property
    def chordwise_forces_at_candidates(self) -> np.ndarray:
        """The same on the links where the sum may be least: at the ends and beside point loads (patterns, knots)."""
        places = {0, self.chain.links - 1}
        for load in self.chain.p.point_loads:
            j = np.flatnonzero(_particle_shares(self.chain, load.fraction)[1:-1])
            places |= {int(item) for item in np.concatenate([j, j + 1])}
        return np.ascontiguousarray(self.chordwise_force_patterns[:, sorted(places)])

    @cached_property
    def geometric_stiffness(self) -> np.ndarray:
        """What patterns of chordwise force do to the coordinates (patterns, r, r)."""
        return (
            np.einsum(
                "an,n,in,jn->aij", self.chordwise_force_patterns, self.chain.length, self.dual_slopes, self.slopes
            )
            * self._same
        )

    @cached_property
    def rule(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Slopes (r, m), chordwise forces of the patterns (patterns, m) and weights (m,) [m] for sums along the chord.

        On the links, or at the points of a Gauss-Lobatto rule, which has the ends, where the chordwise force is least, and with
        m points is exact to degree 2 m - 3: products of few smooth modes need few.
        """
        chain = self.chain
        if self.quadrature is None:
            return self.slopes, self.chordwise_force_patterns, chain.length
        from scipy.interpolate import CubicSpline  # costly to import

        nodes, weights, _ = gll_rule(self.quadrature - 1)
        place = 0.5 * chain.total_length * (nodes + 1.0)
        middles = 0.5 * (chain.arc_length[1:] + chain.arc_length[:-1])
        taus = CubicSpline(middles, self.chordwise_force_patterns, axis=1)(place)
        return self._at_points(self.shapes), np.ascontiguousarray(taus), 0.5 * chain.total_length * weights

    @cached_property
    def test_slopes_at_points(self) -> np.ndarray | None:
        """Slopes of the duals (r, m) for the same sums; None where they are the shapes."""
        if self.tests is None:
            return None
        return self.dual_slopes if self.quadrature is None else self._at_points(self.test_functions)

    def _at_points(self, shapes: np.ndarray) -> np.ndarray:
        """Slopes of smooth shapes (r, particle) at the points of the rule (r, m)."""
        from scipy.interpolate import CubicSpline  # costly to import

        chain, points = self.chain, gll_rule((self.quadrature or 0) - 1)[0]
        return np.ascontiguousarray(
            CubicSpline(chain.arc_length, shapes, axis=1)(0.5 * chain.total_length * (points + 1.0), 1)
        )

    @cached_property
    def geometric_stiffness_norms(self) -> np.ndarray:
        """Norms of `bends` (patterns,)."""
        return np.linalg.norm(self.geometric_stiffness, 2, axis=(1, 2))

    @cached_property
    def load_projection(self) -> np.ndarray:
        """Normal patterns on the coordinates (normals times patterns, r)."""
        full = self.load_patterns @ self.test_functions.T
        parts = []
        for k in range(self.chain.p.dims - 1):
            part = np.zeros_like(full)
            at = slice(0, self.n_in_plane) if k == 0 else slice(self.n_in_plane, None)
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
        return ChordFrame.of(ends[:, 1] - ends[:, 0]).reference


def _particle_shares(chain: LumpedChain, fraction: float) -> np.ndarray:
    """Shares of the particles (n + 1,) in a point load, as in the chain."""
    j, right = chain.lever(fraction)
    shares = np.zeros(chain.links + 1)
    shares[j], shares[j + 1] = 1.0 - right, right
    return shares
