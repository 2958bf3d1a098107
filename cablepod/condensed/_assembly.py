"""From a scene's parameters and modes to the condensed model; what cannot be is refused here."""

from __future__ import annotations

import numpy as np
import xarray as xr

from cablepod.catenary._statics import solve_statics
from cablepod.condensed._coefficients import ORDERS
from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._laws import check_law
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import integer
from cablepod.parameters._parameters import Parameters
from cablepod.pod import _normal as pod_normal
from cablepod.pod._snapshots import relative_arc_length

#: Variable of modes that holds test functions of their own, with the suffixes of ``pod_normal.SETS``.
TEST = "test_function"
#: Least points of quadrature: one mode has a slope that changes its sign, and its square two humps.
MIN_QUADRATURE_POINTS = 4
#: Products of the modes' slopes by a rule may be off by this share.  The stiffness is off by as much; links and a smooth curve
#: through the particles differ by (i pi / n)^2 / 12 in mode i, 0.5 % in the third of 40 links.
QUADRATURE_RTOL = 0.01


def model_of(
    p: Parameters, modes: xr.Dataset, *, rank: int | None, order: str, law: str, quadrature: int | None = None
) -> CondensedModel:
    """Make the condensed model of a scene's parameters on modes.

    Raises
    ------
    SceneError
        For a scene or modes that this model cannot do.
    """
    check_law(law)
    if order not in ORDERS:
        raise scene_error("order", order, "one of " + ", ".join(f'"{name}"' for name in ORDERS))
    if order == "leading" and law != "linear":
        raise scene_error("law", law, '"linear" with order "leading", which knows no strain beside the first order')
    if quadrature is not None:
        integer(least=MIN_QUADRATURE_POINTS)("quadrature", quadrature)
        if order == "leading" or p.point_loads:
            raise scene_error(
                "quadrature",
                quadrature,
                'none but with order "exact" or "inertial" and without point loads, which kink the cable',
            )
    if p.free_end is not None:
        raise scene_error(
            "ends.free", p.free_end, "two held ends, because there is no chord without; chain.simulate does a free end"
        )
    if p.link_viscosity is not None:
        raise scene_error(
            "damping.link_viscosity", p.link_viscosity, "none for a reduced model; mass_proportional is possible"
        )
    sets = pod_normal.sets(modes)
    if modes.sizes["coordinate"] != p.dims:
        raise SceneError(
            f"modes: given {modes.sizes['coordinate']} coordinates; allowed: the {p.dims} coordinates of the scene"
        )
    most = max(len(shape) for _, shape in sets)
    if rank is not None:
        integer(least=1)("rank", rank)
        if rank > most:
            raise scene_error("rank", rank, f"at most {most}, as many modes as there are")
    sigma = relative_arc_length(modes)
    total = float(solve_statics(p, p.length_key, p.length_value)[0])
    arc_length = total * sigma
    chain = LumpedChain(p, np.diff(arc_length), arc_length, law)
    chosen = [shape if rank is None else shape[:rank] for _, shape in sets]
    model = CondensedModel(chain, order, tuple(chosen), quadrature, _tests(modes, sets, rank, order, quadrature))
    if quadrature is not None:
        _check_rule(model, trained="trained_quadrature" in modes.attrs)
    return model


def _tests(
    modes: xr.Dataset, sets: list[tuple[str, np.ndarray]], rank: int | None, order: str, quadrature: int | None
) -> tuple[np.ndarray, ...] | None:
    """Return the test functions of each set (mode, particle), where the modes bring some."""
    if f"{TEST}{sets[0][0]}" not in modes:
        return None
    count = modes.sizes["mode"] if rank is None else rank
    most = modes.attrs.get("trained_rank", modes.sizes["mode"])
    if count != most:
        raise scene_error("rank", count, f"{most}, for which the test functions were trained; or modes without them")
    trained = modes.attrs.get("trained_order", order)
    if trained != order:
        raise scene_error(
            "order", order, f'"{trained}", for which the test functions were trained; or modes without them'
        )
    points = modes.attrs.get("trained_quadrature", quadrature or 0)
    if points != (quadrature or 0):
        what = f"{points} points" if points else "none, the links"
        raise scene_error(
            "quadrature", quadrature, f"{what}, for which the test functions were trained; or modes without them"
        )
    return tuple(modes[f"{TEST}{suffix}"].transpose("mode", "particle").values[: len(shape)] for suffix, shape in sets)


def _check_rule(model: CondensedModel, *, trained: bool) -> None:
    """Refuse a rule that does not give the products of the slopes that the links give; test functions are trained with theirs."""
    slopes, _, weights = model.rule
    size = np.sqrt(model.spectral_basis[1])
    off = np.abs((slopes * weights) @ slopes.T - np.diag(model.spectral_basis[1])) / np.outer(size, size)
    if not trained and model.test_slopes_at_points is not None and model.test_stiffness_defect is not None:
        missed = (
            (model.test_slopes_at_points * weights) @ slopes.T
            - np.diag(model.spectral_basis[1])
            - model.test_stiffness_defect
        )
        off = np.maximum(off, np.abs(missed) / np.outer(size, size))
    off[: model.n_in_plane, model.n_in_plane :] = off[model.n_in_plane :, : model.n_in_plane] = (
        0.0  # sets do not meet in the model either
    )
    if off.max() > QUADRATURE_RTOL:
        off_by = (
            f"products of the modes' slopes are off by {100 * off.max():.2g} %, more than {100 * QUADRATURE_RTOL:g} %"
        )
        raise scene_error("quadrature", model.quadrature, f"more points, or fewer or smoother modes, as {off_by}")
