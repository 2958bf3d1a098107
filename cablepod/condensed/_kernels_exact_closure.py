"""Compiled closure: chordwise stretch and chord tension H for a given distance of the ends."""

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.condensed._kernels_layout import (
    COMPLIANCE,
    CURVATURE,
    FORCE,
    LOAD_FORCE,
    RESIDUAL,
    SLOPE_SQUARED,
)
from cablepod.discretisation._kernels_laws import green_along, green_secant, linear_along, linear_secant

#: Relative tolerance of Newton's method for a step: estimated next correction over the largest coordinate.
NEWTON_RTOL = 1e-11
#: Maximum number of Newton iterations.
MAX_ITERATIONS = 30
#: Relative tolerance of the closure: change of H by the remaining residual.
CLOSURE_RTOL = 1e-10
#: Absolute tolerance of the closure over K (rounding of the strain).
CLOSURE_ATOL = 1e-16
#: Numbers of load increments tried in turn between two shapes.
INCREMENTS = (1, 16)
#: Maximum number of iterations of the closure from no guess: from K down to rounding it takes 53 halvings.
SAFE_ITERATIONS = 100
#: Relative correction of a stretch there that is rounding: some units of the last digit.
ROUNDING = 1e-15
#: Relative tolerance of the distance of the ends there: where a link buckles its stretch changes as the root of its force.
SAFE_RTOL = 1e-7


@compiled(fastmath=REORDERED_FUSED, forceinline=True, counted=False)
def _newton(green, strain, squared, stretch):
    """Return Newton's correction of the chordwise stretch zeta' by the law, its derivative by N / K, and its curvature.

    With xi^2 = zeta'^2 + w'^2 the law is N / K = zeta' (1 - 1 / xi) or, where `green` is not None, law (21),
    N / K = zeta' (xi^2 - 1) / 2; N / K is `strain` and w'^2 `squared`.  The curvature is half the second derivative over the
    first.
    """
    if green is None:  # with two divisions, which take most of the time
        inverse = 1.0 / math.sqrt(stretch * stretch + squared)
        tangent = linear_along(squared, inverse)
        bending, inverse_tangent = 1.0 - tangent, 1.0 / tangent
        correction = (strain - stretch * linear_secant(inverse, 1.0)) * inverse_tangent
        return correction, inverse_tangent, abs(1.5 * stretch * bending * inverse * inverse * inverse_tangent)
    inverse_tangent = 1.0 / green_along(squared, stretch)
    correction = (strain - stretch * green_secant(stretch * stretch + squared, 1.0)) * inverse_tangent
    return correction, inverse_tangent, abs(1.5 * stretch * inverse_tangent)


@compiled(fastmath=REORDERED_FUSED, forceinline=True, counted=False)
def _close(weights, chord, stiffness, green, chord_tension, stretch, work):
    """Solve the closure for H and the chordwise stretch by Newton's method.

    Parameters
    ----------
    weights
        Unstretched lengths of the links, or quadrature weights (m,) [m].
    chord, stiffness, green
        Distance of the ends [m], K [N], True for law (21) and None for the linear one.
    chord_tension
        First guess of H [N].
    stretch
        First guess of the chordwise stretch (m,); changed into the solution.
    work
        (CLOSURE_ROWS, m): rows LOAD_FORCE and SLOPE_SQUARED are given; rows FORCE and COMPLIANCE are filled.

    Returns
    -------
    float
        H [N], not finite where Newton's method did not converge.
    """
    m, flexibility = stretch.size, 1.0 / stiffness
    for _ in range(MAX_ITERATIONS):
        for j in range(m):
            work[FORCE, j] = chord_tension + work[LOAD_FORCE, j]
            strain, squared = work[FORCE, j] * flexibility, work[SLOPE_SQUARED, j]
            correction, derivative, curvature = _newton(green, strain, squared, stretch[j])
            work[RESIDUAL, j], work[COMPLIANCE, j], work[CURVATURE, j] = correction, derivative * flexibility, curvature
        reach, compliance = 0.0, 0.0
        for j in range(m):
            reach += weights[j] * (stretch[j] + work[RESIDUAL, j])
            compliance += weights[j] * work[COMPLIANCE, j]
        tension_change = (chord - reach) / compliance
        chord_tension += tension_change
        # second-order error of the correction, twice: the tangents are those of the old stretch
        residual = 0.0
        for j in range(m):
            correction = work[RESIDUAL, j] + work[COMPLIANCE, j] * tension_change
            stretch[j] += correction
            work[FORCE, j] += tension_change
            residual += weights[j] * work[CURVATURE, j] * correction * correction
        if 2.0 * residual / abs(compliance) <= CLOSURE_RTOL * abs(chord_tension) + CLOSURE_ATOL * stiffness:
            return chord_tension
        if not abs(tension_change) < np.inf:
            break
    return np.nan


