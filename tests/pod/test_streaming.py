"""Snapshots seen once: exactly known spectra, whatever order and pieces they come in, lazy data, streams, and dask's default."""

from __future__ import annotations

import pickle
import threading

import dask
import dask.array as da
import numpy as np
import pytest
import xarray as xr
from mpmath import matrix, mp
from spectra import STEEP, accumulated, known_rows, sines, trajectory, turning

import cablepod as cp
from cablepod import decompositions, lineage, streaming
from cablepod import snapshots as reading
from cablepod.chord import Frame
from cablepod.threads import one_blas_thread


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("kind", ["random", "waves", "turns"])
def test_small_singular_values_keep_their_digits_in_any_order(kind, parts):
    rows, left = known_rows(8000, 40, STEEP, kind)
    found = accumulated(rows, parts=parts).decomposed()
    # the matrix itself is rounded, to 2^-53 of an entry, of which some 1e-18 of the norm is along a mode of 1e-8
    np.testing.assert_allclose(found.values[:20], STEEP, rtol=2e-10)
    exact = left * np.sum(left * found.left[:, :20], axis=0)
    assert np.linalg.norm(found.left[:, :20] - exact, axis=0).max() < 1e-8
    np.testing.assert_allclose(found.left.T @ found.left, np.eye(40), atol=1e-14)


def test_without_turned_axes_they_would_not(monkeypatch):
    monkeypatch.setattr(streaming, "straight", lambda gram: True)
    found = accumulated(known_rows(8000, 40, STEEP, "turns")[0]).decomposed()
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

    assert worst(streaming.turned_factor(factor, axes, other)) < 1e-15
    assert worst(factor @ (axes.T @ other)) > 1e-9  # a plain product loses 2^-53 of the largest column


def test_a_product_in_twice_the_precision():
    rng = np.random.default_rng(3)
    left, right = rng.normal(size=(6, 30)) * np.geomspace(1, 1e-9, 30), rng.normal(size=(30, 5))
    high, low = streaming.accurate_product(left, right)
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
    np.testing.assert_allclose(sums.decomposed().values[:12], spectrum, rtol=1e-10)
    np.testing.assert_allclose(sums.mean(), mean, atol=1e-15 * 4)
    raw = accumulated(rows + mean, center=False).decomposed()
    assert raw.values[0] == pytest.approx(np.linalg.norm(mean) * np.sqrt(6000), rel=1e-3)


@pytest.mark.parametrize("kind", ["random", "turns"])
def test_many_features_are_held_by_the_axes_they_need(kind):
    rows, left = known_rows(1200, 800, STEEP, kind)
    sums = accumulated(rows, parts=2, block=64)
    found = sums.decomposed()
    assert found.left.shape[1] < 60
    np.testing.assert_allclose(found.values[:20], STEEP, rtol=1e-9)  # few rows: less averages out than in a long run
    assert found.lost < 1e-13
    exact = left * np.sum(left * found.left[:, :20], axis=0)
    assert np.linalg.norm(found.left[:, :20] - exact, axis=0).max() < 1e-8


def test_what_is_left_out_of_many_features_is_told(monkeypatch):
    monkeypatch.setattr(streaming, "MOST", 60)
    monkeypatch.setattr(streaming, "KEPT", 40)
    spectrum = 1.0 / np.arange(1, 201)
    with one_blas_thread():
        found = accumulated(known_rows(900, 600, spectrum)[0], block=50).decomposed()
    error = np.abs(found.values[:20] - spectrum[:20])
    unsure = decompositions.uncertainty(found.values, (600, 900), "blocks", lost=found.lost)[:20]
    assert found.energy == pytest.approx(np.sum(spectrum**2), rel=1e-10)
    assert np.all(error <= unsure)  # a bound, which what is left out reaches only where it lies along the modes
    assert 1e-6 < error.max() < 1e-3


@pytest.mark.parametrize("size", [1e-220, 1e-30, 1.0, 1e30, 1e220])
def test_any_size(size):
    rows, _ = known_rows(2000, 20, np.geomspace(1.0, 1e-6, 10))
    found = accumulated(rows * size, parts=2).decomposed()
    np.testing.assert_allclose(found.values[:10] / size, np.geomspace(1.0, 1e-6, 10), rtol=1e-9)


