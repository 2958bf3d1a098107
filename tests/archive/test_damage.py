"""Damage and edits of files are seen: flipped bits, edits by other programs, also in parts read lazily."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from damage import flipped, with_flipped, without_seal
from results import make_modes, make_scene, make_trajectory

from cablepod.archive import ArchiveError, describe, read, write

KINDS = {"scene": make_scene, "modes": make_modes, "trajectory": lambda: make_trajectory(times=200)}


def edit(path, name="tension", place=(0, 0), value=1.0, **attrs):
    """Edit a file as other programs do."""
    netCDF4 = pytest.importorskip("netCDF4")
    with netCDF4.Dataset(path, "r+") as file:
        file.variables[name][place] = value
        file.setncatts(attrs)


def lazily(path):
    with read(path, chunks={}) as dataset:
        # a thread that still reads when another one has failed would open the file again after it was closed
        return dataset.load(scheduler="synchronous")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("flips", [30, pytest.param(500, marks=pytest.mark.slow)])
@pytest.mark.usefixtures("without_search")
def test_a_flipped_bit_is_seen(kind, flips, tmp_path):
    content = write(KINDS[kind](), tmp_path / "it.nc").read_bytes()
    path = tmp_path / "flipped.nc"
    for seed in range(flips):
        path.write_bytes(flipped(content, seed))
        for task in (read, lazily, describe):
            with pytest.raises(ArchiveError, match=r"changed since it was written|truncated or damaged|not a netCDF-4"):
                task(path)
    path.write_bytes(content)
    xr.testing.assert_identical(read(path), read(tmp_path / "it.nc"))


@pytest.mark.parametrize("sealed", [True, False])
@pytest.mark.usefixtures("large_files")
def test_a_file_that_lost_its_checksums_is_refused(sealed, tmp_path):
    content = write(make_modes(), tmp_path / "it.nc").read_bytes()
    path = tmp_path / "lost.nc"
    path.write_bytes(content)
    with pytest.importorskip("netCDF4").Dataset(path, "r+") as file:
        file.renameAttribute("cablepod_checksums", "cablepod_checksumt")
    if sealed:
        with path.open("ab") as file:
            file.write(content[len(without_seal(content)) :])
    with pytest.raises(ArchiveError, match=r"lost\.nc: changed since it was written: attribute cablepod_checksums;"):
        lazily(path)
    assert read(path, verify=False).equals(read(tmp_path / "it.nc"))


@pytest.mark.parametrize("kind", KINDS)
def test_values_are_right_or_refused_also_without_the_seal(kind, tmp_path):
    """A file that lost its seal, as one edited by another program, is compared variable by variable."""
    whole = write(KINDS[kind](), tmp_path / "it.nc")
    content, wanted = without_seal(whole.read_bytes()), read(whole)
    values = next(variable.values for variable in wanted.values() if variable.dtype.kind == "f")
    start = content.index(values.tobytes()[:8])  # stands in the file as it is; elsewhere the library may hang
    path = tmp_path / "flipped.nc"
    for bit in range(0, 64, 3):  # some of each byte
        path.write_bytes(with_flipped(content, 8 * start + bit))
        for task in (read, lazily):
            with pytest.raises(ArchiveError, match="changed since it was written"):
                task(path)
    path.write_bytes(content)
    xr.testing.assert_identical(read(path), wanted)


def test_an_edit_is_named_and_taken_on_demand(tmp_path):
    path = write(make_trajectory(), tmp_path / "it.nc")
    before = read(path)
    edit(path)
    with pytest.raises(ArchiveError, match=r"it\.nc: changed since it was written: tension; .*verify=False"):
        read(path)
    lazy = read(path, chunks={})
    lazy["position"].load()  # which is as it was
    with pytest.raises(ArchiveError, match=r"it\.nc: changed since it was written: tension;"):
        lazy["tension"].load()
    lazy.close()
    edited = read(path, verify=False)
    assert edited["tension"][0, 0] == 1.0
    edited.close()
    again = read(write(edited, tmp_path / "again.nc"))
    assert again.attrs["id"] != before.attrs["id"]
    assert "changed outside the package" in again.attrs["history_json"]
    edit(path := write(before, tmp_path / "titled.nc"), value=before["tension"].values[0, 0], title="Mine")
    for task in (read, lazily, describe):
        with pytest.raises(ArchiveError, match=r"titled\.nc: changed since it was written: attribute title;"):
            task(path)
    assert read(path, verify=False).attrs["title"] == "Mine"


def test_damage_is_named(tmp_path):
    content = write(make_modes(), path := tmp_path / "it.nc").read_bytes()
    first = read(path)["mode_shape"].values.astype("<f8").tobytes()
    path.write_bytes(with_flipped(content, 8 * content.index(first)))
    with pytest.raises(ArchiveError, match=r"it\.nc: changed since it was written: mode_shape;"):
        read(path)


@pytest.mark.parametrize(
    ("chunks", "block"),  # each of both, and the finest of one with the coarsest of the other
    [({}, 64), ({"time": 7}, 1000), ({"time": 7, "particle": 4}, 64), ({"time": 7, "particle": 4}, 1 << 20), ({"time": -1}, 64)],
)  # fmt: skip
@pytest.mark.usefixtures("large_files")
def test_blocks_are_compared_whatever_is_selected(chunks, block, tmp_path, checksum_block):
    checksum_block(block)
    path = write(make_trajectory(), tmp_path / "it.nc")
    wanted = make_trajectory()
    selections = [
        {"time": 3}, {"time": slice(5, 40, 3)}, {"time": slice(40, 5, -2), "particle": -1}, {"time": [1, 5, 2]},
        {"time": slice(0, 0)}, {"time": -1, "coordinate": 0}, {},
    ]  # fmt: skip
    for selection in selections:
        with read(path, chunks=chunks) as dataset:
            xr.testing.assert_equal(dataset.isel(selection, missing_dims="ignore"), wanted.isel(selection))
    edit(path, place=(50, 3))
    with (
        read(path, chunks=chunks) as dataset,
        pytest.raises(ArchiveError, match="changed since it was written: tension;"),
    ):
        dataset["tension"].isel(time=50).load()


@pytest.mark.parametrize("case", ["lazy", "texts", "objects", "nan", "empty", "big endian", "integers", "order"])
def test_what_is_written_is_found_unchanged(case, tmp_path, checksum_block):
    rng = np.random.default_rng(3)
    checksum_block(512)
    attrs = {
        "one": [1.5], "text": ["a"], "texts": ["a", "é"], "zero": -0.0, "nan": np.nan, "empty": "", "i": np.int8(3),
    }  # fmt: skip
    values = rng.normal(size=(50, 6, 2))
    dataset = {
        "lazy": lambda: xr.Dataset({"a": (("time", "x", "y"), values, attrs)}).chunk(time=7, x=4),
        "texts": lambda: xr.Dataset({"a": ("x", ["", "é", "long" * 30]), "b": ((), "σ")}),
        "objects": lambda: xr.Dataset({"a": ("x", np.array(["a", "", "b"], dtype=object))}),
        "nan": lambda: xr.Dataset({"a": ("x", [np.nan, -np.nan, np.inf, -0.0]), "b": ((), np.nan)}, {"x": [3, 1, 2, 0]}),
        "empty": lambda: xr.Dataset({"a": (("time", "x"), np.zeros((0, 3)))}, {"x": ["a", "b", "c"]}),
        "big endian": lambda: xr.Dataset({"a": ("x", np.arange(4.0).astype(">f8"))}, {"x": np.arange(4, dtype=">i2")}),
        "integers": lambda: xr.Dataset({"a": (("time", "x"), rng.integers(9, size=(300, 7)))}, {"x": np.arange(7, dtype="u1")}),
        "order": lambda: xr.Dataset({"a": (("x", "time", "y"), values), "b": (("member", "time"), values[:3, :, 0])}),
    }[case]()  # fmt: skip
    dataset.attrs = attrs
    path = write(dataset, tmp_path / "it.nc")
    sealed = read(path)
    path.write_bytes(without_seal(path.read_bytes()))
    xr.testing.assert_identical(read(path), sealed)
    xr.testing.assert_identical(lazily(path), sealed)
