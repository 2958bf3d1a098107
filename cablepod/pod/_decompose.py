"""Karhunen-Loeve decomposition (POD): snapshots -> modes; projection and reconstruction.

Snapshots are decomposed in the lifted variables of eq. (35): the position minus the straight line between the instantaneous ends.
Modes vanish at both ends and are functions of sigma = S / L0.  The SVD is in ``_svd_methods.py``, shares of energy and the choice
of the rank are in ``_label.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from cablepod._inputs import SNAPSHOTS, several
from cablepod._resources import check_bytes, defer_sigint_during_dask
from cablepod.errors import scene_error
from cablepod.parameters._checks import truth
from cablepod.pod import _normal as pod_normal
from cablepod.pod import _svd_methods as svd_methods
from cablepod.pod._blocks import count_snapshots, is_lazy, read_rows
from cablepod.pod._graded_svd import COMPLETE
from cablepod.pod._label import check_options, labelled
from cablepod.pod._snapshots import check_same_particles, position_of, positions, relative_arc_length, weight_roots
from cablepod.pod._stream import Stream, add_checked
from cablepod.pod._training_range import range_of

#: Maximum bytes of lazy snapshots that are read at once instead of in blocks.
MAX_LOADED_BYTES = 1 << 17


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
        order; further dimensions such as ``member`` count as more snapshots.  With "svd", also several trajectories of any
        lengths on the same particles (S / L0).
    rank
        Number of modes to keep, for each coordinate in layout "separate"; all by default.
    energy
        Keep the smallest number of modes with this fraction of the sum of squared singular values, in (0, 1], of each coordinate
        or deflection that moves.
    layout
        "separate": modes for each coordinate, as in the paper; "vector": one set of modes for all coordinates; "normal": modes of
        the deflection normal to the instantaneous chord, for :mod:`cablepod.condensed`, in spatial scenes with a second set out
        of the plane of chord and vertical.
    method
        One of the three methods of section 5.1 of the paper: "svd", the singular value decomposition of the data, eq. (30);
        "covariance", eigenvectors of the (n, n) covariance matrix, eq. (29); "snapshots", the method of Sirovich, eigenvectors of
        an (m, m) matrix, for few snapshots of very many particles.  The last two square the data: singular values below 10^-8 of
        the largest are noise.  With "svd", many snapshots and lazy data (as of ``archive.read(path, chunks=...)``) are read once,
        in blocks, by :class:`cablepod.pod.Stream`; the attribute ``algorithm`` names the algorithm used.
    weights
        Weights of the particles in the inner product: None for equal weights, as in the paper; "length" for the tributary
        unstretched length, "mass" for the mass, scaled to mean 1.  Both are the same unless particles have masses of their own
        (coordinate ``particle_mass``: ``chain.masses``, segments, attachments).
    center
        Subtract the time mean first.  Layout "normal" is never centred.

    Returns
    -------
    xarray.Dataset
        ``mode_shape (coordinate, mode, particle)`` and ``singular_value (coordinate, mode)`` [m] of the centred, lifted data
        matrix.  Layout "vector" has ``mode_shape (mode, particle, coordinate)`` and ``singular_value (mode)``.  Layout "normal"
        has ``mode_shape (mode, particle)`` and ``singular_value (mode)``, in space also with the suffix ``_out_of_plane``.
        Further variables are ``proper_orthogonal_value`` (squared singular value over the number of snapshots) [m^2],
        ``energy_share``, ``singular_value_share`` (of the sum of all singular values) and ``mean (particle, coordinate)`` [m].
        Error measures are ``truncation_error``, the square root of the energy fraction outside the modes;
        ``singular_value_uncertainty`` [m], an estimate of the error of the method; and ``mode_uncertainty`` [rad], the resulting
        angular error of the mode, which grows as neighbouring singular values come close.  The first entry of a mode of at least
        half its maximum is positive.

    Raises
    ------
    SceneError
        If an option is invalid, or snapshots are not finite or too few.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> modes = cp.pod.decompose(cp.chain.simulate(scene), rank=2)
    >>> modes.singular_value.dims, modes.singular_value.sel(coordinate="x").values.round(2).tolist()
    (('coordinate', 'mode'), [7.05, 0.03])
    """
    check_options(layout, method, weights, rank, energy)
    center = truth("center", center)
    parts = several("snapshots", snapshots, SNAPSHOTS)
    check_same_particles(parts)
    parts = [_in_memory(part) for part in parts]
    if len(parts) > 1 and method != "svd":
        raise scene_error("method", method, "'svd' for several trajectories")
    if len(parts) > 1 or (method == "svd" and _use_stream(position_of(parts[0]), layout, rank)):
        stream = Stream(layout=layout, weights=weights, center=center)
        for part in parts:
            add_checked(stream, part)
        return stream.modes(rank=rank, energy=energy, function="pod.decompose")
    return _decompose_matrix(parts[0], (rank, energy), layout, method, weights, center and layout != "normal")


def _in_memory(snapshots: xr.Dataset) -> xr.Dataset:
    """Return snapshots that are lazy and few in memory, where no bit of the modes depends on their chunks."""
    position = position_of(snapshots)
    if not is_lazy(position) or position.nbytes > MAX_LOADED_BYTES:
        return snapshots
    with defer_sigint_during_dask(snapshots):
        return snapshots.assign(position=position.compute())


def _decompose_matrix(
    snapshots: xr.Dataset,
    choice: tuple[int | None, float | None],
    layout: str,
    method: str,
    weights: str | None,
    center: bool,
) -> xr.Dataset:
    """Decompose the data matrix of all snapshots; `choice` is (rank, energy)."""
    position = position_of(snapshots)
    width, dims = position.sizes["particle"] - 2, position.sizes["coordinate"]
    shape = (width * dims if layout == "vector" else width, count_snapshots(position))
    needed = svd_methods.memory_needed(*shape, method)
    check_bytes(needed, "method", f"{method!r} for {shape[0]} by {shape[1]} values, {needed / 1e9:.3g} GB")
    found = positions(snapshots)
    root = None if weights is None else weight_roots(snapshots, weights)
    reference = pod_normal.reference_of(found) if layout == "normal" else None
    parts = [*read_rows(found, relative_arc_length(snapshots), root, layout, reference)]
    rows = np.concatenate(parts, axis=1)  # (matrix, samples, features)
    means = rows.mean(axis=1) if center else np.zeros((len(rows), rows.shape[2]))
    rows -= means[:, None]
    decomposed = [svd_methods.ROUTES[method](matrix.T) for matrix in rows]
    values = np.stack([singular_values for _, singular_values in decomposed])
    return labelled(
        [left for left, _ in decomposed],
        values,
        np.stack([svd_methods.uncertainty(row, shape, method) for row in values]),
        np.zeros(len(values)),
        list(means),
        shape[1],
        choice=choice,
        options={"layout": layout, "method": method, "weights": weights, "center": bool(center)},
        algorithm=svd_methods.ALGORITHMS[method],
        like=snapshots,
        inputs=[snapshots],
        trained=range_of(snapshots),
        reference=reference,
    )


def _use_stream(position: xr.DataArray, layout: str, rank: int | None) -> bool:
    """Tell whether reading in blocks is required (lazy data) or faster than one matrix."""
    samples = count_snapshots(position)
    features = position.sizes["particle"] * (position.sizes["coordinate"] if layout == "vector" else 1)
    if is_lazy(position):
        return True
    return samples >= 1000 and (
        samples >= 8 * features if features <= COMPLETE else 20 * (rank or features) <= features
    )
