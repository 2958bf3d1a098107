"""Compare a map of stability of the condensed model with the full chain at a sample of its points: verdicts and run times.

    python pipelines/periodic/map.py [--out FOLDER] [--readme] [--quick] [--frequencies N] [--amplitudes N] [--links N N ...]
        [--columns N] [--points N] [--integrations N]

Writes map.nc and map.png.

The top of Example 2's guy moves along its chord.  At some random frequencies, half of them where the map has instability, the
chain's response is grown from rest over all amplitudes by the technique of the map, and all its multipliers are computed at
random amplitudes, half of them unstable ones.  At some of these points the chain is integrated in time as well.  Times are
processor times of one thread, for a point of the map.
"""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    import _study

    os.environ.update(_study.ONE_THREAD)

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, publish, short
from matplotlib import pyplot as plt

import cablepod as cp
from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import chain_of
from cablepod.parameters._from_scene import Members
from cablepod.periodic._forcing import periodic_forcing, scaled
from cablepod.periodic._map import HARMONICS, TAIL_RTOL, even_steps
from cablepod.periodic._map_general import guesses
from cablepod.periodic._members import model_of
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._multipliers import NO_GROWTH
from cablepod.periodic._solve import State
from periodic.chain import ChainModel, ChainSolver
from periodic.run import CASES, MODE_LINKS

HERE = Path(__file__).resolve().parent
CASE = CASES["chord"]
#: Range of frequencies [rad/s] and largest amplitude [m] of the map, modes in each direction, largest number of harmonics.
FREQUENCY, AMPLITUDE, RANK, MAX_HARMONICS = (11.0, 14.0), 0.006, 2, 20
#: Number of steps of the grid within which a change of the verdict makes an edge.
EDGE = 2
#: Time integration: exponent to which free vibrations decay, displacement of the middle out of the plane at the start [m],
#: instants of a period that are kept, step over the largest stable one.
DECAY, SEED, INSTANTS, STEP = 7.0, 1e-3, 16, 0.9
#: Change of the motion from one period to the next, relative to it, above which a run is not periodic.
NOT_PERIODIC = 0.02


# --- the chain by the technique of the map ------------------------------------------------------------------------------


