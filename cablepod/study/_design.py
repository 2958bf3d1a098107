"""Storms from all directions and of all speeds on a mast or a guy, and the numbers that a design needs."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import archive, mast, provenance
from cablepod._inputs import check_units, taken
from cablepod.archive._folder import new_results, path_of
from cablepod.errors import MemberFailedWarning, SceneError, scene_error, shown
from cablepod.integrate._request import check_progress
from cablepod.mast._runs import warn_of_late_breaks
from cablepod.parameters._checks import integer, number, numbers_list, truth
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._mast import mast_parameters
from cablepod.scene._mast import scene_kind
from cablepod.scene._warnings import without_warnings
from cablepod.study._design_numbers import CABLE, MAST, joined, with_damage, with_peaks, with_rest
from cablepod.study._design_tables import TABLES, write_tables

#: Files of a study in its folder: storms, result.
STORMS, RESULT = "storms", "design.nc"
#: Maximum number of storms in a file of the folder: what a run that is killed loses on each core.
MAX_BATCH = 20
#: Maximum number of storms that follow one another in a mean wind: they share the rest of mast and guys and the coherence of the
#: wind, and the next mean wind shares their random phases (:func:`cablepod.wind._turbulence._phases`).
STORMS_TOGETHER = 10
#: Digits to which components of directions are rounded, so that those along an axis have no component across it.
DIGITS = 15


def design(
    scene: xr.Dataset,
    *,
    directions: Any,
    speeds: Any,
    storms: int,
    out: str | os.PathLike[str] | None = None,
    shares: Any = None,
    slope: float | None = None,
    reference_range: float | None = None,
    level: float = 0.9,
    window: tuple[float, float] | None = None,
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate storms from all directions and of all speeds, and give peaks, envelopes, reactions, slack guys and damage.

    Parameters
    ----------
    scene
        Scene of a mast or of one guy with ``[wind]`` and ``[time]``, whose duration is that of each storm.
    directions
        Angles from +x towards +z [rad] into which the wind blows; in a planar scene 0 and pi.
    speeds
        Mean wind speeds at the reference height [m/s].
    storms
        Number of storms for each direction and speed, with seeds from that of the scene on: the same ones in all directions and
        of all speeds.  1 without ``[wind.turbulence]``, as steady winds are all equal.
    out
        Folder for the storms (``storms``, an ensemble), ``design.nc`` and tables (CSV); a repeated call goes on where an
        interrupted one stopped.  Without it nothing is written.
    shares
        Shares of the time in which the wind has each speed (speeds,), in all directions alike, or each direction and speed
        (directions, speeds), of a sum of at most 1: they give the damage by fatigue.
    slope, reference_range
        Of the S-N curve of the stress in the guys, for `shares`: exponent, and range [Pa] at two million cycles.
    level
        Level of the intervals of peaks.
    window
        Start and end [s] of the part of each storm that counts; all of it by default.  Slack guys are told of in the whole storm.
    overwrite
        Replace another study in the folder.
    progress
        Callback receiving the completed fraction, 0 to 1.

    Returns
    -------
    xarray.Dataset
        Over ``direction``, ``speed`` and ``storm`` the extremes of :func:`cablepod.mast.simulate` and its envelopes; over
        ``direction`` and ``speed`` their mean over the storms, with the ending ``_peak``, from three storms on also its interval
        (``_peak_low``, ``_peak_high``) and a quantile of the largest values (``_quantile``, ``_quantile_low``,
        ``_quantile_high``), as of :func:`cablepod.extremes.peaks`; ``utilisation (direction, speed, guy)``;
        ``governing_direction``, ``governing_speed (guy)`` of the largest peak of the tension; ``slack_storms``, the number of
        storms in which the guy is slack before it breaks; ``buckling_factor (direction, speed)`` in the mean wind, and where
        guys break ``buckling_factor_after_break`` without these, beside the coordinate ``guy_breaks (guy)`` [s]; with `shares`
        ``damage`` of a storm, ``damage_per_year (guy)`` and ``fatigue_life (guy)`` [years]; ``failure`` says why a storm failed.
        Of one guy its ends take the place of the guys, and there is no mast.

    Raises
    ------
    SceneError
        For empty, repeated or non-finite directions and speeds, storms that are no whole number above 0, a scene without wind,
        with a record or with several members, shares without an S-N curve, and as :func:`cablepod.ensemble.run`.
    ArchiveError
        If the folder holds another study, or cannot be written.
    RunStopped
        If all storms failed.

    Warns
    -----
    MemberFailedWarning
        If storms failed; their direction and speed have nan.
    OutOfRangeWarning
        If guys go slack; the result has them by name.
    UnusualSceneWarning
        For guys that do not break before the end of a storm, and once of the worst that :func:`cablepod.summary` notes.

    Notes
    -----
    Masts have condensed guys, or chains where a guy breaks or a cable has segments or attachments; one guy is a condensed model
    on its vibration modes.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("mast120")
    >>> table = cp.study.design(scene, directions=[0.0, 1.0], speeds=[20.0], storms=3, window=(60.0, 600.0))  # doctest: +SKIP
    >>> table.guy_tension_peak.dims  # doctest: +SKIP
    ('direction', 'speed', 'guy')
    """
    scene = taken("scene", scene, scene_kind(scene))
    check_progress(progress)
    overwrite = truth("overwrite", overwrite)
    kind = MAST if "mast_height" in scene else CABLE
    axes = _axes(scene, directions, speeds, storms)
    level = number(above=0.0, most=0.9999)("level", level)
    window = _checked_window(window, float(scene["time_duration"]))
    shares = _checked_shares(shares, slope, reference_range, axes)
    curve = None if shares is None else (float(slope), float(reference_range))  # type: ignore[arg-type]
    if shares is not None:
        kind.check_areas(scene)
    if kind is MAST:
        warn_of_late_breaks(mast_parameters(scene), float(scene["time_duration"]))
    scenes = _scenes(scene, axes)
    options = {**kind.options(scene), "window": window}
    folder = None if out is None else path_of(out, key="out", allowed="a folder")
    parts = _parts(scenes, kind.model, kind.modes(scene), options, folder, overwrite=overwrite, progress=progress)
    numbers = [kind.numbers(part, scene, curve, window) for part in parts]
    of_storms = joined(numbers, kind)
    result = _unstacked(of_storms, axes)
    result = with_peaks(result, kind, level)
    if kind is MAST:
        with without_warnings(), warnings.catch_warnings():  # the storms have warned
            warnings.simplefilter("ignore", MemberFailedWarning)
            result = with_rest(result, mast.rest(scenes.isel(member=_members_of(axes)[:, :, 0].ravel())))
    if curve is not None:
        start, end = window or (0.0, float(scene["time_duration"]))
        result = with_damage(result, kind, shares, end - start)
    result.attrs = {
        "title": f"{scene.attrs.get('title', 'scene')}: design", "stage": "design", "level": level,
        **({} if curve is None else {"slope": curve[0], "reference_range": curve[1]}),
    }  # fmt: skip
    options = {
        "directions": axes["direction"], "speeds": axes["speed"], "storms": axes["storm"].size, "shares": shares,
        "slope": slope, "reference_range": reference_range, "level": level,
        "window": None if window is None else list(window),
    }  # fmt: skip
    result = provenance.record(result, function="study.design", parameters=options, inputs=[scene])
    if folder is not None:
        with new_results(folder, (RESULT, *TABLES)) as new:
            archive.write(result, new / RESULT)
            write_tables(new, result)
    return result


