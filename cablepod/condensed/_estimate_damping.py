"""Forces that depend on the rates in the error estimate: damping by the tension and by ratios, drag of the wind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._air import CondensedAir
from cablepod.condensed._estimate_air import EnrichedDrag
from cablepod.condensed._estimate_attached import forces_of_attachments
from cablepod.condensed._kernels_layout import LeadingTerms, RateTerms
from cablepod.discretisation._modal_damping import modal_damping

if TYPE_CHECKING:
    from cablepod.condensed._error_equation import ErrorEquation
    from cablepod.condensed._model import CondensedModel


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
    from cablepod.condensed import _kernels_leading as kernel  # numba is imported only to compute

    size, rows = len(equation.change), model.static_boundary_data[None]
    force, stiffness, at_rest = np.empty((1, size)), np.empty((1, size, size)), (equation.change @ model.rest)[None]
    kernel.leading_forces(equation.terms.enriched, rows, at_rest, force, stiffness, np.empty(1))
    return modal_damping(model.chain.p.damping_ratios or (), stiffness[0], np.ones(size))


def _damped(
    equation: ErrorEquation, model: CondensedModel, q: np.ndarray, rates: np.ndarray, boundary_data: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the forces of the damping by the tension and by ratios, with H to leading order.

    The error is damped as its slowest mode, with the mean of H, by which faster modes are damped too little.
    """
    from cablepod.condensed import _kernels_leading as kernel  # numba is imported only to compute

    p, to_enriched = equation.chain.p, equation.change.T
    matrix = np.empty((0, 0)) if p.damping_ratios is None else enriched_damping(equation, model)
    terms, beta = LeadingTerms(*(array[0] for array in equation.terms.enriched)), p.tension_damping or 0.0
    forces, chord_tension = np.empty((len(q), len(to_enriched.T))), np.empty(len(q))
    rate_terms, work = RateTerms(beta, matrix.reshape(-1)), np.empty(len(to_enriched.T))
    states = boundary_data, q @ to_enriched, rates @ to_enriched
    kernel.rate_forces(terms, rate_terms, *(map(np.ascontiguousarray, states)), work, forces, chord_tension)
    damping = beta * max(float(chord_tension.mean()), 0.0) * float(terms.kappa.min())
    return forces, damping + (max(float(np.linalg.eigvalsh(matrix)[0]), 0.0) if matrix.size else 0.0)