@contextmanager
def one_core() -> Iterator[None]:
    """Let the process use one core, where the system can say so."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


@dataclass(eq=False)
class ChainMap:
    """Responses of a chain that grow from rest with the amplitude."""

    scene: xr.Dataset
    scales: PeriodicModel
    links: int
    amplitudes: np.ndarray

    @cached_property
    def models(self) -> list[ChainModel]:
        """Chains of all amplitudes, with the same positions at rest."""
        forcing = periodic_forcing(Members(self.scene)[0])
        one = ChainModel.of(self.scene, self.scales, self.links)
        found = []
        for amplitude in self.amplitudes:
            p = scaled(forcing.parameters, float(amplitude) / forcing.amplitude)
            model = ChainModel(replace(one.chain, p=p), one.scales, one.spatial)
            model.__dict__["rest"] = one.rest
            found.append(model)
        return found

    def solvers(self, harmonics: int) -> list[ChainSolver]:
        """Return the solvers of all amplitudes."""
        return [ChainSolver(model, harmonics) for model in self.models]

    def column(self, omega: float, solvers: dict[int, list[ChainSolver]]) -> tuple[list[State | None], int, float]:
        """Return the responses at a frequency [rad/s], their number of harmonics, and the processor time [s].

        As in the map, a column with much in the last two harmonics is computed again with twice as many.
        """
        spent, harmonics = 0.0, HARMONICS
        while True:
            if harmonics not in solvers:
                solvers[harmonics] = self.solvers(harmonics)
            begin = time.process_time()
            states = self._grown(omega / self.scales.scales[0], solvers[harmonics])
            spent += time.process_time() - begin
            tail = max((state.tail for state in states if state is not None), default=0.0)
            if tail <= TAIL_RTOL or 2 * harmonics > MAX_HARMONICS:
                return states, harmonics, spent
            harmonics *= 2

    def _grown(self, omega: float, solvers: list[ChainSolver]) -> list[State | None]:
        """Return the responses of all amplitudes, from the first guesses of the map."""
        states: list[State | None] = []
        for solver, is_even in zip(solvers, even_steps(self.amplitudes).tolist(), strict=False):
            found = None
            for guess in guesses(solver.rest(omega), states, is_even):
                state, _, iterations = solver.at_frequency(guess)
                if iterations > 0:
                    found = state
                    break
            states.append(found)
        return states


def growths(solver: ChainSolver, state: State) -> tuple[np.ndarray, float]:
    """Return the growth rates in the plane and out of it [1/s], and the processor time of all multipliers [s]."""
    begin = time.process_time()
    size = np.abs(solver.multipliers(state))
    spent = time.process_time() - begin
    split = 2 * solver.model.size
    scale = solver.model.scales[0]
    largest = np.array([size[:split].max(), size[split:].max()])
    return np.log(largest) / (2.0 * np.pi / state.omega) * scale, spent


# --- the chain in time --------------------------------------------------------------------------------------------------


def integrated(omega: float, amplitude: float, links: int) -> tuple[bool, float]:
    """Return whether the planar motion of the forcing's period is left after long forcing, and the processor time [s].

    The chain starts from rest, its middle slightly out of the plane, and runs until free vibrations would have fallen by
    exp(-DECAY), with nearly the longest stable step of the explicit scheme.
    """
    chain = chain_of(Members(CASE.scene(omega, amplitude))[0], links)
    points = rest_shape(chain)[0]
    aside = SEED * np.sin(np.pi * np.arange(links + 1) / links) ** 2
    scene = CASE.scene(omega, amplitude, spatial=True, points=np.column_stack([points, aside]).tolist())
    period = 2.0 * np.pi / omega
    first = int(np.ceil(2.0 * DECAY / CASE.damping / period))
    times = np.append(0.0, period * (first + np.arange(2 * INSTANTS) / INSTANTS))
    step = STEP * 2.0 / chain.highest_frequency()
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cp.VelocityJumpWarning)
        warnings.simplefilter("ignore", cp.NotConvergedWarning)
        run = cp.chain.simulate(
            scene, links=links, times=times, step=step, scheme="velocity_verlet", outputs=("position",)
        ).position.values[1:]
    spent = time.process_time() - begin
    now, then = run[INSTANTS:], run[:INSTANTS]
    motion = np.abs(now[..., :2] - now[..., :2].mean(axis=0)).max()
    left = np.abs(now[..., 2]).max() > SEED or np.abs((now - then)[..., :2]).max() > NOT_PERIODIC * motion
    return bool(left), spent


# --- the study ----------------------------------------------------------------------------------------------------------


def changes_nearby(unstable: np.ndarray, steps: int = EDGE) -> np.ndarray:
    """Return where a verdict changes within some steps of the grid."""
    padded = np.pad(unstable, steps, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * steps + 1, 2 * steps + 1))
    return np.asarray(windows.any(axis=(2, 3)) & ~windows.all(axis=(2, 3)))


def sampled(unstable: np.ndarray, columns: int, points: int, seed: int) -> list[tuple[int, list[int]]]:
    """Return random columns of a map, half of them with unstable points, each with random rows, half of them unstable."""
    rng = np.random.default_rng(seed)
    among = rng.permutation(np.flatnonzero(unstable.any(axis=0)))[: columns // 2]
    others = np.setdiff1d(np.arange(unstable.shape[1]), among)
    found = []
    for f in np.sort(np.concatenate([among, rng.permutation(others)[: columns - among.size]])):
        some = rng.permutation(np.flatnonzero(unstable[:, f]))[: points // 2]
        stable = rng.permutation(np.flatnonzero(~unstable[:, f]))[: points - some.size]
        found.append((int(f), sorted(np.concatenate([some, stable]).tolist())))
    return found


def study(
    frequencies: int,
    amplitudes: int,
    links: tuple[int, ...],
    columns: int,
    points: int,
    integrations: int,
    progress: Callable[[str], None] = lambda text: None,
) -> xr.Dataset:
    """Return the map, and verdicts and times of chains at a sample of its points, along `sample`."""
    scene = CASE.scene()
    modes = cp.condensed.vibration_modes(scene, rank=RANK, links=MODE_LINKS)
    grid = {
        "frequency": np.linspace(*FREQUENCY, frequencies),
        "amplitude": AMPLITUDE * np.arange(1, amplitudes + 1) / amplitudes,
    }
    cp.periodic.stability_map(scene, modes, **{key: values[:3] for key, values in grid.items()})  # compiles
    walls, times = [], []
    for _ in range(5):
        begin = time.perf_counter()
        found = cp.periodic.stability_map(scene, modes, **grid)
        walls.append(time.perf_counter() - begin)
        with one_core():  # as the chain runs
            used = time.process_time()
            cp.periodic.stability_map(scene, modes, **grid)
            times.append(time.process_time() - used)
    growth = np.stack([found["growth_in_plane"].values, found["growth_out_of_plane"].values])
    # what the kernel takes for neutral is stable
    unstable = growth * 2.0 * np.pi / grid["frequency"] > NO_GROWTH
    edges = np.stack([changes_nearby(part) for part in unstable])
    chosen = sampled(unstable.any(axis=0), columns, points, seed=0)
    places = [(a, f) for f, rows in chosen for a in rows]
    scales, _ = model_of(scene, modes, rank=RANK, order="leading", out_of_plane=True)
    of_chain = np.full((len(links), len(places), 2), np.nan)
    orbit_time, multiplier_time = np.zeros(len(links)), np.zeros(len(links))
    for k, count in enumerate(links):
        chain = ChainMap(scene, scales, count, grid["amplitude"])
        solvers: dict[int, list[ChainSolver]] = {HARMONICS: chain.solvers(HARMONICS)}
        chain.column(float(grid["frequency"][0]), {HARMONICS: solvers[HARMONICS][:2]})  # compiles
        spent, place = [], 0
        for f, rows in chosen:
            progress(f"chain of {count} links: {grid['frequency'][f]:.2f} rad/s")
            states, harmonics, seconds = chain.column(float(grid["frequency"][f]), solvers)
            orbit_time[k] += seconds / (len(chosen) * amplitudes)
            for a in rows:
                state = states[a]
                if state is not None:
                    of_chain[k, place], seconds = growths(solvers[harmonics][a], state)
                    spent.append(seconds)
                place += 1
        multiplier_time[k] = float(np.median(spent))
    rows, cols = (np.array(part) for part in zip(*places, strict=True))
    left, integration_time = np.full((len(links), len(places)), np.nan), np.full(len(links), np.nan)
    off = ~edges[:, rows, cols].any(axis=0)
    tried = np.random.default_rng(1).permutation(np.flatnonzero(off))[:integrations]
    for k, count in enumerate(links):
        spent = []
        for i in tried:
            progress(f"chain of {count} links in time: {len(spent) + 1} of {tried.size}")
            verdict, seconds = integrated(
                float(grid["frequency"][cols[i]]), float(grid["amplitude"][rows[i]]), count
            )  # fmt: skip
            left[k, i] = verdict
            spent.append(seconds)
        integration_time[k] = float(np.median(spent)) if spent else np.nan
    variables: dict[str, tuple[Any, Any, str, str]] = {
        "growth": (("set", "amplitude", "angular_frequency"), growth, "s-1", "growth rate of the map"),
        "sample_amplitude": ("sample", grid["amplitude"][rows], "m", "amplitude of the point"),
        "sample_angular_frequency": ("sample", grid["frequency"][cols], "rad s-1", "angular frequency of the point"),
        "sample_growth": (("sample", "set"), growth[:, rows, cols].T, "s-1", "growth rate of the map at the point"),
        "at_edge": (("sample", "set"), edges[:, rows, cols].T, "1", "whether the map's verdict changes nearby"),
        "chain_growth": (("chain", "sample", "set"), of_chain, "s-1", "growth rate of the chain"),
        "chain_left": (("chain", "sample"), left, "1", "whether time integration left the planar period, nan: not run"),
        "orbit_time": ("chain", orbit_time, "s", "processor time of a response of the chain"),
        "multiplier_time": ("chain", multiplier_time, "s", "processor time of its multipliers"),
        "integration_time": ("chain", integration_time, "s", "processor time of a run of the chain"),
        "map_wall_time": ("run", np.array(walls), "s", "wall time of the map"),
        "map_time": ("run", np.array(times), "s", "processor time of the map in one thread"),
    }
    result = xr.Dataset(
        {name: (dims, values, {"units": units, "long_name": text}) for name, (dims, values, units, text) in variables.items()},
        coords={"amplitude": grid["amplitude"], "angular_frequency": grid["frequency"],
                "set": ["in plane", "out of plane"], "links": ("chain", np.array(links))},
    )  # fmt: skip
    result["amplitude"].attrs.update(units="m", long_name="amplitude of the upper end along the chord")
    result["angular_frequency"].attrs.update(units="rad s-1", long_name="angular frequency of the upper end")
    result["set"].attrs.update(units="1", long_name="coordinates of the disturbance")
    result["links"].attrs.update(units="1", long_name="number of links of the chain")
    result.attrs.update(
        title=CASE.title, stage="comparison", edges=int(found.sizes["edge"]),
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        load=os.getloadavg()[0],
    )  # fmt: skip
    return result


def verdicts(result: xr.Dataset, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where the verdicts of map and chain agree, and where they are off the edges, both (sample, set)."""
    neutral = NO_GROWTH * result["sample_angular_frequency"].values[:, None] / (2.0 * np.pi)
    chain = result["chain_growth"].values[k]
    agree = (result["sample_growth"].values > neutral) == (chain > neutral)
    return agree & np.isfinite(chain), ~result["at_edge"].values.astype(bool)


