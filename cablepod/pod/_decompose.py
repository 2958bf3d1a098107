"""Karhunen-Loeve decomposition (POD): snapshots -> modes; projection and reconstruction.

Snapshots are decomposed in the lifted variables of eq. (35): what is left of the position when the straight line between the
ends of the moment is taken off.  Modes vanish at both ends and live on sigma = S / L0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from cablepod import provenance
from cablepod.conventions import ENDS, label
from cablepod.discretisation import _similarity as training
from cablepod.parameters import _schema as schema
from cablepod.parameters._parameters import check_bytes
from cablepod.parameters._schema import SceneError, refuse
from cablepod.pod import _decompositions as decompositions
from cablepod.pod import _normal as pod_normal
from cablepod.pod import _snapshots as reading
from cablepod.pod._incremental import COMPLETE
from cablepod.pod._snapshots import lift, relative_arc_length
from cablepod.pod._stream import LAYOUTS, Stream, check_options, labelled


def decompose(
    snapshots: xr.Dataset | Sequence[xr.Dataset],
    *,
    rank: int | None = None,
    energy: float | None = None,
    layout: str = "separate",
    method: str = "svd",
    weights: str | None = None,
    center: bool = True,
) -> xr.Dataset:
    """Decompose snapshots into Karhunen-Loeve modes, eqs. (24)-(36).

    Parameters
    ----------
    snapshots
        A trajectory with ``position (time, particle, coordinate)`` [m] and ``arc_length (particle)`` [m], dimensions in any
        order; further dimensions such as ``member`` count as more snapshots.  Or several trajectories on the same particles
        (S / L0), of any lengths, for "svd".
    rank
        Number of modes to keep (of each coordinate where they are separate); all by default.
    energy
        Keep as many modes as are needed for this share of the sum of squared singular values, in (0, 1].
    layout
        "separate": modes for each coordinate, as the paper has them; "vector": one set of modes for all coordinates; "normal":
        modes of the deflection normal to the chord of the moment, for :mod:`cablepod.condensed`, with a set of their own out of
        the plane of chord and vertical in spatial scenes.
    method
        The route, all three of section 5.1 of the paper: "svd", the singular value decomposition of the data, eq. (30), right to
        the last digits; "covariance", eigenvectors of the (n, n) covariance matrix, eq. (29); "snapshots", Sirovich's,
        eigenvectors of an (m, m) matrix, for few snapshots of very many particles.  The last two square the data: below 10^-8
        of the largest singular value they give noise.  For "svd", many snapshots and those held in chunks (as
        ``archive.read(path, chunks=...)`` gives them) are not made into one matrix, but read once, in blocks, by
        :class:`Stream`; the attribute ``algorithm`` says so.
    weights
        Inner product over the particles: None, the paper's, counts all alike; "length" or "mass" by the unstretched length
        that each carries, scaled to mean 1 (the same for a uniform cable).
    center
        Take the time mean off first.  Deflections normal to the chord keep their mean.

    Returns
    -------
    xarray.Dataset
        ``mode_shape (coordinate, mode, particle)``, ``singular_value (coordinate, mode)`` [m] of the plain centred, lifted
        data matrix, or for "vector" ``mode_shape (mode, particle, coordinate)``, ``singular_value (mode)``, or for "normal"
        ``mode_shape (mode, particle)``, ``singular_value (mode)``, with the same names and ``_out_of_plane`` in space; with
        ``proper_orthogonal_value`` (squared singular value over the number of snapshots), ``energy_share``,
        ``singular_value_share`` (over all singular values computed), and ``mean (particle, coordinate)`` [m].  What is not
        known: ``truncation_error``, the root of the share of the energy that the modes do not hold;
        ``singular_value_uncertainty`` [m], an estimate of what the chosen route may be off by, and ``mode_uncertainty`` [rad],
        the angle that this lets a mode turn by, which grows as neighbouring singular values come close.  The first entry of a
        mode that reaches half its largest is positive.

    Raises
    ------
    SceneError
        For options that cannot be and snapshots that are not finite or too few.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> modes = cp.pod.decompose(cp.chain.simulate(scene), rank=2)
    >>> modes.singular_value.dims, modes.singular_value.sel(coordinate="x").values.round(2).tolist()
    (('coordinate', 'mode'), [7.05, 0.03])
    """
    check_options(layout, method, weights, rank, energy)
    parts = [snapshots] if isinstance(snapshots, xr.Dataset) else list(snapshots)
    reading.check_alike(parts)
    if len(parts) > 1 and method != "svd":
        raise refuse("method", method, "'svd' for several trajectories")
    if len(parts) > 1 or (method == "svd" and _in_blocks(reading.position_of(parts[0]), layout, rank)):
        stream = Stream(layout=layout, weights=weights, center=center)
        for part in parts:
            stream.update(part)
        return stream.modes(rank=rank, energy=energy, function="pod.decompose")
    return _at_once(parts[0], (rank, energy), layout, method, weights, center and layout != "normal")


def _at_once(
    snapshots: xr.Dataset,
    choice: tuple[int | None, float | None],
    layout: str,
    method: str,
    weights: str | None,
    center: bool,
) -> xr.Dataset:
    """Decompose the matrix of all snapshots."""
    position = reading.position_of(snapshots)
    width, dims = position.sizes["particle"] - 2, position.sizes["coordinate"]
    extent = (width * dims if layout == "vector" else width, reading.count(position))
    needed = decompositions.memory_needed(*extent, method)
    check_bytes(needed, "method", f"{method!r} for {extent[0]} by {extent[1]} values, {needed / 1e9:.3g} GB")
    if layout == "normal":
        hat = np.moveaxis(pod_normal.deflections(reading.positions(snapshots)), 0, -1)
    else:
        hat, _ = lift(snapshots)
    sigma = relative_arc_length(snapshots)
    samples, particles, dims = hat.shape
    mean = hat.mean(axis=0) if center else np.zeros((particles, dims))
    inner = (hat - mean)[:, 1:-1]
    root = reading.weight_roots(sigma, weights)
    # rows of the ends are zero: leaving them out keeps them from becoming modes of their own
    if layout != "vector":
        matrices = [np.ascontiguousarray(root[:, None] * inner[:, :, c].T) for c in range(dims)]
    else:
        matrices = [np.ascontiguousarray((root[None, :, None] * inner).reshape(samples, -1).T)]
    decomposed = [decompositions.ROUTES[method](matrix) for matrix in matrices]
    values = np.stack([item[1] for item in decomposed])
    return labelled(
        [left.T.reshape(left.shape[1], particles - 2, -1) / root[:, None] for left, _ in decomposed],
        values,
        np.stack([decompositions.uncertainty(item, extent, method) for item in values]),
        np.zeros(len(values)),
        mean,
        samples,
        choice=choice,
        options={"layout": layout, "method": method, "weights": weights, "center": bool(center)},
        algorithm=decompositions.ALGORITHMS[method],
        like=snapshots,
        inputs=[snapshots],
        trained=training.range_of(snapshots),
    )


def _in_blocks(position: xr.DataArray, layout: str, rank: int | None) -> bool:
    """Tell whether snapshots are read in blocks: those in chunks, and in memory where that is faster than one matrix."""
    samples = reading.count(position)
    features = position.sizes["particle"] * (position.sizes["coordinate"] if layout == "vector" else 1)
    if reading.is_lazy(position):
        return True
    return samples >= 1000 and (
        samples >= 8 * features if features <= COMPLETE else 20 * (rank or features) <= features
    )


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
        schema.integer(least=1)("rank", rank)
        if rank > most:
            raise refuse("rank", rank, f"at most {most}, as many modes as there are")
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
        raise refuse("times", float(wanted[off][0]), "instants of the trajectory")
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
    weight = np.ones(sigma.size) if modes.attrs["weights"] == "None" else reading.shares(sigma)
    if modes.attrs["layout"] == "normal":
        position = reading.positions(snapshots)
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
