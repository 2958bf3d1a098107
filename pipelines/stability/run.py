"""Classify the runs of every scheme of the chain on stiff and extreme scenes.

    python pipelines/stability/run.py [--out FOLDER] [--cases "NAME;NAME"] [--readme] [--list]

Schemes of elastic and rigid chains.  Writes stability.nc and stability.png.

Classes: accurate, inaccurate, refused, stopped, broken (hangs, refuses without a message, or gives garbage),
another model.
Steps: explicit runs take 0.9 of their predicted limit, implicit ones a two-hundredth of the first transverse period (or a
fortieth of the time scale of motions and loads), however stiff the cable.
Truth: velocity Verlet with steps halved until two runs agree to 1e-7 of the motion or a budget is spent, checked by the
energy-momentum scheme, another algorithm with other code.  Where two such runs differ by more than a hundredth of the motion the
case is chaotic, and statistics of the runs are compared with the spread of six equally good runs.
Rigid links run over the same scenes, by the first step of their own choice, against the elastic truth: their error is the
distance of the models, and most scenes are refused as stretched.  On their own scenes the truth is the index-1 form with steps
halved, checked by RATTLE, and elastic links do not run.
Tolerance: `chain.simulate(scene, tolerance=...)` (`rigid.simulate` on the scenes of rigid links) against that truth.
Limits: the step at which velocity Verlet breaks down, found by bisection, against the predicted one.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, publish
from tqdm import tqdm

import cablepod as cp
from cablepod.chain import _start as chain_start
from cablepod.chain._explicit import ExplicitChainRun
from cablepod.discretisation._chain import chain_of
from cablepod.parameters._from_scene import parameters
from cablepod.rigid._runs import FORMULATIONS
from stability.cases import Case, cases
from stability.verdict import (
    ACCURATE,
    CLASSES,
    INACCURATE,
    REFERENCE,
    SCHEMES,
    STATES,
    TOLERANCES,
    drift,
    energies,
    row,
    simulate,
    work_of_ends,
)  # fmt: skip

# --- limits of explicit steps ------------------------------------------------------------------------------------------

HERE = Path(__file__).resolve().parent
#: Maximum energy of a sound run over that of a run with a twentieth of the limit.
EXCESS = 2.0
LIMIT_CASES = (
    "the guy, K = 2e7 N", "rubber, K = 2e4 N", "2 links", "links and masses 1 : 1000", "weightless", "by mass, 50 per s",
    "all terms at once", "slackens and snaps", "let go above its rest", "let fall from a wide arc", "moved by half the span",
)  # fmt: skip


def breaks_down(run: ExplicitChainRun, step: float, energy: float) -> bool:
    """Return whether velocity Verlet stops with a step, or exceeds EXCESS times an energy [J].

    The energy need not grow without bounds: slack links are soft, and keep many a broken run bounded.
    """
    try:
        return _energy(run, step) > EXCESS * energy
    except cp.RunStopped:
        return True


def _energy(run: ExplicitChainRun, step: float) -> float:
    """Return the maximum kinetic and strain energy of a run [J]."""
    state = run(1.0 / step)
    kinetic, strain, _ = energies(run.chain, state.position, np.asarray(state.velocity))
    return float((kinetic + strain).max())


def limits(scene: xr.Dataset) -> tuple[float, float]:
    """Return the limit of the step of velocity Verlet, predicted and found [s].

    The run omits the check that refuses steps above the limit.  Links that slacken make the border ragged: the search for the
    shortest step that breaks down goes by twentieths of the limit, and then by bisection.
    """
    chain = chain_of(parameters(scene))
    predicted, interval = chain.step_limit(), float(scene["time_interval"])
    run = ExplicitChainRun(
        chain, chain_start.start(chain), times=parameters(scene).times(), outputs=("position", "velocity")
    )
    sound = _energy(run, min(0.05 * predicted, interval))
    low = 0.0
    for high in np.arange(0.1, 1.51, 0.05):
        if breaks_down(run, high * predicted, sound):
            break
        low = high
    else:
        return predicted, np.inf
    for _ in range(8):  # to two parts in ten thousand
        middle = 0.5 * (low + high)
        low, high = (low, middle) if breaks_down(run, middle * predicted, sound) else (middle, high)
    return predicted, float(0.5 * (low + high) * predicted)


# --- energy with moving ends ----------------------------------------------------------------------------------------------


def balance(case: Case, scheme: str, step: float, duration: float) -> float:
    """Return the maximum change of the energy less the work of the ends.

    Over all steps, relative as in :func:`drift`.
    """
    scene = replace(case, tables={**case.tables, "time": {"duration": duration, "interval": duration}}).scene()
    steps = round(duration / step)
    run = simulate(scene, scheme=scheme, step=step, times=step * np.arange(steps + 1), outputs=("position", "velocity"))
    chain, x = chain_of(parameters(scene)), run["position"].values
    return drift(chain, x, run["velocity"].values, work_of_ends(chain, x, conserving=scheme == REFERENCE))


# --- report ---------------------------------------------------------------------------------------------------------

UNITS = {"steps": "1", "run_time": "s", "step": "s", "error": "1", "energy_drift": "1", "kept": "1"}
LONG_NAMES = {
    "outcome": "class, an index into the attribute classes",
    "error": "largest error over the motion; relative, of the worst of three statistics, where judged by statistics",
    "energy_drift": "largest change of the energy over the largest kinetic and strain energy; less the work of moving ends",
    "steps": "number of steps", "run_time": "wall time of one call", "step": "time step", "kept": "part of the run computed",
    "message": "why a run was refused or stopped", "tolerance_state": "whether met, an index into the attribute states",
    "tolerance_error": "error with the tolerance", "tolerance_step": "step that the tolerance picked",
    "tolerance_scheme": "scheme that the tolerance picked, an index into scheme; -1 where no run came of it",
    "tolerance_run_time": "wall time of one call with the tolerance, compilation included",
    "tolerance_reason": "why that scheme",
    "truth_error": "distance of the two finest runs, by velocity Verlet or of rigid links by the index-1 form",
    "truth_check": "distance of the truth to a fine run by the energy-momentum scheme, of rigid links by RATTLE",
    "statistical": "1 where judged by statistics: chaotic, or so long that phases are lost",
    "chaotic": "1 where two fine steps disagree", "group": "group of cases", "links": "number of links",
    "duration": "duration of the run", "limit_predicted": "stability limit of velocity Verlet, predicted",
    "limit_found": "step of velocity Verlet at which runs break down", "case": "case", "limit_case": "case of the limits",
    "scheme": "scheme", "wanted_error": "tolerance",
}  # fmt: skip


def report(chosen: list[Case], *, progress: Callable[[list[Case]], Any] = iter, long: bool = True) -> xr.Dataset:
    """Run all cases; return a Dataset over (case, scheme), (case, wanted_error) and limit_case.

    Parameters
    ----------
    chosen
        The cases.
    progress
        Wraps the list of cases.
    long
        Whether the energy balance with moving ends covers long runs too.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cp.NotConvergedWarning)
        rows = [row(case) for case in progress(chosen)]
        probed = [case for case in chosen if case.name in LIMIT_CASES]
        found = np.array([limits(case.scene()) for case in progress(probed)]).reshape(-1, 2)
        for item in rows:
            if long and item["case"].long and not item["case"].quiet:
                _add_balances(item)
    result = _dataset(rows, probed, found)
    for name in result.variables:
        result[name].attrs.setdefault("units", "1")
        result[name].attrs["long_name"] = LONG_NAMES[str(name)]
    result.attrs.update(title="Stability of the schemes of the chain", stage="comparison", classes=", ".join(CLASSES))
    result.attrs.update(
        states=", ".join(STATES),
        comment="not a number: does not apply, as the error of a run that was refused or the energy drift of a damped one",
    )
    return result