def test_small_then_large_and_nothing_then_something():
    rows, _ = known_rows(3000, 20, np.geomspace(1.0, 1e-6, 10))
    sums = accumulated(np.vstack([np.zeros((500, 20)), rows * 1e-220, rows * 1e200]), center=False)
    np.testing.assert_allclose(sums.decomposed().values[:10] / 1e200, np.geomspace(1.0, 1e-6, 10), rtol=1e-9)
    nothing = accumulated(np.zeros((100, 20))).decomposed()
    assert not nothing.values.any()
    np.testing.assert_allclose(nothing.left.T @ nothing.left, np.eye(20), atol=1e-15)


@pytest.mark.parametrize("kind", ["random", "waves", "turns"])
def test_the_uncertainty_covers_the_errors(kind):
    rows, left = known_rows(8000, 40, STEEP, kind, seed=2)
    found = accumulated(rows).decomposed()
    unsure = decompositions.uncertainty(found.values, (40, 8000), "blocks")
    assert np.all(np.abs(found.values[:20] - STEEP) <= unsure[:20])
    angle = decompositions.mode_angles(found.values[None], unsure[None])[0, :20]
    assert np.all(
        np.linalg.norm(found.left[:, :20] - left * np.sum(left * found.left[:, :20], axis=0), axis=0) <= angle
    )
    assert unsure[19] < 1e-7 * STEEP[19]  # and is not idle


# through the public functions


@pytest.mark.parametrize("weights", [None, "length"])
@pytest.mark.parametrize("layout", ["separate", "vector"])
def test_memory_chunks_and_streams_give_the_same(layout, weights):
    snapshots, _ = trajectory(spectrum=np.geomspace(1.0, 1e-6, 12))
    snapshots = snapshots.assign_coords(arc_length=("particle", 50.0 * np.linspace(0.0, 1.0, 22) ** 1.3))
    options = {"layout": layout, "weights": weights}
    # through LAPACK's singular value decomposition of one matrix: beyond its rank the modes are any
    few = cp.pod.decompose(snapshots.isel(time=slice(0, 900)), rank=8, **options)
    assert "gesdd" in few.attrs["algorithm"]
    cut = cp.pod.decompose(snapshots.isel(time=slice(0, 900)).chunk({"time": 128}), rank=8, **options)
    assert "one pass" in cut.attrs["algorithm"]
    full = cp.pod.decompose(snapshots, rank=8, **options)
    lazy = cp.pod.decompose(
        snapshots.chunk({"time": 700, "particle": 9}).transpose("coordinate", ...), rank=8, **options
    )
    stream = cp.pod.Stream(**options)
    for begin in range(0, 6000, 1000):
        stream.update(snapshots.isel(time=slice(begin, begin + 1000)))
    for one, other in ((few, cut), (full, lazy), (full, stream.modes(rank=8))):
        # LAPACK is right to some 1e-15 of the first, and 1e-6 of it is the last
        np.testing.assert_allclose(one.singular_value, other.singular_value, rtol=1e-8, atol=0)
        np.testing.assert_allclose(one.mode_shape, other.mode_shape, atol=1e-8)
        np.testing.assert_allclose(one["mean"], other["mean"], atol=1e-15)
        np.testing.assert_allclose(one.energy_share, other.energy_share, rtol=1e-8)
    assert full.attrs["id"] == lazy.attrs["id"]
    assert stream.modes(rank=8).attrs["id"] != lazy.attrs["id"]


@pytest.mark.parametrize("dims", [2, 3])
def test_deflections_in_blocks(dims):
    snapshots, spectra, left = turning(dims=dims)
    whole = cp.pod.decompose(snapshots.isel(time=slice(0, 150)), rank=6, layout="normal", weights="length")
    assert "gesdd" in whole.attrs["algorithm"]
    cut = cp.pod.decompose(
        snapshots.isel(time=slice(0, 150)).chunk({"time": 40}), rank=6, layout="normal", weights="length"
    )
    assert set(cut.variables) == set(whole.variables)
    for name in whole.data_vars:  # LAPACK is right to 1e-16 of the positions, over 1e-4 of the sixth mode
        if "uncertainty" not in name and "truncation" not in name:
            np.testing.assert_allclose(cut[name], whole[name], rtol=1e-9, atol=1e-10, err_msg=name)
    streams = [cp.pod.Stream(layout="normal") for _ in range(3)]
    for number, stream in enumerate(streams):
        stream.update(snapshots.isel(time=slice(1000 * number, 1000 * (number + 1))))
    merged = cp.pod.Stream(layout="normal").merge(streams[0]).merge(streams[1]).merge(streams[2])
    lazy = cp.pod.decompose(snapshots.chunk({"time": 700}), rank=8, layout="normal")
    for found in (lazy, cp.pod.decompose(snapshots, rank=8, layout="normal"), merged.modes(rank=8)):
        assert "one pass" in found.attrs["algorithm"]
        assert "mean" not in found
        for suffix, spectrum, exact in zip(("", "_out_of_plane"), spectra, left, strict=False):
            # the rounding of positions of size 8, some 5e-16 along any pair of vectors, is 5e-9 of the smallest
            np.testing.assert_allclose(found[f"singular_value{suffix}"], spectrum[:8], rtol=2e-8)
            shape = found[f"mode_shape{suffix}"].values[:6, 1:-1].T
            off = shape - exact[:, :6] * np.sum(exact[:, :6] * shape, axis=0)
            assert np.linalg.norm(off, axis=0).max() < 1e-8
    assert lazy.attrs["id"] == cp.pod.decompose(snapshots, rank=8, layout="normal").attrs["id"]


