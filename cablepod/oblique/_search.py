"""Bases in which test functions are searched for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cablepod.condensed._model import CondensedModel

#: Each test function is a sum of so many vibration modes for every mode of the model, and of some more.
WIDTH, MORE = 2, 4


def vibrations(model: CondensedModel) -> np.ndarray:
    """Vibration modes (mode, particle) of the cable, taut and straight as at rest, mass-orthonormal, by rising frequency."""
    from scipy.linalg import eigh  # costly to import

    chain, loads = model.chain, model.static_boundary_data[1 : 1 + len(model.chordwise_force_patterns)]
    tension = np.maximum(
        model.rest_tension + loads @ (model.chordwise_force_patterns - model.mean_chordwise_forces[:, None]),
        0.1 * model.rest_tension,
    )
    slope = np.diff(np.eye(chain.links + 1), axis=0) / chain.length[:, None]
    stiffness = (slope.T * (chain.length * tension)) @ slope
    vectors = eigh(stiffness[1:-1, 1:-1], np.diag(model.mass[1:-1]))[1]
    return np.pad(vectors.T, ((0, 0), (1, 1)))


@dataclass(frozen=True)
class TestFunctionBasis:
    """Test functions by numbers: some to begin with, and sums of vibration modes that these do not stand for."""

    first: tuple[np.ndarray, ...]  #: of each set (mode, particle)
    free: tuple[np.ndarray, ...]  #: what is added to each (more, particle)

    @property
    def count(self) -> int:
        """How many numbers there are."""
        return sum(len(psi) * len(part) for psi, part in zip(self.first, self.free, strict=True))

    def tests(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Test functions (mode, particle) of each set; 0 are the first."""
        result, at = [], 0
        for psi, part in zip(self.first, self.free, strict=True):
            size = len(psi) * len(part)
            result.append(psi + x[at : at + size].reshape(len(psi), -1) @ part if size else psi)
            at += size
        return tuple(result)


def test_function_bases(model: CondensedModel) -> tuple[TestFunctionBasis, TestFunctionBasis]:
    """Where to begin: from the modes themselves, and from as many vibration modes, those that tell the modes apart best.

    These feel no force of the others as long as the tension is that at rest.
    """
    from scipy.linalg import qr  # costly to import

    base = vibrations(model)
    taken, free = [], []
    for psi in model.modes:
        width = min(WIDTH * len(psi) + MORE, len(base)) if len(psi) else 0
        order = qr((psi * model.mass) @ base[:width].T, mode="r", pivoting=True)[1] if width else []
        size = math.sqrt(np.mean(((psi * model.mass) * psi).sum(axis=1))) if width else 1.0
        # to add these to test functions, in whatever size, changes nothing: the model knows only what they span
        taken.append(size * base[sorted(order[: len(psi)])])
        free.append(size * base[sorted(order[len(psi) :])])
    return TestFunctionBasis(model.modes, tuple(free)), TestFunctionBasis(tuple(taken), tuple(free))
