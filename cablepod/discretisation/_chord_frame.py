"""Co-rotating chord frame: positions as distances along the chord and deflections normal to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cablepod.discretisation._chain import square
from cablepod.errors import SceneError

#: Maximum cosine between the first chord and the vertical for normals that refer to it.
ALIGNED = 0.98
#: Maximum cosine between a chord and its reference: the angle between them, which the normals are divided by, may halve once.
MAX_COSINE = 0.5 * (1.0 + ALIGNED)


@dataclass(frozen=True)
class ChordFrame:
    """Unit vectors along and normal to the chord at given instants.

    In the plane the normal is the chord direction turned by a right angle.  In space the first normal is the projection of
    `reference`; the second completes a right-handed system.  Frames with the vertical as reference turn about the chord when it
    leaves its vertical plane; with their first normal at the start as reference they hardly do.
    """

    chord: np.ndarray  #: distance of the ends (times,) [m]
    along: np.ndarray  #: (times, dims)
    normals: np.ndarray  #: (times, dims - 1, dims)
    reference: np.ndarray  #: unit vector (dims,) whose part normal to the chord is the first normal in space

    @classmethod
    def of(cls, reach: np.ndarray, reference: np.ndarray | None = None) -> ChordFrame:
        """Compute the frames of chord vectors (times, dims) [m], from the lower to the upper end.

        `reference` is by default the axis that :func:`reference_axis` chooses for the first chord.

        Raises
        ------
        SceneError
            If the ends meet, if the chord turns into the reference in space, or if there is one coordinate only.
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
            return cls(chord, along, np.stack([-along[:, 1], along[:, 0]], axis=1)[:, None], np.array([0.0, 1.0]))
        if reference is None:
            reference = reference_axis(reach[0])
        if np.abs(along @ reference).max() >= MAX_COSINE:
            raise SceneError(
                f"motion: the chord turns into the direction {(reference.round(3) + 0.0).tolist()}, which its normals refer to; "
                "allowed: one that stays away from it"
            )
        first = first_normals(along, reference)
        return cls(chord, along, np.stack([first, np.cross(along, first)], axis=1), reference)

    def rates(self, reach: np.ndarray, reach_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the rates of chord (times,), direction (times, dims) and normals for chord rates (times, dims) [m/s]."""
        chord_rate = np.sum(reach_rate * self.along, axis=1)
        along_rate = (reach_rate - chord_rate[:, None] * self.along) / self.chord[:, None]
        if reach.shape[1] == 2:
            return chord_rate, along_rate, np.stack([-along_rate[:, 1], along_rate[:, 0]], axis=1)[:, None]
        first = self.normals[:, 0]
        cosine, cosine_rate = (self.along @ self.reference)[:, None], (along_rate @ self.reference)[:, None]
        sine = np.sqrt(1.0 - cosine**2)
        first_rate = (-cosine_rate * self.along - cosine * along_rate) / sine + first * cosine * cosine_rate / sine**2
        second_rate = np.cross(along_rate, first) + np.cross(self.along, first_rate)
        return chord_rate, along_rate, np.stack([first_rate, second_rate], axis=1)

    def split(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split positions into distances along the chord (times, particle) and deflections (normals, times, particle) [m]."""
        from_lower = position - position[:, :1]
        return (
            np.einsum("tpc,tc->tp", from_lower, self.along),
            np.einsum("tpc,tkc->ktp", from_lower, self.normals),
        )

    def join(self, lower: np.ndarray, along: np.ndarray, deflection: np.ndarray) -> np.ndarray:
        """Join the parts of :meth:`split` and the position of the lower end to positions (times, particle, dims) [m]."""
        position = np.empty((*along.shape, lower.shape[1]))
        for c in range(lower.shape[1]):  # by coordinate: loops over the particles, not over two or three axes
            position[:, :, c] = lower[:, c, None] + along * self.along[:, c, None]
            position[:, :, c] += sum(part * self.normals[:, k, c, None] for k, part in enumerate(deflection))
        return position


def reference_axis(chord: np.ndarray) -> np.ndarray:
    """Return the axis (..., 3) closest to the first normals of chords (..., 3): the vertical, for chords near it the flattest."""
    cosine = np.abs(chord) / np.sqrt(square(chord))[..., None]
    return np.eye(3)[np.where(cosine[..., 1] < ALIGNED, 1, np.argmin(cosine, axis=-1))]


def first_normals(along: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the part of unit vectors `reference` (..., 3) normal to unit vectors `along` (..., 3), of unit length."""
    cosine = (along * reference).sum(axis=-1, keepdims=True)
    return (reference - cosine * along) / np.sqrt(1.0 - cosine**2)


def normals_at_start(chord: np.ndarray) -> np.ndarray:
    """Return the first normals (..., dims) at chords (..., dims) [m] that the normals of their later motion refer to."""
    along = chord / np.sqrt(square(chord))[..., None]
    if chord.shape[-1] == 2:
        return np.stack([-along[..., 1], along[..., 0]], axis=-1)
    return first_normals(along, reference_axis(chord))


def stretch_to_close(slopes: np.ndarray, length: np.ndarray, chord: np.ndarray) -> np.ndarray:
    """Return the chordwise stretch (times, n) of equally stretched links that reach from end to end.

    Parameters
    ----------
    slopes
        Squared slopes: differences of the deflections over the unstretched lengths, squared (times, n).
    length
        Unstretched lengths (n,) [m].
    chord
        Distance of the ends (times,) [m].
    """
    steepest = np.broadcast_to(slopes.max(axis=1), chord.shape)
    # the sum of sqrt(xi^2 - w'^2) is concave and increasing in xi, so that Newton's method converges
    xi = np.sqrt(np.maximum((chord / length.sum()) ** 2, steepest * (1.0 + 1e-12)) + slopes.mean(axis=1))
    for _ in range(60):
        z = np.sqrt(np.maximum(xi[:, None] ** 2 - slopes, 1e-300))
        change = (chord - z @ length) / ((xi[:, None] / z) @ length)
        xi = np.maximum(xi + change, np.sqrt(steepest) * (1.0 + 1e-12))
        if np.abs(change).max() < 1e-15 * xi.max():
            break
    return np.sqrt(np.maximum(xi[:, None] ** 2 - slopes, 0.0))
