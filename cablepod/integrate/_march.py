"""Advance a state in blocks up to the first step that fails, and cut steps that do not converge."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cablepod.integrate._peaks import Watch, restore

#: Steps between two checks of the state (few enough to stop early, many enough to cost nothing).
BLOCK = 65536
#: Parts in which a block that fails is repeated, and each part of it that fails again, down to one step.
PARTS = 16
#: Maximum number of substeps of a step in which Newton's method does not converge.
MAX_SUBSTEPS = 1024


def advance_in_blocks(
    advance: Callable[[int, int], bool],
    state: tuple[np.ndarray, ...],
    total: int,
    progress: Callable[[float], None] | None,
    watch: Watch | None = None,
) -> int | None:
    """Advance a state by `total` steps in blocks, with a check after each block.

    A block that fails is repeated in parts to find the step, which costs about as much as the block itself.  An implicit scheme
    starts anew at each part, and may converge where it did not within the block.

    Parameters
    ----------
    advance
        Takes the number of the first step and the number of steps, changes `state`, returns whether all steps were taken and
        `state` is still finite.
    state
        All arrays that a step changes.
    total
        Number of steps.
    progress
        Callback receiving the completed fraction, 0 to 1.
    watch
        What is done with extremes between the blocks; None for runs without.

    Returns
    -------
    int or None
        Number of the step that fails, None if none does; `state` is that which the attempt leaves.
    """
    done = 0
    while done < total:
        steps = min(BLOCK, total - done)
        before: list[np.ndarray] = []
        if watch is not None:
            steps = watch.limit(done, steps)
            before = watch.before(state)
        failed = _first_failure(advance, state, done, steps)
        if failed is not None:
            return failed
        done += steps
        if watch is not None:
            watch.after(done, steps, before)
        if progress is not None:
            progress(done / total)
    return None


def _first_failure(
    advance: Callable[[int, int], bool], state: tuple[np.ndarray, ...], start: int, steps: int
) -> int | None:
    """Advance a state by `steps` steps from step `start` on; return the number of the step that fails, None if none does."""
    before = [array.copy() for array in state]
    if advance(start, steps):
        return None
    if steps == 1:
        return start
    restore(state, before)
    part = max(steps // PARTS, 1)
    for begin in range(start, start + steps, part):
        failed = _first_failure(advance, state, begin, min(part, start + steps - begin))
        if failed is not None:
            return failed
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
        restore(state, before)
        substeps *= 4
    return False


def not_converged() -> str:
    """Describe a step that :func:`cut_step` gave up, as the beginning of a message."""
    return f"Newton's method did not converge, with the step cut into {MAX_SUBSTEPS},"
