"""Show progress bars on stderr, if it is a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any


class Bars:
    """Show one progress bar at a time."""

    def __init__(self) -> None:
        self._label: str | None = None
        self._bar: Any = None

    def __enter__(self) -> Bars:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __call__(self, label: str, fraction: float) -> None:
        """Move the bar of `label` to the completed fraction; close the bar of another label."""
        if label != self._label:
            from tqdm import tqdm  # imported here, because most commands show no bar

            self.close()
            self._label = label
            self._bar = tqdm(
                total=1.0,
                desc=label,
                disable=None,  # where stderr is not a terminal
                leave=False,
                bar_format="{desc}: {percentage:3.0f}% {bar} {elapsed}",
            )
        self._bar.update(fraction - self._bar.n)

    def close(self) -> None:
        """Remove the bar, so that output can be printed."""
        if self._bar is not None:
            self._bar.close()
        self._label = self._bar = None


@contextmanager
def member_bar(label: str, members: int) -> Iterator[Callable[[float], None]]:
    """Show a bar that counts members; yield the callback of the completed fraction."""
    from tqdm import tqdm

    with tqdm(
        total=members,
        desc=label,
        unit="member",
        disable=None,
        leave=False,
        bar_format="{desc}: {n:.0f}/{total} {bar} {elapsed}, {rate_fmt}, {remaining} left",
    ) as bar:
        begun = False

        def progress(fraction: float) -> None:
            nonlocal begun
            if not begun:  # members of an earlier run do not count for the speed
                begun, bar.initial, bar.n = True, fraction * members, fraction * members
            bar.update(fraction * members - bar.n)

        yield progress
