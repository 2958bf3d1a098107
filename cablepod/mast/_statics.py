"""Rest of a mast and its guys: nonlinear equilibrium, tangent stiffness, buckling.

Guys on the beam: rows of shape functions give the displacement of the upper end of a guy, and take its force to the nodes; in
motion ``_kernels_mast.py`` does the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np

from cablepod.errors import SceneError
from cablepod.mast._beam import Beam, beam_of
from cablepod.mast._drag import MastDrag, drag_of_mast
from cablepod.mast._static_guys import GuyStatics, StaticGuy, static_guys, with_mean_drag
from cablepod.parameters._mast import MastParameters
from cablepod.scene._mast_notes import mast_hint
from cablepod.wind._mast_air import MastAir

#: Maximum number of Newton iterations, the last correction over the height, and that below which it may stop to fall by rounding:
#: of nodes 1e-4 of the height apart, corrections of 2e-9 are left.
MAX_ITERATIONS, RTOL, ROUNDED = 60, 1e-13, 1e-7
#: Minimum share of loads and wind by which they grow where Newton's method fails with all of them.
LEAST_SHARE = 1.0 / 64.0
#: Largest displacement of an iterate over the height: beyond, the equations for small slopes do not hold.
MAX_DEFLECTION = 0.2


@dataclass(frozen=True, eq=False)
class MastRest:
    """A mast and its guys in equilibrium."""

    p: MastParameters
    beam: Beam
    bare: list[StaticGuy]  #: the guys of the straight mast in still air
    still: list[StaticGuy]  #: those of the straight mast with the mean drag
    unknowns: np.ndarray  #: of the beam (count,)
    force: np.ndarray  #: of the guys on the mast (guys, 3) [N]
    tension: np.ndarray  #: at anchor and mast (guys, 2) [N]
    drag: MastDrag
    statics: GuyStatics

    @cached_property
    def upper(self) -> np.ndarray:
        """Upper ends of the guys on the displaced mast (guys, 3) [m]."""
        return upper_ends(self.p, self.beam, self.unknowns)

    @cached_property
    def guys(self) -> list[StaticGuy]:
        """The guys with their upper ends on the displaced mast."""
        return [guy.at(end) for guy, end in zip(self.still, self.upper, strict=True)]

    @cached_property
    def rows(self) -> np.ndarray:
        """Matrix from the unknowns to the displacement of the guys' upper ends in x and z (guys, 2, count)."""
        return guy_rows(self.p, self.beam)

    @cached_property
    def pull(self) -> np.ndarray:
        """Vertical pull of the guys, downwards (guys,) [N]."""
        return -self.force[:, 1]

    @cached_property
    def levels(self) -> np.ndarray:
        """Heights of the guys (guys,) [m]."""
        return np.array([guy.level for guy in self.p.guys])

    @cached_property
    def geometric(self) -> np.ndarray:
        """Stiffness of the axial force (count, count)."""
        return self.beam.geometric(self.levels, self.pull)

    @cached_property
    def mast_stiffness(self) -> np.ndarray:
        """Stiffness of the mast without its guys, with the axial force (count, count)."""
        return self.beam.bending + self.geometric

    @cached_property
    def section_rows(self) -> np.ndarray:
        """Matrix from the unknowns to the section forces, see :meth:`cablepod.mast._beam.Beam.section_rows`."""
        return self.beam.section_rows(self.levels, self.pull)

    @cached_property
    def sections(self) -> np.ndarray:
        """Bending moments at the nodes [N m], then horizontal forces at the ends of elements [N] (node + element ends, 2)."""
        return self.section_rows @ self.unknowns + self.drag.section_rows @ self.drag.at_rest

    @cached_property
    def compression(self) -> np.ndarray:
        """Axial force at the lower ends of the elements, positive in compression (element,) [N]."""
        return self.beam.compression(self.beam.height[:-1], self.levels, self.pull)

    @cached_property
    def guy_stiffness(self) -> np.ndarray:
        """Static stiffness of the guys in x and z (guys, 2, 2) [N/m]."""
        return self.statics.stiffness()[:, [0, 2]][:, :, [0, 2]]

    @cached_property
    def stiffness(self) -> np.ndarray:
        """Static stiffness of mast and guys (count, count)."""
        return self.mast_stiffness + seen_by(self.rows, self.guy_stiffness)

    def unbalanced(self, load: np.ndarray) -> np.ndarray:
        """Return what a load (count,) exceeds the forces of mast and guys by (count,)."""
        return load - self.mast_stiffness @ self.unknowns + np.einsum("gi,gia->a", self.force[:, [0, 2]], self.rows)

    @property
    def is_stable(self) -> bool:
        """Whether the stiffness is positive definite: the critical factor is above 1 then."""
        try:
            np.linalg.cholesky(self.stiffness)
        except np.linalg.LinAlgError:
            return False
        return True

    @cached_property
    def buckling_factor(self) -> float:
        """Factor of the axial force at which the mast buckles, the stiffness of the guys kept; infinite without compression."""
        from scipy.linalg import eigh

        elastic = self.stiffness - self.geometric
        try:
            ratio = eigh(-self.geometric, elastic, eigvals_only=True)[-1]
        except np.linalg.LinAlgError:
            return 0.0  # not stable without axial force either
        return float(1.0 / ratio) if ratio > 0.0 else np.inf


