"""Errors and warnings of the package, and the form of their messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr


class SceneError(ValueError):
    """What a user gave cannot be a scene; the message names the key, what was given and what is allowed."""


def scene_error(key: str, given: Any, allowed: str) -> SceneError:
    """Make the error for `key`: what was `given` and what is `allowed`."""
    return SceneError(f"{key}: given {shown(given)}; allowed: {allowed}")


def shown(given: Any) -> str:
    """Write what was given in at most 120 characters, whatever it is."""
    try:
        text = repr(given.item() if isinstance(given, np.generic) else given)
    except Exception:  # too deep, a number too long to write, an object that cannot say what it is
        text = f"something of type {type(given).__name__} that cannot be shown"
    return text if len(text) <= 120 else text[:117] + "..."


def named(name: Any) -> str:
    """Write the name of a key or file: as it is where that makes one short line, otherwise as :func:`shown` does."""
    return name if isinstance(name, str) and name.isprintable() and 0 < len(name) <= 300 else shown(name)


class RunStopped(RuntimeError):  # it names what happened; the run may have been asked to end there
    """A run left the finite numbers; `partial` is the Dataset computed until then, marked incomplete."""

    def __init__(self, message: str, partial: xr.Dataset | None = None) -> None:
        super().__init__(message)
        self.partial = partial


class NotConvergedWarning(UserWarning):
    """Two steps disagree by more than the tolerance: the motion is chaotic or needs a shorter step."""


class ArchiveError(ValueError):
    """A dataset that cannot be written, or a file that cannot be read; the message says which, why and what to do."""


class MemberFailedWarning(UserWarning):
    """Some members failed; they hold nan, and the variable ``failure`` says why."""


class AllFailedError(Exception):
    """The cause of the error that is raised where all members fail; `reasons` has those of each."""

    def __init__(self, reasons: list[str]) -> None:
        super().__init__(f"all {len(reasons)} members failed")
        self.reasons = reasons


class StoppedError(Exception):
    """Members were stopped on demand, see :func:`until`."""


class OutOfRangeWarning(UserWarning):
    """A reduced model was used where it cannot be trusted; the message says which number decides."""
