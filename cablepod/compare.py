"""Error of a trajectory against a reference trajectory."""

from __future__ import annotations

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import MOTION, floats, taken
from cablepod.conventions import label
from cablepod.discretisation._interpolation import at_places
from cablepod.errors import SceneError, scene_error, shown
from cablepod.integrate._comparison import motion_scale
from cablepod.pod._snapshots import relative_arc_length

__all__ = ["errors"]


def errors(run: xr.Dataset, truth: xr.Dataset) -> xr.Dataset:
    """Compute the error of a trajectory against a reference.

    Parameters
    ----------
    run, truth
        Trajectory and reference, with ``position (time, particle, coordinate)`` [m] and ``arc_length (particle)`` [m] at the same
        instants.  If the particles differ, cubic splines in sigma = S / L0 interpolate the reference to those of the run.

    Returns
    -------
    xarray.Dataset
        ``error (time)``, the rms distance over the particles with equal weights, divided by the largest rms displacement of the
        reference from its first shape (by the chord if nothing moves); ``error_max`` and ``error_rms`` over time; and
        ``displacement_scale`` [m], the divisor.  Errors are fractions.

    Raises
    ------
    SceneError
        If instants, coordinates or members differ, or positions are missing or not finite.

    Notes
    -----
    If the run or the reference has the dimension ``member``, the errors have it too, with its coordinates.  Members of both are
    paired by their labels, also one member that was picked, as by ``isel(member=0)`` (with ``drop=True`` it has no label).

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> error = cp.compare.errors(cp.chain.simulate(scene, links=20), cp.chain.simulate(scene, links=40))
    >>> round(100 * float(error.error_max), 1)  # per cent
    0.1
    """
    run, truth = taken("run", run, MOTION), taken("truth", truth, MOTION)
    run, truth = _of_one_member(run, truth), _of_one_member(truth, run)
    if "member" in run.dims or "member" in truth.dims:
        return _member_errors(run, truth)
    _check_instants(run["time"].values, truth["time"].values)
    if list(run["coordinate"].values) != list(truth["coordinate"].values):
        raise scene_error(
            "run", list(run["coordinate"].values), f"the coordinates of the truth, {list(truth['coordinate'].values)}"
        )
    order = ("time", "particle", "coordinate")
    for name, dataset in (("run", run), ("truth", truth)):
        if set(dataset["position"].dims) != set(order):
            raise scene_error(f"{name}: position", dataset["position"].dims, f"{order}")
    position, reference = (floats(dataset["position"].transpose(*order).values) for dataset in (run, truth))
    for name, values in (("run", position), ("truth", reference)):
        if not np.isfinite(values).all():
            raise SceneError(f"{name}: position is not finite everywhere; allowed: finite numbers")
    reference = at_places(relative_arc_length(run), relative_arc_length(truth), reference)
    chord = float(np.linalg.norm(reference[0, -1] - reference[0, 0]))
    scale = motion_scale(reference, reference[0], chord)
    error = np.sqrt(np.mean(np.sum((position - reference) ** 2, axis=-1), axis=-1)) / scale
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


def _of_one_member(dataset: xr.Dataset, other: xr.Dataset) -> xr.Dataset:
    """Return a Dataset, of several members the one that was picked of the other; refuse another one."""
    own, picked = (one.coords.get("member") for one in (dataset, other))
    if own is None or picked is None or picked.ndim:
        return dataset
    found = np.flatnonzero(own.values == picked.values)
    if found.size != 1:
        given = " and ".join(shown(name.values.tolist()) for name in (own, picked))
        raise SceneError(f"run and truth: given the members {given}; allowed: the same; try: isel(..., drop=True)")
    return dataset.isel(member=int(found[0])) if own.ndim else dataset


def _check_instants(times: np.ndarray, reference: np.ndarray) -> None:
    """Refuse times [s] that differ from those of the reference."""
    if times.shape != reference.shape:
        raise SceneError(f"run: given {times.size} instants; allowed: the instants of the truth, {reference.size}")
    if not np.allclose(times, reference, rtol=1e-12, atol=1e-12):
        index = int(np.argmax(np.abs(times - reference)))
        raise SceneError(
            f"run: given instant {times[index]:g} s; allowed: the instants of the truth, here {reference[index]:g} s"
        )


def _member_errors(run: xr.Dataset, truth: xr.Dataset) -> xr.Dataset:
    """Return the errors of all members along ``member``."""
    own, of_truth = (dataset.indexes.get("member") for dataset in (run, truth))
    if own is not None and of_truth is not None and own.size == of_truth.size and not own.equals(of_truth):
        if not (own.is_unique and of_truth.is_unique and own.isin(of_truth).all()):
            raise SceneError(
                f"run: given the members {shown(list(own))}; allowed: those of the truth, {shown(list(of_truth))}"
            )
        truth = truth.isel(member=of_truth.get_indexer(own))
    count = max(run.sizes.get("member", 1), truth.sizes.get("member", 1))

    def select(dataset: xr.Dataset, i: int) -> xr.Dataset:
        """Return member `i`, or the dataset if it has no members."""
        return dataset.isel(member=i, drop=True) if "member" in dataset.dims else dataset

    if {run.sizes.get("member", count), truth.sizes.get("member", count)} != {count}:
        raise SceneError(
            f"run: given {run.sizes['member']} members; allowed: the members of the truth, {truth.sizes['member']}"
        )
    with provenance.unrecorded():
        results = [errors(select(run, i), select(truth, i)) for i in range(count)]
    joined = xr.concat(results, dim="member", data_vars="all", coords="minimal", compat="override", join="exact")
    joined.attrs = dict(results[0].attrs)
    of_members = run if "member" in run.dims else truth
    joined = joined.assign_coords({name: item for name, item in of_members.coords.items() if item.dims == ("member",)})
    return provenance.record(joined, function="compare.errors", parameters={"members": count}, inputs=[run, truth])
