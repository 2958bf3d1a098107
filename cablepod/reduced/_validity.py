"""When a reduced model is outside its range: warnings with the number that decides, for single runs and members alike."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

#: Motion of the ends with a frequency above this share of the first axial one makes waves along the cable, which the condensed
#: model lacks, and modes of slower motion.
FAST = 0.2
#: An estimate of the error above this share of the motion says that the modes do not hold it.
HALF = 0.5


class OutOfRangeWarning(UserWarning):
    """A reduced model was used where it cannot be trusted; the message says which number decides."""


def check_forcing(attrs: Mapping[str, Any], what: str, which: str = "") -> None:
    """Warn where loads or ends change so fast that waves run along the cable."""
    ratio = attrs["forcing_over_axial_frequency"]
    if ratio > FAST:
        warnings.warn(
            f"{which}loads or ends change with {ratio:.2g} times the first axial frequency, {attrs['first_axial_frequency']:.3g} "
            f"rad/s (above {FAST}): {what} waves along the cable; compare with chain.simulate",
            OutOfRangeWarning,
            stacklevel=5,
        )


def check_estimate(attrs: Mapping[str, Any], which: str = "") -> None:
    """Warn where the model itself expects an error as large as the motion, or nearly."""
    error = attrs.get("error_estimate", 0.0)
    if error > HALF:
        warnings.warn(
            f"{which}the model expects an error of {error:.2g} times the motion (error_estimate, above {HALF}): these modes do "
            "not hold this scene; give more modes, or modes trained nearer to it, or compare with chain.simulate",
            OutOfRangeWarning,
            stacklevel=5,
        )
