"""Bars and notes on a terminal: a note stands on a line of its own, and the bar is drawn again below it."""

from __future__ import annotations

import io
import sys

from cablepod.cli._group import note
from cablepod.cli._progress import Bars, member_bar


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


def lines_seen(text):
    """Return the lines as a terminal shows them: what follows a carriage return overwrites the line."""
    seen = []
    for line in text.split("\n"):
        cells: list[str] = []
        for part in line.split("\r"):
            cells[: len(part)] = part
        seen.append("".join(cells).rstrip())
    return seen


def test_a_note_does_not_garble_a_bar(monkeypatch):
    for bar in (lambda: Bars(), lambda: member_bar("chain", 10)):
        terminal = Terminal()
        monkeypatch.setattr(sys, "stderr", terminal)
        with bar() as progress:
            say = (
                (lambda fraction, progress=progress: progress("chain", fraction))
                if isinstance(progress, Bars)
                else progress
            )
            say(0.5)
            note("the step is too long")
            say(0.75)
            drawn = lines_seen(terminal.getvalue())
        assert drawn[0] == "cablepod: note: the step is too long"
        assert drawn[1].startswith("chain: ")
        assert lines_seen(terminal.getvalue())[1:] == [""]  # the bar is gone at the end


def test_a_note_without_a_bar_is_one_line(capsys):
    note("two\n  lines")
    assert capsys.readouterr().err == "cablepod: note: two lines\n"
