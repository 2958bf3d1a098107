"""Compiled Floquet multipliers: Numerov's scheme over one period, eigenvalues of real matrices."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.periodic._kernels_forces import leading_samples

#: Maximum number of iterations of the QR algorithm for one eigenvalue.
MAX_QR_ITERATIONS = 60
ROUNDING = 2.0**-52


@compiled(fastmath=REORDERED_FUSED)
def monodromy(tangent, begin, end, damping, step, matrix):
    """Fill the matrix of Numerov's scheme over the phases of `tangent`, for the coordinates `begin` ... `end` - 1.

    With u = exp(damping t / 2) q, u'' = -A u, A = tangent - damping^2 / 4 symmetric.  For y = T u, T = 1 + step^2 A / 12, the
    scheme y_{k+1} = (12 / T_k - 10) y_k - y_{k-1} is of fourth order and symplectic: the determinant is one.

    Parameters
    ----------
    tangent
        Negative derivative of the forces (M, n, n).
    begin, end
        First coordinate and last plus one; the others do not couple with these.
    damping, step
        Mass-proportional damping, and duration of one of the M steps.
    matrix
        Filled: (2 r, 2 r), from (y_0, y_{-1}) to (y_M, y_{M-1}).
    """
    r = end - begin
    scheme, inverse = np.empty((r, r)), np.empty((r, r))
    now, old = np.zeros((r, 2 * r)), np.zeros((r, 2 * r))
    for a in range(r):
        now[a, a], old[a, r + a] = 1.0, 1.0
    factor = step * step / 12.0
    for k in range(tangent.shape[0]):
        for a in range(r):
            for b in range(r):
                scheme[a, b] = factor * tangent[k, begin + a, begin + b]
                inverse[a, b] = 0.0
            scheme[a, a] += 1.0 - 0.25 * factor * damping * damping
            inverse[a, a] = 1.0
        for i in range(r):  # T is close to one or, at long steps, still definite: no pivots
            pivot = 1.0 / scheme[i, i]
            for j in range(r):
                scheme[i, j] *= pivot
                inverse[i, j] *= pivot
            for other in range(r):
                if other != i:
                    share = scheme[other, i]
                    for j in range(r):
                        scheme[other, j] -= share * scheme[i, j]
                        inverse[other, j] -= share * inverse[i, j]
        for a in range(r):
            for b in range(r):
                inverse[a, b] *= 12.0
            inverse[a, a] -= 10.0
            for c in range(2 * r):
                total = 0.0
                for b in range(r):
                    total += inverse[a, b] * now[b, c]
                old[a, c] = total - old[a, c]
        now, old = old, now
    for a in range(r):
        for c in range(2 * r):
            matrix[a, c], matrix[r + a, c] = now[a, c], old[a, c]


@compiled
def _to_hessenberg(a):
    """Reduce a matrix to upper Hessenberg form in place, by elimination with pivots."""
    n = a.shape[0]
    for m in range(1, n - 1):
        x, i = 0.0, m
        for j in range(m, n):
            if abs(a[j, m - 1]) > abs(x):
                x, i = a[j, m - 1], j
        if i != m:
            for j in range(m - 1, n):
                a[i, j], a[m, j] = a[m, j], a[i, j]
            for j in range(n):
                a[j, i], a[j, m] = a[j, m], a[j, i]
        if x != 0.0:
            for i in range(m + 1, n):
                y = a[i, m - 1]
                if y != 0.0:
                    y /= x
                    for j in range(m, n):
                        a[i, j] -= y * a[m, j]
                    for j in range(n):
                        a[j, m] += y * a[j, i]
    for i in range(2, n):
        for j in range(i - 1):
            a[i, j] = 0.0


@compiled
def eigenvalues(a, real, imag):
    """Fill real and imaginary parts of the eigenvalues of a matrix, which is overwritten; False where QR fails.

    The QR algorithm with double shifts for Hessenberg matrices (EISPACK ``hqr``; Wilkinson and Reinsch 1971).
    """
    _to_hessenberg(a)
    n = a.shape[0]
    norm = 0.0
    for i in range(n):
        for j in range(max(i - 1, 0), n):
            norm += abs(a[i, j])
    if not norm < np.inf:
        return False
    last, shift = n - 1, 0.0
    p = q = r = s = x = y = z = w = 0.0
    while last >= 0:
        iteration = 0
        while True:
            low = last
            while low > 0:
                s = abs(a[low - 1, low - 1]) + abs(a[low, low])
                if s == 0.0:
                    s = norm
                if abs(a[low, low - 1]) <= ROUNDING * s:
                    a[low, low - 1] = 0.0
                    break
                low -= 1
            x = a[last, last]
            if low == last:
                real[last], imag[last] = x + shift, 0.0
                last -= 1
                break
            y, w = a[last - 1, last - 1], a[last, last - 1] * a[last - 1, last]
            if low == last - 1:
                p = 0.5 * (y - x)
                q = p * p + w
                z = math.sqrt(abs(q))
                x += shift
                if q >= 0.0:
                    z = p + math.copysign(z, p)
                    real[last - 1] = real[last] = x + z
                    if z != 0.0:
                        real[last] = x - w / z
                    imag[last - 1] = imag[last] = 0.0
                else:
                    real[last - 1] = real[last] = x + p
                    imag[last - 1], imag[last] = -z, z
                last -= 2
                break
            if iteration == MAX_QR_ITERATIONS:
                return False
            if iteration % 10 == 9:  # an exceptional shift
                shift += x
                for i in range(last + 1):
                    a[i, i] -= x
                s = abs(a[last, last - 1]) + abs(a[last - 1, last - 2])
                x = y = 0.75 * s
                w = -0.4375 * s * s
            iteration += 1
            m = last - 2
            while True:
                z = a[m, m]
                r, s = x - z, y - z
                p = (r * s - w) / a[m + 1, m] + a[m, m + 1]
                q = a[m + 1, m + 1] - z - r - s
                r = a[m + 2, m + 1]
                s = abs(p) + abs(q) + abs(r)
                p, q, r = p / s, q / s, r / s
                if m == low:
                    break
                u = abs(a[m, m - 1]) * (abs(q) + abs(r))
                v = abs(p) * (abs(a[m - 1, m - 1]) + abs(z) + abs(a[m + 1, m + 1]))
                if u <= ROUNDING * v:
                    break
                m -= 1
            for i in range(m + 2, last + 1):
                a[i, i - 2] = 0.0
                if i != m + 2:
                    a[i, i - 3] = 0.0
            for k in range(m, last):
                if k != m:
                    p, q, r = a[k, k - 1], a[k + 1, k - 1], 0.0
                    if k != last - 1:
                        r = a[k + 2, k - 1]
                    x = abs(p) + abs(q) + abs(r)
                    if x != 0.0:
                        p, q, r = p / x, q / x, r / x
                s = math.copysign(math.sqrt(p * p + q * q + r * r), p)
                if s == 0.0:
                    continue
                if k == m:
                    if low != m:
                        a[k, k - 1] = -a[k, k - 1]
                else:
                    a[k, k - 1] = -s * x
                p += s
                x, y, z = p / s, q / s, r / s
                q, r = q / p, r / p
                for j in range(k, last + 1):
                    p = a[k, j] + q * a[k + 1, j]
                    if k != last - 1:
                        p += r * a[k + 2, j]
                        a[k + 2, j] -= p * z
                    a[k + 1, j] -= p * y
                    a[k, j] -= p * x
                for i in range(low, min(last, k + 3) + 1):
                    p = x * a[i, k] + y * a[i, k + 1]
                    if k != last - 1:
                        p += z * a[i, k + 2]
                        a[i, k + 2] -= p * r
                    a[i, k + 1] -= p * q
                    a[i, k] -= p
    return True


@compiled(literal=False)
def multipliers(z, basis, forced, periods, split, real, imag, least):
    """Fill the Floquet multipliers of an orbit, of the coordinates before `split` first; False where QR fails.

    Parameters
    ----------
    z, basis, forced, periods
        As in :func:`cablepod.periodic._kernels_forces.leading_samples`, with the basis at all M phases, and
        :func:`cablepod.periodic._kernels_balance.balance`.
    split
        Number of coordinates of the first set, which does not couple with the second; all for one set.
    real, imag
        Filled: (2 r,).
    least
        Filled: (1,), smallest chordwise force.
    """
    phases, r, damping = forced.rows.shape[1], forced.terms.kappa.size, forced.damping
    tangent = np.empty((phases, r, r))
    least[0] = leading_samples(z, basis, forced, 1, np.empty((0, r)), np.empty((0, r)), tangent)
    duration = 2.0 * math.pi * periods / z[-1]
    decay = math.exp(-0.5 * damping * duration)
    good = True
    for part in range(2):
        begin, end = (0, split) if part == 0 else (split, r)
        if end == begin:
            continue
        matrix = np.empty((2 * (end - begin), 2 * (end - begin)))
        monodromy(tangent, begin, end, damping, duration / phases, matrix)
        good = eigenvalues(matrix, real[2 * begin : 2 * end], imag[2 * begin : 2 * end]) and good
    for i in range(real.size):
        real[i] *= decay
        imag[i] *= decay
    return good
