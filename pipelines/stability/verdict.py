"""Compute truth, energy balance and verdict of the runs of the stability report."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from _study import timed
from scipy.stats import t as student

import cablepod as cp
from cablepod.chain import _scheme as chain_scheme
from cablepod.discretisation._chain import LumpedChain, chain_of
from cablepod.parameters._from_scene import parameters
from cablepod.rigid._runs import FORMULATIONS
from stability.cases import Case, dividing, rigid_step

SCHEMES = (*chain_scheme.SCHEMES, *FORMULATIONS)
VERLET, REFERENCE = SCHEMES[0], "energy_momentum"
RATTLE, INDEX1 = FORMULATIONS
ACCURATE, INACCURATE, REFUSED, STOPPED, BROKEN, OTHER = CLASSES = (
    "accurate", "inaccurate", "refused", "stopped", "broken", "another model",
)  # fmt: skip
MET, MISSED, WARNED, CHAOTIC, OPEN, NOT_TRIED = STATES = (
    "met", "missed", "missed with a warning", "no single truth", "truth too coarse", "not tried",
)  # fmt: skip
TOLERANCES = (1e-3, 1e-4, 1e-6)
#: Maximum time of a run with the middle tolerance [s] for which the first and the last are tried.
COSTLY = 4.0

#: Maximum error of an accurate run, over the motion (the width of a line in a drawing of it).
LIMIT = 1e-2
#: Tolerance of the truth (a tenth of the smallest tolerance); maximum links times steps of its runs, and of its check.
AGREE, BUDGET, CHECK_BUDGET = 1e-7, 4e8, 1e7
#: As BUDGET, for the chain of rigid links, whose truth comes from a scheme of fourth order.
RIGID_BUDGET = 1e7
#: Number of equally good runs whose spread is that of a chaotic scene; probability that an exact run counts as a wrong one.
REALISATIONS, DOUBT = 6, 1e-3
#: Maximum energy of a sound run over that of the truth.
GARBAGE = 10.0
#: Maximum time of a run [s]; longer ones count as a hang.
PATIENCE = 120.0
OUTPUTS = ("position", "velocity", "tension_extremes")


class Overdue(RuntimeError):
    """A run exceeds PATIENCE."""


def simulate(scene: xr.Dataset, **options: Any) -> xr.Dataset:
    """Run the chain of elastic or rigid links, by the scheme, for at most PATIENCE."""
    begin = time.perf_counter()

    def look(_: float) -> None:
        if time.perf_counter() - begin > PATIENCE:
            raise Overdue

    if options.get("scheme") in FORMULATIONS:
        return cp.rigid.simulate(scene, progress=look, formulation=options.pop("scheme"), **options)
    return cp.chain.simulate(scene, progress=look, **options)


# --- energy ---------------------------------------------------------------------------------------------------------


def energies(chain: LumpedChain, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return kinetic, strain and load energy [J], (time,), from positions [m] and velocities [m/s].

    Held particles are left out.  The energy of the constant loads counts from the first position, against cancellation.
    """
    p, free = chain.p, chain.free_particles
    size = np.sqrt(np.sum(np.diff(x, axis=1) ** 2, axis=-1))
    strain = 0.5 * (chain.k * np.maximum(size - chain.length, 0.0) ** 2).sum(axis=-1)
    kinetic = 0.5 * p.mass * (chain.tributary_length * np.sum(v**2, axis=-1))[:, free].sum(axis=-1)
    return kinetic, strain, -((x - x[0]) * chain.loads())[:, free].sum(axis=(1, 2))


def drift(chain: LumpedChain, x: np.ndarray, v: np.ndarray, work: np.ndarray | float = 0.0) -> float:
    """Return the maximum change of the energy less the work of the ends.

    It is relative to the maximum sum of kinetic and strain energy.  That sum sets the rounding error of a
    scheme, and does not depend on the zero of the loads' energy.
    """
    kinetic, strain, potential = energies(chain, x, v)
    change = kinetic + strain + potential - work
    return float(np.abs(change - change[0]).max() / max((kinetic + strain).max(), 1e-300))


def work_of_ends(chain: LumpedChain, x: np.ndarray, *, conserving: bool) -> np.ndarray:
    """Return the work of the ends [J], (time,), from the positions at all steps.

    The force of a step is the mean of those at its two instants; for the energy-momentum scheme that of the scheme, by the
    difference quotient of the link's energy: then kinetic, strain and potential energy change by exactly this work.
    """
    total = np.zeros(len(x))
    for end, link in ((0, 0), (-1, -1)):
        reach = np.diff(x, axis=1)[:, link] * (1.0 if end == -1 else -1.0)  # from the neighbour to the end
        square = np.sum(reach**2, axis=-1)
        size, k, length = np.sqrt(square), chain.k[link], chain.length[link]
        over = np.maximum(size - length, 0.0)
        if conserving:
            gap = square[1:] - square[:-1]
            tangent = k * np.maximum(1.0 - 2.0 * length / (size[1:] + size[:-1]), 0.0)
            with np.errstate(divide="ignore", invalid="ignore"):
                secant = k * (over[1:] ** 2 - over[:-1] ** 2) / gap
            both = (over[1:] > 0.0) & (over[:-1] > 0.0)
            factor = np.where(both | (gap == 0.0), tangent, secant)
            force = factor[:, None] * 0.5 * (reach[1:] + reach[:-1])
        else:
            pull = (k * over / size)[:, None] * reach
            force = 0.5 * (pull[1:] + pull[:-1])
        total[1:] += np.cumsum(np.sum(force * np.diff(x[:, end], axis=0), axis=-1))
    return total


