"""Advance a state in blocks up to the first step that is no longer finite, and cut steps that do not converge."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Steps between two checks of the state (few enough to stop early, many enough to cost nothing).
BLOCK = 65536
#: Maximum number of substeps of a step in which Newton's method does not converge.
MAX_SUBSTEPS = 1024


def advance_in_blocks(
    advance: Callable[[int, int], bool],
    state: tuple[np.ndarray, ...],
    total: int,
    progress: Callable[[float], None] | None,
) -> int | None:
    """Advance a state by `total` steps in blocks, with a check after each block.

    Parameters
    ----------
    advance
        Takes the number of the first step and the number of steps, changes `state`, returns whether it is still finite.
    state
        All arrays that a step changes.
    total
        Number of steps.
    progress
        Callback receiving the completed fraction, 0 to 1.

    Returns
    -------
    int or None
        The step after which the state is not finite, None if there is none.
    """
    done = 0
    while done < total:
        steps = min(BLOCK, total - done)
        before = [array.copy() for array in state]
        if not advance(done, steps):
            _restore(state, before)
            end = done + steps
            while done < end and advance(done, 1):  # repeat step by step to find the failing one
                done += 1
            if done < end:
                return done
            # Newton's method restarts at each step here, and may converge where it did not within the block
        else:
            done += steps
        if progress is not None:
            progress(done / total)
    return None


def cut_step(take: Callable[[int], int], state: tuple[np.ndarray, ...], substeps: int = 2) -> bool:
    """Repeat a step in `substeps`, then each time four times as many, until all of them converge.

    Parameters
    ----------
    take
        Takes a number of substeps, changes `state`, returns how many it took.
    state
        All arrays that a step changes; unchanged if no number of substeps converges.
    substeps
        The first number.

    Returns
    -------
    bool
        Whether the substeps converged.
    """
    before = [array.copy() for array in state]
    while substeps <= MAX_SUBSTEPS:
        if take(substeps) == substeps:
            return True
        _restore(state, before)
        substeps *= 4
    return False


def not_converged() -> str:
    """Describe a step that :func:`cut_step` gave up, as the beginning of a message."""
    return f"Newton's method did not converge, with the step cut into {MAX_SUBSTEPS},"


def _restore(state: tuple[np.ndarray, ...], before: list[np.ndarray]) -> None:
    """Set the arrays of a state back to copies made before."""
    for target, source in zip(state, before, strict=True):
        target[:] = source
