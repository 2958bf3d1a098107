"""Collect the warnings of worker threads and emit each category once."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from cablepod.errors import MemberFailedWarning, user_stacklevel

#: Category and text of a warning.
Note = tuple[type[Warning], str]


class _Collector:
    """Record the warnings of each thread (``warnings.showwarning`` is one function for all threads)."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.open = 0
        self.log: list[tuple[int, Note]] = []
        self.contexts = ExitStack()

    def begin(self) -> None:
        """Start recording in this thread."""
        with self.lock:
            if not self.open:
                self.contexts.enter_context(warnings.catch_warnings())
                warnings.simplefilter("always")
                warnings.showwarning = self._note
            self.open += 1

    def _note(self, message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        """Record a warning; replaces ``warnings.showwarning``."""
        self.log.append((threading.get_ident(), (category, str(message))))

    def end(self) -> list[Note]:
        """Return the warnings of this thread; the last thread also gets those of threads that never called ``begin``."""
        with self.lock:
            self.open -= 1
            notes = [note for thread, note in self.log if thread == threading.get_ident() or not self.open]
            self.log = [record for record in self.log if record[0] != threading.get_ident() and self.open]
            if not self.open:
                self.contexts.close()
            return notes


_COLLECTOR = _Collector()


@contextmanager
def collect_warnings() -> Iterator[list[Note]]:
    """Collect warnings instead of emitting them; the list is filled on exit."""
    notes: list[Note] = []
    _COLLECTOR.begin()
    try:
        yield notes
    finally:
        notes += _COLLECTOR.end()


def emit_warnings(notes: list[Note], count: int) -> None:
    """Emit the first warning of each category and the number of others, without MemberFailedWarning."""
    for category in dict.fromkeys(category for category, _ in notes):
        texts = [text for note_category, text in notes if note_category is category]
        if category is MemberFailedWarning:
            continue
        more = f" (and {len(texts) - 1} more such warnings in {count} members)" if len(texts) > 1 else ""
        warnings.warn(texts[0] + more, category, stacklevel=user_stacklevel())