def table(result: xr.Dataset) -> str:
    """Write agreement and times of all chains, and times over those of the map."""
    cells = result.sizes["amplitude"] * result.sizes["angular_frequency"]
    of_map = float(result["map_time"].median()) / cells
    lines = []
    for k, links in enumerate(result["links"].values):
        agree, off = verdicts(result, k)
        chain = {name: float(result[name][k]) for name in ("orbit_time", "multiplier_time", "integration_time")}
        point = chain["orbit_time"] + chain["multiplier_time"]
        growth = result["sample_growth"].values
        difference = np.abs(result["chain_growth"].values[k] - growth)[off & (growth > 0.0)]
        middle = np.nanmedian(difference) if difference.size else np.nan
        left = result["chain_left"].values[k]
        run = np.isfinite(left)
        grows = (growth > 0.0).any(axis=1)
        lines.append(
            [str(int(links)), f"{100.0 * agree[off].mean():.1f} % of {int(off.sum())}", f"{100.0 * agree.mean():.1f} %",
             f"{middle:.1e} of {growth.max():.1e}", f"{1e3 * point:.2g}", short(point / of_map),
             f"{int((left[run] == grows[run]).sum())} of {int(run.sum())}", short(chain["integration_time"]),
             short(chain["integration_time"] / of_map)]
        )  # fmt: skip
    head = (
        "links", "verdicts agree, off the edges", "all", "growth differs by, 1/s", "point, ms", "ratio", "in time agree",
        "run, s", "ratio",
    )  # fmt: skip
    wall, used = (float(result[name].median()) for name in ("map_wall_time", "map_time"))
    said = (
        f"Map of {result.sizes['angular_frequency']} x {result.sizes['amplitude']} points, {RANK} + {RANK} modes, "
        f"{result.attrs['edges']} edges refined: {used:.2f} s of processor time in one thread, "
        f"{1e6 * of_map:.0f} microseconds a point; "
        f"{wall:.2f} s on {result.attrs['cores']} cores (load of the machine {result.attrs['load']:.0f})."
    )
    return f"{said}\n\n{markdown_table(head, lines)}"


