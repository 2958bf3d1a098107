"""A-posteriori error estimate of the Galerkin model from the residual of an enriched model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from cablepod.condensed._error_equation import ErrorEquation
from cablepod.condensed._estimate import MAX_ERROR, motion_or_missed, sample_interval
from cablepod.condensed._fields import close_chord_of, positions_of
from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.errors import SceneError
from cablepod.galerkin._assembly import KEPT_MODELS
from cablepod.galerkin._model import GalerkinModel
from cablepod.galerkin._record import GalerkinTrajectory, Samples

#: Relative tolerance of deflections: combinations of modes below it move the cable along the chord only.
DEFLECTION_RTOL = 1e-6
#: Interval of the residual samples times the angular frequency of the first truncated mode: at 1.8 the estimate of Example 3 is
#: six times as large.
SAMPLING_PHASE = 1.2
#: Points along the cable for the residual: POINTS plus POINTS_PER_MODE for each deflection, at most the links.  With half as many
#: the estimate of taut cables under steep modes is five times as large.
POINTS, POINTS_PER_MODE = 4, 4
#: Maximum number of instants at which the distance along the chord is computed (it follows the ends and the deflection slowly).
CHORDWISE_SAMPLES = 64


@dataclass(frozen=True, eq=False)
class GalerkinEstimate:
    """Estimate of the error that the modes and the law leave, as a fraction of the motion.

    The deflection of the particles normal to the chord is a motion of a condensed model of the same links, whose modes are the
    deflections of the mean shape and of all modes.  Its residual in an enriched model, with more modes, the chordwise stretch
    that closes the chord, and chordwise inertia, drives the error equation, see
    :class:`cablepod.condensed._error_equation.ErrorEquation`.  The distance of the particles from their chordwise positions is
    added.  The enriched model has the law of the chain that the run is meant to reproduce: a motion by law (21) has the
    difference of the laws in its residual.
    The time error of the step is not included.
    """

    model: GalerkinModel
    end_time: float  #: of the runs [s]
    law: str = "linear"  #: of the enriched model

    @cached_property
    def condensed(self) -> CondensedModel:
        """Condensed model on the deflections of the mean shape and of all modes."""
        chain, dims = self.model.chain, self.model.chain.p.dims
        deflections = _deflections(self.model.mean.tobytes(), self.model.modes.tobytes(), dims)
        links = LumpedChain(chain.p, chain.length, chain.arc_length, self.law)
        return CondensedModel(links, "inertial", (deflections,) * (dims - 1))

    @cached_property
    def equation(self) -> ErrorEquation:
        """Error equation of the deflection."""
        condensed = self.condensed
        points = POINTS + POINTS_PER_MODE * len(condensed.modes[0])
        return ErrorEquation.of(
            condensed.chain, condensed.modes, condensed.shapes, condensed.n_in_plane, leading=False, points=points
        )

    @cached_property
    def omega_squared(self) -> float:
        """Squared angular frequency that samples resolve [1/s^2].

        That of the last mode, as a sine of a taut string, and at least that of the slowest vibration of the model, which is fast
        where its modes lock.
        """
        p, length = self.model.chain.p, self.model.chain.total_length
        ends = p.end_positions(np.linspace(0.0, self.end_time, 1001))
        chord = math.sqrt(square(ends[:, 1] - ends[:, 0]).max())
        tension = max(p.stiffness * (chord / length - 1.0), self.condensed.rest_tension, 1e-12 * p.stiffness)
        string = tension / p.mass * (math.pi * self.model.modes_per_coordinate / length) ** 2
        return max(string, float(self.model.initial_vibrations[0][0]))

    def sample_interval(self, steps_per_second: float) -> int:
        """Return the number of steps between two samples of a run; 0 if there is nothing to sample."""
        if self.end_time == 0.0:
            return 0
        try:
            modes = self.model.modes_per_coordinate
            return sample_interval(self.omega_squared, modes, steps_per_second, self.end_time, SAMPLING_PHASE)
        except SceneError:
            return 0

    def error(self, trajectory: GalerkinTrajectory) -> float:
        """Estimate the largest error over time as a fraction of the motion, from a trajectory with samples.

        Returns
        -------
        float
            At most 2, an error larger than the motion.  nan if no estimate exists: the cable runs back along its chord, or the
            chord turns so far that in-plane and out-of-plane deflections mix.
        """
        samples = trajectory.samples
        if self.end_time == 0.0:
            return 0.0
        if samples is None:
            return math.nan
        condensed, count, rate = self.condensed, samples.count, samples.per_second
        try:
            frame = self._chord_frame(samples)
            boundary_data = condensed.boundary_data(0, count - 1, rate)
            motion = self._deflection(samples, frame)
            chosen = np.linspace(0, count - 1, min(CHORDWISE_SAMPLES, count)).astype(int)
            chordwise = self._chordwise(samples, motion[0], frame, boundary_data, chosen)
        except SceneError:
            return math.nan
        if not np.isfinite(chordwise).all():
            return math.nan
        equation, q = self.equation, motion[0][0]
        if condensed.chain.p.initial:
            initial_error = equation.coordinates(condensed.start_deflection()[:, 0]) - equation.change @ q
        else:
            initial_error = self._error_at_rest
        start_rates, initial_rate = condensed.start_deflection_rates, np.zeros_like(initial_error)
        if start_rates is not None:
            initial_rate = equation.coordinates(start_rates) - equation.change @ motion[1][0]
        squares = equation.mean_squares(motion, boundary_data, 1.0 / rate, initial_error, initial_rate)
        largest = max(float(squares.max()), float((squares[chosen] + chordwise).max()))
        p = self.model.chain.p
        scale = motion_or_missed(samples.motion, float(np.linalg.norm(p.upper - p.lower)), squares)
        return min(math.sqrt(largest) / scale, MAX_ERROR)

    @cached_property
    def _error_at_rest(self) -> np.ndarray:
        """Distance from the start of the model to the equilibrium of the enriched one, in the coordinates of that (R,)."""
        model, ends = self.model, self.model.initial_displacements
        states = np.zeros((3, 1, len(model.fields_of_projections)))
        states[0, 0] = np.concatenate([model.initial + ends @ model.coupling, ends])
        start = Samples(model, states, 1.0)
        q = self._deflection(start, self._chord_frame(start))[0][0]
        return self.equation.error_at_rest(q, self.condensed.static_boundary_data)

    @cached_property
    def _projection(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of the deflection by each axis: of the mean shape (dims, r), and of each sampled coordinate as well.

        The shape of the latter is (coordinates, dims, r).
        """
        condensed, model = self.condensed, self.model
        weighted = (condensed.shapes * condensed.mass).T
        # the line between the ends has no deflection
        fields = np.concatenate([model.fields, -np.tensordot(model.coupling, model.fields, axes=1)])
        return model.mean.T @ weighted, fields.swapaxes(1, 2) @ weighted

    def _chord_frame(self, samples: Samples) -> ChordFrame:
        """Chord frame of the ends at the samples."""
        p, lifts = self.model.chain.p, self.model.lifts
        displacements = samples.states[0, :, len(self.model.modes) :]
        return ChordFrame.of(p.upper - p.lower + displacements @ (lifts[:, -1] - lifts[:, 0]), self.condensed.reference)

    def _deflection(self, samples: Samples, frame: ChordFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates of the deflection (times, r), and their first and second time derivatives.

        The derivatives are relative to the line between the ends, which the enriched model adds.
        """
        mean, fields = self._projection
        by_axis = samples.states.reshape(-1, len(fields)) @ fields.reshape(len(fields), -1)
        by_axis = by_axis.reshape(3, samples.count, *mean.shape)
        by_axis[0] += mean
        # the normal of each coordinate (times, r, dims); a product of matrices of two or three axes takes longer
        normals = frame.normals[:, (np.arange(mean.shape[1]) >= self.condensed.n_in_plane).astype(int)]
        q, rates, accelerations = sum(by_axis[:, :, axis] * normals[:, :, axis] for axis in range(len(mean)))
        return q, rates, accelerations

    def _chordwise(
        self,
        samples: Samples,
        coordinates: np.ndarray,
        frame: ChordFrame,
        boundary_data: np.ndarray,
        chosen: np.ndarray,
    ) -> np.ndarray:
        """Mean square distance of the particles from their positions in the condensed model, at some samples [m^2].

        It is infinite where they run back along the chord.
        """
        model, states = self.model, samples.states[0, chosen]
        position = (states @ model.fields_of_projections.reshape(states.shape[1], -1)).reshape(-1, *model.shape.shape)
        position += model.shape
        stretch, _, _, deflection = close_chord_of(self.condensed, coordinates[chosen], boundary_data[chosen])
        closed = positions_of(self.condensed, stretch, deflection, np.ascontiguousarray(position[:, [0, -1]]))
        advances = np.einsum("tpc,tc->tp", np.diff(position, axis=1), frame.along[chosen])
        return np.where((advances > 0.0).all(axis=1), square(closed - position).mean(axis=1), math.inf)


@lru_cache(maxsize=KEPT_MODELS)
def estimate_of(model: GalerkinModel, end_time: float, law: str) -> GalerkinEstimate:
    """Return the estimate of a model against a chain of this law, kept with its equation, for runs until `end_time` [s]."""
    return GalerkinEstimate(model, end_time, law)


@lru_cache(maxsize=64)
def _deflections(mean: bytes, modes: bytes, dims: int) -> np.ndarray:
    """Return orthonormal deflections (mode, particle) that contain those of the mean shape and of all modes along any normal.

    Kept by content, as the coefficients of the enriched model are kept by the content of these.
    """
    shape = np.frombuffer(mean).reshape(-1, dims)
    fields = np.concatenate([shape[None], np.frombuffer(modes).reshape(-1, *shape.shape)])
    fields[:, [0, -1]] = 0.0
    deflection = np.moveaxis(fields, 2, 0).reshape(-1, len(shape))
    norm = np.sqrt(np.sum(deflection**2, axis=1))
    deflected = norm > DEFLECTION_RTOL * norm.max()
    if not deflected.any():
        return np.zeros((0, len(shape)))
    _, values, rows = np.linalg.svd(deflection[deflected] / norm[deflected, None], full_matrices=False)
    return rows[values > DEFLECTION_RTOL * values[0]]
