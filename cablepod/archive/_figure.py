"""Write figures as PNG files, atomically."""

from __future__ import annotations

import sys
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cablepod.archive._atomic import atomic_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Level of compression: half the time of the default, with one percent more bytes.
LEVEL = 4
#: Number of letters in a line of a title.
TITLE_WIDTH = 80


def write_figure(figure: Figure, path: Path, *, title: str = "", dpi: int = 150) -> None:
    """Write a figure as a PNG file, atomically, and close it.

    It is laid out and drawn once, where ``savefig`` draws a figure with a constrained layout twice.

    Parameters
    ----------
    figure
        With a white or another opaque background.
    path
        The file, which is replaced; its folder must exist.
    title
        Written above all axes, in lines that fit; none by default.
    dpi
        Dots per inch.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    try:
        figure.set_dpi(dpi)
        if title:
            figure.suptitle(textwrap.fill(title, TITLE_WIDTH), fontsize="medium")
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        picture = Image.fromarray(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3]))
        with atomic_file(path) as unfinished:
            picture.save(unfinished, format="png", dpi=(dpi, dpi), compress_level=LEVEL)
    finally:
        if "matplotlib.pyplot" in sys.modules:  # which keeps the figures that it made
            from matplotlib import pyplot as plt

            plt.close(figure)
