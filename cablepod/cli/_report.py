"""Format what ``cablepod run`` prints: answers, the table of models, singular values; or all of it as JSON."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.cli._statistics import HEADS, columns, fatigue_text, files_text, finite, part_of_run
from cablepod.conventions import ENDINGS_OF_AIR, ENDS, STILL_AIR, note_lines, printed, printed_unit
from cablepod.integrate._coarse import LIKELY, remedy_of
from cablepod.parameters._utilisation import utilisation
from cablepod.study._figures import FIGURES
from cablepod.study._models import fastest_chain
from cablepod.study._run import TRUTH_TOLERANCE

#: Columns of the table of models.
HEAD = f"{'model':<24}{'error':>10}{'estimate':>10}{'call':>11}{'one run':>11}{'step [s]':>11}{'steps':>10}"
#: Numbers of the rows: of reduced models, of chains.
OF_REDUCED_MODEL = ("error_max", "error_rms", "error_estimate", "call_time", "loop_time", "compile_time", "step")
OF_CHAIN = ("error_max", "error_rms", "call_time", "step", "tolerance")
#: Names of the frequencies.
VIBRATIONS = ("frequency_in_plane", "frequency_out_of_plane")
#: Maximum error of a reduced model that is compared with chains, as a fraction of the motion.
LARGEST_ERROR = 0.05
#: Ratio of a call to one of its runs up to which their difference is noise of the clock.
NOISE = 1.1


def models(study: xr.DataTree) -> list[dict[str, Any]]:
    """Return the rows of the table: reduced models, cheaper chains, the reference solution."""
    rows = []
    if "comparison" in study:
        table = study["comparison"].to_dataset()
        for model in table["model"].values:
            for rank in table["rank"].values:
                row = table.sel(model=model, rank=rank)
                if math.isfinite(float(row["call_time"])):
                    values = {name: finite(row[name]) for name in OF_REDUCED_MODEL}
                    steps = int(row["number_of_steps"])
                    rows.append({"model": str(model), "rank": int(rank), **values, "steps": steps})
    if "chains" in study:
        chains = study["chains"].to_dataset()
        for trial in _front(chains):
            row = chains.isel(trial=trial)
            values = {name: finite(row[name]) for name in OF_CHAIN}
            steps = int(row["number_of_steps"])
            rows.append({"model": "chain", "links": int(row["links"]), **values, "steps": steps})
    chain = study["chain"].to_dataset()
    reference = {
        "links": chain.sizes["particle"] - 1,
        "call_time": chain.attrs["wall_time_s"],
        "step": chain.attrs["step"],
        "error_estimate": finite(chain.attrs["space_error_estimate"]),
    }
    rows.append(
        {"model": "chain", **reference, "steps": int(chain.attrs["number_of_steps"]), "tolerance": TRUTH_TOLERANCE}
    )
    return rows


def as_json(study: xr.DataTree) -> str:
    """Return the answers and the table as JSON."""
    content = {"title": study.attrs["title"], "answers": answers(study), "models": models(study)}
    content["left_out"] = study.attrs["left_out"]
    return json.dumps(content, indent=2, allow_nan=False)


def text(study: xr.DataTree, folder: Path) -> str:
    """Return what the command prints: title, answers, models, singular values, files."""
    parts = [study.attrs["title"], answers_text(study), table(study), singular_values(study["modes"].to_dataset())]
    return "\n\n".join([*parts, files_text(folder, FIGURES)])


def answers(study: xr.DataTree) -> dict[str, Any]:
    """Return the answers that an engineer asks first: numbers at rest, frequencies, tensions over time."""
    numbers = study["summary"].to_dataset()
    names = ("unstretched_length", "chord", "sag", "stress", "tension_lower", "tension_upper", *VIBRATIONS)
    found: dict[str, Any] = {"air": numbers.attrs["air"]}
    for ending in ENDINGS_OF_AIR:  # beside those at rest, of scenes with wind those in still air and in the mean wind
        for name in (f"{name}{ending}" for name in names if f"{name}{ending}" in numbers):
            values = numbers[name]
            found[name] = [finite(value) for value in values] if values.ndim else finite(values)
    found["tension"] = {kind: _peak(study, kind) for kind in ("maximum", "minimum")}
    if "breaking_strength" in numbers:
        found["breaking_strength"] = float(numbers["breaking_strength"])
        found["utilisation"] = utilisation(found["tension"]["maximum"]["value"], found["breaking_strength"])
    if "tension" in study:
        found["tension"] |= _statistics(study["tension"].to_dataset())
    return found


def _statistics(ends: xr.Dataset) -> dict[str, Any]:
    """Return the statistics of a cable in the wind: of which part of the run, and a row for each end [N, s]."""
    names = {
        "mean": "end_tension_mean", "std": "end_tension_std", "least": "end_tension_minimum", "peak": "end_tension_maximum",
        "peak_time": "end_tension_maximum_time", "fatigue_range": "fatigue_range",
    }  # fmt: skip
    rows = {
        str(end): {name: float(ends[variable].sel(end=end)) for name, variable in names.items()}
        for end in ends["end"].values
    }
    return {name: ends.attrs[name] for name in ("window_start", "window_end", "exponent", "frequency")} | rows


def _peak(study: xr.DataTree, kind: str) -> dict[str, Any]:
    """Return the largest or the smallest tension of the chain, with instant, place and error.

    The error by the length of the links, of second order, is a third of the change from half the links: of the largest or the
    smallest tension, whichever changes more, as the change of one alone may be small by chance.
    """
    chain = study["chain"].to_dataset()
    value, error = _extreme(chain, kind), None
    if "chain_half" in study:
        half = study["chain_half"].to_dataset()
        error = max(abs(_extreme(chain, each) - _extreme(half, each)) for each in ("minimum", "maximum")) / 3.0
    time, place = (float(chain[f"tension_{kind}_{of}"]) for of in ("time", "arc_length"))
    return {"value": value, "time": time, "arc_length": place, "error": error}


def _extreme(chain: xr.Dataset, kind: str) -> float:
    """Return the largest or the smallest tension over links and steps [N]."""
    values = chain[f"tension_{kind}"]
    return float(values.max() if kind == "maximum" else values.min())


def answers_text(study: xr.DataTree) -> str:
    """Return the answers as lines, each with how far to trust it."""
    found = answers(study)
    chord, sag = found["chord"], found["sag"]
    rest = study["chain_rest"].to_dataset()
    change = abs(float(rest["tension_upper"]) / found["tension_upper"] - 1.0)
    chain = study["chain"].to_dataset()
    links, length = chain.sizes["particle"] - 1, float(chain["arc_length"][-1])
    air, windy = found["air"], "sag_still_air" in found
    stress = f", stress {printed(found['stress'], 'Pa', 4)}" if "stress" in found else ""  # none without an area
    model = "continuous cable" if windy else "exact catenary without point loads"
    lines = [
        f"at rest      length {printed(found['unstretched_length'], 'm')}, sag {printed(sag, 'm', 3)} normal to the chord "
        f"({100 * sag / chord:.2g} % of it){stress}",
        f"             tension {printed(found['tension_lower'], 'N')} at the lower end, "
        f"{printed(found['tension_upper'], 'N')} at the upper",
        f"             {model}{f' in {air}' if windy else ''}; the chain of {links} links differs by {100 * change:.2g} %",
        f"vibration    {_vibrations(found)}, about rest",
    ]
    if windy:
        _, of_still_air, of_mean_wind = ENDINGS_OF_AIR
        lines.append(_in_other_air(found, of_mean_wind if air.startswith(STILL_AIR) else of_still_air))
    for name, kind in (("largest", "maximum"), ("smallest", "minimum")):
        peak = found["tension"][kind]
        factor, unit = printed_unit("N", peak["value"])
        trust = "" if peak["error"] is None else f", ± {factor * peak['error']:.2g} {unit} by the length of the links"
        lines.append(
            f"tension      {name} {printed(peak['value'], 'N')} at {peak['time']:.4g} s, {peak['arc_length']:.3g} m "
            f"along the cable (S / L0 = {peak['arc_length'] / length:.2g}){trust}"
        )
    lines.append("             over all time steps; output times between steps do not count")
    if "utilisation" in found:
        strength = printed(found["breaking_strength"], "N")
        used = printed(found["utilisation"], "%", 3)
        lines.append(f"             utilisation {used}: the largest over the breaking strength of {strength}")
    if "tension" in study:
        of_ends = found["tension"]
        lines += [f"in the wind  {part_of_run(of_ends)}; {fatigue_text(of_ends)}", f"             tension [kN]{HEADS}"]
        lines += [f"             {end + ' end':<12}{columns(of_ends[end])}" for end in reversed(ENDS)]
    return "\n".join(lines + [f"note         {note}" for note in note_lines(study["summary"].to_dataset())])


def _vibrations(found: dict[str, Any], ending: str = "") -> str:
    """Return the first frequencies in the plane and out of it."""
    within, across = (_hertz(found[f"{name}{ending}"]) for name in VIBRATIONS)
    return f"{within} Hz in the plane, {across} Hz out of it"


def _in_other_air(found: dict[str, Any], ending: str) -> str:
    """Return tension and frequencies in the air in which the scene is not at rest, still air or the mean wind."""
    tension = found[f"tension_upper{ending}"]
    upper = "no rest" if tension is None else f"{printed(tension, 'N')} at the upper end"
    return f"             {ENDINGS_OF_AIR[ending]}: {upper}, {_vibrations(found, ending)}"


def _hertz(values: list[float | None]) -> str:
    """Return frequencies with three digits."""
    return ", ".join("none" if value is None else f"{value:.3g}" for value in values)


def table(study: xr.DataTree) -> str:
    """Return the table of models with what it means."""
    lines = [HEAD]
    for row in models(study):
        name = f"chain, {row['links']} links" if "links" in row else f"{row['model']}, r = {row['rank']}"
        error = f"{100 * row['error_max']:.3g} %" if "error_max" in row else "reference"
        estimate = f"{100 * row['error_estimate']:.3g} %" if row.get("error_estimate") is not None else ""
        one_run = seconds(row["loop_time"]) if "loop_time" in row else ""
        if "links" in row:
            name += f" ({row['tolerance']:g})"
        step, steps = f"{row['step']:.3g}", str(row["steps"])
        lines.append(
            f"{name:<24}{error:>10}{estimate:>10}{seconds(row['call_time']):>11}{one_run:>11}{step:>11}{steps:>10}"
        )
    lines += ["", *notes(study)]
    return "\n".join(lines)


def notes(study: xr.DataTree) -> list[str]:
    """Return what the table means: the models at equal error, what makes one slow, how far to trust it."""
    chain = study["chain"].to_dataset()
    lines = [
        "error: largest rms distance to the last row over time, as a fraction of the motion; estimate: by the model itself",
        "estimate of the last row: of its links, its distance from the continuous cable; the other rows share its links",
        "call: run time with defaults, compilation apart; one run: with that step given; (tolerance) of a chain",
    ]
    if "comparison" in study:
        rows = study["comparison"].to_dataset()
        chains = study["chains"].to_dataset() if "chains" in study else None
        lines += [_at_equal_error(rows.sel(model=str(model)), str(model), chains) for model in rows["model"].values]
    if study.attrs["compile_time_s"] > 0.0:
        lines.append(f"compiling took {study.attrs['compile_time_s']:.0f} s, once on this machine")
    if study.attrs["notes_left_out"]:
        lines.append(
            f"notes: {study.attrs['notes_left_out']} more like those above, of other models and with other numbers"
        )
    if (error := chain.attrs["space_error_estimate"]) > LIKELY:
        links = chain.sizes["particle"] - 1
        lines.append(
            f"the links of the last row are too few for the continuous cable, by this estimate; {remedy_of(links, error)}"
        )
    if chain.attrs["time_error_estimate"] > TRUTH_TOLERANCE:
        lines.append(
            "two steps of the last row disagree by more than the tolerance: chaotic or too abrupt a motion, "
            "to be judged by statistics"
        )
    return lines + [f"left out: {reason}" for reason in study.attrs["left_out"]]


def _at_equal_error(rows: xr.Dataset, model: str, chains: xr.Dataset | None) -> str:
    """Compare the rank of a model that gains most with the fastest chain that errs no more; useless ranks do not count."""
    best, text = -math.inf, ""
    if not (rows["error_max"] <= LARGEST_ERROR).any():
        return f"{model}: errs by more than {100.0 * LARGEST_ERROR:g} % with each of these ranks; give more modes"
    for rank in rows["rank"].values:
        row = rows.sel(rank=rank)
        error, own = float(row["error_max"]), float(row["call_time"])
        rival = fastest_chain(chains, error)
        if rival is None or not math.isfinite(own) or error > LARGEST_ERROR:
            continue
        gain = float(rival["call_time"]) / own
        if gain > best:
            best = gain
            faster = f"{gain:.2g} times faster" if gain >= 1.0 else f"{1.0 / gain:.2g} times slower"
            text = f"{model}, r = {rank}: {100 * error:.2g} % in {seconds(own)}, {faster} than the fastest chain above that errs "
            text += f"no more ({int(rival['links'])} links, tolerance {float(rival['tolerance']):g}):\n  {_cost(row, rival)}"
    if not text:
        return f"{model}: no chain of the table errs as little"
    return text


def _cost(row: xr.Dataset, rival: xr.Dataset) -> str:
    """Say why a call takes its time beside that of a chain: runs in a call, number of steps, run time of a step."""
    call, one_run, steps = (float(row[name]) for name in ("call_time", "loop_time", "number_of_steps"))
    of_chain = float(rival["number_of_steps"])
    runs = f"{call / one_run:.2g} times one" if call > NOISE * one_run else "one"
    return (
        f"{runs} run of {steps:.0f} steps, {seconds(one_run / steps)} each with output; "
        f"that chain {of_chain:.0f} steps in its last run, {seconds(float(rival['call_time']) / of_chain)} each of its call"
    )


def _front(chains: xr.Dataset) -> list[int]:
    """Return the chains that are faster than all that err no more, the fastest first."""
    order = np.argsort(chains["call_time"].values, kind="stable")
    least, kept = math.inf, []
    for trial in order:
        error = float(chains["error_max"][trial])
        if error < 0.9 * least:
            least = error
            kept.append(int(trial))
    return kept


def seconds(value: float) -> str:
    """Return a run time with its unit."""
    if value < 1e-3:
        return f"{1e6 * value:.3g} us"
    return f"{1e3 * value:.3g} ms" if value < 1.0 else f"{value:.3g} s"


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
