"""Every error and warning that the package can raise, collected from its source: what it says, and that it helps.

``python tests/test_messages.py`` lists them.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import cablepod

PACKAGE = Path(cablepod.__file__).parent
OURS = ("SceneError", "ArchiveError", "RunStopped", "refuse", "warn", "stop")

#: A refusal: the key or file, what was given or what is wrong with it, and what is allowed.
REFUSAL = re.compile(r"^\S.*?: \S.*; allowed: \S", re.DOTALL)
#: Anything else: what happened, then what to do.
REMEDY = re.compile(
    r"\S.*[;,] (?:or )?(?:try|compare with|give|install|check|change|make|leave|open|judge|see|free|use|run|take|allowed:) ?\S",
    re.DOTALL,
)

#: Messages of another form, by file and beginning, and why they may be.  An entry that fits no message fails too.
EXCEPTIONS = {
    # passed on: the message of an error that was made elsewhere, and is in this list there
    ("scene.py", "SceneError", "{named(str(path))}: {error}"): "the file's name before a refusal of its contents",
    ("scene.py", "SceneError", "{text}"): "made just above, ends with a refusal",
    ("records.py", "SceneError", "{key}: {error}"): "the key before a refusal of its file",
    ("archive.py", "ArchiveError", "{path}: {error}"): "the file's name before a message of its contents",
    ("archive.py", "ArchiveError", "{path}: {folder} {what}"): "`what` ends with what to do, see the line above it",
    (
        "archive.py",
        "ArchiveError",
        "{path}: not written, nothing is left behind: {reason(",
    ): "reason ends with what to do",
    ("ensemble_store.py", "ArchiveError", "{path}: not written: {archive.reason("): "the same",
    ("*", "call", "damaged(path, error)"): "a function that makes the message; the messages are in this list",
    ("*", "call", "_damaged(path, error)"): "the same",
    ("archive_ensemble.py", "ArchiveError", "{'; '.join(faults[:5])}{more}"): "each fault ends with what to do",
    ("ensemble_work.py", "warn", "{texts[0]}{often}"): "the warning of a member, and of how many more",
    ("ensemble_work.py", "name", "error"): "the error of the batch, raised again where no member alone explains it",
    ("ensemble.py", "subscript", "errors[0]"): "the error of the first batch, raised again",
    (
        "ensemble_design.py",
        "SceneError",
        "{key}: given {schema.shown(values)}, at {value:g} no scene: {error}",
    ): "ends with a refusal",
    ("members.py", "subscript", "failed[0][1]"): "the error of the first member, raised again where all failed",
    ("elements.py", "SceneError", "{str(error).replace("): "the chain's message, said of the cable",
    ("runs.py", "RunStopped", "{why}"): "why is what the callers of stop say; they are in this list",
    ("verlet.py", "RunStopped", "{why}"): "made just above, ends with what to try",
    ("verlet.py", "stop", "{why}"): "the same",
    ("implicit.py", "stop", "{why}"): "made just above, ends with what to try",
    ("rigid_runs.py", "stop", "{why}"): "made just above, both times, ends with what to try",
    # caught inside the package: no user sees them
    ("archive_ensemble.py", "ValueError", "it is another kind of file"): "caught four lines below",
    ("members.py", "name", "StoppedError"): "caught where the threads are waited for",
    ("parameters.py", "IndexError", "{at}"): "ends a loop over all, as Python has it",
    ("scene.py", "name", "RecursionError"): "caught three lines below",
    ("snapshots.py", "FloatingPointError", "ends are not finite"): "caught, and said of the snapshots by name",
    ("streaming.py", "FloatingPointError", "rows are not finite"): "caught, and said of the snapshots by name",
    (
        "paper/statics.py",
        "SceneError",
        "Example 1: the boundary value problem",
    ): "fixed numbers: nothing that a user gave",
    # mistakes in the package itself, which a user can only report
    (
        "conventions.py",
        "KeyError",
        "variable {name!r} has no entry in the vocabulary and no units",
    ): "a variable we forgot",
    ("elements.py", "AssertionError", "the last try returns or raises"): "cannot be reached",
    ("stepping.py", "ValueError", "dense output needs rates"): "a caller inside the package that forgot them",
    ("runs.py", "name", "NotImplementedError"): "an abstract method",
    ("galerkin_runs.py", "name", "NotImplementedError"): "an abstract method",
}


class Message(NamedTuple):
    """A place that raises or warns: file, line, what (class or function) and text, variables in braces."""

    file: str
    line: int
    what: str
    text: str


def said(node: ast.expr) -> str:
    """Write the text that an expression makes, with variables in braces."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(said(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        conversion = f"!{chr(node.conversion)}" if node.conversion > 0 else ""
        return (
            "{"
            + ast.unparse(node.value)
            + conversion
            + (f":{said(node.format_spec)}" if node.format_spec else "")
            + "}"
        )
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return said(node.left) + said(node.right)
    return "{" + ast.unparse(node) + "}"


