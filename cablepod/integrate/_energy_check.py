"""Energy check of a run: strain energy against a bound of the energy supplied by start, loads and ends.

The stability limit of the step holds for taut links.  Where links slacken and snap taut, explicit runs well below it may gain
energy in every snap.  They stay finite because slack links carry no force, so that finite numbers alone prove nothing.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod.discretisation._chain import LumpedChain, square

#: Strain energy over its bound for the whole run, above which a run is warned of (resonance, or a step too long for links that
#: slacken and snap taut) and above which it is stopped.  Valid runs of hard cases stay below 1.
ENERGY_WARN, ENERGY_STOP = 10.0, 1e3
#: Strain energy over its bound at the instant, from positions and tensions of the run, above which a run is stopped.  Valid runs
#: exceed 1 only by what happens between two output times and by the error of the scheme; broken runs of hard scenes have 12 and
#: more.  Below the second number times the bound for the whole run, rounding and small errors decide, and nothing is checked.
EXCESS_STOP, EXCESS_FLOOR = 10.0, 1e-2
#: Quadrature points per period or ramp for end paths and load variation, and their maximum number.
POINTS_PER_CHANGE, MAX_POINTS = 16.0, 1_000_000


def check_energy(
    chain: LumpedChain,
    initial: np.ndarray,
    run_bound: float,
    times: np.ndarray,
    position: np.ndarray,
    held_energy: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compare the strain energy of a run with the bounds of the supplied energy.

    Parameters
    ----------
    chain
        Links and loads.
    initial
        Positions at the start (n + 1, dims) [m].
    run_bound
        Bound of the energy supplied over the whole run [J], from :func:`max_energy_of_run`.
    times
        Times of `position` [s].
    position
        Positions (times, n + 1, dims) [m].
    held_energy
        Energy of springs to the ground at the start [J].

    Returns
    -------
    energy
        Strain energy (times,) [J].
    excess
        Ratio to the bound for the whole run (times,).
    broken
        Ratio at the instants at which the run has broken down, 0 at all others (times,).
    """
    energy = chain.strain_energy(position)
    excess = energy / run_bound
    broken, worst = excess > ENERGY_STOP, excess
    if excess.max(initial=0.0) > EXCESS_FLOOR:
        bound = max_energy_until(chain, initial, times, position) + held_energy
        bound = bound + EXCESS_FLOOR / EXCESS_STOP * run_bound
        broken = broken | (energy > EXCESS_STOP * bound)
        worst = np.maximum(excess, energy / bound)
    return energy, excess, np.where(broken, worst, 0.0)


def max_energy_of_run(chain: LumpedChain, initial: np.ndarray, times: np.ndarray) -> float:
    """Bound the energy that start, loads and ends can supply to the links over a whole run [J]."""
    p = chain.p
    loads = np.abs(chain.loads()).sum() + sum(
        float(np.abs(factor(times)).max() * np.abs(pattern).sum()) for pattern, factor in chain.time_dependent_loads()
    )
    reach = chain.total_length + float(np.abs(np.diff(initial[[0, -1]], axis=0)).sum())
    grid = np.linspace(0.0, float(times[-1]), 1001)
    ends, speed = p.end_positions(grid), math.sqrt(square(p.end_positions(grid, 1)).max())
    strain = 0.0
    if p.free_end is None:
        strain = max(math.sqrt(square(ends[:, 1] - ends[:, 0]).max()) / chain.total_length - 1.0, 0.0)
    enforced = 0.5 * p.stiffness * chain.total_length * (strain + 1.5 * strain**2) ** 2
    kinetic = 0.5 * p.mass * chain.total_length * speed**2
    return float(chain.strain_energy(initial[None])[0]) + float(loads) * reach + enforced + kinetic + 1e-300


def max_energy_until(chain: LumpedChain, initial: np.ndarray, times: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Bound the energy that start, loads and ends have supplied until each instant (times,) [J].

    The work of constant loads follows from the positions.  That of a time-dependent load is at most, by partial integration, its
    variation times the reach; that of an end is at most the length of its path times the largest tension beside it.
    """
    p = chain.p
    total = float(chain.strain_energy(initial[None])[0]) + np.maximum(
        np.sum((position - initial) * chain.loads(), axis=(1, 2)), 0.0
    )
    end_time = float(times[-1])
    count = int(min(max(1000.0, math.ceil(POINTS_PER_CHANGE * end_time / p.shortest_time_scale)), MAX_POINTS))
    grid = np.linspace(0.0, end_time, count + 1)

    def cumulative(increments: np.ndarray) -> np.ndarray:
        return np.interp(times, grid, np.concatenate([[0.0], np.cumsum(increments)]))

    if p.motions:
        path = np.sqrt(square(np.diff(p.end_positions(grid), axis=0))).sum(axis=1)
        tension = np.abs(chain.tensions_and_forces(position)[0])
        # the mean of all links too: with few output times the largest tension at the ends may be missed
        beside = np.maximum(tension[:, [0, -1]].max(axis=1), tension.mean(axis=1))
        total = total + cumulative(path) * np.maximum.accumulate(beside)
    reach = chain.total_length + float(np.abs(np.diff(initial[[0, -1]], axis=0)).sum())
    for pattern, factor in chain.time_dependent_loads():
        total = (
            total + (np.abs(factor(times)) + cumulative(np.abs(np.diff(factor(grid))))) * np.abs(pattern).sum() * reach
        )
    return total
