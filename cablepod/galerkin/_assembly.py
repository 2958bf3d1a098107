"""Assembly of a Galerkin model from a scene and modes; models are kept between calls."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import xarray as xr

from cablepod.catenary._statics import solve_statics
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._laws import check_law
from cablepod.discretisation._modal_damping import refuse_damping_ratios
from cablepod.errors import SceneError, scene_error
from cablepod.galerkin._model import GalerkinModel
from cablepod.parameters._nonuniform import refuse_nonuniform
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._particles import refuse_own
from cablepod.pod._project import mean_of, mode_fields
from cablepod.pod._snapshots import relative_arc_length
from cablepod.wind._air import check_no_wind

#: Number of models kept between calls.
KEPT_MODELS = 32


def model_of(p: Parameters, modes: xr.Dataset, *, rank: int | None, law: str) -> GalerkinModel:
    """Assemble the Galerkin model of a scene's parameters on modes.

    Parameters
    ----------
    p
        Parameters of the scene.
    modes
        Result of :func:`cablepod.pod.decompose`.
    rank
        Number of modes, of each coordinate if separate; None for all.
    law
        "green" or "linear".

    Raises
    ------
    SceneError
        For a free end, viscous links, or modes of other coordinates.
    """
    check_law(law)
    if p.free_end is not None:
        raise scene_error(
            "ends.free", p.free_end, "two held ends, as the modes vanish at both; use chain.simulate for a free end"
        )
    if p.link_viscosity is not None:
        raise scene_error(
            "damping.link_viscosity", p.link_viscosity, "none for a reduced model; use damping.mass_proportional"
        )
    check_no_wind(p, "condensed.simulate or chain.simulate")
    if p.tension_damping is not None:
        raise scene_error(
            "damping.tension_proportional",
            p.tension_damping,
            "none; try: condensed.simulate, or damping.mass_proportional",
        )
    refuse_damping_ratios(p, "condensed.simulate, or damping.mass_proportional")
    refuse_nonuniform(p, "condensed.simulate or chain.simulate")
    refuse_own(p, "chain.simulate")
    fields = mode_fields(modes, rank)
    if fields.shape[2] != p.dims:
        raise SceneError(f"modes: given {fields.shape[2]} coordinates; allowed: the {p.dims} coordinates of the scene")
    mean = mean_of(modes)
    arrays = tuple(np.array(array) for array in (relative_arc_length(modes), mean, fields))
    content = tuple(array.tobytes() for array in arrays)
    return _kept_model(p, _Modes(arrays, content, modes.attrs["layout"], law))


@dataclass(frozen=True)
class _Modes:
    """Modes and law of a model, compared by content."""

    #: relative arc length, mean [m], modes (modes, particle, dims)
    arrays: tuple[np.ndarray, ...] = field(compare=False)
    content: tuple[bytes, ...]
    layout: str
    law: str


@lru_cache(KEPT_MODELS)
def _kept_model(p: Parameters, modes: _Modes) -> GalerkinModel:
    """Make the model of parameters on modes; that of the same parameters and modes is kept with all that follows from it."""
    sigma, mean, fields = modes.arrays
    arc_length = float(solve_statics(p, p.length_key, p.length_value)[0]) * sigma
    return GalerkinModel(LumpedChain(p, np.diff(arc_length), arc_length, modes.law), mean, fields, modes.layout)
