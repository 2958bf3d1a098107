"""Warning of slopes of the mast that its equations take for small."""

from __future__ import annotations

import numpy as np

from cablepod.errors import OutOfRangeWarning, warn
from cablepod.mast._beam import Beam

#: Slope of the mast above which it is not small: its square is about the relative error of the beam's equations.
LARGE_SLOPE = 0.1


def slopes_of(beam: Beam, displacement: np.ndarray) -> np.ndarray:
    """Return the mean slopes of the elements for displacements of the nodes (nodes, 2, ...) [m]: (elements, 2, ...)."""
    return np.diff(displacement, axis=0) / beam.length.reshape(-1, *[1] * (displacement.ndim - 1))


def warn_of_slopes(beam: Beam, slopes: np.ndarray, times: np.ndarray | None = None) -> None:
    """Warn of slopes (instants, elements, 2) that are not small, at instants [s] or at rest."""
    squares = np.einsum("tnd,tnd->tn", slopes, slopes)
    at, element = np.unravel_index(int(squares.argmax()), squares.shape)
    if (largest := float(np.sqrt(squares[at, element]))) > LARGE_SLOPE:
        instant = "at rest" if times is None else f"at {times[at]:.6g} s"
        warn(
            f"the mast slopes by {largest:.3g} (above {LARGE_SLOPE:g}) {instant}, {beam.height[element]:.4g} m above its foot: "
            f"its equations hold for small slopes and err by about their square, {largest**2:.0%}; check guys and loads",
            OutOfRangeWarning,
        )
