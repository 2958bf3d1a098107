"""Cables of several segments, and what is attached to them: read from a scene, placed on a cable, refused."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import direction as check_direction
from cablepod.parameters._checks import plain
from cablepod.parameters._key_paths import listed_path
from cablepod.parameters._keys import ATTACHED_KEYS, CABLE, PLACE_KEYS, STIFFNESS_KEYS, WEIGHT_KEYS, exactly_one
from cablepod.parameters._parameters import Attachment, Parameters, Segment
from cablepod.parameters._scene_values import listed

#: Distance of places on a cable that count as one, over its length.
SAME_PLACE = 1e-9
#: Keys of the cable of which one is given, so that the one of a segment stands in place of that of the cable.
ALTERNATIVES = (WEIGHT_KEYS, STIFFNESS_KEYS)
#: Lists of these tables.
NONUNIFORM = ("segment", "attachment")
#: Sine of the angle of chord and vertical below which "normal" has no direction.
LEAST_SINE = 1e-9


def of_segment(cable: Mapping[str, Any], segment: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of ``[cable]`` for a segment: its own, and those of the cable that it leaves out."""
    own = {name: value for name, value in segment.items() if name in CABLE}
    replaced = {name for names in ALTERNATIVES for name in names if set(names) & set(own)}
    return {name: value for name, value in cable.items() if name not in replaced} | own


def segment_bounds(tables: Sequence[Mapping[str, Any]], name: str = "segment") -> list[tuple[float, float]]:
    """Return the bounds of segments in the order of their tables, as fractions of the unstretched length.

    A table without ``from`` goes on where the one before it ends, the first one begins at 0, and the last one without ``to``
    ends at 1.  `name` is the path of their list, for messages.

    Raises
    ------
    SceneError
        For segments that overlap, leave gaps or have no length.
    """
    bounds: list[tuple[float, float]] = []
    for number, table in enumerate(tables, start=1):
        path = listed_path(name, number)
        begin = float(table.get("from", bounds[-1][1] if bounds else 0.0))
        if "to" not in table and number < len(tables):
            raise SceneError(
                f"{path}.to: missing; allowed: a fraction of the length, as only the last segment ends at 1"
            )
        end = float(table.get("to", 1.0))
        if not end - begin > SAME_PLACE:
            key, value = ("to", end) if "to" in table else ("from", begin)
            raise scene_error(f"{path}.{key}", value, f"{path}.from below {path}.to (they are {begin:g} and {end:g})")
        bounds.append((begin, end))
    last, before = 0.0, 0
    for number in sorted(range(1, len(bounds) + 1), key=lambda number: bounds[number - 1]):
        begin, path = bounds[number - 1][0], listed_path(name, number)
        if abs(begin - last) > SAME_PLACE:
            other = listed_path(name, before)
            what = f"{last:g}, where {other} ends" if before else "0, the lower end of the cable"
            kind = "overlap" if begin < last else "leave gaps"
            raise scene_error(f"{path}.from", begin, f"{what}: segments do not {kind}")
        last, before = bounds[number - 1][1], number
    if bounds and abs(last - 1.0) > SAME_PLACE:
        raise scene_error(
            f"{listed_path(name, before)}.to", last, "1, the upper end of the cable: segments do not leave gaps"
        )
    return bounds


def with_segments_and_attachments(
    uniform: Parameters,
    tables: Mapping[str, Any],
    make: Callable[[Mapping[str, Any], str], Parameters],
    above: str = "",
) -> Parameters:
    """Return the parameters of a cable with its segments and attachments.

    Parameters
    ----------
    uniform
        Parameters without them.
    tables
        Tables of the scene, with the lists of these.
    make
        Makes the parameters of a uniform cable from its table ``[cable]``; the key path names it in messages.
    above
        Beginning of the paths of their tables, for messages; empty for a scene of one cable.

    Raises
    ------
    SceneError
        The message names the key.
    """
    segments, p = list(listed(tables, "segment", above)), uniform
    borders = borders_now = np.array([0.0, 1.0])
    if segments:
        for path, own in segments:
            for names in ALTERNATIVES:
                if any(name in own for name in names):
                    exactly_one(path, own, names)
        cables = [make(of_segment(tables["cable"], own), path) for path, own in segments]
        bounds = segment_bounds([own for _, own in segments], f"{above}segment")
        cables = [cables[number] for number in sorted(range(len(cables)), key=lambda number: bounds[number])]
        borders = np.array([0.0, *sorted(end for _, end in bounds)[:-1], 1.0])
        lengths = np.diff(borders) * [cable.expansion for cable in cables]
        borders_now = np.concatenate([[0.0], np.cumsum(lengths)[:-1] / lengths.sum(), [1.0]])
        p = _joined(uniform, borders_now, cables, float(lengths.sum()))
        if any(cable.bare is not None for cable in [uniform, *cables]):
            tensioned = [cable.bare or cable for cable in cables]
            p = replace(p, bare=_joined(uniform.bare or uniform, borders, tensioned, 1.0))
    if attachments := _attachments(tables, uniform, above):
        bare = None if p.bare is None else replace(p.bare, attachments=attachments)
        now = tuple(_expanded(attachment, p.expansion, borders, borders_now) for attachment in attachments)
        p = replace(p, attachments=now, bare=bare)
    return p


def _expanded(attachment: Attachment, expansion: float, borders: np.ndarray, borders_now: np.ndarray) -> Attachment:
    """Return an attachment at the temperature of the scene, which moves the borders between the segments."""
    if attachment.place_key != "arc_length":
        return replace(attachment, expansion=expansion, borders=(tuple(borders.tolist()), tuple(borders_now.tolist())))
    return replace(attachment, place=float(np.interp(attachment.place, borders, borders_now)))


