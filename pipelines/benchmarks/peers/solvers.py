"""Run one chain on other packages, each with its best settings and imported on demand.

A case assembles its model (outside the stepping), steps, and returns the positions at the given instants.  Settings that were
tried, on Example 2:

- CVODE: order 1, 2, 3 and 5 (above 2 its steps stay within the stability of the fastest axial modes and it takes minutes),
  relative and absolute tolerances and their ratio, Adams (order 2 is the trapezoidal rule) and BDF, band solver of SUNDIALS and
  of LAPACK, Jacobian given (twice as fast and more) and by differences.
- SciPy: Radau with sparse and full Jacobian; LSODA through odeint and VODE through ode with the order limited to 2 and a banded
  Jacobian (solve_ivp's LSODA cannot limit its order and takes more than 25 s); DOP853, which stability limits.
- Exudyn: its module without range checks, no files, a ground that is moved once a step instead of a constraint, full and
  modified Newton (half the time), sparse and full matrices, spectral radius, tolerances as loose as the error allows (with the
  default ones Newton's method stagnates at rounding).  Its springs resist compression too: in these examples no link is slack.
- MoorDyn: no water, no output; positions are put into its saved state, because it starts from its own catenary.  Of its schemes
  only RK4 stays finite at steps near the stability limit; its ends move at constant velocity over a call, hence 0.02 s a call.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.metadata
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from _moordyn import Line, moordyn_of, nodes_of
from numba import njit

from benchmarks.peers.system import ABOVE, BELOW, System, jacobian_of, rates_of

#: Package -> name of its distribution
DISTRIBUTIONS = {"scikit-sundae": "scikit-sundae", "SciPy": "scipy", "Exudyn": "exudyn", "MoorDyn": "moordyn"}


@dataclass(frozen=True)
class Case:
    """A package with a setting.

    `prepare` takes system and instants and returns a function without arguments that steps and returns the positions
    (time, n + 1, 2) [m] of all particles and the stepping time [s].
    """

    package: str
    method: str
    setting: str
    prepare: Callable[[System, np.ndarray], Callable[[], tuple[np.ndarray, float]]]
    slow: bool = False


def versions() -> dict[str, str | None]:
    """Return the version of each package, None if it is not installed."""
    found: dict[str, str | None] = {}
    for package, distribution in DISTRIBUTIONS.items():
        try:
            found[package] = importlib.metadata.version(distribution)
        except importlib.metadata.PackageNotFoundError:
            found[package] = None
    return found


def cases() -> list[Case]:
    """Return all settings of all packages, installed or not."""
    result = []
    for order2, tolerances in (("Adams", (1e-3, 1e-4, 5e-5, 1e-5, 1e-6)), ("BDF", (1e-5, 1e-6, 1e-7, 1e-8))):
        result += [
            Case("scikit-sundae", f"CVODE {order2}, order 2", f"rtol {r:g}", cvode(order2, rtol=r, atol=1e-2 * r))
            for r in tolerances
        ]
    for a in (1e-5, 1e-6):  # larger tolerance for velocities: fast axial waves
        absolute = {"rtol": 1e-15, "atol": np.array([100.0 * a, 100.0 * a, a, a])}
        result.append(Case("scikit-sundae", "CVODE BDF, order 2", f"atol {a:g} m", cvode("BDF", **absolute)))
    result += [Case("SciPy", "Radau", f"rtol {r:g}", radau(rtol=r, atol=1e-2 * r)) for r in (1e-3, 1e-4, 1e-5, 1e-6)]
    result += [
        Case("SciPy", "LSODA, order 2", f"rtol {r:g}", lsoda(rtol=r, atol=1e-2 * r), slow=r < 1e-6)
        for r in (1e-6, 1e-7)
    ]
    result += [Case("SciPy", "VODE Adams, order 2", f"rtol {r:g}", vode("adams", r)) for r in (1e-3, 1e-4, 5e-5, 1e-5)]
    result += [Case("SciPy", "VODE BDF, order 2", f"rtol {r:g}", vode("bdf", r)) for r in (1e-5, 1e-7)]
    result.append(Case("SciPy", "DOP853", "rtol 1e-06", dop853(rtol=1e-6, atol=1e-8), slow=True))
    result += [
        Case("Exudyn", "trapezoidal", f"{h:g} s", exudyn(h), slow=h < 0.002) for h in (1.0, 0.1, 0.01, 0.002, 0.001)
    ]
    result.append(Case("Exudyn", "velocity Verlet", "3.2e-4 s", exudyn(3.2e-4, explicit=True), slow=True))
    result += [
        Case("MoorDyn", "RK4", f"{h:g} s", moordyn(h, call), slow=h < 4e-4) for h, call in ((4e-4, 0.02), (2e-4, 0.005))
    ]
    return result


# --- general solvers --------------------------------------------------------------------------------------------------


@functools.cache
def compiled(system: System) -> tuple[Callable[..., None], Callable[..., None], Callable[..., Any], Callable[..., Any]]:
    """Compile right side and Jacobian once for a system, for CVODE and SciPy."""
    rates, jacobian = rates_of(system), jacobian_of(system)
    size = 4 * system.particles

    @njit(error_model="numpy")
    def fill(time, state, rates, out):
        jacobian(time, state, out, False)

    @njit(error_model="numpy")
    def right(time, state):
        out = np.empty(size)
        rates(time, state, out)
        return out

    @njit(error_model="numpy")
    def band(time, state):
        out = np.empty((ABOVE + 1 + BELOW, size))
        jacobian(time, state, out, True)
        return out

    return rates, fill, right, band


def cvode(method: str, *, rtol: float, atol: float | np.ndarray) -> Callable[..., Any]:
    """Prepare CVODE of SUNDIALS through scikit-sundae, order at most 2.

    An array `atol` (4,) is that of one particle.
    """

    def prepare(system: System, times: np.ndarray) -> Callable[[], tuple[np.ndarray, float]]:
        from sksundae.cvode import CVODE

        rates, fill, _, _ = compiled(system)
        solver = CVODE(
            rates, method=method, linsolver="band", lband=BELOW, uband=ABOVE, jacfn=fill, max_order=2,
            max_num_steps=10**7, rtol=rtol, atol=atol if np.isscalar(atol) else np.tile(atol, system.particles),
        )  # fmt: skip

        def step() -> tuple[np.ndarray, float]:
            begin = time.perf_counter()
            solution = solver.solve(times, np.zeros(4 * system.particles))
            spent = time.perf_counter() - begin
            if len(solution.t) != len(times):
                raise RuntimeError(f"CVODE stopped: {solution.message}")
            return system.positions(np.ascontiguousarray(solution.y), times), spent

        return step

    return prepare


def _scipy(solve: Callable[..., np.ndarray]) -> Callable[..., Any]:
    """Wrap ``solve(right, band, y0, times) -> states (time, unknown)``."""

    def prepare(system: System, times: np.ndarray) -> Callable[[], tuple[np.ndarray, float]]:
        _, _, right, band = compiled(system)

        def step() -> tuple[np.ndarray, float]:
            begin = time.perf_counter()
            states = solve(right, band, np.zeros(4 * system.particles), times)
            spent = time.perf_counter() - begin
            if len(states) != len(times):
                raise RuntimeError("SciPy's solver stopped")
            return system.positions(np.ascontiguousarray(states), times), spent

        return step

    return prepare


def radau(**tolerances: float) -> Callable[..., Any]:
    """Prepare SciPy's Radau IIA of fifth order with a sparse Jacobian."""

    def solve(right, band, first, times):
        from scipy.integrate import solve_ivp
        from scipy.sparse import csc_matrix

        size = first.size
        row, column = np.indices((size, size))
        pattern = csc_matrix((row - column <= BELOW) & (column - row <= ABOVE))
        columns = np.repeat(np.arange(size), np.diff(pattern.indptr))
        place = (pattern.indices - columns + ABOVE, columns)

        def sparse(time, state):
            return csc_matrix((band(time, state)[place], pattern.indices, pattern.indptr), shape=(size, size))

        span = (times[0], times[-1])
        return solve_ivp(right, span, first, method="Radau", t_eval=times, jac=sparse, **tolerances).y.T

    return _scipy(solve)


