"""Forces that depend on the rates in the error estimate: damping by the tension, drag of the wind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._air import CondensedAir
from cablepod.condensed._estimate_air import EnrichedDrag

if TYPE_CHECKING:
    from cablepod.condensed._error_equation import ErrorEquation


def forces_by_rates(
    equation: ErrorEquation,
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
    if air is not None:
        drag, of_drag = EnrichedDrag.of(equation, air).forces(times, q, rates, boundary_data)
        forces, damping = forces + drag, damping + of_drag
    return forces, damping


def _damping_by_tension(
    equation: ErrorEquation, q: np.ndarray, rates: np.ndarray, boundary_data: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return what the damping by the tension adds: less beta times geometric stiffness times rates, with H to leading order.

    The error is damped as its slowest mode, with the mean of H, by which faster modes are damped too little.
    """
    p, change, terms = equation.chain.p, equation.change, equation.terms.enriched
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