def test_streams_of_deflections_keep_the_first_chord_s_axis():
    steep = turning(steep=True)[0].isel(time=slice(0, 1500))
    other = turning()[0]
    stream = cp.pod.Stream(layout="normal").update(steep)
    with pytest.raises(cp.SceneError, match="other: its first chord is so steep"):
        cp.pod.Stream(layout="normal").update(other).merge(stream)
    # later pieces, whose own first chord is far from the vertical, do not begin anew
    late = steep.isel(time=slice(1400, None))
    assert Frame.of(late.position.values[:1, -1] - late.position.values[:1, 0]).reference == 1
    pieces = cp.pod.Stream(layout="normal").update(steep.isel(time=slice(0, 1400))).update(late).modes(rank=6)
    np.testing.assert_allclose(pieces.singular_value, stream.modes(rank=6).singular_value, rtol=1e-9)
    with pytest.raises(cp.SceneError, match="coordinate: given 1"):
        cp.pod.decompose(other.isel(coordinate=[0]).chunk(), layout="normal")
    ends = other.where((other.time < 0.5) | (other.arc_length < 10.0))
    with pytest.raises(cp.SceneError, match="not finite"):
        cp.pod.decompose(ends.assign_coords(arc_length=other.arc_length).chunk(), layout="normal")


def test_mixed_shapes_are_refused_by_name():
    snapshots, _ = trajectory(samples=300)
    long = snapshots.assign_coords(particle=np.arange(22))
    short = snapshots.isel(particle=slice(0, 15)).assign_coords(particle=np.arange(15))
    shifted = snapshots.assign_coords(arc_length=snapshots.arc_length**1.1)
    for parts, match in (
        ([long, short, long, short], r"15 particles in \[1, 3\], 22 particles in \[0, 2\]"),
        ([snapshots, shifted], r"different S / L0.*differ \[1\]"),
        ([snapshots, snapshots, snapshots.isel(coordinate=[0])], r"of other coordinates.*differ \[2\]"),
        ([], "given no trajectory"),
    ):
        with pytest.raises(cp.SceneError, match=match):
            cp.pod.decompose(parts)
    with pytest.raises(cp.SceneError, match="method: given 'covariance'"):
        cp.pod.decompose([snapshots, snapshots], method="covariance")
    # what xarray makes of members of unlike shapes, with gaps
    options = {"join": "outer", "data_vars": "all", "coords": "different", "compat": "equals"}
    joined = xr.concat([short, long, short], "member", **options).assign_coords(member=[4, 5, 6])
    for case in (joined, joined.chunk({"time": 100})):
        with pytest.raises(cp.SceneError, match=r"15 particles in \[4, 6\], 22 particles in \[5\]"):
            cp.pod.decompose(case)
    alike = xr.concat([snapshots] * 3, "member", data_vars="all").assign_coords(member=[4, 5, 6])
    broken = alike.where((alike.member != 5) | (alike.time < 9.0)).assign_coords(arc_length=snapshots.arc_length)
    for case in (broken.isel(time=slice(80, 120)), broken.chunk({"time": 100})):
        with pytest.raises(cp.SceneError, match="not finite everywhere in member 5"):
            cp.pod.decompose(case)
    stream = cp.pod.Stream().update(long)
    with pytest.raises(cp.SceneError, match=r"given 15 particles in members \[7\]"):
        stream.update(short.assign_coords(member=7))