def _axes(scene: xr.Dataset, directions: Any, speeds: Any, storms: Any) -> dict[str, np.ndarray]:
    """Check and return directions [rad], speeds [m/s] and seeds of the storms.

    Raises
    ------
    SceneError
        Names the argument or the table.
    """
    if "wind_speed" not in scene:
        raise SceneError("wind: missing; allowed: a scene with the table wind, of which direction and speed are varied")
    found = {
        "direction": _numbers("directions", directions, "angles [rad], each once", numbers_list()),
        "speed": _numbers("speeds", speeds, "mean wind speeds [m/s] above 0, each once", numbers_list(above=0.0)),
    }
    count = integer(least=1, most=10**6)("storms", storms)
    if "wind_turbulence_record" in scene:
        raise scene_error(
            "wind.turbulence.record",
            "a file",
            "none here, as a record has its own direction and speed; try: a spectrum",
        )
    (mast_parameters if "mast_height" in scene else parameters)(scene).times()  # refuses a scene without [time]
    seed = 0
    if "wind_turbulence_spectrum" in scene:
        seed = int(scene["wind_turbulence_seed"])
    elif count > 1:
        raise scene_error("storms", count, "1 without wind.turbulence, as steady winds are all equal")
    if scene["wind_direction"].sizes["coordinate"] == 2:
        for angle in found["direction"].tolist():
            if abs(np.sin(angle)) > 1e-9:
                raise scene_error("directions", angle, "0 and pi in a planar scene, whose wind blows along x")
    return {**found, "storm": seed + np.arange(count)}


def _numbers(key: str, given: Any, what: str, check: Callable[[str, Any], list[float]]) -> np.ndarray:
    """Return numbers that are given, each once."""
    check_units(key, given, "rad" if key == "directions" else "m s-1")
    values = np.asarray(given).tolist() if isinstance(given, np.ndarray | xr.DataArray) else given
    if not isinstance(values, list | tuple) or not len(values):
        raise scene_error(key, values, f"a list of {what}")
    found = np.array(check(key, values))
    compared = np.round(found % (2.0 * np.pi), 9) % round(2.0 * np.pi, 9) if key == "directions" else found
    if np.unique(compared).size < found.size:
        raise scene_error(key, values, f"a list of {what}")
    return found


