"""Karhunen-Loeve decomposition: identities, known spectra, the paper's numbers, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from spectra import made_up, particle_weights

import cablepod as cp


@pytest.mark.parametrize("dims", [2, 3])
def test_a_known_spectrum_is_found(dims):
    modes = cp.pod.decompose(made_up(dims=dims), rank=6)
    # the ends are of size 1: subtracting the straight line leaves rounding of about 1e-16 times sqrt(360)
    np.testing.assert_allclose(modes.singular_value, np.tile(10.0 ** -np.arange(6), (dims, 1)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(modes.proper_orthogonal_value, modes.singular_value**2 / 30, rtol=1e-13)
    np.testing.assert_allclose(modes.energy_share.isel(mode=0), 1 / np.sum(0.01 ** np.arange(10)), rtol=1e-12)
    np.testing.assert_allclose(modes.singular_value_share.isel(mode=0), 1 / np.sum(0.1 ** np.arange(10)), rtol=1e-12)


@pytest.mark.parametrize("layout", ["separate", "vector"])
@pytest.mark.parametrize("weights", [None, "length", "mass"])
def test_orthonormal_modes_and_the_discarded_energy(layout, weights):
    snapshots = made_up()
    full = cp.pod.decompose(snapshots, layout=layout, weights=weights)
    sets = [full] if layout == "vector" else [full.isel(coordinate=[axis]) for axis in range(2)]
    weight = particle_weights(snapshots, weights)
    for modes in sets:
        shapes = modes.mode_shape.transpose("mode", "particle", "coordinate").values
        np.testing.assert_allclose(np.einsum("ipc,p,kpc->ik", shapes, weight, shapes), np.eye(len(shapes)), atol=1e-12)
        assert not shapes[:, [0, -1]].any()
    kept = cp.pod.decompose(snapshots, layout=layout, weights=weights, rank=3)
    back = cp.pod.reconstruct(cp.pod.project(snapshots, kept), kept)
    lost = np.sum(weight[:, None] * (back.position - snapshots.position).values ** 2)
    discarded = float((full.singular_value.isel(mode=slice(3, None)) ** 2).sum())
    assert lost == pytest.approx(discarded, rel=1e-9)


def test_all_modes_give_the_snapshots_back():
    snapshots = made_up()
    modes = cp.pod.decompose(snapshots)
    back = cp.pod.reconstruct(cp.pod.project(snapshots, modes), modes)
    np.testing.assert_allclose(back.position, snapshots.position, atol=1e-14)
    # with the ends where they were, to the last bit
    np.testing.assert_array_equal(back.position[:, [0, -1]], snapshots.position[:, [0, -1]])


@pytest.mark.parametrize("layout", ["separate", "vector", "normal"])
def test_amplitudes_find_their_modes_by_number_and_layout(layout):
    snapshots = made_up(dims=3)
    modes = cp.pod.decompose(snapshots, layout=layout)
    picked = modes.isel(mode=[0, 2])
    amplitudes = cp.pod.project(snapshots, modes).isel(mode=[0, 2])
    own = cp.pod.reconstruct(cp.pod.project(snapshots, picked), picked)
    for given in (modes, picked):
        np.testing.assert_array_equal(cp.pod.reconstruct(amplitudes, given).position, own.position)
    with pytest.raises(
        cp.SceneError, match=r"amplitudes: mode: given \[1, 3\]; allowed: numbers of the modes, \[1, 2\]"
    ):
        cp.pod.reconstruct(amplitudes, modes.isel(mode=[0, 1]))
    others = cp.pod.decompose(snapshots, layout="vector" if layout == "normal" else "normal")
    with pytest.raises(cp.SceneError, match=f"amplitudes: given '{layout}'; allowed: those of modes with layout"):
        cp.pod.reconstruct(amplitudes, others)


def test_the_singular_values_of_example_2(scenes):
    modes = cp.pod.decompose(cp.chain.simulate(cp.read_scene(scenes / "example2.toml"), step=2.5e-4))
    np.testing.assert_allclose(modes.singular_value.isel(mode=0), [7.048, 2.479], rtol=2e-3)
    assert float(modes.singular_value[0, 1]) == pytest.approx(0.030, rel=0.02)


def test_the_sign_is_fixed():
    snapshots = made_up()
    mirrored = snapshots.assign(position=-snapshots.position)
    a, b = cp.pod.decompose(snapshots), cp.pod.decompose(mirrored)
    np.testing.assert_allclose(a.mode_shape, b.mode_shape, atol=1e-9)
    flat = a.mode_shape.values.reshape(-1, 12)
    first = flat[np.arange(len(flat)), np.argmax(np.abs(flat) >= 0.5 * np.abs(flat).max(axis=1, keepdims=True), axis=1)]
    assert (first > 0).all()


def test_any_order_and_more_dimensions():
    snapshots = made_up()
    modes = cp.pod.decompose(snapshots)
    turned = cp.pod.decompose(snapshots.transpose("coordinate", "particle", "time").assign_coords(run=5))
    xr.testing.assert_allclose(turned.drop_vars("run", errors="ignore"), modes)
    members = xr.concat(
        [snapshots.isel(time=slice(0, 15)), snapshots.isel(time=slice(15, None)).assign_coords(time=np.arange(15.0))],
        "member",
    )
    xr.testing.assert_allclose(cp.pod.decompose(members), modes, rtol=1e-9)


def test_enough_energy_is_kept():
    snapshots = made_up(spectrum=[3.0, 2.0, 1.0, 0.5])
    total = 9 + 4 + 1 + 0.25
    assert cp.pod.decompose(snapshots, energy=13 / total).sizes["mode"] == 2
    assert cp.pod.decompose(snapshots, energy=13.001 / total).sizes["mode"] == 3
    assert cp.pod.decompose(snapshots, energy=1.0).sizes["mode"] >= 4


def test_a_coordinate_that_stands_still_has_no_energy():
    snapshots = made_up(dims=3)
    snapshots.position[..., 2] = 0.0
    modes = cp.pod.decompose(snapshots)
    assert not modes.singular_value[2].any()
    assert not modes.energy_share[2].any()
    assert all(np.isfinite(v).all() for v in modes.data_vars.values())


def test_inputs_are_not_modified_and_units_are_set():
    snapshots = made_up()
    before = snapshots.copy(deep=True)
    modes = cp.pod.decompose(snapshots)
    amplitudes = cp.pod.project(snapshots, modes)
    xr.testing.assert_identical(snapshots, before)
    for dataset in (modes, amplitudes, cp.pod.reconstruct(amplitudes, modes)):
        assert all({"units", "long_name"} <= set(v.attrs) for v in dataset.variables.values())


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"layout": "joint"}, "layout: given 'joint'; allowed: one of 'separate', 'vector'"),
        ({"method": "magic"}, "method: given 'magic'; allowed: one of 'svd'"),
        ({"weights": "area"}, "weights: given 'area'"),
        ({"weights": np.ones(12)}, r"weights: given array\(.*; allowed: one of None, 'length'"),
        ({"rank": 0}, "rank: given 0; allowed: a whole number of at least 1"),
        ({"rank": 11}, "rank: given 11; allowed: at most 10"),
        ({"energy": 1.5}, "energy: given 1.5"),
        ({"center": "no"}, "center: given 'no'; allowed: true or false"),
        ({"rank": 2, "energy": 0.9}, "rank and energy"),
    ],
)
def test_options_that_cannot_be(options, match):
    with pytest.raises(cp.SceneError, match=match):
        cp.pod.decompose(made_up(), **options)


def test_snapshots_that_cannot_be():
    snapshots = made_up()
    with pytest.raises(cp.SceneError, match="a Dataset without arc_length; allowed: a trajectory"):
        cp.pod.decompose(snapshots.drop_vars("arc_length"))
    with pytest.raises(cp.SceneError, match=r"position: given the dimensions .*allowed: .*'time'"):
        cp.pod.decompose(snapshots.isel(time=0))
    with pytest.raises(cp.SceneError, match="one instant"):
        cp.pod.decompose(snapshots.isel(time=[0]))
    with pytest.raises(cp.SceneError, match="not finite"):
        cp.pod.decompose(snapshots.where(snapshots.time != 3))
    with pytest.raises(cp.SceneError, match="the 12 particles of the modes"):
        cp.pod.project(made_up(particles=9), cp.pod.decompose(snapshots))


@pytest.mark.parametrize("layout", ["separate", "vector", "normal"])
@pytest.mark.parametrize("dims", [(2, 3), (3, 2)])
def test_modes_of_other_coordinates_are_refused(layout, dims):
    own, other = (made_up(dims=number).assign_coords(arc_length=("particle", np.arange(12.0))) for number in dims)
    modes, others = (cp.pod.decompose(snapshots, layout=layout, rank=2) for snapshots in (own, other))
    with pytest.raises(
        cp.SceneError, match=r"snapshots: coordinate: given \['x', .*; allowed: those of the modes, \['x', "
    ):
        cp.pod.project(other, modes)
    with pytest.raises(cp.SceneError, match=r"amplitudes: coordinate: given \['x', "):
        cp.pod.reconstruct(cp.pod.project(other, others), modes)


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
