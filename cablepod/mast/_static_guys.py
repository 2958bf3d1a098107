"""Guys as exact elastic catenaries: unstretched lengths, end forces and static stiffness; mean drag on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cablepod.catenary._end_stiffness import STRAIGHT, curved_stiffness, static_stiffness
from cablepod.catenary._formulas import FOUND, SLACK_WEIGHTLESS
from cablepod.catenary._piecewise import Pieces, PiecewiseCatenary
from cablepod.catenary._piecewise_solve import between_ends, end_stiffness
from cablepod.catenary._shape import shape
from cablepod.catenary._statics import length_as_tensioned, solve_statics
from cablepod.catenary._uniform import resolved, solve_catenaries
from cablepod.discretisation._lifting import weights_of_ends
from cablepod.mast._piecewise_guys import in_mean_wind, still_pieces
from cablepod.parameters._mast import MastParameters
from cablepod.parameters._parameters import Parameters, ramp_of
from cablepod.scene._mast_field import GUY_POINTS
from cablepod.scene._wind_field import linear_between
from cablepod.wind._air import density_of, mean_velocity
from cablepod.wind._drag import drag_of, straight_drag
from cablepod.wind._mast_air import MastAir

#: Points along a guy for the mean drag, and passes with the shape in the wind.
POINTS, PASSES = 41, 3


@dataclass(frozen=True, eq=False)
class StaticGuy:
    """A guy of known unstretched length, with a uniform load, or of pieces with loads of their own."""

    p: Parameters
    length: float  #: unstretched [m]
    #: Reactions of anchor and mast to drag, beside those to the uniform load (2, 3) [N].
    reactions: np.ndarray = field(default_factory=lambda: np.zeros((2, 3)))
    pieces: Pieces | None = None  #: of a guy with segments or attachments, which have the drag; None for a uniform one
    key: str = "cable"  #: key path of its table, for errors of the statics of pieces

    @property
    def chord(self) -> np.ndarray:
        """Vector from anchor to mast (3,) [m]."""
        return self.p.upper - self.p.lower

    def at(self, upper: np.ndarray) -> StaticGuy:
        """Return the guy with its upper end elsewhere [m]."""
        return replace(self, p=replace(self.p, upper=upper))

    def hung(self) -> PiecewiseCatenary:
        """Return the catenary of a guy of pieces."""
        assert self.pieces is not None
        return between_ends(self.pieces, self.chord, self.length, self.length_key)

    @property
    def length_key(self) -> str:
        """Key path of its length."""
        return f"{self.key}.unstretched_length"


class GuyStatics:
    """Guys as exact elastic catenaries with their upper ends at given places, all at once."""

    def __init__(self, guys: Sequence[StaticGuy], upper: np.ndarray) -> None:
        self._guys, self._upper = guys, upper
        self.lengths = np.array([guy.length for guy in guys])  #: unstretched (guys,) [m]
        self._spring = np.array([guy.p.stiffness for guy in guys], dtype=float)
        self._reactions = np.array([guy.reactions for guy in guys]).reshape(-1, 2, 3)
        chords = upper - np.array([guy.p.lower for guy in guys], dtype=float).reshape(-1, 3)
        loads = np.array([guy.p.load_at(0.0) for guy in guys], dtype=float).reshape(-1, 3)
        *plane, self._across, self._against = resolved(chords, loads)
        self.loads = plane[3]  #: per unstretched length (guys,) [N/m]
        #: solutions of the uniform catenaries (guys, 6), see ``cablepod.catenary._formulas``; nan for guys of pieces
        self.solved, status = solve_catenaries(plane, self._spring, "unstretched_length", self.lengths)
        self._hung = {g: guy.at(upper[g]).hung() for g, guy in enumerate(guys) if guy.pieces is not None}
        self.solved[list(self._hung)] = np.nan
        self.solved[status == SLACK_WEIGHTLESS, 2:] = 0.0  # carries nothing
        for g in np.flatnonzero((status != FOUND) & (status != SLACK_WEIGHTLESS)).tolist():
            if g not in self._hung:  # says what is wrong
                solve_statics(guys[g].at(upper[g]).p, "unstretched_length", guys[g].length, prefix=guys[g].key)

    @property
    def frames(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Anchors [m] and unit vectors across and against the load (guys, 3)."""
        return np.array([guy.p.lower for guy in self._guys]), self._across, self._against

    @property
    def forces(self) -> np.ndarray:
        """Forces on the mast (guys, 3) [N]."""
        return self._end_forces[:, 1]

    @property
    def anchor_forces(self) -> np.ndarray:
        """Forces on the anchors (guys, 3) [N]."""
        return self._end_forces[:, 0]

    @cached_property
    def _end_forces(self) -> np.ndarray:
        """Forces on anchor and mast (guys, 2, 3) [N]."""
        horizontal, middle, half = self.solved[:, 2], self.solved[:, 3], 0.5 * self.loads * self.lengths
        across, against = np.stack([horizontal, -horizontal], axis=1), np.stack([middle - half, -middle - half], axis=1)
        uniform = across[..., None] * self._across[:, None] + against[..., None] * self._against[:, None]
        result = uniform + self._reactions
        for g, catenary in self._hung.items():
            result[g] = catenary.end_forces * [[1.0], [-1.0]]
        return result

    @property
    def tensions(self) -> np.ndarray:
        """Tensions at the anchor and at the mast (guys, 2) [N]."""
        return np.linalg.norm(self._end_forces, axis=2)

    def stiffness(self) -> np.ndarray:
        """Return the stiffness of the upper ends (guys, 3, 3) [N/m], as :mod:`cablepod.catenary._end_stiffness`."""
        result = np.empty((len(self._guys), 3, 3))
        force, least = self.solved[:, 2], STRAIGHT * self.solved[:, 4:].sum(axis=1)
        curved = (self.loads * self.lengths > least) & (force > least)
        for g in np.flatnonzero(~curved).tolist():  # straight, slack, along the load, or of pieces
            guy, hung = self._guys[g], self._hung.get(g)
            if hung is not None:
                result[g] = end_stiffness(hung)
            elif not self.solved[g, -1] > 0.0:
                result[g] = 0.0  # slack, without weight
            else:
                result[g] = static_stiffness(guy.p, guy.length, self._upper[g])
        each = self._across, self._against, self.solved, self.loads, self.lengths, self.lengths / self._spring
        result[curved] = curved_stiffness(*(values[curved] for values in each))
        return result


