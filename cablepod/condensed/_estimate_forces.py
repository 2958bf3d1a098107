"""Forces on the enriched model of the error estimate beyond those to leading order: damping, dampers and springs, drag."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._air import EXTRA_POINTS, CondensedAir
from cablepod.condensed._air_motion import DragOfMotion
from cablepod.condensed._attached import chordwise_motion, has_load, place_of, shape_along
from cablepod.condensed._coefficients import Coefficients
from cablepod.condensed._kernels_layout import RateTerms
from cablepod.condensed._newton import leading_forces
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.discretisation._modal_damping import modal_damping

if TYPE_CHECKING:
    from cablepod.condensed._error_equation import ErrorEquation
    from cablepod.condensed._model import CondensedModel

#: Number of air tables that are kept for the estimates of further runs.
KEPT_TABLES = 4


@dataclass(frozen=True)
class EnrichedDrag:
    """Drag on the coordinates of the enriched model, for a motion of the model."""

    equation: ErrorEquation
    air: CondensedAir  #: at as many points as the enriched modes need

    @classmethod
    def of(cls, equation: ErrorEquation, air: CondensedAir) -> EnrichedDrag:
        """Return the drag of the air along a model on its enriched one."""
        in_plane = equation.enriched_in_plane
        return cls(equation, _refined(air, max(in_plane, len(equation.change) - in_plane) + EXTRA_POINTS))

    def forces(
        self, times: np.ndarray, q: np.ndarray, rates: np.ndarray, boundary_data: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Return the forces (samples, R) on the enriched coordinates, and the damping of the error per mass [1/s].

        Parameters
        ----------
        times
            Instants [s].
        q, rates
            Coordinates of the motion and their rates (samples, r).
        boundary_data
            A row for each sample, the chord first.
        """
        chain, in_plane = self.air.model.chain, self.equation.enriched_in_plane
        motion = DragOfMotion.of(self.air, times, q, rates, boundary_data[:, 0] / chain.total_length)
        _, slopes, loads = self.air.places.shapes(self.air.model, self.equation.shapes)
        return motion.on(loads, in_plane) + motion.by_tension(slopes, in_plane), motion.damping / self._mass_per_length

    @property
    def _mass_per_length(self) -> float:
        """Mass per length by which the drag damps the error [kg/m]: of a cable that is not uniform, that of the slowest mode."""
        model = self.air.model
        if model.is_uniform:
            return model.chain.p.mass
        masses = [segment.mass for segment in model.chain.p.segments]
        attached = sum(attachment.mass for attachment in model.chain.p.attachments)
        return max([model.chain.p.mass, *masses]) + 2.0 * attached / model.chain.total_length

    def at_rest(self, q: np.ndarray, boundary_data: np.ndarray) -> np.ndarray:
        """Return the forces (R,) in the mean wind on coordinates (r,) at rest."""
        steady = EnrichedDrag(self.equation, self.air.in_mean_wind)
        return steady.forces(np.zeros(1), q[None], np.zeros((1, q.size)), boundary_data[None])[0][0]


@lru_cache(KEPT_TABLES)
def _refined(air: CondensedAir, points: int) -> CondensedAir:
    """Return the same air at another number of points."""
    return replace(air, points=points)


