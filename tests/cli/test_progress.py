"""Bars and notes on a terminal: a note stands on a line of its own, and the bar is drawn again below it."""

from __future__ import annotations

import io
import sys

from cablepod.cli import _progress
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


def test_progress_is_told_in_lines_where_there_is_no_terminal(monkeypatch, capsys):
    now = [100.0]
    monkeypatch.setattr(_progress.time, "monotonic", lambda: now[0])
    with Bars() as bars, member_bar("chain", 10) as members:
        for seconds in (1.0, 9.0, 11.0, 15.0, 21.0, 23.0, 60.0):
            now[0] = 100.0 + seconds
            bars("response", seconds / 100.0)
            members(seconds / 100.0)
    said = capsys.readouterr().err.splitlines()
    assert [line for line in said if "chain" not in line] == [
        f"cablepod: note: response: {seconds} % after {seconds} s" for seconds in (11, 23, 60)
    ]
    assert "cablepod: note: chain, 10 members: 23 % after 23 s" in said


def test_compilation_is_told_once(monkeypatch, capsys):
    from numba.core import event

    now = [0.0]
    monkeypatch.setattr(_progress.time, "monotonic", lambda: now[0])
    with _progress.telling_of_compilation():
        for now[0] in (1.0, 2.0, 5.0, 9.0):
            with event.trigger_event("numba:compile"):
                told = capsys.readouterr().err
                assert told.startswith("cablepod: note: compiling, once") is (now[0] == 5.0)
    monkeypatch.setattr(sys, "stderr", Terminal())
    with _progress.telling_of_compilation(), event.trigger_event("numba:compile"):
        assert "compiling, once" in sys.stderr.getvalue()


def test_lines_say_how_long_it_was_compiling(monkeypatch, capsys):
    from numba.core import event

    now = [100.0]
    monkeypatch.setattr(_progress.time, "monotonic", lambda: now[0])
    with _progress.telling_of_compilation(), Bars() as bars:
        bars("chain", 0.0)
        with event.trigger_event("numba:compile"):
            now[0] += 1.0
            with event.trigger_event("numba:compile"):  # nested
                now[0] += 23.0
                bars("chain", 0.0)
        now[0] += 31.0
        bars("chain", 0.98)
    said = [line for line in capsys.readouterr().err.splitlines() if "chain" in line]
    assert said == [
        "cablepod: note: chain: 0 % after 24 s, 24 s of them compiling, once on this machine",
        "cablepod: note: chain: 98 % after 55 s, 24 s of them compiling, once on this machine",
    ]


def test_a_note_without_a_bar_is_one_line(capsys):
    note("two\n  lines")
    assert capsys.readouterr().err == "cablepod: note: two lines\n"
