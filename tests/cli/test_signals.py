"""SIGINT and SIGTERM at random instants of the command: one line, a status, nothing half-written, nothing left running.

``CABLEPOD_SIGNALS=40`` attacks each command at that many instants, ``CABLEPOD_SEED=1`` at others.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import pytest
from children import finish, python, run_python
from scenes import SOFT_TOML
from suite import slow

import cablepod as cp

#: What an installed script does.  It tells that the command begins where code of the package first can: before, for milliseconds,
#: Python looks for the package, and a signal ends it in Python's own way.
SCRIPT = (
    "import os, sys; from cablepod.__main__ import main; os.write({told}, b'.'); os.close({told}); sys.exit(main())"
)
#: Longest time from a signal to the end of the process [s], the grace and an idle second; `longest` allows for the load.
LONGEST = 3.0
ENSEMBLE = ("ensemble", "{scene}", "--out", "{out}", "--option", "step=1e-3", "--batch", "4")
COMMANDS = {
    "run": ("run", "{scene}", "--out", "{out}", "--ranks", "1,2"),
    "threads": ENSEMBLE,
    "processes": (*ENSEMBLE, "--scheduler", "processes"),
    "paper": ("paper", "--small", "--out", "{out}"),
}
#: Instants of a command are drawn up to here [s].
SPAN = {"run": 6.0, "threads": 4.0, "processes": 8.0, "paper": 20.0}
NUMBERS = {"SIGINT": signal.SIGINT, "SIGTERM": signal.SIGTERM}
CAUSES = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}


@dataclass
class End:
    """How a process ended."""

    status: int
    output: str
    error: str
    seconds: float  #: from the signal to the end
    missed: bool  #: it had ended before the signal


def tell(text: str) -> None:
    """Print a line of the protocol, shown by ``-rP``."""
    sys.stdout.write(f"{text}\n")


def scene_of(folder: Path, command: str, members: int) -> Path:
    """Write the scene of a command."""
    path = folder / "scene.toml"
    table = f'[ensemble]\nmembers = {members}\n[ensemble.ranges]\n"cable.top_tension" = [200.0, 300.0]\n'
    path.write_text(SOFT_TOML + (table if command in ("threads", "processes") else ""))
    return path


def start(arguments: list[str], **options) -> subprocess.Popen[str]:
    """Start the command in a session of its own; return when its first line runs."""
    heard, told = os.pipe()
    process = python("-c", SCRIPT.format(told=told), *arguments, pass_fds=(told,), start_new_session=True, **options)
    os.close(told)
    assert os.read(heard, 1) == b".", "the command did not begin"
    os.close(heard)
    return process


def in_session(session: int) -> list[psutil.Process]:
    """Return the processes of a session that are alive."""
    found = []
    for process in psutil.process_iter():
        try:
            if os.getsid(process.pid) == session and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (ProcessLookupError, psutil.Error):
            continue
    return found


def longest() -> float:
    """Return :data:`LONGEST` times the processes that share a core, where these are more than one."""
    return LONGEST * max(1.0, os.getloadavg()[0] / len(os.sched_getaffinity(0)))


def attack(arguments: list[str], number: int, after: float, *, group: bool, **options) -> End:
    """Start the command and send it a signal after so many seconds, alone or with its children as a terminal does."""
    process = start(arguments, **options)
    try:
        status = process.wait(after)
    except subprocess.TimeoutExpired:
        status = None
    sent = time.monotonic()
    if status is None:
        (os.killpg if group else os.kill)(process.pid, number)
    output, error = finish(process, timeout=60)
    seconds = time.monotonic() - sent
    end = time.monotonic() + longest()
    while (left := in_session(process.pid)) and time.monotonic() < end:
        time.sleep(0.05)
    told = [" ".join(process.cmdline()) for process in left]
    for child in left:
        child.kill()
    assert not told, f"left running: {told}"
    return End(process.returncode, output, error, seconds, status is not None)


def without_notes(error: str) -> list[str]:
    """Return the lines of stderr but notes: of progress, of what is unusual."""
    return [line for line in error.splitlines() if not line.startswith("cablepod: note: ")]


def message(command: str, number: int) -> str:
    """Return the line after a signal."""
    how = "the same command goes on where it stopped" if command == "ensemble" else "--overwrite begins anew"
    return f"cablepod: {CAUSES[number]}; every file that was written is whole, {how}"


def is_whole(folder: Path) -> int:
    """Read every file completely; return their number."""
    files = [path for path in folder.rglob("*.nc") if not path.name.startswith(".")]
    for path in files:
        cp.archive.read(path)
    for path in folder.rglob("*.png"):
        assert path.read_bytes().rstrip()[-8:-4] == b"IEND", path
    return len(files)


def instants(command: str, name: str, count: int) -> list[float]:
    """Draw instants [s]: a third while modules are imported, the others until the command ends."""
    random.seed(f"{command} {name}{os.environ.get('CABLEPOD_SEED', '')}")
    return [random.uniform(0.0, 0.8 if i % 3 == 0 else SPAN[command]) for i in range(count)]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("command", ["threads", slow("run"), slow("processes"), slow("paper")])
@pytest.mark.usefixtures("ctrl_c")
def test_every_instant_ends_with_one_line(command, name, tmp_path):
    number, seen = NUMBERS[name], []
    scene = scene_of(tmp_path, command, 300)
    count = int(os.environ.get("CABLEPOD_SIGNALS", 2 if command == "threads" else 3))
    for i, after in enumerate(instants(command, name, count)):
        out = tmp_path / f"out{i}"
        arguments = [text.format(scene=scene, out=out) for text in COMMANDS[command]]
        end = attack(arguments, number, after, group=i % 2 == 0)
        told = f"{command}, {name} after {after:.3f} s, {'group' if i % 2 == 0 else 'process'}: {end}"
        if end.missed:
            assert end.status == 0, told
            assert not without_notes(end.error), told
            continue
        assert end.status == 128 + number, told
        lines = without_notes(end.error)
        assert lines == [message(arguments[0], number)], told
        assert end.error.endswith(f"{lines[0]}\n"), told
        assert end.seconds < longest(), told
        files = is_whole(out) if out.exists() else 0
        seen.append(end.seconds)
        tell(f"{after:.3f} s: ended in {end.seconds:.3f} s, {files} files, {len(list(out.glob('.*.part')))} parts")
    assert seen, "all ended before their signal"
    tell(f"{command}, {name}: {len(seen)} of {count} met, the last one ended after {max(seen):.2f} s")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["threads", "processes"])
def test_killed_ensembles_go_on_to_the_same_bits(command, tmp_path):
    scene = scene_of(tmp_path, command, 300)
    random.seed(f"{command}{os.environ.get('CABLEPOD_SEED', '')}")

    def run(name: str) -> tuple[Path, list[str]]:
        out = tmp_path / name
        return out, [text.format(scene=scene, out=out) for text in COMMANDS[command]]

    folder, arguments = run("whole")
    began = time.monotonic()
    assert attack(arguments, signal.SIGKILL, 600.0, group=False).status == 0  # it ends by itself
    span = time.monotonic() - began  # on this machine, as busy as it is
    whole = cp.archive.open_ensemble(folder).load()
    for i in range(int(os.environ.get("CABLEPOD_SIGNALS", 2))):
        after = random.uniform(0.4, 1.0) * span  # mostly while files are written
        out, arguments = run(f"out{i}")
        end = attack(arguments, signal.SIGKILL, after, group=False)
        done = len(list(out.glob("batch_*.nc")))
        again = attack(arguments, signal.SIGKILL, 600.0, group=False)
        assert again.status == 0, again
        assert not without_notes(again.error), again
        assert not list(out.glob(".*.part"))
        resumed = cp.archive.open_ensemble(out).load()
        assert resumed.id == whole.id
        for variable in whole.variables:
            np.testing.assert_array_equal(resumed[variable], whole[variable], err_msg=f"killed after {after} s")
        tell(f"killed after {after:.3f} s: {end.missed=}, {done} of 75 files were there")


def test_sigint_remains_ignored_in_the_background(tmp_path, ctrl_c):
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the fixture puts back what was
    scene = scene_of(tmp_path, "threads", 300)
    arguments = [text.format(scene=scene, out=tmp_path / "out") for text in COMMANDS["threads"]]
    process = start(arguments)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.5)
    process.send_signal(signal.SIGTERM)
    _, error = finish(process, timeout=60)
    assert (process.returncode, error) == (143, f"{message('ensemble', signal.SIGTERM)}\n")


#: A process with a child that does not look whether its parent is there; its main thread takes KeyboardInterrupt or does not.
WITH_CHILD = """
import multiprocessing, time
import cablepod.cli
from cablepod.__main__ import main

