"""Forces that depend on the rates in the error estimate: damping by the tension and by ratios, drag of the wind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._air import CondensedAir
from cablepod.condensed._estimate_air import EnrichedDrag
from cablepod.condensed._estimate_attached import forces_of_attachments
from cablepod.condensed._kernels_layout import LeadingTerms
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
    if equation.chain.p.tension_damping is not None:
        forces, damping = _damping_by_tension(equation, q, rates, boundary_data)
    if equation.chain.p.damping_ratios is not None:
        matrix = enriched_damping(equation, model)
        forces -= rates @ (matrix @ equation.change).T
        damping += max(float(np.linalg.eigvalsh(matrix)[0]), 0.0)
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


def _damping_by_tension(
    equation: ErrorEquation, q: np.ndarray, rates: np.ndarray, boundary_data: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return what the damping by the tension adds: less beta times geometric stiffness times rates, with H to leading order.

    The error is damped as its slowest mode, with the mean of H, by which faster modes are damped too little.
    """
    p, change = equation.chain.p, equation.change
    terms = LeadingTerms(*(array[0] for array in equation.terms.enriched))
    beta, size, kappa = p.tension_damping or 0.0, len(change), terms.kappa
    loads = boundary_data[:, 1 : 1 + terms.mean_chordwise_forces.size]
    motion, moving = q @ change.T, rates @ change.T
    straight = (
        p.stiffness * (boundary_data[:, 0] / equation.chain.total_length - 1.0) - loads @ terms.mean_chordwise_forces
    )
    chord_tension = straight + terms.sag_stiffness[0] * (motion**2 @ kappa)
    forces = chord_tension[:, None] * (kappa * moving)
    for load, stiffness in zip(loads.T, terms.geometric_stiffness.reshape(-1, size, size), strict=True):
        forces += load[:, None] * (moving @ stiffness.T)
    forces[chord_tension <= 0.0] = 0.0
    damping = beta * max(float(chord_tension.mean()), 0.0) * float(kappa.min())
    return -beta * forces, damping
