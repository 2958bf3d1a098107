"""Compiled forces of a periodically forced model at the samples of a period, by the terms of the condensed model."""

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.condensed._kernels_closure import _chord_tensions, _fill_tangent, _forces
from cablepod.condensed._kernels_layout import LeadingTerms, Sizes
from cablepod.condensed._kernels_rates import _add_rate_forces
from cablepod.discretisation._kernels_laws import damping_by_tension
from cablepod.periodic._kernels_layout import Forced

#: Change of omega for derivatives, a power of two: a taut cable remains taut.  Forces are linear in the boundary data.
SMALL_CHANGE = 2.0**-10


@compiled(fastmath=REORDERED_FUSED, counted=False)
def _sum_rows(rows, k, second, third, row):
    """Fill the boundary data (columns,) of a phase: those of the first term, plus the second and third times their factors."""
    for c in range(row.size):
        row[c] = rows[0, k, c] + second * rows[1, k, c] + third * rows[2, k, c]


@compiled(counted=False)
def _least_force(forced, row, tension):
    """Return the smallest chordwise force along the cable."""
    least = np.inf
    for c in range(forced.candidates.shape[1]):
        chordwise = tension
        for a in range(forced.candidates.shape[0]):
            chordwise += row[1 + a] * forced.candidates[a, c]
        least = min(least, chordwise)
    return least


@compiled(fastmath=REORDERED_FUSED, literal=False)
def leading_samples(z, basis, forced, stride, force, force_rate, tangent):
    """Evaluate the forces of order "leading" at the samples of a period.

    Without forces return the smallest chordwise force, inf otherwise.

    Parameters
    ----------
    z
        Unknowns ((1 + 2 H) n + 1,), see :mod:`cablepod.periodic._kernels_balance`.
    basis
        Values of the harmonics at the samples (N, columns), see :func:`cablepod.periodic._model.harmonics_at`.
    forced
        Terms and boundary data, see :class:`cablepod.periodic._kernels_layout.Forced`, at M = N stride phases.
    stride
        Number of phases of the boundary data for each sample.
    force, force_rate, tangent
        Filled where they have entries: forces (N, n), their derivative by omega (N, n), their negative derivative by q (N, n, n).
    """
    samples, n, terms, omega = basis.shape[0], forced.terms.kappa.size, forced.terms, z[-1]
    mean = terms.mean_chordwise_forces
    q, row, tension, least = np.empty(n), np.empty(forced.rows.shape[2]), np.empty(1), np.inf
    sizes, has_rate = Sizes((0,), q, mean, row[1 + mean.size :]), force_rate.size > 0
    for j in range(samples):
        for a in range(n):
            q[a] = 0.0
        for c in range((z.size - 1) // n):
            for a in range(n):
                q[a] += basis[j, c] * z[c * n + a]
        if force.size == 0:
            _sum_rows(forced.rows, j * stride, omega, omega * omega, row)
            _chord_tensions(sizes, terms, row, q, tension)
            least = min(least, _least_force(forced, row, tension[0]))
        # forces are linear in the boundary data: their difference for a change of these is their derivative
        for part in range(0 if has_rate else 1, 2 if force.size > 0 else 1):
            change = 1.0 - part
            second, third = omega + change, omega * (omega + 2.0 * change)
            _sum_rows(forced.rows, j * stride, second, third, row)
            _forces(sizes, terms, row, q, tension, force[j])
            for a in range(n if has_rate else 0):
                force_rate[j, a] = force[j, a] if part == 0 else force_rate[j, a] - force[j, a]
        if tangent.size > 0:
            _fill_tangent(terms, row, q, tension[0], tangent[j])
    return least


@compiled(fastmath=REORDERED_FUSED)
def damped_samples(q, v, omega, forced, rate_terms, force, force_rate, tangent, damping):
    """Evaluate forces of order "leading" with damping by the tension; return the smallest chordwise force.

    Parameters
    ----------
    q, v
        Coordinates and rates at all M phases (M, n).
    omega, forced
        Angular frequency of the forcing; see :func:`leading_samples`.
    rate_terms
        See :class:`cablepod.condensed._kernels_layout.RateTerms`, without dimension.
    force, force_rate, tangent, damping
        Filled: forces (M, n), their derivative by omega at constant q and v (M, n), their negative derivatives by q and v
        (M, n, n).
    """
    (phases, n), terms, beta = q.shape, forced.terms, rate_terms.tension_damping
    row, tension, still, work, least = np.empty(forced.rows.shape[2]), np.empty(1), np.zeros(n), np.empty(n), np.inf
    sizes = Sizes((0,), still, terms.mean_chordwise_forces, row[1 + terms.mean_chordwise_forces.size :])
    for k in range(phases):
        for part in range(2):
            change = SMALL_CHANGE * (1.0 - part)
            second, third = omega + change, omega * (omega + 2.0 * change)
            _sum_rows(forced.rows, k, second, third, row)
            _forces(sizes, terms, row, q[k], tension, force[k])
            _add_rate_forces(sizes, terms, rate_terms, row, tension, v[k], work, force[k])
            if part == 0:
                for a in range(n):
                    force_rate[k, a] = force[k, a]
        for a in range(n):
            force_rate[k, a] = (force_rate[k, a] - force[k, a]) / SMALL_CHANGE
        _fill_tangent(terms, row, q[k], tension[0], tangent[k])
        _fill_tangent(terms, row, still, tension[0], damping[k])
        damped = damping_by_tension(1.0, tension[0], beta)
        for a in range(n):
            for b in range(n):
                damping[k, a, b] *= damped
                # the tension in the damping depends on the coordinates
                by_q = 2.0 * terms.sag_stiffness[0] * terms.kappa[b] * q[k, b]
                tangent[k, a, b] += damped * terms.kappa[a] * v[k, a] * by_q
        least = min(least, _least_force(forced, row, tension[0]))
    return least


@compiled
def _at_amplitude(forced, a):
    """Return terms and boundary data of one amplitude of those of all amplitudes."""
    t = forced.terms
    terms = LeadingTerms(
        t.stiffness[a], t.inverse_length[a], t.sag_stiffness[a], t.kappa[a], t.mean_chordwise_forces[a],
        t.geometric_stiffness[a], t.load_projection[a],
    )  # fmt: skip
    return Forced(terms, forced.candidates[a], forced.rows[a], forced.damping)
