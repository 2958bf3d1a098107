"""Animate a cable as a GIF or an MP4."""

from __future__ import annotations

import base64
import html
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod.errors import scene_error
from cablepod.parameters._checks import integer, number, truth
from cablepod.plots import _style
from cablepod.plots._style import COLOURS, SIGMA

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FRAMES_PER_SECOND = 15
#: Frames in the shortest time scale of ends and loads, their least number, and the largest without a given one.
FRAMES_PER_CHANGE, LEAST_FRAMES, MOST_FRAMES = 12, 60, 600
DOTS_PER_INCH = 80


class Animation:
    """Animated figure: a notebook shows it, :meth:`save` writes it.

    Attributes
    ----------
    ax : matplotlib.axes.Axes
        Axes of the figure.
    times : numpy.ndarray
        Instants of the frames [s].
    """

    def __init__(self, ax: Axes, times: np.ndarray, show: Callable[[int], None]) -> None:
        self.ax, self.times, self._show = ax, times, show
        self._clock = ax.text(0.02, 0.97, "", transform=ax.transAxes, va="top", family="monospace")
        self._frames_per_second: float = FRAMES_PER_SECOND
        self.show_frame(0)
        self._page: str | None = None

    @property
    def figure(self) -> Figure:
        """The figure of the axes."""
        return self.ax.figure  # type: ignore[return-value]

    def show_frame(self, number: int) -> Axes:
        """Draw the frame `number`, counted from 0, and return the axes."""
        self._draw(integer(least=0, most=self.times.size - 1)("number", number))
        return self.ax

    def _draw(self, number: int) -> None:
        """Draw a frame, with its instant and the speed of the animation."""
        self._show(number)
        text = f"t = {self.times[number]:.4g} s"
        if self.times.size > 1:
            interval = (self.times[-1] - self.times[0]) / (self.times.size - 1)
            text += f", {self._frames_per_second * interval:.2g} x real time"
        self._clock.set_text(text)

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        frames_per_second: float = FRAMES_PER_SECOND,
        progress: Callable[[float], None] | None = None,
    ) -> Path:
        """Write the animation to a file; an existing file is replaced.

        Parameters
        ----------
        path
            Name that ends in ``.gif``, or in ``.mp4`` if the program ffmpeg or the package imageio-ffmpeg is installed (``pip
            install 'cablepod[mp4]'``).
        frames_per_second
            Frame rate [1/s], at most 50.
        progress
            Callback receiving the completed fraction, which never falls and ends at 1.

        Returns
        -------
        pathlib.Path
            `path`.

        Raises
        ------
        SceneError
            For another ending, a missing folder, and an MP4 without ffmpeg.
        """
        import matplotlib as mpl
        from matplotlib import animation

        target, ending = Path(path), Path(path).suffix.lower()
        speed = number(above=0.0, most=50.0)("frames_per_second", frames_per_second)
        program = find_ffmpeg() if ending == ".mp4" else ""
        if program is None:
            raise scene_error(
                "path",
                str(path),
                "a name that ends in .gif; .mp4 needs the program ffmpeg, not found here; pip install 'cablepod[mp4]' brings it",
            )
        if ending not in (".gif", ".mp4"):
            raise scene_error("path", str(path), "a name that ends in .gif or .mp4")
        if not target.parent.is_dir():
            raise scene_error("path", str(path), "a file in a folder that is there")
        engine = self.figure.get_layout_engine()
        self.figure.canvas.draw()
        self.figure.set_layout_engine("none")  # laid out once, so that the axes do not move
        writer = (animation.PillowWriter if ending == ".gif" else animation.FFMpegWriter)(fps=speed)
        width, height = self.figure.get_size_inches()
        self._frames_per_second = speed
        try:
            with mpl.rc_context():
                mpl.rcParams["animation.ffmpeg_path"] = program
                self._write(writer, target, progress)
        finally:
            self.figure.set_layout_engine(engine)
            self.figure.set_size_inches(width, height)  # the video writer rounds to even numbers of pixels
        return target

    def _write(self, writer: Any, target: Path, progress: Callable[[float], None] | None) -> None:
        with writer.saving(self.figure, str(target), DOTS_PER_INCH):
            for i in range(self.times.size):
                self._draw(i)
                writer.grab_frame()
                if progress is not None and i + 1 < self.times.size:
                    progress((i + 1) / self.times.size)
        if progress is not None:
            progress(1.0)  # the file is written

    def _repr_html_(self) -> str:
        if self._page is None:
            with tempfile.TemporaryDirectory() as folder:
                picture = self.save(Path(folder) / "animation.gif").read_bytes()
            title = self.ax.get_title() or "a cable in motion"
            description = html.escape(f"{title}, t = {self.times[0]:g} to {self.times[-1]:g} s", quote=True)
            data = base64.b64encode(picture).decode("ascii")
            self._page = f'<img alt="{description}" src="data:image/gif;base64,{data}">'
        return self._page


