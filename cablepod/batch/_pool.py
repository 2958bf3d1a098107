"""Map a function over items in threads, with early end after Ctrl-C or a failure."""

from __future__ import annotations

import concurrent.futures
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor
from typing import Any

from cablepod._resources import LOOK_EVERY, check_sigint, defer_sigint


def map_threads(
    function: Callable[[Any], Any],
    items: Iterable[Any],
    workers: int,
    *,
    ended: Callable[[], None] = lambda: None,
    done: Callable[[int], None] = lambda count: None,
) -> list[Any]:
    """Map a function over items in threads; after Ctrl-C or a failure no further item starts.

    Parameters
    ----------
    function, items
        Function of one argument, and its arguments.
    workers
        Number of threads.
    ended
        Called at the end, also after Ctrl-C or a failure, so that running items can return early.
    done
        Callback receiving the number of completed items.

    Returns
    -------
    list
        Results, in the order of the items.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C, when the running items have ended.
    Exception
        The exception of a failed item.
    """
    with defer_sigint(), ThreadPoolExecutor(workers, thread_name_prefix="cablepod") as pool:
        futures = [pool.submit(function, item) for item in items]
        try:
            failed, ready = False, set[Future[Any]]()
            while len(ready) < len(futures) and not failed:
                check_sigint()
                ready, _ = concurrent.futures.wait(futures, LOOK_EVERY, FIRST_EXCEPTION)
                failed = any(future.exception() is not None for future in ready)
                done(len(ready))
        finally:
            ended()
            pool.shutdown(wait=False, cancel_futures=True)
    # only items that ended before the failure was seen: later ones may fail because of `ended`
    return [future.result() for future in (filter(ready.__contains__, futures) if failed else futures)]
