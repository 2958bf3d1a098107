"""Models of all scenes on the same modes: coefficients of a unit cable times powers of mass and length.

Modes are functions of sigma = S / L0.  The coefficients of a cable of unit mass and unit length therefore depend on the modes and
on which loads there are, not on the numbers of a scene; they are computed once for each set of modes and kept.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from cablepod.catenary._statics import solve_statics
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._reference_state import INSTANTS, orthogonal_coordinates, reference_state
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._chord_frame import normals_at_start
from cablepod.parameters._parameters import Parameters

#: Number of unit models kept: sets of modes, ranks and orders that a program alternates between.
UNIT_MODELS = 32


@dataclass(frozen=True)
class ModeStructure:
    """Modes, options and kinds of loads, which determine the coefficients of a unit cable; compared by content."""

    sigma: np.ndarray = field(compare=False)  #: relative arc length of the particles (n + 1,)
    modes: tuple[np.ndarray, ...] = field(compare=False)  #: modes of each set (mode, particle)
    mode_numbers: tuple[Any, ...]  #: labels of the modes of the larger set
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
        mode_numbers: tuple[Any, ...],
        options: tuple[str, str, int | None],
    ) -> ModeStructure:
        """Make the structure of a scene on modes with some numbers; `options` are order, law and quadrature."""
        content = tuple((array.shape, array.tobytes()) for array in (sigma, *modes))
        is_uniform = not (p.segments or p.attachments)  # the models of others are no multiples of a unit model
        loads = (p.dims, bool(p.motions), tuple(load.fraction for load in p.point_loads), is_uniform)
        return cls(sigma, modes, mode_numbers, p, *options, (content, loads))


@lru_cache(UNIT_MODELS)
def unit_model(structure: ModeStructure) -> CondensedModel:
    """Make the model of a cable of unit mass per length and unit length; its coefficients are computed at first use."""
    sigma = structure.sigma.copy()
    chain = LumpedChain(replace(structure.p, mass=1.0), np.diff(sigma), sigma, structure.law)
    modes = tuple(shape.copy() for shape in structure.modes)
    return CondensedModel(chain, structure.order, modes, structure.quadrature, mode_numbers=structure.mode_numbers)


class MemberStates(NamedTuple):
    """Reference states of many scenes under uniform loads, see :mod:`cablepod.condensed._reference_state`."""

    uniform: np.ndarray  #: (scenes,)
    sag: np.ndarray  #: (scenes,)
    shares: np.ndarray  #: share of each deflection in the squared slopes at rest (scenes, sets)

    @classmethod
    def of(cls, unit: CondensedModel, parameters: Parameters, total: np.ndarray, end_time: float) -> MemberStates:
        """Compute the states of members with unstretched lengths `total` [m], for chords until `end_time` [s]."""
        load, reach = parameters.load_at(0.0), parameters.ends[:, 1] - parameters.ends[:, 0]
        along = reach / np.sqrt((reach * reach).sum(axis=1, keepdims=True))
        tangential = (load * along).sum(axis=1)
        squared = np.maximum((load * load).sum(axis=1) - tangential**2, 0.0)
        shares = np.ones((load.shape[0], 1))
        if load.shape[1] == 3:
            first = (load * normals_at_start(reach)).sum(axis=1) ** 2
            first = np.divide(first, squared, out=np.zeros_like(first), where=squared > 0.0)
            shares = np.stack([first, 1.0 - first], axis=1)
        ends = parameters.end_positions(np.linspace(0.0, end_time, INSTANTS if parameters.motions else 1))
        strain = np.sqrt(((ends[:, :, 1] - ends[:, :, 0]) ** 2).sum(axis=2)) / total[:, None] - 1.0
        deviation = unit.chordwise_force_patterns[0] - unit.mean_chordwise_forces[0]
        mean_square = (deviation**2) @ unit.chain.length
        fourth = (deviation**4) @ unit.chain.length / mean_square**2
        rest_load = squared * mean_square * total**2 / parameters.stiffness**2
        return cls(*reference_state(np.stack([strain.min(axis=1), strain.max(axis=1)]), rest_load, fourth), shares)


class RescaledCoefficients(NamedTuple):
    """Coefficients of many scenes, with a leading dimension of scenes."""

    named: dict[str, np.ndarray]  #: under their names in the model
    bases: list[np.ndarray]  #: matrices from modes to coordinates, set by set
    slope_norms_squared: np.ndarray


def rescale_coefficients(
    unit: CondensedModel, mass: np.ndarray, total: np.ndarray, states: MemberStates | None
) -> RescaledCoefficients:
    """Compute the coefficients of scenes from those of their unit cable.

    Parameters
    ----------
    unit
        Result of :func:`unit_model` for the modes and loads of the scenes.
    mass, total
        Mass per unstretched length [kg/m] and unstretched length [m] of the scenes (scenes,).
    states
        Reference states of the scenes, which turn the coordinates; None without terms of second order.
    """
    by_load = load_scaling(unit, total)
    names = ("chordwise_force_patterns", "mean_chordwise_forces", "chordwise_forces_at_candidates")
    named = {name: _scale(by_load, getattr(unit, name)) for name in names}
    of_shapes = rescale_shapes(unit, mass, total, by_load, states)
    return of_shapes._replace(named=named | of_shapes.named)


def load_scaling(unit: CondensedModel, total: np.ndarray) -> np.ndarray:
    """Return the factors of the load patterns of scenes with unstretched lengths `total` [m] (scenes, patterns).

    Distributed loads are proportional to the length, point loads are not.
    """
    result = np.ones((total.size, len(unit.load_patterns)))
    result[:, : 2 if unit.chain.p.motions else 1] = total[:, None]
    return result


def rescale_shapes(
    unit: CondensedModel, mass: np.ndarray, total: np.ndarray, by_load: np.ndarray, states: MemberStates | None
) -> RescaledCoefficients:
    """Compute the coefficients of the shapes of scenes, see :func:`rescale_coefficients`.

    `by_load` are the factors of the load patterns, see :func:`load_scaling`.
    """
    if states is not None:
        return RescaledCoefficients(*_turned_shapes(unit, mass, total, by_load, states))
    mass_scaling = 1.0 / np.sqrt(mass * total)
    stiffness_scaling = mass_scaling**2 / total
    stiffness_by_load = by_load * stiffness_scaling[:, None]
    factors = {
        "shapes": mass_scaling,
        "slopes": mass_scaling / total,
        "geometric_stiffness": stiffness_by_load,
        "geometric_stiffness_norms": stiffness_by_load,
        "load_projection": np.concatenate([by_load] * (unit.chain.p.dims - 1), axis=1) * mass_scaling[:, None],
    }
    named = {name: _scale(factor, getattr(unit, name)) for name, factor in factors.items()}
    bases, kappa = unit.spectral_basis
    return RescaledCoefficients(
        named, [_scale(mass_scaling, basis) for basis in bases], _scale(stiffness_scaling, kappa)
    )


def _scale(factor: np.ndarray, coefficient: np.ndarray) -> np.ndarray:
    """Multiply a coefficient by factors (scenes,) or (scenes, patterns)."""
    return factor.reshape(factor.shape + (1,) * (coefficient.ndim + 1 - factor.ndim)) * coefficient


def _turned_shapes(
    unit: CondensedModel, mass: np.ndarray, total: np.ndarray, by_load: np.ndarray, states: MemberStates
) -> tuple[dict[str, np.ndarray], list[np.ndarray], np.ndarray]:
    """Return the coefficients of shapes with the terms of second order, matrices to coordinates, squared slope norms."""
    scenes, patterns, r = total.size, len(unit.load_patterns), sum(unit.ranks)
    uniform, sag = states.uniform[:, None, None], states.sag[:, None, None]
    shapes, geometric = np.zeros((scenes, r, unit.chain.links + 1)), np.zeros((scenes, patterns, r, r))
    projection = np.zeros((scenes, len(unit.sets), patterns, r))
    geometric_scaling = (by_load / total[:, None])[:, :, None, None]
    bases, kappa = [], []
    for k, (psi, which, products) in enumerate(
        zip(unit.modes, unit.sets, unit.products_under_uniform_load, strict=True)
    ):
        gram, inertia, slopes, with_patterns = products
        values, turn = orthogonal_coordinates(
            (uniform * slopes[0] + sag * slopes[1]) / total[:, None, None],
            (mass * total)[:, None, None] * (gram + 2.0 * sag * states.shares[:, k, None, None] * inertia),
        )
        back = np.swapaxes(turn, 1, 2)
        tension = uniform[:, None] * with_patterns[0] + sag[:, None] * with_patterns[1]
        geometric[:, :, which, which] = (back[:, None] @ tension @ turn[:, None]) * geometric_scaling
        shapes[:, which] = back @ psi
        projection[:, k, :, which] = by_load[:, :, None] * (unit.load_patterns @ psi.T @ turn)
        bases.append(turn)
        kappa.append(values)
    finite = np.where(np.isfinite(geometric), geometric, 0.0)
    named = {
        "shapes": shapes,
        "slopes": np.diff(shapes, axis=2) / (unit.chain.length * total[:, None, None]),
        "geometric_stiffness": geometric,
        "geometric_stiffness_norms": np.abs(np.linalg.eigvalsh(finite)).max(axis=-1),
        "load_projection": projection.reshape(scenes, -1, r),
    }
    return named, bases, np.concatenate(kappa, axis=1)


def _of_loads(name: str) -> cached_property[np.ndarray]:
    """Return a property of a scene: that of its unit cable times the factors of its loads."""
    return cached_property(lambda model: _scale(model._load_scaling, getattr(model.unit, name))[0])


def _of_shapes(name: str) -> cached_property[np.ndarray]:
    """Return a property of a scene: the coefficient of its rescaled shapes."""
    return cached_property(lambda model: model._rescaled_shapes.named[name][0])


@dataclass(frozen=True, eq=False)
class RescaledModel(CondensedModel):
    """Model of a uniform cable whose coefficients follow from those of its unit cable."""

    unit: CondensedModel = field(kw_only=True)

    @cached_property
    def rest_tension(self) -> float:
        """Mean of the tensions of both ends at rest [N]."""
        p = self.chain.p
        statics = solve_statics(p, p.length_key, p.length_value)
        return 0.5 * float(statics[4] + statics[5])

    @cached_property
    def _load_scaling(self) -> np.ndarray:
        return load_scaling(self.unit, np.array([self.chain.total_length]))

    load_patterns = _of_loads("load_patterns")
    chordwise_force_patterns = _of_loads("chordwise_force_patterns")
    mean_chordwise_forces = _of_loads("mean_chordwise_forces")
    chordwise_forces_at_candidates = _of_loads("chordwise_forces_at_candidates")

    @cached_property
    def _rescaled_shapes(self) -> RescaledCoefficients:
        """Coefficients of the shapes, of one scene."""
        chain, states = self.chain, None
        total = np.array([chain.total_length])
        if self.reference_state is not None:
            uniform, sag = (np.array([value]) for value in self.reference_state)
            states = MemberStates(uniform, sag, ((self.rest_shear**2 @ chain.length) / total)[None])
        return rescale_shapes(self.unit, np.array([chain.p.mass]), total, self._load_scaling, states)

    shapes = _of_shapes("shapes")
    slopes = _of_shapes("slopes")
    geometric_stiffness = _of_shapes("geometric_stiffness")
    geometric_stiffness_norms = _of_shapes("geometric_stiffness_norms")
    load_projection = _of_shapes("load_projection")

    @cached_property
    def spectral_basis(self) -> tuple[list[np.ndarray], np.ndarray]:
        """As in :class:`CondensedModel`."""
        scaled = self._rescaled_shapes
        return [np.asfortranarray(basis[0]) for basis in scaled.bases], scaled.slope_norms_squared[0]


def rescaled_model(unit: CondensedModel, p: Parameters) -> CondensedModel:
    """Make the model of a scene from that of its unit cable."""
    total = float(solve_statics(p, p.length_key, p.length_value)[0])
    arc_length = total * unit.chain.arc_length
    chain = LumpedChain(p, arc_length[1:] - arc_length[:-1], arc_length, unit.chain.law)
    model = replace(unit, chain=chain)
    if not model.is_uniform or (model.order == "leading" and p.point_loads):
        return model  # computed from the modes; point loads: another profile of the slopes
    return RescaledModel(**{item.name: getattr(model, item.name) for item in fields(model)}, unit=unit)


#: The same, kept for the same objects, see ``parameters._from_scene.SceneContent``.
kept_model = lru_cache(UNIT_MODELS)(rescaled_model)
