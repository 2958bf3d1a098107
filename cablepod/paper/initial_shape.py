"""Search initial shapes that explain Table 2 and the energy shares of Example 3; compute those found."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cablepod import chain, pod
from cablepod.errors import RunStopped, SceneError
from cablepod.examples import scene, table
from cablepod.paper.datasets import described
from cablepod.paper.examples import SUMMED, misfit, share_of_five
from cablepod.paper.table1 import inextensible

#: Time step of the runs [s] (half of it changes the ten values by at most 3e-4 as long as no link slackens).
STEP = 2.5e-4
#: Initial sags of Example 3 over that of equilibrium, and time steps [s] (links slacken, results depend on the step).
EXAMPLE_3_SAGS = (0.55, 0.6, 0.62, 0.64, 0.66)
EXAMPLE_3_STEPS = (1.6e-4, 1.25e-4)


def printed() -> np.ndarray:
    """Return the singular values of Table 2 (coordinate, row) [m]."""
    rows = table("table2")
    return np.stack([rows[f"singular_value_{axis}_m"] for axis in "xy"])


def printed_sums() -> np.ndarray:
    """Return the printed sums of 20 singular values of Example 2 (coordinate,) [m]."""
    rows = table("energy_shares")
    row = int(np.flatnonzero(rows["example"] == 2)[0])
    return np.array([rows[name][row] for name in ("horizontal", "vertical")])


def with_start(base: xr.Dataset, start: Mapping[str, Any]) -> xr.Dataset:
    """Return a scene with cable and initial shape of a row of ``data/starts.csv``; nan entries change nothing."""
    values = {key: float(value) for key, value in start.items() if key != "name" and not np.isnan(value)}
    metre, newton = {"units": "m"}, {"units": "N"}
    result = base
    if "cable_length_m" in values:
        length = ((), values["cable_length_m"], metre)
        result = result.drop_vars("cable_top_tension").assign(cable_unstretched_length=length)
    if "cable_tension_N" in values:
        result = result.assign(cable_top_tension=((), values["cable_tension_N"], newton))
    if "start_length_m" in values:
        result = result.assign(initial_unstretched_length=((), values["start_length_m"], metre))
    if "start_tension_N" in values:
        result = result.assign(initial_top_tension=((), values["start_tension_N"], newton))
    if "start_sag" in values:
        line = _sagging_line(base, values["start_sag"])
        result = result.assign(initial_points=(("initial_points_point", "coordinate"), line, metre))
    if "mass_damping_per_s" in values:
        result = result.assign(damping_mass_proportional=((), values["mass_damping_per_s"], {"units": "s-1"}))
    return result


def _sagging_line(base: xr.Dataset, sag: float, count: int = 400) -> np.ndarray:
    """Return points (count, 2) [m] on the inextensible catenary of a scene, its deflection scaled by `sag`."""
    curve = inextensible(base, float(base["cable_top_tension"]))
    x = np.linspace(0.0, curve.a, count)
    straight = curve.b * x / curve.a
    return np.stack([x, straight + sag * (curve.height(x) - straight)], axis=1) + base["ends_lower"].values


def tried(*, progress: Callable[[float], None] | None = None) -> xr.Dataset:
    """Compute the ten values of Table 2 for every initial shape of ``data/starts.csv``.

    Returns
    -------
    xarray.Dataset
        ``tried_singular_value (tried, coordinate, table2_row)`` [m], ``tried_sum (tried, coordinate)`` [m],
        ``tried_sag (tried)``, ``tried_misfit (tried)``, ``tried_misfit_3 (tried)``; nan for initial shapes from which the run
        stops because links slacken.
    """
    target, rows, base = printed(), table("starts"), scene("example2")
    names = [str(name) for name in rows["name"]]
    values, sags = np.full((len(names), 2, SUMMED), np.nan), np.empty(len(names))
    for i in range(len(names)):
        changed = with_start(base, {key: column[i] for key, column in rows.items()})
        values[i] = _values(changed)
        first = chain.simulate(changed, times=[0.0], step=STEP)["position"].values[0]
        sags[i] = _sag(first) / _sag(chain.rest(changed)["position"].values)
        if progress is not None:
            progress((i + 1) / len(names))
    count = target.shape[1]
    return described(
        "initial_shape.tried", {"step": STEP},
        {
            "tried_singular_value": (("tried", "coordinate", "table2_row"), values[..., :count],
                "m", "singular value of the centred, lifted snapshots"),
            "tried_sum": (("tried", "coordinate"), values.sum(axis=-1), "m", "sum of 20 singular values"),
            "tried_sag": ("tried", sags, "1", "sag of the start over that of the cable at rest"),
            "tried_misfit": ("tried", misfit(values[..., :count], target),
                "1", "rms of ln(ours / print) over all rows and both columns"),
            "tried_misfit_3": ("tried", misfit(values[..., :3], target[:, :3]),
                "1", "rms of ln(ours / print) over the first three rows and both columns"),
        },
        {
            "tried": (names, "1", "start of Example 2 that was tried"),
            "coordinate": (["x", "y"],),
            "table2_row": (np.arange(1, count + 1), "1", "row of Table 2"),
        },
        [base],
    )  # fmt: skip


def _sag(position: np.ndarray) -> float:
    """Return the largest distance from the chord [m], negative above it."""
    chord = position[-1] - position[0]
    below = (position - position[0]) @ np.array([chord[1], -chord[0]]) / np.hypot(*chord)
    return float(below[np.abs(below).argmax()])


def _values(changed: xr.Dataset) -> np.ndarray:
    """Return singular values (coordinate, mode) [m] of a scene's chain; nan without a simulation."""
    try:
        return pod.decompose(chain.simulate(changed, step=STEP), rank=SUMMED)["singular_value"].values
    except (RunStopped, SceneError):  # diverged at this step, or no such cable
        return np.full((2, SUMMED), np.nan)


