"""What is asked of a run of a mast, and its arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cablepod._resources import check_bytes
from cablepod.errors import scene_error
from cablepod.integrate._request import check_in_run
from cablepod.integrate._window import steps_within
from cablepod.mast._kernels_layout import Extremes
from cablepod.parameters._mast import MastLoad, MastParameters

#: Maximum relative distance of a number of steps in an interval from a whole number.
ROUNDING = 1e-9
#: Memory of a step at least: its time and the factor of a load [bytes].
BYTES_PER_STEP = 16.0


@dataclass(frozen=True)
class MastRequest:
    """Instants and steps of a run."""

    times: np.ndarray  #: of the output, equally spaced from 0 on [s]
    every: int  #: steps from one output to the next
    window: tuple[float, float] | None  #: of extremes and means [s]
    energy: bool = False  #: whether the energy is computed
    keeps_guys: bool = False  #: whether the coordinates of condensed guys are kept
    keeps_drag: bool = False  #: whether the drag on the nodes is kept, which bending moments need
    lone_step: float = 1.0  #: step of a run with the start alone [s]

    @property
    def interval(self) -> float:
        """Interval of the output [s]."""
        return float(self.times[1] - self.times[0]) if self.times.size > 1 else self.lone_step * self.every

    @property
    def step(self) -> float:
        """Step [s]."""
        return self.interval / self.every

    @property
    def outputs_count(self) -> int:
        """Number of outputs."""
        return int(self.times.size)

    @property
    def steps(self) -> int:
        """Number of steps."""
        return (self.outputs_count - 1) * self.every

    @property
    def window_steps(self) -> tuple[int, int]:
        """First and last step of extremes and means."""
        if self.window is None:
            return 0, self.steps
        first, last = steps_within(self.window, 1.0 / self.step)
        return first, min(last, self.steps)

    def steps_of_breaks(self, p: MastParameters) -> np.ndarray:
        """Return the first step at which each guy is broken (guys,): that at its break to rounding, or the next one."""
        return np.ceil(times_of_breaks(p) / self.step * (1.0 - ROUNDING))

    def broken_at_outputs(self, p: MastParameters) -> np.ndarray:
        """Tell which guys are broken at the outputs (outputs, guys)."""
        return self.every * np.arange(self.outputs_count)[:, None] >= self.steps_of_breaks(p)

    def factors(self, loads: Sequence[MastLoad]) -> np.ndarray:
        """Return the factors of the loads at all steps (loads, steps + 1); without rows where no load varies."""
        time = self.step * np.arange(self.steps + 1)
        if all(load.factor is None for load in loads):
            return np.empty((0, time.size))
        return np.array([np.ones(time.size) if load.factor is None else load.factor(time) for load in loads])


def times_of_breaks(p: MastParameters) -> np.ndarray:
    """Return the time at which each guy breaks (guys,) [s], infinite where it does not."""
    return np.array([np.inf if guy.breaks is None else guy.breaks for guy in p.guys])


def request_of(
    times: np.ndarray,
    default_step: float,
    step: float | None,
    window: tuple[float, float] | None,
    *,
    energy: bool = False,
    keeps_guys: bool = False,
    keeps_drag: bool = False,
) -> MastRequest:
    """Place the instants of the output on steps.

    Raises
    ------
    SceneError
        For instants that are not equally spaced from 0 on, a step that does not divide their interval, and a window that is not
        within the run or has less than two steps.
    """
    if times.size == 1 and times[0] == 0.0:
        return MastRequest(times, 1, None, energy, keeps_guys, keeps_drag, default_step if step is None else step)
    interval = float(times[1] - times[0]) if times.size > 1 else float(times[0])
    if times[0] != 0.0 or times.size < 2 or np.abs(np.diff(times) / interval - 1.0).max() > ROUNDING * times.size:
        raise scene_error("times", times, "equally spaced instants from 0 on [s]")
    every = max(1, int(np.ceil(interval / default_step * (1.0 - ROUNDING))))
    if step is not None:
        every = round(interval / step)
        if every < 1 or abs(interval / step - every) > ROUNDING * every:
            raise scene_error("step", step, f"a step that divides the interval of the output, {interval:g} s")
    request = MastRequest(times, every, window, energy, keeps_guys, keeps_drag)
    needed = BYTES_PER_STEP * request.steps
    check_bytes(needed, "step", f"{request.step:.3g} s, {request.steps} steps, {needed / 1e9:.3g} GB")
    if window is not None:
        check_in_run(window, float(times[-1]))
        steps_within(window, 1.0 / request.step)  # refuses one of less than two steps
    return request


@dataclass(eq=False)
class MastTrajectory:
    """Arrays of a run."""

    request: MastRequest
    modal: np.ndarray  #: modal coordinates of the mast (outputs, modes)
    rates: np.ndarray  #: rates half a step before and after (outputs, 2, modes)
    force: np.ndarray  #: of the guys on the mast (outputs, guys, 3) [N]
    tension: np.ndarray  #: at the mast (outputs, guys) [N]
    drag: np.ndarray  #: on the nodes but the foot, and padding (outputs or 0, 2, nodes) [N]
    of_levels: Extremes  #: of displacements in x and z (levels, 2) [m]
    of_tensions: Extremes  #: (guys,) [N]
    least: np.ndarray  #: least chordwise force or tension of each guy before it breaks (guys,) [N]
    least_step: np.ndarray  #: its step (guys,)
    status: int = 0
    at: int = 0  #: step of the status
    guy: int = 0  #: which made the run stop
    energy: np.ndarray | None = None  #: (outputs,) [J]
    guy_position: np.ndarray | None = None  #: of points of the guys (outputs, guys, points, 3) [m]

    @property
    def completed(self) -> int:
        """Number of outputs that were computed."""
        return self.request.outputs_count if not self.status else max(0, (self.at - 1) // self.request.every + 1)

    @property
    def stopped_at(self) -> float:
        """Time at which the run stopped [s]."""
        return self.at * self.request.step

    @property
    def counted(self) -> int:
        """Number of steps of the window."""
        first, last = self.request.window_steps
        return last - first + 1
