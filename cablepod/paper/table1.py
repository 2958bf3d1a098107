"""Reproduce section 3 and Example 1: Table 1 by the paper's procedure and exactly, the guy at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from cablepod import catenary, chain
from cablepod.errors import SceneError
from cablepod.examples import scene, table
from cablepod.paper import independent_chain
from cablepod.paper.datasets import described
from cablepod.paper.examples import CHAIN_TOLERANCE
from cablepod.parameters._from_scene import parameters

#: Axial stiffness over that of the printed data: as printed, and as used in rows 2 to 4 of Table 1.
STIFFNESS_FACTORS = (1.0, 0.01)


@dataclass(frozen=True)
class Inextensible:
    """Inextensible catenary with a given tension at its upper end: eqs. (7)-(16).

    All these equations agree in this convention: y up, weight q > 0 per length, and

        beta = q a / (2 H),  zeta = asinh((b / a) beta / sinh beta),
        V(x) = H sinh(zeta - beta (1 - 2 x / a)),  T(x) = H cosh(zeta - beta (1 - 2 x / a)).

    The print has the other sign in eqs. (7), (9), (12), (13), which exchanges the two ends, ``cos`` for ``cosh`` in
    T1 = H cosh(zeta + beta), and s / L, L0 / L for s / a, L0 / a in eqs. (14) and (16).
    """

    a: float  #: span [m]
    b: float  #: rise [m]
    q: float  #: weight per length [N/m]
    horizontal: float  #: horizontal force H [N]

    @classmethod
    def of_tension(cls, a: float, b: float, q: float, tension: float) -> Inextensible:
        """Find H from the tension at the upper end by the secant method.

        It starts from H = T1 cos(theta), as in the paper.

        Raises
        ------
        SceneError
            If the iteration does not converge.
        """
        from scipy.optimize import newton  # slow to import

        def gap(h: float) -> float:
            return cls(a, b, q, h).tension(a) - tension

        h, result = newton(
            gap, tension * a / math.hypot(a, b), full_output=True, disp=False, rtol=1e-15, tol=1e-13 * tension
        )
        if not result.converged or not abs(gap(h)) < 1e-9 * tension:
            raise SceneError(
                f"top_tension: given {tension} N; allowed: one for which T1 = H cosh(zeta + beta) has a solution"
            )
        return cls(a, b, q, float(h))

    @property
    def beta(self) -> float:
        """Dimensionless weight beta, eq. (10)."""
        return 0.5 * self.q * self.a / self.horizontal

    @property
    def zeta(self) -> float:
        """Dimensionless inclination zeta, eq. (11)."""
        return math.asinh(self.b / self.a * self.beta / math.sinh(self.beta))

    def vertical(self, x: float) -> float:
        """Return the vertical force V(x) [N], eq. (12)."""
        return self.horizontal * math.sinh(self.zeta - self.beta * (1.0 - 2.0 * x / self.a))

    def tension(self, x: float) -> float:
        """Return the tension T(x) [N], eq. (13)."""
        return self.horizontal * math.cosh(self.zeta - self.beta * (1.0 - 2.0 * x / self.a))

    def height(self, x: np.ndarray) -> np.ndarray:
        """Return y(x) [m], eq. (9)."""
        angle = self.zeta - self.beta * (1.0 - 2.0 * np.asarray(x) / self.a)
        return self.horizontal / self.q * (np.cosh(angle) - math.cosh(self.zeta - self.beta))

    @property
    def length(self) -> float:
        """Length of the catenary L [m], eq. (14)."""
        return (self.vertical(self.a) - self.vertical(0.0)) / self.q

    def unstretched_length(self, stiffness: float) -> float:
        """Return L0 = L - (1 / K) int T ds [m] by the linearised eqs. (15), (16)."""
        upper = self.vertical(self.a) * self.tension(self.a)
        lower = self.vertical(0.0) * self.tension(0.0)
        return self.length - (0.5 * self.horizontal * self.a + 0.5 * (upper - lower) / self.q) / stiffness


def inextensible(base: xr.Dataset, tension: float) -> Inextensible:
    """Return the inextensible catenary between the ends of a planar scene, with a tension [N] at its upper end."""
    p = parameters(base)
    a, b = p.upper - p.lower
    return Inextensible.of_tension(float(a), float(b), float(-p.weight[1]), tension)


def table1() -> xr.Dataset:
    """Compute Table 1 by the paper's procedure and exactly, for two stiffnesses.

    Returns
    -------
    xarray.Dataset
        ``table1_unstretched_length (table1_row, table1_stiffness, procedure)`` [m], ``table1_stretched_length`` [m] and
        ``table1_tension_lower`` [N] with the same dimensions, ``table1_*_printed (table1_row)``, and ``table1_source
        (table1_row)``: index of the stiffness with the linearised L0 nearest to the print, with ``table1_misfit`` [m].
    """
    printed = table("table1")
    tensions = printed["top_tension_N"]
    base = scene("example1")
    stiffness = parameters(base).stiffness * np.array(STIFFNESS_FACTORS)
    shape = (tensions.size, stiffness.size, 2)
    unstretched, stretched, lower = np.empty(shape), np.empty(shape), np.empty(shape)
    for i, tension in enumerate(tensions):
        curve = inextensible(base, float(tension))
        for j, k in enumerate(stiffness):
            unstretched[i, j, 0], stretched[i, j, 0] = curve.unstretched_length(k), curve.length
            lower[i, j, 0] = curve.tension(0.0)
            exact = catenary.rest(
                base.assign(cable_youngs_modulus=k / float(base["cable_area"]), cable_top_tension=tension), points=2
            )
            unstretched[i, j, 1], stretched[i, j, 1] = exact["unstretched_length"], exact["stretched_length"]
            lower[i, j, 1] = exact["tension_lower"]
    misfit = np.abs(unstretched[:, :, 0] - printed["unstretched_length_m"][:, None])
    place = ("table1_row", "table1_stiffness", "procedure")
    return described(
        "table1.table1", {},
        {
            "table1_unstretched_length": (place, unstretched, "m", "unstretched length L0 for the tension of the row"),
            "table1_stretched_length": (place, stretched, "m", "stretched length L"),
            "table1_tension_lower": (place, lower, "N", "tension at the lower end T0"),
            "table1_top_tension": ("table1_row", tensions, "N", "tension at the upper end T1"),
            "table1_unstretched_length_printed": ("table1_row", printed["unstretched_length_m"], "m", "L0 as printed"),
            "table1_stretched_length_printed": ("table1_row", printed["stretched_length_m"], "m", "L as printed"),
            "table1_tension_lower_printed": ("table1_row", printed["bottom_tension_N"], "N", "T0 as printed"),
            "table1_elongation_printed": ("table1_row", printed["elongation_m"], "m", "L - L0 as printed"),
            "table1_source": ("table1_row", misfit.argmin(axis=1),
                "1", "index of the stiffness whose linearised L0 is nearest to the print"),
            "table1_misfit": ("table1_row", misfit.min(axis=1), "m", "distance of that L0 from the print"),
        },
        {
            "table1_stiffness": (stiffness, "N", "axial stiffness K"),
            "procedure": (["linearised", "exact"], "1", "linearised: eqs. (9)-(16); exact: elastic catenary"),
        },
        [base],
    )  # fmt: skip


def rest_comparison(
    *, links: tuple[int, ...] = (10, 20, 40, 80, 160), moving_links: int = 20, duration: float = 4.0
) -> xr.Dataset:
    """Compare the guy of Example 1 at rest and in motion with independent solutions.

    The catenary equation (7) is solved as a boundary value problem by SciPy (in the paper by Maple).  The chain at rest is
    compared with the elastic catenary at equal S.  Eqs. (1)-(3) of the chain, in complex coordinates after Wilson, are integrated
    by a Runge-Kutta method of order 8.

    Parameters
    ----------
    links
        Numbers of links of the chain at rest.
    moving_links, duration
        Links and duration [s] of the compared motion (the independent routine is slow).

    Returns
    -------
    xarray.Dataset
        ``rest_gap (rest_links)``: largest distance between particle and catenary [m]; ``catenary_gap``: largest difference of
        height between eq. (9) and the boundary value problem [m]; ``motion_gap``: largest distance between the chain of the
        package and the independent one [m]; ``motion_size``: the largest displacement in that time [m].
    """
    guy = scene("example1")
    gaps = []
    for count in links:
        at_rest = chain.rest(guy, links=count)
        exact = catenary.rest(guy, points=count + 1)  # equally spaced in S, as a uniform chain
        gaps.append(float(np.sqrt(((at_rest["position"] - exact["position"]) ** 2).sum("coordinate")).max()))
    times = np.linspace(0.0, duration, 11)
    coarse = guy.assign(chain_links=moving_links)
    options: dict[str, Any] = {"scheme": "velocity_verlet", "tolerance": CHAIN_TOLERANCE, "outputs": ("position",)}
    ours = chain.simulate(coarse, times=times, **options)["position"].values
    theirs = independent_chain.simulate(coarse, times)
    return described(
        "table1.rest_comparison", {"links": list(links), "moving_links": moving_links, "duration": duration},
        {
            "rest_gap": ("rest_links", gaps,
                "m", "largest distance at rest between a particle of the chain and the elastic catenary"),
            "catenary_gap": ((), _boundary_value_gap(inextensible(guy, float(guy["cable_top_tension"]))),
                "m", "largest difference of height between eq. (9) and a boundary value solver"),
            "motion_gap": ((), float(np.hypot(*np.moveaxis(ours - theirs, -1, 0)).max()),
                "m", "largest distance between two integrations of Example 1's chain"),
            "motion_size": ((), float(np.hypot(*np.moveaxis(ours - ours[0], -1, 0)).max()),
                "m", "largest displacement in that time"),
        },
        {"rest_links": (list(links), "1", "links of the chain at rest")},
        [guy],
    )  # fmt: skip


def _boundary_value_gap(curve: Inextensible) -> float:
    """Return the largest difference [m] of eq. (9) from a numerical solution of eq. (7).

    Eq. (7) with corrected sign: y'' = (q / H) sqrt(1 + y'^2).
    """
    from scipy.integrate import solve_bvp  # slow to import

    x = np.linspace(0.0, curve.a, 101)
    solution = solve_bvp(
        lambda _, y: np.stack([y[1], curve.q / curve.horizontal * np.sqrt(1.0 + y[1] ** 2)]),
        lambda left, right: np.array([left[0], right[0] - curve.b]),
        x,
        np.stack([curve.b * x / curve.a, np.full_like(x, curve.b / curve.a)]),
        tol=1e-10,
    )
    if not solution.success:
        raise SceneError(f"Example 1: the boundary value problem of the catenary was not solved: {solution.message}")
    return float(np.abs(solution.sol(x)[0] - curve.height(x)).max())