def forces_by_rates(
    equation: ErrorEquation,
    model: CondensedModel,
    air: CondensedAir | None,
    times: np.ndarray,
    q: np.ndarray,
    rates: np.ndarray,
    boundary_data: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Return the forces (samples, R) on the enriched coordinates, and the damping of the error per mass [1/s].

    Parameters
    ----------
    equation
        Error equation of the model.
    model
        Model of the motion.
    air
        Air along the cable; None for still air.
    times
        Instants of the samples [s].
    q, rates
        Coordinates of the motion and their rates (samples, r).
    boundary_data
        A row for each sample.
    """
    forces, damping = np.zeros((len(q), len(equation.change))), 0.0
    p = equation.chain.p
    if p.tension_damping is not None or p.damping_ratios is not None:
        forces, damping = _damped(equation, model, q, rates, boundary_data)
    if equation.model is not None:  # the damping of the error by dampers, which may miss a mode, does not count
        forces += forces_of_attachments(equation.model, model, equation.change, times, q, rates, boundary_data)
    if air is not None:
        drag, of_drag = EnrichedDrag.of(equation, air).forces(times, q, rates, boundary_data)
        forces, damping = forces + drag, damping + of_drag
    return forces, damping


def enriched_damping(equation: ErrorEquation, model: CondensedModel) -> np.ndarray:
    """Return the damping matrix of the ratios on the enriched coordinates (R, R) [1/s].

    The stiffness is that of the enriched model to leading order at rest, where the motion's model rests.
    """
    at_rest, rows = (equation.change @ model.rest)[None], model.static_boundary_data[None]
    stiffness = leading_forces(equation.terms.enriched, rows, at_rest)[1][0]
    return modal_damping(model.chain.p.damping_ratios or (), stiffness, np.ones(len(stiffness)))


def _damped(
    equation: ErrorEquation, model: CondensedModel, q: np.ndarray, rates: np.ndarray, boundary_data: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the forces of the damping by the tension and by ratios, with H to leading order.

    The error is damped as its slowest mode, with the mean of H, by which faster modes are damped too little.
    """
    from cablepod.condensed import _kernels_rates as kernel  # numba is imported only to compute

    p, to_enriched = equation.chain.p, equation.change.T
    matrix = np.empty((0, 0)) if p.damping_ratios is None else enriched_damping(equation, model)
    terms, beta = equation.terms.enriched.take(0), p.tension_damping or 0.0
    forces, chord_tension = np.empty((len(q), len(to_enriched.T))), np.empty(len(q))
    rate_terms, work = RateTerms(beta, matrix.reshape(-1)), np.empty(len(to_enriched.T))
    states = boundary_data, q @ to_enriched, rates @ to_enriched
    kernel.rate_forces(terms, rate_terms, *(map(np.ascontiguousarray, states)), work, forces, chord_tension)
    damping = beta * max(float(chord_tension.mean()), 0.0) * float(terms.kappa.min())
    return forces, damping + (max(float(np.linalg.eigvalsh(matrix)[0]), 0.0) if matrix.size else 0.0)


def forces_of_attachments(
    enriched: Coefficients,
    model: CondensedModel,
    change: np.ndarray,
    times: np.ndarray,
    q: np.ndarray,
    rates: np.ndarray,
    boundary_data: np.ndarray,
) -> np.ndarray:
    """Return the forces of dampers and springs on the enriched coordinates beyond those to leading order (samples, R).

    An attachment moves by u = (d.n) w + (d.e) eta along its direction, where eta is the chordwise motion by -w'^2 / 2; its force
    acts on the coordinates by the derivatives of u.  The model has these at the slopes and for the chord of rest.

    Parameters
    ----------
    enriched, model
        Enriched model, and that of the motion.
    change
        Matrix from the coordinates of the motion to the enriched ones (R, r).
    times
        Instants of the samples [s].
    q, rates, boundary_data
        Coordinates of the motion, their rates (samples, r), and boundary data (samples, columns).
    """
    chain, p = model.chain, model.chain.p
    frame_at_rest = ChordFrame.of(np.diff(p.initial_ends, axis=0), model.reference)
    reach, reach_rate = (np.diff(p.end_positions(times, derivative), axis=1)[:, 0] for derivative in (0, 1))
    frame = ChordFrame.of(reach, model.reference)
    turning = frame.rates(reach, reach_rate)[1:]
    length, patterns, rest = chain.length, len(model.load_patterns), model.rest_of_springs
    column = 1 + 2 * patterns - len(model.attached_shapes)
    forces = np.zeros((len(q), len(change)))
    for attachment, fraction in zip(p.attachments, chain.attached_fractions, strict=True):
        if not (attachment.damper or attachment.spring):
            continue
        place, d = place_of(chain, fraction), np.asarray(attachment.direction)
        by_link = chordwise_motion(chain, np.eye(chain.links), place)
        # d.e, and d.n of each deflection: at rest, of the samples (samples,), and their rates
        of_chord = (frame_at_rest.along @ d)[0], frame.along @ d, turning[0] @ d
        of_normals = ((array @ d).T for array in (frame_at_rest.normals, frame.normals, turning[1]))
        psi, at_rest = shape_along(model, attachment, fraction), shape_along(enriched, attachment, fraction)
        load = np.zeros(len(q))
        if has_load(p, attachment):
            load, column = boundary_data[:, column], column + 1
        moved, rate, derivatives = np.zeros(len(q)), np.zeros(len(q)), np.empty_like(forces)
        for which, own, *of_normal in zip(model.sets, enriched.sets, *of_normals, strict=True):
            shape, slopes = model.shapes[which] @ place, model.slopes[which]
            slope, slope_rate, slope_rest = q[:, which] @ slopes, rates[:, which] @ slopes, rest[which] @ slopes
            of_slopes = length * by_link
            eta, eta_rate = 0.5 * slope**2 @ of_slopes, (slope * slope_rate) @ of_slopes
            w, w_rate = q[:, which] @ shape, rates[:, which] @ shape
            moved += of_normal[1] * w + of_chord[1] * eta
            moved -= of_normal[0] * (rest[which] @ shape) + of_chord[0] * (0.5 * slope_rest**2 @ of_slopes)
            rate += of_normal[1] * w_rate + of_normal[2] * w + of_chord[1] * eta_rate + of_chord[2] * eta
            derivatives[:, own] = np.outer(of_normal[1], enriched.shapes[own] @ place)
            derivatives[:, own] += of_chord[1][:, None] * ((slope * of_slopes) @ enriched.slopes[own].T)
        force = load - attachment.spring * (psi @ rest + moved) - attachment.damper * rate
        in_equation = load - attachment.spring * (q @ change.T @ at_rest)
        forces += force[:, None] * derivatives - in_equation[:, None] * at_rest
    return forces
