"""The three routes to the modes: against a spectrum known exactly, what each loses, and rank-deficient data."""

from __future__ import annotations

import numpy as np
import pytest
from spectra import made_up

import cablepod as cp
from cablepod.pod import _svd_methods as svd_methods

SHAPES = [(12, 40), (40, 12), (20, 20), (78, 125)]


def known(features, samples, spectrum, seed=0):
    """A matrix of given singular values, and its left singular vectors."""
    rng = np.random.default_rng(seed)
    left = np.linalg.qr(rng.normal(size=(features, spectrum.size)))[0]
    right = np.linalg.qr(rng.normal(size=(samples, spectrum.size)))[0]
    return (left * spectrum) @ right.T, left


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("method", svd_methods.ROUTES)
def test_a_gentle_spectrum_is_found_by_all(method, shape):
    spectrum = 3.0 * 0.5 ** np.arange(min(shape))[:12]
    data, true = known(*shape, spectrum)
    left, values = svd_methods.ROUTES[method](data)
    assert left.shape == (shape[0], min(shape))
    # squares of values 2^11 apart keep 2^-52 * 2^22 of the smallest
    np.testing.assert_allclose(values[:12], spectrum, rtol=0 if method == "svd" else 1e-8, atol=1e-14)
    cosine = np.abs(np.sum(left[:, :12] * true, axis=0))
    np.testing.assert_allclose(cosine, 1.0, atol=1e-12)
    np.testing.assert_allclose(left.T @ left, np.eye(min(shape)), atol=1e-13)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("method", svd_methods.ROUTES)
def test_the_uncertainty_covers_the_error_and_is_not_idle(method, shape):
    spectrum = np.geomspace(1.0, 1e-13, min(shape))
    data, _ = known(*shape, spectrum)
    _, values = svd_methods.ROUTES[method](data)
    error = np.abs(values - spectrum)
    unsure = svd_methods.uncertainty(values, shape, method)
    assert np.all(error <= unsure)
    # an envelope of what rounding may do lies above what it does here, but not by more than three orders
    assert error.max() > 0.001 * unsure.max()


@pytest.mark.parametrize("method", ["covariance", "snapshots"])
def test_squaring_loses_what_the_svd_keeps(method):
    spectrum = np.geomspace(1.0, 1e-12, 13)
    data, _ = known(40, 30, spectrum)
    np.testing.assert_allclose(svd_methods.by_svd(data)[1][:13], spectrum, rtol=1e-2)
    off = np.abs(svd_methods.ROUTES[method](data)[1][:13] / spectrum - 1.0)
    assert off[:7].max() < 0.01
    assert off[9:].min() > 0.5


@pytest.mark.parametrize("method", svd_methods.ROUTES)
@pytest.mark.parametrize("data", [np.zeros((5, 8)), np.outer(np.arange(5.0), np.ones(8)), np.zeros((8, 5))])
def test_data_without_full_rank_still_give_orthonormal_modes(method, data):
    left, values = svd_methods.ROUTES[method](data)
    np.testing.assert_allclose(left.T @ left, np.eye(5), atol=1e-14)
    assert np.all(np.diff(values) <= 0)
    assert values[0] == pytest.approx(np.linalg.norm(data), rel=1e-14)
    # the root of the rounding of a square
    assert np.all(values[1:] <= 1e-7 * max(values[0], 1e-300))


@pytest.mark.parametrize("weights", [None, "length"])
@pytest.mark.parametrize("layout", ["separate", "vector"])
@pytest.mark.parametrize("method", ["covariance", "snapshots"])
def test_all_routes_give_the_same_modes(method, layout, weights):
    snapshots = made_up(samples=25, particles=14, spectrum=2.0 ** -np.arange(12))
    options = {"layout": layout, "weights": weights, "rank": 6}
    one, other = cp.pod.decompose(snapshots, **options), cp.pod.decompose(snapshots, method=method, **options)
    assert other.attrs["method"] == method
    for name in ("mode_shape", "singular_value", "energy_share", "singular_value_share"):
        # values up to 2^-12 of the first are summed in the shares
        np.testing.assert_allclose(other[name], one[name], rtol=1e-7, atol=1e-9)
    assert one.attrs["id"] != other.attrs["id"]


def test_a_matrix_that_does_not_fit_is_refused_before_it_is_formed(monkeypatch):
    monkeypatch.setattr(svd_methods, "memory_needed", lambda *_: 1e15)
    with pytest.raises(ValueError, match=r"method: given 'snapshots' for 10 by 30 values, 1e\+06 GB; allowed: half"):
        cp.pod.decompose(made_up(), method="snapshots")


def test_the_memory_of_each_route():
    assert svd_methods.memory_needed(80, 12500, "snapshots") > 3 * 8 * 12500**2
    assert svd_methods.memory_needed(80, 12500, "covariance") < 1e8
    assert svd_methods.memory_needed(80, 12500, "svd") < 1e8
