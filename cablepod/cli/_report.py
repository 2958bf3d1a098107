"""The tables that ``cablepod run`` prints."""

from __future__ import annotations

import xarray as xr

from cablepod.integrate._request import DEFAULT_TOLERANCE
from cablepod.study import REDUCED_TOLERANCE


def table(study: xr.DataTree) -> str:
    """Write errors, steps and wall times of the chain and the Galerkin models as text."""
    comparison = study["comparison"].to_dataset()
    lines = [
        f"{'model':<15}{'modes':>6}{'largest error':>15}{'rms error':>12}{'step [s]':>11}{'steps':>10}{'time [s]':>10}"
    ]
    chain = study["chain"].to_dataset()
    lines.append(_row("elastic chain", "", "truth", "", chain))
    runs = [chain]
    for r in comparison["rank"].values:
        runs.append(study[f"galerkin_r{r}"].to_dataset())
        error = comparison.sel(rank=r)
        largest, rms = (f"{100 * float(error[name]):.4f} %" for name in ("error_max", "error_rms"))
        lines.append(_row("Galerkin", str(r), largest, rms, runs[-1]))
    lines.append(
        "errors over the largest rms displacement of the chain; times are of the whole call with the check of its step,"
    )
    lines.append("and include compilation the first time a model runs on this machine")
    if not all(_is_converged(run) for run in runs):
        lines.append(
            "* two steps disagree by more than the tolerance: chaotic or too abrupt a motion, to be judged by statistics"
        )
    return "\n".join(lines)


def _row(model: str, rank: str, largest: str, rms: str, run: xr.Dataset) -> str:
    attrs = run.attrs
    return (
        f"{model:<15}{rank:>6}{largest:>15}{rms:>12}{attrs['step']:>11.3g}{attrs['number_of_steps']:>10}"
        f"{attrs['wall_time_s']:>10.3f}" + ("" if _is_converged(run) else " *")
    )


def _is_converged(run: xr.Dataset) -> bool:
    """Tell whether the estimated time error of a run is within its tolerance."""
    tolerance = DEFAULT_TOLERANCE if run.attrs["model"] == "elastic chain" else REDUCED_TOLERANCE
    return bool(run.attrs["time_error_estimate"] <= tolerance)


def singular_values(modes: xr.Dataset) -> str:
    """Write the first singular values [m] of each coordinate and their share of the sum as text."""
    values = modes["singular_value"]
    lines = []
    for axis in modes["coordinate"].values:
        one = values.sel(coordinate=axis).values
        first = "  ".join(f"{value:.5g}" for value in one[:5])
        held = [100.0 * one[:count].sum() / one.sum() if one.any() else 0.0 for count in (1, 5)]
        share = f"the first has {held[0]:.2f} %, these have {held[1]:.2f} % of the sum of {one.size}"
        lines.append(f"singular values of {axis} [m]: {first}; {share}")
    return "\n".join(lines)
