"""Compiled material laws, see ``_laws.py``."""

from __future__ import annotations

from cablepod._jit import compiled
from cablepod.discretisation._formulas import damping_by_tension as by_tension
from cablepod.discretisation._formulas import green_secant as green
from cablepod.discretisation._formulas import linear_secant as linear
from cablepod.discretisation._formulas import viscous_secant as viscous

linear_secant, green_secant, viscous_secant, damping_by_tension = (
    compiled(formula, forceinline=True, counted=False, no_cpython_wrapper=True)
    for formula in (linear, green, viscous, by_tension)
)


@compiled(forceinline=True, counted=False, no_cpython_wrapper=True)
def taut_secant(elastic, total):
    """Return T / xi of a link that only pulls: `total`, or 0 where it is slack or shortens so fast that it would push."""
    return total if elastic > 0.0 and total > 0.0 else 0.0
