"""A guy as a functional mock-up unit (FMI 2.0, co-simulation), for pythonfmu.

    pip install '.[fmu]'
    python pipelines/fmu/build.py GUY.nc --out out/fmu

The unit needs Python with cablepod where it runs.  GUY.nc is a prepared model, see build.py; it travels inside the unit.
Inputs are position and velocity of the upper end at the end of a step, outputs the force of the cable on it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

import cablepod as cp

AXES = "xyz"
#: File of the prepared model among the resources of the unit.
MODEL = "guy.nc"


class Guy(Fmi2Slave):
    """Cable whose upper end another program moves; the force is without the inertia of the masses, which are outputs."""

    author = "cablepod"
    description = "A guy as a condensed model: quasi-static along its chord, few modes across it"

    def __init__(self, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self.guy = cp.condensed.resume(cp.archive.read(Path(self.resources) / MODEL))
        self.initial_state = self.guy.state
        self.dims = self.guy.end_position.size
        self.last_velocity = np.zeros(self.dims)
        for i, axis in enumerate(AXES[: self.dims]):
            setattr(self, f"position_{axis}", float(self.guy.end_position[i]))
            setattr(self, f"velocity_{axis}", 0.0)
            self._register(f"position_{axis}", "input", "position of the end [m]")
            self._register(f"velocity_{axis}", "input", "velocity of the end [m/s]")
        self._outputs()
        for name in self._output_names():
            text = (
                "force of the cable [N]"
                if name.startswith("force")
                else "mass of the cable that moves with the end [kg]"
            )
            self._register(name, "output", text)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Take one step; False where the model refuses it or leaves the finite numbers."""
        position, velocity = (
            np.array([getattr(self, f"{name}_{axis}") for axis in AXES[: self.dims]])
            for name in ("position", "velocity")
        )
        substeps = max(1, int(np.ceil(step_size / (0.5 * self.guy.step_limit))))
        start, before = self.guy.end_position, self.last_velocity
        try:
            for k in range(1, substeps + 1):
                place, speed = between(start, before, position, velocity, step_size, k / substeps)
                self.guy.step(place, speed, step_size / substeps)
        except (cp.SceneError, cp.RunStopped) as error:
            self.log(str(error))
            return False
        self.last_velocity = velocity
        self._outputs()
        return True

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Begin from the state of the file."""
        self.guy.state = self.initial_state
        self.last_velocity = np.zeros(self.dims)
        self._outputs()

    def _outputs(self) -> None:
        """Copy force and mass into the variables of the unit."""
        force, mass = self.guy.force, self.guy.mass
        for i, axis in enumerate(AXES[: self.dims]):
            setattr(self, f"force_{axis}", float(force[i]))
            for j in range(i, self.dims):
                setattr(self, f"mass_{axis}{AXES[j]}", float(mass[i, j]))

    def _output_names(self) -> list[str]:
        axes = AXES[: self.dims]
        masses = [f"mass_{axis}{other}" for i, axis in enumerate(axes) for other in axes[i:]]
        return [f"force_{axis}" for axis in axes] + masses

    def _register(self, name: str, causality: str, description: str) -> None:
        self.register_variable(
            Real(
                name,
                causality=Fmi2Causality[causality],
                variability=Fmi2Variability.continuous,
                description=description,
                **({"start": getattr(self, name)} if causality == "input" else {}),
            )
        )


def between(
    start: np.ndarray, before: np.ndarray, end: np.ndarray, after: np.ndarray, step: float, part: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity within a step by the cubic through positions and velocities at both ends."""
    s, rise = part, end - start
    position = start + s * s * (3 - 2 * s) * rise + step * s * (1 - s) * ((1 - s) * before - s * after)
    velocity = 6 * s * (1 - s) / step * rise + (1 - s) * (1 - 3 * s) * before + s * (3 * s - 2) * after
    return position, velocity
