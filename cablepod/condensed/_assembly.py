"""Assembly of the condensed model from parameters and modes, with all refusals."""

from __future__ import annotations

import numpy as np
import xarray as xr

from cablepod.condensed._coefficients import ORDERS
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._rescale import ModeStructure, rescaled_model, unit_model
from cablepod.discretisation._laws import check_law
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import choice, integer
from cablepod.parameters._nonuniform import refuse_nonuniform
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._particles import refuse_own
from cablepod.pod import _normal as pod_normal
from cablepod.pod._project import numbers_of
from cablepod.pod._snapshots import relative_arc_length

#: Minimum number of quadrature points: the squared slope of a single mode already has two maxima.
MIN_QUADRATURE_POINTS = 4
#: Relative tolerance of the modes' slope products by quadrature, an error that the stiffness inherits.  Links and a smooth curve
#: through the particles differ by (i pi / n)^2 / 12 in mode i, 0.5 % in the third mode of 40 links.
QUADRATURE_RTOL = 0.01


def model_of(
    p: Parameters, modes: xr.Dataset, *, rank: int | None, order: str, law: str, quadrature: int | None = None
) -> CondensedModel:
    """Assemble the condensed model of a scene on modes.

    Raises
    ------
    SceneError
        For a scene, modes or options that the condensed model does not support.
    """
    unit = unit_of(p, modes, rank=rank, order=order, law=law, quadrature=quadrature)
    pod_normal.check_axis(modes, np.diff(p.initial_ends, axis=0)[0])
    return rescaled_model(unit, p)


def unit_of(
    p: Parameters, modes: xr.Dataset, *, rank: int | None, order: str, law: str, quadrature: int | None = None
) -> CondensedModel:
    """Return the unit model of a scene on modes, which all scenes with loads of the same kinds and the same normals share.

    Raises
    ------
    SceneError
        As :func:`model_of`.
    """
    _check_options(p, order, law, quadrature)
    sets = pod_normal.sets(modes)
    if modes.sizes["coordinate"] != p.dims:
        raise SceneError(
            f"modes: given {modes.sizes['coordinate']} coordinates; allowed: the {p.dims} coordinates of the scene"
        )
    most = max(len(shape) for _, shape in sets)
    if rank is not None:
        integer(least=1)("rank", rank)
        if rank > most:
            raise scene_error("rank", rank, f"at most {most}, the number of modes")
    retained = tuple(shape if rank is None else shape[:rank] for _, shape in sets)
    numbers = tuple(numbers_of(modes, max(len(shape) for shape in retained)).tolist())
    unit = unit_model(ModeStructure.of(p, relative_arc_length(modes), retained, numbers, (order, law, quadrature)))
    if quadrature is not None:
        _check_quadrature(unit)
    return unit


def _check_options(p: Parameters, order: str, law: str, quadrature: int | None) -> None:
    """Refuse scenes, and combinations of options, that the model does not support."""
    check_law(law)
    choice(*ORDERS)("order", order)
    if order != "leading":
        refuse_nonuniform(p, f'order "leading" in place of "{order}"')
    if p.tension_damping is not None and any(attachment.spring for attachment in p.attachments):
        raise scene_error(
            "damping.tension_proportional", p.tension_damping, "none beside a spring; try: damping.mass_proportional"
        )
    if order == "leading" and law != "linear":
        raise scene_error("law", law, '"linear" with order "leading", which is of first order in the strain')
    if quadrature is not None:
        integer(least=MIN_QUADRATURE_POINTS)("quadrature", quadrature)
        if order == "leading" or p.point_loads:
            raise scene_error(
                "quadrature",
                quadrature,
                'only with order "exact" or "inertial", and without point loads, which kink the cable',
            )
    refuse_own(p, "chain.simulate")
    if p.free_end is not None:
        raise scene_error("ends.free", p.free_end, "two held ends, which define the chord; try: chain.simulate")
    if p.link_viscosity is not None:
        raise scene_error(
            "damping.link_viscosity", p.link_viscosity, "none for a reduced model; try: damping.mass_proportional"
        )


def _check_quadrature(model: CondensedModel) -> None:
    """Refuse a quadrature whose slope products differ from those of the links."""
    slopes, _, weights = model.rule
    kappa, n = np.diag(model.slope_norms_squared), model.n_in_plane
    norms = np.sqrt(model.slope_norms_squared)
    error = np.abs((slopes * weights) @ slopes.T - kappa) / np.outer(norms, norms)
    error[:n, n:] = error[n:, :n] = 0.0  # the model has no products of in-plane and out-of-plane modes
    if error.max() > QUADRATURE_RTOL:
        reason = f"slope products of the modes err by {100 * error.max():.2g} %, more than {100 * QUADRATURE_RTOL:g} %"
        raise scene_error("quadrature", model.quadrature, f"more points, or fewer or smoother modes, as {reason}")
