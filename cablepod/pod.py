"""Karhunen-Loeve decomposition (POD): snapshots -> modes; projection and reconstruction.

Snapshots are decomposed in the lifted variables of eq. (35): what is left of the position when the straight line between the
ends of the moment is taken off.  Modes vanish at both ends and live on sigma = S / L0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod import decompositions, pod_normal, provenance, schema, training
from cablepod.conventions import ENDS, label
from cablepod.parameters import check_bytes
from cablepod.schema import SceneError, refuse

LAYOUTS = ("separate", "vector", "normal")
METHODS = tuple(decompositions.ROUTES)
WEIGHTS = (None, "length", "mass")


def decompose(
    snapshots: xr.Dataset,
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
        order; further dimensions such as ``member`` count as more snapshots.
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
        the last digits; "covariance", eigenvectors of the (n, n) covariance matrix, eq. (29), the fastest for many snapshots;
        "snapshots", Sirovich's, eigenvectors of an (m, m) matrix, for few snapshots of very many particles.  The last two
        square the data: below 10^-8 of the largest singular value they give noise.
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
        ``singular_value_share`` (over all singular values computed), ``singular_value_uncertainty`` [m], an estimate of what
        rounding on the chosen route may do, and ``mean (particle, coordinate)`` [m].  The first entry of a mode that reaches
        half its largest is positive.

    Raises
    ------
    SceneError
        For options that cannot be and snapshots that are not finite or too few.
    """
    for key, value, allowed in (
        ("layout", layout, LAYOUTS),
        ("method", method, METHODS),
        ("weights", weights, WEIGHTS),
    ):
        if value not in allowed:
            raise refuse(key, value, "one of " + ", ".join(repr(item) for item in allowed))
    if rank is not None and energy is not None:
        raise refuse("rank and energy", (rank, energy), "one of them")
    if layout == "normal":
        hat = np.moveaxis(pod_normal.deflections(_positions(snapshots)), 0, -1)
        center = False
    else:
        hat, _ = lift(snapshots)
    sigma = relative_arc_length(snapshots)
    samples, particles, dims = hat.shape
    mean = hat.mean(axis=0) if center else np.zeros((particles, dims))
    inner = (hat - mean)[:, 1:-1]
    scale = np.ones(particles) if weights is None else _share(sigma)
    root = np.sqrt(scale[1:-1])
    # rows of the ends are zero: leaving them out keeps them from becoming modes of their own
    if layout != "vector":
        matrices = [np.ascontiguousarray(root[:, None] * inner[:, :, c].T) for c in range(dims)]
    else:
        matrices = [np.ascontiguousarray((root[None, :, None] * inner).reshape(samples, -1).T)]
    extent = matrices[0].shape
    needed = decompositions.memory_needed(extent[0], extent[1], method)
    check_bytes(needed, "method", f"{method!r} for {extent[0]} by {extent[1]} values, {needed / 1e9:.3g} GB")
    decomposed = [decompositions.ROUTES[method](matrix) for matrix in matrices]
    values = np.stack([item[1] for item in decomposed])
    unsure = np.stack([decompositions.uncertainty(item, extent, method) for item in values])
    kept = _count(values, rank, energy, samples - bool(center))
    shapes = []
    for left, _ in decomposed:
        modes = left[:, :kept].T
        field = modes.reshape(kept, particles - 2, -1) / root[None, :, None]
        shapes.append(np.pad(_fix_sign(field), ((0, 0), (1, 1), (0, 0))))
    squares = values**2
    lead = ("coordinate",) if layout == "separate" else ()

    def share(part: np.ndarray) -> np.ndarray:
        total = part.sum(axis=1, keepdims=True)
        return np.divide(part, total, out=np.zeros_like(part), where=total > 0)

    shape = np.stack([item[:, :, 0] for item in shapes]) if layout != "vector" else shapes[0][None]
    shape_dims = ("mode", "particle", "coordinate") if layout == "vector" else (*lead, "mode", "particle")
    tables = {
        "singular_value": values,
        "singular_value_uncertainty": unsure,
        "proper_orthogonal_value": squares / samples,
        "energy_share": share(squares),
        "singular_value_share": share(values),
    }
    variables: dict[str, Any] = {}
    for i, suffix in enumerate(pod_normal.SETS[:dims] if layout == "normal" else ("",)):
        pick = slice(None) if lead else i
        variables[f"mode_shape{suffix}"] = (shape_dims, shape[pick])
        variables |= {f"{name}{suffix}": ((*lead, "mode"), table[:, :kept][pick]) for name, table in tables.items()}
    if layout != "normal":
        variables["mean"] = (("particle", "coordinate"), mean)
    variables["unstretched_length"] = ((), _arc_length(snapshots)[-1])
    result = xr.Dataset(
        variables,
        coords={
            "mode": np.arange(1, kept + 1),
            "coordinate": snapshots["coordinate"].values,
            "arc_length": ("particle", _arc_length(snapshots)),
        },
    )
    label(training.gather(result, snapshots))
    result.attrs.update(
        title=f"{snapshots.attrs.get('title', 'snapshots')}: Karhunen-Loeve modes",
        stage="modes",
        layout=layout,
        method=method,
        weights=str(weights),
        number_of_snapshots=samples,
    )
    options: dict[str, Any] = {
        "rank": kept,
        "layout": layout,
        "method": method,
        "weights": weights,
        "center": bool(center),
        "snapshots": samples,
    }
    return provenance.record(result, function="pod.decompose", parameters=options, inputs=[snapshots])


