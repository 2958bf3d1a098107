"""Time functions: the motions of the ends and the factors of the loads.

One small class evaluates every kind, with its first two derivatives, on arrays of times; steppers receive tables of its
values and know no kinds.
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
#: Kinds whose values at equidistant steps are compiled rotations.
SINES = ("one_minus_cosine", "harmonic")


@cache
def _kernel() -> Any:
    """Import the compiled tables, which only computing needs; the statement alone takes half as long as a table of 30 steps."""
    from cablepod.parameters import _kernels_sines as motion

    return motion


@dataclass(frozen=True)
class TimeFunction:
    """A function of time, of one of the kinds of the scene file.

    Attributes
    ----------
    kind
        "one_minus_cosine", "harmonic", "ramp", "polynomial" or "file".
    values
        The parameters of that kind under their names in the scene file; for "file" the samples `time` [s] and `value`.
    """

    kind: str
    values: Mapping[str, Any]
    _spline: Any = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.kind == "file":
            from scipy.interpolate import CubicSpline  # only here: a scene without a record does not pay for it

            object.__setattr__(self, "_spline", CubicSpline(self.values["time"], self.values["value"]))

    def __call__(self, time: ArrayLike, derivative: int = 0) -> Array:
        """Evaluate at `time` [s]; `derivative` 0, 1 or 2 gives the value, the rate or the second rate."""
        return getattr(self, f"_{self.kind}")(np.asarray(time, dtype=float), derivative)

    def at_steps(self, start: int, steps: int, rate: float, derivative: int = 0, origin: float = 0.0) -> Array:
        """Evaluate at the steps `start` ... `start + steps` of so many to the second, (steps + 1,); `origin` is added to values.

        Sines of equidistant angles come from compiled rotations; computed one by one they would cost a tenth of what a chain of
        40 links does.
        """
        return self.all_at_steps(start, steps, rate, (derivative,), origin)[0]

    def all_at_steps(
        self, start: int, steps: int, rate: float, derivatives: tuple[int, ...], origin: float = 0.0
    ) -> Array:
        """Evaluate several derivatives at once, (derivatives, steps + 1), as :meth:`on_steps` does one."""
        if self.kind not in SINES:
            time = np.arange(start, start + steps + 1) / rate
            return np.array([self(time, derivative) + (0.0 if derivative else origin) for derivative in derivatives])
        result = np.empty((len(derivatives), steps + 1))
        _kernel().harmonic(start, rate, *self.sine, float(origin), derivatives, result)
        return result

    @property
    def sine(self) -> tuple[float, float, float]:
        """Angular frequency [rad/s], phase [rad] and amplitude of one of SINES."""
        phase = float(self.values["phase"]) if self.kind == "harmonic" else -0.5 * math.pi  # of one minus a cosine
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
        # The quintic step has two vanishing derivatives at both ends, so that the motion is C2.
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
    def shortest_time_scale(self) -> float:
        """Shortest time over which it changes [s]: a period, the length of a ramp, twice the spacing of a record."""
        if self.kind in SINES:
            return (
                2.0 * np.pi / abs(float(self.values["angular_frequency"]))
                if self.values["angular_frequency"]
                else np.inf
            )
        if self.kind == "ramp":
            return float(self.values["duration"])
        return 2.0 * float(np.diff(self.values["time"]).min()) if self.kind == "file" else np.inf

    def sampling_times(self, until: float) -> Array:
        """Give instants from 0 to `until` [s] that show how far it goes: of a period, of the whole run, its samples."""
        if self.kind == "file":
            time = np.asarray(self.values["time"], dtype=float)
            return time[(time >= 0.0) & (time <= until)]
        return np.linspace(0.0, min(until, self.shortest_time_scale) if self.kind in SINES else until, 101)

    @property
    def begin(self) -> float:
        """First time [s] at which the function is known; minus infinity but for a record."""
        return float(self.values["time"][0]) if self.kind == "file" else -np.inf

    @property
    def end(self) -> float:
        """Last time [s] at which the function is known; infinite but for a record."""
        return float(self.values["time"][-1]) if self.kind == "file" else np.inf


class BatchedTimeFunction:
    """The same time function of several scenes, with numbers of its own in each; `origins` (members,) are added to values.

    Where all are sines, one compiled call fills their tables.
    """

    def __init__(self, functions: Sequence[TimeFunction], origins: Sequence[float] | None = None) -> None:
        self.functions = functions
        self.origins = np.zeros(len(functions)) if origins is None else np.array(origins, dtype=float)
        self.sines = None
        if all(function.kind in SINES for function in functions):
            self.sines = np.array([function.sine for function in functions]).T.copy()

    def fill(self, start: int, rate: float, derivative: int, row: int, tables: Array) -> None:
        """Fill `tables[:, row]`, (members, steps + 1), as :meth:`TimeFunction.on_steps` does."""
        if self.sines is not None:
            omega, phase, amplitude = self.sines
            _kernel().harmonic_of_members(start, rate, omega, phase, amplitude, self.origins, derivative, row, tables)
            return
        steps = tables.shape[2] - 1
        for table, function, origin in zip(tables, self.functions, self.origins.tolist(), strict=True):
            table[row] = function.at_steps(start, steps, rate, derivative, origin)
