"""Which start explains Table 2 and the shares of Example 3?  What was tried, computed again; and the search itself."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cablepod import chain, pod, provenance
from cablepod.conventions import label
from cablepod.errors import RunStopped, SceneError
from cablepod.examples import scene, table
from cablepod.paper.examples import SUMMED, misfit
from cablepod.paper.table1 import inextensible
from cablepod.parameters._from_scene import parameters

#: Time step of the runs [s]; half of it moves none of the ten values by more than 3e-4 of itself where no link slackens.
STEP = 2.5e-4
#: Sags over that of Example 3 from which its chain is started, and the steps [s] (links slacken, runs differ).
EXAMPLE_3_SAGS = (0.55, 0.6, 0.62, 0.64, 0.66)
EXAMPLE_3_STEPS = (1.6e-4, 1.25e-4)


def printed() -> np.ndarray:
    """Return the singular values of Table 2 (coordinate, row) [m]."""
    rows = table("table2")
    return np.stack([rows[f"singular_value_{axis}_m"] for axis in "xy"])


def printed_sums() -> np.ndarray:
    """Return the sums of 20 singular values of Example 2 that the text prints (coordinate,) [m]."""
    rows = table("energy_shares")
    row = int(np.flatnonzero(rows["example"] == 2)[0])
    return np.array([rows[name][row] for name in ("horizontal", "vertical")])


def with_start(base: xr.Dataset, start: Mapping[str, Any]) -> xr.Dataset:
    """Return `base` with the cable and the start of a row of ``data/starts.csv``; what is nan there is left as it is."""
    given = {key: float(value) for key, value in start.items() if key != "name" and not np.isnan(value)}
    metre, newton = {"units": "m"}, {"units": "N"}
    result = base
    if "cable_length_m" in given:
        length = ((), given["cable_length_m"], metre)
        result = result.drop_vars("cable_top_tension").assign(cable_unstretched_length=length)
    if "cable_tension_N" in given:
        result = result.assign(cable_top_tension=((), given["cable_tension_N"], newton))
    if "start_length_m" in given:
        result = result.assign(initial_unstretched_length=((), given["start_length_m"], metre))
    if "start_tension_N" in given:
        result = result.assign(initial_top_tension=((), given["start_tension_N"], newton))
    if "start_sag" in given:
        line = _sagging_line(base, given["start_sag"])
        result = result.assign(initial_points=(("point", "coordinate"), line, metre))
    if "mass_damping_per_s" in given:
        result = result.assign(damping_mass_proportional=((), given["mass_damping_per_s"], {"units": "s-1"}))
    return result


def _sagging_line(base: xr.Dataset, sag: float, count: int = 400) -> np.ndarray:
    """Points (count, 2) [m] on the inextensible catenary of a scene, its distance from the chord times `sag`."""
    p = parameters(base)
    curve = inextensible(p, p.length_value)
    x = np.linspace(0.0, curve.a, count)
    straight = curve.b * x / curve.a
    return np.stack([x, straight + sag * (curve.height(x) - straight)], axis=1) + p.lower


def tried(*, progress: Callable[[float], None] | None = None) -> xr.Dataset:
    """Compute the ten values of Table 2 for every start of ``data/starts.csv``.

    Returns
    -------
    xarray.Dataset
        ``tried_singular_value (tried, coordinate, table2_row)`` [m], ``tried_sum (tried, coordinate)`` [m],
        ``tried_sag (tried)``, ``tried_misfit (tried)``, ``tried_misfit_3 (tried)``; nan for a start whose links slacken so
        violently that the run stops.
    """
    target, rows, base = printed(), table("starts"), scene("example2")
    names = [str(name) for name in rows["name"]]
    values, sags = np.full((len(names), 2, SUMMED), np.nan), np.empty(len(names))
    for i in range(len(names)):
        given = with_start(base, {key: column[i] for key, column in rows.items()})
        values[i] = _values(given)
        first = chain.simulate(given, times=[0.0], step=STEP)["position"].values[0]
        sags[i] = _sag(first) / _sag(chain.rest(given)["position"].values)
        if progress is not None:
            progress((i + 1) / len(names))
    count = target.shape[1]
    result = xr.Dataset(
        {
            "tried_singular_value": (("tried", "coordinate", "table2_row"), values[..., :count]),
            "tried_sum": (("tried", "coordinate"), values.sum(axis=-1)),
            "tried_sag": ("tried", sags),
            "tried_misfit": ("tried", misfit(values[..., :count], target)),
            "tried_misfit_3": ("tried", misfit(values[..., :3], target[:, :3])),
        },
        coords={"tried": names, "coordinate": ["x", "y"], "table2_row": np.arange(1, count + 1)},
    )
    label(
        result,
        tried=("1", "start of Example 2 that was tried"),
        table2_row=("1", "row of Table 2"),
        tried_singular_value=("m", "singular value of the centred, lifted snapshots"),
        tried_sag=("1", "sag of the start over that of the cable at rest"),
        tried_sum=("m", "sum of 20 singular values"),
        tried_misfit=("1", "rms of ln(ours / print) over all rows and both columns"),
        tried_misfit_3=("1", "rms of ln(ours / print) over the first three rows and both columns"),
    )
    return provenance.record(result, function="paper.starts.tried", parameters={"step": STEP}, inputs=[base])


def _sag(position: np.ndarray) -> float:
    """Largest distance from the chord [m], negative above it."""
    chord = position[-1] - position[0]
    below = (position - position[0]) @ np.array([chord[1], -chord[0]]) / np.hypot(*chord)
    return float(below[np.abs(below).argmax()])


def _values(given: xr.Dataset) -> np.ndarray:
    try:
        return pod.decompose(chain.simulate(given, step=STEP), rank=SUMMED)["singular_value"].values
    except (RunStopped, SceneError):  # slack links leave the finite numbers at this step, or no cable is so
        return np.full((2, SUMMED), np.nan)


def example3(*, sags: Sequence[float] = EXAMPLE_3_SAGS, steps: Sequence[float] = EXAMPLE_3_STEPS) -> xr.Dataset:
    """Compute the shares of Example 3 with its printed tension, started from shapes of another sag.

    Returns
    -------
    xarray.Dataset
        ``sagging_share (sag, sagging_step, coordinate)``: share of five in the sum of 20 singular values.
    """
    base = scene("example3")
    shares = np.empty((len(sags), len(steps), 2))
    for i, sag in enumerate(sags):
        given = with_start(base, {"start_sag": sag})
        for j, step in enumerate(steps):
            values = pod.decompose(chain.simulate(given, step=step), rank=SUMMED)["singular_value"].values
            shares[i, j] = values[:, :5].sum(axis=1) / values.sum(axis=1)
    result = xr.Dataset(
        {"sagging_share": (("sag", "sagging_step", "coordinate"), shares)},
        coords={"sag": list(sags), "sagging_step": list(steps), "coordinate": ["x", "y"]},
    )
    label(
        result,
        sag=("1", "sag of the start over that of equilibrium"),
        sagging_step=("s", "time step"),
        sagging_share=("1", "share of five in the sum of 20 singular values of Example 3"),
    )
    options = {"sags": list(sags), "steps": list(steps)}
    return provenance.record(result, function="paper.starts.example3", parameters=options, inputs=[base])


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
    """Search the starts from the rest shape of another length: random draws, the best of them polished by Nelder and Mead.

    Parameters
    ----------
    draws
        Number of random pairs.
    polished
        How many of the best are polished.
    cable_lengths, differences
        Ranges of the cable's unstretched length and of what the start's length has more [m].
    most_evaluations
        Runs for each that is polished.
    seed
        Of the random numbers.
    progress
        Called with the part that is done.

    Returns
    -------
    xarray.Dataset
        ``search_cable_length``, ``search_start_length`` [m] and ``search_misfit (draw)`` of the draws, and ``polished_*``
        alike, best first.
    """
    from scipy.optimize import minimize  # costly to import

    base, target = scene("example2"), printed()
    rng = np.random.default_rng(seed)
    cable = rng.uniform(*cable_lengths, size=draws)
    start = cable + rng.uniform(*differences, size=draws)

    def gap(point: np.ndarray) -> float:
        values = _values(with_start(base, {"cable_length_m": point[0], "start_length_m": point[1]}))
        found = float(misfit(values[:, : target.shape[1]], target))
        return found if np.isfinite(found) else 99.0  # no cable, or one that flies apart, is no explanation

    def told(point: np.ndarray, part: float) -> float:
        if progress is not None:
            progress(part)
        return gap(point)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # the logarithm of what flew apart
        found = np.array(
            [told(np.array(pair), 0.7 * i / draws) for i, pair in enumerate(zip(cable, start, strict=True))]
        )
        best = np.argsort(found)[:polished]
        ends = [
            minimize(
                lambda point, i=i: told(point, 0.7 + 0.3 * i / polished),
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
    ends.sort(key=lambda end: end.fun)
    result = xr.Dataset(
        {
            "search_cable_length": ("draw", cable),
            "search_start_length": ("draw", start),
            "search_misfit": ("draw", found),
            "polished_cable_length": ("polished", [end.x[0] for end in ends]),
            "polished_start_length": ("polished", [end.x[1] for end in ends]),
            "polished_misfit": ("polished", [end.fun for end in ends]),
        }
    )
    for name in result.variables:
        units = "m" if str(name).endswith("length") else "1"
        result[name].attrs.update(units=units, long_name=str(name).replace("_", " "))
    options = {
        "draws": draws,
        "polished": polished,
        "cable_lengths": list(cable_lengths),
        "differences": list(differences),
        "most_evaluations": most_evaluations,
        "seed": seed,
    }
    return provenance.record(result, function="paper.starts.search", parameters=options, inputs=[base])
