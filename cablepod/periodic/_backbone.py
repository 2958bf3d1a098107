"""Public function: free vibrations over their amplitude."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod._inputs import NORMAL_MODES, SCENE, taken
from cablepod.conventions import INTERRUPTED
from cablepod.errors import RunStopped, scene_error
from cablepod.parameters._checks import choice, integer, number
from cablepod.parameters._from_scene import Members
from cablepod.periodic import _fields as fields
from cablepod.periodic import _output as output
from cablepod.periodic._continuation import AMPLITUDE, SLACK, adapted, zero_between
from cablepod.periodic._forcing import Forcing, refuse_wind, unforced
from cablepod.periodic._members import one_member, rising
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._solve import MIN_HARMONICS, Solver, State

#: Kinds of free vibrations.
MOTIONS = ("planar", "whirling")
#: First amplitude without dimension, its growth from point to point, and its largest change.
FIRST_AMPLITUDE, GROWTH, LARGEST_CHANGE = 0.02, 1.25, 0.1
#: Amplitudes without dimension from which the coefficient of amplitude squared is extrapolated.
SMALL = (0.02, 0.04)
#: Largest number of points.
MAX_POINTS = 5000
#: Tolerance of a place between two points of a branch: of the amplitude, and where whirling leaves.
ZERO_RTOL = 1e-15
#: Relative difference of frequencies in the plane and out of it below which whirling begins at rest.
DEGENERATE = 1e-9


def backbone(
    scene: xr.Dataset,
    modes: xr.Dataset,
    *,
    mode: int = 1,
    amplitude: float,
    rank: int | None = None,
    motion: str = "planar",
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Compute frequencies of free vibrations over their amplitude, without damping and forcing.

    Parameters
    ----------
    scene, modes
        As in :func:`orbit`; motions and factors of loads are those of time 0, damping is left out.
    mode
        Number of the vibration about rest in the plane, by rising frequency, from which the branch starts.
    amplitude
        Largest deflection from its mean over a period up to which the branch is followed [m], at most the length of the cable.
    rank
        Number of modes of each deflection; all by default.
    motion
        "planar", or "whirling": the motion out of the plane a quarter of a period behind that in it.  It leaves the planar branch
        at ``branch_off`` points; where both frequencies agree at rest it starts there, as a circle.
    progress
        Callback receiving the completed fraction, which never falls and ends at 1.

    Returns
    -------
    xarray.Dataset
        ``angular_frequency (point)`` [rad/s], ``amplitude (point)`` [m], the largest deflection from its mean over a period,
        ``amplitude_of_mode (point, mode)`` [m], ``smallest_chordwise_force (point)`` [N].  Attributes: ``mode``, ``motion``,
        ``hardening`` [rad^2/s^2/m^2], the coefficient of amplitude squared in the squared frequency at small amplitude;
        ``ended``: "amplitude", "slack", "points", "diverged" or, in what Ctrl-C left, "interrupted"; ``branch_off_amplitude``
        [m] and ``branch_off_angular_frequency`` [rad/s], where whirling leaves the planar branch (nan where it does not).

    Raises
    ------
    SceneError
        For a scene, modes or options that it does not support; the key is named.
    RunStopped
        If no vibration is found at small amplitude, and on Ctrl-C; `partial` has what was traced.

    Notes
    -----
    Free vibrations of the conservative model are symmetric in time: cosines in the plane, sines out of it.
    """
    scene, modes = taken("scene", scene, SCENE), taken("modes", modes, NORMAL_MODES)
    choice(*MOTIONS)("motion", motion)
    integer(least=1)("mode", mode)
    number(above=0.0)("amplitude", amplitude)

    one_member(scene, "backbone")
    p = Members(scene)[0]
    refuse_wind(p)
    forcing = Forcing(unforced(p), 1.0, 0.0, "m")
    model = PeriodicModel.of(forcing, modes, rank=rank, order="leading", out_of_plane=True)
    length = float(model.condensed.chain.total_length)
    if amplitude > length:
        raise scene_error("amplitude", amplitude, f"at most the length of the cable, {length:.6g} m")
    if mode > model.n_in_plane:
        raise scene_error("mode", mode, f"at most {model.n_in_plane}, the number of modes in the plane")
    study = _Backbone(model, int(mode), float(amplitude), progress)
    result = study.result(motion)
    parameters = {"mode": int(mode), "amplitude": float(amplitude), "rank": rank, "motion": motion}
    kept = f"{result.sizes['point']} points" if study.interrupted else ""
    return output.record(result, "periodic.backbone", scene, modes, parameters, kept=kept)


