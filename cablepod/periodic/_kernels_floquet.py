"""Compiled matrices of Numerov's scheme over one period, whose eigenvalues are Floquet multipliers."""

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled


@compiled(fastmath=REORDERED_FUSED, literal=False)
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
