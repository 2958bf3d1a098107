"""Define scenes, truth, settings and kernel time of the models that the study compares."""

from __future__ import annotations

import contextlib
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from _study import wrapped
from scipy.interpolate import CubicSpline

import cablepod as cp
import cablepod.cable._runs
import cablepod.chain._explicit
import cablepod.condensed._runs
import cablepod.galerkin._runs  # all loaded at the first call otherwise, too late to be watched
from cablepod.cable._mesh import mesh_of
from cablepod.catenary import _kernels_solve as catenary_kernel
from cablepod.catenary._formulas import LENGTH
from cablepod.catenary._shape import shape
from cablepod.catenary._statics import load_plane, solve_statics
from cablepod.discretisation._chain import chain_of
from cablepod.examples import scene as shipped
from cablepod.examples import truth_path, truths
from cablepod.integrate._comparison import motion_scale
from cablepod.integrate._output_times import preferred_steps_per_second
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._parameters import Parameters

EXAMPLES = ("example2", "example3", "example4")
#: Scenes without modes of their own, cables as in Example 2: a flatter guy in side wind, and a long and almost level one.
UNSEEN: dict[str, dict[str, Any]] = {
    "guy": {
        "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 6000.0},
        "ends": {"lower": [0.0, 0.0], "upper": [35.0, 45.0]},
        "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 0.7}}},
        "load": {"uniform": [4.90625, 0.0]},
    },
    "flat": {
        "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 9000.0},
        "ends": {"lower": [0.0, 0.0], "upper": [75.0, 12.0]},
        "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.06, "angular_frequency": 0.25}}},
        "load": {"uniform": [0.0, 0.0]},
    },
}
#: Numbers of links of the chains that modes are trained on.
TRAINED = (40, 80, 160)
RANKS = (1, 2, 3, 4, 6, 8, 10)
STEPS = (5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
#: Number of elements of the truth, of order 7 (16 differ by less than 5e-7 of the motion), and its step over the stability limit.
ELEMENTS, SHARE = 12, 0.8
#: Number of points along the cable at which quasi-static sequences are given.
PLACES = 41


def scene_of(name: str, duration: float) -> xr.Dataset:
    """Return a scene by name, with a duration [s] and an output every second."""
    if name in UNSEEN:
        time_table = {"duration": duration, "interval": 1.0}
        return cp.make_scene(
            {"title": name, "gravity": 9.81, **UNSEEN[name], "time": time_table, "chain": {"links": 40}}
        )
    given = shipped(name)
    return given.assign(time_duration=((), duration, given["time_duration"].attrs))


# --- truth ------------------------------------------------------------------------------------------------------------


@dataclass
class Truth:
    """The converged continuous cable of a scene by one law."""

    scene: xr.Dataset
    law: str
    nodes: np.ndarray  #: positions of the nodes of the elements (times, nodes, dims) [m]
    elements: int
    _known: dict[int, np.ndarray] = field(default_factory=dict)

    def at(self, particles: int) -> np.ndarray:
        """Return positions at equal unstretched distances (times, particles, dims) [m]."""
        if particles not in self._known:
            mesh = mesh_of(parameters(self.scene), self.elements, law=self.law, points="nodes")
            self._known[particles] = mesh.interpolate(self.nodes, mesh.total_length * np.linspace(0.0, 1.0, particles))
        return self._known[particles]

    def errors(self, position: np.ndarray) -> tuple[float, float]:
        """Return maximum and rms over time of the error, defined as in cablepod.compare."""
        truth = self.at(position.shape[1])
        chord = float(np.linalg.norm(truth[0, -1] - truth[0, 0]))
        error = np.sqrt(np.mean(np.sum((position - truth) ** 2, axis=-1), axis=-1))
        error /= motion_scale(truth, truth[0], chord)
        return float(error.max()), float(np.sqrt(np.mean(error**2)))


def truth_of(name: str, given: xr.Dataset, law: str, times: np.ndarray, folder: Path, elements: int) -> Truth:
    """Compute the truth at all instants, or read that of an earlier run from `folder`."""
    path = folder / f"truth_{name}_{law}_{elements}.nc"
    if path.exists():
        kept = cp.archive.read(path)
        if kept.sizes["time"] == times.size and np.allclose(kept["time"].values, times):
            return Truth(given, law, kept["position"].values, elements)
    mesh = mesh_of(parameters(given), elements, law=law, points="nodes")
    # by law (21) the cable at rest is stiffer, by a thousandth: less than the margin
    step = 1.0 / preferred_steps_per_second(mesh.highest_frequency(1.0) / (2.0 * SHARE))
    run = cp.cable.simulate(given, elements=elements, law=law, step=step, times=times, points="nodes")
    cp.archive.write(run, path, overwrite=True)
    return Truth(given, law, run["position"].values, elements)


def from_file(name: str, truth: Truth, times: np.ndarray) -> float:
    """Return the maximum difference from the truth on file over the motion, or nan."""
    if (name, truth.law) not in truths():
        return float("nan")
    kept = cp.archive.read(truth_path(name, truth.law))
    kept = kept.isel(time=kept["time"].values <= times[-1] + 1e-9)
    ours = truth.at(kept.sizes["particle"])[np.searchsorted(times, kept["time"].values - 1e-9)]
    theirs = kept["position"].values
    scale = motion_scale(theirs, theirs[0], float(np.linalg.norm(theirs[0, -1] - theirs[0, 0])))
    return float(np.sqrt(np.mean(np.sum((ours - theirs) ** 2, axis=-1), axis=-1)).max()) / scale


# --- modes ------------------------------------------------------------------------------------------------------------


@dataclass
class Training:
    """Modes by layout and number of links, with their offline time [s]."""

    modes: dict[tuple[Any, ...], xr.Dataset]
    seconds: dict[tuple[Any, ...], float]


def trained_on(scenes: list[xr.Dataset], sizes: tuple[int, ...], rank: int) -> Training:
    """Decompose the snapshots of chains of all scenes together.

    Chains run explicitly at 0.9 of their limit and give one snapshot a second.
    """
    found = Training({}, {})
    for links in sizes:
        begin = time.perf_counter()
        runs = []
        for given in scenes:
            limit = chain_of(parameters(given), links).step_limit()
            runs.append(cp.chain.simulate(given, links=links, scheme="velocity_verlet", step=0.9 * limit))
        # of several scenes the lengths differ, the fractions of the length at which particles stand do not
        snapshots = xr.concat([run["position"] for run in runs], dim="member").to_dataset(name="position")
        snapshots = snapshots.assign_coords(arc_length=runs[0]["arc_length"].variable)
        spent = time.perf_counter() - begin
        for layout in ("normal", "separate") if links == sizes[0] else ("normal",):
            begin = time.perf_counter()
            found.modes[layout, links] = cp.pod.decompose(snapshots, rank=rank, layout=layout)
            found.seconds[layout, links] = spent + time.perf_counter() - begin
    return found


# --- settings ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Setting:
    """One model with all its options.

    The step of an explicit full model is a share of its stability limit.
    """

    family: str  #: "full", "reduced" or "quasi-static"
    model: str
    scheme: str
    size: int  #: links of a chain or of the one trained on, elements of a cable
    order: str = ""  #: of the elements, or of the condensed model
    rank: int = 0
    points: int = 0  #: of quadrature along the cable, instead of the links
    step: float = 0.0  #: [s]
    share: float = 0.0  #: of the stability limit, instead of a step

    @property
    def name(self) -> str:
        """Name in tables."""
        what = {"chain": "n", "cable": "elements"}.get(self.model, "trained with n")
        parts = [
            self.model,
            f"order {self.order}" if self.model == "cable" else self.order,
            f"r = {self.rank}" if self.rank else "",
            f"{what} = {self.size}" if self.size else "",
            f"{self.points} points" if self.points else "",
        ]
        return ", ".join(part for part in [*parts, self.scheme.replace("_", " ")] if part)


def settings(*, quick: bool) -> list[Setting]:
    """Return all settings of the study."""
    found = []
    for n in (8, 20) if quick else (5, 8, 10, 13, 16, 20, 26, 32, 40, 56, 80, 113, 160):
        found += [Setting("full", "chain", "trapezoidal", n, step=h) for h in (STEPS[2:7:2] if quick else STEPS)]
    found += [Setting("full", "chain", "velocity_verlet", n, share=0.9) for n in ((8,) if quick else (10, 20, 40, 80))]
    cables = ((7, (1,)),) if quick else ((3, (2, 4)), (5, (1, 2)), (7, (1, 2, 3, 4)))
    for order, counts in cables:
        for count in counts:
            found += [
                Setting("full", "cable", "trapezoidal", count, str(order), step=h)
                for h in (STEPS[3:5] if quick else STEPS[1:] if count < 3 else STEPS[1:-1])
            ]
            if order == 7 and count < 4 and not quick:
                found.append(Setting("full", "cable", "velocity_verlet", count, "7", share=0.9))
    found += [Setting("quasi-static", "catenary", "", 0, step=h) for h in (5.0, 2.0, 1.0, 0.5, 0.1)]
    found += [
        Setting("reduced", "Galerkin", "velocity_verlet", TRAINED[0], "law (21)", r, share=share)
        for r in ((2,) if quick else (1, 2, 3, 4, 6, 8))
        for share in (0.8, 0.3)
    ]
    return found + _condensed(quick)


def _condensed(quick: bool) -> list[Setting]:
    if quick:
        return [
            Setting("reduced", "condensed", scheme, 40, "leading", 2, step=h)
            for scheme, h in (("velocity_verlet", 0.1), ("velocity_verlet", 0.05), ("trapezoidal", 0.2))
        ] + [Setting("reduced", "condensed", "velocity_verlet", 40, "exact", 2, points, step=0.05) for points in (0, 8)]
    found = []
    explicit, implicit = "velocity_verlet", "trapezoidal"
    for order, scheme, sizes, ranks, points, steps in (
        # to leading order a step costs the same whatever the links
        ("leading", explicit, (40, 160), RANKS, (0,), (0.25, *(h for h in STEPS if h <= 0.2))),
        ("leading", implicit, (40, 160), RANKS[:-1], (0,), STEPS[:-2]),
        ("exact", explicit, TRAINED, (2, 3, 4, 6, 8), (0,), (0.1, 0.05, 0.02, 0.01)),
        ("exact", implicit, TRAINED, (2, 3, 4, 6), (0,), (2.0, 1.0, 0.5, 0.2, 0.1)),
        ("exact", explicit, (160,), (1, 2, 3, 4), (8, 16), (0.25, 0.2, 0.1, 0.05, 0.02, 0.01)),
        ("exact", implicit, (160,), (1, 2, 3, 4), (8, 16), (2.0, 1.0, 0.5, 0.2, 0.1)),
        ("inertial", explicit, TRAINED, (4, 6, 8), (0,), (0.02, 0.01)),
        ("inertial", implicit, TRAINED[:2], (2, 4, 8), (0,), (0.5, 0.2, 0.1, 0.05)),
        ("inertial", explicit, (160,), (6, 8), (16, 24), (0.02, 0.01, 0.005)),
    ):
        found += [
            Setting("reduced", "condensed", scheme, n, order, r, m, step=h)
            for n in sizes
            for r in ranks
            for m in points
            for h in steps
        ]
    return found


def basis(setting: Setting) -> tuple[Any, ...]:
    """Return the key of a setting's modes in a Training."""
    return {"Galerkin": "separate", "condensed": "normal"}.get(setting.model, ""), setting.size


def limit_of(given: xr.Dataset, setting: Setting, training: Training) -> float:
    """Return the stability limit of a full or Galerkin model at the start [s]."""
    p = parameters(given)
    if setting.model == "chain":
        return chain_of(p, setting.size).step_limit()
    if setting.model == "cable":
        mesh = mesh_of(p, setting.size, int(setting.order), law="linear")
        return 2.0 / mesh.highest_frequency(1.0)
    modes = training.modes["separate", setting.size]
    return cp.galerkin.simulate(given, modes, rank=setting.rank, times=[0.0], step=1e-6).attrs["step_limit"]


def law_of(setting: Setting) -> str:
    """Return the law of a setting and of its truth."""
    return "green" if setting.model == "Galerkin" else "linear"


def job_of(given: xr.Dataset, setting: Setting, step: float, training: Training) -> Callable[..., Any]:
    """Return the public call of a setting as a function of `times` and `outputs`."""
    if setting.model == "catenary":
        return partial(sequence, given, step)
    options: dict[str, Any] = {"scheme": setting.scheme, "step": step}
    if setting.model == "chain":
        return partial(cp.chain.simulate, given, links=setting.size, law="linear", **options)
    if setting.model == "cable":
        order, points = int(setting.order), PLACES
        return partial(
            cp.cable.simulate, given, elements=setting.size, order=order, points=points, law="linear", **options
        )
    options["rank"] = setting.rank
    if setting.model == "Galerkin":
        return partial(cp.galerkin.simulate, given, training.modes["separate", setting.size], law="green", **options)
    modes = training.modes[basis(setting)]
    if setting.points:
        options["quadrature"] = setting.points
    return partial(cp.condensed.simulate, given, modes, order=setting.order, **options)


# --- quasi-static sequence --------------------------------------------------------------------------------------------


def _catenaries(p: Parameters, times: np.ndarray) -> tuple[list[tuple[Any, tuple[Any, ...]]], tuple[np.ndarray, ...]]:
    """Return the calls of the catenaries at some instants, and their arrays.

    The arrays are lower ends, solutions to be filled, and unit vectors.
    """
    _, _, _, q, across, against = load_plane(p)
    length = float(solve_statics(p, p.length_key, p.length_value)[0])
    ends = p.end_positions(times)
    chord = ends[:, 1] - ends[:, 0]
    span, rise = np.ascontiguousarray(chord @ across), np.ascontiguousarray(chord @ against)
    out, status = np.empty((times.size, 6)), np.empty(times.size, dtype=np.int64)
    same = (np.full(times.size, item) for item in (q, p.stiffness, length))
    loads, stiff, lengths = same
    solve = (span, rise, np.hypot(span, rise), loads, stiff, LENGTH, lengths, out, status)
    calls = [(function, (times,)) for function in p.motions.values()]
    return [*calls, (catenary_kernel.solve_many, solve)], (ends[:, 0], out, across, against)


def knots(times: np.ndarray, step: float) -> np.ndarray:
    """Return instants of a sequence to beyond `times`, at least four for the cubic."""
    return step * np.arange(max(int(np.ceil(times[-1] / step - 1e-9)), 3) + 1)


def sequence(
    given: xr.Dataset, step: float, *, times: np.ndarray, outputs: tuple[str, ...] = ("position",)
) -> xr.Dataset:
    """Compute quasi-static positions: catenaries every `step`, cubic splines in time between them."""
    p = parameters(given)
    at = knots(times, step)
    calls, (lower, solutions, across, against) = _catenaries(p, at)
    function, arguments = calls[-1]
    function(*arguments)
    shapes = np.empty((at.size, PLACES, p.dims))
    for target, base, solution in zip(shapes, lower, solutions, strict=True):
        x, y, _ = shape(solution[0] * np.linspace(0.0, 1.0, PLACES), solution, p_load(p), p.stiffness)
        target[:] = base + x[:, None] * across + y[:, None] * against
    position = CubicSpline(at, shapes, axis=0)(times)
    return xr.Dataset(
        {name: (("time", "particle", "coordinate"), position) for name in outputs}, coords={"time": times}
    )


def p_load(p: Parameters) -> float:
    """Return the total load per unstretched length [N/m]."""
    return load_plane(p)[3]


# --- time of the kernel -----------------------------------------------------------------------------------------------

#: Functions that march from the first state to the last.
MARCHES = ("cablepod.integrate._march.advance_in_blocks",)
#: Compiled loops, and the tables of ends and loads that they need.
COMPILED = (
    "cablepod.chain._kernels_explicit.verlet",
    "cablepod.chain._kernels_implicit.implicit",
    "cablepod.cable._kernels_explicit.verlet",
    "cablepod.cable._kernels_trapezoidal.trapezoidal",
    "cablepod.galerkin._kernels_explicit.verlet",
    "cablepod.condensed._kernels_frame.planar_frames_of_lanes",
    "cablepod.condensed._kernels_frame.spatial_frames_of_lanes",
    "cablepod.condensed._kernels_explicit.verlet",
    "cablepod.condensed._kernels_explicit.numerov",
    "cablepod.condensed._kernels_implicit.trapezoidal",
    "cablepod.condensed._kernels_exact.exact_verlet",
    "cablepod.condensed._kernels_implicit.exact_trapezoidal",
)
TABLES = (
    "cablepod.parameters._time_functions.TimeFunction.__call__",
    "cablepod.parameters._time_functions.TimeFunction.at_steps",
    "cablepod.parameters._time_functions.TimeFunction.all_at_steps",
)


def kernel_calls(
    job: Callable[..., Any], times: np.ndarray, setting: Setting, outputs: tuple[str, ...] = ()
) -> tuple[list[tuple[Any, tuple[Any, ...]]], xr.Dataset]:
    """Record compiled loops and tables of a call between first and last state.

    Returns them and the result of the call.
    """
    if setting.model == "catenary":
        given, step = job.args  # type: ignore[attr-defined]
        return _catenaries(parameters(given), knots(times, step))[0], job(times=times, outputs=outputs)
    calls: list[tuple[Any, tuple[Any, ...]]] = []

    def note(function: Callable[..., Any], args: tuple[Any, ...], options: dict[str, Any]) -> Any:
        calls.append((partial(function, **options) if options else function, tuple(copied(item) for item in args)))
        return function(*args, **options)

    with _through(note):
        result = job(times=times, outputs=outputs)
    return calls, result


def seconds_within(job: Callable[..., Any], times: np.ndarray, outputs: tuple[str, ...]) -> tuple[float, float]:
    """Return the time of a call between first and last state, and the whole [s]."""
    spent = [0.0]

    def watch(function: Callable[..., Any], args: tuple[Any, ...], options: dict[str, Any]) -> Any:
        begin = time.perf_counter()
        result = function(*args, **options)
        spent[0] += time.perf_counter() - begin
        return result

    with _through(watch):
        begin = time.perf_counter()
        job(times=times, outputs=outputs)
        whole = time.perf_counter() - begin
    return spent[0], whole


@contextlib.contextmanager
def _through(note: Callable[..., Any]) -> Iterator[None]:
    """Pass the calls of compiled loops and tables between first and last state to `note`."""
    marching, inside = [False], [False]

    def marched(function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapper(*args: Any, **options: Any) -> Any:
            marching[0] = True
            try:
                return function(*args, **options)
            finally:
                marching[0] = False

        return wrapper

    def recorded(function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapper(*args: Any, **options: Any) -> Any:
            if not marching[0] or inside[0]:
                return function(*args, **options)
            inside[0] = True
            try:
                return note(function, args, options)
            finally:
                inside[0] = False

        return wrapper

    with wrapped(marched, *MARCHES), wrapped(recorded, *COMPILED, *TABLES):
        yield


def copied(item: Any) -> Any:
    """Copy an array that a call may change, also those of named arguments."""
    if isinstance(item, tuple) and hasattr(item, "_fields"):
        return type(item)(*map(copied, item))
    return item.copy(order="K") if isinstance(item, np.ndarray) and item.flags.writeable else item


def seconds_of(calls: list[tuple[Any, tuple[Any, ...]]], least: float = 2e-3, most: int = 100) -> float:
    """Return the median time of recorded calls [s], each from its recorded first state.

    The turns fill `least` seconds and are at least three, so that a disturbed one does not count, or one where calls are much
    longer.
    """
    taken: list[float] = []
    while len(taken) < (3 if sum(taken) < 20.0 * least else 1) or (sum(taken) < least and len(taken) < most):
        total = 0.0
        for function, args in calls:
            fresh = tuple(copied(item) for item in args)
            begin = time.perf_counter()
            function(*fresh)
            total += time.perf_counter() - begin
        taken.append(total)
    return statistics.median(taken)
