"""Two trajectories -> the error of one against the other."""

from __future__ import annotations

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.conventions import label
from cablepod.errors import SceneError, scene_error
from cablepod.integrate._step_control import motion_scale
from cablepod.pod._snapshots import relative_arc_length

__all__ = ["errors"]


def errors(run: xr.Dataset, truth: xr.Dataset) -> xr.Dataset:
    """Measure the error of a run against a truth.

    Parameters
    ----------
    run, truth
        Trajectories with ``position (time, particle, coordinate)`` [m] and ``arc_length (particle)`` [m] on the same instants.
        The truth is interpolated to the particles of the run in sigma = S / L0, by cubic splines where they differ.

    Returns
    -------
    xarray.Dataset
        ``error (time)``: rms distance over the particles, all counted alike, divided by the largest rms displacement of the
        truth from its first shape (by the chord where nothing moves); ``error_max`` and ``error_rms`` over time, all
        fractions; ``displacement_scale`` [m], the divisor.

    Raises
    ------
    SceneError
        Where instants or coordinates differ, or positions are missing or not finite.

    Notes
    -----
    With a dimension ``member`` on either side the errors have it too.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> error = cp.compare.errors(cp.chain.simulate(scene, links=20), cp.chain.simulate(scene, links=40))
    >>> round(100 * float(error.error_max), 1)  # per cent
    0.1
    """
    for name, dataset in (("run", run), ("truth", truth)):
        if "position" not in dataset or "arc_length" not in dataset.variables:
            raise SceneError(f"{name}: given a Dataset without position or arc_length; allowed: a trajectory")
    if "member" in run.dims or "member" in truth.dims:
        return _of_members(run, truth)
    _check_instants(run["time"].values, truth["time"].values)
    if list(run["coordinate"].values) != list(truth["coordinate"].values):
        raise scene_error(
            "run", list(run["coordinate"].values), f"the coordinates of the truth, {list(truth['coordinate'].values)}"
        )
    order = ("time", "particle", "coordinate")
    x, y = (dataset["position"].transpose(*order).values for dataset in (run, truth))
    for name, position in (("run", x), ("truth", y)):
        if not np.isfinite(position).all():
            raise SceneError(f"{name}: position is not finite everywhere; allowed: finite numbers")
    y = _at(relative_arc_length(run), relative_arc_length(truth), y)
    chord = float(np.linalg.norm(y[0, -1] - y[0, 0]))
    scale = motion_scale(y, y[0], chord)
    error = np.sqrt(np.mean(np.sum((x - y) ** 2, axis=-1), axis=-1)) / scale
    result = xr.Dataset(
        {
            "error": ("time", error),
            "error_max": ((), error.max()),
            "error_rms": ((), np.sqrt(np.mean(error**2))),
            "displacement_scale": ((), scale),
        },
        coords={"time": run["time"].values},
    )
    label(result)
    result.attrs.update(
        title=f"error of {run.attrs.get('title', 'a run')} against {truth.attrs.get('title', 'a truth')}",
        stage="comparison",
    )
    return provenance.record(result, function="compare.errors", parameters={}, inputs=[run, truth])


def _check_instants(a: np.ndarray, b: np.ndarray) -> None:
    if a.shape != b.shape:
        raise SceneError(f"run: given {a.size} instants; allowed: the instants of the truth, {b.size}")
    if not np.allclose(a, b, rtol=1e-12, atol=1e-12):
        where = int(np.argmax(np.abs(a - b)))
        raise SceneError(f"run: given instant {a[where]:g} s; allowed: the instants of the truth, here {b[where]:g} s")


def _at(sigma: np.ndarray, own: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Interpolate positions (time, particle, coordinate) from `own` to `sigma`."""
    if sigma.shape == own.shape and np.abs(sigma - own).max() <= 1e-9:
        return position
    from scipy.interpolate import CubicSpline  # equal particles need no spline

    return CubicSpline(own, position, axis=1)(sigma)


def _of_members(run: xr.Dataset, truth: xr.Dataset) -> xr.Dataset:
    count = max(run.sizes.get("member", 1), truth.sizes.get("member", 1))

    def pick(dataset: xr.Dataset, i: int) -> xr.Dataset:
        return dataset.isel(member=i, drop=True) if "member" in dataset.dims else dataset

    if {run.sizes.get("member", count), truth.sizes.get("member", count)} != {count}:
        raise SceneError(
            f"run: given {run.sizes['member']} members; allowed: the members of the truth, {truth.sizes['member']}"
        )
    results = [errors(pick(run, i), pick(truth, i)) for i in range(count)]
    joined = xr.concat(results, dim="member", data_vars="all", coords="minimal", compat="override", join="exact")
    joined.attrs = dict(results[0].attrs)
    return provenance.record(joined, function="compare.errors", parameters={"members": count}, inputs=[run, truth])
