"""Time functions: the motions of the ends and the factors of the loads.

One class evaluates every kind and its first two derivatives at arrays of times.  Time steppers receive tables of values at
their steps.  With g the formula of the kind or the spline of the record, and s the quintic step from 0 to 1, a displacement is
s(t / ramp) (g(t) - g(0)), and a load factor g(0) + s(t / ramp) (g(t) - g(0)); s is absent without a ramp.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablepod.errors import SceneError
from cablepod.parameters._checks import SMALLEST

Array = NDArray[np.float64]
#: Kinds that are a sine of time and a constant.
SINES = ("one_minus_cosine", "harmonic")
#: Number of steps that have a factor in common in :func:`sines`.
COMMON_STEPS = 128
#: Fewest instants of a record, which a spline needs, and its longest interval over the median one.
FEWEST, MAX_GAP = 4, 10.0


def smooth_step(s: Array, derivative: int = 0, scale: Any = 1.0) -> Array:
    """Evaluate the quintic step from 0 at s = 0 to `scale` at s = 1, or a derivative by s.

    First and second derivatives vanish at both ends, so that it is twice continuously differentiable.
    """
    s = np.clip(s, 0.0, 1.0)
    if derivative == 0:
        return scale * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    if derivative == 1:
        return scale * 30.0 * s**2 * (1.0 - s) ** 2
    return scale * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)


def ramped(time: Array, ramp: Any, change: Sequence[Array] | Array) -> Array:
    """Multiply a function by the quintic step over `ramp` [s], where that is not 0: the derivative of the highest order given.

    `change` are its values and derivatives up to an order.
    """
    rate = np.divide(1.0, ramp, out=np.zeros(np.shape(ramp)), where=np.greater(ramp, 0.0))
    place = np.where(np.greater(ramp, 0.0), time * rate, 1.0)
    step = [smooth_step(place, order) * rate**order for order in range(len(change))]
    if len(change) == 1:
        return step[0] * change[0]
    if len(change) == 2:
        return step[0] * change[1] + step[1] * change[0]
    return step[0] * change[2] + 2.0 * step[1] * change[1] + step[2] * change[0]


def sines(coefficients: Sequence[complex], omega: float, start: int, count: int, steps_per_second: float) -> Array:
    """Return Im(c exp(i omega t)) for coefficients c at `count` steps from number `start` on, (coefficients, count).

    Each exponential is that of a step in :data:`COMMON_STEPS` times that of the steps since, which repeat: a product in place of
    a sine and a cosine takes a tenth of the time, and loses no more than its rounding.
    """
    angle = 1j * omega / steps_per_second
    since = np.exp(angle * np.arange(COMMON_STEPS))
    common = np.multiply.outer(coefficients, np.exp(angle * np.arange(start, start + count, COMMON_STEPS)))
    return np.multiply.outer(common, since).imag.reshape(len(coefficients), -1)[:, :count]


@dataclass(frozen=True)
class TimeFunction:
    """Function of time, of one of the kinds of the scene file.

    Attributes
    ----------
    kind
        "one_minus_cosine", "harmonic", "ramp", "polynomial" or "file".
    values
        Parameters of that kind by their names in the scene file, with stacked members arrays (members, 1); for "file" the
        samples `time` [s] and `value`; for all kinds but "ramp" also `ramp` [s], the duration of a smooth start.
    keeps_start
        Whether a record keeps its value at t = 0, as the factor of a load does; a displacement is counted from it.
    """

    kind: str
    values: Mapping[str, Any]
    keeps_start: bool = False
    _spline: Any = field(default=None, init=False, repr=False, compare=False)
    _start: float = field(default=0.0, init=False, repr=False, compare=False)  # value of the record at t = 0

    def __post_init__(self) -> None:
        if self.kind == "file":
            from scipy.interpolate import CubicSpline  # slow to import, needed by records only

            object.__setattr__(self, "_spline", CubicSpline(self.values["time"], self.values["value"]))
            object.__setattr__(self, "_start", float(self._spline(0.0)))

    def __call__(self, time: ArrayLike, derivative: int = 0) -> Array:
        """Evaluate the function (`derivative` 0), or its first or second derivative, at `time` [s]."""
        time = np.asarray(time, dtype=float)
        ramp = self.ramp
        if not (ramp if isinstance(ramp, float) else ramp.any()):
            return self._unramped(time, derivative)
        change = [self._unramped(time, order) for order in range(derivative + 1)]
        if self.keeps_start:
            change[0] = change[0] - self._start
        value = ramped(time, self.ramp, change)
        return value + self._start if self.keeps_start and derivative == 0 else value

    def _unramped(self, time: Array, derivative: int) -> Array:
        """Evaluate the function without its ramp."""
        return getattr(self, f"_{self.kind}")(time, derivative)

    def take(self, part: np.ndarray) -> TimeFunction:
        """Return the functions of some of stacked members, by their numbers."""
        return replace(self, values={name: value[part] for name, value in self.values.items()})

    @property
    def ramp(self) -> Any:
        """Duration of the smooth start [s], of stacked members an array; 0 without."""
        ramp = self.values.get("ramp", 0.0)
        return ramp if np.ndim(ramp) else float(ramp)

    @property
    def offset(self) -> Any:
        """Value of the formula or record at t = 0, from which a displacement is counted; arrays for stacked members."""
        if self.kind == "harmonic":
            return self.values["amplitude"] * np.sin(self.values["phase"])
        return self._start

    def at_steps(
        self, start: int, steps: int, steps_per_second: float, derivative: int = 0, origin: float = 0.0
    ) -> Array:
        """Evaluate a derivative from step `start` on, (steps + 1,); `origin` is added to values."""
        return self.all_at_steps(start, steps, steps_per_second, (derivative,), origin)[0]

    def all_at_steps(
        self, start: int, steps: int, steps_per_second: float, derivatives: tuple[int, ...], origin: float = 0.0
    ) -> Array:
        """Evaluate several derivatives at steps, (derivatives, steps + 1), as :meth:`at_steps` does one.

        Sines come from :func:`sines`; one by one they would cost a tenth of the time of a chain of 40 links.
        """
        if self.kind not in SINES:
            time = np.arange(start, start + steps + 1) / steps_per_second
            return np.array([self(time, derivative) + (0.0 if derivative else origin) for derivative in derivatives])
        result = self._sines(derivatives, start, steps + 1, steps_per_second)
        # only the steps before the end of the ramp are multiplied by it
        count = min(max(math.ceil(self.ramp * steps_per_second) - start, 0), steps + 1)
        if count:
            time = np.arange(start, start + count) / steps_per_second
            during = self._sines(range(max(derivatives) + 1), start, count, steps_per_second)
            for row, derivative in zip(result, derivatives, strict=True):
                row[:count] = ramped(time, self.ramp, during[: derivative + 1])
        for row, derivative in zip(result, derivatives, strict=True):
            if derivative == 0:
                row += origin
        return result

    def _sines(self, derivatives: Sequence[int], start: int, count: int, steps_per_second: float) -> Array:
        """Evaluate derivatives of a kind of :data:`SINES` without its ramp at `count` steps, (derivatives, count)."""
        omega, phase, amplitude = self.sine
        phasor = amplitude * cmath.exp(1j * phase)
        result = sines([(1j * omega) ** order * phasor for order in derivatives], omega, start, count, steps_per_second)
        for row, derivative in zip(result, derivatives, strict=True):
            if derivative == 0:
                row -= amplitude * math.sin(phase)
        return result

    @property
    def sine(self) -> tuple[Any, Any, Any]:
        """Angular frequency [rad/s], phase [rad] and amplitude of a kind of :data:`SINES`; arrays for stacked members."""
        amplitude = self.values["amplitude"]
        phase = self.values["phase"] if self.kind == "harmonic" else 0.0 * amplitude - 0.5 * math.pi  # one minus cosine
        return self.values["angular_frequency"], phase, amplitude

    def _one_minus_cosine(self, time: Array, derivative: int) -> Array:
        amplitude, omega = self.values["amplitude"], self.values["angular_frequency"]
        if derivative == 0:
            return amplitude * (1.0 - np.cos(omega * time))
        if derivative == 1:
            return amplitude * omega * np.sin(omega * time)
        return amplitude * omega**2 * np.cos(omega * time)

    def _harmonic(self, time: Array, derivative: int) -> Array:
        amplitude, omega, phase = (self.values[key] for key in ("amplitude", "angular_frequency", "phase"))
        if derivative == 0:
            return amplitude * (np.sin(omega * time + phase) - np.sin(phase))
        if derivative == 1:
            return amplitude * omega * np.cos(omega * time + phase)
        return -amplitude * omega**2 * np.sin(omega * time + phase)

    def _ramp(self, time: Array, derivative: int) -> Array:
        amplitude, duration = self.values["amplitude"], self.values["duration"]
        return smooth_step(time / duration, derivative, amplitude / duration**derivative)

    def _polynomial(self, time: Array, derivative: int) -> Array:
        polynomial = np.polynomial.Polynomial([0.0, *self.values["coefficients"]])
        return polynomial.deriv(derivative)(time) if derivative else polynomial(time)

    def _file(self, time: Array, derivative: int) -> Array:
        values = self._spline(time, derivative)
        return values if derivative or self.keeps_start else values - self._start

    @property
    def has_kinks(self) -> bool:
        """Whether its third derivative jumps, as at both ends of a ramp and between the samples of a record."""
        return bool(np.any(self.ramp)) or self.kind in ("ramp", "file")

    @property
    def shortest_time_scale(self) -> Any:
        """Period, duration of a ramp, or twice the spacing of a record [s]; infinity for a polynomial without ramp."""
        if not np.any(self.ramp):
            return self._time_scale
        if np.ndim(self.ramp):
            return np.minimum(self._time_scale, np.where(self.ramp > 0.0, self.ramp, np.inf))
        return min(self._time_scale, self.ramp)

    @property
    def _time_scale(self) -> Any:
        """Shortest time scale without the ramp [s]."""
        if self.kind in SINES:
            with np.errstate(divide="ignore"):
                period = 2.0 * np.pi / np.abs(self.values["angular_frequency"])
            return period if period.ndim else float(period)
        if self.kind == "ramp":
            return float(self.values["duration"])
        return 2.0 * float(np.diff(self.values["time"]).min()) if self.kind == "file" else np.inf

    def sampling_times(self, end_time: float) -> Array:
        """Return instants up to `end_time` [s] that resolve the range of values.

        These are 101 in a period or in the whole time, or the samples of a record; with a ramp, also 101 in it, and the period
        begins after it.
        """
        ramp = min(end_time, self.ramp)
        during = [np.linspace(0.0, ramp, 101)] if ramp else []
        if self.kind == "file":
            time = np.asarray(self.values["time"], dtype=float)
            after = time[(time >= 0.0) & (time <= end_time)]
        else:
            after = np.linspace(ramp, min(end_time, ramp + self._time_scale) if self.kind in SINES else end_time, 101)
        return np.unique(np.concatenate([*during, after])) if during else after

    @property
    def begin(self) -> float:
        """First time of a record [s]; minus infinity for other kinds."""
        return float(self.values["time"][0]) if self.kind == "file" else -np.inf

    @property
    def end(self) -> float:
        """Last time of a record [s]; infinity for other kinds."""
        return float(self.values["time"][-1]) if self.kind == "file" else np.inf


def check_instants(key: str, record: str, time: np.ndarray) -> None:
    """Refuse instants [s] of a record: too few, not rising, or with a gap; messages name key and `record`."""
    if time.size < FEWEST:
        raise SceneError(
            f"{key}: {record} is too short: {time.size} rows; allowed: one of at least {FEWEST} rows of numbers"
        )
    step = np.diff(time)
    least = max(1e-9 * float(np.median(step)), SMALLEST)
    if step.min() < least:
        where = int(np.argmax(step < least))
        raise SceneError(
            f"{key}: {record} is unsorted: time {time[where + 1]:g} s follows {time[where]:g} s; allowed: rising times"
        )
    if step.max() > MAX_GAP * np.median(step):
        where = int(np.argmax(step))
        raise SceneError(
            f"{key}: {record} has a gap of {step.max():g} s after {time[where]:g} s; "
            f"allowed: at most ten times the median spacing, {np.median(step):g} s"
        )


def check_reach(functions: Mapping[str, TimeFunction], time: float) -> None:
    """Refuse records, by the key paths of their tables, that do not cover the run from 0 to `time` [s]."""
    for key, function in functions.items():
        if function.begin > 0.0 or time > function.end * (1.0 + 1e-12):
            raise SceneError(
                f"{key}.path: the record is too short, from {function.begin:g} s to {function.end:g} s; "
                f"allowed: one that covers the run, from 0 s to {time:g} s"
            )
