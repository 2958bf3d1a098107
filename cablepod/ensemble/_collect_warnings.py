"""Collect the warnings of worker threads and emit each kind once."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from cablepod.errors import MemberFailedWarning

Note = tuple[type[Warning], str]


# --- warnings -----------------------------------------------------------------------------------------------------------


class _Listener:
    """Notes the warnings of each thread; the interpreter has one place for all of them."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.open = 0
        self.log: list[tuple[int, Note]] = []
        self.held = ExitStack()

    def begin(self) -> None:
        with self.lock:
            if not self.open:
                self.held.enter_context(warnings.catch_warnings())
                warnings.simplefilter("always")
                warnings.showwarning = self._note
            self.open += 1

    def _note(self, message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        self.log.append((threading.get_ident(), (category, str(message))))

    def end(self) -> list[Note]:
        """Return the notes of this thread; the last one to go takes those of threads that nobody waits for too."""
        with self.lock:
            self.open -= 1
            own = [note for thread, note in self.log if thread == threading.get_ident() or not self.open]
            self.log = [item for item in self.log if item[0] != threading.get_ident() and self.open]
            if not self.open:
                self.held.close()
            return own


_LISTENER = _Listener()


@contextmanager
def collect_warnings() -> Iterator[list[Note]]:
    """Keep the warnings that come up to be told later; the list is filled on leaving."""
    notes: list[Note] = []
    _LISTENER.begin()
    try:
        yield notes
    finally:
        notes += _LISTENER.end()


def emit_warnings(notes: list[Note], count: int) -> None:
    """Warn once of each category: how often it came up, and what was said first; of failures from their number."""
    for category in dict.fromkeys(category for category, _ in notes):
        texts = [text for own, text in notes if own is category]
        if category is MemberFailedWarning:
            continue
        often = f" (and {len(texts) - 1} more such warnings in {count} members)" if len(texts) > 1 else ""
        warnings.warn(texts[0] + often, category, stacklevel=4)
