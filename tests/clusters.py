"""A dask scheduler and its workers, each in a process and a working directory of its own."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from children import environment

#: Commands that start another one with file systems of its own, as root and as any other user.
APART = (["unshare", "-m"], ["unshare", "-Urm"])


def way_apart() -> list[str] | None:
    """Return the command that starts another one with file systems of its own, where this machine allows it."""
    for command in APART:
        probe = [*command, "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
        if shutil.which("unshare") and subprocess.run(probe, capture_output=True).returncode == 0:
            return command
    return None


class Cluster:
    """Scheduler, and workers that come and leave."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.file = folder / "scheduler.json"
        self.processes: list[subprocess.Popen[bytes]] = []

    def start(
        self, *arguments: object, before: tuple[str, ...] = (), path: Path | None = None
    ) -> subprocess.Popen[bytes]:
        """Start a command of dask in a new working directory; `path` comes first in the path of its modules."""
        place = self.folder / f"place{len(self.processes)}"
        place.mkdir()
        variables = environment()
        if path is not None:
            variables["PYTHONPATH"] = os.pathsep.join([str(path), variables["PYTHONPATH"]])
        command = [*before, sys.executable, "-m", "dask", *map(str, arguments)]
        with (place / "log").open("wb") as log:
            process = subprocess.Popen(command, env=variables, cwd=place, stdout=log, stderr=log)
        self.processes.append(process)
        return process

    def start_scheduler(self) -> str:
        """Start the scheduler; return its address."""
        self.start("scheduler", "--host", "127.0.0.1", "--port", 0, "--no-dashboard", "--scheduler-file", self.file)
        for _ in range(600):  # a minute
            if self.file.exists() and (text := self.file.read_text()).endswith("}"):
                return str(json.loads(text)["address"])
            time.sleep(0.1)
        raise TimeoutError((self.folder / "place0" / "log").read_text())

    def worker(self, *, hidden: Path | None = None, **options: Any) -> subprocess.Popen[bytes]:
        """Start a worker with one thread; it does not see the folder `hidden`."""
        before: tuple[str, ...] = ()
        if hidden is not None:
            way = way_apart()
            assert way is not None
            hide = 'mount -t tmpfs tmpfs "$0" && exec "$@"'
            before = (*way, "sh", "-c", hide, str(hidden))
        words = ("--nthreads", 1, "--no-nanny", "--no-dashboard", "--host", "127.0.0.1", "--local-directory", "scratch")
        return self.start("worker", "--scheduler-file", self.file, *words, before=before, **options)

    def close(self) -> None:
        """End all processes."""
        for process in reversed(self.processes):
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
            process.wait(60)


@contextmanager
def cluster_in(folder: Path) -> Iterator[Cluster]:
    """Provide a cluster whose processes end with the block."""
    folder.mkdir()
    cluster = Cluster(folder)
    try:
        yield cluster
    finally:
        cluster.close()
