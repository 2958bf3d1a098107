"""Initial shape of a chain: equilibrium between its ends, or particles on a given line."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from cablepod.catenary._end_force import GAP_RTOL, force_to_reach
from cablepod.catenary._statics import load_plane, solve_statics
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.discretisation._formulas import green_tangent
from cablepod.discretisation._laws import strain_at
from cablepod.errors import SceneError

if TYPE_CHECKING:
    from cablepod.chain._air import ChainAir

#: Relative tolerance of the shape at rest in wind, and maximum number of iterations of the drag on it.
DRAG_RTOL, MAX_DRAG_ITERATIONS = 1e-13, 200


def rest_shape(chain: LumpedChain, air: ChainAir | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n + 1, dims) [m] and tensions (n,) [N] of a chain at rest, in the wind of the start."""
    position, tension, force = _rest_under(chain, None)
    if air is None:
        return position, tension
    for _ in range(MAX_DRAG_ITERATIONS):
        before, drag = position, air.at_rest(position)
        if not drag.any():  # with a ramp, from still air
            break
        position, tension, force = _rest_under(chain, drag, force)
        if np.abs(position - before).max() <= DRAG_RTOL * chain.total_length:
            break
    else:
        refuse_rest_in_wind()
    return position, tension


def refuse_rest_in_wind() -> NoReturn:
    """Refuse a wind in which drag and shape do not settle."""
    raise SceneError(
        "wind: no rest found in this wind; allowed: a wind that the cable withstands, or wind.ramp above 0"
    )


