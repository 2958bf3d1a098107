"""Run of a mast on static guys, as practice has them: exact catenaries in still air, without motion of their own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cablepod.catenary._statics import solve_catenaries
from cablepod.errors import OutOfRangeWarning, SceneError, scene_error, warn
from cablepod.mast._air import drive_of
from cablepod.mast._kernels_layout import StaticTerms, StaticWind
from cablepod.mast._march import march
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastRequest, MastTrajectory
from cablepod.mast._static_guys import GuyStatics, StaticGuy
from cablepod.scene._mast_field import GUY_POINTS
from cablepod.wind._air import refined
from cablepod.wind._drag import drag_of, straight_drag
from cablepod.wind._mast_air import MastAir

#: Intervals of a table, and its reach to both sides over the height of the mast.
INTERVALS, REACH = 1000, 0.03
#: Difference of the tension of a static guy in still air from that at rest in the mean wind, over this, above which it warns.
DRAG_COUNTS = 0.05
#: Steps in the shortest period of the mast's modes, whose frequencies the scheme has exactly.
STEPS_PER_PERIOD = 4.0


@dataclass(frozen=True, eq=False)
class CatenaryGuys:
    """The guys of a mast as static catenaries."""

    mast: ModalMast
    air: MastAir | None

    @cached_property
    def guys(self) -> list[StaticGuy]:
        """The guys in still air, with ice."""
        return self.mast.rest.bare

    @property
    def default_step(self) -> float:
        """Step by the shortest period of the mast's modes [s]."""
        return 2.0 * np.pi / (STEPS_PER_PERIOD * float(self.mast.omega[-1]))

    @cached_property
    def tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Least distances, intervals (guys,) [m], splines of horizontal force over distance and of vertical force."""
        from scipy.interpolate import CubicSpline

        count = len(self.guys)
        first, spacing = np.empty(count), np.empty(count)
        splines = np.empty((2, count, INTERVALS, 4))
        for g, (guy, own) in enumerate(zip(self.guys, self.mast.rest.p.guys, strict=True)):
            at_rest = self.mast.rest.upper[g]
            middle = float(np.hypot(at_rest[0] - guy.p.lower[0], at_rest[2] - guy.p.lower[2]))
            reach = min(REACH * self.mast.rest.p.height, 0.9 * middle if middle > 0.0 else np.inf)
            low = max(middle - reach, 1e-3 * reach)
            span = np.linspace(low, middle + reach, INTERVALS + 1)
            rise = own.level - float(guy.p.lower[1])
            weight = -float(guy.p.weight[1])
            ones = np.ones_like(span)
            plane = (span, rise * ones, np.hypot(span, rise), weight * ones)
            solved, status = solve_catenaries(plane, guy.p.stiffness * ones, "unstretched_length", guy.length * ones)
            if status.any():
                raise SceneError(
                    f"{own.key}: given a guy without a static table; allowed: guys with weight and stiffness"
                )
            vertical = -(solved[:, 3] + 0.5 * weight * guy.length)
            first[g], spacing[g] = low, span[1] - span[0]
            place = np.arange(INTERVALS + 1.0)
            for target, values in zip(splines[:, g], (solved[:, 2] / span, vertical), strict=True):
                target[:] = CubicSpline(place, values).c.T
        return first, spacing, np.ascontiguousarray(splines[0]), np.ascontiguousarray(splines[1])

    def _reaction(self, velocity: np.ndarray) -> np.ndarray:
        """Return the part of the drag that the mast carries, for velocities (samples, points, 3): (samples, guys, 2) [N]."""
        assert self.air is not None
        wind = self.air.of_guys(velocity)
        sigma = np.linspace(0.0, 1.0, GUY_POINTS)
        result = np.empty((len(velocity), len(self.guys), 2))
        for g, guy in enumerate(self.guys):
            along = guy.chord / np.linalg.norm(guy.chord)
            force = straight_drag(drag_of(guy.p, self.air.density), guy.length * along, wind[:, g])[0][..., (0, 2)]
            result[:, g] = np.trapezoid(sigma[:, None] * force, sigma, axis=1)
        return result

    def run(self, request: MastRequest) -> MastTrajectory:
        """Run from rest.

        Raises
        ------
        SceneError
            For a step above the stability limit.
        """
        mast, step, count = self.mast, request.step, len(self.guys)
        limit = np.pi / float(mast.omega[-1])
        if not step < limit:
            raise scene_error("step", step, f"below half of the shortest period of the mast, {limit:.6g} s")
        drive, wind = drive_of(mast, self.air, request), None
        statics = GuyStatics(self.guys, mast.rest.upper)
        self._warn_of_drag(statics.tensions[:, 1])
        forces = statics.forces.copy()
        if self.air is not None:
            wind = StaticWind(refined(self._reaction(self.air.velocity)), drive.refined_samples_per_step)
            forces[:, [0, 2]] += self._reaction(self.air.start[None])[0]
        first, spacing, horizontal, vertical = self.tables
        places = np.repeat([[np.inf], [-np.inf]], count, axis=1)
        anchors = np.array([guy.p.lower[[0, 2]] for guy in self.guys]).reshape(-1, 2)
        result = march(
            mast, request, mast.step_matrices_with(mast.guy_masses, step), drive, mast.guy_masses, forces,
            static=StaticTerms(anchors, first, spacing, horizontal, vertical, places), guy_wind=wind,
        )  # fmt: skip
        status = result.status
        if count and not status:
            self._warn_of_slack(first + spacing * places[0])
        if count and not status and (places[0].min() < 0.0 or places[1].max() > INTERVALS):
            warn(
                f"a guy's end moved by more than {REACH:g} of the height, beyond the table of its force, which is a "
                'straight line there; compare with guys="chain"',
                OutOfRangeWarning,
            )
        return result

    def _warn_of_drag(self, start: np.ndarray) -> None:
        """Warn of guys whose tensions in still air (guys,) [N] are not those at rest in the mean wind."""
        at_rest = self.mast.rest.tension[:, 1]
        excess = np.abs(start - at_rest) - DRAG_COUNTS * at_rest
        if excess.max(initial=0.0) > 0.0:
            worst = int(excess.argmax())
            warn(
                f"{self.mast.rest.p.guys[worst].key}: static guys are catenaries in still air: guy {worst + 1} starts with "
                f"{start[worst]:.4g} N, but is at rest in the mean wind with {at_rest[worst]:.4g} N; compare with "
                'guys="condensed" or guys="chain"',
                OutOfRangeWarning,
            )

    def _warn_of_slack(self, least: np.ndarray) -> None:
        """Warn of a guy, taut on the straight mast, whose chord becomes shorter than the guy.

        Parameters
        ----------
        least
            Least horizontal distances of the ends (guys,) [m].
        """
        taut = [float(np.linalg.norm(guy.chord)) > guy.length for guy in self.mast.rest.bare]
        lengths, rises = np.array([[guy.length, guy.chord[1]] for guy in self.guys]).T
        excess = np.where(taut, np.hypot(least, rises) / lengths - 1.0, np.inf)
        worst = int(excess.argmin())
        if excess[worst] < 0.0:
            warn(
                f"{self.mast.rest.p.guys[worst].key}: the chord of guy {worst + 1} became shorter than its unstretched length, "
                f"by {-excess[worst]:.2g} of it: it goes slack, where a static guy lacks the motion of a real one; compare with "
                'guys="chain"',
                OutOfRangeWarning,
            )