def find_ffmpeg() -> str | None:
    """Return the path of ffmpeg, as matplotlib finds it or from imageio-ffmpeg; None if there is none."""
    import matplotlib as mpl
    from matplotlib import animation

    if animation.writers.is_available("ffmpeg"):
        return str(mpl.rcParams["animation.ffmpeg_path"])
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):  # not installed, or installed without the program
        return None


def animate(
    chain: xr.Dataset,
    reduced: xr.Dataset | None = None,
    *,
    deflection: bool = False,
    frames: int | None = None,
    ax: Axes | None = None,
) -> Animation:
    """Animate the cable: the chain as dots, the reduced cable as a line.

    Parameters
    ----------
    chain, reduced
        Trajectories with ``position (time, particle, coordinate)`` [m].  The optional `reduced` needs the instants of the chain,
        and may have other particles.
    deflection
        Draw the deflection normal to the instantaneous chord [m] against S / L0 instead of y against x.
    frames
        Maximum number of frames, evenly spread over the instants.  By default 12 in the shortest time scale of ends and loads
        (attribute ``shortest_time_scale`` of full models), from 60 to 600.
    ax
        Axes to draw on; their figure is redrawn for each frame.

    Returns
    -------
    Animation
        Shown as a GIF by a notebook; ``animate(...).save("guy.gif")`` or ``"guy.mp4"`` writes it.

    Raises
    ------
    SceneError
        For Datasets without positions, and for different instants.

    Notes
    -----
    Each frame is an instant as of :func:`cablepod.plots.shapes`, and states the speed; the first shape stays as a grey line.
    There are no more frames than instants: a fast motion needs ``times`` that show it.
    """
    runs = {"chain": chain} if reduced is None else {"chain": chain, "reduced": reduced}
    positions = _style.positions(runs)
    times = positions["chain"]["time"].values
    truth("deflection", deflection)
    most = _count(chain, times) if frames is None else integer(least=1)("frames", frames)
    picked = _style.spread(times.size, most)
    curves = list(_style.curves(runs, positions, times[picked], deflection=deflection).values())
    ax = _style.axes(ax, private=True)
    ax.plot(curves[0][0][0], curves[0][1][0], color="0.6", linewidth=0.8, zorder=0, label=f"at {times[picked[0]]:g} s")
    lines = []
    for key, (across, up) in zip(runs, curves, strict=True):
        line: dict[str, Any] = {"color": COLOURS[1], "linewidth": 1.5}
        style = _style.dots(0, across.shape[1]) if key == "chain" else line
        lines += ax.plot(across[0], up[0], label=_style.name(runs[key], key), **style)
    if deflection:
        ax.set(xlabel=SIGMA, ylabel="deflection normal to the chord [m]")
    else:
        ax.set(xlabel="x [m]", ylabel="y [m]")
    for axis, which in (("x", 0), ("y", 1)):
        drawn = np.concatenate([np.ravel(curve[which]) for curve in curves])
        drawn = drawn[np.isfinite(drawn)]  # a stopped run ends with nan
        low, high = (drawn.min(), drawn.max()) if drawn.size else (0.0, 0.0)
        margin = 0.05 * (high - low) or 0.5
        getattr(ax, f"set_{axis}lim")(low - margin, high + margin)
    _style.finish(ax)

    def show(i: int) -> None:
        for line, (across, up) in zip(lines, curves, strict=True):
            line.set_data(across[i], up[i])

    return Animation(ax, times[picked], show)


def _count(run: xr.Dataset, times: np.ndarray) -> int:
    """Return the number of frames that shows the fastest driven motion of a run with these instants [s]."""
    scale = float(run.attrs.get("shortest_time_scale", np.inf))
    return int(np.clip(np.ceil(FRAMES_PER_CHANGE * (times[-1] - times[0]) / scale) + 1, LEAST_FRAMES, MOST_FRAMES))
