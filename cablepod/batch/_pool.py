"""Threads over items, which end soon after Ctrl-C or a failure."""

from __future__ import annotations

import concurrent.futures
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor
from typing import Any

from cablepod.batch._sigint import LOOK_EVERY, check_sigint, defer_sigint


def map_threads(
    function: Callable[[Any], Any],
    items: Iterable[Any],
    workers: int,
    *,
    ended: Callable[[], None] = lambda: None,
    done: Callable[[int], None] = lambda count: None,
) -> list[Any]:
    """Call a function for each item, in threads; after Ctrl-C or a failure what has not begun does not begin.

    Parameters
    ----------
    function, items
        What is called, and with what.
    workers
        Number of threads.
    ended
        Called when no more results are wanted, for those at work to end soon.
    done
        Told now and then how many items are done.

    Returns
    -------
    list
        Results, in the order of the items.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C, when what is at hand has ended.
    Exception
        What an item raised that failed.
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
    # what others raise because they were asked to end is not why
    return [future.result() for future in (filter(ready.__contains__, futures) if failed else futures)]