def _checked_shares(shares: Any, slope: Any, reference_range: Any, axes: dict[str, np.ndarray]) -> np.ndarray | None:
    """Return the shares of directions and speeds (direction, speed); None without."""
    curve = {"slope": slope, "reference_range": reference_range}
    if shares is None:
        for key, value in curve.items():
            if value is not None:
                raise scene_error(key, value, "none without shares of the wind speeds")
        return None
    for key, value in curve.items():
        if value is None:
            raise SceneError(f"{key}: missing; allowed: a number above 0, for the damage by the given shares")
        number(above=0.0)(key, value)
    counts = (axes["direction"].size, axes["speed"].size)
    allowed = (
        f"{counts[1]} numbers, one for each speed, or {counts[0]} lists of them, one for each direction: of at least 0, with a "
        "sum of at most 1"
    )
    try:
        values = np.array(np.asarray(shares).tolist(), dtype=float)
    except (TypeError, ValueError):
        raise scene_error("shares", shares, allowed) from None
    if values.shape not in (counts[1:], counts) or not np.isfinite(values).all() or values.min() < 0.0:
        raise scene_error("shares", shares, allowed)
    if values.sum() > 1.0 + 1e-9:
        raise SceneError(f"shares: given {shown(shares)} with the sum {values.sum():.6g}; allowed: {allowed}")
    return values if values.ndim == 2 else np.repeat(values[None] / counts[0], counts[0], axis=0)


def _checked_window(window: Any, duration: float) -> tuple[float, float] | None:
    """Return the part of each storm that counts [s], for storms of a duration [s]; None for all."""
    if window is None:
        return None
    allowed = f"start and end [s], rising, within {duration:g} s"
    if not isinstance(window, tuple | list) or len(window) != 2:
        raise scene_error("window", window, allowed)
    start, end = (number(least=0.0, most=duration)("window", value) for value in window)
    if not start < end:
        raise scene_error("window", window, allowed)
    return start, end


def _members_of(axes: dict[str, np.ndarray]) -> np.ndarray:
    """Return the numbers of the members (direction, speed, storm): some storms in each mean wind, then the next storms."""
    count, storms = axes["direction"].size * axes["speed"].size, axes["storm"].size
    edges = np.linspace(0, storms, -(-storms // STORMS_TOGETHER) + 1).round().astype(int)
    blocks = [
        count * first + np.arange(count * (last - first)).reshape(count, last - first)
        for first, last in pairwise(edges.tolist())
    ]
    return np.concatenate(blocks, axis=1).reshape(axes["direction"].size, axes["speed"].size, storms)


def _scenes(scene: xr.Dataset, axes: dict[str, np.ndarray]) -> xr.Dataset:
    """Return a scene for each direction, speed and storm, in the order of :func:`_members_of`."""
    from cablepod import ensemble  # its imports take a second

    order = np.argsort(_members_of(axes), axis=None)
    angles, speeds, seeds = (
        part.ravel()[order] for part in np.meshgrid(axes["direction"], axes["speed"], axes["storm"], indexing="ij")
    )
    vectors = np.round(np.stack([np.cos(angles), 0.0 * angles, np.sin(angles)], axis=1), DIGITS) + 0.0
    dims = scene["wind_direction"].sizes["coordinate"]
    ranges: dict[str, Any] = {"wind.direction": vectors[:, :dims].tolist(), "wind.speed": speeds.tolist()}
    if "wind_turbulence_spectrum" in scene:
        ranges["wind.turbulence.seed"] = seeds.tolist()
    return ensemble.design(scene, ranges, members=seeds.size, sampling="list")


def _parts(
    scenes: xr.Dataset, model: str, modes: xr.Dataset | None, options: dict[str, Any], folder: Path | None, *, overwrite: bool,
    progress: Callable[[float], None] | None,
) -> Iterator[xr.Dataset]:  # fmt: skip
    """Yield the results of the storms part by part, in order; from the folder where one is given."""
    from cablepod import ensemble

    size = min(MAX_BATCH, -(-scenes.sizes["member"] // 2))
    common: dict[str, Any] = {"model": model, "modes": modes, "batch": size, "progress": progress, **options}
    if folder is None:
        yield from ensemble.batches(scenes, **common)
        return
    runs = ensemble.run(scenes, folder / STORMS, overwrite=overwrite, **common)
    for first in range(0, runs.sizes["member"], size):
        yield runs.isel(member=slice(first, first + size))


def _unstacked(of_storms: xr.Dataset, axes: dict[str, np.ndarray]) -> xr.Dataset:
    """Return numbers over ``member`` over direction, speed and storm."""
    members = xr.DataArray(_members_of(axes), dims=("direction", "speed", "storm"))
    labels = {
        "direction": ("rad", "direction into which the wind blows, from +x towards +z"),
        "speed": ("m s-1", "mean wind speed at the reference height"),
        "storm": ("1", "seed of the turbulence"),
    }
    coords: dict[str, Any] = {
        name: (name, axes[name], {"units": units, "long_name": text}) for name, (units, text) in labels.items()
    }
    return of_storms.transpose("member", ...).isel(member=members).assign_coords(coords)
