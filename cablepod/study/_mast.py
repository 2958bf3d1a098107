"""The main job for a mast: rest, frequencies, motion, numbers of the guys, figures."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from cablepod import archive, mast
from cablepod.archive._folder import prepare_folder
from cablepod.conventions import label
from cablepod.integrate._window import window_attributes
from cablepod.mast._fatigue import EXPONENT, FREQUENCY, guy_fatigue
from cablepod.mast._piecewise_guys import kind_in_studies
from cablepod.mast._runs import check_run
from cablepod.parameters._mast import MastParameters, mast_parameters
from cablepod.study._figures import check_backend, write_drawings
from cablepod.study._models import recorded
from cablepod.study._tension import start_of_statistics
from cablepod.study._timing import timed

#: Stages, which are the names of the files, and figures.
STAGES, FIGURES = ("scene", "rest", "frequencies", "motion", "guys"), ("tensions", "moments", "modes")
#: Number of frequencies.
FREQUENCIES = 20
OUTPUTS = ("displacement", "guy_tension", "bending_moment", "extremes", "envelopes", "error_estimate")


def run_mast(
    scene: xr.Dataset,
    out: Path | None,
    *,
    overwrite: bool,
    progress: Callable[[str, float], None] | None,
    report: Callable[[str, xr.Dataset], None] | None,
) -> xr.DataTree:
    """Compute and write what is asked of a mast; see :func:`cablepod.study.run`.

    Returns
    -------
    xarray.DataTree
        Nodes "scene", "rest", "frequencies", "motion" and "guys", a table of tensions over ``guy``.
    """
    p = mast_parameters(scene)
    window = _after_ramps(p)  # refuses a scene without [time]
    guys = kind_in_studies(p)
    options: dict[str, Any] = {"guys": guys, "outputs": OUTPUTS[:-1] if guys == "chain" else OUTPUTS}
    if any(guy.breaks is not None for guy in p.guys):
        window = None
    if window is not None:
        options["window"] = window
    check_run(scene, **options)
    if out is not None:
        check_backend()
        files = [*(f"{name}.nc" for name in STAGES), *(f"{name}.png" for name in FIGURES)]
        prepare_folder(out, files, overwrite=overwrite)
    results: dict[str, xr.Dataset] = {}

    def add(name: str, result: xr.Dataset) -> xr.Dataset:
        if out is not None:
            archive.write(result, out / f"{name}.nc", overwrite=True)
        results[name] = result
        if report is not None:
            report(name, result)
        return result

    def at(share: float) -> None:
        if progress is not None:
            progress("mast", share)

    at(0.0)
    add("scene", scene)
    add("rest", mast.rest(scene))
    count = min(FREQUENCIES, 2 * int(scene["mast_elements"]))
    add("frequencies", mast.frequencies(scene, count=count))
    at(0.2)
    say = None if progress is None else partial(progress, "mast: compiling, once", 0.2)
    call = partial(mast.simulate, scene, **options)
    # a storm takes long: it is not run again for its run time, of which compilation is left out
    motion, seconds = timed(call, progress=lambda share: at(0.2 + 0.7 * share), say=say, longest_repeated=0.0)
    motion.attrs["wall_time_s"] = seconds["call_time"]
    add("motion", motion)
    if p.guys:
        add("guys", guy_table(motion, results["rest"], window))
    if out is not None:
        _write_figures(out, results)
    at(1.0)
    root = xr.Dataset(attrs={"title": scene.attrs["title"], "left_out": [], "compile_time_s": seconds["compile_time"]})
    return xr.DataTree.from_dict({"/": root, **results}, name="study")


def _after_ramps(p: MastParameters) -> tuple[float, float] | None:
    """Return the part of the run after the ramps of wind and forces [s]; None without one, and if too little is left then."""
    end = float(p.times()[-1])
    ramps = [float((p.wind or {}).get("ramp", 0.0)), *(load.factor.ramp for load in p.loads if load.factor is not None)]
    start = start_of_statistics(ramps, end)
    return (start, end) if start else None


def guy_table(motion: xr.Dataset, rest: xr.Dataset, window: tuple[float, float] | None = None) -> xr.Dataset:
    """Return tensions of the guys: at rest, mean, standard deviation, extremes, equivalent fatigue range [N].

    Parameters
    ----------
    motion, rest
        The run, and the rest from which it starts.
    window
        Start and end [s] of the part of the run that its extremes and means are of; all of it by default.
    """
    names = ("mean", "std", "minimum", "maximum", "maximum_time")
    ranges = guy_fatigue(motion, window)
    table = xr.Dataset(
        {
            "anchor": rest["anchor"],
            "guy_tension_rest": ("guy", rest["guy_tension"].values),
            **{f"guy_tension_{name}": motion[f"guy_tension_{name}"] for name in names},
            **({} if ranges is None else {"fatigue_range": ranges}),
            **({"utilisation": motion["utilisation"]} if "utilisation" in motion else {}),
        }
    )
    label(table, guy_tension_rest=("N", "tension of the guy at the mast, at rest"))
    table.attrs = {
        "title": f"{motion.attrs['title']}: guys", "stage": "mast guys", "air": rest.attrs["air"], "exponent": EXPONENT,
        "frequency": FREQUENCY,
        **window_attributes(window),
    }  # fmt: skip
    return recorded(table, "guys", [motion, rest])


def _write_figures(folder: Path, results: dict[str, xr.Dataset]) -> None:
    """Write the figures."""
    from cablepod import plots

    drawings: dict[str, Callable[..., Any]] = {
        "moments": partial(plots.bending_moments, results["motion"]),
        "modes": partial(plots.mast_shapes, results["frequencies"]),
    }
    if "guys" in results:
        with_anchors = results["motion"].assign(anchor=results["rest"]["anchor"])
        drawings["tensions"] = partial(plots.guy_tensions, with_anchors)
    write_drawings(folder, drawings, str(results["scene"].attrs["title"]))
