"""Gauss-Lobatto-Legendre (GLL) rule: nodes, weights, derivatives, interpolation, integrals."""

from __future__ import annotations

import functools

import numpy as np


@functools.cache
def gll_rule(order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return GLL nodes, weights and differentiation matrix (rows: nodes) on [-1, 1]."""
    from numpy.polynomial import legendre

    coefficients = np.zeros(order + 1)
    coefficients[-1] = 1.0
    slope = legendre.legder(coefficients)
    node = np.concatenate([[-1.0], np.sort(legendre.legroots(slope).real), [1.0]])
    for _ in range(3):  # legroots is not accurate to the last digit
        node[1:-1] -= legendre.legval(node[1:-1], slope) / legendre.legval(node[1:-1], legendre.legder(slope))
    node = 0.5 * (node - node[::-1])
    value = legendre.legval(node, coefficients)
    weight = 2.0 / (order * (order + 1) * value**2)
    gap = node[:, None] - node + np.eye(order + 1)
    derivative = value[:, None] / value / gap
    np.fill_diagonal(derivative, 0.0)
    np.fill_diagonal(derivative, -derivative.sum(axis=1))  # a rigid motion then has no force, to rounding
    for array in (node, weight, derivative):
        array.setflags(write=False)
    return node, weight, derivative


def lagrange_basis(order: int, place: np.ndarray) -> np.ndarray:
    """Return the Lagrange polynomials of the nodes (columns) at places in [-1, 1] (rows)."""
    node, _, _ = gll_rule(order)
    gap = place[:, None] - node
    at_node = np.abs(gap) < 1e-14
    barycentric = 1.0 / np.prod(node[:, None] - node + np.eye(order + 1), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = barycentric / gap
        values = terms / terms.sum(axis=1, keepdims=True)
    rows = at_node.any(axis=1)
    values[rows] = at_node[rows]
    return values


def integration_matrix(order: int) -> np.ndarray:
    """Return the matrix from values at the nodes to integrals from the first node to each one (rows), on [-1, 1]."""
    from numpy.polynomial import legendre

    node, _, _ = gll_rule(order)
    values = legendre.legvander(node, order + 1)
    # the integral of P(k) is (P(k + 1) - P(k - 1)) / (2 k + 1), which is 0 at the first node for k > 0
    integrals = np.empty((order + 1, order + 1))
    integrals[:, 0] = node + 1.0
    degree = np.arange(1, order + 1)
    integrals[:, 1:] = (values[:, 2:] - values[:, :-2]) / (2.0 * degree + 1.0)
    return np.linalg.solve(values[:, :-1].T, integrals.T).T
