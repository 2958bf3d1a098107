"""Advance a state in blocks and stop at the first step that is no longer finite."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Steps between two checks of the state (few enough to stop early, many enough to cost nothing).
BLOCK = 65536


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
            for target, source in zip(state, before, strict=True):
                target[:] = source
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
