"""Models of scenes that differ from a prepared one in numbers, from its coefficients by scaling.

To order "leading" the constants of second order stay those of the prepared scene, as a part of its structure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import xarray as xr

from cablepod.catenary._statics import check_solved, load_plane
from cablepod.condensed import _kernels_host_layout as layout
from cablepod.condensed._host import host_coefficients
from cablepod.condensed._kernels_host_layout import HostCoefficients
from cablepod.condensed._model import CondensedModel
from cablepod.conventions import COORDINATES
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import Check, number
from cablepod.parameters._from_scene import Members
from cablepod.parameters._key_paths import dotted, variable_of
from cablepod.parameters._keys import LENGTH_KEYS, WEIGHT_KEYS
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._time_functions import Array, TimeFunction

#: Largest distance of an instant on a step from it, over the step.
ON_STEPS = 1e-6
#: Properties of parameters that depend on their numbers, and are made anew.
OF_MOTIONS = ("ends", "shortest_time_scale", "initial_ends", "initial_end_rates", "damping")
#: Tables of the scene whose numbers a run may replace; numbers of other tables belong to the structure.
TABLES = ("cable", "gravity", "ends", "load", "motion", "damping", "wind")
#: Properties of a model that depend on motions and positions of the ends, and are made anew.
OF_ENDS = (
    "initial_boundary_data", "static_boundary_data", "first_guess", "initial_state", "initial_forces",
    "start_deflection_rates",
)  # fmt: skip
#: The same of loads and damping too.
OF_LOADS = (*OF_ENDS, "rest_tension")
#: The same of mass and length, beside those that are scaled.
OF_LENGTH = ("mass", "shapes", "slopes", "chordwise_force_patterns", "rule", "leading_coefficients")
#: Cached properties of the prepared model that all its variants share: computed once, before the variants copy them.
SHARED = ("leading_coefficients", "rest_tension", "reference")


@dataclass(frozen=True)
class Variant:
    """A prepared model with other parameters."""

    p: Parameters
    q: np.ndarray  #: coordinates at rest (r,)
    coefficients: HostCoefficients
    shape: float  #: factor of the shapes
    make: Callable[[], CondensedModel]  #: makes the model

    @cached_property
    def model(self) -> CondensedModel:
        """The model; runs to leading order need it for positions and tensions only."""
        return self.make()


class TabulatedMotion(TimeFunction):
    """Displacement given at equidistant steps, from rest; its derivatives are central differences, as the leapfrog scheme's."""

    def __init__(self, displacement: np.ndarray, step: float) -> None:
        rate, second = np.gradient(displacement, step), np.empty_like(displacement)
        rate[0] = 0.0
        second[1:-1] = np.diff(displacement, 2) / step**2
        second[0], second[-1] = 2.0 * (displacement[1] - displacement[0]) / step**2, 2.0 * second[-2] - second[-3]
        super().__init__("table", {"step": step, "tables": (displacement, rate, second)})

    def __call__(self, time: Any, derivative: int = 0) -> Array:
        """Return the value, or its first or second derivative, at instants [s]; linear between the steps, held after them."""
        table, places = self.values["tables"][derivative], np.asarray(time, dtype=float) / self.values["step"]
        nearest = np.clip(np.rint(places), 0, len(table) - 1).astype(int)
        if np.abs(places - nearest).max(initial=0.0) < ON_STEPS:
            return table[nearest]
        return np.interp(places, np.arange(len(table)), table)

    def all_at_steps(
        self, start: int, steps: int, steps_per_second: float, derivatives: tuple[int, ...], origin: float = 0.0
    ) -> Array:
        """Return several derivatives at steps (derivatives, steps + 1)."""
        part = slice(start, start + steps + 1)
        tables = self.values["tables"]
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
        fixed = Members(scene).fixed
        #: Numbers of the cable and gravity, by the last part of their key paths.
        self._cable = {
            name.removeprefix("cable_"): float(fixed[name])
            for name in fixed
            if name.startswith(("cable_", "gravity")) and not isinstance(fixed[name], str)
        }
        self.has_records = any(motion.kind == "file" for motion in self.p.motions.values())
        self.plane = load_plane(self.p)
        #: Displacements of both ends by their motions at time 0 (end, dims) [m], and their derivatives.
        self._displacements = self.p.initial_ends - np.array([self.p.lower, self.p.upper])
        self._end_rates = self.p.initial_end_rates
        self._entries: dict[str, tuple[int | None, Check, str]] = {}
        chain = model.chain
        sigma = chain.arc_length / chain.total_length
        #: Integrals of the shapes times the parabola sigma (1 - sigma) (r,) [kg^-1/2 m].
        self._parabola = model.shapes @ (chain.tributary_length * sigma * (1.0 - sigma))
        self._coefficients, self.bases = host_coefficients(model), model.spectral_basis[0]
        self._rest = model.initial()[0]
        for name in SHARED:
            getattr(model, name)
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
        if not isinstance(parameters, Mapping | None):
            raise scene_error("parameters", parameters, "a mapping of key paths to numbers")
        changes = dict(parameters) if parameters is not None else {}
        p, is_static = self._parameters(changes)
        variant = Variant(p, self._rest, self._coefficients, 1.0, partial(self._motion_only, p))
        if not is_static:
            variant = self._other_cable(p)
        return variant if path is None else self._along_path(variant, path, step)

    def _along_path(self, variant: Variant, path: np.ndarray, step: float) -> Variant:
        """Return the variant whose upper end follows a path (steps + 1, dims) [m]."""
        p, moved = _copy(variant.p), variant.p.end_positions(np.zeros(1))[0]
        displacement = path - path[0]
        motions = {
            ("upper", axis): TabulatedMotion(displacement[:, i], step) for i, axis in enumerate(COORDINATES[: p.dims])
        }
        lower = {key: motion for key, motion in p.motions.items() if key[0] == "lower"}
        p.__dict__.update(motions=lower | motions, upper=path[0].copy())

        def make() -> CondensedModel:
            model = _copy(variant.model)
            for name in OF_ENDS:
                model.__dict__.pop(name, None)
            model.__dict__["chain"] = _with(variant.model.chain, p)
            return model

        if np.array_equal(path[0], moved[1]):
            return Variant(p, variant.q, variant.coefficients, variant.shape, make)
        return Variant(p, make().initial()[0], variant.coefficients, variant.shape, make)

    # --- parameters ---------------------------------------------------------------------------------------------------

    def _parameters(self, changes: Mapping[str, Any]) -> tuple[Parameters, bool]:
        """Return the changed parameters, and whether they leave cable, loads and ends at rest as they are."""
        if not changes:
            return self.p, True
        p, cable = _copy(self.p), {}
        values, is_static = p.__dict__, True
        for path, value in ((dotted(path), value) for path, value in changes.items()):
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
            elif table == "wind":
                name = path.removeprefix("wind.").removeprefix("turbulence.").split(".")[0]
                key = "turbulence" if path.startswith("wind.turbulence.") else "wind"
                new = value if component is None else _replaced(values[key][name], component, value)
                values[key] = {**values[key], name: new}
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
        if values["motions"] is self.p.motions:
            values["initial_ends"] = self._displacements + np.array([p.lower, p.upper])
            values["initial_end_rates"] = self._end_rates
        return p, is_static

    def _change_cable(self, values: dict[str, Any], changes: Mapping[str, float]) -> None:
        """Replace stiffness, mass, weight and length in the parameters, from numbers of the cable and gravity."""
        cable = {**self._cable, **changes}
        area, gravity = cable["area"], cable["gravity"]
        if WEIGHT_KEYS[1] in cable:
            mass = cable["density"] * area
            weight = mass * gravity
        else:
            weight = cable["specific_weight"] * area
            if not gravity:
                raise scene_error("gravity", gravity, "above 0 for a cable of given specific weight: it gives the mass")
            mass = weight / gravity
        weights = np.zeros(self.p.dims)
        weights[1] = -weight
        length_value = cable[self.p.length_key]
        stiffness = cable["youngs_modulus"] * area
        values.update(area=area, stiffness=stiffness, mass=mass, weight=weights, length_value=length_value)
        values.update({name: cable[name] for name in ("diameter", "drag_coefficient") if name in cable})

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
                f"{path if isinstance(path, str) and path else 'parameters'}: given in parameters; allowed: {allowed}"
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

    def _other_cable(self, p: Parameters) -> Variant:
        """Return the variant with another cable, other loads or ends."""
        from cablepod.catenary import _kernels_solve as catenary  # numba is imported only to compute
        from cablepod.condensed import _kernels_prepared_run as kernel

        same_ends = p.lower is self.p.lower and p.upper is self.p.upper
        plane = self.plane
        if same_ends and p.load is None and self.p.load is None and p.weight[1] < 0.0:
            plane = plane._replace(load=float(-p.weight[1]))
        else:
            plane = load_plane(p)
        base = self._coefficients
        numbers, load = base.numbers.copy(), p.load_at(0.0)
        numbers[layout.STIFFNESS], numbers[layout.MASS], numbers[layout.DAMPING] = (
            p.stiffness,
            p.mass,
            p.mass_damping or 0.0,
        )
        numbers[layout.STEADY_LOAD : layout.STEADY_LOAD + load.size] = load
        sizes = base.sizes.copy()
        if not same_ends:
            sizes[layout.REFERENCE] = _reference_axis(p)
        coefficients = HostCoefficients(
            sizes, numbers, np.empty_like(base.geometric_stiffness), np.empty_like(base.by_coordinate),
            np.empty_like(base.by_pattern), np.empty_like(base.by_point),
        )  # fmt: skip
        q, solution = np.empty_like(self._rest), np.empty(6)
        status = kernel.leading_variant(
            base, coefficients, np.array(plane[:4]), np.subtract(*p.initial_ends[::-1]),
            LENGTH_KEYS.index(p.length_key), p.length_value, self._parabola, q, solution,
        )  # fmt: skip
        if status not in (catenary.FOUND, kernel.NO_REST):
            check_solved(status, plane[:4], p.stiffness, p.length_key, p.length_value, name=f"cable.{p.length_key}")
        total = float(solution[0])
        shape = 1.0 / math.sqrt(p.mass / self.p.mass * (total / self.base.chain.total_length))
        tension = 0.5 * float(solution[4] + solution[5])
        make = partial(self._scaled, p, coefficients, total, shape, tension)
        if self.base.order != "leading" or status == kernel.NO_REST:
            q = make().initial()[0]
        return Variant(p, q, coefficients, shape, make)

    def _scaled(
        self, p: Parameters, coefficients: HostCoefficients, total: float, shape: float, rest_tension: float
    ) -> CondensedModel:
        """Return the model of another cable from its scaled coefficients."""
        base, model = self.base.chain, object.__new__(CondensedModel)
        length = total / base.total_length
        model.__dict__.update({key: value for key, value in self._without_loads.items() if key not in OF_LENGTH})
        _, _, geometric_stiffness, by_coordinate, by_pattern, *_ = coefficients
        model.__dict__.update(
            chain=LumpedChain(p, base.length * length, base.arc_length * length, base.law),
            rest_tension=rest_tension,
            load_patterns=self.base.load_patterns * length,
            spectral_basis=([basis * shape for basis in self.bases], by_coordinate[layout.KAPPA]),
            geometric_stiffness=geometric_stiffness,
            load_projection=by_coordinate[layout.PROJECTION :],
            mean_chordwise_forces=by_pattern[layout.MEANS],
            geometric_stiffness_norms=by_pattern[layout.NORMS],
            chordwise_forces_at_candidates=np.ascontiguousarray(by_pattern[layout.AT_CANDIDATES :].T),
            reference=int(coefficients.sizes[layout.REFERENCE]),
        )
        return model


def _reference_axis(p: Parameters) -> int:
    """Return the axis that defines the normals of the chord between the ends at rest."""
    reach = p.initial_ends[1] - p.initial_ends[0]
    return 1 if p.dims == 2 and reach.any() else ChordFrame.of(reach[None]).reference


def _copy(source: Any) -> Any:
    """Return a shallow copy of a frozen dataclass, whose fields the caller may replace in ``__dict__``."""
    result = object.__new__(type(source))
    result.__dict__.update(source.__dict__)
    for name in OF_MOTIONS:
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
