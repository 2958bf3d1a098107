"""The clock that files are stamped with, stopped."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from cablepod.archive import _attributes as attributes


@pytest.fixture
def stop_clock(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Let all files be written at one instant."""

    def stop(instant: str) -> None:
        class Clock(attributes.datetime):
            @classmethod
            def now(cls, tz=None):
                return cls.strptime(instant, "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=tz)

        monkeypatch.setattr(attributes, "datetime", Clock)
        monkeypatch.setattr(attributes, "_STAMPS", {})  # as another process

    return stop
