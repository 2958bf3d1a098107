"""Newton's method and multipliers where forces are not cubic, or depend on rates: order "exact", damping not by mass alone.

The forces of order "exact" at all samples are evaluated together by array expressions.  Without damping by tension, ratios or
dampers multipliers follow by Numerov's scheme.  With it the disturbances obey v'' + D(t) v' + A(t) v = 0, where D does not factor
out and may depend on time, and A is not symmetric: a Magnus scheme of fourth order integrates the system of first order, with the
determinant exp(-int tr D dt).
"""

from __future__ import annotations

import numpy as np

from cablepod.condensed._fields import close, stretch_derivatives
from cablepod.condensed._kernels_layout import RateTerms
from cablepod.discretisation._formulas import damping_by_tension
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._solve import Forces, Solver, State, basis_at, rates_of

#: Norm of the matrix in an exponential above which it is halved, and number of terms of the series (rounding at this norm).
MAX_EXPONENT, TERMS = 0.5, 14


def solver_of(model: PeriodicModel) -> Solver:
    """Return the solver of a model: the compiled one where it covers the forces."""
    is_general = model.condensed.order != "leading" or model.is_damped_beside_mass
    return GeneralSolver(model) if is_general else Solver(model)


class GeneralSolver(Solver):
    """Newton's method and multipliers of a model by array expressions."""

    overhead = 2e7

    # --- forces -----------------------------------------------------------------------------------------------------

    def _forces(self, state: State, phases: int, *, tangents_only: bool = False) -> Forces:
        """Evaluate the forces at equidistant phases of the motion, for the coordinates of the state; always all of them."""
        c = state.coefficients
        basis = basis_at(phases, state.harmonics)
        q, rates = basis @ c, state.omega / state.periods * (basis @ rates_of(c))
        evaluate = self._leading if self.model.condensed.order == "leading" else self._exact
        forces, n = evaluate(q, rates, state.omega, state.periods), q.shape[1]
        matrix = self.model.damping_matrix[:n, :n]
        if not matrix.any():
            return forces
        damping = np.tile(matrix, (phases, 1, 1))
        if forces.damping is not None:
            damping += forces.damping
        return forces._replace(force=forces.force - rates @ matrix.T, damping=damping)

    def _leading(self, q: np.ndarray, v: np.ndarray, omega: float, periods: int) -> Forces:
        """Evaluate the forces of order "leading", with damping by the tension."""
        from cablepod.periodic._kernels_forces import damped_samples  # numba is imported only to compute

        (phases, n), beta = q.shape, self.model.tension_damping
        force, rate, tangent, damping = (np.empty((phases, *shape)) for shape in ((n,), (n,), (n, n), (n, n)))
        forced = self.model.forced(n, phases, periods)
        least = damped_samples(q, v, omega, forced, RateTerms(beta, np.empty(0)), force, rate, tangent, damping)
        return Forces(force, rate, tangent, damping if beta else None, least)

    def _exact(self, q: np.ndarray, v: np.ndarray, omega: float, periods: int) -> Forces:
        """Evaluate the forces of order "exact": the chordwise stretch of each link by the closure."""
        model, condensed, chain = self.model, self.model.condensed, self.model.condensed.chain
        frequency, length, _ = model.scales
        n = q.shape[1]
        rows = model.rows(len(q), periods)
        data = rows[0] + omega * rows[1] + omega**2 * rows[2]
        change = rows[1] + 2.0 * omega * rows[2]
        patterns = len(condensed.load_patterns)
        tau_rate = change[:, 1 : 1 + patterns] @ condensed.chordwise_force_patterns
        slopes = [np.diff(shapes, axis=1) / chain.length for shapes in model.sets]
        begin = np.cumsum([0, *(len(part) for part in slopes)])
        used = [(part, slice(i, i + len(part))) for part, i in zip(slopes, begin[:-1], strict=True) if i < n]
        slope = [length * (q[:, which] @ part) for part, which in used]
        squared = sum(part**2 for part in slope)
        first = np.zeros(max(n, condensed.slope_norms_squared.size))
        first[:n] = length * q[0]
        stretch, chordwise = close(condensed, squared, first[: condensed.slope_norms_squared.size], data)
        by_force, coupling = stretch_derivatives(condensed, stretch, squared)
        compliance = by_force / chain.p.stiffness
        weights, total = chain.length, (compliance @ chain.length)[:, None]
        secant, beta = chordwise / stretch, model.tension_damping
        # the tension over the stretch acts on slopes and, with damping, on their rates
        moved = [
            w + damping_by_tension(length * (v[:, which] @ part), secant, beta) if beta else w
            for (part, which), w in zip(used, slope, strict=True)
        ]
        lateral = condensed.load_projection
        lateral = np.pad(lateral, ((0, 0), (0, max(0, n - lateral.shape[1]))))[:, :n]
        force, rate = data[:, 1 + patterns :] @ lateral, change[:, 1 + patterns :] @ lateral
        pull = np.empty((len(q), n))  # derivative of the chord tension by the coordinates, times the total compliance
        pulled, tangent = np.empty((len(q), n)), np.empty((len(q), n, n))
        damping_matrix = np.zeros((len(q), n, n)) if beta else None
        tension_rate = -((compliance * tau_rate) @ weights)[:, None] / total
        for (part, which), w, u in zip(used, slope, moved, strict=True):
            force[:, which] -= (weights * secant * u) @ part.T
            rate[:, which] -= (weights * coupling * u * (tension_rate + tau_rate)) @ part.T
            pull[:, which] = (weights * coupling * w) @ part.T
            pulled[:, which] = (weights * coupling * u) @ part.T
            for (other, columns), x in zip(used, slope, strict=True):
                inner = weights * secant * coupling * u * x / stretch
                if columns == which:
                    inner = inner + weights * secant
                tangent[:, which, columns] = np.einsum("mk,ik,jk->mij", inner, part, other, optimize=True)
            if damping_matrix is not None:
                damping_matrix[:, which, which] = (
                    np.einsum(
                        "mk,ik,jk->mij", weights * damping_by_tension(secant, secant, beta), part, part, optimize=True
                    )
                    / frequency**2
                )
        tangent += pulled[:, :, None] * pull[:, None] / total[:, None]
        unit = 1.0 / (length * frequency**2)
        least = float(chordwise.min()) / model.force_scale
        return Forces(force * unit, rate * unit, tangent / frequency**2, damping_matrix, least)

    # --- multipliers ------------------------------------------------------------------------------------------------

    def _monodromy(self, forces: Forces, part: slice, duration: float) -> np.ndarray:
        """Return the matrix of the coordinates of one set over a period."""
        if not np.isfinite(forces.stiffness).all():
            size = 2 * (part.stop - part.start)
            return np.full((size, size), np.nan)
        if forces.damping is None:
            return super()._monodromy(forces, part, duration)
        stiffness, damping = forces.stiffness[:, part, part], forces.damping[:, part, part]
        damping = damping + self.model.damping * np.eye(damping.shape[1])
        return magnus(stiffness, damping, 2.0 * duration / len(stiffness), self.model.highest_frequency)


