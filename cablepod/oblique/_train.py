"""Training of test functions of the condensed model over trajectories: training cases, optimisation, labelled result."""

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
from cablepod._inputs import NORMAL_MODES, ROUNDING, SCENE, TRAJECTORY, several, taken
from cablepod._resources import cores
from cablepod.batch._pool import map_threads
from cablepod.condensed._assembly import TEST, model_of
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._runs import CondensedRequest, solve
from cablepod.conventions import VARIABLES, label
from cablepod.errors import RunStopped, SceneError, scene_error
from cablepod.integrate._request import check_positive, check_times
from cablepod.integrate._step_control import motion_scale
from cablepod.oblique._search import TestFunctionBasis, test_function_bases
from cablepod.parameters._checks import integer
from cablepod.parameters._from_scene import parameters
from cablepod.pod import _normal as pod_normal
from cablepod.pod._snapshots import positions, relative_arc_length
from cablepod.pod._training_range import add_training_range, range_of, union_of_ranges
from cablepod.reduced._validity import MAX_LOG_GROWTH
from cablepod.wind._air import check_no_wind

#: Fractions of the runs that are fitted in turn.  Over the whole run at once a late phase error says little about its cause, and
#: the search ends in one of many local minima.
WINDOWS = (0.125, 0.25, 0.5, 0.75, 1.0)
#: Finite-difference increment of a coefficient (small beside the test functions, far above the kernels' Newton tolerance).
INCREMENT = 1e-6
#: Error assigned to a run that stops or is refused, as a multiple of the motion.
FAILED_ERROR = 10.0
#: Relative tolerances of the search: 1e-3 of the sum of fourth powers is 2.5e-4 of the error.
STOP = {"xtol": 1e-4, "ftol": 1e-3, "gtol": 1e-12}
#: Maximum distance of trajectory and modes in sigma, and of trajectory and scene at the ends over the chord.
SIGMA_ATOL, END_RTOL = ROUNDING, 1e-6


