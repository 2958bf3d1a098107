"""Guys of several segments, or with attachments: pieces of their catenaries, mean drag on these, their mass at the mast."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cablepod.catenary._piecewise import Pieces, pieces_of
from cablepod.catenary._piecewise_solve import between_ends
from cablepod.discretisation._modal_damping import ratios_error
from cablepod.errors import SceneError
from cablepod.parameters._mast import MastParameters
from cablepod.parameters._nonuniform import attachment_fractions
from cablepod.parameters._parameters import Parameters
from cablepod.wind._drag import body_drag, straight_drag

#: Kinds of guys: with their own motion, as reduced models or as chains; static, as springs in small vibrations.
KINDS = ("condensed", "chain", "catenary")
#: Least number of pieces with a drag of their own, relative last change of the drag, maximum number of iterations.
PIECES, DRAG_RTOL, MAX_ITERATIONS = 40, 1e-11, 60

#: Velocity of the air (points, 3) [m/s] at positions (points, 3) [m] and relative arc lengths (points,).
Air = Callable[[np.ndarray, np.ndarray], np.ndarray]


def kind_of_guys(p: MastParameters) -> str:
    """Return the kind of guys by default: condensed models, and chains where a guy has segments or attachments."""
    return "chain" if first_thing(p) is not None else "condensed"


def kind_in_studies(p: MastParameters) -> str:
    """Return the kind of guys in studies and designs: chains also where a guy breaks.

    The mast then leans or falls towards the other guys, which go slack; condensed ones would hold it by compression.
    """
    return "chain" if any(guy.breaks is not None for guy in p.guys) else kind_of_guys(p)


def first_thing(p: MastParameters) -> str | None:
    """Return the key path of the first segment or attachment of a guy; None without.

    One without effect counts too, so that all members of an ensemble have guys of one kind.
    """
    return next((guy.thing for guy in p.guys if guy.thing is not None), None)


def refuse_things(p: MastParameters, guys: str) -> None:
    """Refuse segments and attachments with guys of a kind that lacks them.

    Raises
    ------
    SceneError
        The message begins with the path of the first one.
    """
    thing = first_thing(p)
    if thing is not None:
        raise SceneError(
            f'{thing}: given; allowed: none with guys "{guys}"; try: guys="chain", which is the default here'
        )


def refuse_ratios(p: MastParameters, guys: str) -> None:
    """Refuse damping by ratios with guys of another kind than condensed ones.

    Raises
    ------
    SceneError
        The message names the key.
    """
    for guy in p.guys:
        if guys != "condensed" and guy.p.damping_ratios is not None:
            remedies = ["damping.mass_proportional"] * (guys == "chain")
            remedies += ['guys="condensed" of mast.simulate'] * (first_thing(p) is None)
            raise ratios_error(guy.p, f'none with guys "{guys}"; try: {", or ".join(remedies)}')


def note_of_ratios(p: MastParameters) -> str | None:
    """Return a note on damping by ratios that studies refuse, as guys are chains there; None without."""
    try:
        refuse_ratios(p, kind_in_studies(p))
    except SceneError:
        why = first_thing(p) or next(f"{guy.key}.breaks" for guy in p.guys if guy.breaks is not None)
        key = ratios_error(p.guys[0].p, "").args[0].partition(":")[0]
        return f"{key}: refused by run and design, whose guys are chains with {why}; try damping.mass_proportional"
    return None


def still_pieces(p: Parameters, length: float) -> Pieces | None:
    """Return the pieces of a guy of an unstretched length [m] in still air; None for a uniform guy that carries nothing.

    Raises
    ------
    SceneError
        For an attachment outside of the guy, at its ends or at the place of another one.
    """
    if not (p.segments or p.attachments):
        return None
    attachment_fractions(p, length)
    return pieces_of(p, length)


def in_mean_wind(p: Parameters, pieces: Pieces, air: Air, density: float, name: str) -> Pieces:
    """Return the pieces of a guy with the mean drag on them and on its attachments.

    The guy is cut into at least forty parts.  The drag on each is that of its segment in its middle, on its chord; that on an
    attachment is a force at its place.  Both follow the shape.

    Parameters
    ----------
    p
        Parameters of the guy between its ends.
    pieces
        Of the guy in still air.
    air
        Mean velocity of the air.
    density
        Density of the air [kg/m3].
    name
        Key path of the length of the guy, for messages.
    """
    total = float(pieces.length.sum())
    bodies = [attachment for attachment in p.attachments if attachment.drag_area]
    places = total * np.array([attachment.fraction(total) for attachment in bodies])
    still = pieces.cut(np.concatenate([total / PIECES * np.arange(1, PIECES), places]))
    ends = np.cumsum(still.length)
    at_body = np.abs(ends[:, None] - places).argmin(axis=0)
    areas = np.array([attachment.drag_area for attachment in bodies])
    middle = (ends - 0.5 * still.length) / total
    widths, chord, loaded = p.drag_widths(middle), p.upper - p.lower, still
    before = np.zeros_like(still.attached)
    for _ in range(MAX_ITERATIONS):
        found = between_ends(loaded, chord, total, name)
        position = p.lower + np.concatenate([np.zeros((1, 3)), found.at(ends)[0]])
        reach = np.diff(position, axis=0)
        wind = air(0.5 * (position[1:] + position[:-1]), middle)
        on_parts = straight_drag(0.5 * density * widths, reach, wind)[0]
        at_places = air(position[1:][at_body], ends[at_body] / total)
        attached = still.attached.copy()
        np.add.at(attached, at_body, body_drag(0.5 * density * areas, at_places))
        loaded = still._replace(load=still.load + on_parts / still.length[:, None], attached=attached)
        total_drag = on_parts + attached - still.attached
        if np.abs(total_drag - before).max() <= DRAG_RTOL * np.abs(total_drag).max():
            break
        before = total_drag
    return loaded


def mass_at_mast(p: Parameters, length: float) -> float:
    r"""Return the mass of a guy of an unstretched length [m] at its upper end [kg]: a third of that of a uniform one.

    It is :math:`\int\mu\sigma^2dS + \sum m\sigma^2`, that of a guy that stays straight.
    """
    if not (p.segments or p.attachments):
        return float(p.mass * length / 3.0)
    parts = [(segment.start, segment.end, segment.mass) for segment in p.segments] or [(0.0, 1.0, float(p.mass))]
    mass = sum(mass * (end**3 - start**3) for start, end, mass in parts) * length / 3.0
    return float(mass + sum(attachment.mass * attachment.fraction(length) ** 2 for attachment in p.attachments))