def dop853(**tolerances: float) -> Callable[..., Any]:
    """Prepare SciPy's explicit Runge-Kutta method of eighth order."""

    def solve(right, band, first, times):
        from scipy.integrate import solve_ivp

        return solve_ivp(right, (times[0], times[-1]), first, method="DOP853", t_eval=times, **tolerances).y.T

    return _scipy(solve)


def lsoda(**tolerances: float) -> Callable[..., Any]:
    """Prepare LSODA by SciPy's odeint, for its limit of the order."""

    def solve(right, band, first, times):
        from scipy.integrate import odeint

        return odeint(
            right, first, times, Dfun=band, ml=BELOW, mu=ABOVE, tfirst=True, mxords=2, mxstep=10**8, **tolerances
        )

    return _scipy(solve)


def vode(method: str, rtol: float) -> Callable[..., Any]:
    """Prepare VODE by SciPy's ode, order at most 2, with a banded Jacobian."""

    def solve(right, band, first, times):
        from scipy.integrate import ode

        solver = ode(right, band).set_integrator(
            "vode", method=method, order=2, with_jacobian=True, lband=BELOW, uband=ABOVE, nsteps=10**8,
            rtol=rtol, atol=1e-2 * rtol,
        )  # fmt: skip
        solver.set_initial_value(first, times[0])
        return np.array([first, *(solver.integrate(instant) for instant in times[1:])])

    return _scipy(solve)


# --- packages of mechanics --------------------------------------------------------------------------------------------


