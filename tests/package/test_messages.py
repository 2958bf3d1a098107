"""The fields of every error and warning that the package can raise, collected from its source.

The form is ``key: problem (value); allowed: ...; try: ...`` or ``key: given value; allowed: ...``.  A refusal of input names its
key, what was given, and what is allowed.  Any other message tells the problem, and what is allowed or what to do.  ``python
tests/package/test_messages.py`` lists all messages.
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

#: Function that makes a refusal of input from its fields: key, given, allowed and, if it takes one, remedy.
REFUSE = "scene_error"
#: Functions that get the text of a message, and the index of that argument.
TELLING = {"warn": 0, "stop": -1}
#: Exceptions that are made in one place and raised in another, so that their calls are collected, not the raise statements.
OWN = ("SceneError", "ArchiveError", "RunStopped")
COLLECTED = (REFUSE, *TELLING, *OWN)
#: Kinds of messages that refuse input.
REFUSALS = ("SceneError", REFUSE)
#: The words that begin a remedy: the field of its own, or an imperative in the last clause.
REMEDY = re.compile(
    r"[;,] (?:or )?(?:try: |(?=(?:try|compare with|give|install|check|change|make|leave|open|judge|see|free|use|run|take) \S))"
)
#: Longest key, in words beside variables: "law and damping.link_viscosity".
KEY_WORDS = 3

#: Messages of another form, by kind and beginning of the text, and the reason.  An entry that fits no message fails.
EXCEPTIONS = {
    # passed on: the message of an error that was made elsewhere, and is collected there
    ("SceneError", "{named(str(path))}: {error}"): "the file's name before a refusal of its contents",
    ("SceneError", "{kind.instead[1]}"): "a text beside its kind, which has all fields",
    ("SceneError", "{key}: given {shown(values)}, at {shown_value(value)} no scene: {error}"): "ends with a refusal",
    ("SceneError", "{prefix}: given {', '.join(lacking)}, which make no scene: {error}"): "ends with a refusal",
    ("SceneError", "{prefix}: given a member with {together}, which make no scene: {error}"): "ends with a refusal",
    ("SceneError", "{str(error).replace("): "the chain's message, said of the cable",
    ("ArchiveError", "{path}: {error}"): "the file's name before a message of its contents",
    ("ArchiveError", "{path}: {folder} {problem}"): "`problem` ends with what to do, see the line above it",
    (
        "ArchiveError",
        "{path}: not written, nothing is left behind: ",
    ): "`remedy` ends with what to do, see the lines above it",
    ("ArchiveError", "{faults_text(faults)}"): "each fault ends with what to do",
    ("RunStopped", "{why}"): "the reason, told by the callers of stop or made just above",
    ("stop", "{why}"): "made just above, ends with what to try",
    ("warn", "{text}"): "told by the callers, which are collected",
    ("subscript", "answer[0]"): "what the job of a worker raised",
    ("warn", "{warning.message}"): "given again as it is, where it is the first of its kind",
    ("warn", "{texts[0]}{more}"): "the warning of a member, and of how many more",
    ("call", "damaged(path, error)"): "a function that makes the message, which is collected there",
    ("call", "not_written("): "a function that makes the message, which is collected there",
    ("call", "changed("): "a function that makes the message, which is collected there",
    ("call", "newer("): "a function that makes the message, which is collected there",
    ("call", "missing_file("): "a function that makes the message, which is collected there",
    ("call", "unknown_key("): "a function that makes the message, which is collected there",
    ("name", "error"): "the error of the batch, raised again where no member alone explains it",
    ("subscript", "errors[0]"): "the error of the first batch, raised again",
    ("subscript", "failed[0][1]"): "the error of the first member, raised again where all failed",
    # caught inside the package: no user sees them
    ("RunStopped", "{INTERRUPTED}"): "the word in `failure` of members that Ctrl-C left out, not raised",
    ("name", "KeyboardInterrupt"): "after SIGINT or SIGTERM, whose line the command has printed",
    ("ValueError", "it is another kind of file"): "caught a few lines below",
    ("ValueError", "its last line is not whole"): "caught, the message of a damaged file tells it",
    ("ValueError", "it is not JSON"): "of a history: told by the archive, with the remedy",
    ("ValueError", "it is no list"): "the same",
    ("ValueError", "stage {number}"): "the same",
    ("ValueError", "{function}"): "caught where the script says that the stage cannot be made again",
    ("name", "ValueError"): "the same",
    ("FloatingPointError", "ends are not finite"): "caught, and said of the snapshots by name",
    ("FloatingPointError", "rows are not finite"): "caught, and said of the snapshots by name",
    ("IndexError", "{index}"): "ends a loop over all, as Python has it",
    ("name", "StoppedError"): "caught where the threads are waited for",
    ("name", "RecursionError"): "caught a few lines below",
    ("SceneError", "Example 1: the boundary value problem"): "fixed numbers: nothing that a user gave",
    # mistakes in the package itself, which a user can only report
    ("KeyError", "variable {name!r} has no entry in the vocabulary and no units"): "a variable without an entry",
    ("AssertionError", "the last try returns or raises"): "cannot be reached",
    ("ValueError", "dense output needs rates"): "a caller inside the package that forgot them",
    ("name", "NotImplementedError"): "an abstract method",
}


class Message(NamedTuple):
    """A place that raises or warns: file, line, kind (class or function) and text, variables in braces."""

    file: str
    line: int
    kind: str
    text: str


class Fields(NamedTuple):
    """What a message says; empty where it says nothing of the kind."""

    key: str
    given: str
    allowed: str
    remedy: str


# --- collecting ---------------------------------------------------------------------------------------------------------


def text_of(node: ast.expr) -> str:
    """Write the text that an expression makes, with variables in braces."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        conversion = f"!{chr(node.conversion)}" if node.conversion > 0 else ""
        form = f":{text_of(node.format_spec)}" if node.format_spec else ""
        return "{" + ast.unparse(node.value) + conversion + form + "}"
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return text_of(node.left) + text_of(node.right)
    return "{" + ast.unparse(node) + "}"


