"""The force at the lower end of a cable at rest that makes it reach from end to end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Gap at the upper end that is rounding, over the length of a cable or its chord.
GAP_RTOL = 1e-11
#: Relative change of the force in the last step of Newton's method, whose square bounds the error.
FORCE_RTOL = 1e-9
#: Maximum number of steps, and of halvings of one.
MAX_STEPS, MAX_HALVINGS = 100, 40


def force_to_reach(
    reach_of: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    chord: np.ndarray,
    force: np.ndarray,
    tolerance: float,
) -> tuple[np.ndarray, float]:
    """Solve for the force at the lower end by Newton's method.

    The force minimises a convex function, the complementary energy less its product with the chord: a step is halved while it
    leads far beyond the minimum along it.  Steps end where the gap is at rounding.

    Parameters
    ----------
    reach_of
        Gives the upper from the lower end (dims,) [m] for a force, and the derivative by it (dims, dims) [m/N].
    chord
        Where the upper end is (dims,) [m].
    force
        First guess (dims,) [N].
    tolerance
        Gap below which one that no longer falls is rounding [m].

    Returns
    -------
    tuple
        The force, and the largest component of the gap that is left [m]; nan where no force is determined.
    """
    with np.errstate(all="ignore"):
        reach, compliance = reach_of(force)
        gap = reach - chord
        left = float(np.abs(gap).max())
        for _ in range(MAX_STEPS):
            if not np.isfinite(left):
                break
            try:
                step = np.linalg.solve(compliance, -gap)
            except np.linalg.LinAlgError:  # no force is determined
                return force, np.nan
            beyond, before = 0.5 * abs(float(gap @ step)), left
            for halvings in range(MAX_HALVINGS):
                trial = force + 0.5**halvings * step
                reach, compliance = reach_of(trial)
                gap = reach - chord
                if float(gap @ step) <= beyond:
                    break
            left = float(np.abs(gap).max())
            if before <= tolerance and not left < before:
                return force, before
            force = trial
            if left <= tolerance and np.abs(step).max() <= FORCE_RTOL * np.abs(force).max():
                break
    return force, left
