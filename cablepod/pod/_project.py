"""Projection of snapshots on modes, reconstruction, selection of instants."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from cablepod import provenance
from cablepod._inputs import AMPLITUDES, FIELD_MODES, MODES, MOTION, TIMED, floats, numbers_in, taken
from cablepod.conventions import label, shared_coordinates
from cablepod.discretisation._interpolation import are_same
from cablepod.discretisation._lifting import line_between
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import choice, integer
from cablepod.pod import _normal as pod_normal
from cablepod.pod._label import amplitude_dataset
from cablepod.pod._snapshots import MASS, particle_weights, positions, relative_arc_length


def mode_fields(modes: xr.Dataset, rank: int | None = None) -> np.ndarray:
    """Return modes as vector fields (modes, particle, coordinate), separate ones ordered coordinate by coordinate.

    Raises
    ------
    SceneError
        If `modes` have fewer modes than `rank`.
    """
    most = modes.sizes["mode"]
    if rank is not None:
        integer(least=1)("rank", rank)
        if rank > most:
            raise scene_error("rank", rank, f"at most {most}, the number of modes")
        most = int(rank)
    if modes.attrs["layout"] == "vector":
        return floats(modes.variables["mode_shape"].values)[:most]
    shape = modes.variables["mode_shape"].values[:, :most]
    dims, _, particles = shape.shape
    fields = np.zeros((dims, most, particles, dims))
    for c in range(dims):
        fields[c, :, :, c] = shape[c]
    return fields.reshape(dims * most, particles, dims)


def numbers_of(modes: xr.Dataset, rank: int | None = None) -> np.ndarray:
    """Return the numbers of the first `rank` modes, or of all: their labels, which a selection keeps, otherwise from 1 on."""
    numbers = modes.variables.get("mode")
    return (np.arange(1, modes.sizes["mode"] + 1) if numbers is None else numbers.values)[:rank]


def _split_amplitude(amplitude: np.ndarray, modes: xr.Dataset) -> tuple[tuple[str, ...], np.ndarray]:
    """Return dimensions and values of amplitudes (time, modes) in the order of :func:`mode_fields`."""
    if modes.attrs["layout"] != "separate":
        return ("time", "mode"), amplitude
    coordinates = modes.sizes["coordinate"]
    return ("time", "coordinate", "mode"), amplitude.reshape(-1, coordinates, amplitude.shape[1] // coordinates)


def at_times(trajectory: xr.Dataset, *, times: ArrayLike) -> xr.Dataset:
    """Select instants of a trajectory, and record it in the history (``isel`` and ``sel`` do not).

    Parameters
    ----------
    trajectory
        Dataset with ``time`` [s]; not modified.
    times
        Instants of the trajectory [s].

    Returns
    -------
    xarray.Dataset
        The trajectory at these instants.

    Raises
    ------
    SceneError
        If the trajectory does not contain an instant.
    """
    trajectory = taken("trajectory", trajectory, TIMED)
    available = trajectory["time"].values
    wanted = numbers_in("times", times, "s", "finite instants of the trajectory [s]")
    right = np.clip(np.searchsorted(available, wanted), min(1, available.size - 1), available.size - 1)
    nearest = np.where(wanted - available[right - 1] < available[right] - wanted, right - 1, right)
    off = np.abs(available[nearest] - wanted) > 1e-9 * np.maximum(1.0, np.abs(wanted))
    if off.any():
        raise scene_error("times", float(wanted[off][0]), "instants of the trajectory")
    selected = trajectory.isel(time=nearest)
    return provenance.record(selected, function="pod.at_times", parameters={"times": wanted}, inputs=[trajectory])


def project(snapshots: xr.Dataset, modes: xr.Dataset) -> xr.Dataset:
    """Project snapshots on modes.

    Parameters
    ----------
    snapshots
        A trajectory on the particles of the modes (the same sigma = S / L0).
    modes
        Modes of :func:`cablepod.pod.decompose`.

    Returns
    -------
    xarray.Dataset
        ``amplitude (time, coordinate, mode)``, or ``(time, mode)`` for vector modes [m], and ``end_position``
        (time, end, coordinate) [m], which :func:`reconstruct` needs for the line between the ends.

    Raises
    ------
    SceneError
        If particles or coordinates differ, or positions are missing or not finite.
    """
    snapshots, modes = taken("snapshots", snapshots, MOTION), taken("modes", modes, MODES)
    sigma, snapshot_sigma = relative_arc_length(modes), relative_arc_length(snapshots)
    if not are_same(sigma, snapshot_sigma):
        raise SceneError(
            f"snapshots: given {snapshot_sigma.size} particles; allowed: the {sigma.size} particles of the modes, at the same "
            "S / L0"
        )
    _check_coordinates("snapshots", snapshots, modes)
    if set(snapshots["position"].dims) != {"time", "particle", "coordinate"}:
        raise scene_error("snapshots.position", snapshots["position"].dims, "('time', 'particle', 'coordinate')")
    weights = str(choice("None", "length", "mass")("modes.weights", modes.attrs.get("weights")))
    weight = particle_weights(modes, None if weights == "None" else weights)
    position = positions(snapshots)
    ends = position[:, (0, -1)]
    if modes.attrs["layout"] == "normal":
        variables = pod_normal.project(position, modes, weight)
    else:
        lifted = position - line_between(ends, snapshot_sigma) - mean_of(modes)
        amplitude = np.einsum("tpc,mpc->tm", lifted * weight[:, None], mode_fields(modes))
        variables = {"amplitude": _split_amplitude(amplitude, modes)}
    result = amplitude_dataset(variables, ends, snapshots["time"].values, modes)
    result.attrs.update(
        title=f"{snapshots.attrs.get('title', 'snapshots')}: amplitudes",
        stage="amplitudes",
        layout=modes.attrs["layout"],
    )
    return provenance.record(result, function="pod.project", parameters={}, inputs=[snapshots, modes])


def _check_coordinates(key: str, dataset: xr.Dataset, modes: xr.Dataset) -> None:
    """Refuse a trajectory or amplitudes of other coordinates than the modes."""
    given, own = (part["coordinate"].values.tolist() for part in (dataset, modes))
    if given != own:
        raise scene_error(f"{key}: coordinate", given, f"those of the modes, {own}")


def _modes_of(amplitudes: xr.Dataset, modes: xr.Dataset) -> xr.Dataset:
    """Return the modes of the numbers of some amplitudes; refuse amplitudes of modes that are not there."""
    wanted, own = numbers_of(amplitudes), numbers_of(modes)
    if not np.isin(wanted, own).all():
        raise scene_error("amplitudes: mode", wanted.tolist(), f"numbers of the modes, {own.tolist()}")
    return modes if wanted.size == own.size else modes.isel(mode=np.searchsorted(own, wanted))


def mean_of(modes: xr.Dataset) -> np.ndarray:
    """Return the mean of the lifted position (particle, coordinate) [m]."""
    if "mean" not in modes.variables:
        raise scene_error("modes", "a Dataset without mean", FIELD_MODES.allowed)
    return floats(modes.variables["mean"].values)


def reconstruct(amplitudes: xr.Dataset, modes: xr.Dataset) -> xr.Dataset:
    """Reconstruct snapshots from amplitudes and modes, eq. (36).

    Parameters
    ----------
    amplitudes
        Result of :func:`project` or of a reduced model; each amplitude is that of the mode of the same number (label ``mode``).
    modes
        Modes of :func:`cablepod.pod.decompose`, at least those of the amplitudes.

    Returns
    -------
    xarray.Dataset
        ``position (time, particle, coordinate)`` [m].  Layout "normal" has no displacements along the chord: all links then have
        the same stretch along it.

    Raises
    ------
    SceneError
        If the amplitudes are of another layout, of other coordinates or of modes that are not there.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> chain = cp.chain.simulate(scene)
    >>> modes = cp.pod.decompose(chain, rank=2)
    >>> again = cp.pod.reconstruct(cp.pod.project(chain, modes), modes)
    >>> float(cp.compare.errors(again, chain).error_max) < 1e-3  # truncation to two modes
    True
    """
    amplitudes, modes = taken("amplitudes", amplitudes, AMPLITUDES), taken("modes", modes, MODES)
    layout, given = modes.attrs["layout"], amplitudes["amplitude"].dims
    dims = {"time", "coordinate", "mode"} if layout == "separate" else {"time", "mode"}
    if set(given) != dims or amplitudes.attrs.get("layout", layout) != layout:
        given = amplitudes.attrs.get("layout", given)
        raise scene_error("amplitudes", given, f"those of modes with layout {layout!r}")
    _check_coordinates("amplitudes", amplitudes, modes)
    modes = _modes_of(amplitudes, modes)
    if layout == "normal":
        position = pod_normal.reconstruct(amplitudes, modes, relative_arc_length(modes))
    else:
        fields = mode_fields(modes)
        amplitude = floats(amplitudes["amplitude"].values).reshape(amplitudes.sizes["time"], -1)
        ends = floats(amplitudes["end_position"].values)
        position = (
            line_between(ends, relative_arc_length(modes)) + mean_of(modes) + np.tensordot(amplitude, fields, axes=1)
        )
        position[:, (0, -1)] = ends  # exactly, without rounding errors of sigma
    result = xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position)},
        coords=shared_coordinates(
            {
                "time": amplitudes["time"].values,
                "coordinate": modes["coordinate"].values,
                "arc_length": ("particle", modes["arc_length"].values),
                **({MASS: ("particle", modes[MASS].values)} if MASS in modes.variables else {}),
            }
        ),
    )
    label(result)
    result.attrs.update(title=f"{amplitudes.attrs.get('title', 'amplitudes')}: snapshots", stage="trajectory")
    return provenance.record(result, function="pod.reconstruct", parameters={}, inputs=[amplitudes, modes])
