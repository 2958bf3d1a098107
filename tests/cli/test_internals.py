"""Parts of the command: bars and notes, rows of tables, what commands consist of, instants of a report."""

from __future__ import annotations

import io
import shlex
import sys
import warnings

import numpy as np
import pytest
import xarray as xr
from numba.core import event

import cablepod as cp
from cablepod import cli
from cablepod.archive import _lineage
from cablepod.cli import _progress, _report
from cablepod.cli._commands import commands
from cablepod.cli._group import note
from cablepod.cli._progress import Bars, member_bar
from cablepod.study import _run as study


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


def test_a_command_that_fails_leaves_no_time_of_compilation_to_the_next_one(monkeypatch, capsys):
    now = [100.0]
    monkeypatch.setattr(_progress.time, "monotonic", lambda: now[0])

    def fail():
        now[0] += 5.0
        raise cp.SceneError("scene: missing")

    with pytest.raises(cp.SceneError), _progress.telling_of_compilation(), event.trigger_event("numba:compile"):
        fail()
    with Bars() as bars:
        now[0] += 11.0
        bars("chain", 0.1)
    assert capsys.readouterr().err == "cablepod: note: chain: 10 % after 11 s\n"


def test_a_note_without_a_bar_is_one_line(capsys):
    note("two\n  lines")
    assert capsys.readouterr().err == "cablepod: note: two lines\n"


def test_the_table_says_what_a_call_consists_of():
    row = xr.Dataset({"call_time": 6e-3, "loop_time": 2e-3, "number_of_steps": 2480})
    rival = xr.Dataset({"call_time": 20e-3, "number_of_steps": 1250})
    near = _report._cost(row.assign(loop_time=8e-3), rival)  # a call takes no less than its own run
    assert near.startswith("one run of 2480 steps, 3.23 us each")
    assert _report._cost(row, rival) == (
        "3 times one run of 2480 steps, 0.806 us each with output; that chain 1250 steps in its last run, 16 us each of its call"
    )


def test_useless_ranks_are_not_compared_with_chains():
    rows = xr.Dataset(
        {"error_max": ("rank", [0.79, 0.04]), "call_time": ("rank", [1e-3, 6e-3]), "loop_time": ("rank", [1e-3, 6e-3]),
         "number_of_steps": ("rank", [100, 100])}, coords={"rank": [1, 2]},
    )  # fmt: skip
    chains = xr.Dataset(
        {"error_max": ("trial", [0.5, 0.03]), "call_time": ("trial", [0.1, 0.012]), "number_of_steps": ("trial", [9, 9]),
         "links": ("trial", [10, 20]), "tolerance": ("trial", [0.1, 0.01])}
    )  # fmt: skip
    assert _report._at_equal_error(rows, "galerkin", chains).startswith(
        "galerkin, r = 2: 4 % in 6 ms, 2 times faster than"
    )
    said = _report._at_equal_error(rows.isel(rank=[0]), "galerkin", chains)
    assert said == "galerkin: errs by more than 5 % with each of these ranks; give more modes"


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("ensemble", "try: the chain (--model chain) or chain.simulate(scene); give --overwrite"),
        ("run", "try: the chain or chain.simulate(scene); give --overwrite"),
        ("info", "try: chain.simulate or chain.simulate(scene); give --overwrite"),
    ],
)
def test_messages_speak_of_the_options_of_the_command(command, said, capsys, monkeypatch):
    def raise_it(*_, **__):
        warnings.warn("compare with chain.simulate", cp.OutOfRangeWarning, stacklevel=1)
        raise cp.SceneError("try: chain.simulate or chain.simulate(scene); give overwrite=True")

    monkeypatch.setattr(commands.commands[command], "callback", raise_it)
    assert cli.main([command, "file", *(["--out", "out"] if command == "ensemble" else [])]) == 2
    note, error = capsys.readouterr().err.splitlines()
    assert note == f"cablepod: note: compare with {said.split('try: ')[1].split(' or ')[0]}"
    assert error == f"cablepod: {said}"


@pytest.mark.parametrize(("duration", "interval"), [(124.0, 1.0), (4.0, 0.3), (1e-7, 2.5e-8), (1e6, 3e3), (0.3, 0.1)])
def test_the_snapshots_are_among_the_instants_of_the_report(duration, interval):
    snapshots = interval * np.arange(int(duration / interval + 1e-9) + 1)
    times = study._report_times(snapshots)
    assert (np.diff(times) > 0.5e-9 * duration).all()
    np.testing.assert_array_equal(times[np.searchsorted(times, snapshots)], snapshots)
    assert times.size <= study.REPORT_INSTANTS + snapshots.size + 1


def test_every_command_has_examples_that_parse(capsys):
    group = commands
    assert set(group.commands) >= {"run", "paper", "info", "new", "examples"}
    for name in group.commands:
        assert cli.main([name, "--help"]) == 0
        text = capsys.readouterr().out
        examples = [line.partition("#")[0].split(">")[0] for line in text.splitlines() if "  cablepod " in line]
        assert any(f"cablepod {name}" in example for example in examples), f"the help of {name} has no example"
        for example in examples:
            _, command, *arguments = shlex.split(example)
            group.commands[command].make_context(command, arguments)


def test_functions_that_a_script_calls_are_of_the_package():
    assert _lineage._callable("__main__.main") is None
    assert _lineage._callable("cli.main") is None
    assert _lineage._callable("chain.simulate") is not None


def test_the_error_of_a_peak_is_that_of_the_tension_that_changes_most_with_the_links():
    # in gusts the change of one alone may be small by chance: with 20 links a third of it missed the error of 7 of 24 peaks in 12
    # storms by more than a factor of 3, a third of the larger change that of one
    def chain(least, largest):
        tensions = {"tension_minimum": ("link", [least, 50.0]), "tension_maximum": ("link", [50.0, largest])}
        places = {f"tension_{kind}_{of}": 0.0 for kind in ("minimum", "maximum") for of in ("time", "arc_length")}
        return xr.Dataset(tensions | places)

    trees = xr.DataTree.from_dict({"chain": chain(9.0, 90.0), "chain_half": chain(6.0, 90.3)})
    assert [_report._peak(trees, kind)["error"] for kind in ("minimum", "maximum")] == [1.0, 1.0]
