"""Time functions: the motions of the ends and the factors of the loads.

One class evaluates every kind and its first two derivatives at arrays of times.  Time steppers receive tables of values at
their steps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
#: Kinds tabulated at equidistant steps by compiled rotations.
SINES = ("one_minus_cosine", "harmonic")


@cache
def _kernel() -> Any:
    """Import the kernels once: the import statement takes half as long as a table of 30 steps."""
    from cablepod.parameters import _kernels_sines as kernel

    return kernel


@dataclass(frozen=True)
class TimeFunction:
    """Function of time, of one of the kinds of the scene file.

    Attributes
    ----------
    kind
        "one_minus_cosine", "harmonic", "ramp", "polynomial" or "file".
    values
        Parameters of that kind by their names in the scene file, with stacked members arrays (members, 1); for "file" the
        samples `time` [s] and `value`.
    """

    kind: str
    values: Mapping[str, Any]
    _spline: Any = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.kind == "file":
            from scipy.interpolate import CubicSpline  # slow to import, needed by records only

            object.__setattr__(self, "_spline", CubicSpline(self.values["time"], self.values["value"]))

    def __call__(self, time: ArrayLike, derivative: int = 0) -> Array:
        """Evaluate the function (`derivative` 0), or its first or second derivative, at `time` [s]."""
        return getattr(self, f"_{self.kind}")(np.asarray(time, dtype=float), derivative)

    def at_steps(
        self, start: int, steps: int, steps_per_second: float, derivative: int = 0, origin: float = 0.0
    ) -> Array:
        """Evaluate a derivative from step `start` on, (steps + 1,); `origin` is added to values."""
        return self.all_at_steps(start, steps, steps_per_second, (derivative,), origin)[0]

    def all_at_steps(
        self, start: int, steps: int, steps_per_second: float, derivatives: tuple[int, ...], origin: float = 0.0
    ) -> Array:
        """Evaluate several derivatives at steps, (derivatives, steps + 1), as :meth:`at_steps` does one.

        Sines come from compiled rotations; one by one they would cost a tenth of the time of a chain of 40 links.
        """
        if self.kind not in SINES:
            time = np.arange(start, start + steps + 1) / steps_per_second
            return np.array([self(time, derivative) + (0.0 if derivative else origin) for derivative in derivatives])
        result = np.empty((len(derivatives), steps + 1))
        _kernel().harmonic(start, steps_per_second, *self.sine, float(origin), derivatives, result)
        return result

    @property
    def sine(self) -> tuple[float, float, float]:
        """Angular frequency [rad/s], phase [rad] and amplitude of a kind of :data:`SINES`."""
        phase = float(self.values["phase"]) if self.kind == "harmonic" else -0.5 * math.pi  # one minus cosine
        return float(self.values["angular_frequency"]), phase, float(self.values["amplitude"])

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
        # quintic step: first and second derivatives vanish at both ends, so that the motion is C2
        amplitude, duration = self.values["amplitude"], self.values["duration"]
        s = np.clip(time / duration, 0.0, 1.0)
        if derivative == 0:
            return amplitude * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        if derivative == 1:
            return amplitude / duration * 30.0 * s**2 * (1.0 - s) ** 2
        return amplitude / duration**2 * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)

    def _polynomial(self, time: Array, derivative: int) -> Array:
        polynomial = np.polynomial.Polynomial([0.0, *self.values["coefficients"]])
        return polynomial.deriv(derivative)(time) if derivative else polynomial(time)

    def _file(self, time: Array, derivative: int) -> Array:
        return self._spline(time, derivative)

    @property
    def shortest_time_scale(self) -> Any:
        """Period, duration of a ramp, or twice the spacing of a record [s]; infinity for a polynomial."""
        if self.kind in SINES:
            with np.errstate(divide="ignore"):
                period = 2.0 * np.pi / np.abs(self.values["angular_frequency"])
            return period if period.ndim else float(period)
        if self.kind == "ramp":
            return float(self.values["duration"])
        return 2.0 * float(np.diff(self.values["time"]).min()) if self.kind == "file" else np.inf

    def sampling_times(self, end_time: float) -> Array:
        """Return instants up to `end_time` [s] that resolve the range of values.

        These are 101 in a period or in the whole time, or the samples of a record.
        """
        if self.kind == "file":
            time = np.asarray(self.values["time"], dtype=float)
            return time[(time >= 0.0) & (time <= end_time)]
        return np.linspace(0.0, min(end_time, self.shortest_time_scale) if self.kind in SINES else end_time, 101)

    @property
    def begin(self) -> float:
        """First time of a record [s]; minus infinity for other kinds."""
        return float(self.values["time"][0]) if self.kind == "file" else -np.inf

    @property
    def end(self) -> float:
        """Last time of a record [s]; infinity for other kinds."""
        return float(self.values["time"][-1]) if self.kind == "file" else np.inf


class BatchedTimeFunction:
    """Time functions of several members; `origins` (members,) are added to values.

    One compiled call fills the tables if all are sines.
    """

    def __init__(self, functions: Sequence[TimeFunction], origins: Sequence[float] | None = None) -> None:
        self.functions = functions
        self.origins = np.zeros(len(functions)) if origins is None else np.array(origins, dtype=float)
        self.sines = None
        if all(function.kind in SINES for function in functions):
            self.sines = np.array([function.sine for function in functions]).T.copy()

    def fill(self, start: int, steps_per_second: float, derivative: int, row: int, tables: Array) -> None:
        """Fill `tables[:, row]`, (members, steps + 1), as :meth:`TimeFunction.at_steps` does."""
        if self.sines is not None:
            omega, phase, amplitude = self.sines
            _kernel().harmonic_of_members(
                start, steps_per_second, omega, phase, amplitude, self.origins, derivative, row, tables
            )
            return
        steps = tables.shape[2] - 1
        for table, function, origin in zip(tables, self.functions, self.origins.tolist(), strict=True):
            table[row] = function.at_steps(start, steps, steps_per_second, derivative, origin)