def seen_by(rows: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """Return the sum of matrices of ends (ends, 2, 2) seen by unknowns that displace them by rows (ends, 2, count)."""
    count = rows.shape[2]
    return rows.reshape(-1, count).T @ (matrices @ rows).reshape(-1, count)


def upper_ends(p: MastParameters, beam: Beam, unknowns: np.ndarray) -> np.ndarray:
    """Return the upper ends of the guys for unknowns of the mast (guys, 3) [m]."""
    result = np.zeros((len(p.guys), 3))
    result[:, [0, 2]] = guy_rows(p, beam) @ unknowns
    result[:, 1] = [guy.level for guy in p.guys]
    return result


def guy_rows(p: MastParameters, beam: Beam) -> np.ndarray:
    """Return the matrix from the unknowns to the displacement of the guys' upper ends in x and z (guys, 2, count)."""
    return beam.rows_at([guy.level for guy in p.guys])


def load_vectors(p: MastParameters, beam: Beam) -> np.ndarray:
    """Return the loads of the mast on the unknowns, for factors of one (loads, count)."""
    rows = beam.rows_at([load.level for load in p.loads])
    return np.array([load.force[[0, 2]] @ row for load, row in zip(p.loads, rows, strict=True)]).reshape(-1, beam.count)


def steady_load(p: MastParameters, beam: Beam, drag: MastDrag) -> np.ndarray:
    """Return loads at time 0 and drag at rest on the mast, on the unknowns (count,)."""
    total = np.zeros(beam.count)
    for load, vector in zip(p.loads, load_vectors(p, beam), strict=True):
        total += vector * (1.0 if load.factor is None else float(load.factor(0.0)))
    return total + np.tensordot(drag.at_rest, drag.rows, 2)


@lru_cache(16)
def rest_of(p: MastParameters, air: MastAir | None = None) -> MastRest:
    """Find mast and guys at rest, in the mean wind of the scene or in that of a field.

    Where Newton's method fails from the upright mast, the forces that displace it grow in steps, each from the rest before it.

    Raises
    ------
    SceneError
        For a mast that buckles, or without equilibrium.
    """
    beam = beam_of(p)
    straight = static_guys(p)
    guys = with_mean_drag(straight, p, air)
    drag = drag_of_mast(p, beam, air)
    load = steady_load(p, beam, drag)
    at = partial(_at, p, drag, straight, guys)
    rest = at(np.zeros(beam.count))
    check_buckling(rest)
    upright, share, step = rest.unbalanced(load), 0.0, 1.0
    while share < 1.0:
        found = _equilibrium(rest, load - (1.0 - share - step) * upright, at)
        if found is not None and found.is_stable:
            rest, share = found, share + step
            step = min(2.0 * step, 1.0 - share)
        elif step > LEAST_SHARE:
            step *= 0.5
        elif share + step == 1.0 and found is not None:
            check_buckling(found)
        else:
            raise SceneError(
                f"mast: no stable rest found with displacements below {MAX_DEFLECTION:g} of the height beyond {share:.3g} of "
                f"loads and wind; allowed: loads and wind that mast and guys carry{mast_hint(p)}"
            )
    return rest


def _equilibrium(start: MastRest, load: np.ndarray, at: Callable[[np.ndarray], MastRest]) -> MastRest | None:
    """Return the equilibrium under a load (count,) by Newton's method from a state; None where it fails."""
    rest, rows, height, last = start, start.rows, start.p.height, np.inf
    for _ in range(MAX_ITERATIONS):
        try:
            change = np.linalg.solve(rest.stiffness, rest.unbalanced(load))
        except np.linalg.LinAlgError:
            return None
        unknowns = rest.unknowns + change
        if not np.abs(rows @ unknowns).max(initial=0.0) < MAX_DEFLECTION * height:
            return None
        rest = at(unknowns)
        correction = np.abs(rows @ change).max(initial=0.0) / height
        if correction <= RTOL or ROUNDED > correction >= last:
            return rest
        last = correction
    return None


def rest_in(p: MastParameters, air: MastAir | None) -> MastRest:
    """Find mast and guys at rest in the mean of their air; that of a record or field takes the place of [wind].

    Raises
    ------
    SceneError
        As :func:`rest_of`.
    """
    return rest_of(p, None if air is None or air.has_profile else air)


def check_buckling(rest: MastRest) -> None:
    """Refuse a mast that buckles under its weight and its guys.

    Raises
    ------
    SceneError
        States the critical factor of the axial force.
    """
    if not rest.is_stable:
        factor = rest.buckling_factor
        compression = float(rest.beam.compression(np.zeros(1), rest.levels, rest.pull)[0])
        if factor == 0.0:
            raise SceneError(
                "guy: given guys that do not hold the mast in all directions; allowed: guys on three sides, or mast.base "
                '"clamped"'
            )
        said = mast_hint(rest.p) or "; try: guys of lower tension or a stiffer mast"
        raise SceneError(
            f"mast.bending_stiffness: given a mast that buckles under its weight and guys, {compression:.4g} N at its foot: "
            f"critical factor {factor:.4g}; allowed: a critical factor above 1{said}"
        )


def _at(
    p: MastParameters,
    drag: MastDrag,
    bare: list[StaticGuy],
    guys: list[StaticGuy],
    unknowns: np.ndarray,
) -> MastRest:
    """Return mast and guys with given unknowns of the mast."""
    statics = GuyStatics(guys, upper_ends(p, drag.beam, unknowns))
    return MastRest(p, drag.beam, bare, guys, unknowns, statics.forces, statics.tensions, drag, statics)


def check_shapes(rest: MastRest) -> None:
    """Refuse guys without weight that are slack at rest, as they have no shape to move from.

    Raises
    ------
    SceneError
        Names the first of them.
    """
    for g in np.flatnonzero(rest.tension[:, 1] == 0.0).tolist():
        raise SceneError(
            f"{rest.p.guys[g].key}: given guys without weight, of which guy {g + 1} is slack at rest and has no shape to move "
            "from; allowed: guys with weight, or taut ones"
        )
