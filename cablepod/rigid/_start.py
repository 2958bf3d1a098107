"""Equilibrium and initial shape of a chain of rigid links, with checks of its lengths."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cablepod.catenary._statics import load_plane, solve_statics
from cablepod.chain._start import gap_tolerance, link_forces
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.errors import SceneError, scene_error

#: Maximum relative length error of an initial shape (decimals of points in a file), which is then corrected to rounding.
LENGTH_TOLERANCE = 1e-9
#: Minimum relative distance of the ends from the full length (the multipliers are ill-conditioned below).
STRAIGHT = 1e-12
#: Maximum relative deficit of the length of a line between two held ends (links cut the corners of a bent line).
MAX_DEFICIT = 1e-2


# --- rest -----------------------------------------------------------------------------------------------------------


def rest_shape(chain: LumpedChain) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n + 1, dims) [m] and tensions (n,) [N] of rigid links at rest.

    As in the elastic chain, the force in the first link determines all others, and thus the directions of the links.
    """
    p, total = chain.p, chain.total_length
    ends = p.initial_ends
    check_chord(chain, ends[1] - ends[0])
    # initial guess: an elastic catenary stiff enough to be close to the rigid one
    stiff = replace(p, stiffness=max(p.stiffness, 1e7 * load_plane(p).load * total))
    statics = solve_statics(stiff, "unstretched_length", total)
    forces, tension, gap = link_forces(chain, statics, np.inf, 1e-300)
    # on one line, in which rigid links do not give way, no force is determined
    spread = np.linalg.svd(forces, compute_uv=False)
    if not gap <= gap_tolerance(chain) or not tension.min() > 0.0 or spread[1] <= STRAIGHT * spread[0]:
        left = f" (a gap of {gap:.2g} m is left)" if np.isfinite(gap) else ""
        raise SceneError(
            f"chain: no rest of rigid links found{left}; allowed: a scene whose chain is neither straight nor folded on itself "
            "at rest, or a start from initial.points"
        )
    reach = chain.length[:, None] * forces / tension[:, None]
    return ends[0] + np.concatenate([np.zeros((1, p.dims)), np.cumsum(reach, axis=0)]), tension


def check_chord(chain: LumpedChain, chord: np.ndarray) -> None:
    """Refuse an initial chord (dims,) [m] that is not shorter than the chain."""
    distance, total = float(np.hypot.reduce(chord)), chain.total_length
    is_straight = chain.p.free_end is None and distance >= total * (1.0 - STRAIGHT)
    if distance > total * (1.0 + LENGTH_TOLERANCE) or is_straight:
        raise SceneError(
            f"ends: given {distance:.9g} m apart at the start, {_lengthened(distance, total)} the length of the rigid links; "
            f"allowed: less than {total:.9g} m (cable.{chain.p.length_key} makes it so long), as rigid links do not stretch"
        )


def _lengthened(length: float, total: float) -> str:
    """Compare a length with `total` in words."""
    if abs(length - total) <= 1e-9 * total:
        return "just"
    more_or_less = "more" if length > total else "less"
    return f"{abs(length - total):.3g} m ({abs(length / total - 1.0):.3g} of it) {more_or_less} than"


# --- starts ---------------------------------------------------------------------------------------------------------


def start(chain: LumpedChain) -> np.ndarray:
    """Return the initial positions of a run (n + 1, dims) [m], with link lengths to LENGTH_TOLERANCE."""
    p = chain.p
    for key in ("top_tension", "unstretched_length"):
        if key in p.initial:
            length = solve_statics(p, key, p.initial[key], prefix="initial")[0]
            if abs(length / chain.total_length - 1.0) > LENGTH_TOLERANCE:
                raise scene_error(
                    f"initial.{key}",
                    p.initial[key],
                    f"equilibrium or initial.points, as the links of that shape are {_lengthened(length, chain.total_length)} "
                    "these rigid ones all together",
                )
    chord = float(np.hypot.reduce(np.diff(p.initial_ends, axis=0)[0]))
    if "points" in p.initial:
        position = place_on_polyline(chain, np.asarray(p.initial["points"], dtype=float))
    elif p.free_end is not None and abs(chord / chain.total_length - 1.0) <= LENGTH_TOLERANCE:
        position = march_links(chain, p.initial_ends)
    else:
        position = rest_shape(chain)[0]
    _check_lengths(chain, position)
    return position


