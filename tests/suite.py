"""Rules for a run of the tests: slow ones in parts, a time limit for each test, no process left behind."""

from __future__ import annotations

import argparse
import gc
import os
import time
from collections.abc import Generator, Iterable, Iterator
from pathlib import PurePosixPath
from typing import Any

import psutil
import pytest

from cablepod.condensed import _stepper

#: Time limit of a test marked slow [s]; that of all others is `timeout` in pyproject.toml.
SLOW_LIMIT = 1200.0
#: Time that processes have to end after the tests of a file [s].
PATIENCE = 5.0
#: Folders in the order in which worker processes take them: first those that compile most kernels, in the end short ones.
FOLDERS = (
    "chain", "condensed", "cable", "galerkin", "rigid", "models", "periodic", "wind", "mast", "paper", "pipelines", "ensemble",
    "notebooks", "properties", "batch", "plots", "archive", "cli", "study", "package", "catenary",
)  # fmt: skip
#: What the package has, see :func:`pytest_runtest_setup`.
MAX_CONSTANT_SIZE = _stepper.MAX_CONSTANT_SIZE
#: Variable of the environment by which a process is known that a test started, also when its parent has ended.
OWNER = "CABLEPOD_TEST_PROCESS"
#: Ends with the process of the tests: started by multiprocessing, once.
ALLOWED = "multiprocessing.resource_tracker"


def part_of(text: str) -> tuple[int, int]:
    """Return K and N of the option ``--slow-part K/N``."""
    try:
        number, count = map(int, text.split("/"))
    except ValueError:
        number, count = 0, 0
    if not 1 <= number <= count:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: K/N with K from 1 to N, as 2/4")
    return number, count


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that takes a part of the slow tests."""
    parser.addoption("--slow-part", type=part_of, metavar="K/N", help="of the tests marked slow, run part K of N only")


def pytest_report_header(config: pytest.Config) -> str | None:
    """Say which part is run."""
    part = config.getoption("--slow-part")
    return f"slow tests: part {part[0]} of {part[1]}" if part else None


def is_slow(item: pytest.Item) -> bool:
    """Tell whether a test is marked slow."""
    return item.get_closest_marker("slow") is not None


def unit_of(item: pytest.Item) -> str:
    """Return the name of what is not divided among parts: a test, or a group of tests that share what is dear to make."""
    group = item.get_closest_marker("xdist_group")
    return item.nodeid if group is None else str(group.args[0] if group.args else group.kwargs["name"])


def folder_of(nodeid: str) -> str:
    """Return the folder of a test."""
    return PurePosixPath(nodeid.partition("::")[0]).parent.name


def place_of(item: pytest.Item) -> int:
    """Return the place of the folder of a test in the order of :data:`FOLDERS`."""
    folder = folder_of(item.nodeid)
    return FOLDERS.index(folder) if folder in FOLDERS else len(FOLDERS)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each worker process a folder at a time: tests of one folder need the same kernels, which are compiled once."""
    from xdist.scheduler import LoadScopeScheduling

    class FolderScheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return folder_of(nodeid)

    if config.getvalue("dist") != "load":  # asked for another way
        return None
    config.option.loadscopereorder = False
    return FolderScheduling(config, log)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put the slow tests of a folder last, with their time limit; leave out those of other parts."""
    quick, slow = ([item for item in items if is_slow(item) is wanted] for wanted in (False, True))
    for item in slow:
        if item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(SLOW_LIMIT))
    if part := config.getoption("--slow-part"):
        number, count = part
        chosen = set(sorted({unit_of(item) for item in slow})[number - 1 :: count])
        config.hook.pytest_deselected(items=[item for item in slow if unit_of(item) not in chosen])
        slow = [item for item in slow if unit_of(item) in chosen]
    items[:] = sorted([*quick, *slow], key=place_of)


def pytest_configure(config: pytest.Config) -> None:
    """Mark all processes that are started from here on, and look for garbage less often than Python does by default."""
    os.environ[OWNER] = str(os.getpid())
    gc.set_threshold(50_000)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    """Look for no garbage while modules and tests are loaded, which is a tenth of that time in each worker process."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave out thousands of tests and modules where garbage is looked for: a tenth of the time that kernels compile."""
    gc.freeze()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Compile the condensed model once for all numbers of modes, but for tests of its constants and slow ones.

    For each number of modes up to :data:`MAX_CONSTANT_SIZE` the package compiles steps of its own, which are faster; this takes
    seconds for each, minutes for all numbers that tests have.
    """
    constant = is_slow(item) or item.get_closest_marker("constant_sizes") is not None
    _stepper.MAX_CONSTANT_SIZE = MAX_CONSTANT_SIZE if constant else 0


def processes() -> list[psutil.Process]:
    """Return the processes that tests started and that are alive: descendants, and those whose parent has ended."""
    here, found = psutil.Process(), []
    below = {process.pid for process in here.children(recursive=True)}
    for process in psutil.process_iter():
        try:
            ours = process.pid in below or process.environ().get(OWNER) == str(here.pid)
            if ours and process.pid != here.pid and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except psutil.Error:  # ended meanwhile, or somebody else's
            continue
    return found


def command_of(process: psutil.Process) -> str:
    """Return the command line of a process, empty if it has ended."""
    try:
        return " ".join(process.cmdline())
    except psutil.Error:
        return ""


def left_behind() -> dict[psutil.Process, str]:
    """Return the processes that are still there after :data:`PATIENCE`, with their command lines."""
    end = time.monotonic() + PATIENCE
    while left := {process: line for process in processes() if (line := command_of(process)) and ALLOWED not in line}:
        if time.monotonic() > end:
            break
        time.sleep(0.05)
    return left


@pytest.fixture(scope="module", autouse=True)
def no_process_left_behind(request: pytest.FixtureRequest) -> Iterator[None]:
    """Fail the last test of a file if processes that its tests started are still there, and kill them."""
    yield
    if left := left_behind():
        for process in left:
            process.kill()
        psutil.wait_procs(left, timeout=PATIENCE)
        told = "; ".join(f"{process.pid}: {line}" for process, line in left.items())
        pytest.fail(f"{request.node.nodeid} left processes behind: {told}", pytrace=False)


def slow(*values: Any) -> Any:
    """Mark a value, or values, of a parametrised test as slow."""
    return pytest.param(*values, marks=pytest.mark.slow)


def with_slow(values: Iterable[Any], *names: Any) -> list[Any]:
    """Mark these values of a parametrised test as slow, and leave the others quick."""
    return [slow(value) if value in names else value for value in values]


def slow_but(values: Iterable[Any], *quick: Any) -> list[Any]:
    """Mark all values of a parametrised test as slow but those named."""
    return [value if value in quick else slow(value) for value in values]
