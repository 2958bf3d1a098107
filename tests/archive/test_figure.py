"""Figures as PNG files."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.image import imread
from PIL import Image

from cablepod.archive._figure import write_figure


def drawn(figure):
    figure.subplots().plot([0.0, 1.0], [0.0, 1e5], label="a long name of a line")
    figure.axes[0].legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
    return figure


def test_the_picture_is_that_of_savefig(tmp_path):
    write_figure(drawn(Figure(figsize=(5.0, 3.0), layout="constrained")), tmp_path / "once.png")
    drawn(Figure(figsize=(5.0, 3.0), layout="constrained")).savefig(tmp_path / "twice.png", dpi=150)
    once, twice = (imread(tmp_path / f"{name}.png") for name in ("once", "twice"))
    np.testing.assert_array_equal(once, twice[..., :3])  # one has no transparency


def test_a_long_title_stands_above_the_axes_in_lines_that_fit(tmp_path):
    figure = drawn(Figure(figsize=(7.5, 4.2), layout="constrained"))
    write_figure(figure, tmp_path / "titled.png", title="A guy of the upper level, " * 5)
    lines = figure.get_suptitle().split("\n")
    assert len(lines) == 2
    box, frame = figure._suptitle.get_window_extent(), figure.bbox
    assert frame.x0 < box.x0 < box.x1 < frame.x1
    assert figure.axes[0].get_window_extent().y1 < box.y0 < box.y1 < frame.y1


def test_an_interrupted_write_leaves_the_old_picture_and_no_open_figure(tmp_path, monkeypatch):
    path = tmp_path / "it.png"
    write_figure(Figure(), path)
    old = path.read_bytes()

    def half(self, target, **options):
        target.write_bytes(b"\x89PNG")
        raise KeyboardInterrupt

    monkeypatch.setattr(Image.Image, "save", half)
    figure = plt.figure()
    with pytest.raises(KeyboardInterrupt):
        write_figure(figure, path)
    assert path.read_bytes() == old
    assert [item.name for item in tmp_path.iterdir()] == ["it.png"]
    assert not plt.fignum_exists(figure.number)
