"""Errors and warnings of the package, and the form of their messages."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

#: C0 but newline and tab, DEL, C1, line separators, marks and overrides of direction, surrogates.
UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


class SceneError(ValueError):
    """Invalid input; the message names the key, the given value and the allowed ones."""


def scene_error(key: str, given: Any, allowed: str) -> SceneError:
    """Make the error of `key` with the `given` value and the `allowed` ones."""
    return SceneError(f"{key}: given {shown(given)}; allowed: {allowed}")


def shown(given: Any) -> str:
    """Return a value as text of at most 120 characters."""
    try:
        text = repr(given.item() if isinstance(given, np.generic) else given)
    except Exception:  # nested too deeply, an integer with too many digits, a failing __repr__
        text = f"something of type {type(given).__name__} that cannot be shown"
    text = " ".join(text.split())  # one line
    return text if len(text) <= 120 else text[:117] + "..."


def printable(text: str) -> str:
    """Return a text with escapes for characters that control a terminal or the direction of text, but newlines and tabs."""
    return text if text.isascii() and text.isprintable() else UNPRINTABLE.sub(_escape, text)


def _escape(found: re.Match[str]) -> str:
    """Return a character as in the repr of a text."""
    return found[0].encode("unicode_escape", "surrogatepass").decode()


def named(name: Any) -> str:
    """Return a name unchanged if it is one short line, otherwise as :func:`shown`."""
    return name if isinstance(name, str) and name.isprintable() and 0 < len(name) <= 300 else shown(name)


class RunStopped(RuntimeError):
    """A run was stopped, for example because it diverged; `partial` is the Dataset up to then, marked incomplete."""

    def __init__(self, message: str, partial: xr.Dataset | None = None) -> None:
        super().__init__(message)
        self.partial = partial


class NotConvergedWarning(UserWarning):
    """Runs with two time steps differ by more than the tolerance."""


class ArchiveError(ValueError):
    """A file that cannot be written or read; the message names it, the reason and a remedy."""


class MemberFailedWarning(UserWarning):
    """Some members failed; they hold nan, with the reason in the variable ``failure``."""


class AllFailedError(Exception):
    """Cause of the error raised if all members fail; `reasons` holds the message of each."""

    def __init__(self, reasons: list[str]) -> None:
        super().__init__(f"all {len(reasons)} members failed")
        self.reasons = reasons


class StoppedError(Exception):
    """Members were stopped on request, see :func:`cablepod.batch._members.stop_when`."""


class VelocityJumpWarning(UserWarning):
    """An end starts from rest with a nonzero speed; the message names the axial wave that this sends out, and a remedy."""


class CoarseWarning(UserWarning):
    """Links, elements or instants are likely too few for the motion; the message names how many are likely needed."""


class OutOfRangeWarning(UserWarning):
    """A reduced model was used outside its range of validity; the message names the deciding diagnostic."""


class UnusualSceneWarning(UserWarning):
    """A scene has an unusual value, such as a density of 8 kg/m3; the message names the key that is likely wrong."""


class WorkersWarning(UserWarning):
    """The run of an ensemble waits for workers, or does not use some; the message says which and why."""


def closest(name: Any, allowed: Iterable[str]) -> list[str]:
    """Return up to two of the `allowed` words that resemble `name`, the most similar first."""
    if not isinstance(name, str) or not 0 < len(name) <= 60:
        return []
    from difflib import SequenceMatcher  # only for messages

    word, scores = name.lower().replace("-", "_"), {}
    for candidate in allowed:
        score = SequenceMatcher(None, word, candidate.lower()).ratio()
        # a part of a name, such as modulus of youngs_modulus
        scores[candidate] = max(score, 0.75 if len(word) > 2 and word in candidate.lower().split("_") else 0.0)
    similar = sorted((word for word in scores if scores[word] >= 0.65), key=lambda word: -scores[word])
    return [word for word in similar if scores[word] > scores[similar[0]] - 0.1][:2]


def did_you_mean(name: Any, allowed: Iterable[str], prefix: str = "") -> str:
    """Return the remedy of a message, "; try: ..." with the allowed words that resemble `name`; empty without any."""
    similar = [prefix + word for word in closest(name, allowed)]
    return f"; try: {' or '.join(similar)}" if similar else ""


def one_of(allowed: Iterable[str], given: Any) -> str:
    """Return the field "allowed" of a choice of words, with the remedy where `given` resembles one of them."""
    words = list(allowed)
    return "one of " + ", ".join(f'"{word}"' for word in words) + did_you_mean(given, words)


def warn(text: str | Warning, category: type[Warning] = UserWarning) -> None:
    """Warn at the first line outside this package."""
    frame, level = sys._getframe(), 1
    inside = ("cablepod", "contextlib")
    while frame.f_back is not None and str(frame.f_globals.get("__name__", "")).partition(".")[0] in inside:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)
