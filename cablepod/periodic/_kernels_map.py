"""Compiled map of stability: orbits grown from rest by amplitude, with the matrices of their disturbances."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.periodic._kernels_balance import MAX_ITERATIONS, NEWTON_RTOL, balance, factorise, substitute
from cablepod.periodic._kernels_floquet import monodromy
from cablepod.periodic._kernels_forces import _at_amplitude, leading_samples

#: Number of sizes of the last orbit, each twice the one before, and of parts of a period by which it is moved, from which another
#: orbit is looked for where the response folds back.
SIZES, TURNS = 3, 6
#: Size of a correction over the one before above which the matrix of Newton's method is computed anew.
MAX_CONTRACTION = 0.1


@compiled
def _solve_again(z, omega, basis, forced, stride, work, factors, pivots, known):
    """Change z into the orbit at a frequency; return whether there is one, and whether `factors` are of a matrix nearby.

    Newton's method with the factors of an earlier matrix while they make corrections fall fast.

    Parameters
    ----------
    z, omega
        First guess, changed; angular frequency.
    basis, forced, stride
        See :func:`cablepod.periodic._kernels_forces.leading_samples`.
    work
        Arrays that are overwritten: forces (N, n), their rates, tangents (N, n, n), residual, its rate.
    factors, pivots
        Of the derivative of the residual, see :func:`factorise`; overwritten.
    known
        Whether they are of a matrix nearby.
    """
    force, force_rate, tangent, residual, rate = work
    no_rate, no_tangent, no_matrix = force_rate[:0], tangent[:0], factors[:0]
    z[-1] = omega
    unknowns = residual.size
    before, anew = np.inf, not known
    for iteration in range(2 * MAX_ITERATIONS):
        if anew:
            leading_samples(z, basis, forced, stride, force, force_rate, tangent)
            balance(z, basis, forced.damping, 1, force, force_rate, tangent, residual, rate, factors)
            if not factorise(factors, pivots):
                return False, False
        else:
            leading_samples(z, basis, forced, stride, force, no_rate, no_tangent)
            balance(z, basis, forced.damping, 1, force, no_rate, no_tangent, residual, rate[:0], no_matrix)
        substitute(factors, pivots, residual)
        change, largest = 0.0, 1.0
        for i in range(unknowns):
            largest = max(largest, abs(z[i]))
            change = max(change, abs(residual[i]))
            z[i] -= residual[i]
        if not change < 1e6 * largest or (anew and iteration > 5 and change > before):
            return False, False
        if change <= NEWTON_RTOL * largest:
            return True, True
        anew = iteration > 0 and change > MAX_CONTRACTION * before
        before = change
    return False, False


@compiled
def scaled_and_turned(last, n, size, share, z):
    """Fill z with an orbit of other size that runs later by a share of the period."""
    columns = (z.size - 1) // n
    for a in range(n):
        z[a] = last[a]
    for k in range(1, columns // 2 + 1):
        cosine, sine = math.cos(2.0 * math.pi * k * share), math.sin(2.0 * math.pi * k * share)
        for a in range(n):
            c, s = last[(2 * k - 1) * n + a], last[2 * k * n + a]
            z[(2 * k - 1) * n + a] = size * (c * cosine - s * sine)
            z[2 * k * n + a] = size * (c * sine + s * cosine)


@compiled
def _embed(z, n, r, full):
    """Fill the unknowns of all r coordinates from those of the first n."""
    columns = (z.size - 1) // n
    full[:] = 0.0
    for c in range(columns):
        for a in range(n):
            full[c * r + a] = z[c * n + a]
    full[-1] = z[-1]


@compiled
def map_columns(
    begin, end, omega, equal, rest, of_orbit, of_all, basis, phases_basis, stride, orbits, inside, outside, least
):
    """Follow orbits from rest over all amplitudes, at the frequencies `begin` ... `end` - 1.

    Parameters
    ----------
    begin, end, omega
        Columns, and the angular frequencies of all columns (columns,).
    equal
        Whether the last four amplitudes differ by equal steps, from each amplitude on (amplitudes,).
    rest
        Coefficients at rest ((1 + 2 H) n,).
    of_orbit, of_all
        Terms and boundary data for the n coordinates of the orbit and for all r, see
        :class:`cablepod.periodic._kernels_layout.Forced`; amplitudes are the first dimension of their arrays.
    basis, phases_basis, stride
        See :func:`cablepod.periodic._kernels_forces.leading_samples`; `phases_basis` at all phases of the forcing.
    orbits, inside, outside, least
        Filled, nan without an orbit: unknowns (amplitudes, columns, ...), matrices of :func:`monodromy` for the n coordinates
        and for the others, of the columns from `begin` on (amplitudes, end - begin, ...), smallest chordwise forces
        (amplitudes, columns).
    """
    n, r = of_orbit.terms.kappa.shape[1], of_all.terms.kappa.shape[1]
    unknowns, samples = rest.size + 1, basis.shape[0]
    z, last, full = np.empty(unknowns), np.empty(unknowns), np.empty((rest.size // n) * r + 1)
    work = (
        np.empty((samples, n)), np.empty((samples, n)), np.empty((samples, n, n)), np.empty(rest.size),
        np.empty(rest.size),
    )  # fmt: skip
    factors, pivots = np.empty((rest.size, rest.size)), np.empty(rest.size, np.int64)
    phases = phases_basis.shape[0]
    none, tangents = np.empty((0, r)), np.empty((phases, r, r))
    for f in range(begin, end):
        good, known = 0, False  # number of successive solutions; whether there is a last one
        factored = False  # whether factors are those of a matrix nearby
        for a in range(of_all.rows.shape[0]):
            forced, solved = _at_amplitude(of_orbit, a), False
            for attempt in range(
                4 + SIZES * TURNS
            ):  # along the last three or two orbits, from the last one, from rest, from others
                if attempt == 0 and good > 2 and equal[a]:
                    for k in range(z.size):
                        z[k] = 3.0 * (orbits[a - 1, f, k] - orbits[a - 2, f, k]) + orbits[a - 3, f, k]
                elif attempt == 1 and good > 1:
                    for k in range(z.size):
                        z[k] = 2.0 * orbits[a - 1, f, k] - orbits[a - 2, f, k]
                elif attempt == 2 and known:
                    for k in range(z.size):
                        z[k] = last[k]
                elif attempt == 3:
                    for k in range(rest.size):
                        z[k] = rest[k]
                elif attempt > 3 and known:
                    scaled_and_turned(last, n, 2.0 ** ((attempt - 4) % SIZES), (attempt - 4) // SIZES / TURNS, z)
                else:
                    continue
                solved, factored = _solve_again(
                    z, omega[f], basis, forced, stride, work, factors, pivots, factored and attempt < 3
                )
                if solved:
                    break
            if not solved:
                good = 0
                orbits[a, f, :], inside[a, f - begin, :], outside[a, f - begin, :] = np.nan, np.nan, np.nan
                least[a, f] = np.nan
                continue
            good, known = good + 1, True
            for k in range(z.size):
                orbits[a, f, k], last[k] = z[k], z[k]
            _embed(z, n, r, full)
            least[a, f] = leading_samples(full, phases_basis, _at_amplitude(of_all, a), 1, none, none, tangents)
            step = 2.0 * math.pi / omega[f] / phases
            monodromy(tangents, 0, n, of_all.damping, step, inside[a, f - begin])
            if r > n:
                monodromy(tangents, n, r, of_all.damping, step, outside[a, f - begin])
