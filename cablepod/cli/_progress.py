"""Show progress on stderr: bars on a terminal, otherwise a line now and then; tell of compilation."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any

from cablepod.cli._group import note

#: Time until the first line of progress that is no terminal's [s]; until the next one it is twice as long, and so on.
FIRST_LINE = 10.0
#: Time of compilation before a line tells of it where stderr is no terminal [s].
LONG_COMPILATION = 3.0


class _Compilation:
    """Time of compilation of this command; kernels from the cache on disk are none."""

    depth, begun, done = 0, 0.0, 0.0

    @classmethod
    def seconds(cls) -> float:
        """Return the time of compilation until now [s]."""
        return cls.done + (time.monotonic() - cls.begun if cls.depth else 0.0)


class Lines:
    """Print progress as lines at growing intervals, unless stderr is a terminal."""

    def __init__(self) -> None:
        self._begin, self._next = time.monotonic(), FIRST_LINE

    def __call__(self, label: str, fraction: float) -> None:
        """Print the completed fraction, if it is time."""
        seconds = time.monotonic() - self._begin
        if seconds >= self._next and not sys.stderr.isatty():
            self._next = 2.0 * seconds
            compiling = _Compilation.seconds()
            of_them = f", {compiling:.0f} s of them compiling, once on this machine" if compiling >= 1.0 else ""
            note(f"{label}: {100.0 * fraction:.0f} % after {seconds:.0f} s{of_them}")


@contextmanager
def telling_of_compilation() -> Iterator[None]:
    """Print a line when a compilation begins, once; where stderr is no terminal, when it takes LONG_COMPILATION."""
    from numba.core import event  # the commands that use this compute

    begun, told = 0.0, False

    class Listener(event.Listener):
        """Clock of the compilation, of the outermost of nested events."""

        def on_start(self, event: Any) -> None:
            nonlocal begun, told
            begun = begun or time.monotonic()
            _Compilation.depth += 1
            if _Compilation.depth == 1:
                _Compilation.begun = time.monotonic()
            if not told and (sys.stderr.isatty() or time.monotonic() - begun > LONG_COMPILATION):
                told = True
                note("compiling, once on this machine; this takes up to a minute")

        def on_end(self, event: Any) -> None:
            _Compilation.depth -= 1
            if _Compilation.depth == 0:
                _Compilation.done += time.monotonic() - _Compilation.begun

    try:
        with event.install_listener("numba:compile", Listener()):
            yield
    finally:  # also of a command that fails: the next one of this process begins anew
        _Compilation.depth, _Compilation.done = 0, 0.0


class Bars:
    """Show one progress bar at a time."""

    def __init__(self) -> None:
        self._label: str | None = None
        self._bar: Any = None
        self._lines = Lines()

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
        self._lines(label, fraction)

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
        begun, lines = False, Lines()

        def progress(fraction: float) -> None:
            nonlocal begun
            if not begun:  # members of an earlier run do not count for the speed
                begun, bar.initial, bar.n = True, fraction * members, fraction * members
            bar.update(fraction * members - bar.n)
            lines(f"{label}, {members} members", fraction)

        yield progress
