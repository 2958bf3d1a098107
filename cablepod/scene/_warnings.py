"""The warning of the models of what is unusual in a scene."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator, Sequence, Sized
from contextvars import ContextVar
from typing import Any, TypeVar, cast

import numpy as np
import xarray as xr

from cablepod.batch._members import inside_members
from cablepod.errors import SceneError, UnusualSceneWarning, warn
from cablepod.parameters._from_scene import Members
from cablepod.parameters._parameters import Parameters
from cablepod.scene._note import Note
from cablepod.scene._notes import likely_keys, notes_of, remedy

F = TypeVar("F", bound=Callable[..., Any])
#: Number of scenes whose warnings are kept.
KEPT_WARNINGS = 64
#: Maximum number of members that the models look at.
MEMBERS_CHECKED = 5

#: Whether the function that is running has warned; None outside of functions that warn once.
_WARNED: ContextVar[list[bool] | None] = ContextVar("warned", default=None)


def warn_once(function: F) -> F:
    """Decorate a function that calls several models on one scene: the first warns of what is unusual, the others do not."""

    @functools.wraps(function)
    def wrapper(*args: Any, **options: Any) -> Any:
        token = _WARNED.set([])
        try:
            return function(*args, **options)
        finally:
            _WARNED.reset(token)

    return cast(F, wrapper)


@contextlib.contextmanager
def without_warnings() -> Iterator[None]:
    """Do not warn of what is unusual within this context, whose result tells it."""
    token = _WARNED.set([True])
    try:
        yield
    finally:
        _WARNED.reset(token)


def warn_of_unusual(p: Parameters) -> None:
    """Warn of the worst note on a scene, at the user's line; a fraction of a microsecond for parameters seen before."""
    warn_with(_warning(p))


def may_warn() -> bool:
    """Tell whether a warning of what is unusual would be given: not within members, and once in functions that warn once."""
    return not _WARNED.get() and not inside_members()


def warn_with(text: str) -> None:
    """Warn with a text of what is unusual, at the user's line; not with an empty one."""
    if text and may_warn():
        warned = _WARNED.get()
        if warned is not None:
            warned.append(True)
        warn(f"{text}; see cp.summary(scene) or cablepod check", UnusualSceneWarning)


def checked_members(members: Sized) -> list[int]:
    """Return up to :data:`MEMBERS_CHECKED` members that the models look at, the first and the last among them."""
    found: list[int] = np.unique(np.linspace(0, len(members) - 1, MEMBERS_CHECKED).astype(int)).tolist()
    return found


def warn_of_unusual_members(scene: xr.Dataset) -> None:
    """Warn of the worst note on up to :data:`MEMBERS_CHECKED` members of a scene, the first and the last among them."""
    members = Members(scene)
    for index in checked_members(members):
        try:
            p = members[index]
        except SceneError:  # the run of that member says why
            continue
        if _warning(p):
            warn_of_unusual(p)
            return


@functools.lru_cache(KEPT_WARNINGS)
def _warning(p: Parameters) -> str:
    """Return the text of the warning of a scene, empty for a usual one; kept, as parameters of equal scenes are one object."""
    try:
        with np.errstate(all="ignore"):
            notes = notes_of(p)
    except (SceneError, ArithmeticError):
        return ""  # the model refuses the scene, or does not need an equilibrium
    return text_of_warning(notes, likely_keys(p) if notes else [])


def text_of_warning(notes: Sequence[Note], changes: list[tuple[str, str]]) -> str:
    """Return the text of the warning of notes and of the changes of keys that explain the first; empty without notes."""
    if not notes:
        return ""
    key = changes[0][0] if changes else notes[0].key
    more = f", and {len(notes) - 1} more" if len(notes) > 1 else ""
    return f"{key}: the scene has {notes[0].text}{more}{remedy(changes)}"
