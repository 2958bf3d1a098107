"""Karhunen-Loeve decomposition (POD): snapshots -> modes; projection and reconstruction.

Snapshots are decomposed in the lifted variables of eq. (35): what is left of the position when the straight line between the
ends of the moment is taken off.  Modes vanish at both ends and live on sigma = S / L0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from cablepod._resources import check_bytes
from cablepod.errors import scene_error
from cablepod.pod import _decompositions as decompositions
from cablepod.pod import _normal as pod_normal
from cablepod.pod._blocks import count_snapshots, is_lazy
from cablepod.pod._gram import COMPLETE
from cablepod.pod._label import check_options, labelled
from cablepod.pod._snapshots import check_alike, lift, position_of, positions, relative_arc_length, weight_roots
from cablepod.pod._stream import Stream
from cablepod.pod._training_range import range_of


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
    check_alike(parts)
    if len(parts) > 1 and method != "svd":
        raise scene_error("method", method, "'svd' for several trajectories")
    if len(parts) > 1 or (method == "svd" and _in_blocks(position_of(parts[0]), layout, rank)):
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
    position = position_of(snapshots)
    width, dims = position.sizes["particle"] - 2, position.sizes["coordinate"]
    extent = (width * dims if layout == "vector" else width, count_snapshots(position))
    needed = decompositions.memory_needed(*extent, method)
    check_bytes(needed, "method", f"{method!r} for {extent[0]} by {extent[1]} values, {needed / 1e9:.3g} GB")
    if layout == "normal":
        hat = np.moveaxis(pod_normal.deflections(positions(snapshots)), 0, -1)
    else:
        hat, _ = lift(snapshots)
    sigma = relative_arc_length(snapshots)
    samples, particles, dims = hat.shape
    mean = hat.mean(axis=0) if center else np.zeros((particles, dims))
    inner = (hat - mean)[:, 1:-1]
    root = weight_roots(sigma, weights)
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
        trained=range_of(snapshots),
    )


def _in_blocks(position: xr.DataArray, layout: str, rank: int | None) -> bool:
    """Tell whether snapshots are read in blocks: those in chunks, and in memory where that is faster than one matrix."""
    samples = count_snapshots(position)
    features = position.sizes["particle"] * (position.sizes["coordinate"] if layout == "vector" else 1)
    if is_lazy(position):
        return True
    return samples >= 1000 and (
        samples >= 8 * features if features <= COMPLETE else 20 * (rank or features) <= features
    )
