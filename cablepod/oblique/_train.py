"""Test functions for the condensed model, trained so that its motion keeps to that of the chain.

A Galerkin model tests its equations with the modes themselves, and takes for nothing what the modes left out do to those
retained: they pull on them, and they take length from the cable, which makes tension.  Other test functions feel less of that: a
Petrov-Galerkin model, an oblique projection.  Here they are optimised over whole trajectories, as Otto, Padovan and Rowley (2022,
Optimizing oblique projections for nonlinear systems using trajectories, SIAM J. Sci. Comput. 44, A1681) do, but with modes from
snapshots kept as trial functions.  The model has as many unknowns as before; its explicit steps may have to be a little shorter.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._resources import cores
from cablepod.batch._pool import map_threads
from cablepod.condensed._assembly import TEST, model_of
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._runs import CondensedRequest, solve
from cablepod.conventions import label
from cablepod.errors import RunStopped, SceneError, scene_error
from cablepod.integrate._request import check_positive, check_times
from cablepod.integrate._step_control import motion_scale
from cablepod.oblique._search import TestFunctionBasis, test_function_bases
from cablepod.parameters._checks import integer
from cablepod.parameters._from_scene import parameters
from cablepod.pod import _normal as pod_normal
from cablepod.pod._snapshots import positions, relative_arc_length
from cablepod.pod._training_range import add_training_range, range_of, union_of_ranges

#: Parts of the runs over which one after the other is trained: over all of them at once, a model that is out of step late tells
#: little of why, and the search ends in one of many minima.
WINDOWS = (0.125, 0.25, 0.5, 0.75, 1.0)
#: By this a coefficient is changed for a difference: test functions are as large as the modes, so it is small, and what it does
#: to a run is far above the 1e-11 at which the kernels' searches end.
SHIFT = 1e-6
#: A model that stops or refuses counts as one that errs by so many times the motion.
FAILED = 10.0
#: The search ends where the coefficients, or the sum of squares, change by less than such shares: a thousandth of the sum of
#: fourth powers is a four-thousandth of the error, far below what another scene adds.
STOP = {"xtol": 1e-4, "ftol": 1e-3, "gtol": 1e-12}


@dataclass(frozen=True)
class TrainingCase:
    """A trajectory of the chain, and how the model is run to compare with it."""

    model: CondensedModel  #: tested with its own modes
    times: np.ndarray  #: [s]
    real: np.ndarray  #: deflections of the chain (normals, times, particle) [m]
    motion: float  #: largest rms displacement of the chain [m]
    tolerance: float

    @cached_property
    def how(self) -> tuple[str, float]:
        """Scheme and step [s] that meet the tolerance with the modes as test functions; kept, so that errors are smooth."""
        solution = solve(self.model, CondensedRequest(times=self.times, given_tolerance=self.tolerance, outputs=()))
        return solution.run.scheme, 1.0 / solution.steps_per_second

    @cached_property
    def seen(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates (times, r) of the chain in a basis of the shapes, these in it (r, r), the distance left (times,) [m]."""
        coordinates, turns, left = [], np.zeros((len(self.model.shapes),) * 2), 0.0
        at = 0
        for part, count in zip(self.real, self.model.ranks, strict=False):
            basis, turn = np.linalg.qr(self.model.shapes[at : at + count].T)
            coordinates.append(part @ basis)
            turns[at : at + count, at : at + count] = turn
            left = left + ((part - coordinates[-1] @ basis.T) ** 2).sum(axis=1)
            at += count
        return np.concatenate(coordinates, axis=1), turns, np.sqrt(left)

    def until(self, share: float) -> TrainingCase:
        """Return the first part of it, with the scheme and the step of the whole."""
        count = max(2, round(share * (self.times.size - 1)) + 1)
        part = replace(self, times=self.times[:count], real=self.real[:, :count])
        part.__dict__["how"] = self.how
        return part

    def grows(self, tests: tuple[np.ndarray, ...]) -> bool:
        """Whether with these test functions small vibrations about rest grow by more than a factor of e over the run."""
        return replace(self.model, tests=tests).unstable_growth_rate * float(self.times[-1]) > 1.0

    @cached_property
    def size(self) -> float:
        """What a distance over all particles is divided by [m]."""
        return self.motion * math.sqrt(self.real.shape[2])

    def errors(self, tests: tuple[np.ndarray, ...]) -> np.ndarray:
        """Parts of the error over the motion (times, r + 1): along each direction of the modes, and off them.

        The root of the sum of their squares is the rms distance in deflection.
        """
        model = replace(self.model, tests=tests)
        model.__dict__["turned"] = self.model.spectral_basis  # as costly as the run, and the same
        coordinates, turns, left = self.seen
        scheme, step = self.how
        try:
            q = solve(model, CondensedRequest(times=self.times, scheme=scheme, step=step, outputs=())).state.q
        except (RunStopped, SceneError):
            return np.full((self.times.size, coordinates.shape[1] + 1), FAILED)
        return np.column_stack([q @ turns.T - coordinates, left]) / self.size


