"""Parts of the decomposition with answers of their own: routes, sums of rows, blocks of files, and the frame of the chord."""

from __future__ import annotations

import threading

import numpy as np
import pytest
import xarray as xr
from mpmath import matrix, mp
from spectra import STEEP, known_rows, made_up, sines, trajectory
from threadpoolctl import threadpool_info

import cablepod as cp
from cablepod.batch._blas import one_blas_thread
from cablepod.discretisation._chord_frame import ChordFrame, stretch_to_close
from cablepod.pod import _blocks as pod_blocks
from cablepod.pod import _graded_svd as graded_svd
from cablepod.pod import _incremental as incremental
from cablepod.pod import _stream as pod_stream
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


def test_a_matrix_that_does_not_fit_is_refused_before_it_is_formed(monkeypatch):
    monkeypatch.setattr(svd_methods, "memory_needed", lambda *_: 1e15)
    with pytest.raises(ValueError, match=r"method: given 'snapshots' for 10 by 30 values, 1e\+06 GB; allowed: half"):
        cp.pod.decompose(made_up(), method="snapshots")


def test_the_memory_of_each_route():
    assert svd_methods.memory_needed(80, 12500, "snapshots") > 3 * 8 * 12500**2
    assert svd_methods.memory_needed(80, 12500, "covariance") < 1e8
    assert svd_methods.memory_needed(80, 12500, "svd") < 1e8


def accumulated(rows, *, parts=1, block=500, center=True):
    """Sums of rows that came in blocks and were merged from parts."""
    sums = [incremental.IncrementalSVD(rows.shape[1], center=center) for _ in range(parts)]
    for own, part in zip(sums, np.array_split(rows, parts), strict=True):
        for begin in range(0, len(part), block):
            own.add(part[begin : begin + block].copy())
    for other in sums[1:]:
        sums[0].merge(other)
    return sums[0]


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
    energy = np.sum(found.values**2) + found.discarded**2
    assert energy == pytest.approx(np.sum(spectrum**2), rel=1e-10)
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