def _check_lengths(chain: LumpedChain, position: np.ndarray) -> None:
    """Refuse positions (n + 1, dims) [m] with a link of the wrong length."""
    relative = np.sqrt(square(np.diff(position, axis=0))) / chain.length - 1.0
    worst = int(np.argmax(np.abs(relative)))
    if not abs(relative[worst]) <= LENGTH_TOLERANCE:
        length = chain.length[worst] * (1.0 + relative[worst])
        raise SceneError(
            f"initial.points: given points that leave link {worst + 1} a length of {length:.12g} m, "
            f"{_lengthened(length, float(chain.length[worst]))} its own; allowed: {chain.length[worst]:.12g} m to within a "
            f"part of {LENGTH_TOLERANCE:g}, as rigid links do not stretch"
        )


def place_on_polyline(chain: LumpedChain, line: np.ndarray) -> np.ndarray:
    """Place the particles on a polyline (points, dims) [m]: one on each point, or by the link lengths.

    Towards a free end, each particle lies on the line at a link's length from the last particle; the last segment is extended if
    the links cut corners.  Between two held ends this does not close in general: the particles are placed by unstretched length
    and then moved by the smallest corrections that give the links their lengths.
    """
    p = chain.p
    ends = p.initial_ends
    for index, end in ((0, "lower"), (-1, "upper")):
        if p.free_end != end:
            line[index] = ends[index]
    if len(line) == chain.links + 1:
        return line
    reach = np.concatenate([[0.0], np.cumsum(np.sqrt(square(np.diff(line, axis=0))))])
    total = chain.total_length
    if p.free_end is not None:
        if reach[-1] < total * (1.0 - LENGTH_TOLERANCE):
            raise SceneError(
                f"initial.points: given a line of {reach[-1]:.9g} m; allowed: at least the length of the links, {total:.9g} m, "
                "so that the free end can lie on it"
            )
        return march_links(chain, line)
    if reach[-1] > total * (1.0 + LENGTH_TOLERANCE) or reach[-1] < total * (1.0 - MAX_DEFICIT):
        raise SceneError(
            f"initial.points: given a line of {reach[-1]:.9g} m between the held ends, {_lengthened(float(reach[-1]), total)} "
            f"the length of the rigid links; allowed: {total:.9g} m, or up to {MAX_DEFICIT:.0%} less for the corners that "
            "links cut"
        )
    place = chain.arc_length / total * reach[-1]
    position = np.stack([np.interp(place, reach, line[:, c]) for c in range(p.dims)], axis=1)
    position[[0, -1]] = ends
    return project_lengths(chain, position)


def march_links(chain: LumpedChain, line: np.ndarray) -> np.ndarray:
    """Place link after link on a polyline from the held end on, each with its own length."""
    backwards = chain.p.free_end == "lower"
    line, length = (line[::-1], chain.length[::-1]) if backwards else (line, chain.length)
    line = line[np.concatenate([[True], np.any(np.diff(line, axis=0) != 0.0, axis=1)])]
    beyond = line[-1] + (line[-1] - line[-2]) * (2.0 * chain.total_length / np.linalg.norm(line[-1] - line[-2]))
    line = np.concatenate([line[:-1], beyond[None]])
    position = np.empty((chain.links + 1, chain.p.dims))
    position[0] = line[0]
    segment = 0
    for j, link in enumerate(length):
        # the next particle lies on the first segment that ends beyond a link's length
        while segment < len(line) - 2 and math.dist(line[segment + 1], position[j]) < link * (1.0 - 1e-12):
            segment += 1
        a, d = line[segment] - position[j], line[segment + 1] - line[segment]
        # the larger t with |a + t d| = link
        dd, ad, aa = float(d @ d), float(a @ d), float(a @ a) - float(link) ** 2
        step = a + (-ad + math.sqrt(max(ad * ad - dd * aa, 0.0))) / dd * d
        position[j + 1] = position[j] + step * (float(link) / float(np.sqrt(square(step))))
    return position[::-1].copy() if backwards else position


def project_lengths(chain: LumpedChain, position: np.ndarray) -> np.ndarray:
    """Move the inner particles by the smallest corrections that give all links their lengths (Gauss-Newton)."""
    inner = np.zeros(chain.links + 1)
    inner[1:-1] = 1.0
    from scipy.linalg import solveh_banded  # takes longer to import than a short run

    for _ in range(50):
        reach = np.diff(position, axis=0)
        stretched = np.sqrt(square(reach))
        error = stretched - chain.length
        if np.abs(error / chain.length).max() <= 1e-13:
            break
        unit = reach / stretched[:, None]
        band = np.zeros((2, chain.links))
        band[1] = inner[:-1] + inner[1:]
        band[0, 1:] = -inner[1:-1] * np.einsum("ij,ij->i", unit[:-1], unit[1:])
        try:
            force = solveh_banded(band, error)[:, None] * unit
        except np.linalg.LinAlgError:
            break  # a straight chain, which the check of the lengths refuses
        zero = np.zeros((1, chain.p.dims))
        position = position + inner[:, None] * np.diff(np.concatenate([zero, force, zero]), axis=0)
    return position
