"""Figures of a page: what is drawn of which Datasets, as PNG."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod.plots import _cables, _maps, _mast, _modes, _periodic, _reports, _stringing, _wind
from cablepod.plots._page_tables import ROUNDING_SHARE, stage_of_scene
from cablepod.plots._style import private_axes

#: Resolution of a figure [dots per inch].
DOTS = 150
#: Size below which bending moments are rounding [N m].
MIN_MOMENT = 1e-9
#: Peaks of tensions in storms of which a map is drawn, with the dimension of the guys or ends.
PEAKS = {"guy_tension_peak": "guy", "tension_peak": "end"}
#: Variables of ensembles of which a map is drawn, the first that is there.
MAPPED = ("guy_tension_maximum", "tension_maximum", "utilisation", "fatigue_range")


class Drawing(NamedTuple):
    """Caption of a figure, and what draws it on axes."""

    caption: str
    draw: Callable[..., Any]


def drawings(results: Mapping[str, xr.Dataset]) -> Iterator[Drawing]:
    """Yield what can be drawn of results by name, in the order of its worth to an engineer."""
    yield from _of_tensions(results)
    for name, dataset in results.items():
        yield from _of_mast(name, dataset)
        yield from _of_members(name, dataset)
        yield from _of_storms(name, dataset)
        yield from _of_responses(name, dataset)
        yield from _of_statics(name, dataset)
        if _has(dataset, "wind", "time"):
            yield Drawing(f"{name}: velocity of the air over time and height", partial(_wind.wind_field, dataset))
    yield from _of_cables(results)
    yield from _of_models(results)


def _of_tensions(results: Mapping[str, xr.Dataset]) -> Iterator[Drawing]:
    """Yield tensions over time: of guys, at both ends (of the stage that has more instants, if there is one), along the cable."""
    for name, dataset in results.items():
        if _has(dataset, "guy_tension", "time"):
            yield Drawing(f"{name}: tension of each guy at the mast over time", partial(_mast.guy_tensions, dataset))
    ends = [name for name, dataset in results.items() if _has(dataset, "end_tension", "time", "end")]
    along = [name for name, dataset in results.items() if _has(dataset, "tension", "time", "link")]
    for name in ends or along:
        yield Drawing(f"{name}: tension at both ends over time", partial(_cables.end_tensions, results[name]))
    for name in along:
        if results[name].sizes["link"] > 1:
            yield Drawing(
                f"{name}: tension over time and place along the cable, hatched where it is zero or less",
                partial(_cables.tension, results[name]),
            )


def _of_statics(name: str, dataset: xr.Dataset) -> Iterator[Drawing]:
    """Yield tension and sag over temperature."""
    if "temperature" in dataset.dims and "sag" in dataset:
        for variable, words in (("tension_upper", "tension at the upper end"), ("sag", "sag")):
            draw = partial(_stringing.stringing, dataset, variable=variable)
            yield Drawing(f"{name}: {words} over temperature", draw)


def _of_models(results: Mapping[str, xr.Dataset]) -> Iterator[Drawing]:
    """Yield errors over time, and the shapes and singular values of the first modes."""
    for name, dataset in results.items():
        if _has(dataset, "error", "time"):
            runs = _comparisons(name, dataset)
            if runs:
                yield Drawing(f"{name}: error over time", partial(_reports.error_over_time, runs))
    modes = [name for name, dataset in results.items() if str(dataset.attrs.get("stage")) == "modes"]
    for name in modes[:1]:  # other layouts of the same motion look alike
        yield Drawing(f"{name}: shapes of the first modes", partial(_modes.modes, results[name]))
        if "singular_value" in results[name]:
            yield Drawing(f"{name}: singular values", partial(_modes.singular_values, results[name]))


def _has(dataset: xr.Dataset, name: str, *dims: str) -> bool:
    """Tell whether a Dataset of one scene has a variable over dimensions."""
    return name in dataset.data_vars and set(dims) <= set(dataset[name].dims) and "member" not in dataset[name].dims


def _of_mast(name: str, dataset: xr.Dataset) -> Iterator[Drawing]:
    """Yield the figures of a mast: moments over height in both directions, shapes of vibration."""
    if "node_height" not in dataset.coords or "member" in dataset.dims:
        return
    run = "bending_moment_maximum" in dataset
    if set(dataset.dims) & {"direction", "storm"}:
        return  # of many storms, which its tables tell
    if run or ("bending_moment" in dataset and "time" not in dataset["bending_moment"].dims):
        moments = dataset["bending_moment_maximum" if run else "bending_moment"]
        ranges = ["bending_moment_minimum"] if run else []
        for axis in ("x", "z"):
            if "coordinate" in moments.coords and not _bends(dataset, [str(moments.name), *ranges], axis):
                continue
            yield Drawing(
                f"{name}: {'range of the ' if run else ''}bending moment over the height, displacements along {axis}",
                partial(_mast.bending_moments, dataset, component=axis),
            )
    if "mast_share" in dataset:
        yield Drawing(f"{name}: shapes of vibration in which the mast moves most", partial(_mast.mast_shapes, dataset))


def _bends(dataset: xr.Dataset, names: Sequence[str], axis: str) -> bool:
    """Tell whether moments of displacements along an axis are more than rounding."""
    sizes = abs(dataset[names])
    largest = max(float(sizes[name].max()) for name in names)
    own = max(float(sizes[name].sel(coordinate=axis).max()) for name in names)
    return own > max(MIN_MOMENT, ROUNDING_SHARE * largest)


def _of_members(name: str, dataset: xr.Dataset) -> Iterator[Drawing]:
    """Yield a map over the two parameters that vary in an ensemble."""
    drawn = next((variable for variable in MAPPED if variable in dataset and "member" in dataset[variable].dims), None)
    varied = [
        str(key)
        for key, values in dataset.coords.items()
        if values.dims == ("member",) and key != "member" and values.dtype.kind in "iuf" and _varies(values.values)
    ]
    if drawn is not None and len(varied) == 2:
        x, y = sorted(varied, key=lambda key: "frequency" not in key)
        words = drawn.replace("_", " ")
        yield Drawing(
            f"{name}: {words} of each member", partial(_maps.parameter_map, dataset, drawn, x=x, y=y, hertz=True)
        )


def _of_storms(name: str, dataset: xr.Dataset) -> Iterator[Drawing]:
    """Yield a map of the largest tension of a design over direction and speed of the wind."""
    for variable, lines in PEAKS.items():
        if variable in dataset and {"direction", "speed"} <= set(dataset[variable].dims):
            largest = dataset[variable].max(lines, keep_attrs=True)
            largest.attrs["long_name"] = f"largest tension of all {lines}s, mean over the storms"
            yield Drawing(
                f"{name}: {largest.attrs['long_name']}, over direction and speed of the wind",
                partial(_maps.parameter_map, largest.to_dataset(), variable, x="direction", y="speed"),
            )


def _varies(values: np.ndarray) -> bool:
    finite = values[np.isfinite(values)]
    return bool(finite.size and finite.min() < finite.max())


def _of_responses(name: str, dataset: xr.Dataset) -> Iterator[Drawing]:
    """Yield the figures of periodic responses and maps of stability."""
    if {"branch", "stable", "angular_frequency"} <= set(dataset.variables):
        yield Drawing(f"{name}: periodic responses over frequency", partial(_periodic.frequency_response, dataset))
    if "hardening" in dataset.attrs:
        yield Drawing(f"{name}: free vibrations", partial(_periodic.backbone, dataset))
    if "growth_in_plane" in dataset:
        yield Drawing(f"{name}: growth over frequency and amplitude", partial(_periodic.stability_map, dataset))


def _of_cables(results: Mapping[str, xr.Dataset]) -> Iterator[Drawing]:
    """Yield the deflection of the full model, with the reduced one of its scene beside it that expects the least error."""
    runs = {
        name: dataset
        for name, dataset in results.items()
        if _has(dataset, "position", "time", "particle", "coordinate") and "time" in dataset.coords
    }
    full = next((name for name, run in runs.items() if "rank" not in run.attrs), None)
    scenes = {name: (stage_of_scene(run) or {}).get("id") for name, run in runs.items()}
    reduced = [
        name for name, run in runs.items() if "rank" in run.attrs and (full is None or scenes[name] == scenes[full])
    ]
    best = min(reduced, key=lambda name: _estimate(runs[name]), default=None)
    first, second = (best, None) if full is None else (full, best)
    if first is None:
        return
    beside = "" if second is None else f" and {second} (the least estimated error)"
    yield Drawing(
        f"{first}{beside}: deflection normal to the chord at some instants",
        partial(_cables.shapes, runs[first], None if second is None else runs[second], deflection=True),
    )


def _estimate(run: xr.Dataset) -> float:
    """Return the estimated error of a reduced run, infinite without one."""
    value = run.attrs.get("error_estimate", math.inf)
    return float(value) if math.isfinite(value) else math.inf


def _comparisons(name: str, dataset: xr.Dataset) -> dict[str, xr.Dataset]:
    """Return comparisons by name: one, or those of a table over model and rank."""
    dims = [str(dim) for dim in dataset["error"].dims if dim != "time"]
    if not dims:
        return {name: dataset}
    if dims != ["model", "rank"]:
        return {}
    parts = {
        f"{model}, r = {rank}": dataset[["error"]].sel(model=model, rank=rank, drop=True)
        for model in dataset["model"].values
        for rank in dataset["rank"].values
    }
    return {name: part for name, part in parts.items() if np.isfinite(part["error"].values).any()}


def png_of(drawing: Drawing) -> bytes:
    """Return a figure as PNG, drawn without pyplot, which would change the caller's open figures.

    Raises
    ------
    SceneError
        For a Dataset of which it cannot be drawn.
    """
    ax: Any = private_axes()
    drawing.draw(ax=ax)
    stream = io.BytesIO()
    ax.figure.savefig(stream, format="png", dpi=DOTS, facecolor="white")
    return stream.getvalue()
