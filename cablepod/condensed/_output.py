"""From amplitudes of the condensed model back to positions, velocities and tensions, and how far the result can be trusted."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr
from xarray.indexes import PandasIndex

from cablepod.condensed._model import Model
from cablepod.conventions import COORDINATES, ENDS, label
from cablepod.discretisation import _similarity as training
from cablepod.discretisation._chord_frame import Frame
from cablepod.integrate._stepping import Instants
from cablepod.pod import _normal as pod_normal
from cablepod.reduced import _validity as trust


@lru_cache
def _fixed(dims: int, rank: int) -> tuple[dict[Any, PandasIndex], dict[Any, xr.Variable]]:
    """Make names of axes and ends, numbers of modes, which takes longer than a run of a thousand steps."""
    names = {"coordinate": np.array(COORDINATES[:dims]), "mode": np.arange(1, rank + 1), "end": np.array(ENDS)}
    indexes = {key: PandasIndex(values, key, coord_dtype=values.dtype) for key, values in names.items()}
    return indexes, {name: item for index in indexes.values() for name, item in index.create_variables().items()}


def coordinates_of(
    model: Model, times: np.ndarray, links: np.ndarray | None, *, with_arc_length: bool = False
) -> xr.Coordinates:
    """Coordinates of a result, with the indexes that xarray would make of them."""
    fixed, made = _fixed(model.chain.p.dims, model.rank)
    own = {"time": PandasIndex(times, "time")}
    if links is not None:
        own["link"] = PandasIndex(links + 1, "link")
    variables = dict(made)  # a Dataset takes copies of what it is made of
    for index in own.values():
        variables |= index.create_variables()
    if with_arc_length:  # members have each its own
        variables["arc_length"] = xr.Variable("particle", model.chain.arc_length)
    return xr.Coordinates(variables, indexes={**fixed, **own})


@dataclass
class State:
    """What one run gives."""

    instants: Instants
    saved: np.ndarray  #: coordinates at the saved steps (steps, r)
    halves: np.ndarray  #: rates half a step before and after (steps, 2, r)
    extremes: tuple[np.ndarray, np.ndarray] | None  #: of the tensions (n,) [N]
    watch: np.ndarray  #: see ``kernels.condensed.leading_verlet``
    scheme: str
    tension: np.ndarray | None = (
        None  #: of the links asked for at the instants (times, links) [N], where taken on the way
    )

    @property
    def q(self) -> np.ndarray:
        """Coordinates at the instants of the output (times, r)."""
        if not self.instants.dense:
            return self.saved[self.instants.left]
        rates = 0.5 * (self.halves[:, 0] + self.halves[:, 1])
        return self.instants.at_times(self.saved, rates, (self.halves[:, 1] - self.halves[:, 0]) * self.instants.rate)

    @property
    def rates(self) -> np.ndarray:
        """Their rates (times, r)."""
        v = 0.5 * (self.halves[:, 0] + self.halves[:, 1])
        i, s = self.instants.left, self.instants.fraction[:, None]
        after = np.minimum(i + 1, len(v) - 1)
        return np.where(s > 0, (1 - s) * v[i] + s * v[after], v[i])


def sets(model: Model) -> tuple[slice, ...]:
    """Which coordinates are deflections in the plane, and out of it."""
    return (slice(0, model.plane), slice(model.plane, None))[: model.chain.p.dims - 1]


def _closed(model: Model, q: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Chordwise stretch, chordwise force, slopes squared (times, n) of the links, and deflections (normals, times, particle)."""
    from cablepod.condensed import _kernels as kernel

    chain, k = model.chain, model.chain.p.stiffness
    rows = model.rows_at(times)
    deflection = np.stack([q[:, at] @ model.shapes[at] for at in sets(model)])
    squared = ((np.diff(deflection, axis=2) / chain.length) ** 2).sum(axis=0)
    tau = rows[:, 1 : 1 + len(model.taus)] @ model.taus
    if model.order == "leading":
        mean = (tau @ chain.length)[:, None] / chain.total_length
        h = (
            k * (rows[:, :1] / chain.total_length - 1.0 + 0.5 * (squared @ chain.length)[:, None] / chain.total_length)
            - mean
        )
        force = h + tau
        return 1.0 + force / k - 0.5 * squared, force, squared, deflection
    z, h = np.empty_like(squared), np.empty(times.size)
    z[0], h[0] = model.first_stretch(rows[0]), model.guess(rows[0], q[0])
    kernel.close_all(squared, tau, chain.length, np.ascontiguousarray(rows[:, 0]), k, model.green, h, z)
    return z, h[:, None] + tau, squared, deflection


