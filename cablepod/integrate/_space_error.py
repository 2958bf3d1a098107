"""Estimate of the error in space, from a companion run with fewer links or elements."""

from __future__ import annotations

import math
from typing import Any

from cablepod.discretisation._chain import square
from cablepod.discretisation._interpolation import at_places

#: Links of a companion over those of the run, and over those of an implicit run with a given step, which is one run and not the
#: last of several: either costs about half as much or less.  With half of the links in all runs a companion may lose the phase of
#: a motion that the run holds, and the estimate falls to a third of the error.
COARSER, COARSER_OF_ONE = 0.6, 0.5


def distance_of(coarse: Any, coarse_state: Any, run: Any, state: Any) -> float:
    """Return the largest rms distance of two runs over the particles of the coarser one, over the motion of the finer one."""
    places, known = (of.chain.arc_length / of.chain.total_length for of in (coarse, run))
    gap = at_places(places, known, state.position) - coarse_state.position
    return math.sqrt(float(square(gap).mean(axis=-1).max())) / run.motion(state)


def extrapolated(distance: float, refinement: float, order: int = 2) -> float:
    """Return the error of the finer of two runs whose cells are `refinement` times shorter, by the order in space."""
    return distance / (refinement**order - 1.0)
