"""Format the tables of ``cablepod run``."""

from __future__ import annotations

import xarray as xr

from cablepod.integrate._request import DEFAULT_TOLERANCE
from cablepod.study import REDUCED_TOLERANCE


def table(study: xr.DataTree) -> str:
    """Return a table of errors, steps and wall times of the chain and the Galerkin models."""
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
    """Return the row of one run."""
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
    """Return a text of the first singular values [m] and their shares of the sum."""
    values = modes["singular_value"]
    lines = []
    for axis in modes["coordinate"].values:
        of_axis = values.sel(coordinate=axis).values
        first = "  ".join(f"{value:.5g}" for value in of_axis[:5])
        shares = [100.0 * of_axis[:count].sum() / of_axis.sum() if of_axis.any() else 0.0 for count in (1, 5)]
        share = f"the first has {shares[0]:.2f} %, these have {shares[1]:.2f} % of the sum of {of_axis.size}"
        lines.append(f"singular values of {axis} [m]: {first}; {share}")
    return "\n".join(lines)
