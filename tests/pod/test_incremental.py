"""Incremental decomposition: spectra known exactly, whatever order and pieces the rows come in."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import matrix, mp
from spectra import STEEP, accumulated, known_rows

from cablepod.batch._blas import one_blas_thread
from cablepod.pod import _graded_svd as graded_svd
from cablepod.pod import _incremental as incremental
from cablepod.pod import _svd_methods as svd_methods


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("kind", ["random", "waves", "turns"])
def test_small_singular_values_keep_their_digits_in_any_order(kind, parts):
    rows, left = known_rows(8000, 40, STEEP, kind)
    found = accumulated(rows, parts=parts).decompose()
    # the matrix itself is rounded, to 2^-53 of an entry, of which some 1e-18 of the norm is along a mode of 1e-8
    np.testing.assert_allclose(found.values[:20], STEEP, rtol=2e-10)
    exact = left * np.sum(left * found.left[:, :20], axis=0)
    assert np.linalg.norm(found.left[:, :20] - exact, axis=0).max() < 1e-8
    np.testing.assert_allclose(found.left.T @ found.left, np.eye(40), atol=1e-14)


def test_without_turned_axes_they_would_not(monkeypatch):
    monkeypatch.setattr(incremental, "is_well_conditioned", lambda gram: True)
    found = accumulated(known_rows(8000, 40, STEEP, "turns")[0]).decompose()
    assert np.abs(found.values[:20] / STEEP - 1.0).max() > 1e-6


def test_turned_sums_keep_the_digits_of_small_columns():
    rng = np.random.default_rng(5)
    axes, turn = (np.linalg.qr(rng.normal(size=(12, 12)))[0] for _ in range(2))
    axes = axes + 1e-15 * rng.normal(size=(12, 12))  # orthonormal only to rounding
    other = axes @ turn
    factor = np.geomspace(1.0, 1e-9, 12)[:, None] * turn.T
    with mp.workdps(50):
        exact = matrix(factor.tolist()) * matrix(axes.tolist()) ** -1 * matrix(other.tolist())
        exact = np.array(exact.tolist(), dtype=float)

    def worst(found):
        return (np.linalg.norm(found - exact, axis=0) / np.linalg.norm(exact, axis=0)).max()

    assert worst(graded_svd.change_basis(factor, axes, other)) < 1e-15
    assert worst(factor @ (axes.T @ other)) > 1e-9  # a plain product loses 2^-53 of the largest column


def test_a_product_in_twice_the_precision():
    rng = np.random.default_rng(3)
    left, right = rng.normal(size=(6, 30)) * np.geomspace(1, 1e-9, 30), rng.normal(size=(30, 5))
    high, low = graded_svd.accurate_product(left, right)
    with mp.workdps(50):
        exact = matrix(left.tolist()) * matrix(right.tolist())
        worst = max(abs(exact[i, j] - mp.mpf(high[i, j]) - mp.mpf(low[i, j])) for i in range(6) for j in range(5))
    assert worst < 1e-22  # 2^-76 of entries of about 10
    assert np.abs(left @ right - high).max() > 1e-17  # the plain product is not as good


def test_a_mean_far_larger_than_the_motion_is_taken_off():
    spectrum = np.geomspace(1.0, 1e-5, 12)
    rows, _ = known_rows(6000, 30, spectrum, "waves")
    mean = np.random.default_rng(4).normal(size=30)  # some 80 times the largest entry of a row
    sums = accumulated(rows + mean, parts=2)
    # rows are rounded to 2^-53 of the mean: 1e-16 / (1e-5 / sqrt(6000)) of the weakest in each entry, averaged over 6000
    np.testing.assert_allclose(sums.decompose().values[:12], spectrum, rtol=1e-10)
    np.testing.assert_allclose(sums.mean(), mean, atol=1e-15 * 4)
    raw = accumulated(rows + mean, center=False).decompose()
    assert raw.values[0] == pytest.approx(np.linalg.norm(mean) * np.sqrt(6000), rel=1e-3)


@pytest.mark.parametrize("kind", ["random", "turns"])
def test_many_features_are_held_by_the_axes_they_need(kind):
    rows, left = known_rows(1200, 800, STEEP, kind)
    sums = accumulated(rows, parts=2, block=64)
    found = sums.decompose()
    assert found.left.shape[1] < 60
    np.testing.assert_allclose(found.values[:20], STEEP, rtol=1e-9)  # few rows: less averages out than in a long run
    assert found.discarded < 1e-13
    exact = left * np.sum(left * found.left[:, :20], axis=0)
    assert np.linalg.norm(found.left[:, :20] - exact, axis=0).max() < 1e-8


def test_what_is_left_out_of_many_features_is_told(monkeypatch):
    monkeypatch.setattr(incremental, "MAX_AXES", 60)
    monkeypatch.setattr(incremental, "KEPT_AXES", 40)
    spectrum = 1.0 / np.arange(1, 201)
    with one_blas_thread():
        found = accumulated(known_rows(900, 600, spectrum)[0], block=50).decompose()
    error = np.abs(found.values[:20] - spectrum[:20])
    unsure = svd_methods.uncertainty(found.values, (600, 900), "blocks", discarded=found.discarded)[:20]
    assert found.energy == pytest.approx(np.sum(spectrum**2), rel=1e-10)
    assert np.all(error <= unsure)  # a bound, which what is left out reaches only where it lies along the modes
    assert 1e-6 < error.max() < 1e-3


@pytest.mark.parametrize("size", [1e-220, 1e-30, 1.0, 1e30, 1e220])
def test_any_size(size):
    rows, _ = known_rows(2000, 20, np.geomspace(1.0, 1e-6, 10))
    found = accumulated(rows * size, parts=2).decompose()
    np.testing.assert_allclose(found.values[:10] / size, np.geomspace(1.0, 1e-6, 10), rtol=1e-9)


def test_small_then_large_and_nothing_then_something():
    rows, _ = known_rows(3000, 20, np.geomspace(1.0, 1e-6, 10))
    sums = accumulated(np.vstack([np.zeros((500, 20)), rows * 1e-220, rows * 1e200]), center=False)
    np.testing.assert_allclose(sums.decompose().values[:10] / 1e200, np.geomspace(1.0, 1e-6, 10), rtol=1e-9)
    nothing = accumulated(np.zeros((100, 20))).decompose()
    assert not nothing.values.any()
    np.testing.assert_allclose(nothing.left.T @ nothing.left, np.eye(20), atol=1e-15)


@pytest.mark.parametrize("kind", ["random", "waves", "turns"])
def test_the_uncertainty_covers_the_errors(kind):
    rows, left = known_rows(8000, 40, STEEP, kind, seed=2)
    found = accumulated(rows).decompose()
    unsure = svd_methods.uncertainty(found.values, (40, 8000), "blocks")
    assert np.all(np.abs(found.values[:20] - STEEP) <= unsure[:20])
    angle = svd_methods.mode_angles(found.values[None], unsure[None])[0, :20]
    assert np.all(
        np.linalg.norm(found.left[:, :20] - left * np.sum(left * found.left[:, :20], axis=0), axis=0) <= angle
    )
    assert unsure[19] < 1e-7 * STEEP[19]  # and is not idle