def test_trajectories_of_any_lengths_in_one_decomposition():
    snapshots, _ = trajectory(spectrum=np.geomspace(1.0, 1e-6, 12))
    cuts = [(0, 10), (10, 700), (700, 6000)]
    parts = [snapshots.isel(time=slice(*cut)).assign_attrs(id=f"part {number}") for number, cut in enumerate(cuts)]
    found, whole = (cp.pod.decompose(item, rank=8) for item in (parts, snapshots))
    np.testing.assert_allclose(found.singular_value, whole.singular_value, rtol=1e-9)
    np.testing.assert_allclose(found.mode_shape, whole.mode_shape, atol=1e-8)
    assert [f"part {number}" in found.attrs["history_json"] for number in range(3)] == [True] * 3
    stage = {"id": "it", "function": "pod.decompose", "inputs": ["a", "b"], "parameters": {"rank": 8}}
    assert (
        lineage._statements(stage, {"it": "modes", "a": "one", "b": "two"})[0]
        == "modes = cp.pod.decompose([one, two], rank=8)"
    )


def test_what_does_not_fit_is_refused_before_it_is_read():
    snapshots, _ = trajectory(samples=30)
    huge = da.broadcast_to(da.zeros((1, 22, 2)), (10**10, 22, 2), chunks=(10**8, 22, 2))
    lazy = xr.Dataset({"position": (("time", "particle", "coordinate"), huge)}, snapshots.drop_vars("time").coords)
    with pytest.raises(cp.SceneError, match="method: given 'covariance' for 20 by 10000000000 values"):
        cp.pod.decompose(lazy, method="covariance")


def test_lazy_data_meet_what_is_known():
    snapshots, left = trajectory(samples=20000)
    modes = cp.pod.decompose(snapshots.chunk({"time": 3000}), rank=20, layout="vector")
    np.testing.assert_allclose(modes.singular_value, STEEP, rtol=1e-10)
    assert sines(modes, left).max() < 1e-8
    same = cp.pod.decompose(snapshots, rank=20, layout="vector")
    np.testing.assert_allclose(modes.singular_value, same.singular_value, rtol=1e-10)
    assert float(modes.truncation_error) < 1e-14
    kept = cp.pod.decompose(snapshots, rank=5, layout="vector")
    assert float(kept.truncation_error) == pytest.approx(np.sqrt(np.sum(STEEP[5:] ** 2) / np.sum(STEEP**2)), rel=1e-9)


def test_members_are_pooled_also_in_chunks():
    snapshots, _ = trajectory(samples=3000)
    pieces = [snapshots.isel(time=slice(i, i + 600)).assign_coords(time=np.arange(600.0)) for i in range(0, 3000, 600)]
    members = xr.concat(pieces, "member", data_vars="all")
    for chunks in ({"member": 2}, {"member": 1, "time": 250}, {"time": 7}):
        found = cp.pod.decompose(members.chunk(chunks), rank=10)
        np.testing.assert_allclose(found.singular_value, cp.pod.decompose(snapshots, rank=10).singular_value, rtol=1e-9)
    lengths = np.outer([1.0, 2.0, 1.0, 1.0, 3.0], snapshots.arc_length)
    scaled = members.drop_vars("arc_length").assign_coords(arc_length=(("member", "particle"), lengths))
    xr.testing.assert_allclose(
        cp.pod.decompose(scaled, rank=3).mode_shape, cp.pod.decompose(members, rank=3).mode_shape
    )
    lengths[3, 5] *= 1.01
    other = scaled.assign_coords(arc_length=(("member", "particle"), lengths))
    with pytest.raises(cp.SceneError, match=r"different S / L0, from the first one differ \[3\]"):
        cp.pod.decompose(other.chunk({"member": 1}))


def test_an_archive_is_read_once_and_in_small_pieces(tmp_path, monkeypatch):
    snapshots, left = trajectory(samples=20000)
    path = cp.archive.write(snapshots, tmp_path / "it.nc")
    monkeypatch.setattr(reading, "BLOCK", 1 << 20)
    read, sizes = reading._sliced, []

    def counted(source, region):
        found = read(source, region)
        sizes.append(found[0].nbytes)
        return found

    monkeypatch.setattr(reading, "_sliced", counted)
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
    counted_in, seen = cp.pod_stream._count_in, []

    def counted(sums, block, how):
        seen.append((threading.current_thread().name, len(block)))
        counted_in(sums, block, how)

    monkeypatch.setattr(cp.pod_stream, "_count_in", counted)
    one, other = (cp.pod.decompose(lazy, rank=12, layout="vector") for _ in range(2))
    xr.testing.assert_identical(one.drop_attrs(deep=False), other.drop_attrs(deep=False))
    assert all(name.startswith("cablepod") for name, _ in seen)
    assert sum(size for _, size in seen) == 40000
    broken = lazy.where((lazy.time != 1500.0) | (lazy.particle != 5))
    with pytest.raises(cp.SceneError, match="not finite"):
        cp.pod.decompose(broken)


