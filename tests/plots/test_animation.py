"""Animations: frames are instants, files play, and notebooks show them."""

from __future__ import annotations

import base64
import importlib
import re
import shutil
import subprocess
import sys
import types
from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pytest
from drawings import TIME, modes_of, trajectory
from matplotlib import animation
from matplotlib import pyplot as plt
from PIL import Image

from cablepod import plots
from cablepod.errors import SceneError


def lines_of(movie):
    """The lines that move, without the grey one."""
    return movie.ax.lines[1:]


def test_frames_are_the_instants():
    chain, reduced = trajectory(), trajectory(sigma=np.linspace(0.0, 1.0, 7), seed=5)
    movie = plots.animate(chain, reduced)
    np.testing.assert_array_equal(movie.times, TIME)
    for i in (0, 3, 1):
        movie.show_frame(i)
        for line, run in zip(lines_of(movie), (chain, reduced), strict=True):
            np.testing.assert_array_equal(line.get_xydata(), run.position.values[i])
        assert movie.ax.texts[0].get_text() == f"t = {TIME[i]:g} s, 1.5 x real time"
    np.testing.assert_array_equal(movie.ax.lines[0].get_xydata(), chain.position.values[0])
    assert (movie.ax.get_xlabel(), movie.ax.get_ylabel()) == ("x [m]", "y [m]")


def test_frames_are_as_many_as_wanted_and_hold_all_of_the_motion():
    run = trajectory(times=np.linspace(0.0, 10.0, 101))
    run["position"].values[77, 1, 1] = -50.0  # in no frame but one
    movie = plots.animate(run, frames=5)
    assert movie.times.tolist() == [0.0, 2.5, 5.0, 7.5, 10.0]
    assert movie.show_frame(3).texts[0].get_text() == "t = 7.5 s, 38 x real time"
    assert plots.animate(run, frames=5).ax.get_ylim()[0] > -50.0
    assert plots.animate(run, frames=500).ax.get_ylim()[0] < -50.0


def test_frames_follow_the_fastest_driven_motion():
    run = trajectory(times=np.linspace(0.0, 10.0, 1001))
    assert plots.animate(run).times.size == 60
    assert plots.animate(run.assign_attrs(shortest_time_scale=1.0)).times.size == 121
    assert plots.animate(run.assign_attrs(shortest_time_scale=0.01)).times.size == 600
    movie = plots.animate(run.assign_attrs(shortest_time_scale=1.0))
    assert movie.show_frame(0).texts[0].get_text().endswith(f"{15 * 10.0 / 120:.2g} x real time")


def test_deflections_are_those_of_shapes():
    run = trajectory()
    movie = plots.animate(run, deflection=True)
    movie.show_frame(2)
    (line,) = plots.shapes(run, times=[0.2], deflection=True).lines
    np.testing.assert_array_equal(lines_of(movie)[0].get_xydata(), line.get_xydata())


def test_a_gif_has_a_frame_for_each_instant_and_they_differ(tmp_path):
    movie = plots.animate(trajectory())
    engine = movie.figure.get_layout_engine()
    told = []
    path = movie.save(tmp_path / "guy.gif", frames_per_second=10, progress=told.append)
    assert told == [(i + 1) / TIME.size for i in range(TIME.size)]
    with Image.open(path) as picture:
        assert picture.format == "GIF"
        assert picture.n_frames == TIME.size
        assert picture.info["duration"] == 100  # ms
        frames = []
        for i in range(picture.n_frames):
            picture.seek(i)
            frames.append(np.asarray(picture.convert("RGB")))
    assert all((a != b).any() for a, b in pairwise(frames))
    assert movie.figure.get_layout_engine() is engine


def test_a_notebook_shows_a_gif_once():
    movie = plots.animate(trajectory(), frames=2)
    page = movie._repr_html_()
    data = re.fullmatch(r'<img alt="a cable in motion, t = 0 to 0.3 s" src="data:image/gif;base64,([^"]+)">', page)[1]
    assert base64.b64decode(data).startswith(b"GIF8")
    assert movie._repr_html_() is page
    assert not plt.get_fignums()  # a figure of pyplot would be shown a second time


def test_given_axes_are_used():
    _, ax = plt.subplots()
    assert plots.animate(trajectory(), ax=ax).ax is ax


