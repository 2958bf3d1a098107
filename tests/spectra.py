"""Made-up snapshots of exactly known singular values."""

from __future__ import annotations

import numpy as np
import xarray as xr

STEEP = np.geomspace(1.0, 1e-8, 20)


def made_up(samples=30, particles=12, dims=2, seed=0, spectrum=None):
    """Snapshots with random ends and lifted parts of a known spectrum (per coordinate)."""
    rng = np.random.default_rng(seed)
    count = min(particles - 2, samples - 1)
    spectrum = 10.0 ** -np.arange(count) if spectrum is None else np.asarray(spectrum)
    hat = np.zeros((samples, particles, dims))
    for c in range(dims):
        left = np.linalg.qr(rng.normal(size=(particles - 2, spectrum.size)))[0]
        # right vectors orthogonal to the constant, so that centring takes nothing off
        right = np.linalg.qr(np.c_[np.ones(samples), rng.normal(size=(samples, spectrum.size))])[0][:, 1:]
        hat[:, 1:-1, c] = (right * spectrum) @ left.T
    sigma = np.sort(np.r_[0.0, rng.uniform(size=particles - 2), 1.0])
    ends = rng.normal(size=(samples, 2, dims))
    s = sigma[None, :, None]
    position = (1 - s) * ends[:, :1] + s * ends[:, 1:] + hat + np.sin(np.pi * s)
    return xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position)},
        coords={
            "time": np.arange(samples) * 1.0,
            "arc_length": ("particle", 7.0 * sigma),
            "coordinate": list("xyz"[:dims]),
        },
    )


def particle_weights(snapshots, weights):
    """Weights of the particles by their definition, of mean 1 over the inner ones: the ends have no part in it."""
    length = np.diff(snapshots.arc_length)
    carried = 0.5 * (np.r_[length, 0.0] + np.r_[0.0, length])
    return np.ones(carried.size) if weights is None else carried / carried[1:-1].mean()


def known_rows(samples, features, spectrum, kind="random", seed=0):
    """Rows of exactly known singular values with zero mean, and their modes; "waves" begin slowly, "turns" move one by one."""
    rng = np.random.default_rng(seed)
    count = len(spectrum)
    left = np.linalg.qr(rng.normal(size=(features, count)))[0]
    if kind == "random":
        right = np.linalg.qr(np.c_[np.ones(samples), rng.normal(size=(samples, count))])[0][:, 1:]
    elif kind == "waves":
        place = (np.arange(samples) + 0.5) / samples
        right = np.sqrt(2.0 / samples) * np.cos(np.pi * np.outer(place, np.arange(1, count + 1)))
    else:  # the weakest first
        width = samples // (2 * count)
        right = np.zeros((samples, count))
        for mode in range(count):
            begin = (count - 1 - mode) * 2 * width
            right[begin : begin + width, mode] = 1.0
            right[begin + width : begin + 2 * width, mode] = -1.0
        right /= np.linalg.norm(right, axis=0)
    return (right * spectrum) @ left.T, left


def trajectory(samples=6000, particles=22, dims=2, spectrum=STEEP, kind="random"):
    """Snapshots whose rows of all coordinates have a known spectrum, with ends at rest in the origin; and their modes."""
    rows, left = known_rows(samples, (particles - 2) * dims, spectrum, kind)
    position = np.zeros((samples, particles, dims))
    position[:, 1:-1] = rows.reshape(samples, particles - 2, dims)
    snapshots = xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position)},
        coords={
            "time": np.arange(samples) * 0.1,
            "arc_length": ("particle", np.linspace(0.0, 50.0, particles)),
            "coordinate": list("xyz"[:dims]),
        },
        attrs={"id": "made up"},
    )
    return snapshots, left


def turning(samples=3000, particles=22, dims=3, steep=False):
    """Snapshots on a chord that turns and grows, with deflections of known spectra; and their modes, normal by normal."""
    spectra = [np.geomspace(1.0, 1e-6, 10), np.geomspace(0.1, 1e-7, 8)][: dims - 1]
    known = [known_rows(samples, particles - 2, item, seed=number) for number, item in enumerate(spectra)]
    time = np.linspace(0.0, 1.0, samples)
    reach = np.stack([8.0 + time, 0.5 * time**2, 2.0 * np.sin(3.0 * time)], axis=1)[
        :, [1, 0, 2] if steep else [0, 1, 2]
    ]
    chord = np.linalg.norm(reach[:, :dims], axis=1, keepdims=True)
    along = reach[:, :dims] / chord
    if dims == 2:
        normals = [np.stack([-along[:, 1], along[:, 0]], axis=1)]
    else:
        level = np.cross(along, [1.0, 0.0, 0.0] if steep else [0.0, 1.0, 0.0])
        level /= np.linalg.norm(level, axis=1, keepdims=True)
        normals = [np.cross(level, along), level]
    deflection = np.zeros((dims - 1, samples, particles))
    deflection[:, :, 1:-1] = [item[0] for item in known]
    place = chord * np.linspace(0.0, 1.0, particles) ** 1.1
    position = np.stack([0.3 * time] * dims, axis=1)[:, None] + place[:, :, None] * along[:, None]
    position += sum(part[:, :, None] * normal[:, None] for part, normal in zip(deflection, normals, strict=True))
    snapshots = xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position)},
        coords={
            "time": time,
            "arc_length": ("particle", 10.0 * np.linspace(0.0, 1.0, particles) ** 1.1),
            "coordinate": list("xyz"[:dims]),
        },
    )
    return snapshots, spectra, [item[1] for item in known]


def sines(modes, left):
    """Sines of the angles between modes and exact ones; the root of 1 - cos^2 would lose half of the digits."""
    own = modes.mode_shape.values[:, 1:-1].reshape(modes.sizes["mode"], -1).T
    exact = left[:, : own.shape[1]]
    return np.linalg.norm(own - exact * np.sum(exact * own, axis=0), axis=0)
