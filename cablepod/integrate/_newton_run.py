"""Run of one scene on a chain whose steps are solved by Newton's method, for all implicit schemes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NoReturn

from cablepod.integrate._chain_run import ChainRun, Trajectory
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._output import Extremes
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._peaks import Watch


class NewtonRun(ChainRun):
    """Run whose steps are solved by Newton's method, and cut into substeps where it does not converge."""

    @property
    def alternatives(self) -> str:
        """What to try where a run stops, the most promising first."""
        return "a shorter step, gentler loads or motion, or damping"

    def new_stepper(self, instants: OutputTimes) -> Any:
        """Return the state of a run, with the functions to advance it."""
        raise NotImplementedError

    def _gather(self, stepper: Any, instants: OutputTimes, extremes: Extremes) -> Trajectory:
        """Make a trajectory of the saved steps up to the last one of `instants`."""
        raise NotImplementedError

    def __call__(self, steps_per_second: float) -> Trajectory:
        """Run with a number of steps per second."""
        instants = self.instants(steps_per_second)
        total, stepper = int(instants.steps[-1]), self.new_stepper(instants)
        watch = self.watch(steps_per_second, total, stepper.watched if "tension_extremes" in self.outputs else None)

        def advance(start: int, steps: int) -> bool:
            done, end = start, start + steps
            while done < end:
                done += stepper.advance(done, end - done)
                self._check_step(stepper, done)
                if done < end:
                    if not stepper.substep(done):
                        self._stop(stepper, done, stepper.failure())
                    done += 1
                    self._check_step(stepper, done)
            return True

        advance_in_blocks(advance, stepper.state, total, self.progress, watch)
        return self.end(stepper, instants, watch)

    def end(self, stepper: Any, instants: OutputTimes, watch: Watch | None = None) -> Trajectory:
        """Return the trajectory of a stepper after its last step."""
        extremes = stepper.save_last()
        if watch is None or extremes is None:
            return self.check_energy(self._gather(stepper, instants, extremes))
        if watch.window is not None:
            extremes = watch.window.finish(extremes)
        result = self._gather(stepper, instants, extremes)
        if watch.peaks is not None:
            if watch.window is None or not watch.window.is_closed:
                watch.peaks.note_last(int(instants.steps[-1]), extremes)
            extremes = extremes[0].copy(), extremes[1].copy()
            watch.peaks.locate(lambda start, count: _repeat(stepper, start, count), stepper.state)
            result = replace(result, extremes=extremes, peak_times=watch.peak_times(instants.steps_per_second))
        return self.check_energy(result)

    def _check_step(self, stepper: Any, done: int) -> None:
        """Stop a run if the last one of `done` steps, at which the kernels return, diverged."""
        if not stepper.is_finite():
            self._stop(stepper, done - 1, "the chain left the finite numbers")
        if stepper.out_of_balance:
            self._stop(stepper, done, "the energies are far out of balance")

    def _stop(self, stepper: Any, done: int, failure: str) -> NoReturn:
        """Raise :class:`cablepod.errors.RunStopped` with the trajectory before step `done`."""
        steps_per_second, before = stepper.instants.steps_per_second, stepper.instants.before_step(done)
        partial = None if before is None else self._gather(stepper, before, None)
        why = (
            f"{failure} at {done / steps_per_second:.6g} s ({self.scheme}, step {1 / steps_per_second:.4g} s, step number "
            f"{done}); try {self.alternatives}"
        )
        self.stop(None if partial is None else self.dataset(partial), done / steps_per_second, why)


def _repeat(stepper: Any, start: int, count: int) -> None:
    """Repeat steps that a stepper has taken before, in substeps where Newton's method does not converge."""
    done = 0
    while done < count:
        done += stepper.advance(start + done, count - done)
        if done < count:
            stepper.substep(start + done)
            done += 1