def train(
    scenes: xr.Dataset | Sequence[xr.Dataset],
    trajectories: xr.Dataset | Sequence[xr.Dataset],
    modes: xr.Dataset,
    *,
    rank: int | None = None,
    order: str = "leading",
    law: str = "linear",
    quadrature: int | None = None,
    tolerance: float = 1e-5,
    iterations: int = 12,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Train test functions for the condensed model, so that its motion keeps to that of chains.

    Parameters
    ----------
    scenes
        A scene or several, each with both ends held.
    trajectories
        What :func:`cablepod.chain.simulate` gives for each, from 0 s on, on the particles of the modes.
    modes
        What :func:`cablepod.pod.decompose` gives with layout "normal".
    rank
        Number of modes of each deflection; all by default.  Test functions serve this number alone.
    order, law, quadrature
        Of the model, as in :func:`cablepod.condensed.simulate`.  Test functions make up for some of what "leading" leaves out,
        so they belong to the order for which they were trained.
    tolerance
        Wanted time error of the runs that are compared, as a fraction of the motion.
    iterations
        Most changes of all test functions together, from either start and over each of five parts of the runs.  Each costs a run
        of every scene for every coefficient, of which each mode has four more than there are modes.
    progress
        Called now and then with the part that is done, from 0 to 1.

    Returns
    -------
    xarray.Dataset
        The first `rank` modes with ``test_function (mode, particle)``, in space also ``test_function_out_of_plane``, which
        :func:`cablepod.condensed.simulate` uses.  Attributes: ``training_error``, the largest distance in deflection over time
        and scenes, over the motion, ``training_error_galerkin``, the same with the modes as test functions,
        ``projection_error``, what the modes cannot hold, and what was trained for: ``trained_rank``, ``trained_order``,
        ``trained_quadrature`` (0 for the links).  ``training_range`` is that of these scenes.

    Raises
    ------
    SceneError
        For options that cannot be, trajectories that do not belong to scenes and modes.
    RunStopped
        Where the model with the modes as test functions, from which the search begins, breaks down.

    Notes
    -----
    The sum over scenes and instants of the fourth power of the distance is made least by Gauss and Newton's method with trust
    regions and differences, over the first eighth of each run, from there over a quarter and so on to the whole: once from the
    modes as test functions (Galerkin) and once from vibration modes.  Of what is found the one with the least error counts,
    which need not be the least of all, unless vibrations about rest would grow.

    Trained test functions are no principle of mechanics: what they gain holds near the scenes of training, and far from these
    they are worse than the modes.  ``outside_training``, ``growth_over_run`` and ``error_estimate`` of a run say how it stands.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example3")
    >>> chain = cp.chain.simulate(scene, times=range(41))
    >>> modes = cp.pod.decompose(chain, layout="normal", rank=3)
    >>> trained = cp.oblique.train(scene, chain, modes, iterations=8)
    >>> trained.attrs["training_error"] < 0.3 * trained.attrs["training_error_galerkin"]
    True
    >>> later = cp.condensed.simulate(scene, trained)  # over all of its 124 s
    """
    some = [scenes] if isinstance(scenes, xr.Dataset) else list(scenes)
    runs = [trajectories] if isinstance(trajectories, xr.Dataset) else list(trajectories)
    if not some or len(some) != len(runs):
        raise scene_error("trajectories", len(runs), f"one for each of the {len(some)} scenes, at least one")
    for key, items in (("scenes", some), ("trajectories", runs)):
        for item in items:
            if not isinstance(item, xr.Dataset):
                raise scene_error(key, type(item).__name__, "a Dataset or several")
    check_positive("tolerance", tolerance)
    integer(least=1)("iterations", iterations)
    given = modes
    if TEST in modes:
        modes = modes.drop_vars([f"{TEST}{suffix}" for suffix in pod_normal.SETS if f"{TEST}{suffix}" in modes])
    lessons = [
        _training_case(
            i, scene, run, modes, {"rank": rank, "order": order, "law": law, "quadrature": quadrature}, tolerance
        )
        for i, (scene, run) in enumerate(zip(some, runs, strict=True))
    ]
    tests, before, after = _improved(lessons, iterations, progress)
    count = lessons[0].model.rank
    result = modes.isel(mode=slice(0, count))
    if count < modes.sizes["mode"]:  # of all modes
        result = result.drop_vars([name for name in result.data_vars if str(name).startswith("truncation_error")])
    for suffix, part in zip(pod_normal.SETS, tests, strict=False):
        result[f"{TEST}{suffix}"] = (("mode", "particle"), np.pad(part, ((0, count - len(part)), (0, 0))))
    known: np.ndarray | None = None
    for run in runs:
        known = union_of_ranges(known, range_of(run))
    add_training_range(result, known)  # what counts is where test functions were trained
    label(result)
    result.attrs |= {
        "title": f"{modes.attrs.get('title', 'modes')}, with trained test functions",
        "trained_rank": count,
        "trained_order": order,
        "trained_quadrature": quadrature or 0,
        "training_error": after,
        "training_error_galerkin": before,
        "projection_error": max(float((item.seen[2] / item.size).max()) for item in lessons),
    }
    if progress is not None:
        progress(1.0)
    return provenance.record(
        result,
        function="oblique.train",
        parameters={
            "rank": count, "order": order, "law": law, "quadrature": quadrature, "tolerance": tolerance, "iterations": iterations,
        },
        inputs=[*some, *runs, given],
        chosen=provenance.defaulted_options(rank=rank),
    )  # fmt: skip


def _training_case(
    number: int, scene: xr.Dataset, run: xr.Dataset, modes: xr.Dataset, options: dict[str, Any], tolerance: float
) -> TrainingCase:
    """Check one scene with its trajectory, and make it ready."""
    if "member" in scene.dims:
        raise scene_error("scenes", f"members of scene {number}", "single scenes, isel(member=...)")
    p = parameters(scene)
    model = model_of(p, modes, **options)
    sigma, own = relative_arc_length(modes), relative_arc_length(run)
    if sigma.shape != own.shape or np.abs(sigma - own).max() > 1e-9:
        raise scene_error(
            "trajectories",
            f"{own.size} particles in number {number}",
            f"the {sigma.size} particles of the modes, at the same S / L0",
        )
    position, times = positions(run), check_times(run["time"].values)
    if len(position) != times.size:
        raise scene_error(
            "trajectories", f"{len(position)} shapes in number {number}", f"one for each of its {times.size} instants"
        )
    ends = p.end_positions(times)
    chord = float(np.linalg.norm(ends[0, 1] - ends[0, 0]))
    off = float(np.abs(position[:, (0, -1)] - ends).max())
    if off > 1e-6 * chord:
        raise scene_error(
            "trajectories",
            f"ends {off:.3g} m off those of scene {number}",
            "the trajectory of each scene, in their order",
        )
    motion = motion_scale(position, position[0], chord)
    return TrainingCase(model, times, pod_normal.deflections(position, model.reference), motion, tolerance)


def _improved(
    lessons: list[TrainingCase], iterations: int, progress: Callable[[float], None] | None
) -> tuple[tuple[np.ndarray, ...], float, float]:
    """Return the best test functions found, and the largest errors with the modes and with them."""
    starts = [start for start in test_function_bases(lessons[0].model) if start.count]
    done, all_runs = 0.0, sum(WINDOWS) * sum(iterations * (start.count + 1) for start in starts)

    def tell(share: float) -> None:
        nonlocal done
        done += share
        if progress is not None:
            progress(min(done / all_runs, 1.0))

    def largest(tests: tuple[np.ndarray, ...]) -> float:
        return max(float(np.linalg.norm(item.errors(tests), axis=1).max()) for item in lessons)

    for item in lessons:
        _ = item.how  # a model that breaks down with its own modes says why
    best = lessons[0].model.modes
    before = least = largest(best)
    for start in starts:
        x = np.zeros(start.count)
        for share in WINDOWS:
            x = _fitted(start, x, [item.until(share) for item in lessons], iterations, functools.partial(tell, share))
            tests = start.tests(x)
            after = largest(tests)
            if after < least and not any(item.grows(tests) for item in lessons):
                best, least = tests, after
    return best, before, least


def _fitted(
    start: TestFunctionBasis, x: np.ndarray, lessons: list[TrainingCase], iterations: int, tell: Callable[[], None]
) -> np.ndarray:
    """Return the numbers that make the sum of fourth powers of the distances least, from `x` on; each run of all is told."""
    from scipy.optimize import least_squares  # costly to import

    first = start.tests(x)
    # in their own size, for errors of 1e-6 are worth as much as others
    size = max(float(np.linalg.norm(item.errors(first), axis=1).max()) for item in lessons) or 1.0

    def measure(x: np.ndarray) -> np.ndarray:
        """Distances squared: the sum of their squares is what is made least."""
        tests = start.tests(x)
        parts = [item.errors(tests) / size for item in lessons]
        tell()
        return np.concatenate([(part * np.linalg.norm(part, axis=1)[:, None]).ravel() for part in parts])

    def slope(x: np.ndarray) -> np.ndarray:
        base = measure(x)
        # compiled loops let others run beside them
        shifted = map_threads(lambda unit: (measure(x + SHIFT * unit) - base) / SHIFT, np.eye(x.size), cores())
        return np.stack(shifted, axis=1)

    return np.asarray(least_squares(measure, x, jac=slope, max_nfev=iterations, **STOP).x)
