"""Checks of a requested run: output times, outputs, scheme, step and tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import check_times
from cablepod.conventions import OUTPUTS
from cablepod.errors import NotConvergedWarning, SceneError, did_you_mean, scene_error, warn
from cablepod.integrate._means import wants_means
from cablepod.integrate._window import ROUNDING
from cablepod.parameters._checks import choice, number
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._time_functions import check_reach

#: Default tolerance of the time error of full models, as a fraction of the motion; the least that reduced models ask for by
#: themselves, and their default where they have no estimate of their modes.
DEFAULT_TOLERANCE, REDUCED_TOLERANCE = 1e-4, 1e-6
#: Default time error of reduced models over their estimated error.
TIME_ERROR_SHARE = 0.1
#: Maximum given step without a warning, as a fraction of the shortest time scale of motions and loads.
MAX_STEP_RATIO = 0.25
#: Maximum number of steps of a given length (weeks), and without a warning (some minutes of a chain of 40 links); number of steps
#: in a minute of the fastest models.
MAX_GIVEN_STEPS, MAX_SILENT_STEPS, STEPS_PER_MINUTE = 1e13, 1e9, 6e8


def check_outputs(outputs: Any, allowed: tuple[str, ...] = OUTPUTS) -> tuple[str, ...]:
    """Return the names of the outputs as a tuple; refuse unknown ones."""
    try:
        names = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    except TypeError:
        names = (outputs,)
    for name in names:
        if not isinstance(name, str) or name not in allowed:
            raise scene_error("outputs", name, "some of " + ", ".join(allowed) + did_you_mean(name, allowed))
    return names


def check_window(window: Any) -> tuple[float, float]:
    """Return a window as two floats [s]; refuse others than finite, rising, not negative ones."""
    allowed = "two finite instants (start, end) of the run with start < end [s]"
    try:
        ends = tuple(number(least=0.0)("window", instant) for instant in window)
    except (TypeError, SceneError):
        raise scene_error("window", window, allowed) from None
    if len(ends) != 2 or ends[0] >= ends[1]:
        raise scene_error("window", window, allowed)
    return ends[0], ends[1]


def check_in_run(window: tuple[float, float], end_time: float) -> None:
    """Refuse a window [s] that ends after the run [s]."""
    if window[1] > end_time * (1.0 + ROUNDING):
        raise scene_error("window", window, f"a part of the run, from 0 s to {end_time:g} s")


def check_progress(progress: Any) -> None:
    """Refuse a callback that is none."""
    if progress is not None and not callable(progress):
        raise scene_error("progress", progress, "a function of the completed fraction, or None")


def check_positive(key: str, value: Any) -> float:
    """Return an option as a float; refuse it unless it is finite and positive."""
    return number(above=0.0)(key, value)


def check_scheme(scheme: str | None, allowed: tuple[str, ...]) -> str:
    """Return the name of a scheme, the first one for None; refuse unknown names."""
    return allowed[0] if scheme is None else str(choice(*allowed)("scheme", scheme))


def check_resolved(step: float, time_scale: float) -> None:
    """Warn if a given step [s] does not resolve motions and loads with the shortest time scale `time_scale` [s].

    Warns
    -----
    NotConvergedWarning
        With both numbers; the stability limit does not exclude such steps.
    """
    if step > MAX_STEP_RATIO * time_scale:
        warn(
            f"step: given {step:.6g} s does not resolve motions and loads, with {time_scale / step:.2g} steps in their shortest "
            f"time scale of {time_scale:.4g} s; give a step below {MAX_STEP_RATIO * time_scale:.3g} s, or a tolerance instead",
            NotConvergedWarning,
        )


def check_step(step: Any, limit: float, formula: str) -> float:
    """Return a given step [s] as a float; refuse it at or above the stability limit [s].

    `formula` says how the limit follows.

    Raises
    ------
    SceneError
        With both numbers.
    """
    value = check_positive("step", step)
    if value >= limit:
        raise SceneError(f"step: given {value:.6g} s; allowed: below the stability limit, {limit:.6g} s, {formula}")
    return value


def check_steps(step: float, end_time: float) -> None:
    """Refuse a given step [s] with more steps than anybody waits for, and announce a long run before it begins.

    Warns
    -----
    UserWarning
        With the number of steps, and the least time that they may take.
    """
    steps = end_time / step
    if steps > MAX_GIVEN_STEPS:
        raise scene_error("step", step, f"at least {end_time / MAX_GIVEN_STEPS:.3g} s, for {end_time:g} s of time")
    if steps > MAX_SILENT_STEPS:
        warn(
            f"step: given {step:.6g} s takes {steps:.3g} steps, {steps / STEPS_PER_MINUTE:.2g} minutes or longer; "
            "try a longer step, or a tolerance instead"
        )


@dataclass(frozen=True, kw_only=True)
class Request:
    """Options of a run, checked as far as possible without a scene."""

    times: np.ndarray | None = None  #: output times [s], by default those of the scene
    scheme: str | None = None  #: by default chosen by the model
    step: float | None = None  #: [s], by default chosen by the tolerance
    given_tolerance: float | None = None  #: of the time error, as a fraction of the motion
    outputs: tuple[str, ...] = ("position",)
    default_tolerance: float = DEFAULT_TOLERANCE  #: without a given one
    window: tuple[float, float] | None = None  #: part of the run of extremes and means [s], None for all
    progress: Rising | None = None  #: receives the completed fraction of each run

    @classmethod
    def of(
        cls,
        *,
        times: Any = None,
        scheme: str | None = None,
        schemes: tuple[str, ...] = (),
        step: Any = None,
        tolerance: Any = None,
        outputs: Any = ("position", "tension"),
        allowed: tuple[str, ...] = OUTPUTS,
        window: Any = None,
        progress: Callable[[float], None] | None = None,
        several: bool | None = None,
        **others: Any,
    ) -> Self:
        """Check the options of a run.

        Parameters
        ----------
        times, scheme, step, tolerance, outputs
            As given by the caller; None for the default of the model.
        schemes, allowed
            Names of the schemes and outputs that the model has.
        window
            Start and end of the part of the run over which extremes and means are taken [s].
        progress
            Callback receiving the completed fraction, 0 to 1.
        several
            Whether a call has several runs; by default without a given step.
        **others
            Further fields of a model's own request.

        Raises
        ------
        SceneError
            For unknown names, times that do not rise, a step together with a tolerance, and numbers that are not positive.
        """
        if schemes:
            check_scheme(scheme, schemes)
        names = check_outputs(outputs, allowed)
        if "tension_peaks" in names and "tension_extremes" not in names:
            raise scene_error("outputs", names, '"tension_extremes" beside "tension_peaks"')
        if step is not None and tolerance is not None:
            raise scene_error("step and tolerance", (step, tolerance), "one of them: a tolerance chooses the step")
        check_progress(progress)
        if window is not None:
            window = check_window(window)
            if "tension_extremes" not in names and not wants_means(names):
                needed = (
                    'none without the output "tension_extremes", "tension_mean" or "tension_rms", which it restricts'
                )
                raise scene_error("window", window, needed)
        return cls(
            times=None if times is None else check_times(times),
            scheme=scheme,
            step=None if step is None else check_positive("step", step),
            given_tolerance=None if tolerance is None else check_positive("tolerance", tolerance),
            outputs=names,
            window=window,
            progress=None
            if progress is None
            else Rising(progress, several=step is None if several is None else several),
            **others,
        )

    @property
    def tolerance(self) -> float:
        """Tolerance of the time error of a run without a given step, as a fraction of the motion."""
        return self.default_tolerance if self.given_tolerance is None else self.given_tolerance

    def of_run(self, times: np.ndarray, **others: Any) -> dict[str, Any]:
        """Return what every :class:`cablepod.integrate._run.Run` takes of a request, with the output times [s], and others."""
        shared = {"times": times, "outputs": self.outputs, "progress": self.progress, "window": self.window}
        return shared | others

    def instants(self, p: Parameters) -> np.ndarray:
        """Return the output times [s], within the records of motions and loads.

        Raises
        ------
        SceneError
            For a record that ends too early, and for a scene without times if none are given.
        """
        times = p.times() if self.times is None else self.times
        check_reach(p.time_functions(), float(times[-1]))
        if self.step is not None:
            check_steps(self.step, float(times[-1]))
        if self.window is not None:
            check_in_run(self.window, float(times[-1]))
        return times

    def steps_per_second(self, p: Parameters, end_time: float, limit: float | None, formula: str = "") -> float | None:
        """Return the steps per second of the given step, None without one.

        Parameters
        ----------
        p, end_time
            Parameters of the scene, and the end of the run [s].
        limit
            Stability limit of an explicit step [s]; None for implicit ones, whose step is at most the run.
        formula
            How the limit follows, and which schemes have none.

        Raises
        ------
        SceneError
            For a step that is too long.
        """
        if self.step is None:
            return None
        if limit is not None:
            return 1.0 / check_step(self.step, limit, formula)
        value = number(above=0.0, most=end_time or math.inf)("step", self.step)
        check_resolved(value, p.shortest_time_scale)
        return 1.0 / value

    def record(
        self,
        result: xr.Dataset,
        *,
        function: str,
        inputs: list[xr.Dataset],
        given: Mapping[str, Any],
        scene_digest: str | None = None,
        **parameters: Any,
    ) -> xr.Dataset:
        """Append a run to the history of its result, in place, see :func:`cablepod.provenance.record`.

        Parameters
        ----------
        result, function, inputs, scene_digest
            As there.
        given
            Options of the model as the caller gave them; those that are None count as chosen.
        **parameters
            Options of the model with defaults filled in; those of the request are added.
        """
        if self.progress is not None:
            self.progress.end()
        resolved = {
            "times": result.variables["time"].values,
            "step": result.attrs.get("step") if self.step is None else self.step,
            "tolerance": None if self.step is not None else self.tolerance,
            "outputs": list(self.outputs),
            **({} if self.window is None else {"window": list(self.window)}),
        }
        chosen = provenance.defaulted_options(times=self.times, step=self.step, tolerance=self.given_tolerance, **given)
        return provenance.record(
            result,
            function=function,
            parameters=resolved | parameters,
            inputs=inputs,
            chosen=chosen,
            scene_digest=scene_digest,
        )


class Rising:
    """Callback of the runs of one call; passes on fractions that never fall and end at 1.

    How many runs follow is known of a given step only.  Otherwise each run takes half of what is left: the first one ends at 1/2,
    the second one at 3/4.
    """

    def __init__(self, progress: Callable[[float], None], *, several: bool) -> None:
        self.progress, self.several = progress, several
        self._last = self._begin = 0.0

    def __call__(self, fraction: float) -> None:
        """Report the completed fraction of the present run; one that is not above the last begins a new run."""
        if self.several:
            if fraction <= self._last:
                self._begin = 0.5 * (1.0 + self._begin)
            self._last = fraction
            fraction = self._begin + 0.5 * (1.0 - self._begin) * fraction
        self.progress(fraction)

    def end(self) -> None:
        """Report that the call is done."""
        if self.several:
            self.progress(1.0)