def ffmpeg():
    """The program ffmpeg of the system or of a package; None without both."""
    if found := shutil.which("ffmpeg"):
        return found
    try:
        return importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        return None


@pytest.mark.skipif(ffmpeg() is None, reason="neither ffmpeg nor imageio-ffmpeg is installed")
def test_an_mp4_has_a_frame_for_each_instant_and_they_differ(tmp_path):
    _, ax = plt.subplots(figsize=(5.0125, 3.0125))  # 401 x 241 pixels, of which a video holds even numbers only
    movie = plots.animate(trajectory(), ax=ax)
    size, told = ax.figure.get_size_inches().tolist(), mpl.rcParams["animation.ffmpeg_path"]
    path = movie.save(tmp_path / "guy.mp4", frames_per_second=10)
    assert ax.figure.get_size_inches().tolist() == size
    assert mpl.rcParams["animation.ffmpeg_path"] == told
    options = [ffmpeg(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "gray", "-"]
    read = subprocess.run(options, capture_output=True, check=True)
    assert re.search(rb"Duration: 00:00:00.40, .* h264 .* 400x240\b.* 10 fps", read.stderr, re.DOTALL)
    frames = np.frombuffer(read.stdout, np.uint8).reshape(-1, 240, 400)
    assert len(frames) == TIME.size
    # the clock alone changes some dozen pixels from black to white
    assert all((abs(a.astype(int) - b) > 100).sum() > 10 for a, b in pairwise(frames))
    for frame in frames:
        assert (frame > 240).mean() > 0.7  # a page, mostly white


@pytest.mark.parametrize("used", ["package", "system"])
def test_the_ffmpeg_of_a_package_is_found_where_there_is_no_other(used, tmp_path, monkeypatch):
    for name in ("package", "system"):  # programs that write their name
        (tmp_path / name).write_text(f'#!/bin/sh\nfor last; do :; done\ncat >/dev/null\necho {name} >"$last"\n')
        (tmp_path / name).chmod(0o755)
    monkeypatch.setattr(animation.writers, "is_available", lambda name: used == "system")
    monkeypatch.setitem(mpl.rcParams, "animation.ffmpeg_path", str(tmp_path / "system"))
    package = types.ModuleType("imageio_ffmpeg")
    package.get_ffmpeg_exe = lambda: str(tmp_path / "package")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", package)
    movie = plots.animate(trajectory(), frames=2)
    assert movie.save(tmp_path / "guy.mp4").read_text() == f"{used}\n"


@pytest.mark.parametrize("package", [None, "without a program"])
def test_an_mp4_is_refused_without_ffmpeg(tmp_path, monkeypatch, package):
    def none_there():
        raise RuntimeError("No ffmpeg exe could be found.")

    monkeypatch.setattr(animation.writers, "is_available", lambda name: False)
    there = types.ModuleType("imageio_ffmpeg")
    there.get_ffmpeg_exe = none_there
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", there if package else None)
    with pytest.raises(SceneError, match=r"path: given '.*guy\.mp4'; allowed: .*\.gif; \.mp4 needs the program ffmpeg"):
        plots.animate(trajectory(), frames=2).save(tmp_path / "guy.mp4")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: plots.animate(modes_of()), "chain: given a Dataset without position"),
        (lambda: plots.animate(trajectory(), trajectory(times=TIME + 0.05)), "times: .*instants of the reduced"),
        (lambda: plots.animate(trajectory(), frames=0), "frames: given 0; allowed: a whole number of at least 1"),
        (lambda: plots.animate(trajectory()).show_frame(4), "number: given 4; allowed: .*at most 3"),
        (lambda: plots.animate(trajectory()).save("guy.avi"), "path: given 'guy.avi'; allowed: .*gif or .mp4"),
        (lambda: plots.animate(trajectory()).save("no/such/guy.gif"), "path: .*a folder that is there"),
        (lambda: plots.animate(trajectory()).save("a.gif", frames_per_second=0), "frames_per_second: given 0"),
        (lambda: plots.animate(trajectory(), trajectory(3)), "reduced: .*the coordinates of the chain"),
    ],
)
def test_wrong_input_is_refused(act, message):
    with pytest.raises(SceneError, match=message):
        act()
