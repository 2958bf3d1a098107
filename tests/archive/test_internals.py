"""What no public function does alone: figures as PNG files, the checksum of a file and its seal, the commit of a checkout."""

from __future__ import annotations

import re
import subprocess
import zlib

import numpy as np
import pytest
from damage import with_flipped, without_seal
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.image import imread
from PIL import Image
from results import make_modes, make_scene, make_trajectory

from cablepod.archive import ArchiveError, _checked, _program, write
from cablepod.archive import _folded as folded
from cablepod.archive._figure import write_figure

KINDS = {"scene": make_scene, "modes": make_modes, "trajectory": lambda: make_trajectory(times=200)}


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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.usefixtures("without_search")
def test_every_flipped_bit_of_the_seal_is_seen(kind, tmp_path):
    """Also those of its first words: a file without a seal is taken for one that another program edited."""
    content = write(KINDS[kind](), tmp_path / "it.nc").read_bytes()
    path = tmp_path / "flipped.nc"
    for bit in range(8 * len(without_seal(content)), 8 * len(content)):
        path.write_bytes(with_flipped(content, bit))
        with pytest.raises((ArchiveError, ValueError)):  # readers make the second a message
            assert _checked.check_bytes(path, whole=True) is None, bit


@pytest.mark.parametrize("size", [0, 5, folded.LEAST - 1, folded.LEAST, 100_003, folded.PIECE, 2 * folded.PIECE + 4171])
def test_a_folded_crc_sees_what_changes(size):
    rng = np.random.default_rng(size)
    data = rng.bytes(size)
    whole = folded.folded_crc(data)
    parts, at = folded.FoldedCrc(), 0
    for step in rng.integers(1, max(2, size // 3), 20):
        parts.update(data[at : at + step])
        at += step
    parts.update(data[at:])
    assert parts.value() == whole
    if size < folded.LEAST:
        assert whole == zlib.crc32(data)
    seen = {whole}
    for bit in rng.integers(0, max(1, 8 * size), min(8 * size, 200)):
        assert folded.folded_crc(with_flipped(data, bit)) != whole
    for row in (*folded.ROWS, 1, 64):  # words that change places, in the same column of a fold or not
        for first in (0, 7):
            ends = [8 * first, 8 * (first + row)]
            if size < ends[1] + 8:
                continue
            changed = bytearray(data)
            a, b = (slice(start, start + 8) for start in ends)
            changed[a], changed[b] = data[b], data[a]
            assert folded.folded_crc(changed) not in seen
            seen.add(folded.folded_crc(changed))


def test_commit_is_that_of_the_checkout_and_absent_without_one(tmp_path, monkeypatch):
    assert _program.commit_of(tmp_path) is None
    (tmp_path / "file").write_text("1")
    who = ["-c", "user.name=n", "-c", "user.email=e@example.org", "-c", "commit.gpgsign=false"]
    for command in (["init", "-q"], ["add", "."], [*who, "commit", "-qm", "one"]):
        assert subprocess.run(["git", *command], cwd=tmp_path, capture_output=True).returncode == 0
    commit = _program.commit_of(tmp_path)
    assert re.fullmatch("[0-9a-f]{40}", commit)
    (tmp_path / "inner").mkdir()
    assert _program.commit_of(tmp_path / "inner") is None
    (tmp_path / "file").write_text("22")
    assert _program.commit_of(tmp_path) == f"{commit}-dirty"
    monkeypatch.setenv("PATH", str(tmp_path))  # where no git is
    assert _program.commit_of(tmp_path) is None
