"""Public functions: rainflow cycles of a series, equivalent range."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs._taken import powers
from cablepod.conventions import is_rising
from cablepod.errors import CoarseWarning, SceneError, scene_error, shown, warn
from cablepod.parameters._checks import number

#: Variables of the cycles -> units, or whose, and long name.
LABELS = {
    "cycle_range": ("series", "range of the cycle of {of}"),
    "cycle_mean": ("series", "mean of the cycle of {of}"),
    "cycle_count": ("1", "1 for a whole cycle, 0.5 for half a cycle"),
    "cycle_start": ("dim", "{dim} at which the cycle begins"),
    "cycle_end": ("dim", "{dim} at which the cycle ends"),
}
#: Exponent of the S-N curve and frequency [Hz] of equivalent ranges, also of those that studies and ensembles give.
EXPONENT, FREQUENCY = 4.0, 1.0
#: Maximum part of the equivalent range that half of the instants may miss: a shipped mast misses 6.5 % so, and 3 % at all
#: instants; the damage by an exponent of 4 lacks four times as much.
MAX_LOSS = 0.08
#: Minimum number of instants from which this is asked.
MIN_INSTANTS = 32


def ranges(series: xr.DataArray, *, dim: str = "time") -> xr.Dataset:
    """Count the cycles of a series by the rainflow method of ASTM E1049.

    Parameters
    ----------
    series
        Numbers along `dim`, such as the tension of a link.  Every further dimension (``member``, ``link``) is a series of its
        own.  A series without any number, that of a failed member, has no cycles.
    dim
        Dimension along which the series runs.

    Returns
    -------
    xarray.Dataset
        Along ``cycle``, in the order in which the method closes them: ``cycle_range`` and ``cycle_mean`` in the units of the
        series, ``cycle_count``, 1 for a cycle and 0.5 for half a cycle, ``cycle_start`` and ``cycle_end``, values of the
        coordinate `dim` (numbers of samples without one, of dates seconds from the first).  Series with fewer cycles than
        others are filled with nan and the count 0.

    Raises
    ------
    SceneError
        For anything but a DataArray with the dimension `dim`, for fewer than two samples, for numbers that are not finite, for a
        coordinate `dim` that does not rise, and for dimensions and coordinates with names of the result.

    Notes
    -----
    ASTM E1049-85, Standard practices for cycle counting in fatigue analysis, section 5.4.4.  The first and the last sample count
    as reversals.

    Examples
    --------
    >>> import cablepod as cp
    >>> import xarray as xr
    >>> series = xr.DataArray([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0], dims="time")  # of the standard
    >>> cycles = cp.fatigue.ranges(series)
    >>> cycles.cycle_range.values.tolist(), cycles.cycle_count.values.tolist()
    ([3.0, 4.0, 4.0, 8.0, 9.0, 8.0, 6.0], [0.5, 0.5, 1.0, 0.5, 0.5, 0.5, 0.5])
    """
    from xarray.indexes import PandasIndex

    from cablepod.fatigue import _kernels_rainflow as kernel  # numba is imported only to compute

    rows, size, dims = _rows(series, dim)
    if own := {"cycle", *LABELS} & {*dims, *series.coords} - {dim}:
        raise SceneError(
            f"series: given one with {min(own)}; allowed: names other than those of the result; try: rename"
        )
    pairs, counts = np.empty((*rows.shape, 2), np.int32), np.empty(len(rows), np.int64)
    kernel.all_cycles(rows, pairs, counts)
    counts[np.isnan(size)] = 0
    most = int(counts.max(initial=0))
    places, units_of_places = _places(series, dim)
    filled = np.empty((len(LABELS), len(rows), most))
    kernel.tables(rows, places, pairs, counts, filled)
    of = series.attrs.get("long_name", series.name or "the series")
    units = {"series": str(series.attrs.get("units", "1")), "dim": units_of_places or "1"}
    shape = (*(series.sizes[name] for name in dims), most)
    index = PandasIndex(np.arange(1, most + 1), "cycle")
    variables = {
        name: xr.Variable(
            (*dims, "cycle"),
            table.reshape(shape),
            {"units": units.get(unit, unit), "long_name": text.format(of=of, dim=dim)},
            fastpath=True,
        )
        for (name, (unit, text)), table in zip(LABELS.items(), filled, strict=True)
    }
    variables |= index.create_variables() | {name: series.coords.variables[name] for name in _without(series, dim)}
    variables["cycle"].attrs = {"units": "1", "long_name": "number of the cycle"}
    indexes = {name: kept for name, kept in series.xindexes.items() if name in variables}
    # twice as fast as a Dataset of variables and coordinates, which xarray aligns
    result = xr.Coordinates(variables, indexes={**indexes, "cycle": index}).to_dataset().reset_coords(list(LABELS))
    result.attrs.update(title=f"rainflow cycles of {of}", stage="cycles")
    return provenance.record(result, function="fatigue.ranges", parameters={"series": rows, "dim": dim})


def equivalent(
    series: xr.DataArray, *, exponent: float = EXPONENT, frequency: float = FREQUENCY, dim: str = "time"
) -> xr.DataArray:
    """Compute the constant range of the same fatigue damage.

    Parameters
    ----------
    series
        Numbers along `dim`, as in :func:`ranges`, with the coordinate `dim` [s], or dates or differences of times.
    exponent
        Exponent m of the S-N curve, damage per cycle proportional to range^m.
    frequency
        Frequency [Hz] of the constant range.
    dim
        Dimension along which the series runs.

    Returns
    -------
    xarray.DataArray
        Equivalent range in the units of the series, over its other dimensions: (sum of count range^m / cycles)^(1/m), where
        cycles is the frequency times the duration from the first to the last sample.  Series without any number give nan.

    Raises
    ------
    SceneError
        As :func:`ranges`, for an exponent or frequency that is not positive, and for a coordinate that does not rise or has
        units other than s.

    Notes
    -----
    By Palmgren and Miner's rule: cycles of this range at `frequency` do the damage of all counted cycles in the same time.

    Examples
    --------
    >>> import cablepod as cp
    >>> import numpy as np
    >>> import xarray as xr
    >>> time = np.arange(0.0, 100.25, 0.25)
    >>> series = xr.DataArray(3.0 * np.sin(2.0 * np.pi * time), dims="time", coords={"time": time})
    >>> round(float(cp.fatigue.equivalent(series, frequency=1.0)), 3)
    5.993
    """
    m, reference = number(above=0.0)("exponent", exponent), number(above=0.0)("frequency", frequency)
    scale, sums, dims = _damage_sums(series, m, dim)
    place = _instants(series, dim)
    values = scale * (sums / (reference * (place[-1] - place[0]))) ** (1.0 / m)
    of = series.attrs.get("long_name", series.name or "the series")
    attrs = {
        "units": str(series.attrs.get("units", "1")),
        "long_name": f"equivalent range of {of}",
        "exponent": float(m),
        "frequency": float(reference),
    }
    return _of_series(series, values, dims, attrs)


def _instants(series: xr.DataArray, dim: str) -> np.ndarray:
    """Return the coordinate of a series [s], of dates from the first on."""
    if dim not in series.coords.variables:
        raise SceneError(f"series: given one without the coordinate {dim}; allowed: a DataArray with {dim} [s]")
    places, units = _places(series, dim)
    if units is not None and units != "s" and powers(units) != {"s": 1}:
        raise SceneError(f"series: given a coordinate {dim} in {units}; allowed: {dim} [s]")
    return places


def _places(series: xr.DataArray, dim: str) -> tuple[np.ndarray, str | None]:
    """Return the rising coordinate of a series with its units, None without; of dates seconds from the first on."""
    label = series.coords.variables.get(dim)
    if label is None:
        return np.arange(series.sizes[dim], dtype=float), "1"
    places, units = label.values, label.attrs.get("units")
    if places.dtype.kind in "mM":
        places, units = (places - places[0]) / np.timedelta64(1, "s"), "s"
    if places.dtype.kind not in "fiu":
        raise SceneError(f"series: given a coordinate {dim} of type {places.dtype}; allowed: numbers or dates, or none")
    places = places.astype(float)
    if not is_rising(places) or not np.isfinite(places[[0, -1]]).all():
        raise SceneError(
            f"series: given a coordinate {dim} that does not rise; allowed: increasing, finite instants [s]"
        )
    return places, None if units is None else str(units)


def damage(
    series: xr.DataArray, *, slope: float, reference_range: float, reference_cycles: float = 2e6, dim: str = "time"
) -> xr.DataArray:
    """Compute Miner's sum of a series: the part of the life that its cycles take.

    Parameters
    ----------
    series
        Numbers along `dim`, as in :func:`ranges`.
    slope
        Slope m of the S-N curve, whose cycles to failure fall as range^-m.
    reference_range
        Range, in the units of the series, that fails after `reference_cycles`: for tensions the detail category of the strand
        times its metallic area.
    reference_cycles
        Cycles of the reference range to failure.
    dim
        Dimension along which the series runs.

    Returns
    -------
    xarray.DataArray
        Sum of count (range / reference range)^m / reference cycles [1] over the other dimensions of the series; 1 is failure.
        Series without any number give nan.

    Raises
    ------
    SceneError
        As :func:`ranges`, and for a slope, range or number of cycles that is not positive.

    Notes
    -----
    Palmgren and Miner's rule with one slope and no cut-off: small cycles count too.

    Examples
    --------
    >>> import cablepod as cp
    >>> import numpy as np
    >>> import xarray as xr
    >>> series = xr.DataArray(np.tile([0.0, 2e3], 500), dims="time", attrs={"units": "N"})
    >>> round(1e6 * float(cp.fatigue.damage(series, slope=3, reference_range=1e3)), 3)  # 499.5 cycles of 2 kN
    1998.0
    """
    m = number(above=0.0)("slope", slope)
    size = number(above=0.0)("reference_range", reference_range)
    cycles = number(above=0.0)("reference_cycles", reference_cycles)
    scale, sums, dims = _damage_sums(series, m, dim)
    with np.errstate(over="ignore"):  # more than the largest number is failure as well
        values = (scale / size) ** m * sums / cycles
    of = series.attrs.get("long_name", series.name or "the series")
    attrs = {
        "units": "1",
        "long_name": f"fatigue damage by {of}",
        "slope": float(m),
        "reference_range": float(size),
        "reference_cycles": float(cycles),
    }
    return _of_series(series, values, dims, attrs)


def warn_of_cut_cycles(series: xr.DataArray, exponent: float, of: str) -> None:
    """Warn where instants are so far apart that rainflow cycles lose their peaks.

    What every second instant misses of the equivalent range is one to two times what all instants miss of that of the motion.

    Parameters
    ----------
    series
        Numbers along ``time`` at equally spaced instants; every further dimension is a series of its own.
    exponent
        Exponent of the S-N curve.
    of
        What is too low then, for the message.
    """
    if series.sizes["time"] < MIN_INSTANTS:
        return
    ranges = []
    for step in (1, 2):
        some = series.isel(time=slice(None, None, step))
        scale, sums, _ = _damage_sums(some, exponent, "time")
        ranges.append(scale * sums ** (1.0 / exponent))
    with np.errstate(invalid="ignore", divide="ignore"):
        loss = 1.0 - np.divide(ranges[1], ranges[0])
    largest = float(np.nanmax(loss, initial=0.0))
    if largest > MAX_LOSS:
        interval = float(series["time"].values[1] - series["time"].values[0])
        warn(
            f"time.interval: {interval:g} s cuts cycles: at every second instant the equivalent range of a tension falls by "
            f"{100.0 * largest:.2g} %, so that {of} is likely too low by half of that or more; try: time.interval = "
            f"{0.25 * interval:.2g} s",
            CoarseWarning,
        )


def _damage_sums(series: Any, exponent: float, dim: str) -> tuple[np.ndarray, np.ndarray, tuple[Hashable, ...]]:
    """Return the scale of each series, the sum of count (range / scale)^exponent, nan without any number, and the dimensions."""
    from cablepod.fatigue import _kernels_rainflow as kernel

    rows, size, dims = _rows(series, dim)
    _places(series, dim)
    scale = np.where(size > 0.0, size, 1.0)  # ranges of the order of one neither overflow nor underflow
    sums = np.empty(len(rows))
    # products are ten times as fast as powers
    power = int(exponent) if float(exponent).is_integer() and exponent < 100 else float(exponent)
    kernel.damage_sums(rows, scale, power, sums)
    sums[np.isnan(size)] = np.nan
    return scale, sums, dims


def _of_series(
    series: xr.DataArray, values: np.ndarray, dims: tuple[Hashable, ...], attrs: dict[str, Any]
) -> xr.DataArray:
    """Return a number of each series over its other dimensions."""
    shaped = values.reshape([series.sizes[name] for name in dims])
    (dim,) = set(series.dims) - set(dims)
    coords = {name: series.coords[name] for name in _without(series, dim)}
    return xr.DataArray(shaped, dims=dims, coords=coords, attrs=attrs)


def _rows(series: Any, dim: str) -> tuple[np.ndarray, np.ndarray, tuple[Hashable, ...]]:
    """Return the series as rows (rows, n), the largest size in each, and the other dimensions."""
    if not isinstance(series, xr.DataArray):
        raise scene_error(
            "series", series, 'a DataArray, such as run.tension.isel(link=-1), or xr.DataArray(values, dims="time")'
        )
    if dim not in series.dims:
        raise SceneError(
            f"dim: given {shown(dim)}; allowed: a dimension of the series, {', '.join(map(str, series.dims))}"
        )
    if series.dtype.kind not in "iuf":
        raise SceneError(f"series: given values of type {series.dtype}; allowed: numbers")
    if series.sizes[dim] < 2:
        raise SceneError(f"series: given {series.sizes[dim]} samples along {dim}; allowed: at least 2")
    dims = tuple(name for name in series.dims if name != dim)
    rows = np.ascontiguousarray(series.variable.transpose(*dims, dim).values, dtype=float).reshape(
        -1, series.sizes[dim]
    )
    size = np.maximum(rows.max(axis=1), -rows.min(axis=1))
    if not np.isfinite(size).all():
        finite = np.isfinite(rows)
        wrong = ~finite.all(axis=1) & ~np.isnan(rows).all(axis=1)
        if wrong.any():
            place = int(np.argmin(finite[int(np.argmax(wrong))]))
            raise SceneError(
                f"series: given a value that is not finite at sample {place} along {dim}; allowed: finite numbers"
            )
    return rows, size, dims


def _without(series: xr.DataArray, dim: Hashable) -> list[Hashable]:
    """Return the names of the coordinates that do not run along `dim`."""
    return [name for name, variable in series.coords.variables.items() if dim not in variable.dims]
