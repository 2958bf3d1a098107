"""Files with altered histories and hostile texts: described in escapes or refused in a line, without tracebacks and hangs."""

from __future__ import annotations

import ast
import json
import re

import pytest
from histories import CODE, HOSTILE, altered_history
from results import make_modes

from cablepod import cli, provenance
from cablepod.archive import write
from cablepod.errors import printable

netCDF4 = pytest.importorskip("netCDF4")
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")
#: What a script may call.
CALLED = ("cp.", "cablepod.lineage.", "SystemExit", "float")


@pytest.fixture
def foreign(tmp_path):
    """A file, and its stages, without checksums, as another program writes it."""
    path = write(make_modes(), tmp_path / "it.nc")
    with netCDF4.Dataset(path, "r+") as file:
        file.delncattr("cablepod_checksums")
        return path, json.loads(file.history_json)


def alter(path, history, text=""):
    with netCDF4.Dataset(path, "r+") as file:
        file.history_json = history.replace("\0", "")
        file.title = f"it {text}".replace("\0", "")
        file.variables["mode_shape"].long_name = f"mode {text}".replace("\0", "")


def check_script(text):
    """Check that a script calls known functions with literal values, and does nothing else."""
    for statement in ast.parse(text).body:
        if isinstance(statement, ast.Import):
            assert [name.name.split(".")[0] for name in statement.names] == ["cablepod"]
        else:
            assert isinstance(statement, ast.Assign | ast.Expr | ast.Raise)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call):
            assert ast.unparse(node.func).startswith(CALLED)
        assert not isinstance(node, ast.Lambda | ast.comprehension | ast.Subscript | ast.Await | ast.JoinedStr)


@pytest.mark.parametrize("count", [40, pytest.param(300, marks=pytest.mark.slow)])
def test_an_altered_history_is_described_or_refused(count, foreign, capsys):
    path, stages = foreign
    described = 0
    for seed in range(count):
        alter(path, altered_history(stages, seed), HOSTILE if seed % 2 else "")
        for arguments in (["info", "--no-verify", str(path)], ["info", "--no-verify", "--lineage", str(path)]):
            status = cli.main(arguments)
            out, err = capsys.readouterr()
            assert status in (0, 2)
            assert not CONTROL.search(out + err)
            assert status == 0 or err.count("\n") == 1
            described += status == 0
            if status == 0 and "--lineage" in arguments:
                check_script(out)
    assert described > 0


@pytest.mark.parametrize("code", CODE)
@pytest.mark.parametrize("place", ["title", "id", "function", "key", "option", "value", "number", "model"])
def test_no_text_of_a_history_becomes_code(place, code, foreign, capsys):
    path, stages = foreign
    last = stages[-1]
    if place in ("id", "function"):
        last[place] = " ".join(code.split("\n"))
    elif place in ("key", "value"):
        last["parameters"] = {code: 1} if place == "key" else {"rank": code, "layout": [code, {code: code}]}
    elif place in ("option", "number", "model"):
        last["function"] = "ensemble.run"
        last["parameters"] = {"model": "chain", "batch": 2, "options": {"step": 1e-3}}
        if place == "option":
            last["parameters"]["options"] = {code: 1}
        else:
            last["parameters"][place] = code
    alter(path, json.dumps(stages), code if place == "title" else "")
    assert cli.main(["info", "--no-verify", "--lineage", str(path)]) in (0, 2)
    check_script(capsys.readouterr().out)


def test_texts_are_escaped():
    assert printable("a\tb\nσ é") == "a\tb\nσ é"
    assert printable("\x1b[2J\x9b\x7f\u202e\0") == r"\x1b[2J\x9b\x7f\u202e\x00"
    assert not CONTROL.search(printable("".join(map(chr, range(0x3000)))))
    assert printable("\ud800") == r"\ud800"


@pytest.mark.parametrize(
    ("stages", "why"),
    [
        ([{"function": "f"}], "stage 1 has no id or no function"),
        ([{"id": 1, "function": "f"}], "stage 1 has another id"),
        ([{"id": "a", "function": "f", "inputs": ["a"]}], "an input that is made after it"),
        ([{"id": "a", "function": "f", "inputs": ["b"]}, {"id": "b", "function": "f"}], "stage 1 has an input"),
        ([{"id": "a", "function": "f"}] * 2, "stage 2 has the id of another one"),
        ([{"id": "a", "function": "f", "wall_time_s": float("nan")}], "another wall_time_s"),
        ([{"id": "a", "function": "f", "parameters": []}], "another parameters"),
        ({}, "it is no list"),
    ],
)
def test_the_form_of_a_history(stages, why):
    with pytest.raises(ValueError, match=why):
        provenance.checked_stages(json.dumps(stages))


def test_what_is_left_out_is_filled_in():
    stage = provenance.checked_stages('[{"id": "a", "function": "chain.rest", "written": "2030"}]')[0]
    assert stage["parameters"] == {}
    assert stage["inputs"] == []
    assert stage["program"] == "unknown"