def name_of(call: ast.Call) -> str:
    """Return the name of the function or class that is called, without its module."""
    return ast.unparse(call.func).rpartition(".")[2]


def message_of(call: ast.Call, kind: str) -> str:
    """Return the text of a call that makes an error or a warning."""
    if kind == REFUSE:
        named = {item.arg: item.value for item in call.keywords}
        values = {**dict(zip(Fields._fields, call.args, strict=False)), **named}
        key, allowed = (text_of(values[name]) if name in values else "" for name in ("key", "allowed"))
        given = f"{{{ast.unparse(values['given'])}}}" if "given" in values else ""
        remedy = f"; try: {text_of(values['remedy'])}" if "remedy" in values else ""
        return f"{key}: given {given}; allowed: {allowed}{remedy}"
    return text_of(call.args[TELLING.get(kind, 0)]) if call.args else ""


def messages(package: Path = PACKAGE) -> Iterator[Message]:
    """Collect all that a package raises or warns of."""
    for path in sorted(package.rglob("*.py")):
        file = path.relative_to(package).as_posix()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Raise) and node.exc is not None:
                raised = node.exc
                if isinstance(raised, ast.Name):
                    yield Message(file, node.lineno, "name", raised.id)
                elif not isinstance(raised, ast.Call):
                    yield Message(file, node.lineno, type(raised).__name__.lower(), ast.unparse(raised))
                elif (name := name_of(raised)) not in COLLECTED:
                    known = name.endswith(("Error", "Warning", "Exception"))
                    text = message_of(raised, name) if known else ast.unparse(raised)
                    yield Message(file, node.lineno, name if known else "call", text)
            elif isinstance(node, ast.Call) and (name := name_of(node)) in COLLECTED and (node.args or node.keywords):
                yield Message(file, node.lineno, name, message_of(node, name))


# --- judging ------------------------------------------------------------------------------------------------------------


def fields_of(text: str) -> Fields:
    """Take a message apart."""
    problem, _, allowed = text.partition("; allowed: ")
    tail = allowed or problem
    found = REMEDY.search(tail)
    remedy = tail[found.end() :] if found else ""
    if found and allowed:
        allowed = tail[: found.start()]
    elif found:
        problem = tail[: found.start()]
    key, colon, given = problem.partition(": ")
    return Fields(key if colon else "", (given if colon else problem).removeprefix("given "), allowed, remedy)


def lacking(kind: str, text: str) -> list[str]:
    """Name the fields that a message of this kind should have and has not."""
    fields = fields_of(text)
    wanted = {"given": fields.given.strip()}
    if kind in REFUSALS:
        words = re.sub(r"\(.*?\)", "", re.sub(r"\{.*?\}", "{}", fields.key)).split()
        wanted |= {"key": 0 < len(words) <= KEY_WORDS, "allowed": fields.allowed.strip()}
    else:
        wanted["allowed or remedy"] = fields.allowed.strip() or fields.remedy.strip()
    return [name for name, there in wanted.items() if not there]


def exception_of(message: Message) -> tuple[str, str] | None:
    """Return the entry among the exceptions that a message falls under."""
    for kind, beginning in EXCEPTIONS:
        if kind == message.kind and message.text.startswith(beginning):
            return kind, beginning
    return None


@pytest.fixture(scope="module")
def everything() -> list[Message]:
    """All messages of the package."""
    return list(messages())


