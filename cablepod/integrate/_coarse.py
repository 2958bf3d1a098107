"""Warning of links that are too few for the motion of a cable, by numbers that are known before the run."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cablepod.batch._members import inside_members
from cablepod.catenary._sag import irvine_parameter
from cablepod.catenary._statics import solve_statics
from cablepod.discretisation._chain import square
from cablepod.errors import CoarseWarning, SceneError, warn
from cablepod.parameters._from_scene import Members
from cablepod.parameters._parameters import Parameters, ramp_of
from cablepod.parameters._time_functions import SINES
from cablepod.scene._warnings import checked_members

#: Links for each half wave that is driven below which an error of more than LIKELY is likely.
LINKS_PER_HALF_WAVE = 8.0
#: Part of the motion that is free vibration, over that of an undamped mass which its support starts to move at once; and least
#: distance of the squared frequency from resonance.
FREE_PART, RESONANCE = 0.5, 0.05
#: Nodes of elements of a higher order for each half wave, of which two resolve it.
NODES_PER_HALF_WAVE = 4.0
#: Error without a warning, as a fraction of the motion.
LIKELY = 0.01
#: Maximum error without a warning of the load by gusts on the first vibration; the motion errs by 1.2 to 1.9 times as much.
GUSTS = 0.03
#: Error from which links do not resolve the motion.
LARGE = 0.1
#: Rms over the cable of a parabolic deflection of height 1, and of a deflection that falls linearly from 1 at one end.
PARABOLA, LINE = math.sqrt(8.0 / 15.0), math.sqrt(1.0 / 3.0)
#: Number of instants at which the motion of the ends is sampled.
INSTANTS = 201


class Driven(NamedTuple):
    """What drives a cable, in numbers that decide on its links."""

    half_waves: float  #: that are driven along the cable, at least one; 0 where nothing moves
    drift: float  #: distance by the phase of free vibrations of n links over the motion, times the square of n
    sag: float  #: distance of the shape of n links from the continuous cable over the motion, times the square of n

    @property
    def links(self) -> float:
        """Number of links from which an error of more than LIKELY is unlikely."""
        return max(LINKS_PER_HALF_WAVE * self.half_waves, math.sqrt(max(self.drift, self.sag) / LIKELY))

    def reason(self, links: int) -> str:
        """Say why links are too few."""
        if self.sag > max(self.drift, LIKELY * links**2):
            return "the sag of so few links differs by more"
        if self.drift > LIKELY * links**2:
            return "vibrations of so few links lose their phase"
        return f"{links / self.half_waves:.3g} for each half wave that is driven, of {LINKS_PER_HALF_WAVE:g}"


def remedy_of(links: int, error: float) -> str:
    """Return what to do where some links have an estimated error in space that is too large.

    The error falls with the square of the links once they resolve the motion; a large one falls later, and asks for more.
    """
    enough = math.ceil(links * math.sqrt(error / LIKELY))
    about = "about" if error < LARGE else "at least"
    links_given = "chain.links of the scene, or the option links"
    return f"try {about} {enough} links ({links_given}), or cable.simulate, which chooses its elements by a tolerance"


def warn_of_few_links(p: Parameters, links: int, end_time: float, *, prefix: str = "") -> None:
    """Warn if the links are so few that an error in space of more than LIKELY is likely; not within members.

    Parameters
    ----------
    p
        Parameters of a scene; what follows from them is computed once.
    links, end_time
        Number of links, and end of the run [s].
    prefix
        Begins the message.
    """
    if inside_members() or len(p.initial.get("points", ())) == links + 1:  # particles that the user has placed
        return
    driven, equal = driven_of(p, end_time), links
    if p.link_lengths is not None:  # as fine as the longest link
        equal = math.floor(float(np.sum(p.link_lengths) / np.max(p.link_lengths)) + 1e-9)
    if equal < driven.links:
        _warn(f"{prefix}links: given {links}", driven.reason(equal), f"links={math.ceil(driven.links)}")


def warn_of_coarse_gusts(air: Any, links: int) -> None:
    """Warn if particles in gusts are so far apart that the load errs by more than GUSTS; `air` along a chain, None for still."""
    if air is None or not air.interval < math.inf or inside_members():
        return
    error = air.sampling_error
    if error > GUSTS:
        least = air.air.sigma.size - 1
        why = f"the load of gusts at {least + 1} points on {links + 1} particles errs by {100.0 * error:.2g} %"
        _warn(f"links: given {links}", why, f"links={least}")


def warn_of_few_links_in(members: Members, links: int | None, times: np.ndarray | None) -> None:
    """Warn of the member, of those that are looked at, that needs most links; `links` and `times` [s] replace the scene's."""
    needs: dict[int, float] = {}
    for i in checked_members(members):
        count = links or members[i].links
        needs[i] = driven_of(members[i], end_time_of(members[i], times)).links / count if count else 0.0
    worst = max(needs, key=needs.__getitem__)
    count, prefix = links or members[worst].links, f"member {members.name(worst)}, the worst of {len(members)}: "
    warn_of_few_links(members[worst], count or 0, end_time_of(members[worst], times), prefix=prefix)


