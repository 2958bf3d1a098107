"""Snapshots in memory, in chunks, from files and of several runs give the same modes, within the memory there is."""

from __future__ import annotations

import dask
import dask.array as da
import numpy as np
import pytest
import xarray as xr
from scenes import SOFT
from spectra import STEEP, sines, trajectory, turning
from threadpoolctl import threadpool_limits

import cablepod as cp
from cablepod import provenance


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
    known = provenance.record(snapshots.copy(), function="made", parameters={})
    ids = {cp.pod.decompose(part, rank=8, **options).attrs["id"] for part in (known, known.chunk({"time": 700}))}
    assert len(ids) == 1  # chunks are taken for what is on record
    assert full.attrs["id"] != lazy.attrs["id"]  # without a record they are known by how they were made
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
    known = provenance.record(snapshots, function="made", parameters={})
    lazy = cp.pod.decompose(known.chunk({"time": 700}), rank=8, layout="normal")
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


def test_mixed_shapes_are_refused_by_name():
    snapshots, _ = trajectory(samples=300)
    long = snapshots.assign_coords(particle=np.arange(22))
    short = snapshots.isel(particle=slice(0, 15)).assign_coords(particle=np.arange(15))
    shifted = snapshots.assign_coords(arc_length=snapshots.arc_length**1.1)
    for parts, match in (
        ([long, short, long, short], r"15 particles in \[1, 3\], 22 particles in \[0, 2\]"),
        ([snapshots, shifted], r"different S / L0.*\[1\] differ"),
        (
            [snapshots, snapshots, snapshots.isel(coordinate=[0])],
            r"snapshots\[2\]: coordinate: given .'x'.; allowed: x and y",
        ),
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
    with pytest.raises(cp.SceneError, match=r"different S / L0, the members \[3\] differ"):
        cp.pod.decompose(other.chunk({"member": 1}))


def test_members_without_some_of_their_particles_are_refused():
    scene = cp.make_scene(SOFT)
    scenes = scene.assign(cable_top_tension=("member", [200.0, 300.0], scene.cable_top_tension.attrs))
    run = cp.chain.simulate(scenes, scheme="trapezoidal", step=0.05)
    backwards = run.isel(particle=slice(None, None, -1))
    for part, last in ((slice(0, 5), "5.* m of 1"), (slice(1, None), "m of 1")):
        for given in (run, backwards):
            with pytest.raises(
                cp.SceneError, match=rf"snapshots: arc_length: given '.*{last}.*allowed: .*to the unstretched"
            ):
                cp.pod.decompose(given.isel(particle=part))
    assert np.array_equal(cp.pod.decompose(run).singular_value, cp.pod.decompose(backwards).singular_value)


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


def test_where_the_default_of_dask_goes_wrong_this_does_not():
    # fast decay, as of a chain's modes: powers of the matrix lose what lies below 10^-16 of the largest power
    spectrum = np.geomspace(1.0, 1e-8, 20)
    snapshots, left = trajectory(samples=4000, particles=42, spectrum=spectrum)
    lazy = snapshots.chunk({"time": 1000})
    matrix_ = lazy.position[:, 1:-1].data.reshape(4000, -1).T.rechunk((80, 1000))
    with dask.config.set(scheduler="synchronous"), threadpool_limits(1, "blas"):
        theirs = da.linalg.svd_compressed(matrix_, 20, n_power_iter=4, seed=0, iterator="power")[1].compute()
        right = da.linalg.svd_compressed(matrix_, 20, n_power_iter=4, seed=0, iterator="QR")[1].compute()
    ours = cp.pod.decompose(lazy, rank=20, layout="vector")
    np.testing.assert_allclose(ours.singular_value, spectrum, rtol=3e-10)
    assert sines(ours, left).max() < 1e-8
    # were dask right one day, this case would show nothing any more
    assert np.abs(theirs / spectrum - 1.0).max() > 0.5
    assert np.abs(right / spectrum - 1.0).max() < 1e-6
