"""Warnings of the stages of a study: each kind once, though every model gives it with its own numbers."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from cablepod.errors import warn

#: What differs between warnings of one kind: the name of the model, and numbers.
OF_MODEL, NUMBER = re.compile(r"of the model \w+"), re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


class OnceEach:
    """Warnings of several runs, of which those are left out that differ from an earlier one in model and numbers alone."""

    def __init__(self) -> None:
        self.seen: set[tuple[type[Warning], str]] = set()
        self.left_out = 0

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Collect the warnings in the block, and give those of a new kind at its end, also where it raises."""
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                yield
        finally:
            for warning in caught:
                kind = warning.category, NUMBER.sub("#", OF_MODEL.sub("", str(warning.message)))
                if kind in self.seen:
                    self.left_out += 1
                else:
                    self.seen.add(kind)
                    warn(warning.message)
