"""Compiled closure of the chord: the tension at which the stretched links add up to it."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled

#: Newton's method ends when what is left of a correction is below this share of the amplitudes, or of the tension.
CLOSE = 1e-11
MOST = 30
#: The chord is closed where what is left would change H by less than this share.
CLOSED = 1e-10


# --- exact chordwise stretch ------------------------------------------------------------------------------------------


@compiled(fastmath=REORDERED_FUSED, forceinline=True)
def _close(h, chord, stiffness, green, force, z, work):
    """Find H and the chordwise stretch z for which the cable reaches from end to end.

    Parameters
    ----------
    h
        Unstretched lengths or weights of quadrature (m,) [m].
    chord, stiffness, green
        Distance of the ends [m], K [N], whether law (21) holds.
    force, z
        First guess of H [N] and, changed, of z (m,).
    work
        (6, m): chordwise force beside H [N] in row 3, squares of the slopes w' in row 4; on return the chordwise force in row
        0, dz/dN in row 1.

    Returns
    -------
    float
        H, not finite where the search did not end.
    """
    m, soft = z.size, 1.0 / stiffness
    for _ in range(MOST):
        # divisions are what takes the time
        if green:
            for j in range(m):
                n = force + work[3, j]
                give = 1.0 / (3.0 * z[j] * z[j] + work[4, j] - 1.0)
                work[2, j] = (2.0 * n * soft - z[j] * (z[j] * z[j] + work[4, j] - 1.0)) * give
                work[0, j] = n
                work[1, j] = 2.0 * soft * give
                work[5, j] = abs(3.0 * z[j] * give)
        else:
            for j in range(m):
                n = force + work[3, j]
                inverse = 1.0 / math.sqrt(z[j] * z[j] + work[4, j])
                bent = work[4, j] * inverse * inverse * inverse
                give = 1.0 / (1.0 - bent)
                work[2, j] = (n * soft - z[j] * (1.0 - inverse)) * give
                work[0, j] = n
                work[1, j] = soft * give
                work[5, j] = abs(1.5 * z[j] * bent * inverse * inverse * give)
        reach, longer = 0.0, 0.0
        for j in range(m):
            reach += h[j] * (z[j] + work[2, j])
            longer += h[j] * work[1, j]
        change = (chord - reach) / longer
        force += change
        # what the tangents leave out goes with the square of what z changed by: row 5, half the second derivative over the first,
        # and as much again, as the tangents are those of the old z
        left = 0.0
        for j in range(m):
            grown = work[2, j] + work[1, j] * change
            z[j] += grown
            work[0, j] += change
            left += h[j] * work[5, j] * grown * grown
        if 2.0 * left / abs(longer) <= CLOSED * abs(force) + 1e-16 * stiffness:
            return force
        if not abs(change) < np.inf:
            break
    return np.nan


@compiled(inline="always")
def _carry(stretching, h, inertia, momentum):
    """Fill the product (m,) of links that stretch with the mass that they carry along the chord.

    A link that grows moves all particles above it, less what keeps the chord as it is.
    """
    m = h.size
    if inertia.shape[0] != 2:  # at points of quadrature
        for j in range(m):
            total = 0.0
            for k in range(m):
                total += inertia[j, k] * stretching[k]
            momentum[j] = total
        return
    total = 0.0
    for j in range(m):
        total += h[j] * stretching[j]
        momentum[j] = total
    mean = 0.0
    for j in range(m):
        momentum[j] = inertia[0, j] * (momentum[j] - inertia[1, j] * total)
        mean += inertia[1, j] * momentum[j]
    above = -mean
    for back in range(m):
        j = m - 1 - back
        above += momentum[j]
        momentum[j] = h[j] * above


@compiled
def close_all(squared, tau, h, chord, stiffness, green, force, z):
    """Close many shapes: (times, m) squares of slopes, chordwise forces, stretches (filled); (times,) chords and H (filled)."""
    work = np.empty((6, h.size))
    guess, last = force[0], 0
    for i in range(chord.size):
        # from one shape to the next; where that is too far for Newton's method, by way of shapes between
        for parts in (1, 16):
            force[i] = guess
            if i:
                for j in range(h.size):
                    z[i, j] = z[last, j]
            for part in range(1, parts + 1):
                share = part / parts
                for j in range(h.size):
                    work[4, j] = (1.0 - share) * squared[last, j] + share * squared[i, j]
                    work[3, j] = (1.0 - share) * tau[last, j] + share * tau[i, j]
                reach = (1.0 - share) * chord[last] + share * chord[i]
                force[i] = _close(h, reach, stiffness, green, force[i], z[i], work)
            if i == 0 or abs(force[i]) < np.inf:
                break
        if abs(force[i]) < np.inf:
            guess, last = force[i], i
