"""Public function: one periodic response."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cablepod._inputs import NORMAL_MODES, SCENE, taken
from cablepod.errors import RunStopped, scene_error
from cablepod.parameters._checks import integer
from cablepod.periodic import _estimate as estimate
from cablepod.periodic import _fields as fields
from cablepod.periodic import _output as output
from cablepod.periodic._continuation import adapted_at
from cablepod.periodic._general import solver_of
from cablepod.periodic._members import each_member, given_names, model_of
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._solve import MAX_HARMONICS, MIN_HARMONICS, Solver, State, sets_of
from cablepod.periodic._start import grown_from_rest
from cablepod.pod._normal import SETS

#: Outputs of an orbit.
OUTPUTS = ("position", "tension", "tension_extremes", "harmonics", "error_estimate")
#: Units and name of the estimate.
ERROR_LABEL = {"units": "1", "long_name": "estimated rms error of the deflection, over the motion"}
#: Number of instants of a period of the forcing in the result.
INSTANTS = 128


def orbit(
    scene: xr.Dataset,
    modes: xr.Dataset,
    *,
    rank: int | None = None,
    order: str = "leading",
    periods: int = 1,
    harmonics: int | None = None,
    start: xr.Dataset | None = None,
    out_of_plane: bool = True,
    outputs: tuple[str, ...] = ("position", "tension_extremes"),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Compute a periodic response of the condensed model and its Floquet multipliers.

    Parameters
    ----------
    scene
        Scene with both ends held, with motions of the ends or load factors of kind "harmonic" or "one_minus_cosine" and of one
        angular frequency.  Scenes with ``member`` are computed one by one; where periods differ, the instants of each member are
        ``member_time (member, time)`` [s] in place of ``time``.
    modes
        Modes of layout "normal", of :func:`cablepod.pod.decompose` or :func:`cablepod.condensed.vibration_modes`; those of the
        scene with its attachments have their kinks.
    rank
        Number of modes of each deflection; all by default.
    order
        "leading" or "exact", see :func:`cablepod.condensed.simulate`.
    periods
        Number of periods of the forcing after which the motion repeats.
    harmonics
        Number of harmonics of a period of the motion; by default so many that the last two hold less than 1e-6 of it.
    start
        First guess: an orbit, a point of :func:`frequency_response` with output "harmonics", or a run of
        :func:`cablepod.condensed.simulate` on the same modes, whose last periods are taken.  By default the response grows from
        rest with the amplitude of the forcing; where that folds back, it is followed from a lower or higher frequency.
    out_of_plane
        Whether disturbances out of the plane are judged in a planar scene.  Its modes out of the plane are vibrations about rest.
    outputs
        Some of "position" (at 128 instants of each period of the forcing), "tension", "tension_extremes", "harmonics" and
        "error_estimate", which takes some ten times as long as the orbit; not of cables with segments or attachments, as order
        "exact".
    progress
        Callback receiving the completed fraction of the members, which never falls and ends at 1.

    Returns
    -------
    xarray.Dataset
        ``time`` [s] over one period of the motion, ``amplitude (time, mode)`` [m], ``angular_frequency`` [rad/s],
        ``multiplier_real``, ``multiplier_imag``, ``multiplier_set (multiplier)``, ``deflection_maximum`` [m], ``stable``,
        ``growth`` [1/s], and what `outputs` names.  ``error_estimate`` is the largest rms distance of the deflection from that of
        a richer model over its motion, nan where that has no orbit nearby; the attribute ``error_estimate_by`` tells in what it
        is richer: order "exact", two more modes.  Other attributes: number of harmonics, ``smallest_chordwise_force`` [N],
        ``forcing_over_axial_frequency`` of the highest harmonic with 1 % of the motion.

    Raises
    ------
    SceneError
        For a scene, modes or options that it does not support; the key is named.
    RunStopped
        If no periodic response is found near the start; on Ctrl-C after the first member, where `partial` has those computed.

    Warns
    -----
    OutOfRangeWarning
        For a slack cable, harmonics near the first axial frequency, and without damping.

    Notes
    -----
    Harmonic balance with forces sampled in time (Cameron and Griffin 1989), Newton's method with the exact Jacobian.  Multipliers
    follow by Numerov's scheme from the linearised equations without damping, which factors out.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example4")
    >>> modes = cp.condensed.vibration_modes(scene, rank=2)
    >>> response = cp.periodic.orbit(scene, modes)  # doctest: +SKIP
    """
    scene, modes = taken("scene", scene, SCENE), taken("modes", modes, NORMAL_MODES)
    wanted = given_names("outputs", outputs, OUTPUTS)
    periods = integer(least=1, most=8)("periods", periods)
    if harmonics is not None:
        harmonics = integer(least=2, most=MAX_HARMONICS * periods)("harmonics", harmonics)

    def one(scene: xr.Dataset, _: Callable[[float], None]) -> xr.Dataset:
        model, omega = model_of(scene, modes, rank=rank, order=order, out_of_plane=out_of_plane)
        if "error_estimate" in wanted:
            estimate.refuse_things(model)
        solver = solver_of(model)
        state = find(solver, omega / model.scales[0], periods, harmonics, start)
        result = labelled(solver, state, wanted)
        if "error_estimate" in wanted:
            rich, gained = estimate.richer_solver(scene, modes, rank, out_of_plane)
            result["error_estimate"] = ((), estimate.orbit_error(solver, state, rich), ERROR_LABEL)
            result.attrs["error_estimate_by"] = gained
        output.warn_of_result(result.attrs, model.undamped)
        return result

    result = each_member(scene, one, progress)
    parameters = {
        "rank": rank, "order": order, "periods": periods, "harmonics": harmonics, "out_of_plane": bool(out_of_plane),
        "outputs": list(wanted),
    }  # fmt: skip
    inputs = () if start is None else (start,)
    kept = "some members" if "incomplete" in result.attrs else ""
    return output.record(result, "periodic.orbit", scene, modes, parameters, inputs, kept=kept)


