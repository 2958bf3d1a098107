"""The clock that files are stamped with, stopped; files that are checked in small blocks."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from cablepod.archive import _attributes as attributes
from cablepod.archive import _checksums


@pytest.fixture
def stop_clock(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Let all files be written at one instant, as by another process if not told otherwise."""

    def stop(instant: str, *, same_process: bool = False) -> None:
        class Clock(attributes.datetime):
            @classmethod
            def now(cls, tz=None):
                return cls.strptime(instant, "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=tz)

        monkeypatch.setattr(attributes, "datetime", Clock)
        if not same_process:
            monkeypatch.setattr(attributes, "_STAMPS", {})

    return stop


@pytest.fixture
def checksum_block(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Let checksums be those of blocks of this size [bytes]."""
    return lambda size: monkeypatch.setattr(_checksums, "BLOCK", size)