@compiled(fastmath=REORDERED_FUSED, noalias=True, literal=False, counted=False)
def _chordwise_momentum(count, stretching, weights, inertia, momentum):
    """Multiply rates of stretch (m, count) by the chordwise mass matrix, into `momentum` (m, count) [kg m^2], side by side.

    `inertia` is the full matrix (m, m) at quadrature points, or (2, m) its factors on links: a link that stretches moves all
    particles above it, minus a uniform contraction that keeps the chord length.
    """
    m = weights.size
    if inertia.shape[0] != 2:  # full matrix, at quadrature points
        for j in range(m):
            for t in range(count):
                momentum[j, t] = 0.0
            for k in range(m):
                for t in range(count):
                    momentum[j, t] += inertia[j, k] * stretching[k, t]
        return
    for t in range(count):
        total, mean = 0.0, 0.0
        for j in range(m):
            total += weights[j] * stretching[j, t]
            momentum[j, t] = total
        for j in range(m):
            momentum[j, t] = inertia[0, j] * (momentum[j, t] - inertia[1, j] * total)
            mean += inertia[1, j] * momentum[j, t]
        above = -mean
        for back in range(m):
            j = m - 1 - back
            above += momentum[j, t]
            momentum[j, t] = weights[j] * above


@compiled(counted=False)
def chordwise_momenta(stretching, weights, inertia, momentum):
    """Do :func:`_chordwise_momentum` for members, the first dimension of all arrays."""
    for member in range(weights.shape[0]):
        _chordwise_momentum(stretching.shape[2], stretching[member], weights[member], inertia[member], momentum[member])


@compiled(counted=False)
def close_all(squared, tau, weights, chord, stiffness, green, begin, last, work, chord_tension, stretch):
    """Solve the closure for shapes at many times, from one to the next, up to the first where Newton's method fails.

    Parameters
    ----------
    squared, tau
        Squared slopes and chordwise forces of the loads [N], (times, m).
    weights, stiffness, green, work
        As in :func:`_close`.
    chord
        Distance of the ends (times,) [m].
    begin, last
        Number of the first time, and of the last one before that has a solution; -1 without any: guesses are the first entries.
    chord_tension, stretch
        Filled: H (times,) [N], and chordwise stretch (times, m).

    Returns
    -------
    tuple of int
        Number of the time where it fails, or of times, and `last` there.
    """
    for i in range(begin, chord.size):
        before = last if last > 0 else 0
        guess = chord_tension[before]
        # with intermediate shapes where Newton's method does not converge at once
        for parts in INCREMENTS:
            chord_tension[i] = guess
            for j in range(weights.size):
                stretch[i, j] = stretch[before, j]
            for part in range(1, parts + 1):
                weight = part / parts
                for j in range(weights.size):
                    work[SLOPE_SQUARED, j] = (1.0 - weight) * squared[before, j] + weight * squared[i, j]
                    work[LOAD_FORCE, j] = (1.0 - weight) * tau[before, j] + weight * tau[i, j]
                reach = (1.0 - weight) * chord[before] + weight * chord[i]
                chord_tension[i] = _close(weights, reach, stiffness, green, chord_tension[i], stretch[i], work)
            if last < 0 or abs(chord_tension[i]) < np.inf:  # at first there is no shape to begin with
                break
        if not abs(chord_tension[i]) < np.inf:
            return i, last
        last = i
    return chord.size, last


@compiled(counted=False)
def _stretch_at(strain, squared, green):
    """Return the chordwise stretch for a chordwise force over K and a squared slope, where it rises with the force; or nan.

    There the force is a convex function of a positive stretch, so that Newton's method converges from above.  Links with slopes
    above one turn back along the chord before they buckle; the force is odd in the stretch.
    """
    sign, least = 1.0, 0.0
    if squared < 1.0:
        least = math.sqrt(squared ** (2.0 / 3.0) - squared if green is None else (1.0 - squared) / 3.0)
    elif strain < 0.0:
        sign, strain = -1.0, -strain
    stretch = 1.0 + max(strain, 0.0)
    for _ in range(SAFE_ITERATIONS):
        correction, _, _ = _newton(green, strain, squared, stretch)
        if -correction <= ROUNDING * stretch:  # all corrections are downwards, but for rounding
            return sign * stretch
        stretch += correction
        if not stretch > least:
            break
    return np.nan


@compiled(counted=False)
def _reach_at(chord_tension, load_force, squared, weights, stiffness, green, stretch):
    """Fill the chordwise stretch (m,) for H [N]; return the distance of the ends [m], nan where a link carries no such force."""
    reach = 0.0
    for j in range(weights.size):
        stretch[j] = _stretch_at((chord_tension + load_force[j]) / stiffness, squared[j], green)
        reach += weights[j] * stretch[j]
    return reach


@compiled(counted=False)
def close_from_nothing(weights, chord, stiffness, green, load_force, squared, stretch):
    """Solve the closure by halving, from no guess, where the distance of the ends rises with H.

    Parameters
    ----------
    weights, chord, stiffness, green
        As in :func:`_close`.
    load_force, squared
        Chordwise forces of the loads [N] and squared slopes (m,).
    stretch
        Filled: chordwise stretch (m,).

    Returns
    -------
    float
        H [N]; nan where there is none, as the ends are nearer to each other than the links can be pushed together.
    """
    low, high, width = -stiffness, 0.0, 1e-3 * stiffness
    for j in range(weights.size):
        low, high = min(low, -stiffness - load_force[j]), max(high, -load_force[j])
    for _ in range(SAFE_ITERATIONS):
        if _reach_at(high, load_force, squared, weights, stiffness, green, stretch) >= chord:
            break
        low, high, width = high, high + width, 2.0 * width
    for _ in range(SAFE_ITERATIONS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if _reach_at(middle, load_force, squared, weights, stiffness, green, stretch) >= chord:
            high = middle
        else:  # also where a link buckles
            low = middle
    reach = _reach_at(high, load_force, squared, weights, stiffness, green, stretch)
    return high if abs(reach - chord) <= SAFE_RTOL * chord else np.nan