def test_an_archive_is_read_once_and_in_small_pieces(tmp_path, monkeypatch):
    snapshots, left = trajectory(samples=20000)
    path = cp.archive.write(snapshots, tmp_path / "it.nc")
    monkeypatch.setattr(pod_blocks, "BLOCK_BYTES", 1 << 20)
    read, sizes = pod_blocks._read_range, []

    def counted(source, region):
        found = read(source, region)
        sizes.append(found[0].nbytes)
        return found

    monkeypatch.setattr(pod_blocks, "_read_range", counted)
    for chunks in ({}, -1, {"time": 2 * (2**20 // (22 * 2 * 8))}):
        sizes.clear()
        with cp.archive.read(path, chunks=chunks) as lazy:
            modes = cp.pod.decompose(lazy, rank=20, layout="vector")
        np.testing.assert_allclose(modes.singular_value, STEEP, rtol=1e-10)
        assert sines(modes, left).max() < 1e-8
        assert sum(sizes) == snapshots.position.nbytes
        assert max(sizes) <= 1 << 20
    # members so long that one is more than a piece
    long = xr.concat([snapshots, 2.0 * snapshots], "member", data_vars="all", combine_attrs="override")
    long.to_netcdf(tmp_path / "long.nc", encoding={"position": {"chunksizes": (1, 1000, 22, 2)}})
    sizes.clear()
    with xr.open_dataset(tmp_path / "long.nc", chunks=-1) as lazy:
        modes = cp.pod.decompose(lazy, rank=20, layout="vector")
    np.testing.assert_allclose(modes.singular_value, np.sqrt(5.0) * STEEP, rtol=1e-10)
    assert sum(sizes) == long.position.nbytes
    assert max(sizes) <= 1 << 20
    with cp.archive.read(path, chunks={}) as lazy:
        parts = xr.concat([lazy.isel(time=slice(0, 9000)), lazy.isel(time=slice(9000, None))], "time")
        np.testing.assert_allclose(cp.pod.decompose(2.0 * parts, rank=5, layout="vector").singular_value, 2 * STEEP[:5])


def test_two_threads_share_long_lazy_data_and_give_the_same_bits(monkeypatch):
    snapshots, _ = trajectory(samples=20000)
    lazy = snapshots.chunk({"time": 3000})
    counted_in, seen = pod_stream._add_block, []

    def counted(sums, block, how):
        seen.append((threading.current_thread().name, len(block)))
        counted_in(sums, block, how)

    monkeypatch.setattr(pod_stream, "_add_block", counted)
    one, other = (cp.pod.decompose(lazy, rank=12, layout="vector") for _ in range(2))
    xr.testing.assert_identical(one.drop_attrs(deep=False), other.drop_attrs(deep=False))
    assert all(name.startswith("cablepod") for name, _ in seen)
    assert sum(size for _, size in seen) == 40000
    broken = lazy.where((lazy.time != 1500.0) | (lazy.particle != 5))
    with pytest.raises(cp.SceneError, match="not finite"):
        cp.pod.decompose(broken)


def test_blas_threads_come_back():
    def threads():
        return [item["num_threads"] for item in threadpool_info() if item["user_api"] == "blas"]

    with one_blas_thread():
        pass  # loads what it looks at
    before = threads()
    inside = []

    def hold():
        with one_blas_thread():
            inside.append(threads())

    with one_blas_thread():
        other = threading.Thread(target=hold)
        other.start()
        other.join()
        inside.append(threads())
    assert all(set(item) == {1} for item in inside)
    assert threads() == before


@pytest.mark.parametrize("dims", [2, 3])
def test_a_frame_is_orthonormal_right_handed_and_its_rates_are_derivatives(dims):
    rng = np.random.default_rng(2)
    reach, speed = np.array([4.0, 3.0, 2.0])[:dims] + rng.normal(size=(6, dims)), rng.normal(size=(6, dims))
    frame = ChordFrame.of(reach)
    axes = np.concatenate([frame.along[:, None], frame.normals], axis=1)
    np.testing.assert_allclose(
        axes @ axes.transpose(0, 2, 1), np.broadcast_to(np.eye(dims), (6, dims, dims)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(axes), 1.0, rtol=1e-14)
    rates = frame.rates(reach, speed)
    h = 1e-5
    before, after = ChordFrame.of(reach - h * speed), ChordFrame.of(reach + h * speed)
    for rate, a, b in zip(
        rates, (before.chord, before.along, before.normals), (after.chord, after.along, after.normals), strict=True
    ):
        # central differences: h^2 of third derivatives, and rounding of 1e-16 / h
        np.testing.assert_allclose(rate, (b - a) / (2 * h), atol=1e-8)


def test_a_vertical_chord_takes_another_axis_and_ends_must_not_meet():
    frame = ChordFrame.of(np.array([[0.0, 5.0, 0.0], [0.1, 5.0, 0.0]]))
    np.testing.assert_array_equal(frame.reference, [1.0, 0.0, 0.0])
    assert np.isfinite(frame.normals).all()
    with pytest.raises(cp.SceneError, match=r"^ends: they meet at some instant; allowed: a distance"):
        ChordFrame.of(np.array([[1.0, 0.0], [0.0, 0.0]]))
    with pytest.raises(
        cp.SceneError, match=r"^motion: the chord turns into the direction \[1.0, 0.0, 0.0\], which its normals"
    ):
        ChordFrame.of(np.array([[0.0, 5.0, 0.0], [5.0, 0.0, 0.0]]))


def test_links_stretched_alike_reach_from_end_to_end_though_one_is_steep():
    rng = np.random.default_rng(4)
    length, slopes = rng.uniform(0.5, 1.5, size=20), rng.uniform(0.0, 0.1, size=(50, 20))
    slopes[:, 3] = 0.9
    stretch = rng.uniform(0.9, 8.0, size=50)
    slopes, chord = slopes * stretch[:, None] ** 2, stretch * length.sum()
    z = stretch_to_close(slopes, length, chord)
    np.testing.assert_allclose(z @ length, chord, rtol=1e-13)
    xi = np.sqrt(z**2 + slopes)
    np.testing.assert_allclose(xi, np.broadcast_to(xi[:, :1], xi.shape), rtol=1e-12)
