"""Rules for a run of the tests, held on small test files: parts of the slow ones, time limits, processes left behind."""

from __future__ import annotations

import re
import textwrap

import psutil
import pytest
from children import run_python
from scenes import TESTS
from suite import FOLDERS, part_of


@pytest.fixture
def run(tmp_path):
    """Run pytest by these rules alone on test files given by name; return its status and what it said."""

    def run(files, *options, command=("-m", "pytest")):
        for name, text in files.items():
            (tmp_path / f"test_{name}.py").write_text(textwrap.dedent(text))
        (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n    slow\n")
        alone = (*command, "-p", "suite", "-p", "no:cacheprovider", "--strict-markers", *options, tmp_path)
        done = run_python(*alone, timeout=100, cwd=tmp_path)
        return done.returncode, done.stdout + done.stderr

    return run


PARTS = """
    import pytest

    def test_quick():
        pass

    @pytest.mark.slow
    @pytest.mark.parametrize("i", range(5))
    def test_slow(i):
        pass

    @pytest.mark.slow
    @pytest.mark.xdist_group("shared")
    @pytest.mark.parametrize("i", range(3))
    def test_together(i):
        pass
"""


def test_parts_of_the_slow_tests_are_all_of_them_and_share_none(run):
    """One process runs both parts."""
    code = "import sys, pytest; sys.exit(max(pytest.main([*sys.argv[1:], '--slow-part', f'{i}/2']) for i in (1, 2)))"
    status, said = run({"it": PARTS}, "-v", command=("-c", code))
    assert status == 0
    found = []
    for number, part in enumerate(re.split("slow tests: part ", said)[1:], start=1):
        assert part.startswith(f"{number} of 2")
        first, *names = re.findall(r"::(\S+) PASSED", part)
        assert first == "test_quick"
        assert sum("together" in name for name in names) in (0, 3)
        assert len(names) in (3, 5)
        found += names
    assert sorted(found) == [f"test_slow[{i}]" for i in range(5)] + [f"test_together[{i}]" for i in range(3)]


@pytest.mark.parametrize("text", ["", "2", "0/3", "4/3", "a/b", "1/2/3"])
def test_a_part_that_is_none_is_refused(text):
    with pytest.raises(Exception, match="allowed: K/N"):
        part_of(text)


LIMITS = """
    import time
    import pytest

    def test_endless():
        time.sleep(30)

    def test_next():
        pass

    @pytest.mark.slow
    def test_slow(request):
        assert request.node.get_closest_marker("timeout").args == (1200.0,)
"""


def test_a_test_beyond_its_limit_fails_and_the_next_one_runs(run):
    status, said = run({"it": LIMITS}, "--timeout", "0.5")
    assert status == 1
    assert "Timeout (>0.5s)" in said
    assert "1 failed, 2 passed" in said


LEAVE = """
    import multiprocessing, subprocess, sys, time
    import suite

    suite.PATIENCE = 2.0
    SLEEP = "import time; time.sleep({seconds})"
    ORPHAN = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {{SLEEP!r}}], start_new_session=True)"

    def test_it():
        {start}
"""


@pytest.mark.slow
def test_a_process_left_behind_fails_and_is_ended(run):
    child, fork = "subprocess.Popen([sys.executable, '-c', SLEEP])", "multiprocessing.get_context('fork')"
    files = {
        "child": LEAVE.format(seconds=60, start=child),
        "orphan": LEAVE.format(seconds=60, start="subprocess.run([sys.executable, '-c', ORPHAN], check=True)"),
        "fork": LEAVE.format(seconds=60, start=f"{fork}.Process(target=time.sleep, args=(60,)).start()"),
        "ends_in_time": LEAVE.format(seconds=0.1, start=child),
    }
    status, said = run(files)
    assert status == 1
    assert "4 passed, 3 errors" in said
    left = dict(re.findall(r"test_(\w+)\.py left processes behind: (\d+): ", said))
    assert set(left) == {"child", "orphan", "fork"}
    for process in left.values():  # one that nobody waits for may stay in the table of processes
        assert not psutil.pid_exists(int(process)) or psutil.Process(int(process)).status() == psutil.STATUS_ZOMBIE


def test_the_order_names_folders_that_are_there():
    assert {name for name in FOLDERS if not list((TESTS / name).glob("test_*.py"))} == set()