def positions(model: Model, q: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Positions of the particles (times, particle, dims) [m] for coordinates (times, r)."""
    z, _, _, deflection = _closed(model, q, times)
    return _joined(model, z, deflection, times)


def _joined(model: Model, z: np.ndarray, deflection: np.ndarray, times: np.ndarray) -> np.ndarray:
    ends = model.chain.p.end_positions(times)
    frame = Frame.of(ends[:, 1] - ends[:, 0], model.reference)
    position = frame.join(ends[:, 0], _summed(z * model.chain.length), deflection)
    position[:, -1] = ends[:, 1]  # but for rounding, and for modes that are not quite zero there
    return position


def _summed(parts: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros((len(parts), 1)), np.cumsum(parts, axis=1)], axis=1)


def _rates_of_stretch(model: Model, z: np.ndarray, squared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Differentiate the chordwise stretch (times, n) by N / K, and by half the slope squared with the sign turned."""
    if model.order == "leading":
        return np.ones_like(z), np.ones_like(z)
    if model.green:
        bend = 3.0 * z * z + squared - 1.0
        return 2.0 / bend, 2.0 * z / bend
    cube = (z * z + squared) ** 1.5
    return cube / (cube - squared), z / (cube - squared)


def _velocities(
    model: Model, z: np.ndarray, deflection: np.ndarray, rates: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """Velocities (times, particle, dims) [m/s], but for what loads that change in time stretch along the chord."""
    chain, p = model.chain, model.chain.p
    ends, speeds = p.end_positions(times), p.end_positions(times, 1)
    reach, speed = ends[:, 1] - ends[:, 0], speeds[:, 1] - speeds[:, 0]
    frame = Frame.of(reach, model.reference)
    grow, turn, swing = frame.rates(reach, speed)
    moving = np.stack([rates[:, at] @ model.shapes[at] for at in sets(model)])
    slope, slope_rate = (np.diff(item, axis=2) / chain.length for item in (deflection, moving))
    give, lever = _rates_of_stretch(model, z, (slope * slope).sum(axis=0))
    stretching = -lever * (slope * slope_rate).sum(axis=0)
    stretching += give * ((grow - stretching @ chain.length) / (give @ chain.length))[:, None]
    along, along_rate = _summed(z * chain.length), _summed(stretching * chain.length)
    velocity = speeds[:, :1] + along_rate[:, :, None] * frame.along[:, None] + along[:, :, None] * turn[:, None]
    velocity = (
        velocity + np.einsum("ktp,tkc->tpc", moving, frame.normals) + np.einsum("ktp,tkc->tpc", deflection, swing)
    )
    velocity[:, -1] = speeds[:, 1]
    return velocity


def variables(
    model: Model, state: State, outputs: tuple[str, ...], links: np.ndarray | None = None
) -> dict[str, tuple[tuple[str, ...], Any]]:
    """Dimensions and values of what a run gave and of the outputs asked for; tensions of some `links` only, where given."""
    chain, p = model.chain, model.chain.p
    times, q = state.instants.times, state.q
    made: dict[str, tuple[tuple[str, ...], Any]] = {
        f"amplitude{suffix}": (("time", "mode"), padded(q[:, at] @ turn.T, model.rank))
        for suffix, at, turn in zip(pod_normal.SETS, sets(model), model.turned[0], strict=False)
    }
    made["end_position"] = (("time", "end", "coordinate"), p.end_positions(times))
    made["unstretched_length"] = ((), chain.total_length)
    if {"position", "velocity"} & set(outputs):
        z, force, squared, deflection = _closed(model, q, times)
        place = ("time", "particle", "coordinate")
        if "position" in outputs:
            made["position"] = (place, _joined(model, z, deflection, times))
        if "velocity" in outputs:
            made["velocity"] = (place, _velocities(model, z, deflection, state.rates, times))
        if "tension" in outputs:
            tension = _tension(model, z, force, squared)
            made["tension"] = (("time", "link"), tension if links is None else tension[:, links])
    elif "tension" in outputs:
        taken = state.tension
        made["tension"] = (("time", "link"), _tensions(model, q, times, links) if taken is None else taken)
    if state.extremes is not None:
        made["tension_minimum"], made["tension_maximum"] = ((("link",), item) for item in state.extremes)
    return made


def attributes(model: Model, state: State, modes: xr.Dataset | None) -> dict[str, Any]:
    """Tell how a run was made and how far it can be trusted."""
    axial, slowest = model.first_axial_frequency, model.chain.p.time_scale
    return {
        **shared_attributes(model, state.instants, state.scheme, modes),
        "smallest_chordwise_force": float(state.watch[0]),
        "time_of_smallest_force": float(state.watch[1]) / state.instants.rate,
        "first_axial_frequency": axial,
        "forcing_over_axial_frequency": 2.0 * math.pi / slowest / axial if slowest < math.inf else 0.0,
        **({} if model.tests is None else {"growth_over_run": model.growth * float(state.instants.times[-1])}),
        **training.outside(
            modes, model.chain.p, model.chain.total_length, float(state.instants.times[-1]), model.rest_tension
        ),
    }


def shared_attributes(model: Model, instants: Instants, scheme: str, modes: xr.Dataset | None) -> dict[str, Any]:
    """Tell what runs of scenes on the same modes, with the same scheme and step, have alike."""
    kept = {}
    if modes is not None and "energy_share" in modes:
        kept["energy_share_kept"] = float(modes.variables["energy_share"].values[: model.plane].sum())
    return {
        "stage": "trajectory",
        "model": "condensed",
        "order": model.order,
        "law": model.chain.law,
        "rank": model.rank,
        "scheme": scheme,
        "step": 1.0 / instants.rate,
        "number_of_steps": int(instants.steps[-1]),
        **kept,
    }


def dataset(
    model: Model,
    state: State,
    attrs: Mapping[str, Any],
    outputs: tuple[str, ...],
    title: str,
    links: np.ndarray | None = None,
) -> xr.Dataset:
    """Label what a run gave."""
    coords = coordinates_of(model, state.instants.times, links, with_arc_length=True)
    result = label(xr.Dataset(variables(model, state, outputs, links), coords=coords))
    result.attrs = {"title": title_of(model, title), **attrs}
    return result


def title_of(model: Model, title: str) -> str:
    """Title of a result from that of the scene."""
    return f"{title}: condensed model, r = {model.rank}, order {model.order}" + (
        f", {model.chain.law} law" if model.green else ""
    )


def padded(amplitude: np.ndarray, rank: int) -> np.ndarray:
    """Amplitudes (..., modes) with zeros for modes that never moved."""
    missing = rank - amplitude.shape[-1]
    return np.pad(amplitude, [(0, 0)] * (amplitude.ndim - 1) + [(0, missing)]) if missing else amplitude


def _tension(model: Model, z: np.ndarray, force: np.ndarray, squared: np.ndarray) -> np.ndarray:
    """Tensions of the links (times, n) [N]."""
    if model.order == "leading":
        return force * np.sqrt(1.0 + squared)
    k, xi = model.chain.p.stiffness, np.sqrt(z * z + squared)
    return 0.5 * k * xi * (xi * xi - 1.0) if model.green else k * (xi - 1.0)


def _tensions(model: Model, q: np.ndarray, times: np.ndarray, links: np.ndarray | None) -> np.ndarray:
    """Tensions (times, n or some links) [N] alone; to leading order a link needs no other."""
    if links is None or model.order != "leading":
        z, force, squared, _ = _closed(model, q, times)
        tension = _tension(model, z, force, squared)
        return tension if links is None else tension[:, links]
    rows = model.rows_at(times)
    loads = rows[:, 1 : 1 + len(model.taus)]
    k, length = model.chain.p.stiffness, model.chain.total_length
    sag = 0.5 * (q * q) @ model.turned[1]
    force = k * ((rows[:, 0] + sag) / length - 1.0) - loads @ model.means
    slopes = (q[:, at] @ model.slopes[at][:, links] for at in sets(model))
    return (force[:, None] + loads @ model.taus[:, links]) * np.sqrt(1.0 + sum(item * item for item in slopes))


def _check_slack(attrs: Mapping[str, Any], which: str = "") -> None:
    if attrs["smallest_chordwise_force"] < 0.0:
        implicit = attrs["scheme"] != "velocity_verlet"
        long = f" (or the step of {attrs['step']:g} s is too long for what moves)" if implicit else ""
        warnings.warn(
            f"{which}the chordwise force falls to {attrs['smallest_chordwise_force']:.3g} N at "
            f"{attrs['time_of_smallest_force']:.4g} s, below zero: the cable goes slack there, and the condensed "
            f"model is ill-posed{long}; compare with chain.simulate",
            trust.OutOfRangeWarning,
            stacklevel=5,
        )


def _check_forcing(attrs: Mapping[str, Any], which: str = "") -> None:
    trust.check_forcing(attrs, "the condensed model lacks", which)


def _check_growth(attrs: Mapping[str, Any], which: str = "") -> None:
    if attrs.get("growth_over_run", 0.0) > 1.0:
        warnings.warn(
            f"{which}with these test functions small vibrations about rest grow, over the run by a factor of e to "
            f"{attrs['growth_over_run']:.3g} (growth_over_run, above 1): the scene is too far from those that they were "
            "trained on; train them nearer to it, or take the modes without them",
            trust.OutOfRangeWarning,
            stacklevel=5,
        )


#: The number that decides -> what it is multiplied by, above what it is too much, what warns of it.
CHECKS = {
    "smallest_chordwise_force": (-1.0, 0.0, _check_slack),
    "forcing_over_axial_frequency": (1.0, trust.FAST, _check_forcing),
    "growth_over_run": (1.0, 1.0, _check_growth),
    "error_estimate": (1.0, trust.HALF, trust.check_estimate),
}


def warn_out_of_range(attrs: Mapping[str, Any]) -> None:
    """Warn where the numbers of a run say that the model cannot be trusted."""
    for *_, check in CHECKS.values():
        check(attrs)


def warn_of_members(attrs: Mapping[str, list[Any]]) -> None:
    """Warn once for all members, by the worst of each kind."""
    for name, (sign, limit, check) in CHECKS.items():
        values = sign * np.array(attrs.get(name, []), dtype=float)
        bad = values > limit
        if bad.any():
            i = int(np.nanargmax(values))
            worst = {key: of_all[i] for key, of_all in attrs.items()}
            check(worst, f"{int(bad.sum())} of {bad.size} members, of these number {i} the worst: ")
