"""Measure the run time of calls, compilation apart."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import xarray as xr

#: Calls of at most this wall time [s] are repeated.
LONGEST_REPEATED = 3.0
#: Maximum number of repeats; they end sooner when all of them together take this time [s].
REPEATS, REPEAT_SECONDS = 3, 0.05


def timed(
    call: Callable[..., xr.Dataset],
    *,
    progress: Callable[[float], None] | None = None,
    say: Callable[[], None] | None = None,
) -> tuple[xr.Dataset, dict[str, float]]:
    """Call for the result, and again for the run time.

    The median of the repeats counts, because the first call compiles kernels or loads them from the cache on disk.  A long call
    is not repeated; its time is that of the first without compilation.

    Parameters
    ----------
    call
        Takes the keyword `progress`.
    progress
        Callback of the first call, receiving the completed fraction, 0 to 1.
    say
        Called when a compilation begins.

    Returns
    -------
    tuple
        The result, and ``call_time`` and ``compile_time`` [s].
    """
    from numba.core import event  # numba is imported only to compute

    compile_seconds = depth = begun = 0.0

    class Listener(event.Listener):
        """Clock of the outermost compilation; kernels from the cache on disk are none."""

        def on_start(self, event: Any) -> None:
            nonlocal depth, begun
            if depth == 0:
                begun = time.perf_counter()
                if say is not None:
                    say()
            depth += 1

        def on_end(self, event: Any) -> None:
            nonlocal depth, compile_seconds
            depth -= 1
            if depth == 0:
                compile_seconds += time.perf_counter() - begun

    with event.install_listener("numba:compile", Listener()):
        result, seconds = _clocked(partial(call, progress=progress))
    seconds -= compile_seconds
    if seconds > LONGEST_REPEATED:
        return result, {"call_time": seconds, "compile_time": compile_seconds}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the first call has warned
        repeats = [_clocked(call)[1]]
        while len(repeats) < REPEATS and sum(repeats) + repeats[-1] <= REPEAT_SECONDS:
            repeats.append(_clocked(call)[1])
    return result, {"call_time": median(repeats), "compile_time": compile_seconds}


def _clocked(call: Callable[..., xr.Dataset]) -> tuple[xr.Dataset, float]:
    """Return the result of a call and its wall time [s]."""
    begin = time.perf_counter()
    result = call()
    return result, time.perf_counter() - begin
