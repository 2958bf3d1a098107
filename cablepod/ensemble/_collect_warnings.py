"""Collect the warnings of worker threads and emit each category once."""

from __future__ import annotations

import re
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import xarray as xr

from cablepod.archive._manifest import errors_text, worst_first
from cablepod.errors import MemberFailedWarning, NotConvergedWarning, OutOfRangeWarning, warn
from cablepod.reduced._validity import warn_condensed_members

#: Begin of a warning of the members of one batch, see :func:`cablepod.reduced._validity.warn_condensed_members`.
OF_BATCH = re.compile(r"\d+ of \d+ members, of these number \d+ the worst: ")
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


def emit_warnings(notes: list[Note], count: int, time_errors: Mapping[str, Sequence[float]], accepted: float) -> None:
    """Emit warnings of `count` members, one for each category.

    For members that have not converged in time it names the worst, for other categories the first and the number of others.
    MemberFailedWarning is left out.

    Parameters
    ----------
    notes
        Warnings of all members.
    count
        Number of members.
    time_errors
        Errors of motion and tension of the members that have not converged, see
        :func:`cablepod.archive._manifest.time_errors`.
    accepted
        Time error above which a member counts as not converged.
    """
    if time_errors:
        warn(
            f"{len(time_errors)} of {count} members have not converged in time, with an estimated error above {accepted:g}; the "
            f"worst: {_worst(time_errors)}; their motion is chaotic (judge it by statistics), or axial waves or snaps are not "
            "resolved; give a ramp to motions that start with a jump, a shorter step, or a larger tolerance",
            NotConvergedWarning,
        )
        notes = [note for note in notes if note[0] is not NotConvergedWarning or "not converged in time" not in note[1]]
    for category in dict.fromkeys(category for category, _ in notes):
        texts = [text for note_category, text in notes if note_category is category]
        if category is MemberFailedWarning:
            continue
        more = f" (and {len(texts) - 1} more such warnings in {count} members)" if len(texts) > 1 else ""
        warn(texts[0] + more, category)


def _worst(errors: Mapping[str, Sequence[float]]) -> str:
    """Return the members with the largest error of the motion and of motion or tension, with their errors."""
    worst = max(errors, key=lambda member: errors[member][0])
    tense = worst_first(errors)[0]
    members = [worst] if worst == tense else [worst, tense]
    return "; ".join(f"member {member} has {errors_text(errors[member])}" for member in members)


def emit_of_all_members(notes: list[Note], result: Callable[[], xr.Dataset]) -> list[Note]:
    """Emit warnings that batches of the condensed model give of their members once for all; return the other warnings.

    `result` gives the results of all members.
    """
    others = [note for note in notes if note[0] is not OutOfRangeWarning or not OF_BATCH.match(note[1])]
    if len(others) < len(notes):
        results = result()
        names = [str(name) for name, variable in results.variables.items() if variable.dims == ("member",)]
        names = [name for name in names if results[name].dtype.kind == "f"]
        attrs = {name: results[name].values.tolist() for name in names}
        scheme = [str(results.attrs.get("scheme", ""))] * results.sizes["member"]
        warn_condensed_members({**attrs, "scheme": scheme})
    return others