def _add_balances(item: dict[str, Any]) -> None:
    """Add the energy balance of long runs.

    It covers a hundredth of the time, all of it for the energy-momentum scheme.
    """
    for scheme, verdict in zip(SCHEMES, item["verdicts"], strict=True):
        duration = float(item["truth"].run["time"][-1]) * (1.0 if scheme == REFERENCE else 0.01)
        if scheme not in FORMULATIONS and verdict.outcome in (ACCURATE, INACCURATE):
            verdict.energy_drift = balance(item["case"], scheme, verdict.step, duration)


def _dataset(rows: list[dict[str, Any]], probed: list[Case], found: np.ndarray) -> xr.Dataset:
    def of_runs(key: str) -> np.ndarray:
        return np.array([[getattr(verdict, key) for verdict in item["verdicts"]] for item in rows])

    def of_choices(key: str) -> np.ndarray:
        return np.array([[getattr(choice, key) for choice in item["chosen"]] for item in rows])

    def of_truths(key: str) -> np.ndarray:
        return np.array([np.nan if item["truth"] is None else getattr(item["truth"], key) for item in rows])

    runs, choices = ("case", "scheme"), ("case", "wanted_error")
    statistical = np.array([item["truth"] is not None and item["truth"].samples is not None for item in rows])
    long = np.array([item["case"].long for item in rows])
    names = [*SCHEMES, ""]
    return xr.Dataset(
        {key: (runs, of_runs(key), {"units": unit}) for key, unit in UNITS.items()}
        | {
            "outcome": (runs, np.vectorize(CLASSES.index)(of_runs("outcome")).astype(np.int8)),
            "message": (runs, of_runs("message").astype(str)),
            "tolerance_state": (choices, np.vectorize(STATES.index)(of_choices("state")).astype(np.int8)),
            "tolerance_error": (choices, of_choices("error")),
            "tolerance_step": (choices, of_choices("step"), {"units": "s"}),
            "tolerance_run_time": (choices, of_choices("run_time"), {"units": "s"}),
            "tolerance_reason": (choices, of_choices("reason").astype(str)),
            "tolerance_scheme": (
                choices,
                np.array([[names.index(c.scheme) % len(names) for c in item["chosen"]] for item in rows]) % len(names),
            ),
            "truth_error": ("case", of_truths("error")),
            "truth_check": ("case", of_truths("check")),
            "statistical": ("case", statistical.astype(np.int8)),
            "chaotic": ("case", (statistical & ~long).astype(np.int8)),
            "group": ("case", [item["case"].group for item in rows]),
            "links": ("case", [chain_of(parameters(item["case"].scene())).links for item in rows]),
            "duration": ("case", [float(item["case"].scene()["time_duration"]) for item in rows], {"units": "s"}),
            "limit_predicted": ("limit_case", found[:, 0], {"units": "s"}),
            "limit_found": ("limit_case", found[:, 1], {"units": "s"}),
        },
        coords={
            "case": [item["case"].name for item in rows],
            "scheme": list(SCHEMES),
            "wanted_error": list(TOLERANCES),
            "limit_case": np.array([case.name for case in probed], dtype=str),
        },
    )


