"""Reduced models of one scene, and full chains beside them, each with its error and run time."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from cablepod import chain, compare, provenance
from cablepod.errors import RunStopped
from cablepod.study._timing import timed

#: Tolerances of the chains that are compared with the reduced models, and the smallest number of links that is halved for them.
CHAIN_TOLERANCES, MIN_HALVED_LINKS = (1e-1, 1e-2, 1e-3), 8
#: Tolerance of the chain of half the links that tells the error of tensions.
COARSER_TOLERANCE = 1e-4
#: The chains take no more time together than this multiple of that of the reference solution, or than a minimum [s].
CHAIN_SHARE, CHAIN_SECONDS = 1.5, 1.0
#: Variables of a row of the table beside its errors: unit and long name.
ROW = {
    "call_time": ("s", "run time of the whole call with its defaults, compilation apart"),
    "loop_time": ("s", "run time of the call with that step given and positions alone"),
    "compile_time": ("s", "compilation of the kernels, once on a machine"),
    "step": ("s", "time step"),
    "number_of_steps": ("1", "number of steps"),
    "error_estimate": ("1", "largest error over time as the model estimates it, as a fraction of the motion"),
}
TITLE = "errors and run times of the models against the elastic chain"


def timed_twice(
    call: Callable[..., xr.Dataset],
    *,
    repeated: bool = True,
    progress: Callable[[float], None] | None,
    say: Callable[[], None] | None,
) -> tuple[xr.Dataset, dict[str, float]]:
    """Return the result of a call with its defaults, and the variables of its row; nan for what the result does not tell.

    If `repeated`, the call is timed with its step and scheme given, too.
    """
    result, row = timed(call, progress=progress, say=say)
    chosen = {name: result.attrs.get(name, np.nan) for name in ("step", "number_of_steps", "error_estimate")}
    once = {"call_time": np.nan}
    if repeated:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the call with the defaults has warned
            scheme = result.attrs["scheme"]
            _, once = timed(partial(call, step=chosen["step"], scheme=scheme, outputs=("position",)))
    return result, row | {"loop_time": once["call_time"], **chosen}


def with_row(error: xr.Dataset, row: dict[str, float]) -> xr.Dataset:
    """Return a comparison with the variables of its row."""
    variables = {
        name: ((), float(value), {"units": ROW[name][0], "long_name": ROW[name][1]}) for name, value in row.items()
    }
    return error.assign(variables)


def table_of(rows: dict[tuple[str, int], xr.Dataset]) -> xr.Dataset:
    """Concatenate rows by model and rank along ``model`` and ``rank``; nan where a model has no such rank."""
    models, ranks = list(dict.fromkeys(model for model, _ in rows)), sorted({rank for _, rank in rows})
    empty = xr.full_like(next(iter(rows.values())), np.nan)
    options: Any = {
        "data_vars": "all",
        "coords": "minimal",
        "compat": "override",
        "join": "exact",
        "combine_attrs": "override",
    }
    of_model = [
        xr.concat([rows.get((model, rank), empty) for rank in ranks], dim="rank", **options) for model in models
    ]
    table = xr.concat(of_model, dim="model", **options).assign_coords(
        model=("model", models, {"units": "1", "long_name": "reduced model"}),
        rank=("rank", ranks, {"units": "1", "long_name": "modes of each coordinate"}),
    )
    table.attrs = {**next(iter(rows.values())).attrs, "title": TITLE}
    return table


def chains_of(
    scene: xr.Dataset, reference: xr.Dataset, seconds: float, progress: Callable[[str, float], None] | None
) -> xr.Dataset | None:
    """Return errors and run times of cheaper chains along ``trial``: half and all links, several tolerances.

    Parameters
    ----------
    scene, reference
        The scene, and its converged chain.
    seconds
        Run time of the reference solution [s]; the chains together take little more.
    progress
        Called with a label and the completed fraction.
    """
    links = reference.sizes["particle"] - 1
    numbers = [links // 2, links] if links >= MIN_HALVED_LINKS else [links]
    left = max(CHAIN_SHARE * seconds, CHAIN_SECONDS)
    rows: list[xr.Dataset] = []
    for tolerance, number in itertools.product(CHAIN_TOLERANCES, numbers):
        if progress is not None:
            progress("chains of the same error", len(rows) / (len(numbers) * len(CHAIN_TOLERANCES)))
        call = partial(
            chain.simulate,
            scene,
            links=number,
            times=reference["time"].values,
            tolerance=tolerance,
            outputs=("position",),
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a coarse chain may not converge; its error is in the table
            try:
                run, row = timed(call)
            except RunStopped:  # long steps may break down
                continue
        steps = {"step": run.attrs["step"], "number_of_steps": run.attrs["number_of_steps"]}
        trial = with_row(compare.errors(run, reference), {"call_time": row["call_time"], **steps})
        rows.append(trial.assign(links=number, tolerance=tolerance))
        left -= row["call_time"]
        if left < 0.0:
            break
    if not rows:
        return None
    table = xr.concat(rows, dim="trial", data_vars="all", coords="minimal", compat="override", join="exact")
    table["links"].attrs = {"units": "1", "long_name": "links of the chain"}
    table["tolerance"].attrs = {"units": "1", "long_name": "tolerance of the time error, as a fraction of the motion"}
    table.attrs = {**rows[0].attrs, "title": "errors and run times of cheaper chains"}
    return recorded(table, "chains", [scene, reference])


def recorded(table: xr.Dataset, name: str, inputs: list[xr.Dataset]) -> xr.Dataset:
    """Append a table of a study, with measured run times, to the histories of its inputs, in place; return the table."""
    return provenance.record(table, function=f"study.{name}", parameters={}, inputs=inputs)


def coarser_chain(scene: xr.Dataset, reference: xr.Dataset) -> xr.Dataset | None:
    """Return the extremes of the tension of a chain of half the links; None where there are too few, or it stops."""
    links = reference.sizes["particle"] - 1
    if links < MIN_HALVED_LINKS:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the chain of all links has warned
        try:
            return chain.simulate(
                scene,
                links=links // 2,
                times=reference["time"].values,
                tolerance=COARSER_TOLERANCE,
                outputs=("tension_extremes",),
            )
        except RunStopped:
            return None


def fastest_chain(chains: xr.Dataset | None, error: float) -> xr.Dataset | None:
    """Return the fastest chain whose largest error is at most `error`; None without one."""
    if chains is None:
        return None
    good = chains.isel(trial=np.flatnonzero(chains["error_max"].values <= error))
    return good.isel(trial=int(np.argmin(good["call_time"].values))) if good.sizes["trial"] else None
