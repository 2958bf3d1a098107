"""Chain of a cable of several segments with attachments: lumped properties, compliances, links between the attachments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._nonuniform import SAME_PLACE, attachment_fractions
from cablepod.parameters._parameters import Parameters


def lumped(arc_length: np.ndarray, borders: Sequence[float], densities: np.ndarray) -> np.ndarray:
    """Distribute densities over the particles by the lever rule, which keeps sums and moments.

    Parameters
    ----------
    arc_length
        Unstretched arc length of the particles (n + 1,) [m].
    borders
        Fractions of the length between which the densities are constant (parts + 1,).
    densities
        Per unstretched length (parts, ...).

    Returns
    -------
    numpy.ndarray
        (n + 1, ...).
    """
    first, last, link, part = _cuts(arc_length, borders)
    middle, length = 0.5 * (first + last), last - first
    upper = (middle - arc_length[link]) / (arc_length[link + 1] - arc_length[link])
    result = np.zeros((arc_length.size, *densities.shape[1:]))
    extra = (1,) * (densities.ndim - 1)
    np.add.at(result, link, (length * (1.0 - upper)).reshape(-1, *extra) * densities[part])
    np.add.at(result, link + 1, (length * upper).reshape(-1, *extra) * densities[part])
    return result


def compliances(arc_length: np.ndarray, borders: Sequence[float], stiffnesses: np.ndarray) -> np.ndarray:
    """Return the stretch of each link by a force of one (n,) [m/N]: that of its parts in series, of stiffnesses (parts,) [N]."""
    first, last, link, part = _cuts(arc_length, borders)
    result = np.zeros(arc_length.size - 1)
    np.add.at(result, link, (last - first) / stiffnesses[part])
    return result


def _cuts(arc_length: np.ndarray, borders: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Cut the links at the borders of parts: lower and upper end [m], number of the link and of the part of each piece."""
    inner = arc_length[-1] * np.asarray(borders[1:-1])
    ends = np.union1d(arc_length, inner)
    first, last = ends[:-1], ends[1:]
    middle = 0.5 * (first + last)
    return first, last, np.searchsorted(arc_length, middle) - 1, np.searchsorted(inner, middle)


def nearest_particles(arc_length: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Return the particles at fractions of the length, of a chain that has them."""
    places = fractions * arc_length[-1]
    nearest = np.abs(arc_length[:, None] - places).argmin(axis=0)
    assert np.abs(arc_length[nearest] - places).max(initial=0.0) <= SAME_PLACE * arc_length[-1]
    return nearest


def lengths_between_attachments(p: Parameters, total: float, links: int, key: str) -> np.ndarray:
    """Return unstretched lengths of links (links,) [m] with a particle at each attachment.

    Links between two attachments are equal.  Each part has one link, and each further link divides the part with the longest
    ones, so that a link is shorter than half of another one only where two places are that close.

    Parameters
    ----------
    p, total, links
        Parameters, unstretched length [m] and number of links.
    key
        Key that gives this number, in errors.

    Raises
    ------
    SceneError
        For fewer links than parts, and for given lengths of links without a particle at an attachment.
    """
    fractions = attachment_fractions(p, total)
    if p.link_lengths is not None:
        ends = np.concatenate([[0.0], np.cumsum(p.link_lengths / p.link_lengths.sum())])
        for attachment, fraction in zip(p.attachments, fractions, strict=True):
            if np.abs(ends - fraction).min() > SAME_PLACE:
                where = f"lengths with a particle at {attachment.key}, at {fraction:.9g} of the length"
                raise scene_error("chain.link_lengths", p.link_lengths.tolist(), where)
        return np.asarray(total * np.diff(ends))
    borders = np.unique(np.concatenate([[0.0], fractions, [1.0]]))
    part = np.diff(borders)
    if links < part.size:
        raise SceneError(
            f"{key}: given {links}; allowed: at least {part.size}, so that there is a particle at each attachment"
        )
    counts = np.ones(part.size, dtype=int)
    for _ in range(links - part.size):
        # of equal ones, the first; rounding does not decide on it
        counts[np.argmax(np.round(part / counts, 12))] += 1
    return np.asarray(total * np.repeat(part / counts, counts))
