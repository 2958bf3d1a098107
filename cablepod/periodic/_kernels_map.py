"""Compiled map of stability: orbits grown from rest by amplitude, with the matrices of their disturbances."""

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.periodic._kernels_balance import MAX_ITERATIONS, NEWTON_RTOL, balance, factorise, substitute
from cablepod.periodic._kernels_floquet import monodromy
from cablepod.periodic._kernels_forces import _at_amplitude, leading_samples

#: Number of sizes of the last orbit, each twice the one before, and of parts of a period by which it is moved, from which another
#: orbit is looked for where the response folds back.
SIZES, TURNS = 3, 6
#: Number of first guesses, see :func:`first_guess`.
GUESSES = 4 + SIZES * TURNS
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
def _scaled_and_turned(last, n, size, share, z):
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
def first_guess(number, last, count, is_even, rest, n, z):
    """Fill z with a first guess of an orbit; return whether there is one of this number, from 0 to GUESSES - 1.

    They are, in this order, along the last three orbits and the last two, the last one, rest, the last one made larger and moved.

    Parameters
    ----------
    number
        Number of the guess.
    last
        Last orbits at the frequency, the newest first (3, unknowns).
    count
        How many amplitudes in a row have orbits, 0 if the one before has none, -1 if there is none at all.
    is_even
        Whether the last four amplitudes differ by equal steps.
    rest, n
        Coefficients at rest ((1 + 2 H) n,), and number of coordinates.
    z
        Filled ((1 + 2 H) n + 1,), but for the frequency.
    """
    if number == 0 and count > 2 and is_even:
        for k in range(rest.size):
            z[k] = 3.0 * (last[0, k] - last[1, k]) + last[2, k]
    elif number == 1 and count > 1:
        for k in range(rest.size):
            z[k] = 2.0 * last[0, k] - last[1, k]
    elif number == 2 and count >= 0:
        for k in range(rest.size):
            z[k] = last[0, k]
    elif number == 3:
        for k in range(rest.size):
            z[k] = rest[k]
    elif number > 3 and count >= 0:
        _scaled_and_turned(last[0], n, 2.0 ** ((number - 4) % SIZES), (number - 4) // SIZES / TURNS, z)
    else:
        return False
    return True


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
    begin, end, omega, is_even, starts, of_orbit, of_all, basis, phases_basis, stride, orbits, inside, outside, least
):
    """Follow orbits from rest over all amplitudes, at the frequencies `begin` ... `end` - 1.

    Parameters
    ----------
    begin, end, omega
        Columns, and the angular frequencies of all columns (columns,).
    is_even
        Whether the last four amplitudes differ by equal steps, at each of them (amplitudes,).
    starts
        Coefficients at rest, or those that lead to the response of the first amplitude (columns, (1 + 2 H) n).
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
    size, samples = starts.shape[1], basis.shape[0]
    unknowns = size + 1
    z, last, full = np.empty(unknowns), np.zeros((3, unknowns)), np.empty((size // n) * r + 1)
    work = (
        np.empty((samples, n)), np.empty((samples, n)), np.empty((samples, n, n)), np.empty(size),
        np.empty(size),
    )  # fmt: skip
    factors, pivots = np.empty((size, size)), np.empty(size, np.int64)
    phases = phases_basis.shape[0]
    none, tangents = np.empty((0, r)), np.empty((phases, r, r))
    for f in range(begin, end):
        count, factored = -1, False  # see :func:`first_guess`; whether factors are those of a matrix nearby
        for a in range(of_all.rows.shape[0]):
            forced, solved = _at_amplitude(of_orbit, a), False
            for number in range(GUESSES):
                if not first_guess(number, last, count, is_even[a], starts[f], n, z):
                    continue
                solved, factored = _solve_again(
                    z, omega[f], basis, forced, stride, work, factors, pivots, factored and number < 3
                )
                if solved:
                    break
            if not solved:
                count = min(count, 0)
                orbits[a, f, :], inside[a, f - begin, :], outside[a, f - begin, :] = np.nan, np.nan, np.nan
                least[a, f] = np.nan
                continue
            count = max(count, 0) + 1
            for k in range(z.size):
                last[2, k], last[1, k], last[0, k] = last[1, k], last[0, k], z[k]
                orbits[a, f, k] = z[k]
            _embed(z, n, r, full)
            least[a, f] = leading_samples(full, phases_basis, _at_amplitude(of_all, a), 1, none, none, tangents)
            step = 2.0 * math.pi / omega[f] / phases
            monodromy(tangents, 0, n, of_all.damping, step, inside[a, f - begin])
            if r > n:
                monodromy(tangents, n, r, of_all.damping, step, outside[a, f - begin])
