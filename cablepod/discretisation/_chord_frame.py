"""The frame of the chord: positions of a cable as distance along the chord of the moment and deflection normal to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cablepod.discretisation._chain import square
from cablepod.errors import SceneError

#: Cosine to the chord above which an axis does not serve to say which normal lies "in the plane".
ALIGNED = 0.98


@dataclass(frozen=True)
class ChordFrame:
    """Unit vectors along and across the chord at some instants.

    In the plane the one normal is the chord direction turned by a right angle.  In space the first normal is as close to
    `reference` as a normal can be (the vertical, but for a vertical chord); the second completes a right-handed system.
    """

    chord: np.ndarray  #: distance of the ends (times,) [m]
    along: np.ndarray  #: (times, dims)
    normals: np.ndarray  #: (times, dims - 1, dims)
    reference: int  #: axis that tells the normals apart, in space

    @classmethod
    def of(cls, reach: np.ndarray, reference: int | None = None) -> ChordFrame:
        """Make the frames of chords (times, dims) [m], from the lower end to the upper one.

        Raises
        ------
        SceneError
            Where the ends meet, or in space the chord turns into the reference axis, or where there is one coordinate only.
        """
        if reach.shape[1] not in (2, 3):
            raise SceneError(
                f"coordinate: given {reach.shape[1]}; allowed: 2 or 3 of them, as deflections are normal to the chord"
            )
        chord = np.sqrt(square(reach))
        if not chord.min(initial=np.inf) > 0.0:
            raise SceneError(
                "ends: they meet at some instant; allowed: a distance, as deflections are normal to the chord"
            )
        along = reach / chord[:, None]
        if reach.shape[1] == 2:
            return cls(chord, along, np.stack([-along[:, 1], along[:, 0]], axis=1)[:, None], 1)
        if reference is None:
            reference = 1 if abs(along[0, 1]) < ALIGNED else int(np.argmin(np.abs(along[0])))
        part = along[:, reference, None]
        if np.abs(part).max() >= 0.5 * (1.0 + ALIGNED):
            raise SceneError(
                f"motion: the chord turns into the axis {'xyz'[reference]}; allowed: one that stays away from the axis that "
                "tells deflection in the plane from deflection out of it"
            )
        first = (np.eye(3)[reference] - part * along) / np.sqrt(1.0 - part**2)
        return cls(chord, along, np.stack([first, np.cross(along, first)], axis=1), reference)

    def rates(self, reach: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rates of chord (times,), direction (times, dims) and normals for rates of the chords `speed` (times, dims) [m/s]."""
        grow = np.sum(speed * self.along, axis=1)
        turn = (speed - grow[:, None] * self.along) / self.chord[:, None]
        if reach.shape[1] == 2:
            return grow, turn, np.stack([-turn[:, 1], turn[:, 0]], axis=1)[:, None]
        k, first = self.reference, self.normals[:, 0]
        part, rate = self.along[:, k, None], turn[:, k, None]
        size = np.sqrt(1.0 - part**2)
        one = (-rate * self.along - part * turn) / size + first * part * rate / size**2
        return grow, turn, np.stack([one, np.cross(turn, first) + np.cross(self.along, one)], axis=1)

    def split(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances along the chord (times, particle) and deflections (normals, times, particle) of positions, both in m."""
        from_lower = position - position[:, :1]
        return (
            np.einsum("tpc,tc->tp", from_lower, self.along),
            np.einsum("tpc,tkc->ktp", from_lower, self.normals),
        )

    def join(self, lower: np.ndarray, along: np.ndarray, deflection: np.ndarray) -> np.ndarray:
        """Positions (times, particle, dims) from those of the lower end and what :meth:`split` gives."""
        position = lower[:, None] + along[:, :, None] * self.along[:, None]
        return position + np.einsum("ktp,tkc->tpc", deflection, self.normals)


def stretch_to_close(slopes: np.ndarray, length: np.ndarray, chord: np.ndarray) -> np.ndarray:
    """Chordwise stretch (times, n) of links that are all stretched alike and reach from end to end.

    Parameters
    ----------
    slopes
        Squares of the deflections' differences over the unstretched lengths (times, n).
    length
        Unstretched lengths (n,) [m].
    chord
        Distance of the ends (times,) [m].
    """
    squared = np.broadcast_to(slopes.max(axis=1), chord.shape)
    # the sum of sqrt(xi^2 - w'^2) is concave and rises with xi: from a start on the left Newton's method comes down from above
    xi = np.sqrt(np.maximum((chord / length.sum()) ** 2, squared * (1.0 + 1e-12)) + slopes.mean(axis=1))
    for _ in range(60):
        z = np.sqrt(np.maximum(xi[:, None] ** 2 - slopes, 1e-300))
        change = (chord - z @ length) / ((xi[:, None] / z) @ length)
        xi = np.maximum(xi + change, np.sqrt(squared) * (1.0 + 1e-12))
        if np.abs(change).max() < 1e-15 * xi.max():
            break
    return np.sqrt(np.maximum(xi[:, None] ** 2 - slopes, 0.0))
