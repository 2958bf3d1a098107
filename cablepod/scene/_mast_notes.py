"""Notes on what is unusual in a scene with a mast, the key that is likely wrong, and the warning of the models."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod.errors import SceneError
from cablepod.parameters._guys import Guy
from cablepod.parameters._keys import LENGTH_KEYS
from cablepod.parameters._mast import MastParameters, mast_parameters
from cablepod.parameters._parameters import ramp_of
from cablepod.scene._note import Note, outside
from cablepod.scene._notes import likely_keys, notes_of, notes_of_gusts, remedy, worst_first
from cablepod.scene._table_notes import (
    IN_PERCENT,
    LARGEST_DAMPING_RATIO,
    notes_of_damping,
    notes_of_gravity,
    notes_of_phase,
    notes_of_temperatures,
    notes_of_wind,
)
from cablepod.scene._warnings import checked_members, may_warn, text_of_warning, warn_with

#: Usual heights of masts [m]; the highest has 646 m.
HEIGHT = (0.5, 1000.0)
#: Usual mass per length of a mast [kg/m]: rods of fibre to towers of wind turbines.
MASS = (0.5, 2e4)
#: Maximum usual drag area per length of a mast [m].
LARGEST_DRAG_AREA = 50.0
#: Young's modulus over density of steel and aluminium [m2/s2], by which bending stiffness and mass give a radius of gyration.
MODULUS_OVER_DENSITY = 2.6e7
#: Usual ratios of the height to this radius: a stout tower, which stands without guys, to a whip.
SLENDERNESS = (20.0, 2500.0)
#: Usual ratios of the radius of the anchors to the level of the guy.
RADIUS_OVER_LEVEL = (0.05, 10.0)
#: Least usual number of guys of a level; guys whose levels differ by less than this share of the height are of one level.
GUYS_OF_LEVEL, SAME_LEVEL = 3, 0.02
#: Factors between units that are mistaken for each other, and the name of the unit in which a value was likely given.
UNITS: dict[str, dict[float, str]] = {
    "mass": {1e3: "t/m", 1e-3: "g/m"},
    "bending_stiffness": {1e3: "kN m2", 1e6: "MN m2", 1e-3: "", 1e-6: "N mm2"},
    "height": {1e-3: "mm", 1e3: "km"},
    "radius": {1e-3: "mm", 1e3: "km"},
}
#: Column of a section in :attr:`MastParameters.bare`.
COLUMNS = {"bending_stiffness": 2, "mass": 3}

#: Notes, the worst first, and key paths and changes that explain them.
Found = tuple[Sequence[Note], list[tuple[str, str]]]


def notes_of_mast(p: MastParameters, tensions: np.ndarray | None = None) -> list[Found]:
    """Return the notes on a mast, its guys and its tables, each with the changes that explain them, the worst first.

    Parameters
    ----------
    p
        Parameters of the scene.
    tensions
        Largest tension of each guy at rest in the mean wind [N]; by default notes are about the guys in still air.
    """
    found = [
        _of_structure(p),
        *(_of_guys(p, number, tensions) for number in dict.fromkeys(guy.table for guy in p.guys)),
    ]
    found = sorted((part for part in found if part[0]), key=lambda part: -part[0][0].excess)
    tables = worst_first(_notes_of_tables(p))
    seen = {note[:2] for note in tables}  # tables that all guys share
    result: list[Found] = []
    for notes, changes in [*found, (tables, [])]:
        own = [note for note in notes if note[:2] not in seen or notes is tables]
        seen.update(note[:2] for note in own)
        if own:
            result.append((own, changes))
    return result


def _of_structure(p: MastParameters) -> Found:
    """Return the notes on the mast alone."""
    notes = worst_first(_notes_of_structure(p))
    changes = []
    for key, factors in UNITS.items():
        for factor, unit in factors.items() if notes and key != "radius" else ():
            if not any(_notes_of_structure(_scaled(p, key, factor))):
                changes.append((f"mast.{key}", _times(f"mast.{key}", factor, unit)))
                break
    return notes, changes


def _times(what: str, factor: float, unit: str) -> str:
    return f"{what} times {factor:g}" + (f" (given in {unit}?)" if unit else "")


def _scaled(p: MastParameters, key: str, factor: float) -> MastParameters:
    """Return a mast with its height, or one quantity of all its sections, times a factor."""
    if key == "height":
        return replace(p, height=p.height * factor)
    bare = p.bare.copy()
    bare[:, COLUMNS[key]] *= factor
    return replace(p, bare=bare)


def _notes_of_structure(p: MastParameters) -> Iterator[Note]:
    yield from outside("mast.height", "a height", p.height, HEIGHT, "m")
    for bottom, top, stiffness, mass, drag_area in p.bare:
        where = "" if len(p.bare) == 1 else f" from {bottom:g} to {top:g} m"
        yield from outside("mast.mass", f"a mass per length of the mast{where}", mass, MASS, "kg/m")
        radius = math.sqrt(stiffness / mass / MODULUS_OVER_DENSITY)
        what = f"a radius of gyration{where} of {radius:.3g} m, from bending stiffness and mass, and a height over it, a ratio"
        yield from outside("mast.bending_stiffness", what, p.height / radius, SLENDERNESS, "")
        yield from outside("mast.drag_area", f"a drag area{where}", drag_area, (0.0, LARGEST_DRAG_AREA), "m")


def _of_guys(p: MastParameters, number: int, tensions: np.ndarray | None) -> Found:
    """Return the notes on the guys of a table, as of one cable with the largest of their tensions."""
    indices = [index for index, guy in enumerate(p.guys) if guy.table == number]
    guy = p.guys[indices[0]]
    ratio = [*_note_of_radius(guy, 1.0)]
    try:
        with np.errstate(all="ignore"):
            of_cable = notes_of(guy.p, None if tensions is None else float(np.max(tensions[indices])))
    except (SceneError, ArithmeticError):
        of_cable = ()  # rest refuses the scene
    notes = [*ratio, *(note._replace(key=path_of_guy(guy, note.key)) for note in of_cable)]
    return notes, _changes_of_radius(guy) if ratio else _changes_of_cable(guy)


def _note_of_radius(guy: Guy, factor: float) -> Iterator[Note]:
    """Yield the note of a radius times a factor; none where the anchor is at the axis."""
    radius = factor * math.hypot(guy.p.lower[0], guy.p.lower[2])
    what = f"anchors {radius:.3g} m from the mast and a level of {guy.level:.3g} m, with a ratio"
    yield from outside(f"{guy.key}.radius", what, radius / guy.level, RADIUS_OVER_LEVEL, "")


def _changes_of_radius(guy: Guy) -> list[tuple[str, str]]:
    key = f"{guy.key}.radius"
    factors = (item for item in UNITS["radius"].items() if not any(_note_of_radius(guy, item[0])))
    return [(key, _times(key, *item)) for item in factors]


def _changes_of_cable(guy: Guy) -> list[tuple[str, str]]:
    """Return key paths and changes of the cable of a guy that leave nothing unusual; the ends are those of a mast."""
    changes = [change for change in likely_keys(guy.p) if change[0] != "ends.upper"]
    return [(path_of_guy(guy, path), path_of_guy(guy, text)) for path, text in changes]


def path_of_guy(guy: Guy, text: str) -> str:
    """Return a text with the key paths of a guy in place of those of a scene of its cable alone."""

    def path(found: re.Match[str]) -> str:
        return f"{guy.key if found[1] in LENGTH_KEYS else f'cables.{guy.name}'}.{found[1]}"

    return re.sub(r"\bcable\.(\w+)", path, text)


def guy_hint(guy: Guy) -> str:
    """Return the remedy "; try: ..." of the error of a guy whose refusal one key in another unit explains; else empty."""
    return remedy(_changes_of_radius(guy) if any(_note_of_radius(guy, 1.0)) else _changes_of_cable(guy))


def mast_hint(p: MastParameters) -> str:
    """Return the end of the error of a mast without rest: the remedy, or else the number, that is likely the reason; or empty."""
    found = notes_of_mast(p)
    for notes, changes in found:
        if notes[0].excess > 0.0:
            return remedy(changes) or f"; {notes[0].key}: the scene has {notes[0].text}"
    few = (note for notes, _ in found for note in notes if note.key.endswith(".count"))
    return "".join(f"; {note.key}: the scene has {note.text}" for note in itertools.islice(few, 1))


def _notes_of_tables(p: MastParameters) -> Iterator[Note]:
    yield from notes_of_temperatures(p.temperatures)
    yield from notes_of_gravity(p.gravity)
    yield from notes_of_wind(p.wind, p.duration)
    yield from notes_of_gusts(p, {guy.table: guy.p for guy in p.guys}.values())
    yield from notes_of_damping(p.guy_damping_ratios)
    what = "a damping ratio of the mast"
    yield from outside("mast.damping_ratio", what, p.damping_ratio, (0.0, LARGEST_DAMPING_RATIO), "", IN_PERCENT)
    for load in p.loads:
        yield from notes_of_phase(load.key, load.factor)
    if p.wind is not None and not p.sections[:, 4].any():
        yield Note("mast.drag_area", "a mast whose drag area is missing, or 0: the wind acts on the guys alone", 0.0)
    done: list[float] = []
    for guy in p.guys:
        if any(abs(guy.level - level) <= SAME_LEVEL * p.height for level in done):
            continue
        done.append(guy.level)
        near = sum(abs(guy.level - other.level) <= SAME_LEVEL * p.height for other in p.guys)
        if near < GUYS_OF_LEVEL:
            guys = "one guy" if near == 1 else f"{near} guys"
            text = f"{guys} at the level of {guy.level:g} m (usual: at least {GUYS_OF_LEVEL}; a missing count is 1)"
            yield Note(f"{guy.key}.count", text, 0.0)


# --- the warning --------------------------------------------------------------------------------------------------------


def warn_of_unusual_mast(p: MastParameters, tension: Any = None) -> None:
    """Warn of the worst note on a mast, at the user's line; not within members.

    Parameters
    ----------
    p
        Parameters of the scene.
    tension
        Tensions of the guys at the rest from which a run starts (guys, ends) [N]; not of use where the wind has a ramp.
    """
    if not may_warn():
        return
    found = notes_of_mast(p, None if tension is None or ramp_of(p) or not p.guys else np.max(tension, axis=1))
    notes = [note for part in found for note in part[0]]
    warn_with(text_of_warning(notes, found[0][1] if found else []))


def warn_of_unusual_mast_members(scene: xr.Dataset) -> None:
    """Warn of the worst note on some members of a scene with a mast, in still air."""
    for index in checked_members(range(scene.sizes["member"])) if may_warn() else ():
        with suppress(SceneError):  # the run of that member says why
            p = mast_parameters(scene.isel(member=index))
            if notes_of_mast(p):
                warn_of_unusual_mast(p)
                return
