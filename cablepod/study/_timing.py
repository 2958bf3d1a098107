"""Measure the run time of calls, compilation apart."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import xarray as xr

#: Calls of at most this wall time [s] are repeated.
LONGEST_REPEATED = 3.0
#: Maximum number of repeats; they end sooner when all of them together take this time [s].
REPEATS, REPEAT_SECONDS = 2, 0.05


def timed(
    call: Callable[..., xr.Dataset],
    *,
    progress: Callable[[float], None] | None = None,
    say: Callable[[], None] | None = None,
    longest_repeated: float = LONGEST_REPEATED,
) -> tuple[xr.Dataset, dict[str, float]]:
    """Call for the result, and again for the run time.

    The fastest call counts.  Of the first call the time is left out in which kernels are compiled, or loaded from the cache on
    disk; modules that it imports remain in it.  A long call is not repeated.

    Parameters
    ----------
    call
        Takes the keyword `progress`.
    progress
        Callback of the first call, receiving the completed fraction, 0 to 1.
    say
        Called when a compilation begins.
    longest_repeated
        Wall time of the first call above which it is not repeated [s].

    Returns
    -------
    tuple
        The result, and ``call_time`` and ``compile_time`` [s].
    """
    from numba.core import event  # numba is imported only to compute

    class Compilation(event.TimingListener):
        """Clock of compilation, which says when one begins."""

        def on_start(self, begun: Any) -> None:
            if say is not None:
                say()
            super().on_start(begun)

    compilation, with_loading = Compilation(), event.TimingListener()
    with (
        event.install_listener("numba:compile", compilation),
        event.install_listener("numba:compiler_lock", with_loading),  # held also for kernels from the cache
    ):
        result, first = _clocked(partial(call, progress=progress))
    seconds = [first - (with_loading.duration if with_loading.done else 0.0)]
    if seconds[0] <= longest_repeated:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the first call has warned
            seconds.append(_clocked(call)[1])
            while len(seconds) <= REPEATS and sum(seconds[1:]) + seconds[-1] <= REPEAT_SECONDS:
                seconds.append(_clocked(call)[1])
    return result, {"call_time": min(seconds), "compile_time": compilation.duration if compilation.done else 0.0}


def _clocked(call: Callable[..., xr.Dataset]) -> tuple[xr.Dataset, float]:
    """Return the result of a call and its wall time [s]."""
    begin = time.perf_counter()
    result = call()
    return result, time.perf_counter() - begin