# --- truth ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Truth:
    """The truth of a case."""

    run: xr.Dataset  #: the finest run
    error: float  #: its distance to the next coarser one, over the motion
    check: float  #: its distance to the run by another scheme
    energy: float  #: its largest kinetic and strain energy [J]
    #: statistics of equally good runs (realisation, statistic), where single motions mean nothing
    samples: np.ndarray | None


def statistics(chain: LumpedChain, run: xr.Dataset) -> np.ndarray:
    """Return rms displacement [m], mean kinetic and strain energy [J], maximum tension [N]."""
    x, v = run["position"].values, run["velocity"].values
    kinetic, strain, _ = energies(chain, x, v)
    away = np.sqrt(np.mean(np.sum((x - x[0]) ** 2, axis=-1)))
    return np.array([away, np.mean(kinetic + strain), float(run["tension_maximum"].max())])


def error_of(run: xr.Dataset, truth: xr.Dataset) -> float:
    """Return the maximum error over the motion."""
    return float(cp.compare.errors(run, truth)["error_max"])


def truth_of(case: Case, scene: xr.Dataset) -> Truth:
    """Compute the truth of a case, by statistics if it is chaotic or long."""
    chain = chain_of(parameters(scene))
    duration = float(scene["time_duration"])
    scheme, checking, budget = (INDEX1, RATTLE, RIGID_BUDGET) if case.rigid else (VERLET, REFERENCE, BUDGET)
    limit = rigid_step(scene) if case.rigid else chain.step_limit()

    def run(part: float) -> xr.Dataset:
        return simulate(scene, scheme=scheme, step=dividing(scene, limit / part), outputs=OUTPUTS)

    if case.long:
        # phases are lost: no affordable refinement makes two runs agree
        samples = np.array([statistics(chain, run(part)) for part in (1.5, 2.0, 2.5)])
        fine = run(2.0)
        error = check = np.inf
    else:
        part, fine, error = 4.0, run(4.0), np.inf
        while error == np.inf or (error > AGREE and 2.0 * part * duration / limit * chain.links <= budget):
            part, coarse, fine = 2.0 * part, fine, run(2.0 * part)
            error = error_of(coarse, fine)
        other = max(limit / part, duration * chain.links / CHECK_BUDGET)
        check = error_of(simulate(scene, scheme=checking, step=dividing(scene, other)), fine)
        samples = None
        if max(error, check) > LIMIT:
            samples = np.array([statistics(chain, run(4.0 + i)) for i in range(REALISATIONS)])
    kinetic, strain, _ = energies(chain, fine["position"].values, fine["velocity"].values)
    return Truth(fine, error, check, float((kinetic + strain).max()), samples)


# --- judging --------------------------------------------------------------------------------------------------------


@dataclass
class Verdict:
    """The outcome of one run."""

    outcome: str
    error: float = np.nan  #: over the motion; of the worst statistic where there is no other truth
    energy_drift: float = np.nan
    steps: int = 0
    run_time: float = 0.0  #: [s]
    step: float = np.nan  #: [s]
    kept: float = 0.0  #: computed part of the duration
    message: str = ""


def garbage(chain: LumpedChain, run: xr.Dataset, truth: Truth | None) -> str:
    """Return the defect of a completed run, empty for a sound one."""
    for name in run.data_vars:
        if not np.isfinite(run[name].values).all():
            return f"{name} is not finite everywhere"
    if truth is not None:
        kinetic, strain, _ = energies(chain, run["position"].values, run["velocity"].values)
        if float((kinetic + strain).max()) > GARBAGE * truth.energy:
            return (
                f"finite, but with {float((kinetic + strain).max()) / truth.energy:.2g} times the energy of the truth"
            )
    return ""


def judge(case: Case, scene: xr.Dataset, truth: Truth | None, run: Callable[[], xr.Dataset]) -> Verdict:
    """Make a run and classify it; `truth` is None if no run is possible."""
    chain = chain_of(parameters(scene))
    try:
        result = run()
    except cp.SceneError as error:
        return Verdict(REFUSED if str(error) else BROKEN, message=str(error))
    except cp.RunStopped as error:
        return _stopped(chain, float(scene["time_duration"]), error)
    except Overdue:
        return Verdict(BROKEN, message=f"still running after {PATIENCE:g} s")
    verdict = Verdict(BROKEN, steps=int(result.attrs["number_of_steps"]), step=float(result.attrs["step"]), kept=1.0)
    verdict.message = garbage(chain, result, truth)
    if verdict.message or truth is None:
        return verdict
    if case.rigid:  # with the work of the ends by the run itself
        verdict.energy_drift = float(result.attrs["energy_drift"])
    if case.quiet:
        verdict.energy_drift = drift(chain, result["position"].values, result["velocity"].values)
    verdict.error, accurate = _accuracy(chain, result, truth)
    verdict.outcome = ACCURATE if accurate else INACCURATE
    return verdict