def find(solver: Solver, omega: float, periods: int, harmonics: int | None, start: xr.Dataset | None) -> State:
    """Find a periodic response at an angular frequency without dimension.

    Raises
    ------
    RunStopped
        If there is none near the start.
    """
    model = solver.model
    count = MIN_HARMONICS * periods if harmonics is None else harmonics
    state = (
        grown_from_rest(solver, omega, count, periods)
        if start is None
        else state_of(model, start, omega, periods, count)
    )
    found, _, iterations = solver.at_frequency(state) if harmonics is not None else adapted_at(solver, state)
    if iterations < 0:
        raise RunStopped(
            f"no periodic response at {omega * model.scales[0]:.6g} rad/s: Newton's method fails from "
            f"{'this start' if start is not None else 'rest'}; try start=, a run of condensed.simulate that has settled"
            f"{model.remedy}"
        )
    return found


def state_of(model: PeriodicModel, start: Any, omega: float, periods: int, harmonics: int) -> State:
    """Make a first guess from a Dataset.

    Raises
    ------
    SceneError
        If it has no amplitudes of these modes.
    """
    allowed = (
        "an orbit, a point of frequency_response with output harmonics, or a run of condensed.simulate on these modes"
    )
    if not isinstance(start, xr.Dataset):
        raise scene_error("start", type(start).__name__, allowed)
    if "member_time" in start.coords and start["member_time"].dims == ("time",):  # of a member
        start = start.assign_coords(time=start["member_time"].values)
    name = "harmonic_cosine" if "harmonic_cosine" in start else "amplitude"
    base = "harmonic" if name == "harmonic_cosine" else "time"
    if (
        name not in start
        or start[name].dims != (base, "mode")
        or start.sizes["mode"] < model.n_in_plane
        or not start.sizes[base]
    ):
        raise scene_error("start", f"a Dataset with {', '.join(map(str, start.data_vars))}", allowed)
    is_run = base == "time" and "angular_frequency" not in start
    given = periods if is_run else int(start.attrs.get("periods", start.get("periods", 1)))
    most = -(-harmonics * given // periods)  # number of harmonics of the start that can be wanted
    parts = []
    for suffix, turn in zip(SETS, model.turns, strict=False):
        values = np.zeros((2, 1 + harmonics, len(turn)))  # cosines and sines
        if f"{name}{suffix}" in start:
            if base == "harmonic":
                found = np.stack([start[f"harmonic_{kind}{suffix}"] for kind in ("cosine", "sine")])
            else:
                own = omega * model.scales[0] if is_run else float(start["angular_frequency"])
                found = _fitted(start[f"{name}{suffix}"], own, given, most)
            k = np.arange(min(found.shape[1], most + 1))
            k = k[k * periods % given == 0]
            values[:, k * periods // given] = np.nan_to_num(found[:, k, : len(turn)])
        pairs = np.delete(values.transpose(1, 0, 2).reshape(-1, len(turn)), 1, axis=0)  # without the sine of the mean
        parts.append(np.linalg.solve(turn, pairs.T).T)
    coefficients = np.concatenate(parts, axis=1) / model.scales[1]
    outside = np.abs(coefficients[:, model.n_in_plane :]).max(initial=0.0)
    planar = model.is_planar and outside <= 1e-9 * np.abs(coefficients).max()
    if planar:
        coefficients = coefficients[:, : model.n_in_plane]
    return State(np.append(coefficients.ravel(), omega), planar, coefficients.shape[1], periods)


def _fitted(amplitude: xr.DataArray, omega: float, periods: int, harmonics: int) -> np.ndarray:
    """Fit cosines and sines to the last periods of amplitudes (time, mode), from the mean on (2, 1 + harmonics, mode)."""
    time = amplitude["time"].values
    duration = 2.0 * np.pi * periods / omega
    last = time > time[-1] - duration * (1.0 - 1e-9)
    most = max(min(harmonics, (int(last.sum()) - 1) // 3), 1)
    phase = np.outer(time[last], np.arange(most + 1)) * omega / periods
    basis = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)  # the sine of the mean gets no part
    values = np.linalg.lstsq(basis, np.nan_to_num(amplitude.values[last]), rcond=None)[0]
    return values.reshape(2, most + 1, -1)


def labelled(solver: Solver, state: State, wanted: Sequence[str]) -> xr.Dataset:
    """Return a solution with its multipliers as a Dataset."""
    model = solver.model
    stability = solver.stability(state)
    omega = state.omega * model.scales[0]
    phases = INSTANTS * state.periods
    q = fields.coordinates(model, state, phases)
    closed = np.concatenate([q, q[:1]])
    phase = 2.0 * np.pi / INSTANTS * np.arange(phases + 1)
    mu = stability.multipliers
    if not np.isfinite(mu).all():
        raise RunStopped(
            f"the multipliers are not finite: disturbances grow without bound (smallest chordwise force "
            f"{stability.smallest_force:.3g} N); try other amplitudes, or compare with chain.simulate{model.remedy}"
        )
    duration = 2.0 * np.pi * state.periods / omega
    sets = [name for name, which in sets_of(model, state) for _ in range(which.start, which.stop)]
    variables: dict[str, Any] = {
        "angular_frequency": ((), omega),
        **output.per_set(model, "amplitude", ("time",), fields.mode_amplitudes(model, closed)),
        "deflection_maximum": ((), fields.largest_deflection(model, q)),
        "stable": ((), stability.is_stable),
        "growth": ((), float(np.log(np.abs(mu).max())) / duration),
        "multiplier_real": (("multiplier",), mu.real),
        "multiplier_imag": (("multiplier",), mu.imag),
        "multiplier_set": (("multiplier",), sets),
    }
    if {"position", "tension", "tension_extremes"} & set(wanted):
        stretch, force, squared = fields.close_chord(model, closed, omega, phase)
        if "position" in wanted:
            variables["position"] = (
                ("time", "particle", "coordinate"),
                fields.positions(model, closed, stretch, phase),
            )
        tension = fields.tensions(model, stretch, force, squared)
        if "tension" in wanted:
            variables["tension"] = (("time", "link"), tension)
        if "tension_extremes" in wanted:
            variables["tension_minimum"] = (("link",), -fields.maximum(-tension[:-1]))
            variables["tension_maximum"] = (("link",), fields.maximum(tension[:-1]))
    coords: dict[str, Any] = {"time": phase / omega, "multiplier": np.arange(1, mu.size + 1)}
    if "harmonics" in wanted:
        variables |= output.harmonic_variables(model, state)
        coords["harmonic"] = np.arange(state.harmonics + 1) / state.periods
    names = {
        "amplitude": ("m", "amplitude of the mode"),
        "amplitude_out_of_plane": ("m", "amplitude of the mode out of the plane"),
        "time": ("s", "time since an instant at which the phase of the forcing is that of the scene at its start"),
        "harmonic": ("1", "angular frequency of the harmonic over that of the forcing"),
    }
    result = output.dataset(model, variables, coords, **names)
    result.attrs.update(
        periods=state.periods,
        harmonics=state.harmonics,
        order=model.condensed.order,
        smallest_chordwise_force=stability.smallest_force,
        **output.axial_attributes(model, output.significant_harmonic(state) * omega),
    )
    return result
