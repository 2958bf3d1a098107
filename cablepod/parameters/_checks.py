"""Checks of single values: numbers, lists, points, texts, choices."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable
from typing import Any

import numpy as np

from cablepod.errors import one_of, scene_error

#: Minimum of positive numbers of a scene and maximum magnitude of all (squares and ratios stay finite).
SMALLEST, LARGEST = 1e-30, 1e30
#: Maximum whole number, of seeds too: tables of members and record may hold it as a float, which has all up to here.
WHOLE = 2**53
#: What Python or numpy call a number, and is none here.
NO_NUMBERS = (bool, np.bool_, np.timedelta64)
#: Direction normal to the chord at rest, in its vertical plane.
NORMAL = "normal"
Check = Callable[[str, Any], Any]


def number(
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
    mistaken: tuple[float, str] | None = None,
) -> Check:
    """Make a check of a finite number within bounds; `mistaken` is a unit, factor and name, in which it is given by mistake."""
    bounds = [
        f"above {above:g}" if above > -math.inf else "",
        f"of at least {least:g}" if least > -math.inf else "",
        f"of at most {most:g}" if most < math.inf else "",
    ]
    allowed = " ".join(["a finite number", " and ".join(text for text in bounds if text)]).strip()

    def check(key: str, value: Any) -> float:
        value = _scalar(value)
        if isinstance(value, NO_NUMBERS) or not isinstance(value, numbers.Real):
            raise scene_error(key, value, allowed)
        try:
            result = float(value)
        except OverflowError:
            raise scene_error(key, value, allowed) from None
        if not math.isfinite(result) or result <= above or result < least or result > most:
            remedy = ""
            if mistaken is not None and most < result < math.inf and result * mistaken[0] <= most:
                remedy = f"; try: {result * mistaken[0]:.6g} (given in {mistaken[1]}?)"
            raise scene_error(key, value, allowed + remedy)
        if isinstance(value, numbers.Integral) and int(value) != result:  # seeds that differ would become equal
            raise scene_error(key, value, f"{allowed}, a whole one of at most 2**53 = {WHOLE}")
        if abs(result) > LARGEST or (above >= 0.0 and result < SMALLEST):
            raise scene_error(key, value, f"{allowed}, of a size from {SMALLEST:g} to {LARGEST:g}")
        return result

    return check


def _scalar(value: Any) -> Any:
    return value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value


def integer(*, least: int, most: int = WHOLE) -> Check:
    """Make a check of a whole number from `least` to `most`."""
    allowed = f"a whole number of at least {least}"

    def check(key: str, value: Any) -> int:
        value = _scalar(value)
        if isinstance(value, NO_NUMBERS) or not isinstance(value, numbers.Integral) or int(value) < least:
            raise scene_error(key, value, allowed)
        if int(value) > most:
            raise scene_error(key, value, f"{allowed} and at most {most}")
        return int(value)

    return check


def plain(value: Any) -> Any:
    """Return a value as Python holds it, for messages."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)


def numbers_list(
    *, least_length: int = 1, above: float = -math.inf, least: float = -math.inf, most: float = math.inf
) -> Check:
    """Make a check of a list of finite numbers within bounds."""
    check_number = number(above=above, least=least, most=most)

    def check(key: str, value: Any) -> list[float]:
        if not _is_list(value) or len(value) < least_length:
            raise scene_error(key, value, f"a list of at least {least_length} finite numbers")
        return [check_number(f"{key}[{index}]", entry) for index, entry in enumerate(value)]

    return check


def point(key: str, value: Any) -> list[float]:
    """Check a vector of two or three finite numbers."""
    if not _is_list(value) or len(value) not in (2, 3):
        raise scene_error(key, value, "a list of two or three finite numbers")
    check_number = number()
    return [check_number(f"{key}[{index}]", component) for index, component in enumerate(value)]


def direction(key: str, value: Any) -> str | list[float]:
    """Check a direction: "normal", or a vector of two or three numbers, not all zero."""
    if isinstance(value, str):
        return choice(NORMAL)(key, value)
    vector = point(key, value)
    if not any(vector):
        raise scene_error(key, value, f'"{NORMAL}", or a vector other than zero')
    return vector


def points(key: str, value: Any) -> list[list[float]]:
    """Check a list of at least two points."""
    if not _is_list(value) or len(value) < 2:
        raise scene_error(key, value, "a list of at least two points")
    return [point(f"{key}[{index}]", vector) for index, vector in enumerate(value)]


def text(key: str, value: Any) -> str:
    """Check a text that is not empty."""
    if not isinstance(value, str) or not value.strip():
        raise scene_error(key, value, "a text that is not empty")
    return value


def truth(key: str, value: Any) -> bool:
    """Check a truth value."""
    value = _scalar(value)
    if not isinstance(value, bool | np.bool_):
        raise scene_error(key, value, "true or false")
    return bool(value)


def choice(*allowed: str) -> Check:
    """Make a check of a choice of words."""

    def check(key: str, value: Any) -> str:
        if not isinstance(value, str) or value not in allowed:
            raise scene_error(key, value, one_of(allowed, value))
        return value

    return check
