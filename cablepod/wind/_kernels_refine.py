"""Compiled interpolation of the wind in time."""

from __future__ import annotations

from cablepod._jit import compiled


@compiled
def refine(samples, weights, refined):
    """Interpolate samples (n, columns) by polynomials through six of them, the first and last repeated beyond the ends.

    Parameters
    ----------
    samples : float array (n, columns)
        At equal intervals.
    weights : float array (parts, 6)
        Weights of the samples two before ... three after, for each part of an interval; those of the first part are not used.
    refined : float array (parts (n - 1) + 1, columns)
        Filled.
    """
    count, columns = samples.shape
    parts, last = weights.shape[0], count - 1
    for i in range(last):
        a, b, d, e = max(i - 2, 0), max(i - 1, 0), min(i + 2, last), min(i + 3, last)
        for c in range(columns):
            refined[parts * i, c] = samples[i, c]
        for k in range(1, parts):
            w = weights[k]
            w0, w1, w2, w3, w4, w5 = w[0], w[1], w[2], w[3], w[4], w[5]
            for c in range(columns):
                refined[parts * i + k, c] = (
                    w0 * samples[a, c] + w1 * samples[b, c] + w2 * samples[i, c] + w3 * samples[i + 1, c]
                    + w4 * samples[d, c] + w5 * samples[e, c]
                )  # fmt: skip
    for c in range(columns):
        refined[parts * last, c] = samples[last, c]
