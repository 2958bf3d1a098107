"""Prepared model: steps of a host that moves the upper end, the state between them, and runs of the scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr

from cablepod.catenary._end_stiffness import static_stiffness
from cablepod.condensed import _kernels_layout as layout
from cablepod.condensed._fields import close_chord_of, link_tensions, positions_of
from cablepod.condensed._host import (
    air_of_host,
    end_of_wind,
    host_coefficients,
    initial_state,
    refusal,
    vector,
)
from cablepod.condensed._kernels_layout import MAX_OMEGA_SQUARED, MIN_FORCE, HostCoefficients
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._prepared_dataset import ROUNDING, check_coefficients, checked_state, dataset_of
from cablepod.condensed._prepared_run import OUTPUTS, PreparedRun, run
from cablepod.condensed._simulate import check_links
from cablepod.discretisation._step_limit import verlet_step_limit
from cablepod.errors import OutOfRangeWarning, RunStopped, SceneError, scene_error, warn
from cablepod.integrate._particle_air import OF_DRAG
from cablepod.integrate._request import check_outputs, check_positive, check_step
from cablepod.parameters._key_paths import motion_path


class PreparedModel:
    """Condensed model of one cable, ready to run or to be stepped by a host; :func:`cablepod.condensed.prepare` makes it.

    A host moves the upper end.  :meth:`step` takes its position and velocity at the end of a step and gives the force of the
    cable on it.  Hosts that iterate call :meth:`trial` as often as they like, and :meth:`accept` once.

    The force is without the inertia of :attr:`mass`, the part of the cable that moves with the end.  The host adds this mass to
    its own, or passes the acceleration of the end, which completes the force.
    """

    def __init__(
        self,
        scene: xr.Dataset,
        modes: xr.Dataset,
        model: CondensedModel,
        prepared_step: float,
        wind: xr.Dataset | None = None,
        *,
        step_is_chosen: bool = False,
        stored: HostCoefficients | None = None,
    ) -> None:
        from cablepod.condensed import _kernels_host  # numba is imported only to compute

        self._scene, self._modes, self._model = scene, modes, model
        #: Field of the wind in place of that of the scene; None without.
        self.wind = wind
        air = air_of_host(model, wind)
        self._end_of_wind = math.inf if air is None else end_of_wind(air)
        self._drag_limit = math.inf if air is None else air.step_limit
        #: Step of :meth:`run` [s].
        self.prepared_step = prepared_step
        #: Whether :func:`cablepod.condensed.prepare` chose it.
        self.step_is_chosen = step_is_chosen
        self._coefficients = host_coefficients(model, air)
        if stored is not None:
            # the modes give these coefficients again, but on another machine not always to the last bit
            check_coefficients(stored, self._coefficients)
            self._coefficients = stored._replace(air=self._coefficients.air)
        self._kernel = _kernels_host.leading_trial
        self._accepted = initial_state(model, self._coefficients, air)
        self._initial, self._trial = self._accepted.copy(), self._accepted.copy()
        self._dims, self._has_trial, self._warned = model.chain.p.dims, False, False
        self._no_acceleration = np.empty(0)
        p = model.chain.p
        lower = [motion_path(*key) for key in p.motions if key[0] == "lower"]
        self._moving_lower_end = lower[0] if lower else None

    # --- steps of a host ----------------------------------------------------------------------------------------------

    def step(self, end_position: Any, end_velocity: Any, step: float, end_acceleration: Any = None) -> np.ndarray:
        """Move the upper end by one step and accept it.

        Parameters
        ----------
        end_position, end_velocity
            Position and velocity of the upper end at the end of the step (dims,) [m, m/s].
        step
            Length of the step [s]; it may change from step to step.
        end_acceleration
            Acceleration of the end (dims,) [m/s^2]; with it the force contains the inertia of :attr:`mass`.

        Returns
        -------
        numpy.ndarray
            Force of the cable on the host at the end of the step (dims,) [N].

        Raises
        ------
        SceneError
            For arrays of another shape, numbers that are not finite, a step above the stability limit of the present state, an
            end so near or so far that the model no longer holds.  Nothing has run then.
        RunStopped
            If the motion leaves the finite numbers or stiffens beyond the stability limit; the accepted state stays.
        """
        force = self.trial(end_position, end_velocity, step, end_acceleration)
        self.accept()
        return force

    def trial(self, end_position: Any, end_velocity: Any, step: float, end_acceleration: Any = None) -> np.ndarray:
        """Try a step from the accepted state, which does not change.

        Parameters
        ----------
        end_position, end_velocity, step, end_acceleration
            As in :meth:`step`.

        Returns
        -------
        numpy.ndarray
            Force of the cable on the host at the end of the step (dims,) [N].

        Raises
        ------
        SceneError, RunStopped
            As in :meth:`step`.
        """
        self._has_trial = False
        try:
            position, velocity = vector(end_position), vector(end_velocity)
            acceleration = self._no_acceleration if end_acceleration is None else vector(end_acceleration)
            if type(step) is not float:
                step = check_positive("step", step)
        except (OverflowError, TypeError, ValueError):
            error: Exception = self._shape_error(end_position, end_velocity, end_acceleration, step)
            raise error from None
        shape = (self._dims,)
        if (
            position.shape != shape
            or velocity.shape != shape
            or (end_acceleration is not None and acceleration.shape != shape)
            or not step > 0.0
            or self._moving_lower_end
        ):
            error = self._shape_error(end_position, end_velocity, end_acceleration, step)
            raise error
        accepted, trial = self._accepted, self._trial
        if accepted[layout.CLOCK, layout.TIME] + step > self._end_of_wind:
            raise scene_error(
                "step", step, f"steps until {self._end_of_wind:g} s, where the wind ends; try: time.duration"
            )
        if step >= self._drag_limit:
            check_step(step, self._drag_limit, OF_DRAG)
        status = self._kernel(self._coefficients, accepted, trial, position, velocity, acceleration, step)
        if status:
            error = refusal(status, self._coefficients, accepted, position, velocity, acceleration, step)
            if isinstance(error, RunStopped):
                error.partial = self._dataset(incomplete=f"stopped at {self.time + step:.9g} s")
            raise error
        self._has_trial = True
        return trial[layout.END_FORCE, : self._dims].copy()

    def accept(self) -> None:
        """Make the last trial the accepted state."""
        if not self._has_trial:
            raise SceneError("accept: given no trial since the last one; allowed: trial() first, without an error")
        self._accepted, self._trial, self._has_trial = self._trial, self._accepted, False
        if self._accepted[layout.MONITOR, MIN_FORCE] < 0.0 and not self._warned:
            self._warned = True
            warn(
                f"the chordwise force became negative, {self.smallest_chordwise_force:.3g} N until {self.time:.6g} s: the cable "
                "goes slack, where the condensed model resists compression; compare with chain.simulate",
                OutOfRangeWarning,
            )

    def _shape_error(self, position: Any, velocity: Any, acceleration: Any, step: Any) -> SceneError:
        """Return the error of arguments of a step that are no numbers, or of another shape."""
        if self._moving_lower_end:
            return scene_error(
                self._moving_lower_end, "a motion", "a lower end at rest for steps of a host; try: run()"
            )
        for key, value in (("end_position", position), ("end_velocity", velocity), ("end_acceleration", acceleration)):
            if not (key == "end_acceleration" and value is None) and not _is_vector(value, self._dims):
                return scene_error(key, value, f"an array of {self._dims} numbers, one for each coordinate")
        return scene_error("step", step, "a finite number above 0 [s]")

    # --- state --------------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time of the accepted state [s]."""
        return float(self._accepted[layout.CLOCK, layout.TIME])

    @property
    def is_at_rest(self) -> bool:
        """Whether the accepted state is that of `prepare`, to rounding."""
        near = np.allclose(self._accepted, self._initial, rtol=ROUNDING, atol=ROUNDING, equal_nan=True)
        return self.time == 0.0 and bool(near)

    @property
    def force(self) -> np.ndarray:
        """Force of the cable on the host in the accepted state (dims,) [N]."""
        return self._accepted[layout.END_FORCE, : self._dims].copy()

    @property
    def end_position(self) -> np.ndarray:
        """Position of the upper end in the accepted state (dims,) [m]."""
        return self._accepted[layout.END, : self._dims].copy()

    @property
    def mass(self) -> np.ndarray:
        """Mass of the cable that moves with the end (dims, dims) [kg].

        Along the chord it is a third of the cable's; across it, what the modes leave of that third.
        """
        axes = self._accepted[layout.AXES :, : self._dims][: self._dims]
        masses = self._coefficients.numbers[layout.END_MASS : layout.END_MASS + self._dims]
        return axes.T @ (masses[:, None] * axes)

    @property
    def stiffness(self) -> np.ndarray:
        """Static stiffness of the end at its present position (dims, dims) [N/m], of the elastic catenary at rest."""
        return static_stiffness(self._model.chain.p, self._model.chain.total_length, self.end_position)

    @property
    def amplitude(self) -> tuple[np.ndarray, ...]:
        """Amplitudes of the modes in the accepted state (mode,) [m], for each normal of the chord."""
        q, model = self._accepted[layout.Q, : len(self._model.shapes)], self._model
        return tuple(turn @ q[which] for turn, which in zip(model.spectral_basis[0], model.sets, strict=True))

    @property
    def position(self) -> np.ndarray:
        """Positions of the particles in the accepted state (particle, dims) [m]."""
        stretch, _, _, deflection = self._closed_chord()
        ends = np.stack([self._model.chain.p.lower, self.end_position])[None]
        return positions_of(self._model, stretch, deflection, ends)[0]

    @property
    def tension(self) -> np.ndarray:
        """Tensions of the links in the accepted state (link,) [N]."""
        stretch, force, squared, _ = self._closed_chord()
        return link_tensions(self._model, stretch, force, squared)[0]

    def _closed_chord(self) -> tuple[np.ndarray, ...]:
        """Return chordwise stretch, chordwise force [N], squared slopes (1, n) and deflections of the accepted state."""
        q, columns = self._accepted[None, layout.Q, : len(self._model.shapes)], 1 + layout.PATTERNS * self._dims
        return close_chord_of(self._model, q, self._accepted[None, layout.BOUNDARY, :columns])

    @property
    def step_limit(self) -> float:
        """Stability limit of the steps from the accepted state [s]."""
        return min(
            float(verlet_step_limit(np.sqrt(self._accepted[layout.MONITOR, MAX_OMEGA_SQUARED]))), self._drag_limit
        )

    @property
    def smallest_chordwise_force(self) -> float:
        """Least chordwise force of all accepted steps [N]; below zero the cable goes slack."""
        return float(self._accepted[layout.MONITOR, MIN_FORCE])

    # --- compiled hosts -----------------------------------------------------------------------------------------------

    @property
    def kernel(self) -> Any:
        """Compiled function ``kernel(coefficients, accepted, trial, end_position, end_velocity, end_acceleration, step)``.

        It fills the state `trial` and returns 0, or another number if `trial` is not to be accepted.  A function compiled by
        numba may call it; arguments are :attr:`coefficients`, two arrays like :attr:`state`, and arrays (dims,), the last one
        without entries where the acceleration is not known.  The force is in the row :attr:`FORCE_ROW` of a state.
        """
        return self._kernel

    #: Row of a state whose first entries are the force on the host (dims,) [N].
    FORCE_ROW = layout.END_FORCE

    @property
    def coefficients(self) -> HostCoefficients:
        """Coefficients for :attr:`kernel`."""
        return self._coefficients

    @property
    def state(self) -> np.ndarray:
        """Copy of the accepted state; assign a state of :attr:`kernel` to go on from it."""
        return self._accepted.copy()

    @state.setter
    def state(self, state: np.ndarray) -> None:
        self._accepted, self._has_trial = checked_state(state, self._accepted.shape), False

    # --- runs and Datasets --------------------------------------------------------------------------------------------

    def run(self, *, times: Any = None, outputs: tuple[str, ...] = ("end_force",), links: Any = None) -> PreparedRun:
        """Run the cable from rest with the motions of the scene; the state of the steps stays as it is.

        Parameters
        ----------
        times
            Instants of the output [s]; those of the scene by default.
        outputs
            Some of "position", "tension" and "end_force"; amplitudes come in any case.
        links
            Numbers, from 1 at the lower end, of the links whose tensions are computed; all by default.

        Returns
        -------
        PreparedRun
            Plain arrays.

        Raises
        ------
        SceneError
            For options that are not allowed, and a step above the stability limit.
        RunStopped
            As :func:`cablepod.condensed.simulate`.

        Warns
        -----
        OutOfRangeWarning
            Where the chordwise force becomes negative, and where the ends move as fast as waves travel along the cable.
        NotConvergedWarning
            Where the step does not resolve the motion of the ends.
        """
        outputs = check_outputs(outputs, OUTPUTS)
        chosen = None if links is None else check_links(links, self._modes)
        return run(self._model, self._coefficients, self.prepared_step, self.wind, times, outputs, chosen)

    def dataset(self) -> xr.Dataset:
        """Return the model with its accepted state as a Dataset, from which :func:`cablepod.condensed.resume` goes on bit by bit.

        Variables of scene and modes have the prefixes ``scene_`` and ``modes_``.
        """
        return self._dataset()

    def _dataset(self, **attrs: str) -> xr.Dataset:
        return dataset_of(self, self._scene, self._modes, self._model, **attrs)


def _is_vector(value: Any, dims: int) -> bool:
    try:
        return vector(value).shape == (dims,)
    except (OverflowError, TypeError, ValueError):
        return False