@dataclass(frozen=True)
class TrainingCase:
    """A reference trajectory, and the model that is compared with it."""

    model: CondensedModel  #: with its modes as test functions
    times: np.ndarray  #: instants (times,) [s]
    reference: np.ndarray  #: deflections of the reference (normals, times, particle) [m]
    motion: float  #: largest rms displacement of the reference [m]
    tolerance: float  #: time error of the runs of the model, as a fraction of the motion

    @cached_property
    def scheme_and_step(self) -> tuple[str, float]:
        """Scheme and step [s] that meet the tolerance for Galerkin; kept fixed, so that errors are smooth in x."""
        solution = solve(self.model, CondensedRequest(times=self.times, given_tolerance=self.tolerance, outputs=()))
        return solution.run.scheme, 1.0 / solution.steps_per_second

    @cached_property
    def projection(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Projection of the reference onto an orthonormal basis of the shapes.

        Returns coordinates of the reference (times, r) [m], matrix from coordinates of the model to those (r, r), and distance
        of the reference from its projection (times,) [m], summed over all particles.
        """
        coordinates, change, left = [], np.zeros((len(self.model.shapes),) * 2), 0.0
        begin = 0
        for part, count in zip(self.reference, self.model.ranks, strict=False):
            basis, triangle = np.linalg.qr(self.model.shapes[begin : begin + count].T)
            coordinates.append(part @ basis)
            change[begin : begin + count, begin : begin + count] = triangle
            left = left + ((part - coordinates[-1] @ basis.T) ** 2).sum(axis=1)
            begin += count
        return np.concatenate(coordinates, axis=1), change, np.sqrt(left)

    def first_part(self, fraction: float) -> TrainingCase:
        """Return the first part of the case, with the scheme and step of the whole."""
        count = max(2, round(fraction * (self.times.size - 1)) + 1)
        part = replace(self, times=self.times[:count], reference=self.reference[:, :count])
        part.__dict__["scheme_and_step"] = self.scheme_and_step
        return part

    def grows(self, test_functions: tuple[np.ndarray, ...]) -> bool:
        """Return whether vibrations about rest grow by more than a factor of e over the run."""
        model = replace(self.model, raw_test_functions=test_functions)
        return model.unstable_growth_rate * float(self.times[-1]) > MAX_LOG_GROWTH

    @cached_property
    def scale(self) -> float:
        """Divisor of distances summed over all particles [m]: the motion times the root of their number."""
        return self.motion * math.sqrt(self.reference.shape[2])

    def errors(self, test_functions: tuple[np.ndarray, ...]) -> np.ndarray:
        """Return error components over the motion (times, r + 1): along each basis vector of the modes, and orthogonal to them.

        Their Euclidean norm is the rms distance in deflection.
        """
        model = replace(self.model, raw_test_functions=test_functions)
        model.__dict__["spectral_basis"] = self.model.spectral_basis  # the same, and as costly as the run
        coordinates, change, left = self.projection
        scheme, step = self.scheme_and_step
        try:
            q = solve(model, CondensedRequest(times=self.times, scheme=scheme, step=step, outputs=())).state.q
        except (RunStopped, SceneError):
            return np.full((self.times.size, coordinates.shape[1] + 1), FAILED_ERROR)
        return np.column_stack([q @ change.T - coordinates, left]) / self.scale


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
    """Train test functions that minimise the error of the condensed model over trajectories.

    Parameters
    ----------
    scenes
        One or several scenes, each with both ends held.
    trajectories
        Result of :func:`cablepod.chain.simulate` for each scene, from 0 s on, on the particles of the modes.
    modes
        Result of :func:`cablepod.pod.decompose` with layout "normal".
    rank
        Number of modes of each deflection; all by default.  The test functions are valid for this number only.
    order, law, quadrature
        Options of the model, as in :func:`cablepod.condensed.simulate`.  The test functions are valid for this order and
        quadrature only, because they also compensate part of what an order neglects.
    tolerance
        Time error of the runs of the model, as a fraction of the motion.
    iterations
        Maximum number of iterations for each of two initial guesses and five parts of the runs.  An iteration runs every scene
        once for each coefficient; each mode has as many coefficients as there are modes, plus four.
    progress
        Callback receiving the completed fraction, 0 to 1.

    Returns
    -------
    xarray.Dataset
        The first `rank` modes with ``test_function (mode, particle)``, in space also ``test_function_out_of_plane``, which
        :func:`cablepod.condensed.simulate` uses.  Attributes: ``training_error`` (largest rms distance in deflection over time
        and scenes, over the motion), ``training_error_galerkin`` (the same with the modes as test functions),
        ``projection_error`` (the same for the projection onto the modes, a lower bound), ``trained_rank``, ``trained_order``,
        ``trained_quadrature`` (0 for the links).  ``training_range`` is that of these scenes.

    Raises
    ------
    SceneError
        For invalid options, and trajectories that do not match scenes and modes.
    RunStopped
        Where the model with the modes as test functions, the first initial guess, diverges.

    Notes
    -----
    The sum over scenes and instants of the fourth power of the rms distance is minimised by a Gauss-Newton method with trust
    region and finite differences.  The first eighth of each run is fitted first, then a quarter, and so on up to the whole run.
    Initial guesses are the modes (Galerkin) and vibration modes.  The candidate with the smallest error over the whole runs is
    returned, a local minimum; candidates with growing vibrations about rest are rejected.

    The gain holds near the training scenes; far from them trained test functions are worse than the modes.  The attributes
    ``outside_training``, ``growth_over_run`` and ``error_estimate`` of a run show it.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example3")
    >>> chain = cp.chain.simulate(scene, times=range(41))
    >>> modes = cp.pod.decompose(chain, layout="normal", rank=3)
    >>> trained = cp.oblique.train(scene, chain, modes, iterations=8)
    >>> trained.attrs["training_error"] < 0.3 * trained.attrs["training_error_galerkin"]
    True
    >>> later = cp.condensed.simulate(scene, trained)  # over all of its 124 s
    """
    scene_list, references = several("scenes", scenes, SCENE), several("trajectories", trajectories, TRAJECTORY)
    modes = taken("modes", modes, NORMAL_MODES)
    _check_inputs(scene_list, references, tolerance, iterations)
    galerkin_modes = modes
    if TEST in modes:
        trained = [f"{TEST}{suffix}" for suffix in pod_normal.SETS if f"{TEST}{suffix}" in modes]
        galerkin_modes = modes.drop_vars(trained)
    options = {"rank": rank, "order": order, "law": law, "quadrature": quadrature}
    cases = [
        _training_case(i, scene, reference, galerkin_modes, options, tolerance)
        for i, (scene, reference) in enumerate(zip(scene_list, references, strict=True))
    ]
    test_functions, galerkin_error, trained_error = _optimise(cases, iterations, progress)
    result = _labelled(galerkin_modes, cases[0].model.rank, test_functions, references)
    result.attrs |= {
        "title": f"{modes.attrs.get('title', 'modes')}, with trained test functions",
        "trained_rank": cases[0].model.rank,
        "trained_order": order,
        "trained_quadrature": quadrature or 0,
        "trained_second_order": int(cases[0].model.reference_state is not None),
        "training_error": trained_error,
        "training_error_galerkin": galerkin_error,
        "projection_error": max(float((case.projection[2] / case.scale).max()) for case in cases),
    }
    if progress is not None:
        progress(1.0)
    return provenance.record(
        result,
        function="oblique.train",
        parameters={**options, "rank": cases[0].model.rank, "tolerance": tolerance, "iterations": iterations},
        inputs=[*scene_list, *references, modes],
        chosen=provenance.defaulted_options(rank=rank),
    )


def _check_inputs(scenes: list[Any], references: list[Any], tolerance: float, iterations: int) -> None:
    """Refuse options and numbers of scenes and trajectories that do not match."""
    if not scenes or len(scenes) != len(references):
        raise scene_error("trajectories", len(references), f"one for each of the {len(scenes)} scenes, at least one")
    check_positive("tolerance", tolerance)
    integer(least=1)("iterations", iterations)


def _labelled(
    modes: xr.Dataset, rank: int, test_functions: tuple[np.ndarray, ...], references: list[xr.Dataset]
) -> xr.Dataset:
    """Return the first `rank` modes with labelled test functions and the training range of the references."""
    result = modes.isel(mode=slice(0, rank))
    if rank < modes.sizes["mode"]:  # truncation errors are those of all modes
        result = result.drop_vars([name for name in result.data_vars if str(name).startswith("truncation_error")])
    for suffix, part in zip(pod_normal.SETS, test_functions, strict=False):
        result[f"{TEST}{suffix}"] = (("mode", "particle"), np.pad(part, ((0, rank - len(part)), (0, 0))))
    training_range: np.ndarray | None = None
    for reference in references:
        training_range = union_of_ranges(training_range, range_of(reference))
    add_training_range(result, training_range)  # that of the test functions replaces that of the modes
    own = [str(name) for name, variable in result.variables.items() if "units" not in variable.attrs]
    label(result, **{name: ("1", name) for name in own if name not in VARIABLES})  # added to the modes by the caller
    return result


def _training_case(
    number: int, scene: xr.Dataset, run: xr.Dataset, modes: xr.Dataset, options: dict[str, Any], tolerance: float
) -> TrainingCase:
    """Check one scene with its trajectory, and prepare its training case."""
    if "member" in scene.dims:
        raise scene_error("scenes", f"members of scene {number}", "single scenes, isel(member=...)")
    p = parameters(scene)
    check_no_wind(p, "condensed.simulate with modes that have no trained test functions")
    model = model_of(p, modes, **options)
    sigma, run_sigma = relative_arc_length(modes), relative_arc_length(run)
    if sigma.shape != run_sigma.shape or np.abs(sigma - run_sigma).max() > SIGMA_ATOL:
        raise scene_error(
            "trajectories",
            f"{run_sigma.size} particles in number {number}",
            f"the {sigma.size} particles of the modes, at the same S / L0",
        )
    position, times = positions(run), check_times(run["time"].values)
    if len(position) != times.size:
        raise scene_error(
            "trajectories", f"{len(position)} shapes in number {number}", f"one for each of its {times.size} instants"
        )
    ends = p.end_positions(times)
    chord = float(np.linalg.norm(ends[0, 1] - ends[0, 0]))
    distance = float(np.abs(position[:, (0, -1)] - ends).max())
    if distance > END_RTOL * chord:
        raise scene_error(
            "trajectories",
            f"ends {distance:.3g} m off those of scene {number}",
            "the trajectory of each scene, in their order",
        )
    motion = motion_scale(position, position[0], chord)
    return TrainingCase(model, times, pod_normal.deflections(position, model.reference), motion, tolerance)


def _optimise(
    cases: list[TrainingCase], iterations: int, progress: Callable[[float], None] | None
) -> tuple[tuple[np.ndarray, ...], float, float]:
    """Return the best test functions found, and the largest errors with the modes and with them."""
    bases = [basis for basis in test_function_bases(cases[0].model) if basis.count]
    done, total = 0.0, sum(WINDOWS) * sum(iterations * (basis.count + 1) for basis in bases)

    def report(fraction: float) -> None:
        nonlocal done
        done += fraction
        if progress is not None:
            progress(min(done / total, 1.0))

    def largest_error(test_functions: tuple[np.ndarray, ...]) -> float:
        return max(float(np.linalg.norm(case.errors(test_functions), axis=1).max()) for case in cases)

    for case in cases:
        _ = case.scheme_and_step  # raises here where the model diverges with its own modes
    best = cases[0].model.modes
    galerkin_error = least_error = largest_error(best)
    for basis in bases:
        x = np.zeros(basis.count)
        for fraction in WINDOWS:
            parts = [case.first_part(fraction) for case in cases]
            x = _fit(basis, x, parts, iterations, functools.partial(report, fraction))
            candidate = basis.test_functions(x)
            error = largest_error(candidate)
            if error < least_error and not any(case.grows(candidate) for case in cases):
                best, least_error = candidate, error
    return best, galerkin_error, least_error


def _fit(
    basis: TestFunctionBasis, x: np.ndarray, cases: list[TrainingCase], iterations: int, report: Callable[[], None]
) -> np.ndarray:
    """Minimise the sum of fourth powers of the distances, starting at `x`; report progress after each run of all cases."""
    from scipy.optimize import least_squares  # costly to import

    initial = basis.test_functions(x)
    # relative to the initial error, so that the tolerances of the search are relative too
    scale = max(float(np.linalg.norm(case.errors(initial), axis=1).max()) for case in cases) or 1.0

    def residuals(x: np.ndarray) -> np.ndarray:
        """Return residuals whose sum of squares is the sum of fourth powers of the distances."""
        test_functions = basis.test_functions(x)
        errors = [case.errors(test_functions) / scale for case in cases]
        report()
        return np.concatenate([(error * np.linalg.norm(error, axis=1)[:, None]).ravel() for error in errors])

    def jacobian(x: np.ndarray) -> np.ndarray:
        """Return forward differences of the residuals, with runs in threads."""
        base = residuals(x)
        columns = map_threads(
            lambda unit: (residuals(x + INCREMENT * unit) - base) / INCREMENT, np.eye(x.size), cores()
        )
        return np.stack(columns, axis=1)

    return np.asarray(least_squares(residuals, x, jac=jacobian, max_nfev=iterations, **STOP).x)
