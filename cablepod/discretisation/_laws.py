"""Material laws: tension, tangent stiffness and strain energy at a stretch.

With the stretch xi (length over unstretched length) and the axial stiffness K the law "linear" is T = K (xi - 1), and "green" is
eq. (21) of the paper, T / xi = K (xi^2 - 1) / 2, whose strain energy is quadratic in the Green strain (xi^2 - 1) / 2.  Slack
links of the linear law are handled by the callers.  The formulas are in ``_formulas.py``, compiled in ``_kernels_laws.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cablepod.discretisation._formulas import green_secant, green_tangent, linear_secant, viscous_secant
from cablepod.errors import scene_error
from cablepod.parameters._checks import choice

LAWS = ("linear", "green")
#: Maximum number of iterations for the strain at a tension.
MAX_ITERATIONS = 60


def check_law(law: str) -> None:
    """Refuse unknown names of laws."""
    choice(*LAWS)("law", law)


def law_of(attrs: Mapping[str, Any]) -> str | None:
    """Return the law that the attributes of a run, or of modes of runs, name; None without."""
    law = attrs.get("law")
    return law if isinstance(law, str) and law in LAWS else None


def check_viscous_law(law: str, viscosity: float | None) -> None:
    """Refuse viscous links, with a viscosity [s], with law "green"."""
    if law == "green" and viscosity is not None:
        raise scene_error(
            "law and damping.link_viscosity",
            (law, viscosity),
            'viscous links with law "linear"; with "green" none, mass_proportional is possible',
        )


def law_tension(stretch: Any, stiffness: Any, *, green: bool) -> Any:
    """Return the tension [N] at a stretch, negative in compression."""
    if green:
        return green_secant(stretch * stretch, stiffness) * stretch
    return stiffness * (stretch - 1.0)


def strain_at(tension: np.ndarray, stiffness: Any, *, green: bool) -> np.ndarray:
    """Return the strain xi - 1 at a tension of at least 0 [N], the inverse of :func:`law_tension`.

    By law "green" it solves e (1 + e) (1 + e/2) = T / K, whose left side is convex and increasing: Newton's method from e = T / K
    falls to the solution, without cancellation for small strains.
    """
    load = tension / stiffness
    if not green:
        return load
    strain = load
    for _ in range(MAX_ITERATIONS):
        lower = strain - (strain * (1.0 + strain) * (1.0 + 0.5 * strain) - load) / green_tangent(
            (1.0 + strain) ** 2, 1.0
        )
        if not (lower < strain).any():
            break
        strain = np.minimum(lower, strain)
    return strain


def taut_secant(
    stretched: np.ndarray, length: Any, stiffness: Any, viscosity: float | None = None, rate: np.ndarray | None = None
) -> np.ndarray:
    """Return T / xi of law "linear" in the units of `stiffness`; 0 where a link is slack, or shortens so fast that T would push.

    `rate` is the inner product of each link's vector, of the length `stretched`, and its rate; None without `viscosity` [s].
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        elastic = total = linear_secant(length / stretched, stiffness)
        if rate is not None:
            total = viscous_secant(elastic, rate, stretched * stretched, viscosity * stiffness)
    return np.where((elastic > 0.0) & (total > 0.0), total, 0.0)


def tangent_stiffness_ratio(squared_stretch: Any) -> Any:
    """Return max(1, (3 xi^2 - 1) / 2), (dT/dxi) / K of law "green"; a compressed link returns through xi = 1."""
    return np.maximum(1.0, green_tangent(squared_stretch, 1.0))


def strain_energy_density(stretch: np.ndarray, *, green: bool) -> np.ndarray:
    """Return the strain energy over K and unstretched length; 0 in compression by the linear law."""
    if green:
        return (stretch**2 - 1.0) ** 2 / 8.0
    return 0.5 * np.maximum(stretch - 1.0, 0.0) ** 2
