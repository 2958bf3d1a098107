"""Models of all scenes on the same modes: coefficients of a unit cable times powers of mass and length.

Modes are functions of sigma = S / L0.  The coefficients of a cable of unit mass and unit length therefore depend on the modes and
on which loads there are, not on the numbers of a scene; they are computed once for each set of modes and kept.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cablepod.catenary._statics import solve_statics
from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chain import LumpedChain
from cablepod.parameters._parameters import Parameters

#: Number of unit models kept: sets of modes, ranks and orders that a session alternates between.
UNIT_MODELS = 32


@dataclass(frozen=True)
class ModeStructure:
    """Modes, options and kinds of loads, which determine the coefficients of a unit cable; compared by content."""

    sigma: np.ndarray = field(compare=False)  #: relative arc length of the particles (n + 1,)
    modes: tuple[np.ndarray, ...] = field(compare=False)  #: modes of each set (mode, particle)
    raw_test_functions: tuple[np.ndarray, ...] | None = field(compare=False)  #: see ``Coefficients``
    p: Parameters = field(compare=False)  #: any parameters with these kinds of loads
    order: str
    law: str
    quadrature: int | None
    key: tuple[Any, ...]  #: content of the fields that are not compared

    @classmethod
    def of(
        cls,
        p: Parameters,
        sigma: np.ndarray,
        modes: tuple[np.ndarray, ...],
        raw_test_functions: tuple[np.ndarray, ...] | None,
        options: tuple[str, str, int | None],
    ) -> ModeStructure:
        """Make the structure of a scene on modes; `options` are order, law and quadrature."""
        arrays = (sigma, *modes, *(raw_test_functions or ()))
        content = tuple((array.shape, array.tobytes()) for array in arrays)
        loads = (p.dims, bool(p.motions), tuple(load.fraction for load in p.point_loads))
        key = (content, raw_test_functions is None, loads)
        return cls(sigma, modes, raw_test_functions, p, *options, key)


@lru_cache(UNIT_MODELS)
def unit_model(structure: ModeStructure) -> CondensedModel:
    """Make the model of a cable of unit mass per length and unit length; its coefficients are computed at first use."""
    sigma = structure.sigma.copy()
    chain = LumpedChain(replace(structure.p, mass=1.0), np.diff(sigma), sigma, structure.law)
    modes = tuple(shape.copy() for shape in structure.modes)
    return CondensedModel(chain, structure.order, modes, structure.quadrature, structure.raw_test_functions)


class RescaledCoefficients(NamedTuple):
    """Coefficients of many scenes, with a leading dimension of scenes."""

    mass_scaling: np.ndarray  #: factor of the mass-orthonormal shapes
    named: dict[str, np.ndarray]  #: under their names in the model
    bases: list[np.ndarray]  #: matrices from modes to coordinates, set by set
    slope_norms_squared: np.ndarray


def rescale_coefficients(unit: CondensedModel, mass: np.ndarray, total: np.ndarray) -> RescaledCoefficients:
    """Compute the coefficients of scenes from those of their unit cable.

    Parameters
    ----------
    unit
        Result of :func:`unit_model` for the modes and loads of the scenes.
    mass, total
        Mass per unstretched length [kg/m] and unstretched length [m] of the scenes (scenes,).
    """
    mass_scaling = 1.0 / np.sqrt(mass * total)
    stiffness_scaling = mass_scaling**2 / total
    # distributed loads are proportional to the length, point loads are not
    load_scaling = np.ones((total.size, len(unit.load_patterns)))
    load_scaling[:, : 2 if unit.chain.p.motions else 1] = total[:, None]
    projection_scaling = np.concatenate([load_scaling] * (unit.chain.p.dims - 1), axis=1) * mass_scaling[:, None]
    stiffness_by_load = load_scaling * stiffness_scaling[:, None]
    factors = {
        "shapes": mass_scaling,
        "slopes": mass_scaling / total,
        "load_patterns": load_scaling,
        "chordwise_force_patterns": load_scaling,
        "mean_chordwise_forces": load_scaling,
        "chordwise_forces_at_candidates": load_scaling,
        "geometric_stiffness": stiffness_by_load,
        "geometric_stiffness_norms": stiffness_by_load,
        "load_projection": projection_scaling,
    }
    if unit.raw_test_functions is not None:
        factors |= {"test_functions": mass_scaling, "test_slopes": factors["slopes"]}
        factors["test_stiffness_defect"] = stiffness_scaling
    named = {name: _scale(factor, getattr(unit, name)) for name, factor in factors.items()}
    bases, kappa = unit.spectral_basis
    return RescaledCoefficients(
        mass_scaling, named, [_scale(mass_scaling, basis) for basis in bases], _scale(stiffness_scaling, kappa)
    )


def _scale(factor: np.ndarray, coefficient: np.ndarray) -> np.ndarray:
    """Multiply a coefficient by factors (scenes,) or (scenes, patterns)."""
    return factor.reshape(factor.shape + (1,) * (coefficient.ndim + 1 - factor.ndim)) * coefficient


@lru_cache(UNIT_MODELS)
def kept_model(unit: CondensedModel, p: Parameters) -> CondensedModel:
    """Do :func:`rescaled_model` once for the same objects, see ``parameters._from_scene.SceneContent``."""
    return rescaled_model(unit, p)


def rescaled_model(unit: CondensedModel, p: Parameters) -> CondensedModel:
    """Make the model of a scene from that of its unit cable."""
    statics = solve_statics(p, p.length_key, p.length_value)
    total = float(statics[0])
    arc_length = total * unit.chain.arc_length
    chain = LumpedChain(p, arc_length[1:] - arc_length[:-1], arc_length, unit.chain.law)
    result = CondensedModel(chain, unit.order, unit.modes, unit.quadrature, unit.raw_test_functions)
    scaled = rescale_coefficients(unit, np.array([p.mass]), np.array([total]))
    # fills the cached properties, so that they are not computed from the modes
    result.__dict__.update(
        {name: values[0] for name, values in scaled.named.items()},
        spectral_basis=([basis[0] for basis in scaled.bases], scaled.slope_norms_squared[0]),
        rest_tension=0.5 * float(statics[4] + statics[5]),
    )
    return result


def same_structure(p: Parameters, other: Parameters) -> bool:
    """Return whether two scenes differ in numbers only, so that they share a unit cable."""
    return (
        p.dims == other.dims
        and p.free_end == other.free_end
        and p.link_viscosity == other.link_viscosity
        and list(p.motions) == list(other.motions)
        and [load.fraction for load in p.point_loads] == [load.fraction for load in other.point_loads]
    )
