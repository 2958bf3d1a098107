"""What a caller asks of a run: instants, outputs, scheme, step and tolerance, checked."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from cablepod.conventions import OUTPUTS
from cablepod.errors import NotConvergedWarning, SceneError, refuse
from cablepod.parameters._checks import number

#: Time error that a run without scheme, step or tolerance keeps, as a fraction of the motion.
DEFAULT_TOLERANCE = 1e-6
#: A given step longer than this part of that time is warned of.
LONGEST_PART = 0.25


def check_times(times: Any) -> np.ndarray:
    """Check instants that a caller gives: finite, from 0 on, rising; returns them as floats [s]."""
    try:
        result = np.atleast_1d(np.asarray(times, dtype=float))
    except (TypeError, ValueError):
        raise refuse("times", times, "finite, rising instants from 0 on [s]") from None
    if (
        result.ndim != 1
        or result.size == 0
        or not np.isfinite(result).all()
        or result[0] < 0
        or (np.diff(result) <= 0).any()
    ):
        raise refuse("times", times, "finite, rising instants from 0 on [s]")
    return result


def check_outputs(outputs: Any, allowed: tuple[str, ...] = OUTPUTS) -> tuple[str, ...]:
    """Check the names of the outputs."""
    names = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    for name in names:
        if name not in allowed:
            raise refuse("outputs", name, "some of " + ", ".join(allowed))
    return names


def check_positive(key: str, value: Any) -> float:
    """Check an option that must be a finite positive number."""
    return number(above=0.0)(key, value)


def check_scheme(scheme: str | None, allowed: tuple[str, ...]) -> str:
    """Check the name of a scheme; None means the first of those allowed."""
    if scheme is None:
        return allowed[0]
    if scheme not in allowed:
        raise refuse("scheme", scheme, "one of " + ", ".join(f'"{name}"' for name in allowed))
    return scheme


def implicit_rate(step: Any, until: float, time_scale: float) -> float:
    """Return the steps per second of an implicit run to a time [s], whose step a caller gives; see :func:`check_resolved`."""
    value = number(above=0.0, most=until or math.inf)("step", step)
    check_resolved(value, time_scale, stacklevel=5)
    return 1.0 / value


def check_resolved(step: float, time_scale: float, *, stacklevel: int = 4) -> None:
    """Warn where a given step [s] does not resolve motions and loads that change within `time_scale` [s].

    Warns
    -----
    NotConvergedWarning
        With both numbers; no limit of stability forbids such steps.
    """
    if step > LONGEST_PART * time_scale:
        warnings.warn(
            f"step: given {step:.6g} s, of which only {time_scale / step:.2g} fit into the shortest time over which motions and "
            f"loads change, {time_scale:.4g} s: they are not resolved, though the run is stable; give a step below "
            f"{LONGEST_PART * time_scale:.3g} s, or a tolerance instead",
            NotConvergedWarning,
            stacklevel=stacklevel,
        )


def check_step(step: Any, limit: float, what: str) -> float:
    """Check a step that a caller gives against the stability limit [s].

    Raises
    ------
    SceneError
        With both numbers.
    """
    value = check_positive("step", step)
    if value >= limit:
        raise SceneError(f"step: given {value:.6g} s; allowed: below the stability limit, {limit:.6g} s, {what}")
    return value
