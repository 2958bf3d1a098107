"""Arrays of condensed guys for the kernels: guys last, in lanes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cablepod.catenary._end_stiffness import gauss_rule
from cablepod.condensed._air_places import FINE, projection
from cablepod.condensed._kernels_layout import LeadingTerms, Sizes
from cablepod.mast import _kernels_layout as layout
from cablepod.mast._air import to_gauss
from cablepod.mast._condensed_guy import GuySet


@dataclass(frozen=True)
class Lanes:
    """Places of guys and modes in the arrays of the kernel: guys last, padded to whole groups of lanes, modes too."""

    count: int  #: number of guys
    rank: int  #: number of modes of each deflection

    @property
    def size(self) -> int:
        """Number of lanes."""
        return -(-max(self.count, 1) // layout.LANES) * layout.LANES

    @property
    def modes(self) -> int:
        """Number of modes with those of padding."""
        return -(-self.rank // layout.MODES_TOGETHER) * layout.MODES_TOGETHER

    def of(self, values: np.ndarray) -> np.ndarray:
        """Return values (guys, ...) as (..., lanes)."""
        result = np.zeros((*values.shape[1:], self.size))
        result[..., : self.count] = np.moveaxis(values, 0, -1)
        return result

    def coordinates(self, values: np.ndarray) -> np.ndarray:
        """Return values of the coordinates (guys, 2 r) as (2, modes, lanes)."""
        result = np.zeros((2, self.modes, self.size))
        result[:, : self.rank, : self.count] = np.moveaxis(values.reshape(-1, 2, self.rank), 0, -1)
        return result

    def back(self, values: np.ndarray) -> np.ndarray:
        """Return values (..., 2, modes, lanes) of the kernel by guys (..., guys, 2 r)."""
        own = np.moveaxis(values[..., : self.rank, : self.count], -1, -3)
        return own.reshape(*own.shape[:-2], 2 * self.rank)


def terms_of(lanes: Lanes, guys: GuySet, axes: np.ndarray) -> layout.CondensedTerms:
    """Return the coefficients of guys with axes (guys, 3, 3) at rest."""
    numbers, r = np.ones((8, lanes.size)), lanes.rank
    numbers[[layout.WEIGHT, layout.STIFFENING, layout.LARGEST_KAPPA]] = 0.0
    rows = {
        layout.STIFFNESS: guys.stiffness, layout.LENGTH: guys.length, layout.WEIGHT: guys.weight,
        layout.SOFTENING: 1.0 - 2.0 * guys.strain, layout.STIFFENING: guys.strain * guys.rest_force,
        layout.SCALE: guys.scale, layout.SLOPE_SCALE: guys.scale / guys.length,
    }  # fmt: skip
    for row, values in rows.items():
        numbers[row, : lanes.count] = values
    kappa, none = lanes.coordinates(guys.kappa), np.empty(0)
    spring = 0.5 * numbers[layout.STIFFNESS] / numbers[layout.LENGTH]
    closure = LeadingTerms(
        numbers[layout.STIFFNESS], 1.0 / numbers[layout.LENGTH], spring * numbers[layout.SOFTENING], kappa.ravel(),
        none, none, none,
    )  # fmt: skip
    tilt = np.zeros((2, lanes.modes, lanes.modes))
    tilt[0, :r, :r], tilt[1, :r, :r] = guys.tilt[:r, :r], guys.tilt[r:, r:]
    reach = lanes.of(guys.lower - guys.upper)
    reach[0, lanes.count :] = 1.0  # lanes without a guy have a chord
    return layout.CondensedTerms(
        numbers, Sizes(np.empty(lanes.size), np.empty(2 * lanes.modes), none, none), closure, kappa,
        lanes.coordinates(guys.moments), lanes.coordinates(guys.loads), tilt, reach, lanes.of(axes.reshape(-1, 9)),
    )  # fmt: skip


def watched(terms: layout.CondensedTerms, largest_kappa: np.ndarray) -> layout.CondensedTerms:
    """Return the coefficients of guys that are watched, with their largest fitted kappa (guys,) [1/(kg m)]."""
    numbers = terms.numbers.copy()
    numbers[layout.LARGEST_KAPPA, : largest_kappa.size] = largest_kappa
    return terms._replace(numbers=numbers)


def damping_of(lanes: Lanes, matrices: np.ndarray, step: float, fitted: np.ndarray) -> np.ndarray | None:
    """Return the matrices D and A of damping matrices (guys, 2 r, 2 r), in lanes (2, 2, modes, modes, lanes); None without any.

    D is the damping matrix for the fitted masses, A = (1 + step / 2 D F)^-1, for fitted factors F (guys, 2 r).
    """
    if not matrices.size:
        return None
    r, root, one = lanes.rank, np.sqrt(fitted), np.eye(2 * lanes.rank)
    fitting = matrices / root[:, :, None] / root[:, None]
    solved = np.linalg.inv(one + 0.5 * step * fitting * fitted[:, None])
    result = np.zeros((2, 2, lanes.modes, lanes.modes, lanes.size))
    for k, both in enumerate((fitting, solved)):
        for part in range(2):  # the planes are independent about rest
            which = slice(part * r, (part + 1) * r)
            result[k, part, :r, :r, : lanes.count] = np.moveaxis(both[:, which, which], 0, -1)
    return result


def wind_of(lanes: Lanes, guys: GuySet, drag: np.ndarray, points: int, velocity: np.ndarray) -> layout.CondensedWind:
    """Return the drag at points of the guys for velocities of the air there, see :class:`CondensedWind`.

    Integrals of shapes times polynomials of a degree below the number of points are kept.  By single values of the shapes the
    last ones would be damped by up to 1.7 times as much.  `drag` is half the density of the air times drag coefficient and
    diameter (guys,) [kg/m2].
    """
    places, weights, _ = to_gauss(points)
    fine, fine_weights = gauss_rule(FINE * places.size)
    onto_points = projection(places.size, fine, fine_weights)
    shapes, slopes = np.zeros((2, 2, places.size, lanes.modes))
    for part, shape in enumerate(guys.shapes):
        shapes[part, :, : lanes.rank] = onto_points @ shape.basis(fine, 0).T
        slopes[part, :, : lanes.rank] = shape.basis(places, 1).T
    of_points = lanes.of((drag * guys.length)[:, None] * weights)
    return layout.CondensedWind.of(velocity, of_points, places, shapes, slopes)
