"""Public function: static numbers of a mast, its first frequencies, and notes on what is unusual."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.batch._members import no_plan, over_members_by
from cablepod.conventions import ENDINGS_OF_AIR, label, names_in_air
from cablepod.errors import SceneError
from cablepod.mast._chain_run import links_of
from cablepod.mast._frequencies import frequencies
from cablepod.mast._output import NAMES
from cablepod.mast._piecewise_guys import first_thing, note_of_ratios
from cablepod.mast._rest import rest
from cablepod.parameters._mast import MastParameters, mast_parameters
from cablepod.parameters._parameters import ramp_of
from cablepod.parameters._utilisation import utilisation_of
from cablepod.scene._mast import MAST_SCENE
from cablepod.scene._mast_notes import notes_of_mast
from cablepod.scene._warnings import without_warnings

#: Number of frequencies.
FREQUENCIES = 6
#: A critical factor of buckling below which a note is made: codes ask for more against imperfections.
LOW_BUCKLING_FACTOR = 3.0
#: Tension of a guy at its anchor over that on the straight mast in still air, below which a note says that it is nearly slack.
NEARLY_SLACK = 0.2
#: Largest displacement at rest over the height beyond which slopes are no longer small.
LARGE_DISPLACEMENT = 0.02
#: Numbers that the wind does not change.
OF_THE_SCENE = ("guy_length", "anchor")
_, OF_STILL_AIR, OF_MEAN_WIND = ENDINGS_OF_AIR
#: Name -> (units, long name) of the numbers of a summary beside those of :func:`rest` and :func:`frequencies`.
NUMBERS = {
    "axial_force_foot": ("N", "axial force at the foot, compression positive"),
    "displacement_largest": ("m", "largest displacement of the mast at rest"),
    "bending_moment_largest": ("N m", "largest bending moment at rest"),
    "frequency": ("Hz", "frequency of small vibrations about rest"),
    "tension_over_breaking_strength": ("1", "tension of the guy at the mast over its breaking strength"),
    "note": ("1", "what is unusual, a line each"),
}


@over_members_by(no_plan, kind=MAST_SCENE)
def summary(scene: xr.Dataset) -> xr.Dataset:
    """Summarise a mast and its guys: rest, first frequencies, and notes on what is unusual.

    Parameters
    ----------
    scene
        Scene with a mast, with or without ``member``; it needs no ``[time]``.

    Returns
    -------
    xarray.Dataset
        ``axial_force_foot`` [N], ``buckling_factor``, where guys break also ``buckling_factor_after_break``,
        ``displacement_largest`` [m], ``bending_moment_largest`` [N m], ``angular_frequency (mode)`` [rad/s], ``frequency
        (mode)`` [Hz], ``mast_share (mode)``; of the guys ``guy_length`` [m], ``guy_tension``, ``guy_tension_anchor (guy)`` [N],
        where given ``tension_over_breaking_strength (guy)``.  ``note`` is a text with a line for each note; empty for a usual
        mast.  Rest is in the mean wind of the scene, with ``wind.ramp`` in the still air from which the wind rises; the
        attribute ``air`` says which.  Where the scene has wind, the numbers in still air and in its mean wind stand side by
        side, with the endings ``_still_air`` and ``_mean_wind`` (nan where a mast with a ramp finds no rest in the full wind).

    Raises
    ------
    SceneError
        As :func:`rest`.

    Notes
    -----
    Notes tell of guys that move as chains, of damping by ratios that these refuse, of a critical factor of buckling below 3,
    guys that are nearly slack at rest, displacements at rest beyond a fiftieth of the height, where slopes are no longer small,
    guys that break after the end of the run, and numbers that are likely in another unit, with that unit: of the mast, of its
    guys as of a cable, of wind, ice, damping and temperatures.  They also tell of a mast in wind without a drag area and of
    levels with fewer than three guys.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> numbers = cp.mast.summary(examples.scene("mast30"))
    >>> round(float(numbers.buckling_factor), 2), numbers.frequency.values[:2].round(2).tolist(), str(numbers.note.values)
    (3.26, [0.73, 0.73], '')
    """
    with without_warnings():  # the notes tell it
        return _summary(scene)


def _summary(scene: xr.Dataset) -> xr.Dataset:
    p = mast_parameters(scene)
    at_rest, variables = _numbers(scene, p)
    if p.wind is not None:
        still = scene.drop_vars([name for name in scene.data_vars if str(name).startswith("wind_")])
        in_wind = _in_mean_wind(scene, variables) if ramp_of(p) else dict(variables)
        parts = (_numbers(still, mast_parameters(still))[1], in_wind)
        for ending, numbers in zip((OF_STILL_AIR, OF_MEAN_WIND), parts, strict=True):
            variables |= {f"{name}{ending}": value for name, value in numbers.items() if name not in OF_THE_SCENE}
    variables["note"] = xr.Variable((), "\n".join(_notes(p, at_rest, _largest_tensions(variables))))
    coords: dict[str, Any] = {"mode": np.arange(1, variables["frequency"].size + 1)}
    if p.guys:
        coords |= {name: at_rest[name] for name in ("guy", "guy_level", "table", "coordinate")}
    result = xr.Dataset(variables, coords=coords)
    names = names_in_air(NAMES | NUMBERS, result)
    label(result, mode=("1", "number of the mode, from 1, by rising frequency"), **names)
    result.attrs = {
        "title": f"{scene.attrs.get('title', 'scene')}: summary",
        "stage": "summary",
        "air": at_rest.attrs["air"],
    }
    return provenance.record(result, function="mast.summary", parameters={}, inputs=[scene])


def _in_mean_wind(scene: xr.Dataset, at_rest: dict[str, xr.Variable]) -> dict[str, xr.Variable]:
    """Return the numbers in the mean wind after a ramp by name, nan where there is no rest."""
    full = scene.assign(wind_ramp=scene["wind_ramp"].copy(data=np.zeros_like(scene["wind_ramp"].values)))
    try:
        return _numbers(full, mast_parameters(full))[1]
    except SceneError:
        return {name: value.copy(data=np.full(value.shape, np.nan)) for name, value in at_rest.items()}


def _numbers(scene: xr.Dataset, p: MastParameters) -> tuple[xr.Dataset, dict[str, xr.Variable]]:
    """Return the rest, and the numbers of rest and vibrations by name."""
    at_rest, modes = rest(scene), frequencies(scene, count=min(FREQUENCIES, 2 * p.elements))
    variables = {
        "axial_force_foot": xr.Variable((), float(at_rest["axial_force"][0])),
        "buckling_factor": at_rest["buckling_factor"].variable,
        **{name: at_rest[name].variable for name in ("buckling_factor_after_break",) if name in at_rest},
        "displacement_largest": xr.Variable((), float(np.linalg.norm(at_rest["displacement"].values, axis=-1).max())),
        "bending_moment_largest": xr.Variable(
            (), float(np.linalg.norm(at_rest["bending_moment"].values, axis=-1).max())
        ),
        "angular_frequency": modes["angular_frequency"].variable,
        "frequency": xr.Variable("mode", modes["angular_frequency"].values / (2.0 * np.pi)),
        "mast_share": modes["mast_share"].variable,
    }
    if p.guys:
        variables |= {
            name: at_rest[name].variable for name in ("guy_length", "guy_tension", "guy_tension_anchor", "anchor")
        }
        used = utilisation_of((guy.p for guy in p.guys), at_rest["guy_tension"].values)
        if used is not None:
            variables["tension_over_breaking_strength"] = xr.Variable("guy", used)
    return at_rest, variables


def _largest_tensions(variables: dict[str, xr.Variable]) -> np.ndarray | None:
    """Return the largest tension of each guy at rest, in the mean wind where there is one [N]; None without guys or rest."""
    ending = OF_MEAN_WIND if f"guy_tension{OF_MEAN_WIND}" in variables else ""
    ends = [variables[f"{name}{ending}"].values for name in ("guy_tension", "guy_tension_anchor") if name in variables]
    return np.max(ends, axis=0) if ends and np.isfinite(ends).all() else None


def _notes(p: MastParameters, at_rest: xr.Dataset, tensions: np.ndarray | None) -> list[str]:
    """Return what is unusual, a line each."""
    notes = []
    for found, changes in notes_of_mast(p, tensions):
        notes += [f"{note.key}: {note.text}" for note in found]
        notes += [f"perhaps {text}" for _, text in changes]
    notes += [] if p.duration is None else p.late_breaks(p.duration)
    if (thing := first_thing(p)) is not None:
        notes.append(f"{thing}: guys move as chains of {links_of(p)} links, which chain.links changes")
    notes += filter(None, [note_of_ratios(p)])
    factor = float(at_rest["buckling_factor"])
    if factor < LOW_BUCKLING_FACTOR:
        notes.append(f"the critical factor of buckling is {factor:.3g}: imperfections, which are not modelled, matter")
    for g, guy in enumerate(p.guys):
        lowest = float(at_rest["guy_tension_anchor"][g])
        given = guy.p.length_value if guy.p.length_key.endswith("tension") else None
        if given is not None and lowest < NEARLY_SLACK * given:
            notes.append(f"guy {g + 1} ({guy.key}) is nearly slack at rest, {lowest:.4g} N at its anchor")
    largest = float(np.linalg.norm(at_rest["displacement"].values, axis=-1).max())
    if largest > LARGE_DISPLACEMENT * p.height:
        notes.append(f"the mast leans by {largest:.3g} m at rest, where slopes are no longer small")
    return notes
