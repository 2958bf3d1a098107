"""What a caller asks of a run: instants, outputs, scheme, step and tolerance, checked."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from cablepod.conventions import OUTPUTS
from cablepod.errors import NotConvergedWarning, SceneError, scene_error
from cablepod.parameters._checks import number
from cablepod.parameters._parameters import Parameters

#: Time error that a run without scheme, step or tolerance keeps, as a fraction of the motion.
DEFAULT_TOLERANCE = 1e-6
#: A given step longer than this part of that time is warned of.
MAX_STEP_SHARE = 0.25


def check_times(times: Any) -> np.ndarray:
    """Check instants that a caller gives: finite, from 0 on, rising; returns them as floats [s]."""
    try:
        result = np.atleast_1d(np.asarray(times, dtype=float))
    except (TypeError, ValueError):
        raise scene_error("times", times, "finite, rising instants from 0 on [s]") from None
    if (
        result.ndim != 1
        or result.size == 0
        or not np.isfinite(result).all()
        or result[0] < 0
        or (np.diff(result) <= 0).any()
    ):
        raise scene_error("times", times, "finite, rising instants from 0 on [s]")
    return result


def check_outputs(outputs: Any, allowed: tuple[str, ...] = OUTPUTS) -> tuple[str, ...]:
    """Check the names of the outputs."""
    names = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    for name in names:
        if name not in allowed:
            raise scene_error("outputs", name, "some of " + ", ".join(allowed))
    return names


def check_positive(key: str, value: Any) -> float:
    """Check an option that must be a finite positive number."""
    return number(above=0.0)(key, value)


def check_scheme(scheme: str | None, allowed: tuple[str, ...]) -> str:
    """Check the name of a scheme; None means the first of those allowed."""
    if scheme is None:
        return allowed[0]
    if scheme not in allowed:
        raise scene_error("scheme", scheme, "one of " + ", ".join(f'"{name}"' for name in allowed))
    return scheme


def implicit_steps_per_second(step: Any, until: float, time_scale: float) -> float:
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
    if step > MAX_STEP_SHARE * time_scale:
        warnings.warn(
            f"step: given {step:.6g} s, of which only {time_scale / step:.2g} fit into the shortest time over which motions and "
            f"loads change, {time_scale:.4g} s: they are not resolved, though the run is stable; give a step below "
            f"{MAX_STEP_SHARE * time_scale:.3g} s, or a tolerance instead",
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


@dataclass(frozen=True, kw_only=True)
class Request:
    """What a caller asks of a run, checked as far as no scene is needed for that."""

    times: np.ndarray | None = None  #: instants of the output [s], those of the scene by default
    scheme: str | None = None  #: by default the model chooses
    step: float | None = None  #: [s], by default chosen by the tolerance
    given_tolerance: float | None = None  #: of the time error, as a fraction of the motion
    outputs: tuple[str, ...] = ("position",)

    @classmethod
    def of(
        cls,
        *,
        times: Any = None,
        scheme: str | None = None,
        schemes: tuple[str, ...] = (),
        step: Any = None,
        tolerance: Any = None,
        outputs: Any = ("position",),
        allowed: tuple[str, ...] = OUTPUTS,
        **others: Any,
    ) -> Self:
        """Check what a caller gives.

        Parameters
        ----------
        times, scheme, step, tolerance, outputs
            As the caller gives them; None for those left to the model.
        schemes, allowed
            Names of the schemes and outputs that the model has.
        **others
            Further fields of a model's own request.

        Raises
        ------
        SceneError
            For names that the model does not have, instants that do not rise, a step beside a tolerance, and numbers that are
            not positive.
        """
        if schemes:
            check_scheme(scheme, schemes)
        names = check_outputs(outputs, allowed)
        if step is not None and tolerance is not None:
            raise scene_error("step and tolerance", (step, tolerance), "one of them: a tolerance chooses the step")
        return cls(
            times=None if times is None else check_times(times),
            scheme=scheme,
            step=None if step is None else check_positive("step", step),
            given_tolerance=None if tolerance is None else check_positive("tolerance", tolerance),
            outputs=names,
            **others,
        )

    @property
    def tolerance(self) -> float:
        """Time error that a run without a given step keeps, as a fraction of the motion."""
        return DEFAULT_TOLERANCE if self.given_tolerance is None else self.given_tolerance

    @property
    def recorded_tolerance(self) -> float | None:
        """Tolerance as the history of a result tells it: none where the step is given."""
        return None if self.step is not None else self.tolerance

    def instants(self, p: Parameters) -> np.ndarray:
        """Return the instants of the output [s], which records of motions and loads must cover.

        Raises
        ------
        SceneError
            For a record that is too short, and a scene without instants where none are asked for.
        """
        instants = p.times() if self.times is None else self.times
        p.check_reach(float(instants[-1]))
        return instants
