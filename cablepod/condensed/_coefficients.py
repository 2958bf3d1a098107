"""Coefficients of the condensed model: shapes, mass, geometric stiffness, load projections, quadrature."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cablepod.catenary._statics import solve_statics
from cablepod.condensed._attached import BodyLoads, loading, place_of, shape_along
from cablepod.condensed._reference_state import (
    INSTANTS,
    ReferenceState,
    chordwise_inertia,
    orthogonal_coordinates,
    reference_state,
)
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._chord_frame import ChordFrame, normals_at_start
from cablepod.discretisation._gll import gll_rule, integration_matrix
from cablepod.reduced._validity import check_independent

#: Orders of approximation.  "leading": closure and force to first order in strain and squared slope, with second-order terms of a
#: reference state; "exact": exact chordwise stretch; "inertial": exact, with the chordwise inertia that the deflection enforces.
ORDERS = ("leading", "exact", "inertial")


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficients of the condensed model on links or quadrature points.

    Coordinates q are mass-orthonormal amplitudes of modes of the deflection normal to the chord; to order "leading" the mass has
    the chordwise inertia of the reference state.  The first ``n_in_plane`` belong to the in-plane deflection.  The chordwise
    force is N = H + tau, where tau is a sum of patterns, one for each load.
    """

    chain: LumpedChain  #: links and masses on the particles of the modes
    order: str  #: one of ORDERS
    #: modes of each set as given (mode, particle); sets: in plane, in space also out of plane
    modes: tuple[np.ndarray, ...]
    quadrature: int | None = None  #: number of quadrature points of the chordwise stretch; None for the links
    body_loads: BodyLoads | None = None  #: drag of bodies along the chord; None without

    @cached_property
    def green(self) -> bool:
        """Whether law (21) holds."""
        return self.chain.green

    @cached_property
    def n_in_plane(self) -> int:
        """Number of in-plane coordinates."""
        return len(self.modes[0])

    @cached_property
    def rank(self) -> int:
        """Number of modes of the larger set."""
        return max(self.ranks)

    @cached_property
    def ranks(self) -> tuple[int, ...]:
        """Number of coordinates of each set."""
        return tuple(len(modes) for modes in self.modes)

    @cached_property
    def mass(self) -> np.ndarray:
        """Masses of the particles (n + 1,) [kg]."""
        return self.chain.mass

    @property
    def is_uniform(self) -> bool:
        """Whether the cable is the same along its length, without attachments."""
        return not (self.chain.p.segments or self.chain.p.attachments)

    @cached_property
    def mass_length(self) -> np.ndarray:
        """Masses of the particles over the mean mass per length of the cable (n + 1,) [m]."""
        return self.chain.tributary_length if self.is_uniform else self.mass / self.chain.p.mass

    @cached_property
    def root_total_mass(self) -> float:
        """Root of the mass of the cable [kg^1/2]."""
        return float(np.sqrt(self.mass.sum()))

    @cached_property
    def spectral_basis(self) -> tuple[list[np.ndarray], np.ndarray]:
        """Matrices from modes to coordinates, set by set, and squared slope norms of the coordinates (r,) [1/(kg m)].

        Within each set the coordinates are orthogonal in mass and in slope, both with the terms of second order.
        """
        turns, squares = [], []
        for k, psi in enumerate(self.modes):
            slope, gram = np.diff(psi, axis=1) / self.chain.length, (psi * self.mass) @ psi.T
            check_independent(gram)
            if self.reference_state is not None:
                gram = gram + self._added_mass(slope, k)
                values, vectors = orthogonal_coordinates((slope * self._slope_weights) @ slope.T, gram)
            else:
                from scipy.linalg import eigh  # costly to import

                values, vectors = eigh((slope * self.chain.length) @ slope.T, gram)
            turns.append(np.asfortranarray(vectors))
            squares.append(values)
        return turns, np.concatenate(squares)

    def _added_mass(self, slopes: np.ndarray, k: int) -> np.ndarray:
        """Return the chordwise inertia of the reference state for slopes of the deflection number `k` (r, r)."""
        chain, shear = self.chain, self.rest_shear[k]
        sag = 0.0 if self.reference_state is None else float(self.reference_state.sag)
        return (2.0 * sag * chain.p.mass) * chordwise_inertia(
            slopes * shear, chain.length, chain.arc_length, self.mass_length
        )

    @property
    def _slope_weights(self) -> np.ndarray:
        """Weights of integrals of slope products along the cable (n,) [m]."""
        return self.chain.length if self.reference_state is None else self.chain.length * self.slope_factor

    @cached_property
    def rest_shear(self) -> np.ndarray:
        """Transverse force on the links at rest, over its root mean square (sets, n); zero without transverse load."""
        shear = self._rest_shear
        mean_square = float((shear * shear).sum(axis=0) @ self.chain.length) / self.chain.total_length
        return shear / np.sqrt(mean_square) if mean_square else np.zeros_like(shear)

    @cached_property
    def _rest_shear(self) -> np.ndarray:
        """Transverse force on the links at rest (sets, n) [N]."""
        p = self.chain.p
        ends = p.end_positions(np.zeros(1))
        normals = ChordFrame.of(ends[:, 1] - ends[:, 0], self.reference).normals[0]
        uniform = p.load_at(0.0)
        loads = [uniform if self.is_uniform else p.weight, *([np.zeros(p.dims)] if p.motions else [])]
        if not self.is_uniform and p.load is not None:
            loads.append(uniform - p.weight)
        loads += [load.force * (1.0 if load.factor is None else float(load.factor(0.0))) for load in p.point_loads]
        patterns = self.chordwise_force_patterns[: len(loads)]
        deviations = patterns - (patterns @ self.chain.length / self.chain.total_length)[:, None]
        return (normals @ np.array(loads).T) @ deviations

    @cached_property
    def rest_slopes(self) -> np.ndarray:
        """Slopes of the deflections on the links at rest (sets, n), to first order in the sag."""
        return -self._rest_shear / self.rest_tension

    @cached_property
    def rest_tension(self) -> float:
        """Mean of the tensions of both ends at rest [N]."""
        statics = solve_statics(self.chain.p, "unstretched_length", self.chain.total_length)
        return 0.5 * float(statics[4] + statics[5])

    @cached_property
    def reference_state(self) -> ReferenceState | None:
        """Constants of second order; None without them.

        The distance of the ends is that over the duration of the scene, so that it does not depend on the instants of the output.
        """
        if self.order != "leading":
            return None
        p, length = self.chain.p, self.chain.total_length
        end_time = min([p.duration or 0.0, *(motion.end for motion in p.motions.values())])
        ends = p.end_positions(np.linspace(0.0, end_time, INSTANTS if p.motions else 1))
        strain = np.sqrt(((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1)) / length - 1.0
        squared = (self._rest_shear**2).sum(axis=0) @ self.chain.length / (length * p.stiffness**2)
        fourth = (self._rest_profile**2) @ self.chain.length / length
        state = reference_state(np.array([[strain.min()], [strain.max()]]), np.array([squared]), fourth)
        return ReferenceState(*(values[0] for values in state))

    @cached_property
    def _rest_profile(self) -> np.ndarray:
        """Squared slopes at rest over their mean (n,)."""
        return (self.rest_shear**2).sum(axis=0)

    @cached_property
    def slope_factor(self) -> np.ndarray:
        """Factor of the squared slopes by the terms of second order (n,), ones without them."""
        state = self.reference_state
        return np.ones(self.chain.links) if state is None else state.uniform + state.sag * self._rest_profile

    @cached_property
    def shear_under_uniform_load(self) -> np.ndarray:
        """Transverse force on the links by a uniform load, over its root mean square (n,)."""
        shear = self.chordwise_force_patterns[0] - self.mean_chordwise_forces[0]
        return shear / np.sqrt((shear * shear) @ self.chain.length / self.chain.total_length)

    @cached_property
    def products_under_uniform_load(self) -> list[tuple[np.ndarray, ...]]:
        """Products of the modes as given, with the squared slopes of a cable under uniform load as profile, set by set.

        Products of shapes [m], chordwise inertia [m], slope products without and with the profile (2, r, r) [1/m], the same with
        each chordwise force pattern (2, patterns, r, r).
        """
        chain = self.chain
        result: list[tuple[np.ndarray, ...]] = []
        shear = self.shear_under_uniform_load
        weights = np.stack([chain.length, chain.length * shear**2])
        for psi in self.modes:
            slope = np.diff(psi, axis=1) / chain.length
            inertia = chordwise_inertia(slope * shear, chain.length, chain.arc_length, chain.tributary_length)
            with_patterns = np.einsum("wn,an,in,jn->waij", weights, self.chordwise_force_patterns, slope, slope)
            gram = (psi * chain.tributary_length) @ psi.T
            check_independent(gram)
            result.append((gram, inertia, (slope * weights[:, None]) @ slope.T, with_patterns))
        return result

    @property
    def slope_norms_squared(self) -> np.ndarray:
        """Squared slope norms of the coordinates (r,) [1/(kg m)]."""
        return self.spectral_basis[1]

    @cached_property
    def shapes(self) -> np.ndarray:
        """Orthonormal shapes of the coordinates, see ``spectral_basis`` (r, particle) [kg^-1/2]."""
        return np.concatenate([turn.T @ psi for turn, psi in zip(self.spectral_basis[0], self.modes, strict=True)])

    @cached_property
    def slopes(self) -> np.ndarray:
        """Slopes of the shapes on the links (r, n)."""
        return np.diff(self.shapes, axis=1) / self.chain.length

    @property
    def sets(self) -> tuple[slice, ...]:
        """Slices of the coordinates: in-plane deflection and, in space, out-of-plane deflection."""
        return (slice(0, self.n_in_plane), slice(self.n_in_plane, None))[: self.chain.p.dims - 1]

    @cached_property
    def load_patterns(self) -> np.ndarray:
        """Particle loads of each unit load pattern (patterns, particle) [m], point loads [1]."""
        chain, p = self.chain, self.chain.p
        patterns = [self.mass_length]
        if p.motions:
            patterns.append(self.mass_length * chain.arc_length / chain.total_length)
        if not self.is_uniform and p.load is not None:
            patterns.append(chain.tributary_length)
        patterns += [place_of(chain, load.fraction) for load in p.point_loads]
        patterns += [place_of(chain, fraction) for fraction in (self.body_loads.fractions if self.body_loads else ())]
        patterns += [np.zeros(chain.links + 1) for _ in loading(chain)]
        return np.array(patterns)

    @cached_property
    def chordwise_force_patterns(self) -> np.ndarray:
        """Chordwise force minus H on the links for unit load patterns (patterns, n) [m], point loads [1]."""
        above_first = np.cumsum(self.load_patterns[:, 1:-1], axis=1)
        return np.concatenate([np.zeros((len(above_first), 1)), above_first], axis=1)

    @cached_property
    def mean_chordwise_forces(self) -> np.ndarray:
        """Means of the chordwise force patterns over the length, weighted by the compliance (patterns,)."""
        if self.chain.p.segments:
            return self.chordwise_force_patterns @ (self.chain.p.stiffness / self.chain.k) / self.chain.total_length
        return self.chordwise_force_patterns @ self.chain.length / self.chain.total_length

    @cached_property
    def chordwise_forces_at_candidates(self) -> np.ndarray:
        """Chordwise force patterns on links where N may be least: at ends, point loads, attachments (patterns, candidates)."""
        candidates = {0, self.chain.links - 1}
        fractions = [load.fraction for load in self.chain.p.point_loads]
        for fraction in [*fractions, *(self.chain.attached_fractions if self.chain.p.attachments else ())]:
            j = np.flatnonzero(place_of(self.chain, fraction)[1:-1])
            candidates |= {int(link) for link in np.concatenate([j, j + 1])}
        return np.ascontiguousarray(self.chordwise_force_patterns[:, sorted(candidates)])

    @cached_property
    def geometric_stiffness(self) -> np.ndarray:
        """Geometric stiffness of each unit chordwise force pattern (patterns, r, r) [1/kg], point loads [1/(kg m)]."""
        products = np.einsum(
            "an,n,in,jn->aij", self.chordwise_force_patterns, self._slope_weights, self.slopes, self.slopes
        )
        in_plane = np.arange(len(self.shapes)) < self.n_in_plane
        products *= in_plane[:, None] == in_plane
        if len(self.attached_shapes):
            springs = [attachment.spring for attachment, _ in loading(self.chain)]
            products[-len(springs) :] = np.einsum("a,ai,aj->aij", springs, self.attached_shapes, self.attached_shapes)
        return products

    @cached_property
    def attached_shapes(self) -> np.ndarray:
        """Displacements of the attachments that are loads along their directions, for unit coordinates (loads, r) [kg^-1/2]."""
        rows = [shape_along(self, *pair) for pair in loading(self.chain)]
        return np.array(rows).reshape(len(rows), len(self.shapes))

    @cached_property
    def rule(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Slopes (r, m), chordwise force patterns (patterns, m) and weights (m,) [m] of integrals along the chord.

        The points are the links, or those of a Gauss-Lobatto rule.  That rule contains the ends, where N is least, and is exact
        to degree 2 m - 3, so that few points suffice for few smooth modes.
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

    def _at_points(self, shapes: np.ndarray) -> np.ndarray:
        """Return slopes of smooth shapes (r, particle) at the quadrature points (r, m), by cubic splines."""
        from scipy.interpolate import CubicSpline  # costly to import

        chain, points = self.chain, gll_rule((self.quadrature or 0) - 1)[0]
        return np.ascontiguousarray(
            CubicSpline(chain.arc_length, shapes, axis=1)(0.5 * chain.total_length * (points + 1.0), 1)
        )

    @cached_property
    def geometric_stiffness_norms(self) -> np.ndarray:
        """Spectral norms of the geometric stiffness (patterns,)."""
        return np.linalg.norm(self.geometric_stiffness, 2, axis=(1, 2))

    @cached_property
    def load_projection(self) -> np.ndarray:
        """Projection of unit normal load patterns onto the shapes (normals times patterns, r)."""
        full = self.load_patterns @ self.shapes.T
        parts = []
        for which in self.sets:
            part = np.zeros_like(full)
            part[:, which] = full[:, which]
            parts.append(part)
        if len(self.attached_shapes):
            parts[0][-len(self.attached_shapes) :] = self.attached_shapes  # in and out of plane at once
        return np.concatenate(parts)

    @cached_property
    def inertia(self) -> np.ndarray:
        """Chordwise mass matrix of rates of stretch; empty without chordwise inertia.

        On the links its factors (2, n): masses [kg] and relative arc lengths of the particles above them.  At quadrature points
        the matrix itself (m, m) [kg m^2].  A point moves by the integral of the rates of stretch up to it, minus sigma times the
        whole integral, because the ends are held.
        """
        if self.order != "inertial":
            return np.empty((0, 0))
        chain = self.chain
        if self.quadrature is None:
            return np.stack([self.mass[1:], chain.arc_length[1:] / chain.total_length])
        nodes, weights, _ = gll_rule(self.quadrature - 1)
        half = 0.5 * chain.total_length
        displacement = half * (integration_matrix(self.quadrature - 1) - np.outer(0.5 * (nodes + 1.0), weights))
        return np.ascontiguousarray(chain.p.mass * half * (displacement.T * weights) @ displacement)

    @cached_property
    def reference(self) -> np.ndarray:
        """First normal at the start (dims,), which the normals refer to, so that they hardly turn about the chord."""
        lower, upper = self.chain.p.initial_ends
        return normals_at_start(upper - lower)


def from_momenta(momenta: np.ndarray, shapes: np.ndarray, mass: np.ndarray, sets: tuple[slice, ...]) -> np.ndarray:
    """Return coordinates (..., r) whose deflections have the momenta of the shapes (..., r).

    Shapes (..., r, particle) are orthonormal in mass and chordwise inertia, not in the mass (..., particle) alone.
    """
    result = np.zeros_like(momenta)
    for which in sets:
        of_set = shapes[..., which, :]
        gram = (of_set * mass[..., None, :]) @ np.swapaxes(of_set, -1, -2)
        result[..., which] = np.linalg.solve(gram, momenta[..., which, None])[..., 0]
    return result