def magnus(stiffness: np.ndarray, damping: np.ndarray, step: float, frequency: float) -> np.ndarray:
    """Integrate v'' + D v' + A v = 0 over a period by the Magnus scheme of fourth order with Simpson's rule.

    Parameters
    ----------
    stiffness, damping
        A and D at an even number of equidistant phases of the period (M, r, r).
    step
        Duration of two intervals.
    frequency
        Unit of the rates beside the coordinates, near the highest frequency: the norm of the matrices is then about that.

    Returns
    -------
    float array (2 r, 2 r)
        Matrix from v times `frequency` and v' at the start to those after the period.
    """
    phases, r = stiffness.shape[:2]
    system = np.zeros((phases, 2 * r, 2 * r))
    system[:, :r, r:] = frequency * np.eye(r)
    system[:, r:, :r], system[:, r:, r:] = -stiffness / frequency, -damping
    first, middle = system[0::2], system[1::2]
    last = np.roll(first, -1, axis=0)
    exponent = step / 6.0 * (first + 4.0 * middle + last) - step**2 / 12.0 * (first @ last - last @ first)
    parts = exponentials(exponent)
    while len(parts) > 1:
        odd = parts[-1:] if len(parts) % 2 else parts[:0]
        parts = np.concatenate([parts[1::2] @ parts[: len(parts) - len(odd) : 2], odd])
    return np.asarray(parts[0])


def exponentials(matrices: np.ndarray) -> np.ndarray:
    """Return the exponentials of matrices (..., n, n), by a series after halving, and by squaring."""
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    if not np.isfinite(norm):
        return np.full_like(matrices, np.nan)
    halvings = max(0, int(np.ceil(np.log2(max(norm, 1e-300) / MAX_EXPONENT))))
    scaled = matrices / 2.0**halvings
    one = np.eye(matrices.shape[-1])
    result = one + scaled / TERMS
    for k in range(TERMS - 1, 0, -1):
        result = one + scaled @ result / k
    for _ in range(halvings):
        result = result @ result
    return result
