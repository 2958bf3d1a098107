"""Compiled records of a run to leading order: extremes of force and frequency, and tensions of links."""

import math

import numpy as np

from cablepod._jit import FUSED, REORDERED_FUSED, compiled
from cablepod.condensed._kernels_closure import _chord_tensions, _of_member
from cablepod.condensed._kernels_layout import (
    MAX_OMEGA_SQUARED,
    MIN_FORCE,
    MIN_FORCE_STEP,
    OMEGA_SQUARED_LIMIT,
    UNSTABLE_STEP,
    Links,
    Sizes,
)


@compiled(fastmath=FUSED, noalias=True, forceinline=True, literal=False, counted=False)
def _monitor_frequency(sizes, terms, bounds, row, q, tension, number, monitor):
    """Keep the largest bound of the squared frequency, and the first step where it is too large.

    The squared frequencies are at most |H| max kappa + K / L0 sum (kappa q)^2 + sum |g_a| |G_a|.
    """
    lanes, size, patterns = len(sizes.lanes), len(sizes.modes), len(sizes.patterns)
    for m in range(lanes):
        steepest, sag, loads = 0.0, 0.0, 0.0
        for j in range(size):
            kappa = terms.kappa[j * lanes + m]
            steepest = kappa if kappa > steepest else steepest
            sag += (kappa * q[j * lanes + m]) * (kappa * q[j * lanes + m])
        for a in range(patterns):
            loads += abs(row[(1 + a) * lanes + m]) * bounds.norms[a * lanes + m]
        omega_squared = abs(tension[m]) * steepest + loads + 2.0 * terms.sag_stiffness[m] * sag
        largest, unstable = MAX_OMEGA_SQUARED * lanes + m, UNSTABLE_STEP * lanes + m
        is_first = omega_squared >= monitor[OMEGA_SQUARED_LIMIT * lanes + m] and number < monitor[unstable]
        monitor[unstable] = number if is_first else monitor[unstable]
        monitor[largest] = omega_squared if omega_squared > monitor[largest] else monitor[largest]


@compiled(fastmath=FUSED, noalias=True, forceinline=True, literal=False, counted=False)
def _monitor_step(sizes, terms, bounds, row, q, tension, number, monitor):
    """Update the monitor (MONITOR_ROWS, lanes): least chordwise force with its step, largest frequency."""
    lanes, patterns = len(sizes.lanes), len(sizes.patterns)
    for m in range(lanes):
        bounds.least[m] = np.inf
    for k in range(bounds.candidates.shape[0]):
        for m in range(lanes):
            force = tension[m]
            for a in range(patterns):
                force += row[(1 + a) * lanes + m] * bounds.candidates[k, a * lanes + m]
            bounds.least[m] = force if force < bounds.least[m] else bounds.least[m]
    for m in range(lanes):
        least, force, step = bounds.least[m], MIN_FORCE * lanes + m, MIN_FORCE_STEP * lanes + m
        monitor[step] = number if least < monitor[force] else monitor[step]
        monitor[force] = least if least < monitor[force] else monitor[force]
    _monitor_frequency(sizes, terms, bounds, row, q, tension, number, monitor)


@compiled(fastmath=REORDERED_FUSED, forceinline=True, literal=False, counted=False)
def _link_tension(sizes, links, row, q, tension, j, m):
    """Return the tension [N] of link j in lane m to leading order, (H + tau) sqrt(1 + w'^2)."""
    lanes, size, patterns = len(sizes.lanes), len(sizes.modes), len(sizes.patterns)
    # indices without sign: a negative one would count from the end, a test that keeps loops from being vectorised
    k = np.uintp(j * lanes + m)
    across, out_of_plane, force = 0.0, 0.0, tension[m]
    for i in range(size):
        slope = links.slopes[i, k] * q[np.uintp(i * lanes + m)]
        across += slope if i < links.in_plane else 0.0
        out_of_plane += 0.0 if i < links.in_plane else slope
    for a in range(patterns):
        force += row[np.uintp((1 + a) * lanes + m)] * links.force_patterns[a, k]
    return force * math.sqrt(1.0 + across * across + out_of_plane * out_of_plane)


@compiled(fastmath=REORDERED_FUSED, noalias=True, literal=False, counted=False)
def _update_extremes(sizes, links, row, q, tension):
    """Update the extremes by the tensions of the links."""
    lanes = len(sizes.lanes)
    for j in range(links.low.size // lanes):
        for m in range(lanes):
            k, value = np.uintp(j * lanes + m), _link_tension(sizes, links, row, q, tension, j, m)
            links.low[k] = value if value < links.low[k] else links.low[k]
            links.high[k] = value if value > links.high[k] else links.high[k]


@compiled(fastmath=REORDERED_FUSED, counted=False)
def link_tensions(terms, boundary_data, q, slopes, in_plane, force_patterns, chord_tension, rows, tension):
    """Fill the tensions of links of members (rows, times, links) [N] for coordinates q, see :func:`_link_tension`.

    Arrays have a leading dimension of members: boundary data of the instants (times, columns), q (times, r), the other tables as
    in :class:`cablepod.condensed._kernels_layout.Links`, with one lane; `rows` are those of the members in `tension` (members,).
    `chord_tension` (1,) is a work array.
    """
    times = q.shape[1]
    for m in range(q.shape[0]):
        own = _of_member(terms, m)
        # the loads along the normals do not count
        sizes = Sizes((0,), q[m, 0], own.mean_chordwise_forces, chord_tension)
        links = Links(slopes[m], in_plane, force_patterns[m], chord_tension, chord_tension)  # without extremes
        for t in range(times):
            _chord_tensions(sizes, own, boundary_data[m, t], q[m, t], chord_tension)
            for j in range(tension.shape[2]):
                tension[rows[m], t, j] = _link_tension(sizes, links, boundary_data[m, t], q[m, t], chord_tension, j, 0)