def _stopped(chain: LumpedChain, duration: float, error: cp.RunStopped) -> Verdict:
    """Classify a stopped run: its partial result must exist, be marked, and be sound."""
    kept = error.partial
    if kept is None or "incomplete" not in kept.attrs or not str(error):
        return Verdict(BROKEN, message=f"stopped, and nothing kept of it: {error}")
    wrong = garbage(chain, kept, None)
    return Verdict(
        BROKEN if wrong else STOPPED,
        steps=int(kept.attrs["number_of_steps"]),
        step=float(kept.attrs["step"]),
        kept=float(kept["time"][-1]) / duration,
        message=wrong or str(error),
    )


def _accuracy(chain: LumpedChain, run: xr.Dataset, truth: Truth) -> tuple[float, bool]:
    """Return the error of a run, and whether it is accurate.

    With a truth in statistics only, a run is accurate if its distance from the mean of equally good runs is within LIMIT, or
    within that of one more of them with probability 1 - DOUBT (Student's distribution, as the spread comes from few runs).
    """
    if truth.samples is None:
        error = error_of(run, truth.run)
        return error, error <= LIMIT
    count, mean = len(truth.samples), truth.samples.mean(axis=0)
    spread = truth.samples.std(axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / count)
    away = np.abs(statistics(chain, run) - mean)
    allowed = np.maximum(student.isf(0.5 * DOUBT, count - 1) * spread, LIMIT * mean)
    worst = int(np.argmax(away / np.maximum(allowed, 1e-300)))
    return float(away[worst] / mean[worst]), bool((away <= allowed).all())


def of_scheme(case: Case, scene: xr.Dataset, truth: Truth | None, scheme: str, step: float) -> Verdict:
    """Judge one scheme on one case, with the run time of its second run (the first may compile)."""
    options = {"scheme": scheme, "step": step, "outputs": OUTPUTS}
    verdict, first = timed(lambda: judge(case, scene, truth, lambda: simulate(scene, **options)))
    verdict.run_time = first
    if verdict.kept:
        again = [first]
        if first < 2.0:
            again.append(timed(lambda: _quietly(lambda: simulate(scene, **options)))[1])
        verdict.run_time = min(again)
    return verdict


def _quietly(call: Callable[[], Any]) -> Any:
    try:
        return call()
    except cp.RunStopped:
        return None


@dataclass
class Chosen:
    """The outcome of a run with a tolerance."""

    state: str
    error: float = np.nan
    scheme: str = ""
    step: float = np.nan  #: [s]
    run_time: float = 0.0  #: [s]
    reason: str = ""


def of_tolerance(case: Case, scene: xr.Dataset, truth: Truth | None, tolerance: float) -> Chosen:
    """Judge the choice of scheme and step for a tolerance.

    Of rigid links it is the step of RATTLE, their default.
    """
    options: dict[str, Any] = {"scheme": RATTLE} if case.rigid else {}
    if truth is None or truth.samples is not None:
        return Chosen(CHAOTIC)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            run, seconds = timed(lambda: simulate(scene, tolerance=tolerance, **options))
        except (cp.SceneError, cp.RunStopped, Overdue) as error:
            return Chosen(MISSED, reason=f"{type(error).__name__}: {error}")
    warned = any(issubclass(item.category, cp.NotConvergedWarning) for item in caught)
    error = error_of(run, truth.run)
    state = MET if error <= tolerance else WARNED if warned else MISSED
    if truth.error > 0.3 * tolerance:  # another halving changes it by a third of that at most, at second order
        state = OPEN
    attrs = run.attrs
    return Chosen(state, error, attrs["scheme"], float(attrs["step"]), seconds, str(attrs.get("choice_of_scheme", "")))


def row(case: Case) -> dict[str, Any]:
    """Run all schemes and tolerances on one case."""
    scene = case.scene()
    try:
        truth, steps = truth_of(case, scene), case.steps(scene)
    except cp.SceneError:  # then every scheme must refuse by itself
        truth, steps = None, dict.fromkeys(SCHEMES, dividing(scene, 0.5 * chain_of(parameters(scene)).step_limit()))
    verdicts = [
        Verdict(OTHER, message="elastic links move in another way")
        if case.rigid and scheme not in FORMULATIONS
        else of_scheme(case, scene, truth, scheme, steps[scheme])
        for scheme in SCHEMES
    ]
    chosen = {1e-4: of_tolerance(case, scene, truth, 1e-4)}
    for tolerance in TOLERANCES:
        if tolerance not in chosen:
            costly = chosen[1e-4].run_time > COSTLY
            chosen[tolerance] = Chosen(NOT_TRIED) if costly else of_tolerance(case, scene, truth, tolerance)
    return {
        "case": case,
        "truth": truth,
        "verdicts": verdicts,
        "chosen": [chosen[tolerance] for tolerance in TOLERANCES],
    }
