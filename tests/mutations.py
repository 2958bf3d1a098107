"""Mutations of scenes, and what holds of any call with one: an end in time, a result without nan or a clear error."""

from __future__ import annotations

import copy
import math
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import xarray as xr
from hypothesis import event
from hypothesis import strategies as st
from numba.core import event as numba_event
from scenes import spatial

import cablepod as cp

#: A job that takes longer than this, compilation apart, counts as hanging [s of processor time: other load does not count].
HANGS = 10.0
NUMBERS = st.one_of(
    st.sampled_from([0, 1, -1, 2, 0.0, -0.0, 1e-320, 1e-30, 1e-9, 1e9, 1e30, 1e300, 10**400, 2**63, True]),
    st.sampled_from([math.nan, math.inf, -math.inf]),
    st.floats(),
    st.floats(1e-3, 1e3),
    st.integers(-5, 50),
)
JUNK = st.one_of(
    NUMBERS,
    st.none(),
    st.sampled_from(
        ["", " ", "upper", "lower", "ramp", "file", "é\n", [], {}, [[]], [1.0], [1.0, 2.0], [1.0, 2.0, 3.0], {"x": 1}]
    ),
    st.lists(NUMBERS, max_size=4),
    st.sampled_from([np.float64(3.0), np.int8(3), np.zeros(2), np.array(2.5), 1j, b"2", object()]),
)
CHANGES = (*["nudge"] * 6, *["scale"] * 4, *["negate"] * 2, "junk", "delete", "copy", "add", "longer")
NAMES = (
    "x", "z", "kind", "amplitude", "duration", "links", "free", "force", "density", "uniform", "no_such_key", "", "a.b", 5,
)  # fmt: skip


def places(tree: Any) -> list[tuple[Any, Any]]:
    """List all (container, key) of a nested value."""
    found = []
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        found += [(tree, key), *places(value)]
    return found


def is_real(value: Any) -> bool:
    """Tell a number that can be scaled."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e290


@st.composite
def mutated(draw: st.DrawFn, bases: tuple[dict[str, Any], ...]) -> dict[str, Any]:
    """Draw a valid scene with one to three changes that a user, a program or an accident could make."""
    scene = copy.deepcopy(draw(st.sampled_from(bases)))
    if draw(st.integers(0, 19)) == 19:
        scene = spatial(scene)
    for _ in range(draw(st.sampled_from([1, 1, 2, 3]))):
        change = draw(st.sampled_from(CHANGES))
        found = places(scene)
        if change in ("nudge", "scale", "negate"):
            found = [(container, key) for container, key in found if is_real(container[key])]
        if not found:
            continue
        container, key = draw(st.sampled_from(found))
        value = container[key]
        if change == "scale":
            container[key] = value * 10.0 ** draw(st.integers(-8, 8))
        elif change == "nudge":
            container[key] = (
                value * draw(st.floats(0.3, 3.0)) if isinstance(value, float) else value + draw(st.integers(-3, 9))
            )
        elif change == "negate":
            container[key] = -value
        elif change == "delete":
            del container[key]
        elif change == "copy":
            other, its = draw(st.sampled_from(found))
            container[key] = copy.deepcopy(other[its])
        elif change == "add" and isinstance(container, dict):
            container[draw(st.sampled_from(NAMES))] = draw(JUNK)
        elif change == "longer" and isinstance(value, list):
            container[key] = [*value, draw(JUNK)]
        else:
            container[key] = draw(JUNK)
    return scene


class HangError(Exception):
    """A job did not end in time."""


@contextmanager
def in_time() -> Iterator[None]:
    """Raise where the body takes longer than HANGS, the compilation of kernels apart."""
    with numba_event.install_recorder("numba:compile") as compiled:
        seen = [0]

        def ring(*_: object) -> None:
            count = len(compiled.buffer)
            if count == seen[0] and count % 2 == 0:  # a begin and an end each: an odd number of them is one at work
                raise HangError(f"more than {HANGS:g} s")
            seen[0] = count
            signal.setitimer(signal.ITIMER_PROF, HANGS)

        before = signal.signal(signal.SIGPROF, ring)
        signal.setitimer(signal.ITIMER_PROF, HANGS)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, before)


def finite(dataset: xr.Dataset) -> None:
    """Hold that no number of a result is nan or infinite."""
    for name, variable in dataset.variables.items():
        if variable.dtype.kind == "f":
            assert np.isfinite(variable.values).all(), f"{dataset.attrs.get('title')}: {name} is not finite"


def clear(error: Exception) -> None:
    """Hold that an error is one line that says what is wrong and what to do."""
    text = str(error)
    assert "\n" not in text
    assert len(text) < 1000
    assert "; allowed: " in text if isinstance(error, cp.SceneError) else "; try " in text, text


def tried(what: str, function: Any, *arguments: Any, **options: Any) -> xr.Dataset | None:
    """Call `function`: a result without nan, or None after a clear error."""
    try:
        result = function(*arguments, **options)
    except cp.SceneError as error:
        event(f"{what}: refused")
        clear(error)
        return None
    except cp.RunStopped as error:
        event(f"{what}: stopped")
        clear(error)
        if error.partial is not None:
            finite(error.partial)
        return None
    event(f"{what}: a result")
    finite(result)
    return result
