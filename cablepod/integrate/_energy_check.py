"""Energy check of a run: strain energy against what start, loads and ends can have supplied.

The stability limit of the step holds for taut links.  Where links slacken and snap taut, explicit runs well below it may gain
energy in every snap, and stay finite because slack links do not pull: finite numbers may be garbage too.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod.discretisation._chain import LumpedChain, square

#: Strain energy over what rest, loads and ends can explain: a run above the second number has broken down, one above the first is
#: suspect (resonance, or a step too long for links that slacken and snap taut).  Sound runs of hard cases stay below 1.
ENERGY_WARN, ENERGY_STOP = 10.0, 1e3
#: Strain energy over what start, loads and ends have put in until then, for which positions and tensions of the run count: never
#: above 1 but for what happens between two instants and the error of the scheme; garbage of the hardest scenes has 12 and more.
#: Not looked at below the second number times what can be put in at all, where rounding and small errors decide.
EXCESS_STOP, EXCESS_FLOOR = 10.0, 1e-2
#: Instants at which the way of the ends and the variation of the loads are added up: in a period or ramp, and at most.
POINTS_PER_CHANGE, MAX_POINTS = 16.0, 1_000_000


def check_energy(
    chain: LumpedChain, initial: np.ndarray, run_times: np.ndarray, times: np.ndarray, position: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compare the strain energy of a run with what can have been supplied.

    Parameters
    ----------
    chain
        Links and loads.
    initial
        Positions at the start (n + 1, dims) [m].
    run_times, times
        Instants that the run was asked for and those of `position` [s].
    position
        Positions (times, n + 1, dims) [m].

    Returns
    -------
    energy
        Strain energy (times,) [J].
    excess
        Its ratio to the energy at hand over the whole run (times,).
    broken
        The ratio that shows that the run broke down, 0 where it did not (times,).
    """
    energy = chain.strain_energy(position)
    at_hand = energy_at_hand(chain, initial, run_times)
    excess = energy / at_hand
    broken, worst = excess > ENERGY_STOP, excess
    if excess.max(initial=0.0) > EXCESS_FLOOR:
        supplied = energy_supplied(chain, initial, times, position) + EXCESS_FLOOR / EXCESS_STOP * at_hand
        broken = broken | (energy > EXCESS_STOP * supplied)
        worst = np.maximum(excess, energy / supplied)
    return energy, excess, np.where(broken, worst, 0.0)


def energy_at_hand(chain: LumpedChain, initial: np.ndarray, times: np.ndarray) -> float:
    """Energy that the start, the loads over the length of the cable, and the distance of the ends can put into links [J]."""
    p = chain.p
    loads = np.abs(chain.loads()).sum() + sum(
        float(np.abs(factor(times)).max() * np.abs(pattern).sum()) for pattern, factor in chain.time_dependent_loads()
    )
    reach = chain.total_length + float(np.abs(np.diff(initial[[0, -1]], axis=0)).sum())
    grid = np.linspace(0.0, float(times[-1]), 1001)
    ends, speed = p.end_positions(grid), math.sqrt(square(p.end_positions(grid, 1)).max())
    drawn = 0.0
    if p.free_end is None:
        drawn = max(math.sqrt(square(ends[:, 1] - ends[:, 0]).max()) / chain.total_length - 1.0, 0.0)
    enforced = 0.5 * p.stiffness * chain.total_length * (drawn + 1.5 * drawn**2) ** 2
    pushed = 0.5 * p.mass * chain.total_length * speed**2
    return float(chain.strain_energy(initial[None])[0]) + float(loads) * reach + enforced + pushed + 1e-300


def energy_supplied(chain: LumpedChain, initial: np.ndarray, times: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Most energy that the start, the loads, and the ends on their way can have put in until each instant (times,) [J].

    Constant loads have done the work that the positions show.  A load that varies does no more, by partial integration, than
    its variation times the reach, and an end no more than its way times the largest tension beside it.
    """
    p = chain.p
    total = float(chain.strain_energy(initial[None])[0]) + np.maximum(
        np.sum((position - initial) * chain.loads(), axis=(1, 2)), 0.0
    )
    until = float(times[-1])
    count = int(min(max(1000.0, math.ceil(POINTS_PER_CHANGE * until / p.shortest_time_scale)), MAX_POINTS))
    grid = np.linspace(0.0, until, count + 1)

    def added_up(steps: np.ndarray) -> np.ndarray:
        return np.interp(times, grid, np.concatenate([[0.0], np.cumsum(steps)]))

    if p.motions:
        way = np.sqrt(square(np.diff(p.end_positions(grid), axis=0))).sum(axis=1)
        tension = np.abs(chain.tensions_and_forces(position)[0])
        # the mean of all, as at few instants that of the end may be missed
        beside = np.maximum(tension[:, [0, -1]].max(axis=1), tension.mean(axis=1))
        total = total + added_up(way) * np.maximum.accumulate(beside)
    reach = chain.total_length + float(np.abs(np.diff(initial[[0, -1]], axis=0)).sum())
    for pattern, factor in chain.time_dependent_loads():
        total = (
            total + (np.abs(factor(times)) + added_up(np.abs(np.diff(factor(grid))))) * np.abs(pattern).sum() * reach
        )
    return total