def exudyn(step_size: float, *, explicit: bool = False) -> Callable[..., Any]:
    """Prepare Exudyn: mass points and springs.

    Generalized alpha with spectral radius 1 is the trapezoidal rule.
    """

    def prepare(system: System, times: np.ndarray) -> Callable[[], tuple[np.ndarray, float]]:
        sys.exudynFast = True  # its module without range checks, where available
        import exudyn as exu

        mbs, sensors, container = _exudyn_model(exu, system)
        settings = exu.SimulationSettings()
        integration = settings.timeIntegration
        integration.endTime = times[-1]
        integration.numberOfSteps = round(times[-1] / step_size)
        integration.verboseMode = 0
        integration.newton.useModifiedNewton = True
        integration.newton.relativeTolerance = integration.newton.absoluteTolerance = 1e-4
        integration.generalizedAlpha.spectralRadius = 1.0
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = times[1] - times[0]
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        settings.parallel.numberOfThreads = 1
        kinds = exu.DynamicSolverType
        kind = kinds.VelocityVerlet if explicit else kinds.GeneralizedAlpha

        def step() -> tuple[np.ndarray, float]:
            assert container is not None  # it must outlive its system
            begin = time.perf_counter()
            mbs.SolveDynamic(settings, solverType=kind)
            spent = time.perf_counter() - begin
            states = np.zeros((len(times), system.particles, 4))
            for j, sensor in enumerate(sensors):
                states[:, j, 2:] = mbs.GetSensorStoredData(sensor)[: len(times), 1:3] - system.start[j + 1]
            return system.positions(states.reshape(len(times), -1), times), spent

        return step

    return prepare


def _exudyn_model(exu: Any, system: System) -> tuple[Any, list[Any], Any]:
    """Assemble the chain; return system, sensors of the free particles, and the container."""
    import exudyn.itemInterface as item

    container = exu.SystemContainer()
    mbs = container.AddSystem()
    ends = [mbs.AddObject(item.ObjectGround(referencePosition=[*end, 0.0])) for end in system.start[[0, -1]]]
    markers = [mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=ends[0]))]
    sensors = []
    for place, mass, load in zip(system.start[1:-1], system.mass, system.load, strict=True):
        node = mbs.AddNode(item.NodePoint2D(referenceCoordinates=list(place)))
        mbs.AddObject(item.MassPoint2D(mass=mass, nodeNumber=node))
        markers.append(mbs.AddMarker(item.MarkerNodePosition(nodeNumber=node)))
        mbs.AddLoad(item.Force(markerNumber=markers[-1], loadVector=[*load, 0.0]))
        kind = exu.OutputVariableType.Position
        sensors.append(mbs.AddSensor(item.SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=kind)))
    markers.append(mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=ends[1])))
    for j, (k, length) in enumerate(zip(system.chain.k, system.chain.length, strict=True)):
        mbs.AddObject(
            item.ObjectConnectorSpringDamper(
                markerNumbers=markers[j : j + 2], referenceLength=length, stiffness=k, damping=0.0
            )
        )
    x, y = (float(value) for value in system.start[-1])

    def move(mbs: Any, instant: float) -> bool:
        mbs.SetObjectParameter(ends[1], "referencePosition", [x + system.upper(instant), y, 0.0])
        return True

    mbs.SetPreStepUserFunction(move)
    mbs.Assemble()
    return mbs, sensors, container


def moordyn(step_size: float, call: float) -> Callable[..., Any]:
    """Prepare MoorDyn, RK4 with a step [s].

    Its coupled end has constant velocity over a call of `call` [s].
    """

    def prepare(system: System, times: np.ndarray) -> Callable[[], tuple[np.ndarray, float]]:
        import moordyn as md

        model, line = _moordyn_model(system, step_size)
        y = float(system.start[-1, 1])
        grid = np.arange(round(times[-1] / call) + 1) * call
        x = system.start[-1, 0] + system.amplitude * (1.0 - np.cos(system.omega * grid))
        velocity = np.diff(x) / call
        save = set(np.rint(times / call).astype(int).tolist())

        def step() -> tuple[np.ndarray, float]:
            positions = [system.start]
            begin = time.perf_counter()
            for i in range(len(velocity)):
                md.Step(model, [x[i], 0.0, y], [velocity[i], 0.0, 0.0], grid[i], call)
                if i + 1 in save:
                    positions.append(nodes_of(line, len(system.start))[:, [0, 2]])
            spent = time.perf_counter() - begin
            md.Close(model)
            result = np.array(positions)
            result[:, -1, 0] = x[np.rint(times / call).astype(int)]
            return result, spent

        return step

    return prepare


def _moordyn_model(system: System, step_size: float) -> tuple[Any, Any]:
    """Load the chain at its start; return system and line."""
    p, (x, y) = system.chain.p, system.start.T
    line = Line(np.stack([x, 0.0 * x, y], axis=1), p.mass, p.stiffness, system.chain.total_length, (1, 2))
    model, (own,) = moordyn_of([line], [("Fixed", 0.0), ("Coupled", 0.0)], step_size, -float(p.weight[1]) / p.mass)
    return model, own


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Discard standard output and standard error, of compiled libraries too."""
    sys.stdout.flush()
    sys.stderr.flush()
    with open(os.devnull, "w") as sink, contextlib.ExitStack() as stack:
        for number in (1, 2):
            kept = os.dup(number)
            stack.callback(os.close, kept)
            stack.callback(os.dup2, kept, number)
            os.dup2(sink.fileno(), number)
        yield
