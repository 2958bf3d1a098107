"""Compiled map of stability: orbits grown from rest by amplitude, their growth rates, edges of the stable regions."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.periodic._kernels_balance import MAX_ITERATIONS, NEWTON_RTOL, balance, correct, factorise, substitute
from cablepod.periodic._kernels_floquet import multipliers
from cablepod.periodic._kernels_forces import _at_amplitude, leading_samples

#: Kinds of the fastest growth of one set of coordinates.
STABLE, ABOVE_ONE, BELOW_MINUS_ONE, COMPLEX, FAILED = 0, 1, 2, 3, 4
#: Logarithm of the growth over a period that counts as none, and relative imaginary part of a real multiplier.
NO_GROWTH, REAL = 1e-9, 1e-7
#: Number of sizes of the last orbit, each twice the one before, and of parts of a period by which it is moved, from which another
#: orbit is looked for where the response folds back.
SIZES, TURNS = 3, 6
#: Size of a correction over the one before above which the matrix of Newton's method is computed anew.
MAX_CONTRACTION = 0.1
#: Maximum number of evaluations for one edge, and its relative tolerance in the angular frequency.
MAX_EVALUATIONS, EDGE_RTOL = 40, 1e-10


@compiled
def growth_of(real, imag, duration):
    """Return the largest growth rate of multipliers of one set, and its kind."""
    best, kind = -1.0, STABLE
    for i in range(real.size):
        size = math.hypot(real[i], imag[i])
        if not size < np.inf:
            return np.nan, FAILED
        if size > best:
            best = size
            kind = COMPLEX if abs(imag[i]) > REAL * size else (ABOVE_ONE if real[i] > 0.0 else BELOW_MINUS_ONE)
    growth = math.log(best) if best > 0.0 else -np.inf
    return growth / duration, kind if growth > NO_GROWTH else STABLE


@compiled
def _tail(z, n):
    """Return the share of the last two harmonics in the motion."""
    columns = (z.size - 1) // n
    mean = motion = last = 0.0
    for c in range(columns):
        for a in range(n):
            square = z[c * n + a] * z[c * n + a]
            if c == 0:
                mean += square
            else:
                motion += square
            if c >= columns - 4:
                last += square
    return math.sqrt(last / max(motion, 1e-18 * (mean + motion), 1e-300))


@compiled
def _solve_at(z, omega, basis, forced, stride, samples, active, direction, tangent):
    """Change z into the orbit at a frequency; False where Newton's method fails."""
    z[-1] = omega
    return correct(z, active, direction, omega, basis, forced, 1, stride, samples, tangent) > 0