def _joined(p: Parameters, borders: np.ndarray, cables: Sequence[Parameters], expansion: float) -> Parameters:
    """Return a cable of segments, uniform where neighbours are equal; numbers of the cable are means over its length."""
    segments: list[Segment] = []
    for begin, end, cable in zip(borders[:-1].tolist(), borders[1:].tolist(), cables, strict=True):
        segment = Segment(
            begin, end, cable.stiffness, cable.area, cable.mass, cable.weight, cable.diameter,
            cable.drag_coefficient, cable.breaking_strength,
        )  # fmt: skip
        if segments and segments[-1].is_like(segment):
            segments[-1] = replace(segments[-1], end=end)
        else:
            segments.append(segment)
    share = np.array([segment.end - segment.start for segment in segments])

    def mean(numbers: Sequence[Any]) -> Any:
        if any(number is None for number in numbers):
            return None
        return numbers[0] if len(numbers) == 1 else float(share @ np.array(numbers))

    diameter = mean([segment.diameter for segment in segments])
    drag = [segment.drag_width for segment in segments]
    strengths = [segment.breaking_strength for segment in segments if segment.breaking_strength is not None]
    compliance = mean([1.0 / segment.stiffness for segment in segments])
    first, length = segments[0], p.length_value
    if p.length_key == "unstretched_length":
        length = length if p.expansion == expansion else length / p.expansion * expansion
    return replace(
        p,
        length_value=length,
        expansion=expansion,
        stiffness=first.stiffness if len(segments) == 1 else 1.0 / compliance,
        area=first.area if len({segment.area for segment in segments}) == 1 else None,
        mass=mean([segment.mass for segment in segments]),
        weight=first.weight if len(segments) == 1 else share @ np.array([segment.weight for segment in segments]),
        diameter=diameter,
        drag_coefficient=mean(drag) / diameter
        if len(segments) > 1 and diameter is not None
        else first.drag_coefficient,
        breaking_strength=min(strengths, default=None),
        segments=tuple(segments) if len(segments) > 1 else (),
    )


def _attachments(tables: Mapping[str, Any], p: Parameters, above: str) -> tuple[Attachment, ...]:
    """Return the attachments that have a mass, drag, damper or spring."""
    attachments = []
    for path, table in listed(tables, "attachment", above):
        place = exactly_one(path, table, PLACE_KEYS)
        if not any(name in table for name in ATTACHED_KEYS):
            raise SceneError(f"{path}: given none of {', '.join(ATTACHED_KEYS)}; allowed: at least one")
        for name in ("damper", "spring"):
            if table.get(name) and "direction" not in table:
                allowed = f'"normal", or a vector, along which the {name} acts'
                raise SceneError(f"{path}.direction: missing; allowed: {allowed}")
        numbers: dict[str, Any] = {name: float(table.get(name, 0.0)) for name in ATTACHED_KEYS}
        given = table.get("direction")
        if any(numbers.values()):
            unit = None if given is None else _unit(f"{path}.direction", given, p)
            weight = np.zeros(p.dims)
            weight[1] = -numbers["mass"] * float(tables["gravity"])
            attachments.append(Attachment(path, place, float(table[place]), weight=weight, direction=unit, **numbers))
    return tuple(attachments)


def _unit(key: str, given: Any, p: Parameters) -> np.ndarray:
    """Return the unit vector of a direction (dims,)."""
    given = check_direction(key, plain(given))
    if not isinstance(given, str):
        vector = np.array(given, dtype=float)
        if vector.size != p.dims:
            raise scene_error(key, given, f"{p.dims} numbers, as many as ends.lower has")
        return vector / math.hypot(*vector)
    chord = np.subtract(p.upper, p.lower)
    chord = chord / math.hypot(*chord)
    normal = -chord[1] * chord
    normal[1] += 1.0
    sine = math.hypot(*normal)
    if sine < LEAST_SINE:
        raise scene_error(key, given, "a vector, as a vertical chord has no normal of its own")
    return np.asarray(normal / sine)


def attachment_fractions(p: Parameters, length: float) -> np.ndarray:
    """Return the places of the attachments as fractions of the unstretched `length` [m], (attachments,).

    Raises
    ------
    SceneError
        For an attachment outside of the cable or at a held end, and for two at one place; the message names the key.
    """
    fractions = np.array([attachment.fraction(length) for attachment in p.attachments])
    for number, (attachment, fraction) in enumerate(zip(p.attachments, fractions, strict=True)):
        key = f"{attachment.key}.{attachment.place_key}"
        if not -SAME_PLACE < fraction < 1.0 + SAME_PLACE:
            raise scene_error(key, attachment.place, f"at most {length:.6g} m, the unstretched length")
        for end, is_there in (("lower", fraction < SAME_PLACE), ("upper", fraction > 1.0 - SAME_PLACE)):
            if is_there and end != p.free_end:
                raise scene_error(key, attachment.place, f"a place between the held ends (this is the {end} one)")
        for other, before in zip(p.attachments[:number], fractions[:number], strict=True):
            if abs(fraction - before) < SAME_PLACE:
                raise scene_error(key, attachment.place, f"another place than that of {other.key}")
    return np.clip(fractions, 0.0, 1.0)


def refuse_nonuniform(p: Parameters, remedy: str) -> None:
    """Refuse segments and attachments in a model that lacks them.

    Raises
    ------
    SceneError
        The message names the table.
    """
    if p.segments:
        raise SceneError(f"segment: given {len(p.segments)} different parts; allowed: none here; try: {remedy}")
    if p.attachments:
        raise SceneError(f"{p.attachments[0].key}: given; allowed: none here; try: {remedy}")