def command():
    multiprocessing.get_context("fork").Process(target=time.sleep, args=(60,)).start()
    print("started", flush=True)
    while True:
        try:
            time.sleep(60)
        except KeyboardInterrupt:
            if {orderly}:
                return 1

cablepod.cli.main = command
main()
"""


@pytest.mark.parametrize("orderly", [True, slow(False)])
@pytest.mark.usefixtures("ctrl_c")
def test_children_end_with_the_command(orderly):
    process = python("-c", WITH_CHILD.format(orderly=orderly), start_new_session=True)
    assert process.stdout.readline() == "started\n"
    sent = time.monotonic()
    process.terminate()
    finish(process, timeout=60)  # which waits until nobody holds stdout any more
    assert process.returncode == 128 + signal.SIGTERM
    assert time.monotonic() - sent < longest()


def test_a_status_and_a_traceback_are_as_usual(tmp_path):
    code = "import sys; import cablepod.cli; cablepod.cli.main = lambda: {}; from cablepod.__main__ import main; main()"
    for text, status, said in (("3", 3, ""), ("sys.exit('out')", 1, "out"), ("1 / 0", 1, "ZeroDivisionError")):
        end = run_python("-c", code.format(text), timeout=60)
        assert end.returncode == status
        assert said in end.stderr
    kept = run_python("-c", f"import atexit; atexit.register(print, 'end'); {code.format(0)}", timeout=60)
    assert (kept.returncode, kept.stdout) == (0, "end\n")
