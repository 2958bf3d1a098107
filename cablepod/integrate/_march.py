"""Advance a state in blocks, watching for the loss of finite numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Steps between two looks at the state: few enough to stop early, many enough to cost nothing.
BLOCK = 65536


def advance_in_blocks(
    advance: Callable[[int, int], bool],
    state: tuple[np.ndarray, ...],
    total: int,
    progress: Callable[[float], None] | None,
) -> int | None:
    """Advance a state by `total` steps in blocks, looking at it between them.

    Parameters
    ----------
    advance
        Takes the number of the first step and how many, changes `state`, tells whether it is still sound.
    state
        All arrays that a step changes.
    total
        Number of steps.
    progress
        Called with the part that is done.

    Returns
    -------
    int or None
        The step that left the finite numbers, None where none did.
    """
    done = 0
    while done < total:
        steps = min(BLOCK, total - done)
        keep = [array.copy() for array in state]
        if not advance(done, steps):
            for target, source in zip(state, keep, strict=True):
                target[:] = source
            end = done + steps
            while done < end and advance(done, 1):  # once more, step by step, to say when
                done += 1
            if done < end:
                return done
            # iterations that begin anew at each step may succeed where those of the block did not
        else:
            done += steps
        if progress is not None:
            progress(done / total)
    return None
