"""Models of scenes that differ from a prepared one in numbers, from its coefficients by scaling."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod.catenary._statics import LoadPlane, check_solved, load_plane
from cablepod.condensed import _kernels_host_layout as layout
from cablepod.condensed._host import host_coefficients
from cablepod.condensed._kernels_host_layout import HostCoefficients
from cablepod.condensed._model import CondensedModel
from cablepod.conventions import COORDINATES
from cablepod.discretisation._chain import LumpedChain
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import Check, number
from cablepod.parameters._from_scene import Members
from cablepod.parameters._key_paths import variable_of
from cablepod.parameters._keys import LENGTH_KEYS, WEIGHT_KEYS
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._time_functions import Array, TimeFunction

#: Tables of the scene whose numbers a run may replace; numbers of other tables belong to the structure.
TABLES = ("cable", "gravity", "ends", "load", "motion", "damping")
#: Properties of a model that depend on loads, motions and positions of the ends, and are made anew.
OF_LOADS = ("initial_boundary_data", "static_boundary_data", "first_guess", "unstable_growth_rate", "rest_tension")
#: The same of mass and length, beside those that are scaled.
OF_LENGTH = (
    "mass", "shapes", "slopes", "test_functions", "test_slopes", "load_patterns", "chordwise_force_patterns", "rule",
    "test_slopes_at_points", "leading_coefficients",
)  # fmt: skip


class Variant(NamedTuple):
    """A model with other parameters than the prepared one."""

    model: CondensedModel
    q: np.ndarray  #: coordinates at rest (r,)
    coefficients: HostCoefficients


class TabulatedMotion(TimeFunction):
    """Displacement given at equidistant steps, from rest; its derivatives are central differences, as the leapfrog scheme's."""

    def __init__(self, displacement: np.ndarray, step: float) -> None:
        object.__setattr__(self, "kind", "table")
        object.__setattr__(self, "values", {"step": step})
        rate, second = np.gradient(displacement, step), np.empty_like(displacement)
        rate[0] = 0.0
        second[1:-1] = np.diff(displacement, 2) / step**2
        second[0], second[-1] = 2.0 * (displacement[1] - displacement[0]) / step**2, 2.0 * second[-2] - second[-3]
        object.__setattr__(self, "_tables", (displacement, rate, second))

    def __call__(self, time: Any, derivative: int = 0) -> Array:
        """Return the value, or its first or second derivative, at instants on the steps [s]."""
        places = np.rint(np.asarray(time, dtype=float) / self.values["step"]).astype(int)
        return self._tables[derivative][places]  # type: ignore[attr-defined]

    def all_at_steps(
        self, start: int, steps: int, steps_per_second: float, derivatives: tuple[int, ...], origin: float = 0.0
    ) -> Array:
        """Return several derivatives at steps (derivatives, steps + 1)."""
        part = slice(start, start + steps + 1)
        tables = self._tables  # type: ignore[attr-defined]
        return np.array([tables[derivative][part] + (0.0 if derivative else origin) for derivative in derivatives])

    @property
    def shortest_time_scale(self) -> float:
        """Infinity: the steps of a host resolve its motion."""
        return math.inf


