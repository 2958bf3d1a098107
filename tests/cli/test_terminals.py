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


def test_an_unknown_backend_is_refused_before_the_run(tmp_path):
    program = (
        "import cablepod as cp\nfrom cablepod import examples, study\n"
        f"study.run(examples.scene('example2'), {str(tmp_path / 'out')!r})"
    )
    done = run_python("-c", program, env={**environment(), "MPLBACKEND": "nonsense"}, timeout=120.0)
    assert "SceneError: MPLBACKEND: given 'nonsense'; allowed: a backend of matplotlib" in done.stderr
    assert not (tmp_path / "out").exists()


def test_the_command_needs_no_backend(tmp_path):
    scene = SOFT_TOML.replace("[ends]", "thermal_expansion = 1.2e-5\n[ends]")
    (tmp_path / "soft.toml").write_text(scene)
    program = (
        "import os, sys; from cablepod.cli import main; assert main(sys.argv[1:]) == 0; print(os.environ['MPLBACKEND'])"
    )
    command = ["stringing", tmp_path / "soft.toml", "--temperatures", "0", "20", "2", "--out", tmp_path / "out"]
    done = run_python("-c", program, *command, env={**environment(), "MPLBACKEND": "nonsense"}, timeout=120.0)
    assert done.stdout.endswith("nonsense\n"), done.stderr
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