def outcome_table(result: xr.Dataset) -> str:
    """Write the number of cases in each class, by scheme."""
    lines = []
    for scheme in result["scheme"].values:
        found = [CLASSES[int(value)] for value in result["outcome"].sel(scheme=scheme).values]
        lines.append([str(scheme), *(str(found.count(name)) for name in CLASSES)])
    return markdown_table(["scheme", *CLASSES], lines)


def limit_table(result: xr.Dataset) -> str:
    """Write the limits of the step of velocity Verlet, predicted and found."""
    lines = []
    for name in result["limit_case"].values:
        low, high = (float(result[key].sel(limit_case=name)) for key in ("limit_predicted", "limit_found"))
        lines.append([str(name), f"{low:.4g} s", f"{high:.4g} s", f"{high / low:.3f}"])
    return markdown_table(["case", "predicted", "found", "found over predicted"], lines)


def lines(result: xr.Dataset) -> list[str]:
    """Return the report as lines of text."""
    text = [f"{'':<26}" + "".join(f"{name:<26}" for name in SCHEMES) + "tolerance 1e-4"]
    for name in result["case"].values:
        of_case = result.sel(case=name)
        line = f"{name:<26}"
        for scheme in SCHEMES:
            cell = of_case.sel(scheme=scheme)
            drifted = "" if np.isnan(cell["energy_drift"]) else f" E {float(cell['energy_drift']):.0e}"
            error = "" if np.isnan(cell["error"]) else f" {float(cell['error']):.0e}"
            line += f"{CLASSES[int(cell['outcome'])] + error + drifted:<26}"
        one = of_case.sel(wanted_error=1e-4)
        state = STATES[int(one["tolerance_state"])]
        line += state + ("" if np.isnan(one["tolerance_error"]) else f" {float(one['tolerance_error']):.1e}")
        text.append(line)
    for name in result["limit_case"].values:
        low, high = (float(result[key].sel(limit_case=name)) for key in ("limit_predicted", "limit_found"))
        text.append(
            f"limit of velocity Verlet, {name:<28} predicted {low:.4g} s, found {high:.4g} s, {high / low:.3f} of it"
        )
    return text


def main() -> None:
    """Run the cases, write the Dataset and the figure, print the report."""
    parser = command_line(__doc__, out="out/stability", readme=True)
    parser.add_argument("--cases", default="", help="names of cases or groups, separated by semicolons")
    parser.add_argument("--list", action="store_true", help="print the names of the cases and end")
    options = parser.parse_args()
    import matplotlib as mpl

    mpl.use("Agg")
    from stability.figure import matrix, small

    wanted = [name.strip() for name in options.cases.split(";") if name.strip()]
    known = cases()
    for name in wanted:
        if not any(name in (case.name, case.group) for case in known):
            parser.error(f"--cases: given {name!r}; allowed: " + "; ".join(case.name for case in known))
    chosen = [case for case in known if not wanted or case.name in wanted or case.group in wanted]
    if options.list:
        print("\n".join(f"{case.group}: {case.name}" for case in chosen))
        return
    begin = time.perf_counter()
    result = report(chosen, progress=lambda items: tqdm(items, disable=None))
    figure, text = matrix(result), "\n".join(lines(result))
    publish(
        options.out,
        "stability",
        result,
        draw=lambda path: figure.savefig(path, dpi=110),
        draw_small=lambda path: small(figure, path),
        page=HERE if options.readme else None,
        tables={"outcomes": outcome_table(result), "limits": limit_table(result)},
    )
    print(text)
    print(f"{len(chosen)} cases in {time.perf_counter() - begin:.0f} s; {options.out}/stability.nc, stability.png")


if __name__ == "__main__":
    main()