def example3(*, sags: Sequence[float] = EXAMPLE_3_SAGS, steps: Sequence[float] = EXAMPLE_3_STEPS) -> xr.Dataset:
    """Compute the energy shares of Example 3 at its printed tension from initial shapes of another sag.

    Returns
    -------
    xarray.Dataset
        ``sagging_share (relative_sag, sagging_step, coordinate)``: share of five in the sum of 20 singular values.
    """
    base = scene("example3")
    shares = np.empty((len(sags), len(steps), 2))
    for i, sag in enumerate(sags):
        changed = with_start(base, {"start_sag": sag})
        for j, step in enumerate(steps):
            shares[i, j] = share_of_five(pod.decompose(chain.simulate(changed, step=step), rank=SUMMED))
    return described(
        "initial_shape.example3", {"sags": list(sags), "steps": list(steps)},
        {
            "sagging_share": (("relative_sag", "sagging_step", "coordinate"), shares,
                "1", "share of five in the sum of 20 singular values of Example 3"),
        },
        {
            "relative_sag": (list(sags), "1", "sag of the start over that of equilibrium"),
            "sagging_step": (list(steps), "s", "time step"),
            "coordinate": (["x", "y"],),
        },
        [base],
    )  # fmt: skip


def search(
    *,
    draws: int = 1000,
    polished: int = 5,
    cable_lengths: tuple[float, float] = (61.1530, 61.1562),
    differences: tuple[float, float] = (-0.036, 0.028),
    most_evaluations: int = 150,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Search initial shapes of another cable length: random draws, the best refined by Nelder-Mead.

    Parameters
    ----------
    draws
        Number of random pairs.
    polished
        Number of the best draws that are refined.
    cable_lengths, differences
        Ranges of the unstretched length of the cable, and of the additional length of the initial shape [m].
    most_evaluations
        Maximum number of runs of each refinement.
    seed
        Seed of the random numbers.
    progress
        Callback receiving the completed fraction, 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``search_cable_length``, ``search_start_length`` [m] and ``search_misfit (draw)`` of the draws; ``polished_*`` of the
        refined ones, best first.
    """
    from scipy.optimize import minimize  # slow to import

    base, target = scene("example2"), printed()
    rng = np.random.default_rng(seed)
    cable = rng.uniform(*cable_lengths, size=draws)
    start = cable + rng.uniform(*differences, size=draws)

    def gap(point: np.ndarray, part: float) -> float:
        if progress is not None:
            progress(part)
        values = _values(with_start(base, {"cable_length_m": point[0], "start_length_m": point[1]}))
        value = float(misfit(values[:, : target.shape[1]], target))
        return value if np.isfinite(value) else 99.0  # no such cable, or diverged

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # logarithm of nan
        misfits = np.array([gap(pair, 0.7 * i / draws) for i, pair in enumerate(np.stack([cable, start], axis=1))])
        best = np.argsort(misfits)[:polished]
        ends = [
            minimize(
                lambda point, i=i: gap(point, 0.7 + 0.3 * i / polished),
                [cable[k], start[k]],
                method="Nelder-Mead",
                options={
                    "initial_simplex": np.array([cable[k], start[k]]) + 3e-4 * np.array([[0, 0], [1, 0], [0, 1]]),
                    "xatol": 1e-7,
                    "fatol": 1e-4,
                    "maxfev": most_evaluations,
                },
            )
            for i, k in enumerate(best)
        ]
    refined = sorted(ends, key=lambda end: end.fun)
    columns = {
        "search_cable_length": ("draw", cable, "m"), "search_start_length": ("draw", start, "m"),
        "search_misfit": ("draw", misfits, "1"), "polished_cable_length": ("polished", [end.x[0] for end in refined], "m"),
        "polished_start_length": ("polished", [end.x[1] for end in refined], "m"),
        "polished_misfit": ("polished", [end.fun for end in refined], "1"),
    }  # fmt: skip
    options = {
        "draws": draws, "polished": polished, "cable_lengths": list(cable_lengths), "differences": list(differences),
        "most_evaluations": most_evaluations, "seed": seed,
    }  # fmt: skip
    variables = {name: (*column, name.replace("_", " ")) for name, column in columns.items()}
    return described("initial_shape.search", options, variables, {}, [base])
