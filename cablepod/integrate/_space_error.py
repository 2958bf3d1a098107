"""Estimate of the error in space, from a companion run with fewer links or elements."""

from __future__ import annotations

import math
from typing import Any

from cablepod.discretisation._chain import square
from cablepod.discretisation._interpolation import at_places

#: Links of a companion over those of the run, and the same of implicit steps that are given and of explicit ones close to their
#: limit: a run with a given step is one run and not the last of several, and either costs about half as much.  With half of the
#: links in all runs a companion may lose the phase of a motion that the run holds: the estimate falls to a third of the error.
COARSER, COARSER_OF_ONE = 0.6, 0.5
#: Steps per second of a companion over those of a run with a given step: of explicit steps if they are stable, and of implicit
#: ones, which are as long as their error admits.
FEWER_STEPS, FEWER_IMPLICIT_STEPS = 0.4, 0.5
#: Number of output times from which an implicit companion of a given step has every second one, which twice as long steps meet:
#: to interpolate between steps takes as long as to make them.
MANY_TIMES = 100
#: Newton tolerance of an implicit companion over that of a run: its longer steps then need no more iterations.  What a correction
#: leaves grows with its square, so that the tension is right to 1e-7 in place of 1e-10, for a distance of which two digits are
#: wanted.
COMPANION_NEWTON = 30.0
#: Largest part of the stability limit that steps of a companion are lengthened to, and part above which steps are close to it.
MOST_OF_LIMIT, CLOSE_TO_LIMIT = 0.9, 0.65
#: Largest error of the motion over that of the load of gusts on the first vibration, by the places of the particles (1.2 to 1.9).
MOTION_OVER_SAMPLING = 1.9
#: Loops over links vectorise best with multiples of this number.
LANES = 8


def companion_cells(cells: int, part_of_limit: float | None, *, is_given: bool) -> int:
    """Return the number of links or elements of a companion.

    Parameters
    ----------
    cells
        Links or elements of the run.
    part_of_limit
        Step over the stability limit; None for implicit steps, which have none.
    is_given
        Whether the step is given.
    """
    is_long = part_of_limit is None or part_of_limit > CLOSE_TO_LIMIT
    fewer = math.floor((COARSER_OF_ONE if is_given and is_long else COARSER) * cells)
    return fewer if part_of_limit is None or fewer < 2 * LANES else fewer - fewer % LANES


def companion_steps(least: float, part_of_limit: float | None, limits: float) -> float:
    """Return the steps per second of a companion over those of the run: the least ones wanted, or as many as are stable.

    Parameters
    ----------
    least
        Wanted.
    part_of_limit
        Step of the run over its stability limit, which a companion may have too; None for implicit steps.
    limits
        Stability limit of the run over that of the companion.
    """
    if part_of_limit is None:
        return least
    return max(least, part_of_limit / max(part_of_limit, MOST_OF_LIMIT) * limits)


def distance_of(coarse: Any, coarse_state: Any, run: Any, state: Any, every: int = 1) -> float:
    """Return the largest rms distance of two runs over the particles of the coarser one, over the motion of the finer one.

    The coarser one has one of `every` so many output times of the finer one.
    """
    places, known = (of.chain.arc_length / of.chain.total_length for of in (coarse, run))
    gap = at_places(places, known, state.position[::every]) - coarse_state.position
    return math.sqrt(float(square(gap).mean(axis=-1).max())) / run.motion(state)


def extrapolated(distance: float, refinement: float, order: int = 2) -> float:
    """Return the error of the finer of two runs whose cells are `refinement` times shorter, by the order in space."""
    return distance / (refinement**order - 1.0)
