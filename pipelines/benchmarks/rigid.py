"""Measure error and run time of the chain of rigid links.

    pip install '.[peers]' && python pipelines/benchmarks/rigid.py [--repeats 5] [--out FOLDER] [--readme]

Writes rigid.png.  RATTLE and the index-1 form, and IDA of SUNDIALS as an independent third.

Three shipped scenes: a slack cable whose end moves (60 s), a slack line let go (3 s), a folded chain that falls (0.38 s).  IDA
(through scikit-sundae, extra `peers`; left out with a message if not installed) gets the stabilised index-2 form of Gear, Gupta
and Leimkuhler, a second set of multipliers keeping the velocities on the constraints: positions, velocities and both multipliers
of a particle side by side, a compiled residual, a banded Jacobian by difference quotients, consistent initial values, and an
absolute tolerance of 1e10 for the multipliers, which takes them out of its error test.

Error: maximum over the scene's instants of the rms distance of the particles, over the maximum rms displacement, against the
index-1 form at an eighth of the step chosen for a tolerance of 1e-9.  Time: inside the compiled loop, and of one whole
call of rigid.simulate with a given step; of IDA the call of its solver.  One thread, medians over the repeats (one where a run
takes more than 5 s), after compilation.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from _study import command_line, markdown_table, medians, show_table, time_inside, timed
from numba import njit

import cablepod as cp
from cablepod.discretisation._chain import chain_of
from cablepod.examples import scene
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._parameters import Parameters

HERE = Path(__file__).resolve().parent
SCENES = ("slack_cable", "slack_line", "folded_chain")
#: Longest step of RATTLE [s], halved from there; that of the index-1 form is twice as long.
LONGEST = {"slack_cable": 0.064, "slack_line": 0.004, "folded_chain": 0.0005}
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
WIDTH = 6  #: unknowns of a particle: x, y, vx, vy, and of the link above it lambda, mu
KERNELS = ("cablepod.rigid._kernels_steps.rattle", "cablepod.rigid._kernels_steps.index1")
Row = tuple[str, str, float, float, float, float]


def repeated(call: Callable[[], tuple[float, float, Any]], repeats: int) -> tuple[float, float, Any]:
    """Return the medians of the two times of a call [s], and its result."""
    call()
    results = [call()]
    while len(results) < repeats and results[0][1] < 5.0:
        results.append(call())
    return *medians(result[:2] for result in results), results[0][2]


def ours(given, method: str, step: float) -> tuple[float, float, Any]:
    """Return seconds inside the loop and of the whole call, and the run."""
    with time_inside(*KERNELS) as loop, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # too long steps are part of the figure
        run, whole = timed(lambda: cp.rigid.simulate(given, step=step, formulation=method))
    return loop.seconds, whole, run


def end_motion(p: Parameters) -> tuple[float, float]:
    """Return amplitude and angular frequency of the upper end along x.

    It is the only motion of these scenes.
    """
    functions = list(p.motions.values())
    return (functions[0].values["amplitude"], functions[0].values["angular_frequency"]) if functions else (0.0, 1.0)


def residual_of(p: Parameters, chain) -> Callable[..., None]:
    """Compile the residual of the stabilised index-2 form."""
    n = chain.links
    free = np.zeros(n + 1, dtype=np.bool_)
    free[chain.free_particles] = True
    mass = p.mass * chain.tributary_length
    acceleration = chain.loads(0.0) / mass[:, None]
    # the second multipliers move positions by lengths of the order of 1
    relative = mass.mean() / mass
    length, lower, upper = chain.length, p.lower, p.upper
    amplitude, omega = end_motion(p)

    @njit(error_model="numpy")
    def residual(t, y, yp, res):
        for j in range(n + 1):
            a = WIDTH * j
            if not free[j]:
                end = lower if j == 0 else upper
                moved = amplitude * (1.0 - np.cos(omega * t)) if j == n else 0.0
                rate = amplitude * omega * np.sin(omega * t) if j == n else 0.0
                res[a], res[a + 1] = y[a] - end[0] - moved, y[a + 1] - end[1]
                res[a + 2], res[a + 3] = y[a + 2] - rate, y[a + 3]
            else:
                for c in range(2):
                    force = push = 0.0
                    if j < n:
                        e = (y[a + WIDTH + c] - y[a + c]) / length[j]
                        force, push = y[a + 4] * e, y[a + 5] * e
                    if j > 0:
                        e = (y[a + c] - y[a - WIDTH + c]) / length[j - 1]
                        force -= y[a - 2] * e
                        push -= y[a - 1] * e
                    res[a + c] = yp[a + c] - y[a + 2 + c] - relative[j] * push
                    res[a + 2 + c] = yp[a + 2 + c] - acceleration[j, c] - force / mass[j]
            if j == n:
                res[a + 4], res[a + 5] = y[a + 4], y[a + 5]
                continue
            dx, dy = y[a + WIDTH] - y[a], y[a + WIDTH + 1] - y[a + 1]
            res[a + 4] = 0.5 * ((dx * dx + dy * dy) / length[j] - length[j])
            res[a + 5] = (dx * (y[a + WIDTH + 2] - y[a + 2]) + dy * (y[a + WIDTH + 3] - y[a + 3])) / length[j]

    return residual


def ida(given, first) -> Callable[[float], tuple[float, float, np.ndarray]]:
    """Prepare a scene for IDA; return a function of the tolerance that runs it."""
    from sksundae.ida import IDA

    p = parameters(given)
    chain = chain_of(p)
    residual = residual_of(p, chain)
    size = WIDTH * (chain.links + 1)
    y = np.zeros((chain.links + 1, WIDTH))
    y[:, :2] = first.position[0]
    y[:-1, 4] = first.tension[0]
    rates = np.zeros(size)
    left = np.empty(size)
    residual(0.0, y.ravel(), rates, left)
    free = np.zeros((chain.links + 1, WIDTH), dtype=bool)
    free[chain.free_particles, 2:4] = True
    rates[free.ravel()] = -left[free.ravel()]  # the other rates are zero
    if p.free_end is None:
        # the end's acceleration is that of its motion
        amplitude, omega = end_motion(p)
        rates[WIDTH * chain.links + 2] = amplitude * omega**2
    free[chain.free_particles, :2] = True
    algebraic = np.flatnonzero(~free.ravel())
    times = p.times()

    def run(tolerance: float) -> tuple[float, float, np.ndarray]:
        speed = np.sqrt(9.81 * chain.total_length)
        atol = np.tile([1.0, 1.0, speed, speed, 1e10, 1e10], chain.links + 1)
        atol[[i for i in range(size) if i % WIDTH < 4]] *= tolerance
        solver = IDA(
            residual, rtol=tolerance, atol=atol, linsolver="band", lband=2 * WIDTH - 1, uband=2 * WIDTH - 1,
            algebraic_idx=algebraic, max_num_steps=10**6,
        )  # fmt: skip
        begin = time.perf_counter()
        solution = solver.solve(times, y.ravel(), rates)
        spent = time.perf_counter() - begin
        if len(solution.t) != len(times):
            raise RuntimeError(f"IDA stopped: {solution.message}")
        return spent, spent, np.ascontiguousarray(solution.y).reshape(len(times), -1, WIDTH)[:, :, :2]

    return run


def measure(name: str, repeats: int) -> Iterator[Row]:
    """Measure one scene.

    A row is method, setting, seconds inside, seconds of the call, error, relative error of lengths.
    """
    given = scene(name)
    best = cp.rigid.simulate(given, formulation="index1", tolerance=1e-9, outputs=("position", "tension"))
    truth = cp.rigid.simulate(given, formulation="index1", step=best.attrs["step"] / 8.0)
    for method, factor, count in (("rattle", 1.0, 9), ("index1", 2.0, 8)):
        for step in factor * LONGEST[name] / 2.0 ** np.arange(count):
            try:
                inside, whole, run = repeated(partial(ours, given, method, step), repeats)
            except cp.RunStopped as stopped:
                print(f"{name}: {stopped}")
                continue
            error = float(cp.compare.errors(run, truth).error_max)
            yield method, f"{step:.3g} s", inside, whole, error, run.attrs["length_error"]
    try:
        run_ida = ida(given, best)
    except ModuleNotFoundError:
        print(f"{name}: IDA is left out, scikit-sundae is not installed (pip install '.[peers]')")
        return
    for tolerance in TOLERANCES:
        try:
            inside, whole, position = repeated(partial(run_ida, tolerance), repeats)
        except RuntimeError as stopped:
            print(f"{name}: rtol {tolerance:g}: {stopped}")
            continue
        run = truth.assign(position=(truth.position.dims, position))
        size = np.linalg.norm(np.diff(position, axis=1), axis=-1) / np.diff(truth.arc_length.values)
        error = float(cp.compare.errors(run, truth).error_max)
        yield "IDA", f"rtol {tolerance:g}", inside, whole, error, float(np.abs(size - 1.0).max())


def draw(rows: dict[str, list[Row]], path: Path) -> None:
    """Draw error against time of all scenes."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    styles = {
        "rattle": ("#0072B2", "o", "RATTLE"),
        "index1": ("#D55E00", "s", "index 1, projected"),
        "IDA": ("#000000", "^", "IDA"),
    }
    figure, axes = plt.subplots(1, len(rows), figsize=(4.2 * len(rows), 3.8), sharey=True, layout="constrained")
    for ax, (name, of_scene) in zip(np.atleast_1d(axes), rows.items(), strict=True):
        for method, (colour, marker, label) in styles.items():
            chosen = [row for row in of_scene if row[0] == method]
            if chosen:
                ax.loglog(
                    [1e3 * row[2] for row in chosen],
                    [row[4] for row in chosen],
                    marker=marker,
                    color=colour,
                    label=label,
                )
        ax.set_title(name.replace("_", " "))
        ax.set_xlabel("stepping time [ms]")
        ax.grid(alpha=0.3)
    np.atleast_1d(axes)[0].set_ylabel("largest error / largest displacement")
    np.atleast_1d(axes)[0].legend()
    figure.savefig(path, dpi=130)


def main() -> None:
    """Print the table."""
    options = command_line(__doc__, out="out/rigid", readme=True, repeats=5).parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[Row]] = {}
    for name in SCENES:
        print(f"\n{name}: {scene(name).attrs['title']}")
        rows[name] = list(measure(name, options.repeats))
        lines = [
            [method, setting, f"{1e3 * inside:.3g}", f"{1e3 * whole:.3g}", f"{error:.1e}", f"{length:.1e}"]
            for method, setting, inside, whole, error, length in rows[name]
        ]
        head = [name, "setting", "inside [ms]", "call [ms]", "error", "length error"]
        show_table(f"rigid_{name}", markdown_table(head, lines), HERE if options.readme else None)
    for folder in [options.out] + ([HERE] if options.readme else []):
        draw(rows, folder / "rigid.png")


if __name__ == "__main__":
    main()
