"""Public function: mean and quantile of the peaks of several storms, with intervals."""

from __future__ import annotations

import math
from collections.abc import Hashable
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.errors import SceneError, scene_error, shown
from cablepod.parameters._checks import number

#: Names of the numbers of a variable -> long name.
STATISTICS = {
    "mean": "mean of {of}",
    "mean_low": "lower end of the {level:g} interval of the mean of {of}",
    "mean_high": "upper end of the {level:g} interval of the mean of {of}",
    "quantile": "{of} that is not exceeded with probability {probability:g}",
    "quantile_low": "lower end of the {level:g} interval of that quantile of {of}",
    "quantile_high": "upper end of the {level:g} interval of that quantile of {of}",
}
COUNT = "count"
#: Default probability of the quantile.
PROBABILITY = 0.78
#: Fewest peaks that tell a scatter.
LEAST = 3
#: Samples of the standard Gumbel distribution that give the intervals, the largest number of their values, and their seed.
SAMPLES, LEAST_SAMPLES, VALUES, SEED = 20_000, 2_000, 4_000_000, 1


def peaks(
    data: xr.DataArray | xr.Dataset, *, dim: str = "member", level: float = 0.9, probability: float = PROBABILITY
) -> xr.Dataset:
    """Estimate mean and quantile of the largest value of a storm from those of several storms.

    Parameters
    ----------
    data
        Largest values, one of each storm along `dim`; of a Dataset every variable of numbers along `dim`, such as
        ``tension_maximum`` of an ensemble.  Every further dimension is a sample of its own.  Failed members (nan) are left out.
        Of smallest values give the negative ones.
    dim
        Dimension along which the storms are.
    level
        Probability that an interval holds the true value.
    probability
        Probability that the quantile is not exceeded in a storm.

    Returns
    -------
    xarray.Dataset
        ``mean``, ``mean_low``, ``mean_high``, ``quantile``, ``quantile_low``, ``quantile_high`` in the units of the data, over
        its other dimensions, and ``count``, the number of peaks.  Of a Dataset these are ``tension_maximum_mean`` and so on,
        for each variable.  Samples with fewer than three peaks give nan.

    Raises
    ------
    SceneError
        For anything but a DataArray or Dataset of numbers along `dim`, for fewer than three peaks in all samples, for infinite
        numbers, and for a level or probability that is not above 0, or above 0.999 or 0.9999.

    Notes
    -----
    Peaks have a Gumbel distribution, whose scale follows from L-moments (Hosking, J. R. Stat. Soc. B 52, 1990).  Distances of the
    estimates from the true values, divided by the estimated scale, have a distribution that depends on the number of peaks alone;
    that of 20 000 standard samples gives the intervals.  The default probability is that of Cook and Mayne (J. Wind Eng. Ind.
    Aerodyn. 6, 1980) for the largest load of an hour.

    Examples
    --------
    >>> import cablepod as cp
    >>> import xarray as xr
    >>> tension = xr.DataArray([21.3, 19.8, 22.4, 20.1, 20.9, 23.6, 20.4, 21.0], dims="member", attrs={"units": "kN"})
    >>> result = cp.extremes.peaks(tension)
    >>> [round(float(result[name]), 1) for name in ("mean_low", "mean", "mean_high")]
    [20.5, 21.2, 22.3]
    """
    level = number(above=0.0, most=0.999)("level", level)
    probability = number(above=0.0, most=0.9999)("probability", probability)
    samples = _samples_of(data, dim)
    own = {f"{prefix}{name}" for prefix, _ in samples for name in (*STATISTICS, COUNT)}
    coords = {name: item for name, item in data.coords.items() if dim not in item.dims}
    if used := own & {*map(str, coords)}:
        raise SceneError(
            f"data: given one with the coordinate {min(used)}; allowed: names other than those of the result"
        )
    variables: dict[Hashable, Any] = {}
    for prefix, sample in samples:
        estimates, count, dims = _estimates(sample, dim, level, probability)
        of = sample.attrs.get("long_name", sample.name or "the peak")
        units = str(sample.attrs.get("units", "1"))
        for (name, text), values in zip(STATISTICS.items(), estimates, strict=True):
            words = text.format(of=of, level=level, probability=probability)
            variables[f"{prefix}{name}"] = (dims, values, {"units": units, "long_name": words})
        variables[f"{prefix}{COUNT}"] = (dims, count, {"units": "1", "long_name": f"number of values of {of}"})
    result = xr.Dataset(variables, coords, {"title": f"peaks of {data.attrs.get('title', 'storms')}", "stage": "peaks"})
    options = {"dim": dim, "level": level, "probability": probability}
    if isinstance(data, xr.Dataset):
        return provenance.record(result, function="extremes.peaks", parameters=options, inputs=[data])
    return provenance.record(result, function="extremes.peaks", parameters={"data": data.values, **options})


