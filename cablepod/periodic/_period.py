"""Check that multipliers of a period can be computed."""

from __future__ import annotations

from cablepod.errors import RunStopped
from cablepod.periodic._model import PeriodicModel

#: Largest phase of the highest frequency in a period, of 8192 steps that are then four times as long as elsewhere (phases err by
#: 1e-3), and largest decay exponent: e^600 times e^-600 are still numbers.
MAX_PHASE, MAX_DECAY = 8192 * 0.8, 300.0


def check_period(model: PeriodicModel, duration: float) -> None:
    """Stop where a period without dimension is too long for multipliers.

    Raises
    ------
    RunStopped
        If its steps would be too many, or disturbances decay too far.
    """
    if duration * model.fastest_rate > MAX_PHASE:
        raise RunStopped(
            f"a period of {duration / model.scales[0]:.3g} s is too long for multipliers: rates go up to "
            f"{model.fastest_rate * model.scales[0]:.3g} rad/s; try fewer modes, or a higher frequency of the forcing"
        )
    if 0.5 * duration * model.damping > MAX_DECAY:
        raise RunStopped(
            f"damping by mass of {model.damping * model.scales[0]:.3g} 1/s leaves nothing of a disturbance after a period "
            f"of {duration / model.scales[0]:.3g} s; try less damping, or a higher frequency of the forcing"
        )
    if duration * model.slowest_decays[1] > MAX_DECAY:
        kind = (
            f"by the tension of {model.tension_damping / model.scales[0]:.3g} s"
            if model.tension_damping
            else "by ratios or dampers"
        )
        raise RunStopped(
            f"damping {kind} leaves nothing of a disturbance after "
            f"a period of {duration / model.scales[0]:.3g} s; try less damping, or a higher frequency of the forcing"
        )
