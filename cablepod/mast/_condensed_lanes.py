"""Arrays of condensed guys for the kernels: guys last, in lanes."""

from __future__ import annotations

import weakref
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cablepod.catenary._end_stiffness import gauss_rule
from cablepod.condensed._air_places import FINE, projection
from cablepod.condensed._kernels_layout import LeadingTerms, Sizes
from cablepod.mast import _kernels_layout as layout
from cablepod.mast._air import to_gauss
from cablepod.wind._drag import drag_of

if TYPE_CHECKING:
    from cablepod.mast._condensed_run import CondensedGuys


class Lanes:
    """Arrays of the guys of a mast for the kernel: guys last, padded to whole groups of lanes, modes too."""

    def __init__(self, model: CondensedGuys) -> None:
        guys, self.rank = model.guys, model.rank
        # a proxy, as the model keeps these lanes: in a circle both would keep the air of many members
        self.model = weakref.proxy(model)
        self.count = guys.count
        self.size = -(-max(self.count, 1) // layout.LANES) * layout.LANES
        self.modes = -(-self.rank // layout.MODES_TOGETHER) * layout.MODES_TOGETHER
        self.numbers = np.ones((8, self.size))
        self.numbers[[layout.WEIGHT, layout.STIFFENING, layout.LARGEST_KAPPA]] = 0.0
        rows = {
            layout.STIFFNESS: guys.stiffness, layout.LENGTH: guys.length, layout.WEIGHT: guys.weight,
            layout.SOFTENING: 1.0 - 2.0 * guys.strain, layout.STIFFENING: guys.strain * guys.rest_force,
            layout.SCALE: guys.scale, layout.SLOPE_SCALE: guys.scale / guys.length,
        }  # fmt: skip
        for row, values in rows.items():
            self.numbers[row, : self.count] = values

    def watched(self, fitted: np.ndarray) -> layout.CondensedTerms:
        """Return the coefficients of guys that are watched, with fitted factors (guys, 2 r)."""
        numbers = self.numbers.copy()
        numbers[layout.LARGEST_KAPPA, : self.count] = (self.model.guys.kappa * fitted).max(axis=1, initial=0.0)
        return self.terms._replace(numbers=numbers)

    @cached_property
    def terms(self) -> layout.CondensedTerms:
        """Coefficients of the guys."""
        model, guys, numbers, r = self.model, self.model.guys, self.numbers, self.rank
        kappa, none = self.coordinates(guys.kappa), np.empty(0)
        spring = 0.5 * numbers[layout.STIFFNESS] / numbers[layout.LENGTH]
        closure = LeadingTerms(
            numbers[layout.STIFFNESS], 1.0 / numbers[layout.LENGTH], spring * numbers[layout.SOFTENING], kappa.ravel(),
            none, none, none,
        )  # fmt: skip
        tilt = np.zeros((2, self.modes, self.modes))
        tilt[0, :r, :r], tilt[1, :r, :r] = guys.tilt[:r, :r], guys.tilt[r:, r:]
        reach = self.of(guys.lower - guys.upper)
        reach[0, self.count :] = 1.0  # lanes without a guy have a chord
        return layout.CondensedTerms(
            numbers, Sizes(np.empty(self.size), np.empty(2 * self.modes), none, none), closure, kappa,
            self.coordinates(guys.moments), self.coordinates(guys.loads), tilt, reach, self.of(model.axes.reshape(-1, 9)),
        )  # fmt: skip

    @cached_property
    def end_mass(self) -> np.ndarray:
        """Mass of the upper ends, rows of force in x, y, z by acceleration in x and z (6, lanes) [kg]."""
        return self.of(self.model.reaction_mass.reshape(-1, 6))

    def damping(self, step: float, fitted: np.ndarray) -> np.ndarray | None:
        """Return the matrices D and A of the damping by ratios (2, 2, modes, modes, lanes); None without.

        D is the damping matrix for the fitted masses, A = (1 + step / 2 D F)^-1, for fitted factors F (guys, 2 r).
        """
        matrices, r = self.model.damping, self.rank
        if not matrices.size:
            return None
        root, one = np.sqrt(fitted), np.eye(2 * r)
        fitting = matrices / root[:, :, None] / root[:, None]
        solved = np.linalg.inv(one + 0.5 * step * fitting * fitted[:, None])
        result = np.zeros((2, 2, self.modes, self.modes, self.size))
        for k, both in enumerate((fitting, solved)):
            for part in range(2):  # the planes are independent about rest
                which = slice(part * r, (part + 1) * r)
                result[k, part, :r, :r, : self.count] = np.moveaxis(both[:, which, which], 0, -1)
        return result

    def wind(self, velocity: np.ndarray) -> layout.CondensedWind:
        """Return the drag at points of the guys for velocities of the air there, see :class:`CondensedWind`.

        Integrals of shapes times polynomials of a degree below the number of points are kept.  By single values of the shapes the
        last ones would be damped by up to 1.7 times as much.
        """
        model = self.model
        assert model.air is not None
        places, weights, _ = to_gauss(model.drag_points)
        drag = np.array([drag_of(guy.p, model.air.density) for guy in model.mast.rest.p.guys]) * model.guys.length
        fine, fine_weights = gauss_rule(FINE * places.size)
        onto_points = projection(places.size, fine, fine_weights)
        shapes, slopes = np.zeros((2, 2, places.size, self.modes))
        for part, shape in enumerate(model.shapes):
            shapes[part, :, : self.rank] = onto_points @ shape.basis(fine, 0).T
            slopes[part, :, : self.rank] = shape.basis(places, 1).T
        return layout.CondensedWind.of(velocity, self.of(drag[:, None] * weights), places, shapes, slopes)

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
