"""The condensed model in numbers without dimension, with its forcing at the phases of a period."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import xarray as xr

from cablepod.chain._start import rest_shape
from cablepod.condensed._assembly import unit_of
from cablepod.condensed._kernels_layout import LeadingTerms
from cablepod.condensed._model import MODES_WITH_SAG, CondensedModel
from cablepod.condensed._newton import leading_forces
from cablepod.condensed._rescale import rescaled_model
from cablepod.condensed._rest_tangent import RestTangent, vibrations
from cablepod.discretisation._modal_damping import modal_damping
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import choice
from cablepod.periodic._forcing import Forcing, scaled
from cablepod.periodic._kernels_layout import Forced
from cablepod.periodic._sag import missing_sag, sag_over_chord
from cablepod.pod._normal import check_axis

#: Orders of the condensed model that have periodic responses.
ORDERS = ("leading", "exact")
#: Share of the linear stiffness that the stretching by a coordinate of one has.
REFERENCE_STRETCHING = 0.1
#: Maximum mean compressive strain of the model at rest: usual guys on too few modes have 1e-4; those with a sag of a fifth of the
#: chord, where the model finds another equilibrium than that of the cable, 0.01 to 0.25.
MAX_COMPRESSION = 0.01
#: Loads out of the plane over those in it, below which they are rounding.
PLANAR_RTOL = 1e-12


def harmonics_at(phases: int, harmonics: int) -> np.ndarray:
    """Return mean, cosine 1, sine 1, cosine 2, ... at equidistant phases of a period (phases, 1 + 2 harmonics)."""
    angle = 2.0 * np.pi / phases * (np.outer(np.arange(phases), np.arange(1, harmonics + 1)) % phases)
    result = np.ones((phases, 1 + 2 * harmonics))
    result[:, 1::2], result[:, 2::2] = np.cos(angle), np.sin(angle)
    return result


@dataclass(eq=False)
class PeriodicModel:
    """Condensed model under periodic forcing, without dimension.

    Coordinates are those of the condensed model over `length_scale`, in the plane first; frequencies are over `frequency_scale`,
    the lowest one about rest in the plane.  A coordinate of one has a stretching stiffness of `REFERENCE_STRETCHING`.
    """

    condensed: CondensedModel  #: of the scene at unit angular frequency
    unit: CondensedModel  #: of a cable of unit mass and length
    out_of_plane: bool  #: whether a planar scene has coordinates out of the plane
    forcing: Forcing
    #: Model of another amplitude whose scales and shapes out of the plane hold for this one too; None: its own
    base: PeriodicModel | None = field(default=None, repr=False)
    _rows: dict[tuple[int, int], np.ndarray] = field(default_factory=dict, repr=False)
    _terms: dict[int, LeadingTerms] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        forcing: Forcing,
        modes: xr.Dataset,
        *,
        rank: int | None,
        order: str,
        out_of_plane: bool,
    ) -> PeriodicModel:
        """Assemble the model of a scene on modes.

        Raises
        ------
        SceneError
            For a scene, modes or options that it does not support.
        """
        choice(*ORDERS)("order", order)
        unit = unit_of(forcing.parameters, modes, rank=rank, order=order, law="linear")
        check_axis(modes, np.diff(forcing.parameters.initial_ends, axis=0)[0])
        return cls(rescaled_model(unit, forcing.parameters), unit, out_of_plane, forcing)

    def with_amplitude(self, factor: float) -> PeriodicModel:
        """Return the model for amplitudes of the forcing times a factor, with the same scales."""
        p = scaled(self.forcing.parameters, factor)
        base = self if self.base is None else self.base
        forcing = self.forcing._replace(parameters=p)
        return PeriodicModel(rescaled_model(self.unit, p), self.unit, self.out_of_plane, forcing, base)

    # --- coordinates ----------------------------------------------------------------------------------------------------

    @cached_property
    def sets(self) -> list[np.ndarray]:
        """Shapes of the coordinates in the plane and out of it (r, particle) [kg^-1/2]; one set only without the latter."""
        model = self.condensed
        found = [model.shapes[which] for which in model.sets]
        if len(found) == 1 and self.out_of_plane:
            found.append(self._lateral[0])
        return found

    @cached_property
    def lateral_shapes(self) -> np.ndarray:
        """Shapes of vibrations out of the plane about rest (mode, particle) of a planar scene, for any amplitude."""
        if self.base is not None:
            return self.base.lateral_shapes
        chain = self.condensed.chain
        position, tension = rest_shape(chain)
        still = np.zeros_like(chain.arc_length)
        tangent = RestTangent(still, tension / chain.stretch(position), np.zeros(chain.links), 1.0)
        return vibrations(chain, tangent)[1][: self.n_in_plane]

    @cached_property
    def _lateral(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shapes out of the plane of a planar scene (r, particle) [kg^-1/2], squared slope norms (r,), vibrations to them."""
        from scipy.linalg import eigh  # costly to import

        model = self.condensed
        chain = model.chain
        psi = self.lateral_shapes
        slopes = np.diff(psi, axis=1) / chain.length
        values, vectors = eigh((slopes * self._slope_weights) @ slopes.T, (psi * model.mass) @ psi.T)
        return vectors.T @ psi, values, vectors

    @cached_property
    def turns(self) -> list[np.ndarray]:
        """Matrices from modes to coordinates, set by set."""
        found = list(self.condensed.spectral_basis[0])
        return [*found, self._lateral[2]] if len(self.sets) > len(found) else found

    @property
    def _slope_weights(self) -> np.ndarray:
        """Weights of products of slopes along the cable (n,) [m]."""
        model = self.condensed
        return model.chain.length if model.reference_state is None else model.chain.length * model.slope_factor

    @cached_property
    def n_in_plane(self) -> int:
        """Number of coordinates in the plane."""
        return self.condensed.n_in_plane

    @cached_property
    def size(self) -> int:
        """Number of coordinates."""
        return sum(len(shapes) for shapes in self.sets)

    @cached_property
    def kappa_si(self) -> np.ndarray:
        """Squared slope norms of the coordinates (r,) [1/(kg m)]."""
        kappa = self.condensed.slope_norms_squared
        return np.concatenate([kappa, self._lateral[1]]) if self.size > kappa.size else kappa

    @cached_property
    def geometric_stiffness(self) -> np.ndarray:
        """Geometric stiffness of each unit chordwise force pattern (patterns, r, r) [1/kg], point loads [1/(kg m)]."""
        model, r = self.condensed, self.size
        known = model.geometric_stiffness
        result = np.zeros((len(known), r, r))
        result[:, : known.shape[1], : known.shape[1]] = known
        if r > known.shape[1]:
            slopes = np.diff(self.sets[1], axis=1) / model.chain.length
            result[:, self.n_in_plane :, self.n_in_plane :] = np.einsum(
                "an,n,in,jn->aij", model.chordwise_force_patterns, self._slope_weights, slopes, slopes
            )
        return result

    @cached_property
    def load_projection(self) -> np.ndarray:
        """Projection of unit normal loads onto the coordinates (normals times patterns, r)."""
        known = self.condensed.load_projection
        return np.pad(known, ((0, 0), (0, self.size - known.shape[1])))

    # --- scales ---------------------------------------------------------------------------------------------------------

    @cached_property
    def rest(self) -> np.ndarray:
        """Coordinates at rest (r,) [kg^1/2 m]."""
        q = self.condensed.initial_state[0]
        return np.concatenate([q, np.zeros(self.size - q.size)])

    @cached_property
    def scales(self) -> tuple[float, float, float]:
        """Scales of frequency [rad/s], coordinates [kg^1/2 m] and squared slope norms [1/(kg m)]."""
        if self.base is not None:
            return self.base.scales
        chain = self.condensed.chain
        squared = np.linalg.eigvalsh(self.tangent_at_rest[: self.n_in_plane, : self.n_in_plane])
        positive = squared[squared > 1e-9 * np.abs(squared).max()]
        compressed = not self.strain_at_rest >= -MAX_COMPRESSION  # also where the closure has no solution
        if compressed or not positive.size:
            if self.missing_sag:
                raise SceneError(f"modes: given {self.missing_sag}; allowed: {MODES_WITH_SAG}")
            if self.condensed.rest_tension > 0.0:
                sag = f"a sag of {100.0 * sag_over_chord(self.condensed):.2g} % of the chord"
                state = "in compression in the condensed model" if compressed else "without stiffness to leading order"
                raise scene_error("scene", f"{sag}, {state}", "a shallower cable; try: chain.simulate")
            raise scene_error("scene", "a cable without stiffness at rest", "a cable in tension")
        kappa = float(self.kappa_si[: self.n_in_plane].min())
        stretching = 0.5 * chain.p.stiffness / chain.total_length * kappa**2
        return float(np.sqrt(positive[0])), float(np.sqrt(REFERENCE_STRETCHING * positive[0] / stretching)), kappa

    @property
    def strain_at_rest(self) -> float:
        """Mean chordwise force of the condensed model at rest over its axial stiffness; nan where its closure has no solution."""
        model, row = self.condensed, self.condensed.static_boundary_data
        q, mean = model.initial_state[0], model.mean_chordwise_forces
        chord_tension = model.force(q, np.zeros_like(q), row)[2]
        return float(chord_tension + row[1 : 1 + mean.size] @ mean) / model.chain.p.stiffness

    @cached_property
    def missing_sag(self) -> str:
        """What the modes lack of the deflection at rest, in words; empty for those that hold it."""
        return missing_sag(self.condensed)

    @property
    def remedy(self) -> str:
        """End of a message where no response is found: what modes that miss the sag should be; empty for others."""
        return f"; given {self.missing_sag}, try {MODES_WITH_SAG}" if self.missing_sag else ""

    @cached_property
    def tangent_at_rest(self) -> np.ndarray:
        """Stiffness at rest (r, r) [1/s^2], to leading order."""
        return leading_forces(self._terms_si, self.condensed.static_boundary_data[None], self.rest[None])[1][0]

    @cached_property
    def _terms_si(self) -> LeadingTerms:
        """Terms of all coordinates, in SI units, with a leading dimension of one."""
        chain = self.condensed.chain
        return LeadingTerms.of(
            chain.p.stiffness, chain.total_length, self.kappa_si, self.condensed.mean_chordwise_forces,
            self.geometric_stiffness, self.load_projection,
        )  # fmt: skip

    def terms(self, n: int) -> LeadingTerms:
        """Return the terms of the first n coordinates without dimension; H is over `force_scale`."""
        omega, length, _ = self.scales
        si, force = self._terms_si.take(0), self.force_scale
        geometric, load = self.geometric_stiffness, self.load_projection
        return LeadingTerms(
            si.stiffness / force, si.inverse_length, np.array([self.sag]), self.kappa[:n].copy(),
            si.mean_chordwise_forces / force, np.ravel(geometric[:, :n, :n] / omega**2),
            np.ravel(load[:, :n] / (length * omega**2)),
        )  # fmt: skip

    @cached_property
    def kappa(self) -> np.ndarray:
        """Squared slope norms without dimension (r,)."""
        return self.kappa_si / self.scales[2]

    @cached_property
    def sag(self) -> float:
        """Factor of (kappa . q^2) kappa q."""
        omega, length, kappa = self.scales
        chain = self.condensed.chain
        return 0.5 * chain.p.stiffness / chain.total_length * (kappa * length / omega) ** 2

    @property
    def force_scale(self) -> float:
        """Chordwise force of one without dimension [N]."""
        return self.scales[0] ** 2 / self.scales[2]

    @cached_property
    def damping(self) -> float:
        """Mass-proportional damping without dimension."""
        return float(self.condensed.chain.p.damping) / self.scales[0]

    @cached_property
    def tension_damping(self) -> float:
        """Damping by the tension without dimension."""
        return float(self.condensed.chain.p.tension_damping or 0.0) * self.scales[0]

    @cached_property
    def damping_matrix(self) -> np.ndarray:
        """Damping matrix of ratios and attached dampers without dimension (r, r); zero without them.

        Those of the condensed model; out of the plane of a planar scene the ratios count from its first vibration anew, and
        dampers, which lie in the plane, do not act.
        """
        result, count = np.zeros((self.size, self.size)), len(self.condensed.shapes)
        for known in (self.condensed.damping_matrix, self.condensed.damper_matrix):
            result[: len(known), : len(known)] += known / self.scales[0]
        ratios, lateral = self.condensed.chain.p.damping_ratios, slice(count, None)
        if ratios is not None and self.size > count:
            stiffness = self.tangent_at_rest[lateral, lateral]
            result[lateral, lateral] = modal_damping(ratios, stiffness, np.ones(len(stiffness))) / self.scales[0]
        return result

    @property
    def is_damped_beside_mass(self) -> bool:
        """Whether there is damping other than by mass, by the tension, ratios or dampers: forces depend on rates."""
        return bool(self.tension_damping or self.damping_matrix.any())

    @property
    def undamped(self) -> str:
        """What no damping acts on, in words; empty where both deflections are damped."""
        if self.damping or self.tension_damping:
            return ""
        if not self.damping_matrix.any():
            return "damping is zero"
        sets = ("in the plane", slice(0, self.n_in_plane)), ("out of the plane", slice(self.n_in_plane, self.size))
        still = [words for words, part in sets if part.stop > part.start and not self.damping_matrix[part, part].any()]
        return f"nothing damps motion {still[0]}" if still else ""

    @cached_property
    def highest_frequency(self) -> float:
        """Highest frequency about rest, without dimension."""
        return float(np.sqrt(np.abs(np.linalg.eigvalsh(self.tangent_at_rest)).max())) / self.scales[0]

    @property
    def fastest_rate(self) -> float:
        """Rate that the steps of the scheme for multipliers resolve, without dimension."""
        return max(self.highest_frequency, 0.5 * self.damping)

    @cached_property
    def slowest_decays(self) -> tuple[float, float]:
        """Rates at which the slowest disturbance about rest decays, without dimension: of what the forcing moves, and of all."""
        one, zero = np.eye(self.size), np.zeros((self.size, self.size))
        stiffness = self.tangent_at_rest / self.scales[0] ** 2
        damping = self.damping * one + self.tension_damping * stiffness + self.damping_matrix

        def slowest(n: int) -> float:
            system = np.block([[zero[:n, :n], one[:n, :n]], [-stiffness[:n, :n], -damping[:n, :n]]])
            return max(-float(np.linalg.eigvals(system).real.max()), 0.0)

        return slowest(self.n_in_plane if self.is_planar else self.size), slowest(self.size)

    @cached_property
    def _largest_loads(self) -> tuple[float, float]:
        """Largest load over a period on the coordinates in the plane, and on those out of it."""
        load = np.abs(self.rows(64, 1)[..., -len(self.load_projection) :] @ self.load_projection)
        return float(load[..., : self.n_in_plane].max()), float(load[..., self.n_in_plane :].max(initial=0.0))

    @cached_property
    def is_planar(self) -> bool:
        """Whether the forcing stays in the plane, so that motion out of it is a matter of stability."""
        inside, outside = self._largest_loads
        return self.size == self.n_in_plane or (not self._things_couple and outside <= PLANAR_RTOL * inside)

    @cached_property
    def is_axisymmetric(self) -> bool:
        """Whether nothing tells the deflections apart, as in a vertical cable moved along itself: turned orbits are orbits."""
        n = self.n_in_plane
        if self.size != 2 * n or any(self._largest_loads) or self.condensed.damper_matrix.any():
            return False
        each = self.kappa_si, np.abs(self.geometric_stiffness)  # signs of shapes are free
        halves = (each[0][:n], each[0][n:]), (each[1][:, :n, :n], each[1][:, n:, n:])
        return all(np.allclose(a, b, rtol=0.0, atol=1e-9 * np.abs(a).max(initial=0.0)) for a, b in halves)

    @property
    def _things_couple(self) -> bool:
        """Whether dampers or springs couple motion in the plane with that out of it."""
        inside, outside = slice(0, self.n_in_plane), slice(self.n_in_plane, len(self.condensed.shapes))
        found = [
            matrix
            for matrix in (self.condensed.damper_matrix, *self.condensed.geometric_stiffness)
            if matrix.size and np.abs(matrix[inside, outside]).max(initial=0.0) > PLANAR_RTOL * np.abs(matrix).max()
        ]
        return bool(found)

    # --- forcing --------------------------------------------------------------------------------------------------------

    def boundary_data(self, phase: np.ndarray) -> np.ndarray:
        """Return boundary data (3, phases, columns) as terms with the factors 1, omega, omega squared [rad/s]."""
        condensed, p = self.condensed, self.condensed.chain.p
        ends = np.ascontiguousarray(p.end_positions(phase).reshape(-1, 2 * p.dims).T)
        still = np.zeros((2 * p.dims, phase.size if p.motions else 0))
        first = condensed._project_loads(ends, still, phase, 0, 0.0)
        if not p.motions:
            return np.stack([first, np.zeros_like(first), np.zeros_like(first)])
        rates, accelerations = (
            np.ascontiguousarray(p.end_positions(phase, derivative).reshape(-1, 2 * p.dims).T) for derivative in (1, 2)
        )
        second = p.damping * (condensed._project_loads(ends, rates, phase, 0, 0.0) - first)
        if condensed.damper_matrix.size or self.tension_damping:
            second += condensed._project_loads(ends, still, phase, 0, 0.0, rates) - first
        return np.stack([first, second, condensed._project_loads(ends, accelerations, phase, 0, 0.0) - first])

    def rows(self, phases: int, periods: int) -> np.ndarray:
        """Return the boundary data at equidistant phases of `periods` periods of the forcing, see :class:`Forced`."""
        key = (phases, periods)
        if key not in self._rows:
            rows = self.boundary_data(2.0 * np.pi * periods / phases * np.arange(phases))
            rows[1] *= self.scales[0]  # factors are of frequencies without dimension
            rows[2] *= self.scales[0] ** 2
            self._rows[key] = np.ascontiguousarray(rows)
        return self._rows[key]

    def forced(self, n: int, phases: int, periods: int) -> Forced:
        """Return terms of the first n coordinates and the boundary data at equidistant phases."""
        if n not in self._terms:
            self._terms[n] = self.terms(n)
        return Forced(self._terms[n], self._candidates, self.rows(phases, periods), self.damping)

    @cached_property
    def _candidates(self) -> np.ndarray:
        """Chordwise force patterns where their sum may be least, without dimension."""
        return self.condensed.chordwise_forces_at_candidates / self.force_scale

    def forget_rows(self) -> None:
        """Free the boundary data of all phases."""
        self._rows.clear()
