"""Program that writes a file: version, platform, commit."""

from __future__ import annotations

import functools
import os
import platform
import subprocess
from pathlib import Path

from cablepod.archive._read import version


@functools.cache
def program() -> dict[str, str]:
    """Return program, version, platform and, in a checkout, commit, for the record of a stage."""
    found = {"program": "cablepod", "version": version(), "platform": platform.platform()}
    commit = commit_of(Path(__file__).resolve().parents[2])
    return found | ({"commit": commit} if commit else {})


def commit_of(root: Path) -> str | None:
    """Return the commit of the checkout `root`, with the suffix "-dirty" if files differ; None without a checkout."""
    if not (root / ".git").exists():  # git would report a checkout around an installed package
        return None
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    environment["GIT_OPTIONAL_LOCKS"] = "0"  # read only
    try:
        result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):  # no git, no commit yet, another user's checkout
        return None
    return result.stdout.strip() or None