@compiled(fastmath=REORDERED_FUSED)
def _residual(z, basis, forced, stride, force, residual):
    """Fill the residual of all harmonics at the frequency of z, as `leading_samples` and `balance` do, without derivatives."""
    (samples, n), omega, damping = force.shape, z[-1], forced.damping
    columns = (z.size - 1) // n
    leading_samples(z, basis, forced, stride, force, np.empty((0, n)), np.empty((0, n, n)))
    for i in range(residual.size):
        residual[i] = 0.0
    for j in range(samples):
        for a in range(n):
            force[j, a] *= 2.0 / samples
            residual[a] -= 0.5 * force[j, a]
        for c in range(1, columns):
            for a in range(n):
                residual[c * n + a] -= basis[j, c] * force[j, a]
    for i in range(1, columns // 2 + 1):
        frequency = i * omega
        for a in range(n):
            c, s = (2 * i - 1) * n + a, 2 * i * n + a
            residual[c] += -frequency * frequency * z[c] + damping * frequency * z[s]
            residual[s] += -frequency * frequency * z[s] - damping * frequency * z[c]


@compiled
def _solve_again(z, omega, basis, forced, stride, work, factors, pivots, known):
    """Change z into the orbit at a frequency; return whether there is one, and whether `factors` are of a matrix nearby.

    Newton's method with the factors of an earlier matrix while they make corrections fall fast.

    Parameters
    ----------
    z, omega, basis, forced, stride
        As in :func:`_solve_at`.
    work
        Arrays that are overwritten: forces (N, n), their rates, tangents (N, n, n), residual, its rate.
    factors, pivots
        Of the derivative of the residual, see :func:`factorise`; overwritten.
    known
        Whether they are of a matrix nearby.
    """
    force, force_rate, tangent, residual, rate = work
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
            _residual(z, basis, forced, stride, force, residual)
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
def _largest_deflection(z, n, basis, shapes):
    """Return the largest deflection from its mean, of all phases (M, columns) and particles (n, normals, particles)."""
    columns, (_, normals, particles) = (z.size - 1) // n, shapes.shape
    deflection, largest = np.empty((normals, particles)), 0.0
    for k in range(basis.shape[0]):
        for d in range(normals):
            for j in range(particles):
                deflection[d, j] = 0.0
        for a in range(n):
            q = 0.0
            for c in range(1, columns):
                q += basis[k, c] * z[c * n + a]
            for d in range(normals):
                for j in range(particles):
                    deflection[d, j] += q * shapes[a, d, j]
        for j in range(particles):
            square = 0.0
            for d in range(normals):
                square += deflection[d, j] * deflection[d, j]
            largest = max(largest, square)
    return math.sqrt(largest)


@compiled
def map_columns(
    begin, end, omega, equal, rest, of_orbit, of_all, shapes, split, basis, phases_basis, stride, samples, orbits, growth, kind,
    response, least, tail,
):  # fmt: skip
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
    shapes, split
        Shapes of the n coordinates along each normal (n, normals, particles) [m]; number of coordinates of the first set.
    basis, phases_basis, stride, samples
        See :func:`cablepod.periodic._kernels_forces.leading_samples` and :func:`multipliers`.
    orbits, growth, kind, response, least, tail
        Filled: unknowns (amplitudes, columns, ...), growth rates and kinds of the sets (2, amplitudes, columns), largest
        deflections [m], smallest chordwise forces, shares of the last two harmonics (amplitudes, columns).
    """
    n, r = of_orbit.terms.kappa.shape[1], of_all.terms.kappa.shape[1]
    unknowns = rest.size + 1
    z, last, full = np.empty(unknowns), np.empty(unknowns), np.empty((rest.size // n) * r + 1)
    work = (
        np.empty((samples, n)), np.empty((samples, n)), np.empty((samples, n, n)), np.empty(rest.size),
        np.empty(rest.size),
    )  # fmt: skip
    factors, pivots = np.empty((rest.size, rest.size)), np.empty(rest.size, np.int64)
    real, imag, smallest = np.empty(2 * r), np.empty(2 * r), np.empty(1)
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
                orbits[a, f, :] = np.nan
                growth[0, a, f], growth[1, a, f], response[a, f] = np.nan, np.nan, np.nan
                kind[0, a, f], kind[1, a, f] = FAILED, FAILED
                least[a, f], tail[a, f] = np.nan, np.nan
                continue
            good, known = good + 1, True
            for k in range(z.size):
                orbits[a, f, k], last[k] = z[k], z[k]
            tail[a, f] = _tail(z, n)
            _embed(z, n, r, full)
            multipliers(full, phases_basis, _at_amplitude(of_all, a), 1, split, real, imag, smallest)
            duration = 2.0 * math.pi / omega[f]
            growth[0, a, f], kind[0, a, f] = growth_of(real[: 2 * split], imag[: 2 * split], duration)
            if r > split:
                growth[1, a, f], kind[1, a, f] = growth_of(real[2 * split :], imag[2 * split :], duration)
            least[a, f] = smallest[0]
            response[a, f] = _largest_deflection(z, n, phases_basis, shapes)


@compiled
def signed_stability(kind, real, imag, duration):
    """Return a number of the multipliers of one set that changes sign at an edge of a kind."""
    if kind == COMPLEX:
        return growth_of(real, imag, duration)[0]
    sign = -1.0 if kind == ABOVE_ONE else 1.0
    x, y = 1.0, 0.0
    for i in range(real.size):
        u, v = 1.0 + sign * real[i], sign * imag[i]
        x, y = x * u - y * v, x * v + y * u
    return x


@compiled
def refine_edge(kind, first, second, begin, end, a, of_orbit, of_all, split, basis, phases_basis, stride, samples):
    """Return the angular frequency between two orbits at which multipliers of one set cross the unit circle; nan for none.

    Parameters
    ----------
    kind
        Kind of the growth on the unstable side.
    first, second
        Unknowns of the two orbits.
    begin, end
        Multipliers of the set.
    a
        Number of the amplitude.
    of_orbit, of_all, split, basis, phases_basis, stride, samples
        As in :func:`map_columns`.
    """
    n, r = of_orbit.terms.kappa.shape[1], of_all.terms.kappa.shape[1]
    forced, forced_all = _at_amplitude(of_orbit, a), _at_amplitude(of_all, a)
    unknowns = first.size
    active, direction, tangent = np.arange(unknowns), np.zeros(unknowns), np.empty(unknowns)
    direction[-1] = 1.0
    z, full = np.empty(unknowns), np.empty(((unknowns - 1) // n) * r + 1)
    real, imag, smallest = np.empty(2 * r), np.empty(2 * r), np.empty(1)
    low, high, value_low, value_high, side = 0.0, 1.0, 0.0, 0.0, 0
    share = 0.0
    for evaluation in range(MAX_EVALUATIONS):
        if evaluation < 2:
            share = float(evaluation)
        else:
            share = (low * value_high - high * value_low) / (value_high - value_low)
            if evaluation % 6 == 5 or not low < share < high:
                share = 0.5 * (low + high)
        for k in range(unknowns):
            z[k] = first[k] + share * (second[k] - first[k])
        omega = z[-1]
        if not _solve_at(z, omega, basis, forced, stride, samples, active, direction, tangent):
            return np.nan
        _embed(z, n, r, full)
        multipliers(full, phases_basis, forced_all, 1, split, real, imag, smallest)
        value = signed_stability(kind, real[begin:end], imag[begin:end], 2.0 * math.pi / omega)
        if evaluation == 0:
            value_low = value
            continue
        if evaluation == 1:
            value_high = value
            if not value_low * value_high < 0.0:
                return np.nan
            continue
        if value * value_high > 0.0:
            moved = high - share
            high, value_high = share, value
            if side == 1:
                value_low *= 0.5
            side = 1
        else:
            moved = share - low
            low, value_low = share, value
            if side == -1:
                value_high *= 0.5
            side = -1
        if value == 0.0 or (high - low) * abs(second[-1] - first[-1]) < EDGE_RTOL * omega:
            break
        if evaluation > 4 and moved * abs(second[-1] - first[-1]) < EDGE_RTOL * omega:
            break
    return first[-1] + share * (second[-1] - first[-1])
