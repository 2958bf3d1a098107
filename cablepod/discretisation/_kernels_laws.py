"""Compiled formulas, see ``_formulas.py``."""

from cablepod._jit import compiled
from cablepod.discretisation import _formulas

linear_secant, green_secant, viscous_secant, damping_by_tension, linear_along, green_along, closure_tension, on_line = (
    compiled(formula, forceinline=True, counted=False, no_cpython_wrapper=True)
    for formula in (
        _formulas.linear_secant, _formulas.green_secant, _formulas.viscous_secant, _formulas.damping_by_tension,
        _formulas.linear_tangent_along, _formulas.green_tangent_along, _formulas.closure_tension, _formulas.on_line,
    )
)  # fmt: skip


@compiled(forceinline=True, counted=False, no_cpython_wrapper=True)
def taut_secant(elastic, total):
    """Return T / xi of a link that only pulls: `total`, or 0 where it is slack or shortens so fast that it would push."""
    return total if elastic > 0.0 and total > 0.0 else 0.0