def _count(values: np.ndarray, rank: int | None, energy: float | None, most: int) -> int:
    most = min(values.shape[1], most)
    if most < 1:
        raise SceneError("snapshots: given one instant; allowed: at least two, because the time mean is taken off")
    if rank is not None:
        schema.integer(least=1)("rank", rank)
        if rank > most:
            raise refuse("rank", rank, f"at most {most}, as many as particles and snapshots give")
        return int(rank)
    if energy is None:
        return most
    schema.number(above=0.0, most=1.0)("energy", energy)
    needed = 1
    for squares in values**2:
        if squares.sum() > 0.0:
            gathered = np.cumsum(squares) / squares.sum()
            needed = max(needed, int(np.searchsorted(gathered, energy * (1.0 - 1e-15))) + 1)
    return min(needed, most)


def _fix_sign(field: np.ndarray) -> np.ndarray:
    """Turn each mode (modes, particles, dims) so that its first entry of at least half the largest size is positive."""
    flat = field.reshape(len(field), -1)
    size = np.abs(flat)
    first = np.argmax(size >= 0.5 * size.max(axis=1, keepdims=True), axis=1)
    sign = np.where(flat[np.arange(len(flat)), first] < 0.0, -1.0, 1.0)
    return field * sign[:, None, None]


def _arc_length(snapshots: xr.Dataset) -> np.ndarray:
    s = snapshots["arc_length"]
    return s.values if s.ndim == 1 else s.transpose("particle", ...).values.reshape(s.sizes["particle"], -1)[:, 0]


def relative_arc_length(dataset: xr.Dataset) -> np.ndarray:
    """Return sigma = S / L0 of the particles, from 0 to 1."""
    s = _arc_length(dataset)
    return s / s[-1]


def _share(sigma: np.ndarray) -> np.ndarray:
    """Return the length that each particle carries, scaled to mean 1 over the inner particles."""
    step = np.diff(sigma)
    share = 0.5 * np.concatenate([step[:1], step[:-1] + step[1:], step[-1:]])
    return share / share[1:-1].mean()


def lift(snapshots: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Take the straight line between the ends off the positions, eq. (35).

    Returns
    -------
    tuple
        Lifted positions (samples, particle, coordinate) and positions of the ends (samples, 2, coordinate) [m].

    Raises
    ------
    SceneError
        Where positions are missing or not finite.
    """
    position = _positions(snapshots)
    sigma = relative_arc_length(snapshots)[None, :, None]
    ends = position[:, (0, -1)]
    return position - (1.0 - sigma) * ends[:, :1] - sigma * ends[:, 1:], ends


def _positions(snapshots: xr.Dataset) -> np.ndarray:
    """Positions (samples, particle, coordinate) [m] of a trajectory, all its further dimensions counted as samples."""
    if "position" not in snapshots or "arc_length" not in snapshots.variables:
        raise SceneError("snapshots: given a Dataset without position or arc_length; allowed: a trajectory")
    for name in ("time", "particle", "coordinate"):
        if name not in snapshots["position"].dims:
            raise SceneError(f"snapshots: position lacks the dimension {name}; allowed: (time, particle, coordinate)")
    position = snapshots["position"].transpose(..., "time", "particle", "coordinate").values
    position = position.reshape(-1, *position.shape[-2:]).astype(float)
    if not np.isfinite(position).all():
        raise SceneError("snapshots: position is not finite everywhere; allowed: finite numbers")
    if position.shape[1] < 3:
        raise SceneError(
            f"snapshots: given {position.shape[1]} particles; allowed: at least 3, because modes vanish at both ends"
        )
    return position


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
    weight = np.ones(sigma.size) if modes.attrs["weights"] == "None" else _share(sigma)
    if modes.attrs["layout"] == "normal":
        position = _positions(snapshots)
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
