"""Search space of test functions: their ansatz in vibration modes, whose coefficients the training optimises."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cablepod.condensed._model import CondensedModel

#: Number of vibration modes in the ansatz: this many per mode of the model, plus this many.
PER_MODE, ADDITIONAL = 2, 4
#: Minimum chordwise force as a fraction of its mean at rest, for the vibration modes.
MIN_FORCE_RATIO = 0.1


def vibrations(model: CondensedModel) -> np.ndarray:
    """Return the vibration modes (mode, particle) [kg^-1/2] of the taut, straight cable at rest, by rising frequency."""
    from scipy.linalg import eigh  # costly to import

    chain, loads = model.chain, model.static_boundary_data[1 : 1 + len(model.chordwise_force_patterns)]
    tension = np.maximum(
        model.rest_tension + loads @ (model.chordwise_force_patterns - model.mean_chordwise_forces[:, None]),
        MIN_FORCE_RATIO * model.rest_tension,
    )
    slope = np.diff(np.eye(chain.links + 1), axis=0) / chain.length[:, None]
    stiffness = (slope.T * (chain.length * tension)) @ slope
    vectors = eigh(stiffness[1:-1, 1:-1], np.diag(model.mass[1:-1]))[1]
    return np.pad(vectors.T, ((0, 0), (1, 1)))


@dataclass(frozen=True)
class TestFunctionBasis:
    """Ansatz of test functions: initial ones plus linear combinations of the remaining vibration modes."""

    initial: tuple[np.ndarray, ...]  #: initial test functions of each set (mode, particle)
    added: tuple[np.ndarray, ...]  #: vibration modes added to each of them (additional, particle)

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return sum(len(psi) * len(chi) for psi, chi in zip(self.initial, self.added, strict=True))

    def test_functions(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the test functions of each set (mode, particle) for coefficients x (count,); the initial ones for x = 0."""
        result, begin = [], 0
        for psi, chi in zip(self.initial, self.added, strict=True):
            size = len(psi) * len(chi)
            result.append(psi + x[begin : begin + size].reshape(len(psi), -1) @ chi if size else psi)
            begin += size
        return tuple(result)


def test_function_bases(model: CondensedModel) -> tuple[TestFunctionBasis, TestFunctionBasis]:
    """Return two ansatzes, which start from the modes and from the vibration modes that best separate the modes.

    Vibration modes are orthogonal to the forces of the truncated ones as long as the tension is that at rest.
    """
    from scipy.linalg import qr  # costly to import

    base = vibrations(model)
    selected, added = [], []
    for psi in model.modes:
        n_candidates = min(PER_MODE * len(psi) + ADDITIONAL, len(base)) if len(psi) else 0
        order = qr((psi * model.mass) @ base[:n_candidates].T, mode="r", pivoting=True)[1] if n_candidates else []
        scale = math.sqrt(np.mean(((psi * model.mass) * psi).sum(axis=1))) if n_candidates else 1.0
        # the selected ones are not among those added: the model depends only on the span of the test functions
        selected.append(scale * base[sorted(order[: len(psi)])])
        added.append(scale * base[sorted(order[len(psi) :])])
    return TestFunctionBasis(model.modes, tuple(added)), TestFunctionBasis(tuple(selected), tuple(added))