class _Backbone:
    """Free vibrations of one scene."""

    def __init__(
        self, model: PeriodicModel, mode: int, amplitude: float, progress: Callable[[float], None] | None = None
    ) -> None:
        self.model, self.mode, self.amplitude = model, mode, amplitude
        self.progress, self.interrupted = rising(progress), False
        self.solver = Solver(model)
        n = model.n_in_plane
        values, self.vectors = np.linalg.eigh(model.tangent_at_rest[:n, :n])
        if values[mode - 1] <= 0.0:
            raise RunStopped(
                f"mode {mode} has no frequency at rest, where the cable is unstable; try static_modes=True in vibration_modes"
            )
        self.omega = float(np.sqrt(values[mode - 1])) / model.scales[0]
        outside, self.lateral = np.linalg.eigh(model.tangent_at_rest[n:, n:])
        self.gaps: np.ndarray = np.sqrt(np.abs(outside)) / model.scales[0] / self.omega - 1.0

    def active(self, state: State) -> np.ndarray:
        """Return the numbers of the unknowns of motion symmetric in time: cosines in the plane, sines out of it."""
        mask = np.zeros((1 + 2 * state.harmonics, state.size), dtype=bool)
        n = self.model.n_in_plane
        mask[0, :n], mask[1::2, :n] = True, True
        mask[2::2, n:] = True
        return np.append(np.flatnonzero(mask.ravel()), state.z.size - 1)

    def correct(self, state: State, direction: np.ndarray) -> tuple[State, np.ndarray, int]:
        """Do :func:`cablepod.periodic._continuation.adapted`, for motion symmetric in time; directions have all unknowns."""
        return adapted(self.solver, state, direction, self.active)

    def start(self, size: float, circular: bool) -> tuple[State, np.ndarray]:
        """Return a vibration of small size without dimension, and the direction of its amplitude."""
        model = self.model
        n = model.n_in_plane
        r = model.size if circular else n
        coefficients = np.zeros((1 + 2 * MIN_HARMONICS, r))
        coefficients[0, :n] = model.rest[:n] / model.scales[1]
        grown = np.zeros_like(coefficients)
        grown[1, :n] = self.vectors[:, self.mode - 1]
        if circular:
            grown[2, n:] = self.lateral[:, int(np.argmin(np.abs(self.gaps)))]
            grown /= np.sqrt(2.0)
        direction = np.append(grown.ravel(), 0.0)
        state = State(np.append((coefficients + size * grown).ravel(), self.omega), not circular, r)
        found, _, iterations = self.correct(state, direction)
        if iterations < 0:
            raise RunStopped("no free vibration at small amplitude, as Newton's method fails; try another mode or rank")
        return found, direction

    def trace(
        self,
        rows: list[tuple[State, float, float]],
        state: State,
        direction: np.ndarray,
        share: tuple[float, float] = (0.0, 1.0),
    ) -> str:
        """Follow the branch until its largest deflection reaches the amplitude; return why it ends.

        State, amplitude and smallest force of each point are appended to `rows`; `share` is the begin and the end of its part of
        the progress.
        """
        rows.append(self._row(state))
        step = FIRST_AMPLITUDE
        for _ in range(MAX_POINTS):
            found, tangent, iterations = self.correct(replace(state, z=state.z + step * direction), direction)
            before = replace(state, z=direction).resized(found.harmonics).z
            if iterations < 0 or before @ tangent < 0.95:
                step *= 0.5
                if step < 1e-8:
                    return "diverged"
                continue
            rows.append(self._row(found))
            if rows[-1][2] < 0.0:
                return SLACK
            if rows[-1][1] >= self.amplitude:
                last = self._zero_between(state, found, lambda state: self._deflection(state) - self.amplitude)
                if last is not None:
                    rows[-1] = self._row(last)
                return AMPLITUDE
            self.progress(share[0] + (share[1] - share[0]) * rows[-1][1] / self.amplitude)
            state, direction = found, tangent
            step = min(GROWTH * step, LARGEST_CHANGE * max(1.0, float(np.linalg.norm(found.coefficients[1:]))))
        return "points"

    def _zero_between(self, before: State, after: State, test: Callable[[State], float]) -> State | None:
        """Return the state between two of a branch where a test function changes its sign; None for none."""
        before = before.resized(after.harmonics)
        way = after.z - before.z
        direction = way / np.linalg.norm(way)

        def between(low: State, high: State, share: float) -> State | None:
            low = low.resized(high.harmonics)
            state, _, iterations = self.correct(low.towards(high, share), direction)
            return None if iterations < 0 else state

        found = zero_between((before, after), between, test, ZERO_RTOL)
        return None if found is None else found[1]

    def _deflection(self, state: State) -> float:
        """Return the largest deflection from its mean over a period [m]."""
        return fields.largest_deflection(self.model, fields.coordinates(self.model, state, 2 * fields.PHASES))

    def _row(self, state: State) -> tuple[State, float, float]:
        return state, self._deflection(state), self.solver.stability(state).smallest_force

    def hardening(self, circular: bool) -> float:
        """Return the coefficient of amplitude squared in the squared frequency [rad^2/s^2/m^2], at small amplitude."""
        slopes, squares = [], []
        for size in SMALL:
            state, largest, _ = self._row(self.start(size, circular)[0])
            squares.append(largest**2)
            slopes.append((state.omega**2 - self.omega**2) * self.model.scales[0] ** 2 / largest**2)
        return float((squares[1] * slopes[0] - squares[0] * slopes[1]) / (squares[1] - squares[0]))

    def branch_off(self, rows: list[tuple[State, float, float]]) -> tuple[State, np.ndarray] | None:
        """Return the first point at which whirling leaves the planar branch, and its direction; None for none."""
        n, model = self.model.n_in_plane, self.model
        if model.size == n:
            return None

        def block(state: State) -> tuple[np.ndarray, np.ndarray, State]:
            full = state.full(model)
            mask = np.zeros((1 + 2 * full.harmonics, full.size), dtype=bool)
            mask[2::2, n:] = True
            rows = np.flatnonzero(mask.ravel())
            return self.solver.jacobian(full)[np.ix_(rows, rows)], rows, full

        signs = [np.linalg.slogdet(block(state)[0])[0] for state, *_ in rows]
        change = [i for i in range(1, len(rows)) if signs[i] * signs[i - 1] < 0.0]
        if not change:
            return None
        before, after = rows[change[0] - 1][0], rows[change[0]][0]
        scale = np.linalg.slogdet(block(before.resized(after.harmonics))[0])[1]

        def determinant(state: State) -> float:
            sign, size = np.linalg.slogdet(block(state)[0])
            return float(sign * np.exp(size - scale))

        found = self._zero_between(before, after, determinant)
        if found is None:
            return None
        matrix, numbers, full = block(found)
        null = np.zeros(full.z.size)
        null[numbers] = np.linalg.svd(matrix)[2][-1]
        return full, null

    def result(self, motion: str) -> xr.Dataset:
        """Return the branch as a Dataset."""
        circular = motion == "whirling"
        degenerate = self.gaps.size > 0 and float(np.abs(self.gaps).min()) < DEGENERATE
        leaves = circular and not degenerate  # from the planar branch, which is traced first
        attrs: dict[str, Any] = {
            "mode": self.mode,
            "motion": motion,
            "hardening": self.hardening(circular and degenerate),
        }
        planar: list[tuple[State, float, float]] = []
        rows = [] if leaves else planar
        leaving, ended = None, INTERRUPTED
        try:
            start = self.start(FIRST_AMPLITUDE, circular and degenerate)
            size = self._deflection(start[0])
            if size >= self.amplitude:
                start = self.start(0.5 * FIRST_AMPLITUDE * self.amplitude / size, circular and degenerate)
            planar_ended = self.trace(planar, *start, (0.0, 0.5 if leaves else 1.0))
            ended = INTERRUPTED if leaves else planar_ended
            leaving = None if degenerate else self.branch_off(planar)
            if leaves and leaving is None:
                raise scene_error(
                    "motion", motion, f'"planar": whirling does not leave this branch below {self.amplitude:g} m'
                )
            if leaves and leaving is not None:
                ended = self.trace(rows, *leaving, (0.5, 1.0))
            self.progress(1.0)
        except KeyboardInterrupt:
            if not rows:
                raise  # nothing to keep
            self.interrupted = True
        attrs["branch_off_amplitude"] = 0.0 if degenerate else self._row(leaving[0])[1] if leaving else np.nan
        attrs["branch_off_angular_frequency"] = (
            self.omega if degenerate else leaving[0].omega if leaving else np.nan
        ) * self.model.scales[0]
        return self.labelled(rows, attrs | {"ended": ended})

    def labelled(self, rows: list[tuple[State, float, float]], attrs: dict[str, Any]) -> xr.Dataset:
        """Return points as a Dataset."""
        model = self.model
        ranges = []
        for state, *_ in rows:
            q = fields.coordinates(model, state, 2 * fields.PHASES)
            ranges.append([fields.half_range(part) for part in fields.mode_amplitudes(model, q)])
        parts = [np.array([entry[k] for entry in ranges]) for k in range(len(model.sets))]
        variables = {
            "angular_frequency": (("point",), np.array([state.omega for state, *_ in rows]) * model.scales[0]),
            "amplitude": (("point",), np.array([size for _, size, _ in rows])),
            "smallest_chordwise_force": (("point",), np.array([force for *_, force in rows])),
            **output.per_set(model, "amplitude_of_mode", ("point",), parts),
        }
        names = {
            "angular_frequency": ("rad s-1", "angular frequency of the free vibration"),
            "amplitude": ("m", "largest deflection normal to the chord, from its mean over a period"),
            "amplitude_of_mode": ("m", "half of the range of the amplitude of the mode over a period"),
            "amplitude_of_mode_out_of_plane": ("m", "the same, out of the plane"),
        }
        result = output.dataset(model, variables, {"point": np.arange(1, len(rows) + 1)}, **names)
        result.attrs.update(attrs)
        return result
