"""Wind in the error estimate: drag on the enriched model, and the damping of the error by it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._air import EXTRA_POINTS, CondensedAir
from cablepod.condensed._air_motion import DragOfMotion

if TYPE_CHECKING:
    from cablepod.condensed._error_equation import ErrorEquation

#: Number of air tables that are kept for the estimates of further runs.
KEPT_TABLES = 4


@dataclass(frozen=True)
class EnrichedDrag:
    """Drag on the coordinates of the enriched model, for a motion of the model."""

    equation: ErrorEquation
    air: CondensedAir  #: at as many points as the enriched modes need

    @classmethod
    def of(cls, equation: ErrorEquation, air: CondensedAir) -> EnrichedDrag:
        """Return the drag of the air along a model on its enriched one."""
        in_plane = equation.enriched_in_plane
        return cls(equation, _refined(air, max(in_plane, len(equation.change) - in_plane) + EXTRA_POINTS))

    def forces(
        self, times: np.ndarray, q: np.ndarray, rates: np.ndarray, boundary_data: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Return the forces (samples, R) on the enriched coordinates, and the damping of the error per mass [1/s].

        Parameters
        ----------
        times
            Instants [s].
        q, rates
            Coordinates of the motion and their rates (samples, r).
        boundary_data
            A row for each sample, the chord first.
        """
        chain, in_plane = self.air.model.chain, self.equation.enriched_in_plane
        motion = DragOfMotion.of(self.air, times, q, rates, boundary_data[:, 0] / chain.total_length)
        shapes, slopes = self.air.at_points(self.equation.shapes, (0, 1))
        return motion.on(shapes, in_plane) + motion.by_tension(slopes, in_plane), motion.damping / self._mass_per_length

    @property
    def _mass_per_length(self) -> float:
        """Mass per length by which the drag damps the error [kg/m]: of a cable that is not uniform, that of the slowest mode."""
        model = self.air.model
        if model.is_uniform:
            return model.chain.p.mass
        masses = [segment.mass for segment in model.chain.p.segments]
        attached = sum(attachment.mass for attachment in model.chain.p.attachments)
        return max([model.chain.p.mass, *masses]) + 2.0 * attached / model.chain.total_length

    def at_rest(self, q: np.ndarray, boundary_data: np.ndarray) -> np.ndarray:
        """Return the forces (R,) in the mean wind on coordinates (r,) at rest."""
        steady = EnrichedDrag(self.equation, self.air.in_mean_wind)
        return steady.forces(np.zeros(1), q[None], np.zeros((1, q.size)), boundary_data[None])[0][0]


@lru_cache(KEPT_TABLES)
def _refined(air: CondensedAir, points: int) -> CondensedAir:
    """Return the same air at another number of points."""
    return replace(air, points=points)
