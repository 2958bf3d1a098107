"""Compiled harmonic balance: residual and exact Jacobian, and the linear systems of maps.

All numbers are without dimension.  Coordinates q(theta) are sums of harmonics with the coefficients X (1 + 2 H, n), in the order
mean, cosine 1, sine 1, cosine 2, ...; the unknowns z are X, flat, and the angular frequency omega of the forcing.  The phase
theta runs over `periods` periods of the forcing, so that harmonic k has the angular frequency k omega / periods.
"""

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled

#: Maximum number of Newton iterations.
MAX_ITERATIONS = 12
#: Newton correction over the largest unknown, or one, below which the next one would be rounding.
NEWTON_RTOL = 1e-8


@compiled
def factorise(matrix, pivots):
    """Replace a matrix (n, n) by its factors with partial pivoting; False where it is singular."""
    n = matrix.shape[0]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        pivots[k] = best
        if not abs(matrix[best, k]) > 0.0:
            return False
        if best != k:
            for j in range(n):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        inverse = 1.0 / matrix[k, k]
        upper = matrix[k, k + 1 :]
        for i in range(k + 1, n):
            factor = matrix[i, k] * inverse
            matrix[i, k] = factor
            if factor != 0.0:
                row = matrix[i, k + 1 :]
                for j in range(upper.size):
                    row[j] -= factor * upper[j]
    return True


@compiled
def substitute(matrix, pivots, x):
    """Solve for the right-hand side x (n,) in place, with the factors of :func:`factorise`."""
    n = x.size
    for k in range(n):
        best = pivots[k]
        if best != k:
            x[k], x[best] = x[best], x[k]
    for i in range(1, n):
        total = x[i]
        for j in range(i):
            total -= matrix[i, j] * x[j]
        x[i] = total
    for back in range(n):
        i = n - 1 - back
        total = x[i]
        for j in range(i + 1, n):
            total -= matrix[i, j] * x[j]
        x[i] = total / matrix[i, i]


@compiled(fastmath=REORDERED_FUSED)
def harmonic_blocks(mean, count, odd, matrix):
    """Fill the action of a periodic matrix on harmonics: rows of harmonics, times harmonics, over a period.

    Products of two harmonics are those of their sum and difference.  For harmonic 0 both rows and both columns are one: what is
    written last, of cosines, stays.

    Parameters
    ----------
    mean
        Fourier sums of the matrix at the samples, over their number, up to twice the highest harmonic (4 H + 1, n, n).
    count, odd
        Number of harmonics; 0 for 0, 1, 2, ..., 1 for the odd halves 1/2, 3/2, ... of a motion over two periods, which the study
        in ``pipelines/periodic`` has.
    matrix
        Filled: the unknowns in the order cosine, sine of each harmonic, all n together.
    """
    n = mean.shape[1]
    for i in range(count):
        ci, si = max(2 * i - 1 + odd, 0) * n, (2 * i + odd) * n
        weight = 0.5 if si == 0 else 1.0
        for j in range(count):
            cj, sj = max(2 * j - 1 + odd, 0) * n, (2 * j + odd) * n
            low, high = abs(i - j), i + j + odd
            sign = 1.0 if i > j else -1.0
            for a in range(n):
                for b in range(n):
                    cosine_low, cosine_high = mean[max(2 * low - 1, 0), a, b], mean[max(2 * high - 1, 0), a, b]
                    sine_low = sign * mean[2 * low, a, b] if low > 0 else 0.0
                    sine_high = mean[2 * high, a, b] if high > 0 else 0.0
                    matrix[si + a, sj + b] = cosine_low - cosine_high
                    matrix[si + a, cj + b] = sine_high + sine_low
                    matrix[ci + a, sj + b] = weight * (sine_high - sine_low)
                    matrix[ci + a, cj + b] = weight * (cosine_low + cosine_high)


@compiled(fastmath=REORDERED_FUSED, literal=False)
def balance(z, basis, damping, periods, force, force_rate, tangent, residual, rate, jacobian):
    """Fill the residual of all harmonics, its derivatives by omega and by X, from forces at the samples.

    Parameters
    ----------
    z, basis, damping, periods
        As in :func:`cablepod.periodic._kernels_forces.leading_samples`; damping by mass; number of periods of the forcing in one
        of the motion.
    force, force_rate, tangent
        Filled by :func:`cablepod.periodic._kernels_forces.leading_samples`.
    residual, rate, jacobian
        Filled: acceleration and damping less the force, harmonic by harmonic ((1 + 2 H) n,), its derivative by omega, its
        derivative by X; both derivatives where they have entries.
    """
    samples, n = force.shape
    columns = (z.size - 1) // n
    harmonics = columns // 2
    omega = z[-1]
    derives = jacobian.size > 0
    # Fourier sums of the tangent, over the number of samples
    mean = np.zeros((4 * harmonics + 1 if derives else 0, n, n))
    inverse = 1.0 / samples
    for i in range(residual.size):
        residual[i] = 0.0
    for i in range(rate.size):
        rate[i] = 0.0
    for j in range(samples):
        for c in range(columns):
            weight = basis[j, c] * (inverse if c == 0 else 2.0 * inverse)
            for a in range(n):
                residual[c * n + a] -= weight * force[j, a]
            for a in range(n if derives else 0):
                rate[c * n + a] -= weight * force_rate[j, a]
        for c in range(mean.shape[0]):
            weight = basis[j, c] * inverse
            for a in range(n):
                for b in range(n):
                    mean[c, a, b] += weight * tangent[j, a, b]
    if derives:
        harmonic_blocks(mean, harmonics + 1, 0, jacobian)
    for i in range(1, harmonics + 1):
        factor = i / periods
        frequency = omega * factor
        for a in range(n):
            c, s = (2 * i - 1) * n + a, 2 * i * n + a
            residual[c] += -frequency * frequency * z[c] + damping * frequency * z[s]
            residual[s] += -frequency * frequency * z[s] - damping * frequency * z[c]
            if not derives:
                continue
            rate[c] += factor * (-2.0 * frequency * z[c] + damping * z[s])
            rate[s] += factor * (-2.0 * frequency * z[s] - damping * z[c])
            jacobian[c, c] -= frequency * frequency
            jacobian[s, s] -= frequency * frequency
            jacobian[c, s] += damping * frequency
            jacobian[s, c] -= damping * frequency
