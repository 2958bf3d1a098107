"""Draw cables: shapes, displacements, tensions, phase portraits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod._inputs import numbers_in
from cablepod.conventions import printed
from cablepod.errors import scene_error
from cablepod.parameters._checks import choice, number, numbers_list, truth
from cablepod.plots import _style
from cablepod.plots._style import COLOURS, DEFAULT_INSTANTS, LINES, MARKERS, MAX_INSTANTS, PLACE, SIGMA

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TENSIONS = 'a trajectory with tensions, from a simulate with outputs=("tension",)'


def shapes(
    chain: xr.Dataset,
    reduced: xr.Dataset | None = None,
    *,
    times: Sequence[float] | np.ndarray | None = None,
    deflection: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw shapes of the chain (dots) and the reduced cable (lines) at a few instants.

    Parameters
    ----------
    chain, reduced
        Trajectories with ``position (time, particle, coordinate)`` [m]; the optional `reduced` may have other particles.
    times
        At most six instants [s] of both trajectories; by default five, evenly spread over those of the chain.
    deflection
        Draw the deflection normal to the instantaneous chord [m] against S / L0 instead of y against x.  Motions that are small
        compared with the span are visible only in this form.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones; x and y are to the same scale.

    Raises
    ------
    SceneError
        For Datasets without positions, missing instants, and coincident ends if a chord is needed.

    Notes
    -----
    Figures 6 to 9 of the paper.  The normal lies in the plane of the chord and y, and points up at the first instant.  A spatial
    cable is seen along z, or drawn by its deflection in that plane; one that moves more across it, as in wind from the side, is
    seen along y, or drawn by its deflection across the plane.  The legend states which.
    """
    runs = {"chain": chain} if reduced is None else {"chain": chain, "reduced": reduced}
    positions = _style.positions(runs)
    wanted = _wanted(positions["chain"], times)
    truth("deflection", deflection)
    across = _moves_across(positions["chain"].values, deflection=deflection)
    curves = _style.curves(runs, positions, wanted, deflection=deflection, across=across)
    ax = _style.axes(ax)
    handles = _draw_instants(ax, *curves.values())
    title = "dots: " + _style.name(chain, "chain")
    if reduced is not None:
        title += "\nlines: " + _style.name(reduced, "reduced cable")
    if positions["chain"].sizes["coordinate"] > 2:
        where = f"{'across' if across else 'in'} the plane of chord and y"
        title += f"\n{where if deflection else _seen_along(across)}"
    if deflection:
        ax.set(xlabel=SIGMA, ylabel="deflection normal to the chord [m]")
    else:
        _style.equal_axes(ax, "z" if across else "y")
    return _style.finish(ax, title=title, handles=handles, labels=[f"t = {t:g} s" for t in wanted])


def _seen_along(across: bool) -> str:
    """Return how a spatial cable is seen."""
    return f"seen along {'y' if across else 'z'}"


def _moves_across(position: np.ndarray, *, deflection: bool = False) -> bool:
    """Tell whether a cable (time, particle, coordinate) moves more along z than y; or across its plane than in it."""
    if position.shape[2] < 3:
        return False
    if deflection:
        both = [_style.normal_deflection("chain", position, across=across) for across in (False, True)]
    else:
        both = [position[..., 1], position[..., 2]]
    in_plane, across = (float(np.ptp(values, axis=0).max()) for values in both)
    return across > in_plane