def _samples_of(data: Any, dim: str) -> list[tuple[str, xr.DataArray]]:
    """Return the prefix of the results, and the values, of each variable of numbers along `dim`."""
    if not isinstance(data, xr.DataArray | xr.Dataset):
        raise scene_error("data", data, "a DataArray or a Dataset of largest values, such as runs[['tension_maximum']]")
    if dim not in data.dims:
        raise SceneError(f"dim: given {shown(dim)}; allowed: a dimension of the data, {', '.join(map(str, data.dims))}")
    if isinstance(data, xr.DataArray):
        if data.dtype.kind not in "iuf":
            raise SceneError(f"data: given values of type {data.dtype}; allowed: numbers")
        return [("", data)]
    found = [
        (f"{name}_", values)
        for name, values in data.data_vars.items()
        if dim in values.dims and values.dtype.kind in "iuf"
    ]
    if not found:
        raise SceneError(
            f"data: given a Dataset without a variable of numbers along {dim}; allowed: one with largest values"
        )
    return found


def _estimates(
    sample: xr.DataArray, dim: str, level: float, probability: float
) -> tuple[np.ndarray, np.ndarray, tuple[Hashable, ...]]:
    """Return the numbers of :data:`STATISTICS` and the count of peaks of each sample, and their dimensions."""
    dims = tuple(name for name in sample.dims if name != dim)
    shape = tuple(sample.sizes[name] for name in dims)
    # nan last
    rows = np.sort(
        sample.transpose(*dims, dim).values.astype(float).reshape(math.prod(shape), sample.sizes[dim]), axis=1
    )
    if np.isinf(rows).any():
        raise SceneError(
            f"data: given infinite values of {sample.name or 'the peaks'}; allowed: finite numbers, nan of failed members"
        )
    count = np.isfinite(rows).sum(axis=1)
    if count.max(initial=0) < LEAST:
        raise SceneError(
            f"data: given {count.max(initial=0)} peaks of {sample.name or 'each sample'} along {dim}; allowed: at least {LEAST}"
        )
    values = np.full((len(STATISTICS), len(rows)), np.nan)
    for n in np.unique(count[count >= LEAST]).tolist():
        which = count == n
        values[:, which] = _with_intervals(rows[which, :n], level, probability)
    return values.reshape(-1, *shape), count.reshape(shape), dims


def _with_intervals(rows: np.ndarray, level: float, probability: float) -> np.ndarray:
    """Return the numbers of :data:`STATISTICS` for sorted rows without nan (6, rows)."""
    n = rows.shape[1]
    mean, scale = _moments(rows)
    # (estimate - true value) / estimated scale, of standard samples: mean Euler's constant, scale 1
    draws = max(LEAST_SAMPLES, min(SAMPLES, VALUES // n))
    standard_mean, standard_scale = _moments(np.sort(np.random.default_rng(SEED).gumbel(size=(draws, n)), axis=1))
    reduced = -np.log(-np.log(probability)) - np.euler_gamma  # quantile less mean, over the scale
    tails = np.array([0.5 + 0.5 * level, 0.5 - 0.5 * level])
    results = []
    for factor in (0.0, reduced):
        estimate = mean + factor * scale
        distance = (standard_mean + factor * standard_scale - np.euler_gamma - factor) / standard_scale
        results += [estimate, *(estimate - np.quantile(distance, tail) * scale for tail in tails)]
    return np.array(results)


def _moments(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean, and the scale of a Gumbel distribution by the second L-moment over log 2, of sorted rows."""
    n = rows.shape[1]
    mean = rows.mean(axis=1)
    weights = np.arange(n) / (n - 1) / n
    # from the mean: a small scatter about a large mean keeps its digits
    return mean, 2.0 * ((rows - mean[:, None]) @ weights) / np.log(2.0)