def draw(result: xr.Dataset, path: Path) -> None:
    """Draw the map, and the verdicts of the finest chain at the sample."""
    picture, axes = plt.subplots(1, 2, figsize=(9.0, 4.0), sharey=True, layout="constrained")
    agree, _ = verdicts(result, -1)
    chain = result["chain_growth"].values[-1]
    x, y = result["sample_angular_frequency"].values, 1e3 * result["sample_amplitude"].values
    for k, ax in enumerate(axes):
        growth = np.where(result["growth"].values[k] > 0.0, result["growth"].values[k], np.nan)
        image = ax.pcolormesh(
            result["angular_frequency"], 1e3 * result["amplitude"], growth, cmap="cividis", vmin=0.0,
            vmax=float(result["growth"].max()), rasterized=True,
        )  # fmt: skip
        for unstable, marker, text in ((False, "o", "chain stable"), (True, "^", "chain unstable")):
            part = (chain[:, k] > 0.0) == unstable
            ax.plot(x[part], y[part], marker, ms=4, mfc="w" if unstable else "none", mec="k", label=text)
        wrong = ~agree[:, k]
        ax.plot(x[wrong], y[wrong], "x", ms=9, color="#D55E00", label="other verdict")
        ax.set_title(str(result["set"].values[k]), fontsize=10)
        ax.set_xlabel("angular frequency [rad/s]")
    axes[0].set_ylabel("amplitude of the top along the chord [mm]")
    picture.colorbar(image, ax=axes, label="growth rate [1/s]")
    picture.legend(*axes[1].get_legend_handles_labels(), fontsize=8, loc="outside lower center", ncols=3)
    picture.savefig(path, dpi=75)
    plt.close(picture)


def main() -> None:
    """Run, write, print and draw."""
    parser = command_line(__doc__, out="out/periodic_map", readme=True, quick="a small map and sample")
    for name, default, text in (
        ("frequencies", 200, "frequencies of the map"), ("amplitudes", 200, "amplitudes of the map"),
        ("columns", 16, "frequencies of the sample"), ("points", 6, "amplitudes of the sample at each frequency"),
        ("integrations", 6, "points at which chains are integrated in time"),
    ):  # fmt: skip
        parser.add_argument(f"--{name}", type=int, default=default, metavar="N", help=f"number of {text} ({default})")
    parser.add_argument(
        "--links", type=int, nargs="+", default=(40, 80), metavar="N", help="links of the chains (40 80)"
    )
    given = parser.parse_args()
    sizes = (given.frequencies, given.amplitudes, tuple(given.links), given.columns, given.points, given.integrations)
    if given.quick:
        sizes = (24, 16, (20,), 3, 4, 1)
    result = study(*sizes, progress=lambda text: print(text, flush=True))
    written = table(result)
    page = HERE if given.readme else None
    publish(given.out, "map", result, draw=lambda path: draw(result, path), page=page, tables={"map": written})
    print(written)


if __name__ == "__main__":
    main()
