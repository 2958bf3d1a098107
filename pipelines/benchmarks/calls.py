"""Count the calls from one sub-package of cablepod into another during one simulation.

    python pipelines/benchmarks/calls.py [--scene example3] [--pairs 0]

A warm second call of ``chain.simulate``, ``galerkin.simulate`` (r = 2) and ``condensed.simulate`` (r = 2), default options
otherwise, under ``sys.setprofile``.  Only frames of the package's own files count: the caller of a frame is the nearest frame of
the package below it, compiled functions have no frame, and each step of a generator is a call.  A frame belongs to the folder of
its file below ``cablepod/``; a file directly in ``cablepod/`` is a sub-package of its own.

files
    distinct files of the package with a frame.
depth
    largest number of the package's frames on the stack.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import cablepod as cp
from cablepod.examples import scene

PACKAGE = Path(cp.__file__).resolve().parent


class CallCounter:
    """Count calls between sub-packages, files and depth while it is the profile function."""

    def __init__(self) -> None:
        self.calls = 0
        self.across: Counter[tuple[str, str]] = Counter()
        self.files: set[str] = set()
        self.depth = 0
        self._known: dict[str, str] = {}  # file name of a code object -> path below the package, empty outside

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Note the call of a frame of the package."""
        if event != "call" or not (path := self._path(frame)):
            return
        callers, depth, below = [], 1, frame.f_back
        while below is not None:
            if caller := self._path(below):
                callers.append(caller)
                depth += 1
            below = below.f_back
        self.calls += 1
        self.files.add(path)
        self.depth = max(self.depth, depth)
        if callers and sub_package(callers[0]) != sub_package(path):
            self.across[sub_package(callers[0]), sub_package(path)] += 1

    def _path(self, frame: FrameType) -> str:
        name = frame.f_code.co_filename
        if name not in self._known:
            path = Path(name)
            inside = path.is_absolute() and path.resolve().is_relative_to(PACKAGE)
            self._known[name] = path.resolve().relative_to(PACKAGE).as_posix() if inside else ""
        return self._known[name]


def sub_package(path: str) -> str:
    """Return the sub-package of a file, given by its path below the package."""
    return path.removesuffix(".py") if "/" not in path else path.partition("/")[0]


def counted(call: Callable[[], object]) -> CallCounter:
    """Count during the second of two calls."""
    call()
    counter = CallCounter()
    sys.setprofile(counter)
    try:
        call()
    finally:
        sys.setprofile(None)
    return counter


def simulations(name: str) -> dict[str, Callable[[], object]]:
    """Return the call of each model for a shipped scene, on modes of its chain."""
    given = scene(name)
    chain = cp.chain.simulate(given)
    separate = cp.pod.decompose(chain, rank=2)
    normal = cp.pod.decompose(chain, rank=2, layout="normal")
    return {
        "chain": lambda: cp.chain.simulate(given),
        "galerkin": lambda: cp.galerkin.simulate(given, separate, rank=2),
        "condensed": lambda: cp.condensed.simulate(given, normal, rank=2),
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="example3", help="name of a shipped scene")
    parser.add_argument("--pairs", type=int, default=0, help="number of pairs of sub-packages shown for each model")
    options = parser.parse_args()
    print("| model | calls across | calls | files | depth |\n| --- | --- | --- | --- | --- |")
    pairs = []
    for model, call in simulations(options.scene).items():
        found = counted(call)
        print(f"| {model} | {found.across.total()} | {found.calls} | {len(found.files)} | {found.depth} |")
        pairs += [f"{model}: {a} -> {b} {count}" for (a, b), count in found.across.most_common(options.pairs)]
    print("\n".join(pairs))


if __name__ == "__main__":
    main()