def end_time_of(p: Parameters, times: np.ndarray | None) -> float:
    """Return the end of a run [s], 0 where the scene has none."""
    return float(times[-1]) if times is not None else p.duration or 0.0


def warn_of_few_elements(p: Parameters, elements: int, order: int, end_time: float) -> None:
    """Warn if the nodes of a given number of elements are so few that an error in space of more than LIKELY is likely."""
    half_waves = driven_of(p, end_time).half_waves
    least = LINKS_PER_HALF_WAVE if order == 1 else NODES_PER_HALF_WAVE
    if elements * order < least * half_waves and not inside_members():
        why = f"{elements * order / half_waves:.3g} nodes for each half wave that is driven, of {least:g}"
        given = f"elements: given {elements} of order {order}"
        _warn(given, why, f"elements={math.ceil(least * half_waves / order)}, or none, which chooses them by tolerance")


def _warn(given: str, why: str, remedy: str) -> None:
    warn(
        f"{given}, too few for the continuous cable: an error of more than {100.0 * LIKELY:g} % of the motion is likely ({why}); "
        f'try {remedy}; the output "error_estimate" tells the error of a run',
        CoarseWarning,
    )


@lru_cache(64)
def driven_of(p: Parameters, end_time: float) -> Driven:
    """Return what drives a cable until `end_time` [s], by the equations of the README of this package."""
    starts = bool(p.free_end or p.initial or p.turbulence or ramp_of(p))  # whatever moves, moves one half wave
    if end_time == 0.0 or not (starts or p.time_functions()) or p.own_keys:  # a chain of its own stands for no cable
        return Driven(0.0, 0.0, 0.0)
    try:
        statics = solve_statics(p, p.length_key, p.length_value)
    except (SceneError, ArithmeticError):
        return Driven(0.0, 0.0, 0.0)  # the run says why
    length, tension = float(statics[0]), float(statics[4:].mean())
    passage = _passage(p, length, tension)
    ratio = 2.0 * passage / p.shortest_time_scale
    if starts or not tension > 0.0:
        return Driven(max(1.0, ratio), 0.0, 0.0)
    loads = p.load_factor is not None or any(load.factor is not None for load in p.point_loads)
    return Driven(max(1.0, ratio), _drift(p, passage, end_time), 0.0 if loads else _sag(p, length, tension, end_time))


def _passage(p: Parameters, length: float, tension: float) -> float:
    """Return the time of a transverse wave along the cable [s]; 0 where it is unknown."""
    if p.free_end is None:
        return length * math.sqrt(p.mass / tension) if tension > 0.0 else 0.0
    load = math.hypot(*p.load_at(0.0))
    return 0.0 if p.initial or load == 0.0 else 2.0 * math.sqrt(length * p.mass / load)  # it hangs


def _drift(p: Parameters, passage: float, end_time: float) -> float:
    """Return the distance by the phase of free vibrations over the motion, times n^2 [1]; `passage` [s] of a transverse wave.

    Sines that begin at once leave free vibrations; a ramp does not.
    """
    sines = [item for item in p.time_functions().values() if item.kind in SINES and not np.any(item.ramp)]
    ratio = 2.0 * passage / min((float(item.shortest_time_scale) for item in sines), default=math.inf)
    lasting = min(end_time, 2.0 / p.mass_damping) if p.mass_damping else end_time
    free = FREE_PART * ratio**2 / max(abs(1.0 - ratio**2), RESONANCE)
    return math.pi**2 / 24.0 * free * math.pi / passage * lasting


def _sag(p: Parameters, length: float, tension: float, end_time: float) -> float:
    """Return the rms distance of the shape at rest of n links from the continuous cable over the motion, times n^2 [1]."""
    ends = p.end_positions(np.linspace(0.0, end_time, INSTANTS))
    reach = ends[:, 1] - ends[:, 0]
    chords = np.sqrt(square(reach))
    along, chord, load = reach[0] / chords[0], float(chords[0]), p.load_at(0.0)
    normal = math.sqrt(float(square(load - (load @ along) * along)))
    sag = normal * length**2 / (8.0 * tension)
    if sag == 0.0:
        return 0.0
    irvine = irvine_parameter(normal, length, tension, p.stiffness)
    sag_by_length = PARABOLA * 3.0 * chord / (16.0 * sag) * irvine / (irvine + 12.0)
    moved = math.sqrt(float(square(ends - ends[0]).max()))
    motion = math.hypot(LINE * moved, sag_by_length * float(np.abs(chords - chord).max()))
    return sag_by_length * 8.0 * sag**2 / (3.0 * chord) / motion if motion > 0.0 else 0.0