def test_streams_merge_and_travel():
    snapshots, left = trajectory(samples=9000, kind="waves")
    streams = [cp.pod.Stream(layout="vector") for _ in range(3)]
    for i, stream in enumerate(streams):
        stream.update(snapshots.isel(time=slice(3000 * i, 3000 * (i + 1))))
    sent = [pickle.loads(pickle.dumps(stream)) for stream in streams]
    before = sent[1].modes(rank=5)
    merged = cp.pod.Stream(layout="vector").merge(sent[2]).merge(sent[0]).merge(sent[1])
    modes = merged.modes(rank=20)
    np.testing.assert_allclose(modes.singular_value, STEEP, rtol=3e-10)  # 9000 rows average less than a long run
    assert sines(modes, left).max() < 1e-8
    assert modes.attrs["number_of_snapshots"] == 9000
    xr.testing.assert_identical(sent[1].modes(rank=5), before)
    assert len(pickle.dumps(merged)) < 100_000


def test_a_fault_leaves_a_stream_as_it_was():
    snapshots, _ = trajectory(samples=3000)
    stream = cp.pod.Stream().update(snapshots)
    before = stream.modes(rank=4)
    broken = snapshots.where((snapshots.time != 200.0) | (snapshots.particle != 5))
    for bad, match in (
        (broken, "not finite"),
        (broken.chunk({"time": 300}), "not finite"),
        (snapshots.isel(particle=slice(0, 9)), "given 9 particles"),
        (snapshots.isel(coordinate=[0]), r"coordinates \[.*'x'.*\]"),
        (snapshots.drop_vars("position"), "without position"),
    ):
        with pytest.raises(cp.SceneError, match=match):
            stream.update(bad)
        xr.testing.assert_identical(stream.modes(rank=4), before)
    with pytest.raises(cp.SceneError, match="other: given"):
        stream.merge(cp.pod.Stream(center=False))
    with pytest.raises(cp.SceneError, match="given none"):
        cp.pod.Stream().modes()
    with pytest.raises(cp.SceneError, match="layout: given 'joint'"):
        cp.pod.Stream(layout="joint")
    with pytest.raises(cp.SceneError, match="one instant"):
        cp.pod.Stream().update(snapshots.isel(time=[0])).modes()
    with pytest.raises(cp.SceneError, match="rank: given 21; allowed: at most 20"):
        stream.modes(rank=21)


def test_a_coordinate_at_rest_among_moving_ones_of_many_features():
    snapshots, _ = trajectory(samples=1500, particles=602, dims=1, spectrum=np.geomspace(1.0, 1e-3, 6))
    still = snapshots.assign_coords(coordinate=["y"]).assign(
        position=0.0 * snapshots.position.assign_coords(coordinate=["y"])
    )
    both = xr.concat([snapshots, still], "coordinate")
    modes = cp.pod.decompose(both.chunk({"time": 500}), rank=4)
    np.testing.assert_allclose(modes.singular_value[0], np.geomspace(1.0, 1e-3, 6)[:4], rtol=1e-12)
    assert not modes.singular_value[1].any()
    shape = modes.mode_shape[1].values
    np.testing.assert_allclose(shape @ shape.T, np.eye(4), atol=1e-14)


def test_blas_threads_come_back():
    from threadpoolctl import threadpool_info

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


def test_where_the_default_of_dask_goes_wrong_this_does_not():
    # fast decay, as of a chain's modes: powers of the matrix lose what lies below 10^-16 of the largest power
    spectrum = np.geomspace(1.0, 1e-8, 20)
    snapshots, left = trajectory(samples=4000, particles=42, spectrum=spectrum)
    lazy = snapshots.chunk({"time": 1000})
    matrix_ = lazy.position[:, 1:-1].data.reshape(4000, -1).T.rechunk((80, 1000))
    with dask.config.set(scheduler="synchronous"), one_blas_thread():
        theirs = da.linalg.svd_compressed(matrix_, 20, n_power_iter=4, seed=0, iterator="power")[1].compute()
        right = da.linalg.svd_compressed(matrix_, 20, n_power_iter=4, seed=0, iterator="QR")[1].compute()
    ours = cp.pod.decompose(lazy, rank=20, layout="vector")
    np.testing.assert_allclose(ours.singular_value, spectrum, rtol=3e-10)
    assert sines(ours, left).max() < 1e-8
    # were dask right one day, this case would show nothing any more
    assert np.abs(theirs / spectrum - 1.0).max() > 0.5
    assert np.abs(right / spectrum - 1.0).max() < 1e-6
