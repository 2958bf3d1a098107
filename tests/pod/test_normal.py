"""Modes of layout "normal", of the deflection normal to the chord of the moment: identities, known spectra, frames."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from spectra import particle_weights

import cablepod as cp

SPECTRA = [1.0, 0.3, 0.04, 0.001], [0.2, 0.03, 0.002]


def made_up(dims=2, samples=30, particles=12, *, alike=True, seed=1):
    """Snapshots with moving ends and deflections of known spectra, whose links are stretched alike or anyhow."""
    rng = np.random.default_rng(seed)
    sigma = np.sort(np.r_[0.0, rng.uniform(size=particles - 2), 1.0])
    lower = 0.3 * rng.normal(size=(samples, dims))
    reach = np.array([4.0, 3.0, 2.0])[:dims] + 0.3 * rng.normal(size=(samples, dims))
    chord = np.linalg.norm(reach, axis=1)
    e = reach / chord[:, None]
    if dims == 2:
        normals = [np.stack([-e[:, 1], e[:, 0]], axis=1)]
    else:
        level = np.cross(e, [0.0, 1.0, 0.0])
        level /= np.linalg.norm(level, axis=1, keepdims=True)
        normals = [np.cross(level, e), level]
    parts = []
    for spectrum in SPECTRA[: dims - 1]:
        waves = np.sin(np.pi * np.outer(sigma[1:-1], np.arange(1, 1 + len(spectrum))))
        left = np.linalg.qr(waves + 0.02 * rng.normal(size=waves.shape))[0]
        right = np.linalg.qr(rng.normal(size=(samples, len(spectrum))))[0]
        parts.append(np.pad((right * spectrum) @ left.T, ((0, 0), (1, 1))))
    across = sum(np.diff(part, axis=1) ** 2 for part in parts)
    length = 7.0 * np.diff(sigma)
    along = np.empty((samples, particles))
    for i in range(samples):
        xi = 1.0
        if alike:  # by bisection: links of xi times their length, that reach from end to end
            low, high = np.sqrt((across[i] / length**2).max()), 1e3
            for _ in range(200):
                xi = 0.5 * (low + high)
                over = np.sqrt(np.maximum((xi * length) ** 2 - across[i], 0.0)).sum() > chord[i]
                low, high = (low, xi) if over else (xi, high)
            links = np.sqrt((xi * length) ** 2 - across[i])
        else:
            links = rng.uniform(0.5, 1.5, size=length.size)
            links *= chord[i] / links.sum()
        along[i] = np.r_[0.0, np.cumsum(links)]
    position = lower[:, None] + along[:, :, None] * e[:, None]
    position += sum(part[:, :, None] * normal[:, None] for part, normal in zip(parts, normals, strict=True))
    snapshots = xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position)},
        coords={
            "time": np.arange(samples) * 1.0,
            "arc_length": ("particle", 7.0 * sigma),
            "coordinate": list("xyz"[:dims]),
        },
    )
    return snapshots, parts


def sets(dims):
    return [("", SPECTRA[0]), ("_out_of_plane", SPECTRA[1])][: dims - 1]


@pytest.mark.parametrize("alike", [True, False])
@pytest.mark.parametrize("dims", [2, 3])
def test_a_known_spectrum_is_found_however_the_particles_lie_along_the_chord(dims, alike):
    snapshots, parts = made_up(dims, alike=alike)
    modes = cp.pod.decompose(snapshots, layout="normal")
    for (suffix, spectrum), part in zip(sets(dims), parts, strict=True):
        count = len(spectrum)
        # deflections are cut out of positions of some m: rounding of 1e-16 times sqrt(360) of them
        np.testing.assert_allclose(modes[f"singular_value{suffix}"][:count], spectrum, rtol=0, atol=1e-13)
        np.testing.assert_allclose(modes[f"singular_value{suffix}"][count:], 0.0, atol=1e-13)
        shapes = modes[f"mode_shape{suffix}"].transpose("mode", "particle").values
        np.testing.assert_allclose(shapes @ shapes.T, np.eye(len(shapes)), atol=1e-12)
        assert not shapes[:, [0, -1]].any()
        # the mean is a part like any other: modes hold the deflections themselves
        kept = shapes[:count]
        np.testing.assert_allclose(part @ kept.T @ kept, part, atol=1e-12)
        share = np.square(spectrum) / np.square(spectrum).sum()
        np.testing.assert_allclose(modes[f"energy_share{suffix}"][:count], share, atol=1e-12)
    assert ("mode_shape_out_of_plane" in modes) == (dims == 3)
    assert "mean" not in modes


@pytest.mark.parametrize("weights", [None, "length", "mass"])
@pytest.mark.parametrize("dims", [2, 3])
def test_modes_are_orthonormal_in_their_weights_and_lose_the_energy_left_out(dims, weights):
    snapshots, parts = made_up(dims)
    modes = cp.pod.decompose(snapshots, layout="normal", weights=weights, rank=2)
    full = cp.pod.decompose(snapshots, layout="normal", weights=weights)
    weight = particle_weights(snapshots, weights)
    amplitudes = cp.pod.project(snapshots, modes)
    for (suffix, _), part in zip(sets(dims), parts, strict=True):
        shapes = modes[f"mode_shape{suffix}"].transpose("mode", "particle").values
        np.testing.assert_allclose((shapes * weight) @ shapes.T, np.eye(2), atol=1e-12)
        lost = np.sum(weight * (amplitudes[f"amplitude{suffix}"].values @ shapes - part) ** 2)
        assert lost == pytest.approx(float((full[f"singular_value{suffix}"][2:] ** 2).sum()), rel=1e-9)


@pytest.mark.parametrize("dims", [2, 3])
def test_all_modes_give_snapshots_back_whose_links_are_stretched_alike(dims):
    snapshots, _ = made_up(dims)
    modes = cp.pod.decompose(snapshots, layout="normal")
    back = cp.pod.reconstruct(cp.pod.project(snapshots, modes), modes)
    np.testing.assert_allclose(back.position, snapshots.position, atol=1e-12)
    # of links stretched anyhow the deflection alone
    other, parts = made_up(dims, alike=False)
    modes = cp.pod.decompose(other, layout="normal")
    back = cp.pod.reconstruct(cp.pod.project(other, modes), modes)
    again = cp.pod.project(back, modes)
    for (suffix, _), part in zip(sets(dims), parts, strict=True):
        shapes = modes[f"mode_shape{suffix}"].transpose("mode", "particle").values
        np.testing.assert_allclose(again[f"amplitude{suffix}"].values @ shapes, part, atol=1e-12)
    np.testing.assert_allclose(back.position[:, [0, -1]], other.position[:, [0, -1]], atol=1e-12)


def test_moved_turned_and_larger_scenes_have_the_same_modes():
    snapshots, _ = made_up(3)
    modes = cp.pod.decompose(snapshots, layout="normal")
    cosine, sine = np.cos(0.7), np.sin(0.7)
    turn = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])  # about the vertical
    other = snapshots.assign(
        position=snapshots.position.copy(data=2.0 * snapshots.position.values @ turn.T + [5, 6, 7])
    )
    found = cp.pod.decompose(other, layout="normal")
    for suffix, spectrum in sets(3):
        count = len(spectrum)
        np.testing.assert_allclose(found[f"singular_value{suffix}"], 2.0 * modes[f"singular_value{suffix}"], atol=1e-13)
        # shapes are known to rounding over the distance of their singular value to the next
        pair = (item[f"mode_shape{suffix}"].transpose("mode", "particle")[:count] for item in (found, modes))
        np.testing.assert_allclose(*pair, atol=1e-10)


def test_a_planar_motion_in_space_has_the_modes_of_the_plane():
    snapshots, _ = made_up(2)
    wide = xr.concat(
        [snapshots.position, 0.0 * snapshots.position[..., :1].assign_coords(coordinate=["z"])], "coordinate"
    )
    space = cp.pod.decompose(snapshots.drop_vars(["position", "coordinate"]).assign(position=wide), layout="normal")
    plane = cp.pod.decompose(snapshots, layout="normal")
    np.testing.assert_allclose(space.singular_value, plane.singular_value, atol=1e-13)
    np.testing.assert_allclose(space.mode_shape[:4], plane.mode_shape[:4], atol=1e-10)
    assert not space.singular_value_out_of_plane.any()
    # nor does rounding count as energy where the plane is not that of two axes
    turned = wide.values @ [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] + np.array([0.0, 0.0, 0.1])
    tilted = cp.pod.decompose(cp.snapshots(turned, arc_length=snapshots.arc_length), layout="normal", energy=0.99)
    assert tilted.sizes["mode"] == cp.pod.decompose(snapshots, layout="normal", energy=0.99).sizes["mode"]
    # modes that never moved are no coordinates of a model, whatever pushes it
    line = {"youngs_modulus": 2e7, "area": 1e-3, "density": 1000.0, "top_tension": 200.0}
    ends = {"lower": [0.0, 0.0, 0.0], "upper": [4.0, 3.0, 0.0]}
    scene = cp.make_scene({"cable": line, "ends": ends, "load": {"uniform": [0.0, 0.0, 5.0]}})
    run = cp.condensed.simulate(scene, space, times=[0.0, 0.1], step=1e-3)
    assert run.sizes["mode"] == 4
    assert not run.amplitude_out_of_plane.any()
