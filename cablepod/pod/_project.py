"""Projection of snapshots on modes, reconstruction, interpolation in time."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from cablepod import provenance
from cablepod.conventions import ENDS, label
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import integer
from cablepod.pod import _normal as pod_normal
from cablepod.pod._label import LAYOUTS
from cablepod.pod._snapshots import lift, positions, relative_arc_length, shares


def mode_fields(modes: xr.Dataset, rank: int | None = None) -> np.ndarray:
    """Return the modes as vector fields (modes, particle, coordinate), separate ones coordinate by coordinate.

    Raises
    ------
    SceneError
        Where `modes` are none, or fewer than `rank`.
    """
    if "mode_shape" not in modes or modes.attrs.get("layout") not in LAYOUTS[:2]:
        raise SceneError(
            f"modes: given a Dataset without mode_shape, or layout {modes.attrs.get('layout')!r}; allowed: what pod.decompose "
            f"gives with one of {LAYOUTS[:2]}"
        )
    most = modes.sizes["mode"]
    if rank is not None:
        integer(least=1)("rank", rank)
        if rank > most:
            raise scene_error("rank", rank, f"at most {most}, as many modes as there are")
        most = int(rank)
    if modes.attrs["layout"] == "vector":
        return modes["mode_shape"].transpose("mode", "particle", "coordinate").values[:most]
    shape = modes["mode_shape"].transpose("coordinate", "mode", "particle").values[:, :most]
    dims, _, particles = shape.shape
    fields = np.zeros((dims, most, particles, dims))
    for c in range(dims):
        fields[c, :, :, c] = shape[c]
    return fields.reshape(dims * most, particles, dims)


def amplitude_dataset(amplitude: np.ndarray, ends: np.ndarray, time: np.ndarray, modes: xr.Dataset) -> xr.Dataset:
    """Label amplitudes (time, modes) in the order of :func:`mode_fields` and the positions of the ends (time, 2, coordinate)."""
    dims: tuple[str, ...] = ("time", "mode")
    count = amplitude.shape[1]
    if modes.attrs["layout"] == "separate":
        coordinates = modes.sizes["coordinate"]
        count //= coordinates
        amplitude, dims = amplitude.reshape(-1, coordinates, count), ("time", "coordinate", "mode")
    result = xr.Dataset(
        {"amplitude": (dims, amplitude), "end_position": (("time", "end", "coordinate"), ends)},
        coords={
            "time": time,
            "mode": modes["mode"].values[:count],
            "coordinate": modes["coordinate"].values,
            "end": list(ENDS),
        },
    )
    return label(result)


def at_times(trajectory: xr.Dataset, *, times: ArrayLike) -> xr.Dataset:
    """Pick instants of a trajectory as snapshots, and note so in its history, which ``isel`` and ``sel`` do not.

    Parameters
    ----------
    trajectory
        With ``time`` [s]; not modified.
    times
        Instants of it [s].

    Raises
    ------
    SceneError
        Where an instant is none of the trajectory's.
    """
    own, wanted = trajectory["time"].values, np.atleast_1d(np.asarray(times, dtype=float))
    right = np.clip(np.searchsorted(own, wanted), min(1, own.size - 1), own.size - 1)
    nearest = np.where(wanted - own[right - 1] < own[right] - wanted, right - 1, right)
    off = np.abs(own[nearest] - wanted) > 1e-9 * np.maximum(1.0, np.abs(wanted))
    if off.any():
        raise scene_error("times", float(wanted[off][0]), "instants of the trajectory")
    picked = trajectory.isel(time=nearest)
    return provenance.record(picked, function="pod.at_times", parameters={"times": wanted}, inputs=[trajectory])


def project(snapshots: xr.Dataset, modes: xr.Dataset) -> xr.Dataset:
    """Project snapshots on modes.

    Parameters
    ----------
    snapshots
        A trajectory on the particles of the modes (the same sigma = S / L0).
    modes
        What :func:`decompose` gives.

    Returns
    -------
    xarray.Dataset
        ``amplitude (time, coordinate, mode)``, or ``(time, mode)`` for vector modes [m], and ``end_position``
        (time, end, coordinate) [m], which :func:`reconstruct` needs to put the straight line back.

    Raises
    ------
    SceneError
        Where the particles differ.
    """
    sigma, own = relative_arc_length(modes), relative_arc_length(snapshots)
    if sigma.shape != own.shape or np.abs(sigma - own).max() > 1e-9:
        raise SceneError(
            f"snapshots: given {own.size} particles; allowed: the {sigma.size} particles of the modes, at the same S / L0"
        )
    weight = np.ones(sigma.size) if modes.attrs["weights"] == "None" else shares(sigma)
    if modes.attrs["layout"] == "normal":
        position = positions(snapshots)
        values = pod_normal.project(position, modes, weight)
        result = pod_normal.amplitude_dataset(values, position[:, (0, -1)], snapshots["time"].values, modes)
    else:
        hat, ends = lift(snapshots)
        amplitude = np.einsum("tpc,mpc->tm", (hat - _mean(modes)) * weight[:, None], mode_fields(modes))
        result = amplitude_dataset(amplitude, ends, snapshots["time"].values, modes)
    result.attrs.update(title=f"{snapshots.attrs.get('title', 'snapshots')}: amplitudes", stage="amplitudes")
    return provenance.record(result, function="pod.project", parameters={}, inputs=[snapshots, modes])


def _mean(modes: xr.Dataset) -> np.ndarray:
    return modes["mean"].transpose("particle", "coordinate").values


def reconstruct(amplitudes: xr.Dataset, modes: xr.Dataset) -> xr.Dataset:
    """Put snapshots together from amplitudes and modes, eq. (36).

    Parameters
    ----------
    amplitudes
        What :func:`project` or a reduced model gives; fewer modes than `modes` has are taken as the first ones.
    modes
        What :func:`decompose` gives.

    Returns
    -------
    xarray.Dataset
        ``position (time, particle, coordinate)`` [m].  Modes of the deflection normal to the chord say nothing of the distances
        along it: all links are then taken to be stretched alike.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> chain = cp.chain.simulate(scene)
    >>> modes = cp.pod.decompose(chain, rank=2)
    >>> again = cp.pod.reconstruct(cp.pod.project(chain, modes), modes)
    >>> float(cp.compare.errors(again, chain).error_max) < 1e-3  # what two modes cannot hold
    True
    """
    if modes.attrs["layout"] == "normal":
        position = pod_normal.reconstruct(amplitudes, modes, relative_arc_length(modes))
    else:
        fields = mode_fields(modes, amplitudes.sizes["mode"])
        order = ("time", "coordinate", "mode") if modes.attrs["layout"] == "separate" else ("time", "mode")
        amplitude = amplitudes["amplitude"].transpose(*order).values.reshape(amplitudes.sizes["time"], -1)
        ends = amplitudes["end_position"].transpose("time", "end", "coordinate").values
        position = compose(amplitude, ends, fields, _mean(modes), relative_arc_length(modes))
    result = xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position)},
        coords={
            "time": amplitudes["time"].values,
            "coordinate": modes["coordinate"].values,
            "arc_length": ("particle", modes["arc_length"].values),
        },
    )
    label(result)
    result.attrs.update(title=f"{amplitudes.attrs.get('title', 'amplitudes')}: snapshots", stage="trajectory")
    return provenance.record(result, function="pod.reconstruct", parameters={}, inputs=[amplitudes, modes])


def compose(
    amplitude: np.ndarray, ends: np.ndarray, fields: np.ndarray, mean: np.ndarray, sigma: np.ndarray
) -> np.ndarray:
    """Positions (time, particle, coordinate) [m] from amplitudes (time, modes), ends (time, 2, coordinate) and fields."""
    s = sigma[None, :, None]
    position = (1.0 - s) * ends[:, :1] + s * ends[:, 1:] + mean
    position = position + np.tensordot(amplitude, fields, axes=1)
    # rounding in sigma must not move the ends
    position[:, 0], position[:, -1] = ends[:, 0], ends[:, 1]
    return position