def snapshots(
    chain: xr.Dataset,
    cable: xr.Dataset,
    *,
    times: Sequence[float] | np.ndarray | None = None,
    magnify: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw snapshots of the chain against the continuous cable, their displacements magnified.

    Both are drawn as x(0) + m (x(t) - x(0)), because displacements of a taut cable are about a thousandth of the span.

    Parameters
    ----------
    chain, cable
        Trajectories with ``position (time, particle, coordinate)`` [m], with equal coordinates; particles may differ.
    times
        At most six instants [s] of both trajectories; by default five, evenly spread over those of the chain.
    magnify
        The factor m, above 0; by default 1, 2 or 5 times a power of ten, so that the largest displacement is about a tenth of
        the chord, and 1 without motion or chord.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: the chain as dots, the cable as lines, the first shape of the cable as a thin grey line.  x and y are
        to the same scale; a spatial cable is seen along z, or along y where it moves more along z.

    Raises
    ------
    SceneError
        For Datasets without positions, missing instants, and a factor that is not above 0.
    """
    positions = _style.positions({"chain": chain, "cable": cable})
    wanted = _wanted(positions["chain"], times)
    picks = [_style.instants(key, position["time"].values, wanted) for key, position in positions.items()]
    values = [position.values for position in positions.values()]
    factor = _factor(values[0][picks[0]], values[0][0]) if magnify is None else number(above=0.0)("magnify", magnify)
    ax = _style.axes(ax)
    first, across = values[1][0], _moves_across(values[0])
    up = 2 if across else 1
    ax.plot(first[:, 0], first[:, up], color="0.6", linewidth=0.8, zorder=0)
    drawn = [x[0] + factor * (x[pick] - x[0]) for x, pick in zip(values, picks, strict=True)]
    handles = _draw_instants(ax, *((x[..., 0], x[..., up]) for x in drawn))
    title = f"dots: {_style.name(chain, 'chain')}\nlines: {_style.name(cable, 'cable')}\ngrey: at t = "
    title += f"{positions['cable']['time'].values[0]:g} s\ndisplacements × {factor:g}"
    if first.shape[1] > 2:
        title += f"\n{_seen_along(across)}"
    _style.equal_axes(ax, "z" if across else "y")
    return _style.finish(ax, title=title, handles=handles, labels=[f"t = {t:g} s" for t in wanted])


def rest(cable: xr.Dataset, chain: xr.Dataset | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw the continuous cable (line) and the chain (dots) at rest, figure 4 of the paper.

    Parameters
    ----------
    cable, chain
        Results of ``catenary.rest`` and ``chain.rest`` with ``position (particle, coordinate)`` [m].
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones, x and y to the same scale; a spatial cable is seen along z.

    Raises
    ------
    SceneError
        For Datasets without positions of one instant.
    """
    line = _style.take("cable", cable, "position", PLACE, "a cable at rest, from a rest")
    dots = None if chain is None else _style.take("chain", chain, "position", PLACE, "a chain at rest, from chain.rest")
    ax = _style.axes(ax)
    ax.plot(*line.values[:, :2].T, color=COLOURS[3], label="continuous cable")
    if dots is not None:
        ax.plot(*dots.values[:, :2].T, color=COLOURS[0], linestyle="none", marker="o", markersize=3.5, label="chain")
    _style.equal_axes(ax)
    return _style.finish(ax, title="at rest, seen along z" if line.sizes["coordinate"] > 2 else "at rest")


def end_tensions(run: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the tension at both ends over time.

    Parameters
    ----------
    run
        Trajectory with ``tension (time, link)`` [N], as of ``chain.simulate(..., outputs=("tension",))``, of which the first and
        the last link are drawn; or the stage "tension" of :func:`cablepod.study.run`, with ``end_tension (time, end)``.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: time [s] across, tension up.  Where the largest or the smallest tension over all time steps, with its
        instant, is in the Dataset, a marker shows it.

    Raises
    ------
    SceneError
        For a Dataset without tensions, and for links without those at the ends.
    """
    if isinstance(run, xr.Dataset) and "end_tension" in run:
        array = _style.take("run", run, "end_tension", ("time", "end"), TENSIONS)
    else:
        array = _style.take("run", run, "tension", ("time", "link"), TENSIONS)
        _check_end_links(run)
    ax = _style.axes(ax)
    upper, lower = array.values[:, -1], array.values[:, 0]
    ax.plot(array["time"].values, upper, color=COLOURS[0], linewidth=1.0, label="upper end")
    ax.plot(array["time"].values, lower, color=COLOURS[1], linestyle=LINES[1], linewidth=1.0, label="lower end")
    for name, text, marker in (("maximum", "largest", "^"), ("minimum", "smallest", "v")):
        if {f"tension_{name}", f"tension_{name}_time"} <= set(run.variables):
            values = _style.take("run", run, f"tension_{name}", (), TENSIONS, more=1).values
            time = float(_style.take("run", run, f"tension_{name}_time", (), TENSIONS))
            value = float(values.max() if name == "maximum" else values.min())
            label = f"{text}, {printed(value, 'N')}\nat {time:.4g} s"
            ax.plot([time], [value], color=COLOURS[3], linestyle="none", marker=marker, markersize=7, label=label)
    ax.set(xlabel="time [s]")
    _style.label_axis(ax.yaxis, "tension [N]", array.values)
    return _style.finish(ax)


def _check_end_links(run: xr.Dataset) -> None:
    """Refuse a run of which links were picked without those at the ends."""
    if {"arc_length", "link_arc_length"} <= set(run.variables):
        particles = _style.take("run", run, "arc_length", ("particle",), TENSIONS).values
        links = _style.take("run", run, "link_arc_length", ("link",), TENSIONS).values
        if links[0] > particles[1] or links[-1] < particles[-2]:
            raise scene_error(
                "run", f"links from {links[0]:.4g} to {links[-1]:.4g} m", "those at both ends among its links"
            )


def tension(run: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the tension over arc length and time.

    Parameters
    ----------
    run
        Trajectory with ``tension (time, link)`` [N], as of ``chain.simulate(..., outputs=("tension",))``.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: time [s] across, unstretched arc length up, in metres from the lower end where the run has
        ``link_arc_length``, else as S / L0; tension by colour with a colour bar.  Tensions of zero or less are hatched.

    Raises
    ------
    SceneError
        For a Dataset without tensions, or with a single instant or link.
    """
    array = _style.take("run", run, "tension", ("time", "link"), TENSIONS)
    across, (up, place) = array["time"].values, _middles(run, array)
    if min(array.shape) < 2:
        raise scene_error("run", f"tension {dict(array.sizes)}", "two instants and two links at least")
    ax = _style.axes(ax)
    mesh = _style.colour_cells(ax, across, up, array.values.T)
    _style.colour_bar(ax, mesh, "tension [N]", array.values)
    slack = array.values.T <= 0.0
    if slack.any():
        _style.hatch_cells(ax, mesh, slack, "white")
        ax.set_title("hatched: zero or less", fontsize="medium")
    ax.set(xlabel="time [s]", ylabel=place)
    return ax


def phase_portraits(
    run: xr.Dataset, *, at: Sequence[float] | float = (0.25, 0.5), coordinate: str = "y", ax: Axes | None = None
) -> Axes:
    """Draw velocity against displacement of a few points of the cable.

    Parameters
    ----------
    run
        Trajectory with ``position`` [m] and ``velocity`` [m/s] over (time, particle, coordinate), as of ``chain.simulate(...,
        outputs=("position", "velocity"))``; its instants are joined by straight lines and should be close.
    at
        At most six places S / L0, from 0 to 1; the nearest particle is drawn, labelled with its S / L0.
    coordinate
        "x", "y" or "z".
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: a curve for each place, with a large marker at the first instant.

    Raises
    ------
    SceneError
        For a Dataset without positions or velocities, places outside the cable, and a missing coordinate.
    """
    allowed = 'a trajectory, from a simulate with outputs=("position", "velocity")'
    x, v = (_style.take("run", run, name, ("time", *PLACE), allowed) for name in ("position", "velocity"))
    names = [str(name) for name in x["coordinate"].values]
    choice(*names)("coordinate", coordinate)
    allowed = f"one to {MAX_INSTANTS} places from 0 to 1"
    places = numbers_in("at", at, "1", allowed).tolist()
    if len(places) > MAX_INSTANTS or not all(0.0 <= place <= 1.0 for place in places):
        raise scene_error("at", places, allowed)
    sigma = _style.sigma("run", run)
    place, speed = (part.values[..., names.index(coordinate)] for part in (x, v))
    ax = _style.axes(ax)
    for i, wanted in enumerate(places):
        k = int(np.abs(sigma - wanted).argmin())
        moved = place[:, k] - place[0, k]
        label = f"$S / L_0$ = {sigma[k]:.3g}"
        ax.plot(moved, speed[:, k], color=COLOURS[i], linestyle=LINES[i], linewidth=1.0, label=label)
        ax.plot(moved[:1], speed[:1, k], color=COLOURS[i], marker=MARKERS[i], markersize=7)
    ax.set(xlabel=f"displacement in {coordinate} from the first instant [m]", ylabel=f"velocity in {coordinate} [m/s]")
    return _style.finish(ax, title=f"{_style.name(run, 'cable')}\nlarge: first instant")


def _wanted(position: xr.DataArray, times: Sequence[float] | np.ndarray | None) -> np.ndarray:
    """Return the checked instants [s], or evenly spread ones by default."""
    if times is None:
        instants = position["time"].values
        return instants[_style.spread(instants.size, DEFAULT_INSTANTS)]
    wanted = numbers_list()("times", np.atleast_1d(times) if np.isscalar(times) else times)
    if len(wanted) > MAX_INSTANTS:
        raise scene_error("times", f"{len(wanted)} instants", f"one to {MAX_INSTANTS}")
    return np.array(wanted)


def _draw_instants(ax: Axes, *curves: tuple[np.ndarray, np.ndarray]) -> list[tuple[Any, ...]]:
    """Draw curves (instant, point), the first as dots, others as lines; return the handles of each instant."""
    handles: list[tuple[Any, ...]] = [() for _ in curves[0][0]]
    for which, (across, up) in enumerate(curves):
        for i in range(len(handles)):
            line: dict[str, Any] = {"color": COLOURS[i], "linestyle": LINES[i], "linewidth": 1.2}
            style = line if which else _style.dots(i, across.shape[1]) | {"fillstyle": "none"}
            handles[i] += tuple(ax.plot(across[i], up[i], **style))
    return handles


def _factor(position: np.ndarray, first: np.ndarray) -> float:
    """Return a round factor that magnifies the largest displacement to about a tenth of the chord."""
    largest = float(np.linalg.norm(position - first, axis=-1).max())
    chord = float(np.linalg.norm(first[-1] - first[0]))
    if not largest > 0.0 or not chord > 0.0:
        return 1.0
    power = 10.0 ** np.arange(-6, 13)
    rounds = (np.array([1.0, 2.0, 5.0]) * power[:, None]).ravel()
    return float(rounds[np.abs(np.log(rounds * largest / (0.1 * chord))).argmin()])


def _middles(run: xr.Dataset, tension: xr.DataArray) -> tuple[np.ndarray, str]:
    """Return the places of the link centres, in metres where the run has them, else S / L0, and the label of their axis."""
    if "link_arc_length" in tension.coords:
        links = _style.take("run", run, "link_arc_length", ("link",), _style.TRAJECTORY)
        return links.values, "unstretched arc length from the lower end [m]"
    sigma = _style.sigma("run", run)
    middles = 0.5 * (sigma[1:] + sigma[:-1])
    if middles.size == tension.sizes["link"]:
        return middles, SIGMA
    numbers = tension["link"].values if "link" in tension.coords else np.zeros(1)
    if numbers.dtype.kind not in "iu" or numbers.min() < 1 or numbers.max() > middles.size:
        raise scene_error(
            "run", f"{tension.sizes['link']} links", f"the {middles.size} between its particles, or numbered ones"
        )
    return middles[numbers - 1], SIGMA
