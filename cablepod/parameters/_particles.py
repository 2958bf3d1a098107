"""Chains with masses and stiffnesses of their own, eq. (3) of the paper: checks, means over the cable, refusal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import plain
from cablepod.parameters._keys import CABLE, LENGTH_KEYS, STIFFNESS_KEYS, WEIGHT_KEYS, describe
from cablepod.parameters._parameters import Parameters

#: Key of ``[chain]`` -> how many values it has beyond those of the links, and the keys of ``[cable]`` that it replaces.
OWN: Mapping[str, tuple[int, tuple[str, ...]]] = {"masses": (1, WEIGHT_KEYS), "stiffness": (0, STIFFNESS_KEYS)}
#: Length that own masses and stiffnesses need.
LENGTH = "unstretched_length"
#: Largest ratio of two masses or two stiffnesses (rounding of the stiffest link stays below the force of the softest one).
MAX_RATIO = 1e9


def own_names(chain: Mapping[str, Any]) -> list[str]:
    """Return which of the keys :data:`OWN` a table ``[chain]`` has."""
    return [name for name in OWN if name in chain]


def number_of_links(chain: Mapping[str, Any]) -> int | None:
    """Return the number of links that the lists of a table ``[chain]`` give; None without any."""
    if "link_lengths" in chain:
        return len(chain["link_lengths"])
    return next((len(chain[name]) - OWN[name][0] for name in own_names(chain)), None)


def check_links(chain: Mapping[str, Any]) -> None:
    """Refuse relative lengths of links that are not as many as the links, or differ too much.

    Raises
    ------
    SceneError
        The message names the key.
    """
    lengths, links = chain.get("link_lengths"), chain.get("links")
    if lengths is None:
        return
    if links is not None and links != len(lengths):
        allowed = f"{int(links)} numbers, as many as chain.links says"
        raise scene_error("chain.link_lengths", plain(lengths), allowed)
    if not 0.0 < max(lengths) <= 1e6 * min(lengths):
        allowed = "lengths that differ by a factor of at most 1e6"
        raise scene_error("chain.link_lengths", plain(lengths), allowed)


def check_own(cable: Mapping[str, Any], chain: Mapping[str, Any], initial: Mapping[str, Any]) -> None:
    """Refuse masses and stiffnesses that do not fit the links of their chain, or stand beside keys that they replace.

    Parameters
    ----------
    cable, chain, initial
        Tables of the scene.

    Raises
    ------
    SceneError
        The message names the key.
    """
    links = int(chain["links"]) if "links" in chain else number_of_links(chain)
    for name in own_names(chain):
        more, replaced = OWN[name]
        key, values = f"chain.{name}", np.asarray(chain[name], dtype=float)
        if LENGTH not in cable:
            given = [other for other in LENGTH_KEYS if other in cable]
            other = scene_error(f"cable.{given[0]}", cable[given[0]], f"cable.{LENGTH} beside {key}") if given else None
            raise other or SceneError(f"cable.{LENGTH}: missing; allowed: {describe(CABLE[LENGTH])}, which {key} needs")
        for other_name in replaced:
            if other_name in cable:
                of = ", also by a strand" if "strand" in cable else ""
                raise scene_error(f"cable.{other_name}", cable[other_name], f"none beside {key}{of}")
        for other_name in (other for other in initial if other != "points"):
            allowed = f"none beside {key}, as no other length says what the particles do; try: initial.points"
            raise scene_error(f"initial.{other_name}", initial[other_name], allowed)
        if values.shape != (links + more if links else -1,):
            what = "one more than links, both ends included" if more else "one for each link"
            raise scene_error(key, values.tolist(), f"{(links or 0) + more} numbers, {what}")
        if not (np.isfinite(values).all() and values.min() > 0.0 and values.max() <= MAX_RATIO * values.min()):
            allowed = f"finite numbers above 0 that differ by a factor of at most {MAX_RATIO:g}"
            raise scene_error(key, values.tolist(), allowed)


def lengths_of_links(total: float, links: int, relative: np.ndarray | None) -> np.ndarray:
    """Return the unstretched lengths of the links (links,) [m], equal or in the given ratios."""
    relative = np.ones(links) if relative is None else relative
    return total * (relative / relative.sum())


def tributary_lengths(length: np.ndarray) -> np.ndarray:
    """Return the unstretched length that each particle carries (n + 1,) [m], half of the links beside it."""
    half = 0.5 * length
    return np.concatenate([half[:1], half[:-1] + half[1:], half[-1:]])


def with_means(cable: Mapping[str, Any], chain: Mapping[str, Any], free_end: str | None) -> Mapping[str, Any]:
    """Return a table ``[cable]`` with mass per length and axial stiffness of what a checked table ``[chain]`` has of its own.

    They are those of a uniform cable of the same mass and compliance.  The mass of a held end moves nothing, and is left out.
    """
    own = own_names(chain)
    if not own:
        return cable
    total, links, relative = float(cable[LENGTH]), number_of_links(chain) or 0, chain.get("link_lengths")
    length = lengths_of_links(total, links, None if relative is None else np.asarray(relative, dtype=float))
    means = {}
    if "masses" in own:
        free = slice(free_end != "lower", links + (free_end == "upper"))
        means["mass_per_length"] = float(np.sum(chain["masses"][free]) / np.sum(tributary_lengths(length)[free]))
    if "stiffness" in own:
        means["axial_stiffness"] = total / float(np.sum(1.0 / np.asarray(chain["stiffness"])))
    return {**cable, **means}


def refuse_own(p: Parameters, remedy: str) -> None:
    """Refuse masses and stiffnesses of a chain in a model of another kind.

    Raises
    ------
    SceneError
        The message names the key.
    """
    if p.own_keys:
        given = "given masses of particles" if p.masses is not None else "given stiffnesses of links"
        raise SceneError(f"{p.own_keys[0]}: {given}; allowed: a cable without them; try: {remedy}")
