"""Damping of the vibrations about rest by given ratios, for all models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cablepod._resources import memory
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._parameters import Parameters

#: Key path of each form of the ratios.
KEYS = ("damping.ratio", "damping.ratios")
#: Full matrices at a time in :meth:`NodalDamping.of`: stiffness, as held, mass, vibrations, momenta, and two of the solution.
MATRICES = 7
#: Squared frequencies nearer than this, over themselves, are equal: two vibrations that beat once in 10^5 periods are one to any
#: measurement of ratios, and pairs of a vertical cable differ by less (by rounding, up to 10^-6 for 10^3 elements).
SAME_FREQUENCY = 1e-5


def modal_damping(ratios: Sequence[float], stiffness: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Return the damping matrix C = M Phi diag(2 zeta omega) Phi^T M of small vibrations about rest (n, n).

    Parameters
    ----------
    ratios
        Damping ratios zeta of the first vibrations by rising frequency; the last one is that of all others.  Vibrations of equal
        frequency, which have no order and no shapes of their own, all get the mean of theirs.
    stiffness, mass
        Matrices about rest (n, n); the mass may be diagonal, (n,).  Phi are the vibrations, orthonormal in mass, omega their
        angular frequencies, those of shapes without stiffness 0.
    """
    from scipy.linalg import eigh  # costly to import

    mass = np.diag(mass) if mass.ndim == 1 else mass
    squared, phi = eigh(stiffness, mass)
    zeta = np.full(squared.size, ratios[-1])
    zeta[: len(ratios)] = ratios[: squared.size]
    # rounding of the solver is that of the highest frequency
    apart = np.diff(squared) > SAME_FREQUENCY * squared[1:] + np.finfo(float).eps * squared[-1]
    which = np.concatenate([[0], np.cumsum(apart)])
    zeta = (np.bincount(which, zeta) / np.bincount(which))[which]
    momenta = mass @ phi
    return (momenta * (2.0 * zeta * np.sqrt(np.maximum(squared, 0.0)))) @ momenta.T


class NodalDamping(NamedTuple):
    """Damping by ratios on the free nodes of a cable, which implicit steps solve for by iteration.

    The unknowns are node by node.  In the tangent of a step, zeta / 2 (rate^2 M + K) stands for rate C: as
    2 rate omega <= rate^2 + omega^2, it differs from that by at most itself, so that the iteration converges for any ratio.
    """

    matrix: np.ndarray  #: C (unknowns, unknowns) [kg/s]; without entries: no damping by ratios
    sigma: np.ndarray  #: relative arc lengths of all nodes (N,)
    stiffness: np.ndarray  #: zeta / 2 times the tangent stiffness at rest, as the model holds it [N/m]
    half_ratio: float  #: zeta / 2 of the largest ratio

    @classmethod
    def none(cls) -> NodalDamping:
        """Return no damping."""
        return cls(np.empty((0, 0)), np.empty(0), np.empty((0, 0)), 0.0)

    @classmethod
    def of(
        cls, p: Parameters, stiffness: np.ndarray, mass: np.ndarray, sigma: np.ndarray, held: np.ndarray
    ) -> NodalDamping:
        """Return the damping by the ratios of a scene.

        Parameters
        ----------
        p
            Parameters with ratios.
        stiffness, mass
            Of the unknowns at rest (unknowns, unknowns) [N/m], (unknowns,) [kg].
        sigma
            Relative arc lengths of all nodes (N,).
        held
            The stiffness as the model holds it.
        """
        ratios = p.damping_ratios or (0.0,)
        half = 0.5 * max(ratios)
        return cls(modal_damping(ratios, stiffness, mass), sigma, half * held, half)

    def forces(self, rates: np.ndarray, first: int) -> np.ndarray:
        """Return the damping forces (N, dims) [N] for velocities of all nodes (N, dims) [m/s]."""
        from cablepod.discretisation import _kernels_modal_damping as kernel  # numba is imported only to compute

        forces = np.zeros(rates.shape[::-1])
        kernel.damping_forces(self, np.ascontiguousarray(rates.T), first, np.empty(rates.size), forces)
        return forces.T


def check_count(p: Parameters, key: str, count: int) -> None:
    """Refuse damping by ratios of more links or points than its full matrices have memory for.

    Raises
    ------
    SceneError
        Names the key of their number, and the largest one.
    """
    if p.damping_ratios is None:
        return
    most = int((0.5 * memory() / (8.0 * MATRICES)) ** 0.5 / p.dims)
    if count > most:
        name = KEYS[p.has_list_of_ratios]
        allowed = f"at most {most} with {name}, whose full matrices take half of this machine's memory then"
        raise scene_error(key, count, f"{allowed}; try: damping.mass_proportional")


def refuse_damping_ratios(p: Parameters, remedy: str) -> None:
    """Refuse damping by ratios in a model that lacks it.

    Raises
    ------
    SceneError
        The message names the key.
    """
    if p.damping_ratios is not None:
        raise ratios_error(p, f"none; try: {remedy}")


def implicit_scheme(p: Parameters, scheme: str | None, implicit: Sequence[str]) -> str | None:
    """Return the scheme of a chain or cable, with damping by ratios the first implicit one by default.

    Raises
    ------
    SceneError
        For an explicit scheme with damping by ratios, or a free end.
    """
    if p.damping_ratios is None:
        return scheme
    if p.free_end is not None:
        raise ratios_error(p, "none with ends.free, without a line between held ends; try: damping.mass_proportional")
    if scheme is not None and scheme not in implicit:
        names = " or ".join(f'"{name}"' for name in implicit)
        raise ratios_error(p, f'none with scheme "{scheme}"; try: scheme {names}')
    return scheme or implicit[0]


def ratios_error(p: Parameters, allowed: str) -> SceneError:
    """Return the error of a scene whose damping by ratios is not allowed."""
    ratios = list(p.damping_ratios or ())
    is_list = p.has_list_of_ratios
    return scene_error(KEYS[is_list], ratios if is_list else ratios[0], allowed)
