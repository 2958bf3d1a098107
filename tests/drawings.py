"""Made-up trajectories and modes that tests of figures draw."""

from __future__ import annotations

import numpy as np
import xarray as xr

SIGMA = np.array([0.0, 0.3, 0.6, 1.0])
TIME = np.array([0.0, 0.1, 0.2, 0.3])


def trajectory(dims=2, times=TIME, sigma=SIGMA, seed=1):
    """A cable along a chord of slope 3/4, with arbitrary deflections of the inner particles."""
    place = sigma[:, None] * np.array([8.0, 6.0, 0.0])[:dims]
    position = np.repeat(place[None], times.size, axis=0)
    position[:, 1:-1] += 0.1 * np.random.default_rng(seed).standard_normal((times.size, sigma.size - 2, dims))
    return xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position)},
        coords={"time": times, "coordinate": list("xyz"[:dims]), "arc_length": ("particle", 10.0 * sigma)},
        attrs={"model": "made-up chain"},
    )


def modes_of(layout="separate", count=3):
    dims, lead = {
        "separate": (("coordinate", "mode", "particle"), ("coordinate", "mode")),
        "vector": (("mode", "particle", "coordinate"), ("mode",)),
        "normal": (("mode", "particle"), ("mode",)),
        "normal, spatial": (("set", "mode", "particle"), ("set", "mode")),
    }[layout]
    sizes = {"coordinate": 2, "set": 2, "mode": count, "particle": SIGMA.size}
    rng = np.random.default_rng(2)
    return xr.Dataset(
        {
            "mode_shape": (dims, rng.standard_normal([sizes[d] for d in dims])),
            "singular_value": (
                lead,
                10.0 ** -np.arange(np.prod([sizes[d] for d in lead])).reshape([sizes[d] for d in lead]),
            ),
        },
        coords={
            "mode": np.arange(1, count + 1),
            "coordinate": ["x", "y"],
            "set": ["in plane", "out of plane"],
            "arc_length": ("particle", 10.0 * SIGMA),
        },
        attrs={"layout": layout},
    )


def texts(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]