def test_all_are_found(everything):
    # a change of style (another way to raise) must not make them invisible: counted by text, at least as many as there are lines
    lines = sum(len(re.findall(r"^\s+raise \S", path.read_text(), re.MULTILINE)) for path in PACKAGE.rglob("*.py"))
    again = sum(len(re.findall(r"^\s+raise\n", path.read_text(), re.MULTILINE)) for path in PACKAGE.rglob("*.py"))
    assert lines > 150
    assert len(everything) >= lines - again
    assert {message.kind for message in everything} >= set(COLLECTED)


def test_each_has_the_fields_of_its_kind(everything):
    faulty = [
        f"{message.file}:{message.line}: no {' and no '.join(fields)}: {message.text}"
        for message in everything
        if exception_of(message) is None and (fields := lacking(message.kind, message.text))
    ]
    assert not faulty, "\n".join(faulty)


def test_exceptions_are_of_messages_that_are_there(everything):
    used = {exception_of(message) for message in everything if lacking(message.kind, message.text)}
    assert set(EXCEPTIONS) - used == set()


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("cable.area: given {x}; allowed: a number", ("cable.area", "{x}", "a number", "")),
        ("cable.area: missing; allowed: area [m2]", ("cable.area", "missing", "area [m2]", "")),
        ("step: unstable ({x} s); allowed: below {y} s", ("step", "unstable ({x} s)", "below {y} s", "")),
        ("step: unstable ({x} s); allowed: below {y} s; try: 1 s", ("step", "unstable ({x} s)", "below {y} s", "1 s")),
        ("{path}: is empty; try: make it again", ("{path}", "is empty", "", "make it again")),
        ("{path}: is empty; make it again", ("{path}", "is empty", "", "make it again")),
        ("the run broke down; try a shorter step", ("", "the run broke down", "", "try a shorter step")),
        ("the run broke down", ("", "the run broke down", "", "")),
    ],
)
def test_fields_are_found(text, fields):
    assert fields_of(text) == fields


@pytest.mark.parametrize(
    ("kind", "text", "missing"),
    [
        ("SceneError", "cable.area: given {x}; allowed: a number", []),
        ("SceneError", "cable.area: missing; allowed: area [m2]", []),
        ("SceneError", "cable.area: not positive ({x}); allowed: a number above 0; try: 1e-4", []),
        ("SceneError", "the area is negative", ["key", "allowed"]),
        ("SceneError", "the area is negative here: {x}; allowed: a number", ["key"]),
        ("SceneError", "cable.area: given {x}; allowed: ", ["allowed"]),
        ("SceneError", "cable.area: given {x}; try: a number", ["allowed"]),
        ("SceneError", "cable.area: given ; allowed: a number", ["given"]),
        (REFUSE, ": given {x}; allowed: a number", ["key"]),
        ("RunStopped", "the run broke down; try a shorter step", []),
        ("RunStopped", "the run broke down; try: a shorter step", []),
        ("RunStopped", "the run broke down", ["allowed or remedy"]),
        ("RunStopped", "the run broke down; try: ", ["allowed or remedy"]),
        ("warn", "two steps disagree; compare with half the step", []),
        ("warn", "two steps disagree", ["allowed or remedy"]),
    ],
)
def test_the_fields_tell_good_from_bad(kind, text, missing):
    assert sorted(lacking(kind, text)) == sorted(missing)


def test_a_new_kind_of_message_is_found(tmp_path):
    (tmp_path / "new.py").write_text(
        'def f(x):\n    if x:\n        raise ValueError("no")\n    warnings.warn(f"odd {x}" + "!")\n    return SceneError("")\n'
    )
    found = {(message.kind, message.text) for message in messages(tmp_path)}
    assert found == {("ValueError", "no"), ("warn", "odd {x}!"), ("SceneError", "")}
    assert all(lacking(*message) for message in found)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ('"a", x, "b"', "a: given {x}; allowed: b"),
        ('"a", x, "b", "c"', "a: given {x}; allowed: b; try: c"),
        ('key=f"a.{i}", given=x, allowed="b", remedy="c"', "a.{i}: given {x}; allowed: b; try: c"),
        ('"a", x', "a: given {x}; allowed: "),
    ],
)
def test_a_refusal_is_put_together_from_its_fields(tmp_path, arguments, text):
    (tmp_path / "new.py").write_text(f"raise {REFUSE}({arguments})\n")
    assert [message.text for message in messages(tmp_path)] == [text]
    assert lacking(REFUSE, text) == ([] if "b" in arguments else ["allowed"])


if __name__ == "__main__":
    for item in messages():
        sys.stdout.write(f"{item.file}:{item.line} {item.kind}: {item.text}\n")
