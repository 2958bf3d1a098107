"""Numbers of storms on a mast or a guy: extremes of each storm, peaks with intervals, slack guys, damage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from cablepod import extremes, fatigue
from cablepod.archive._manifest import FAILURE
from cablepod.condensed import vibration_modes
from cablepod.conventions import ENDS
from cablepod.errors import RunStopped, SceneError
from cablepod.extremes._peaks import PROBABILITY
from cablepod.fatigue._cycles import warn_of_cut_cycles
from cablepod.integrate._window import within
from cablepod.mast._output import NAMES as MAST_NAMES
from cablepod.mast._piecewise_guys import kind_in_studies, kind_of_guys, refuse_ratios
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._guys import LINKS
from cablepod.parameters._mast import mast_parameters
from cablepod.parameters._utilisation import strengths_of, utilisation

#: Number of vibration modes of one guy in and out of its plane.
RANK = 8
#: Fewest storms whose scatter tells intervals.
FEWEST = 3
#: Seconds in a year.
YEAR = 365.25 * 86400.0
#: What :func:`cablepod.extremes.peaks` gives -> ending of the name here, and text.
STATISTICS = {
    "mean": ("_peak", "mean over the storms of the"), "mean_low": ("_peak_low", "lower bound of the mean of the"),
    "mean_high": ("_peak_high", "upper bound of the mean of the"), "quantile": ("_quantile", f"{PROBABILITY:g} quantile of the"),
    "quantile_low": ("_quantile_low", f"lower bound of the {PROBABILITY:g} quantile of the"),
    "quantile_high": ("_quantile_high", f"upper bound of the {PROBABILITY:g} quantile of the"),
}  # fmt: skip
#: Numbers of each storm of a mast.
OF_MAST = (
    "guy_tension_minimum", "guy_tension_maximum", "guy_tension_mean", "fatigue_range", "displacement_largest",
    "bending_moment_largest", "shear_force_largest", "axial_compression_minimum", "axial_compression_maximum",
    "foot_force_minimum", "foot_force_maximum", "foot_force_horizontal_largest", "anchor_force_minimum",
    "anchor_force_maximum", "anchor_force_largest", "anchor_force_horizontal_largest", "guy_axial_force_minimum",
)  # fmt: skip
#: Names of the numbers of one guy: units and long name.
CABLE_NAMES = {
    "tension_minimum": ("N", "least tension at the end over all steps"),
    "tension_maximum": ("N", "largest tension at the end over all steps"),
    "axial_force_minimum": ("N", "least chordwise force over all steps, negative where the guy is slack"),
}


@dataclass(frozen=True)
class Kind:
    """A kind of scene: its model, and which of its numbers have peaks."""

    model: str
    line: str  #: dimension of the lines with tensions: guys of a mast, ends of one guy
    tension: str  #: the base of the names of tensions
    peaks: Mapping[str, str]  #: number of each storm -> name of its peaks
    always: str  #: number that all storms have
    least_force: str  #: number that is not above 0 where a guy is slack

    def options(self, scene: xr.Dataset) -> dict[str, Any]:
        """Return the options of the model.

        Raises
        ------
        SceneError
            For damping by ratios where guys are chains.
        """
        if self.model != "mast":
            return {"outputs": ("tension", "tension_extremes"), "links": [1, _links_of(scene)]}
        guys = kind_in_studies(p := mast_parameters(scene))
        refuse_ratios(p, guys)
        own = {} if guys == kind_of_guys(p) else {"guys": guys}
        return {"outputs": ("guy_tension", "extremes", "envelopes"), **own}

    def modes(self, scene: xr.Dataset) -> xr.Dataset | None:
        """Return the modes of the model."""
        return None if self.model == "mast" else vibration_modes(
            scene, rank=min(RANK, _links_of(scene) - 1), links=_links_of(scene)
        )  # fmt: skip

    def lines(self, scene: xr.Dataset) -> list[Any]:
        """Return the parameters of the lines."""
        if self.model == "mast":
            return [guy.p for guy in mast_parameters(scene).guys]
        return [parameters(scene)] * len(ENDS)

    def areas(self, scene: xr.Dataset) -> list[Any]:
        """Return the areas of the cross-sections of the lines [m2], or None."""
        return [p.area for p in self.lines(scene)]

    def check_areas(self, scene: xr.Dataset) -> None:
        """Refuse a damage by stresses of cables without an area.

        Raises
        ------
        SceneError
            Names ``reference_range``.
        """
        areas = self.areas(scene)
        if not areas:
            raise SceneError("shares: given for a mast without guys; allowed: none")
        is_mast = self.model == "mast"
        paths = [f"cables.{guy.name}" for guy in mast_parameters(scene).guys] if is_mast else ["cable"] * len(areas)
        for path, area in zip(paths, areas, strict=True):
            if area is None or not np.isfinite(float(area)):
                raise SceneError(
                    f"reference_range: given for cables without an area; allowed: {path}.area [m2] too, as it is a stress [Pa]"
                )

    def numbers(
        self, part: xr.Dataset, scene: xr.Dataset, curve: tuple[float, float] | None, window: tuple[float, float] | None
    ) -> xr.Dataset:
        """Return the numbers of some storms over ``member``, loaded; with slope and range of an S-N curve also the damage."""
        if self.model == "mast":
            result = part[[name for name in OF_MAST if name in part]]
            series = part.get("guy_tension")
        else:
            result, series = _of_cable(part)
        strengths = strengths_of(self.lines(scene))
        if np.isfinite(strengths).any():
            result = result.assign(
                breaking_strength=(self.line, strengths, {"units": "N", "long_name": "breaking strength of the cable"})
            )
        result = result.assign(failure=("member", part["failure"].values.astype(str), FAILURE))
        result = result.drop_vars([name for name in result.coords if "member" in result[name].dims]).load()
        if curve is not None and series is not None:
            series = series.isel(time=within(series["time"].values, window))
            warn_of_cut_cycles(series.load(), curve[0], "the range, and the damage by its power,")
            stress = series / xr.DataArray(np.array(self.areas(scene), dtype=float), dims=self.line)
            damage = fatigue.damage(
                stress.assign_attrs(units="Pa", long_name="stress"), slope=curve[0], reference_range=curve[1]
            )
            result["damage"] = damage.drop_vars(list(damage.coords)).assign_attrs(
                units="1", long_name="Miner's sum of the stress in the storm"
            )
        return result


MAST = Kind(
    "mast", "guy", "guy_tension",
    peaks={
        "guy_tension_maximum": "guy_tension", "displacement_largest": "displacement", "anchor_force_largest": "anchor_force",
        "anchor_force_horizontal_largest": "anchor_force_horizontal", "anchor_uplift_maximum": "anchor_uplift",
        "foot_force_horizontal_largest": "foot_force_horizontal", "foot_force_vertical_maximum": "foot_force_vertical",
        "bending_moment_largest": "bending_moment", "shear_force_largest": "shear_force",
        "axial_compression_maximum": "axial_compression",
    },
    always="displacement_largest",
    least_force="guy_axial_force_minimum",
)  # fmt: skip
CABLE = Kind(
    "condensed", "end", "tension", peaks={"tension_maximum": "tension"}, always="tension_maximum",
    least_force="axial_force_minimum",
)  # fmt: skip


def _links_of(scene: xr.Dataset) -> int:
    """Return the number of links of one guy."""
    return parameters(scene).links or LINKS


def _of_cable(part: xr.Dataset) -> tuple[xr.Dataset, xr.DataArray | None]:
    """Return the numbers of one guy in some storms, and its tensions at both ends over time."""
    coords = {"end": ("end", list(ENDS), {"units": "1", "long_name": "end of the cable"})}
    result = xr.Dataset(coords=coords)
    for name in ("tension_minimum", "tension_maximum"):
        if name in part:
            result[name] = (("member", "end"), part[name].transpose("member", "link").values)
    if "smallest_chordwise_force" in part:
        result["axial_force_minimum"] = ("member", part["smallest_chordwise_force"].values)
    for number, variable in result.data_vars.items():
        units, text = CABLE_NAMES[str(number)]
        variable.attrs = {"units": units, "long_name": text}
    series = None
    if "tension" in part:
        tension = part["tension"]
        series = xr.DataArray(
            tension.transpose("member", "time", "link").data, dims=("member", "time", "end"),
            coords={"time": tension["time"]}, attrs=tension.attrs,
        )  # fmt: skip
    return result, series


def joined(parts: list[xr.Dataset], kind: Kind) -> xr.Dataset:
    """Join the numbers of parts along ``member``; a part whose storms all failed has nan.

    Raises
    ------
    RunStopped
        If all storms of all parts failed, with the reason of the first.
    """
    whole = [part for part in parts if kind.always in part]
    if not whole:
        reason = parts[0]["failure"].values[0]
        raise RunStopped(f"all storms failed, the first: {reason}; try: cablepod run of one storm", parts[0])
    complete = []
    for part in parts:
        if kind.always not in part:
            first = whole[0].isel(member=np.zeros(part.sizes["member"], dtype=int)).drop_vars("failure")
            part = first.map(lambda own: own if "member" not in own.dims else xr.full_like(own, np.nan)).assign(
                failure=part["failure"]
            )
        complete.append(part)
    return xr.concat(complete, "member", data_vars="minimal", coords="minimal", compat="override", join="override")


def with_peaks(result: xr.Dataset, kind: Kind, level: float) -> xr.Dataset:
    """Return the numbers with their peaks over the storms, utilisation, the governing case, and slack storms."""
    result = _with_verticals(result) if kind is MAST else result
    for number, name in kind.peaks.items():
        if number not in result:
            continue
        values = result[number]
        for statistic, numbers in _statistics(values, level).items():
            ending, text = STATISTICS[statistic]
            labels = {"units": values.attrs["units"], "long_name": f"{text} {values.attrs['long_name']}"}
            result[name + ending] = numbers.assign_attrs(labels)
    peak = f"{kind.tension}_peak"
    if peak not in result:
        return result
    if "breaking_strength" in result:
        result["utilisation"] = utilisation(result[peak], result["breaking_strength"]).assign_attrs(
            units="1", long_name="mean over the storms of the largest tension, over breaking strength"
        )
    where = result[peak].fillna(-np.inf).argmax(("direction", "speed"))
    for name, text in (("direction", "direction of the wind"), ("speed", "wind speed")):
        labels = {"units": result[name].attrs["units"], "long_name": f"{text} with the largest peak of the tension"}
        result[f"governing_{name}"] = (kind.line, result[name].values[where[name].values], labels)
    if kind.least_force in result:
        result["slack_storms"] = (
            (result[kind.least_force] <= 0.0)
            .sum("storm")
            .assign_attrs(units="1", long_name="number of storms in which the guy is slack, at any time")
        )
    return result


def _with_verticals(result: xr.Dataset) -> xr.Dataset:
    """Return the numbers with the vertical forces on foundations: down on the foot, up on the anchors."""
    down = -result["foot_force_minimum"].sel(coordinate="y", drop=True)
    labels = {"units": "N", "long_name": "largest downward force of the mast on its foundation, at the output times"}
    result["foot_force_vertical_maximum"] = down.assign_attrs(labels)
    if "anchor_force_maximum" in result:
        labels = {"units": "N", "long_name": "largest upward force of the guy on its anchor, at the output times"}
        up = result["anchor_force_maximum"].sel(coordinate="y", drop=True)
        result["anchor_uplift_maximum"] = up.assign_attrs(labels)
    return result


def _statistics(values: xr.DataArray, level: float) -> dict[str, xr.DataArray]:
    """Return mean and quantile of the storms' largest values with their intervals; nan where a storm failed.

    Failed storms may be the worst ones.  Two storms or one have a mean alone.
    """
    complete = values.notnull().all("storm")
    if values.sizes["storm"] < FEWEST or not complete.any():
        return {"mean": values.mean("storm", skipna=False)}
    found = extremes.peaks(values, dim="storm", level=level)
    return {name: found[name].where(complete) for name in STATISTICS}


def with_rest(result: xr.Dataset, found: xr.Dataset) -> xr.Dataset:
    """Return the numbers with those that are `found` of the mast at rest in the mean winds, by direction and speed."""
    sizes = (result.sizes["direction"], result.sizes["speed"])
    for name in ("buckling_factor", "buckling_factor_after_break"):
        if name in found:
            units, text = MAST_NAMES[name]
            labels = {"units": units, "long_name": f"{text}, at rest in the mean wind"}
            result[name] = (("direction", "speed"), found[name].values.reshape(sizes), labels)
    if "anchor" in found:
        anchor = found["anchor"]
        if "member" in anchor.dims:  # the same in all winds, nan where the mast has no rest
            anchor = anchor.dropna("member").isel(member=0, drop=True)
        result["anchor"] = (("guy", "coordinate"), anchor.values, {"units": "m", "long_name": "position of the anchor"})
    return result


def with_damage(result: xr.Dataset, kind: Kind, shares: Any, duration: float) -> xr.Dataset:
    """Return the numbers with shares (direction, speed), the damage in a year, and the life by it.

    `duration` is the time of a storm that counts [s].
    """
    result["share"] = (
        ("direction", "speed"), shares, {"units": "1", "long_name": "share of the time in which the wind is this one"}
    )  # fmt: skip
    yearly = (result["damage"].mean("storm", skipna=False) * result["share"]).sum(("direction", "speed"), skipna=False)
    yearly = yearly * (YEAR / duration)
    result["damage_per_year"] = yearly.assign_attrs(units="1", long_name="Miner's sum in a year")
    with np.errstate(divide="ignore"):
        life = 1.0 / yearly
    result["fatigue_life"] = life.assign_attrs(units="year", long_name="time until Miner's sum is 1")
    return result
