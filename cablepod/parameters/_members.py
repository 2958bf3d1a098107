"""Parameters of members that differ in numbers only, as arrays with a row for each member."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cablepod.conventions import COORDINATES, ENDS
from cablepod.parameters._from_scene import Members
from cablepod.parameters._key_paths import motion_path, variable_name
from cablepod.parameters._time_functions import SINES, TimeFunction

#: Variables of optional terms that MemberParameters does not cover.
UNSUPPORTED_TERMS = ("ends_free", "load_kind", "point_load_1_force")


@dataclass(frozen=True)
class MemberParameters:
    """Parameters of all members: arrays as :class:`cablepod.parameters._parameters.Parameters`, a row for each member."""

    stiffness: np.ndarray  #: (members,) [N]
    mass: np.ndarray  #: (members,) [kg/m]
    load: np.ndarray  #: weight and uniform load (members, dims) [N/m]
    ends: np.ndarray  #: both ends at rest (members, end, dims) [m]
    motions: Mapping[tuple[str, str], TimeFunction]  #: (end, axis) -> displacement [m], parameters (members, 1)
    length_key: str
    length_value: np.ndarray  #: (members,) [N], or [m] for unstretched_length
    damping: np.ndarray  #: mass-proportional (members,) [1/s]

    @classmethod
    def of(cls, members: Members) -> MemberParameters | None:
        """Stack the parameters of members; None if they differ in more than numbers, or have unsupported terms."""
        p, names = members[0], set(members.fixed) | set(members.varied)
        numeric = all(values.dtype.kind in "fiu" for name, values in members.varied.items() if name != "member")
        initial = any(name.startswith("initial_") for name in names)
        if members.gapped or not numeric or initial or names & set(UNSUPPORTED_TERMS):
            return None
        if p.link_viscosity is not None or "damping_link_viscosity" in members.varied:
            return None
        if any(motion.kind not in SINES for motion in p.motions.values()):
            return None
        count = len(members)

        def rows(name: str, *shape: int) -> np.ndarray:
            values = members.varied[name] if name in members.varied else members.fixed.get(name, 0.0)
            return np.ascontiguousarray(np.broadcast_to(np.asarray(values, dtype=float), (count, *shape)))

        area, gravity = rows("cable_area"), rows("gravity")
        if "cable_density" in names:
            mass = rows("cable_density") * area
            weight = mass * gravity
        else:
            weight = rows("cable_specific_weight") * area
            mass = weight / gravity
        load = rows("load_uniform", p.dims).copy()  # zeros where there is none
        load[:, 1] -= weight
        motions = {
            key: TimeFunction(
                motion.kind,
                {name: rows(variable_name(f"{motion_path(*key)}.{name}"))[:, None] for name in motion.values},
            )
            for key, motion in p.motions.items()
        }
        return cls(
            rows("cable_youngs_modulus") * area,
            mass,
            load,
            np.stack([rows("ends_lower", p.dims), rows("ends_upper", p.dims)], axis=1),
            motions,
            p.length_key,
            rows(f"cable_{p.length_key}"),
            rows("damping_mass_proportional"),
        )

    def part(self, first: int, last: int) -> MemberParameters:
        """Return the members `first` ... `last - 1`."""
        rows = slice(first, last)
        motions = {
            key: TimeFunction(motion.kind, {name: value[rows] for name, value in motion.values.items()})
            for key, motion in self.motions.items()
        }
        return MemberParameters(
            self.stiffness[rows], self.mass[rows], self.load[rows], self.ends[rows], motions, self.length_key,
            self.length_value[rows], self.damping[rows],
        )  # fmt: skip

    @property
    def chord(self) -> np.ndarray:
        """Vector from the lower end at rest to the upper one (members, dims) [m]."""
        return self.ends[:, 1] - self.ends[:, 0]

    @property
    def shortest_time_scale(self) -> np.ndarray:
        """Shortest period of the motions (members,) [s]; infinity if there are none."""
        scale = np.full(self.mass.size, np.inf)
        with np.errstate(divide="ignore"):
            for motion in self.motions.values():
                scale = np.minimum(scale, 2.0 * np.pi / np.abs(motion.values["angular_frequency"][:, 0]))
        return scale

    def end_positions(self, time: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Return positions of both ends, or a derivative of them: (members, time, end, dims) [m]."""
        count, _, dims = self.ends.shape
        result = np.zeros((count, time.size, 2, dims))
        if derivative == 0:
            result += self.ends[:, None]
        for (end, axis), motion in self.motions.items():
            result[:, :, ENDS.index(end), COORDINATES.index(axis)] += motion(time, derivative)
        return result