def message_of(call: ast.Call, what: str) -> str:
    """Return the text of a call that makes an error or a warning."""
    if what == "refuse":
        key, given, allowed = call.args
        return f"{said(key)}: given {{{ast.unparse(given)}}}; allowed: {said(allowed)}"
    return said(call.args[-1 if what == "stop" else 0]) if call.args else ""


def messages() -> Iterator[Message]:
    """Collect all that the package raises or warns of."""
    for path in sorted(PACKAGE.rglob("*.py")):
        file = path.relative_to(PACKAGE).as_posix()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Raise) and node.exc is not None:
                raised = node.exc
                if isinstance(raised, ast.Name):
                    yield Message(file, node.lineno, "name", raised.id)
                elif not isinstance(raised, ast.Call):
                    yield Message(file, node.lineno, type(raised).__name__.lower(), ast.unparse(raised))
                elif (name := _last_name(raised)) not in OURS:  # ours are found as calls, wherever they are made
                    known = name.endswith(("Error", "Warning", "Exception"))
                    text = message_of(raised, name) if known else ast.unparse(raised)
                    yield Message(file, node.lineno, name if known else "call", text)
            elif isinstance(node, ast.Call) and (name := _last_name(node)) in OURS and node.args:
                yield Message(file, node.lineno, name, message_of(node, name))


def _last_name(call: ast.Call) -> str:
    return ast.unparse(call.func).rpartition(".")[2]


def fits(what: str, text: str) -> bool:
    """Tell whether a message has the form that a user can act on."""
    return bool((REFUSAL if what in ("SceneError", "refuse") else REMEDY).search(text))


def exception_of(message: Message) -> tuple[str, str, str] | None:
    """Return the entry among the exceptions that a message falls under."""
    for file, what, beginning in EXCEPTIONS:
        if file in ("*", message.file) and what == message.what and message.text.startswith(beginning):
            return file, what, beginning
    return None


ALL = list(messages())


def test_all_are_found():
    # a change of style (another way to raise) must not make them invisible: counted by text, at least as many as there are lines
    lines = sum(len(re.findall(r"^\s+raise \S", path.read_text(), re.MULTILINE)) for path in PACKAGE.rglob("*.py"))
    again = sum(len(re.findall(r"^\s+raise\n", path.read_text(), re.MULTILINE)) for path in PACKAGE.rglob("*.py"))
    assert lines > 150
    assert len(ALL) >= lines - again
    assert {message.what for message in ALL} >= set(OURS)


@pytest.mark.parametrize("message", ALL, ids=lambda m: f"{m.file}:{m.line}")
def test_it_says_what_is_wrong_and_what_to_do(message):
    if exception_of(message) is None:
        assert fits(message.what, message.text), message.text


def test_exceptions_are_of_messages_that_are_there():
    used = {exception_of(message) for message in ALL if not fits(message.what, message.text)}
    assert set(EXCEPTIONS) - used == set()


@pytest.mark.parametrize(
    ("what", "text", "good"),
    [
        ("SceneError", "cable.area: given {x}; allowed: a number", True),
        ("SceneError", "cable.area: missing; allowed: area [m2]", True),
        ("SceneError", "the area is negative", False),
        ("SceneError", "cable.area: given {x}; allowed: ", False),
        ("RunStopped", "the run broke down; try a shorter step", True),
        ("RunStopped", "the run broke down", False),
        ("warn", "two steps disagree; compare with half the step", True),
        ("warn", "two steps disagree", False),
    ],
)
def test_the_form_tells_good_from_bad(what, text, good):
    assert fits(what, text) == good


def test_a_new_kind_of_message_is_found(monkeypatch, tmp_path):
    (tmp_path / "new.py").write_text(
        'def f(x):\n    if x:\n        raise ValueError("no")\n    warnings.warn(f"odd {x}" + "!")\n    return SceneError("")\n'
    )
    monkeypatch.setattr(sys.modules[__name__], "PACKAGE", tmp_path)
    found = {(message.what, message.text) for message in messages()}
    assert found == {("ValueError", "no"), ("warn", "odd {x}!"), ("SceneError", "")}
    assert not any(fits(*message) for message in found)


if __name__ == "__main__":
    for item in ALL:
        sys.stdout.write(f"{item.file}:{item.line} {item.what}: {item.text}\n")
