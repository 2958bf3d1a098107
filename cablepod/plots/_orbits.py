"""Draw periodic orbits: the path of a particle over a period, an animation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import integer, number
from cablepod.plots import _style
from cablepod.plots._animation import Animation
from cablepod.plots._style import MAX_DOTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Number of paths in an animation.
PATHS = 12
ORBIT = "what periodic.orbit gives"


def orbit(*orbits: xr.Dataset, sigma: float = 0.5, ax: Axes | None = None) -> Axes:
    """Draw the path of one particle over a period: out of the plane over in the plane, or velocity over deflection.

    Parameters
    ----------
    orbits
        Results of :func:`cablepod.periodic.orbit` with output "position".
    sigma
        Relative arc length of the particle, from 0 to 1; the nearest one is drawn.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones.  If one orbit leaves the plane, the path is seen along the chord; else it is a phase portrait of the
        deflection normal to the chord.

    Raises
    ------
    SceneError
        For another Dataset, for none, and for a place outside the cable.
    """
    if not orbits:
        raise SceneError(f"orbits: given none; allowed: {ORBIT}")
    number(least=0.0, most=1.0)("sigma", sigma)
    paths = []
    for one in orbits:
        _style.take("orbits", one, "multiplier_real", ("multiplier",), ORBIT)  # not any trajectory: a period
        position, time = _period("orbits", one)
        k = int(np.argmin(np.abs(_style.sigma("orbits", one) - sigma)))
        paths.append((time, *(part[:, k] for part in _deflections("orbits", position))))
    spatial = any(np.abs(lateral).max() > 1e-12 * max(np.abs(normal).max(), 1e-300) for _, normal, lateral in paths)
    ax = _style.axes(ax, size=_style.EQUAL_SIZE if spatial else _style.SIZE)
    for k, (time, normal, lateral) in enumerate(paths):
        across, up = (lateral, normal) if spatial else (normal, _rate(normal, time))
        label = f"orbit {k + 1}"
        if "angular_frequency" in orbits[k]:
            label = f"{_style.take('orbits', orbits[k], 'angular_frequency', (), ORBIT).item():.4g} rad/s"
        ax.plot(across, up, label=label, **_style.style(k, k, time.size))
    if spatial:
        ax.set(xlabel="deflection out of the plane [m]", ylabel="deflection in the plane [m]")
        ax.set_aspect("equal", adjustable="datalim")
    else:
        ax.set(xlabel="deflection in the plane [m]", ylabel="its rate [m/s]")
    return _style.finish(ax)


def animate_orbit(orbit: xr.Dataset, *, frames: int = 48, ax: Axes | None = None) -> Animation:
    """Animate an orbit seen along the chord: the cable as a line with dots, the paths of some particles.

    Parameters
    ----------
    orbit
        Result of :func:`cablepod.periodic.orbit` with output "position".
    frames
        Number of frames of the period, at most one for each instant of the orbit.
    ax
        Axes to draw on; their figure is redrawn for each frame.

    Returns
    -------
    Animation
        Shown as a GIF by a notebook, which repeats without a jump; ``animate_orbit(...).save("whirling.gif")`` writes it.

    Raises
    ------
    SceneError
        For another Dataset, and fewer than two frames.

    Notes
    -----
    Both axes show the deflection normal to the chord of the moment, with the same scale.
    """
    _style.take("orbit", orbit, "multiplier_real", ("multiplier",), ORBIT)
    position, time = _period("orbit", orbit)
    time = time[:-1]
    count = min(integer(least=2)("frames", frames), time.size)
    picked = np.unique(np.linspace(0, time.size, count, endpoint=False).astype(int))
    inside, lateral = _deflections("orbit", position)
    ax = _style.axes(ax, private=True)
    size = 1.1 * max(float(np.ptp(inside)), float(np.ptp(lateral)), 1e-300) / 2.0
    every = max(1, inside.shape[1] // MAX_DOTS)
    for k in range(0, inside.shape[1], max(1, inside.shape[1] // PATHS)):
        ax.plot(
            lateral[:, k], inside[:, k], color="0.8", linewidth=0.8, zorder=0, label="" if k else "paths of particles"
        )
    (line,) = ax.plot(
        lateral[0], inside[0], color=_style.COLOURS[0], marker=_style.MARKERS[0], markersize=4, markevery=every, linewidth=1.0,
        label="cable, seen along the chord",
    )  # fmt: skip
    middles = [0.5 * float(part.max() + part.min()) for part in (lateral, inside)]
    ax.set(xlabel="deflection out of the plane [m]", ylabel="deflection in the plane [m]")
    ax.set(xlim=(middles[0] - size, middles[0] + size), ylim=(middles[1] - size, middles[1] + size))
    ax.set_aspect("equal", adjustable="box")
    _style.finish(ax)

    def show(i: int) -> None:
        line.set_data(lateral[picked[i]], inside[picked[i]])

    return Animation(ax, time[picked], show)


def _deflections(key: str, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return deflections normal to the chord, in the plane of chord and vertical and out of it (time, particle) [m]."""
    inside = _style.normal_deflection(key, position)
    return inside, _style.normal_deflection(key, position, across=True) if position.shape[2] > 2 else 0.0 * inside


def _rate(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the rate of a periodic quantity over a period, from its first instant to the same one a period later."""
    period = time[-1] - time[0]
    around = np.concatenate([time[-2:-1] - period, time, time[1:2] + period])
    return np.asarray(np.gradient(np.concatenate([values[-2:-1], values, values[1:2]]), around)[1:-1])


def _period(key: str, orbit: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (time, particle, coordinate) [m] of an orbit, and its instants [s]."""
    position = _style.take(key, orbit, "position", ("time", *_style.PLACE), f"{ORBIT} with output position")
    if position.sizes["time"] < 3:
        raise scene_error(
            key, f"{position.sizes['time']} instants", "at least three, from the begin of a period to its end"
        )
    if not np.isfinite(position.values).all():
        raise SceneError(f"{key}: given positions that are not finite; allowed: {ORBIT}")
    if "member_time" in orbit:  # of a member
        return position.values, _style.take(key, orbit, "member_time", ("time",), ORBIT).values
    return position.values, position["time"].values.astype(float)
