"""The main job for a mast: rest, frequencies, motion, numbers of the guys, figures."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from cablepod import mast
from cablepod.conventions import label
from cablepod.fatigue._cycles import EXPONENT, FREQUENCY
from cablepod.integrate._window import window_attributes
from cablepod.mast._output import guy_fatigue
from cablepod.mast._piecewise_guys import kind_in_studies
from cablepod.mast._runs import check_run
from cablepod.parameters._mast import MastParameters, mast_parameters
from cablepod.parameters._parameters import ramp_of
from cablepod.study._figures import write_drawings
from cablepod.study._models import recorded
from cablepod.study._stages import stages_in
from cablepod.study._tension import start_of_statistics
from cablepod.study._timing import timed

#: Number of frequencies.
FREQUENCIES = 20
OUTPUTS = ("displacement", "guy_tension", "bending_moment", "extremes", "envelopes", "error_estimate")


def run_mast(
    scene: xr.Dataset,
    out: str | os.PathLike[str] | None,
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
    with stages_in(out, overwrite=overwrite, progress=progress, report=report) as stages:
        if progress is not None:
            progress("mast", 0.0)
        stages.add("scene", scene)
        rest = stages.add("rest", mast.rest(scene))
        count = min(FREQUENCIES, 2 * int(scene["mast_elements"]))
        stages.add("frequencies", mast.frequencies(scene, count=count))
        # a storm takes long: it is not run again for its run time, of which compilation is left out
        measure = partial(timed, longest_repeated=0.0)
        motion, _ = stages.simulate("motion", "mast", measure, partial(mast.simulate, scene, **options))
        if p.guys:
            stages.add("guys", guy_table(motion, rest, window))
        if stages.folder is not None:
            _write_figures(stages.folder, stages.results)
        return stages.tree()


def _after_ramps(p: MastParameters) -> tuple[float, float] | None:
    """Return the part of the run after the ramps of wind and forces [s]; None without one, and if too little is left then."""
    end = float(p.times()[-1])
    ramps = [ramp_of(p), *(load.factor.ramp for load in p.loads if load.factor is not None)]
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
