"""Run of one scene with any step: what all models share, from output times to the comparison of two runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np
import xarray as xr

from cablepod.discretisation._chain import LumpedChain
from cablepod.integrate._comparison import ComparableRuns
from cablepod.integrate._means import with_steps_of_means
from cablepod.integrate._output import stop
from cablepod.integrate._output_times import OutputTimes, judged_instants, preferred_steps_per_second, with_judged
from cablepod.integrate._peaks import PeakSearch, Watch
from cablepod.integrate._step_control import STEPS_PER_CHANGE
from cablepod.integrate._window import ExtremesWindow


@dataclass(frozen=True, kw_only=True)
class Run:
    """One scene, prepared for runs with any step by one scheme.

    A model adds its equations (the call) and says what is compared of its trajectories.  These have ``instants`` and
    ``only(times)``, the trajectory at some of its instants.
    """

    times: np.ndarray  #: output times [s]
    outputs: tuple[str, ...] = ("position",)  #: names of the requested ones
    progress: Callable[[float], None] | None = None  #: receives the completed fraction, 0 to 1
    #: Part of the run over which extremes and means are taken [s]; None for all
    window: tuple[float, float] | None = None
    #: Further instants at which runs are compared, see :func:`judged_instants` [s]; None without
    judged: np.ndarray | None = None

    def __call__(self, steps_per_second: float) -> Any:
        """Run with a number of steps per second; returns the trajectory."""
        raise NotImplementedError

    @property
    def cells(self) -> LumpedChain:
        """Discretisation of the cable in space."""
        raise NotImplementedError

    @property
    def end_time(self) -> float:
        """End of the run [s]."""
        return float(self.times[-1])

    # --- saved steps ---

    def instants(self, steps_per_second: float) -> OutputTimes:
        """Place the output times, and the instants at which runs are compared, on the steps."""
        return OutputTimes.of(with_judged(self.times, self.judged), steps_per_second)

    def saving(self, instants: OutputTimes, every: int = 0) -> OutputTimes:
        """Add the steps that samples at each multiple of `every` steps and means of the tensions need; no samples for 0."""
        return with_steps_of_means(instants.with_multiples(every) if every else instants, self.outputs, self.window)

    def watch(
        self,
        steps_per_second: float,
        total: int,
        extremes: tuple[np.ndarray, np.ndarray] | None,
        *,
        with_end: bool = False,
        chosen: np.ndarray | None = None,
    ) -> Watch | None:
        """Return what is done with the extremes of the kernels between blocks of steps; None where nothing is.

        Parameters
        ----------
        steps_per_second, total
            Steps per second, and number of steps.
        extremes
            Arrays of the smallest and the largest tensions (n,) [N] that the kernels update; None without.
        with_end, chosen
            As of :class:`cablepod.integrate._peaks.PeakSearch`.
        """
        if extremes is None:
            return None
        window = peaks = None
        if self.window is not None:
            window = ExtremesWindow(self.window, steps_per_second, *extremes, with_end=with_end)
        if "tension_peaks" in self.outputs:
            peaks = PeakSearch(*extremes, total, with_end=with_end, chosen=chosen)
        return None if window is None and peaks is None else Watch(window, peaks)

    # --- comparison ---

    def compared(self, state: Any) -> np.ndarray:
        """Return the positions of a trajectory that are compared (times, points, dims) [m]."""
        raise NotImplementedError

    def motion(self, state: Any) -> float:
        """Return the largest rms displacement of a trajectory, or the chord if nothing moves [m]."""
        raise NotImplementedError

    def has_kinks(self, state: Any) -> bool:
        """Whether the forces of a trajectory have kinks, as where links slacken."""
        return False

    @property
    def step_of_air(self) -> float:
        """Longest step that resolves the wind [s]."""
        return np.inf

    def resolving(self, step: float) -> float:
        """Return a step [s], or the longest one that resolves motions, loads and wind if that is shorter."""
        return min(step, self.cells.p.shortest_time_scale / STEPS_PER_CHANGE, self.step_of_air)

    def comparable(
        self, step: float, rounded: Callable[[float], float] = preferred_steps_per_second, **options: Any
    ) -> ComparableRuns:
        """Describe runs with any step for the step control.

        Parameters
        ----------
        step
            Step of the first run at most [s]; a shorter one where motions, loads or wind need it.
        rounded
            Rounds up steps per second.
        **options
            Further fields of :class:`ComparableRuns`.
        """
        rate = rounded(1.0 / self.resolving(step))
        judged = judged_instants(self.times, rate)
        run = self if judged is None else replace(self, judged=judged)
        about: dict[str, Any] = {"has_kinks": self.has_kinks, "finish": self.at_output_times}
        return ComparableRuns(run, self.compared, self.motion, rate, self.end_time, self.cells.links, **about | options)

    def at_output_times(self, state: Any) -> Any:
        """Return a trajectory without the further instants at which runs are compared."""
        return state.only(self.times)

    # --- stop ---

    def stop(self, partial: xr.Dataset | None, time: float, why: str) -> NoReturn:
        """Raise :class:`cablepod.errors.RunStopped` at `time` [s] with the result before it at the output times."""
        if partial is not None and self.judged is not None:
            rows = np.isin(partial["time"].values, self.times)
            partial = partial.isel(time=rows) if rows.any() else None
        stop(partial, time, self.end_time, why)