def static_guys(p: MastParameters) -> list[StaticGuy]:
    """Return the guys of the straight mast in still air, with ice."""
    guys = []
    for guy in p.guys:
        # tensioned on the straight mast in still air without ice, at the reference temperature
        given = guy.p.bare or guy.p
        length = length_as_tensioned(guy.p, given.length_key, given.length_value, prefix=guy.key)
        own = replace(guy.p, length_key="unstretched_length", length_value=length, bare=None)
        guys.append(StaticGuy(own, length, pieces=still_pieces(own, length), key=guy.key))
    return guys


def with_mean_drag(guys: Sequence[StaticGuy], p: MastParameters, air: MastAir | None = None) -> list[StaticGuy]:
    r"""Return the guys with the mean drag as a uniform load that gives the same sag in the middle of a taut guy.

    With the drag q per unit of :math:`\sigma`, from anchor to mast, that load is :math:`6 \int \sigma (1 - \sigma) q\, d\sigma`.
    The ends carry the rest r, :math:`\int (1 - \sigma) r\, d\sigma` and :math:`\int \sigma r\, d\sigma`, which keeps sum and
    moment of the drag.  Guys of pieces have it piece by piece, see :func:`cablepod.mast._piecewise_guys.in_mean_wind`.  The wind
    is that of the scene, or that of a field.
    """
    if not guys or (air is None and (p.wind is None or ramp_of(p))):
        return list(guys)
    result = [guy if guy.pieces is None else _in_wind(guy, g, p, air) for g, guy in enumerate(guys)]
    uniform = [g for g, guy in enumerate(guys) if guy.pieces is None]
    for g, guy in zip(uniform, _uniform_in_wind(guys, uniform, p, air), strict=True):
        result[g] = guy
    return result


def _in_wind(guy: StaticGuy, number: int, p: MastParameters, air: MastAir | None) -> StaticGuy:
    """Return the guy of pieces of a number with the mean drag, see :func:`with_mean_drag`."""

    def wind(position: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        if air is None:
            return mean_velocity(p, position[:, 1])
        return linear_between(np.linspace(0.0, 1.0, GUY_POINTS), air.of_guys(air.start)[number], sigma, axis=0)

    density = density_of(p) if air is None else air.density
    assert guy.pieces is not None
    return replace(guy, pieces=in_mean_wind(guy.p, guy.pieces, wind, density, guy.length_key))


def _uniform_in_wind(
    all_guys: Sequence[StaticGuy], which: Sequence[int], p: MastParameters, air: MastAir | None
) -> list[StaticGuy]:
    """Return the uniform guys of some numbers with the mean drag, see :func:`with_mean_drag`."""
    guys: Sequence[StaticGuy] = [all_guys[g] for g in which]
    if not guys:
        return []
    sigma, upper = np.linspace(0.0, 1.0, POINTS), np.array([guy.p.upper for guy in guys])
    density = density_of(p) if air is None else air.density
    drag = np.array([drag_of(guy.p, density) for guy in guys])
    if air is not None:
        wind = linear_between(np.linspace(0.0, 1.0, GUY_POINTS), air.of_guys(air.start)[which], sigma)
    for _ in range(PASSES):
        statics = GuyStatics(guys, upper)
        x, y = np.empty((2, len(guys), POINTS))
        for g, guy in enumerate(guys):
            solved, load, stiffness = statics.solved[g], float(statics.loads[g]), float(guy.p.stiffness)
            x[g], y[g], _ = shape(guy.length * sigma, solved, load, stiffness)
        lower, across, against = statics.frames
        position = lower[:, None] + x[..., None] * across[:, None] + y[..., None] * against[:, None]
        if air is None:
            wind = mean_velocity(p, position[..., 1])
        reach = np.gradient(position, sigma, axis=1)
        drags = straight_drag((drag / statics.lengths)[:, None], reach, wind)[0]
        loads = 6.0 * np.trapezoid((sigma * (1.0 - sigma))[:, None] * drags, sigma, axis=1)
        shares = weights_of_ends(sigma)[..., None]
        rest = np.trapezoid(shares * (drags - loads[:, None])[:, None], sigma, axis=2)
        guys = [
            replace(guy, p=replace(guy.p, load=load), reactions=guy.length * reactions)
            for guy, load, reactions in zip(guys, loads, rest, strict=True)
        ]
    return list(guys)
