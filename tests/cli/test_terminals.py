"""Terminals that cannot show all characters, backends of matplotlib that do not exist, inputs that never end."""

import io
import os
import sys

import pytest
from children import environment, run_python
from scenes import SOFT_TOML

import cablepod as cp
from cablepod import cli
from cablepod.examples import scene_path


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "utf-8"])
def test_what_a_terminal_cannot_show_is_escaped(encoding, tmp_path, monkeypatch):
    with open(scene_path("example2"), encoding="utf-8") as file:
        lines = [line for line in file if not line.startswith("title")]
    (tmp_path / "it.toml").write_text('title = "Segu\\u00ed \\u03c3 \\u001b[2J"\n' + "".join(lines), encoding="utf-8")
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), encoding=encoding))
    assert cli.main(["check", str(tmp_path / "it.toml")]) == 0
    sys.stdout.flush()
    said = sys.stdout.buffer.getvalue().decode(encoding)
    shown = "\\u03c3" if encoding != "utf-8" else "σ"
    assert said.split("\n")[0].split() == ["Segu" + ("\\xed" if encoding == "ascii" else "í"), shown, "\\x1b[2J"]


STUDY = """
import os, sys
import cablepod as cp

scene = cp.read_scene("soft.toml")
cp.study.run(scene, ranks=[1])
print(os.listdir(), [name for name in ("matplotlib", "tqdm", "click") if name in sys.modules])
os.environ["MPLBACKEND"] = "nonsense"
try:
    cp.study.run(scene, "out")
except cp.SceneError as error:
    print(error)
print(os.listdir())
"""


def test_a_study_in_memory_draws_nothing_and_an_unknown_backend_is_refused_before_the_run(tmp_path):
    (tmp_path / "soft.toml").write_text(SOFT_TOML)
    done = run_python("-c", STUDY, cwd=tmp_path, timeout=120.0)
    assert (done.returncode, done.stderr) == (0, "")
    first, refused, last = done.stdout.splitlines()
    assert first == "['soft.toml'] []"
    assert refused.startswith("MPLBACKEND: given 'nonsense'; allowed: a backend of matplotlib")
    assert refused.endswith(
        "; try: another one and a new process, as matplotlib cannot be imported in this one any more"
    )
    assert last == "['soft.toml']"


COMMANDS = """
import os
from cablepod.cli import main

assert main(["check", "soft.toml"]) == 0
assert main(["stringing", "soft.toml", "--temperatures", "0", "20", "2", "--out", "out"]) == 0
print(os.environ["MPLBACKEND"])
"""


def test_commands_need_no_backend(tmp_path):
    (tmp_path / "soft.toml").write_text(SOFT_TOML.replace("[ends]", "thermal_expansion = 1.2e-5\n[ends]"))
    environment_of_child = {**environment(), "MPLBACKEND": "nonsense"}
    done = run_python("-c", COMMANDS, cwd=tmp_path, env=environment_of_child, timeout=120.0)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "nonsense"
    assert list((tmp_path / "out").glob("*.png"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names on this system")
def test_inputs_that_never_end_are_refused(tmp_path):
    os.mkfifo(pipe := tmp_path / "pipe.toml")
    for path in (pipe, "/dev/zero"):
        with pytest.raises(cp.SceneError, match="is a pipe or a device; allowed: a scene file"):
            cp.read_scene(path)
    with (tmp_path / "large.toml").open("wb") as file:
        file.truncate(5 * 2**20)
    with pytest.raises(cp.SceneError, match=r"large\.toml: larger than 4 MiB; allowed: a scene file"):
        cp.read_scene(tmp_path / "large.toml")