class ChangedModel:
    """Makes models with other parameters.

    Parameters
    ----------
    scene
        Scene with which the model was made.
    model
        Prepared model; its coefficients are scaled.
    """

    def __init__(self, scene: xr.Dataset, model: CondensedModel) -> None:
        self.scene, self.base = scene, model
        self.p = model.chain.p
        self.fixed = Members(scene).fixed
        self.plane = load_plane(self.p)
        self._entries: dict[str, tuple[int | None, Check, str]] = {}
        chain = model.chain
        sigma = chain.arc_length / chain.total_length
        #: Integrals of the shapes times the parabola sigma (1 - sigma) (r,) [kg^-1/2 m].
        self._parabola = model.shapes @ (chain.tributary_length * sigma * (1.0 - sigma))
        self._coefficients, self._bases = host_coefficients(model), model.spectral_basis[0]
        self._rest = model.initial()[0]
        model.leading_coefficients, model.rest_tension, model.reference  # noqa: B018  (fills the cached properties)
        self._without_loads = {key: value for key, value in model.__dict__.items() if key not in OF_LOADS}

    def variant(self, parameters: Mapping[str, Any] | None, path: np.ndarray | None, step: float) -> Variant:
        """Return the model with other parameters.

        Parameters
        ----------
        parameters
            Numbers by key path, None for those of the scene.
        path, step
            Positions of the upper end at equidistant steps (steps + 1, dims) [m], None for the motions of the scene; their
            distance [s].
        """
        changes = dict(parameters) if parameters is not None else {}
        p, is_static = self._parameters(changes)
        model, q, coefficients = self._motion_only(p), self._rest, self._coefficients
        if not is_static:
            model, coefficients = self._scaled(p)
            q = self._equilibrium(model)
        if path is None:
            return Variant(model, q, coefficients)
        p = _copy(model.chain.p)
        motions = {
            ("upper", axis): TabulatedMotion(path[:, i] - path[0, i], step)
            for i, axis in enumerate(COORDINATES[: p.dims])
        }
        lower = {key: motion for key, motion in p.motions.items() if key[0] == "lower"}
        p.__dict__["motions"] = lower | motions
        moved = not np.array_equal(path[0], p.end_positions(np.zeros(1))[0, 1]) or bool(lower)
        p.__dict__.update(upper=path[0])
        changed = _copy(model)
        for name in OF_LOADS[:3]:
            changed.__dict__.pop(name, None)
        changed.__dict__["chain"] = _with(model.chain, p)
        return Variant(changed, self._equilibrium(changed) if moved else q, coefficients)

    # --- parameters ---------------------------------------------------------------------------------------------------

    def _parameters(self, changes: Mapping[str, Any]) -> tuple[Parameters, bool]:
        """Return the changed parameters, and whether they leave cable, loads and ends at rest as they are."""
        if not changes:
            return self.p, True
        p, cable = _copy(self.p), {}
        values, is_static = p.__dict__, True
        for path, value in changes.items():
            component, check, table = self._entry(path)
            value = check(path, value)
            name = path.split(".")[-1]
            if table == "motion":
                _, end, axis, name = path.split(".")
                motion = values["motions"][end, axis]
                values["motions"] = {
                    **values["motions"],
                    (end, axis): TimeFunction(motion.kind, {**motion.values, name: value}),
                }
            elif table == "damping":
                values["mass_damping"] = value or None
            elif table == "load":
                values["load"] = _replaced(
                    values["load"] if values["load"] is not None else np.zeros(p.dims), component, value
                )
                is_static = False
            elif table == "ends":
                end = path.split(".")[1]
                values[end] = _replaced(values[end], component, value)
                is_static = False
            else:
                cable[name], is_static = value, False
        if cable:
            self._change_cable(values, cable)
        return p, is_static

    def _change_cable(self, values: dict[str, Any], changes: Mapping[str, float]) -> None:
        """Replace stiffness, mass, weight and length in the parameters, from numbers of the cable and gravity."""

        def value(name: str) -> float:
            variable = "gravity" if name == "gravity" else f"cable_{name}"
            return float(changes.get(name, self.fixed[variable]))

        area, gravity = value("area"), value("gravity")
        if f"cable_{WEIGHT_KEYS[1]}" in self.fixed:
            mass = value("density") * area
            weight = mass * gravity
        else:
            weight = value("specific_weight") * area
            mass = weight / gravity
        weights = np.zeros(self.p.dims)
        weights[1] = -weight
        values.update(
            stiffness=value("youngs_modulus") * area, mass=mass, weight=weights, length_value=value(self.p.length_key)
        )

    def _entry(self, path: Any) -> tuple[int | None, Check, str]:
        """Return component, check and table of a key path; refuse what would change the structure."""
        found = self._entries.get(path) if isinstance(path, str) else None
        if found is not None:
            return found
        entry = variable_of(self.scene, path)
        table = path.split(".")[0] if isinstance(path, str) else ""
        if entry is None or table not in TABLES or path == "damping.link_viscosity":
            allowed = "numbers of the prepared scene, such as motion.upper.x.amplitude; its structure stays; try: prepare again"
            raise SceneError(
                f"{path if isinstance(path, str) else 'parameters'}: given in parameters; allowed: {allowed}"
            )
        _, component, key = entry
        self._entries[path] = component, key.check if component is None else number(), table
        return self._entries[path]

    # --- models -------------------------------------------------------------------------------------------------------

    def _motion_only(self, p: Parameters) -> CondensedModel:
        """Return the model with other motions or damping."""
        if p is self.p:
            return self.base
        model = object.__new__(CondensedModel)
        model.__dict__.update(self._without_loads)
        model.__dict__["chain"] = _with(self.base.chain, p)
        model.__dict__["rest_tension"] = self.base.rest_tension
        return model

    def _scaled(self, p: Parameters) -> tuple[CondensedModel, HostCoefficients]:
        """Return the model with another cable, loads or ends, and its coefficients."""
        base = self.base.chain
        total, rest_tension = self._statics(p)
        length = total / base.total_length
        model = object.__new__(CondensedModel)
        model.__dict__.update(self._without_loads)
        coefficients = self._coefficients
        if length == 1.0 and p.mass == self.p.mass and p.stiffness == self.p.stiffness:
            chain = _with(base, p)
        else:
            chain = LumpedChain(p, base.length * length, base.arc_length * length, base.law)
            for name in OF_LENGTH:
                model.__dict__.pop(name, None)
            shape = 1.0 / math.sqrt(p.mass / self.p.mass * length)
            coefficients = self._scaled_coefficients(p, total, length, shape)
            _, _, geometric_stiffness, by_coordinate, by_pattern, _ = coefficients
            model.__dict__.update(
                spectral_basis=([basis * shape for basis in self._bases], by_coordinate[layout.KAPPA]),
                geometric_stiffness=geometric_stiffness,
                load_projection=by_coordinate[layout.PROJECTION :],
                mean_chordwise_forces=by_pattern[layout.MEANS],
                geometric_stiffness_norms=by_pattern[layout.NORMS],
                chordwise_forces_at_candidates=np.ascontiguousarray(by_pattern[layout.AT_CANDIDATES :].T),
            )
        if not (np.array_equal(p.lower, self.p.lower) and np.array_equal(p.upper, self.p.upper)):
            model.__dict__.pop("reference", None)
        model.__dict__.update(chain=chain, rest_tension=rest_tension)
        return model, coefficients

    def _scaled_coefficients(self, p: Parameters, total: float, length: float, shape: float) -> HostCoefficients:
        """Scale the coefficients by powers of the length and of the factor of the shapes."""
        sizes, numbers, geometric_stiffness, by_coordinate, by_pattern, by_point = self._coefficients
        numbers = numbers.copy()
        numbers[layout.STIFFNESS], numbers[layout.LENGTH], numbers[layout.MASS] = p.stiffness, total, p.mass
        numbers[layout.FIRST_TRIBUTARY] *= length
        numbers[layout.SECOND_MOMENT] *= length
        numbers[layout.REACH_MOMENT] *= length * length
        loads, square = length * shape, shape * shape
        coordinate = np.full((len(by_coordinate), 1), loads)
        coordinate[layout.KAPPA], coordinate[layout.MOMENTS] = square / length, loads * (p.mass / self.p.mass)
        pattern = np.full((len(by_pattern), 1), length)
        pattern[layout.NORMS], pattern[layout.REACH_LOADS] = square, length**3
        if by_point.size:
            point = np.full((len(by_point), 1), length)
            point[layout.SLOPES :] = shape / length
            by_point = by_point * point
        return HostCoefficients(
            sizes, numbers, geometric_stiffness * square, by_coordinate * coordinate, by_pattern * pattern, by_point
        )

    def _statics(self, p: Parameters) -> tuple[float, float]:
        """Return the unstretched length [m] and the mean of the end tensions at rest [N]."""
        from cablepod.catenary import _kernels_solve as kernel  # numba is imported only to compute

        plane = self.plane
        if p.load is not None or p.lower is not self.p.lower or p.upper is not self.p.upper or self.p.load is not None:
            plane = load_plane(p)
        else:
            plane = LoadPlane(plane.span, plane.rise, plane.chord, float(-p.weight[1]), plane.across, plane.against)
        if plane.load == 0.0:
            plane = load_plane(p)
        result = np.empty(6)
        status = kernel.solve(*plane[:4], p.stiffness, LENGTH_KEYS.index(p.length_key), p.length_value, result)
        check_solved(status, plane[:4], p.stiffness, p.length_key, p.length_value, name=f"cable.{p.length_key}")
        return float(result[0]), 0.5 * float(result[4] + result[5])

    def _equilibrium(self, model: CondensedModel) -> np.ndarray:
        """Return the coordinates at rest, by Newton's method from the parabola."""
        p, total = model.chain.p, model.chain.total_length
        if model.order == "leading":
            from cablepod.condensed import _kernels_leading as kernel

            length = total / self.base.chain.total_length
            shape = 1.0 / math.sqrt(p.mass / self.p.mass * length)
            static = model.static_boundary_data
            patterns = len(static[1:]) // p.dims
            sag = 0.5 * total * total / model.rest_tension * p.mass * shape * length
            q = sag * self._parabola
            for k, which in enumerate(model.sets):
                q[which] *= static[1 + patterns * (1 + k)]
            if kernel.leading_rest(q, static[None], *model.leading_coefficients):
                return q
        return model.initial()[0]


def _copy(source: Any) -> Any:
    """Return a shallow copy of a frozen dataclass, whose fields the caller may replace in ``__dict__``."""
    result = object.__new__(type(source))
    result.__dict__.update(source.__dict__)
    for name in ("shortest_time_scale",):
        result.__dict__.pop(name, None)
    return result


def _with(chain: LumpedChain, p: Parameters) -> LumpedChain:
    """Return a chain with other parameters and the same links."""
    return LumpedChain(p, chain.length, chain.arc_length, chain.law)


def _replaced(vector: np.ndarray, component: int | None, value: float) -> np.ndarray:
    """Return a vector with another component."""
    if component is None:
        raise scene_error("parameters", value, "one component of a vector, such as load.uniform.x")
    result = np.array(vector, dtype=float)
    result[component] = value
    return result