def _rest_under(
    chain: LumpedChain, drag: np.ndarray | None, guess: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions, tensions and the force in the first link at rest under the loads and a given drag (n + 1, dims) [N]."""
    p = chain.p
    ends = p.end_positions(np.zeros(1))[0]
    forces, tension, gap = link_forces(chain, chain.statics, chain.axial_stiffness, 1e-6 * p.stiffness, drag, guess)
    if not gap <= gap_tolerance(chain) or not tension.min() > 0.0:
        left = f" (a gap of {gap:.2g} m is left)" if np.isfinite(gap) else ""
        raise SceneError(
            f"chain: no rest found with all links taut{left}; allowed: a scene whose chain does not fold on itself at rest and "
            f"is not far softer than its loads (its stiffness is {p.stiffness:.3g} N), or a start from initial.points"
        )
    stretch = 1.0 + strain_at(tension, chain.axial_stiffness, green=chain.green)
    reach = (chain.length * stretch / tension)[:, None] * forces
    position = ends[0] + np.concatenate([np.zeros((1, p.dims)), np.cumsum(reach, axis=0)])
    position[-1] = ends[1]
    return position, tension, forces[0]


def gap_tolerance(chain: LumpedChain) -> float:
    """Return the largest gap at an end of links at rest that counts as rounding [m]."""
    return GAP_RTOL * max(float(np.linalg.norm(chain.p.initial_ends[1] - chain.p.initial_ends[0])), chain.total_length)


def link_forces(
    chain: LumpedChain,
    statics: np.ndarray,
    stiffness: Any,
    least: float,
    drag: np.ndarray | None = None,
    guess: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Solve for the force in the first link at rest, which determines all others.

    Parameters
    ----------
    chain
        Links and loads.
    statics
        Of a catenary near the chain, whose force is the first guess.
    stiffness
        Axial stiffness of the links [N], one number or (n,); infinite for rigid ones.
    least
        Least force of a guess along the chord [N], for a catenary without tension, as without weight.
    drag
        Further forces on the particles (n + 1, dims) [N].
    guess
        First guess in place of that force (dims,) [N], as of nearly the same drag.

    Returns
    -------
    tuple
        Forces (n, dims) and tensions (n,) [N] of the links, and the gap left at the upper end [m].
    """
    ends, dims = chain.p.initial_ends, chain.p.dims
    chord = ends[1] - ends[0]
    loads = chain.loads(0.0)[1:-1] if drag is None else (chain.loads(0.0) + drag)[1:-1]
    _, _, _, q, across, against = load_plane(chain.p)
    force = statics[2] * across + (statics[3] - 0.5 * q * (chain.total_length - chain.length[0])) * against
    force = force if guess is None else guess
    if not np.isfinite(force).all() or not force.any():
        force = chord / np.linalg.norm(chord) * max(float(np.abs(loads).sum()), least)
    # three coordinates, so that planar and spatial scenes have the same bits
    drops = np.zeros((chain.links, 3))
    np.cumsum(loads, axis=0, out=drops[1:, :dims])
    in_space = np.zeros((2, 3))
    in_space[:, :dims] = chord, force

    def reach_of(force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return reach_of_links(force - drops, chain.length, stiffness, green=chain.green)

    first, gap = force_to_reach(reach_of, in_space[0], in_space[1], gap_tolerance(chain))
    forces = (first - drops)[:, :dims]
    return forces, np.sqrt(square(forces)), gap


def reach_of_links(
    forces: np.ndarray, length: np.ndarray, stiffness: Any, *, green: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the upper from the lower end of links [m], and the derivative by one force along all of them (3, 3) [m/N].

    Parameters
    ----------
    forces
        Of the links (n, 3) [N]; one without a force has no length here.
    length, stiffness
        Unstretched lengths (n,) [m] and axial stiffness [N], one number or (n,).
    green
        Whether law (21) holds in place of the linear one.
    """
    tension = np.sqrt(square(forces))
    stretch = 1.0 + strain_at(tension, stiffness, green=green)
    safe = np.where(tension > 0.0, tension, np.inf)
    unit, stretched = forces / safe[:, None], length * stretch
    lateral = stretched / safe
    along = length / (green_tangent(stretch**2, stiffness) if green else stiffness)
    return stretched @ unit, lateral.sum() * np.eye(3) - ((lateral - along) * unit.T) @ unit


def start(chain: LumpedChain, air: ChainAir | None = None) -> np.ndarray:
    """Return the initial positions of a run (n + 1, dims) [m], by the scene's initial table or at rest in the wind."""
    p = chain.p
    if "points" in p.initial:
        return particles_on_line(chain, np.asarray(p.initial["points"], dtype=float))
    for key in ("top_tension", "unstretched_length"):
        if key in p.initial:
            length = solve_statics(p, key, p.initial[key], prefix="initial")[0]
            factor = length / chain.total_length
            lengths = {"length": factor * chain.length, "arc_length": factor * chain.arc_length}
            return rest_shape(replace(chain, **lengths, scene_length=chain.total_length), air)[0]
    return rest_shape(chain, air)[0]


def particles_on_line(chain: LumpedChain, line: np.ndarray) -> np.ndarray:
    """Place the particles on a polyline (points, dims) [m]: one on each point, or by unstretched length.

    Between two held ends arc length and unstretched length are proportional; otherwise they are equal from the held end on.
    """
    if len(line) == chain.links + 1:
        position = line.copy()
    else:
        reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        place = chain.arc_length / chain.total_length * reach[-1]
        if chain.p.free_end is not None:
            spare = reach[-1] - chain.total_length
            if spare < -1e-9 * chain.total_length:
                raise SceneError(
                    f"initial.points: given a line of {reach[-1]:.9g} m; allowed: at least the unstretched length, "
                    f"{chain.total_length:.9g} m, so that the free end can lie on it"
                )
            place = chain.arc_length + (spare if chain.p.free_end == "lower" else 0.0)
        position = np.stack([np.interp(place, reach, line[:, c]) for c in range(line.shape[1])], axis=1)
    ends = chain.p.end_positions(np.zeros(1))[0]
    for index, end in ((0, "lower"), (-1, "upper")):
        if chain.p.free_end != end:
            position[index] = ends[index]
    return position
