"""Make a functional mock-up unit of a prepared model, run it beside the model itself, and print the difference.

    python pipelines/fmu/build.py [MODEL.nc] [--out out/fmu]

MODEL.nc is a file of ``cp.archive.write(guy.dataset(), path)``; without it the guy of Example 2 is taken.  Needs pythonfmu and
fmpy (``pip install '.[fmu]'``).
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from _study import command_line

import cablepod as cp
from cablepod.examples import scene

HERE = Path(__file__).resolve().parent
STEP, STEPS, AMPLITUDE, OMEGA = 0.01, 500, 0.02, 3.0


def example(path: Path) -> Path:
    """Write the prepared model of Example 2's guy."""
    given = scene("example2")
    modes = cp.pod.decompose(cp.chain.simulate(given, tolerance=1e-3), layout="normal", rank=2)
    return cp.archive.write(cp.condensed.prepare(given, modes).dataset(), path, overwrite=True)


def build(model: Path, folder: Path) -> Path:
    """Make the unit of a prepared model in a folder, and return its path."""
    from pythonfmu.builder import FmuBuilder  # of the extra, which --help does not need

    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        resource = Path(temporary) / "guy.nc"
        shutil.copy(model, resource)
        return Path(FmuBuilder.build_FMU(HERE / "guy.py", dest=folder, project_files=[resource]))


def forces_of_unit(path: Path, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the forces (steps, dims) [N] of a unit whose end follows given positions and velocities."""
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave

    description, folder = read_model_description(path), extract(path)
    axes = "xyz"[: position.shape[1]]
    numbers = {variable.name: variable.valueReference for variable in description.modelVariables}
    inputs = [numbers[f"{name}_{axis}"] for name in ("position", "velocity") for axis in axes]
    outputs = [numbers[f"force_{axis}"] for axis in axes]
    unit = FMU2Slave(
        guid=description.guid, unzipDirectory=folder, modelIdentifier=description.coSimulation.modelIdentifier
    )
    unit.instantiate()
    unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    forces = []
    for k in range(1, len(position)):
        unit.setReal(inputs, [*position[k], *velocity[k]])
        unit.doStep((k - 1) * STEP, STEP)
        forces.append(unit.getReal(outputs))
    unit.terminate()
    unit.freeInstance()
    shutil.rmtree(folder)
    return np.array(forces)


def main() -> None:
    """Make the unit and compare."""
    parser = command_line(__doc__, out="out/fmu")
    parser.add_argument("model", nargs="?", type=Path)
    options = parser.parse_args()
    folder = Path(options.out)
    folder.mkdir(parents=True, exist_ok=True)
    model = options.model or example(folder / "guy.nc")
    path = build(model, folder)
    guy = cp.condensed.resume(cp.archive.read(model))
    times = STEP * np.arange(STEPS + 1)
    position, velocity = np.tile(guy.end_position, (STEPS + 1, 1)), np.zeros((STEPS + 1, guy.end_position.size))
    position[:, 0] += AMPLITUDE * np.sin(OMEGA * times)
    velocity[:, 0] = AMPLITUDE * OMEGA * np.cos(OMEGA * times)
    forces = [guy.step(position[k], velocity[k], STEP) for k in range(1, STEPS + 1)]
    difference = np.abs(forces_of_unit(path, position, velocity) - forces).max()
    print(
        f"{path}: {STEPS} steps of {STEP:g} s, largest difference of the force from the model's own {difference:.3g} N"
    )


if __name__ == "__main__":
    main()
